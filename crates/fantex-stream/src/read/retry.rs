//! Which errors pass, and how long to wait for that.

use std::io;
use std::time::Duration;

/// How often and how soon to try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// Attempts after the first.
    pub retries: u32,
    /// Pause before the first retry; doubled before each further one.
    pub first_pause: Duration,
}

impl Default for RetryPolicy {
    /// Three retries after 5, 10 and 20 ms: what a flaky cable or a busy disk needs.
    fn default() -> Self {
        Self { retries: 3, first_pause: Duration::from_millis(5) }
    }
}

impl RetryPolicy {
    /// For servers: three retries after 0.1, 0.2 and 0.4 s.
    pub const NETWORK: Self = Self { retries: 3, first_pause: Duration::from_millis(100) };

    /// The pause before retry `attempt` (0 is the first).
    pub fn pause(&self, attempt: u32) -> Duration {
        self.first_pause * (1 << attempt.min(16))
    }
}

/// Whether the same read may well succeed a moment later. Where there is no such file, no permission, no support, or too few
/// bytes, it will not.
pub fn is_transient(error: &io::Error) -> bool {
    use io::ErrorKind::{
        InvalidData, InvalidInput, NotFound, PermissionDenied, StorageFull, UnexpectedEof, Unsupported,
    };
    !matches!(
        error.kind(),
        InvalidData | InvalidInput | NotFound | PermissionDenied | StorageFull | UnexpectedEof | Unsupported
    )
}
