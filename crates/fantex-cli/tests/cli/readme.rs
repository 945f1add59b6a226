//! What the README shows of commands is what they print.

use std::path::Path;

use crate::{fantex, stderr, workspace};

/// A command, and the lines below it.
type Shown = (String, Vec<String>);

#[test]
fn commands_print_what_the_readme_shows() {
    let folder = tempfile::tempdir().unwrap();
    for file in workspace().join("assets/WaterBottle").read_dir().unwrap() {
        let file = file.unwrap();
        std::fs::copy(file.path(), folder.path().join(file.file_name())).unwrap();
    }
    let commands = consoles(&std::fs::read_to_string(workspace().join("README.md")).unwrap());
    assert!(commands.len() > 2, "{commands:?}");
    for shown in commands {
        check(folder.path(), &shown);
    }
}

/// The blocks of Markdown that are marked as a console, each with one command.
fn consoles(page: &str) -> Vec<Shown> {
    let blocks = page.split("```console\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let shown = |block: &str| {
        let mut lines = block.lines();
        let command = lines.next().and_then(|line| line.strip_prefix("$ fantex ")).expect("a command");
        (command.to_owned(), lines.map(str::to_owned).collect())
    };
    blocks.map(shown).collect()
}

/// Runs a command. Lines that are shown come in this order; notes may come between them.
fn check(folder: &Path, (command, shown): &Shown) {
    let output = fantex().args(command.split(' ')).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{command}: {}", stderr(&output));
    let printed = stderr(&output) + &String::from_utf8_lossy(&output.stdout);
    let mut lines = printed.lines();
    for line in shown {
        assert!(lines.any(|other| same(line, other)), "fantex {command}: README shows {line}\n{printed}");
    }
}

/// Whether two lines are the same but for times, and for what block encoders of other processors change in decimals.
fn same(shown: &str, printed: &str) -> bool {
    let [a, b] = [shown, printed].map(words);
    let decimals = |word: &str| word.contains('.').then(|| word.parse::<f64>().ok()).flatten();
    let is_alike = |k: usize| match (decimals(&a[k]), decimals(&b[k])) {
        (Some(x), Some(y)) => a.get(k + 1).is_some_and(|unit| unit == "s") || (x - y).abs() <= 0.05,
        _ => a[k] == b[k],
    };
    a.len() == b.len() && (0..a.len()).all(is_alike)
}

/// The words of a line, numbers in groups of three digits as one.
fn words(line: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut follows = false;
    for word in line.split(' ') {
        let is_number = !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit());
        match words.last_mut() {
            Some(last) if follows && is_number && word.len() == 3 => last.push_str(word),
            _ if word.is_empty() => {}
            _ => words.push(word.to_owned()),
        }
        follows = is_number;
    }
    words
}
