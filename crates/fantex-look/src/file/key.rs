//! Places in a look.

use std::fmt;

/// The way to a value, as in `textures.bark.layers[2].mask`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Key(Vec<Step>);

/// From a table to one of its values, or from a list to one of its entries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    Name(String),
    Index(usize),
}

impl Key {
    /// The way through tables.
    pub fn of<const N: usize>(names: [&str; N]) -> Self {
        Self(names.iter().map(|name| Step::Name((*name).to_owned())).collect())
    }

    /// A value of the table.
    #[must_use]
    pub fn name(&self, name: &str) -> Self {
        self.with(Step::Name(name.to_owned()))
    }

    /// An entry of the list, from 0.
    #[must_use]
    pub fn index(&self, index: usize) -> Self {
        self.with(Step::Index(index))
    }

    fn with(&self, step: Step) -> Self {
        let mut steps = self.0.clone();
        steps.push(step);
        Self(steps)
    }

    pub(super) fn steps(&self) -> &[Step] {
        &self.0
    }

    /// The name in `NAMES.NAME...`, if the key lies within the table of that name.
    pub(super) fn member_of(&self, table: &str) -> Option<&str> {
        match self.0.as_slice() {
            [Step::Name(first), Step::Name(name), ..] if first == table => Some(name),
            _ => None,
        }
    }
}

impl fmt::Display for Key {
    /// Entries of lists are counted from 1.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (position, step) in self.0.iter().enumerate() {
            match step {
                Step::Name(name) if position == 0 => f.write_str(name)?,
                Step::Name(name) => write!(f, ".{name}")?,
                Step::Index(index) => write!(f, "[{}]", index + 1)?,
            }
        }
        Ok(())
    }
}
