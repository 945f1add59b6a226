//! Counts in messages.

use fantex_base::are;

/// `there is 1`, `there are 3`.
pub(crate) fn there_are(count: usize) -> String {
    format!("there {} {count}", are(count))
}
