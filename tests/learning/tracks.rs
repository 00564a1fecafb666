//! Files of one ball's tracks: what they make, and what is said where units or the floor cannot be right.

use std::sync::atomic::{AtomicUsize, Ordering};

use iplw::budget::{Budget, Endless};
use iplw::discover::{Config, diagnose};
use iplw::error::Error;
use iplw::progress::Silent;
use iplw::reality::{File, Gathered, Of, Reading, gather};
use iplw::task::ball::{Ball, GRAVITY};

use crate::worlds;

const BALL: Ball = Ball { radius: 0.02, mass: Some(0.0027), gravity: GRAVITY, floor: None };

/// Throws through still air, a file each; `cells` writes t (s), x, y (m) of picture k.
fn throws(cells: impl Fn(usize, f64, f64, f64) -> String, header: &str) -> Vec<File> {
    let trials = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 8, 40, 8.0, 5);
    let file = |(i, trial): (usize, &iplw::reality::Trial)| {
        let track = &trial.observed.bodies[0];
        let times = trial.observed.times.iter().enumerate();
        let rows: String = times.map(|(k, t)| cells(k, *t, track.x[k], track.y[k]) + "\n").collect();
        File { name: format!("films/throw {i}.csv"), text: format!("{header}\n{rows}") }
    };
    trials.iter().enumerate().map(file).collect()
}

fn gathered(files: &[File], reading: &Reading) -> Result<Gathered, String> {
    gather(files, Of::Ball(&BALL), reading, &Endless).map_err(|e| e.to_string())
}

#[test]
fn files_of_one_ball_are_diagnosed_without_a_scene() {
    let files = throws(|_, t, x, y| format!("{t},{x},{y}"), "Time (s),pos_x,pos_y");
    let found = gathered(&files, &Reading::default()).unwrap();
    assert_eq!((found.trials.len(), found.trials[7].name.as_str()), (8, "throw 7"));
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let finding = diagnose(&found.scene, &found.trials, &Config::standard(0), &Silent).unwrap();
    let sets = &finding.diagnosis.rivals;
    assert!(sets.iter().any(|s| s == &["quadratic_drag"]), "{sets:?}");
}

/// The same throws in other units give the same trials.
#[test]
fn units_that_are_said_change_nothing() {
    let plain = gathered(&throws(|_, t, x, y| format!("{t},{x},{y}"), "t,x,y"), &Reading::default()).unwrap();
    let films = throws(|_, t, x, y| format!("{},{},{}", 1e3 * t, x / 0.002, -y / 0.002), "t,x,y");
    let said = Reading {
        metres_per_pixel: Some(0.002),
        time_unit: Some("ms".into()),
        y_down: Some(true),
        ..Reading::default()
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
fn units_that_cannot_be_are_told_with_what_to_give() {
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
            &["`y` is falling with", "`length_unit` mm (or cm)"],
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
        let error = gathered(&throws(cells, "t,x,y"), &Reading::default()).expect_err(what);
        for part in wanted {
            assert!(error.contains(part), "{what}: {error}");
        }
    }
}

/// Where a unit was given it is that which is doubted.
#[test]
fn a_unit_that_was_given_is_asked_about_and_not_asked_for() {
    let films = throws(|_, t, x, y| format!("{t},{},{}", x / 0.002, y / 0.002), "t,x,y");
    let pixels = Reading { metres_per_pixel: Some(0.05), ..Reading::default() };
    let error = gathered(&films, &pixels).unwrap_err();
    let wanted = ["is the unit, or the size of a pixel, the right one?", "say so: `time_unit` s"];
    assert!(wanted.iter().all(|w| error.contains(w)) && !error.contains("millimetres"), "{error}");
}

/// What a user says outright is believed, with a note.
#[test]
fn odd_units_are_taken_as_they_are_said_to_be() {
    let files = throws(|_, t, x, y| format!("{t},{},{}", 40.0 * x, 40.0 * y), "t (s),x (m),y (m)");
    let notes = gathered(&files, &Reading::default()).unwrap().notes;
    assert!(notes.len() == 1 && notes[0].contains("times gravity"), "{notes:?}");
    let up = Reading { y_down: Some(false), ..Reading::default() };
    let notes = gathered(&throws(|_, t, x, y| format!("{t},{x},{}", -y), "t,x,y"), &up).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("y is rising")), "{notes:?}");
    // Gravity of nothing says nothing of units.
    let ball = Ball { gravity: 0.0, ..BALL };
    gather(
        &throws(|_, t, x, y| format!("{t},{x},{}", -y), "t,x,y"),
        Of::Ball(&ball),
        &Reading::default(),
        &Endless,
    )
    .unwrap();
}

/// A ball dropped from 1 m on a floor at 0.5 m, restitution 0.8, at 120 pictures a second.
fn drops() -> Vec<File> {
    let file = |i: usize| {
        let (mut y, mut v, mut text) = (1.5 + 0.05 * i as f64, 0.0, String::from("t,x,y\n"));
        for k in 0..100 * 20 {
            if k % 20 == 0 {
                text +=
                    &format!("{:.5},{:.5},{:.5}\n", f64::from(k) / 2400.0, 0.5 * f64::from(k) / 2400.0, y);
            }
            v -= GRAVITY / 2400.0;
            y += v / 2400.0;
            if y < 0.52 && v < 0.0 {
                v *= -0.8;
            }
        }
        File { name: format!("drop{i}.csv"), text }
    };
    (0..6).map(file).collect()
}

#[test]
fn bounces_need_a_floor_where_they_are_and_calibrate_it() {
    let error = gathered(&drops(), &Reading::default()).expect_err("bounces off nothing");
    let wanted = ["`floor` is missing: 6 of 6 trials turn upwards", "at most 0.499 m"];
    assert!(wanted.iter().all(|w| error.contains(w)), "{error}");
    let flight = throws(|_, t, x, y| format!("{t},{x},{y}"), "t,x,y").swap_remove(0);
    let notes = gathered(&[drops().swap_remove(0), flight], &Reading::default()).unwrap().notes;
    assert!(notes.len() == 1 && notes[0].contains("1 of 2 trials"), "{notes:?}");
    let with = |floor: f64| {
        gather(&drops(), Of::Ball(&Ball { floor: Some(floor), ..BALL }), &Reading::default(), &Endless)
    };
    let error = with(0.6).expect_err("a ball below the floor").to_string();
    assert!(error.contains("`floor` is 0.6; allowed: a height below the ball's centre"), "{error}");
    let error = with(0.3).expect_err("bounces far above the floor").to_string();
    assert!(
        error.contains("`floor` is 0.3; allowed: the height of what the ball bounces off: 6 of 6"),
        "{error}"
    );
    let found = with(0.5).unwrap();
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let finding = diagnose(&found.scene, &found.trials, &Config::standard(0), &Silent).unwrap();
    let restitution = finding.diagnosis.calibrated.iter().find(|c| c.name == "restitution").unwrap();
    assert!(restitution.identifiable && (restitution.value - 0.8).abs() < 0.02, "{restitution:?}");
}

/// Several files are trials by name, and an error says in which it is.
#[test]
fn files_are_named_in_trials_and_errors() {
    let file = |name: &str, text: &str| File { name: name.into(), text: text.into() };
    let own = "trial,t,body,x,y\nfirst,0,ping,0,1\nfirst,0.1,ping,0.1,1\n";
    let names = |files: &[File]| {
        let found = gather(files, Of::Ball(&BALL), &Reading::default(), &Endless).unwrap();
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
        &Reading::default(),
    );
    assert_eq!(bad.unwrap_err(), "b.csv:3: `y` is \"?\"; allowed: a number, or nothing");
    let both = "trial,t,body,x,y\na,0,red,0,1\na,0,blue,0,2\n";
    assert!(
        gathered(&[file("a.csv", both)], &Reading::default()).unwrap_err().contains("say which with `track`")
    );
}

/// This project's own format of a scene is read as ever, whatever it holds; what looks odd is a note.
#[test]
fn the_own_format_of_a_scene_is_never_refused_for_its_units() {
    let rows: String = (0..40).map(|k| format!("a,{k},ball,{},{}\n", 100 * k, 5 * k * k)).collect();
    let files = [File { name: "a.csv".into(), text: format!("trial,t,body,x,y\n{rows}") }];
    let scene = BALL.scene("ball", 1.0).unwrap();
    let found = gather(&files, Of::Scene(&scene), &Reading::default(), &Endless).unwrap();
    assert!(found.own_format && found.notes.len() == 1, "{:?}", found.notes);
}

/// Files that end anywhere, or lack a character, are read or refused.
#[test]
fn no_file_is_too_broken_to_be_refused() {
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
                let file = File { name: "a.csv".into(), text: broken };
                let fps = Reading { fps: Some(30.0), track: Some("cm A".into()), ..Reading::default() };
                for reading in [Reading::default(), fps] {
                    if let Err(error) = gathered(std::slice::from_ref(&file), &reading) {
                        assert!(error.contains("allowed: "), "{:?}: {error}", file.text);
                    }
                }
            }
        }
    }
}

/// Gives so many leaves to go on.
struct Looks(AtomicUsize);

impl Budget for Looks {
    fn look(&self) -> Result<(), Error> {
        let left = self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1));
        left.map(|_| ()).map_err(|_| Error::Cancelled)
    }
}

/// A server reads files of 16 MiB for whoever sends them: it must be able to end that, in whatever part of it.
#[test]
fn reading_ends_with_its_budget() {
    let rows: String = (0..20_000).map(|i| format!("{},{}.5,1.5,2.5\n", i / 500, i % 500)).collect();
    let trials = File { name: "film.csv".into(), text: format!("trial,t,x,y\n{rows}") };
    let own: String = rows.lines().map(|r| r.replacen(".5,1.5", ".5,ball,1.5", 1) + "\n").collect();
    let own = File { name: "own.csv".into(), text: format!("trial,t,body,x,y\n{own}") };
    let said = Reading {
        length_unit: Some("m".into()),
        time_unit: Some("s".into()),
        y_down: Some(false),
        ..Reading::default()
    };
    for (file, least) in [(trials, 60), (own, 40)] {
        let read = |looks| {
            gather(std::slice::from_ref(&file), Of::Ball(&BALL), &said, &Looks(AtomicUsize::new(looks)))
        };
        let enough = (0..).find(|looks| read(*looks).is_ok()).expect("an end");
        assert!(enough > least, "{}: {enough} looks", file.name);
        for looks in (0..enough).step_by(7) {
            assert!(matches!(read(looks), Err(Error::Cancelled)), "{}: {looks} looks", file.name);
        }
    }
}
