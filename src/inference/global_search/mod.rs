//! Global search for segments with known initial states.
//!
//! With collisions the loss has many local optima. Segments with known initial states have no nuisances, so
//! that many parameter vectors can be tried: by the cross-entropy method (`cross_entropy`) with a loss that
//! is logarithmic in large residuals, and on grids (`grid_scan`) where optima are too narrow for sampling.
//!
//! Source: Cauchy's likelihood as a redescending loss (Huber and Ronchetti, Robust Statistics, chapter 4).

mod cross_entropy;
mod grid_scan;

use crate::error::Result;
use crate::inference::model::{self, FitState, Linearization, Parameter, ParameterLayout, SegmentData};
use crate::inference::segment::{self, SegmentKind};
use crate::inference::selection::candidates;
use crate::world::effect::{ParameterDeclaration, ParameterRole, ShapeParameter};
use cross_entropy::LATENT_SD_FACTOR;
use grid_scan::SearchProblem;

/// Maximum number of segments used: of those that fit at the start, and of those that do not.
const MAX_SEGMENTS: usize = 24;
/// Minimum number of misfit positions to initialise a region.
const MIN_MISFIT_PLACES: usize = 4;
/// Square per degree of freedom up to which a segment fits.
const FIT_THRESHOLD: f64 = 6.0;
/// Standard deviation of latents, as a share of their usual range.
const LATENT_SD_SHARE: f64 = 0.35;
/// Shares of the initial standard deviations for repeated searches over edges.
const REFINEMENT_SHARES: [f64; 3] = [0.2, 0.05, 0.02];
/// Scan widths, as shares of the standard deviation, each about the best value of the previous one, and grid
/// points per side: for edges, and at the end of a search. Optima can be a few hundredths of the standard
/// deviation wide.
const SCAN_WIDTHS: [(f64, i32); 4] = [(2.0, 100), (0.4, 12), (0.08, 12), (0.015, 12)];
const FINAL_SCAN_WIDTHS: [(f64, i32); 3] = [(0.1, 12), (0.02, 12), (0.004, 12)];
/// Shares of misfit positions on each side that an initial region may exclude.
const FRAME_MARGINS: [f64; 3] = [0.0, 0.1, 0.3];
/// Maximum amplitude, in typical amplitudes.
const MAX_AMPLITUDE: f64 = 3.0;
/// Usual range of a latent.
const MAX_USUAL_LATENT: f64 = 2.0;

/// Whether a global search applies: there are segments with known initial states, and all parameters are
/// shared by all settings.
pub fn is_applicable(data: &SegmentData, layout: &ParameterLayout) -> bool {
    !layout.parameters.is_empty()
        && layout.parameters.iter().all(|s| s.setting.is_none())
        && segment::any_known_initial_state(data.segments)
}

/// Best state found about `start`.
pub fn global_search(
    data: &SegmentData,
    layout: &ParameterLayout,
    start: &FitState,
    seed: u64,
) -> Result<FitState> {
    let linearizations = model::linearise(data, layout, start, &[])?;
    let spread = search_widths(data, layout, start, &linearizations);
    let over = SearchProblem { data, layout, segments: &informative_segments(data, &linearizations) };
    let best = over.cross_entropy(start, &spread, seed)?;
    let best = over.pair_scan(best, &spread)?;
    let best = over.scan(best, &spread, &FINAL_SCAN_WIDTHS)?;
    if layout.has_discontinuities() { edge_search(over, start, best, &spread, seed) } else { Ok(best) }
}

/// Best state after scanning each parameter, one after the other, over twice its plausible width: sticking
/// and slipping friction are separate optima. Edges are not scanned.
pub fn wide_scan(data: &SegmentData, layout: &ParameterLayout, start: &FitState) -> Result<FitState> {
    let linearizations = model::linearise(data, layout, start, &[])?;
    let mut spread = search_widths(data, layout, start, &linearizations);
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

/// Global search over edges of regions, in which the loss is discontinuous; repeated with smaller widths.
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
    // Latents are nearly right by now.
    let own = |(i, s): (usize, &f64)| {
        if layout.parameters[i].latent().is_some() { LATENT_SD_FACTOR * s } else { *s }
    };
    let spread: Vec<f64> = spread.iter().enumerate().map(own).collect();
    for share in REFINEMENT_SHARES {
        let linearizations = model::linearise(data, layout, &best, &[])?;
        let spread: Vec<f64> = spread.iter().map(|s| share * s).collect();
        let over = SearchProblem { segments: &informative_segments(data, &linearizations), ..over };
        best = over.cross_entropy(&best, &spread, seed)?;
        best = over.scan(best, &spread, &SCAN_WIDTHS)?;
    }
    // Few segments cross an edge: the last scan uses all.
    let spread: Vec<f64> = spread.iter().map(|s| REFINEMENT_SHARES[2] * s).collect();
    SearchProblem { segments: &usable_segments(data), ..over }.scan(best, &spread, &SCAN_WIDTHS)
}

/// Sorted x and y of the positions at which the model without the effect does not fit, m.
fn misfit_places(data: &SegmentData, layout: &ParameterLayout, start: &FitState) -> Result<[Vec<f64>; 2]> {
    let mut without = start.clone();
    for (i, value) in without.values.iter_mut().enumerate() {
        if let Some(amplitude) = layout.declaration(i).filter(|p| p.is_amplitude()) {
            *value = amplitude.neutral;
        }
    }
    let mut places: [Vec<f64>; 2] = Default::default();
    for (linearization, segment) in model::linearise(data, layout, &without, &[])?.iter().zip(data.segments) {
        let off = |i: usize| linearization.residual[2 * i].hypot(linearization.residual[2 * i + 1]);
        for (i, point) in
            segment.observations.iter().enumerate().filter(|_| segment.kind == SegmentKind::OneStep)
        {
            if off(i).powi(2) > FIT_THRESHOLD {
                let from = segment.scene.bodies[point.body].position.unwrap_or(point.position);
                (0..2).for_each(|k| places[k].push(0.5 * (from[k] + point.position[k])));
            }
        }
    }
    places.iter_mut().for_each(|p| p.sort_by(f64::total_cmp));
    Ok(places)
}

/// Initial state with edges around `places` without the outermost share `margin`, and its standard
/// deviations.
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
            // Large initial amplitudes: descent from zero finds small ones only.
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

/// Used segments with known initial states.
fn usable_segments(data: &SegmentData) -> Vec<usize> {
    let counts = |w: &usize| data.segments[*w].kind.has_known_initial_state() && data.sd[*w].is_finite();
    (0..data.segments.len()).filter(counts).collect()
}

/// Selection of segments for a search, evenly spaced among those that fit and those that do not.
fn informative_segments(data: &SegmentData, linearizations: &[Linearization]) -> Vec<usize> {
    let fits = |w: &usize| {
        linearizations[*w].square < FIT_THRESHOLD * 2.0 * data.segments[*w].observations.len() as f64
    };
    let (well, ill): (Vec<usize>, Vec<usize>) = usable_segments(data).into_iter().partition(fits);
    // Either kind may use the share that the other leaves.
    let most = |other: &[usize]| 2 * MAX_SEGMENTS - other.len().min(MAX_SEGMENTS);
    let some = |of: &[usize], most: usize| -> Vec<usize> {
        of.iter().copied().step_by(of.len().div_ceil(most).max(1)).collect()
    };
    let mut out = [some(&well, most(&ill)), some(&ill, most(&well))].concat();
    out.sort_unstable();
    out
}

/// Plausible standard deviation of every parameter: usual range of latents, range of the data for shapes, and
/// for amplitudes what would explain the residual, within typical sizes.
fn search_widths(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    linearizations: &[Linearization],
) -> Vec<f64> {
    let span = candidates::data_range(data.segments);
    let [x0, y0, x1, y1] = span.area;
    let left: f64 = linearizations.iter().map(|l| l.residual.norm_squared()).sum();
    let of = |(i, slot): (usize, &Parameter)| {
        let [low, high] = slot.bounds;
        let Some(parameter) = layout.declaration(i) else {
            return LATENT_SD_SHARE * (high - low).min(MAX_USUAL_LATENT);
        };
        let information: f64 = linearizations.iter().map(|l| l.jacobian.column(i).norm_squared()).sum();
        match parameter.role {
            ParameterRole::Amplitude => {
                let usual = parameter.typical_size;
                (left / information.max(1e-12)).sqrt().clamp(0.3 * usual, MAX_AMPLITUDE * usual)
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
    use crate::inference::testing::segments::{flights, one_step_segments, term};
    use crate::world::Engine;

    #[test]
    fn global_search_recovers_wind() {
        let (segments, settings) = one_step_segments(0.731);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![0.0, 0.0], vec![Vec::new(); segments.len()]);
        let found = global_search(&data, &layout, &start, 3).unwrap().values;
        assert!((found[0] - 0.731).abs() < 2e-3 && found[1].abs() < 2e-3, "{found:?}");
    }

    /// Recovers a wind from far off; unidentified edges do not move.
    #[test]
    fn wide_scan_recovers_wind_and_keeps_edges() {
        let (segments, settings) = one_step_segments(0.731);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = FitState::new(vec![-0.6, 0.0], vec![Vec::new(); segments.len()]);
        let found = wide_scan(&data, &layout, &start).unwrap().values;
        assert!((found[0] - 0.731).abs() < 2e-2 && found[1].abs() < 2e-2, "{found:?}");
        let layout = ParameterLayout::new(&[], vec![term("sticky_patch")], 1);
        let start = FitState::new(layout.initial_values(&[0.0, 0.0, 0.0]), vec![Vec::new(); segments.len()]);
        let found = wide_scan(&data, &layout, &start).unwrap().values;
        for i in 0..layout.parameters.len() {
            let edge = layout
                .declaration(i)
                .is_some_and(|p| matches!(p.role, ParameterRole::Shape(ShapeParameter::Edge { .. })));
            assert!(!edge || found[i] == start.values[i], "{i}: {found:?}");
        }
    }

    #[test]
    fn global_search_needs_known_states_and_shared_parameters() {
        let ask = |(segments, settings): (Vec<segment::Segment>, Vec<usize>), per_setting: bool| {
            let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
            let term = model::Term { per_setting, ..term("wind") };
            is_applicable(&data, &ParameterLayout::new(&[], vec![term], 2))
        };
        assert!(ask(one_step_segments(0.0), false));
        assert!(!ask(one_step_segments(0.0), true));
        assert!(!ask(flights([0.0; 2], 2), false));
    }

    /// Edges enclose the misfit positions up to the margin; amplitudes have typical size.
    #[test]
    fn initial_regions_enclose_misfit_positions() {
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
