//! Examples of request bodies in the OpenAPI document, by operation. A test sends each of them in this order.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::world::LINEAR_DRAG;

/// Example of an operation's JSON body; `None` if the operation has no such body.
pub fn example(operation: &str) -> Option<Value> {
    let action = json!([0.5, 0.8, 0.3]);
    let drag = LINEAR_DRAG.effect.name;
    let throws = json!({"ball": {"radius": 0.02}, "trials": throws()});
    Some(match operation {
        "create_world" => json!({"task": "bowling", "latents": {"friction": 0.8}, "damping": 0.9}),
        "reset_world" => json!({"seed": 1, "task": "bowling:000"}),
        "step_world" => json!({"action": action}),
        "set_latents" => json!({"friction": 0.4}),
        "rollout_world" => json!({"actions": [action, [0.2, 0.6, 0.4]], "trajectories": true}),
        "snapshot_world" => json!({"action": action, "at": 1.0}),
        "branch_world" => json!({
            "snapshot": {
                "format": "iplw.snapshot/1", "world": "bowling-sim", "task": "bowling:000", "action": action,
                "latents": {"density": 1.0, "friction": 0.4, "restitution": 0.5}, "stop": true, "interventions": [],
                "at": 1.0, "step": 240,
            },
            "interventions": [{"type": "impulse", "body": "green", "impulse": [1, 0]}],
        }),
        "create_worlds" => json!({"task": "bowling", "count": 2, "seed": 1}),
        "reset_worlds" => json!({"worlds": ["bowling-sim"], "seeds": [1]}),
        "step_worlds" => json!({"worlds": ["bowling-sim"], "actions": [action], "autoreset": "next_step"}),
        "delete_worlds" => json!({"worlds": ["world-1", "world-2"]}),
        "create_control_world" => {
            json!({"task": "pendulum_swing_up", "count": 2, "reward": "sparse", "seed": 1})
        }
        "reset_control_world" => json!({"seed": 1}),
        "step_control_world" => json!({"actions": [[0.3], [-0.3]], "autoreset": "next_step"}),
        "rollout_control_world" => json!({"environment": 1, "actions": [[[0.5], [0.5]], [[-0.5], [0.5]]]}),
        "set_control_physics" => json!({
            "effects": [{"joint": "hinge", "name": "viscous_friction", "parameters": {"b": [0.0, 0.02]}}],
            "noise": {"hinge": 0.001},
        }),
        "place" => json!({"task": "bowling:000", "actions": [action]}),
        "simulate" => json!({"scene": rig(), "action": [0.75, 0.5]}),
        "start_iplw" => {
            json!({"scene": rig(), "real": "ask_tell", "rounds": 2, "actions": 4, "residual": "shooting"})
        }
        "submit_trials" => json!({"trials": [{
            "proposal": 0, "t": [0.0, 0.1, 0.2, 0.3, 0.4],
            "bodies": {"ball": {"x": [0.0, 0.2, 0.4, 0.6, 0.8], "y": [0.5, 0.55, 0.5, 0.36, 0.12]}},
        }]}),
        "start_diagnosis" => throws,
        "start_posterior" => merged(throws, json!({"sets": [[drag]], "draws": 128})),
        "start_likelihood" => merged(throws, json!({"effects": [drag]})),
        "evaluate_likelihood" => json!({"columns": {LINEAR_DRAG.to_string(): [0.0, 0.4]}}),
        "draw_starts" => json!({"count": 4, "seed": 1}),
        "start_plan" => json!({"task": "bowling:000", "actions": 100, "draws": 4}),
        "start_design" => json!({"task": "basketball", "question": "latents", "candidates": 20}),
        "update_job" => json!({"name": "Bounces on felt", "note": "Camera 2, lights on."}),
        "train_policy" => json!({"task": "basketball", "latents": {"friction": 0.2}, "batches": 50}),
        "act" => json!({"task": "basketball:000", "count": 3}),
        "evaluate_policy" => json!({"world": "basketball-real", "split": "test"}),
        "learn_policy" => json!({"world": "basketball-real", "attempts": 30, "batches": 10}),
        "find_surface" => json!({"task": "basketball", "points": 8, "actions": 50}),
        "make_token" => json!({"name": "laptop", "scope": "act", "expires": "30d"}),
        _ => return None,
    })
}

/// A rig: a ball that is thrown over a table; no goal.
fn rig() -> Value {
    json!({
        "format": "iplw.scene/1",
        "name": "table",
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "position": [0.0, 0.5]}],
        "statics": [{"name": "table", "shape": {"type": "segment", "from": [-1, 0], "to": [4, 0]}}],
        "time_step": 0.004, "steps": 250, "observe_every": 10,
        "calibrate": ["friction", "restitution"],
        "action": {"components": [
            {"target": "ball", "set": "vx", "low": 0, "high": 4},
            {"target": "ball", "set": "vy", "low": -1, "high": 3},
        ]},
    })
}

/// Tracks of six throws with a linear drag of 0.4 1/s, as `trial,t,body,x,y`, s and m.
fn throws() -> String {
    let mut csv = String::from("trial,t,body,x,y\n");
    for (trial, i) in (0..6).flat_map(|trial| (0..12).map(move |i| (trial, i))) {
        let (t, rate) = (0.05 * f64::from(i), 0.4);
        let path = (1.0 - libm::exp(-rate * t)) / rate;
        let (x, y) = ((2.0 + 0.5 * f64::from(trial)) * path, 3.0 * path - 9.81 * (t - path) / rate);
        // Writing to a String cannot fail.
        let _ = writeln!(csv, "{trial},{t:.2},ball,{x:.4},{y:.4}");
    }
    csv
}

fn merged(mut one: Value, more: Value) -> Value {
    if let (Value::Object(one), Value::Object(more)) = (&mut one, more) {
        one.extend(more);
    }
    one
}
