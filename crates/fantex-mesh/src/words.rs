//! Counts in messages: `1 triangle`, `2 triangles`.

use std::borrow::Cow;
use std::fmt;

/// A count with its noun, in the number that the count asks for.
///
/// ```
/// use fantex_mesh::counted;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nouns_follow_their_counts() {
        let text = |count: u64, noun| counted(count, noun).to_string();
        assert_eq!(text(0, "triangle"), "0 triangles");
        assert_eq!(text(1, "index"), "1 index");
        assert_eq!(text(2, "index"), "2 indices");
        assert_eq!(text(2, "patch"), "2 patches");
        assert_eq!(text(2, "double-sided pair"), "2 double-sided pairs");
        assert_eq!(text(7, "box"), "7 boxes");
    }
}
