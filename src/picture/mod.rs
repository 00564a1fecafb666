//! Scenes, films and plots as SVG and PNG, and the self-contained HTML report.
//!
//! Data in, strings out: the same data gives the same bytes on every machine. Names come from users, so every
//! text is escaped. Pictures of scenes hold no text unless [`Style::names`] asks for it.
//!
//! [`scene_svg`] draws a scene, [`filmstrip_svg`], [`trails_svg`] and [`animation_svg`] a trajectory in it,
//! [`film_png`] its film in pixels, [`end_svg`] how it ended,
//! [`sheet_svg`] is a contact sheet, [`plan_svgs`] draws plans, [`plot`] draws numbers, [`surface`] what performance asks of the latents, [`svg_to_png`] makes pixels of any of them, and [`Report`] binds them into a page.

mod chances;
pub mod film;
mod plan;
pub mod plot;
pub mod png;
pub mod reel;
pub mod report;
pub mod scene;
pub mod sheet;
pub mod surface;
mod svg;

pub use chances::chances_svg;
pub use film::{animation_svg, filmstrip_svg, trails_svg};
pub use plan::plan_svgs;
pub use png::{svg_to_png, svg_to_png_within, svg_to_rgb};
pub use reel::{end_svg, film_png};
pub use report::{Block, Report, Section};
pub use scene::{Style, scene_svg};
pub use sheet::sheet_svg;
pub use svg::{colour, escape};
