//! Rasterises SVG by resvg. Text is drawn in DejaVu Sans, which is built in; the machine's fonts are ignored, so pictures are the
//! same everywhere.

use std::io::Write;
use std::sync::{Arc, OnceLock};

use png::{BitDepth, ColorType, Encoder};
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{ImageHrefResolver, Options, Tree, fontdb};

use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result};

/// A PNG file `width` px wide (16 to 4096), its height from the picture's aspect (at most 4096), on white.
pub fn svg_to_png(svg: &str, width: u32) -> Result<Vec<u8>> {
    svg_to_png_within(&Unlimited, svg, width)
}

/// [`svg_to_png`] within a budget, which is checked before drawing and between the strips that are compressed (which takes most of the
/// time). An error of the budget is returned.
pub fn svg_to_png_within(budget: &dyn Budget, svg: &str, width: u32) -> Result<Vec<u8>> {
    let width = checked_side("width", width)?;
    let tree = parse(svg)?;
    budget.check()?;
    let pixmap = draw(&tree, width, height(&tree, width)?)?;
    budget.check()?;
    encode_png(&pixmap, budget)
}

/// Encodes a PNG file, strip by strip. All pixels are opaque and need no demultiplication by alpha.
fn encode_png(pixmap: &Pixmap, budget: &dyn Budget) -> Result<Vec<u8>> {
    let failed = |e: &dyn std::fmt::Display| Error::Failed(format!("encoding the PNG: {e}"));
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, pixmap.width(), pixmap.height());
    encoder.set_color(ColorType::Rgba);
    encoder.set_depth(BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(|e| failed(&e))?;
    let mut rows = writer.stream_writer().map_err(|e| failed(&e))?;
    for strip in pixmap.data().chunks((4 * pixmap.width() * STRIP_HEIGHT_PX) as usize) {
        budget.check()?;
        rows.write_all(strip).map_err(|e| failed(&e))?;
    }
    rows.finish().map_err(|e| failed(&e))?;
    drop(writer);
    Ok(bytes)
}

/// `height` x `width` x 3 bytes, rows from the top, red green blue; the picture is scaled to fit (both sizes
/// 16 to 4096) and centred on white.
pub fn svg_to_rgb(svg: &str, width: u32, height: u32) -> Result<Vec<u8>> {
    let (width, height) = (checked_side("width", width)?, checked_side("height", height)?);
    let pixmap = draw(&parse(svg)?, width, height)?;
    // All pixels are opaque and need no demultiplication by alpha.
    Ok(pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect())
}

/// Height of a strip, px: about ten milliseconds of work at the maximal width.
const STRIP_HEIGHT_PX: u32 = 256;
const MIN_SIDE_PX: u32 = 16;
const MAX_SIDE_PX: u32 = 4096;

/// Checks a side of a picture, px.
pub(super) fn checked_side(field: &str, v: u32) -> Result<u32> {
    if (MIN_SIDE_PX..=MAX_SIDE_PX).contains(&v) {
        Ok(v)
    } else {
        Err(Error::input(field, v, format!("pixels from {MIN_SIDE_PX} to {MAX_SIDE_PX}")))
    }
}

/// Height of a picture that is to be `width` px wide, px.
pub(super) fn height(tree: &Tree, width: u32) -> Result<u32> {
    let scale = f64::from(width) / f64::from(tree.size().width());
    let height = (f64::from(tree.size().height()) * scale).round();
    if height > f64::from(MAX_SIDE_PX) {
        let most = (f64::from(width) * f64::from(MAX_SIDE_PX) / height).floor();
        let allowed =
            format!("at most {most} for this picture, so that its height stays within {MAX_SIDE_PX}");
        return Err(Error::input("width", width, allowed));
    }
    Ok(height.max(1.0) as u32)
}

/// Parses an SVG document.
pub(super) fn parse(svg: &str) -> Result<Tree> {
    // Linked images are ignored: no files are read.
    let none =
        ImageHrefResolver { resolve_data: Box::new(|_, _, _| None), resolve_string: Box::new(|_, _| None) };
    let options = Options { image_href_resolver: none, fontdb: fonts(), ..Options::default() };
    Tree::from_str(svg, &options).map_err(|e| Error::input("svg", e, "a well-formed SVG document"))
}

/// A single font for all family names.
fn fonts() -> Arc<fontdb::Database> {
    static FONTS: OnceLock<Arc<fontdb::Database>> = OnceLock::new();
    let load = || {
        let mut all = fontdb::Database::new();
        all.load_font_data(dejavu::sans::regular().to_vec());
        for set in [
            fontdb::Database::set_sans_serif_family,
            fontdb::Database::set_serif_family,
            fontdb::Database::set_monospace_family,
        ] {
            set(&mut all, "DejaVu Sans".to_string());
        }
        Arc::new(all)
    };
    FONTS.get_or_init(load).clone()
}

/// Draws a picture on white.
pub(super) fn draw(tree: &Tree, width: u32, height: u32) -> Result<Pixmap> {
    let mut pixmap = Pixmap::new(width, height)
        .ok_or_else(|| Error::input("width", width, "a size that fits in memory"))?;
    pixmap.fill(Color::WHITE);
    draw_over(tree, &mut pixmap);
    Ok(pixmap)
}

/// Draws a picture over another, scaled to fit.
pub(super) fn draw_over(tree: &Tree, pixmap: &mut Pixmap) {
    let (w, h) = (pixmap.width() as f32, pixmap.height() as f32);
    let scale = (w / tree.size().width()).min(h / tree.size().height());
    let (dx, dy) = ((w - scale * tree.size().width()) / 2.0, (h - scale * tree.size().height()) / 2.0);
    resvg::render(tree, Transform::from_row(scale, 0.0, 0.0, scale, dx, dy), &mut pixmap.as_mut());
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    const HALVES: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" width="20" height="10" viewBox="0 0 20 10">
        <rect width="10" height="10" fill="#ff0000"/><image href="/etc/hostname" width="20" height="10"/></svg>"##;

    #[test]
    fn rasterises_at_the_right_place() {
        let rgb = svg_to_rgb(HALVES, 40, 20).unwrap();
        assert_eq!(rgb.len(), 40 * 20 * 3);
        let at = |x: usize, y: usize| {
            [rgb[(y * 40 + x) * 3], rgb[(y * 40 + x) * 3 + 1], rgb[(y * 40 + x) * 3 + 2]]
        };
        assert_eq!((at(5, 5), at(35, 5)), ([255, 0, 0], [255, 255, 255]));
        // Another aspect ratio: fitted and centred on white.
        let square = svg_to_rgb(HALVES, 40, 40).unwrap();
        let at = |x: usize, y: usize| square[(y * 40 + x) * 3 + 1];
        assert_eq!((at(5, 5), at(5, 20), at(5, 35)), (255, 0, 255));
    }

    #[test]
    fn budget_stops_compression_between_strips() {
        struct CountingBudget(AtomicU32);
        impl Budget for CountingBudget {
            fn check(&self) -> Result<()> {
                if self.0.fetch_sub(1, Ordering::Relaxed) == 0 { Err(Error::Cancelled) } else { Ok(()) }
            }
        }
        let within =
            |looks| svg_to_png_within(&CountingBudget(AtomicU32::new(looks)), HALVES, 8 * STRIP_HEIGHT_PX);
        // One check before and one after drawing, then one before each of four strips.
        for looks in 0..6 {
            assert_eq!(within(looks), Err(Error::Cancelled), "{looks}");
        }
        let whole = within(6).unwrap();
        // The picture is complete when decoded.
        let mut reader = png::Decoder::new(std::io::Cursor::new(&whole)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(
            pixels,
            draw(&parse(HALVES).unwrap(), 8 * STRIP_HEIGHT_PX, 4 * STRIP_HEIGHT_PX).unwrap().data()
        );
    }

    #[test]
    fn draws_text() {
        let svg = |text: &str| {
            format!(
                "<svg xmlns='http://www.w3.org/2000/svg' width='80' height='20'><text x='2' y='15' \
                 font-family='sans-serif' font-size='14'>{text}</text></svg>"
            )
        };
        let dark = |text: &str| {
            let rgb = svg_to_rgb(&svg(text), 80, 20).unwrap();
            rgb.chunks(3).filter(|p| p[0] < 100).count()
        };
        assert_eq!(dark(""), 0);
        assert!(dark("m/s") > 20 && dark("m/s m/s") > dark("m/s"), "{} {}", dark("m/s"), dark("m/s m/s"));
    }

    #[test]
    fn png_has_the_requested_width() {
        let png = svg_to_png(HALVES, 100).unwrap();
        assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
        assert_eq!(&png[16..24], &[0, 0, 0, 100, 0, 0, 0, 50]);
        assert_eq!(png, svg_to_png(HALVES, 100).unwrap());
    }

    #[test]
    fn rejects_invalid_sizes_and_documents_by_name() {
        let refused = |r: Result<Vec<u8>>, field: &str| match r {
            Err(Error::Input(i)) => assert_eq!(i.field, field, "{i}"),
            other => panic!("{:?}", other.map(|v| v.len())),
        };
        for width in [0, 15, 4097, u32::MAX] {
            refused(svg_to_png(HALVES, width), "width");
            refused(svg_to_rgb(HALVES, width, 64), "width");
            refused(svg_to_rgb(HALVES, 64, width), "height");
        }
        for width in [16, 4096] {
            assert!(svg_to_png(HALVES, width).is_ok());
        }
        let tower = r#"<svg xmlns="http://www.w3.org/2000/svg" width="10" height="1000"/>"#;
        refused(svg_to_png(tower, 41), "width");
        assert!(svg_to_png(tower, 40).is_ok());
        for text in ["", "<svg", "hello", "<svg xmlns='http://www.w3.org/2000/svg' width='0' height='1'/>"] {
            refused(svg_to_png(text, 64), "svg");
        }
    }
}
