//! Where surfaces really are: offsets of statics from where the scene has them, by the bounces off them.
//!
//! Tables are level to millimetres at best, and a ball's radius is known to a hundredth. Where a ball bounces is found in every
//! contact segment along with its start; what all bounces off a static have in common is an error of the scene. The surface is
//! moved by it, so that no effect gains from explaining it.

use super::model::FitState;
use super::report::SurfaceOffset;
use super::stats::mean_and_error;
use super::window::{Segment, SegmentKind};
use crate::task::Scene;

/// Standard errors from which an offset counts, and bounces that it needs.
const MIN_STANDARD_ERRORS: f64 = 3.0;
const MIN_BOUNCES: usize = 4;
/// Offsets that are plausible without a word, m, or as a share of the radius.
const PLAUSIBLE_OFFSET: f64 = 2e-3;
const PLAUSIBLE_OFFSET_OF_RADIUS: f64 = 0.01;
/// Cosine between normals of one face.
const SAME_FACE: f64 = 0.99;

/// The offset of a face of a static along its normal.
#[derive(Clone, Debug)]
pub struct FaceOffset {
    /// Index of the static, and the face's normal.
    static_index: usize,
    normal: [f64; 2],
    radius: f64,
    /// m, and its standard error.
    pub mean: f64,
    pub error: f64,
}

/// Offsets of the faces off which bodies bounce, at a fitted state: those that are beyond their error.
pub fn offsets(windows: &[Segment], state: &FitState) -> Vec<FaceOffset> {
    let mut faces: Vec<(FaceOffset, Vec<f64>)> = Vec::new();
    for (window, nuisances) in windows.iter().zip(&state.nuisances) {
        let (SegmentKind::Contact, Some(surface), Some(height)) =
            (window.kind, &window.surface, nuisances.get(5))
        else {
            continue;
        };
        let (fixed, normal, radius) = (surface.static_index, surface.normal, surface.radius);
        match faces.iter_mut().find(|(face, _)| face.is(fixed, normal)) {
            Some((_, heights)) => heights.push(*height),
            None => faces.push((
                FaceOffset { static_index: fixed, normal, radius, mean: 0.0, error: 0.0 },
                vec![*height],
            )),
        }
    }
    let measured =
        faces.into_iter().filter(|(_, heights)| heights.len() >= MIN_BOUNCES).map(|(face, heights)| {
            let (mean, error) = mean_and_error(&heights);
            FaceOffset { mean, error, ..face }
        });
    measured.filter(|o| o.mean.abs() > MIN_STANDARD_ERRORS * o.error).collect()
}

/// Windows whose surfaces are moved by their offsets; `None` without any.
pub fn shifted(windows: &[Segment], offsets: &[FaceOffset]) -> Option<Vec<Segment>> {
    let mut windows = if offsets.is_empty() { return None } else { windows.to_vec() };
    for surface in windows.iter_mut().filter_map(|w| w.surface.as_mut()) {
        if let Some(offset) = offsets.iter().find(|o| o.is(surface.static_index, surface.normal)) {
            surface.level += offset.mean;
        }
    }
    Some(windows)
}

/// The offsets that are larger than what is plausible without a word.
pub fn report(scene: &Scene, offsets: &[FaceOffset]) -> Vec<SurfaceOffset> {
    let is_large =
        |o: &&FaceOffset| o.mean.abs() > PLAUSIBLE_OFFSET.max(PLAUSIBLE_OFFSET_OF_RADIUS * o.radius);
    let of = |o: &FaceOffset| SurfaceOffset {
        name: scene.statics[o.static_index].name.clone(),
        normal: o.normal,
        offset: o.mean,
        sd: o.error,
    };
    offsets.iter().filter(is_large).map(of).collect()
}

/// The same in words; nothing where there are none.
pub fn text(all: &[SurfaceOffset]) -> String {
    let one = |o: &SurfaceOffset| {
        let (mm, sd) = (1e3 * o.offset, 1e3 * o.sd);
        format!(
            "; bounces are {mm:+.1} +- {sd:.1} mm from where the scene has \"{}\", along its normal",
            o.name
        )
    };
    all.iter().map(one).collect()
}

impl FaceOffset {
    fn is(&self, fixed: usize, normal: [f64; 2]) -> bool {
        self.static_index == fixed && self.normal[0] * normal[0] + self.normal[1] * normal[1] > SAME_FACE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::bounces;

    /// Bounces that are all 3 mm too low move their surface; those that scatter about it do not.
    #[test]
    fn what_bounces_share_is_the_surfaces_offset() {
        let (windows, _) = bounces(0.8, 6);
        let state = |height: &dyn Fn(usize) -> f64| {
            let mut state = FitState::new(Vec::new(), windows.iter().map(|w| w.nuisances.clone()).collect());
            for (w, nuisances) in state.nuisances.iter_mut().enumerate() {
                if let Some(h) = nuisances.get_mut(5) {
                    *h = height(w);
                }
            }
            state
        };
        let scattered = |w: usize| 1e-3 * libm::sin((w * w) as f64);
        assert!(offsets(&windows, &state(&scattered)).is_empty());
        let found = offsets(&windows, &state(&|w| scattered(w) - 3e-3));
        assert!(found.len() == 1 && (found[0].mean + 3e-3).abs() < 1e-3, "{found:?}");
        let moved = shifted(&windows, &found).unwrap();
        assert!(shifted(&windows, &[]).is_none());
        let level = |windows: &[Segment]| windows.iter().find_map(|w| w.surface.as_ref()).unwrap().level;
        assert!((level(&moved) - level(&windows) - found[0].mean).abs() < 1e-12);
        let told = report(&windows[0].scene, &[]);
        assert!(told.is_empty() && text(&told).is_empty());
    }
}
