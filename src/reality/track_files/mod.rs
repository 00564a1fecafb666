//! Files of measured tracks: from the formats of tracking programs to trials of a scene.

mod columns;
mod deeplabcut;
mod floor;
mod formats;
#[cfg(test)]
mod formats_test;
mod header;
mod kinovea;
mod load;
mod parse_options;
mod path_fit;
mod pixel_scale;
mod qualisys;
mod read;
mod repeated_frames;
mod selection;
mod size;
mod strokes;
#[cfg(test)]
mod strokes_test;
mod table;
mod times;
mod track_rows;
mod tracker_project;
mod trackmate_xml;
mod unit_checks;
mod vertical_plane;
mod xml;

pub use load::{LoadedTrials, Subject, TrackFile, load_tracks};
pub use parse_options::TrackParseOptions;
pub use size::check_cells;
pub use track_rows::{TrackRow, assemble, check_complete, invalid_value};
