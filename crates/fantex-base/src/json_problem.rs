//! What is wrong with a JSON file, in words. What reads it is derived, and speaks of fields, structures and types of the program.

use serde_json::Value;
use serde_json::error::Category;

use crate::{Error, Place};

/// The problem of a text with its place: `line 3, column 12: the key 'asset' is missing`.
pub fn json_problem(text: &[u8], error: &serde_json::Error) -> Error {
    let (line, column) = (error.line(), error.column());
    let said = error.to_string();
    let said = said.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&said);
    let words = match error.classify() {
        Category::Eof => "the file ends too early".to_owned(),
        // Of a choice nothing else is said where a number, a list or empty braces stand in its place.
        Category::Syntax if said == "expected value" && is_json(text) => CHOICE.to_owned(),
        Category::Syntax => of_syntax(said).to_owned(),
        Category::Data | Category::Io => of_data(said).unwrap_or_else(|| said.to_owned()),
    };
    Error::malformed(format!("line {line}, column {column}: {words}")).with_place(Place::Line(line as u64))
}

const CHOICE: &str =
    "something else belongs here: a word in quotation marks, or one key with its value in braces";

fn is_json(text: &[u8]) -> bool {
    serde_json::from_slice::<Value>(text).is_ok()
}

fn of_syntax(said: &str) -> &'static str {
    match said {
        "expected `:`" => "a key is followed by ':'",
        "expected `,` or `]`" => "expected ',' or ']'",
        "expected `,` or `}`" => "expected ',' or '}'",
        "expected `\"`" | "key must be a string" => "expected a key in quotation marks",
        "trailing comma" => "nothing follows this comma",
        "trailing characters" => "there is more than belongs here",
        "number out of range" => "this number is too large",
        "recursion limit exceeded" => "too much is nested here",
        _ => "this is no JSON",
    }
}

/// None for what is not known.
fn of_data(said: &str) -> Option<String> {
    let name = |quoted: &str| quoted.trim_matches('`').to_owned();
    if let Some(key) = said.strip_prefix("missing field ") {
        return Some(format!("the key '{}' is missing", name(key)));
    }
    if let Some(key) = said.strip_prefix("duplicate field ") {
        return Some(format!("the key '{}' is there twice", name(key)));
    }
    if let Some(rest) = said.strip_prefix("unknown field ") {
        let (key, allowed) = rest.rsplit_once(", expected ")?;
        let allowed: Vec<&str> = allowed.split('`').skip(1).step_by(2).collect();
        return Some(format!("there is no key '{}' here; allowed are {}", name(key), allowed.join(", ")));
    }
    if let Some(rest) = said.strip_prefix("unknown variant ") {
        let (word, allowed) = rest.rsplit_once(", expected ")?;
        let allowed: Vec<&str> = allowed.split('`').skip(1).step_by(2).collect();
        return Some(format!(
            "'{}' is nothing that is known here; allowed are {}",
            name(word),
            allowed.join(", ")
        ));
    }
    let (found, expected) = said.strip_prefix("invalid ")?.rsplit_once(", expected ")?;
    Some(match (found, expected) {
        ("type: unit variant", _) => "this word needs a value: write it as a key in braces".to_owned(),
        (_, "unit") => "this word has no value: write it alone, in quotation marks".to_owned(),
        _ => {
            // What is of the right type is negative, or too large.
            let is_large = found.starts_with("value: integer ") && !found.contains('-');
            // A list that is too short is read key by key.
            let is_list = expected.starts_with("struct ") && found.starts_with("length ");
            let found = if is_list { "a list" } else { found_in_words(found) };
            format!("expected {}, found {found}", expected_in_words(expected, is_large))
        }
    })
}

/// Of what is said as `type: string "a"`, ``value: integer `-1` `` or `length 2`.
fn found_in_words(found: &str) -> &str {
    if let Some(count) = found.strip_prefix("length ") {
        return count;
    }
    match found.split_once(": ").map_or(found, |(_, found)| found) {
        "map" => KEYS,
        "sequence" => "a list",
        text if text.starts_with("string ") => "a text",
        // Numbers and truth values are quoted.
        other => other.split('`').nth(1).unwrap_or(other),
    }
}

/// What is written in braces.
const KEYS: &str = "keys and values in braces";

fn expected_in_words(expected: &str, is_large: bool) -> &str {
    match expected {
        "u8" if is_large => "a whole number up to 255",
        "u16" if is_large => "a whole number up to 65535",
        "u32" if is_large => "a whole number up to 4294967295",
        "u64" | "u32" | "u16" | "u8" | "usize" => "a whole number from 0",
        "f64" | "f32" => "a number",
        "a boolean" => "true or false",
        "a string" | "path string" => "a text",
        "a sequence" => "a list",
        "a map" => KEYS,
        "an array of length 2" => "two numbers",
        "an array of length 3" => "three numbers",
        expected if expected.starts_with("struct ") => KEYS,
        expected if expected.starts_with("tuple ") => match expected.rsplit_once(" with ") {
            Some((_, "2 elements")) => "a list of two",
            _ => "a list",
        },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "nothing is read from it")]
    struct Part {
        name: String,
        corner: [f64; 3],
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    #[expect(dead_code, reason = "nothing is read from it")]
    enum Side {
        Left,
        Right,
        Above(f64),
        Between(f64, f64),
        Part { corner: [f64; 3] },
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "nothing is read from it")]
    struct Whole {
        version: u32,
        side: Option<Side>,
        parts: Vec<Part>,
        part: Option<Part>,
        level: Option<u8>,
        index: Option<usize>,
        pair: Option<[f32; 2]>,
        is_open: Option<bool>,
        file: Option<PathBuf>,
    }

    #[test]
    fn problems_are_said_in_words_with_their_place() {
        for (text, expected) in [
            ("", "line 1, column 0: the file ends too early"),
            ("{\"version\": 1,\n", "line 2, column 0: the file ends too early"),
            ("{\"version\": 1}", "line 1, column 14: the key 'parts' is missing"),
            ("{\"version\": 1, \"version\": 1}", ": the key 'version' is there twice"),
            ("{\"versoin\": 1}", ": there is no key 'versoin' here; allowed are version, side, parts, part"),
            ("{\"side\": \"up\"}", ": 'up' is nothing that is known here; allowed are left, right"),
            ("newmtl red", "line 1, column 2: this is no JSON"),
            ("{\"version\": -1}", ": expected a whole number from 0, found -1"),
            ("{\"version\": \"1\"}", ": expected a whole number from 0, found a text"),
            ("{\"version\": 5000000000}", ": expected a whole number up to 4294967295, found 5000000000"),
            ("{\"level\": 256}", ": expected a whole number up to 255, found 256"),
            ("{\"index\": -1}", ": expected a whole number from 0, found -1"),
            ("{\"index\": 1.5}", ": expected a whole number from 0, found 1.5"),
            ("{\"pair\": [1]}", ": expected two numbers, found 1"),
            ("{\"is_open\": 1}", ": expected true or false, found 1"),
            ("{\"file\": 1}", ": expected a text, found 1"),
            ("{\"side\": \"above\"}", ": this word needs a value: write it as a key in braces"),
            ("{\"side\": \"between\"}", ": this word needs a value: write it as a key in braces"),
            ("{\"side\": \"part\"}", ": this word needs a value: write it as a key in braces"),
            ("{\"side\": {\"left\": 1}}", ": this word has no value: write it alone, in quotation marks"),
            ("{\"side\": {\"between\": 1}}", ": expected a list, found 1"),
            ("{\"side\": {\"between\": [1]}}", ": expected a list of two, found 1"),
            ("{\"side\": {\"part\": 1}}", ": expected keys and values in braces, found 1"),
            ("{\"version\": 1, \"parts\": {}}", ": expected a list, found keys and values in braces"),
            ("{\"version\": 1, \"parts\": [7]}", ": expected keys and values in braces, found 7"),
            ("{\"version\": 1, \"part\": []}", ": expected keys and values in braces, found a list"),
            ("{\"part\": {\"name\": null}}", ": expected a text, found null"),
            ("{\"part\": {\"corner\": [0, 0]}}", ": expected three numbers, found 2"),
            ("{\"part\": {\"corner\": [0, 0, true]}}", ": expected a number, found true"),
            ("{\"part\": {\"corner\": [0, 0, 0, 0]}}", ": there is more than belongs here"),
            ("{\"version\" 1}", ": a key is followed by ':'"),
            ("{\"version\": 1 \"parts\": []}", ": expected ',' or '}'"),
            ("{version: 1}", ": expected a key in quotation marks"),
            ("\u{1}", ": this is no JSON"),
            ("{\"side\": 7}", ": something else belongs here: a word in quotation marks, or one key"),
            ("{\"side\": [0]}", ": something else belongs here: a word in quotation marks, or one key"),
            ("{\"side\": {}}", ": something else belongs here: a word in quotation marks, or one key"),
        ] {
            let error = json_problem(text.as_bytes(), &serde_json::from_str::<Whole>(text).unwrap_err());
            let sentence = error.to_string();
            assert!(sentence.contains(expected), "{text:?}: {sentence}");
            let is_ours =
                ["field", "struct", "u32", "f64", "usize", "sequence", "variant", "tuple", "array", "`"]
                    .iter()
                    .all(|word| !sentence.contains(word));
            assert!(is_ours && matches!(error.place(), Some(Place::Line(_))), "{text:?}: {sentence}");
        }
    }
}
