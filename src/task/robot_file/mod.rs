//! Planar mechanisms from robot files: MJCF (MuJoCo) and URDF.
//!
//! Both are read as links in space ([`spatial`]); if all of them move in one plane they become a scene with joints
//! ([`planar`]). The result lists everything in the file that a scene cannot express.

mod attributes;
mod mjcf;
mod planar;
mod spatial;
mod urdf;

use roxmltree::{Document, ParsingOptions};

use crate::error::{Error, Result};
pub use planar::ImportedMechanism;

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: usize = 16 << 20;

/// Reads MJCF (`<mujoco>`) or URDF (`<robot>`).
///
/// # Errors
/// If the file is neither, names a joint that leaves the plane, or has a moving link without mass.
pub fn mechanism_from_xml(text: &str) -> Result<ImportedMechanism> {
    if text.len() > MAX_FILE_BYTES {
        let allowed = format!("at most {MAX_FILE_BYTES} bytes");
        return Err(Error::input("file", format!("{} bytes", text.len()), allowed));
    }
    let options = ParsingOptions { allow_dtd: false, nodes_limit: 1 << 20, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)
        .map_err(|e| Error::input("file", e.to_string(), "an XML file: MJCF or URDF"))?;
    let root = document.root_element();
    let model = match root.tag_name().name() {
        "mujoco" => mjcf::read(root)?,
        "robot" => urdf::read(root)?,
        other => {
            return Err(Error::input("file", format!("<{other}>"), "<mujoco> (MJCF) or <robot> (URDF)"));
        }
    };
    planar::scene(model)
}
