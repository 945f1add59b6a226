//! Documents as JSON values and back: the types of a look are read from and written to these only.

use serde_json::{Map, Number, Value};
use toml::de::{DeInteger, DeTable, DeValue};

/// A document without its spans. Dates become their text.
pub(super) fn json_of_table(table: &DeTable<'_>) -> Value {
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
pub(super) fn toml_of(value: &Value) -> Option<toml::Value> {
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
pub(super) fn without_defaults(value: &mut Value, schema: &Value, root: &Value) {
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

fn target<'s>(schema: &'s Value, root: &'s Value) -> &'s Value {
    let name = schema.get("$ref").and_then(Value::as_str).and_then(|r| r.strip_prefix("#/$defs/"));
    name.and_then(|name| root.get("$defs")?.get(name)).unwrap_or(schema)
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
