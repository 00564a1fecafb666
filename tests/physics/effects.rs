//! Every effect against analytic solutions, against an independent integrator, and in both engines; neutral
//! values change no bit, and no parameter within bounds produces a NaN.

use iplw::reality::{HiddenConfig, HiddenWorld, Reality, standard};
use iplw::task::scene::{Body, EffectTerm, Goal, Shape, Static};
use iplw::task::shape::{Disc, Rectangle, SegmentShape};
use iplw::task::{Placement, Scene, families, family};
use iplw::trajectory::{Track, Trajectory};
use iplw::world::{BatchSettings, Engine, Rollout, SimdLevel, Simulator, effect, observe};
use proptest::prelude::*;

const ENGINES: [Engine; 2] = [Engine::Lanes, Engine::Rapier];
const G: f64 = 9.8;

// ---- motion ----

#[test]
fn quadratic_drag_converges_to_terminal_speed() {
    for engine in ENGINES {
        let fall = free([0.0, 0.0], 10.0, &[("quadratic_drag", &[("k", 0.2)])], 1.0 / 240.0);
        let t = run(&fall, engine);
        near(last(&t.bodies[0].vy), -(G / 0.2).sqrt(), 0.03, "terminal speed", engine);
    }
}

#[test]
fn quadratic_drag_slows_as_one_over_t() {
    for engine in ENGINES {
        let mut scene = free([12.0, 0.0], 3.0, &[("quadratic_drag", &[("k", 0.5)])], 1.0 / 240.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        // v = v0 / (1 + k v0 t), x = ln(1 + k v0 t) / k.
        let spent: f64 = 1.0 + 0.5 * 12.0 * 3.0;
        near(last(&t.bodies[0].vx), 12.0 / spent, 1e-4, "speed", engine);
        near(last(&t.bodies[0].x), spent.ln() / 0.5, 0.03, "way", engine);
    }
}

/// A body that slides on the plane stops after v / (mu g) and v^2 / (2 mu g), at any speed, and stays.
#[test]
fn ground_friction_stops_bodies() {
    for (engine, speed) in ENGINES.into_iter().flat_map(|engine| [(engine, 1.5), (engine, 3.0)]) {
        let mut scene = free([speed, 0.0], 4.0, &[("ground_friction", &[("mu", 0.1)])], 1.0 / 480.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        near(last(&t.bodies[0].x), speed * speed / (2.0 * 0.1 * 9.81), 0.01, "way", engine);
        assert_eq!(last(&t.bodies[0].vx), 0.0);
        let half = t.times.iter().position(|time| *time >= 0.5).unwrap();
        near(t.bodies[0].vx[half], speed - 0.1 * 9.81 * t.times[half], 0.01, "speed", engine);
    }
}

/// Buoyancy is a gravity error of -ratio g.
#[test]
fn buoyancy_carries_weight() {
    for engine in ENGINES {
        let [carried, lighter] = [("buoyancy", "ratio", 0.3), ("gravity_error", "dg", -0.3 * G)]
            .map(|(name, p, v)| run(&free([1.0, 2.0], 2.0, &[(name, &[(p, v)])], 1.0 / 240.0), engine));
        near(last(&carried.bodies[0].y), last(&lighter.bodies[0].y), 1e-6, "height", engine);
    }
}

/// Two equal discs meet head-on: with the first s times as heavy, momentum and restitution give the velocities.
#[test]
fn mass_ratio_changes_how_discs_share_momentum() {
    for (engine, s) in ENGINES.into_iter().flat_map(|engine| [(engine, 0.5), (engine, 3.0)]) {
        let mut scene = empty(1.0 / 960.0, 1.0);
        scene.gravity = [0.0, 0.0];
        scene.bodies = vec![ball("a", 0.1, [-0.5, 0.0], [1.0, 0.0]), ball("b", 0.1, [0.2, 0.0], [0.0, 0.0])];
        scene.bodies.iter_mut().for_each(|b| b.restitution = 0.8);
        let t = run(&with_effect(&scene, "mass_ratio", &[("s", s)]), engine);
        let e = 0.64;
        near(last(&t.bodies[0].vx), (s - e) / (1.0 + s), 5e-3, "first", engine);
        near(last(&t.bodies[1].vx), s * (1.0 + e) / (1.0 + s), 5e-3, "second", engine);
    }
}

/// Down a slope, a solid sphere accelerates by 5/7 of g sin(angle), a disc by 2/3, a hoop by 1/2, whether the scene or an effect
/// says so.
#[test]
fn moments_of_inertia_change_rolling() {
    use iplw::task::scene::{Inertia, RoundBody};
    let cases = [
        (None, 1.0, 2.0 / 3.0),
        (Some(Inertia::Of(RoundBody::SolidSphere)), 1.0, 5.0 / 7.0),
        (Some(Inertia::Of(RoundBody::Hoop)), 1.0, 0.5),
        (None, 2.0, 0.5),
        (None, 0.8, 5.0 / 7.0),
        (Some(Inertia::Value(0.4 * 0.01)), 1.0, 5.0 / 7.0),
    ];
    for (engine, (inertia, s, share)) in ENGINES.into_iter().flat_map(|e| cases.map(|c| (e, c))) {
        let mut scene = empty(1.0 / 480.0, 1.0);
        scene.gravity = [2.0, -9.6];
        scene.bodies = vec![ball("a", 0.1, [0.0, 0.1], [0.0, 0.0])];
        (scene.bodies[0].mass, scene.bodies[0].density) = (Some(1.0), None);
        (scene.bodies[0].friction, scene.bodies[0].restitution) = (1.0, 0.0);
        scene.bodies[0].inertia = inertia;
        scene.statics = vec![floor()];
        let t = run(&with_effect(&scene, "inertia_error", &[("s", s)]), engine);
        near(last(&t.bodies[0].vx), 2.0 * share, 0.03, "speed", engine);
    }
}

/// A position at distance r from the centre is seen at (1 + k r^2) r, and velocities accordingly.
#[test]
fn lenses_move_positions_outwards() {
    for engine in ENGINES {
        let base = free([2.0, 0.0], 1.0, &[], 1.0 / 240.0);
        let t = run(&base, engine);
        let bent = run(&with_effect(&base, "lens", &[("k", 0.05), ("x", 1.0), ("y", 99.0)]), engine);
        for i in 0..t.times.len() {
            let (dx, dy) = (t.bodies[0].x[i] - 1.0, t.bodies[0].y[i] - 99.0);
            let scale = 1.0 + 0.05 * (dx * dx + dy * dy);
            near(bent.bodies[0].x[i], 1.0 + scale * dx, 1e-9, "x", engine);
            near(bent.bodies[0].y[i], 99.0 + scale * dy, 1e-9, "y", engine);
        }
        let n = t.times.len() - 1;
        let slope = (bent.bodies[0].x[n] - bent.bodies[0].x[n - 2]) / (t.times[n] - t.times[n - 2]);
        // The quotient spans two intervals between observations.
        near(bent.bodies[0].vx[n - 1], slope, 0.06, "velocity", engine);
    }
}

/// In flight the trajectory is unchanged to the bit and the spin decays by e^(-c t); after a bounce, where
/// spin becomes speed, the ball is slower.
#[test]
fn spin_decay_changes_only_spin_in_flight() {
    for engine in ENGINES {
        let mut plain = free([2.0, 3.0], 2.0, &[], 1.0 / 240.0);
        plain.bodies[0].angular_velocity = 10.0;
        let decay = |scene: &Scene, c: f64| {
            run(&Scene { effects: vec![EffectTerm::new("spin_decay", &[("c", c)])], ..scene.clone() }, engine)
        };
        let (with, without) = (decay(&plain, 0.7), run(&plain, engine));
        let path = |t: &Trajectory| [t.bodies[0].x.clone(), t.bodies[0].y.clone()];
        assert_eq!(path(&with), path(&without), "{engine:?}");
        near(last(&with.bodies[0].omega), 10.0 * f64::exp(-0.7 * 2.0), 1e-4, "spin", engine);
        // Topspin lasts until the bounce accelerates the ball.
        let mut falls = lively();
        falls.bodies.truncate(1);
        (falls.bodies[0].velocity, falls.bodies[0].angular_velocity) = ([0.0, 0.0], -30.0);
        falls.steps = 240;
        let way = |t: &Trajectory| last(&t.bodies[0].x) - falls.bodies[0].position.unwrap()[0];
        let (kept, lost) = (way(&run(&falls, engine)), way(&decay(&falls, 2.0)));
        assert!(0.1 < lost && lost < 0.7 * kept, "{engine:?}: {kept} and {lost}");
    }
}

#[test]
fn wind_and_gravity_error_shift_the_parabola() {
    for engine in ENGINES {
        let base = free([2.0, 3.0], 2.0, &[], 1.0 / 240.0);
        let with = |name, parameters: &[(&str, f64)]| Scene {
            effects: vec![EffectTerm::new(name, parameters)],
            ..base.clone()
        };
        let wind = run(&with("wind", &[("ax", 1.5), ("ay", -0.5)]), engine);
        let heavy = run(&with("gravity_error", &[("dg", 1.2)]), engine);
        let plain = run(&base, engine);
        let shift = |t: &Trajectory| {
            [last(&t.bodies[0].x) - last(&plain.bodies[0].x), last(&t.bodies[0].y) - last(&plain.bodies[0].y)]
        };
        near(shift(&wind)[0], 1.5 * 2.0, 0.01, "a t^2 / 2 across", engine);
        near(shift(&wind)[1], -0.5 * 2.0, 0.01, "a t^2 / 2 down", engine);
        near(shift(&heavy)[1], -1.2 * 2.0, 0.01, "dg t^2 / 2", engine);
        near(shift(&heavy)[0], 0.0, 1e-5, "across gravity", engine);
        // Along gravity in any direction.
        let mut aslant = with("gravity_error", &[("dg", 1.0)]);
        aslant.gravity = [3.0, -4.0];
        let v = run(&aslant, engine);
        near(last(&v.bodies[0].vx), 2.0 + 2.0 * 3.6, 1e-3, "along gravity", engine);
        near(last(&v.bodies[0].vy), 3.0 - 2.0 * 4.8, 1e-3, "along gravity", engine);
        aslant.gravity = [0.0, 0.0];
        near(last(&run(&aslant, engine).bodies[0].vx), 2.0, 1e-6, "no gravity, no direction", engine);
    }
}

#[test]
fn moving_air_carries_bodies_along() {
    for engine in ENGINES {
        let parameters = [("ux", 3.0), ("uy", 1.0), ("k", 2.0)];
        let mut scene = free([0.0, 0.0], 30.0, &[("moving_air", &parameters)], 1.0 / 240.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        near(last(&t.bodies[0].vx), 3.0, 0.05, "speed of the air", engine);
        near(last(&t.bodies[0].vy), 1.0, 0.05, "speed of the air", engine);
    }
}

#[test]
fn lift_gives_circular_motion() {
    for engine in ENGINES {
        for dt in [1.0 / 60.0, 1.0 / 240.0] {
            let s = 2.0;
            let mut scene = free([3.0, 0.0], 4.0, &[("lift", &[("s", s)])], dt);
            scene.gravity = [0.0, 0.0];
            let t = run(&scene, engine);
            let track = &t.bodies[0];
            // A circle to the left of the start, of radius v / s, at constant speed.
            let radius = 3.0 / s;
            for i in 0..track.len() {
                let off = (track.x[i].powi(2) + (track.y[i] - 100.0 - radius).powi(2)).sqrt() - radius;
                assert!(off.abs() < 3.0 * dt, "{engine:?} dt {dt}: off the circle by {off}");
                let speed = (track.vx[i].powi(2) + track.vy[i].powi(2)).sqrt();
                near(speed, 3.0, 1e-4, "speed", engine);
            }
            let turned = last(&track.vy).atan2(last(&track.vx)).rem_euclid(std::f64::consts::TAU);
            near(turned, (s * 4.0f64).rem_euclid(std::f64::consts::TAU), 1e-4, "angle turned", engine);
        }
    }
}

#[test]
fn gusts_depend_on_time() {
    for engine in ENGINES {
        let (a, period, phase) = (2.0, 1.5, 0.7);
        let parameters = [("ax", a), ("ay", 0.0), ("period", period), ("phase", phase)];
        let mut scene = free([0.0, 0.0], 1.0, &[("gust", &parameters)], 1.0 / 60.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        let w = std::f64::consts::TAU / period;
        for (i, time) in t.times.iter().enumerate() {
            let v = a / w * (phase.cos() - (w * time + phase).cos());
            near(t.bodies[0].vx[i], v, 1e-5, "speed", engine);
        }
    }
}

#[test]
fn position_field_has_the_right_period_at_any_step() {
    for engine in ENGINES {
        for dt in [1.0 / 20.0, 1.0 / 240.0] {
            let k = 9.0;
            let parameters = [("kx", k), ("x0", 1.0), ("ky", 0.0)];
            let mut scene = free([0.0, 0.5], 20.0, &[("position_field", &parameters)], dt);
            scene.gravity = [0.0, 0.0];
            let t = run(&scene, engine);
            // x = 1 - cos(3 t): the phase is still right after ten periods.
            for (i, time) in t.times.iter().enumerate() {
                let wanted = 1.0 - (3.0 * time).cos();
                let off = (t.bodies[0].x[i] - wanted).abs();
                assert!(off < 3.0 * dt * 1.2, "{engine:?} dt {dt} t {time}: off by {off}");
                near(t.bodies[0].vy[i], 0.5, 1e-6, "the free axis", engine);
            }
        }
    }
}

#[test]
fn position_field_is_stable_for_steps_beyond_its_period() {
    for engine in ENGINES {
        let mut scene = free([0.0, 0.0], 100.0, &[("position_field", &[("kx", 1000.0), ("x0", 1.0)])], 0.1);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        let most = t.bodies[0].x.iter().fold(0.0, |a: f64, x| a.max((x - 1.0).abs()));
        assert!(most < 20.0, "{engine:?}: {most} m off");
    }
}

#[test]
fn repulsion_grows_exponentially() {
    for engine in ENGINES {
        let mut scene =
            free([0.0, 0.0], 2.0, &[("position_field", &[("kx", -4.0), ("x0", -1.0)])], 1.0 / 240.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        near(last(&t.bodies[0].x), (2.0f64 * 2.0).cosh() - 1.0, 0.3, "cosh", engine);
    }
}

#[test]
fn sticky_patch_slows_inside_only() {
    for engine in ENGINES {
        let c = 0.8;
        let patch = [("x_min", 3.0), ("x_max", 5.0), ("y_min", 90.0), ("y_max", 110.0), ("c", c)];
        for v0 in [2.0, 6.0] {
            let mut scene = free([v0, 0.0], 6.0, &[("sticky_patch", &patch)], 1.0 / 240.0);
            scene.gravity = [0.0, 0.0];
            scene.bodies[0].angular_velocity = 1.0;
            let t = run(&scene, engine);
            // Under linear drag speed falls by c per metre of distance.
            let step = v0 / 240.0;
            near(last(&t.bodies[0].vx), v0 - c * 2.0, c * step + 1e-4, "speed behind the patch", engine);
            near(last(&t.bodies[0].omega), (v0 - c * 2.0) / v0, 0.01, "spin", engine);
            let before = t.bodies[0].x.iter().position(|x| *x > 2.0).unwrap();
            near(t.bodies[0].vx[before], v0, 1e-5, "speed before the patch", engine);
            let swapped = patch.map(|(n, v)| match n {
                "x_min" => ("x_max", v),
                "x_max" => ("x_min", v),
                _ => (n, v),
            });
            let turned = Scene { effects: vec![EffectTerm::new("sticky_patch", &swapped)], ..scene.clone() };
            assert_eq!(run(&turned, engine), t, "corners in either order");
        }
    }
}

/// All laws of motion against the Runge-Kutta method, at two time steps: the engines' error is of first
/// order.
#[test]
fn motion_agrees_with_an_independent_integrator() {
    type Law = fn(f64, [f64; 4]) -> [f64; 2];
    type Case = (&'static str, &'static [(&'static str, f64)], Law);
    let cases: [Case; 12] = [
        ("linear_drag", &[("c", 0.7)], |_, [_, _, vx, vy]| [-0.7 * vx, -0.7 * vy]),
        ("quadratic_drag", &[("k", 0.3)], |_, [_, _, vx, vy]| {
            let v = vx.hypot(vy);
            [-0.3 * v * vx, -0.3 * v * vy]
        }),
        ("wind", &[("ax", 2.0), ("ay", 1.0)], |_, _| [2.0, 1.0]),
        ("moving_air", &[("ux", -2.0), ("uy", 1.0), ("k", 0.3)], |_, [_, _, vx, vy]| {
            let (wx, wy) = (vx + 2.0, vy - 1.0);
            let w = wx.hypot(wy);
            [-0.3 * w * wx, -0.3 * w * wy]
        }),
        ("gravity_error", &[("dg", -2.0)], |_, _| [0.0, 2.0]),
        ("lift", &[("s", 1.3)], |_, [_, _, vx, vy]| [-1.3 * vy, 1.3 * vx]),
        ("gust", &[("ax", 3.0), ("ay", -1.0), ("period", 0.8), ("phase", 0.4)], |t, _| {
            let s = (std::f64::consts::TAU * t / 0.8 + 0.4).sin();
            [3.0 * s, -s]
        }),
        ("position_field", &[("kx", 4.0), ("ky", -0.5), ("x0", 2.0), ("y0", 99.0)], |_, [x, y, ..]| {
            [4.0 * (2.0 - x), -0.5 * (99.0 - y)]
        }),
        (
            "place_push",
            &[("ax", 5.0), ("ay", -2.0), ("x0", 2.0), ("y0", 101.0), ("wx", 0.6), ("wy", 0.9)],
            |_, [x, y, ..]| {
                let near = gaussian((x - 2.0) / 0.6, (y - 101.0) / 0.9);
                [5.0 * near, -2.0 * near]
            },
        ),
        (
            "velocity_push",
            &[("ax", -3.0), ("ay", 2.0), ("ux", 4.0), ("uy", 1.0), ("wx", 1.5), ("wy", 2.5)],
            |_, [_, _, vx, vy]| {
                let near = gaussian((vx - 4.0) / 1.5, (vy - 1.0) / 2.5);
                [-3.0 * near, 2.0 * near]
            },
        ),
        ("clock_push", &[("ax", 4.0), ("ay", 3.0), ("t0", 0.6), ("w", 0.15)], |t, _| {
            let near = gaussian((t - 0.6) / 0.15, 0.0);
            [4.0 * near, 3.0 * near]
        }),
        (
            "place_drive",
            &[("along", -4.0), ("across", 6.0), ("x0", 2.0), ("y0", 101.0), ("wx", 0.9), ("wy", 0.9)],
            |_, [x, y, vx, vy]| {
                let near = gaussian((x - 2.0) / 0.9, (y - 101.0) / 0.9) / vx.hypot(vy);
                [near * (-4.0 * vx - 6.0 * vy), near * (-4.0 * vy + 6.0 * vx)]
            },
        ),
    ];
    let start = [0.0, 100.0, 4.0, 5.0];
    let alone = cases.map(|(name, parameters, law)| (vec![EffectTerm::new(name, parameters)], vec![law]));
    let together = (
        cases.iter().map(|c| EffectTerm::new(c.0, c.1)).collect::<Vec<_>>(),
        cases.iter().map(|c| c.2).collect::<Vec<_>>(),
    );
    for (effects, laws) in alone.into_iter().chain([together]) {
        let wanted = runge_kutta(start, 1.5, |t, s| {
            let sum = laws.iter().map(|law| law(t, s)).fold([0.0, -G], |a, b| [a[0] + b[0], a[1] + b[1]]);
            [s[2], s[3], sum[0], sum[1]]
        });
        for engine in ENGINES {
            let error = |dt: f64| {
                let mut scene = free([start[2], start[3]], 1.5, &[], dt);
                scene.effects = effects.clone();
                let b = &run(&scene, engine).bodies[0];
                let got = [last(&b.x), last(&b.y), last(&b.vx), last(&b.vy)];
                got.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            let (coarse, fine) = (error(1.0 / 60.0), error(1.0 / 480.0));
            let names: Vec<&str> = effects.iter().map(|e| e.name.as_str()).collect();
            assert!(coarse < 0.3 && fine < 0.03, "{engine:?} {names:?}: {coarse}, {fine}");
            assert!(fine < coarse / 4.0 || fine < 1e-3, "{engine:?} {names:?}: {coarse}, {fine}");
        }
    }
}

/// A Gaussian of one coordinate is conservative; a drive is not: it adds the same energy in both directions.
#[test]
fn localised_forces_do_the_work_of_their_integral() {
    let gained = |name, amplitude: &'static str, from: f64, vx: f64, engine| {
        let bump = [(amplitude, 3.0), ("x0", 0.0), ("y0", 100.0), ("wx", 0.5), ("wy", 1e5)];
        let mut scene = free([vx, 0.0], 1.5, &[(name, &bump)], 1.0 / 480.0);
        (scene.gravity, scene.bodies[0].position) = ([0.0, 0.0], Some([from, 100.0]));
        last(&run(&scene, engine).bodies[0].vx).powi(2) - vx * vx
    };
    let work = 2.0 * 3.0 * 0.5 * std::f64::consts::TAU.sqrt();
    for engine in ENGINES {
        near(gained("place_push", "ax", -4.0, 6.0, engine), work, 0.05, "there", engine);
        near(gained("place_push", "ax", 4.0, -6.0, engine), -work, 0.05, "and back", engine);
        near(gained("place_drive", "along", -4.0, 6.0, engine), work, 0.05, "driven there", engine);
        near(gained("place_drive", "along", 4.0, -6.0, engine), work, 0.05, "and back", engine);
    }
}

/// With a constant amplitude a drive acts like dry friction and stops the body without reversing it, or
/// rotates the velocity by a / v per second.
#[test]
fn drives_stop_and_deflect_bodies() {
    for engine in ENGINES {
        let driven = |amplitude: &'static str, size: f64| {
            let level = [(amplitude, size), ("wx", 1e5), ("wy", 1e5)];
            let mut scene = free([2.0, 0.0], 1.0, &[("place_drive", &level)], 1.0 / 480.0);
            scene.gravity = [0.0, 0.0];
            run(&scene, engine)
        };
        let stopped = driven("along", -5.0);
        near(last(&stopped.bodies[0].x), 2.0 * 2.0 / (2.0 * 5.0), 0.01, "way to the stop", engine);
        near(last(&stopped.bodies[0].vx), 0.0, 1e-9, "speed at rest", engine);
        let turned = driven("across", 1.2);
        let angle = last(&turned.bodies[0].vy).atan2(last(&turned.bodies[0].vx));
        near(angle, 1.2 / 2.0, 2e-3, "angle turned", engine);
    }
}

/// The velocity gained from a Gaussian pulse is an error function of time; a w sqrt(2 pi) in the end.
#[test]
fn pulses_give_their_integral() {
    for engine in ENGINES {
        let (a, t0, w) = (2.0, 0.5, 0.1);
        let bump = [("ax", a), ("t0", t0), ("w", w)];
        let mut scene = free([0.0, 0.0], 1.0, &[("clock_push", &bump)], 1.0 / 240.0);
        scene.gravity = [0.0, 0.0];
        let t = run(&scene, engine);
        let area = |time: f64| libm::erf((time - t0) / (w * std::f64::consts::SQRT_2));
        for (i, time) in t.times.iter().enumerate() {
            let given = a * w * (std::f64::consts::PI / 2.0).sqrt() * (area(*time) - area(0.0));
            near(t.bodies[0].vx[i], given, 2e-4, "speed", engine);
        }
        near(last(&t.bodies[0].vx), a * w * std::f64::consts::TAU.sqrt(), 1e-5, "area", engine);
    }
}

/// Crossing a Gaussian of velocity takes the integral of 1 / a between two velocities.
#[test]
fn velocity_forces_take_the_integral_of_inverse_acceleration() {
    for engine in ENGINES {
        let (a, u, w) = (3.0, 2.0, 0.8);
        let bump = [("ax", a), ("ux", u), ("uy", 0.0), ("wx", w), ("wy", 1e5)];
        let mut scene = free([1.0, 0.0], 0.8, &[("velocity_push", &bump)], 1.0 / 480.0);
        scene.gravity = [0.0, 0.0];
        let reached = last(&run(&scene, engine).bodies[0].vx);
        // Simpson's rule with a thousand intervals.
        let rate = |v: f64| 1.0 / (a * gaussian((v - u) / w, 0.0));
        let h = (reached - 1.0) / 1000.0;
        let piece = |i: u32| {
            let v = 1.0 + h * f64::from(i);
            (rate(v) + 4.0 * rate(v + h / 2.0) + rate(v + h)) * h / 6.0
        };
        near((0..1000).map(piece).sum(), 0.8, 2e-3, "time", engine);
    }
}

// ---- contact ----

#[test]
fn rolling_resistance_gives_the_right_stopping_distance() {
    // From v0 with crr it stops after v0^2 / (2 crr g), at any mass and size, and does not roll back.
    let (v0, crr) = (3.0, 0.08);
    for engine in ENGINES {
        for (radius, dt) in [(0.5, 1.0 / 240.0), (0.1, 1.0 / 240.0), (0.5, 1.0 / 60.0)] {
            let t = run(&rolling(v0, radius, crr, dt, 6.0), engine);
            let track = &t.bodies[0];
            near(
                last(&track.x),
                v0 * v0 / (2.0 * crr * G),
                3.0 * v0 * dt + 0.02,
                "stopping distance",
                engine,
            );
            near(last(&track.vx), 0.0, 2e-3, "speed at the end", engine);
            assert!(track.vx.iter().all(|v| *v > -2e-3), "{engine:?}: it rolls back");
            let early = t.times.iter().position(|t| *t >= 1.0).unwrap();
            near(track.vx[early], v0 - crr * G * t.times[early], 0.03, "speed on the way", engine);
            near(track.omega[early] * radius, -track.vx[early], 0.03, "it rolls", engine);
        }
    }
}

#[test]
fn rolling_resistance_leaves_flight_and_bounces_alone() {
    for engine in ENGINES {
        let mut scene = rolling(3.0, 0.5, 0.3, 1.0 / 240.0, 1.0);
        scene.bodies[0].position = Some([0.0, 3.0]);
        (scene.bodies[0].friction, scene.bodies[0].restitution) = (0.0, 0.9);
        let t = run(&scene, engine);
        assert!(t.events.len() == 1 || t.events.len() == 2, "{engine:?}: it bounces");
        near(last(&t.bodies[0].vx), 3.0, 1e-4, "speed across", engine);
    }
}

#[test]
fn a_ball_lies_still_on_a_slope_below_the_angle_of_rolling() {
    // The weight component along the slope also accelerates the spin: it rolls at 2/3 g sin, minus crr g
    // cos.
    for engine in ENGINES {
        for (crr, moves) in [(0.03, true), (0.12, false)] {
            let angle: f64 = 0.1;
            let mut scene = rolling(0.0, 0.5, crr, 1.0 / 240.0, 2.0);
            scene.gravity = [G * angle.sin(), -G * angle.cos()];
            let way = last(&run(&scene, engine).bodies[0].x);
            if moves {
                let a = G * (2.0 / 3.0 * angle.sin() - crr * angle.cos());
                near(way, a * 2.0, 0.1 * a * 2.0, "way down the slope", engine);
            } else {
                near(way, 0.0, 0.01, "it lies still", engine);
            }
        }
    }
}

#[test]
fn restitution_falls_with_impact_speed() {
    let (e0, slope) = (0.9, 0.03);
    for engine in ENGINES {
        for height in [1.0, 5.0] {
            let mut scene = empty(1.0 / 480.0, 2.4);
            scene.bodies = vec![ball("a", 0.5, [0.0, 0.5 + height], [0.0, 0.0])];
            scene.bodies[0].restitution = e0;
            scene.statics = vec![floor()];
            scene.observe_every = 1;
            scene.effects = vec![EffectTerm::new("restitution_speed", &[("slope", slope)])];
            let t = run(&scene, engine);
            let y = &t.bodies[0].y;
            let bottom = (1..y.len() - 1).find(|i| y[i + 1] > y[*i]).expect("it bounces");
            let end = (bottom..y.len() - 1).find(|i| t.bodies[0].vy[*i] < 0.0).expect("it comes down again");
            let e = e0 - slope * (2.0 * G * height).sqrt();
            near(y[end] - 0.5, e * e * height, 0.03 * height, "apex", engine);
        }
        // Within [0, 1].
        for (slope, wanted) in [(5.0, 0.0), (-5.0, 1.0)] {
            let mut scene = bouncing([0.0, -4.0], 0.0, 0.5);
            scene.effects = vec![EffectTerm::new("restitution_speed", &[("slope", slope)])];
            near(last(&run(&scene, engine).bodies[0].vy), 4.0 * wanted, 0.05, "speed after", engine);
        }
    }
}

#[test]
fn tangential_restitution_reverses_slip() {
    // A disc with I = m r^2 / 2 has the tangential mass m / 3: surface speed vx + r omega changes from s
    // to -et s, so vx changes by -(1 + et) s / 3.
    let (vx, omega, r) = (1.0, 6.0, 0.5);
    let slip = vx + r * omega;
    for engine in ENGINES {
        for et in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let mut scene = bouncing([vx, -6.0], omega, 0.8);
            scene.effects = vec![EffectTerm::new("tangential_restitution", &[("et", et)])];
            let t = run(&scene, engine);
            let b = &t.bodies[0];
            let what = format!("et {et}: ");
            near(last(&b.vx), vx - (1.0 + et) * slip / 3.0, 0.06, &(what.clone() + "vx"), engine);
            near(last(&b.vx) + r * last(&b.omega), -et * slip, 0.15, &(what.clone() + "slip"), engine);
            near(last(&b.vy), 6.0 * 0.8, 0.06, &(what + "vy"), engine);
        }
        // Within friction: a ball that spins so fast that its surface slides throughout is not
        // reversed.
        let mut scene = bouncing([vx, -6.0], 40.0, 0.8);
        scene.bodies[0].friction = 0.1;
        let sliding = last(&run(&scene, engine).bodies[0].vx);
        scene.effects = vec![EffectTerm::new("tangential_restitution", &[("et", 1.0)])];
        near(last(&run(&scene, engine).bodies[0].vx), sliding, 0.01, "limit of friction", engine);
        if engine == Engine::Lanes {
            near(sliding, vx - 0.1 * 6.0 * 1.8, 1e-6, "friction times the normal impulse", engine);
        }
    }
}

#[test]
fn contact_laws_apply_between_bodies() {
    // Two equal discs collide head on, one spinning: relative tangential mass m / 6.
    for engine in ENGINES {
        let mut scene = empty(1.0 / 480.0, 0.8);
        scene.gravity = [0.0, 0.0];
        scene.bodies = vec![ball("a", 0.5, [0.0, 0.0], [3.0, 0.0]), ball("b", 0.5, [2.0, 0.0], [0.0, 0.0])];
        scene.bodies[0].angular_velocity = 2.0;
        (scene.bodies[0].friction, scene.bodies[1].friction) = (1.5, 1.5);
        (scene.bodies[0].restitution, scene.bodies[1].restitution) = (1.0, 0.9);
        scene.effects = vec![
            EffectTerm::new("restitution_speed", &[("slope", 0.1)]),
            EffectTerm::new("tangential_restitution", &[("et", 0.5)]),
        ];
        let t = run(&scene, engine);
        let (a, b) = (&t.bodies[0], &t.bodies[1]);
        near(last(&b.vx) - last(&a.vx), 3.0 * 0.6, 0.05, "e = 0.9 - 0.1 * 3", engine);
        // Surface speed of b relative to a along +y: -r w before, 0.5 r w after.
        let slip = |a: &Track, b: &Track| last(&b.vy) - last(&a.vy) - 0.5 * (last(&b.omega) + last(&a.omega));
        near(slip(a, b), 0.5, 0.05, "slip", engine);
        near(last(&b.vy) + last(&a.vy), 0.0, 1e-3, "momentum", engine);
    }
}

/// A box lands on an edge with two contacts: the general engine only, and its law for whole manifolds.
#[test]
fn contact_laws_apply_to_boxes() {
    let mut scene = bouncing([0.0, -4.0], 0.0, 0.8);
    scene.bodies[0].shape = Shape::Box(Rectangle { half_width: 0.5, half_height: 0.5 });
    let after = |name: &str, parameters: &[(&str, f64)]| {
        last(&run(&with_effect(&scene, name, parameters), Engine::Rapier).bodies[0].vy)
    };
    // Rapier restores 0.70 of a box's speed for e = 0.8; half the restitution restores half of that.
    let share = after("restitution_speed", &[("slope", 0.1)]) / after("restitution_speed", &[]);
    near(share, 0.5, 0.02, "e = 0.8 - 0.4", Engine::Rapier);
    let mut sliding = rolling(2.0, 0.5, 0.3, 1.0 / 240.0, 1.0);
    sliding.bodies[0].shape = scene.bodies[0].shape.clone();
    (sliding.bodies[0].angular_velocity, sliding.bodies[0].friction) = (0.0, 0.0);
    near(last(&run(&sliding, Engine::Rapier).bodies[0].vx), 2.0, 1e-3, "it slides", Engine::Rapier);
}

// ---- sensors and actions ----

#[test]
fn scale_and_tilt_transform_measurements() {
    for engine in ENGINES {
        let truth = run(&lively(), engine);
        let scaled = run(&with_effect(&lively(), "position_scale", &[("s", 1.1)]), engine);
        let tilted = run(&with_effect(&lively(), "camera_tilt", &[("angle", 0.2)]), engine);
        assert_eq!((&scaled.times, &tilted.times), (&truth.times, &truth.times));
        let (sin, cos) = 0.2f64.sin_cos();
        for (b, own) in truth.bodies.iter().enumerate() {
            let (s, t) = (&scaled.bodies[b], &tilted.bodies[b]);
            for i in 0..own.len() {
                near(s.x[i], 1.1 * own.x[i], 1e-12, "x", engine);
                near(s.vy[i], 1.1 * own.vy[i], 1e-12, "vy", engine);
                assert_eq!((s.angle[i], s.omega[i]), (own.angle[i], own.omega[i]));
                near(t.x[i], own.x[i] * cos - own.y[i] * sin, 1e-12, "x", engine);
                near(t.y[i], own.x[i] * sin + own.y[i] * cos, 1e-12, "y", engine);
                near(t.vx[i], own.vx[i] * cos - own.vy[i] * sin, 1e-12, "vx", engine);
                near(t.angle[i], own.angle[i] + 0.2, 1e-12, "angle", engine);
            }
        }
    }
}

#[test]
fn fast_clock_shows_slow_motion() {
    for engine in ENGINES {
        for s in [0.8, 1.25] {
            let scene = free([2.0, 1.0], 1.0, &[("time_scale", &[("s", s)])], 1.0 / 480.0);
            let t = run(&scene, engine);
            near(last(&t.times), s, 1e-9, "the stamp of the end", engine);
            assert_eq!(t.times[1], 0.05, "stamps are the usual ones");
            for (i, stamp) in t.times.iter().enumerate() {
                let time = stamp / s;
                near(t.bodies[0].x[i], 2.0 * time, 1e-4, "x", engine);
                near(t.bodies[0].y[i], 100.0 + time - G / 2.0 * time * time, 0.02, "y", engine);
                near(t.bodies[0].vy[i], (1.0 - G * time) / s, 0.05, "vy", engine);
            }
        }
    }
}

#[test]
fn delayed_sensor_shows_earlier_states() {
    for engine in ENGINES {
        let scene = free([2.0, 1.0], 1.0, &[("lag", &[("dt", 0.13)])], 1.0 / 480.0);
        let t = run(&scene, engine);
        near(last(&t.times), 1.13, 1e-9, "the stamp of the end", engine);
        let b = &t.bodies[0];
        assert_eq!((b.x[2], b.vx[2]), (0.0, 0.0), "a body waits at its start");
        for (i, stamp) in t.times.iter().enumerate().filter(|(_, stamp)| **stamp > 0.14) {
            near(b.x[i], 2.0 * (stamp - 0.13), 1e-4, "x", engine);
            near(b.vx[i], 2.0, 1e-4, "vx", engine);
        }
        let early = run(&with_effect(&scene, "lag", &[("dt", -0.2)]), engine);
        near(early.bodies[0].x[0], 0.4, 1e-4, "a clock started late", engine);
        near(last(&early.times), 0.8, 1e-9, "the stamp of the end", engine);
        let asleep = run(&with_effect(&scene, "lag", &[("dt", -5.0)]), engine);
        assert_eq!(asleep.times, [0.0]);
        near(asleep.bodies[0].x[0], 2.0, 1e-4, "the end", engine);
    }
}

/// Bounces lie between the usual observations: a delayed sensor must show the true trajectory, not a smooth
/// interpolation across them.
#[test]
fn delayed_sensors_resolve_bounces() {
    for engine in ENGINES {
        let mut scene = lively();
        scene.observe_every = 60;
        let every = Scene { observe_every: 1, ..scene.clone() };
        let truth = run(&every, engine);
        let warped =
            [EffectTerm::new("time_scale", &[("s", 1.1)]), EffectTerm::new("lag", &[("dt", 0.0123)])];
        let seen = run(&Scene { effects: warped.to_vec(), ..scene.clone() }, engine);
        assert!(seen.times.len() > 12);
        // The delay applies last: its state at t is that of the slow clock at t - dt.
        for (i, stamp) in seen.times.iter().enumerate() {
            let time = ((stamp - 0.0123) / 1.1).max(0.0);
            let (n, share) = ((time * 240.0).floor() as usize, (time * 240.0).fract());
            for (b, own) in truth.bodies.iter().enumerate() {
                let m = (n + 1).min(own.len() - 1);
                let straight = own.x[n] + share * (own.x[m] - own.x[n]);
                near(seen.bodies[b].x[i], straight, 2e-3, "x", engine);
                let straight = own.y[n] + share * (own.y[m] - own.y[n]);
                near(seen.bodies[b].y[i], straight, 5e-3, "y", engine);
            }
        }
        // The same sensors applied to a known trajectory.
        let later = observe(truth.clone(), &warped).unwrap();
        let k = later.times.iter().position(|t| (t - seen.times[3]).abs() < 1e-9).unwrap();
        near(later.bodies[0].y[k], seen.bodies[0].y[3], 1e-9, "y", engine);
        assert!(last(&later.times) <= last(&truth.times));
    }
}

#[test]
fn sensors_keep_outcomes_and_contacts() {
    let mut scene = lively();
    scene.goal =
        Some(Goal::Contact { bodies: ["a".into(), "b".into()], hold_s: 0.0, tolerance: 0.01, stop: None });
    for engine in ENGINES {
        let truth = run(&scene, engine);
        assert!(truth.solved() && truth.outcome.steps < scene.steps, "{engine:?}");
        for (name, parameters) in [
            ("position_scale", [("s", 2.0)]),
            ("time_scale", [("s", 0.7)]),
            ("camera_tilt", [("angle", 1.0)]),
            ("lag", [("dt", 0.1)]),
        ] {
            let seen = run(&with_effect(&scene, name, &parameters), engine);
            assert_eq!(seen.outcome, truth.outcome, "{engine:?} {name}");
            assert_eq!(seen.events, truth.events, "{engine:?} {name}");
            assert_eq!((seen.collisions, seen.rolling_steps), (truth.collisions, truth.rolling_steps));
            assert_ne!(seen.bodies, truth.bodies, "{engine:?} {name}");
        }
        // The end is measured, whatever its stamp.
        let slow = run(&with_effect(&scene, "time_scale", &[("s", 0.7)]), engine);
        assert_eq!(last(&slow.bodies[0].x), last(&truth.bodies[0].x));
        near(last(&slow.times), 0.7 * last(&truth.times), 1e-9, "the stamp of the end", engine);
    }
}

#[test]
fn rejects_implausible_clocks() {
    let mut scene = lively();
    scene.effects = vec![EffectTerm::new("time_scale", &[("s", 10.0)]); 6];
    let error = Simulator::new(Engine::Auto).run(&[rollout(&scene)]).unwrap_err().to_string();
    assert!(error.contains("effects") && error.contains("observations"), "{error}");
}

#[test]
fn placement_offset_shifts_placed_objects() {
    let task = &family("basketball").unwrap().tasks()[0];
    let action = task.actions().at(12_345).unwrap();
    let Placement::Valid(scene) = task.place(&action) else { panic!("pick another action") };
    let off = [EffectTerm::new("placement_offset", &[("dx", 0.3), ("dy", -0.2)])];
    let components = &scene.action.as_ref().unwrap().components;
    for engine in ENGINES {
        let [asked, done] = [&[][..], &off[..]].map(|effects| {
            Simulator::new(engine).run(&[Rollout { effects, ..rollout(&scene) }]).unwrap().remove(0)
        });
        for (b, body) in scene.bodies.iter().enumerate() {
            let placed = components.iter().any(|c| c.target == body.name);
            let shift = if placed { [0.3, -0.2] } else { [0.0, 0.0] };
            near(done.bodies[b].x[0] - asked.bodies[b].x[0], shift[0], 1e-5, &body.name, engine);
            near(done.bodies[b].y[0] - asked.bodies[b].y[0], shift[1], 1e-5, &body.name, engine);
        }
    }
    // Without an action, the author of the scene placed all movable bodies.
    let moved = run(&with_effect(&lively(), "placement_offset", &[("dx", 0.5)]), Engine::Lanes);
    let plain = run(&lively(), Engine::Lanes);
    for (m, p) in moved.bodies.iter().zip(&plain.bodies) {
        near(m.x[0] - p.x[0], 0.5, 1e-12, "start", Engine::Lanes);
    }
}

#[test]
fn placement_offset_shifts_placed_statics() {
    // A ball falls on a plank; if the action places the plank too low, the impact is later.
    let mut scene = empty(1.0 / 240.0, 1.5);
    scene.bodies = vec![ball("a", 0.2, [0.0, 3.0], [0.0, 0.0])];
    scene.statics = vec![Static { name: "plank".into(), position: [0.0, 1.0], ..floor() }];
    scene.action = Some(
        serde_json::from_str(
            r#"{"components": [{"target": "plank", "set": "y", "low": 0, "high": 2}],
                "discrete": {"type": "grid", "counts": [3]}}"#,
        )
        .unwrap(),
    );
    for engine in ENGINES {
        for dy in [0.0, -1.0] {
            let mut placed = scene.clone();
            placed.effects = vec![EffectTerm::new("placement_offset", &[("dy", dy)])];
            let t = run(&placed, engine);
            // The top of the plank is at its y; the ball, which is not placed, falls from 2.8
            // above 0.
            let fall: f64 = 2.8 - 1.0 - dy;
            near(t.events[0].time, (2.0 * fall / G).sqrt(), 0.02, "time of impact", engine);
            assert_eq!(t.bodies[0].y[0], 3.0);
        }
    }
}

#[test]
fn hidden_worlds_support_every_effect() {
    for own in families() {
        let name = own.name;
        let task = &own.tasks()[0];
        let actions: Vec<_> = (0..200).map(|i| task.actions().at(i * 190).unwrap()).collect();
        let valid = |a: &&iplw::task::ValidAction| matches!(task.place(a), Placement::Valid(_));
        let actions: Vec<_> = actions.iter().filter(valid).take(3).cloned().collect();
        let measure = |effects: Vec<EffectTerm>| {
            let mut world = HiddenWorld::new(HiddenConfig { effects, ..standard(own) }).unwrap();
            let attempts = world.measure(task, &actions).unwrap();
            assert_eq!(world.interactions(), 3);
            attempts.into_iter().map(|a| a.into_trial("t".into()).unwrap()).collect::<Vec<_>>()
        };
        let plain = measure(Vec::new());
        for e in effect::REGISTRY {
            let trials = measure(vec![EffectTerm::new(e.name, &strong_parameters(e))]);
            assert_ne!(
                trials.iter().map(|t| &t.observed).collect::<Vec<_>>(),
                plain.iter().map(|t| &t.observed).collect::<Vec<_>>(),
                "{name}: {}",
                e.name
            );
            let columns = trials.iter().flat_map(|t| &t.observed.bodies).flat_map(|b| [&b.x, &b.y]);
            assert!(columns.flatten().all(|v| v.is_finite()), "{name}: {}", e.name);
        }
    }
}

// ---- every effect ----

#[test]
fn neutral_values_change_no_bit() {
    for engine in ENGINES {
        let scene = lively();
        let plain = run(&scene, engine);
        for e in effect::REGISTRY {
            let neutral: Vec<(&str, f64)> = e.parameters.iter().map(|p| (p.name, p.neutral)).collect();
            let with = Scene { effects: vec![EffectTerm::new(e.name, &neutral)], ..scene.clone() };
            assert_eq!(bits(&run(&with, engine)), bits(&plain), "{engine:?} {}", e.name);
            assert_eq!(run(&with, engine), plain, "{engine:?} {}", e.name);
        }
    }
}

#[test]
fn every_effect_acts_in_both_engines() {
    for e in effect::REGISTRY {
        for engine in ENGINES {
            let scene = lively();
            let strong =
                Scene { effects: vec![EffectTerm::new(e.name, &strong_parameters(e))], ..scene.clone() };
            assert_ne!(bits(&run(&strong, engine)), bits(&run(&scene, engine)), "{engine:?} {}", e.name);
        }
    }
}

/// Effects act on each lane alone, at any SIMD level and in any batch, and rest is distinguished from zero
/// velocity under a force.
#[test]
fn lanes_with_effects_are_independent() {
    let mut scenes = Vec::new();
    for e in effect::REGISTRY {
        for k in 0..5 {
            let mut scene = lively();
            scene.bodies[0].position = Some([-2.0 - 0.1 * f64::from(k), 2.0 + 0.2 * f64::from(k)]);
            scene.steps = 600 + 400 * k;
            let share = 0.2 * f64::from(k);
            let values = strong_parameters(e).into_iter().zip(e.parameters);
            let values = values.map(|((n, v), p)| (n, p.neutral + share * (v - p.neutral)));
            scene.effects = vec![
                EffectTerm::new(e.name, &values.collect::<Vec<_>>()),
                EffectTerm::new("linear_drag", &[("c", 2.0)]),
            ];
            scenes.push(scene);
        }
    }
    let rollouts: Vec<Rollout> = scenes.iter().map(rollout).collect();
    let alone: Vec<Trajectory> =
        rollouts.iter().map(|r| Simulator::new(Engine::Lanes).run(&[*r]).unwrap().remove(0)).collect();
    let same = |ours: Vec<Trajectory>, what: &str| {
        for ((ours, alone), scene) in ours.iter().zip(&alone).zip(&scenes) {
            assert_eq!(bits(ours), bits(alone), "{what}: {:?}", scene.effects);
            assert_eq!(ours, alone, "{what}: {:?}", scene.effects);
        }
    };
    for level in SimdLevel::ALL.iter().copied().filter(|l| l.available()) {
        for end_at_rest in [true, false] {
            let settings = BatchSettings { level, end_at_rest };
            let ours = Simulator::new(Engine::Lanes).settings(settings).map(&rollouts, |_, t| t).unwrap();
            same(ours, &format!("{settings:?}"));
        }
    }
}

#[test]
fn errors_list_known_names() {
    let mut scene = lively();
    scene.effects = vec![EffectTerm::new("ether", &[])];
    let error = Simulator::new(Engine::Auto).run(&[rollout(&scene)]).unwrap_err().to_string();
    assert!(
        error.contains("effects[0].name") && error.contains("linear_drag") && error.contains("sticky_patch"),
        "{error}"
    );
    scene.effects = vec![EffectTerm::new("wind", &[("az", 1.0)])];
    let error = Simulator::new(Engine::Auto).run(&[rollout(&scene)]).unwrap_err().to_string();
    assert!(error.contains("effects[0].parameters.az") && error.contains("ax, ay"), "{error}");
    scene.effects = vec![EffectTerm::new("gust", &[("period", 0.0)])];
    let error = Simulator::new(Engine::Auto).run(&[rollout(&scene)]).unwrap_err().to_string();
    assert!(error.contains("effects[0].parameters.period") && error.contains("from 0.001 to"), "{error}");
}

/// No other file names an effect, except the study of hidden worlds with certain effects.
#[test]
fn effects_are_named_only_in_their_own_files() {
    /// Compiled for unit tests only.
    const FOR_TESTS: [&str; 2] = ["inference/testing/segments.rs", "inference/testing/throws.rs"];
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut pending, mut offences) = (vec![root.clone()], Vec::new());
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let below = path.strip_prefix(&root).unwrap().to_string_lossy().to_string();
            if path.is_dir() {
                pending.push(path);
                continue;
            }
            if below.starts_with("world/effect/") || below == "experiment/study.rs" || !below.ends_with(".rs")
            {
                continue;
            }
            if FOR_TESTS.contains(&below.as_str()) {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]").next().unwrap_or_default();
            let code = text.lines().map(str::trim).filter(|line| !line.starts_with("//"));
            for (line, e) in code.flat_map(|line| effect::REGISTRY.iter().map(move |e| (line, e))) {
                // `lag` and `wind` occur within other words: only whole literals count.
                if line.contains(&format!("\"{}\"", e.name)) || line.contains(&format!("\"{}.", e.name)) {
                    offences.push(format!("{below}: {line}"));
                }
            }
        }
    }
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Samples are finite for any parameters; an implausible rollout ends as diverged.
    #[test]
    fn parameters_within_bounds_give_finite_states(
        chosen in prop::collection::vec(
            (0..effect::REGISTRY.len(), prop::array::uniform8(0.0..=1.0f64)),
            1..4,
        ),
        rapier in any::<bool>(),
    ) {
        let effects = chosen.iter().map(|(i, shares)| {
            let e = effect::REGISTRY[*i];
            let values = e.parameters.iter().zip(shares).map(|(p, share)| {
                let [low, high] = p.bounds;
                (p.name, (low + share * (high - low)).clamp(low, high))
            });
            EffectTerm::new(e.name, &values.collect::<Vec<_>>())
        });
        let mut scene = Scene { effects: effects.collect(), ..lively() };
        scene.steps = 240;
        let engine = if rapier { Engine::Rapier } else { Engine::Lanes };
        let t = match Simulator::new(engine).run(&[rollout(&scene)]) {
            Ok(mut all) => all.remove(0),
            // Several clocks with tenfold errors.
            Err(e) => {
                prop_assert!(e.to_string().contains("observations"), "{}", e);
                return Ok(());
            }
        };
        for b in &t.bodies {
            for column in [&b.x, &b.y, &b.angle, &b.vx, &b.vy, &b.omega] {
                prop_assert_eq!(column.len(), t.times.len());
                prop_assert!(column.iter().all(|v| v.is_finite()), "{:?}", scene.effects);
            }
        }
    }
}

// ---- helpers ----

/// Parameters that change every rollout of [`lively`].
fn strong_parameters(e: &effect::Effect) -> Vec<(&'static str, f64)> {
    let special = |p: &effect::ParameterDeclaration| match (e.name, p.name) {
        ("sticky_patch", "x_min" | "y_min") => Some(-100.0),
        ("sticky_patch", "x_max" | "y_max") => Some(100.0),
        ("gust", "period") => Some(1.0),
        // Impacts that slide throughout have no more grip to gain, only to lose.
        ("tangential_restitution", _) => Some(-1.0),
        // A small offset into a wall, not through it.
        ("placement_offset", _) => Some(0.05),
        _ => None,
    };
    let value = |p: &effect::ParameterDeclaration| {
        special(p).unwrap_or_else(|| (p.neutral + 0.3).clamp(p.bounds[0], p.bounds[1]))
    };
    e.parameters.iter().map(|p| (p.name, value(p))).collect()
}

/// Two balls that fall, bounce, collide and roll.
fn lively() -> Scene {
    let mut a = ball("a", 0.3, [-2.0, 2.0], [2.0, 0.0]);
    let mut b = ball("b", 0.2, [1.0, 0.2], [0.0, 0.0]);
    (a.angular_velocity, a.restitution, b.friction) = (4.0, 0.7, 0.4);
    let mut scene = empty(1.0 / 240.0, 3.0);
    scene.bodies = vec![a, b];
    scene.statics = vec![floor()];
    scene
}

/// The scene with one effect instead of its own.
fn with_effect(scene: &Scene, name: &str, parameters: &[(&str, f64)]) -> Scene {
    Scene { effects: vec![EffectTerm::new(name, parameters)], ..scene.clone() }
}

/// A ball on the floor that rolls at `v0` against `crr`.
fn rolling(v0: f64, radius: f64, crr: f64, dt: f64, seconds: f64) -> Scene {
    let mut scene = empty(dt, seconds);
    scene.bodies = vec![ball("a", radius, [0.0, radius], [v0, 0.0])];
    (scene.bodies[0].angular_velocity, scene.bodies[0].restitution) = (-v0 / radius, 0.0);
    scene.statics = vec![floor()];
    scene.effects = vec![EffectTerm::new("rolling_resistance", &[("crr", crr)])];
    scene
}

/// A ball thrown at the floor without gravity, observed after the bounce.
fn bouncing(velocity: [f64; 2], omega: f64, e: f64) -> Scene {
    let mut scene = empty(1.0 / 480.0, 0.5);
    scene.gravity = [0.0, 0.0];
    scene.bodies = vec![ball("a", 0.5, [0.0, 1.5], velocity)];
    (scene.bodies[0].angular_velocity, scene.bodies[0].restitution) = (omega, e);
    scene.bodies[0].friction = 3.0;
    scene.statics = vec![floor()];
    scene
}

/// A ball in free flight from (0, 100).
fn free(velocity: [f64; 2], seconds: f64, effects: &[(&str, &[(&str, f64)])], dt: f64) -> Scene {
    let mut scene = empty(dt, seconds);
    scene.bodies = vec![ball("a", 0.5, [0.0, 100.0], velocity)];
    scene.effects = effects.iter().map(|(name, parameters)| EffectTerm::new(name, parameters)).collect();
    scene
}

fn empty(dt: f64, seconds: f64) -> Scene {
    Scene {
        time_step: dt,
        steps: (seconds / dt).round() as u32,
        observe_every: (0.05 / dt).round().max(1.0) as u32,
        ..Scene::empty()
    }
}

fn ball(name: &str, radius: f64, position: [f64; 2], velocity: [f64; 2]) -> Body {
    Body {
        name: name.into(),
        shape: Shape::Disc(Disc { radius }),
        mass: None,
        density: Some(1.0),
        friction: 0.8,
        restitution: 0.5,
        position: Some(position),
        angle: 0.0,
        velocity,
        angular_velocity: 0.0,
        inertia: None,
    }
}

fn floor() -> Static {
    Static {
        name: "floor".into(),
        shape: Shape::Segment(SegmentShape { from: [-500.0, -1.0], to: [500.0, -1.0], radius: 1.0 }),
        friction: 1.0,
        restitution: 1.0,
        position: [0.0, 0.0],
        angle: 0.0,
    }
}

fn rollout(scene: &Scene) -> Rollout<'_> {
    Rollout::of(scene)
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    Simulator::new(engine).run(&[rollout(scene)]).unwrap().remove(0)
}

fn bits(t: &Trajectory) -> Vec<u64> {
    let columns =
        |b: &Track| [b.x.clone(), b.y.clone(), b.angle.clone(), b.vx.clone(), b.vy.clone(), b.omega.clone()];
    t.bodies.iter().flat_map(columns).flatten().map(f64::to_bits).collect()
}

/// A Gaussian bump at distances in widths.
fn gaussian(a: f64, b: f64) -> f64 {
    f64::exp(-(a * a + b * b) / 2.0)
}

fn last(column: &[f64]) -> f64 {
    *column.last().expect("a trajectory has samples")
}

fn near(value: f64, wanted: f64, tolerance: f64, what: &str, engine: Engine) {
    assert!((value - wanted).abs() <= tolerance, "{engine:?}: {what} is {value}, not {wanted}");
}

/// The classical Runge-Kutta method at a thousandth of a second; state (x, y, vx, vy).
fn runge_kutta(start: [f64; 4], seconds: f64, rate: impl Fn(f64, [f64; 4]) -> [f64; 4]) -> [f64; 4] {
    let h = 1e-3;
    let mut s = start;
    for n in 0..(seconds / h).round() as u32 {
        let t = f64::from(n) * h;
        let ahead = |k: [f64; 4], f: f64| std::array::from_fn(|i| s[i] + f * h * k[i]);
        let k1 = rate(t, s);
        let k2 = rate(t + h / 2.0, ahead(k1, 0.5));
        let k3 = rate(t + h / 2.0, ahead(k2, 0.5));
        let k4 = rate(t + h, ahead(k3, 1.0));
        s = std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    s
}
