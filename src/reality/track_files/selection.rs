//! Choice of the columns of one body's track, and their conversion to m and s.

use super::columns::{ColumnQuantity, TrackColumn, column_in_pixels};
use super::parse_options::{TrackParseOptions, contradiction};
use super::table::Table;
use super::times::{TrackClock, last_place};
use super::track_rows::{TrackRow, invalid_value};
use crate::error::Result;

/// Selected columns with their conversions.
pub struct TrackSelection {
    pub clock: TrackClock,
    /// Name of the column of times.
    pub clock_name: String,
    /// Whether the clock is a column of times, which may be rounded.
    pub has_times: bool,
    axes: AxisColumns,
    likelihood: Option<usize>,
    /// Size of the coordinates' unit, m.
    length: f64,
    /// 1, or -1 if y points down.
    up: f64,
    pub trial: Option<usize>,
    /// Whether rows without a trial are no error.
    trial_may_be_missing: bool,
    setting: Option<usize>,
    pub body: Option<usize>,
    /// Number of cells per row.
    count: usize,
    /// Whether the units of length and time are declared by the file or the options.
    pub units_declared: [bool; 2],
}

/// Columns of the coordinates of one track. Where only a height or a distance along a track was measured, the other coordinate is 0.
#[derive(Clone, Copy)]
struct AxisColumns {
    x: Option<usize>,
    y: Option<usize>,
    z: Option<usize>,
}

impl AxisColumns {
    fn all(&self) -> impl Iterator<Item = usize> {
        [self.x, self.y, self.z].into_iter().flatten()
    }
}

/// A row of the selected columns.
pub struct SelectedRow {
    /// `trial` and `body` are empty.
    pub row: TrackRow,
    pub trial: Option<String>,
    pub body: Option<String>,
    /// Third coordinate, m; NaN if there is none.
    pub z: f64,
    /// Size of the last decimal place of the time, s; 0 if unknown.
    pub place: f64,
    /// Whether the point is missing because its likelihood is low.
    pub is_unlikely: bool,
}

/// Likelihood below which a detection is missing: the default of DeepLabCut.
pub const MIN_LIKELIHOOD: f64 = 0.6;
/// Largest absolute coordinate or time, m or s.
const MAX_ABSOLUTE_VALUE: f64 = 1e6;

/// Chooses the columns of the track that `options` select.
pub fn choose(table: &Table, options: &TrackParseOptions) -> Result<TrackSelection> {
    let of = |quantity| table.columns.iter().position(|c| c.quantity == Some(quantity));
    let (clock, clock_declared) = clock(table, options)?;
    let body = of(ColumnQuantity::Body);
    let axes = axes(table, options, body.is_some())?;
    let line = table.header_line;
    let first = axes.all().next().expect("a track has a coordinate");
    let (length, length_declared) = options.length(line, &table.columns[first])?;
    for other in axes.all().skip(1) {
        if options.length(line, &table.columns[other])?.0 != length {
            let both = format!("in another unit than {:?}", table.columns[first].name);
            return Err(invalid_value(line, &table.columns[other].name, &both, "one unit for all"));
        }
    }
    let track = &table.columns[first].track;
    let numbers = of(ColumnQuantity::TrackNumber);
    let clock_column = clock.column().map(|(i, _)| &table.columns[i]);
    Ok(TrackSelection {
        clock,
        clock_name: clock_column.map_or(String::new(), |c| c.name.clone()),
        has_times: clock_column.is_some_and(|c| c.quantity == Some(ColumnQuantity::Time)),
        axes,
        likelihood: (0..table.columns.len()).find(|i| {
            let column = &table.columns[*i];
            column.quantity == Some(ColumnQuantity::Likelihood) && column.track == *track
        }),
        length,
        up: if options.y_down == Some(true) { -1.0 } else { 1.0 },
        trial: of(ColumnQuantity::Trial).or(numbers),
        trial_may_be_missing: of(ColumnQuantity::Trial).is_none(),
        setting: of(ColumnQuantity::Setting),
        body,
        count: table.columns.len(),
        units_declared: [length_declared, clock_declared],
    })
}

/// The clock, and whether its unit is declared.
fn clock(table: &Table, options: &TrackParseOptions) -> Result<(TrackClock, bool)> {
    let line = table.header_line;
    let counts = |c: &TrackColumn| {
        c.quantity == Some(ColumnQuantity::Frame)
            || c.quantity == Some(ColumnQuantity::Time) && c.unit.is_some_and(|u| u.size.is_none())
    };
    let of = |quantity| table.columns.iter().position(|c| c.quantity == Some(quantity) && !counts(c));
    let frames = table.columns.iter().position(counts);
    let times = of(ColumnQuantity::Time);
    if let Some(fps) = options.fps {
        return match (frames, times) {
            (Some(i), _) => Ok((TrackClock::Column(i, 1.0 / fps), true)),
            (None, Some(i)) => match table.columns[i].unit {
                None => Ok((TrackClock::Column(i, frame_or_second(table, i, fps)), true)),
                Some(unit) => Err(contradiction(line, &table.columns[i], unit, "`fps` is for frame numbers")),
            },
            (None, None) => Ok((TrackClock::Rows(1.0 / fps), true)),
        };
    }
    if let Some(i) = times {
        let (seconds, is_declared) = options.time(line, &table.columns[i])?;
        return Ok((TrackClock::Column(i, seconds), is_declared));
    }
    if let Some(i) = of(ColumnQuantity::Interval) {
        let (seconds, is_declared) = options.time(line, &table.columns[i])?;
        return Ok((TrackClock::Intervals(i, seconds), is_declared));
    }
    match (frames, table.frame_rate) {
        (Some(i), Some(rate)) => Ok((TrackClock::Column(i, 1.0 / rate), true)),
        (None, Some(rate)) => Ok((TrackClock::Rows(1.0 / rate), true)),
        (Some(i), None) => {
            let allowed = "with `fps`, the frame rate; or a column of times";
            Err(invalid_value(line, &table.columns[i].name, "a frame number", allowed))
        }
        (None, None) => {
            let allowed = "a column `t` or `time`, or `frame`; or `fps`, if each row is a frame";
            Err(invalid_value(line, "header", "without a time", allowed))
        }
    }
}

/// Largest deviation of seconds between rows from the frame rate, relative.
const FRAME_RATE_TOLERANCE: f64 = 0.05;

/// Size of the unit of a column without one beside a frame rate, s: it counts frames, or it has the seconds of that rate.
fn frame_or_second(table: &Table, column: usize, fps: f64) -> f64 {
    let value = |cells: &[String]| parse(cells.get(column)?, &mut None).ok().filter(|v| v.is_finite());
    let values: Vec<f64> = table.records.iter().filter_map(|(_, cells)| value(cells)).collect();
    if values.iter().all(|v| v.fract() == 0.0) {
        return 1.0 / fps;
    }
    let mut steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let step = steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN);
    let has_seconds = (step * fps - 1.0).abs() < FRAME_RATE_TOLERANCE;
    if has_seconds { 1.0 } else { 1.0 / fps }
}

/// Coordinate columns of one track of a file, in pixels or not.
struct FileTrack<'a> {
    name: Option<&'a str>,
    in_pixels: bool,
    axes: AxisColumns,
}

/// All tracks of a file.
fn file_tracks(table: &Table) -> Result<Vec<FileTrack<'_>>> {
    use ColumnQuantity::{X, Y, Z};
    let invalid =
        |value: &str, allowed: &str| Err(invalid_value(table.header_line, "header", value, allowed));
    let in_pixels = column_in_pixels;
    let mut tracks: Vec<FileTrack> = Vec::new();
    let mut missing = "x";
    for column in table.columns.iter().filter(|c| matches!(c.quantity, Some(X | Y | Z))) {
        let (name, pixels) = (column.track.as_deref(), in_pixels(column));
        let of = |quantity| -> Vec<usize> {
            let is_own = |c: &TrackColumn| {
                c.quantity == Some(quantity) && c.track.as_deref() == name && in_pixels(c) == pixels
            };
            (0..table.columns.len()).filter(|i| is_own(&table.columns[*i])).collect()
        };
        let [x, y, z] = [X, Y, Z].map(of);
        if let Some(twice) = [&x, &y, &z].into_iter().find(|c| c.len() > 1) {
            return invalid(&format!("{:?} twice", table.columns[twice[0]].name), "every column once");
        }
        // Where only two of three coordinates are given, they are across and up.
        let axes = match (x.first(), y.first(), z.first()) {
            (Some(x), Some(y), z) => AxisColumns { x: Some(*x), y: Some(*y), z: z.copied() },
            (Some(across), None, Some(up)) | (None, Some(across), Some(up)) => {
                AxisColumns { x: Some(*across), y: Some(*up), z: None }
            }
            _ => {
                missing = if y.is_empty() { "y" } else { "x" };
                continue;
            }
        };
        if !tracks.iter().any(|t| (t.name, t.in_pixels) == (name, pixels)) {
            tracks.push(FileTrack { name, in_pixels: pixels, axes });
        }
    }
    if tracks.is_empty()
        && let Some((i, axes)) = single_coordinate(table)
    {
        let column = &table.columns[i];
        tracks.push(FileTrack { name: column.track.as_deref(), in_pixels: in_pixels(column), axes });
    }
    if tracks.is_empty() {
        let value = format!("without a {missing} to go with the other coordinate");
        return invalid(
            &value,
            "columns `x` and `y` of one track, in one unit; or one column `height` or `distance`",
        );
    }
    Ok(tracks)
}

/// The only coordinate of a file: a height or a distance along a track.
fn single_coordinate(table: &Table) -> Option<(usize, AxisColumns)> {
    use ColumnQuantity::{Distance, Height, X, Y, Z};
    let of = |quantities: &[ColumnQuantity]| -> Vec<usize> {
        let is_one = |i: &usize| table.columns[*i].quantity.is_some_and(|q| quantities.contains(&q));
        (0..table.columns.len()).filter(is_one).collect()
    };
    let named = of(&[X, Y, Z]);
    let all = if named.is_empty() { of(&[Height, Distance]) } else { named };
    let [only] = *all else { return None };
    let none = AxisColumns { x: None, y: None, z: None };
    let axes = match table.columns[only].quantity {
        Some(X | Distance) => AxisColumns { x: Some(only), ..none },
        _ => AxisColumns { y: Some(only), ..none },
    };
    Some((only, axes))
}

/// Coordinate columns of the selected track; those in pixels if they exist and the size of a pixel is known.
fn axes(table: &Table, options: &TrackParseOptions, has_bodies: bool) -> Result<AxisColumns> {
    let mut tracks = file_tracks(table)?;
    let wanted = options.metres_per_pixel.is_some() && tracks.iter().any(|t| t.in_pixels);
    if tracks.iter().any(|t| t.in_pixels == wanted) {
        tracks.retain(|t| t.in_pixels == wanted);
    }
    let names = |tracks: &[FileTrack]| {
        let named = tracks.iter().map(|t| t.name.map_or("one without a name".into(), |n| format!("{n:?}")));
        named.collect::<Vec<_>>().join(", ")
    };
    if let Some(track) = options.track.as_deref().filter(|_| !has_bodies) {
        let known = names(&tracks);
        tracks.retain(|t| t.name.is_some_and(|name| name.eq_ignore_ascii_case(track)));
        if tracks.is_empty() {
            let allowed = format!("one of {known}");
            return Err(invalid_value(table.header_line, "track", &format!("{track:?}"), &allowed));
        }
    } else if tracks.iter().any(|t| t.name.is_none()) {
        tracks.retain(|t| t.name.is_none());
    }
    match tracks.as_slice() {
        [track] => Ok(track.axes),
        _ => {
            let value = format!("with several tracks: {}", names(&tracks));
            Err(invalid_value(table.header_line, "header", &value, "one track; select it with `track`"))
        }
    }
}

impl TrackSelection {
    /// The selected columns, where there are any.
    fn selected(&self) -> [Option<usize>; 8] {
        let clock = self.clock.column().map(|(i, _)| i);
        let AxisColumns { x, y, z } = self.axes;
        [clock, x, y, z, self.likelihood, self.trial, self.setting, self.body]
    }

    /// The cell of the height in a row.
    pub fn height<'a>(&self, cells: &'a [String]) -> Option<&'a str> {
        cells.get(self.axes.y.or(self.axes.x)?).map(String::as_str)
    }

    /// The coordinate that was not measured, if any.
    pub fn missing_coordinate(&self) -> Option<&'static str> {
        match self.axes {
            AxisColumns { x: None, .. } => Some("across"),
            AxisColumns { y: None, .. } => Some("up"),
            _ => None,
        }
    }

    /// Names of the columns that are not read.
    pub fn unused(&self, columns: &[TrackColumn]) -> Vec<String> {
        let read = self.selected();
        let rest =
            columns.iter().enumerate().filter(|(i, c)| !read.contains(&Some(*i)) && !c.name.is_empty());
        rest.map(|(_, c)| c.name.clone()).collect()
    }

    /// Converts a row; `None` if it belongs to no trial. `marks` are the decimal marks of times and
    /// coordinates in the rows above: Kinovea writes times with a point beside coordinates with a comma.
    pub fn row(
        &self,
        columns: &[TrackColumn],
        line: usize,
        cells: &[String],
        marks: &mut [Option<char>; 2],
    ) -> Result<Option<SelectedRow>> {
        let beyond = cells.get(self.count..).unwrap_or_default().iter().any(|c| !c.trim().is_empty());
        if beyond || self.selected().iter().flatten().any(|k| *k >= cells.len()) {
            let allowed =
                format!("{} cells as in the header (decimal commas need another separator)", self.count);
            return Err(invalid_value(line, "", &format!("{} cells", cells.len()), &allowed));
        }
        let mut number = |k: usize, size: f64| -> Result<f64> {
            let is_time = self.clock.column().is_some_and(|(i, _)| i == k);
            let value = size
                * parse(&cells[k], &mut marks[usize::from(is_time)]).map_err(|allowed| {
                    invalid_value(line, &columns[k].name, &format!("{:?}", cells[k].trim()), allowed)
                })?;
            if value.abs() > MAX_ABSOLUTE_VALUE {
                return Err(invalid_value(line, &columns[k].name, &value.to_string(), "up to 1e6 m or s"));
            }
            Ok(value)
        };
        let t = self.clock.column().map_or(Ok(0.0), |(k, seconds)| number(k, seconds))?;
        // A coordinate without a column is missing where the other one is.
        let mut coordinate = |k: Option<usize>, size: f64| k.map(|k| number(k, size)).transpose();
        let [x, y] = [coordinate(self.axes.x, self.length)?, coordinate(self.axes.y, self.up * self.length)?];
        let other = |own: Option<f64>| own.map_or(0.0, |own| 0.0 * own);
        let (mut x, mut y) = (x.unwrap_or_else(|| other(y)), y.unwrap_or_else(|| other(x)));
        let z = self.axes.z.map_or(Ok(f64::NAN), |k| number(k, self.length))?;
        let likelihood = self.likelihood.map_or(Ok(1.0), |k| number(k, 1.0))?;
        if t.is_nan() {
            return Err(invalid_value(line, &self.clock_name, "missing", "a time"));
        }
        let text = |k: Option<usize>| k.map(|k| cells[k].trim().to_string());
        let trial = text(self.trial);
        if trial.as_deref().is_some_and(|name| name.is_empty() || name == "None") {
            if self.trial_may_be_missing {
                return Ok(None);
            }
            let name = self.trial.map_or("trial", |k| &columns[k].name);
            return Err(invalid_value(line, name, "missing", "the trial's name"));
        }
        let is_unlikely = likelihood < MIN_LIKELIHOOD && x.is_finite();
        if is_unlikely {
            (x, y) = (f64::NAN, f64::NAN);
        }
        let values = [x, y, f64::NAN, f64::NAN, f64::NAN, f64::NAN];
        let (name, setting, body) = (String::new(), text(self.setting), String::new());
        let place = self.clock.column().map_or(0.0, |(k, seconds)| seconds * last_place(&cells[k]));
        let row = TrackRow { line, trial: name, setting, body, t, values };
        Ok(Some(SelectedRow { row, trial, body: text(self.body), z, place, is_unlikely }))
    }
}

/// Parses a number; NaN for a missing value. `mark` is the file's decimal mark, once known.
pub fn parse(cell: &str, mark: &mut Option<char>) -> std::result::Result<f64, &'static str> {
    let cell = cell.trim().trim_matches('"');
    if ["", "-", "nan", "na", "n/a", "null", "none"].contains(&cell.to_lowercase().as_str()) {
        return Ok(f64::NAN);
    }
    let own = match (cell.contains('.'), cell.contains(',')) {
        (true, true) => return Err("a number without separators of thousands"),
        (true, false) => Some('.'),
        (false, true) => Some(','),
        (false, false) => None,
    };
    if let (Some(own), Some(mark)) = (own, *mark)
        && own != mark
    {
        return Err("the decimal mark of the rows above");
    }
    *mark = own.or(*mark);
    match cell.replace(',', ".").parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ if cell.contains(':') => Err("a number: times in s or ms, not as a timecode"),
        _ => Err("a number, or nothing"),
    }
}
