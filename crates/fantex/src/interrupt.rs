//! Ctrl-C.
//!
//! Most of the time there is nothing to undo, and Ctrl-C ends the program at once. While something is being written, a
//! [`Deferral`] is held: Ctrl-C then only sets a flag, the operation notices it, removes its temporary file, and the
//! command ends by itself.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The exit code of a program that was interrupted: 128 + SIGINT.
pub(crate) const EXIT_INTERRUPTED: u8 = 130;

/// What the user is told.
pub(crate) const MESSAGE: &str = "interrupted; no unfinished file was left behind";

/// Whether the user wants to stop, shared with the signal handler's thread.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt {
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    requested: bool,
    deferrals: u32,
}

impl Interrupt {
    /// Listens to Ctrl-C (and termination requests) from now on.
    pub(crate) fn listen() -> Result<Self, ctrlc::Error> {
        let interrupt = Self::default();
        let heard = interrupt.clone();
        ctrlc::set_handler(move || heard.request())?;
        Ok(interrupt)
    }

    /// True after Ctrl-C.
    pub(crate) fn is_requested(&self) -> bool {
        self.lock().requested
    }

    /// Until the result is dropped, Ctrl-C does not end the program at once.
    pub(crate) fn defer(&self) -> Deferral<'_> {
        self.lock().deferrals += 1;
        Deferral { interrupt: self }
    }

    fn request(&self) {
        let mut state = self.lock();
        state.requested = true;
        // The lock stays taken: no operation can begin to write now.
        if state.deferrals == 0 {
            eprintln!("\nfantex: {MESSAGE}");
            std::process::exit(i32::from(EXIT_INTERRUPTED));
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Keeps Ctrl-C from ending the program at once.
#[derive(Debug)]
pub(crate) struct Deferral<'a> {
    interrupt: &'a Interrupt,
}

impl Drop for Deferral<'_> {
    fn drop(&mut self) {
        self.interrupt.lock().deferrals -= 1;
    }
}
