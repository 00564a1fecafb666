//! Limits on the size of trial files. Parsed cells take many times the memory of their text.

use crate::error::{Error, Result};
use crate::task::Scene;

/// Largest number of cells of all files of a request. Parsing keeps a few hundred bytes a row, so this many take less than 512 MB.
pub const MAX_CELLS: u64 = 2_000_000;
/// Text of one cell beyond which it counts as several, bytes.
const BYTES_PER_CELL: u64 = 64;
/// Largest number of files of a request.
pub const MAX_FILES: usize = 1000;
/// Largest number of columns of a file.
pub const MAX_COLUMNS: usize = 1000;
/// Largest number of trials: each is compared with all others in places.
pub const MAX_TRIALS: usize = 5000;
/// Largest number of corners of the scenes of all trials together, of which each trial has a copy.
const MAX_TRIAL_CORNERS: usize = 4_000_000;

/// Errors if files hold too many cells; an upper bound of their number is counted, without parsing.
pub fn check_cells<'a>(texts: impl IntoIterator<Item = &'a str>) -> Result<()> {
    let asked: u64 = texts.into_iter().map(cells).sum();
    if asked <= MAX_CELLS {
        return Ok(());
    }
    let advice = "leave out frames, columns that are not used, or trials";
    Err(Error::TooLarge { what: "cells of the trial files", asked, limit: MAX_CELLS, advice })
}

/// Separators of cells, of lines and of XML attributes, and runs of blanks; long cells count as several.
fn cells(text: &str) -> u64 {
    let mut before = b'\n';
    let mut count = text.len() as u64 / BYTES_PER_CELL;
    for byte in text.bytes() {
        count += u64::from(match byte {
            b',' | b';' | b'\t' | b'<' | b'=' => true,
            b' ' | b'\n' | b'\r' => !matches!(before, b' ' | b'\n' | b'\r'),
            _ => false,
        });
        before = byte;
    }
    count
}

/// Errors if there are too many trials, or too many for the size of their scene.
pub fn check_trials(trials: usize, scene: &Scene) -> Result<()> {
    let most = (MAX_TRIAL_CORNERS / scene.corner_count().max(1)).min(MAX_TRIALS);
    if trials <= most {
        return Ok(());
    }
    let advice = "leave out trials, or simplify the shapes of the scene";
    Err(Error::TooLarge { what: "trials", asked: trials as u64, limit: most as u64, advice })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_at_least_the_cells_of_each_format() {
        for (text, least) in [
            ("t,x,y\n0,1,2\n", 6),
            ("t x   y\r\n0 1  2\r\n", 6),
            (",,,\n", 4),
            ("<a b=\"1\"/>", 2),
            (&"9".repeat(6400), 100),
        ] {
            assert!((least..=2 * least).contains(&cells(text)), "{text:?}: {}", cells(text));
        }
    }

    #[test]
    fn too_many_cells_are_refused_with_their_number() {
        let line = "0.1,0.2,0.3\n";
        let text = line.repeat(MAX_CELLS as usize / 3);
        assert!(check_cells([text.as_str()]).is_ok() || text.len() as u64 / BYTES_PER_CELL > 2);
        let error = check_cells([text.as_str(), text.as_str()]).unwrap_err().to_string();
        assert!(error.contains("at most 2000000") && error.contains("leave out"), "{error}");
    }
}
