//! Signals of the user or the system: requests to end the program, limits.

use fantex_base::{Error, Result};

/// Calls `act`, on a thread of its own, whenever the program is asked to end: by Ctrl-C, by a request to terminate, or because its terminal is
/// closed, unless `nohup` has started it. Once per process.
///
/// # Errors
/// The system refuses, or there is such a function already.
pub fn on_end_request(act: impl FnMut() + Send + 'static) -> Result<()> {
    let set = keep_ignoring_hang_ups(|| ctrlc::set_handler(act));
    set.map_err(|error| Error::unavailable(format!("cannot listen to Ctrl-C: {error}")))
}

/// Makes writes beyond a limit on the size of files (`ulimit -f`) fail like those on a full disk, instead of ending the program.
#[cfg(unix)]
#[expect(unsafe_code, reason = "how signals are ignored")]
pub fn fail_writes_at_size_limit() {
    // SAFETY: the signal is ignored, so no code runs as its handler.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

/// Other systems have no such limit.
#[cfg(not(unix))]
pub fn fail_writes_at_size_limit() {}

/// Sets handlers of signals. A program that `nohup` has started goes on when its terminal is closed.
#[cfg(unix)]
#[expect(unsafe_code, reason = "how signals are ignored")]
fn keep_ignoring_hang_ups<T>(set: impl FnOnce() -> T) -> T {
    // SAFETY: the signal is ignored, so no code runs as its handler.
    let before = unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
    let result = set();
    if before == libc::SIG_IGN {
        // SAFETY: as above.
        unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
    }
    result
}

/// Other systems have no such signal.
#[cfg(not(unix))]
fn keep_ignoring_hang_ups<T>(set: impl FnOnce() -> T) -> T {
    set()
}
