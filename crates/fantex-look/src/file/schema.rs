//! The JSON schema of a look.

use std::sync::LazyLock;

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use serde_json::Value;

use crate::data::Look;

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
