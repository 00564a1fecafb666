//! Values on axes and colours: ranges, short numbers, the palette and the heat scale.

use std::ops::Range;

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::RGBColor;

use crate::picture::svg::{PALETTE, channels, decimals};
use crate::picture::theme::light;

/// Whether a value can be drawn; beyond 1e100 the arithmetic of axes overflows.
pub(super) fn is_drawable(v: f64) -> bool {
    v.abs() <= 1e100
}

pub(super) fn finite_pair(pair: Option<(f64, f64)>) -> Option<(f64, f64)> {
    pair.filter(|(low, high)| is_drawable(*low) && is_drawable(*high))
}

/// Smallest and largest of the finite values; none if there is none.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|v| is_drawable(*v))
        .fold(None, |r, v| Some(r.map_or((v, v), |(low, high): (f64, f64)| (low.min(v), high.max(v)))))
}

/// The range extended by `share` of its length at both ends, never empty.
pub(super) fn extend((low, high): (f64, f64), share: f64) -> Range<f64> {
    let length = high - low;
    // Smaller differences are invisible on an axis.
    let least = low.abs().max(high.abs()).max(1e-9) * 1e-9;
    if length <= least {
        let pad = low.abs().max(1.0) * 0.5;
        return low - pad..high + pad;
    }
    low - share * length..high + share * length
}

/// A short tick label, without the noise of binary fractions.
pub(super) fn tick(v: f64) -> String {
    let size = v.abs();
    if size < 1e-12 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        let text = format!("{v:.2e}");
        match text.split_once('e') {
            Some((m, e)) if m.contains('.') => {
                format!("{}e{e}", m.trim_end_matches('0').trim_end_matches('.'))
            }
            _ => text,
        }
    } else if size < 0.1 {
        decimals(v, 5)
    } else if size < 100.0 {
        decimals(v, 3)
    } else {
        decimals(v, 1)
    }
}

/// Width for tick labels and description of an axis, px.
pub(super) fn label_width(y: &Range<f64>, ticks: usize) -> u32 {
    use plotters::coord::ranged1d::Ranged;
    let axis: RangedCoordf64 = y.clone().into();
    let longest = axis.key_points(ticks).into_iter().map(|v| tick(v).chars().count()).max().unwrap_or(4);
    34 + 7 * longest as u32
}

/// The palette's colours, darker with each repetition.
pub(super) fn series_colour(index: usize) -> RGBColor {
    // Blue first: the best contrast for the plot of one series.
    const ORDER: [usize; 7] = [1, 0, 3, 4, 2, 5, 6];
    let round = (index / ORDER.len()) as i32;
    let shade = |c: u8| (f64::from(c) * 0.5f64.powi(round)) as u8;
    let [r, g, b] = channels(PALETTE[ORDER[index % ORDER.len()]]).map(shade);
    RGBColor(r, g, b)
}

/// A token's colour on a light ground.
pub(super) fn token_colour(token: &str) -> RGBColor {
    let [r, g, b] = channels(light(token));
    RGBColor(r, g, b)
}

/// The heat scale's colour for a share from 0 to 1, as `#RRGGBB`.
pub(in crate::picture) fn heat_colour(share: f64) -> String {
    let RGBColor(r, g, b) = heat(share);
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// Dark blue over green to yellow for 0 to 1; corner points read off the viridis map (Smith and van der Walt).
pub(super) fn heat(share: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 6] = [
        [68.0, 1.0, 84.0],
        [65.0, 68.0, 135.0],
        [42.0, 120.0, 142.0],
        [34.0, 168.0, 132.0],
        [122.0, 209.0, 81.0],
        [253.0, 231.0, 37.0],
    ];
    let s = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let k = (s as usize).min(STOPS.len() - 2);
    let mix = |c: usize| (STOPS[k][c] + (s - k as f64) * (STOPS[k + 1][c] - STOPS[k][c])).round() as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_have_distinct_colours() {
        let colours: Vec<RGBColor> = (0..20).map(series_colour).collect();
        for (i, one) in colours.iter().enumerate() {
            assert!(colours[i + 1..].iter().all(|other| other != one), "{i}: {one:?}");
        }
    }

    #[test]
    fn tick_labels_are_short() {
        let check = |v: f64, wanted: &str| assert_eq!(tick(v), wanted);
        check(0.1 + 0.2, "0.3");
        check(-0.0, "0");
        check(1500.0, "1500");
        check(2.5e-7, "2.5e-7");
        check(1e6, "1e6");
        check(0.002, "0.002");
    }
}
