//! Figures of a phrase, with as many decimals as their uncertainty warrants.

use std::fmt;

/// The number with this many decimals; never `-0.00`.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
    if is_zero { text.trim_start_matches('-').into() } else { text }
}

/// Most decimals of a figure.
const MAX_DECIMALS: i32 = 6;

/// Decimals that show a deviation of this size with one significant digit.
pub fn decimals_of(deviation: f64) -> Option<usize> {
    // 0.0095 is rounded to 0.01.
    let wanted = (-(deviation / 0.95).log10()).ceil();
    (deviation > 0.0 && wanted.is_finite()).then_some(wanted.clamp(0.0, f64::from(MAX_DECIMALS)) as usize)
}

/// A value whose deviation is unknown: two significant digits.
pub fn plain(value: f64) -> String {
    fixed(value, decimals_of(value.abs() / 10.0).unwrap_or(0))
}

/// A value and its 95 % interval; ends that are `None` are unbounded.
pub fn with_interval(value: f64, interval: [Option<f64>; 2]) -> String {
    let value_text = with_decimals(value, interval);
    // A quarter of a 95 % interval is about its standard deviation.
    let deviation = interval_deviation(value, interval);
    let end = |end: f64| deviation.and_then(decimals_of).map_or_else(|| plain(end), |d| fixed(end, d));
    match interval {
        [Some(low), Some(high)] => format!("{value_text} ({} to {})", end(low), end(high)),
        [Some(low), None] => format!("{value_text} (above {})", end(low)),
        [None, Some(high)] => format!("{value_text} (below {})", end(high)),
        [None, None] => value_text,
    }
}

/// A value with the decimals that its 95 % interval warrants.
pub fn with_decimals(value: f64, interval: [Option<f64>; 2]) -> String {
    let decimals = interval_deviation(value, interval).and_then(decimals_of);
    decimals.map_or_else(|| plain(value), |d| fixed(value, d))
}

fn interval_deviation(value: f64, interval: [Option<f64>; 2]) -> Option<f64> {
    match interval {
        [Some(low), Some(high)] => Some((high - low) / 4.0),
        [Some(end), None] | [None, Some(end)] => Some((value - end).abs() / 2.0),
        [None, None] => None,
    }
}

/// A text of at most this many characters; a longer one ends in an ellipsis.
pub struct AtMost<'a>(pub usize, pub &'a str);

impl fmt::Display for AtMost<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let AtMost(most, text) = self;
        match text.char_indices().nth(*most) {
            None => f.write_str(text),
            Some(_) => {
                let end = text.char_indices().nth(most.saturating_sub(1)).map_or(0, |(i, _)| i);
                write!(f, "{}…", &text[..end])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_follow_the_interval() {
        let text = |value, low: f64, high: f64| with_interval(value, [Some(low), Some(high)]);
        assert_eq!(text(0.52, 0.48, 0.56), "0.52 (0.48 to 0.56)");
        assert_eq!(text(0.5201, 0.514, 0.526), "0.520 (0.514 to 0.526)");
        assert_eq!(text(0.8, 0.5, 1.0), "0.8 (0.5 to 1.0)");
        assert_eq!(text(1234.0, 1100.0, 1400.0), "1234 (1100 to 1400)");
        assert_eq!(text(-0.0004, -0.02, 0.02), "0.00 (-0.02 to 0.02)");
        assert_eq!(text(0.8, 0.79, 0.83), "0.80 (0.79 to 0.83)");
        assert_eq!(text(0.5, 0.5, 0.5), "0.50 (0.50 to 0.50)");
        assert_eq!(with_interval(0.0, [None, Some(0.04)]), "0.00 (below 0.04)");
        assert_eq!(with_interval(0.9, [Some(0.8), None]), "0.90 (above 0.80)");
        assert_eq!(with_interval(12.34, [None, None]), "12");
    }

    #[test]
    fn any_number_can_be_shown() {
        for value in [0.0, -0.0, 1e-300, 1e300, f64::NAN, f64::INFINITY] {
            assert!(!plain(value).is_empty());
            assert!(!with_interval(value, [Some(value), Some(-value)]).is_empty());
        }
        assert_eq!((plain(0.2), plain(0.0), plain(-3.456)), ("0.20".into(), "0".into(), "-3.5".into()));
    }
}
