//! One script over every transport gives bit-identical responses; batches equal single steps; no input crashes the
//! server.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use iplw::budget::Unlimited;
use iplw::serve::{ServeConfig, Server};
use iplw::session::{
    Action, Autoreset, Catalogue, Reset, RolloutRequest, TaskSet, World, WorldConfig, WorldKind, reset_many,
    step_many,
};
use iplw::world::Latents;
use rmpv::Value as Packed;
use serde_json::{Value, json};
use zeromq::{DealerSocket, Socket, SocketRecv, SocketSend, ZmqMessage};

/// Batches compared with single steps, without a server.
mod batches {
    use super::*;

    fn worlds(kind: WorldKind, n: u64, noise: f64) -> Vec<Arc<World>> {
        let catalogue = Catalogue::new();
        (0..n)
            .map(|seed| {
                let config = WorldConfig { noise, seed, ..config(&catalogue, "bowling", kind) };
                Arc::new(World::new(config).unwrap())
            })
            .collect()
    }

    #[test]
    fn large_batches_equal_single_steps_to_the_bit() {
        for (kind, n, noise) in [(WorldKind::Sim, 70, 0.0), (WorldKind::Real, 20, 0.01)] {
            let (batch, single) = (worlds(kind, n, noise), worlds(kind, n, noise));
            let actions: Vec<Action> = (0..n).map(|i| Action::Index(i * 37)).collect();
            for round in 0..2 {
                let starts = reset_many(&batch, &vec![Some(Reset::default()); n as usize]).unwrap();
                for (world, start) in single.iter().zip(&starts) {
                    assert_eq!(world.reset(&Reset::default()).unwrap(), *start.as_ref().unwrap());
                }
                let turned = step_many(&batch, &actions, Autoreset::Disabled, None, &Unlimited).unwrap();
                let valid = turned.iter().filter(|t| t.step.as_ref().unwrap().invalid.is_none()).count();
                assert!(valid > n as usize / 3, "{valid} of {n} show too little");
                for ((world, action), one) in single.iter().zip(&actions).zip(turned) {
                    assert_eq!(
                        world.step(action, None, &Unlimited).unwrap(),
                        one.step.unwrap(),
                        "round {round}"
                    );
                    assert_eq!(one.start, None);
                }
            }
        }
    }

    #[test]
    fn autoreset_follows_its_mode() {
        let (next, same, single) =
            (worlds(WorldKind::Sim, 8, 0.0), worlds(WorldKind::Sim, 8, 0.0), worlds(WorldKind::Sim, 8, 0.0));
        let first = vec![Some(Reset::default()); 8];
        for worlds in [&next, &same, &single] {
            reset_many(worlds, &first).unwrap();
        }
        let actions: Vec<Action> = (0..8).map(|i| Action::Index(100 + i)).collect();
        let steps: Vec<_> =
            single.iter().zip(&actions).map(|(w, a)| w.step(a, None, &Unlimited).unwrap()).collect();
        let again: Vec<_> = single
            .iter()
            .zip(&steps)
            .map(|(w, s)| s.terminated.then(|| w.reset(&Reset::default()).unwrap()))
            .collect();
        assert!(again.iter().flatten().count() > 1);
        let turned = step_many(&same, &actions, Autoreset::SameStep, None, &Unlimited).unwrap();
        for ((one, step), start) in turned.iter().zip(&steps).zip(&again) {
            assert_eq!((one.step.as_ref(), &one.start), (Some(step), start));
        }
        let turned = step_many(&next, &actions, Autoreset::NextStep, None, &Unlimited).unwrap();
        assert!(
            turned
                .iter()
                .zip(&steps)
                .all(|(one, step)| one.step.as_ref() == Some(step) && one.start.is_none())
        );
        // An invalid action is ignored if the world is reset in this step.
        let any: Vec<Action> = again
            .iter()
            .map(|a| if a.is_some() { Action::Index(u64::MAX) } else { Action::Index(5) })
            .collect();
        let turned = step_many(&next, &any, Autoreset::NextStep, None, &Unlimited).unwrap();
        for (one, start) in turned.iter().zip(&again) {
            assert_eq!((&one.start, one.step.is_none()), (start, start.is_some()));
        }
        let ended = turned.iter().position(|t| t.step.as_ref().is_some_and(|s| s.terminated));
        if let Some(i) = ended {
            let refused =
                step_many(&next, &actions, Autoreset::Disabled, None, &Unlimited).unwrap_err().to_string();
            assert!(refused.contains(&format!("worlds[{i}]")), "{refused}");
        }
    }

    #[test]
    fn batches_are_all_or_nothing() {
        let catalogue = Catalogue::new();
        let mut all = worlds(WorldKind::Sim, 3, 0.0);
        let poor = WorldConfig { budget: Some(1), ..config(&catalogue, "bowling", WorldKind::Real) };
        all.push(Arc::new(World::new(poor).unwrap()));
        reset_many(&all, &vec![Some(Reset::default()); 4]).unwrap();
        let good = placeable(&all[3]);
        all[3].step(&good, None, &Unlimited).unwrap();
        reset_many(&all, &vec![Some(Reset::default()); 4]).unwrap();
        let actions: Vec<Action> = all.iter().map(placeable).collect();
        let before: Vec<u64> = all.iter().map(|w| w.interactions()).collect();
        let refused = |actions: &[Action], worlds: &[Arc<World>]| {
            step_many(worlds, actions, Autoreset::Disabled, None, &Unlimited).unwrap_err().to_string()
        };
        let spent = refused(&actions, &all);
        assert!(spent.contains("worlds[3]") && spent.contains("budget"), "{spent}");
        let bad = [actions[0].clone(), Action::Vector(vec![0.5, 2.0, 0.5]), actions[2].clone()];
        assert!(refused(&bad, &all[..3]).contains("actions[1][1]"));
        let twice = [all[0].clone(), all[1].clone(), all[0].clone()];
        let said = refused(&actions[..3], &twice);
        assert!(said.contains("worlds[2]") && said.contains("worlds[0]"), "{said}");
        assert!(refused(&actions[..2], &all[..3]).contains("one for each world"));
        let mixed =
            [all[0].clone(), Arc::new(World::new(config(&catalogue, "basketball", WorldKind::Sim)).unwrap())];
        assert!(refused(&actions[..2], &mixed).contains("worlds[1]"));
        let unknown =
            vec![None, Some(Reset { task: Some("bowling:999".into()), ..Reset::default() }), None, None];
        assert!(reset_many(&all, &unknown).unwrap_err().to_string().contains("tasks[1]"));
        assert_eq!(all.iter().map(|w| w.interactions()).collect::<Vec<_>>(), before);
        // Every world still waits for its action.
        assert!(step_many(&all[..3], &actions[..3], Autoreset::Disabled, None, &Unlimited).is_ok());
    }

    /// An action that can be placed in the world's current task.
    fn placeable(world: &Arc<World>) -> Action {
        let places = |i: &u64| world.scene(None, Some(&Action::Index(*i))).is_ok();
        Action::Index((0..1000).find(places).unwrap())
    }
}

/// A world's configuration with the family's defaults.
fn config(catalogue: &Catalogue, family: &str, kind: WorldKind) -> WorldConfig {
    WorldConfig::new(catalogue.family(family).unwrap(), kind)
}

/// An in-process server, stopped on drop.
struct Running {
    http: String,
    zmq: String,
    client: reqwest::blocking::Client,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn start() -> Running {
        Running::at("tcp://127.0.0.1:*")
    }

    fn at(zmq: &str) -> Running {
        let config = ServeConfig {
            http: "127.0.0.1:0".parse().unwrap(),
            zmq: Some(zmq.into()),
            ..ServeConfig::default()
        };
        let (told, address) = std::sync::mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let thread = std::thread::spawn(move || {
            tokio::runtime::Runtime::new().unwrap().block_on(async {
                let server = Server::bind(config).await.unwrap();
                told.send((server.address(), server.zmq_address().unwrap().to_string())).unwrap();
                server.run(async move { drop(stopped.await) }).await.unwrap();
            });
        });
        let (http, zmq) = address.recv().unwrap();
        let client = reqwest::blocking::Client::builder().timeout(Duration::from_secs(120)).build().unwrap();
        Running { http: format!("http://{http}"), zmq, client, stop: Some(stop), thread: Some(thread) }
    }

    fn stop(&mut self) -> Duration {
        let start = Instant::now();
        drop(self.stop.take());
        self.client = reqwest::blocking::Client::new();
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the server panicked");
        }
        start.elapsed()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop();
    }
}

/// A client: operation and arguments in, HTTP status and body (or problem) out.
trait Ask {
    fn ask(&mut self, op: &str, args: Value) -> (u16, Value);

    fn get(&mut self, op: &str, args: Value) -> Value {
        let (status, answer) = self.ask(op, args);
        assert!(status < 300, "{op}: {answer}");
        answer
    }
}

/// HTTP with JSON or msgpack, with or without binary arrays.
struct Http<'a> {
    server: &'a Running,
    /// The Accept header, unless JSON.
    msgpack: Option<&'static str>,
}

impl Ask for Http<'_> {
    fn ask(&mut self, op: &str, mut args: Value) -> (u16, Value) {
        let id = args.as_object_mut().unwrap().remove("id");
        let id = id.as_ref().and_then(Value::as_str).unwrap_or_default().to_string();
        let (method, path) = match op {
            "create_world" => ("POST", "/v1/worlds".into()),
            "get_world" => ("GET", format!("/v1/worlds/{id}")),
            "reset_world" => ("POST", format!("/v1/worlds/{id}/reset")),
            "step_world" => ("POST", format!("/v1/worlds/{id}/step")),
            "set_latents" => ("POST", format!("/v1/worlds/{id}/set_latents")),
            "rollout_world" => ("POST", format!("/v1/worlds/{id}/rollout")),
            "create_worlds" => ("POST", "/v1/batch/worlds".into()),
            "delete_worlds" => ("DELETE", "/v1/batch/worlds".into()),
            "reset_worlds" => ("POST", "/v1/batch/reset".into()),
            "step_worlds" => ("POST", "/v1/batch/step".into()),
            other => panic!("{other}"),
        };
        let url = format!("{}{path}", self.server.http);
        let mut request = self.server.client.request(method.parse().unwrap(), url);
        if method != "GET" {
            request = match self.msgpack {
                None => request.body(args.to_string()),
                Some(_) => request.header("content-type", "application/msgpack").body(packed(&args)),
            };
        }
        if let Some(accept) = self.msgpack {
            request = request.header("accept", accept);
        }
        let response = request.send().unwrap();
        let (status, kind) = (response.status().as_u16(), response.headers().get("content-type").cloned());
        let body = response.bytes().unwrap();
        let kind = kind.map(|k| k.to_str().unwrap().to_string()).unwrap_or_default();
        let sort = if status < 300 { "" } else { "problem+" };
        match (self.msgpack, body.is_empty()) {
            (_, true) => (status, Value::Null),
            (None, _) => {
                assert_eq!(kind, format!("application/{sort}json"));
                (status, serde_json::from_slice(&body).unwrap())
            }
            (Some(_), _) => {
                assert_eq!(kind, format!("application/{sort}msgpack"));
                (status, unpacked(rmpv::decode::read_value(&mut &body[..]).unwrap()))
            }
        }
    }
}

/// A ZeroMQ DEALER of the `zeromq` crate.
struct Zmq {
    runtime: tokio::runtime::Runtime,
    socket: DealerSocket,
    next: u64,
    raw: bool,
}

impl Zmq {
    fn connect(address: &str, raw: bool) -> Zmq {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let mut socket = DealerSocket::new();
        runtime.block_on(socket.connect(address)).unwrap();
        Zmq { runtime, socket, next: 0, raw }
    }

    fn send(&mut self, frames: Vec<Vec<u8>>) {
        let mut frames = frames.into_iter();
        let mut message = ZmqMessage::from(frames.next().unwrap());
        frames.for_each(|frame| message.push_back(frame.into()));
        self.runtime.block_on(self.socket.send(message)).unwrap();
    }

    fn receive(&mut self) -> Vec<Vec<u8>> {
        let wait = tokio::time::Duration::from_secs(180);
        let message = self.runtime.block_on(async { tokio::time::timeout(wait, self.socket.recv()).await });
        message.expect("an answer").unwrap().into_vec().into_iter().map(|f| f.to_vec()).collect()
    }

    /// Sends a request under the next id.
    fn request(&mut self, op: &str, args: Value) -> u64 {
        self.next += 1;
        self.send(vec![packed(&json!({"v": 1, "id": self.next, "op": op, "args": args, "raw": self.raw}))]);
        self.next
    }

    /// The next response with its id.
    fn answer(&mut self) -> (Value, u16, Value) {
        // An empty delimiter frame is echoed.
        let mut frames = self.receive().into_iter().skip_while(Vec::is_empty);
        let head = unpacked(rmpv::decode::read_value(&mut &frames.next().unwrap()[..]).unwrap());
        assert_eq!(head["v"], 1);
        if head["ok"] == false {
            return (
                head["id"].clone(),
                head["problem"]["status"].as_u64().unwrap() as u16,
                head["problem"].clone(),
            );
        }
        let mut result = head["result"].clone();
        for (array, bytes) in head["arrays"].as_array().unwrap().iter().zip(frames.by_ref()) {
            let shape: Vec<usize> = serde_json::from_value(array["shape"].clone()).unwrap();
            let value = nested(array["dtype"].as_str().unwrap(), &shape, &bytes);
            assert!(result.get(array["name"].as_str().unwrap()).is_none(), "an array stands once");
            result[array["name"].as_str().unwrap()] = value;
        }
        assert!(frames.next().is_none());
        (head["id"].clone(), 200, result)
    }
}

impl Ask for Zmq {
    fn ask(&mut self, op: &str, args: Value) -> (u16, Value) {
        let id = self.request(op, args);
        let (answered, status, answer) = self.answer();
        assert_eq!(answered, id);
        (status, answer)
    }
}

/// Direct calls of the library.
struct Rust {
    catalogue: Catalogue,
    world: Option<World>,
}

/// The script: a client's session with one simulated and one real world.
fn episode(client: &mut dyn Ask) -> Vec<Value> {
    let mut said = Vec::new();
    for kind in ["sim", "real"] {
        let made = client.get("create_world", json!({"task": "bowling", "kind": kind, "seed": 7}));
        let id = made["id"].clone();
        for seed in [json!(3), json!(null)] {
            said.push(client.get("reset_world", json!({"id": id, "seed": seed})));
            let (mut index, mut ended) = (0, false);
            while !ended {
                let step = client.get("step_world", json!({"id": id, "action": index * 331}));
                ended = step["terminated"] == true;
                (index, said) = (index + 1, [said, vec![step]].concat());
            }
        }
        if kind == "sim" {
            client.get("set_latents", json!({"id": id, "friction": 0.3, "restitution": 0.9}));
        }
        let actions = json!([[0.1, 0.9, 0.2], [0.33, 0.7, 0.5], [0.8, 0.95, 0.01]]);
        let mut rolled =
            client.get("rollout_world", json!({"id": id, "actions": actions, "task": "bowling:004"}));
        rolled.as_object_mut().unwrap().remove("engine");
        said.push(rolled);
    }
    said
}

/// Responses of [`episode`] in wire format.
impl Ask for Rust {
    fn ask(&mut self, op: &str, args: Value) -> (u16, Value) {
        let action = |v: &Value| match v.as_u64() {
            Some(index) => Action::Index(index),
            None => Action::Vector(serde_json::from_value(v.clone()).unwrap()),
        };
        let answer = match op {
            "create_world" => {
                let kind = if args["kind"] == "sim" { WorldKind::Sim } else { WorldKind::Real };
                let config = WorldConfig { seed: 7, ..config(&self.catalogue, "bowling", kind) };
                self.world = Some(World::new(config).unwrap());
                json!({"id": "here"})
            }
            "reset_world" => {
                let reset = Reset { seed: args["seed"].as_u64(), ..Reset::default() };
                let start = self.world.as_ref().unwrap().reset(&reset).unwrap();
                json!({
                    "observation": start.observation,
                    "info": {"task": start.task, "split": start.split.name(), "episode": start.episode},
                })
            }
            "step_world" => {
                let step =
                    self.world.as_ref().unwrap().step(&action(&args["action"]), None, &Unlimited).unwrap();
                let mut info = json!({
                    "valid": step.invalid.is_none(), "solved": step.solved, "steps": step.steps, "task": step.task,
                    "attempt": step.attempt, "interactions": step.interactions, "collisions": step.collisions,
                    "rolling_steps": step.rolling_steps,
                });
                if let Some(reason) = step.invalid {
                    info["reason"] = reason.into();
                }
                if let Some(end) = step.end {
                    info["end"] = format!("{end:?}").to_lowercase().into();
                }
                json!({
                    "observation": step.observation, "reward": step.reward, "terminated": step.terminated,
                    "truncated": false, "info": info,
                })
            }
            "set_latents" => {
                let number = |name: &str| args[name].as_f64();
                let latents = Latents {
                    density: None,
                    friction: number("friction"),
                    restitution: number("restitution"),
                };
                self.world.as_ref().unwrap().set_latents(latents).unwrap();
                Value::Null
            }
            "rollout_world" => {
                let batch = RolloutRequest {
                    actions: args["actions"].as_array().unwrap().iter().map(action).collect(),
                    task: args["task"].as_str().map(String::from),
                    trajectories: false,
                    stop: true,
                    interventions: Vec::new(),
                };
                let rolled = self.world.as_ref().unwrap().rollout(&batch, &Unlimited).unwrap();
                let result = |r: &Result<iplw::trajectory::Trajectory, String>| match r {
                    Ok(t) => json!({
                        "valid": true, "reason": null, "solved": t.outcome.solved, "steps": t.outcome.steps,
                        "contacts": {"collisions": t.collisions, "rolling_steps": t.rolling_steps},
                    }),
                    Err(reason) => json!({
                        "valid": false, "reason": reason, "solved": null, "steps": 0,
                        "contacts": {"collisions": 0, "rolling_steps": 0},
                    }),
                };
                let results: Vec<Value> = rolled.results.iter().map(result).collect();
                json!({"task": rolled.task, "interactions": rolled.interactions, "results": results})
            }
            other => panic!("{other}"),
        };
        (200, answer)
    }
}

#[test]
fn episodes_are_bit_identical_over_all_transports() {
    let server = Running::start();
    let expected = episode(&mut Rust { catalogue: Catalogue::new(), world: None });
    assert!(expected.len() > 8);
    let ways: [(&str, Box<dyn Ask>); 5] = [
        ("json", Box::new(Http { server: &server, msgpack: None })),
        ("msgpack", Box::new(Http { server: &server, msgpack: Some("application/msgpack") })),
        ("raw msgpack", Box::new(Http { server: &server, msgpack: Some("application/msgpack; arrays=raw") })),
        ("zmq", Box::new(Zmq::connect(&server.zmq, false))),
        ("raw zmq", Box::new(Zmq::connect(&server.zmq, true))),
    ];
    for (name, mut way) in ways {
        let said = episode(&mut *way);
        for (i, (said, expected)) in said.iter().zip(&expected).enumerate() {
            // Numbers are compared as printed, with all digits.
            assert_eq!(said.to_string(), expected.to_string(), "{name}, answer {i}");
        }
        assert_eq!(said.len(), expected.len(), "{name}");
    }
}

#[test]
fn batches_and_trajectories_agree_over_all_transports() {
    let server = Running::start();
    let script = |client: &mut dyn Ask| {
        let made = client.get("create_worlds", json!({"task": "basketball", "count": 5, "seed": 11}));
        let ids = made["worlds"].clone();
        assert_eq!(ids.as_array().unwrap().len(), 5);
        let mut said =
            vec![client.get("reset_worlds", json!({"worlds": ids, "mask": [true, true, false, true, true]}))];
        said.push(
            client.get("reset_worlds", json!({"worlds": ids, "seeds": [1, null, 3, 4, 5], "split": "test"})),
        );
        for autoreset in ["same_step", "next_step", "next_step"] {
            let actions: Vec<u64> = (0..5).map(|i| i * 7_001).collect();
            let args = json!({"worlds": ids, "actions": actions, "autoreset": autoreset});
            said.push(client.get("step_worlds", args));
        }
        let (status, problem) =
            client.ask("step_worlds", json!({"worlds": [ids[0], "none"], "actions": [1, 2]}));
        assert_eq!((status, &problem["field"]), (404, &json!("worlds[1]")), "{problem}");
        said.push(problem);
        client.ask("delete_worlds", json!({"worlds": ids}));
        assert_eq!(client.ask("get_world", json!({"id": ids[0]})).0, 404);
        said
    };
    let mut json_way = Http { server: &server, msgpack: None };
    let expected = script(&mut json_way);
    let film = json!({"id": "basketball-sim", "actions": [5, 17_000, 39_999, 21_212], "task": "basketball:000",
                      "trajectories": true});
    let lists = json_way.get("rollout_world", film.clone());
    let mut raw_ways: Vec<Box<dyn Ask>> = vec![
        Box::new(Http { server: &server, msgpack: Some("application/msgpack; arrays=raw") }),
        Box::new(Zmq::connect(&server.zmq, true)),
    ];
    for way in &mut raw_ways {
        assert_eq!(script(&mut **way), expected);
        let raw = way.get("rollout_world", film.clone());
        let mut seen = 0;
        for (n, result) in lists["results"].as_array().unwrap().iter().enumerate() {
            let times = result["t"].as_array().cloned().unwrap_or_default();
            assert_eq!(raw["length"][n], times.len());
            for (b, body) in raw["bodies"].as_array().unwrap().iter().enumerate() {
                for (k, t) in times.iter().enumerate() {
                    let track = &result["bodies"][body.as_str().unwrap()];
                    assert_eq!(raw["t"][n][k], *t);
                    assert_eq!(
                        raw["states"][n][b][k],
                        json!([track["x"][k], track["y"][k], track["angle"][k]])
                    );
                    seen += 1;
                }
            }
        }
        assert!(seen > 10, "{seen} states show too little");
    }
    let mut packed = Http { server: &server, msgpack: Some("application/msgpack") };
    assert_eq!(script(&mut packed), expected);
    assert_eq!(packed.get("rollout_world", film.clone())["results"], lists["results"]);
}

#[test]
fn dispatches_every_documented_operation() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    let methods =
        document["paths"].as_object().unwrap().values().flat_map(|p| p.as_object().unwrap().values());
    let named: BTreeSet<String> = methods.map(|o| o["operationId"].as_str().unwrap().to_string()).collect();
    let mut only_http = Vec::new();
    for name in &named {
        // Checks only that the operation exists, not its arguments.
        let (status, answer) = client.ask(name, json!({"no_such_argument": 1}));
        assert!((400..500).contains(&status), "{name}: {answer}");
        if answer["detail"].as_str().unwrap().contains("no operation named") {
            only_http.push(name.as_str());
        }
    }
    assert_eq!(only_http, ["follow_job", "metrics", "watch_world"]);
    assert_eq!(client.get("openapi", json!({})), document);
    let healthy = client.get("healthz", json!({}));
    assert_eq!(healthy["status"], "ok");
}

#[test]
fn binary_arrays_replace_argument_fields() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let ids = client.get("create_worlds", json!({"task": "bowling", "count": 2}))["worlds"].clone();
    client.get("reset_worlds", json!({"worlds": ids}));
    let lists =
        client.get("rollout_world", json!({"id": ids[0], "actions": [[0.5, 0.25, 0.75], [0.0, 1.0, 0.5]]}));
    let numbers: Vec<u8> = [0.5f32, 0.25, 0.75, 0.0, 1.0, 0.5].iter().flat_map(|x| x.to_le_bytes()).collect();
    let header = json!({"v": 1, "id": "me", "op": "rollout_world", "args": {"id": ids[0]},
                        "arrays": [{"name": "actions", "dtype": "<f4", "shape": [2, 3]}]});
    // A REQ socket adds an empty delimiter frame and expects one back.
    client.send(vec![vec![], packed(&header), numbers.clone()]);
    let mut frames = client.receive();
    assert!(frames.remove(0).is_empty());
    let head = unpacked(rmpv::decode::read_value(&mut &frames[0][..]).unwrap());
    assert_eq!(head["id"], "me");
    assert_eq!(head["result"]["results"], lists["results"]);
    // The same over HTTP, as extension 78.
    let array =
        Packed::Array(vec!["<f4".into(), Packed::Array(vec![2.into(), 3.into()]), Packed::Binary(numbers)]);
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, &array).unwrap();
    let body = Packed::Map(vec![("actions".into(), Packed::Ext(78, bytes))]);
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, &body).unwrap();
    let url = format!("{}/v1/worlds/{}/rollout", server.http, ids[0].as_str().unwrap());
    let sent =
        server.client.post(url).header("content-type", "application/msgpack").body(bytes).send().unwrap();
    let answer: Value = serde_json::from_str(&sent.text().unwrap()).unwrap();
    assert_eq!(answer["results"], lists["results"]);
    // Binary data are sent and received as arrays.
    let drawn =
        json!({"id": "bowling-sim", "action": [0.1, 0.9, 0.2], "task": "bowling:000", "format": "svg"});
    let drawn = client.get("render_world", drawn);
    assert!(drawn["body"].as_array().unwrap().starts_with(&[b'<'.into()]));
}

#[test]
fn repeated_requests_act_once() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let request = |id: u64, count: u64| {
        packed(
            &json!({"v": 1, "id": id, "op": "create_worlds", "key": "k1", "args": {"task": "bowling", "count": count}}),
        )
    };
    client.send(vec![request(1, 3)]);
    let (_, _, first) = client.answer();
    client.send(vec![request(2, 3)]);
    assert_eq!(client.answer().2, first);
    client.send(vec![request(3, 4)]);
    let (_, status, problem) = client.answer();
    assert_eq!((status, &problem["field"]), (422, &json!("Idempotency-Key")));
    let worlds = client.get("list_worlds", json!({"limit": 1000}));
    assert_eq!(worlds["worlds"].as_array().unwrap().len(), 4 + 3);
}

/// Work of at least a fraction of a second: many rollouts.
fn long(world: &str) -> Value {
    json!({"id": world, "actions": (0..600).map(|i| i * 7).collect::<Vec<u64>>(), "task": "bowling:001"})
}

#[test]
fn busy_workers_answer_pings_and_drop_cancelled_requests() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let first = client.request("rollout_world", long("bowling-sim"));
    // Queued behind it and not started.
    let second = client.request("rollout_world", long("bowling-sim"));
    let ping = client.request("ping", json!({}));
    assert_eq!(client.answer(), (ping.into(), 200, json!({"pong": true})));
    let cancel = client.request("cancel", json!({"request": second}));
    let mut answers: Vec<_> = (0..2).map(|_| client.answer()).collect();
    answers.sort_by_key(|a| a.0.as_u64());
    assert_eq!(answers[0].0, second);
    assert!(answers[0].2["type"].as_str().unwrap().ends_with("/cancelled"), "{answers:?}");
    assert_eq!(answers[1], (cancel.into(), 200, json!({"cancelled": true})));
    let again = client.request("cancel", json!({"request": second}));
    assert_eq!(client.answer(), (again.into(), 200, json!({"cancelled": false})));
    let (id, status, rolled) = client.answer();
    assert_eq!((id, status), (first.into(), 200), "{rolled}");
    let valid = rolled["results"].as_array().unwrap().iter().filter(|r| r["valid"] == true).count();
    // The cancelled one never ran.
    assert_eq!(client.get("get_world", json!({"id": "bowling-sim"}))["interactions"], valid);
}

#[test]
fn rejects_excess_requests_as_busy() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    for _ in 0..200 {
        client.request(
            "rollout_world",
            json!({"id": "bowling-sim", "actions": [1, 2, 3, 4], "task": "bowling:000"}),
        );
    }
    let answers: Vec<_> = (0..200).map(|_| client.answer()).collect();
    let ids: BTreeSet<u64> = answers.iter().map(|a| a.0.as_u64().unwrap()).collect();
    assert_eq!(ids.len(), 200, "each is answered once");
    let busy =
        answers.iter().filter(|a| a.1 == 429 && a.2["type"].as_str().unwrap().ends_with("/busy")).count();
    let done = answers.iter().filter(|a| a.1 == 200).count();
    assert!(done >= 128 && busy >= 1 && done + busy == 200, "{done} done, {busy} busy");
    // Requests to one world run in order of arrival, in whatever order the responses come: the counter only rises.
    let mut done: Vec<_> =
        answers.iter().filter_map(|a| Some((a.0.as_u64()?, a.2["interactions"].as_u64()?))).collect();
    done.sort_unstable();
    assert!(done.is_sorted_by_key(|d| d.1), "{done:?}");
}

#[test]
fn no_input_crashes_the_server() {
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let bad: Vec<(Vec<Vec<u8>>, bool)> = vec![
        (vec![vec![]], false),
        (vec![vec![0xc1]], false),
        (vec![b"{}".to_vec()], false),
        (vec![packed(&json!([1, 2]))], false),
        (vec![packed(&json!({}))], false),
        (vec![packed(&json!({"v": 1, "op": "healthz"}))], false),
        (vec![packed(&json!({"v": 1, "id": null, "op": "healthz"}))], false),
        (vec![packed(&json!({"v": 2, "id": 1, "op": "healthz"}))], true),
        (vec![packed(&json!({"v": 1, "id": 1}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": 3}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "no_such"}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "healthz", "args": [1]}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "healthz", "args": {"x": 1}}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "healthz", "extra": 1}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "healthz"})), vec![1]], true),
        (
            vec![packed(
                &json!({"v": 1, "id": 1, "op": "healthz", "arrays": [{"name": "a", "dtype": "<f8", "shape": [1]}]}),
            )],
            true,
        ),
        (
            vec![
                packed(
                    &json!({"v": 1, "id": 1, "op": "step_worlds", "arrays": [{"name": "actions", "dtype": "<f8", "shape": [3, 99999999999u64]}]}),
                ),
                vec![0; 8],
            ],
            true,
        ),
        (
            vec![
                packed(
                    &json!({"v": 1, "id": 1, "op": "step_worlds", "arrays": [{"name": "actions", "dtype": "object", "shape": [1]}]}),
                ),
                vec![0; 8],
            ],
            true,
        ),
        (
            vec![
                packed(
                    &json!({"v": 1, "id": 1, "op": "step_worlds", "args": {"a": 1}, "arrays": [{"name": "a.b", "dtype": "|u1", "shape": [1]}]}),
                ),
                vec![0],
            ],
            true,
        ),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "cancel"}))], true),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "step_world", "args": {"id": "bowling-sim"}}))], true),
        (
            vec![packed(
                &json!({"v": 1, "id": 1, "op": "step_worlds", "args": {"worlds": [], "actions": []}}),
            )],
            true,
        ),
        (vec![vec![0x91; 5000]], false),
        (vec![vec![7; 17 * 1024 * 1024]], false),
        (vec![packed(&json!({"v": 1, "id": 1, "op": "healthz"})), vec![7; 17 * 1024 * 1024]], true),
        (vec![vec![]; 300], false),
    ];
    for (i, (frames, knows_id)) in bad.into_iter().enumerate() {
        client.send(frames);
        let (id, status, problem) = client.answer();
        assert_eq!(id, if knows_id { json!(1) } else { json!(null) }, "{i}: {problem}");
        assert!((400..500).contains(&status), "{i}: {problem}");
        assert!(problem["detail"].as_str().is_some_and(|d| d.len() > 10), "{i}: {problem}");
    }
    let address = server.zmq.strip_prefix("tcp://").unwrap();
    let mut greeting = [0u8; 64];
    (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
    greeting[12..16].copy_from_slice(b"NULL");
    let ready = b"\x04\x1c\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER";
    let announced = [&[2u8][..], &(1u64 << 61).to_be_bytes()].concat();
    let old = [&[0xff; 10][..], &[1; 54]].concat();
    for raw in [
        b"GET / HTTP/1.1\r\n\r\n".to_vec(),
        [&greeting[..], &announced].concat(),
        [&greeting[..], ready, &announced].concat(),
        [&greeting[..], ready, &[0xff; 40]].concat(),
        [&greeting[..], ready, &[1, 3, 1]].concat(),
        [&greeting[..], b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03PUB"].concat(),
        [&greeting[..], b"\x04\x06\x05RE"].concat(),
        old,
        vec![0xff],
    ] {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(&raw).unwrap();
        drop(stream);
    }
    assert_eq!(client.get("healthz", json!({}))["status"], "ok");
    // ZMTP heartbeats are answered.
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream.write_all(&[&greeting[..], ready, b"\x04\x09\x04PING\x00\x00hi"].concat()).unwrap();
    let mut all = Vec::new();
    let mut some = [0; 256];
    while !all.windows(8).any(|w| w == b"\x07\x04PONGhi") {
        let n = stream.read(&mut some).expect("a PONG");
        assert!(n > 0, "hung up on");
        all.extend_from_slice(&some[..n]);
    }
}

#[test]
fn graceful_shutdown_finishes_requests_and_clients_reconnect() {
    let directory = tempfile::tempdir().unwrap();
    let address = format!("ipc://{}", directory.path().join("iplw.sock").display());
    let mut server = Running::at(&address);
    assert_eq!(server.zmq, address);
    let path = address.strip_prefix("ipc://").unwrap().to_string();
    assert!(std::path::Path::new(&path).exists());
    assert!(server.stop() < Duration::from_secs(4));
    assert!(!std::path::Path::new(&path).exists(), "its socket goes with it");

    let mut server = Running::start();
    let address = server.zmq.clone();
    let mut client = Zmq::connect(&address, false);
    let work = json!({"id": "bowling-sim", "actions": [1, 2, 3, 4], "task": "bowling:001"});
    client.request("rollout_world", work);
    client.ask_nothing();
    let stopping = std::thread::spawn(move || server.stop());
    let (_, status, rolled) = client.answer();
    assert_eq!(status, 200, "{rolled}");
    assert!(stopping.join().unwrap() < Duration::from_secs(9));
    let _again = Running::at(&address);
    assert_eq!(Zmq::connect(&address, false).get("healthz", json!({}))["status"], "ok");
}

impl Zmq {
    /// A round trip, which ensures that earlier messages have arrived.
    fn ask_nothing(&mut self) {
        let ping = self.request("ping", json!({}));
        assert_eq!(self.answer().0, ping);
    }
}

#[test]
fn rejects_invalid_and_occupied_addresses() {
    let taken = Running::start();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    for (address, says) in [
        ("tcp://127.0.0.1", "--zmq"),
        ("udp://127.0.0.1:1", "--zmq"),
        ("tcp://127.0.0.1:99999", "--zmq"),
        ("ipc://", "--zmq"),
        (taken.zmq.as_str(), "cannot listen on this address"),
    ] {
        let http = "127.0.0.1:0".parse().unwrap();
        let config = ServeConfig { http, zmq: Some(address.into()), ..ServeConfig::default() };
        let refused = runtime.block_on(Server::bind(config)).err().expect(address);
        assert!(refused.to_string().contains(says), "{refused}");
    }
}

#[test]
fn light_worlds_step_inline() {
    // Checks the result, since timing is unreliable in tests: two steps of a falling ball.
    let scene = json!({
        "format": "iplw.scene/1", "name": "drop", "gravity": [0, -10], "time_step": 0.1, "steps": 2,
        "observe_every": 1,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}}],
        "goal": {"type": "inside", "body": "ball", "region": [[0, 0], [10, 0], [10, 1], [0, 1]]},
        "action": {"bounds": [0, 0, 10, 10], "components": [
            {"target": "ball", "set": "x", "low": 1, "high": 9}, {"target": "ball", "set": "y", "low": 1, "high": 9}]},
    });
    let parsed = serde_json::from_value(scene.clone()).unwrap();
    let tasks = TaskSet::custom(parsed).unwrap();
    let catalogue = Catalogue::new();
    let world = World::new(WorldConfig { tasks, ..config(&catalogue, "bowling", WorldKind::Sim) }).unwrap();
    assert!(world.runs_inline());
    assert!(!World::new(config(&catalogue, "bowling", WorldKind::Sim)).unwrap().runs_inline());
    let server = Running::start();
    let mut client = Zmq::connect(&server.zmq, false);
    let id = client.get("create_world", json!({"scene": scene}))["id"].clone();
    client.get("reset_world", json!({"id": id}));
    let step = client.get("step_world", json!({"id": id, "action": [0.5, 0.5]}));
    // From 5 m, two steps: the first gains speed, the second moves by it, 5 - 10 * 0.1^2.
    assert!((step["observation"][1].as_f64().unwrap() - 0.49).abs() < 1e-9, "{step}");
    assert_eq!(client.ask("step_world", json!({"id": id, "action": [0.5, 0.5]})).0, 409);
}

/// Converts JSON to msgpack.
fn packed(value: &Value) -> Vec<u8> {
    fn convert(value: &Value) -> Packed {
        match value {
            Value::Null => Packed::Nil,
            Value::Bool(b) => (*b).into(),
            Value::Number(n) => match (n.as_u64(), n.as_i64()) {
                (Some(n), _) => n.into(),
                (None, Some(n)) => n.into(),
                (None, None) => n.as_f64().unwrap().into(),
            },
            Value::String(s) => s.as_str().into(),
            Value::Array(items) => Packed::Array(items.iter().map(convert).collect()),
            Value::Object(map) => {
                Packed::Map(map.iter().map(|(k, v)| (k.as_str().into(), convert(v))).collect())
            }
        }
    }
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, &convert(value)).unwrap();
    bytes
}

/// Converts msgpack to JSON, with arrays as nested lists.
fn unpacked(value: Packed) -> Value {
    match value {
        Packed::Nil => Value::Null,
        Packed::Boolean(b) => b.into(),
        Packed::Integer(n) => n.as_u64().map_or_else(|| n.as_i64().unwrap().into(), Value::from),
        Packed::F64(x) => x.into(),
        Packed::String(s) => s.into_str().unwrap().into(),
        Packed::Array(items) => Value::Array(items.into_iter().map(unpacked).collect()),
        Packed::Map(map) => Value::Object(
            map.into_iter().map(|(k, v)| (k.as_str().unwrap().to_string(), unpacked(v))).collect(),
        ),
        Packed::Ext(78, body) => {
            let parts = rmpv::decode::read_value(&mut &body[..]).unwrap();
            let shape: Vec<usize> =
                parts[1].as_array().unwrap().iter().map(|n| n.as_u64().unwrap() as usize).collect();
            nested(parts[0].as_str().unwrap(), &shape, parts[2].as_slice().unwrap())
        }
        other => panic!("{other}"),
    }
}

fn nested(dtype: &str, shape: &[usize], bytes: &[u8]) -> Value {
    let Some((n, rest)) = shape.split_first() else {
        return match dtype {
            "<f8" => f64::from_le_bytes(bytes.try_into().unwrap()).into(),
            "<u4" => u32::from_le_bytes(bytes.try_into().unwrap()).into(),
            "<u8" => u64::from_le_bytes(bytes.try_into().unwrap()).into(),
            "|b1" => (bytes[0] != 0).into(),
            "|u1" => bytes[0].into(),
            other => panic!("{other}"),
        };
    };
    let size = bytes.len().checked_div(*n).unwrap_or(0);
    Value::Array((0..*n).map(|i| nested(dtype, rest, &bytes[i * size..(i + 1) * size])).collect())
}
