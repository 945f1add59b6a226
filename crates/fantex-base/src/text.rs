//! Counts and shares in messages: `1 triangle`, `2 triangles`, `69 451 tiles`, `9.9` percent; numbers as people type them (`64k`); names in
//! addresses.

use std::borrow::Cow;
use std::fmt;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use crate::{Error, Result};

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
    let plural = match (noun.strip_suffix("ex"), noun.strip_suffix("ry")) {
        (Some(stem), _) => format!("{stem}ices"),
        (_, Some(stem)) => format!("{stem}ries"),
        _ if ["ch", "sh", "x"].iter().any(|end| noun.ends_with(end)) => format!("{noun}es"),
        _ => format!("{noun}s"),
    };
    plural.into()
}

/// The verb that a count asks for: `is` or `are`.
///
/// ```
/// use fantex_base::{are, counted};
///
/// let sentence = |missing: u32| format!("{missing} of {} {} missing", counted(6, "entry"), are(missing));
/// assert_eq!([1, 2].map(sentence), ["1 of 6 entries is missing", "2 of 6 entries are missing"]);
/// ```
pub fn are<N: PartialEq + From<u8>>(count: N) -> &'static str {
    if count == N::from(1) { "is" } else { "are" }
}

/// The same in the past: `was` or `were`.
pub fn were<N: PartialEq + From<u8>>(count: N) -> &'static str {
    if count == N::from(1) { "was" } else { "were" }
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

/// Text for HTML and XML, between tags and in attributes.
///
/// ```
/// assert_eq!(fantex_base::markup_escaped("a < 'b' & \"c\""), "a &lt; &#39;b&#39; &amp; &quot;c&quot;");
/// ```
pub fn markup_escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut escaped, c| {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c => escaped.push(c),
        }
        escaped
    })
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

/// Letters behind a number: thousands, and so on.
pub const LETTERS: [char; 4] = ['k', 'M', 'G', 'T'];

/// Not digits with at most one point and one known letter.
fn syntax() -> Error {
    Error::invalid("expected a number such as 500, 64k, 5.59M or 16G")
}

/// Parses a whole number above zero as people type it: `500`, `64k`, `5.59M`, `16G`. `kilo` is what `k` stands for.
///
/// # Errors
/// It is no such number.
pub fn parse_number(text: &str, kilo: u64) -> Result<u64> {
    let last = text.chars().last().ok_or_else(syntax)?;
    let power = LETTERS.iter().position(|l| l.eq_ignore_ascii_case(&last)).map_or(0, |p| p as u32 + 1);
    let number = if power > 0 { &text[..text.len() - 1] } else { text };
    let unit = u128::from(kilo.pow(power));
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    let is_digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() && fraction.is_empty() || !is_digits(whole) || !is_digits(fraction) {
        return Err(syntax());
    }
    if whole.len() > 20 || fraction.len() > 15 {
        return Err(Error::invalid("the number is too large"));
    }
    let digits = |s: &str| s.bytes().fold(0_u128, |n, b| n * 10 + u128::from(b - b'0'));
    let value = digits(whole) * unit + digits(fraction) * unit / 10_u128.pow(fraction.len() as u32);
    match u64::try_from(value) {
        Ok(0) => Err(Error::invalid("expected a number above zero")),
        Ok(value) => Ok(value),
        Err(_) => Err(Error::invalid("the number is too large")),
    }
}
