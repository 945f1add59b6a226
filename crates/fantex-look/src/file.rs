//! Looks from files: TOML, checked against the schema, with the line of every mistake.
//!
//! ```text
//! text --toml--> document with spans --check (schema)--> references --names--> Look
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use fantex_base::{Error, ErrorKind, Place, Result, input};
use serde_json::{Map, Number, Value};
use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

use crate::check::{Checked, Checker, LookNumber, Mistake, Reference, ReferenceKind, look_schema, target};
use crate::data::{FileName, Look};
use crate::problem;

/// Limit of a look's text, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// A look and the text that it was read from.
#[derive(Clone, Debug)]
pub struct LookFile {
    look: Look,
    path: PathBuf,
    text: String,
    texture_files: Vec<PathBuf>,
}

impl LookFile {
    /// Reads a look.
    ///
    /// # Errors
    /// The file cannot be read, is no TOML, or is no look.
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |error: std::io::Error| {
            if error.kind() == io::ErrorKind::InvalidData {
                let sentence = format!("{} is no look: a look is a text, in TOML", path.display());
                return Error::malformed(sentence).with_path(path).with_source(error);
            }
            let kind = Error::reading(path, std::io::Error::from(error.kind())).kind();
            let sentence = format!("{}: the look cannot be read: {error}", path.display());
            Error::new(kind, sentence).with_path(path).with_source(error)
        };
        let file = input::open(path).map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        if bytes > MAX_BYTES {
            let sentence = format!("the file has {bytes} bytes; a look has at most {MAX_BYTES}");
            return Err(Error::too_large(sentence).in_file(path));
        }
        Self::parse(&io::read_to_string(file.take(MAX_BYTES)).map_err(failed)?, path)
    }

    /// Takes a look from a text. `path` names it in messages, and files that it mentions lie beside it.
    ///
    /// # Errors
    /// The text is no TOML or no look.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut file =
            Self { look: Look::default(), path: path.into(), text: text.into(), texture_files: Vec::new() };
        let document = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            let sentence = format!("this is no TOML: {}", error.message().trim().replace('\n', ", "));
            file.mistake(Mistake { key: Key::default(), span, problem: Error::malformed(sentence) })
        })?;
        let mut checker = Checker::new(look_schema());
        checker.document(&document).map_err(|m| file.mistake(m))?;
        let look = serde_json::from_value(json_of_table(document.get_ref()))
            .map_err(|error| file.error(&Key::default(), problem::refused(error)))?;
        check_names(&look, &checker.references).map_err(|m| file.mistake(m))?;
        let is_file = |r: &&Reference| r.kind == ReferenceKind::File && r.key.member_of("textures").is_some();
        file.texture_files =
            checker.references.iter().filter(is_file).map(|r| r.name.clone().into()).collect();
        Ok(Self { look, ..file })
    }

    /// A look that was made by a program and is known to keep the rules, as if it had been read from a file.
    pub fn of_look(look: Look, path: &Path) -> Self {
        Self { look, path: path.into(), text: String::new(), texture_files: Vec::new() }
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

    /// The numbers in the text, in its order.
    pub fn numbers(&self) -> Vec<LookNumber> {
        let Ok(document) = DeTable::parse(&self.text) else { return Vec::new() };
        let mut checker = Checker::new(look_schema());
        let mut numbers = checker.document(&document).map_or_else(|_| Vec::new(), |()| checker.numbers);
        numbers.sort_by_key(|number| number.span.start);
        numbers.dedup_by_key(|number| number.span.start);
        numbers
    }

    /// The files that the textures mention, as they are named.
    pub fn texture_files(&self) -> &[PathBuf] {
        &self.texture_files
    }

    /// A file that the look mentions, relative to the look's folder.
    pub fn file(&self, name: &FileName) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(&name.0)
    }

    /// A problem at a key of this look: `scene.toml:12: textures.bark.scale: ...`.
    pub fn error(&self, key: &Key, problem: Error) -> Error {
        let span = DeTable::parse(&self.text).ok().and_then(|document| span_of(&document, key));
        self.located(span.map(|start| self.line(start)), key, problem)
    }

    fn mistake(&self, mistake: Mistake) -> Error {
        self.located(Some(self.line(mistake.span.start)), &mistake.key, mistake.problem)
    }

    fn located(&self, line: Option<usize>, key: &Key, problem: Error) -> Error {
        // What a part of the engine takes for an argument of a function stands in the file here.
        let problem = match problem.kind() {
            ErrorKind::InvalidArgument => Error::malformed(problem.to_string()).with_source(problem),
            _ => problem,
        };
        let problem = if key.steps().is_empty() { problem } else { problem.context(key) };
        let path = self.path.display();
        match line {
            None => problem.context(path).with_place(Place::Key(key.to_string())),
            Some(line) => problem.context(format_args!("{path}:{line}")).with_place(Place::Line(line as u64)),
        }
        .with_path(&self.path)
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
    /// A number is not finite.
    pub fn to_toml(&self) -> Result<String> {
        let mut value = serde_json::to_value(self).map_err(problem::refused)?;
        shorten(&mut value);
        let schema = look_schema();
        without_defaults(&mut value, schema, schema);
        let table = toml_of(&value).unwrap_or(toml::Value::Table(toml::Table::new()));
        toml::to_string(&table).map_err(problem::refused)
    }
}

/// Writes numbers of single precision with the digits that tell them from their neighbours, not with those of their value in double
/// precision.
pub(crate) fn shorten(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let single = number.as_f64().unwrap_or_default() as f32;
            let short = single.to_string().parse().ok().and_then(Number::from_f64);
            if Some(f64::from(single)) == number.as_f64()
                && let Some(short) = short
            {
                *number = short;
            }
        }
        Value::Array(list) => list.iter_mut().for_each(shorten),
        Value::Object(members) => members.values_mut().for_each(shorten),
        _ => {}
    }
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

// Places in a look.

/// The way to a value, as in `textures.bark.layers[2].mask`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Key(Vec<Step>);

/// From a table to one of its values, or from a list to one of its entries.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Step {
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

    /// Steps from the document.
    pub(crate) fn depth(&self) -> usize {
        self.0.len()
    }

    fn steps(&self) -> &[Step] {
        &self.0
    }

    /// The name in `NAMES.NAME...`, if the key lies within the table of that name.
    fn member_of(&self, table: &str) -> Option<&str> {
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

// Names that stand for textures, materials and objects of the look.

/// Textures that may need each other in a row: evaluation calls them one within the other.
const MAX_DEPTH: usize = 64;

/// Textures that are evaluated for one point, each as often as others need it.
const MAX_EVALUATIONS: u64 = 4096;

/// Checks that every name is defined and no texture needs itself.
fn check_names(look: &Look, references: &[Reference]) -> Checked {
    let objects: BTreeSet<&str> = look.object.iter().filter_map(|o| o.name.as_deref()).collect();
    references.iter().try_for_each(|reference| check_defined(look, &objects, reference))?;
    let mut needs: BTreeMap<&str, Vec<&Reference>> = BTreeMap::new();
    for reference in references.iter().filter(|r| r.kind == ReferenceKind::Texture) {
        if let Some(owner) = reference.key.member_of("textures") {
            needs.entry(owner).or_default().push(reference);
        }
    }
    let mut walk = Walk { needs: &needs, path: Vec::new(), done: BTreeMap::new() };
    needs.keys().try_for_each(|&name| walk.visit(name).map(drop))
}

fn check_defined(look: &Look, objects: &BTreeSet<&str>, reference: &Reference) -> Checked {
    let name = reference.name.as_str();
    let is_known = match reference.kind {
        ReferenceKind::Texture => look.textures.contains_key(name),
        ReferenceKind::Material => look.materials.contains_key(name),
        ReferenceKind::Object => objects.contains(name),
        ReferenceKind::File => true,
    };
    if is_known {
        return Ok(());
    }
    let (what, known): (_, Vec<&str>) = match reference.kind {
        ReferenceKind::Texture => ("texture", look.textures.keys().map(String::as_str).collect()),
        ReferenceKind::Material => ("material", look.materials.keys().map(String::as_str).collect()),
        ReferenceKind::Object | ReferenceKind::File => ("object", objects.iter().copied().collect()),
    };
    Err(mistake(reference, problem::undefined(what, &reference.name, known)))
}

fn mistake(reference: &Reference, problem: Error) -> Mistake {
    Mistake { key: reference.key.clone(), span: reference.span.clone(), problem }
}

struct Walk<'r> {
    needs: &'r BTreeMap<&'r str, Vec<&'r Reference>>,
    /// From the first texture to the one that is visited.
    path: Vec<&'r str>,
    /// Of textures that are done: those in the longest row from here on, and evaluations for one point.
    done: BTreeMap<&'r str, (usize, u64)>,
}

impl<'r> Walk<'r> {
    fn visit(&mut self, name: &'r str) -> Result<(usize, u64), Mistake> {
        if let Some(&done) = self.done.get(name) {
            return Ok(done);
        }
        self.path.push(name);
        let (mut deepest, mut evaluations) = (0, 1_u64);
        for &reference in self.needs.get(name).into_iter().flatten() {
            if let Some(start) = self.path.iter().position(|&other| other == reference.name) {
                let circle: Vec<&str> =
                    self.path[start..].iter().copied().chain([reference.name.as_str()]).collect();
                let sentence = format!("these textures need each other in a circle: {}", circle.join(" -> "));
                return Err(mistake(reference, Error::malformed(sentence)));
            }
            let too_deep = || {
                let sentence =
                    format!("more than {MAX_DEPTH} textures need each other in a row, starting here");
                mistake(reference, Error::malformed(sentence))
            };
            // Bounds the recursion, too.
            if self.path.len() > MAX_DEPTH {
                return Err(too_deep());
            }
            let (depth, times) = self.visit(&reference.name)?;
            deepest = deepest.max(depth);
            evaluations += times;
            if deepest >= MAX_DEPTH {
                return Err(too_deep());
            }
            if evaluations > MAX_EVALUATIONS {
                let sentence = format!(
                    "more than {MAX_EVALUATIONS} textures would be evaluated for each point, as several need the same ones again; put \
                     a shared one into a table (kind = \"table\")"
                );
                return Err(mistake(reference, Error::malformed(sentence)));
            }
        }
        self.path.pop();
        self.done.insert(name, (deepest + 1, evaluations));
        Ok((deepest + 1, evaluations))
    }
}

// Documents as JSON values and back: the types of a look are read from and written to these only.

/// A document without its spans. Dates become their text.
fn json_of_table(table: &DeTable<'_>) -> Value {
    let members = table.iter().map(|(name, value)| (name.get_ref().to_string(), json_of(value.get_ref())));
    Value::Object(members.collect())
}

fn json_of(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::String(text) => Value::String(text.to_string()),
        DeValue::Integer(integer) => json_of_integer(integer),
        DeValue::Float(float) => {
            float.as_str().parse().ok().and_then(Number::from_f64).map_or(Value::Null, Value::Number)
        }
        DeValue::Boolean(value) => Value::Bool(*value),
        DeValue::Datetime(date) => Value::String(date.to_string()),
        DeValue::Array(list) => list.iter().map(|entry| json_of(entry.get_ref())).collect(),
        DeValue::Table(table) => json_of_table(table),
    }
}

fn json_of_integer(integer: &DeInteger<'_>) -> Value {
    i64::from_str_radix(integer.as_str(), integer.radix()).map_or(Value::Null, Value::from)
}

/// The TOML of a JSON value without nulls; empty tables are left out.
fn toml_of(value: &Value) -> Option<toml::Value> {
    Some(match value {
        Value::Null => return None,
        Value::Bool(value) => toml::Value::Boolean(*value),
        Value::Number(number) => match number.as_i64() {
            Some(integer) => toml::Value::Integer(integer),
            None => toml::Value::Float(number.as_f64()?),
        },
        Value::String(text) => toml::Value::String(text.clone()),
        Value::Array(list) => toml::Value::Array(list.iter().filter_map(toml_of).collect()),
        Value::Object(members) => toml::Value::Table(toml_table(members)),
    })
}

fn toml_table(members: &Map<String, Value>) -> toml::Table {
    members.iter().filter_map(|(name, value)| Some((name.clone(), toml_of(value)?))).collect()
}

/// Removes what says no more than the schema's defaults do.
fn without_defaults(value: &mut Value, schema: &Value, root: &Value) {
    let schema = target(schema, root);
    match value {
        Value::Object(members) => {
            let schema = alternative(schema, members, root);
            for (name, member) in members.iter_mut() {
                let property = schema.get("properties").and_then(|p| p.get(name));
                if let Some(inner) = property.or_else(|| schema.get("additionalProperties")) {
                    without_defaults(member, inner, root);
                }
            }
            let required = schema.get("required").and_then(Value::as_array);
            let is_required = |name: &str| required.is_some_and(|r| r.iter().any(|n| n == name));
            members.retain(|name, member| {
                let default = schema.get("properties").and_then(|p| p.get(name)?.get("default"));
                let says_nothing = member.is_null()
                    || member.as_object().is_some_and(Map::is_empty) && default.is_some()
                    || default == Some(member);
                !says_nothing || is_required(name)
            });
        }
        Value::Array(list) => {
            if let Some(items) = schema.get("items") {
                list.iter_mut().for_each(|entry| without_defaults(entry, items, root));
            }
        }
        _ => {}
    }
}

/// The alternative of a schema whose fixed texts a table has.
fn alternative<'s>(schema: &'s Value, members: &Map<String, Value>, root: &'s Value) -> &'s Value {
    let Some(list) = schema.get("anyOf").or_else(|| schema.get("oneOf")).and_then(Value::as_array) else {
        return schema;
    };
    let fits = |schema: &Value| {
        let properties = schema.get("properties").and_then(Value::as_object);
        properties.is_some_and(|p| {
            p.iter()
                .all(|(name, property)| property.get("const").is_none_or(|c| members.get(name) == Some(c)))
        })
    };
    let candidates = list.iter().map(|a| alternative(target(a, root), members, root));
    candidates.into_iter().find(|a| fits(a)).unwrap_or(schema)
}
