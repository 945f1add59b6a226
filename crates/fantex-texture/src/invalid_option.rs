//! Checks of all options that are plain numbers.

use std::fmt;
use std::ops::RangeInclusive;

use fantex_base::{Error, Result};

/// Numbers that are fine one by one, but not together: a matrix without inverse, axes on one line, an empty range.
pub(crate) fn singular(owner: &str, field: &str) -> Error {
    Error::invalid(format!("{field} of {owner} collapses to nothing: it must have an inverse"))
}

/// What a number may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Allowed {
    /// Neither infinite nor NaN.
    Finite,
    /// Finite and not 0.
    NotZero,
    /// Finite and above 0.
    Positive,
    /// Finite and at least 0.
    NotNegative,
    /// From 0 to 1.
    Share,
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Finite => "finite",
            Self::NotZero => "finite and not 0",
            Self::Positive => "finite and above 0",
            Self::NotNegative => "finite and at least 0",
            Self::Share => "between 0 and 1",
        })
    }
}

/// Checks a number that lies between two others.
pub(crate) fn check_within(owner: &str, field: &str, value: f32, range: RangeInclusive<f32>) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let (low, high) = range.into_inner();
    Err(Error::invalid(format!("{field} of {owner} is {value}; it must be between {low} and {high}")))
}

impl Allowed {
    fn holds(self, value: f32) -> bool {
        value.is_finite()
            && match self {
                Self::Finite => true,
                Self::NotZero => value != 0.0,
                Self::Positive => value > 0.0,
                Self::NotNegative => value >= 0.0,
                Self::Share => (0.0..=1.0).contains(&value),
            }
    }

    /// Checks the numbers of one option.
    pub(crate) fn check(self, owner: &str, field: &str, values: &[f32]) -> Result<()> {
        match values.iter().find(|&&value| !self.holds(value)) {
            Some(value) => Err(Error::invalid(format!("{field} of {owner} is {value}; it must be {self}"))),
            None => Ok(()),
        }
    }
}
