//! Counts and shares in messages: `1 triangle`, `2 triangles`, `69 451 tiles`, `9.9` percent; names in addresses.

use std::borrow::Cow;
use std::fmt;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

/// A count with its noun, in the number that the count asks for.
///
/// ```
/// use fantex_base::counted;
///
/// assert_eq!(counted(1, "vertex").to_string(), "1 vertex");
/// assert_eq!(counted(3, "vertex").to_string(), "3 vertices");
/// ```
pub fn counted<N: Copy + fmt::Display + PartialEq + From<u8>>(count: N, noun: &str) -> impl fmt::Display {
    format!("{count} {}", numbered(count, noun))
}

/// A noun in the number that a count asks for, for counts that are written in another way than as digits.
pub fn numbered<N: PartialEq + From<u8>>(count: N, noun: &str) -> Cow<'_, str> {
    if count == N::from(1) {
        return noun.into();
    }
    let plural = match noun.strip_suffix("ex") {
        Some(stem) => format!("{stem}ices"),
        None if ["ch", "sh", "x"].iter().any(|end| noun.ends_with(end)) => format!("{noun}es"),
        None => format!("{noun}s"),
    };
    plural.into()
}

/// What stands for itself in an address: unreserved characters (RFC 3986, section 2.3).
const ESCAPED: AsciiSet = NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// A share in percent, in as many digits as matter.
///
/// ```
/// use fantex_base::percent;
///
/// let told = [0.714, 0.0994, 0.014, 0.0004, 0.0].map(percent);
/// assert_eq!(told, ["71", "9.9", "1.4", "less than 0.1", "less than 0.1"]);
/// ```
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        percent if percent >= 9.95 => format!("{percent:.0}"),
        percent if percent >= 0.05 => format!("{percent:.1}"),
        _ => "less than 0.1".to_owned(),
    }
}

/// A path as the path of an address, with what does not stand for itself there as `%` and two digits; `/` stays between its parts.
///
/// ```
/// assert_eq!(fantex_base::uri_escaped("old town/b#1-\u{e9}.fan"), "old%20town/b%231-%C3%A9.fan");
/// ```
pub fn uri_escaped(path: &str) -> String {
    const WITH_PARTS: AsciiSet = ESCAPED.remove(b'/');
    utf8_percent_encode(path, &WITH_PARTS).to_string()
}

/// Digits in groups of three, separated by `separator`: `69 451`.
pub fn grouped(number: u64, separator: char) -> String {
    let digits = number.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(separator);
        }
        text.push(digit);
    }
    text
}
