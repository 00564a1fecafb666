//! Persistence across kills: jobs, worlds and their counters, submitted trials, pagination and idempotency keys. Uses
//! the binary and SIGKILL.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use iplw::rng;
use rand::RngExt;
use reqwest::blocking::{Client, RequestBuilder, Response};
use serde_json::{Value, json};

/// A server process on a data directory, killed on drop.
struct Process {
    child: Child,
    url: String,
    client: Client,
}

impl Process {
    fn start(directory: &Path) -> Process {
        let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
            .args(["serve", "--http", "127.0.0.1:0", "--data-dir"])
            .arg(directory)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = line.trim().strip_prefix("listening on ").expect("a server that listens").to_string();
        Process { child, url, client: Client::builder().timeout(Duration::from_secs(120)).build().unwrap() }
    }

    fn get(&self, path: &str) -> Value {
        ok(self.client.get(format!("{}{path}", self.url)), 200)
    }

    fn post(&self, path: &str, body: &Value, status: u16) -> Value {
        ok(self.request(path, body.to_string()), status)
    }

    fn request(&self, path: &str, body: impl Into<reqwest::blocking::Body>) -> RequestBuilder {
        self.client.post(format!("{}{path}", self.url)).body(body)
    }

    /// Waits for a state of the job; panics if it ends in another.
    fn reach(&self, job: &str, state: &str) -> Value {
        loop {
            let job = self.get(&format!("/v1/jobs/{job}"));
            if job["state"] == state {
                return job;
            }
            let going = ["queued", "running", "waiting"].contains(&job["state"].as_str().unwrap());
            assert!(going, "{state} wanted: {job}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// SIGKILL.
    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn ok(request: RequestBuilder, status: u16) -> Value {
    read(request.send().unwrap(), status)
}

fn read(response: Response, status: u16) -> Value {
    let (got, url) = (response.status().as_u16(), response.url().clone());
    let text = response.text().unwrap();
    assert_eq!(got, status, "{url}: {text}");
    serde_json::from_str(&text).unwrap()
}

/// A problem's status and field.
fn problem(request: RequestBuilder) -> (u16, String, Value) {
    let response = request.send().unwrap();
    let status = response.status().as_u16();
    assert_eq!(response.headers()["content-type"], "application/problem+json", "{status}");
    let told = read(response, status);
    (status, told["field"].as_str().unwrap_or_default().to_string(), told)
}

fn id(made: &Value) -> String {
    made["id"].as_str().unwrap().to_string()
}

/// A result without durations.
fn without_durations(job: &Value) -> Value {
    let mut result = job["result"].clone();
    if let Some(fields) = result.as_object_mut() {
        fields.remove("seconds");
    }
    result
}

/// Two estimations in dedicated worlds and one in a shared world with noise and a budget:
/// small, so that kills hit every stage.
fn start_jobs(server: &Process) -> (String, Vec<String>) {
    let world = json!({"task": "basketball", "kind": "real", "noise": 0.01, "budget": 100, "seed": 5});
    let world = id(&server.post("/v1/worlds", &world, 201));
    let small = |more: Value| {
        let mut body = json!({"task": "basketball", "rounds": 6, "actions": 4, "samples": 24});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        body
    };
    let jobs = [
        small(json!({"world": world, "seed": 1})),
        small(json!({"real": {"damping": 0.6, "noise": 0.02}, "seed": 2})),
        small(json!({"strategy": "random", "seed": 3, "budget": 13})),
    ];
    let ids = jobs.iter().map(|body| id(&server.post("/v1/iplw", body, 202))).collect();
    (world, ids)
}

#[test]
fn jobs_give_the_same_result_after_kills() {
    let quiet = tempfile::tempdir().unwrap();
    let server = Process::start(quiet.path());
    let (world, jobs) = start_jobs(&server);
    let begun = Instant::now();
    let wanted: Vec<Value> = jobs.iter().map(|j| without_durations(&server.reach(j, "succeeded"))).collect();
    let whole = begun.elapsed().as_secs_f64();
    let interactions = server.get(&format!("/v1/worlds/{world}"))["interactions"].clone();
    let trials = |server: &Process, job: &str| {
        server
            .client
            .get(format!("{}/v1/jobs/{job}/trials?format=csv", server.url))
            .send()
            .unwrap()
            .text()
            .unwrap()
    };
    let files: Vec<String> = jobs.iter().map(|j| trials(&server, j)).collect();
    drop(server);

    let mut stream = rng::stream(7, "kills");
    let (mut kills, mut runs) = (0, 0);
    while kills < 20 {
        let directory = tempfile::tempdir().unwrap();
        let mut server = Process::start(directory.path());
        let (world, jobs) = start_jobs(&server);
        runs += 1;
        // Kill until the jobs are done, at increasing intervals, so that jobs make progress.
        for patience in 2.. {
            let pause = 0.5 * whole * f64::from(patience) * stream.random_range(0.02..0.35);
            std::thread::sleep(Duration::from_secs_f64(pause));
            let states = jobs.iter().map(|j| server.get(&format!("/v1/jobs/{j}"))["state"].clone());
            let states: Vec<Value> = states.collect();
            assert!(!states.contains(&json!("failed")), "{states:?} after {kills} kills");
            if states.iter().all(|s| s == "succeeded") {
                break;
            }
            server.kill();
            kills += 1;
            server = Process::start(directory.path());
        }
        for ((job, wanted), file) in jobs.iter().zip(&wanted).zip(&files) {
            assert_eq!(
                without_durations(&server.reach(job, "succeeded")),
                *wanted,
                "{job} after {kills} kills"
            );
            assert_eq!(trials(&server, job), *file, "{job}: the same was measured");
        }
        let spent = server.get(&format!("/v1/worlds/{world}"))["interactions"].clone();
        assert_eq!(spent, interactions, "every interaction is counted once");
    }
    println!("{kills} kills in {runs} runs");
}

#[test]
fn training_and_evaluation_resume_after_a_kill() {
    let directory = tempfile::tempdir().unwrap();
    let train = json!({"task": "basketball:000", "batches": 30, "seed": 3});
    let evaluate = json!({"world": "basketball-real", "attempts": 3});
    let run = |server: Process, kill: bool| {
        let job = id(&server.post("/v1/policies", &train, 202));
        let server = if kill { restart(server, directory.path()) } else { server };
        let trained = server.reach(&job, "succeeded");
        let policy = trained["result"]["policy"].as_str().unwrap().to_string();
        let before = server.get("/v1/worlds/basketball-real")["interactions"].as_u64().unwrap();
        let job = id(&server.post(&format!("/v1/policies/{policy}/evaluate"), &evaluate, 202));
        let server = if kill { restart(server, directory.path()) } else { server };
        let evaluated = without_durations(&server.reach(&job, "succeeded"));
        let spent = server.get("/v1/worlds/basketball-real")["interactions"].as_u64().unwrap() - before;
        assert_eq!(evaluated["interactions"], spent, "attempts are made once");
        let mut trained = without_durations(&trained);
        trained.as_object_mut().unwrap().remove("policy");
        (server, trained, evaluated)
    };
    let (server, trained, evaluated) = run(Process::start(directory.path()), false);
    let (_, trained_again, evaluated_again) = run(server, true);
    assert_eq!(trained, trained_again);
    assert_eq!(evaluated, evaluated_again);
}

fn restart(server: Process, directory: &Path) -> Process {
    server.kill();
    Process::start(directory)
}

#[test]
fn worlds_and_their_counters_survive_a_kill() {
    let directory = tempfile::tempdir().unwrap();
    let server = Process::start(directory.path());
    let mut scene = server.get("/v1/tasks/bowling/003")["scene"].clone();
    scene["name"] = "mine".into();
    let real =
        json!({"scene": scene, "kind": "real", "budget": 9, "noise": 0.01, "seed": 18446744073709551615u64});
    let real = id(&server.post("/v1/worlds", &real, 201));
    let sim = json!({"task": "bowling:003", "latents": {"friction": 0.25}, "damping": 0.7});
    let sim = id(&server.post("/v1/worlds", &sim, 201));
    let gone = id(&server.post("/v1/worlds", &json!({"task": "bowling"}), 201));
    assert_eq!(
        server.client.delete(format!("{}/v1/worlds/{gone}", server.url)).send().unwrap().status(),
        204
    );
    let action = server.get("/v1/tasks/bowling/003")["certificate"]["action"].clone();
    let roll = |server: &Process, world: &str, n: usize| {
        let body = json!({"actions": vec![&action; n], "task": null, "trajectories": true});
        server.post(&format!("/v1/worlds/{world}/rollout"), &body, 200)
    };
    let first = roll(&server, &real, 5);
    server.post("/v1/worlds/bowling-real/rollout", &json!({"task": "bowling:003", "actions": [action]}), 200);
    let told = server.get(&format!("/v1/worlds/{real}"));
    let server = restart(server, directory.path());
    assert_eq!(server.get(&format!("/v1/worlds/{real}")), told, "at once, though killed at once");
    assert_eq!(told["remaining"], 4);
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], 1);
    assert_eq!(server.client.get(format!("{}/v1/worlds/{gone}", server.url)).send().unwrap().status(), 404);
    // Noise continues: same action and physics, different noise.
    let second = roll(&server, &real, 4);
    assert_ne!(second["results"][0]["bodies"], first["results"][0]["bodies"]);
    let over =
        server.request(&format!("/v1/worlds/{real}/rollout"), json!({"actions": [action]}).to_string());
    assert_eq!(problem(over).0, 429);
    let before = server.get(&format!("/v1/worlds/{sim}"));
    assert_eq!(
        (&before["latents"]["friction"], &before["effects"][0]["name"]),
        (&json!(0.25), &json!("linear_drag"))
    );
    // A simulated world's counter and latents are written with a delay, but always before a regular shutdown.
    roll(&server, &sim, 3);
    server.post(&format!("/v1/worlds/{sim}/set_latents"), &json!({"restitution": 0.125}), 200);
    let before = server.get(&format!("/v1/worlds/{sim}"));
    let second = Process::start_refused(directory.path());
    assert!(second.contains("in use by another server"), "{second}");
    let server = server.stopped(directory.path());
    assert_eq!(server.get(&format!("/v1/worlds/{sim}")), before);
}

impl Process {
    /// The error of a second server on the same directory.
    fn start_refused(directory: &Path) -> String {
        let run = Command::new(env!("CARGO_BIN_EXE_iplw"))
            .args(["serve", "--http", "127.0.0.1:0", "--data-dir"])
            .arg(directory)
            .output()
            .unwrap();
        assert!(!run.status.success());
        String::from_utf8(run.stderr).unwrap()
    }

    /// Stops this server regularly and starts the next.
    fn stopped(mut self, directory: &Path) -> Process {
        let told = Command::new("kill").arg("-TERM").arg(self.child.id().to_string()).status().unwrap();
        assert!(told.success() && self.child.wait().unwrap().success());
        Process::start(directory)
    }
}

/// Measures proposals in another world, as a robot with a different sampling clock.
fn robot(server: &Process, world: &str, proposals: &Value) -> Vec<Value> {
    proposals["proposals"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| {
            let body = json!({"task": p["task"], "actions": [p["action"]], "trajectories": true});
            let rolled = server.post(&format!("/v1/worlds/{world}/rollout"), &body, 200);
            let result = &rolled["results"][0];
            let mut bodies = result["bodies"].clone();
            for track in bodies.as_object_mut().unwrap().values_mut() {
                track.as_object_mut().unwrap().remove("angle");
            }
            json!({"proposal": p["number"], "t": result["t"], "bodies": bodies})
        })
        .collect()
}

#[test]
fn ask_tell_equals_direct_measurement_and_survives_kills() {
    let directory = tempfile::tempdir().unwrap();
    let server = Process::start(directory.path());
    let body = json!({"task": "basketball", "rounds": 3, "actions": 4, "samples": 24, "seed": 4});
    let here = server.reach(&id(&server.post("/v1/iplw", &body, 202)), "succeeded");
    let mut asked = body.clone();
    asked["real"] = "ask_tell".into();
    let job = id(&server.post("/v1/iplw", &asked, 202));
    let path = format!("/v1/iplw/{job}");
    server.reach(&job, "waiting");
    let first = server.get(&format!("{path}/proposals"));
    let proposals = first["proposals"].as_array().unwrap();
    assert_eq!((proposals.len(), &first["round"], &first["state"]), (4, &json!(0), &json!("waiting")));
    let p = &proposals[1];
    assert_eq!(
        (&p["number"], &p["answered"], &p["scene"]["format"]),
        (&json!(1), &json!(false), &json!("iplw.scene/1"))
    );
    assert_eq!((p["observe_at"].as_array().unwrap().len(), &p["observe_at"][0]), (11, &json!(0.0)));
    assert!(
        p["scene"]["bodies"].as_array().unwrap().iter().all(|b| b["position"].is_array()),
        "all is placed"
    );
    // Submit half of the trials, then kill: trials and proposals survive.
    let answers = robot(&server, "basketball-real", &first);
    let told = server.post(&format!("{path}/trials"), &json!({"trials": answers[..2]}), 200);
    assert_eq!(told, json!({"round": 0, "answered": 2, "failed": 0, "open": 2, "state": "waiting"}));
    assert_eq!(server.get(&format!("/v1/jobs/{job}"))["progress"]["done"], 2);
    let open = server.get(&format!("{path}/rounds"));
    let round = &open["rounds"][0];
    assert_eq!(
        (&open["interactions"], &round["fitted"], &round["latents"]),
        (&json!(2), &json!(false), &json!([]))
    );
    assert_eq!(
        (&round["proposals"][1]["measured"], &round["proposals"][2]["measured"]),
        (&json!(true), &Value::Null)
    );
    let server = restart(server, directory.path());
    let after = server.get(&format!("{path}/proposals"));
    for (i, p) in after["proposals"].as_array().unwrap().iter().enumerate() {
        assert_eq!(p["answered"], i < 2);
        assert_eq!((&p["action"], &p["scene"]), (&proposals[i]["action"], &proposals[i]["scene"]));
    }
    // Submit the rest out of order with one repeated; the round is fitted.
    let rest = json!({"trials": [answers[3], answers[0], answers[2]], "round": 0});
    let told = server.post(&format!("{path}/trials"), &rest, 200);
    assert_eq!(told, json!({"round": 0, "answered": 4, "failed": 0, "open": 0, "state": "queued"}));
    let server = restart(server, directory.path());
    loop {
        let next = server.get(&format!("{path}/proposals"));
        if next["state"] == "succeeded" {
            break;
        }
        if next["state"] == "waiting" {
            // As CSV.
            let answers = robot(&server, "basketball-real", &next);
            let mut csv = String::from("trial,t,body,x,y\n");
            for a in &answers {
                for (i, t) in a["t"].as_array().unwrap().iter().enumerate() {
                    for (name, track) in a["bodies"].as_object().unwrap() {
                        csv += &format!("{},{t},{name},{},{}\n", a["proposal"], track["x"][i], track["y"][i]);
                    }
                }
            }
            let sent =
                server.request(&format!("{path}/trials"), csv.clone()).header("content-type", "text/csv");
            assert_eq!(ok(sent, 200)["state"], "queued");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let there = server.reach(&job, "succeeded");
    check_rounds(&server, &job, &there["result"]);
    let (mut here, mut there) = (without_durations(&here), without_durations(&there));
    // The same positions give the same report. The check of the fit also uses angles and velocities, which the robot does not observe.
    for report in [&mut here, &mut there] {
        assert!(report["fit"]["text"].is_string());
        (report["config"], report["fit"]) = (Value::Null, Value::Null);
    }
    assert_eq!(there, here);
    // Repeating old trials changes nothing; different ones are rejected.
    server.post(&format!("{path}/trials"), &json!({"trials": [answers[0]], "round": 0, "close": true}), 200);
    let mut other = answers[0].clone();
    other["bodies"]["ball"]["x"][0] = json!(7.5);
    let refused = server.request(&format!("{path}/trials"), json!({"trials": [other]}).to_string());
    assert_eq!(problem(refused).0, 409);
    // Trials can be downloaded as JSON pages and as files.
    let mut seen = Vec::new();
    let mut next = String::new();
    loop {
        let page = server.get(&format!("/v1/jobs/{job}/trials?limit=5{next}"));
        let trials = page["trials"].as_array().unwrap().clone();
        for t in &trials {
            assert!(page["scene"]["settings"].get(t["trial"].as_str().unwrap()).is_some());
        }
        seen.extend(trials);
        match page["next"].as_str() {
            Some(cursor) => next = format!("&cursor={cursor}"),
            None => break,
        }
    }
    assert_eq!(
        seen.iter().map(|t| t["proposal"].as_u64().unwrap()).collect::<Vec<_>>(),
        (0..12).collect::<Vec<_>>()
    );
    assert_eq!(seen[2]["bodies"]["ball"]["x"], answers[2]["bodies"]["ball"]["x"]);
    assert!(seen[2]["bodies"]["ball"]["vx"][0].is_null());
    let file = |format: &str| {
        let request = server.client.get(format!("{}/v1/jobs/{job}/trials?format={format}", server.url));
        request.send().unwrap().text().unwrap()
    };
    let scene = iplw::task::Scene::from_json(&file("scene")).unwrap();
    let trials = iplw::reality::trials_from_csv(&file("csv"), &scene).unwrap();
    assert_eq!(trials.len(), 12);
    assert_eq!(trials[7].observed.times.len(), seen[7]["t"].as_array().unwrap().len());
    assert_eq!(problem(server.client.get(format!("{}/v1/jobs/{job}/trials?format=xml", server.url))).0, 422);
}

/// Checks that each round has proposals, reasons and estimates, and that the last equals the report.
fn check_rounds(server: &Process, job: &str, report: &Value) {
    let path = format!("/v1/iplw/{job}/rounds");
    let whole = server.get(&path);
    assert_eq!(
        (&whole["state"], &whole["interactions"]),
        (&json!("succeeded"), &report["real_interactions"])
    );
    let rounds = whole["rounds"].as_array().unwrap();
    assert_eq!(rounds.len(), report["residuals"].as_array().unwrap().len());
    for (i, round) in rounds.iter().enumerate() {
        assert_eq!((&round["number"], &round["fitted"]), (&json!(i), &json!(true)));
        assert_eq!(
            (&round["residual"], &round["interactions"]),
            (&report["residuals"][i], &json!(4 * (i + 1)))
        );
        assert_eq!(round["choice"]["collisions"], report["choices"][i]["collisions"]);
        assert!(round["proposals"].as_array().unwrap().iter().all(|p| p["measured"] == true));
        let names: Vec<&Value> =
            round["latents"].as_array().unwrap().iter().map(|latent| &latent["name"]).collect();
        assert_eq!(names, ["density", "friction", "restitution"]);
    }
    assert_eq!(rounds[rounds.len() - 1]["latents"], report["latents"]);
    let first = server.get(&format!("{path}?limit=1"));
    let rest = server.get(&format!("{path}?cursor={}", first["next"].as_str().unwrap()));
    assert_eq!((&first["rounds"][0], &rest["rounds"][0]), (&rounds[0], &rounds[1]));
    assert!(rest["next"].is_null());
}

#[test]
fn rejects_malformed_trials_without_storing_anything() {
    let directory = tempfile::tempdir().unwrap();
    let server = Process::start(directory.path());
    let body = json!({"task": "basketball", "real": "ask_tell", "rounds": 2, "actions": 3, "samples": 24});
    let job = id(&server.post("/v1/iplw", &body, 202));
    server.reach(&job, "waiting");
    let path = format!("/v1/iplw/{job}/trials");
    let good = json!({"proposal": 0, "t": [0.0, 0.5, 1.0], "bodies": {"ball": {"x": [1, 2, null], "y": [3, 2, null]}}});
    let with = |pointer: &str, value: Value| {
        let mut trial = good.clone();
        *trial.pointer_mut(pointer).unwrap() = value;
        json!({"trials": [{"proposal": 1, "t": [0.0], "bodies": {"ball": {"x": [1], "y": [1]}}}, trial]})
    };
    let extra = |key: &str, value: Value| {
        let mut trial = good.clone();
        trial["bodies"]["ball"][key] = value;
        json!({"trials": [trial]})
    };
    let bodies = |value: Value| with("/bodies", value);
    let rows = [
        (json!({"trials": 1}), 400, "trials"),
        (json!({"trial": []}), 400, "trial"),
        (json!([]), 400, ""),
        (json!({"trials": [1]}), 400, "trials[0]"),
        (json!({"trials": [{"proposal": 0, "t": [0]}]}), 400, "trials[0]"),
        (json!({"failed": [-1]}), 400, "failed[0]"),
        (json!({"failed": "0"}), 400, "failed"),
        (json!({"close": 1}), 400, "close"),
        (json!({"round": -1}), 400, "round"),
        (with("/proposal", json!("0")), 400, "trials[1].proposal"),
        (with("/proposal", json!(3)), 422, "trials[1].proposal"),
        (with("/proposal", json!(u64::MAX)), 422, "trials[1].proposal"),
        (with("/proposal", json!(1)), 422, "trials[1].proposal"),
        (with("/t", json!([])), 422, "trials[1].bodies.ball.x"),
        (with("/t", json!([0.0, 0.5])), 422, "trials[1].bodies.ball.x"),
        (with("/t", json!([0.0, 0.5, 0.5])), 422, "trials[1].t[2]"),
        (with("/t", json!([0.0, 1.0, 0.5])), 422, "trials[1].t[2]"),
        (with("/t", json!([-0.1, 0.5, 1.0])), 422, "trials[1].t[0]"),
        (with("/t", json!([0.2, 0.5, 1.0])), 422, "trials[1].t"),
        (with("/t", json!([0.0, 0.5, 1e7])), 422, "trials[1].t[2]"),
        (with("/t", json!([0.0, null, 1.0])), 400, "trials[1].t[1]"),
        (with("/t/1", json!("x")), 400, "trials[1].t[1]"),
        (with("/bodies/ball/x", json!([1, 2])), 422, "trials[1].bodies.ball.x"),
        (with("/bodies/ball/x/1", json!(1e9)), 422, "trials[1].bodies.ball.x[1]"),
        (with("/bodies/ball/x/1", json!("2")), 400, "trials[1].bodies.ball.x[1]"),
        (with("/bodies/ball/x", json!([null, null, null])), 422, "trials[1]"),
        (bodies(json!({})), 422, "trials[1]"),
        (bodies(json!({"bal": {"x": [1, 2, 3], "y": [1, 2, 3]}})), 422, "trials[1].bodies.bal"),
        (bodies(json!({"floor": {"x": [1, 2, 3], "y": [1, 2, 3]}})), 422, "trials[1].bodies.floor"),
        (bodies(json!([])), 400, "trials[1].bodies"),
        (bodies(json!({"ball": [1]})), 400, "trials[1].bodies.ball"),
        (extra("vx", json!([1])), 422, "trials[0].bodies.ball.vx"),
        (extra("z", json!([1, 2, 3])), 400, "trials[0].bodies.ball.z"),
        (json!({"trials": [good], "failed": [0]}), 422, "failed[0]"),
        (json!({"failed": [1, 1]}), 422, "failed[1]"),
        (json!({"failed": [7]}), 422, "failed[0]"),
        (json!({"failed": [1], "round": 1}), 422, "round"),
    ];
    for (body, status, field) in rows {
        let (got, named, told) = problem(server.request(&path, body.to_string()));
        assert_eq!((got, named.as_str()), (status, field), "{body}: {told}");
    }
    let head = "trial,t,body,x,y\n";
    let files = [
        (String::new(), "empty", ""),
        (head.into(), "no observation", ""),
        (format!("{head}0,0,ball,1\n"), "body:2", ""),
        (format!("{head}0,0,ball,1,x\n"), "`y`", "y"),
        (format!("{head}0,0,bal,1,1\n"), "\"ball\"", "body"),
        (format!("{head}0,0,ball,1,1\nx,0,ball,1,1\n"), "number of a proposal", "trial"),
        (format!("{head}9,0,ball,1,1\n"), "0 to 2", "trial"),
        (format!("{head}0,1,ball,1,1\n"), "since the start", "trial 0: t"),
        (format!("{head}0,-1,ball,1,1\n"), "since the start", "trial 0: t"),
        (format!("{head}0,0,ball,,\n"), "without any position", "trial 0"),
    ];
    for (csv, words, field) in files {
        let sent = server.request(&path, csv.clone()).header("content-type", "text/csv; charset=utf-8");
        let (status, named, told) = problem(sent);
        assert_eq!((status, named.as_str()), (422, field), "{csv}: {told}");
        assert!(told["detail"].as_str().unwrap().contains(words), "{csv}: {told}");
    }
    for (query, field) in
        [("?close=1", "close"), ("?failed=x", "failed"), ("?round=", "round"), ("?rounds=1", "rounds")]
    {
        let csv = format!("{head}0,0,ball,1,1\n");
        let sent = server.request(&format!("{path}{query}"), csv).header("content-type", "text/csv");
        assert_eq!(problem(sent).1, field);
    }
    assert_eq!(problem(server.request(&format!("{path}?close=true"), "{}")).1, "close");
    let proposals = || server.get(&format!("/v1/iplw/{job}/proposals"));
    assert!(
        proposals()["proposals"].as_array().unwrap().iter().all(|p| p["answered"] == false),
        "nothing was kept"
    );
    // Submit, repeat, submit differently, replace.
    server.post(&path, &json!({"trials": [good]}), 200);
    server.post(&path, &json!({"trials": [good]}), 200);
    let mut other = good.clone();
    other["bodies"]["ball"]["x"][1] = json!(2.5);
    assert_eq!(problem(server.request(&path, json!({"trials": [other], "failed": [1]}).to_string())).0, 409);
    assert_eq!(proposals()["proposals"][1]["answered"], false, "all of a request or nothing");
    assert_eq!(problem(server.request(&path, json!({"failed": [0]}).to_string())).0, 409);
    server.post(&path, &json!({"trials": [other], "replace": true}), 200);
    // Closed with one trial: fitted on it.
    let told = server.post(&path, &json!({"round": 0, "close": true}), 200);
    assert_eq!(told, json!({"round": 0, "answered": 1, "failed": 2, "open": 0, "state": "queued"}));
    server.reach(&job, "waiting");
    assert_eq!(proposals()["round"], 1);
    // A repeated close of the previous round has no effect, and a late trial is rejected.
    let told = server.post(&path, &json!({"trials": [other], "round": 0, "close": true}), 200);
    assert_eq!((&told["round"], &told["open"]), (&json!(1), &json!(3)));
    let late = json!({"trials": [{"proposal": 1, "t": [0.0], "bodies": {"ball": {"x": [1], "y": [1]}}}]});
    assert_eq!(problem(server.request(&path, late.to_string())).0, 409);
    server.post(&path, &json!({"failed": [3, 4, 5]}), 200);
    let done = server.reach(&job, "succeeded");
    assert_eq!(
        (&done["result"]["real_interactions"], &done["result"]["stopped"]),
        (&json!(1), &json!("rounds"))
    );
    assert_eq!(problem(server.request(&path, json!({"close": true}).to_string())).0, 409);
    // Jobs without ask-tell, and one without trials.
    let plain = id(&server.post(
        "/v1/iplw",
        &json!({"task": "basketball", "rounds": 1, "actions": 2, "samples": 8}),
        202,
    ));
    assert_eq!(problem(server.request(&format!("/v1/iplw/{plain}/trials"), "{}")).0, 409);
    assert_eq!(problem(server.client.get(format!("{}/v1/iplw/{plain}/proposals", server.url))).0, 409);
    let mute = json!({"task": "basketball", "real": "ask_tell", "rounds": 1, "actions": 2, "samples": 8});
    let mute = id(&server.post("/v1/iplw", &mute, 202));
    server.reach(&mute, "waiting");
    server.post(&format!("/v1/iplw/{mute}/trials"), &json!({"failed": [0, 1]}), 200);
    let failed = server.reach(&mute, "failed");
    assert!(failed["error"]["detail"].as_str().unwrap().contains("nothing was measured"), "{failed}");
    let metrics = server.client.get(format!("{}/metrics", server.url)).send().unwrap().text().unwrap();
    assert!(metrics.contains("iplw_errors_total{class=\"5xx\"} 0"), "{metrics}");
}

#[test]
fn pagination_is_stable_under_changes() {
    let directory = tempfile::tempdir().unwrap();
    let server = Process::start(directory.path());
    let make = || id(&server.post("/v1/worlds", &json!({"task": "bowling:000"}), 201));
    let mut all: Vec<String> = (0..8).map(|_| make()).collect();
    let gone = all.remove(1);
    let (mut seen, mut cursor) = (Vec::<String>::new(), String::new());
    for page in 0.. {
        let list = server.get(&format!("/v1/worlds?limit=3{cursor}"));
        let ids = list["worlds"].as_array().unwrap().iter().map(id).collect::<Vec<_>>();
        assert!(!ids.is_empty() && ids.len() <= 3);
        seen.extend(ids);
        let Some(next) = list["next"].as_str() else { break };
        cursor = format!("&cursor={next}");
        if page == 0 {
            // Delete one ahead, delete the last one listed, and create a new one.
            for id in [&gone, seen.last().unwrap()] {
                server.client.delete(format!("{}/v1/worlds/{id}", server.url)).send().unwrap();
            }
            all.push(make());
        }
    }
    let ready = |f: &&iplw::task::Family| ["sim", "real"].map(|kind| format!("{}-{kind}", f.name));
    let mut wanted: Vec<String> = iplw::task::families().iter().flat_map(ready).collect();
    wanted.extend(all);
    wanted.sort();
    assert_eq!(seen, wanted, "each once, in order");
    // The same holds for the other lists.
    let ids: Vec<Value> = (0..3).map(|_| json!({"task": "basketball", "real": "ask_tell"})).collect();
    ids.iter().for_each(|body| drop(server.post("/v1/iplw", body, 202)));
    let first = server.get("/v1/jobs?limit=2");
    assert_eq!(first["jobs"].as_array().unwrap().iter().map(id).collect::<Vec<_>>(), ["job-1", "job-2"]);
    let next = first["next"].as_str().unwrap();
    let last = server.get(&format!("/v1/jobs?limit=2&cursor={next}"));
    assert_eq!((&last["jobs"][0]["id"], &last["next"]), (&json!("job-3"), &Value::Null));
    let tasks = server.get("/v1/tasks/bowling?limit=40");
    let next = tasks["next"].as_str().unwrap();
    assert_eq!(
        server.get(&format!("/v1/tasks/bowling?limit=1&cursor={next}"))["tasks"][0]["id"],
        "bowling:040"
    );
    assert_eq!(server.get("/v1/tasks/bowling")["next"], Value::Null);
}

#[test]
fn repeated_idempotency_keys_act_once() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Process::start(directory.path());
    let world = json!({"task": "basketball", "kind": "real", "seed": 1});
    let job = json!({"task": "basketball", "real": "ask_tell", "rounds": 1, "actions": 2, "samples": 8});
    let train = json!({"task": "basketball:000", "batches": 1});
    let send = |server: &Process, path: &str, key: &str, body: &Value| {
        server.request(path, body.to_string()).header("Idempotency-Key", key).send().unwrap()
    };
    let whole = |r: Response| {
        let place = r.headers().get("location").map(|v| v.to_str().unwrap().to_string());
        (r.status().as_u16(), place, r.headers().contains_key("idempotent-replayed"), r.text().unwrap())
    };
    let made: Vec<_> = [("/v1/worlds", "a", &world), ("/v1/iplw", "b", &job), ("/v1/policies", "c", &train)]
        .into_iter()
        .map(|(path, key, body)| (path, key, body, whole(send(&server, path, key, body))))
        .collect();
    for restarted in [false, true] {
        if restarted {
            server = restart(server, directory.path());
        }
        for (path, key, body, (status, place, replayed, text)) in &made {
            assert!(!replayed);
            let wanted = (*status, place.clone(), true, text.clone());
            assert_eq!(whole(send(&server, path, key, body)), wanted);
            let mut other = (*body).clone();
            other["seed"] = json!(99);
            let (status, field, _) =
                problem(server.request(path, other.to_string()).header("Idempotency-Key", *key));
            assert_eq!((status, field.as_str()), (422, "Idempotency-Key"));
        }
        let elsewhere = server.request("/v1/iplw", world.to_string()).header("Idempotency-Key", "a");
        assert_ne!(elsewhere.send().unwrap().status().as_u16() / 100, 2);
    }
    assert_eq!(server.get("/v1/worlds")["worlds"].as_array().unwrap().len(), 5);
    assert_eq!(server.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 2);
    // A rejected request can be corrected under the same key.
    assert_eq!(send(&server, "/v1/worlds", "d", &json!({"task": "curling"})).status(), 404);
    assert_eq!(send(&server, "/v1/worlds", "d", &json!({"task": "bowling"})).status(), 201);
    for key in ["", "two words", &"x".repeat(256)] {
        let (status, field, _) =
            problem(server.request("/v1/worlds", world.to_string()).header("Idempotency-Key", key));
        assert_eq!((status, field.as_str()), (422, "Idempotency-Key"));
    }
    // Repeat the last submission of a round after it is fitted.
    let id = serde_json::from_str::<Value>(&made[1].3.3).unwrap()["id"].as_str().unwrap().to_string();
    server.reach(&id, "waiting");
    let path = format!("/v1/iplw/{id}/trials");
    let body = json!({"trials": [{"proposal": 0, "t": [0.0, 1.0], "bodies": {"ball": {"x": [1, 1], "y": [1, 0]}}}], "close": true});
    let first = whole(send(&server, &path, "e", &body));
    server.reach(&id, "succeeded");
    let second = whole(send(&server, &path, "e", &body));
    assert_eq!((first.0, &first.3, second.2), (200, &second.3, true));
}
