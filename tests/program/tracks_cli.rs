//! `iplw diagnose` of one ball's tracks, without a scene.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use iplw::task::Scene;

use crate::worlds;

fn diagnose(files: &[PathBuf], more: &[&str], out: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_iplw"));
    command.arg("diagnose").arg("--trials").args(files).args(more).arg("--out").arg(out);
    command.output().unwrap()
}

/// Throws as Tracker exports them, coordinates in units of `size` m.
fn films(folder: &Path, size: f64) -> Vec<PathBuf> {
    let trials = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 6, 40, 8.0, 5);
    let write = |(i, trial): (usize, &iplw::reality::Trial)| {
        let (track, times) = (&trial.observed.bodies[0], trial.observed.times.iter().enumerate());
        let rows = times.map(|(k, t)| format!("{t:e}\t{:e}\t{:e}\t\n", track.x[k] / size, track.y[k] / size));
        let file = folder.join(format!("throw{i}.txt"));
        std::fs::write(&file, format!("mass_A\t\t\t\nt\tx\ty\t\n{}", rows.collect::<String>())).unwrap();
        file
    };
    trials.iter().enumerate().map(write).collect()
}

#[test]
fn creates_the_scene_from_the_radius() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let done = diagnose(
        &films(folder.path(), 0.001),
        &["--radius", "0.02", "--mass", "0.0027", "--length-unit", "mm"],
        &out,
    );
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(String::from_utf8_lossy(&done.stdout).starts_with("verdict: "));
    let scene = Scene::from_json(&std::fs::read_to_string(out.join("extended_scene.json")).unwrap()).unwrap();
    assert_eq!((scene.gravity, scene.bodies[0].mass), ([0.0, -9.81], Some(0.0027)));
    assert!(scene.bodies[0].position.is_some(), "it rolls out");
}

#[test]
fn errors_name_options() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let scene = folder.path().join("scene.json");
    std::fs::write(&scene, worlds::scene().to_json()).unwrap();
    let scene = scene.to_str().unwrap();
    let (metres, centimetres) = (films(folder.path(), 1.0), tempfile::tempdir().unwrap());
    let small = films(centimetres.path(), 0.01);
    let cases: [(&[PathBuf], &[&str], &str); 8] = [
        (&metres, &[], "`--scene` is missing; allowed: a scene file; or, for a single ball, --radius"),
        (&metres, &["--radius", "0"], "`--radius` is 0"),
        (&metres, &["--radius", "0.02", "--mass", "2.7"], "`--mass` is 2.7; allowed: kg, at most"),
        (
            &metres,
            &["--radius", "0.02", "--floor", "9"],
            "`--floor` is 9; allowed: a height below the ball's centre",
        ),
        (&metres, &["--radius", "0.02", "--fps", "-1"], "`--fps` is -1"),
        (&metres, &["--radius", "0.02", "--scene", scene], "cannot be used with"),
        (&small, &["--radius", "0.02"], "of millimetres --length-unit mm (or cm); if"),
        (&[folder.path().join("none.csv")], &["--radius", "0.02"], "none.csv"),
    ];
    for (files, more, wanted) in cases {
        let done = diagnose(files, more, &out);
        let error = String::from_utf8_lossy(&done.stderr).to_string();
        assert_eq!(done.status.code(), Some(2), "{more:?}: {error}");
        assert!(error.contains(wanted) && error.lines().count() == 1, "{more:?}: {error}");
        assert!(!out.exists());
    }
}

/// Ignored columns are reported, and a scene with a single body accepts track files, too.
#[test]
fn scenes_with_one_body_accept_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("scene.json"), worlds::scene().to_json()).unwrap();
    let rows: String = (0..30).map(|k| format!("{},{},{},0\n", k, 2 * k, 300 - k * k / 3)).collect();
    std::fs::write(at("film.csv"), format!("frame,x,y,v\n{rows}")).unwrap();
    let scene = at("scene.json");
    let more = ["--scene", scene.to_str().unwrap(), "--fps", "60", "--metres-per-pixel", "0.005"];
    let done = diagnose(&[at("film.csv")], &more, &at("out"));
    let told = String::from_utf8_lossy(&done.stderr).to_string();
    assert!(done.status.success(), "{told}");
    assert!(told.contains("film.csv: unused columns: \"v\""), "{told}");
    assert!(String::from_utf8_lossy(&done.stdout).contains("verdict: insufficient_data"));
}
