//! What columns are called by the programs that write them, and what they hold.
//!
//! Sources: exports of Tracker (`t`, `x`, `y`, `pixelx`), of Kinovea (`Time`, `Ball/0/X`) and of data frames (`pos_x`,
//! `Time (s)`, `X [m]`, `x_px`, an index without a name).

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    Time,
    /// Number of the picture; a time once pictures a second are known.
    Frame,
    X,
    Y,
    Trial,
    Setting,
    Body,
}

/// A unit of length or of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    pub name: &'static str,
    /// m or s; none for what only its user knows, as of pixels.
    pub size: Option<f64>,
}

/// A column by its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// As written.
    pub name: String,
    pub quantity: Option<Quantity>,
    /// As written in the name, if it is.
    pub unit: Option<Unit>,
    /// Whose it is, where the name says so: `Ball` of `Ball/0/X`.
    pub track: Option<String>,
}

/// Units of length by every name that is understood.
pub const LENGTHS: [(Unit, &[&str]); 8] = [
    (unit("m", 1.0), &["m", "metre", "metres", "meter", "meters"]),
    (unit("cm", 1e-2), &["cm", "centimetre", "centimetres", "centimeter", "centimeters"]),
    (unit("mm", 1e-3), &["mm", "millimetre", "millimetres", "millimeter", "millimeters"]),
    (unit("um", 1e-6), &["um", "µm", "μm"]),
    (unit("km", 1e3), &["km"]),
    (unit("in", 0.0254), &["in", "inch", "inches"]),
    (unit("ft", 0.3048), &["ft", "foot", "feet"]),
    (Unit { name: "px", size: None }, &["px", "pix", "pixel", "pixels"]),
];

/// Units of time by every name that is understood.
pub const TIMES: [(Unit, &[&str]); 5] = [
    (unit("s", 1.0), &["s", "sec", "secs", "second", "seconds"]),
    (unit("ms", 1e-3), &["ms", "msec", "millisecond", "milliseconds"]),
    (unit("us", 1e-6), &["us", "µs", "μs", "microseconds"]),
    (unit("min", 60.0), &["min", "minute", "minutes"]),
    (Unit { name: "frames", size: None }, &["frame", "frames"]),
];

/// What a column may be called, in small letters without anything between the words.
const NAMES: [(Quantity, &[&str]); 7] = [
    (Quantity::Time, &["t", "time", "times", "timestamp", "elapsed", "elapsedtime", "zeit", "temps"]),
    (Quantity::Frame, &["frame", "frames", "framenumber", "frameno", "framenr", "frameindex", "frameidx"]),
    (
        Quantity::X,
        &["x", "xpos", "posx", "positionx", "xposition", "xcoord", "xcoordinate", "centerx", "centrex"],
    ),
    (
        Quantity::Y,
        &["y", "ypos", "posy", "positiony", "yposition", "ycoord", "ycoordinate", "centery", "centrey"],
    ),
    (Quantity::Trial, &["trial", "run", "launch", "throw", "shot", "take", "particle", "track", "trackid"]),
    (Quantity::Setting, &["setting"]),
    (Quantity::Body, &["body", "object", "marker"]),
];
/// Coordinates in pixels by a name of their own.
const PIXELS: [(Quantity, &[&str]); 2] = [
    (Quantity::X, &["pixelx", "xpixel", "pxx", "pixx", "xpix"]),
    (Quantity::Y, &["pixely", "ypixel", "pxy", "pixy", "ypix"]),
];
/// `v_x` is no x of something called v; a single capital may be a name.
const NO_TRACKS: [&str; 16] = [
    "v",
    "a",
    "p",
    "f",
    "d",
    "vel",
    "velocity",
    "speed",
    "acc",
    "accel",
    "acceleration",
    "momentum",
    "force",
    "err",
    "error",
    "std",
];

/// What a column of this name holds.
pub fn column(name: &str) -> Column {
    let written = name.trim().trim_start_matches('\u{feff}').trim();
    let found = |quantity, unit, track: Option<&str>| Column {
        name: written.to_string(),
        quantity: Some(quantity),
        unit,
        track: track.map(|t| t.trim().to_string()),
    };
    let (rest, unit) = without_unit(written);
    if let Some(quantity) = named(&NAMES, rest).filter(|q| fits(*q, unit)) {
        return found(quantity, unit, None);
    }
    if let Some(quantity) = named(&PIXELS, rest) {
        return found(quantity, Some(PIXEL), None);
    }
    if let Some((unit, _)) =
        TIMES[..2].iter().find(|(_, names)| names[1..].contains(&plain(written).as_str()))
    {
        return found(Quantity::Time, Some(*unit), None);
    }
    if let Some((track, tail)) = rest.rsplit_once(SEPARATORS) {
        let coordinate = match plain(tail).as_str() {
            "x" => Some(Quantity::X),
            "y" => Some(Quantity::Y),
            _ => None,
        };
        let track = track.trim_end_matches(SEPARATORS);
        if let Some(coordinate) =
            coordinate.filter(|q| fits(*q, unit) && !NO_TRACKS.contains(&spelt(track).as_str()))
        {
            return found(coordinate, unit, Some(track));
        }
    }
    Column { name: written.to_string(), quantity: None, unit: None, track: None }
}

/// The unit of this name among `units`.
pub fn unit_named(units: &[(Unit, &[&str])], name: &str) -> Option<Unit> {
    let name = name.trim().to_lowercase();
    units.iter().find(|(_, names)| names.contains(&name.as_str())).map(|(unit, _)| *unit)
}

const PIXEL: Unit = Unit { name: "px", size: None };
const SEPARATORS: [char; 5] = ['/', '_', ' ', '.', '-'];

const fn unit(name: &'static str, size: f64) -> Unit {
    Unit { name, size: Some(size) }
}

/// A name without its unit: `Time (s)`, `X [m]`, `x/m`, `x_px`.
fn without_unit(name: &str) -> (&str, Option<Unit>) {
    let known = |text: &str| unit_named(&LENGTHS, text).or_else(|| unit_named(&TIMES, text));
    for (open, close) in [('(', ')'), ('[', ']')] {
        if let Some((head, tail)) = name.split_once(open)
            && let Some((inside, "")) = tail.rsplit_once(close)
            && let Some(unit) = known(inside)
        {
            return (head.trim(), Some(unit));
        }
    }
    match name.rsplit_once(SEPARATORS) {
        Some((head, tail)) if !head.is_empty() => {
            known(tail).map_or((name, None), |u| (head.trim(), Some(u)))
        }
        _ => (name, None),
    }
}

/// Whether a unit is one of what is measured.
fn fits(quantity: Quantity, unit: Option<Unit>) -> bool {
    let among = |units: &[(Unit, &[&str])]| unit.is_none_or(|u| units.iter().any(|(known, _)| *known == u));
    match quantity {
        Quantity::Time => among(&TIMES),
        Quantity::X | Quantity::Y => among(&LENGTHS),
        _ => unit.is_none(),
    }
}

fn named(names: &[(Quantity, &[&str])], name: &str) -> Option<Quantity> {
    let name = plain(name);
    names.iter().find(|(_, all)| all.contains(&name.as_str())).map(|(quantity, _)| *quantity)
}

/// [`plain`], but of a single letter.
fn spelt(name: &str) -> String {
    if name.chars().count() == 1 { name.to_string() } else { plain(name) }
}

/// In small letters, without anything between the words.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !SEPARATORS.contains(c)).flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_programs_write_are_understood() {
        let cases = [
            ("t", Quantity::Time, None, None),
            ("Time (s)", Quantity::Time, Some("s"), None),
            ("time_ms", Quantity::Time, Some("ms"), None),
            ("Milliseconds", Quantity::Time, Some("ms"), None),
            ("\u{feff}frame", Quantity::Frame, None, None),
            ("Frame Number", Quantity::Frame, None, None),
            ("X [m]", Quantity::X, Some("m"), None),
            ("y (CM)", Quantity::Y, Some("cm"), None),
            ("x/mm", Quantity::X, Some("mm"), None),
            ("pos_x", Quantity::X, None, None),
            ("Position Y (px)", Quantity::Y, Some("px"), None),
            ("x_px", Quantity::X, Some("px"), None),
            ("pixely", Quantity::Y, Some("px"), None),
            ("Ball/0/X", Quantity::X, None, Some("Ball/0")),
            ("P1_y", Quantity::Y, None, Some("P1")),
            ("A_x", Quantity::X, None, Some("A")),
            ("track_id", Quantity::Trial, None, None),
            ("object", Quantity::Body, None, None),
        ];
        for (name, quantity, unit, track) in cases {
            let found = column(name);
            assert_eq!(found.quantity, Some(quantity), "{name}");
            assert_eq!(found.unit.map(|u| u.name), unit, "{name}");
            assert_eq!(found.track.as_deref(), track, "{name}");
        }
    }

    /// Velocities and the like are not taken for coordinates, nor a coordinate in seconds.
    #[test]
    fn other_names_hold_nothing_that_is_read() {
        for name in [
            "",
            "Unnamed: 0",
            "step",
            "v_x",
            "v_{x}",
            "vx",
            "a.y",
            "r",
            "θr",
            "angle",
            "x (s)",
            "t [m]",
            "xy",
        ] {
            assert_eq!(column(name).quantity, None, "{name}");
        }
    }
}
