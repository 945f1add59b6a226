//! What every command needs: where to print, what is allowed, whether the user wants to stop.

use std::io::{self, Write};
use std::path::Path;

use fantex::texture::look::ResolveOptions;
use serde::Serialize;

use crate::cli::CommonArgs;
use crate::error::CliError;
use crate::interrupt::{Deferral, Interrupt};
use crate::progress::Bar;
use crate::sources::folded_seed;

/// The common flags at work.
#[derive(Debug)]
pub(crate) struct Context {
    /// Overwrite existing files.
    pub(crate) force: bool,
    /// Bytes that texels in flight or in caches may take.
    pub(crate) memory_bytes: u64,
    /// Seed of everything random.
    pub(crate) seed: u64,
    json: bool,
    quiet: bool,
    interrupt: Interrupt,
}

impl Context {
    /// Sets up threads and Ctrl-C.
    pub(crate) fn new(common: &CommonArgs) -> Result<Self, CliError> {
        if let Some(threads) = common.threads {
            rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global()?;
        }
        Ok(Self {
            force: common.force,
            memory_bytes: common.memory.0,
            seed: common.seed,
            json: common.json,
            quiet: common.quiet,
            interrupt: Interrupt::listen()?,
        })
    }

    /// Tells the user something that is not the result.
    pub(crate) fn note(&self, text: impl AsRef<str>) {
        if !self.quiet {
            eprintln!("{}", text.as_ref());
        }
    }

    /// Prints the result: as JSON if that is wanted, else as text.
    pub(crate) fn print<T: Serialize>(
        &self,
        result: &T,
        text: impl FnOnce(&T) -> String,
    ) -> Result<(), CliError> {
        let mut output = match self.json {
            true => serde_json::to_string_pretty(result)?,
            false => text(result),
        };
        if !output.ends_with('\n') {
            output.push('\n');
        }
        let mut stdout = io::stdout().lock();
        match stdout.write_all(output.as_bytes()).and_then(|()| stdout.flush()) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(CliError::OutputClosed),
            result => result.map_err(CliError::Print),
        }
    }

    /// A progress bar, drawn only for a person at a terminal.
    pub(crate) fn progress(&self, label: &str) -> Bar<'_> {
        Bar::new(label, !self.quiet && !self.json, &self.interrupt)
    }

    /// Keeps Ctrl-C from ending the program while a file is written.
    pub(crate) fn defer_interrupt(&self) -> Deferral<'_> {
        self.interrupt.defer()
    }

    /// How the textures of a look are made.
    pub(crate) fn resolve_options(&self) -> ResolveOptions {
        ResolveOptions {
            memory_bytes: self.memory_bytes,
            seed: folded_seed(self.seed),
            ..ResolveOptions::default()
        }
    }

    /// Ends the command if Ctrl-C came meanwhile.
    pub(crate) fn check_interrupt(&self) -> Result<(), CliError> {
        if self.interrupt.is_requested() { Err(CliError::Interrupted) } else { Ok(()) }
    }

    /// Refuses to overwrite a file before any work is done for it.
    pub(crate) fn check_output(&self, path: &Path) -> Result<(), CliError> {
        if path.is_dir() {
            return Err(CliError::OutputIsFolder { path: path.into() });
        }
        // A device or a pipe would be replaced by a file of its name.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(CliError::OutputIsNoFile { path: path.into() });
        }
        if !self.force && path.symlink_metadata().is_ok() {
            return Err(CliError::Exists { path: path.into() });
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(CliError::NoFolder { path: path.into(), folder: folder.into() });
        }
        Ok(())
    }

    /// As [`Context::check_output`]; what is made of a file does not replace it either, whatever is asked.
    pub(crate) fn check_output_of(&self, path: &Path, input: &Path) -> Result<(), CliError> {
        if let (Ok(output), Ok(input)) = (path.canonicalize(), input.canonicalize())
            && output == input
            && output.is_file()
        {
            return Err(CliError::OutputIsInput { path: path.into() });
        }
        self.check_output(path)
    }

    /// Makes a folder for output, and those above it.
    pub(crate) fn make_folder(&self, folder: &Path) -> Result<(), CliError> {
        std::fs::create_dir_all(folder)
            .map_err(|source| CliError::MakeFolder { folder: folder.into(), source })
    }
}
