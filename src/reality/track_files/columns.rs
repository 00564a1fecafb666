//! Column names of tracking programs and data frames, and the quantities they denote.
//!
//! Sources: exports of Tracker (`t`, `x`, `y`, `pixelx`), Kinovea (`Time`, `Ball/0/X`), TrackMate (`POSITION_X`, `TRACK_ID`), ImageJ
//! (`Track n°`, `Slice n°`), Logger Pro (`Latest: Time (s)`), Capstone (`Time (s) Run #1`) and of data frames (`pos_x`, `X [m]`, `x_px`, an index without a name).

/// Quantity of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnQuantity {
    Time,
    /// Frame number; converted to a time by the frame rate.
    Frame,
    /// Time since the row above.
    Interval,
    X,
    Y,
    Z,
    /// Height, or distance along a track: a coordinate where there is no other. Beside others it may be the size of a box.
    Height,
    Distance,
    /// Measured size of the body.
    Radius,
    Diameter,
    /// Confidence of a detection, from 0 to 1.
    Likelihood,
    Trial,
    /// The program's number of a track, which is a trial; rows without one belong to none.
    TrackNumber,
    Setting,
    Body,
}

/// Unit of length or time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnUnit {
    pub name: &'static str,
    /// Size in m or s; `None` if only the user knows it, as for pixels.
    pub size: Option<f64>,
}

/// A column parsed from its name.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackColumn {
    /// Name in the file.
    pub name: String,
    pub quantity: Option<ColumnQuantity>,
    /// Unit in the name, if any.
    pub unit: Option<ColumnUnit>,
    /// Track in the name, if any: `Ball/0` of `Ball/0/X`.
    pub track: Option<String>,
    /// Run in the name, if any: `Run 1` of `Run 1: X (m)`. Each run has its own times.
    pub run: Option<String>,
}

impl TrackColumn {
    /// A column that is not read.
    pub fn other(name: &str) -> TrackColumn {
        TrackColumn { name: name.to_string(), quantity: None, unit: None, track: None, run: None }
    }

    /// A column of known quantity.
    pub fn of_quantity(name: &str, quantity: ColumnQuantity, unit: Option<ColumnUnit>) -> TrackColumn {
        TrackColumn { quantity: Some(quantity), unit, ..TrackColumn::other(name) }
    }
}

/// Whether a column is in pixels.
pub fn column_in_pixels(column: &TrackColumn) -> bool {
    column.unit.is_some_and(|unit| unit.size.is_none())
}

/// Units of length with all accepted names.
pub const LENGTHS: [(ColumnUnit, &[&str]); 8] = [
    (unit("m", 1.0), &["m", "metre", "metres", "meter", "meters"]),
    (unit("cm", 1e-2), &["cm", "centimetre", "centimetres", "centimeter", "centimeters"]),
    (unit("mm", 1e-3), &["mm", "millimetre", "millimetres", "millimeter", "millimeters"]),
    (unit("um", 1e-6), &["um", "µm", "μm", "micron", "microns", "micrometer", "micrometre"]),
    (unit("km", 1e3), &["km"]),
    (unit("in", 0.0254), &["in", "inch", "inches"]),
    (unit("ft", 0.3048), &["ft", "foot", "feet"]),
    (ColumnUnit { name: "px", size: None }, &["px", "pix", "pixel", "pixels"]),
];

/// Units of time with all accepted names.
pub const TIMES: [(ColumnUnit, &[&str]); 5] = [
    (unit("s", 1.0), &["s", "sec", "secs", "second", "seconds"]),
    (unit("ms", 1e-3), &["ms", "msec", "millisecond", "milliseconds"]),
    (unit("us", 1e-6), &["us", "µs", "μs", "microseconds"]),
    (unit("min", 60.0), &["min", "minute", "minutes"]),
    (ColumnUnit { name: "frames", size: None }, &["frame", "frames"]),
];

/// Accepted column names, in lower case without separators.
const NAMES: [(ColumnQuantity, &[&str]); 14] = [
    (
        ColumnQuantity::Time,
        &[
            "t",
            "time",
            "times",
            "timestamp",
            "elapsed",
            "elapsedtime",
            "positiont",
            "timesec",
            "zeit",
            "temps",
            "tiempo",
            "tempo",
        ],
    ),
    (
        ColumnQuantity::Frame,
        &[
            "frame",
            "frames",
            "framenumber",
            "frameno",
            "framenr",
            "framenum",
            "frameindex",
            "frameidx",
            "frameid",
            "framecount",
            "slice",
            "slicen°",
            "slicenumber",
            "image",
        ],
    ),
    (ColumnQuantity::Interval, &["dt", "deltat", "Δt", "timestep", "timedelta"]),
    (
        ColumnQuantity::X,
        &[
            "x",
            "xpos",
            "posx",
            "positionx",
            "xposition",
            "xcoord",
            "xcoordinate",
            "centerx",
            "centrex",
            "centroidx",
            "xcenter",
            "xcentre",
            "cx",
            "xc",
        ],
    ),
    (
        ColumnQuantity::Y,
        &[
            "y",
            "ypos",
            "posy",
            "positiony",
            "yposition",
            "ycoord",
            "ycoordinate",
            "centery",
            "centrey",
            "centroidy",
            "ycenter",
            "ycentre",
            "cy",
            "yc",
        ],
    ),
    (ColumnQuantity::Z, &["z", "zpos", "posz", "positionz", "zposition", "zcoord", "zcoordinate"]),
    (ColumnQuantity::Height, &["height", "h", "altitude", "elevation", "hoehe", "höhe"]),
    (ColumnQuantity::Distance, &["distance", "position", "displacement", "pos"]),
    (ColumnQuantity::Radius, &["radius", "ballradius"]),
    (ColumnQuantity::Diameter, &["diameter", "balldiameter", "estimateddiameter"]),
    (ColumnQuantity::Likelihood, &["likelihood"]),
    (ColumnQuantity::Trial, &["trial", "run", "launch", "throw", "shot", "take"]),
    (
        ColumnQuantity::TrackNumber,
        &["particle", "track", "trackid", "tracknumber", "trackn°", "trackno", "trackindex", "trajectory"],
    ),
    (ColumnQuantity::Setting, &["setting"]),
];
/// Names of the body of a row.
const BODIES: [&str; 3] = ["body", "object", "marker"];
/// Names of coordinates in pixels.
const PIXELS: [(ColumnQuantity, &[&str]); 2] = [
    (ColumnQuantity::X, &["pixelx", "xpixel", "pxx", "pixx", "xpix"]),
    (ColumnQuantity::Y, &["pixely", "ypixel", "pxy", "pixy", "ypix"]),
];
/// Prefixes that do not name a track: `v_x` is not the x of a track called v. A single capital letter may name a track.
const NON_TRACK_NAMES: [&str; 16] = [
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

/// Parses a column's name.
pub fn column(name: &str) -> TrackColumn {
    let written = name.trim().trim_start_matches('\u{feff}').trim();
    let (run, own) = match (written.rsplit_once(':'), written.rsplit_once(" Run #")) {
        (Some((run, own)), _) if !run.trim().is_empty() => (Some(run.trim().to_string()), own.trim()),
        (_, Some((own, number))) => (Some(format!("Run {}", number.trim())), own.trim()),
        _ => (None, written),
    };
    let (quantity, unit, track) = match quantity(own) {
        Some((quantity, unit, track)) => (Some(quantity), unit, track.map(|t| t.trim().to_string())),
        None => (None, None, None),
    };
    TrackColumn { name: written.to_string(), quantity, unit, track, run }
}

/// Quantity, unit and track of a column called `name`.
fn quantity(name: &str) -> Option<(ColumnQuantity, Option<ColumnUnit>, Option<&str>)> {
    let (rest, unit) = without_unit(name);
    if let Some(quantity) = named(&NAMES, rest).filter(|q| fits(*q, unit)) {
        return Some((quantity, unit, None));
    }
    if BODIES.contains(&plain(name).as_str()) {
        return Some((ColumnQuantity::Body, None, None));
    }
    if let Some(quantity) = named(&PIXELS, rest) {
        return Some((quantity, Some(PIXEL), None));
    }
    if let Some((unit, _)) = TIMES[..2].iter().find(|(_, names)| names[1..].contains(&plain(name).as_str())) {
        return Some((ColumnQuantity::Time, Some(*unit), None));
    }
    let (track, tail) = rest.rsplit_once(SEPARATORS)?;
    let quantity = match plain(tail).as_str() {
        "x" => ColumnQuantity::X,
        "y" => ColumnQuantity::Y,
        "z" => ColumnQuantity::Z,
        "likelihood" => ColumnQuantity::Likelihood,
        _ => return None,
    };
    let track = track.trim_end_matches(SEPARATORS);
    let is_track = !NON_TRACK_NAMES.contains(&spelt(track).as_str());
    (is_track && fits(quantity, unit)).then_some((quantity, unit, Some(track)))
}

/// The unit in a cell below a column's name: `(m)`, `[ms]`, `px`.
pub fn unit_of_cell(cell: &str) -> Option<ColumnUnit> {
    let inside = cell.trim().trim_start_matches(['(', '[']).trim_end_matches([')', ']']);
    unit_named(&LENGTHS, inside).or_else(|| unit_named(&TIMES, inside))
}

/// The unit called `name` among `units`.
pub fn unit_named(units: &[(ColumnUnit, &[&str])], name: &str) -> Option<ColumnUnit> {
    let name = name.trim().to_lowercase();
    units.iter().find(|(_, names)| names.contains(&name.as_str())).map(|(unit, _)| *unit)
}

const PIXEL: ColumnUnit = ColumnUnit { name: "px", size: None };
const SEPARATORS: [char; 5] = ['/', '_', ' ', '.', '-'];

const fn unit(name: &'static str, size: f64) -> ColumnUnit {
    ColumnUnit { name, size: Some(size) }
}

/// Splits a name into name and unit: `Time (s)`, `X [m]`, `x/m`, `x_px`.
fn without_unit(name: &str) -> (&str, Option<ColumnUnit>) {
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

/// Whether a unit matches the quantity.
pub fn fits(quantity: ColumnQuantity, unit: Option<ColumnUnit>) -> bool {
    let among =
        |units: &[(ColumnUnit, &[&str])]| unit.is_none_or(|u| units.iter().any(|(known, _)| *known == u));
    match quantity {
        ColumnQuantity::Time | ColumnQuantity::Interval => among(&TIMES),
        ColumnQuantity::X
        | ColumnQuantity::Y
        | ColumnQuantity::Z
        | ColumnQuantity::Height
        | ColumnQuantity::Distance
        | ColumnQuantity::Radius
        | ColumnQuantity::Diameter => among(&LENGTHS),
        _ => unit.is_none(),
    }
}

fn named(names: &[(ColumnQuantity, &[&str])], name: &str) -> Option<ColumnQuantity> {
    let name = plain(name);
    names.iter().find(|(_, all)| all.contains(&name.as_str())).map(|(quantity, _)| *quantity)
}

/// As [`plain`], but keeps the case of a single letter.
fn spelt(name: &str) -> String {
    if name.chars().count() == 1 { name.to_string() } else { plain(name) }
}

/// Lower case without separators.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !SEPARATORS.contains(c)).flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_names_of_tracking_programs() {
        let cases = [
            ("t", ColumnQuantity::Time, None, None),
            ("Time (s)", ColumnQuantity::Time, Some("s"), None),
            ("time_ms", ColumnQuantity::Time, Some("ms"), None),
            ("Milliseconds", ColumnQuantity::Time, Some("ms"), None),
            ("\u{feff}frame", ColumnQuantity::Frame, None, None),
            ("Frame Number", ColumnQuantity::Frame, None, None),
            ("X [m]", ColumnQuantity::X, Some("m"), None),
            ("y (CM)", ColumnQuantity::Y, Some("cm"), None),
            ("x/mm", ColumnQuantity::X, Some("mm"), None),
            ("pos_x", ColumnQuantity::X, None, None),
            ("Position Y (px)", ColumnQuantity::Y, Some("px"), None),
            ("x_px", ColumnQuantity::X, Some("px"), None),
            ("pixely", ColumnQuantity::Y, Some("px"), None),
            ("Ball/0/X", ColumnQuantity::X, None, Some("Ball/0")),
            ("P1_y", ColumnQuantity::Y, None, Some("P1")),
            ("A_x", ColumnQuantity::X, None, Some("A")),
            ("track_id", ColumnQuantity::TrackNumber, None, None),
            ("POSITION_T", ColumnQuantity::Time, None, None),
            ("Slice n°", ColumnQuantity::Frame, None, None),
            ("Data Set 1:Time(s)", ColumnQuantity::Time, Some("s"), None),
            ("VideoAnalysis: X (m)", ColumnQuantity::X, Some("m"), None),
            ("X (m) Run #2", ColumnQuantity::X, Some("m"), None),
            ("ball Z", ColumnQuantity::Z, None, Some("ball")),
            ("dt (ms)", ColumnQuantity::Interval, Some("ms"), None),
            ("cx", ColumnQuantity::X, None, None),
            ("object", ColumnQuantity::Body, None, None),
        ];
        for (name, quantity, unit, track) in cases {
            let found = column(name);
            assert_eq!(found.quantity, Some(quantity), "{name}");
            assert_eq!(found.unit.map(|u| u.name), unit, "{name}");
            assert_eq!(found.track.as_deref(), track, "{name}");
        }
    }

    /// Velocities are not parsed as coordinates, nor is a coordinate in seconds.
    #[test]
    fn ignores_other_names() {
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
