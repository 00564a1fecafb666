//! Trial files: parsing, error messages and round trips.

use iplw::reality::{trials_from_csv, trials_to_csv};
use iplw::task::Scene;

fn scene() -> Scene {
    Scene::from_json(
        r#"{"format": "iplw.scene/1",
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "mass": 1},
                       {"name": "cup", "shape": {"type": "disc", "radius": 0.2}, "position": [3, 3]}],
            "settings": {"fast": {"bodies": {"ball": {"mass": 2}}}}}"#,
    )
    .unwrap()
}

const GOOD: &str = "trial,setting,t,body,x,y,angle\n\
    a,fast,0.0,ball,0.0,1.0,\n\
    a,fast,0.0,cup,3.0,3.0,0.5\n\
    a,fast,0.1,ball,0.1,,\n\
    \"b, second\",slow,0.0,ball,5.0,1.5,\n";

#[test]
fn reads_valid_files() {
    let trials = trials_from_csv(GOOD, &scene()).unwrap();
    assert_eq!(trials.len(), 2);
    let first = &trials[0];
    assert_eq!((first.name.as_str(), first.setting.as_deref()), ("a", Some("fast")));
    assert_eq!(first.observed.times, [0.0, 0.1]);
    assert_eq!(first.scene.bodies[0].mass, Some(2.0), "the setting's mass");
    assert_eq!(first.scene.bodies[0].position, Some([0.0, 1.0]), "the first observation");
    assert!(first.observed.bodies[0].y[1].is_nan() && first.observed.bodies[1].x[1].is_nan());
    assert_eq!(trials[1].name, "b, second");
    assert_eq!(trials[1].scene.bodies[0].mass, Some(1.0), "an unknown setting changes nothing");
}

/// Regression test: an observed initial spin was read and not used.
#[test]
fn initial_spin_is_the_observed_one() {
    let text = "trial,t,body,x,y,vx,vy,omega\na,0,ball,0,1,2,3,-4.5\na,0.1,ball,0.2,1.3,2,2,-4\n";
    let start = &trials_from_csv(text, &scene()).unwrap()[0].scene.bodies[0];
    assert_eq!((start.velocity, start.angular_velocity), ([2.0, 3.0], -4.5));
}

#[test]
fn csv_round_trips() {
    let scene = scene();
    let trials = trials_from_csv(GOOD, &scene).unwrap();
    let again = trials_from_csv(&trials_to_csv(&trials), &scene).unwrap();
    assert_eq!(format!("{trials:?}"), format!("{again:?}"));
}

/// Regression test: a carriage return was written without quotes and ended the row.
#[test]
fn quotes_special_characters_in_names() {
    let scene = scene();
    let mut trials = trials_from_csv(GOOD, &scene).unwrap();
    trials[1].name = "the \"second\", begun\ranew".into();
    let again = trials_from_csv(&trials_to_csv(&trials), &scene).unwrap();
    assert_eq!(format!("{trials:?}"), format!("{again:?}"));
}

#[test]
fn writes_plain_names_unquoted_with_full_precision() {
    let text = "trial,t,body,x,y,angle\na,0,ball,0,1,\na,0,cup,3,3,0.5\na,0.1,ball,0.1234567890123456,,\na,0.1,cup,,,\n";
    assert_eq!(trials_to_csv(&trials_from_csv(text, &scene()).unwrap()), text);
}

#[test]
fn accepts_crlf_and_byte_order_mark() {
    let text = format!("\u{feff}{}", GOOD.replace('\n', "\r\n"));
    assert_eq!(trials_from_csv(&text, &scene()).unwrap().len(), 2);
}

/// Each invalid file with a part of its error message.
#[test]
fn rejects_invalid_files_with_line_and_reason() {
    let cases = [
        ("", "empty file"),
        ("trial,t,body,x\na,0,ball,1\n", "\"y\""),
        ("trial,t,body,x,y,z\n", "\"z\""),
        ("trial,t,body,x,y,x\n", "twice"),
        ("trial,t,body,x,y\n", "no observation"),
        ("trial,t,body,x,y\na,0,ball,1\n", "2: 4 cells"),
        ("trial,t,body,x,y\na,0,ball,1,oops\n", "`y` is \"oops\""),
        ("trial,t,body,x,y\na,0,ball,1,NaN\n", "`y` is \"NaN\""),
        ("trial,t,body,x,y\na,0,ball,1,inf\n", "`y` is \"inf\""),
        ("trial,t,body,x,y\na,,ball,1,1\n", "`t` is missing"),
        ("trial,t,body,x,y\n,0,ball,1,1\n", "`trial` is missing"),
        ("trial,t,body,x,y\na,0,bal,1,1\n", "\"ball\", \"cup\""),
        ("trial,t,body,x,y\na,1,ball,1,1\na,0.5,ball,1,1\n", "3: `t` is 0.5"),
        ("trial,t,body,x,y\na,1,ball,1,1\na,1,ball,1,1\n", "3: `t` is 1"),
        ("trial,t,body,x,y\na,0,ball,1,1\nb,0,ball,1,1\na,1,ball,1,1\n", "4: `trial` is \"a\""),
        ("trial,setting,t,body,x,y\na,s,0,ball,1,1\na,r,1,ball,1,1\n", "3: `setting` is \"r\""),
        (
            "trial,t,body,x,y\na,0.00,ball,1.00,1.25\na,0.10,ball,1.00,1.25\na,0.20,ball,1.00,1.25\na,0.30,ball,1.00,1.2",
            "cut off",
        ),
        ("trial,t,body,x,y\na,0.00,ball,1.00,1.25\na,0.10,ba", "3: 3 cells"),
    ];
    for (text, wanted) in cases {
        let error = trials_from_csv(text, &scene()).expect_err(text).to_string();
        assert!(error.contains(wanted), "{text:?} gives {error:?}, without {wanted:?}");
    }
}

#[test]
fn accepts_missing_final_newline() {
    assert_eq!(trials_from_csv(GOOD.trim_end(), &scene()).unwrap().len(), 2);
}
