//! A trajectory as pictures: a strip of frames, one picture with trails, and an animation in real time.
//!
//! Between two samples a body follows its sampled velocities and the scene's gravity: one parabola if both ends agree on it, two
//! parabolas that meet at a bounce, and a straight line otherwise (or without velocities). The samples are interpolated exactly.

use std::fmt::Write;

use super::scene::{BodyStyle, Style, body_colour, document, draw_body, draw_statics, scene_svg, title};
use super::svg::{decimals, px};
use super::theme::light;
use super::viewport::Viewport;
use crate::task::Scene;
use crate::task::geometry::sub;
use crate::trajectory::{Track, Trajectory, hermite};

/// Up to `style.frames` moments in a grid, each with the trails that led to it. Moments are spread evenly
/// over a mean of time and distance travelled, so that a long rest does not fill the strip.
pub fn filmstrip_svg(scene: &Scene, trajectory: &Trajectory, style: &Style) -> String {
    if trajectory.times.is_empty() {
        return scene_svg(scene, style);
    }
    let moments = frame_samples(trajectory, style.frames.clamp(1, 64));
    let width = style.width_px();
    let columns = moments.len().clamp(1, 4);
    let rows = moments.len().div_ceil(columns).max(1);
    let gap = (width * 0.008).max(1.0);
    let view =
        Viewport::new(scene, Some(trajectory), (width - gap * (columns as f64 - 1.0)) / columns as f64);
    let caption = (view.width * 0.075).clamp(8.0, 18.0);
    let (tall, line) = (view.height + caption * 1.5, view.pen(1.0));
    let paths = paths(scene, trajectory);

    let mut body = String::new();
    for (k, sample) in moments.iter().enumerate() {
        let (x, y) = ((k % columns) as f64 * (view.width + gap), (k / columns) as f64 * (tall + gap));
        let (w, h) = (px(view.width), px(view.height));
        // A nested <svg> cuts off what lies outside the frame, without ids that could clash.
        let _ = writeln!(
            body,
            "<svg x=\"{}\" y=\"{}\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">",
            px(x),
            px(y)
        );
        draw_statics(&mut body, scene, &view);
        for (i, path) in paths.iter().enumerate() {
            draw_trail(&mut body, scene, i, path, trajectory.times[*sample], &view);
        }
        for i in 0..scene.bodies.len() {
            if let Some((p, angle)) = sampled_pose(scene, trajectory, i, *sample) {
                draw_body(&mut body, scene, i, p, angle, &view, BodyStyle::Solid);
            }
        }
        let _ = writeln!(
            body,
            "<rect width=\"{w}\" height=\"{h}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"/></svg>\n\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"{}\" \
             fill=\"{}\">{} s</text>",
            light("line"),
            px(line),
            px(x + view.width / 2.0),
            px(y + view.height + caption * 1.15),
            px(caption),
            light("ink"),
            decimals(trajectory.times[*sample], 2)
        );
    }
    let height = rows as f64 * tall + (rows as f64 - 1.0) * gap;
    document(width, height, &title(scene), &body)
}

/// One picture: outlines at the start, trails, bodies at the end.
pub fn trails_svg(scene: &Scene, trajectory: &Trajectory, style: &Style) -> String {
    if trajectory.times.is_empty() {
        return scene_svg(scene, style);
    }
    let view = Viewport::new(scene, Some(trajectory), style.width_px());
    let mut body = String::new();
    draw_statics(&mut body, scene, &view);
    let last = trajectory.times.len().saturating_sub(1);
    for (sample, look) in [(0, BodyStyle::Ghost), (last, BodyStyle::Solid)] {
        if look == BodyStyle::Solid {
            draw_trails(&mut body, scene, trajectory, &view);
        }
        for i in 0..scene.bodies.len() {
            if let Some((p, angle)) = sampled_pose(scene, trajectory, i, sample) {
                draw_body(&mut body, scene, i, p, angle, &view, look);
            }
        }
    }
    document(view.width, view.height, &title(scene), &body)
}

/// The trails of all bodies.
pub(super) fn draw_trails(out: &mut String, scene: &Scene, trajectory: &Trajectory, view: &Viewport) {
    for (i, path) in paths(scene, trajectory).iter().enumerate() {
        draw_trail(out, scene, i, path, f64::INFINITY, view);
    }
}

/// An animation in real time for any browser (SMIL) that pauses for a second at the end and repeats. Without SMIL support (PNG) it
/// shows the start.
pub fn animation_svg(scene: &Scene, trajectory: &Trajectory, style: &Style) -> String {
    let view = Viewport::new(scene, Some(trajectory), style.width_px());
    let mut body = String::new();
    draw_statics(&mut body, scene, &view);
    let start = trajectory.times.first().copied().unwrap_or(0.0);
    let length = trajectory.times.last().copied().unwrap_or(0.0) - start;
    let whole = length + END_PAUSE_S;
    let paths = paths(scene, trajectory);
    for i in 0..scene.bodies.len() {
        let Some(path) = paths.get(i).filter(|p| !p.is_empty()) else {
            if let Some(p) = scene.bodies[i].position {
                draw_body(&mut body, scene, i, p, scene.bodies[i].angle, &view, BodyStyle::Solid);
            }
            continue;
        };
        let first = path[0];
        let origin = view.at([0.0, 0.0]);
        let mut shape = String::new();
        draw_body(&mut shape, scene, i, [0.0, 0.0], 0.0, &view, BodyStyle::Solid);
        // Drawn about the world's origin, shifted to the picture's corner, turned, and carried along.
        let carried = |k: &PathPoint| {
            let p = view.at(k.at);
            format!("{} {}", px(p[0]), px(p[1]))
        };
        let turned = |k: &PathPoint| decimals(-k.angle.to_degrees(), 1);
        let (ct, cv) = keyframes(path, &|k| (k.t - start) / whole, &carried);
        let (rt, rv) = keyframes(path, &|k| (k.t - start) / whole, &turned);
        let _ = writeln!(
            body,
            "<g transform=\"translate({c})\">\n<animateTransform attributeName=\"transform\" \
             type=\"translate\" dur=\"{d}s\" repeatCount=\"indefinite\" keyTimes=\"{ct}\" values=\"{cv}\"/>\n\
             <g transform=\"rotate({r})\">\n<animateTransform attributeName=\"transform\" type=\"rotate\" \
             dur=\"{d}s\" repeatCount=\"indefinite\" keyTimes=\"{rt}\" values=\"{rv}\"/>\n\
             <g transform=\"translate({ox} {oy})\">\n{shape}</g></g></g>",
            c = carried(&first),
            r = turned(&first),
            d = decimals(whole, 4),
            ox = px(-origin[0]),
            oy = px(-origin[1]),
        );
    }
    document(view.width, view.height, &title(scene), &body)
}

/// `keyTimes` (shares of the duration, from 0 to 1) and `values` of a path, without repetitions where a body rests.
fn keyframes(
    path: &[PathPoint],
    share: &dyn Fn(&PathPoint) -> f64,
    value: &dyn Fn(&PathPoint) -> String,
) -> (String, String) {
    let mut keys: Vec<(f64, String)> = path.iter().map(|k| (share(k).clamp(0.0, 1.0), value(k))).collect();
    if let (Some(first), Some(last)) = (keys.first().cloned(), keys.last().cloned()) {
        if first.0 > 0.0 {
            keys.insert(0, (0.0, first.1));
        }
        keys.push((1.0, last.1));
    }
    let needed =
        |i: usize| i == 0 || i + 1 >= keys.len() || keys[i].1 != keys[i - 1].1 || keys[i].1 != keys[i + 1].1;
    let kept: Vec<usize> = (0..keys.len()).filter(|i| needed(*i)).collect();
    let join = |write: &dyn Fn(usize) -> String| kept.iter().map(|i| write(*i)).collect::<Vec<_>>().join(";");
    (join(&|i| decimals(keys[i].0, 5)), join(&|i| keys[i].1.clone()))
}

/// Pause of an animation at its end, s.
pub(super) const END_PAUSE_S: f64 = 1.0;
/// Maximal time between two drawn points of a moving body, s.
const MAX_POINT_INTERVAL_S: f64 = 1.0 / 30.0;

/// A drawn point of a body's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PathPoint {
    /// s
    pub t: f64,
    /// m
    pub at: [f64; 2],
    /// rad
    pub angle: f64,
    /// Whether the path from the point before is unknown.
    pub jump: bool,
}

/// One path for each body of the scene; empty without observations of it.
pub(super) fn paths(scene: &Scene, trajectory: &Trajectory) -> Vec<Vec<PathPoint>> {
    let find = |name: &str| trajectory.track(name);
    scene
        .bodies
        .iter()
        .map(|b| find(&b.name).map_or(Vec::new(), |t| path(t, &trajectory.times, scene.gravity, b.angle)))
        .collect()
}

fn path(track: &Track, times: &[f64], gravity: [f64; 2], rest_angle: f64) -> Vec<PathPoint> {
    let mut knots: Vec<PathPoint> = Vec::new();
    let mut last: Option<usize> = None;
    for (i, ((t, x), y)) in times.iter().zip(&track.x).zip(&track.y).enumerate() {
        let (t, at) = (*t, [*x, *y]);
        if !(t.is_finite() && at[0].is_finite() && at[1].is_finite()) {
            continue;
        }
        let seen_angle = track.angle.get(i).copied().filter(|a| a.is_finite());
        let angle = seen_angle.unwrap_or_else(|| knots.last().map_or(rest_angle, |k| k.angle));
        let here = PathPoint { t, at, angle, jump: last.is_some_and(|l| l + 1 != i) };
        if let (Some(before), Some(l)) = (knots.last().copied(), last)
            && !here.jump
            && here.t > before.t
        {
            interpolate(&mut knots, before, here, velocity(track, l), velocity(track, i), gravity);
        }
        if knots.last().is_none_or(|k| here.t > k.t) {
            knots.push(here);
        }
        last = Some(i);
    }
    knots
}

fn velocity(track: &Track, i: usize) -> Option<[f64; 2]> {
    let v = [*track.vx.get(i)?, *track.vy.get(i)?];
    v.iter().all(|c| c.is_finite()).then_some(v)
}

/// Adds the points between two samples (neither of them included).
fn interpolate(
    knots: &mut Vec<PathPoint>,
    a: PathPoint,
    b: PathPoint,
    va: Option<[f64; 2]>,
    vb: Option<[f64; 2]>,
    gravity: [f64; 2],
) {
    let (Some(va), Some(vb)) = (va, vb) else { return };
    let dt = b.t - a.t;
    let pieces = ((dt / MAX_POINT_INTERVAL_S).ceil() as usize).clamp(1, 60);
    let chord = length(sub(b.at, a.at));
    // Under constant acceleration the mean velocity gives the displacement exactly.
    let mean = [(va[0] + vb[0]) / 2.0 * dt, (va[1] + vb[1]) / 2.0 * dt];
    let way = (length(va) + length(vb)) / 2.0 * dt;
    let smooth = length(sub(mean, sub(b.at, a.at))) <= 0.05 * way + 1e-9;
    // A bounce half way between two samples passes this test too, but changes the velocity by more than gravity does.
    let falling = length(gravity) * dt;
    let pushed = length(sub(vb, va)) > 1.25 * falling + 0.25 * length(va).max(length(vb));
    // A body that moves across gravity is supported.
    let pull = |v: [f64; 2]| {
        let sinking = (v[0] * gravity[0] + v[1] * gravity[1]).abs() * dt;
        if sinking < 0.1 * falling * falling { [0.0, 0.0] } else { gravity }
    };
    let (ga, gb) = (pull(va), pull(vb));
    let forth = |t: f64| [0, 1].map(|d| a.at[d] + va[d] * t + ga[d] * t * t / 2.0);
    let back = |t: f64| {
        let r = dt - t;
        [0, 1].map(|d| b.at[d] - vb[d] * r + gb[d] * r * r / 2.0)
    };
    let apart = |t: f64| length(sub(forth(t), back(t)));
    let meeting = (0..=128)
        .map(|k| dt * f64::from(k) / 128.0)
        .min_by(|s, t| apart(*s).total_cmp(&apart(*t)))
        .filter(|t| apart(*t) <= 0.1 * way.max(chord));
    let mut moments: Vec<f64> = (1..pieces).map(|k| dt * k as f64 / pieces as f64).collect();
    let place: Box<dyn Fn(f64) -> [f64; 2]> = match meeting {
        Some(meet) if pushed || !smooth => {
            // The small gap at the meeting point is distributed along the path.
            let miss = sub(back(meet), forth(meet));
            moments.push(meet);
            Box::new(move |t| {
                let (p, share) = if t <= meet {
                    (forth(t), 0.5 * t / meet.max(f64::MIN_POSITIVE))
                } else {
                    (back(t), -0.5 * (dt - t) / (dt - meet))
                };
                [p[0] + miss[0] * share, p[1] + miss[1] * share]
            })
        }
        _ if smooth => {
            Box::new(move |t| [0, 1].map(|d| hermite([a.at[d], b.at[d]], [va[d], vb[d]], dt, t / dt)))
        }
        _ => return,
    };
    moments.sort_by(f64::total_cmp);
    moments.dedup();
    let inner = moments.into_iter().filter(|t| *t > 0.0 && *t < dt);
    knots.extend(inner.map(|t| {
        let angle = a.angle + (b.angle - a.angle) * t / dt;
        PathPoint { t: a.t + t, at: place(t), angle, jump: false }
    }));
}

/// The path of body `index` up to time `until`, as a thin line of its colour.
fn draw_trail(
    out: &mut String,
    scene: &Scene,
    index: usize,
    path: &[PathPoint],
    until: f64,
    view: &Viewport,
) {
    let (mut d, mut last) = (String::new(), String::new());
    for k in path.iter().take_while(|k| k.t <= until + 1e-9) {
        let p = view.at(k.at);
        let here = format!("{} {}", px(p[0]), px(p[1]));
        if here != last || k.jump {
            let _ = write!(d, "{}{here}", if d.is_empty() || k.jump { "M" } else { "L" });
            last = here;
        }
    }
    if d.contains('L') {
        let _ = writeln!(
            out,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-opacity=\"0.6\" stroke-width=\"{}\" \
             stroke-linejoin=\"round\" stroke-linecap=\"round\"/>",
            body_colour(scene, index),
            px(view.pen(1.8))
        );
    }
}

/// Pose of body `index` at `sample`, m and rad: observed, or the scene's if it has no track.
fn sampled_pose(
    scene: &Scene,
    trajectory: &Trajectory,
    index: usize,
    sample: usize,
) -> Option<([f64; 2], f64)> {
    let body = &scene.bodies[index];
    let Some(track) = trajectory.track(&body.name) else {
        return Some((body.position?, body.angle));
    };
    let p = [*track.x.get(sample)?, *track.y.get(sample)?];
    let angle = track.angle.get(sample).copied().filter(|a| a.is_finite()).unwrap_or(body.angle);
    p.iter().all(|v| v.is_finite()).then_some((p, angle))
}

/// Indices of at most `n` samples, first and last included.
fn frame_samples(trajectory: &Trajectory, n: usize) -> Vec<usize> {
    let count = trajectory.times.len();
    if count <= n || n < 2 {
        return (0..count.min(n)).collect();
    }
    let span = trajectory.times[count - 1] - trajectory.times[0];
    let travelled = |i: usize| -> f64 {
        let ways = trajectory.bodies.iter().filter_map(|t| {
            let d = [t.x.get(i)? - t.x.get(i - 1)?, t.y.get(i)? - t.y.get(i - 1)?];
            Some(length(d)).filter(|l| l.is_finite())
        });
        ways.sum()
    };
    let mut way = vec![0.0; count];
    for i in 1..count {
        way[i] = way[i - 1] + travelled(i);
    }
    let progress = |i: usize| {
        let time = (trajectory.times[i] - trajectory.times[0]) / span.max(f64::MIN_POSITIVE);
        let distance = if way[count - 1] > 0.0 { way[i] / way[count - 1] } else { time };
        (time + distance) / 2.0
    };
    let mut chosen = vec![0];
    for k in 1..n {
        let wanted = k as f64 / (n - 1) as f64;
        let least = chosen[chosen.len() - 1] + 1;
        let most = count - (n - k);
        let best = (least..=most)
            .min_by(|a, b| (progress(*a) - wanted).abs().total_cmp(&(progress(*b) - wanted).abs()));
        chosen.extend(best);
    }
    chosen
}

fn length(v: [f64; 2]) -> f64 {
    (v[0] * v[0] + v[1] * v[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::draw_bodies;
    use crate::picture::scene::tests::{check_svg, hall};
    use resvg::usvg::roxmltree::Document;

    const G: f64 = 9.8;

    /// A ball dropped from rest, its centre bouncing off y = 0 without loss, sampled every `dt` s.
    fn bouncing(name: &str, height: f64, dt: f64, samples: usize) -> Trajectory {
        let fall = (2.0 * height / G).sqrt();
        let mut track = Track::with_capacity(name, samples);
        let times: Vec<f64> = (0..samples).map(|i| i as f64 * dt).collect();
        for t in &times {
            // Time since the last apex, between -fall and fall.
            let s = (t + fall) % (2.0 * fall) - fall;
            track.push([2.0 * t, height - G * s * s / 2.0], *t, [2.0, -G * s], 1.0);
        }
        Trajectory { times, bodies: vec![track], ..Trajectory::default() }
    }

    #[test]
    fn interpolates_flight_by_parabolas() {
        let film = bouncing("red", 100.0, 0.5, 9);
        let knots = path(&film.bodies[0], &film.times, [0.0, -G], 0.0);
        assert!(knots.len() > 100);
        for k in &knots {
            let wanted = [2.0 * k.t, 100.0 - G * k.t * k.t / 2.0];
            assert!(length(sub(k.at, wanted)) < 1e-9, "{k:?} is not at {wanted:?}");
            assert!((k.angle - k.t).abs() < 1e-9);
        }
    }

    #[test]
    fn finds_bounces_between_samples() {
        // The first bounce at sqrt(2 h / g) = 0.7 s lies between the samples at 0.6 and 0.8 s.
        let film = bouncing("red", 2.401, 0.2, 6);
        let knots = path(&film.bodies[0], &film.times, [0.0, -G], 0.0);
        let lowest = knots.iter().min_by(|a, b| a.at[1].total_cmp(&b.at[1])).unwrap();
        assert!((lowest.t - 0.7).abs() < 0.002 && lowest.at[1].abs() < 0.02, "{lowest:?}");
        for (i, t) in film.times.iter().enumerate() {
            let met = knots.iter().find(|k| k.t == *t).unwrap();
            assert_eq!(met.at, [film.bodies[0].x[i], film.bodies[0].y[i]]);
        }
        assert!(knots.windows(2).all(|w| w[0].t < w[1].t));
    }

    #[test]
    fn impacts_while_rolling_stay_on_the_floor() {
        let mut track = Track::with_capacity("red", 2);
        track.push([0.0, 1.0], 0.0, [4.0, 0.0], -4.0);
        track.push([0.3, 1.0], -0.3, [0.0, 0.0], 0.0);
        let knots = path(&track, &[0.0, 0.25], [0.0, -G], 0.0);
        assert!(knots.len() > 4 && knots.iter().all(|k| k.at[1] == 1.0), "{knots:?}");
        let stopped = knots.iter().find(|k| k.at[0] > 0.29).unwrap();
        assert!((stopped.t - 0.075).abs() < 0.01, "{stopped:?}");
    }

    #[test]
    fn missing_samples_leave_gaps() {
        let mut film = bouncing("red", 5.0, 0.1, 10);
        film.bodies[0].y[4] = f64::NAN;
        film.bodies[0].vx[7] = f64::NAN;
        film.bodies[0].angle = vec![f64::NAN; 10];
        let knots = path(&film.bodies[0], &film.times, [0.0, -G], 0.25);
        assert_eq!(knots.iter().filter(|k| k.jump).count(), 1);
        assert!(knots.iter().all(|k| k.at.iter().all(|v| v.is_finite()) && k.angle == 0.25));
        for draw in [filmstrip_svg, trails_svg, animation_svg] {
            check_svg(&draw(&hall(), &film, &Style::default()));
        }
    }

    #[test]
    fn draws_empty_and_short_trajectories() {
        for samples in [0, 1, 2] {
            let film = bouncing("red", 5.0, 0.1, samples);
            for draw in [filmstrip_svg, trails_svg, animation_svg] {
                check_svg(&draw(&hall(), &film, &Style::default()));
                assert_eq!(draw(&hall(), &film, &Style::default()), draw(&hall(), &film, &Style::default()));
            }
        }
        // Tracks shorter than `times`, and of a body that isn't in the scene.
        let mut film = bouncing("red", 5.0, 0.1, 9);
        film.bodies[0].x.truncate(3);
        film.bodies[0].angle.clear();
        film.bodies.push(Track { name: "<stranger>".into(), ..Track::default() });
        for draw in [filmstrip_svg, trails_svg, animation_svg] {
            check_svg(&draw(&hall(), &film, &Style::default()));
        }
    }

    #[test]
    fn filmstrip_spans_the_trajectory_and_skips_rest() {
        let mut film = bouncing("red", 2.0, 0.05, 200);
        for i in 100..200 {
            film.bodies[0].x[i] = film.bodies[0].x[99];
            film.bodies[0].y[i] = film.bodies[0].y[99];
        }
        let chosen = frame_samples(&film, 8);
        assert_eq!((chosen.len(), chosen[0], chosen[7]), (8, 0, 199));
        assert!(chosen.windows(2).all(|w| w[0] < w[1]));
        assert!(chosen.iter().filter(|i| **i < 100).count() >= 5, "{chosen:?}");
        for n in [1, 2, 3, 64] {
            assert_eq!(frame_samples(&film, n).len(), n);
        }
        let strip = filmstrip_svg(&hall(), &film, &Style { frames: 5, ..Style::default() });
        assert_eq!(strip.matches(" s</text>").count(), 5);
        check_svg(&strip);
    }

    #[test]
    fn animates_in_real_time() {
        let film = bouncing("red", 3.0, 0.25, 17);
        let svg = animation_svg(&hall(), &film, &Style::default());
        let document = Document::parse(&svg).unwrap();
        let moves: Vec<_> = document
            .descendants()
            .filter(|n| n.has_tag_name(("http://www.w3.org/2000/svg", "animateTransform")))
            .collect();
        assert_eq!(moves.len(), 2, "one body moves: carried and turned");
        for m in &moves {
            assert_eq!(m.attribute("dur"), Some("5s"), "4 s of motion and 1 s of pause");
            let keys: Vec<f64> =
                m.attribute("keyTimes").unwrap().split(';').map(|k| k.parse().unwrap()).collect();
            assert_eq!(keys.len(), m.attribute("values").unwrap().split(';').count());
            assert_eq!((keys[0], keys[keys.len() - 1]), (0.0, 1.0));
            assert!(keys.windows(2).all(|w| w[0] <= w[1]), "{keys:?}");
        }
        // Turned counter-clockwise by 4 rad, which SVG (y down) counts as negative degrees.
        let turned = moves[1].attribute("values").unwrap().split(';').next_back().unwrap();
        assert!((turned.parse::<f64>().unwrap() + 4.0f64.to_degrees()).abs() < 0.1, "{turned}");
        check_svg(&svg);
    }

    #[test]
    fn static_rendering_shows_the_start() {
        let (scene, film) = (hall(), bouncing("red", 3.0, 0.25, 17));
        let still = |p: [f64; 2], angle: f64| {
            let mut s = scene.clone();
            (s.bodies[0].position, s.bodies[0].angle) = (Some(p), angle);
            let view = Viewport::new(&scene, Some(&film), 300.0);
            let mut body = String::new();
            draw_statics(&mut body, &s, &view);
            draw_bodies(&mut body, &s, &view);
            let svg = document(view.width, view.height, "", &body);
            crate::picture::svg_to_rgb(&svg, 300, view.height as u32).unwrap()
        };
        let svg = animation_svg(&scene, &film, &Style { width: 300, ..Style::default() });
        let height = Viewport::new(&scene, Some(&film), 300.0).height as u32;
        let shown = crate::picture::svg_to_rgb(&svg, 300, height).unwrap();
        let apart = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 64).count();
        assert!(apart(&shown, &still([0.0, 3.0], 0.0)) < 30);
        assert!(apart(&shown, &still([4.0, 3.0], 0.0)) > 300);
    }
}
