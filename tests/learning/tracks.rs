//! Track files of a single ball: parsing, and checks of units and floor.

use std::sync::atomic::{AtomicUsize, Ordering};

use iplw::budget::{Budget, Unlimited};
use iplw::error::Error;
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use iplw::reality::{LoadedTrials, Subject, TrackFile, TrackParseOptions, load_tracks};
use iplw::task::ball::{BallScene, STANDARD_GRAVITY_M_S2};

use crate::worlds;

const BALL: BallScene = BallScene { radius: 0.02, mass: Some(0.0027), gravity: None, floor: None };

/// Throws with drag, one file each; `cells` formats t (s), x, y (m) of frame k.
fn throws(cells: impl Fn(usize, f64, f64, f64) -> String, header: &str) -> Vec<TrackFile> {
    let trials = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 8, 40, 8.0, 5);
    let file = |(i, trial): (usize, &iplw::reality::Trial)| {
        let track = &trial.observed.bodies[0];
        let times = trial.observed.times.iter().enumerate();
        let rows: String = times.map(|(k, t)| cells(k, *t, track.x[k], track.y[k]) + "\n").collect();
        TrackFile { name: format!("films/throw {i}.csv"), text: format!("{header}\n{rows}") }
    };
    trials.iter().enumerate().map(file).collect()
}

fn gathered(files: &[TrackFile], reading: &TrackParseOptions) -> Result<LoadedTrials, String> {
    load_tracks(files, Subject::Ball(&BALL), reading, &Unlimited).map_err(|e| e.to_string())
}

#[test]
fn diagnoses_ball_files_without_scene() {
    let files = throws(|_, t, x, y| format!("{t},{x},{y}"), "Time (s),pos_x,pos_y");
    let found = gathered(&files, &TrackParseOptions::default()).unwrap();
    assert_eq!((found.trials.len(), found.trials[7].name.as_str()), (8, "throw 7"));
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let finding = diagnose(&found.scene, &found.trials, &DiagnosisConfig::standard(0), &NoProgress).unwrap();
    let sets = &finding.diagnosis.rivals;
    assert!(sets.iter().any(|s| s == &["quadratic_drag"]), "{sets:?}");
}

/// The same throws in other units give the same trials.
#[test]
fn declared_units_are_converted() {
    let plain =
        gathered(&throws(|_, t, x, y| format!("{t},{x},{y}"), "t,x,y"), &TrackParseOptions::default())
            .unwrap();
    let films = throws(|_, t, x, y| format!("{},{},{}", 1e3 * t, x / 0.002, -y / 0.002), "t,x,y");
    let said = TrackParseOptions {
        metres_per_pixel: Some(0.002),
        time_unit: Some("ms".into()),
        y_down: Some(true),
        ..TrackParseOptions::default()
    };
    let other = gathered(&films, &said).unwrap();
    for (a, b) in plain.trials.iter().zip(&other.trials) {
        let (a, b) = (&a.observed, &b.observed);
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(
            near(&a.times, &b.times)
                && near(&a.bodies[0].x, &b.bodies[0].x)
                && near(&a.bodies[0].y, &b.bodies[0].y)
        );
    }
}

#[test]
fn rejects_implausible_units_with_suggestion() {
    type Cells<'a> = &'a dyn Fn(usize, f64, f64, f64) -> String;
    let cases: [(&str, Cells, &[&str]); 7] = [
        (
            "millimetres",
            &|_, t, x, y| format!("{t},{},{}", 1e3 * x, 1e3 * y),
            &["`x, y`", "`length_unit` mm", "`metres_per_pixel`"],
        ),
        (
            "centimetres",
            &|_, t, x, y| format!("{t},{},{}", 40.0 * x, 40.0 * y),
            &["`y` is falling with", "`length_unit` cm"],
        ),
        (
            "pixels",
            &|_, t, x, y| format!("{t},{},{}", 500.0 * x, 900.0 - 500.0 * y),
            &["`x, y`", "`metres_per_pixel`"],
        ),
        (
            "pixels downwards",
            &|_, t, x, y| format!("{t},{},{}", 40.0 * x, -40.0 * y),
            &["rising", "`metres_per_pixel`", "`y_down`"],
        ),
        ("downwards", &|_, t, x, y| format!("{t},{x},{}", 1.0 - y), &["`y` is rising", "`y_down`"]),
        ("milliseconds", &|_, t, x, y| format!("{},{x},{y}", 1e3 * t), &["`t`", "`time_unit` ms"]),
        ("pictures", &|k, _, x, y| format!("{k},{x},{y}"), &["`t`", "`fps`", "a second"]),
    ];
    for (what, cells, wanted) in cases {
        let error =
            gathered(&throws(cells, "t,x,y"), &TrackParseOptions::default()).map(|_| ()).expect_err(what);
        for part in wanted {
            assert!(error.contains(part), "{what}: {error}");
        }
    }
}

/// A declared unit is questioned instead of requested.
#[test]
fn questions_a_declared_unit() {
    let films = throws(|_, t, x, y| format!("{t},{},{}", x / 0.002, y / 0.002), "t,x,y");
    let pixels = TrackParseOptions { metres_per_pixel: Some(0.05), ..TrackParseOptions::default() };
    let error = gathered(&films, &pixels).map(|_| ()).unwrap_err();
    let wanted = ["is the unit, or the size of a pixel, the right one?", "say so: `time_unit` s"];
    assert!(wanted.iter().all(|w| error.contains(w)) && !error.contains("millimetres"), "{error}");
}

/// Explicit declarations are accepted, with a note.
#[test]
fn accepts_declared_odd_units_with_note() {
    let files = throws(|_, t, x, y| format!("{t},{},{}", 40.0 * x, 40.0 * y), "t (s),x (m),y (m)");
    let notes = gathered(&files, &TrackParseOptions::default()).unwrap().notes;
    assert!(notes.len() == 1 && notes[0].contains("times gravity"), "{notes:?}");
    let up = TrackParseOptions { y_down: Some(false), ..TrackParseOptions::default() };
    let notes = gathered(&throws(|_, t, x, y| format!("{t},{x},{}", -y), "t,x,y"), &up).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("y is rising")), "{notes:?}");
    // Without gravity there is no check of units.
    let ball = BallScene { gravity: Some(0.0), ..BALL };
    load_tracks(
        &throws(|_, t, x, y| format!("{t},{x},{}", -y), "t,x,y"),
        Subject::Ball(&ball),
        &TrackParseOptions::default(),
        &Unlimited,
    )
    .unwrap();
}

/// A ball dropped from 1 m on a floor at 0.5 m, restitution 0.8, at 120 frames per second.
fn drops() -> Vec<TrackFile> {
    let file = |i: usize| {
        let (mut y, mut v, mut text) = (1.5 + 0.05 * i as f64, 0.0, String::from("t,x,y\n"));
        for k in 0..100 * 20 {
            if k % 20 == 0 {
                text +=
                    &format!("{:.5},{:.5},{:.5}\n", f64::from(k) / 2400.0, 0.5 * f64::from(k) / 2400.0, y);
            }
            v -= STANDARD_GRAVITY_M_S2 / 2400.0;
            y += v / 2400.0;
            if y < 0.52 && v < 0.0 {
                v *= -0.8;
            }
        }
        TrackFile { name: format!("drop{i}.csv"), text }
    };
    (0..6).map(file).collect()
}

/// A track raised by `height`, m.
fn raised(file: TrackFile, height: f64) -> TrackFile {
    let row = |line: &str| match line.rsplit_once(',') {
        Some((rest, y)) if y != "y" => format!("{rest},{}", y.parse::<f64>().unwrap() + height),
        _ => line.to_string(),
    };
    TrackFile { text: file.text.lines().map(row).collect::<Vec<_>>().join("\n") + "\n", ..file }
}

#[test]
fn floors_are_found_or_checked() {
    let found = gathered(&drops(), &TrackParseOptions::default()).unwrap();
    assert!(found.notes.len() == 1 && found.notes[0].contains("floor found at 0.49"), "{:?}", found.notes);
    assert_eq!(found.scene.statics.len(), 1);
    // One bounce of many trials may be a tracking error.
    let flights = throws(|_, t, x, y| format!("{t},{x},{y}"), "t,x,y");
    let single: Vec<TrackFile> = drops().into_iter().take(1).chain(flights).collect();
    let found = gathered(&single, &TrackParseOptions::default()).unwrap();
    let wanted = "trial \"drop0\" turns upwards sharply";
    assert!(
        found.scene.statics.is_empty() && found.notes.iter().any(|n| n.contains(wanted)),
        "{:?}",
        found.notes
    );
    // Bounces off several things.
    let shelves: Vec<TrackFile> =
        drops().into_iter().enumerate().map(|(i, file)| raised(file, 0.1 * i as f64)).collect();
    let error = gathered(&shelves, &TrackParseOptions::default()).map(|_| ()).expect_err("several heights");
    assert!(
        error.contains("`floor` is missing: 6 of 6 trials turn upwards") && error.contains("differ by"),
        "{error}"
    );
    let with = |floor: f64| {
        load_tracks(
            &drops(),
            Subject::Ball(&BallScene { floor: Some(floor), ..BALL }),
            &TrackParseOptions::default(),
            &Unlimited,
        )
    };
    let error = with(0.6).map(|_| ()).expect_err("a ball below the floor").to_string();
    assert!(error.contains("`floor` is 0.6; allowed: a height below the ball's centre"), "{error}");
    let error = with(0.3).map(|_| ()).expect_err("bounces far above the floor").to_string();
    assert!(
        error.contains("`floor` is 0.3; allowed: the height of what the ball bounces off: 6 of 6"),
        "{error}"
    );
    let found = with(0.5).unwrap();
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let finding = diagnose(&found.scene, &found.trials, &DiagnosisConfig::standard(0), &NoProgress).unwrap();
    let restitution = finding.diagnosis.calibrated.iter().find(|c| c.name == "restitution").unwrap();
    assert!(restitution.identifiable && (restitution.value - 0.8).abs() < 0.02, "{restitution:?}");
}

/// One film of a ball that bounces many times is cut into trials, and gives restitution.
#[test]
fn one_film_of_many_bounces_is_diagnosed() {
    let (restitution, fps) = (0.85, 120.0);
    let (mut start, mut flight, mut speed, mut text) = (0.0, 1.0, 0.0, String::from("t,x,y\n"));
    for frame in 0..500 {
        let t = f64::from(frame) / fps;
        let duration =
            (speed + f64::sqrt(speed * speed + 2.0 * STANDARD_GRAVITY_M_S2 * flight)) / STANDARD_GRAVITY_M_S2;
        if t - start > duration {
            let rebound = restitution * (STANDARD_GRAVITY_M_S2 * duration - speed);
            (start, speed, flight) = (start + duration, rebound, 0.0);
        }
        let (s, noise) = (t - start, |k: f64| 1e-3 * 1.414 * f64::sin(k));
        let y = 0.02 + flight + speed * s - 0.5 * STANDARD_GRAVITY_M_S2 * s * s;
        let shake = [f64::from(frame * 7919), f64::from(frame * frame * 31 + 5)].map(noise);
        text += &format!("{t:.5},{:.5},{:.5}\n", 0.3 * t + shake[0], y + shake[1]);
    }
    let found =
        gathered(&[TrackFile { name: "film.csv".into(), text }], &TrackParseOptions::default()).unwrap();
    assert!(found.notes.iter().any(|n| n.contains("cut into")), "{:?}", found.notes);
    assert!(found.trials.len() >= 5 && found.trials[1].name == "film, part 2", "{}", found.trials.len());
    let d =
        diagnose(&found.scene, &found.trials, &DiagnosisConfig::standard(0), &NoProgress).unwrap().diagnosis;
    let found = d.calibrated.iter().find(|c| c.name == "restitution").unwrap();
    assert!(found.identifiable && (found.value - restitution).abs() < 0.01, "{found:?} {}", d.reason);
    assert!(d.effects.is_empty(), "{:?}", d.effects);
}

/// Several files become trials by name, and errors name the file.
#[test]
fn trials_and_errors_name_files() {
    let file = |name: &str, text: &str| TrackFile { name: name.into(), text: text.into() };
    let own = "trial,t,body,x,y\nfirst,0,ping,0,1\nfirst,0.1,ping,0.1,1\n";
    let names = |files: &[TrackFile]| {
        let found =
            load_tracks(files, Subject::Ball(&BALL), &TrackParseOptions::default(), &Unlimited).unwrap();
        (found.scene.bodies[0].name.clone(), found.trials.iter().map(|t| t.name.clone()).collect::<Vec<_>>())
    };
    assert_eq!(names(&[file("a.csv", own)]), ("ping".into(), vec!["first".into()]));
    assert_eq!(names(&[file("x/a.csv", own), file("x/b.csv", own)]).1, ["a/first", "b/first"]);
    assert_eq!(
        names(&[file("x/a.csv", "t,x,y\n0,1,1\n"), file("y/a.csv", "t,x,y\n0,1,1\n")]).1,
        ["x/a.csv", "y/a.csv"]
    );
    let bad = gathered(
        &[file("a.csv", "t,x,y\n0,1,1\n"), file("b.csv", "t,x,y\n0,1,1\n1,1,?\n")],
        &TrackParseOptions::default(),
    );
    let text =
        "b.csv:3: `y` is \"?\"; allowed: a number, or nothing; or `skip_bad`, which leaves this file out";
    assert_eq!(bad.unwrap_err(), text);
    let both = "trial,t,body,x,y\na,0,red,0,1\na,0,blue,0,2\n";
    assert!(
        gathered(&[file("a.csv", both)], &TrackParseOptions::default())
            .unwrap_err()
            .contains("select it with `track`")
    );
}

/// The project's own format is always read; implausible units give a note.
#[test]
fn scene_format_skips_unit_checks() {
    let rows: String = (0..40).map(|k| format!("a,{k},ball,{},{}\n", 100 * k, 5 * k * k)).collect();
    let files = [TrackFile { name: "a.csv".into(), text: format!("trial,t,body,x,y\n{rows}") }];
    let scene = BALL.build("ball", 1.0).unwrap();
    let found =
        load_tracks(&files, Subject::Scene(&scene), &TrackParseOptions::default(), &Unlimited).unwrap();
    assert!(found.own_format && found.notes.len() == 1, "{:?}", found.notes);
}

/// Truncated or corrupted files are read or rejected.
#[test]
fn rejects_or_reads_truncated_files() {
    for text in [
        "#multi:\n\tcm A\t\tcm B\t\t\nt\tx\ty\tx\ty\t\n0\t1\t2\t3\t4\n1\t5\t6\t7\t8\n",
        "\u{feff}\"Time (s)\";\"B\u{e4}ll/0/X\";\"B\u{e4}ll/0/Y\"\r\n\"0,5\";\"1,5\";;\r\n\"1\";;\"2\"\r\n",
        "# T X Y\n\n0 1 2\n1 2 3\n",
        "trial,t,body,x,y,vx\na,0,ball,1,2,\na,1,ball,1,2,3\n",
        "frame,particle,y,x\n0,0,1,2\n0,1,1,2\n1,0,,\n",
    ] {
        let whole: Vec<char> = text.chars().collect();
        for i in 0..whole.len() {
            let without = whole[..i].iter().chain(&whole[i + 1..]).collect::<String>();
            for broken in [whole[..i].iter().collect::<String>(), without] {
                let file = TrackFile { name: "a.csv".into(), text: broken };
                let fps = TrackParseOptions {
                    fps: Some(30.0),
                    track: Some("cm A".into()),
                    ..TrackParseOptions::default()
                };
                for reading in [TrackParseOptions::default(), fps] {
                    if let Err(error) = gathered(std::slice::from_ref(&file), &reading) {
                        assert!(error.contains("allowed: "), "{:?}: {error}", file.text);
                    }
                }
            }
        }
    }
}

/// A budget of a given number of checks.
struct Looks(AtomicUsize);

impl Budget for Looks {
    fn check(&self) -> Result<(), Error> {
        let left = self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1));
        left.map(|_| ()).map_err(|_| Error::Cancelled)
    }
}

/// Reading can be cancelled at any point, because a server reads files of up to 16 MiB.
#[test]
fn reading_respects_budget() {
    let rows: String = (0..20_000).map(|i| format!("{},{}.5,1.5,2.5\n", i / 500, i % 500)).collect();
    let trials = TrackFile { name: "film.csv".into(), text: format!("trial,t,x,y\n{rows}") };
    let own: String = rows.lines().map(|r| r.replacen(".5,1.5", ".5,ball,1.5", 1) + "\n").collect();
    let own = TrackFile { name: "own.csv".into(), text: format!("trial,t,body,x,y\n{own}") };
    let said = TrackParseOptions {
        length_unit: Some("m".into()),
        time_unit: Some("s".into()),
        y_down: Some(false),
        ..TrackParseOptions::default()
    };
    for (file, least) in [(trials, 60), (own, 39)] {
        let read = |looks| {
            load_tracks(
                std::slice::from_ref(&file),
                Subject::Ball(&BALL),
                &said,
                &Looks(AtomicUsize::new(looks)),
            )
        };
        let enough = (0..).find(|looks| read(*looks).is_ok()).expect("an end");
        assert!(enough > least, "{}: {enough} looks", file.name);
        for looks in (0..enough).step_by(7) {
            assert!(matches!(read(looks), Err(Error::Cancelled)), "{}: {looks} looks", file.name);
        }
    }
}
