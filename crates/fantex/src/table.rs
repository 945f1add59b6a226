//! Text in columns.

use std::fmt::Write;

/// Lines of a label and a value, the values below each other.
#[derive(Debug, Default)]
pub(crate) struct Table {
    rows: Vec<(String, String)>,
}

impl Table {
    /// Adds a line.
    pub(crate) fn row(&mut self, label: &str, value: impl Into<String>) -> &mut Self {
        self.rows.push((label.to_owned(), value.into()));
        self
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
