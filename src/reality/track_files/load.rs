//! Converts track files into trials of a given scene, or of a scene built for a single ball.

use std::ops::Range;
use std::path::Path;

use super::floor::{
    FilmFloor, FloorEstimate, check_floor, cuts_between_bounces, find_floor, remark_on_bounce,
};
use super::parse_options::{TrackParseOptions, is_pixel_size_missing};
use super::pixel_scale::{pixel_size, turn_upwards, with_suggestion};
use super::read::{self, TrackTable};
use super::size::{MAX_FILES, check_cells};
use super::strokes::free_stretches;
use super::track_rows::{TrackRow, TrialPoints, assemble};
use super::unit_checks::{DeclaredUnits, check_units};
use super::vertical_plane::project;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::reality::{Trial, trials_csv};
use crate::task::Scene;
use crate::task::ball::{BallScene, STANDARD_GRAVITY_M_S2};

/// A track file. Its name appears in errors and is the default name of its trial.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackFile {
    pub name: String,
    pub text: String,
}

/// Subject of the tracks.
#[derive(Clone, Copy, Debug)]
pub enum Subject<'a> {
    Scene(&'a Scene),
    Ball(&'a BallScene),
}

/// Trials with their scene.
#[derive(Clone, Debug)]
pub struct LoadedTrials {
    pub scene: Scene,
    pub trials: Vec<Trial>,
    /// Notes for the user: unused columns, implausible values.
    pub notes: Vec<String>,
    /// Whether all files are in this project's own format, no option is set, and no film is cut.
    pub own_format: bool,
}

/// Parses track files. Files of a scene with several bodies, and those with a header `trial,t,body,x,y`, are in this project's own
/// format; others contain one body's track from a tracking program. Implausible units are errors; if they are declared, or in this
/// project's own format with a given scene, they are notes. Ends early with `budget`.
pub fn load_tracks(
    files: &[TrackFile],
    of: Subject,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<LoadedTrials> {
    reading.validate()?;
    check_files(files)?;
    let one = match of {
        Subject::Scene(scene) => (scene.bodies.len() == 1).then(|| scene.bodies[0].name.as_str()),
        Subject::Ball(_) => Some(BALL),
    };
    let (mut tables, mut notes) = match of {
        Subject::Scene(_) => read_files(files, one, reading, budget)?,
        Subject::Ball(ball) => read_ball(files, ball, reading, budget)?,
    };
    let declared = DeclaredUnits {
        length: tables.iter().all(|t| t.units_declared[0]),
        time: tables.iter().all(|t| t.units_declared[1]),
        up: reading.y_down.is_some(),
    };
    notes.extend(project(&mut tables, reading)?);
    let mut own = tables.iter().all(|t| t.own_format) && matches!(of, Subject::Scene(_));
    let points = points_by_trial(&tables);
    let all_declared = DeclaredUnits { length: true, time: true, up: true };
    let declared = if own { all_declared } else { declared };
    let scene = match of {
        Subject::Scene(scene) => {
            if scene.bodies.len() == 1 {
                notes.extend(check_units(&points, scene.gravity, !scene.statics.is_empty(), declared)?);
            }
            if scene.bodies.len() == 1 && scene.statics.is_empty() && scene.gravity == [0.0; 2] {
                let cut = cut_between_strokes(&mut tables, budget)?;
                own &= cut.is_none();
                notes.extend(cut);
            }
            scene.clone()
        }
        Subject::Ball(ball) => {
            let g = ball.gravity.unwrap_or(STANDARD_GRAVITY_M_S2);
            // A floor explains why a ball does not fall; wrong units explain why none is found.
            let on_floor = on_floor(ball, &points, g, &mut notes);
            let has_floor = on_floor.as_ref().is_ok_and(|(ball, _)| ball.floor.is_some());
            notes.extend(check_units(&points, [0.0, -g], has_floor, declared)?);
            let (ball, films) = on_floor?;
            notes.extend(move_to_floor(&mut tables, &films));
            if ball.floor.is_some() {
                notes.extend(cut_between_bounces(&mut tables, g)?);
            } else if g == 0.0 {
                notes.extend(cut_between_strokes(&mut tables, budget)?);
            }
            ball.build(body(&tables)?, seconds(&tables))?
        }
    };
    let mut trials = Vec::new();
    for table in tables {
        let assembled = assemble(table.rows, &scene, budget);
        trials.extend(assembled.map_err(|e| e.in_file(&table.file))?);
    }
    Ok(LoadedTrials { scene, trials, notes, own_format: own && reading.is_silent() })
}

/// Errors if there are too many files, or too many cells in them.
fn check_files(files: &[TrackFile]) -> Result<()> {
    if files.len() > MAX_FILES {
        let allowed = format!("at most {MAX_FILES} files");
        return Err(Error::input("trials", format!("{} files", files.len()), allowed));
    }
    check_cells(files.iter().map(|f| f.text.as_str()))
}

/// Reads each file of a ball; where they are in pixels, the size of a pixel and the direction of y may be found.
fn read_ball(
    files: &[TrackFile],
    ball: &BallScene,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<(Vec<TrackTable>, Vec<String>)> {
    let gravity = ball.gravity.unwrap_or(STANDARD_GRAVITY_M_S2);
    let with_size = |size| TrackParseOptions { metres_per_pixel: Some(size), ..reading.clone() };
    let (mut tables, mut notes) = match read_files(files, Some(BALL), reading, budget) {
        Err(Error::Input(input)) if is_pixel_size_missing(&input) => {
            match pixel_size(files.iter().map(|f| f.text.as_str()), ball.radius, reading, budget)? {
                Some((size, remark)) => {
                    let (tables, mut notes) = read_files(files, Some(BALL), &with_size(size), budget)?;
                    notes.push(remark);
                    (tables, notes)
                }
                None => {
                    let in_pixels = read_files(files, Some(BALL), &with_size(1.0), budget).ok();
                    let points = in_pixels.map(|(tables, _)| points_by_trial(&tables));
                    return Err(with_suggestion(Error::Input(input), points.as_deref(), gravity));
                }
            }
        }
        read => read?,
    };
    // A given floor is in the coordinates of the user.
    if tables.iter().all(|t| t.in_pixels) && reading.y_down.is_none() && ball.floor.is_none() {
        notes.extend(turn_upwards(&mut tables, gravity));
    }
    Ok((tables, notes))
}

/// Reads each file, and remarks on them. `body` is the name of the only body of the scene.
fn read_files(
    files: &[TrackFile],
    body: Option<&str>,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<(Vec<TrackTable>, Vec<String>)> {
    let (mut tables, mut notes, mut remarks) = (Vec::new(), Vec::new(), Vec::new());
    let names = names(files);
    let read = |(file, name): (&TrackFile, &String)| match body {
        Some(body) => read::read(&file.text, name, body, reading, budget),
        None if reading.is_silent() => own_format(&file.text, budget),
        None => Err(Error::input("scene", "of several bodies", "one body, if units or a track are given")),
    };
    for (file, name) in files.iter().zip(&names) {
        let mut table = match read((file, name)).map_err(|e| e.in_file(&file.name)) {
            Ok(table) => table,
            Err(Error::Input(input)) if reading.skip_bad == Some(true) => {
                notes.push(format!("left out: {input}"));
                continue;
            }
            Err(Error::Input(mut input)) => {
                if files.iter().zip(&names).any(|other| read(other).is_ok()) {
                    input.allowed += "; or `skip_bad`, which leaves this file out";
                }
                return Err(Error::Input(input));
            }
            Err(e) => return Err(e),
        };
        table.file.clone_from(&file.name);
        if files.len() > 1 && table.names_trials {
            table.rows.iter_mut().for_each(|r| r.trial = format!("{name}/{}", r.trial));
        }
        remarks.extend(table.notes.iter().map(|note| (note.clone(), file.name.clone())));
        tables.push(table);
    }
    notes.extend(remarks_by_file(remarks));
    if tables.is_empty() && !files.is_empty() {
        let value = format!("{} files, of which none can be read", files.len());
        return Err(Error::input("trials", value, format!("at least one; {}", notes[0])));
    }
    Ok((tables, notes))
}

/// Remarks (text, file), each once.
fn remarks_by_file(remarks: Vec<(String, String)>) -> Vec<String> {
    let mut out: Vec<(String, String, usize)> = Vec::new();
    for (text, file) in remarks {
        match out.iter_mut().find(|r| r.0 == text) {
            Some(known) => known.2 += 1,
            None => out.push((text, file, 0)),
        }
    }
    let one = |(text, file, more): (String, String, usize)| match more {
        0 => format!("{file}: {text}"),
        1 => format!("{file} and another file: {text}"),
        _ => format!("{file} and {more} other files: {text}"),
    };
    out.into_iter().map(one).collect()
}

/// The points of all trials in the order of their rows.
fn points_by_trial(tables: &[TrackTable]) -> Vec<TrialPoints> {
    tables.iter().flat_map(|t| TrialPoints::by_trial(&t.rows)).collect()
}

/// The ball with a floor where its tracks show one, if none is given, and how each trial lies to it. Without gravity, as seen from
/// above, there is none.
fn on_floor(
    ball: &BallScene,
    points: &[TrialPoints],
    gravity: f64,
    notes: &mut Vec<String>,
) -> Result<(BallScene, Vec<FilmFloor>)> {
    if let Some(floor) = ball.floor {
        check_floor(points, ball.radius, floor, gravity)?;
        return Ok((ball.clone(), Vec::new()));
    }
    if gravity == 0.0 {
        return Ok((ball.clone(), Vec::new()));
    }
    let Some(FloorEstimate { height, evidence, films }) = find_floor(points, ball.radius, gravity)? else {
        notes.extend(remark_on_bounce(points, gravity));
        return Ok((ball.clone(), Vec::new()));
    };
    notes.push(format!("floor found at {height:.4} m: {evidence}"));
    Ok((BallScene { floor: Some(height), ..ball.clone() }, films))
}

/// Moves the trials to the floor of all, in the order of their rows, and removes those that are left out; remarks on both.
fn move_to_floor(tables: &mut Vec<TrackTable>, films: &[FilmFloor]) -> Vec<String> {
    let (mut notes, mut next) = (Vec::new(), films.iter());
    for table in tables.iter_mut() {
        let mut left_out = Vec::new();
        for rows in table.rows.chunk_by_mut(|a, b| a.trial == b.trial) {
            let trial = rows[0].trial.clone();
            match next.next() {
                Some(FilmFloor::LeftOut(reason)) => {
                    notes.push(format!("left out trial {trial:?}: {reason}"));
                    left_out.push(trial);
                }
                Some(FilmFloor::Shifted(up)) if *up != 0.0 => {
                    notes.push(format!(
                        "trial {trial:?} is moved by {:.1} mm to the floor of the first",
                        1e3 * up
                    ));
                    rows.iter_mut().for_each(|row| row.values[1] += up);
                }
                _ => {}
            }
        }
        table.rows.retain(|row| !left_out.contains(&row.trial));
    }
    tables.retain(|table| !table.rows.is_empty());
    notes
}

/// Number of trials below which films are cut into parts.
const MIN_TRIALS: usize = 4;

/// Cuts films of many bounces, if they are few, into trials with one bounce each; their starts are independent, since each is fitted.
fn cut_between_bounces(tables: &mut [TrackTable], gravity: f64) -> Result<Option<String>> {
    let parts = |film: &TrialPoints| {
        let cuts = cuts_between_bounces(film, gravity);
        let starts = std::iter::once(f64::NEG_INFINITY).chain(cuts.iter().copied());
        let ends = cuts.iter().copied().chain([f64::INFINITY]);
        let parts = starts.zip(ends).map(|(start, end)| start..end);
        Ok(if cuts.is_empty() { Vec::new() } else { parts.collect() })
    };
    let count = cut_films(tables, parts)?;
    Ok(count
        .map(|count| format!("{} where the ball is highest between two bounces", count.describe("bounces"))))
}

/// Cuts films of strokes seen from above, if they are few, into trials of free motion. What strikes the body must not be in the scene:
/// with surfaces or other bodies, an abrupt change of its velocity may be a contact that the scene explains, and nothing is cut.
fn cut_between_strokes(tables: &mut [TrackTable], budget: &dyn Budget) -> Result<Option<String>> {
    let count = cut_films(tables, |film| free_stretches(film, budget))?;
    Ok(count.map(|count| {
        format!(
            "{}, since its velocity changes abruptly; what is recorded during a stroke, or long after the body has stopped, is left out",
            count.describe("strokes")
        )
    }))
}

/// Numbers of films that were cut, and of their parts.
struct CutCount {
    films: usize,
    parts: usize,
}

impl CutCount {
    /// The numbers in words, for films of many `events`.
    fn describe(&self, events: &str) -> String {
        let (films, are) = if self.films == 1 { ("film", "is") } else { ("films", "are") };
        let trials = if self.parts == 1 { "trial" } else { "trials" };
        format!("{} {films} of many {events} {are} cut into {} {trials}", self.films, self.parts)
    }
}

/// Cuts films, if they are few, into trials by the times, s, of their parts, none for a film that stays whole. Rows in no part of a film
/// that is cut are left out. `None` if nothing is cut.
fn cut_films(
    tables: &mut [TrackTable],
    parts: impl Fn(&TrialPoints) -> Result<Vec<Range<f64>>>,
) -> Result<Option<CutCount>> {
    let trials = tables.iter().flat_map(|t| t.rows.chunk_by(|a, b| a.trial == b.trial));
    if trials.count() >= MIN_TRIALS {
        return Ok(None);
    }
    let films = points_by_trial(tables).iter().map(parts).collect::<Result<Vec<_>>>()?;
    let mut next = films.iter();
    for table in tables {
        let mut film: Option<(String, &Vec<Range<f64>>)> = None;
        table.rows.retain_mut(|row| {
            if film.as_ref().is_none_or(|(trial, _)| *trial != row.trial) {
                film = next.next().map(|parts| (row.trial.clone(), parts));
            }
            let Some((_, parts)) = film.as_ref().filter(|(_, parts)| !parts.is_empty()) else { return true };
            let part = parts.iter().position(|part| part.contains(&row.t));
            part.inspect(|part| row.trial += &format!(", part {}", part + 1)).is_some()
        });
    }
    let cut = films.iter().filter(|parts| !parts.is_empty());
    let count = CutCount { films: cut.clone().count(), parts: cut.map(Vec::len).sum() };
    Ok((count.films > 0).then_some(count))
}

/// Default name of a ball.
const BALL: &str = "ball";

fn own_format(text: &str, budget: &dyn Budget) -> Result<TrackTable> {
    Ok(TrackTable::in_own_format(trials_csv::rows(text, budget)?, [true; 2]))
}

/// Default trial name of each file: its stem, or its full name if the stems are not unique.
fn names(files: &[TrackFile]) -> Vec<String> {
    let stem = |f: &TrackFile| {
        Path::new(&f.name).file_stem().map_or(f.name.clone(), |s| s.to_string_lossy().into_owned())
    };
    let stems: Vec<String> = files.iter().map(stem).collect();
    let alike = (1..stems.len()).any(|i| stems[..i].contains(&stems[i]));
    if alike { files.iter().map(|f| f.name.clone()).collect() } else { stems }
}

/// Name of the only body.
fn body(tables: &[TrackTable]) -> Result<&str> {
    let mut rows = tables.iter().flat_map(|t| &t.rows);
    let first = rows.next().map_or(BALL, |r| r.body.as_str());
    match rows.find(|r| r.body != first) {
        Some(other) => {
            let both = format!("{first:?} and {:?}", other.body);
            Err(Error::input(
                "body",
                both,
                "one ball; select it with `track`, or give a scene with all bodies",
            ))
        }
        None => Ok(first),
    }
}

/// Duration of the longest trial, s.
fn seconds(tables: &[TrackTable]) -> f64 {
    let mut longest: f64 = 0.0;
    for table in tables {
        let mut first: Option<&TrackRow> = None;
        for row in &table.rows {
            let start = first.filter(|f| f.trial == row.trial).unwrap_or(row);
            longest = longest.max(row.t - start.t);
            first = Some(start);
        }
    }
    longest
}
