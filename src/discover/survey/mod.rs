//! A search of the whole range of values, for trials whose starts are known.
//!
//! Where things collide the way downhill from the nominal latents ends in the first hollow: the right friction and a
//! rough floor are far apart, and in between every collision goes another way. Stretches that start from what was seen
//! have no nuisances, so many values can simply be tried: drawn all at once (`cross_entropy`), each stretch counting by the
//! logarithm of how far off it is, so that those that fit say more than those that went astray; and where that meets too
//! narrow a place, on grids (`scan`).
//!
//! Source: Cauchy's likelihood as a redescending loss (Huber and Ronchetti, Robust Statistics, chapter 4).

mod cross_entropy;
mod scan;

use super::library;
use super::model::{self, FitState, Linearization, Parameter, ParameterLayout, SegmentData};
use super::window::{self, SegmentKind};
use crate::error::Result;
use crate::world::effect::{ParameterDeclaration, ParameterRole, ShapeParameter};
use cross_entropy::LATENT_SD_FACTOR;
use scan::SearchProblem;

/// Stretches that take part: so many of those that fit at the start, and of those that do not.
const MAX_SEGMENTS: usize = 24;
/// Places that frame something.
const MIN_MISFIT_PLACES: usize = 4;
/// Square, over what noise leaves, up to which a stretch fits.
const FIT_THRESHOLD: f64 = 6.0;
/// Deviation of latents about where they stand, as a share of the range that is usual.
const LATENT_SD_SHARE: f64 = 0.35;
/// Shares of the first deviations from which edges are searched for again.
const REFINEMENT_SHARES: [f64; 3] = [0.2, 0.05, 0.02];
/// Widths of a scan, as shares of the deviation, each about the best value of the one before, and the values tried on each
/// side: where there are edges, and to end a search. Where nothing is right yet, the place that fits is a few hundredths of
/// the deviation wide.
const SCAN_WIDTHS: [(f64, i32); 4] = [(2.0, 100), (0.4, 12), (0.08, 12), (0.015, 12)];
const FINAL_SCAN_WIDTHS: [(f64, i32); 3] = [(0.1, 12), (0.02, 12), (0.004, 12)];
/// Shares of the places where things go wrong that a frame may leave out on each side.
const FRAME_MARGINS: [f64; 3] = [0.0, 0.1, 0.3];
/// Size of an amplitude at most, in sizes that are usual.
const MAX_AMPLITUDE: f64 = 3.0;
/// Values that a latent usually has at most.
const MAX_USUAL_LATENT: f64 = 2.0;

/// Whether there is anything to survey: stretches without nuisances, and values that all trials share.
pub fn is_applicable(data: &SegmentData, layout: &ParameterLayout) -> bool {
    !layout.parameters.is_empty()
        && layout.parameters.iter().all(|s| s.setting.is_none())
        && window::any_known_initial_state(data.segments)
}

/// The state of the best values found about `start`.
pub fn global_search(
    data: &SegmentData,
    layout: &ParameterLayout,
    start: &FitState,
    seed: u64,
) -> Result<FitState> {
    let looks = model::linearise(data, layout, start, &[])?;
    let spread = search_widths(data, layout, start, &looks);
    let over = SearchProblem { data, layout, segments: &informative_segments(data, &looks) };
    let best = over.cross_entropy(start, &spread, seed)?;
    let best = over.pair_scan(best, &spread)?;
    let best = over.scan(best, &spread, &FINAL_SCAN_WIDTHS)?;
    if layout.has_discontinuities() { edge_search(over, start, best, &spread, seed) } else { Ok(best) }
}

/// The state of the best values found about `start` where each number is tried twice as far to either side as it may plausibly be, one
/// after the other: what is rough enough to stick and what slips, say, are far apart. Edges stay where they are.
pub fn wide_scan(data: &SegmentData, layout: &ParameterLayout, start: &FitState) -> Result<FitState> {
    let looks = model::linearise(data, layout, start, &[])?;
    let mut spread = search_widths(data, layout, start, &looks);
    for (i, spread) in spread.iter_mut().enumerate() {
        let edge =
            |p: &ParameterDeclaration| matches!(p.role, ParameterRole::Shape(ShapeParameter::Edge { .. }));
        if layout.declaration(i).is_some_and(edge) {
            *spread = 0.0;
        }
    }
    SearchProblem { data, layout, segments: &usable_segments(data) }.scan(
        start.clone(),
        &spread,
        &SCAN_WIDTHS,
    )
}

/// The best values with edges in space, which paths feel by leaps and bounds as they cross them a step sooner or later: they
/// are searched for again, closer and closer, since the way downhill does not lead to them.
fn edge_search(
    over: SearchProblem,
    start: &FitState,
    best: FitState,
    spread: &[f64],
    seed: u64,
) -> Result<FitState> {
    let SearchProblem { data, layout, .. } = over;
    let mut best = best;
    let places = misfit_places(data, layout, start)?;
    for margin in FRAME_MARGINS.into_iter().filter(|_| places[0].len() >= MIN_MISFIT_PLACES) {
        let (start, spread) = frame_edges(layout, start, spread, &places, margin);
        let other = over.scan(start, &spread, &SCAN_WIDTHS)?;
        let losses = over.losses(&[best.values.clone(), other.values.clone()])?;
        best = if losses[1] < losses[0] { other } else { best };
    }
    // What is right by now of the latents need not be searched for again.
    let own = |(i, s): (usize, &f64)| {
        if layout.parameters[i].latent().is_some() { LATENT_SD_FACTOR * s } else { *s }
    };
    let spread: Vec<f64> = spread.iter().enumerate().map(own).collect();
    for share in REFINEMENT_SHARES {
        let looks = model::linearise(data, layout, &best, &[])?;
        let spread: Vec<f64> = spread.iter().map(|s| share * s).collect();
        let over = SearchProblem { segments: &informative_segments(data, &looks), ..over };
        best = over.cross_entropy(&best, &spread, seed)?;
        best = over.scan(best, &spread, &SCAN_WIDTHS)?;
    }
    // An edge is told by the few that cross it: in the end all have their say.
    let spread: Vec<f64> = spread.iter().map(|s| REFINEMENT_SHARES[2] * s).collect();
    SearchProblem { segments: &usable_segments(data), ..over }.scan(best, &spread, &SCAN_WIDTHS)
}

/// x and y of the places where the model without the effect goes wrong, each in order, m.
fn misfit_places(data: &SegmentData, layout: &ParameterLayout, start: &FitState) -> Result<[Vec<f64>; 2]> {
    let mut without = start.clone();
    for (i, value) in without.values.iter_mut().enumerate() {
        if let Some(amplitude) = layout.declaration(i).filter(|p| p.is_amplitude()) {
            *value = amplitude.neutral;
        }
    }
    let mut places: [Vec<f64>; 2] = Default::default();
    for (look, window) in model::linearise(data, layout, &without, &[])?.iter().zip(data.segments) {
        let off = |i: usize| look.residual[2 * i].hypot(look.residual[2 * i + 1]);
        for (i, point) in
            window.observations.iter().enumerate().filter(|_| window.kind == SegmentKind::OneStep)
        {
            if off(i).powi(2) > FIT_THRESHOLD {
                let from = window.scene.bodies[point.body].position.unwrap_or(point.position);
                (0..2).for_each(|k| places[k].push(0.5 * (from[k] + point.position[k])));
            }
        }
    }
    places.iter_mut().for_each(|p| p.sort_by(f64::total_cmp));
    Ok(places)
}

/// A start with edges about `places`, all but the outermost share `margin`, and deviations from it; latents are taken for
/// nearly right.
fn frame_edges(
    layout: &ParameterLayout,
    start: &FitState,
    spread: &[f64],
    places: &[Vec<f64>; 2],
    margin: f64,
) -> (FitState, Vec<f64>) {
    let at = |k: usize, share: f64| places[k][(share * (places[k].len() - 1) as f64) as usize];
    let (mut framed, mut near) = (start.clone(), spread.to_vec());
    for (i, near) in near.iter_mut().enumerate() {
        let Some(parameter) = layout.declaration(i) else {
            *near *= LATENT_SD_FACTOR;
            continue;
        };
        let ParameterRole::Shape(ShapeParameter::Edge { axis, end }) = parameter.role else {
            // The way downhill from nothing leads to small amplitudes alone.
            *near = MAX_AMPLITUDE * parameter.typical_size;
            framed.values[i] = parameter.neutral + *near;
            continue;
        };
        let share = if end == 0 { margin } else { 1.0 - margin };
        framed.values[i] = at(axis, share);
        *near = 0.25 * (at(axis, 1.0) - at(axis, 0.0)) + 0.2;
    }
    (framed, near)
}

/// Stretches that start where everything is known and are not left out.
fn usable_segments(data: &SegmentData) -> Vec<usize> {
    let counts = |w: &usize| data.segments[*w].kind.has_known_initial_state() && data.sd[*w].is_finite();
    (0..data.segments.len()).filter(counts).collect()
}

/// Stretches that take part, in order: evenly spread over those that fit and over those that do not.
fn informative_segments(data: &SegmentData, looks: &[Linearization]) -> Vec<usize> {
    let fits =
        |w: &usize| looks[*w].square < FIT_THRESHOLD * 2.0 * data.segments[*w].observations.len() as f64;
    let (well, ill): (Vec<usize>, Vec<usize>) = usable_segments(data).into_iter().partition(fits);
    // What one kind lacks the other may have.
    let most = |other: &[usize]| 2 * MAX_SEGMENTS - other.len().min(MAX_SEGMENTS);
    let some = |of: &[usize], most: usize| -> Vec<usize> {
        of.iter().copied().step_by(of.len().div_ceil(most).max(1)).collect()
    };
    let mut out = [some(&well, most(&ill)), some(&ill, most(&well))].concat();
    out.sort_unstable();
    out
}

/// How far each value may plausibly be from where it stands: latents over their usual range, shapes over what the data
/// span, amplitudes as far as would move paths by what is left, within what is usual.
fn search_widths(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    looks: &[Linearization],
) -> Vec<f64> {
    let span = library::data_range(data.segments);
    let [x0, y0, x1, y1] = span.area;
    let left: f64 = looks.iter().map(|l| l.residual.norm_squared()).sum();
    let of = |(i, slot): (usize, &Parameter)| {
        let [low, high] = slot.bounds;
        let Some(parameter) = layout.declaration(i) else {
            return LATENT_SD_SHARE * (high - low).min(MAX_USUAL_LATENT);
        };
        let told: f64 = looks.iter().map(|l| l.jacobian.column(i).norm_squared()).sum();
        match parameter.role {
            ParameterRole::Amplitude => {
                let usual = parameter.typical_size;
                (left / told.max(1e-12)).sqrt().clamp(0.3 * usual, MAX_AMPLITUDE * usual)
            }
            ParameterRole::Shape(ShapeParameter::Place | ShapeParameter::Edge { .. }) => {
                0.25 * (x1 - x0).max(y1 - y0)
            }
            ParameterRole::Shape(ShapeParameter::Velocity) => span.speed,
            ParameterRole::Shape(ShapeParameter::Time) => 0.25 * span.duration,
            ParameterRole::Shape(ShapeParameter::Period | ShapeParameter::Width) => {
                0.5 * state.values[i].abs()
            }
            ParameterRole::Shape(ShapeParameter::Phase) => 1.5,
            ParameterRole::Shape(ShapeParameter::Power) => 1.0,
        }
    };
    layout.parameters.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, one_step_segments, term};
    use crate::world::Engine;

    #[test]
    fn a_wind_is_found_to_the_last_where_nothing_errs() {
        let (windows, settings) = one_step_segments(0.731);
        let data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![0.0, 0.0], vec![Vec::new(); windows.len()]);
        let found = global_search(&data, &layout, &start, 3).unwrap().values;
        assert!((found[0] - 0.731).abs() < 2e-3 && found[1].abs() < 2e-3, "{found:?}");
    }

    /// From a wind that is far off; edges that nothing tells stay.
    #[test]
    fn a_number_far_off_is_found_and_edges_stay() {
        let (windows, settings) = one_step_segments(0.731);
        let data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![-0.6, 0.0], vec![Vec::new(); windows.len()]);
        let found = wide_scan(&data, &layout, &start).unwrap().values;
        assert!((found[0] - 0.731).abs() < 2e-2 && found[1].abs() < 2e-2, "{found:?}");
        let layout = ParameterLayout::new(&[], vec![term("sticky_patch")], 1);
        let start = FitState::new(layout.initial_values(&[0.0, 0.0, 0.0]), vec![Vec::new(); windows.len()]);
        let found = wide_scan(&data, &layout, &start).unwrap().values;
        for i in 0..layout.parameters.len() {
            let edge = layout
                .declaration(i)
                .is_some_and(|p| matches!(p.role, ParameterRole::Shape(ShapeParameter::Edge { .. })));
            assert!(!edge || found[i] == start.values[i], "{i}: {found:?}");
        }
    }

    #[test]
    fn what_has_starts_of_its_own_or_settings_is_not_surveyed() {
        let ask = |(windows, settings): (Vec<window::Segment>, Vec<usize>), per_setting: bool| {
            let data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
            let term = model::Term { per_setting, ..term("wind") };
            is_applicable(&data, &ParameterLayout::new(&[], vec![term], 2))
        };
        assert!(ask(one_step_segments(0.0), false));
        assert!(!ask(one_step_segments(0.0), true));
        assert!(!ask(flights([0.0; 2], 2), false));
    }

    /// Edges stand about the places where things go wrong, as near as the margin has it; amplitudes are of the usual size.
    #[test]
    fn a_frame_holds_the_places_where_things_go_wrong() {
        let layout = ParameterLayout::new(&[1], vec![term("sticky_patch")], 1);
        let start = FitState::new(layout.initial_values(&[0.0, 0.3, 0.0]), Vec::new());
        let places = [(0..11).map(f64::from).collect::<Vec<_>>(), vec![5.0; 11]];
        for (margin, edges) in [(0.0, [0.0, 10.0]), (0.3, [3.0, 7.0])] {
            let (framed, spread) = frame_edges(&layout, &start, &[1.0; 6], &places, margin);
            let of = |name: &str| {
                let slot = |i: &usize| layout.declaration(*i).is_some_and(|p| p.name == name);
                framed.values[(0..6).find(slot).unwrap()]
            };
            assert_eq!([of("x_min"), of("x_max"), of("y_min"), of("y_max")], [edges[0], edges[1], 5.0, 5.0]);
            assert!(of("c") > 0.0 && framed.values[0] == 0.3 && spread[0] == LATENT_SD_FACTOR);
        }
    }
}
