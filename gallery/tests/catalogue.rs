//! Entries of the gallery that change keys of their looks.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use fantex_base::Result;
use fantex_gallery::Variant;

fn changed(look: &str, set: &str) -> Result<toml::Table> {
    let variant = Variant { caption: String::new(), set: toml::from_str(set).unwrap() };
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
