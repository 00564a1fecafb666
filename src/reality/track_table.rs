//! Parser for one body's track from tracking programs and data frames; converts to m and s with y up.
//!
//! Accepts, in addition to this project's own format: separators `,` `;` tab and blanks; decimal commas if the comma is not the
//! separator (or a cell is quoted); comment lines, track names (Tracker) and a table title above the header; a header after `#`
//! (Kinovea, numpy); names and units of columns as in [`columns`](super::columns); empty cells, `nan` and similar for missing values.
//! [`TrackParseOptions`] supply information that a file lacks; the defaults are m, s and y up. Velocities and angles are not read,
//! since such programs derive them from the positions.

use std::collections::{BTreeMap, HashSet};

use super::columns::{ColumnQuantity, TrackColumn};
use super::header::{TableHeader, head};
use super::parse_options::{TrackParseOptions, contradiction};
use super::track_rows::{TrackRow, check_complete, invalid_value};
use super::trials_csv;
use crate::budget::{Budget, checked};
use crate::error::{Error, Result};

/// Parsed table.
pub struct TrackTable {
    /// Rows in contiguous blocks per trial.
    pub rows: Vec<TrackRow>,
    /// Whether a column contains trial names.
    pub names_trials: bool,
    /// Whether the file is in this project's own format.
    pub own_format: bool,
    /// Names of columns that are not read.
    pub unused: Vec<String>,
    /// Whether the units of length and time are declared by the file or the options.
    pub units_declared: [bool; 2],
}

/// Parses a file. `trial` and `body` are the default names; `reading` must be valid.
pub fn read(
    text: &str,
    trial: &str,
    body: &str,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<TrackTable> {
    // Carriage return as line end (old Mac OS).
    let text = if text.contains('\n') { text.to_string() } else { text.replace('\r', "\n") };
    let head = head(&text)?;
    let names: Vec<&str> = head.columns.iter().map(|c| c.name.as_str()).collect();
    if trials_csv::is_header(&names) {
        return own_format(&text, reading, budget);
    }
    let choice = choose(&head, reading)?;
    let records = head.records(&text, budget)?;
    let cut: Vec<&str> =
        records.iter().filter_map(|(_, cells)| cells.get(choice.y).map(String::as_str)).collect();
    check_complete(&text, records.last().map_or(head.line, |(line, _)| *line), cut)?;
    let mut rows = Vec::new();
    let (mut bodies, mut mark) = (Vec::new(), None);
    for record in checked(&records, budget) {
        let (line, cells) = record?;
        if cells.iter().all(|c| c.trim().is_empty()) {
            continue;
        }
        let row = choice.row(&head.columns, *line, cells, &mut mark)?;
        let own = TrackRow { trial: row.0.unwrap_or(trial.into()), body: body.into(), ..row.2 };
        bodies.push(row.1);
        rows.push(own);
    }
    let rows = of_one_body(rows, bodies, reading.track.as_deref().filter(|_| choice.body.is_some()))?;
    let clock = &head.columns[choice.time.0].name;
    Ok(TrackTable {
        rows: by_trial(rows, clock, budget)?,
        names_trials: choice.trial.is_some(),
        own_format: false,
        unused: choice.unused(&head.columns),
        units_declared: choice.units_declared,
    })
}

/// Selected columns with their conversions.
struct TrackSelection {
    /// Size of the time unit, s.
    time: (usize, f64),
    x: usize,
    y: usize,
    /// Size of the coordinates' unit, m.
    length: f64,
    /// 1, or -1 if y points down.
    up: f64,
    trial: Option<usize>,
    setting: Option<usize>,
    body: Option<usize>,
    /// Number of cells per row.
    count: usize,
    units_declared: [bool; 2],
}

fn choose(head: &TableHeader, reading: &TrackParseOptions) -> Result<TrackSelection> {
    let of = |quantity| head.columns.iter().position(|c| c.quantity == Some(quantity));
    let (time, seconds, time_declared) = clock(head, reading)?;
    let body = of(ColumnQuantity::Body);
    let [x, y] = coordinates(head, reading, body.is_some())?;
    let (length, length_declared) = reading.length(head.line, &head.columns[x])?;
    if reading.length(head.line, &head.columns[y])?.0 != length {
        let both = format!("in another unit than {:?}", head.columns[x].name);
        return Err(invalid_value(head.line, &head.columns[y].name, &both, "one unit for both"));
    }
    Ok(TrackSelection {
        time: (time, seconds),
        x,
        y,
        length,
        up: if reading.y_down == Some(true) { -1.0 } else { 1.0 },
        trial: of(ColumnQuantity::Trial),
        setting: of(ColumnQuantity::Setting),
        body,
        count: head.columns.len(),
        units_declared: [length_declared, time_declared],
    })
}

/// Index of the time column, the size of its unit in s, and whether the unit is declared.
fn clock(head: &TableHeader, reading: &TrackParseOptions) -> Result<(usize, f64, bool)> {
    let counts = |c: &TrackColumn| {
        c.quantity == Some(ColumnQuantity::Frame)
            || c.quantity == Some(ColumnQuantity::Time) && c.unit.is_some_and(|u| u.size.is_none())
    };
    let frames = head.columns.iter().position(counts);
    let times = head.columns.iter().position(|c| c.quantity == Some(ColumnQuantity::Time) && !counts(c));
    match (reading.fps, frames, times) {
        (Some(fps), Some(i), _) => Ok((i, 1.0 / fps, true)),
        (Some(fps), None, Some(i)) => match head.columns[i].unit {
            None => Ok((i, 1.0 / fps, true)),
            Some(unit) => Err(contradiction(head.line, &head.columns[i], unit, "`fps` is for frame numbers")),
        },
        (None, _, Some(i)) => {
            let (seconds, is_declared) = reading.time(head.line, &head.columns[i])?;
            Ok((i, seconds, is_declared))
        }
        (_, Some(i), None) => {
            let allowed = "with `fps`, the frame rate; or a column of times";
            Err(invalid_value(head.line, &head.columns[i].name, "a frame number", allowed))
        }
        (_, None, None) => {
            Err(invalid_value(head.line, "header", "without a time", "a column `t` or `time`, or `frame`"))
        }
    }
}

/// Indices of the columns x and y of the selected track; those in pixels if they exist and the size of a pixel is known.
fn coordinates(head: &TableHeader, reading: &TrackParseOptions, bodies: bool) -> Result<[usize; 2]> {
    let pixels = |c: &TrackColumn| c.unit.is_some_and(|u| u.size.is_none());
    let all = |quantity| head.columns.iter().enumerate().filter(move |(_, c)| c.quantity == Some(quantity));
    let mut pairs: Vec<(Option<&str>, bool, [usize; 2])> = Vec::new();
    for (i, x) in all(ColumnQuantity::X) {
        let (track, px) = (x.track.as_deref(), pixels(x));
        let fitting = all(ColumnQuantity::Y).find(|(_, y)| y.track.as_deref() == track && pixels(y) == px);
        if pairs.iter().any(|p| (p.0, p.1) == (track, px)) {
            return Err(invalid_value(
                head.line,
                "header",
                &format!("{:?} twice", x.name),
                "every column once",
            ));
        }
        pairs.extend(fitting.map(|(j, _)| (track, px, [i, j])));
    }
    if pairs.is_empty() {
        let missing = if all(ColumnQuantity::Y).next().is_none() { "y" } else { "x" };
        let value = format!("without a {missing} to go with the other coordinate");
        return Err(invalid_value(
            head.line,
            "header",
            &value,
            "columns `x` and `y` of one track, in one unit",
        ));
    }
    let wanted = reading.metres_per_pixel.is_some() && pairs.iter().any(|p| p.1);
    if pairs.iter().any(|p| p.1 == wanted) {
        pairs.retain(|p| p.1 == wanted);
    }
    if let Some(track) = reading.track.as_deref().filter(|_| !bodies) {
        let known = tracks(&pairs);
        pairs.retain(|p| p.0.is_some_and(|name| name.eq_ignore_ascii_case(track)));
        if pairs.is_empty() {
            return Err(invalid_value(head.line, "track", &format!("{track:?}"), &format!("one of {known}")));
        }
    } else if pairs.iter().any(|p| p.0.is_none()) {
        pairs.retain(|p| p.0.is_none());
    }
    match pairs.as_slice() {
        [(_, _, at)] => Ok(*at),
        _ => {
            let value = format!("with several tracks: {}", tracks(&pairs));
            Err(invalid_value(head.line, "header", &value, "one track; select it with `track`"))
        }
    }
}

fn tracks(pairs: &[(Option<&str>, bool, [usize; 2])]) -> String {
    let named = pairs.iter().map(|p| p.0.map_or("one without a name".into(), |n| format!("{n:?}")));
    named.collect::<Vec<_>>().join(", ")
}

impl TrackSelection {
    /// A row with the names of its trial and body, if any. `mark` is the decimal mark of the rows above.
    fn row(
        &self,
        columns: &[TrackColumn],
        line: usize,
        cells: &[String],
        mark: &mut Option<char>,
    ) -> Result<(Option<String>, Option<String>, TrackRow)> {
        let beyond = cells.get(self.count..).unwrap_or_default().iter().any(|c| !c.trim().is_empty());
        let chosen = [Some(self.time.0), Some(self.x), Some(self.y), self.trial, self.setting, self.body];
        if beyond || chosen.iter().flatten().any(|k| *k >= cells.len()) {
            let allowed =
                format!("{} cells as in the header (decimal commas need another separator)", self.count);
            return Err(invalid_value(line, "", &format!("{} cells", cells.len()), &allowed));
        }
        let mut number = |k: usize, size: f64| -> Result<f64> {
            let value = size
                * parse(&cells[k], mark).map_err(|allowed| {
                    invalid_value(line, &columns[k].name, &format!("{:?}", cells[k].trim()), allowed)
                })?;
            if value.abs() > MAX_ABSOLUTE_VALUE {
                return Err(invalid_value(line, &columns[k].name, &value.to_string(), "up to 1e6 m or s"));
            }
            Ok(value)
        };
        let t = number(self.time.0, self.time.1)?;
        let (x, y) = (number(self.x, self.length)?, number(self.y, self.up * self.length)?);
        if t.is_nan() {
            return Err(invalid_value(line, &columns[self.time.0].name, "missing", "a time"));
        }
        let text = |k: Option<usize>| k.map(|k| cells[k].trim().to_string());
        let trial = text(self.trial);
        if trial.as_deref() == Some("") {
            let name = self.trial.map_or("trial", |k| &columns[k].name);
            return Err(invalid_value(line, name, "missing", "the trial's name"));
        }
        let values = [x, y, f64::NAN, f64::NAN, f64::NAN, f64::NAN];
        let (trial_name, setting) = (String::new(), text(self.setting));
        let row = TrackRow { line, trial: trial_name, setting, body: String::new(), t, values };
        Ok((trial, text(self.body), row))
    }

    /// Names of the columns that are not read.
    fn unused(&self, columns: &[TrackColumn]) -> Vec<String> {
        let read = [Some(self.time.0), Some(self.x), Some(self.y), self.trial, self.setting, self.body];
        let rest =
            columns.iter().enumerate().filter(|(i, c)| !read.contains(&Some(*i)) && !c.name.is_empty());
        rest.map(|(_, c)| c.name.clone()).collect()
    }
}

/// Largest absolute coordinate or time, m or s.
const MAX_ABSOLUTE_VALUE: f64 = 1e6;

/// Parses a number; NaN for a missing value. `mark` is the file's decimal mark, once known.
fn parse(cell: &str, mark: &mut Option<char>) -> std::result::Result<f64, &'static str> {
    let cell = cell.trim();
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

/// Selects the rows of one body; `bodies` are the bodies of the rows.
fn of_one_body(
    rows: Vec<TrackRow>,
    bodies: Vec<Option<String>>,
    track: Option<&str>,
) -> Result<Vec<TrackRow>> {
    let mut known: Vec<&str> = bodies.iter().flatten().map(String::as_str).collect();
    known.sort_unstable();
    known.dedup();
    let listed = known.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
    match track {
        None if known.len() > 1 => {
            let line = rows.first().map_or(1, |r| r.line);
            Err(invalid_value(line, "body", &listed, "one body; select it with `track`"))
        }
        None => Ok(rows),
        Some(track) if !known.iter().any(|n| n.eq_ignore_ascii_case(track)) => {
            Err(Error::input("track", format!("{track:?}"), format!("one of {listed}")))
        }
        Some(track) => {
            let own = |body: &Option<String>| body.as_ref().is_some_and(|b| b.eq_ignore_ascii_case(track));
            Ok(rows.into_iter().zip(bodies).filter(|(_, body)| own(body)).map(|(row, _)| row).collect())
        }
    }
}

/// Groups rows by trial, in order of first occurrence; times must increase.
fn by_trial(rows: Vec<TrackRow>, clock: &str, budget: &dyn Budget) -> Result<Vec<TrackRow>> {
    let mut order: BTreeMap<String, usize> = BTreeMap::new();
    let mut trials: Vec<Vec<TrackRow>> = Vec::new();
    for row in checked(rows, budget) {
        let row = row?;
        let next = order.len();
        let at = *order.entry(row.trial.clone()).or_insert(next);
        if at == trials.len() {
            trials.push(Vec::new());
        }
        if let Some(last) = trials[at].last()
            && row.t <= last.t
        {
            let allowed = format!("a time after {} s; one trial a file, or a column `trial`", last.t);
            return Err(invalid_value(row.line, clock, &format!("{} s", row.t), &allowed));
        }
        trials[at].push(row);
    }
    Ok(trials.into_iter().flatten().collect())
}

/// Parses this project's own format, in the declared units.
fn own_format(text: &str, reading: &TrackParseOptions, budget: &dyn Budget) -> Result<TrackTable> {
    let mut rows = trials_csv::rows(text, budget)?;
    let plain = |name: &str| TrackColumn { name: name.into(), quantity: None, unit: None, track: None };
    let (length, length_declared) = reading.length(1, &plain("x"))?;
    let (time, time_declared) = match reading.fps {
        Some(fps) => (1.0 / fps, true),
        None => reading.time(1, &plain("t"))?,
    };
    if let Some(track) = &reading.track {
        let known: HashSet<&str> = rows.iter().map(|r| r.body.as_str()).collect();
        if !known.contains(track.as_str()) {
            let known = known.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
            return Err(Error::input("track", format!("{track:?}"), format!("one of {known}")));
        }
        rows.retain(|r| r.body == *track);
    }
    let up = if reading.y_down == Some(true) { -1.0 } else { 1.0 };
    for row in &mut rows {
        row.t *= time;
        let sizes = [length, up * length, up, length / time, up * length / time, up / time];
        row.values.iter_mut().zip(sizes).for_each(|(v, size)| *v *= size);
    }
    Ok(TrackTable {
        rows,
        names_trials: true,
        own_format: true,
        unused: Vec::new(),
        units_declared: [length_declared, time_declared],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Unlimited;

    /// Trial, t, x, y by row.
    fn parsed_rows(text: &str, reading: &TrackParseOptions) -> Vec<(String, f64, f64, f64)> {
        let table =
            read(text, "film", "ball", reading, &Unlimited).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        let rounded = |v: f64| (v * 1e9).round() / 1e9;
        table
            .rows
            .into_iter()
            .map(|r| (r.trial, rounded(r.t), rounded(r.values[0]), rounded(r.values[1])))
            .collect()
    }

    fn row(t: f64, x: f64, y: f64) -> (String, f64, f64, f64) {
        ("film".into(), t, x, y)
    }

    #[test]
    fn parses_files_of_tracking_programs() {
        let two = vec![row(0.0, 1.5, 2.0), row(0.04, 1.75, -1.25)];
        let silent = TrackParseOptions::default();
        for text in [
            // Tracker, one mass; with a trailing separator; several masses behind one column of times.
            "mass_A\nt\tx\ty\n0.0E0\t1.5E0\t2.0E0\n4.0E-2\t1.75\t-1.25\n",
            "\tmass A\t\t\t\t\nt\tx\ty\tv_{x}\tstep\t\n0.0\t1.5\t2.0\t\t0\t\n0.04\t1.75\t-1.25\t6.25\t1\t\n",
            // Kinovea: quoted cells, decimal commas; its text for gnuplot.
            "\"Time\";\"Ball/0/X\";\"Ball/0/Y\"\r\n\"0,000\";\"1,5\";\"2,0\"\r\n\"0,040\";\"1,75\";\"-1,25\"\r\n",
            "\"Time\",\"Ball/0/X\",\"Ball/0/Y\"\r\n\"0,000\",\"1,5\",\"2,0\"\r\n\"0,040\",\"1,75\",\"-1,25\"\r\n",
            "#Kinovea Trajectory data export\n#T X Y\n\n# Ball\n0 1.5 2 \n0.04 1.75 -1.25 \n",
            // Data frames: an index without a name; units; other orders; a spreadsheet's hint and its empty last rows.
            ",time,x,y\n0,0.0,1.5,2.0\n1,0.04,1.75,-1.25\n",
            "Time (ms),X [cm],Y [cm]\n0,150,200\n40,175,-125\n",
            "pos_y,pos_x,t_ms\n2,1.5,0\n-1.25,1.75,40\n",
            "\u{feff}sep=;\nTime (s);X (m);Y (m)\n0;1,5;2\n0,04;1,75;-1,25\n;;\n;;\n",
            "# t x y\n0 1.5 2\n0.04 1.75 -1.25",
            "t,x,y\r0,1.5,2\r0.04,1.75,-1.25\r",
        ] {
            assert_eq!(parsed_rows(text, &silent), two, "{text:?}");
        }
    }

    #[test]
    fn options_supply_missing_information() {
        let pixels = TrackParseOptions {
            fps: Some(250.0),
            metres_per_pixel: Some(0.01),
            y_down: Some(true),
            ..TrackParseOptions::default()
        };
        let wanted = vec![row(0.0, 1.5, -2.0), row(0.04, 1.75, -1.25)];
        for text in [
            "frame,x,y\n0,150,200\n10,175,125\n",
            "t;x;y\n0;150;200\n10;175;125\n",
            "frame,x_px,y_px\n0,150,200\n10,175,125\n",
            // Tracker writes both; the pixel columns are used.
            "t,frame,x,y,pixelx,pixely\n0,0,9,9,150,200\n9,10,9,9,175,125\n",
        ] {
            assert_eq!(parsed_rows(text, &pixels), wanted, "{text:?}");
        }
        let units = |length: &str, time: &str| TrackParseOptions {
            length_unit: Some(length.into()),
            time_unit: Some(time.into()),
            ..TrackParseOptions::default()
        };
        assert_eq!(
            parsed_rows("t,x,y\n0,1500,2000\n40,1750,-1250\n", &units("mm", "ms")),
            [row(0.0, 1.5, 2.0), row(0.04, 1.75, -1.25)]
        );
        // Also in this project's own format, including velocities and angles.
        let own = "trial,t,body,x,y,angle,vx,vy,omega\na,50,ball,150,200,1,10,20,3\n";
        let table =
            read(own, "film", "x", &TrackParseOptions { fps: Some(100.0), ..pixels }, &Unlimited).unwrap();
        let r = &table.rows[0];
        assert_eq!((r.trial.as_str(), r.body.as_str(), r.t), ("a", "ball", 0.5));
        assert_eq!(r.values, [1.5, -2.0, -1.0, 10.0, -20.0, -300.0]);
    }

    #[test]
    fn keeps_missing_values_and_reports_unused_columns() {
        let text = "t,x,y,vx,label\n0,1,2,5,a\n1,,3,5,b\n2,nan,,5,c\n3,4,5,,d\n";
        let table = read(text, "film", "ball", &TrackParseOptions::default(), &Unlimited).unwrap();
        let missing: Vec<[bool; 2]> =
            table.rows.iter().map(|r| [r.values[0].is_nan(), r.values[1].is_nan()]).collect();
        assert_eq!(missing, [[false, false], [true, false], [true, true], [false, false]]);
        assert!(table.rows.iter().all(|r| r.values[2..].iter().all(|v| v.is_nan())));
        assert_eq!(
            (table.unused, table.units_declared),
            (vec!["vx".to_string(), "label".into()], [false, false])
        );
    }

    /// Rows may be grouped by frame.
    #[test]
    fn separates_trials_and_tracks() {
        let text = "frame,y,x,particle\n0,2,1,0\n0,4,3,1\n1,2.5,1.5,0\n1,4.5,3.5,1\n";
        let fps = TrackParseOptions { fps: Some(10.0), ..TrackParseOptions::default() };
        let own = |trial: &str, t, x, y| (trial.to_string(), t, x, y);
        let wanted = [
            own("0", 0.0, 1.0, 2.0),
            own("0", 0.1, 1.5, 2.5),
            own("1", 0.0, 3.0, 4.0),
            own("1", 0.1, 3.5, 4.5),
        ];
        assert_eq!(parsed_rows(text, &fps), wanted);
        let multi = "#multi:\n\tcm A\t\tcm B\t\t\nt\tx\ty\tx\ty\t\n0\t1\t2\t3\t4\n1\t5\t6\t7\t8\n";
        let of =
            |track: &str| TrackParseOptions { track: Some(track.into()), ..TrackParseOptions::default() };
        assert_eq!(parsed_rows(multi, &of("cm b")), [row(0.0, 3.0, 4.0), row(1.0, 7.0, 8.0)]);
        let bodies = "t,object,x,y\n0,red,1,2\n0,blue,3,4\n1,red,5,6\n";
        assert_eq!(parsed_rows(bodies, &of("red")), [row(0.0, 1.0, 2.0), row(1.0, 5.0, 6.0)]);
    }

    #[test]
    fn errors_name_line_column_and_what_is_allowed() {
        let silent = TrackParseOptions::default;
        let px = || TrackParseOptions { metres_per_pixel: Some(0.01), ..silent() };
        let cases = [
            ("a,b\n1,2\n", silent(), "1: `header` is \"a,b\"; allowed: a line that names the columns"),
            ("0,1,2\n1,1,2\n", silent(), "allowed: a line that names the columns"),
            ("", silent(), "`header` is \"empty\""),
            ("t,x\n0,1\n", silent(), "1: `header` is without a y"),
            ("t,x,y,x\n0,1,2,3\n", silent(), "\"x\" twice"),
            ("frame,x,y\n0,1,2\n", silent(), "1: `frame` is a frame number; allowed: with `fps`"),
            ("t,x_px,y_px\n0,1,2\n", silent(), "1: `x_px` is in pixels; allowed: with `metres_per_pixel`"),
            ("t,x (m),y (m)\n0,1,2\n", px(), "1: `x (m)` is in m; "),
            ("t,x (m),y (cm)\n0,1,2\n", silent(), "`y (cm)` is in another unit than \"x (m)\""),
            ("Time (s),x,y\n0,1,2\n", TrackParseOptions { fps: Some(9.0), ..silent() }, "`Time (s)` is in s"),
            (
                "title\nt,pos x,y\n0,1,2\n1,two,2\n",
                silent(),
                "4: `pos x` is \"two\"; allowed: a number, or nothing",
            ),
            (
                "t;x;y\n0;1,5;2\n1;1.5;2\n",
                silent(),
                "3: `x` is \"1.5\"; allowed: the decimal mark of the rows above",
            ),
            ("t;x;y\n0;1.000,5;2\n", silent(), "separators of thousands"),
            (
                "#T X Y\n0:00:00:03 1 2\n",
                silent(),
                "2: `T` is \"0:00:00:03\"; allowed: a number: times in s or ms",
            ),
            ("t,x,y\n0,1,5,2,0\n", silent(), "2: 5 cells; allowed: 3 cells as in the header (decimal commas"),
            ("t,x,y\n0,1\n", silent(), "2: 2 cells"),
            ("t,x,y\n,1,2\n", silent(), "2: `t` is missing"),
            (
                "t,x,y\n0,1,2\n0.5,1,2\n0.1,1,2\n",
                silent(),
                "4: `t` is 0.1 s; allowed: a time after 0.5 s; one trial a file",
            ),
            ("t,x,y\n0,1e9,2\n", silent(), "2: `x` is 1000000000; allowed: up to 1e6"),
            (
                "t,A_x,A_y,B_x,B_y\n0,1,2,3,4\n",
                silent(),
                "several tracks: \"A\", \"B\"; allowed: one track; select it with `track`",
            ),
            (
                "t,x,y\n0.0,1.00,2.00\n0.1,1.00,2.10\n0.2,1.00,2.20\n0.3,1.00,2.",
                silent(),
                "5: allowed: a complete last line",
            ),
            ("trial,t,body,x,y\na,0,b,1,oops\n", silent(), "2: `y` is \"oops\""),
        ];
        for (text, reading, wanted) in cases {
            let error =
                read(text, "film", "ball", &reading, &Unlimited).map(|_| ()).expect_err(text).to_string();
            assert!(error.contains(wanted), "{text:?} gives {error:?}, without {wanted:?}");
        }
    }
}
