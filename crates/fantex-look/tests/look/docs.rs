//! The reference page and the schema say what the code does.

use std::fs;
use std::path::{Path, PathBuf};

use fantex_look::reference::fill_reference;
use fantex_look::{LookFile, look_schema};

fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name)
}

fn page() -> String {
    fs::read_to_string(docs("look.md")).unwrap()
}

#[test]
fn the_schema_is_current() {
    let committed = fs::read_to_string(docs("look.schema.json")).unwrap();
    let current = serde_json::to_string_pretty(look_schema()).unwrap() + "\n";
    assert!(committed == current, "docs/look.schema.json is out of date: run cargo xtask schema");
}

#[test]
fn the_tables_of_the_page_are_current() {
    let page = page();
    assert!(fill_reference(&page).unwrap() == page, "docs/look.md is out of date: run cargo xtask schema");
}

#[test]
fn marks_that_name_nothing_are_refused() {
    let refused = |page: &str, words: &str| assert!(fill_reference(page).unwrap_err().contains(words));
    refused("<!-- keys: Nothing -->\n<!-- end -->", "no table 'Nothing'");
    refused("<!-- keys: TextureTable nothing -->\n<!-- end -->", "no table 'TextureTable nothing'");
    refused("<!-- keys: Place -->\n", "'Place' has no end");
}

#[test]
fn words_are_explained_where_they_are_met_first() {
    let page =
        fill_reference("<!-- keys: Place -->\n<!-- end -->\n<!-- keys: Place -->\n<!-- end -->").unwrap();
    assert_eq!(page.matches("- `unit = \"world\"`: The world's unit.\n").count(), 1, "{page}");
    assert_eq!(page.matches("| `unit` |").count(), 2, "{page}");
}

#[test]
fn every_table_of_the_schema_is_on_the_page() {
    let page = page();
    let definitions = look_schema()["$defs"].as_object().unwrap();
    for (name, schema) in definitions {
        let has_keys = schema["properties"].as_object().is_some_and(|keys| !keys.is_empty());
        let is_covered = page.contains(&format!("<!-- keys: {name} -->"));
        assert!(!has_keys || is_covered, "docs/look.md has no table of {name}");
    }
}

#[test]
fn every_kind_is_shown_on_the_page() {
    let page = page();
    for (name, tag) in [("TextureTable", "kind"), ("LightTable", "kind"), ("CoordinatesKind", "from")] {
        let kinds = look_schema()["$defs"][name]["oneOf"].as_array().unwrap();
        for kind in kinds {
            let text = kind["properties"][tag]["const"].as_str().unwrap();
            assert!(
                page.contains(&format!("\"{text}\"")),
                "docs/look.md has no example of {tag} = \"{text}\""
            );
        }
    }
}

#[test]
fn every_example_is_a_look() {
    let page = page();
    let mut count = 0;
    for (index, block) in page.split("```toml\n").skip(1).enumerate() {
        let text = block.split("```").next().unwrap();
        // Examples that show a part name textures and materials of others.
        let text = format!("{text}\n{}", missing_names(text));
        let result = LookFile::parse(&text, Path::new("look.md"));
        assert!(result.is_ok(), "example {}: {}\n{text}", index + 1, result.unwrap_err());
        count += 1;
    }
    assert!(count > 30, "{count} examples");
}

/// The object of the first step, the material of the second, and the scene of the third.
#[test]
fn the_steps_of_the_page_make_one_look() {
    let page = page();
    let (_, section) = page.split_once("## Step by step").unwrap();
    let steps: Vec<&str> =
        section.split("```toml\n").skip(1).take(3).map(|block| block.split("```").next().unwrap()).collect();
    let object = steps[0].split("[materials.copper]").next().unwrap();
    for text in
        [steps[0].to_owned(), format!("{object}{}", steps[1]), format!("{object}{}{}", steps[1], steps[2])]
    {
        let result = LookFile::parse(&text, Path::new("copper.toml"));
        assert!(result.is_ok(), "{}\n{text}", result.unwrap_err());
    }
}

/// Definitions of the names that an example uses and leaves to the reader.
fn missing_names(text: &str) -> String {
    let mut added = String::new();
    loop {
        let all = format!("{text}\n{added}");
        let Err(error) = LookFile::parse(&all, Path::new("look.md")) else { return added };
        let message = error.to_string();
        let name = |what: &str| {
            let (_, rest) = message.split_once(&format!("there is no {what} '"))?;
            Some(rest.split_once('\'')?.0.to_owned())
        };
        if let Some(name) = name("texture") {
            added.push_str(&format!("[textures.{name}]\nkind = \"wood\"\n"));
        } else if let Some(name) = name("material") {
            added.push_str(&format!("[materials.{name}]\n"));
        } else {
            return added;
        }
    }
}
