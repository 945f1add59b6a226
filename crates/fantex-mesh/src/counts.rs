//! Counts in messages.

/// `there is 1`, `there are 3`.
pub(crate) fn there_are(count: usize) -> String {
    format!("there {} {count}", if count == 1 { "is" } else { "are" })
}
