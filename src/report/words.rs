//! Names and sentences for readers.

/// The name of a set of effects.
pub fn set_name(names: &[String]) -> String {
    match names.is_empty() {
        true => "nothing".into(),
        false => names.iter().map(|n| plain_names(n)).collect::<Vec<_>>().join(" + "),
    }
}

/// Names of effects and parameters without underscores, in any text.
pub fn plain_names(text: &str) -> String {
    let words = text.split(' ').map(|word| {
        let is_name =
            word.contains('_') && word.chars().all(|c| c.is_ascii_lowercase() || "_,;:().".contains(c));
        match (is_name, word.split_once('.').is_some_and(|(_, rest)| !rest.is_empty())) {
            (true, true) => word.replace(['_', '.'], " "),
            (true, false) => word.replace('_', " "),
            (false, _) => word.to_string(),
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// Items as in "a, b and c".
pub fn listed(items: &[String]) -> String {
    match items {
        [all @ .., last] if !all.is_empty() => format!("{} and {last}", all.join(", ")),
        _ => items.join(""),
    }
}

/// A sentence with a capital and a full stop.
pub fn sentence(text: &str) -> String {
    let mut chars = text.trim().chars();
    let capital: String = chars.next().map(|c| c.to_uppercase().collect()).unwrap_or_default();
    let whole = capital + chars.as_str();
    if whole.is_empty() || whole.ends_with(['.', '!', '?']) { whole } else { whole + "." }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_effects_are_words() {
        assert_eq!(plain_names("gravity_error (3 %), x_1 and pos_X"), "gravity error (3 %), x_1 and pos_X");
        assert_eq!(plain_names("linear_drag.c of linear_drag."), "linear drag c of linear drag.");
        assert_eq!(set_name(&["wind".into(), "linear_drag".into()]), "wind + linear drag");
        let items = ["a", "b", "c"].map(String::from);
        assert_eq!([listed(&items), listed(&items[..1]), listed(&[])], ["a, b and c", "a", ""]);
        assert_eq!([sentence("a b"), sentence("A!"), sentence("")], ["A b.", "A!", ""]);
    }
}
