//! Files of measured trials: the project's own format, and those of tracking programs.

use iplw::budget::Unlimited;
use iplw::reality::{Subject, TrackFile, TrackParseOptions, load_tracks, trials_from_csv, trials_to_csv};
use iplw::rng::Stream;
use iplw::task::Scene;
use iplw::task::ball::BallScene;
use rand::RngExt;

use super::{FuzzOutcome, MIB, Target, bytes, fate, text};

/// The project's own format.
pub const OWN: Target = Target {
    name: "trials",
    short: 5_000,
    long: 10_000_000,
    work: 64 * MIB,
    seeds: || OWN_SEEDS.map(|s| s.as_bytes().to_vec()).into(),
    mutate,
    check: |bytes| text(bytes, own),
};

/// Tracks of one ball, as tracking programs write them.
pub const TRACKS: Target = Target {
    name: "tracks",
    short: 5_000,
    long: 10_000_000,
    work: 64 * MIB,
    seeds: || TRACK_SEEDS.iter().chain(&OWN_SEEDS).map(|s| s.as_bytes().to_vec()).collect(),
    mutate,
    check: |bytes| text(bytes, tracks),
};

const OWN_SEEDS: [&str; 3] = [
    "trial,t,body,x,y\na,0,ball,0,1\na,0.1,ball,0.1,0.95\na,0.2,ball,0.2,0.8\nb,0,ball,1,1\nb,0.5,ball,1.5,\n",
    "trial,setting,t,body,x,y,angle,vx,vy,omega\n1,slow,0,ball,0,1,0,1,0,0\n1,slow,0,box,3,1,0.1,,,\n\
     1,slow,0.25,ball,0.25,0.7,,,,\n1,slow,0.25,box,3,0.9,0.1,,,\n",
    "\u{feff}trial,t,body,x,y\r\n\"a, b\",0,ball,-1e3,1e-3\r\n\"a, b\",1,ball,-999.5,0.001\r\n",
];

const TRACK_SEEDS: [&str; 5] = [
    "t,x,y\n0,0,1\n0.1,0.1,0.95\n0.2,0.2,0.8\n0.3,0.3,0.55\n",
    "time (s);x (cm);y (cm)\n0,00;0,5;100,1\n0,04;1,5;99,2\n0,08;2,5;96,3\n",
    "# mass_A\nt\tx\ty\n0\t0\t1\n0.04\t0.01\t0.99\n0.08\t0.02\t0.97\n",
    "Frame,Time,X_px,Y_px\n0,0,10,400\n1,0.033,12,398\n2,0.066,14,392\n",
    "track,t (ms),x (mm),y (mm)\nA,0,0,0\nA,40,1,2\nB,0,5,5\nB,40,5,4\n",
];

const WORDS: [&[u8]; 24] = [
    b",",
    b";",
    b"\t",
    b"\n",
    b"\r\n",
    b"\"",
    b"\"\"",
    b"NaN",
    b"inf",
    b"1e308",
    b"-0",
    b"1e-320",
    b"1e6",
    b"0,5",
    b"ball",
    b"box",
    b"trial",
    b"setting",
    b"omega",
    b"(cm)",
    b"[ms]",
    b"#",
    b"\xef\xbb\xbf",
    b"frame",
];

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    if draw.random_range(0..4) > 0 || seed.is_empty() {
        return bytes::mutate(seed, seeds, &WORDS, draw);
    }
    // Duplicates, drops or moves lines.
    let text = String::from_utf8_lossy(seed).into_owned();
    let mut lines: Vec<&str> = text.split_inclusive('\n').collect();
    for _ in 0..draw.random_range(1..4) {
        let (from, to) = (draw.random_range(0..lines.len()), draw.random_range(0..lines.len()));
        match draw.random_range(0..3) {
            0 => lines.insert(to, lines[from]),
            1 => lines.swap(from, to),
            _ => drop(lines.remove(from)),
        }
        if lines.is_empty() {
            break;
        }
    }
    *seed = lines.concat().into_bytes();
}

fn scene() -> Scene {
    let text = r#"{"format": "iplw.scene/1", "name": "two", "time_step": 0.01, "steps": 100, "observe_every": 10,
        "bodies": [
            {"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1]},
            {"name": "box", "shape": {"type": "box", "half_width": 0.2, "half_height": 0.2}, "position": [3, 1]}],
        "settings": {"slow": {"bodies": {"ball": {"velocity": [0.5, 0]}}}}}"#;
    Scene::from_json(text).expect("a legal scene")
}

thread_local! {
    static SCENE: Scene = scene();
}

const BALL: BallScene = BallScene { radius: 0.02, mass: Some(0.0027), gravity: None, floor: Some(0.0) };

/// Parsed values are finite or missing, and survive a round trip.
fn own(text: &str) -> FuzzOutcome {
    SCENE.with(|scene| {
        let read = trials_from_csv(text, scene);
        if let Ok(trials) = &read {
            for trial in trials {
                let times = &trial.observed.times;
                assert!(times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
                assert!(trial.observed.bodies.iter().all(|b| b.x.len() == times.len()));
            }
            let written = trials_to_csv(trials);
            let again = trials_from_csv(&written, scene);
            let again =
                again.unwrap_or_else(|e| panic!("what was read cannot be read again: {e}\n{written}"));
            assert_eq!(trials_to_csv(&again), written, "written twice");
        }
        fate(read)
    })
}

fn tracks(text: &str) -> FuzzOutcome {
    let file = TrackFile { name: "tracks.csv".into(), text: text.into() };
    fate(load_tracks(&[file], Subject::Ball(&BALL), &TrackParseOptions::default(), &Unlimited))
}
