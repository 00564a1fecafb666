//! Building blocks of SVG: escaped text, short numbers, colours.

/// Escapes text for elements and quoted attributes; characters that XML forbids become U+FFFD.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(writable(c)),
        }
    }
    out
}

/// Replaces characters that XML forbids, for writers that escape the rest themselves.
pub fn cleaned(text: &str) -> String {
    text.chars().map(writable).collect()
}

/// The character, or U+FFFD if XML forbids it.
fn writable(c: char) -> char {
    match c {
        '\t' | '\n' | '\r' => c,
        c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => '\u{fffd}',
        c => c,
    }
}

/// The colour-blind-safe palette of Okabe and Ito (2008), without black and ordered for contrast on white.
pub const PALETTE: [&str; 7] = ["#E69F00", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#B8A800"];

/// The colour of the body called `name`: that of a colour word in the name (`red`, `blue ball 2`), otherwise entry `index` of the
/// palette.
pub fn colour(name: &str, index: usize) -> &'static str {
    name.split(|c: char| !c.is_alphabetic())
        .find_map(|word| {
            let word = word.to_lowercase();
            COLOUR_WORDS.iter().find(|(known, _)| *known == word).map(|(_, colour)| *colour)
        })
        .unwrap_or(PALETTE[index % PALETTE.len()])
}

/// Colour words in names, in shades that are distinguishable on white.
const COLOUR_WORDS: [(&str, &str); 15] = [
    ("red", "#D62F2F"),
    ("green", "#2FA04A"),
    ("blue", "#2B6CD4"),
    ("orange", "#F08A1D"),
    ("yellow", "#E8C71A"),
    ("purple", "#8A4FBF"),
    ("violet", "#8A4FBF"),
    ("pink", "#E774A8"),
    ("magenta", "#C2339B"),
    ("cyan", "#22AEBF"),
    ("brown", "#8B5A2B"),
    ("black", "#2A2A2A"),
    ("white", "#FAFAFA"),
    ("grey", "#8C8C8C"),
    ("gray", "#8C8C8C"),
];

/// A number with at most `digits` decimals and no trailing zeros; 0 for values that aren't finite.
pub fn decimals(v: f64, digits: usize) -> String {
    if !v.is_finite() {
        return "0".into();
    }
    let text = format!("{v:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.into() }
}

/// A coordinate in pixels, to two decimals.
pub fn px(v: f64) -> String {
    decimals(v, 2)
}

/// `x,y x,y ...` for `points` attributes.
pub fn points(list: &[[f64; 2]]) -> String {
    list.iter().map(|p| format!("{},{}", px(p[0]), px(p[1]))).collect::<Vec<_>>().join(" ")
}

/// A darker shade of a `#RRGGBB` colour, for outlines.
pub fn darker(colour: &str) -> String {
    let [r, g, b] = channels(colour).map(|v| u32::from(v) * 6 / 10);
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// Whether dark text has more contrast than white on a `#RRGGBB` colour.
pub fn is_light(colour: &str) -> bool {
    let [r, g, b] = channels(colour).map(f64::from);
    0.299 * r + 0.587 * g + 0.114 * b > 175.0
}

/// Red, green and blue of a `#RRGGBB` colour; black for anything else.
pub fn channels(colour: &str) -> [u8; 3] {
    [1, 3, 5].map(|i| colour.get(i..i + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_text() {
        assert_eq!(escape("<a b=\"c\" & 'd'>\u{0}"), "&lt;a b=&quot;c&quot; &amp; &#39;d&#39;&gt;\u{fffd}");
    }

    #[test]
    fn formats_short_numbers() {
        let check = |v: f64, wanted: &str| assert_eq!(px(v), wanted);
        check(1.0, "1");
        check(-0.001, "0");
        check(10.0, "10");
        check(2.505_4, "2.51");
        check(f64::NAN, "0");
        assert_eq!(decimals(100.0, 0), "100");
    }

    #[test]
    fn finds_colour_words_in_names() {
        assert_eq!(colour("Red ball 2", 0), colour("red", 5));
        assert_eq!(colour("blue_ball", 0), colour("blue", 0));
        assert_ne!(colour("redo", 0), colour("red", 0));
        assert_eq!(colour("ball", 9), PALETTE[2]);
        assert_eq!(darker("#FF8000"), "#994C00");
    }
}
