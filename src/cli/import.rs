//! `iplw import`: a scene with joints from a robot file.

use std::path::PathBuf;

use iplw::error::{Error, Result};
use iplw::task::mechanism_from_xml;

use super::output;

/// Make a scene with joints from a robot file (MJCF or URDF).
///
/// Reads a mechanism whose joints move in one plane: hinges with parallel axes, and slides across them. Masses, inertias, motors, damping,
/// dry friction, limits, springs and armatures become those of a scene (`iplw.scene/2`), which `iplw rollout` and `iplw diagnose` take. Prints
/// what a scene cannot express, such as contacts.
#[derive(clap::Args)]
pub struct Args {
    /// Robot file: MJCF (MuJoCo) or URDF.
    robot: PathBuf,
    /// Output file.
    #[arg(long, default_value = "scene.json")]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<()> {
    let text = std::fs::read_to_string(&args.robot).map_err(|e| Error::io(&args.robot, e))?;
    let found = mechanism_from_xml(&text).map_err(|e| e.in_file(args.robot.display()))?;
    output::prepare_file("--out", &args.out)?;
    output::write_whole(&args.out, (found.scene.to_json() + "\n").as_bytes())?;
    let mut text = format!(
        "{}: {} joints, {} motors\n",
        args.out.display(),
        found.scene.joints.len(),
        found.scene.motors.len()
    );
    found.left_out.iter().for_each(|line| text += &format!("  {line}\n"));
    output::print(&text)
}
