//! Scenes, animations and plots as SVG and PNG, and self-contained HTML reports.
//!
//! All functions are pure: the same data gives the same bytes on every machine. Names come from users, so all text is escaped.
//! Pictures of scenes contain no text unless [`Style::names`] is set.
//!
//! [`scene_svg, scene_svg_within`] draws a scene; [`filmstrip_svg`], [`trails_svg`] and [`animation_svg`] a trajectory in it; [`animation_png`] an animated
//! PNG; [`final_frame_svg`] its last frame; [`contact_sheet_svg`] a contact sheet; [`overlay_svg`] measured over simulated trajectories; [`plan_svgs`] plans; [`plot`] plots data;
//! [`surface`] draws performance surfaces; [`svg_to_png`] rasterises any of them, and [`HtmlReport`] is a page.

pub mod animation;
pub mod apng;
pub mod contact_sheet;
pub mod intervals;
pub mod overlay;
mod plan;
pub mod plot;
pub mod png;
pub mod report;
pub mod scene;
mod success_map;
pub mod surface;
mod svg;
pub mod theme;
mod viewport;

pub use animation::{animation_svg, filmstrip_svg, trails_svg};
pub use apng::{animation_png, final_frame_svg};
pub use contact_sheet::contact_sheet_svg;
pub use intervals::{IntervalRow, intervals_svg};
pub use overlay::{OverlayPanel, overlay_svg};
pub use plan::plan_svgs;
pub use png::{svg_to_png, svg_to_png_within, svg_to_rgb};
pub use report::{Block, HtmlReport, Section};
pub use scene::{Style, scene_svg, scene_svg_within};
pub use success_map::success_map_svg;
pub use svg::{colour, escape};
