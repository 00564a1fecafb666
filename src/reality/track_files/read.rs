//! Reads one body's track from a file of a tracking program or a data frame; converts to m and s with y up.
//!
//! Accepts, in addition to this project's own format, the formats of [`formats`](super::formats) and tables with: separators `,` `;` tab
//! and blanks; decimal commas if the comma is not the separator (or a cell is quoted); comment lines, track names (Tracker), titles
//! above the header; lines of units below it; a header after `#` (Kinovea, numpy); names and units of columns as in
//! [`columns`](super::columns); several runs side by side (Logger Pro); empty cells, `nan` and similar for missing values; times
//! rounded to few decimals. [`TrackParseOptions`] supply information that a file lacks; the defaults are m, s and y up. Velocities
//! and angles are not read, since such programs derive them from the positions.

use std::collections::{BTreeMap, HashSet};

use super::columns::TrackColumn;
use super::formats::table;
use super::parse_options::TrackParseOptions;
use super::repeated_frames::{Picture, without_repeats};
use super::selection::{MIN_LIKELIHOOD, SelectedRow, TrackSelection, choose};
use super::size::MAX_COLUMNS;
use super::table::Table;
use super::times::{check_increasing, undo_rounding};
use super::track_rows::{TrackRow, check_complete, invalid_value};
use crate::budget::{Budget, checked};
use crate::error::{Error, Result};
use crate::reality::trials_csv;

/// A track as read.
pub struct TrackTable {
    /// Name of the file.
    pub file: String,
    /// Rows in contiguous blocks per trial.
    pub rows: Vec<TrackRow>,
    /// Third coordinate of each row, m; empty if there is none.
    pub z: Vec<f64>,
    /// Whether a column contains trial names.
    pub names_trials: bool,
    /// Whether the file is in this project's own format.
    pub own_format: bool,
    /// Remarks for the user.
    pub notes: Vec<String>,
    /// Whether the units of length and time are declared by the file or the options.
    pub units_declared: [bool; 2],
    /// Whether the coordinates are in pixels.
    pub in_pixels: bool,
}

impl TrackTable {
    /// Rows of a file in this project's own format.
    pub fn in_own_format(rows: Vec<TrackRow>, units_declared: [bool; 2]) -> TrackTable {
        TrackTable {
            file: String::new(),
            rows,
            z: Vec::new(),
            names_trials: true,
            own_format: true,
            notes: Vec::new(),
            units_declared,
            in_pixels: false,
        }
    }
}

/// Reads a file. `trial` and `body` are the default names; `options` must be valid.
pub fn read(
    text: &str,
    trial: &str,
    body: &str,
    options: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<TrackTable> {
    // Carriage return as line end (old Mac OS).
    let text = if text.contains('\n') { text.to_string() } else { text.replace('\r', "\n") };
    let first = text.lines().next().unwrap_or_default().trim_start_matches('\u{feff}');
    if trials_csv::is_header(&first.split(',').map(str::trim).collect::<Vec<_>>()) {
        return own_format(&text, options, budget);
    }
    let mut runs = Vec::new();
    let table = table(&text, options.columns.as_deref(), budget)?;
    if table.columns.len() > MAX_COLUMNS {
        let value = format!("{} columns", table.columns.len());
        return Err(invalid_value(
            table.header_line,
            "header",
            &value,
            &format!("at most {MAX_COLUMNS} columns"),
        ));
    }
    for (run, table) in table.by_run() {
        let name = run.as_deref().unwrap_or(trial);
        let mut read = read_table(&text, &table, name, body, options, budget)?;
        read.names_trials |= run.is_some();
        runs.push(read);
    }
    let mut runs = runs.into_iter();
    let mut all = runs.next().expect("a table has at least one run");
    for run in runs {
        all.rows.extend(run.rows);
        all.z.extend(run.z);
    }
    Ok(all)
}

fn read_table(
    text: &str,
    table: &Table,
    trial: &str,
    body: &str,
    options: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<TrackTable> {
    let selection = choose(table, options)?;
    if let Some((last, _)) = table.records.last() {
        let cells = table.records.iter().filter_map(|(_, cells)| selection.height(cells));
        check_complete(text, *last, cells)?;
    }
    let mut rows = Vec::new();
    let (mut marks, mut without_trial) = ([None; 2], 0);
    for record in checked(&table.records, budget) {
        let (line, cells) = record?;
        if cells.iter().all(|c| c.trim().is_empty()) {
            continue;
        }
        match selection.row(&table.columns, *line, cells, &mut marks)? {
            Some(mut selected) => {
                selected.row.trial = selected.trial.take().unwrap_or(trial.into());
                selected.row.body = body.into();
                rows.push(selected);
            }
            None => without_trial += 1,
        }
    }
    let rows = of_one_body(rows, options.track.as_deref().filter(|_| selection.body.is_some()))?;
    let unlikely = rows.iter().filter(|r| r.is_unlikely).count();
    let has_z = rows.iter().any(|r| r.z.is_finite());
    let mut trials = by_trial(rows, budget)?;
    let rounded = complete_times(&mut trials, &selection)?;
    let mut notes = table.notes.clone();
    notes.extend(drop_repeats(&mut trials));
    let unused = selection.unused(&table.columns);
    if !unused.is_empty() {
        let names: Vec<String> = unused.iter().map(|n| format!("{n:?}")).collect();
        notes.push(format!("unused columns: {}", names.join(", ")));
    }
    if let Some(missing) = selection.missing_coordinate() {
        let text = "one coordinate was measured; effects that act";
        notes.push(format!("{text} {missing} are not candidates"));
    }
    if let Some(step) = rounded.first() {
        let count = rounded.len();
        notes.push(format!(
            "times of {count} trials are rounded; they are taken as equal steps of {step:.5} s"
        ));
    }
    if unlikely > 0 {
        notes.push(format!("{unlikely} points with a likelihood below {MIN_LIKELIHOOD} are missing values"));
    }
    if without_trial > 0 {
        notes.push(format!("{without_trial} rows belong to no track and are left out"));
    }
    let z = trials.iter().flatten().map(|r| r.z).filter(|_| has_z).collect();
    Ok(TrackTable {
        file: String::new(),
        rows: trials.into_iter().flatten().map(|r| r.row).collect(),
        z,
        names_trials: selection.trial.is_some(),
        own_format: false,
        notes,
        units_declared: selection.units_declared,
        in_pixels: options.metres_per_pixel.is_some(),
    })
}

/// Completes the times of each trial; returns the steps of those whose times were rounded, s.
fn complete_times(trials: &mut [Vec<SelectedRow>], selection: &TrackSelection) -> Result<Vec<f64>> {
    let mut rounded = Vec::new();
    for rows in trials {
        let place = rows.iter().map(|r| r.place).fold(f64::INFINITY, f64::min);
        let mut own: Vec<TrackRow> = rows.iter_mut().map(|r| std::mem::take(&mut r.row)).collect();
        selection.clock.complete(&mut own);
        if selection.has_times && place.is_finite() && place > 0.0 {
            rounded.extend(undo_rounding(&mut own, place));
        }
        check_increasing(&own, &selection.clock_name)?;
        rows.iter_mut().zip(own).for_each(|(r, row)| r.row = row);
    }
    Ok(rounded)
}

/// Leaves out pictures that repeat the one before, in films whose frame rate was converted that way.
fn drop_repeats(trials: &mut [Vec<SelectedRow>]) -> Option<String> {
    let mut remark = None;
    for rows in trials {
        let pictures: Vec<Picture> =
            rows.iter().map(|r| (r.row.t, [r.row.values[0], r.row.values[1]])).collect();
        let Some(found) = without_repeats(&pictures) else { continue };
        let mut kept = found.kept.iter().peekable();
        let mut i = 0;
        rows.retain_mut(|r| {
            let time = kept.next_if(|k| k.0 == i).map(|k| k.1);
            i += 1;
            r.row.t = time.unwrap_or(r.row.t);
            time.is_some()
        });
        let rate = (rows.len() - 1) as f64 / (rows[rows.len() - 1].row.t - rows[0].row.t);
        remark.get_or_insert_with(|| {
            format!(
                "one of {} pictures repeats the one before; repeats are left out and the others spaced evenly, {rate:.1} a second",
                found.period
            )
        });
    }
    remark
}

/// Selects the rows of one body.
fn of_one_body(rows: Vec<SelectedRow>, track: Option<&str>) -> Result<Vec<SelectedRow>> {
    let mut known: Vec<&str> = rows.iter().filter_map(|r| r.body.as_deref()).collect();
    known.sort_unstable();
    known.dedup();
    let listed = known.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
    match track {
        None if known.len() > 1 => {
            let line = rows.first().map_or(1, |r| r.row.line);
            Err(invalid_value(line, "body", &listed, "one body; select it with `track`"))
        }
        None => Ok(rows),
        Some(track) if !known.iter().any(|n| n.eq_ignore_ascii_case(track)) => {
            Err(Error::input("track", format!("{track:?}"), format!("one of {listed}")))
        }
        Some(track) => {
            let own = |r: &SelectedRow| r.body.as_ref().is_some_and(|b| b.eq_ignore_ascii_case(track));
            Ok(rows.into_iter().filter(own).collect())
        }
    }
}

/// Groups rows by trial, in order of first occurrence.
fn by_trial(rows: Vec<SelectedRow>, budget: &dyn Budget) -> Result<Vec<Vec<SelectedRow>>> {
    let mut order: BTreeMap<String, usize> = BTreeMap::new();
    let mut trials: Vec<Vec<SelectedRow>> = Vec::new();
    for row in checked(rows, budget) {
        let row = row?;
        let next = order.len();
        let at = *order.entry(row.row.trial.clone()).or_insert(next);
        if at == trials.len() {
            trials.push(Vec::new());
        }
        trials[at].push(row);
    }
    Ok(trials)
}

/// Parses this project's own format, in the declared units.
fn own_format(text: &str, reading: &TrackParseOptions, budget: &dyn Budget) -> Result<TrackTable> {
    let mut rows = trials_csv::rows(text, budget)?;
    let plain = TrackColumn::other;
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
    Ok(TrackTable::in_own_format(rows, [length_declared, time_declared]))
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
        assert_eq!(table.notes, ["unused columns: \"vx\", \"label\""]);
        assert_eq!(table.units_declared, [false, false]);
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
            ("t,x,z_px\n0,1,2\n", silent(), "1: `header` is without a y"),
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
