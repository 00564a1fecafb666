//! Posterior intervals beside those of the prior, each parameter on the scale of its prior.

use std::fmt::Write;

use super::scene::document;
use super::svg::{escape, px};
use super::theme::{Meaning, light};

/// A parameter's posterior and prior.
#[derive(Clone, Debug, PartialEq)]
pub struct IntervalRow {
    pub name: String,
    /// The estimate as text.
    pub text: String,
    /// Ends of the scale: the prior's.
    pub scale: [f64; 2],
    /// 2.5, 25, 50, 75 and 97.5 % quantiles.
    pub quantiles: [f64; 5],
    /// The true value, if it is known.
    pub truth: Option<f64>,
}

/// Columns of names, bars and texts, and the height of a row, px.
const NAME_WIDTH_PX: f64 = 190.0;
const BAR_WIDTH_PX: f64 = 360.0;
const TEXT_WIDTH_PX: f64 = 210.0;
const ROW_HEIGHT_PX: f64 = 34.0;

/// One row for each parameter: the prior's range as a grey bar, the 95 % interval as a line, the central 50 % as a bar, the median as a
/// dot.
pub fn intervals_svg(title: &str, rows: &[IntervalRow]) -> String {
    let mut body = String::new();
    for (i, row) in rows.iter().enumerate() {
        let y = (i as f64 + 0.5) * ROW_HEIGHT_PX;
        let [low, high] = row.scale;
        let at = |v: f64| {
            NAME_WIDTH_PX + BAR_WIDTH_PX * ((v - low) / (high - low).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
        };
        let text = |x: f64, anchor: &str, text: &str| {
            format!(
                "<text x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\" font-family=\"sans-serif\" font-size=\"13\" fill=\"{}\">{}</text>\n",
                px(x),
                px(y + 4.5),
                light("ink"),
                escape(text)
            )
        };
        body += &text(NAME_WIDTH_PX - 12.0, "end", &row.name);
        body += &text(NAME_WIDTH_PX + BAR_WIDTH_PX + 12.0, "start", &row.text);
        let bar = |from: f64, to: f64, half: f64, colour: &str| {
            let (x, width) = (at(from), (at(to) - at(from)).max(1.0));
            let (y, height) = (y - half, 2.0 * half);
            format!(
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"2\" fill=\"{colour}\"/>\n",
                px(x),
                px(y),
                px(width),
                px(height)
            )
        };
        let [q2, q25, q50, q75, q97] = row.quantiles;
        let extended = Meaning::Extended.colour();
        body += &bar(low, high, 2.0, light("line"));
        body += &bar(q2, q97, 1.5, extended);
        body += &bar(q25, q75, 4.5, extended);
        let _ = writeln!(
            body,
            "<circle cx=\"{}\" cy=\"{}\" r=\"4\" fill=\"{}\" stroke=\"{extended}\" stroke-width=\"2\"/>",
            px(at(q50)),
            px(y),
            light("scene")
        );
        if let Some(truth) = row.truth {
            body += &bar(truth, truth, 9.0, Meaning::Truth.colour());
        }
    }
    let width = NAME_WIDTH_PX + BAR_WIDTH_PX + TEXT_WIDTH_PX;
    document(width, rows.len().max(1) as f64 * ROW_HEIGHT_PX, title, &body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::check_svg;

    #[test]
    fn rows_have_their_bars_and_texts() {
        let row = |truth| IntervalRow {
            name: "fric<tion>".into(),
            text: "0.5".into(),
            scale: [0.0, 1.0],
            quantiles: [0.4, 0.45, 0.5, 0.55, 7.0],
            truth,
        };
        let svg = intervals_svg("posterior", &[row(None), row(Some(0.5))]);
        check_svg(&svg);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert_eq!(svg.matches(Meaning::Truth.colour()).count(), 1);
        check_svg(&intervals_svg("none", &[]));
    }
}
