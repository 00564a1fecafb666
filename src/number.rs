//! Numbers as readers expect them: few digits, units, no false precision.

/// Four significant digits, without trailing zeros.
pub fn digits(v: f64) -> String {
    significant(v, 4)
}

/// `count` significant digits, without trailing zeros; very small and very large numbers as powers of ten.
pub fn significant(v: f64, count: usize) -> String {
    if v == 0.0 || !v.is_finite() {
        return if v == 0.0 { "0".into() } else { "-".into() };
    }
    let text = format!("{:.*e}", count - 1, v);
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if !(-5..6).contains(&exponent) {
        let power: String = exponent.to_string().chars().map(superscript).collect();
        return format!("{} \u{d7} 10{power}", trim_zeros(mantissa)).replace('-', "\u{2212}");
    }
    let decimals = usize::try_from(count as i32 - 1 - exponent).unwrap_or(0);
    trim_zeros(&format!("{v:.decimals$}")).replace('-', "\u{2212}")
}

fn superscript(c: char) -> char {
    const DIGITS: [char; 10] = [
        '\u{2070}', '\u{b9}', '\u{b2}', '\u{b3}', '\u{2074}', '\u{2075}', '\u{2076}', '\u{2077}', '\u{2078}',
        '\u{2079}',
    ];
    c.to_digit(10).map_or('\u{207b}', |d| DIGITS[d as usize])
}

fn trim_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

/// A length with two digits: in mm below 1 m, else in m.
pub fn length(metres: f64) -> String {
    if metres.abs() < 1.0 {
        format!("{} mm", significant(1e3 * metres, 2))
    } else {
        format!("{} m", significant(metres, 2))
    }
}

/// A unit for readers: `m/s^2` as m/s², and nothing for `1`.
pub fn unit(unit: &str) -> String {
    if unit == "1" { String::new() } else { superscripts(unit) }
}

/// `^2` and `^3` as superscripts.
pub fn superscripts(text: &str) -> String {
    text.replace("^2", "\u{b2}").replace("^3", "\u{b3}")
}

/// A value with its unit.
pub fn with_unit(v: f64, of: &str) -> String {
    format!("{} {}", digits(v), unit(of)).trim_end().to_string()
}

/// A probability in percent.
pub fn percent(p: f64) -> String {
    match p {
        p if p > 0.999 && p < 1.0 => "> 99.9 %".into(),
        p if p > 0.0 && p < 0.001 => "< 0.1 %".into(),
        p if p > 0.9 => format!("{} %", significant(100.0 * p, 3)),
        p if p < 0.1 => format!("{} %", significant(100.0 * p, 2)),
        p => format!("{:.0} %", 100.0 * p),
    }
}

/// A p-value; small ones as a bound.
pub fn p_value(p: f64) -> String {
    if p < 0.001 { "below 0.001".into() } else { significant(p, 2) }
}

/// A 95 % interval with its unit.
pub fn interval(ends: &[Option<f64>; 2], of: &str) -> String {
    match ends {
        [Some(low), Some(high)] => format!("{} to {}", digits(*low), with_unit(*high, of)),
        _ => "not bounded by these trials".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let check = |v: f64, wanted: &str| assert_eq!(digits(v), wanted);
        check(0.200_14, "0.2001");
        check(0.0, "0");
        check(-1234.5, "\u{2212}1234");
        check(2e-7, "2 \u{d7} 10\u{207b}\u{2077}");
        check(1.713e-4, "0.0001713");
        check(0.5, "0.5");
        check(f64::NAN, "-");
        assert_eq!(length(0.1576), "158 mm");
        assert_eq!(length(2.5), "2.5 m");
        assert_eq!(with_unit(9.81, "m/s^2"), "9.81 m/s\u{b2}");
        assert_eq!(with_unit(0.5, "1"), "0.5");
    }

    #[test]
    fn probabilities_are_bounds_at_the_ends() {
        assert_eq!(
            [0.9999, 1.0, 0.5, 1e-9, 0.0, 0.034].map(percent),
            ["> 99.9 %", "100 %", "50 %", "< 0.1 %", "0 %", "3.4 %"]
        );
        assert_eq!([0.0, 0.012].map(p_value), ["below 0.001", "0.012"]);
        assert_eq!(interval(&[Some(0.1), Some(0.2)], "1/m"), "0.1 to 0.2 1/m");
        assert_eq!(interval(&[None, Some(0.2)], "1"), "not bounded by these trials");
    }
}
