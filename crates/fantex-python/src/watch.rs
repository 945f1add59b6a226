//! Long work beside the interpreter, and errors on their way to Python.

use std::cell::Cell;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use fantex::addresses::is_address;
use fantex::{ErrorKind, Progress};
use pyo3::exceptions::{
    PyException, PyFileExistsError, PyFileNotFoundError, PyKeyboardInterrupt, PyOSError, PyPermissionError,
    PyRuntimeError, PyTypeError, PyValueError,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::{ThreadPool, ThreadPoolBuilder};

pyo3::create_exception!(
    fantex,
    Error,
    PyException,
    "What cannot be done: a damaged or unsupported file, a limit, a missing channel. `path` is the file, or None."
);

/// Flags and commands in the library's sentences, and what stands for them in Python; what is longer comes first.
const ARGUMENTS: [(&str, &str); 26] = [
    ("'fantex world --make-coarse'", "fantex.make_world(..., make_coarse=True)"),
    ("'fantex split'", "fantex.split"),
    ("'fantex bake --weld'", "weld="),
    ("--channel displacement", "export_channels({\"displacement\": ...})"),
    ("--channel light", "export_channels({\"light\": ...})"),
    ("fewer --texels", "fewer texels="),
    ("--make-previews", "make_previews=True"),
    ("--make-coarse", "make_coarse=True"),
    ("use --force", "give overwrite=True"),
    ("with --force", "with overwrite=True"),
    ("allow more (--memory)", "allow more by fantex.set_read_limits(memory=...)"),
    ("(--allow-outside)", "by fantex.set_read_limits(allow_outside=True)"),
    ("--memory", "memory="),
    ("--format rgba8", "format=\"rgba8\""),
    ("--longest-edge", "longest_edge="),
    ("--padding", "padding="),
    ("--weld", "weld="),
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

/// A sentence of the library with arguments where that names flags. What `path`, the file that it is about, has in its name stays as it is.
pub(crate) fn in_python(sentence: &str, path: Option<&Path>) -> String {
    let name = path.map(|path| path.display().to_string()).filter(|name| name.contains("--"));
    match name {
        Some(name) => sentence.split(&name).map(with_arguments).collect::<Vec<_>>().join(&name),
        None => with_arguments(sentence),
    }
}

fn with_arguments(text: &str) -> String {
    let mut said = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let found = ARGUMENTS.iter().find_map(|(flag, argument)| {
            let behind = rest.strip_prefix(flag)?;
            stands_alone(&said, behind).then_some((*argument, behind))
        });
        match found {
            Some((argument, behind)) => {
                said.push_str(argument);
                rest = behind;
            }
            None => {
                said.push(first);
                rest = &rest[first.len_utf8()..];
            }
        }
    }
    said
}

/// Whether what stands between two pieces of text is a word, and no part of a path.
fn stands_alone(before: &str, behind: &str) -> bool {
    let is_begun = before.chars().next_back().is_none_or(|c| c.is_whitespace() || "('\"`".contains(c));
    let mut next = behind.chars();
    let is_ended = match next.next() {
        Some('.') => !next.next().is_some_and(char::is_alphanumeric),
        Some(c) => !c.is_alphanumeric() && !"-_/\\=".contains(c),
        None => true,
    };
    is_begun && is_ended
}

/// The exception that stands for an error. Its text is the command line's, with an argument where that names a flag.
pub(crate) fn exception(error: fantex::Error) -> PyErr {
    let text = in_python(&error.to_string(), error.path());
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

/// How far a step of work is.
#[derive(Clone, Copy, Default, PartialEq)]
struct Step {
    /// From 1; 0 before the first.
    number: u64,
    /// What is done, such as "covering".
    word: &'static str,
    done: u64,
    total: u64,
}

/// Progress of work on another thread, and the wish that it end.
#[derive(Default)]
pub(crate) struct Watch {
    step: Mutex<Step>,
    /// What is done in steps that have no word of their own.
    word: &'static str,
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

    fn step(&self) -> MutexGuard<'_, Step> {
        self.step.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, word: &'static str, done: u64, total: u64) {
        // Callers divide by it.
        if total == 0 {
            return;
        }
        let mut step = self.step();
        if done == 0 || step.total != total || step.word != word {
            *step = Step { number: step.number + 1, word, done, total };
        } else {
            step.done = step.done.max(done);
        }
    }

    /// Tells of one of several steps.
    pub(crate) fn named(&self, word: &'static str) -> Named<'_> {
        Named { watch: self, word }
    }
}

impl Progress for Watch {
    fn report(&self, done: u64, total: u64) {
        self.count(self.word, done, total);
    }

    fn prepare(&self, word: &'static str, share: f32) {
        self.named(word).report((1000.0 * share) as u64, 1000);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// A step with a word of its own.
pub(crate) struct Named<'a> {
    watch: &'a Watch,
    word: &'static str,
}

impl Progress for Named<'_> {
    fn report(&self, done: u64, total: u64) {
        self.watch.count(self.word, done, total);
    }

    fn prepare(&self, word: &'static str, share: f32) {
        self.watch.prepare(word, share);
    }

    fn is_cancelled(&self) -> bool {
        self.watch.is_cancelled()
    }
}

/// Who hears of progress, and what is done in steps that have no word of their own.
pub(crate) type Heard<'a, 'py> = (&'a Bound<'py, PyAny>, &'static str);

/// Who hears of work, if anybody does.
pub(crate) fn heard<'a, 'py>(
    progress: &'a Option<Bound<'py, PyAny>>,
    word: &'static str,
) -> Option<Heard<'a, 'py>> {
    progress.as_ref().map(|progress| (progress, word))
}

/// Calls `progress(done, total)`, or `progress(done, total, step=step)` where it has such a parameter.
#[pyfunction]
pub(crate) fn tell(progress: &Bound<'_, PyAny>, done: u64, total: u64, step: &str) -> PyResult<()> {
    Teller::of(progress)?.tell(done, total, step)
}

/// A function that hears of progress.
struct Teller<'a, 'py> {
    progress: &'a Bound<'py, PyAny>,
    hears_steps: bool,
}

impl<'a, 'py> Teller<'a, 'py> {
    fn of(progress: &'a Bound<'py, PyAny>) -> PyResult<Self> {
        if !progress.is_callable() {
            let kind = progress.get_type().name()?;
            let sentence = format!("progress is of type {kind}; expected a function of done and total");
            return Err(PyTypeError::new_err(sentence));
        }
        let has_parameter = || {
            let signature = progress.py().import("inspect")?.call_method1("signature", (progress,))?;
            signature.getattr("parameters")?.contains("step")
        };
        // Some that are not written in Python have no signature.
        Ok(Self { progress, hears_steps: has_parameter().unwrap_or(false) })
    }

    fn tell(&self, done: u64, total: u64, step: &str) -> PyResult<()> {
        let named = PyDict::new(self.progress.py());
        if self.hears_steps {
            named.set_item("step", step)?;
        }
        self.progress.call((done, total), Some(&named)).map(drop)
    }
}

/// How often signals are looked for.
const PERIOD: Duration = Duration::from_millis(50);

/// After how long the same is told again, so that who hears of it may end the work meanwhile.
const TOLD_AGAIN: Duration = Duration::from_millis(250);

/// A pool, and the process that has its threads.
type Pool = (u32, &'static ThreadPool);

/// The pool of a process that was forked from one that had worked before.
static FORKED: Mutex<Option<Pool>> = Mutex::new(None);

thread_local! {
    /// The pool for work that is asked for on this thread of another pool.
    static BESIDE: Cell<Option<Pool>> = const { Cell::new(None) };
}

/// The pool for work that is asked for on this thread; none where the common one serves. Where a thread of a pool asks, a function of Python's
/// does, such as the source of a bake: all threads of that pool may be waiting for such functions, so the work gets a thread beside them. A
/// process that was forked has none of its parent's threads, and starts its own.
fn own_pool() -> PyResult<Option<&'static ThreadPool>> {
    static FIRST: OnceLock<u32> = OnceLock::new();
    let process = std::process::id();
    if rayon::current_thread_index().is_some() {
        let pool = running(BESIDE.get(), ThreadPoolBuilder::new().num_threads(1))?;
        BESIDE.set(Some(pool));
        return Ok(Some(pool.1));
    }
    if *FIRST.get_or_init(|| process) == process {
        return Ok(None);
    }
    let mut forked = FORKED.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = running(*forked, ThreadPoolBuilder::new())?;
    *forked = Some(pool);
    Ok(Some(pool.1))
}

/// The pool if it is of this process, else a new one. Pools stay: to drop one of a parent would be to wake its threads.
fn running(pool: Option<Pool>, builder: ThreadPoolBuilder) -> PyResult<Pool> {
    let process = std::process::id();
    if let Some(pool) = pool.filter(|(owner, _)| *owner == process) {
        return Ok(pool);
    }
    let built =
        builder.build().map_err(|error| PyRuntimeError::new_err(format!("cannot start threads: {error}")))?;
    let pool: &'static ThreadPool = Box::leak(Box::new(built));
    Ok((process, pool))
}

/// Runs work on a thread of its own, without the interpreter's lock. The calling thread [tells](tell) of it now and then and at the
/// end, and ends the work on Ctrl-C or when that raises. What the call at the end raises is raised although the work is done.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<Heard<'_, '_>>,
    work: impl FnOnce(&Watch) -> fantex::Result<T> + Send,
) -> PyResult<T> {
    let watch = Watch { word: progress.map_or("", |(_, word)| word), ..Watch::default() };
    let teller = progress.map(|(progress, _)| Teller::of(progress)).transpose()?;
    let caller = thread::current();
    // A thread has not ended yet when it wakes its caller.
    let is_done = AtomicBool::new(false);
    let pool = own_pool()?;
    let (mut told, mut told_at) = (Step::default(), Instant::now());
    let mut tell = || {
        let step = *watch.step();
        let is_due = step != told || step.number > 0 && told_at.elapsed() > TOLD_AGAIN;
        if let Some(teller) = teller.as_ref().filter(|_| is_due && !watch.is_cancelled()) {
            (told, told_at) = (step, Instant::now());
            if let Err(raised) = teller.tell(step.done, step.total, step.word) {
                watch.fail(raised);
            }
        }
    };
    let result = thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let result = match pool {
                Some(pool) => pool.install(|| work(&watch)),
                None => work(&watch),
            };
            is_done.store(true, Ordering::Release);
            caller.unpark();
            result
        });
        while !is_done.load(Ordering::Acquire) && !worker.is_finished() {
            py.detach(|| thread::park_timeout(PERIOD));
            if let Err(signal) = py.check_signals() {
                watch.fail(signal);
            }
            tell();
        }
        let result = py.detach(|| worker.join());
        if matches!(result, Ok(Ok(_))) {
            tell();
        }
        result
    });
    if let Some(reason) = watch.failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        if let Ok(Err(error)) = &result
            && let Some(remains) = error.remains()
        {
            // Pythons before 3.11 have no notes.
            drop(reason.value(py).call_method1("add_note", (remains,)));
        }
        return Err(reason);
    }
    match result {
        Ok(result) => result.map_err(exception),
        Err(_) => Err(PyRuntimeError::new_err("fantex failed inside; please report it, with what you did")),
    }
}
