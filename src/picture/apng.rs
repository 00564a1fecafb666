//! Animated PNG (APNG), which browsers and notebooks play and Pillow reads frame by frame.
//!
//! Static bodies are drawn once; each further frame contains only the rectangle that changed. Between two samples bodies are interpolated
//! as in [`super::animation`].

use png::{BitDepth, BlendOp, ColorType, DisposeOp, Encoder};
use resvg::tiny_skia::Pixmap;

use super::animation::{END_PAUSE_S, PathPoint, paths};
use super::png::{checked_side, draw, draw_over, height, parse};
use super::scene::{BodyStyle, Style, document, draw_body, draw_statics, title};
use super::svg::px;
use super::viewport::Viewport;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// Default frame rate, 1/s.
pub const DEFAULT_FPS: u32 = 30;
/// Maximal frame rate, 1/s: that of screens.
pub const MAX_FPS: u32 = 60;
/// Maximal number of frames: two minutes at the default rate, about 2 s of work at the default width.
pub const MAX_FRAMES: u64 = 3600;
/// Maximal number of pixels of all frames; each is copied, drawn and compared in about 6 ns.
pub const MAX_PIXELS: u64 = 1_000_000_000;

/// The animation of a trajectory, `fps` frames a second from its first sample to its last, which is shown for a second. It repeats
/// forever. The budget is checked before each frame.
pub fn animation_png(
    budget: &dyn Budget,
    scene: &Scene,
    trajectory: &Trajectory,
    style: &Style,
    fps: u32,
) -> Result<Vec<u8>> {
    let width = checked_side("width", style.width)?;
    let view = Viewport::new(scene, Some(trajectory), f64::from(width));
    let mut fixed = String::new();
    draw_statics(&mut fixed, scene, &view);
    let tree = parse(&document(view.width, view.height, &title(scene), &fixed))?;
    let fixed = draw(&tree, width, height(&tree, width)?)?;
    let moments = frame_times(trajectory, fps);
    let paths = paths(scene, trajectory);
    let frame = |t: &f64| {
        budget.check()?;
        let mut frame = fixed.clone();
        draw_over(&parse(&bodies_svg(scene, &paths, &view, *t))?, &mut frame);
        Ok(frame)
    };
    encode_apng(moments.len() as u32, moments.iter().map(frame), fps)
}

/// The last frame of a trajectory's animation.
pub fn final_frame_svg(scene: &Scene, trajectory: &Trajectory, style: &Style) -> String {
    let view = Viewport::new(scene, Some(trajectory), style.width_px());
    let mut body = String::new();
    draw_statics(&mut body, scene, &view);
    draw_bodies_at(&mut body, scene, &paths(scene, trajectory), &view, f64::INFINITY);
    document(view.width, view.height, &title(scene), &body)
}

/// Errors if an animation of `seconds` exceeds the limits of a request.
pub fn check_size(scene: &Scene, seconds: f64, width: u32, fps: u32) -> Result<()> {
    let frames = frame_count(seconds, fps);
    let advice = "take a smaller `fps`";
    if frames > MAX_FRAMES {
        return Err(Error::TooLarge { what: "frames of a film", asked: frames, limit: MAX_FRAMES, advice });
    }
    let view = Viewport::new(scene, None, f64::from(checked_side("width", width)?));
    let pixels = frames.saturating_mul((view.width * view.height) as u64);
    if pixels > MAX_PIXELS {
        let (what, advice) = ("pixels of a film", "take a smaller `width` or `fps`");
        return Err(Error::TooLarge { what, asked: pixels, limit: MAX_PIXELS, advice });
    }
    Ok(())
}

/// Number of frames of an animation.
fn frame_count(seconds: f64, fps: u32) -> u64 {
    // Tolerates rounding in a whole number of frames.
    (seconds * f64::from(fps) - 1e-6).max(0.0).ceil() as u64 + 1
}

/// Times of the frames, s; the last one is the end.
fn frame_times(trajectory: &Trajectory, fps: u32) -> Vec<f64> {
    let (Some(start), Some(end)) = (trajectory.times.first(), trajectory.times.last()) else {
        return vec![0.0];
    };
    (0..frame_count(end - start, fps)).map(|k| (start + k as f64 / f64::from(fps)).min(*end)).collect()
}

/// The bodies at time `t` on a transparent background.
fn bodies_svg(scene: &Scene, paths: &[Vec<PathPoint>], view: &Viewport, t: f64) -> String {
    let (w, h) = (px(view.width), px(view.height));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">"
    );
    draw_bodies_at(&mut svg, scene, paths, view, t);
    svg.push_str("</svg>");
    svg
}

/// The bodies at time `t`; unobserved ones have the scene's pose.
fn draw_bodies_at(out: &mut String, scene: &Scene, paths: &[Vec<PathPoint>], view: &Viewport, t: f64) {
    for (i, body) in scene.bodies.iter().enumerate() {
        let seen = paths.get(i).and_then(|path| pose_at(path, t));
        let still = || body.position.map(|position| (position, body.angle));
        if let Some((position, angle)) = seen.or_else(still) {
            draw_body(out, scene, i, position, angle, view, BodyStyle::Solid);
        }
    }
}

/// Position and angle of a path at time `t`, m and rad. In gaps it stays at the last known point.
fn pose_at(path: &[PathPoint], t: f64) -> Option<([f64; 2], f64)> {
    let next = path.partition_point(|k| k.t <= t);
    let (a, b) = (path.get(next.saturating_sub(1))?, path.get(next));
    let Some(b) = b.filter(|b| next > 0 && !b.jump) else { return Some((a.at, a.angle)) };
    let share = (t - a.t) / (b.t - a.t);
    let between = |a: f64, b: f64| a + (b - a) * share;
    Some(([0, 1].map(|d| between(a.at[d], b.at[d])), between(a.angle, b.angle)))
}

/// Encodes frames as an APNG.
fn encode_apng(count: u32, frames: impl Iterator<Item = Result<Pixmap>>, fps: u32) -> Result<Vec<u8>> {
    let failed = |e: png::EncodingError| Error::Failed(format!("encoding the film: {e}"));
    let mut frames = frames.enumerate();
    let Some((_, first)) = frames.next() else { return Err(Error::Failed("a film without a frame".into())) };
    let mut before = first?;
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, before.width(), before.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_animated(count, 0).map_err(failed)?;
    encoder.set_blend_op(BlendOp::Source).map_err(failed)?;
    encoder.set_dispose_op(DisposeOp::None).map_err(failed)?;
    let delay = |k: usize| if k + 1 == count as usize { (END_PAUSE_S as u16, 1) } else { (1, fps as u16) };
    let (part, whole) = delay(0);
    encoder.set_frame_delay(part, whole).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    let whole_frame = PixelRect { x: 0, y: 0, width: before.width(), height: before.height() };
    writer.write_image_data(&whole_frame.rgb(&before)).map_err(failed)?;
    for (k, frame) in frames {
        let frame = frame?;
        let part = PixelRect::bounding_difference(&before, &frame);
        writer.reset_frame_position().map_err(failed)?;
        writer.set_frame_dimension(part.width, part.height).map_err(failed)?;
        writer.set_frame_position(part.x, part.y).map_err(failed)?;
        let (share, of) = delay(k);
        writer.set_frame_delay(share, of).map_err(failed)?;
        writer.write_image_data(&part.rgb(&frame)).map_err(failed)?;
        before = frame;
    }
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

/// A rectangle of a picture, px.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PixelRect {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl PixelRect {
    /// The bounding rectangle of the differences between two pictures of one size; one pixel if they are equal.
    fn bounding_difference(a: &Pixmap, b: &Pixmap) -> PixelRect {
        let row = 4 * a.width() as usize;
        let (mut top, mut bottom, mut left, mut right) = (None, 0, row, 0);
        for (y, (p, q)) in a.data().chunks(row).zip(b.data().chunks(row)).enumerate() {
            if p == q {
                continue;
            }
            let differs = |(_, (p, q)): &(usize, (&u8, &u8))| p != q;
            let mut bytes = p.iter().zip(q).enumerate();
            left = left.min(bytes.find(differs).map_or(row, |(i, _)| i));
            right = right.max(p.iter().zip(q).enumerate().rfind(differs).map_or(0, |(i, _)| i));
            top = top.or(Some(y as u32));
            bottom = y as u32;
        }
        let Some(y) = top else { return PixelRect { x: 0, y: 0, width: 1, height: 1 } };
        let (left, right) = (left as u32 / 4, right as u32 / 4);
        PixelRect { x: left, y, width: right - left + 1, height: bottom - y + 1 }
    }

    /// Its pixels, red green blue. All are opaque and need no demultiplication by alpha.
    fn rgb(&self, of: &Pixmap) -> Vec<u8> {
        let row = of.width() as usize;
        let lines = of.pixels().chunks(row).skip(self.y as usize).take(self.height as usize);
        let seen = lines.flat_map(|line| &line[self.x as usize..(self.x + self.width) as usize]);
        seen.flat_map(|p| [p.red(), p.green(), p.blue()]).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::budget::Unlimited;
    use crate::picture::scene::tests::hall;
    use crate::picture::svg_to_rgb;
    use crate::trajectory::Track;

    /// A ball that moves 2 m in a second, observed every quarter of a second, and rests for another second.
    fn run(name: &str) -> Trajectory {
        let mut track = Track::with_capacity(name, 9);
        let times: Vec<f64> = (0..9).map(|i| f64::from(i) * 0.25).collect();
        for t in &times {
            let (x, v) = (2.0 * t.min(1.0), if *t < 1.0 { 2.0 } else { 0.0 });
            track.push([x, 1.0], 0.0, [v, 0.0], 0.0);
        }
        Trajectory { times, bodies: vec![track], ..Trajectory::default() }
    }

    /// Decoded frames, each with its duration, s.
    fn played(film: &[u8]) -> Vec<(Vec<u8>, f64)> {
        let mut reader = png::Decoder::new(Cursor::new(film)).read_info().unwrap();
        let count = reader.info().animation_control().unwrap().num_frames;
        let mut canvas = vec![0; reader.output_buffer_size().unwrap()];
        let row = 3 * reader.info().width as usize;
        let mut frames = Vec::new();
        for _ in 0..count {
            let mut part = vec![0; canvas.len()];
            reader.next_frame(&mut part).unwrap();
            let f = *reader.info().frame_control().unwrap();
            for (y, line) in part.chunks(3 * f.width as usize).take(f.height as usize).enumerate() {
                let from = (f.y_offset as usize + y) * row + 3 * f.x_offset as usize;
                canvas[from..from + line.len()].copy_from_slice(line);
            }
            frames.push((canvas.clone(), f64::from(f.delay_num) / f64::from(f.delay_den)));
        }
        frames
    }

    #[test]
    fn shows_samples_at_their_times_and_pauses_at_the_end() {
        let scene = hall();
        let name = &scene.bodies[0].name;
        let trajectory = run(name);
        let style = Style { width: 160, ..Style::default() };
        let film = animation_png(&Unlimited, &scene, &trajectory, &style, 20).unwrap();
        let frames = played(&film);
        assert_eq!(frames.len(), 41);
        assert!(frames[..40].iter().all(|f| f.1 == 0.05) && frames[40].1 == 1.0);
        // Moves for a second, then rests; all frames of the motion differ.
        let different = frames.windows(2).filter(|w| w[0].0 != w[1].0).count();
        assert_eq!(different, 20);
        // Frames assembled from rectangles equal frames drawn whole.
        let height = frames[0].0.len() as u32 / 3 / 160;
        let end = svg_to_rgb(&final_frame_svg(&scene, &trajectory, &style), 160, height).unwrap();
        assert!(frames[40].0 == end && frames[0].0 != end);
        let half = Trajectory {
            times: trajectory.times[..3].to_vec(),
            bodies: trajectory.bodies.clone(),
            ..Trajectory::default()
        };
        let then =
            bodies_svg(&scene, &paths(&scene, &half), &Viewport::new(&scene, Some(&trajectory), 160.0), 0.5);
        let here = bodies_svg(
            &scene,
            &paths(&scene, &trajectory),
            &Viewport::new(&scene, Some(&trajectory), 160.0),
            0.5,
        );
        assert_eq!(then, here);
        assert_eq!(film, animation_png(&Unlimited, &scene, &trajectory, &style, 20).unwrap());
    }

    #[test]
    fn does_not_interpolate_across_gaps() {
        let knot = |t: f64, x: f64, jump: bool| PathPoint { t, at: [x, 0.0], angle: t, jump };
        let path = [knot(1.0, 0.0, false), knot(2.0, 4.0, false), knot(4.0, 9.0, true)];
        for (t, x, angle) in [
            (0.0, 0.0, 1.0),
            (1.25, 1.0, 1.25),
            (2.0, 4.0, 2.0),
            (3.9, 4.0, 2.0),
            (4.0, 9.0, 4.0),
            (9.0, 9.0, 4.0),
        ] {
            assert_eq!(pose_at(&path, t), Some(([x, 0.0], angle)), "{t}");
        }
        assert_eq!(pose_at(&[], 0.0), None);
    }

    #[test]
    fn draws_one_frame_without_samples() {
        let style = Style { width: 64, ..Style::default() };
        let frames = played(&animation_png(&Unlimited, &hall(), &Trajectory::default(), &style, 30).unwrap());
        assert_eq!((frames.len(), frames[0].1), (1, 1.0));
    }

    #[test]
    fn rejects_long_and_large_animations() {
        let check = |seconds: f64, width: u32, fps: u32, wanted: Option<&str>| match (
            check_size(&hall(), seconds, width, fps),
            wanted,
        ) {
            (Ok(()), None) => {}
            (Err(Error::TooLarge { what, .. }), Some(wanted)) => assert_eq!(what, wanted),
            (other, _) => panic!("{seconds} s at {width} px: {other:?}"),
        };
        check(119.9, 256, 30, None);
        check(120.1, 256, 30, Some("frames of a film"));
        check(20.0, 1024, 30, None);
        check(20.0, 4096, 60, Some("pixels of a film"));
    }
}
