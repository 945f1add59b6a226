//! What `--json` prints is what `docs/cli.md` says.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::workspace;

/// Compares the keys that a command printed with those of its section of the page.
pub(crate) fn check_keys(words: &[&str], printed: &Value) {
    let Some(sections) = sections_of(words) else { return };
    let arguments = words.join(" ");
    let printed: BTreeSet<&str> = printed.as_object().unwrap().keys().map(String::as_str).collect();
    let mut documented = BTreeMap::new();
    sections.iter().for_each(|section| documented.append(&mut keys_of(section)));
    for key in &printed {
        assert!(
            documented.contains_key(*key),
            "docs/cli.md, {sections:?}, lacks '{key}' of 'fantex {arguments}'"
        );
    }
    for (key, is_always) in documented {
        let is_there = printed.contains(&*key);
        assert!(
            is_there || !is_always,
            "'fantex {arguments}' does not print '{key}': docs/cli.md, {sections:?}"
        );
    }
}

/// The headings under which a command's keys stand; none for what has no table.
fn sections_of(words: &[&str]) -> Option<Vec<String>> {
    let has = |flag: &str| words.contains(&flag);
    let writes = |extension: &str| words.iter().any(|word| word.ends_with(extension));
    let titles = |titles: &[&str]| titles.iter().map(|title| format!("`{title}`")).collect();
    let sections: Vec<String> = match words[0] {
        option if option.starts_with('-') => return None,
        "bench" if words[1] != "fidelity" => return None,
        "info" if has("--look") => return None,
        "bake" if words[2..].iter().any(|word| word.ends_with(".glb") || word.ends_with(".gltf")) => {
            vec!["`bake` of a model".to_owned()]
        }
        "info" => vec![format!("`info` of {}", kind_of(words[1]))],
        "verify" if kind_of(words[1]) == "a world" => vec!["`verify` of a world".to_owned()],
        "world" => vec!["`world`".to_owned(), "`info` of a world".to_owned()],
        "generate" if writes(".fan") => titles(&["generate landscape", "bake"]),
        "generate" | "bench" => titles(&[&words[..2].join(" ")]),
        "export" if has("--turntable") => titles(&["export --turntable"]),
        "export" if has("--web") => titles(&["export --web"]),
        "paint" if has("--export-log") => titles(&["paint --export-log"]),
        command => titles(&[command]),
    };
    Some(sections)
}

fn kind_of(file: &str) -> &str {
    match file.rsplit_once('.') {
        Some((_, "fan")) => "an asset",
        Some((_, "fanworld")) => "a world",
        Some((_, "toml")) => "a look",
        _ => "a model",
    }
}

/// The keys of a section, and whether they are always there.
fn keys_of(section: &str) -> BTreeMap<String, bool> {
    let page = std::fs::read_to_string(workspace().join("docs/cli.md")).unwrap();
    let (_, body) =
        page.split_once(&format!("\n### {section}\n")).unwrap_or_else(|| panic!("no section {section}"));
    let body = body.split("\n### ").next().unwrap();
    let rows = body.lines().filter(|line| line.starts_with("| `"));
    let mut keys = BTreeMap::new();
    for row in rows {
        let [key, what] = [1, 2].map(|cell| row.split('|').nth(cell).unwrap().trim());
        let is_always = !what.starts_with("of ") && !what.starts_with("not of ");
        keys.extend(key.split('`').skip(1).step_by(2).map(|key| (key.to_owned(), is_always)));
    }
    keys
}

#[test]
fn every_command_is_on_the_page() {
    let page = std::fs::read_to_string(workspace().join("docs/cli.md")).unwrap();
    let help = crate::run(&[&"--help"]).stdout;
    let help = String::from_utf8(help).unwrap();
    let (_, commands) = help.split_once("Commands:\n").unwrap();
    let commands = commands.split("\n\n").next().unwrap().lines();
    let names = commands
        .filter_map(|line| line.strip_prefix("  ")?.split(' ').next().filter(|name| !name.is_empty()));
    let mut count = 0;
    for name in names.filter(|name| *name != "help") {
        assert!(page.contains(&format!("`{name}`")), "docs/cli.md does not mention {name}");
        count += 1;
    }
    assert!(count > 20, "{count} commands: {help}");
}
