//! Hidden worlds with a floor, on which a ball bounces or rolls.

use super::{Noise, noisy, normal};
use iplw::reality::{Trial, trials_from_csv};
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;

/// Number of kinds of [`contact`].
pub const CONTACTS: usize = 6;

/// Names of hidden effects of a world with a floor, and trials of a ball that bounces or rolls on it. The
/// floor's true restitution and friction differ from the scene's.
pub fn contact(
    kind: usize,
    noise: Noise,
    count: usize,
    rows: usize,
    seed: u64,
) -> (Vec<&'static str>, Vec<Trial>) {
    let mut r = rng::stream(seed, "contacts");
    let share: f64 = r.random_range(0.7..1.4);
    let (mut slope, mut et, mut crr, mut patch, mut c) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let rolls = kind >= 3;
    let names = match kind {
        0 | 3 => Vec::new(),
        1 => {
            slope = 0.04 * share;
            vec!["restitution_speed"]
        }
        2 => {
            et = 0.5 * share;
            vec!["tangential_restitution"]
        }
        4 => {
            crr = 0.03 * share;
            vec!["rolling_resistance"]
        }
        5 if share < 1.05 => {
            patch = 0.8;
            vec!["sticky_patch"]
        }
        _ => {
            c = 0.15 * share;
            vec!["linear_drag"]
        }
    };
    let (e, mu, radius) = (r.random_range(0.7..0.85), r.random_range(0.2..0.4), 0.05);
    let mut csv = String::from("trial,t,body,x,y,angle\n");
    let (mut n, sd) = (rng::stream(seed, "noise"), 0.0015);
    for trial in 0..count {
        // x, y, vx, vy, spin, angle
        let mut s: [f64; 6] = if rolls {
            let v = r.random_range(0.8..3.0) * if trial % 3 == 2 { -1.0 } else { 1.0 };
            [if v > 0.0 { 0.0 } else { 3.0 }, radius, v, 0.0, -v / radius, 0.0]
        } else {
            let (v, w) = (r.random_range(-3.0..3.0), r.random_range(-20.0..20.0));
            [0.0, r.random_range(0.6..2.5), v, r.random_range(-1.0..1.0), w, 0.0]
        };
        let (gap, h) = (0.02, 1e-4);
        let mut carried: [f64; 2] = [normal(&mut n), normal(&mut n)];
        for row in 0..rows {
            let seen = noisy(noise, [s[0], s[1]], sd, &mut carried, &mut n);
            let turned = s[5] + 0.03 * normal(&mut n);
            csv += &format!("{trial},{},ball,{},{},{turned}\n", gap * row as f64, seen[0], seen[1]);
            for _ in 0..(gap / h).round() as usize {
                let local = if s[0] > 1.0 && s[0] < 2.0 { patch } else { 0.0 };
                if rolls {
                    let a = -(c + local) * s[2] - crr * 9.81 * s[2].signum();
                    s[0] += h * s[2] + 0.5 * h * h * a;
                    s[2] += h * a;
                    s[4] = -s[2] / radius;
                } else {
                    s[0] += h * s[2];
                    s[1] += h * s[3] - 0.5 * h * h * 9.81;
                    s[3] -= h * 9.81;
                    if s[1] < radius && s[3] < 0.0 {
                        let rebound = (e - slope * -s[3]).clamp(0.0, 1.0);
                        let push = -(1.0 + rebound) * s[3];
                        let slip = s[2] + radius * s[4];
                        // A full disc: a third of the mass resists slip.
                        let grip = ((1.0 + et) * slip / 3.0).clamp(-mu * push, mu * push);
                        s[3] += push;
                        s[2] -= grip;
                        s[4] -= 2.0 * grip / radius;
                    }
                }
                s[5] += h * s[4];
            }
        }
    }
    let scene = floor();
    (names, trials_from_csv(&csv, &scene).expect("generated trials are valid"))
}

/// The scene for a diagnosis of [`contact`].
pub fn floor() -> Scene {
    Scene::from_json(
        r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.1,
                        "friction": 0.5, "restitution": 0.9}],
            "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
            "calibrate": ["friction", "restitution"]}"#,
    )
    .expect("the scene is valid")
}
