//! Shared model discrepancy: a small acceleration field over position and velocity, a small displacement of
//! observed positions over position, and small impact errors over approach and slip speed.
//!
//! No set-up follows a textbook law exactly, and its errors (lens, air in the room, a drag coefficient that
//! is not quite constant) are the same in all trials. Models therefore predict y = f(theta) + F w + ..., w ~
//! N(0, s^2 I), with the same w for every trial. The columns of F are the responses of observed positions to
//! Gaussian radial basis functions, constants and trends, and displacements by a lens and by an oblique view,
//! scaled so that s = 1 is the largest plausible discrepancy: see [`Settings`].
//!
//! Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; Brynjarsdottir and O'Hagan, Inverse Probl. 30 (2014) 114007;
//! radial and decentring distortion of lenses: Brown, Photogramm. Eng. 32 (1966) 444.
//!
//! Differences from the sources: basis functions of fixed widths replace a Gaussian process; responses are computed once,
//! along the paths of the richest model, and are the same for every set of effects.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::settings::{SETTINGS, Settings};
use crate::budget::checked;
use crate::error::Result;
use crate::inference::dynamics::Impact;
use crate::inference::field::{RadialBasisFunction, radial_grid, robust_range};
use crate::inference::mixed_model::groups::Group;
use crate::inference::model::{self, FitState, ParameterLayout, SegmentData};
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::selection::candidates;
use crate::inference::statistics::median;

/// Numbers of radial basis functions over position (x, y), velocity (x, y) and impacts (approach, slip).
const POSITION_BUMPS: [usize; 2] = [5, 4];
const VELOCITY_BUMPS: [usize; 2] = [4, 3];
const IMPACT_BUMPS: [usize; 2] = [4, 3];
/// Number of acceleration fields along an axis that are constant or linear in the state.
const TRENDS: usize = 5;
/// Number of modes of camera distortion.
const CAMERA_MODES: usize = 5;

/// Responses of observations to the shared discrepancy.
#[derive(Clone)]
pub struct SharedDiscrepancy {
    /// By segment: response of the observations, two rows each, to every basis function at its largest
    /// plausible size, m.
    pub responses: Vec<DMatrix<f64>>,
    /// Number of basis functions.
    pub count: usize,
    /// Ratio of a broad field (as large as the acceleration beyond gravity) to the largest plausible discrepancy.
    pub broad_ratio: f64,
    /// Largest plausible discrepancy, m/s^2, and the part of it that does not grow with the acceleration beyond gravity.
    pub acceleration: f64,
    base_acceleration: f64,
    /// Its functions, and largest plausible displacement, m.
    basis: Arc<DiscrepancyBasis>,
    position: f64,
    /// Coefficients of the functions by direction, if the basis is restricted to these.
    directions: Option<DMatrix<f64>>,
}

impl SharedDiscrepancy {
    /// Responses along the trajectories of the richest model.
    pub fn from_model(
        data: &SegmentData,
        layout: &ParameterLayout,
        state: &FitState,
        settings: &Settings,
    ) -> Result<Self> {
        let paths = model::segment_states(data, layout, state)?;
        let impacts = data.each_segment(|w, segment| match segment.kind {
            kind if kind.is_impact() => model::impact(segment, w, layout, state),
            _ => None,
        })?;
        let typical = typical_acceleration(data, layout, state, &paths)?;
        let base = settings.discrepancy_of_gravity * acceleration_scale(data, &paths);
        let acceleration = base.hypot(settings.discrepancy_of_acceleration * typical);
        let [x0, y0, x1, y1] = candidates::data_range(data.segments).area;
        let position = settings.discrepancy_of_position * (x1 - x0).max(y1 - y0);
        let fields = DiscrepancyBasis::over(data, &paths, &impacts)?;
        let column = |w: usize, segment: &Segment| {
            fields.responses(segment, &paths[w], impacts[w].as_ref(), [acceleration, position], settings)
        };
        let columns: Vec<DMatrix<f64>> = data.each_segment(column)?;
        let count = if columns.iter().all(|c| c.iter().all(|v| *v == 0.0)) { 0 } else { fields.count() };
        let broad = (typical / acceleration).max(3.0 * base / acceleration).max(1.0);
        let basis = Arc::new(fields);
        Ok(SharedDiscrepancy {
            responses: columns,
            count,
            broad_ratio: broad,
            acceleration,
            base_acceleration: base,
            basis,
            position,
            directions: None,
        })
    }

    /// Responses of the observations of another flight along its path (x, y, vx, vy): two rows per observation. `typical`: its
    /// acceleration beyond gravity, m/s^2. Beyond the visited states the fields continue as at their edge.
    pub fn responses_along(&self, segment: &Segment, path: &[[f64; 4]], typical: f64) -> DMatrix<f64> {
        if self.count == 0 {
            return DMatrix::zeros(2 * path.len(), 0);
        }
        let acceleration = self.base_acceleration.hypot(SETTINGS.discrepancy_of_acceleration * typical);
        let path: Vec<[f64; 4]> = path.iter().map(|state| self.basis.nearest_visited(*state)).collect();
        let all = self.basis.responses(segment, &path, None, [acceleration, self.position], &SETTINGS);
        match &self.directions {
            Some(directions) => all * directions,
            None => all,
        }
    }
}

/// Minimum information of a direction of the basis, and maximum number of directions.
const MIN_INFORMATION: f64 = 0.01;
const MAX_DIRECTIONS: usize = 40;

impl SharedDiscrepancy {
    /// Restricts the basis to the directions with most information; an isotropic prior stays isotropic.
    /// `groups`: groups with the basis after the first `parameters` columns.
    pub fn reduced(
        &self,
        data: &SegmentData,
        groups: &[Group],
        parameters: usize,
    ) -> Result<SharedDiscrepancy> {
        if self.count == 0 {
            return Ok(self.clone());
        }
        let mut information = DMatrix::zeros(self.count, self.count);
        for block in groups.iter().flat_map(|p| &p.blocks) {
            let own = block.jacobian.columns(parameters, self.count);
            information += own.tr_mul(&own);
        }
        let eigen = information.symmetric_eigen();
        let mut order: Vec<usize> =
            (0..self.count).filter(|k| eigen.eigenvalues[*k] > MIN_INFORMATION).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(MAX_DIRECTIONS);
        let directions = eigen.eigenvectors.select_columns(&order);
        let columns = data.each_segment(|w, _| &self.responses[w] * &directions)?;
        let (responses, count, directions) = (columns, order.len(), Some(directions));
        Ok(SharedDiscrepancy { responses, count, directions, ..self.clone() })
    }
}

/// Median over flights of the root mean square acceleration beyond gravity, m/s^2; 0 without flights.
fn typical_acceleration(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    paths: &[Vec<[f64; 4]>],
) -> Result<f64> {
    let of = |w: usize, segment: &Segment| {
        if !matches!(segment.kind, SegmentKind::Flight | SegmentKind::Rolling) {
            return None;
        }
        let values = state.values_in(w);
        Some(rms_beyond_gravity(segment, &model::accelerations(segment, layout, &values, &paths[w])))
    };
    Ok(median(&data.each_segment(of)?.into_iter().flatten().collect::<Vec<_>>()))
}

/// Root mean square of the finite accelerations, without gravity, m/s^2.
pub fn rms_beyond_gravity(segment: &Segment, accelerations: &[[f64; 2]]) -> f64 {
    let g = segment.scene.gravity;
    let square = accelerations.iter().map(|a| (a[0] - g[0]).powi(2) + (a[1] - g[1]).powi(2));
    let square: Vec<f64> = square.filter(|s| s.is_finite()).collect();
    (square.iter().sum::<f64>() / square.len().max(1) as f64).sqrt()
}

/// Gravity; without it the square of the typical speed over the size of the region, m/s^2.
fn acceleration_scale(data: &SegmentData, paths: &[Vec<[f64; 4]>]) -> f64 {
    let gravity = candidates::max_gravity(data.segments);
    if gravity > 0.0 {
        return gravity;
    }
    let states = || paths.iter().flatten().filter(|s| s.iter().all(|v| v.is_finite()));
    let speed = median(&states().map(|s| s[2].hypot(s[3])).collect::<Vec<_>>());
    let extent = |k: usize| {
        let [low, high] = robust_range(states().map(|s| s[k]).collect());
        high - low
    };
    speed * speed / extent(0).max(extent(1)).max(1e-9)
}

/// All basis functions with their normalisation.
struct DiscrepancyBasis {
    position: Vec<RadialBasisFunction>,
    velocity: Vec<RadialBasisFunction>,
    impact: Vec<RadialBasisFunction>,
    /// Centre and half extent of the visited states (m, m/s).
    centre: [f64; 4],
    half_extent: [f64; 4],
    /// Root of the mean, over visited states and over impacts, of the sum of squared functions along an axis.
    bump_norm: f64,
    trend_norm: f64,
    camera_norm: f64,
    impact_norm: f64,
}

impl DiscrepancyBasis {
    fn over(
        data: &SegmentData,
        paths: &[Vec<[f64; 4]>],
        impacts: &[Option<Impact>],
    ) -> Result<DiscrepancyBasis> {
        let states: Vec<[f64; 4]> = (data.segments.iter().zip(paths))
            .filter(|(w, _)| w.kind.has_free_initial_state())
            .flat_map(|(_, path)| path.iter().copied())
            .filter(|s| s.iter().all(|v| v.is_finite()))
            .collect();
        let range = |k: usize| robust_range(states.iter().map(|s| s[k]).collect());
        let hits: Vec<[f64; 2]> = impacts.iter().flatten().map(|i| [i.approach, i.slip]).collect();
        let hit_range = |k: usize| robust_range(hits.iter().map(|h| h[k]).collect());
        let position = radial_grid([range(0), range(1)], POSITION_BUMPS);
        let velocity = radial_grid([range(2), range(3)], VELOCITY_BUMPS);
        let impact = if hits.is_empty() {
            Vec::new()
        } else {
            radial_grid([hit_range(0), hit_range(1)], IMPACT_BUMPS)
        };
        let ranges = [0, 1, 2, 3].map(range);
        let mut fields = DiscrepancyBasis {
            position,
            velocity,
            impact,
            centre: ranges.map(|[low, high]| 0.5 * (low + high)),
            half_extent: ranges.map(|[low, high]| (0.5 * (high - low)).max(1e-9)),
            bump_norm: 1.0,
            trend_norm: 1.0,
            camera_norm: 1.0,
            impact_norm: 1.0,
        };
        let norm =
            |squares: Vec<f64>| (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt().max(1e-12);
        let squares = |of: &dyn Fn([f64; 4]) -> Vec<f64>| -> Result<Vec<f64>> {
            checked(&states, &data.progress).map(|s| Ok(of(*s?).iter().map(|f| f * f).sum())).collect()
        };
        fields.bump_norm = norm(squares(&|s| fields.bumps(s).collect())?);
        fields.trend_norm = norm(squares(&|s| fields.trends(s).to_vec())?);
        // Displacements are along both axes, the norm is along one.
        fields.camera_norm = 0.5f64.sqrt() * norm(squares(&|s| fields.displacements(s).concat())?);
        fields.impact_norm =
            norm(hits.iter().map(|h| fields.impact.iter().map(|b| b.at(*h).powi(2)).sum()).collect());
        Ok(fields)
    }

    fn count(&self) -> usize {
        2 * (self.acceleration_count() + self.impact.len()) + CAMERA_MODES
    }

    /// The nearest state in the range of visited ones.
    fn nearest_visited(&self, state: [f64; 4]) -> [f64; 4] {
        let near = |k: usize| {
            let [centre, half] = [self.centre[k], self.half_extent[k]];
            state[k].clamp(centre - half, centre + half)
        };
        std::array::from_fn(near)
    }

    /// Displacements of a position by a camera: radial distortion, decentring distortion along x and y, and an
    /// oblique view along x and y. All vanish at the centre and grow towards the edges.
    fn displacements(&self, [x, y, _, _]: [f64; 4]) -> [[f64; 2]; CAMERA_MODES] {
        let half = self.half_extent[0].max(self.half_extent[1]);
        let [x, y] = [x - self.centre[0], y - self.centre[1]].map(|d| d / half);
        let square = x * x + y * y;
        [
            [square * x, square * y],
            [square + 2.0 * x * x, 2.0 * x * y],
            [2.0 * x * y, square + 2.0 * y * y],
            [x * x, x * y],
            [x * y, y * y],
        ]
    }

    /// Number of acceleration fields along an axis.
    fn acceleration_count(&self) -> usize {
        self.position.len() + self.velocity.len() + TRENDS
    }

    fn bumps(&self, [x, y, vx, vy]: [f64; 4]) -> impl Iterator<Item = f64> {
        let position = self.position.iter().map(move |b| b.at([x, y]));
        position.chain(self.velocity.iter().map(move |b| b.at([vx, vy])))
    }

    /// A constant acceleration, and four that are linear in position and velocity.
    fn trends(&self, state: [f64; 4]) -> [f64; TRENDS] {
        let [x, y, vx, vy] = std::array::from_fn(|k| (state[k] - self.centre[k]) / self.half_extent[k]);
        [1.0, x, y, vx, vy]
    }

    /// Acceleration fields with a total root mean square of one along an axis; radial basis functions and trends
    /// have half of the variance each.
    fn at_state(&self, state: [f64; 4]) -> Vec<f64> {
        let [bump, trend] = [self.bump_norm, self.trend_norm].map(|norm| 0.5f64.sqrt() / norm);
        let bumps = self.bumps(state).map(|f| bump * f);
        bumps.chain(self.trends(state).map(|f| trend * f)).collect()
    }

    /// Response of a segment's observations to fields of `acceleration`, m/s^2, displacements of `position`,
    /// m, and the plausible impact errors: two rows per observation, x and y of every function in turn.
    fn responses(
        &self,
        segment: &Segment,
        path: &[[f64; 4]],
        impact: Option<&Impact>,
        [acceleration, position]: [f64; 2],
        settings: &Settings,
    ) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(2 * segment.observations.len(), self.count());
        if !segment.kind.has_free_initial_state() || path.iter().flatten().any(|v| !v.is_finite()) {
            return out;
        }
        self.integrate(segment, path, acceleration, &mut out);
        let first = 2 * self.acceleration_count();
        for (i, state) in path.iter().enumerate() {
            for (k, moved) in self.displacements(*state).into_iter().enumerate() {
                (0..2).for_each(|a| out[(2 * i + a, first + k)] = position / self.camera_norm * moved[a]);
            }
        }
        if let Some(impact) = impact {
            let [of_approach, of_tangent] = settings.discrepancy_of_impact;
            let normal = of_approach * impact.approach;
            let sizes =
                [normal, normal.hypot(of_tangent * impact.tangent)].map(|size| size / self.impact_norm);
            let [nx, ny] = impact.direction;
            let first = first + CAMERA_MODES;
            for (k, bump) in self.impact.iter().enumerate() {
                let current = bump.at([impact.approach, impact.slip]);
                for (way, along) in [[nx, ny], [-ny, nx]].into_iter().enumerate() {
                    let size = sizes[way] * current;
                    for (i, point) in segment.observations.iter().enumerate() {
                        let since = impact.shares[point.body] * (point.time - impact.time).max(0.0);
                        (0..2).for_each(|a| out[(2 * i + a, first + 2 * k + way)] = since * size * along[a]);
                    }
                }
            }
        }
        out
    }

    /// Integrates every function twice along a trajectory; along the surface if the body rolls.
    fn integrate(&self, segment: &Segment, path: &[[f64; 4]], size: f64, out: &mut DMatrix<f64>) {
        let tangent = match (&segment.surface, segment.kind) {
            (Some(surface), kind) if kind.is_supported() => Some([surface.normal[1], -surface.normal[0]]),
            _ => None,
        };
        let count = self.acceleration_count();
        let (mut speed, mut moved) = (vec![0.0; count], vec![0.0; count]);
        let mut before: Option<(f64, Vec<f64>)> = None;
        for (i, (point, state)) in segment.observations.iter().zip(path).enumerate() {
            let now = self.at_state(*state);
            // A body at rest is held there.
            if segment.kind == SegmentKind::Sliding && state[2] == 0.0 && state[3] == 0.0 {
                speed.fill(0.0);
            }
            // Each body's trajectory begins anew.
            let same = i > 0 && segment.observations[i - 1].body == point.body;
            if !same {
                speed.fill(0.0);
                moved.fill(0.0);
            }
            if let Some((time, last)) = before.filter(|_| same) {
                let dt = point.time - time;
                for k in 0..count {
                    let a = 0.5 * size * (last[k] + now[k]);
                    moved[k] += speed[k] * dt + 0.5 * a * dt * dt;
                    speed[k] += a * dt;
                    for axis in 0..2 {
                        match tangent {
                            None => out[(2 * i + axis, 2 * k + axis)] = moved[k],
                            Some(t) => (0..2).for_each(|row| {
                                out[(2 * i + row, 2 * k + axis)] = moved[k] * t[axis] * t[row];
                            }),
                        }
                    }
                }
            }
            before = Some((point.time, now));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{bounces, flights, one_step_segments};
    use crate::world::Engine;

    fn discrepancy_of(segments: &[Segment], settings: &[usize]) -> SharedDiscrepancy {
        let data = SegmentData::new(segments, settings, vec![1e-3; segments.len()], Engine::Auto);
        let state = FitState::new(Vec::new(), segments.iter().map(|w| w.nuisances.clone()).collect());
        SharedDiscrepancy::from_model(&data, &ParameterLayout::new(&[], Vec::new(), 1), &state, &SETTINGS)
            .unwrap()
    }

    /// Without other accelerations the largest plausible discrepancy is a hundredth of gravity, with a
    /// displacement of about a t^2 / 2.
    #[test]
    fn a_hundredth_of_gravity_is_plausible() {
        let (segments, settings) = flights([0.0; 2], 4);
        let found = discrepancy_of(&segments, &settings);
        assert!((found.acceleration - 0.0981).abs() < 1e-6, "{}", found.acceleration);
        let bumps = POSITION_BUMPS.iter().product::<usize>() + VELOCITY_BUMPS.iter().product::<usize>();
        let fields = 2 * (bumps + TRENDS);
        let rows = |c: &DMatrix<f64>| c.columns(0, fields).row(c.nrows() - 2).norm();
        let time = segments[0].observations[19].time;
        let expected = 0.5 * found.acceleration * time * time;
        let moved = rows(&found.responses[0]);
        assert!((0.3 * expected..1.5 * expected).contains(&moved), "{moved} and {expected}");
        let begins = |c: &DMatrix<f64>| c.columns(0, fields).row(0).norm() == 0.0;
        assert!(found.responses.iter().all(begins), "a path begins where it begins");
        // The displacement of observed positions is a few thousandths of the extent.
        let [x0, y0, x1, y1] = candidates::data_range(&segments).area;
        let view = found.responses[0].columns(fields, found.responses[0].ncols() - fields).row(0).norm();
        let plausible = SETTINGS.discrepancy_of_position * (x1 - x0).max(y1 - y0);
        assert!((0.2 * plausible..3.0 * plausible).contains(&view), "{view} and {plausible}");
    }

    /// Beyond the visited velocities the fields are as at their edge, and grow with the acceleration only.
    #[test]
    fn the_discrepancy_of_another_flight_is_bounded() {
        let (segments, settings) = flights([0.0; 2], 4);
        let found = discrepancy_of(&segments, &settings);
        let count = segments[0].observations.len();
        let path = |speed: f64| vec![[0.0, 1.0, speed, speed]; count];
        let size = |speed: f64, typical: f64| {
            found.responses_along(&segments[0], &path(speed), typical).row(2 * count - 2).norm()
        };
        let edge = size(1e3, 0.0);
        assert!(edge > 0.0 && (size(1e6, 0.0) / edge - 1.0).abs() < 1e-9, "{} and {edge}", size(1e6, 0.0));
        let time = segments[0].observations[count - 1].time;
        assert!(edge < 2.0 * found.acceleration * time * time, "{edge} m");
        assert!(size(1e3, 50.0) > 3.0 * edge);
    }

    /// Impact errors act after the impact only; fully observed segments have no discrepancy.
    #[test]
    fn impact_errors_act_after_impact() {
        let (segments, settings) = bounces(0.8, 3);
        let found = discrepancy_of(&segments, &settings);
        let first = found.count - 2 * IMPACT_BUMPS[0] * IMPACT_BUMPS[1];
        let (w, contact) = segments.iter().enumerate().find(|(_, w)| w.kind == SegmentKind::Contact).unwrap();
        let own = found.responses[w].columns(first, found.count - first).into_owned();
        let last = own.nrows() - 1;
        assert!(
            own.row(1).norm() == 0.0 && own.row(last).norm() > 0.0,
            "{} points",
            contact.observations.len()
        );
        let (segments, settings) = one_step_segments(0.0);
        assert_eq!(discrepancy_of(&segments, &settings).count, 0);
    }
}
