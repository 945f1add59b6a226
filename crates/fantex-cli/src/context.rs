//! What every command needs: where to print, what is allowed, progress, and whether the user wants to stop.
//!
//! Most of the time there is nothing to undo, and Ctrl-C ends the program at once. While something is being written, a
//! [`Deferral`] is held: Ctrl-C then only sets a flag, the operation notices it, removes its temporary file, and the
//! command ends by itself.

use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fantex::addresses::{check_is_path, is_address};
use fantex::bake::Progress;
use fantex::base::files::{check_folder_of, exists, remove_temporaries};
use fantex::base::input::{self, ReadLimits, ReadOptions};
use fantex::base::random::folded_seed;
use fantex::look::ResolveOptions;
use fantex::signals::on_end_request;
use fantex::stream::{ObjectTarget, Replace};
use fantex::texture::material::LeftOut;
use fantex::{Error, ErrorKind, Result};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;

use crate::CommonArgs;

/// The common flags, and whether the user wants to stop.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) force: bool,
    /// Bytes that texels in flight or in caches may take.
    pub(crate) memory_bytes: u64,
    /// Bytes that were asked for.
    pub(crate) memory_asked: Option<u64>,
    pub(crate) threads_asked: Option<u32>,
    pub(crate) seed: u64,
    pub(crate) is_seed_asked: bool,
    pub(crate) allow_outside: bool,
    /// Coarser texels do not stand in for damaged ones, and models are not shown without images: that is an error.
    pub(crate) strict: bool,
    json: bool,
    quiet: bool,
    interrupt: Interrupt,
}

impl Context {
    pub(crate) fn new(common: &CommonArgs) -> Result<Self> {
        if let Some(threads) = common.threads {
            let started = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
            started.map_err(|error| {
                Error::unavailable(format!("cannot start the threads that were asked for: {error}"))
            })?;
        }
        let memory_bytes = common.memory.unwrap_or(1 << 30);
        if memory_bytes < 1 << 30 {
            return_memory_at_once();
        }
        let options = ReadOptions {
            memory_bytes: common.memory.unwrap_or(4 << 30),
            allow_outside: common.allow_outside,
            protect_inputs: true,
        };
        ReadLimits::new(options).make_default();
        Ok(Self {
            force: common.force,
            memory_bytes,
            memory_asked: common.memory,
            threads_asked: common.threads,
            allow_outside: common.allow_outside,
            strict: common.strict,
            seed: common.seed(),
            is_seed_asked: common.seed.is_some(),
            json: common.json,
            quiet: common.quiet,
            interrupt: Interrupt::listen()?,
        })
    }

    /// Prints a note on standard error, unless --quiet is given.
    pub(crate) fn note(&self, text: impl AsRef<str>) {
        if !self.quiet {
            say(text.as_ref());
        }
    }

    /// Says that coarser texels stand in for damaged ones; with --strict that is an error.
    pub(crate) fn report_damage(&self, sentence: String) -> Result<()> {
        if self.strict {
            return Err(Error::damaged(sentence));
        }
        say(sentence);
        Ok(())
    }

    /// Notes images of a model that could not be read; with --strict that is an error.
    pub(crate) fn report_left_out(&self, path: &Path, left_out: &LeftOut) -> Result<()> {
        if self.strict {
            left_out.check()?;
        }
        left_out.notes().iter().for_each(|note| self.note(format!("{}: {note}", path.display())));
        Ok(())
    }

    /// The first flag that was given and says nothing to a window.
    pub(crate) fn flag_not_for_windows(&self) -> Option<&'static str> {
        let flags = [
            ("--json", self.json),
            ("--quiet", self.quiet),
            ("--strict", self.strict),
            ("--force", self.force),
            ("--seed", self.is_seed_asked),
        ];
        flags.into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag)
    }

    /// Whether results are printed for programs.
    pub(crate) fn is_json(&self) -> bool {
        self.json
    }

    /// Prints the result: as JSON if that is wanted, else as text. A reader that has closed standard output wants no more.
    pub(crate) fn print<T: Serialize>(&self, result: &T, text: impl FnOnce(&T) -> String) -> Result<()> {
        let mut output = match self.json {
            true => serde_json::to_string_pretty(result)
                .map_err(|error| Error::new(ErrorKind::Io, format!("cannot write the result: {error}")))?,
            false => printable(&text(result)),
        };
        if !output.ends_with('\n') {
            output.push('\n');
        }
        let mut stdout = io::stdout().lock();
        match stdout.write_all(output.as_bytes()).and_then(|()| stdout.flush()) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            result => result.map_err(|error| {
                Error::new(ErrorKind::Io, format!("cannot write to standard output: {error}"))
            }),
        }
    }

    /// A progress bar, drawn only for a person at a terminal.
    pub(crate) fn progress(&self, label: &str) -> Bar<'_> {
        Bar::new(label, "M texels", !self.quiet && !self.json, &self.interrupt)
    }

    /// As [`Context::progress`], of what counts bytes.
    pub(crate) fn progress_of_bytes(&self, label: &str) -> Bar<'_> {
        Bar::new(label, "MB", !self.quiet && !self.json, &self.interrupt)
    }

    /// A bar that is drawn from the first report to the last, for one of several steps.
    pub(crate) fn step(&self, label: &'static str, unit: &'static str) -> StepBar<'_> {
        StepBar { context: self, label, unit, bar: Mutex::default() }
    }

    /// A bar for a model that is read and cleaned.
    pub(crate) fn reading(&self) -> StepBar<'_> {
        self.step("reading", "MB")
    }

    /// Bars for what is fetched from a store and sent back.
    pub(crate) fn transfers(&self) -> [StepBar<'_>; 2] {
        ["fetching", "uploading"].map(|label| self.step(label, "MB"))
    }

    /// Until the result is dropped, Ctrl-C only sets a flag, so that a file being written is removed.
    pub(crate) fn defer_interrupt(&self) -> Deferral<'_> {
        self.interrupt.defer()
    }

    pub(crate) fn resolve_options(&self) -> ResolveOptions {
        ResolveOptions {
            memory_bytes: self.memory_bytes,
            seed: folded_seed(self.seed),
            ..ResolveOptions::default()
        }
    }

    pub(crate) fn is_interrupted(&self) -> bool {
        self.interrupt.is_requested()
    }

    /// Notes finished files that an interruption leaves.
    pub(crate) fn set_remains(&self, remains: String) {
        self.interrupt.lock().remains = Some(remains);
    }

    /// The last line of the interrupted program.
    pub(crate) fn last_line(&self) -> String {
        self.interrupt.lock().last_line()
    }

    /// Waits for Ctrl-C.
    pub(crate) fn wait_for_interrupt(&self) {
        self.interrupt.wait();
    }

    /// Checks for Ctrl-C between steps.
    pub(crate) fn check_interrupt(&self) -> Result<()> {
        if self.interrupt.is_requested() { Err(Error::cancelled(INTERRUPTED)) } else { Ok(()) }
    }

    /// What an object that is written may take the place of.
    pub(crate) fn replace(&self) -> Replace {
        if self.force { Replace::Anything } else { Replace::Nothing }
    }

    /// Refuses to overwrite a file before any work is done for it.
    pub(crate) fn check_output(&self, path: &Path) -> Result<()> {
        if is_address(path) {
            return Err(Error::invalid(format!(
                "cannot write {}: this command writes files; give a path, and copy the file to its address afterwards",
                path.display()
            )));
        }
        if path.is_dir() {
            return Err(Error::conflict(format!("cannot write {}: it is a folder", path.display())));
        }
        input::check_output(path)?;
        // A device or a pipe would be replaced by a file of its name.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            let path = path.display();
            return Err(Error::conflict(format!(
                "cannot write {path}: it is no ordinary file; give another name"
            )));
        }
        if !self.force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
        check_folder_of(path)
    }

    /// As [`Context::check_output`]; never allows the input itself, not even with --force.
    pub(crate) fn check_output_of(&self, path: &Path, input: &Path) -> Result<()> {
        // What is opened is known.
        drop(input::open(input));
        self.check_output(path)
    }

    /// As [`Context::check_output_of`], for what may be an object in a store, too: whether that is there, and whether it may be written.
    pub(crate) fn check_target_of<'a>(
        &self,
        place: &Path,
        inputs: impl IntoIterator<Item = &'a Path>,
    ) -> Result<()> {
        for input in inputs {
            if is_address(place) && place == input {
                return Err(input::is_read(place));
            }
            // What is opened is known.
            drop(input::open(input));
        }
        if !is_address(place) {
            return self.check_output(place);
        }
        let _deferral = self.defer_interrupt();
        ObjectTarget::at(place)?.check(self.force)?;
        self.check_interrupt()
    }

    /// Makes a folder, and those above it, where they are not there. If the command fails or is interrupted, those that it has made go,
    /// unless something is in them.
    pub(crate) fn make_folder(&self, folder: &Path) -> Result<()> {
        check_can_be_folder(folder)?;
        let mut state = self.interrupt.lock();
        let missing = folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let missing: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        state.made_folders.extend(missing.into_iter().rev());
        std::fs::create_dir_all(folder).map_err(|error| Error::writing(folder, error))
    }

    /// Removes the folders that the command has made and written nothing into.
    pub(crate) fn remove_empty_folders(&self) {
        self.interrupt.lock().remove_empty_folders();
    }
}

/// Refuses what can be no folder.
pub(crate) fn check_can_be_folder(folder: &Path) -> Result<()> {
    check_is_path(folder)?;
    if folder.exists() && !folder.is_dir() {
        let folder = folder.display();
        return Err(Error::conflict(format!("cannot write into {folder}: it is a file; give a folder")));
    }
    Ok(())
}

/// Prints a line on standard error, as far as that takes it.
pub(crate) fn say(line: impl fmt::Display) {
    let line = printable(&format!("{line}\n"));
    io::stderr().lock().write_all(line.as_bytes()).unwrap_or_default();
}

/// Text for a terminal: control characters, which names in files may hold, are shown as what they are.
fn printable(text: &str) -> String {
    let shown = |c: char| match c {
        '\n' | '\t' => c.to_string(),
        c if c.is_control() => c.escape_default().to_string(),
        c => c.to_string(),
    };
    text.chars().map(shown).collect()
}

/// The exit code of a program that was interrupted: 128 + SIGINT.
pub(crate) const EXIT_INTERRUPTED: u8 = 130;

/// The last line of an interrupted program that leaves nothing.
const INTERRUPTED: &str = "interrupted; no unfinished file was left behind";

/// Whether the user wants to stop, shared with the signal handler's thread.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt {
    state: Arc<Mutex<State>>,
    requested: Arc<Condvar>,
}

#[derive(Debug, Default)]
struct State {
    requested: bool,
    deferrals: u32,
    /// Finished files of an unfinished series.
    remains: Option<String>,
    /// Folders that the command has made, each after those above it.
    made_folders: Vec<PathBuf>,
}

impl State {
    fn remove_empty_folders(&mut self) {
        for folder in self.made_folders.drain(..).rev() {
            std::fs::remove_dir(folder).unwrap_or_default();
        }
    }

    fn last_line(&self) -> String {
        match &self.remains {
            Some(remains) => format!("interrupted after {remains}; no unfinished file was left behind"),
            None => INTERRUPTED.to_owned(),
        }
    }
}

impl Interrupt {
    /// Listens to Ctrl-C (and termination requests) from now on.
    pub(crate) fn listen() -> Result<Self> {
        let interrupt = Self::default();
        let heard = interrupt.clone();
        on_end_request(move || heard.request())?;
        Ok(interrupt)
    }

    pub(crate) fn is_requested(&self) -> bool {
        self.lock().requested
    }

    /// Until the result is dropped, Ctrl-C does not end the program at once.
    pub(crate) fn defer(&self) -> Deferral<'_> {
        self.lock().deferrals += 1;
        Deferral { interrupt: self }
    }

    fn wait(&self) {
        let mut state = self.lock();
        while !state.requested {
            state = self.requested.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn request(&self) {
        let mut state = self.lock();
        state.requested = true;
        self.requested.notify_all();
        // The lock stays taken: no operation can begin to write now.
        if state.deferrals == 0 {
            // Nothing is said after this: who fails because its files go waits here.
            let _last_word = io::stderr().lock();
            // Before locks go: this waits where nobody reads standard error, and threads that write to an asset go on for as long.
            say(format_args!("\nfantex: {}", state.last_line()));
            remove_temporaries();
            state.remove_empty_folders();
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

/// Shows how far a long operation is, and ends it on Ctrl-C.
pub(crate) struct Bar<'a> {
    bar: ProgressBar,
    label: String,
    /// A million of what is counted.
    millions: &'static str,
    /// The largest number that was reported: threads may report out of order.
    done: AtomicU64,
    interrupt: &'a Interrupt,
}

impl<'a> Bar<'a> {
    /// A bar on standard error, or one that is not drawn. `millions` names a million of what is counted.
    /// Without a terminal nothing is drawn in any case.
    pub(crate) fn new(label: &str, millions: &'static str, is_shown: bool, interrupt: &'a Interrupt) -> Self {
        let target =
            if is_shown { ProgressDrawTarget::stderr_with_hz(8) } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target);
        let bar = Self { bar, label: label.to_owned(), millions, done: AtomicU64::new(0), interrupt };
        bar.name(None);
        bar.bar.enable_steady_tick(Duration::from_millis(250));
        bar
    }

    /// Names the step that begins: one that counts nothing has a word of its own.
    fn name(&self, word: Option<&'static str>) {
        self.bar.set_message(word.map_or_else(|| self.label.clone(), str::to_owned));
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %  {amount}") {
            let millions = word.is_none().then_some(self.millions);
            let write_amount = move |state: &ProgressState, text: &mut dyn fmt::Write| {
                write_amount(state, millions, text);
            };
            self.bar.set_style(style.with_key("amount", write_amount));
        }
    }

    fn show(&self, word: Option<&'static str>, done: u64, total: u64) {
        if done == 0 || self.bar.length() != Some(total) {
            // Another operation begins.
            self.name(word);
            self.bar.set_length(total);
            self.bar.set_position(0);
            self.bar.reset_elapsed();
            self.done.store(0, Relaxed);
        }
        let before = self.done.fetch_max(done, Relaxed);
        self.bar.inc(done.saturating_sub(before));
    }
}

/// `12.0 of 64.0 M texels, 3.1 M texels/s, 17s left`, or the time alone of what counts nothing; what comes before is not counted. Of the first
/// second nothing is concluded.
fn write_amount(state: &ProgressState, millions: Option<&str>, text: &mut dyn fmt::Write) {
    let count = |count: f64| count / 1e6;
    let (elapsed, done) = (state.elapsed(), state.pos() as f64);
    let left = |total: u64| HumanDuration(elapsed.mul_f64((total as f64 - done).max(0.0) / done));
    let is_known = done > 0.0 && elapsed > Duration::from_secs(1);
    let _drawing_cannot_fail = match (state.len(), millions) {
        (None, _) => text.write_str("preparing"),
        (Some(total), None) if is_known => write!(text, "{:#} left", left(total)),
        (Some(_), None) => Ok(()),
        (Some(total), Some(unit)) => write!(text, "{:.1} of {:.1} {unit}", count(done), count(total as f64))
            .and_then(|()| match is_known {
                true => {
                    let rate = count(done / elapsed.as_secs_f64());
                    write!(text, ", {rate:.1} {unit}/s, {:#} left", left(total))
                }
                false => Ok(()),
            }),
    };
}

impl Progress for Bar<'_> {
    fn report(&self, done: u64, total: u64) {
        self.show(None, done, total);
    }

    fn prepare(&self, word: &'static str, share: f32) {
        self.show(Some(word), (1000.0 * share) as u64, 1000);
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_requested()
    }
}

/// A bar that is there while there is something to show; it ends the work on Ctrl-C in any case.
pub(crate) struct StepBar<'a> {
    context: &'a Context,
    label: &'static str,
    unit: &'static str,
    bar: Mutex<Option<Bar<'a>>>,
}

impl StepBar<'_> {
    fn show(&self, is_done: bool, show: impl FnOnce(&Bar<'_>)) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        if is_done {
            drop(bar.take());
            return;
        }
        let Context { quiet, json, interrupt, .. } = self.context;
        let is_shown = !quiet && !json;
        show(bar.get_or_insert_with(|| Bar::new(self.label, self.unit, is_shown, interrupt)));
    }
}

impl Progress for StepBar<'_> {
    fn report(&self, done: u64, total: u64) {
        self.show(done >= total, |bar| bar.report(done, total));
    }

    fn prepare(&self, word: &'static str, share: f32) {
        self.show(share >= 1.0, |bar| bar.prepare(word, share));
    }

    fn is_cancelled(&self) -> bool {
        self.context.is_interrupted()
    }
}

/// Shows nothing, and ends the work on Ctrl-C.
impl Progress for Context {
    fn report(&self, _done: u64, _total: u64) {}

    fn is_cancelled(&self) -> bool {
        self.is_interrupted()
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Makes the allocator give blocks of 8 MiB and more back to the system when they are freed. glibc's keeps them, for each thread,
/// up to 64 MiB: a bake in 128 MiB on eight threads takes 185 MiB this way and 337 MiB otherwise. It costs up to a
/// tenth of the time.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the C library's setting")]
fn return_memory_at_once() {
    // SAFETY: a number for a setting of that name; the call itself synchronises with other threads.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 8 << 20) };
}

/// Other allocators are left as they are.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn return_memory_at_once() {}

/// The most physical memory that the process has held at once, in bytes; unknown on systems without `/proc`.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    #[test]
    fn a_process_uses_some_memory() {
        assert!(super::peak_memory_bytes().unwrap() > 100_000);
    }
}
