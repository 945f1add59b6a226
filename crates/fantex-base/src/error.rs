//! One error type for the whole library.
//!
//! An [`Error`] has a [kind](ErrorKind) that programs match, and one sentence for people: what, where, what was expected, what to
//! do. Where it concerns a file, the file and the place in it can be asked for, too.
//!
//! ```
//! use fantex_base::{Error, ErrorKind, Place};
//!
//! let error = Error::malformed("expected three vertex indices").at(Place::Line(12)).in_file("bunny.obj");
//! assert_eq!(error.to_string(), "bunny.obj: line 12: expected three vertex indices");
//! assert_eq!(error.kind(), ErrorKind::Malformed);
//! ```

use std::error::Error as StdError;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What went wrong, for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// A file, or an item that was asked for by name, is not there.
    NotFound,
    /// The output exists, and overwriting was not asked for.
    AlreadyExists,
    /// The system refused to read or write.
    Io,
    /// The content of a file breaks its format's rules.
    Malformed,
    /// Valid, but not something that can be read or done.
    Unsupported,
    /// A limit would be exceeded: memory, counts, extents.
    TooLarge,
    /// An argument or option is out of its range, or contradicts another.
    InvalidArgument,
    /// Stored data do not match their checksums.
    Damaged,
    /// Another process holds or has changed what is needed.
    Conflict,
    /// A device, server or program is missing or has gone.
    Unavailable,
    /// The caller asked to stop.
    Cancelled,
}

/// A place inside a file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// Line of a text file, from 1.
    Line(u64),
    /// Offset in bytes, from 0.
    Byte(u64),
    /// A key of a structured file, such as `material[0].base_color`.
    Key(String),
    /// A named part, such as `accessor 3`.
    Item(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Key(name) | Self::Item(name) => f.write_str(name),
        }
    }
}

/// Why an operation did not succeed.
///
/// `Display` gives the whole sentence, from the outermost context inwards, parts separated by colons.
#[derive(Clone)]
pub struct Error(Box<Inner>);

#[derive(Clone)]
struct Inner {
    kind: ErrorKind,
    message: String,
    path: Option<PathBuf>,
    place: Option<Place>,
    source: Option<Arc<dyn StdError + Send + Sync>>,
    remains: Option<String>,
}

macro_rules! constructors {
    ($($name:ident => $kind:ident),* $(,)?) => {
        $(
            #[doc = concat!("An error of kind [`ErrorKind::", stringify!($kind), "`].")]
            pub fn $name(message: impl Into<String>) -> Self {
                Self::new(ErrorKind::$kind, message)
            }
        )*
    };
}

impl Error {
    /// An error with its sentence, or the innermost part of one.
    pub fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        let message = message.into();
        Self(Box::new(Inner { kind, message, path: None, place: None, source: None, remains: None }))
    }

    constructors! {
        not_found => NotFound,
        already_exists => AlreadyExists,
        malformed => Malformed,
        unsupported => Unsupported,
        too_large => TooLarge,
        invalid => InvalidArgument,
        damaged => Damaged,
        conflict => Conflict,
        unavailable => Unavailable,
        cancelled => Cancelled,
    }

    /// `cannot read PATH: ...`; a missing file is [`ErrorKind::NotFound`], anything else [`ErrorKind::Io`].
    pub fn reading(path: impl Into<PathBuf>, source: io::Error) -> Self {
        Self::of_io("read", path.into(), source)
    }

    /// `cannot write PATH: ...`.
    pub fn writing(path: impl Into<PathBuf>, source: io::Error) -> Self {
        Self::of_io("write", path.into(), source)
    }

    fn of_io(verb: &str, path: PathBuf, source: io::Error) -> Self {
        let kind = match source.kind() {
            io::ErrorKind::NotFound => ErrorKind::NotFound,
            _ => ErrorKind::Io,
        };
        let message = format!("cannot {verb} {}: {source}", path.display());
        Self::new(kind, message).with_path(path).with_source(source)
    }

    /// Names the file, without changing the sentence.
    pub fn with_path(mut self, path: impl Into<PathBuf>) -> Self {
        self.0.path = Some(path.into());
        self
    }

    /// Names the place in the file, without changing the sentence.
    pub fn with_place(mut self, place: Place) -> Self {
        self.0.place = Some(place);
        self
    }

    /// Keeps the error that caused this one, without changing the sentence.
    pub fn with_source(mut self, source: impl Into<Box<dyn StdError + Send + Sync>>) -> Self {
        let source: Box<dyn StdError + Send + Sync> = source.into();
        self.0.source = Some(Arc::from(source));
        self
    }

    /// Puts the file before the sentence: `bunny.obj: ...`. An error that names a file already stays as it is.
    pub fn in_file(self, path: impl AsRef<Path>) -> Self {
        if self.0.path.is_some() {
            return self;
        }
        let path = path.as_ref();
        self.context(path.display()).with_path(path)
    }

    /// Has the sentence and the path name another file, for one that nobody else knows; or another folder, for one with such files.
    pub fn renamed(mut self, file: &Path, name: &Path) -> Self {
        let [known, told] = [file, name].map(|path| path.display().to_string());
        self.0.message = self.0.message.replace(&known, &told);
        if let Some(rest) = self.path().and_then(|path| path.strip_prefix(file).ok()) {
            self.0.path = Some(if rest.as_os_str().is_empty() { name.to_owned() } else { name.join(rest) });
        }
        self
    }

    /// Puts the place before the sentence: `line 12: ...`.
    pub fn at(self, place: Place) -> Self {
        let mut error = self.context(&place);
        error.0.place.get_or_insert(place);
        error
    }

    /// Puts words before the sentence: `cannot write bunny.fan: ...`.
    pub fn context(mut self, words: impl fmt::Display) -> Self {
        self.0.message = format!("{words}: {}", self.0.message);
        self
    }

    /// Says behind the sentence what is left of the work: `cannot write ...; the finished file is kept: ...`.
    pub fn leaving(mut self, remains: impl Into<String>) -> Self {
        let remains = remains.into();
        self.0.message = format!("{}; {remains}", self.0.message);
        self.0.remains = Some(remains);
        self
    }

    /// What is left of the work, where the sentence says that.
    pub fn remains(&self) -> Option<&str> {
        self.0.remains.as_deref()
    }

    /// What went wrong, for programs.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// The file, where it concerns one.
    pub fn path(&self) -> Option<&Path> {
        self.0.path.as_deref()
    }

    /// The place in the file, where it is known.
    pub fn place(&self) -> Option<&Place> {
        self.0.place.as_ref()
    }

    /// Whether the caller asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.0.kind == ErrorKind::Cancelled
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.message)
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}({:?})", self.0.kind, self.0.message)
    }
}

impl StdError for Error {
    fn source(&self) -> Option<&(dyn StdError + 'static)> {
        self.0.source.as_deref().map(|source| source as _)
    }
}
