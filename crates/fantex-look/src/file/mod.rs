//! Looks from files: TOML, checked against the schema, with the line of every mistake.
//!
//! ```text
//! text --toml--> document with spans --check (schema)--> references --names--> Look
//! ```

mod check;
mod error;
mod key;
mod names;
mod schema;
mod suggest;
mod tree;

use std::fs;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use check::{Checker, Mistake};
use key::Step;

use crate::data::{FileName, Look};

pub use error::{LookError, LookProblem};
pub use key::Key;
pub use schema::look_schema;

/// Longest text of a look, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// A look and the text that it was read from.
#[derive(Clone, Debug)]
pub struct LookFile {
    look: Look,
    path: PathBuf,
    text: String,
}

impl LookFile {
    /// Reads a look.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is no TOML, or is no look.
    pub fn read(path: &Path) -> Result<Self, LookError> {
        let fail = |problem| LookError {
            file: path.into(),
            line: 0,
            key: String::new(),
            problem: Box::new(problem),
        };
        let read = || -> Result<String, LookProblem> {
            let bytes = fs::metadata(path)?.len();
            if bytes > MAX_BYTES {
                return Err(LookProblem::TooLong { bytes, limit: MAX_BYTES });
            }
            Ok(fs::read_to_string(path)?)
        };
        Self::parse(&read().map_err(fail)?, path)
    }

    /// Takes a look from a text. `path` names it in messages, and files that it mentions lie beside it.
    ///
    /// # Errors
    ///
    /// The text is no TOML or no look.
    pub fn parse(text: &str, path: &Path) -> Result<Self, LookError> {
        let file = Self { look: Look::default(), path: path.into(), text: text.into() };
        let document = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            file.mistake(Mistake { key: Key::default(), span, problem: Box::new(syntax(&error)) })
        })?;
        let mut checker = Checker::new(look_schema());
        checker.document(&document).map_err(|m| file.mistake(m))?;
        let look = serde_json::from_value(tree::json_of_table(document.get_ref()))
            .map_err(|error| file.error(&Key::default(), LookProblem::refused(error)))?;
        names::check_names(&look, &checker.references).map_err(|m| file.mistake(m))?;
        Ok(Self { look, ..file })
    }

    /// A look that was made by a program, as if it had been read from a file.
    ///
    /// # Errors
    ///
    /// It breaks a rule of looks, such as a range or an undefined name.
    pub fn from_look(look: &Look, path: &Path) -> Result<Self, LookError> {
        let text = look.to_toml().map_err(|problem| LookError {
            file: path.into(),
            line: 0,
            key: String::new(),
            problem: Box::new(problem),
        })?;
        Self::parse(&text, path)
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// What the file says.
    pub fn look(&self) -> &Look {
        &self.look
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A file that the look mentions, relative to the look's folder.
    pub fn file(&self, name: &FileName) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(&name.0)
    }

    /// A problem at a key of this look.
    pub fn error(&self, key: &Key, problem: LookProblem) -> LookError {
        let span = DeTable::parse(&self.text).ok().and_then(|document| span_of(&document, key));
        let line = span.map_or(0, |start| self.line(start));
        LookError { file: self.path.clone(), line, key: key.to_string(), problem: Box::new(problem) }
    }

    fn mistake(&self, mistake: Mistake) -> LookError {
        let Mistake { key, span, problem } = mistake;
        LookError { file: self.path.clone(), line: self.line(span.start), key: key.to_string(), problem }
    }

    /// The line of a byte, from 1.
    fn line(&self, byte: usize) -> usize {
        let before = self.text.as_bytes().get(..byte).unwrap_or(self.text.as_bytes());
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }
}

impl Look {
    /// The look as TOML that [`LookFile::parse`] reads; what has its default is left out.
    ///
    /// # Errors
    ///
    /// A number is not finite.
    pub fn to_toml(&self) -> Result<String, LookProblem> {
        let mut value = serde_json::to_value(self).map_err(LookProblem::refused)?;
        let schema = look_schema();
        tree::without_defaults(&mut value, schema, schema);
        let table = tree::toml_of(&value).unwrap_or(toml::Value::Table(toml::Table::new()));
        toml::to_string(&table).map_err(LookProblem::refused)
    }
}

fn syntax(error: &toml::de::Error) -> LookProblem {
    LookProblem::Syntax(error.message().trim().replace('\n', ", "))
}

/// The first byte of a key's value; of the innermost table around it, where the value itself is a default.
fn span_of(document: &Spanned<DeTable<'_>>, key: &Key) -> Option<usize> {
    let mut start = None;
    let mut table = Some(document.get_ref());
    let mut list = None;
    for step in key.steps() {
        let value = match step {
            Step::Name(name) => {
                let Some((name, value)) = table.and_then(|t| t.get_key_value(name.as_str())) else { break };
                start = Some(name.span().start);
                value
            }
            Step::Index(index) => {
                let Some(value) = list.and_then(|l: &toml::de::DeArray<'_>| l.get(*index)) else { break };
                start = Some(value.span().start);
                value
            }
        };
        (table, list) = match value.get_ref() {
            DeValue::Table(inner) => (Some(inner), None),
            DeValue::Array(inner) => (None, Some(inner)),
            _ => (None, None),
        };
    }
    start
}
