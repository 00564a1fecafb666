//! The field of what is left: what pushes launches beside the reported model, where they flew.
//!
//! The shared force field without a name (`field`), fitted to all launches beside the model, as its mean over the states that
//! were flown through in each cell of the plane: what it says of velocities and of times nobody flew with is not asked.

use super::field::{Form, left};
use super::fit::{Fitted, Fitter};
use super::model;
use super::report::{FieldLeft, rounded};
use super::window::Kind;
use crate::error::Result;

/// Cells along x and y.
const CELLS: [usize; 2] = [12, 8];

/// A state on a path: clock time, s; x, y, vx, vy.
type Flown = (f64, [f64; 4]);

/// A field beside a model in every cell that was flown through; `None` where it cannot be fitted.
pub fn field(fitter: &Fitter, model: &Fitted, form: Form) -> Result<Option<FieldLeft>> {
    let Some(left) = left(fitter, model, form)? else { return Ok(None) };
    let paths = model::paths(fitter.data, &model.layout, &model.state)?;
    let flights = fitter.data.windows.iter().zip(&paths).filter(|(w, _)| w.kind == Kind::Flight);
    let states = flights.flat_map(|(w, path)| w.points.iter().zip(path).map(|(p, s)| (w.start + p.time, *s)));
    let rows =
        cells(states.filter(|(_, s)| s.iter().all(|v| v.is_finite())).collect()).into_iter().map(|own| {
            let mean = |k: usize| own.iter().map(|(_, s)| s[k]).sum::<f64>() / own.len() as f64;
            let [push, sd] = left.mean(&own);
            [mean(0), mean(1), push[0], push[1], sd[0], sd[1]].map(rounded)
        });
    let rows: Vec<[f64; 6]> = rows.collect();
    let columns = &["x", "y", "ax", "ay", "sd_ax", "sd_ay"];
    Ok((!rows.is_empty()).then_some(FieldLeft { columns, rows }))
}

/// States by the cell that they are in; cells without any are left out.
fn cells(states: Vec<Flown>) -> Vec<Vec<Flown>> {
    let span = [0, 1].map(|k| {
        let all = || states.iter().map(|(_, s)| s[k]);
        [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]
    });
    let mut filled = vec![Vec::new(); CELLS[0] * CELLS[1]];
    for state in states {
        let [i, j] = [0, 1].map(|k| {
            let share = (state.1[k] - span[k][0]) / (span[k][1] - span[k][0]).max(1e-12);
            ((share * CELLS[k] as f64) as usize).min(CELLS[k] - 1)
        });
        filled[j * CELLS[0] + i].push(state);
    }
    filled.retain(|own| !own.is_empty());
    filled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::field::Over;
    use crate::discover::thrown;

    const FIELD: Form = Form { over: Over::All, strength: 2.0 };

    /// A drag that the model has not is left: it pushes against the launches, by about its size where it is told; and what a
    /// model has is not left.
    #[test]
    fn what_a_model_lacks_pushes_where_launches_flew() {
        thrown::fitted(&[0.4; 10], &[], 10, |fitter, base| {
            let left = field(fitter, base, FIELD).unwrap().unwrap();
            assert!(left.rows.len() > 10 && left.rows.len() <= CELLS[0] * CELLS[1]);
            // Launches fly along x at 4 to 11 m/s.
            let told: Vec<_> = left.rows.iter().filter(|r| r[2].abs() > 2.0 * r[4]).collect();
            assert!(told.len() > 5 && told.iter().all(|r| (-6.0..-0.3).contains(&r[2])), "{told:?}");
        });
        thrown::fitted(&[0.4; 10], &["linear_drag"], 10, |fitter, with| {
            let left = field(fitter, with, FIELD).unwrap().unwrap();
            let told = left.rows.iter().filter(|r| r[2].abs() > 3.0 * r[4]).count();
            assert!(5 * told <= left.rows.len(), "{told} of {}", left.rows.len());
        });
    }

    #[test]
    fn cells_hold_every_state_once() {
        let states: Vec<Flown> =
            (0..50).map(|i| (0.0, [f64::from(i), f64::from(i * i % 7), 0.0, 0.0])).collect();
        let cells = cells(states);
        assert_eq!(cells.iter().map(Vec::len).sum::<usize>(), 50);
        assert!(cells.iter().all(|c| !c.is_empty()));
    }
}
