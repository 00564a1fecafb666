//! Requests to every operation, generated from the OpenAPI document: bodies and queries are sampled from the schemas, so new
//! operations are fuzzed without changes here.
//!
//! Encoding of a request in bytes: the operation, the request encoding, the path parameter, the query up to a newline, then the
//! body.

use std::cell::RefCell;
use std::collections::BTreeMap;

use iplw::rng::{Stream, stream};
use iplw::serve::fuzz::{FuzzOutcome, FuzzRequest, InMemoryServer, RequestEncoding, operations};
use rand::RngExt;
use serde_json::{Map, Value, json};

use super::{MIB, Target, bytes};

/// Parses requests without running them.
pub const READ: Target = Target {
    name: "bodies",
    short: 10_000,
    long: 10_000_000,
    work: 64 * MIB,
    seeds,
    mutate,
    check: |bytes| {
        SERVER.with_borrow(|server| fuzz_request(bytes).map_or(FuzzOutcome::Rejected, |a| server.0.read(&a)))
    },
};

/// Runs requests, one after the other on the same server.
pub const RUN: Target =
    Target { name: "requests", short: 1_000, long: 1_000_000, work: 1024 * MIB, seeds, mutate, check: run };

thread_local! {
    /// A server and the number of requests it has received.
    static SERVER: RefCell<(InMemoryServer, u64)> = RefCell::default();
}

/// Requests until the server is replaced; it has a few worlds and jobs by then.
const REQUESTS_PER_SERVER: u64 = 400;

fn run(bytes: &[u8]) -> FuzzOutcome {
    let Some(fuzz_request) = fuzz_request(bytes) else { return FuzzOutcome::Rejected };
    SERVER.with_borrow_mut(|(server, count)| {
        if *count >= REQUESTS_PER_SERVER {
            (*server, *count) = (InMemoryServer::default(), 0);
        }
        *count += 1;
        server.answer(&fuzz_request)
    })
}

/// Bytes before the query.
const HEADER_BYTES: usize = 3;

fn fuzz_request(bytes: &[u8]) -> Option<FuzzRequest<'_>> {
    let (head, rest) = bytes.split_first_chunk::<HEADER_BYTES>()?;
    let end = rest.iter().position(|b| *b == b'\n')?;
    let query = std::str::from_utf8(&rest[..end]).ok()?;
    let encoding = [
        RequestEncoding::Json,
        RequestEncoding::Msgpack,
        RequestEncoding::OtherMediaType,
        RequestEncoding::ZmqFields,
    ][usize::from(head[1]) % 4];
    let path_parameter = PATH_PARAMETERS[usize::from(head[2]) % PATH_PARAMETERS.len()];
    Some(FuzzRequest { operation: head[0].into(), encoding, path_parameter, query, body: &rest[end + 1..] })
}

/// Values of the path parameter; some exist.
const PATH_PARAMETERS: [&str; 14] = [
    "sim",
    "real",
    "job-1",
    "job-2",
    "bowling",
    "basketball",
    "1",
    "002",
    "random",
    "untrained",
    "p",
    "x",
    "",
    "ä/../%00",
];

/// Seeds of each operation: bodies sampled from the document for each encoding, with queries.
fn seeds() -> Vec<Vec<u8>> {
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).expect("it is JSON");
    let described = described(&document);
    let mut draw = stream(1, "bodies");
    let mut seeds = Vec::new();
    for (index, name) in operations().iter().enumerate() {
        let operation = &described[name];
        let schema = |kind: &str| operation.pointer(&format!("/requestBody/content/{kind}/schema"));
        for k in 0..SEEDS_PER_OPERATION {
            let body = schema("application~1json").map(|schema| example(schema, &document, 0, &mut draw));
            let body = body.map_or(String::new(), |b| b.to_string());
            let part = part_of(operation, k, &mut draw);
            let way = [0, 0, 1, 3][k % 4];
            seeds.push(
                [
                    &[index as u8, way, part][..],
                    query(operation, &document, &mut draw).as_bytes(),
                    b"\n",
                    body.as_bytes(),
                ]
                .concat(),
            );
        }
        for (kind, bytes) in
            [("text~1csv", CSV.as_bytes()), ("application~1octet-stream", b"\x02\0\0\0\0\0\0\0{}")]
        {
            if schema(kind).is_some() {
                seeds.push([&[index as u8, 2, 10][..], b"\n", bytes].concat());
            }
        }
    }
    seeds
}

/// Seeds of each operation.
const SEEDS_PER_OPERATION: usize = 16;
const CSV: &str = "trial,t,body,x,y\na,0,red,1,2\na,0.1,red,1,1.9\n";

/// Operations by name.
fn described(document: &Value) -> BTreeMap<&str, &Value> {
    let paths = document["paths"].as_object().into_iter().flatten();
    let all = paths.flat_map(|(_, methods)| methods.as_object().into_iter().flatten());
    all.filter_map(|(_, operation)| Some((operation["operationId"].as_str()?, operation))).collect()
}

/// Mostly existing ids: worlds for world operations, and so on.
fn part_of(operation: &Value, k: usize, draw: &mut Stream) -> u8 {
    let first = match operation["tags"][0].as_str() {
        Some("jobs" | "workflow") => 2,
        Some("tasks") => [4, 6][k % 2],
        Some("policies") => 8,
        _ => 0,
    };
    if draw.random_range(0..4) == 0 { draw.random() } else { first + (k % 2) as u8 }
}

fn query(operation: &Value, document: &Value, draw: &mut Stream) -> String {
    let parameters = operation["parameters"].as_array().into_iter().flatten();
    let mut pairs = Vec::new();
    for parameter in parameters.filter(|p| p["in"] == "query") {
        if draw.random_range(0..3) == 0 {
            let name = parameter["name"].as_str().unwrap_or_default();
            let mut schema = parameter["schema"].clone();
            schema["description"] = parameter["description"].clone();
            let value = example(&schema, document, 0, draw);
            let value = value.as_str().map_or_else(|| value.to_string(), String::from);
            pairs.push(format!("{name}={}", value.replace(['&', '\n'], "")));
        }
    }
    pairs.join("&")
}

/// A value that conforms to a schema.
fn example(schema: &Value, document: &Value, depth: u32, draw: &mut Stream) -> Value {
    if let Some(to) = schema["$ref"].as_str() {
        let to = document.pointer(to.trim_start_matches('#')).unwrap_or(&Value::Null);
        return example(to, document, depth, draw);
    }
    for several in ["oneOf", "anyOf"] {
        if let Some(kinds) = schema[several].as_array() {
            return example(&kinds[draw.random_range(0..kinds.len())], document, depth, draw);
        }
    }
    if let Some(parts) = schema["allOf"].as_array() {
        let parts = parts.iter().map(|part| example(part, document, depth, draw));
        let fields =
            parts.filter_map(|part| if let Value::Object(fields) = part { Some(fields) } else { None });
        return Value::Object(fields.flatten().collect());
    }
    let fixed = [&schema["example"], &schema["default"]].into_iter().find(|v| !v.is_null());
    if let Some(value) = fixed.filter(|_| draw.random()) {
        return value.clone();
    }
    if let Some(values) = schema["enum"].as_array() {
        return values[draw.random_range(0..values.len())].clone();
    }
    let kinds = schema["type"].as_array().cloned().unwrap_or_else(|| vec![schema["type"].clone()]);
    match kinds[draw.random_range(0..kinds.len())].as_str() {
        Some("object") => object(schema, document, depth, draw),
        Some("array") => {
            let least = schema["minItems"].as_u64().unwrap_or(0);
            let most = schema["maxItems"].as_u64().unwrap_or(3).min(least + 3);
            let count = if depth > MAX_DEPTH { least } else { draw.random_range(least..=most.max(least)) };
            (0..count).map(|_| example(&schema["items"], document, depth + 1, draw)).collect()
        }
        Some("integer") => json!(number(schema, draw).round() as i64),
        Some("number") => json!(number(schema, draw)),
        Some("boolean") => json!(draw.random::<bool>()),
        Some("string") => {
            // Descriptions of strings name their values: `png` (default) or `svg`.
            let description = schema["description"].as_str().unwrap_or_default();
            let named: Vec<&str> = description.split('`').skip(1).step_by(2).collect();
            let words = if named.is_empty() || draw.random_range(0..4) == 0 { &WORDS[..] } else { &named };
            json!(words[draw.random_range(0..words.len())])
        }
        // Any value: formats that the document does not define, above all scenes.
        _ => [json!(null), json!({}), json!(1), scene()][draw.random_range(0..4)].clone(),
    }
}

/// Maximum depth of sampled objects and arrays.
const MAX_DEPTH: u32 = 5;

fn object(schema: &Value, document: &Value, depth: u32, draw: &mut Stream) -> Value {
    let required: Vec<&str> =
        schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let mut fields = Map::new();
    for (name, field) in schema["properties"].as_object().into_iter().flatten() {
        let is_required = required.contains(&name.as_str());
        if is_required || (depth <= MAX_DEPTH && draw.random_range(0..3) == 0) {
            // Fields of these names have formats of their own.
            let value = match name.as_str() {
                "scene" => scene(),
                "snapshot" => snapshot(),
                _ => example(field, document, depth + 1, draw),
            };
            fields.insert(name.clone(), value);
        }
    }
    let more = &schema["additionalProperties"];
    if more.is_object() && draw.random() {
        let name = WORDS[draw.random_range(0..WORDS.len())];
        fields.insert(name.into(), example(more, document, depth + 1, draw));
    }
    Value::Object(fields)
}

fn number(schema: &Value, draw: &mut Stream) -> f64 {
    let low = schema["minimum"].as_f64().unwrap_or(0.0);
    let high = schema["maximum"].as_f64().unwrap_or(low + 10.0);
    match draw.random_range(0..6) {
        0 => low,
        1 => high,
        _ => low + draw.random::<f64>() * (high - low).min(10.0),
    }
}

/// Meaningful and meaningless names.
const WORDS: [&str; 24] = [
    "bowling",
    "bowling:002",
    "basketball",
    "basketball:1",
    "sim",
    "real",
    "red",
    "blue",
    "green",
    "friction",
    "restitution",
    "density",
    "linear_drag",
    "c",
    "wind",
    "mixed",
    "random",
    "x",
    "",
    "ä",
    "job-1",
    "train",
    "0.5",
    "1,2,3",
];

fn snapshot() -> Value {
    json!({
        "format": "iplw.snapshot/1", "world": "sim", "task": "bowling:000", "action": [0.5, 0.5, 0.2], "latents": {},
        "stop": true, "at": 1.5, "step": 90,
    })
}

fn scene() -> Value {
    json!({
        "format": "iplw.scene/1", "name": "small", "time_step": 0.01, "steps": 20, "observe_every": 5,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1]},
            {"name": "red", "shape": {"type": "disc", "radius": 0.1}}],
        "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
        "goal": {"type": "contact", "bodies": ["ball", "floor"]},
        "action": {"components": [{"target": "red", "set": "x", "low": -1, "high": 1},
            {"target": "red", "set": "y", "low": 2, "high": 3}]}
    })
}

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    let Some(end) = seed.iter().position(|b| *b == b'\n').filter(|end| *end >= HEADER_BYTES) else {
        return bytes::mutate(seed, seeds, &QUERY_WORDS, draw);
    };
    let mut body = seed.split_off(end + 1);
    match draw.random_range(0..8) {
        0 => {
            let at = draw.random_range(0..HEADER_BYTES);
            // Mostly keeps the operation that fits the body.
            seed[at.max(usize::from(draw.random_range(0..4) > 0))] = draw.random();
        }
        1 => {
            let mut query = seed.split_off(HEADER_BYTES);
            query.pop();
            bytes::mutate(&mut query, seeds, &QUERY_WORDS, draw);
            query.retain(|b| *b != b'\n');
            seed.extend(query);
            seed.push(b'\n');
        }
        2 => bytes::mutate(&mut body, seeds, &QUERY_WORDS, draw),
        _ => {
            if let Ok(value) = serde_json::from_slice(&body) {
                body = super::json::mutant(value, draw);
            } else {
                bytes::mutate(&mut body, seeds, &QUERY_WORDS, draw);
            }
        }
    }
    seed.extend(body);
}

const QUERY_WORDS: [&[u8]; 12] =
    [b"limit=", b"cursor=", b"&", b"=", b"0", b"1000", b"-1", b"1e99", b"true", b"null", b"{}", b"[[1]]"];
