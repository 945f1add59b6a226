//! What is wrong at a place of a look, in words. The place is added by [`LookFile::error`](crate::LookFile::error).

use std::error::Error as StdError;

use fantex_base::{Error, ErrorKind};

/// A key that has no meaning there.
pub(crate) fn unknown_key(name: &str, allowed: &[&str]) -> Error {
    let (suggestion, allowed) = (suggestion(name, allowed), list(allowed));
    Error::malformed(format!("there is no key '{name}' here{suggestion}; allowed are {allowed}"))
}

/// A text that is none of those allowed.
pub fn unknown_value(name: &str, allowed: &[&str]) -> Error {
    let (suggestion, allowed) = (suggestion(name, allowed), list(allowed));
    Error::malformed(format!("'{name}' is not known here{suggestion}; allowed are {allowed}"))
}

/// A name that stands for nothing. `what` is a texture, a material or an object.
pub fn undefined<'a>(what: &str, name: &str, known: impl IntoIterator<Item = &'a str>) -> Error {
    let known: Vec<&str> = known.into_iter().collect();
    let others = match known.len() {
        0 => "; none is defined".to_owned(),
        1..=20 => format!("; defined are {}", list(&known)),
        count => format!("; {count} others are defined"),
    };
    let suggestion = suggestion(name, &known);
    Error::malformed(format!("there is no {what} '{name}' in this look{suggestion}{others}"))
}

/// A key that must be there.
pub fn missing_key(name: &str) -> Error {
    Error::malformed(format!("the key '{name}' is missing"))
}

/// A value of another type, or a number out of its range.
pub(crate) fn unexpected(expected: &str, found: &str) -> Error {
    Error::malformed(format!("expected {expected}, found {found}"))
}

/// Two keys that cannot both be there.
pub fn exclusive(one: &str, other: &str) -> Error {
    Error::malformed(format!("the keys '{one}' and '{other}' exclude each other; leave one of them out"))
}

/// Keys of which one must be there.
pub fn one_needed(keys: &[&str]) -> Error {
    Error::malformed(format!("one of the keys {} is needed", list(keys)))
}

/// A direction of length zero.
pub fn no_direction() -> Error {
    Error::malformed("this is no direction: it has no length")
}

/// What a part of the engine says of an option.
pub fn refused(error: impl StdError + Send + Sync + 'static) -> Error {
    let own = (&error as &dyn StdError).downcast_ref::<Error>();
    let kind = own.map_or(ErrorKind::Malformed, Error::kind);
    Error::new(kind, error.to_string()).with_source(error)
}

/// `a, b and c`.
fn list(names: &[&str]) -> String {
    match names {
        [] => "none".to_owned(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

fn suggestion(name: &str, candidates: &[&str]) -> String {
    nearest(name, candidates).map_or_else(String::new, |name| format!(" (did you mean '{name}'?)"))
}

/// The candidate that is written most like `name`, if any is close enough to be a slip: at most a third of the letters differ, whatever
/// their case.
fn nearest<'a>(name: &str, candidates: &[&'a str]) -> Option<&'a str> {
    // Distances take time in proportion to both lengths.
    let plain = |text: &str| text.to_lowercase().chars().take(64).collect::<String>();
    let (limit, name) = ((name.chars().count() / 3).max(1), plain(name));
    let distances =
        candidates.iter().map(|&candidate| (strsim::osa_distance(&name, &plain(candidate)), candidate));
    let close = distances.filter(|&(distance, _)| distance <= limit);
    close.min_by_key(|&(distance, _)| distance).map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_strangers_are_not() {
        let known = ["roughness", "metallic", "base_color", "kind"];
        assert_eq!(nearest("rougness", &known), Some("roughness"));
        assert_eq!(nearest("base_colour", &known), Some("base_color"));
        assert_eq!(nearest("knid", &known), Some("kind"));
        assert_eq!(nearest("Metallic", &known), Some("metallic"));
        assert_eq!(nearest("velvet", &known), None);
        assert_eq!(nearest("", &known), None);
    }
}
