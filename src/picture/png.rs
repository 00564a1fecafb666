//! SVG to pixels, by resvg. Text is not drawn: there are no fonts to rely on.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{ImageHrefResolver, Options, Tree};

use crate::error::{Error, Result};

/// A PNG file `width` px wide (16 to 4096), its height from the picture's aspect (at most 4096), on white.
pub fn svg_to_png(svg: &str, width: u32) -> Result<Vec<u8>> {
    let width = bounded("width", width)?;
    let tree = parse(svg)?;
    let scale = f64::from(width) / f64::from(tree.size().width());
    let height = (f64::from(tree.size().height()) * scale).round();
    if height > f64::from(LARGEST) {
        let most = (f64::from(width) * f64::from(LARGEST) / height).floor();
        let allowed = format!("at most {most} for this picture, so that its height stays within {LARGEST}");
        return Err(Error::input("width", width, allowed));
    }
    let pixmap = draw(&tree, width, height.max(1.0) as u32)?;
    pixmap.encode_png().map_err(|e| Error::Failed(format!("encoding the PNG: {e}")))
}

/// `height` x `width` x 3 bytes, rows from the top, red green blue; the picture is scaled to fit (both sizes
/// 16 to 4096) and centred on white.
pub fn svg_to_rgb(svg: &str, width: u32, height: u32) -> Result<Vec<u8>> {
    let (width, height) = (bounded("width", width)?, bounded("height", height)?);
    let pixmap = draw(&parse(svg)?, width, height)?;
    // Drawn over opaque white, so every pixel is opaque and needs no demultiplying.
    Ok(pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect())
}

const SMALLEST: u32 = 16;
const LARGEST: u32 = 4096;

fn bounded(field: &str, v: u32) -> Result<u32> {
    if (SMALLEST..=LARGEST).contains(&v) {
        Ok(v)
    } else {
        Err(Error::input(field, v, format!("pixels from {SMALLEST} to {LARGEST}")))
    }
}

fn parse(svg: &str) -> Result<Tree> {
    // Linked images are left out: nothing is read from disk.
    let none =
        ImageHrefResolver { resolve_data: Box::new(|_, _, _| None), resolve_string: Box::new(|_, _| None) };
    let options = Options { image_href_resolver: none, ..Options::default() };
    Tree::from_str(svg, &options).map_err(|e| Error::input("svg", e, "a well-formed SVG document"))
}

fn draw(tree: &Tree, width: u32, height: u32) -> Result<Pixmap> {
    let mut pixmap = Pixmap::new(width, height)
        .ok_or_else(|| Error::input("width", width, "a size that fits in memory"))?;
    pixmap.fill(Color::WHITE);
    let (w, h) = (width as f32, height as f32);
    let scale = (w / tree.size().width()).min(h / tree.size().height());
    let (dx, dy) = ((w - scale * tree.size().width()) / 2.0, (h - scale * tree.size().height()) / 2.0);
    resvg::render(tree, Transform::from_row(scale, 0.0, 0.0, scale, dx, dy), &mut pixmap.as_mut());
    Ok(pixmap)
}
