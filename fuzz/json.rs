//! Mutations of JSON: nearly valid documents, and text that is nearly JSON.

use iplw::rng::Stream;
use rand::RngExt;
use serde_json::{Map, Value, json};

/// One to three changes of a value's fields, and occasionally of its bytes.
pub fn mutant(mut value: Value, draw: &mut Stream) -> Vec<u8> {
    for _ in 0..draw.random_range(1..4) {
        mutate(&mut value, draw);
    }
    let text = value.to_string().replace("\"<<", "").replace(">>\"", "").replace("<twice>", "");
    let mut bytes = text.into_bytes();
    if draw.random_range(0..8) == 0 {
        spoil(&mut bytes, draw);
    }
    bytes
}

/// Boundary values of formats, floats and scenes, in literal form.
const BOUNDARY_NUMBERS: [&str; 34] = [
    "0",
    "-0",
    "-0.0",
    "1",
    "-1",
    "2",
    "0.5",
    "1e-6",
    "9.99e-7",
    "1e-12",
    "1e-30",
    "1e-45",
    "1e-310",
    "5e-324",
    "-5e-324",
    "0.1",
    "1e4",
    "1e5",
    "-1e5",
    "100000.1",
    "400",
    "-400",
    "1e6",
    "1e9",
    "16777217",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "18446744073709551616",
    "1e38",
    "1e39",
    "1.7976931348623157e308",
    "-1.7976931348623157e308",
    "1e999",
];

fn mutate(root: &mut Value, draw: &mut Stream) {
    let mut places = Vec::new();
    collect(root, &mut String::new(), &mut places);
    let numbers: Vec<&String> =
        places.iter().filter(|p| root.pointer(p).is_some_and(Value::is_number)).collect();
    let number = numbers.get(draw.random_range(0..numbers.len().max(1))).map(ToString::to_string);
    if places.is_empty() {
        return change_object(root, &places, draw);
    }
    let any = places[draw.random_range(0..places.len())].clone();
    let other = root.pointer(&places[draw.random_range(0..places.len())]).cloned().unwrap_or(Value::Null);
    match draw.random_range(0..12) {
        0 | 1 => put(
            root,
            number,
            json!(format!("<<{}>>", BOUNDARY_NUMBERS[draw.random_range(0..BOUNDARY_NUMBERS.len())])),
        ),
        2..=5 => {
            let old = number.as_ref().and_then(|p| root.pointer(p)).cloned().unwrap_or_default();
            let reach = [0.1, 0.5, 6.0][draw.random_range(0..3)];
            let size = 10f64.powf(draw.random_range(-reach..reach));
            let was = old.as_f64().unwrap_or(0.0);
            let new = if was == 0.0 { size * 1e-2 } else { was * size };
            let new = if draw.random_range(0..8) == 0 { -new } else { new };
            // Counts stay integers, which would otherwise always be rejected.
            let whole = old.is_u64() && was > 6.0 && new >= 0.0;
            put(root, number, if whole { json!(new.ceil() as u64) } else { json!(new) });
        }
        6 => {
            let values =
                [json!(null), json!(true), json!("x"), json!([]), json!({}), json!([[]]), json!("<<NaN>>")];
            put(root, Some(any), values[draw.random_range(0..values.len())].clone());
        }
        7 => put(root, Some(any), other),
        8 | 9 => change_object(root, &places, draw),
        _ => change_array(root, &places, draw),
    }
}

/// JSON pointers of all nested values.
fn collect(value: &Value, path: &mut String, places: &mut Vec<String>) {
    let length = path.len();
    let mut go = |key: &str, child: &Value| {
        path.push('/');
        path.push_str(&key.replace('~', "~0").replace('/', "~1"));
        places.push(path.clone());
        collect(child, path, places);
        path.truncate(length);
    };
    match value {
        Value::Object(fields) => fields.iter().for_each(|(k, v)| go(k, v)),
        Value::Array(items) => items.iter().enumerate().for_each(|(i, v)| go(&i.to_string(), v)),
        _ => {}
    }
}

fn put(root: &mut Value, place: Option<String>, value: Value) {
    if let Some(slot) = place.and_then(|p| root.pointer_mut(&p)) {
        *slot = value;
    }
}

/// Drops, duplicates or misspells a field.
fn change_object(root: &mut Value, places: &[String], draw: &mut Stream) {
    let objects: Vec<&str> = std::iter::once("")
        .chain(places.iter().map(String::as_str))
        .filter(|p| root.pointer(p).and_then(Value::as_object).is_some_and(|o| !o.is_empty()))
        .collect();
    if objects.is_empty() {
        return;
    }
    let place = objects[draw.random_range(0..objects.len())];
    let fields: &mut Map<String, Value> =
        root.pointer_mut(place).and_then(Value::as_object_mut).expect("it was just seen");
    let key = fields.keys().nth(draw.random_range(0..fields.len())).expect("within the length").clone();
    let value = fields[&key].clone();
    match draw.random_range(0..4) {
        0 => drop(fields.insert(format!("{key}<twice>"), value)),
        1 => drop(fields.insert(format!("{key}s"), value)),
        _ => drop(fields.remove(&key)),
    }
}

/// Clears, shortens or extends an array; added bodies and statics get new names and positions.
fn change_array(root: &mut Value, places: &[String], draw: &mut Stream) {
    let arrays: Vec<&String> =
        places.iter().filter(|p| root.pointer(p).is_some_and(Value::is_array)).collect();
    let Some(place) = arrays.get(draw.random_range(0..arrays.len().max(1))) else { return };
    let items = root.pointer_mut(place).and_then(Value::as_array_mut).expect("it was just seen");
    let Some(item) = items.get(draw.random_range(0..items.len().max(1))).cloned() else { return };
    match draw.random_range(0..6) {
        0 => items.clear(),
        1 => drop(items.pop()),
        _ => {
            let more = [1, 2, 5, 30, 300][draw.random_range(0..5)];
            for k in 0..more {
                let mut copy = item.clone();
                if copy.get("name").is_some() {
                    copy["name"] = json!(format!("copy {k}"));
                    let step = [0.0, 1.0, 3.0][draw.random_range(0..3)];
                    copy["position"] = json!([step * f64::from(k), 5.0 + step * f64::from(k % 7)]);
                }
                items.push(copy);
            }
        }
    }
}

/// Flips, cuts, duplicates or inserts bytes.
fn spoil(bytes: &mut Vec<u8>, draw: &mut Stream) {
    for _ in 0..draw.random_range(1..4) {
        if bytes.is_empty() {
            return;
        }
        let at = draw.random_range(0..bytes.len());
        match draw.random_range(0..4) {
            0 => bytes[at] ^= 1 << draw.random_range(0..8),
            1 => bytes.truncate(at),
            2 => bytes.insert(at, b"{}[],:\"0e-"[draw.random_range(0..10)]),
            _ => {
                let tail = bytes[at..].to_vec();
                bytes.extend(tail);
            }
        }
    }
}
