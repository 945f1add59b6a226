//! Entries of the gallery that change keys of their looks.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::path::Path;

use fantex_base::Result;
use fantex_gallery::{Catalogue, Variant, rows};

fn changed(look: &str, set: &str) -> Result<toml::Table> {
    let variant = Variant { set: toml::from_str(set).unwrap(), ..Variant::default() };
    variant.apply("test", toml::from_str(look).unwrap())
}

#[test]
fn values_are_changed_by_path() {
    let look = "[a]\nb = 1\n[[light]]\nkind = 'sun'\n";
    let table = changed(look, "'a.b' = 2\n'light.0.strength' = 3\n'c.d' = 4\n").unwrap();
    let expected = "[a]\nb = 2\n[[light]]\nkind = 'sun'\nstrength = 3\n[c]\nd = 4\n";
    assert_eq!(table, toml::from_str::<toml::Table>(expected).unwrap());
}

#[test]
fn paths_that_lead_nowhere_are_refused() {
    for set in ["'light.1.strength' = 3", "'a.b.c' = 1", "'light.x' = 1"] {
        let refused = changed("[a]\nb = 1\n[[light]]\nkind = 'sun'\n", set);
        assert!(refused.unwrap_err().to_string().contains("no such table or list"), "{set}");
    }
}

#[test]
fn every_row_of_the_feature_list_has_pictures() {
    let catalogue = Catalogue::read(Path::new(env!("CARGO_MANIFEST_DIR"))).unwrap();
    let is_shown = |row: &String| catalogue.entries.iter().any(|entry| entry.rows.contains(row));
    let missing: Vec<String> = rows().filter(|row| !is_shown(row)).collect();
    assert!(missing.is_empty(), "no entry shows {missing:?}");
    for entry in &catalogue.entries {
        let has_files = entry.pictures.iter().all(|picture| picture.file.is_some());
        let is_made = match (&entry.look, &entry.drawn_by) {
            (None, None) => !entry.commands.is_empty() && !entry.pictures.is_empty() && has_files,
            (None, Some(_)) => !entry.commands.is_empty(),
            (look, drawn_by) => look.is_some() && drawn_by.is_none(),
        };
        assert!(
            is_made,
            "{}: a look, a drawing with commands to try, or commands that write files",
            entry.name
        );
    }
}
