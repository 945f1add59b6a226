//! What the gallery shows: `gallery.toml`, one entry for each technique, each made by a look beside it.

use std::path::Path;

use fantex_base::{Error, Result};
use serde::Deserialize;

/// The rows of the feature list, by chapter.
pub const CHAPTERS: [(char, &str, u32); 6] = [
    ('F', "Fan texturing", 13),
    ('T', "Textures as functions", 10),
    ('M', "Mappings", 8),
    ('L', "What a texture drives", 13),
    ('E', "Environment", 4),
    ('U', "What users get", 5),
];

/// All rows of the feature list, such as `F1`.
pub fn rows() -> impl Iterator<Item = String> {
    CHAPTERS.iter().flat_map(|&(letter, _, count)| (1..=count).map(move |n| format!("{letter}{n}")))
}

/// All entries, in the order of the page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Catalogue {
    #[serde(rename = "entry")]
    /// In the order of the page.
    pub entries: Vec<Entry>,
}

/// One technique.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Names the pictures' files and the entry on the command line.
    pub name: String,
    /// Rows of the feature list that it shows.
    pub rows: Vec<String>,
    /// Its heading.
    pub title: String,
    /// What is to be seen, and why.
    pub idea: String,
    /// How it is computed.
    pub formula: String,
    /// The look, a file beside the catalogue.
    pub look: Option<String>,
    /// Pictures that no look can make: the name of what draws them.
    pub drawn_by: Option<String>,
    /// Commands, without the program's name. Where there is neither look nor drawing they make the pictures; else they show how to see the same
    /// on a model of one's own. Paths in `assets/` and `gallery/` are files that come with the program, others lie in a new folder.
    #[serde(default)]
    pub commands: Vec<String>,
    /// Side by side; one picture of the look as it is where there is none.
    #[serde(default, rename = "picture")]
    pub pictures: Vec<Variant>,
}

/// A picture of an entry's look with some keys changed.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// What distinguishes it from its neighbours.
    #[serde(default)]
    pub caption: String,
    /// New values by key path, such as `textures.photo.filter` or `light.0.strength`.
    #[serde(default)]
    pub set: toml::Table,
    /// The picture that the entry's commands write.
    pub file: Option<String>,
}

impl Catalogue {
    /// Reads `gallery.toml` in a folder.
    ///
    /// # Errors
    /// It cannot be read, is no catalogue, or names a row that is not in the feature list.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("gallery.toml");
        let text = read(&path)?;
        let catalogue: Self = toml::from_str(&text).map_err(|error| no_catalogue(&path, &error))?;
        for entry in &catalogue.entries {
            if let Some(row) = entry.rows.iter().find(|row| !is_row(row)) {
                let entry = &entry.name;
                return Err(Error::malformed(format!(
                    "the gallery's entry '{entry}' names the row '{row}', which is not in the feature list"
                )));
            }
        }
        Ok(catalogue)
    }

    /// The entries of these names or rows, all where there are none.
    ///
    /// # Errors
    /// There is no entry of that name.
    pub fn select(&self, names: &[String]) -> Result<Vec<&Entry>> {
        if let Some(name) = names.iter().find(|name| !self.entries.iter().any(|e| e.is_called(name))) {
            let known: Vec<&str> = self.entries.iter().map(|e| e.name.as_str()).collect();
            let known = known.join(", ");
            return Err(Error::not_found(format!(
                "there is no picture '{name}' in the gallery; there are {known}"
            )));
        }
        let wanted = |e: &&Entry| names.is_empty() || names.iter().any(|name| e.is_called(name));
        Ok(self.entries.iter().filter(wanted).collect())
    }
}

impl Entry {
    /// True for the entry's name and for each of its rows.
    fn is_called(&self, name: &str) -> bool {
        self.name == name || self.rows.iter().any(|row| row == name)
    }

    /// The pictures side by side, at least one.
    pub fn variants(&self) -> Vec<Variant> {
        if self.pictures.is_empty() { vec![Variant::default()] } else { self.pictures.clone() }
    }
}

impl Variant {
    /// A look's table with the changed values.
    ///
    /// # Errors
    /// A key path leads nowhere.
    pub fn apply(&self, entry: &str, look: toml::Table) -> Result<toml::Table> {
        let mut root = toml::Value::Table(look);
        for (key, value) in &self.set {
            let unknown = || {
                Error::malformed(format!(
                    "the gallery's entry '{entry}' changes '{key}' of its look, which has no such table or list"
                ))
            };
            let (parents, last) = key.rsplit_once('.').unwrap_or(("", key));
            let mut steps = parents.split('.').filter(|step| !step.is_empty());
            let place = steps.try_fold(&mut root, child).ok_or_else(unknown)?;
            match place {
                toml::Value::Table(table) => {
                    table.insert(last.to_owned(), value.clone());
                }
                toml::Value::Array(items) => {
                    let index = last.parse::<usize>().ok().filter(|&i| i < items.len());
                    items[index.ok_or_else(unknown)?] = value.clone();
                }
                _ => return Err(unknown()),
            }
        }
        let toml::Value::Table(table) = root else { unreachable!("the root stays a table") };
        Ok(table)
    }
}

/// An entry of a table or a list; tables that are missing are made.
fn child<'v>(value: &'v mut toml::Value, step: &str) -> Option<&'v mut toml::Value> {
    match value {
        toml::Value::Table(table) => {
            Some(table.entry(step).or_insert_with(|| toml::Value::Table(toml::Table::new())))
        }
        toml::Value::Array(items) => items.get_mut(step.parse::<usize>().ok()?),
        _ => None,
    }
}

/// A file's text.
///
/// # Errors
/// It cannot be read.
pub fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|error| Error::reading(path, error))
}

fn no_catalogue(path: &Path, error: &toml::de::Error) -> Error {
    Error::malformed(format!("{} is no catalogue of a gallery: {error}", path.display())).with_path(path)
}

fn is_row(name: &str) -> bool {
    rows().any(|row| row == name)
}

#[cfg(test)]
mod tests {
    use super::is_row;

    #[test]
    fn rows_are_those_of_the_feature_list() {
        assert!(is_row("T10") && is_row("F1") && is_row("E4"));
        assert!(!is_row("T11") && !is_row("X1") && !is_row("E") && !is_row("") && is_row("U5"));
    }
}
