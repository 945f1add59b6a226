//! Long work beside the interpreter, and errors on their way to Python.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use fantex::addresses::is_address;
use fantex::{ErrorKind, Progress};
use pyo3::exceptions::{
    PyException, PyFileExistsError, PyFileNotFoundError, PyKeyboardInterrupt, PyOSError, PyPermissionError,
    PyRuntimeError, PyValueError,
};
use pyo3::prelude::*;

pyo3::create_exception!(
    fantex,
    Error,
    PyException,
    "What cannot be done: a damaged or unsupported file, a limit, a missing channel. `path` is the file, or None."
);

/// Flags in the library's sentences, and what stands for them in Python; what is longer comes first.
const ARGUMENTS: [(&str, &str); 17] = [
    ("use --force", "give overwrite=True"),
    ("with --force", "with overwrite=True"),
    ("allow more (--memory)", "allow more by fantex.set_read_limits(memory=...)"),
    ("(--allow-outside)", "by fantex.set_read_limits(allow_outside=True)"),
    ("--memory", "memory="),
    ("--format rgba8", "format=\"rgba8\""),
    ("--longest-edge", "longest_edge="),
    ("--padding", "padding="),
    ("--uv and --model", "uv="),
    ("--uv source", "uv=\"source\""),
    ("--uv", "uv="),
    ("--model", "uv=fantex.Mesh.load(...)"),
    ("--size", "resolution="),
    ("--source", "source="),
    ("--texture", "texture="),
    ("--add-channel", "add_channels="),
    ("--look", "look="),
];

/// The exception that stands for an error. Its text is the command line's, with an argument where that names a flag.
pub(crate) fn exception(error: fantex::Error) -> PyErr {
    let text =
        ARGUMENTS.iter().fold(error.to_string(), |text, (flag, argument)| text.replace(flag, argument));
    match error.kind() {
        ErrorKind::NotFound if error.path().is_some() => {
            numbered(PyFileNotFoundError::new_err(text), io_source(&error))
        }
        ErrorKind::AlreadyExists => PyFileExistsError::new_err(text),
        ErrorKind::Io => {
            let source = io_source(&error);
            let raised = match source.map(io::Error::kind) {
                Some(io::ErrorKind::NotFound) => PyFileNotFoundError::new_err(text),
                Some(io::ErrorKind::PermissionDenied) => PyPermissionError::new_err(text),
                _ => PyOSError::new_err(text),
            };
            numbered(raised, source)
        }
        ErrorKind::InvalidArgument => PyValueError::new_err(text),
        ErrorKind::Cancelled => PyKeyboardInterrupt::new_err(text),
        _ => damaged(text, error.path()),
    }
}

/// An [`Error`] whose attribute `path` names the file, where there is one.
fn damaged(text: String, path: Option<&Path>) -> PyErr {
    let raised = Error::new_err(text);
    let named = Python::attach(|py| match path.filter(|path| is_address(path)) {
        // Python's paths have one slash where addresses have two.
        Some(address) => raised.value(py).setattr("path", address.to_string_lossy()),
        None => raised.value(py).setattr("path", path),
    });
    named.err().unwrap_or(raised)
}

/// An `OSError` whose attribute `errno` is the system's number, where there is one.
fn numbered(raised: PyErr, source: Option<&io::Error>) -> PyErr {
    match source.and_then(io::Error::raw_os_error).filter(|_| cfg!(unix)) {
        Some(number) => {
            Python::attach(|py| raised.value(py).setattr("errno", number)).err().unwrap_or(raised)
        }
        None => raised,
    }
}

fn io_source(error: &fantex::Error) -> Option<&io::Error> {
    std::error::Error::source(error)?.downcast_ref()
}

/// Progress of work on another thread, and the wish that it end.
#[derive(Default)]
pub(crate) struct Watch {
    /// Done and total.
    state: Mutex<(u64, u64)>,
    is_cancelled: AtomicBool,
    /// Why.
    failure: Mutex<Option<PyErr>>,
}

impl Watch {
    /// Ends the work; the first reason counts.
    pub(crate) fn fail(&self, reason: PyErr) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    fn state(&self) -> MutexGuard<'_, (u64, u64)> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Watch {
    fn report(&self, done: u64, total: u64) {
        let mut state = self.state();
        // With another total, another step has begun; within one, threads may report out of order.
        *state = if state.1 == total { (state.0.max(done), total) } else { (done, total) };
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// How often signals are looked for.
const PERIOD: Duration = Duration::from_millis(50);

/// Runs work on a thread of its own, without the interpreter's lock. The calling thread calls `progress(done, total)` now and then, and
/// ends the work on Ctrl-C or when that raises.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> fantex::Result<T> + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    let caller = thread::current();
    let result = thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let result = work(&watch);
            caller.unpark();
            result
        });
        let mut told = (0, 0);
        while !worker.is_finished() {
            py.detach(|| thread::park_timeout(PERIOD));
            if let Err(signal) = py.check_signals() {
                watch.fail(signal);
            }
            let state = *watch.state();
            if let Some(progress) = progress.filter(|_| state != told && !watch.is_cancelled()) {
                told = state;
                if let Err(raised) = progress.call1(state) {
                    watch.fail(raised);
                }
            }
        }
        py.detach(|| worker.join())
    });
    if let Some(reason) = watch.failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(reason);
    }
    match result {
        Ok(result) => result.map_err(exception),
        Err(_) => Err(PyRuntimeError::new_err("fantex failed inside; please report it, with what you did")),
    }
}
