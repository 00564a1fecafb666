//! The visual language of pictures and reports: colour tokens with a light and a dark value, from `tokens.css`, which the server's page
//! reads too.

/// Colours, type scale and spacing as CSS custom properties of the root.
pub const TOKENS_CSS: &str = include_str!("tokens.css");

/// Whose motion a mark shows; every plot, legend and table uses the same colour for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Recorded, or of the real world.
    Measured,
    /// By the base simulation.
    Simulated,
    /// By the simulation with the effects that a diagnosis adds.
    Extended,
    /// By the true parameters.
    Truth,
}

impl Meaning {
    /// The token of its colour.
    pub fn token(self) -> &'static str {
        match self {
            Meaning::Measured => "measured",
            Meaning::Simulated => "simulated",
            Meaning::Extended => "extended",
            Meaning::Truth => "truth",
        }
    }

    /// Its colour on a light ground, `#rrggbb`.
    pub fn colour(self) -> &'static str {
        light(self.token())
    }
}

/// Colour tokens of pictures; all differ on a light ground, so that a report can replace them.
const PICTURE_TOKENS: [&str; 11] = [
    "scene",
    "ink",
    "soft",
    "line",
    "static",
    "static-edge",
    "goal",
    "measured",
    "simulated",
    "extended",
    "truth",
];

/// A token's colour on a light ground, `#rrggbb`; black for an unknown token.
pub fn light(token: &str) -> &'static str {
    let value = |line: &'static str| {
        let rest = line.trim().strip_prefix("--")?.strip_prefix(token)?.strip_prefix(": light-dark(")?;
        rest.get(..7)
    };
    TOKENS_CSS.lines().find_map(value).unwrap_or("#000000")
}

/// Rules that draw inline pictures of [`light`] colours in the tokens' colours, for light and dark reports.
pub fn picture_css() -> String {
    let rule = |token: &str| {
        let colour = light(token);
        format!(
            ".report svg [fill=\"{colour}\" i] {{ fill: var(--{token}); }}\n\
             .report svg [stroke=\"{colour}\" i] {{ stroke: var(--{token}); }}\n"
        )
    };
    PICTURE_TOKENS.iter().map(|token| rule(token)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_pictures_are_tokens_and_differ() {
        let mut colours: Vec<&str> = PICTURE_TOKENS.iter().map(|token| light(token)).collect();
        assert!(colours.iter().all(|c| c.starts_with('#') && *c != "#000000"), "{colours:?}");
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), PICTURE_TOKENS.len());
        assert_eq!(light("unknown"), "#000000");
    }

    #[test]
    fn reports_replace_every_colour_of_pictures() {
        let css = picture_css();
        assert!(
            css.contains(&format!(
                "[fill=\"{}\" i] {{ fill: var(--extended); }}",
                Meaning::Extended.colour()
            ))
        );
        assert_eq!(css.lines().count(), 2 * PICTURE_TOKENS.len());
    }
}
