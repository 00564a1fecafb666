//! Residual force field: the mean acceleration that the reported model lacks, per cell of the plane.
//!
//! The shared discrepancy field (`field`) is fitted to all trials in addition to the model, and averaged over
//! the observed states in each cell.

use crate::error::Result;
use crate::inference::field::{FieldSpec, field_estimate};
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model;
use crate::inference::report::{ResidualField, round_to_six_digits};
use crate::inference::segment::SegmentKind;

/// Number of cells along x and y.
const CELLS: [usize; 2] = [12, 8];

/// Time, s, and state x, y, vx, vy of a point on a path.
type TimedState = (f64, [f64; 4]);

/// Residual field in every visited cell; `None` if it cannot be fitted.
pub fn residual_field(
    fitter: &ModelFitter,
    model: &FittedModel,
    form: FieldSpec,
) -> Result<Option<ResidualField>> {
    let Some(left) = field_estimate(fitter, model, form)? else { return Ok(None) };
    let paths = model::segment_states(fitter.data, &model.layout, &model.state)?;
    let flights = fitter.data.segments.iter().zip(&paths).filter(|(w, _)| w.kind == SegmentKind::Flight);
    let states =
        flights.flat_map(|(w, path)| w.observations.iter().zip(path).map(|(p, s)| (w.start + p.time, *s)));
    let rows =
        cells(states.filter(|(_, s)| s.iter().all(|v| v.is_finite())).collect()).into_iter().map(|own| {
            let mean = |k: usize| own.iter().map(|(_, s)| s[k]).sum::<f64>() / own.len() as f64;
            let [acceleration, sd] = left.mean(&own);
            [mean(0), mean(1), acceleration[0], acceleration[1], sd[0], sd[1]].map(round_to_six_digits)
        });
    let rows: Vec<[f64; 6]> = rows.collect();
    let columns = ["x", "y", "ax", "ay", "sd_ax", "sd_ay"].map(String::from).to_vec();
    Ok((!rows.is_empty()).then_some(ResidualField { columns, rows }))
}

/// Groups states by cell; empty cells are omitted.
fn cells(states: Vec<TimedState>) -> Vec<Vec<TimedState>> {
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
    use crate::inference::field::FieldInputs;
    use crate::inference::testing::throws;

    const FIELD: FieldSpec = FieldSpec { inputs: FieldInputs::All, coefficient_sd: 2.0 };

    /// A missing drag appears with its sign and size; a modelled one does not.
    #[test]
    fn missing_effects_appear_in_the_residual_field() {
        throws::with_fit(&[0.4; 10], &[], 10, |fitter, base| {
            let left = residual_field(fitter, base, FIELD).unwrap().unwrap();
            assert!(left.rows.len() > 10 && left.rows.len() <= CELLS[0] * CELLS[1]);
            // Trials move along x at 4 to 11 m/s.
            let significant: Vec<_> = left.rows.iter().filter(|r| r[2].abs() > 2.0 * r[4]).collect();
            assert!(
                significant.len() > 5 && significant.iter().all(|r| (-6.0..-0.3).contains(&r[2])),
                "{significant:?}"
            );
        });
        throws::with_fit(&[0.4; 10], &["linear_drag"], 10, |fitter, with| {
            let left = residual_field(fitter, with, FIELD).unwrap().unwrap();
            let significant = left.rows.iter().filter(|r| r[2].abs() > 3.0 * r[4]).count();
            assert!(5 * significant <= left.rows.len(), "{significant} of {}", left.rows.len());
        });
    }

    #[test]
    fn cells_partition_the_states() {
        let states: Vec<TimedState> =
            (0..50).map(|i| (0.0, [f64::from(i), f64::from(i * i % 7), 0.0, 0.0])).collect();
        let cells = cells(states);
        assert_eq!(cells.iter().map(Vec::len).sum::<usize>(), 50);
        assert!(cells.iter().all(|c| !c.is_empty()));
    }
}
