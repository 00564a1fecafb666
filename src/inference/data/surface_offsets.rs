//! Offsets of surfaces from their positions in the scene, estimated from bounces.
//!
//! Tables are level to millimetres at best, and a ball's radius is known to about 1 %. The offset of the
//! surface is a nuisance of every contact segment; the mean over all bounces on a static is an error of the
//! scene. The surface is moved by it, so that no effect gains from explaining it.

use crate::inference::model::FitState;
use crate::inference::report::SurfaceOffset;
use crate::inference::segment::Segment;
use crate::inference::statistics::mean_and_error;
use crate::task::Scene;

/// Minimum offset in standard errors, and minimum number of bounces.
const MIN_STANDARD_ERRORS: f64 = 3.0;
const MIN_BOUNCES: usize = 4;
/// Offsets that are not reported, m, and as a share of the radius.
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

/// Significant offsets of faces at a fitted state.
pub fn offsets(segments: &[Segment], state: &FitState) -> Vec<FaceOffset> {
    let mut faces: Vec<(FaceOffset, Vec<f64>)> = Vec::new();
    for (segment, nuisances) in segments.iter().zip(&state.nuisances) {
        let (true, Some(surface), Some(height)) =
            (segment.kind.is_impact(), &segment.surface, nuisances.get(5))
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

/// Segments with surfaces moved by their offsets; `None` without any.
pub fn shifted(segments: &[Segment], offsets: &[FaceOffset]) -> Option<Vec<Segment>> {
    let mut segments = if offsets.is_empty() { return None } else { segments.to_vec() };
    for surface in segments.iter_mut().filter_map(|w| w.surface.as_mut()) {
        if let Some(offset) = offsets.iter().find(|o| o.is(surface.static_index, surface.normal)) {
            surface.level += offset.mean;
        }
    }
    Some(segments)
}

/// The offsets to be reported.
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

/// Text for the report; empty without offsets.
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
    use crate::inference::testing::segments::bounces;

    /// A common offset of 3 mm moves the surface; scatter about it does not.
    #[test]
    fn common_bounce_offset_moves_the_surface() {
        let (segments, _) = bounces(0.8, 6);
        let state = |height: &dyn Fn(usize) -> f64| {
            let mut state = FitState::new(Vec::new(), segments.iter().map(|w| w.nuisances.clone()).collect());
            for (w, nuisances) in state.nuisances.iter_mut().enumerate() {
                if let Some(h) = nuisances.get_mut(5) {
                    *h = height(w);
                }
            }
            state
        };
        let scattered = |w: usize| 1e-3 * libm::sin((w * w) as f64);
        assert!(offsets(&segments, &state(&scattered)).is_empty());
        let found = offsets(&segments, &state(&|w| scattered(w) - 3e-3));
        assert!(found.len() == 1 && (found[0].mean + 3e-3).abs() < 1e-3, "{found:?}");
        let moved = shifted(&segments, &found).unwrap();
        assert!(shifted(&segments, &[]).is_none());
        let level = |segments: &[Segment]| segments.iter().find_map(|w| w.surface.as_ref()).unwrap().level;
        assert!((level(&moved) - level(&segments) - found[0].mean).abs() < 1e-12);
        let reported = report(&segments[0].scene, &[]);
        assert!(reported.is_empty() && text(&reported).is_empty());
    }
}
