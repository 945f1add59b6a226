//! Why a look cannot be used.

use std::error::Error;
use std::fmt;
use std::io;
use std::path::PathBuf;

/// A mistake in a look, with its place.
#[derive(Debug, thiserror::Error)]
#[error("{}{}{}: {problem}", file.display(), LineSuffix(*line), KeySuffix(key))]
pub struct LookError {
    /// The look.
    pub file: PathBuf,
    /// Line, from 1; 0 where the mistake belongs to no line.
    pub line: usize,
    /// The key, as in `textures.bark.scale` or `light[2].color`; may be empty.
    pub key: String,
    /// What is wrong there.
    #[source]
    pub problem: Box<LookProblem>,
}

struct LineSuffix(usize);

impl fmt::Display for LineSuffix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 { Ok(()) } else { write!(f, ":{}", self.0) }
    }
}

struct KeySuffix<'a>(&'a str);

impl fmt::Display for KeySuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, ": {}", self.0) }
    }
}

/// What is wrong at a place of a look.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookProblem {
    /// The file cannot be read.
    #[error("the look cannot be read: {0}")]
    Read(#[from] io::Error),
    /// The file is too long to be a look.
    #[error("the file has {bytes} bytes; a look has at most {limit}")]
    TooLong {
        /// Bytes of the file.
        bytes: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// The text is no TOML.
    #[error("this is no TOML: {0}")]
    Syntax(String),
    /// A key that has no meaning there.
    #[error("there is no key '{name}' here{}; allowed are {}", Nearest(nearest), List(allowed))]
    UnknownKey {
        /// The key.
        name: String,
        /// An allowed key that is written alike.
        nearest: Option<String>,
        /// All keys that are allowed.
        allowed: Vec<String>,
    },
    /// A key that must be there.
    #[error("the key '{0}' is missing")]
    MissingKey(String),
    /// A value of another type.
    #[error("expected {expected}, found {found}")]
    WrongType {
        /// What is allowed.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A text that is none of those allowed.
    #[error("'{name}' is not known here{}; allowed are {}", Nearest(nearest), List(allowed))]
    UnknownValue {
        /// What was found.
        name: String,
        /// An allowed one that is written alike.
        nearest: Option<String>,
        /// What is allowed.
        allowed: Vec<String>,
    },
    /// A number out of its range.
    #[error("expected a number {allowed}, found {found}")]
    Range {
        /// What is allowed.
        allowed: String,
        /// What was found.
        found: String,
    },
    /// A list with too many or too few entries.
    #[error("expected a list of {expected}, found {found} entries")]
    Length {
        /// How many are allowed.
        expected: String,
        /// How many there are.
        found: usize,
    },
    /// A name that stands for nothing.
    #[error("there is no {what} '{name}' in this look{}{}", Nearest(nearest), Known(known))]
    Undefined {
        /// Texture, material or object.
        what: &'static str,
        /// The name.
        name: String,
        /// A defined name that is written alike.
        nearest: Option<String>,
        /// The names that are defined.
        known: Vec<String>,
    },
    /// A name that cannot be told from a colour or a channel.
    #[error("a name must not be empty, start with '#' or hold a dot")]
    Name,
    /// Textures that need each other.
    #[error("these textures need each other in a circle: {}", .0.join(" -> "))]
    Cycle(Vec<String>),
    /// A chain of textures that is too long.
    #[error("more than {limit} textures need each other in a row, starting here")]
    TooDeep {
        /// How many are allowed.
        limit: usize,
    },
    /// Something would take too much memory.
    #[error("this takes {needed} bytes, and the memory limit is {limit}; make it smaller or raise --memory")]
    Memory {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// Two keys that cannot both be there.
    #[error("the keys '{0}' and '{1}' exclude each other; leave one of them out")]
    Exclusive(&'static str, &'static str),
    /// Keys of which one must be there.
    #[error("one of the keys {} is needed", List(.0))]
    OneNeeded(Vec<String>),
    /// A direction of length zero.
    #[error("this is no direction: it has no length")]
    NoDirection,
    /// A material for what is baked already.
    #[error("an asset is baked already and keeps its look; leave the key out, or name the model")]
    BakedAsset,
    /// What belongs to a model, without one.
    #[error("{0} belongs to a model, and there is none here")]
    NoModel(&'static str),
    /// An image that the model does not have.
    #[error("the model has {count} images, so there is no image {index}; the first is 0")]
    ModelImage {
        /// The image that was asked for.
        index: u32,
        /// Images of the model.
        count: usize,
    },
    /// Whatever the engine says of an option.
    #[error(transparent)]
    Refused(Box<dyn Error + Send + Sync>),
}

impl LookProblem {
    /// What a part of the engine says of an option.
    pub fn refused(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Refused(Box::new(error))
    }
}

struct Nearest<'a>(&'a Option<String>);

impl fmt::Display for Nearest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.as_ref().map_or(Ok(()), |name| write!(f, " (did you mean '{name}'?)"))
    }
}

/// `a, b and c`.
pub(super) struct List<'a>(pub(super) &'a [String]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => f.write_str("none"),
            [one] => f.write_str(one),
            [first @ .., last] => write!(f, "{} and {last}", first.join(", ")),
        }
    }
}

/// The defined names, where they are few enough to be of help.
struct Known<'a>(&'a [String]);

impl fmt::Display for Known<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.len() {
            0 => f.write_str("; none is defined"),
            1..=20 => write!(f, "; defined are {}", List(self.0)),
            count => write!(f, "; {count} others are defined"),
        }
    }
}
