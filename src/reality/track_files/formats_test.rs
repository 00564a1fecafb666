//! Every format of tracking programs is read, in three dialects each, as the same track.

use std::fmt::Write as _;

use super::load::{Subject, TrackFile, load_tracks};
use super::parse_options::TrackParseOptions;
use super::read::read;
use crate::budget::Unlimited;
use crate::task::ball::BallScene;

/// t, x, y of the first trial.
fn rows(text: &str, options: &TrackParseOptions) -> Vec<[f64; 3]> {
    let table = read(text, "film", "ball", options, &Unlimited).unwrap_or_else(|e| panic!("{text:?}: {e}"));
    let first = table.rows[0].trial.clone();
    let rounded = |v: f64| (v * 1e6).round() / 1e6;
    let own = table.rows.into_iter().filter(|r| r.trial == first);
    own.map(|r| [r.t, r.values[0], r.values[1]].map(rounded)).collect()
}

/// The track of all examples: t (s), x and y (m).
const TRACK: [[f64; 3]; 3] = [[0.0, 1.5, 2.0], [0.04, 1.75, -1.25], [0.08, 2.0, -4.0]];

fn check(texts: &[&str], options: &TrackParseOptions) {
    for text in texts {
        assert_eq!(rows(text, options), TRACK, "{text:?}");
    }
}

fn silent() -> TrackParseOptions {
    TrackParseOptions::default()
}

/// 25 frames per second and 1 cm per pixel, rows counted from the top.
fn film() -> TrackParseOptions {
    TrackParseOptions { fps: Some(25.0), metres_per_pixel: Some(0.01), y_down: Some(true), ..silent() }
}

#[test]
fn lines_of_units_and_several_lines_of_names() {
    check(
        &[
            "t,x,y\n(s),(m),(m)\n0,1.5,2\n0.04,1.75,-1.25\n0.08,2,-4\n",
            "Time;X;Y\n[ms];[cm];[cm]\n0;150;200\n40;175;-125\n80;200;-400\n",
            "# t x y\n# units below\ns m m\n0 1.5 2\n0.04 1.75 -1.25\n0.08 2 -4\n",
            "Vernier Format 2\nthrow.cmbl 1/27/2009 11:47:50 .\nData Set\nTime\tX\tY\nt\tx\ty\ns\tm\tm\n\n\
             0\t1.5\t2\n0.04\t1.75\t-1.25\n0.08\t2\t-4\n",
        ],
        &silent(),
    );
}

#[test]
fn trackmate() {
    let spots = "ID0,0,0,9.1,1.5,2,0.0,0.0,0\nID2,2,,9.1,7,7,0.0,0.0,0\nID1,1,0,9.1,1.75,-1.25,0.0,0.04,1\nID3,3,0,9,2,-4,0,0.08,2\n";
    let header = "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME\n";
    let names = "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame\n";
    let units = ",,,(quality),(m),(m),(m),(sec),\n";
    check(&[&format!("{header}{names}{names}{units}{spots}")], &silent());
    check(&[&format!("{header}{names}{units}{spots}"), &format!("{header}{spots}")], &silent());
    let millimetres = TrackParseOptions { y_down: Some(true), ..silent() };
    check(
        &[
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Tracks nTracks=\"1\" spaceUnits=\"mm\" frameInterval=\"40.0\" \
             timeUnits=\"ms\">\n<particle nSpots=\"3\"><detection t=\"0\" x=\"1500\" y=\"-2000\" z=\"0.0\" />\
             <detection t=\"1\" x=\"1750\" y=\"1250\" z=\"0.0\" /><detection t=\"2\" x=\"2000\" y=\"4000\" z=\"0\" />\
             </particle></Tracks>",
            "<TrackMate version=\"7.1\"><Model spatialunits=\"cm\" timeunits=\"sec\"><AllSpots nspots=\"3\"><SpotsInFrame \
             frame=\"0\"><Spot ID=\"8\" POSITION_T=\"0.0\" FRAME=\"0\" POSITION_X=\"150\" POSITION_Y=\"-200\" \
             POSITION_Z=\"0\" /></SpotsInFrame><SpotsInFrame frame=\"1\"><Spot ID=\"5\" POSITION_T=\"0.04\" \
             POSITION_X=\"175\" POSITION_Y=\"125\" POSITION_Z=\"0\">3 1 2</Spot></SpotsInFrame><SpotsInFrame frame=\"2\">\
             <Spot ID=\"6\" POSITION_T=\"0.08\" POSITION_X=\"200\" POSITION_Y=\"400\" POSITION_Z=\"0\" /></SpotsInFrame>\
             </AllSpots><AllTracks><Track name=\"Track_0\" TRACK_ID=\"0\"><Edge SPOT_SOURCE_ID=\"5\" SPOT_TARGET_ID=\"6\" />\
             <Edge SPOT_SOURCE_ID=\"8\" SPOT_TARGET_ID=\"5\" /></Track></AllTracks></Model></TrackMate>",
        ],
        &millimetres,
    );
}

#[test]
fn deeplabcut() {
    let ball = || TrackParseOptions { track: Some("ball".into()), ..film() };
    check(
        &[
            "scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n0,150,-200,1.0\n1,175,125,0.9\n2,200,400,1\n",
        ],
        &film(),
    );
    check(
        &[
            "scorer,net,net,net,net,net,net\nbodyparts,ball,ball,ball,hand,hand,hand\n\
             coords,x,y,likelihood,x,y,likelihood\n0,150,-200,1.0,1,1,1\n1,175,125,0.9,1,1,1\n2,200,400,1,1,1,1\n",
            "scorer,net,net\nbodyparts,ball,ball\ncoords,x,y\n0,150,-200\n1,175,125\n2,200,400\n",
            "scorer,net,net,net\nindividuals,single,single,single\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n\
             0,150,-200,1.0\n1,175,125,0.9\n2,200,400,1\n",
        ],
        &ball(),
    );
    // Unlikely detections are missing.
    let text =
        "scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n0,150,-200,1.0\n1,9,9,0.2\n";
    let table = read(text, "film", "ball", &film(), &Unlimited).unwrap();
    assert!(
        table.rows[1].values[0].is_nan()
            && table.notes.iter().any(|n| n.contains("1 points with a likelihood"))
    );
}

#[test]
fn vernier_and_capstone() {
    check(
        &[
            "VideoAnalysis: Time (s)\tVideoAnalysis: X (m)\tVideoAnalysis: Y (m)\tVideoAnalysis: X Velocity (m/s)\n\
             0\t1.5\t2\t\n0.04\t1.75\t-1.25\t\n0.08\t2\t-4\t\n",
            "Latest: Time (s);Latest: X (cm);Latest: Y (cm)\n0,00;150,0;200\n0,04;175;-125,0\n0,08;200;-400\n",
            "Data Set 1:Time(s),Data Set 1:X(m),Data Set 1:Y(m),Data Set 2:Time(s),Data Set 2:X(m),Data Set 2:Y(m)\n\
             0,1.5,2,0,0,0\n0.04,1.75,-1.25,0.1,0,0\n0.08,2,-4,,,\n",
            "Time (s) Run #1,X (m) Run #1,Y (m) Run #1,Time (s) Run #2,X (m) Run #2,Y (m) Run #2\n\
             0,1.5,2,0,0,0\n0.04,1.75,-1.25,0.1,0,0\n0.08,2,-4,,,\n",
            "Time (s),X (m) Run #1,Y (m) Run #1,X (m) Run #2,Y (m) Run #2\n0,1.5,2,0,0\n0.04,1.75,-1.25,0,0\n0.08,2,-4,,\n",
        ],
        &silent(),
    );
}

#[test]
fn qualisys() {
    let properties = "NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t1\nFREQUENCY\t25\nNO_OF_ANALOG\t0\n\
                      DESCRIPTION\t--\nDATA_INCLUDED\t3D\nMARKER_NAMES\tball\n";
    let data = "1500\t2000\t7\n1750\t-1250\t7\n2000\t-4000\t7\n";
    let framed = "1\t0.00\t1500\t2000\t7\n2\t0.04\t1750\t-1250\t7\n3\t0.08\t2000\t-4000\t7\n";
    check(
        &[
            &format!("{properties}{data}"),
            &format!(
                "FILE_VERSION\t2.0.0\n{properties}TRAJECTORY_TYPES\tMeasured\nball X\tball Y\tball Z\n{data}"
            ),
            &format!("{properties}Frame\tTime\tball X\tball Y\tball Z\n{framed}"),
        ],
        &silent(),
    );
}

#[test]
fn kinovea() {
    check(
        &[
            "#Kinovea Trajectory data export\n#T X Y\n\n# ball\n0.000 1,50 2,00 \n0.040 1,75 -1,25 \n0.080 2,0 -4,0 \n",
            "#Kinovea Trajectory data export\r\n#T X Y\r\n0 1.5 2.0\r\n0.04 1.75 -1.25\r\n0.08 2 -4\r\n\r\n",
            "\"Time\",\"ball/0/X\",\"ball/0/Y\"\r\n\"0,00\",\"1,5\",\"2\"\r\n\"0,04\",\"1,75\",\"-1,25\"\r\n\"0,08\",\"2\",\"-4\"\r\n",
            "\"Time (ms)\";\"X (cm)\";\"Y (cm)\"\n\"0\";\"150\";\"200\"\n\"40\";\"175\";\"-125\"\n\"80\";\"200\";\"-400\"\n",
        ],
        &silent(),
    );
    let two = "#Kinovea Trajectory data export\n#T X Y\n\n# hand\n0 9 9\n0.04 9 9\n\n# ball\n0 1.5 2\n0.04 1.75 -1.25\n0.08 2 -4\n";
    check(&[two], &TrackParseOptions { track: Some("ball".into()), ..silent() });
}

/// A project of Tracker: 100 pixels per unit, origin at (50, 300).
fn project(unit: &str, scale: f64, points: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<object class=\"org.opensourcephysics.cabrillo.tracker.TrackerPanel\">\n\
         <property name=\"videoclip\" type=\"object\"><object class=\"org.opensourcephysics.media.core.VideoClip\">\n\
         <property name=\"startframe\" type=\"int\">5</property><property name=\"starttime\" type=\"double\">0.0</property>\n\
         </object></property><property name=\"clipcontrol\" type=\"object\">\n\
         <object class=\"org.opensourcephysics.media.core.StepperClipControl\">\n\
         <property name=\"delta_t\" type=\"double\">40.0</property></object></property>\n\
         <property name=\"coords\" type=\"object\"><object class=\"org.opensourcephysics.media.core.ImageCoordSystem\">\n\
         <property name=\"framedata\" type=\"array\"><property name=\"[0]\" type=\"object\">\n\
         <object class=\"org.opensourcephysics.media.core.ImageCoordSystem$FrameData\">\n\
         <property name=\"xorigin\" type=\"double\">50.0</property><property name=\"yorigin\" type=\"double\">300.0</property>\n\
         <property name=\"angle\" type=\"double\">0.0</property><property name=\"xscale\" type=\"double\">{scale}</property>\n\
         <property name=\"yscale\" type=\"double\">{scale}</property></object></property></property></object></property>\n\
         {unit}<property name=\"tracks\" type=\"collection\"><property name=\"item\" type=\"object\">\n\
         <object class=\"org.opensourcephysics.cabrillo.tracker.PointMass\"><property name=\"name\" type=\"string\">ball</property>\n\
         <property name=\"framedata\" type=\"array\">{points}</property></object></property></property></object>\n"
    )
}

fn point(frame: usize, x: f64, y: f64) -> String {
    format!(
        "<property name=\"[{frame}]\" type=\"object\"><object class=\"org.opensourcephysics.cabrillo.tracker.PointMass$FrameData\">\
         <property name=\"x\" type=\"double\">{x}</property><property name=\"y\" type=\"double\">{y}</property></object></property>\n"
    )
}

#[test]
fn tracker_projects() {
    let points = [point(5, 200.0, 100.0), point(6, 225.0, 425.0), point(7, 250.0, 700.0)].concat();
    let unit = |unit: &str| format!("<property name=\"length_unit\" type=\"string\">{unit}</property>\n");
    check(&[&project(&unit("m"), 100.0, &points), &project("", 100.0, &points)], &silent());
    check(
        &[&project(&unit("cm"), 1.0, &points)],
        &TrackParseOptions { metres_per_pixel: Some(0.01), ..silent() },
    );
    // An uncalibrated project needs the size of a pixel.
    let error = read(&project(&unit("m"), 1.0, &points), "film", "ball", &silent(), &Unlimited);
    assert!(error.map(|_| ()).unwrap_err().to_string().contains("`metres_per_pixel`"));
}

#[test]
fn clocks_and_columns_without_names() {
    let frames = TrackParseOptions { fps: Some(25.0), ..silent() };
    check(
        &[
            "x,y\n1.5,2\n1.75,-1.25\n2,-4\n",
            "X;Y\n1,5;2\n1,75;-1,25\n2;-4\n",
            "y x\n2 1.5\n-1.25 1.75\n-4 2\n",
        ],
        &frames,
    );
    check(
        &[
            "x,y,dt\n1.5,2,0.04\n1.75,-1.25,0.04\n2,-4,0.04\n",
            "dt (ms);x;y\n0;1,5;2\n40;1,75;-1,25\n40;2;-4\n",
            "delta_t x y\n0.04 1.5 2\n0.04 1.75 -1.25\n0.04 2 -4\n",
        ],
        &silent(),
    );
    let named = |columns: &str| TrackParseOptions { columns: Some(columns.into()), ..silent() };
    check(&["0,1.5,2\n0.04,1.75,-1.25\n0.08,2,-4\n"], &named("t,x,y"));
    check(&["my film\n2;1,5;0\n-1,25;1,75;40\n-4;2;80\n"], &named("y,x,t_ms"));
    check(&["1.5 2\n1.75 -1.25\n2 -4"], &TrackParseOptions { fps: Some(25.0), ..named("x,y") });
    // Decimal commas between commas.
    check(&["t,x,y\n0,00,1,50,2,00\n0,04,1,75,-1,25\n0,08,2,00,-4,00\n"], &silent());
}

#[test]
fn track_numbers_of_images() {
    check(
        &[
            " \tTrack n°\tSlice n°\tX\tY\tDistance\n1\t1\t0\t150\t-200\t-1\n2\t1\t1\t175\t125\t3\n3\t1\t2\t200\t400\t3\n",
            "Track n°,Slice n°,X,Y\n1,0,150,-200\n1,1,175,125\n1,2,200,400\n2,0,9,9\n",
            ",y,x,mass,frame,particle\n0,-200,150,3,0,0\n1,9,9,3,0,1\n2,125,175,3,1,0\n3,400,200,3,2,0\n",
        ],
        &film(),
    );
}

/// A throw in pixels of 2.5 mm, rows counted from the top, with the radius of the ball in pixels.
fn film_of_throw(names: &str) -> TrackFile {
    let mut text = format!("{names}\n");
    for i in 0..40 {
        let t = f64::from(i) / 60.0;
        let (x, y) = (400.0 * t, 900.0 - 400.0 * (2.5 * t - 4.905 * t * t));
        let _ = writeln!(text, "{t:.5},{x:.2},{y:.2},8");
    }
    TrackFile { name: "throw.csv".into(), text }
}

fn load_ball(file: TrackFile, reading: &TrackParseOptions) -> crate::error::Result<(Vec<f64>, String)> {
    let ball = BallScene { radius: 0.02, mass: None, gravity: None, floor: None };
    let loaded = load_tracks(&[file], Subject::Ball(&ball), reading, &Unlimited)?;
    Ok((loaded.trials[0].observed.bodies[0].y.clone(), loaded.notes.join("\n")))
}

/// The size of a pixel follows from the ball's radius, and rows count downwards; notes report both.
#[test]
fn pixels_by_the_radius_of_the_ball() {
    for names in ["t,x (px),y (px),radius (px)", "time,x_px,y_px,ball_radius_px"] {
        let (y, notes) = load_ball(film_of_throw(names), &silent()).unwrap();
        let highest = y.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!((highest - y[0] - 2.5 * 2.5 / 2.0 / 9.81).abs() < 1e-3, "{names}: {}", highest - y[0]);
        assert!(notes.contains("a pixel is 2.5000e-3 m") && notes.contains("y counts downwards"), "{notes}");
    }
    // Half of a diameter.
    let (_, notes) = load_ball(film_of_throw("t,x (px),y (px),diameter (px)"), &silent()).unwrap();
    assert!(notes.contains("a pixel is 5.0000e-3 m"), "{notes}");
    // A size that is given counts.
    let given = TrackParseOptions { metres_per_pixel: Some(0.003), ..silent() };
    assert!(
        !load_ball(film_of_throw("t,x (px),y (px),radius (px)"), &given).unwrap().1.contains("a pixel is")
    );
}

/// Without a radius the error says for which size the tracks fall with gravity.
#[test]
fn size_of_a_pixel_is_suggested() {
    let error = load_ball(film_of_throw("t,x (px),y (px),area"), &silent()).unwrap_err().to_string();
    assert!(error.contains("in pixels") && error.contains("with 2.500e-3 they fall"), "{error}");
}

/// The error of one bad file among good ones says how to leave it out, and that works.
#[test]
fn one_bad_file_can_be_left_out() {
    let ball = BallScene { radius: 0.02, mass: None, gravity: None, floor: None };
    let good = film_of_throw("t,x (px),y (px),radius (px)");
    let bad = TrackFile { name: "notes.csv".into(), text: "nothing,here\n1,2\n".into() };
    let load = |files: &[TrackFile], reading: &TrackParseOptions| {
        load_tracks(files, Subject::Ball(&ball), reading, &Unlimited)
    };
    let scaled = TrackParseOptions { metres_per_pixel: Some(0.0025), ..silent() };
    let error = load(&[good.clone(), bad.clone()], &scaled).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("notes.csv") && error.contains("`skip_bad`"), "{error}");
    let skipping = TrackParseOptions { skip_bad: Some(true), ..scaled.clone() };
    assert_eq!(load(&[good, bad.clone()], &skipping).unwrap().trials.len(), 1);
    let alone = load(&[bad], &scaled).map(|_| ()).unwrap_err().to_string();
    assert!(!alone.contains("skip_bad"), "{alone}");
}
