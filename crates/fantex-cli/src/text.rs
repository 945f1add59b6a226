//! Numbers as people type them (`64k`, `5.59M`, `16G`), and text in columns.

use std::fmt::{self, Write as _};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use fantex::Error;
use fantex::base::numbered;
use fantex::base::text::{LETTERS, parse_number};
use fantex::cover::CoverStats;
use fantex::mesh::check_hard_edges;
use serde::{Serialize, Serializer};

/// A path in a result. JSON is UTF-8, and names of files need not be: what is none stands there as U+FFFD, as in messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShownPath(PathBuf);

impl<P: Into<PathBuf>> From<P> for ShownPath {
    fn from(path: P) -> Self {
        Self(path.into())
    }
}

impl Deref for ShownPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Serialize for ShownPath {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0.display())
    }
}

/// A number of things (texels, triangles): `64k` is 64 000, `4M` four million, `16G` sixteen thousand million.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Count(pub(crate) u64);

impl FromStr for Count {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        parse_number(text, 1000).map(Self)
    }
}

/// Parses a number of bytes: `512M` is 512 MiB, `4G` 4 GiB.
pub(crate) fn bytes(text: &str) -> Result<u64, Error> {
    parse_number(text, 1024)
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mut rest, mut letter) = (self.0, None);
        let mut letters = LETTERS.into_iter();
        while rest > 0 && rest.is_multiple_of(1000) && letters.len() > 0 {
            (rest, letter) = (rest / 1000, letters.next());
        }
        write!(f, "{rest}{}", letter.map(String::from).unwrap_or_default())
    }
}

/// A number above zero, for argument parsing. Single precision holds it.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let is_inside = |n| n > f64::from(f32::MIN_POSITIVE) && n < f64::from(f32::MAX);
    within(text, "expected a number above zero that is not beyond 3e38", is_inside)
}

/// A number from 0 to 1, for argument parsing.
pub(crate) fn share(text: &str) -> Result<f32, String> {
    within(text, "expected a number from 0 to 1", |n: f32| (0.0..=1.0).contains(&n))
}

/// An angle between two normals, for argument parsing.
pub(crate) fn bend(text: &str) -> Result<f32, String> {
    within(text, "expected an angle of 0 to 180 degrees", |degrees| check_hard_edges(degrees).is_ok())
}

/// A whole number, for argument parsing.
pub(crate) fn whole<T: FromStr + Copy>(text: &str) -> Result<T, String> {
    within(text, "expected a whole number, 0 or more", |_| true)
}

/// A number that fulfils a condition; `expected` says which.
pub(crate) fn within<T: FromStr + Copy>(
    text: &str,
    expected: &str,
    is_inside: impl Fn(T) -> bool,
) -> Result<T, String> {
    text.parse().ok().filter(|&number| is_inside(number)).ok_or_else(|| expected.to_owned())
}

/// What an option can be: names, their help, their values.
pub(crate) type Choices<T, const N: usize> = [(&'static str, &'static str, T); N];

/// Parses the names of a table, which `--help` lists.
pub(crate) fn one_of<T: Copy + Send + Sync, const N: usize>(
    table: &'static Choices<T, N>,
) -> impl TypedValueParser<Value = T> {
    let names = table.each_ref().map(|(name, help, _)| PossibleValue::new(*name).help(*help));
    let value_of = move |name: String| table[table.iter().position(|row| row.0 == name).unwrap_or(0)].2;
    PossibleValuesParser::new(names).map(value_of)
}

/// A count in words: `1 tile`, `69 451 tiles`.
pub(crate) fn counted(number: u64, noun: &str) -> String {
    format!("{} {}", grouped(number), numbered(number, noun))
}

/// Digits in groups of three: `69 451`.
pub(crate) fn grouped(number: u64) -> String {
    fantex::base::grouped(number, ' ')
}

/// Megabytes (of a million bytes) with as many digits as matter.
pub(crate) fn megabytes(bytes: u64) -> String {
    let megabytes = bytes as f64 / 1e6;
    match megabytes {
        m if m >= 100.0 => format!("{m:.0} MB"),
        m if m >= 1.0 => format!("{m:.1} MB"),
        _ => format!("{:.1} kB", bytes as f64 / 1e3),
    }
}

/// Lines of a label and a value, the values below each other.
#[derive(Debug, Default)]
pub(crate) struct Table {
    rows: Vec<(String, String)>,
}

impl Table {
    pub(crate) fn row(&mut self, label: &str, value: impl Into<String>) -> &mut Self {
        self.rows.push((label.to_owned(), value.into()));
        self
    }

    /// Adds a line with the same label for each value.
    pub(crate) fn rows(&mut self, label: &str, values: impl IntoIterator<Item = impl Into<String>>) {
        for value in values {
            self.row(label, value);
        }
    }

    /// The lines, each with its end.
    pub(crate) fn to_text(&self) -> String {
        let width = self.rows.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
        self.rows.iter().fold(String::new(), |mut text, (label, value)| {
            let _infallible = writeln!(text, "{label:<width$}  {value}");
            text
        })
    }
}

/// Rows of cells in aligned columns: the first column to the left, the others to the right. The first row is the heading.
pub(crate) fn columns(rows: &[Vec<String>]) -> String {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..count).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> = row
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(i, (cell, &width))| match i {
                0 => format!("{cell:<width$}"),
                _ => format!("{cell:>width$}"),
            })
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}

/// A sentence on texels beyond those that were asked for. Sides of tiles have at least 4 texels, so many tiles of little surface
/// can take more than the budget.
pub(crate) fn over_budget(asked: Option<u64>, stats: &CoverStats) -> Option<String> {
    let asked = asked.filter(|&asked| stats.texels > asked)?;
    let tiles = counted(stats.groups, "tile");
    Some(format!(
        "{} instead of the {} asked for: {tiles} cannot be smaller, as their sides have at least 4 texels",
        counted(stats.texels, "texel"),
        grouped(asked)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_multiply() {
        let count = |text: &str| text.parse::<Count>().unwrap().0;
        let bytes = |text: &str| bytes(text).unwrap();
        assert_eq!(count("64k"), 64_000);
        assert_eq!(count("5.59M"), 5_590_000);
        assert_eq!(count("16g"), 16_000_000_000);
        assert_eq!(count("0.5k"), 500);
        assert_eq!(bytes("512M"), 512 << 20);
        assert_eq!(bytes("1.5G"), 3 << 29);
        assert_eq!(bytes("7"), 7);
    }

    #[test]
    fn nonsense_is_refused() {
        for text in ["", "k", ".", "-5", "1e6", "4 M", "4MB", "1.2.3", "\u{664}", "5\u{b5}"] {
            assert!(text.parse::<Count>().unwrap_err().to_string().contains("such as"), "{text}");
        }
        assert_eq!("0".parse::<Count>().unwrap_err().to_string(), "expected a number above zero");
        assert_eq!(bytes("0.0001").unwrap_err().to_string(), "expected a number above zero");
        assert_eq!("99999999T".parse::<Count>().unwrap_err().to_string(), "the number is too large");
        assert_eq!(
            "123456789012345678901234567890".parse::<Count>().unwrap_err().to_string(),
            "the number is too large"
        );
    }

    #[test]
    fn sizes_print_as_they_are_typed() {
        for text in ["64k", "4M", "5590k", "7"] {
            assert_eq!(text.parse::<Count>().unwrap().to_string(), text);
        }
        assert_eq!(grouped(1_234_567), "1 234 567");
        assert_eq!(grouped(12), "12");
        assert_eq!(megabytes(12_345_678), "12.3 MB");
    }

    #[test]
    fn values_stand_below_each_other() {
        let mut table = Table::default();
        table.row("a", "1").row("longer", "2");
        assert_eq!(table.to_text(), "a       1\nlonger  2\n");
    }

    #[test]
    fn numbers_end_below_each_other() {
        let rows = [vec!["name".to_owned(), "MB".to_owned()], vec!["x".to_owned(), "12.5".to_owned()]];
        assert_eq!(columns(&rows), "name    MB\nx     12.5\n");
    }

    #[test]
    fn only_what_exceeds_a_number_is_said() {
        let stats = CoverStats { texels: 1600, groups: 100, ..CoverStats::default() };
        assert_eq!(over_budget(Some(1600), &stats), None);
        assert_eq!(over_budget(None, &stats), None);
        let text = over_budget(Some(1000), &stats).unwrap();
        assert!(text.starts_with("1 600 texels instead of the 1 000 asked for: 100 tiles"), "{text}");
    }
}
