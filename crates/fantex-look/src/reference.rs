//! The tables of keys in the reference page.
//!
//! The page is written by hand, except for what stands between `<!-- keys: NAME -->` and `<!-- end -->`: a table of the keys of
//! the schema's `$defs/NAME` (of the whole look, for `Look`; of a kind of `$defs/NAME`, for `NAME KIND`), made from the schema. Where a key takes
//! one of several words, what they mean stands below the first table that has the choice.

use std::collections::BTreeSet;
use std::fmt::Write;

use serde_json::{Map, Value};

use crate::look_schema;

const START: &str = "<!-- keys: ";
const START_END: &str = " -->";
const END: &str = "<!-- end -->";

/// Start of a reference in the schema.
const DEFINITIONS: &str = "#/$defs/";

/// The page with all tables of keys made anew.
///
/// # Errors
/// Says which mark is not closed, or names nothing in the schema.
pub fn fill_reference(page: &str) -> Result<String, String> {
    let mut filled = String::with_capacity(page.len());
    let mut explained = BTreeSet::new();
    let mut rest = page;
    while let Some((before, name, after)) = next_mark(rest) {
        let table = table_of(name).ok_or_else(|| format!("the schema has no table '{name}'"))?;
        let end = after.find(END).ok_or_else(|| format!("the mark of '{name}' has no end"))?;
        let keys = key_table(table);
        let words = words_of(table, &mut explained);
        let _written = write!(filled, "{before}{START}{name}{START_END}\n{keys}{words}");
        rest = &after[end..];
    }
    filled.push_str(rest);
    Ok(filled)
}

/// What stands before the next mark, its name, and what stands after its line.
fn next_mark(text: &str) -> Option<(&str, &str, &str)> {
    let start = text.find(START)?;
    let inner = &text[start + START.len()..];
    let end = inner.find(START_END)?;
    let after = &inner[end + START_END.len()..];
    Some((&text[..start], &inner[..end], after.strip_prefix('\n').unwrap_or(after)))
}

fn kind_of(table: &Value) -> Option<&str> {
    table.get("properties")?.as_object()?.values().find_map(|property| property.get("const")?.as_str())
}

/// The table that a mark names.
fn table_of(name: &str) -> Option<&'static Value> {
    let schema = look_schema();
    match name.split_once(' ') {
        None if name == "Look" => Some(schema),
        None => definition(name),
        Some((name, kind)) => {
            let kinds = definition(name)?.get("oneOf")?.as_array()?;
            kinds.iter().find(|table| kind_of(table) == Some(kind))
        }
    }
}

fn definition(name: &str) -> Option<&'static Value> {
    look_schema().get("$defs")?.get(name)
}

/// The keys of a table, without the one that tells its kind.
fn keys_of(table: &Value) -> impl Iterator<Item = (&String, &Value)> {
    let keys = table.get("properties").and_then(Value::as_object).into_iter().flatten();
    keys.filter(|(_, property)| property.get("const").is_none())
}

/// What the words mean that keys of a table take, as Markdown: of the choices that are not explained yet.
fn words_of(table: &Value, explained: &mut BTreeSet<String>) -> String {
    let mut text = String::new();
    for (key, property) in keys_of(table) {
        let reference = property.get("$ref").or_else(|| property.get("items")?.get("$ref"));
        let Some(name) = reference.and_then(Value::as_str).and_then(|r| r.strip_prefix(DEFINITIONS)) else {
            continue;
        };
        let choices = definition(name).and_then(|target| target.get("oneOf")?.as_array());
        let word = |choice: &Value| {
            let text = |key: &str| choice.get(key)?.as_str().map(|text| text.replace('\n', " "));
            Some(format!("- `{key} = \"{}\"`: {}\n", text("const")?, text("description")?))
        };
        let words: String = choices.into_iter().flatten().filter_map(word).collect();
        if !words.is_empty() && explained.insert(name.to_owned()) {
            text.push('\n');
            text.push_str(&words);
        }
    }
    text
}

/// The keys of a table as Markdown.
fn key_table(table: &Value) -> String {
    let schema = look_schema();
    let required = table.get("required").and_then(Value::as_array);
    let mut text = String::from("| key | value | default | what |\n|---|---|---|---|\n");
    for (key, property) in keys_of(table) {
        let is_required = required.is_some_and(|r| r.iter().any(|name| name == key));
        let default = match (is_required, property.get("default")) {
            (true, _) => "needed".to_owned(),
            (false, Some(default)) if !is_table(default) => format!("`{}`", toml_text(default)),
            (false, _) => String::new(),
        };
        let what = property.get("description").and_then(Value::as_str).unwrap_or_default();
        let value = value_text(property, schema);
        let _written = writeln!(
            text,
            "| `{key}` | {value} | {default} | {} |",
            what.replace('\n', " ").replace('|', "\\|")
        );
    }
    text
}

fn is_table(value: &Value) -> bool {
    value.as_object().is_some_and(|o| !o.contains_key("from")) || value.as_array().is_some_and(Vec::is_empty)
}

/// A default as it is written in a look.
fn toml_text(value: &Value) -> String {
    match value {
        Value::Object(members) => match members.get("from") {
            Some(from) if from == "uv" => "\"uv\"".to_owned(),
            _ => toml_table(members),
        },
        Value::Array(list) => format!("[{}]", list.iter().map(toml_text).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

fn toml_table(members: &Map<String, Value>) -> String {
    let members = members.iter().map(|(name, value)| format!("{name} = {}", toml_text(value)));
    format!("{{ {} }}", members.collect::<Vec<_>>().join(", "))
}

/// What a key's value may be.
fn value_text(property: &Value, root: &Value) -> String {
    let reference = property.get("$ref").and_then(Value::as_str).and_then(|r| r.strip_prefix(DEFINITIONS));
    if let Some(name) = reference {
        return referenced_text(name, root);
    }
    if let Some(title) = property.get("title").and_then(Value::as_str) {
        return title.to_owned();
    }
    match property.get("type").and_then(Value::as_str) {
        Some("array") => {
            let items = property.get("items").map_or_else(String::new, |items| value_text(items, root));
            match (property.get("minItems"), property.get("maxItems")) {
                (Some(least), Some(most)) if least == most => format!("{least} of: {items}"),
                _ => format!("list of: {items}"),
            }
        }
        Some("number") => format!("number{}", range_text(property)),
        Some("integer") => format!("whole number{}", range_text(property)),
        Some("boolean") => "`true`, `false`".to_owned(),
        Some("string") => "text".to_owned(),
        _ => match property.get("additionalProperties") {
            Some(inner) if inner.is_object() => format!("tables by name: {}", value_text(inner, root)),
            _ => "table".to_owned(),
        },
    }
}

/// A type of the schema: texts are listed, tables are named.
fn referenced_text(name: &str, root: &Value) -> String {
    let Some(target) = root.get("$defs").and_then(|defs| defs.get(name)) else { return name.to_owned() };
    if let Some(title) = target.get("title").and_then(Value::as_str) {
        return title.to_owned();
    }
    let texts: Vec<String> = texts_of(target).iter().map(|text| format!("`\"{text}\"`")).collect();
    match target.get("properties").or_else(|| target.get("oneOf")) {
        _ if !texts.is_empty() => texts.join(", "),
        Some(_) => format!("table, see {}", spaced(name)),
        None => value_text(target, root),
    }
}

/// The fixed texts of a choice.
fn texts_of(schema: &Value) -> Vec<&str> {
    let alternatives = schema.get("oneOf").and_then(Value::as_array).into_iter().flatten();
    let constants = alternatives.filter_map(|a| a.get("const")?.as_str());
    let listed = schema.get("enum").and_then(Value::as_array).into_iter().flatten();
    constants.chain(listed.filter_map(Value::as_str)).collect()
}

/// `NormalMapTable` as `normal map`.
fn spaced(name: &str) -> String {
    let mut words = String::new();
    for c in name.trim_end_matches("Table").chars() {
        if c.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(c.to_lowercase());
    }
    words
}

fn range_text(schema: &Value) -> String {
    let limit = |name: &str| schema.get(name).filter(|v| v.is_number()).map(ToString::to_string);
    let low = limit("minimum").map(|n| format!("from {n}"));
    let above = limit("exclusiveMinimum").map(|n| format!("above {n}"));
    // The largest number that 32 bits hold is no limit that a reader cares for.
    let high = limit("maximum").filter(|n| *n != u32::MAX.to_string()).map(|n| format!("to {n}"));
    let below = limit("exclusiveMaximum").map(|n| format!("below {n}"));
    let parts: Vec<String> = [low, above, high, below].into_iter().flatten().collect();
    if parts.is_empty() { String::new() } else { format!(" {}", parts.join(" ")) }
}
