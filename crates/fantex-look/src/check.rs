//! A document against the schema.
//!
//! The schema is made from the very types that hold a look, so what passes here can be read into them; and the checks know
//! the line of everything. Only those parts of JSON Schema are understood that the schema of a look uses.

use std::ops::Range;
use std::sync::LazyLock;

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeArray, DeInteger, DeTable, DeValue};

use fantex_base::{Error, counted};
use fantex_texture::Color;

use crate::data::{Look, split_channel};
use crate::file::{Key, shorten};
use crate::problem;

/// No number of a look is farther from 0, and none but 0 itself closer: within this range single precision is safe.
const MAGNITUDES: Range<f64> = 1e-30..1e30;

const BAD_NAME: &str = "a name must not be empty, start with '#' or hold a dot";

#[derive(Debug)]
pub(crate) struct Mistake {
    pub(crate) key: Key,
    pub(crate) span: Range<usize>,
    pub(crate) problem: Error,
}

/// A name that stands for something else in the look.
#[derive(Debug)]
pub(crate) struct Reference {
    pub(crate) key: Key,
    pub(crate) span: Range<usize>,
    pub(crate) kind: ReferenceKind,
    pub(crate) name: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReferenceKind {
    Texture,
    Material,
    Object,
    File,
}

#[derive(Debug)]
pub(crate) struct Checker<'s> {
    schema: &'s Value,
    pub(crate) references: Vec<Reference>,
    pub(crate) numbers: Vec<LookNumber>,
}

pub(crate) type Checked = Result<(), Mistake>;

#[derive(Clone, Debug)]
struct Place<'v, 'i> {
    value: &'v DeValue<'i>,
    key: Key,
    span: Range<usize>,
}

impl<'v, 'i> Place<'v, 'i> {
    fn mistake(&self, problem: Error) -> Mistake {
        Mistake { key: self.key.clone(), span: self.span.clone(), problem }
    }

    fn entry(&self, index: usize, entry: &'v Spanned<DeValue<'i>>) -> Self {
        Place { value: entry.get_ref(), key: self.key.index(index), span: entry.span() }
    }

    /// A value of this table. Tables are shown by their name, other values by themselves.
    fn member(&self, name: &Spanned<toml::de::DeString<'i>>, value: &'v Spanned<DeValue<'i>>) -> Self {
        let span = if value.get_ref().is_table() { name.span() } else { value.span() };
        Place { value: value.get_ref(), key: self.key.name(name.get_ref()), span }
    }
}

impl<'s> Checker<'s> {
    pub(crate) fn new(schema: &'s Value) -> Self {
        Self { schema, references: Vec::new(), numbers: Vec::new() }
    }

    pub(crate) fn document(&mut self, document: &Spanned<DeTable<'_>>) -> Checked {
        let value = DeValue::Table(document.get_ref().clone());
        let place = Place { value: &value, key: Key::default(), span: 0..0 };
        self.value(self.schema, &place)
    }

    fn value(&mut self, schema: &'s Value, place: &Place<'_, '_>) -> Checked {
        let schema = target(schema, self.schema);
        if let Some(alternatives) = alternatives(schema) {
            return self.alternatives(schema, alternatives, place);
        }
        match place.value {
            DeValue::Table(table) if has_type(schema, "object") => self.table(schema, table, place),
            DeValue::Array(list) if has_type(schema, "array") => self.list(schema, list, place),
            DeValue::String(text) if has_type(schema, "string") => self.text(schema, text, place),
            DeValue::Boolean(_) if has_type(schema, "boolean") => Ok(()),
            DeValue::Integer(_) if has_type(schema, "integer") || has_type(schema, "number") => {
                number(schema, place).map(|value| self.numbers.push(LookNumber::new(schema, place, value)))
            }
            DeValue::Float(_) if has_type(schema, "number") => {
                number(schema, place).map(|value| self.numbers.push(LookNumber::new(schema, place, value)))
            }
            _ => Err(place.mistake(unexpected(&phrase(schema), place.value))),
        }
    }

    fn alternatives(
        &mut self,
        schema: &'s Value,
        alternatives: &'s [Value],
        place: &Place<'_, '_>,
    ) -> Checked {
        let fitting: Vec<&Value> =
            alternatives.iter().map(|a| target(a, self.schema)).filter(|a| fits(a, place.value)).collect();
        let Some(&first) = fitting.first() else {
            let expected = schema.get("title").and_then(Value::as_str);
            let expected = expected.map_or_else(|| self.phrases(alternatives), str::to_owned);
            return Err(place.mistake(unexpected(&expected, place.value)));
        };
        match place.value {
            DeValue::Table(table) => match fitting.iter().find_map(|a| discriminator(a)) {
                Some(tag) => self.tagged(&fitting, tag, table, place),
                None => self.value(first, place),
            },
            DeValue::String(text) if fitting.iter().all(|a| constants(a).is_some()) => {
                let allowed: Vec<&str> = fitting.iter().filter_map(|a| constants(a)).flatten().collect();
                one_of(text, &allowed, place)
            }
            _ => self.value(first, place),
        }
    }

    fn phrases(&self, alternatives: &'s [Value]) -> String {
        let phrases: Vec<String> = alternatives.iter().map(|a| phrase(target(a, self.schema))).collect();
        phrases.join(" or ")
    }

    /// A table whose key `tag` says of which kind it is.
    fn tagged(
        &mut self,
        kinds: &[&'s Value],
        tag: &str,
        table: &DeTable<'_>,
        place: &Place<'_, '_>,
    ) -> Checked {
        let Some((name, value)) = table.get_key_value(tag) else {
            return Err(place.mistake(problem::missing_key(tag)));
        };
        let at = place.member(name, value);
        let DeValue::String(kind) = at.value else {
            return Err(at.mistake(unexpected("a text", at.value)));
        };
        let name_of = |schema: &'s Value| schema.get("properties")?.get(tag)?.get("const")?.as_str();
        match kinds.iter().find(|schema| name_of(schema) == Some(kind)) {
            Some(schema) => self.table(schema, table, place),
            None => {
                let allowed: Vec<&str> = kinds.iter().filter_map(|schema| name_of(schema)).collect();
                one_of(kind, &allowed, &at)
            }
        }
    }

    fn table(&mut self, schema: &'s Value, table: &DeTable<'_>, place: &Place<'_, '_>) -> Checked {
        let properties = schema.get("properties").and_then(Value::as_object);
        let free = schema.get("additionalProperties").filter(|s| s.is_object());
        for (name, value) in table.iter() {
            let at = place.member(name, value);
            match (properties.and_then(|p| p.get(name.get_ref().as_ref())), free) {
                (Some(property), _) => self.value(property, &at)?,
                (None, Some(free)) => {
                    let text: &str = name.get_ref();
                    // Names within an object are the model's.
                    let is_own_name = place.key.depth() == 1;
                    if is_own_name && (text.is_empty() || text.starts_with('#') || text.contains('.')) {
                        return Err(Mistake { span: name.span(), ..at.mistake(Error::malformed(BAD_NAME)) });
                    }
                    self.value(free, &at)?;
                }
                (None, None) => {
                    let allowed: Vec<&str> =
                        properties.into_iter().flat_map(|p| p.keys().map(String::as_str)).collect();
                    let problem = problem::unknown_key(name.get_ref(), &allowed);
                    return Err(Mistake { key: place.key.clone(), span: name.span(), problem });
                }
            }
        }
        let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
        match required.filter_map(Value::as_str).find(|name| table.get(*name).is_none()) {
            Some(missing) => Err(place.mistake(problem::missing_key(missing))),
            None => Ok(()),
        }
    }

    fn list(&mut self, schema: &'s Value, list: &DeArray<'_>, place: &Place<'_, '_>) -> Checked {
        let limit = |name: &str| schema.get(name).and_then(Value::as_u64).map(|n| n as usize);
        let (least, most) = (limit("minItems").unwrap_or(0), limit("maxItems"));
        if list.len() < least || most.is_some_and(|most| list.len() > most) {
            let expected = match most {
                Some(most) if most == least => entries(least),
                Some(most) => format!("{least} to {most} entries"),
                None => format!("at least {}", entries(least)),
            };
            return Err(
                place.mistake(problem::unexpected(&format!("a list of {expected}"), &entries(list.len())))
            );
        }
        let Some(items) = schema.get("items") else { return Ok(()) };
        list.iter().enumerate().try_for_each(|(index, entry)| self.value(items, &place.entry(index, entry)))
    }

    fn text(&mut self, schema: &'s Value, text: &str, place: &Place<'_, '_>) -> Checked {
        if let Some(allowed) = constants(schema) {
            return one_of(text, &allowed, place);
        }
        let kind = match schema.get("format").and_then(Value::as_str) {
            Some("color" | "color-or-texture") if text.starts_with('#') => {
                return match Color::from_hex(text) {
                    Some(_) => Ok(()),
                    None => {
                        let expected = "a colour such as \"#ff8000\" or \"#ff800080\"";
                        Err(place.mistake(problem::unexpected(expected, &format!("\"{text}\""))))
                    }
                };
            }
            Some("color") => return Err(place.mistake(unexpected(&phrase(schema), place.value))),
            Some("texture" | "color-or-texture") => ReferenceKind::Texture,
            Some("material") => ReferenceKind::Material,
            Some("object") => ReferenceKind::Object,
            Some("file") => ReferenceKind::File,
            _ => return Ok(()),
        };
        let name = if kind == ReferenceKind::Texture { split_channel(text).0 } else { text };
        let (key, span) = (place.key.clone(), place.span.clone());
        self.references.push(Reference { key, span, kind, name: name.to_owned() });
        Ok(())
    }
}

/// What a schema refers to in the definitions of the whole one; else itself.
pub(crate) fn target<'s>(schema: &'s Value, root: &'s Value) -> &'s Value {
    let name = schema.get("$ref").and_then(Value::as_str).and_then(|r| r.strip_prefix("#/$defs/"));
    name.and_then(|name| root.get("$defs")?.get(name)).unwrap_or(schema)
}

fn alternatives(schema: &Value) -> Option<&[Value]> {
    let list = schema.get("anyOf").or_else(|| schema.get("oneOf"))?;
    list.as_array().map(Vec::as_slice)
}

fn has_type(schema: &Value, name: &str) -> bool {
    match schema.get("type") {
        Some(Value::String(text)) => text == name,
        Some(Value::Array(names)) => names.iter().any(|n| n == name),
        _ => false,
    }
}

fn fits(schema: &Value, value: &DeValue<'_>) -> bool {
    if alternatives(schema).is_some_and(|a| a.iter().any(|a| fits(a, value))) {
        return true;
    }
    match value {
        DeValue::Table(_) => has_type(schema, "object"),
        DeValue::Array(_) => has_type(schema, "array"),
        DeValue::String(_) => has_type(schema, "string") || constants(schema).is_some(),
        DeValue::Boolean(_) => has_type(schema, "boolean"),
        DeValue::Integer(_) => has_type(schema, "integer") || has_type(schema, "number"),
        DeValue::Float(_) => has_type(schema, "number"),
        DeValue::Datetime(_) => false,
    }
}

fn constants(schema: &Value) -> Option<Vec<&str>> {
    if let Some(text) = schema.get("const").and_then(Value::as_str) {
        return Some(vec![text]);
    }
    schema.get("enum")?.as_array().map(|list| list.iter().filter_map(Value::as_str).collect())
}

/// The key that distinguishes tables of several kinds.
fn discriminator(schema: &Value) -> Option<&str> {
    let properties = schema.get("properties")?.as_object()?;
    properties.iter().find(|(_, property)| property.get("const").is_some()).map(|(name, _)| name.as_str())
}

fn one_of(text: &str, allowed: &[&str], place: &Place<'_, '_>) -> Checked {
    if allowed.contains(&text) {
        return Ok(());
    }
    Err(place.mistake(problem::unknown_value(text, allowed)))
}

/// Its value, where it is allowed.
fn number(schema: &Value, place: &Place<'_, '_>) -> Result<f64, Mistake> {
    let (number, text) = match place.value {
        DeValue::Integer(integer) => (integer_value(integer), integer.to_string()),
        DeValue::Float(float) => (float.as_str().parse().ok(), float.to_string()),
        _ => return Ok(0.0),
    };
    let refuse =
        |allowed: String| Err(place.mistake(problem::unexpected(&format!("a number {allowed}"), &text)));
    let Some(number) = number else {
        return refuse("of at most 64 bits (longer ones are written like 1e20)".into());
    };
    if !number.is_finite() {
        return refuse("that is finite".into());
    }
    if let Some(allowed) = violated_limit(schema, number) {
        return refuse(allowed);
    }
    if has_type(schema, "number") && number != 0.0 && !MAGNITUDES.contains(&number.abs()) {
        return refuse("between -1e30 and 1e30, and no closer to 0 than 1e-30".into());
    }
    Ok(number)
}

/// A number in a look's text.
#[derive(Clone, Debug, PartialEq)]
pub struct LookNumber {
    /// Where it stands in the look.
    pub key: Key,
    /// The bytes of the text that write it.
    pub span: Range<usize>,
    /// What it is.
    pub value: f64,
    /// The least that it may be, where that is limited; it may be excluded itself.
    pub low: Option<f64>,
    /// The most, likewise.
    pub high: Option<f64>,
    /// It has no decimals.
    pub is_whole: bool,
}

impl LookNumber {
    fn new(schema: &Value, place: &Place<'_, '_>, value: f64) -> Self {
        let limit = |names: [&str; 2]| names.into_iter().find_map(|name| schema.get(name)?.as_f64());
        Self {
            key: place.key.clone(),
            span: place.span.clone(),
            value,
            low: limit(["minimum", "exclusiveMinimum"]),
            high: limit(["maximum", "exclusiveMaximum"]),
            is_whole: !has_type(schema, "number"),
        }
    }
}

/// `None` beyond the 64 bits that TOML's whole numbers have.
fn integer_value(integer: &DeInteger<'_>) -> Option<f64> {
    i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|n| n as f64)
}

/// What a number would have to be, if it is not.
fn violated_limit(schema: &Value, number: f64) -> Option<String> {
    let limit = |name: &str| schema.get(name).and_then(Value::as_f64);
    let (low, high) = (limit("minimum"), limit("maximum"));
    let (above, below) = (limit("exclusiveMinimum"), limit("exclusiveMaximum"));
    let holds = low.is_none_or(|low| number >= low)
        && high.is_none_or(|high| number <= high)
        && above.is_none_or(|above| number > above)
        && below.is_none_or(|below| number < below);
    let is_excluded = schema.get("not").and_then(|n| n.get("const")?.as_f64()) == Some(number);
    match (low, high, above, below) {
        _ if is_excluded => Some(format!("other than {number}")),
        _ if holds => None,
        (Some(low), Some(high), ..) => Some(format!("from {low} to {high}")),
        (_, Some(high), Some(above), _) => Some(format!("above {above}, up to {high}")),
        (_, _, Some(above), Some(below)) => Some(format!("above {above} and below {below}")),
        (Some(low), ..) => Some(format!("from {low} upwards")),
        (_, _, Some(above), _) => Some(format!("above {above}")),
        (_, Some(high), ..) => Some(format!("up to {high}")),
        (_, _, _, below) => Some(format!("below {}", below.unwrap_or_default())),
    }
}

fn unexpected(expected: &str, found: &DeValue<'_>) -> Error {
    let found = match found {
        DeValue::String(text) => format!("the text \"{}\"", text.chars().take(60).collect::<String>()),
        DeValue::Integer(number) => format!("the number {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(_) => "a date or time".into(),
        DeValue::Array(list) => format!("a list of {}", list.len()),
        DeValue::Table(_) => "a table".into(),
    };
    problem::unexpected(expected, &found)
}

fn entries(count: usize) -> String {
    counted(count, "entry").to_string()
}

fn phrase(schema: &Value) -> String {
    if let Some(title) = schema.get("title").and_then(Value::as_str) {
        return title.to_owned();
    }
    if let Some(texts) = constants(schema) {
        return format!(
            "one of the texts {}",
            texts.iter().map(|t| format!("\"{t}\"")).collect::<Vec<_>>().join(", ")
        );
    }
    let name = ["array", "object", "string", "boolean", "integer", "number"]
        .into_iter()
        .find(|name| has_type(schema, name));
    match name {
        Some("array") => match (schema.get("minItems"), schema.get("maxItems")) {
            (Some(least), Some(most)) if least == most => {
                format!("a list of {}", entries(least.as_u64().unwrap_or(0) as usize))
            }
            _ => "a list".into(),
        },
        Some("object") => "a table".into(),
        Some("string") => "a text".into(),
        Some("boolean") => "true or false".into(),
        Some("integer") => "a whole number".into(),
        _ => "a number".into(),
    }
}

// The JSON schema of a look.

/// The JSON schema (draft 2020-12) of a look, made from the types that hold it. Keys that may be left out have their default
/// beside them.
pub fn look_schema() -> &'static Value {
    static SCHEMA: LazyLock<Value> = LazyLock::new(|| {
        let settings = SchemaSettings::draft2020_12().with_transform(RecursiveTransform(without_null));
        settings.into_generator().into_root_schema_for::<Look>().to_value()
    });
    &SCHEMA
}

/// TOML knows no null: a key that may be left out is left out.
fn without_null(schema: &mut Schema) {
    let Some(object) = schema.as_object_mut() else { return };
    if object.get("default").is_some_and(Value::is_null) {
        object.remove("default");
    }
    if let Some(default) = object.get_mut("default") {
        shorten(default);
    }
    if object.get("format").is_some_and(is_number_format) {
        let format = object.remove("format");
        if format.is_some_and(|f| f == "uint32") {
            object.entry("maximum").or_insert(Value::from(u32::MAX));
        }
    }
    if let Some(Value::Array(types)) = object.get_mut("type") {
        types.retain(|t| t != "null");
        if let [only] = types.as_slice() {
            let only = only.clone();
            object.insert("type".into(), only);
        }
    }
    if let Some(Value::Array(alternatives)) = object.get_mut("anyOf") {
        alternatives.retain(|a| a.get("type").is_none_or(|t| t != "null"));
        if let [Value::Object(only)] = alternatives.as_slice() {
            let only = only.clone();
            object.remove("anyOf");
            object.extend(only);
        }
    }
}

/// Formats such as `double`, which are Rust's, not the user's.
fn is_number_format(format: &Value) -> bool {
    format
        .as_str()
        .is_some_and(|f| f.starts_with("uint") || f.starts_with("int") || matches!(f, "float" | "double"))
}
