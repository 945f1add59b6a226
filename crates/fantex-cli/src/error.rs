//! Why a command ended without its result.

use std::fmt;
use std::path::Path;

use fantex::{Error, ErrorKind};

/// A command's failure.
#[derive(Debug)]
pub(crate) enum CliError {
    /// One sentence, and an exit code by its kind.
    Failed(Box<dyn std::error::Error + Send + Sync>),
    /// The reader of standard output has closed it.
    OutputClosed,
    /// The viewer has said itself what was wrong.
    Viewer { exit_code: u8 },
}

impl<E: std::error::Error + Send + Sync + 'static> From<E> for CliError {
    fn from(error: E) -> Self {
        Self::Failed(Box::new(error))
    }
}

impl fmt::Display for CliError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed(error) => error.fmt(f),
            Self::OutputClosed => f.write_str("standard output was closed"),
            Self::Viewer { .. } => f.write_str("the viewer has said what was wrong"),
        }
    }
}

impl CliError {
    /// 1 where the input or the system is at fault, 2 where the command line is.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::OutputClosed => 0,
            Self::Viewer { exit_code } => *exit_code,
            Self::Failed(error) => match error.downcast_ref().map(Error::kind) {
                Some(ErrorKind::InvalidArgument) => 2,
                _ => 1,
            },
        }
    }
}

/// The output exists.
pub(crate) fn exists(path: &Path) -> Error {
    Error::already_exists(format!("{} exists already; use --force to overwrite it", path.display()))
        .with_path(path)
}
