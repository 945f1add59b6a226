//! The sheet of keys and mouse: as many columns as the window has room for, to be scrolled where it is too low.

use eframe::egui::{Align2, Grid, Order, RichText, ScrollArea, Ui, Vec2, Window, vec2};

use crate::command::{Command, GESTURES, PAINT_GESTURES, Section, Shortcut, shortcuts};
use crate::paint::{PaintCommand, paint_shortcuts};
use crate::settings::label_of;
use crate::theme;
use crate::viewer::Viewer;

/// Widths of a column, and what lies between two, points.
const COLUMN_POINTS: [f32; 2] = [330.0, 400.0];
const GAP: f32 = 20.0;

/// What of a column keys take at most.
const KEYS_POINTS: f32 = 148.0;

/// What lies around the columns: the window's frame and title, and a part of the scene that stays in sight.
const AROUND: Vec2 = vec2(64.0, 110.0);

/// A table with a title.
struct Table {
    title: &'static str,
    rows: Vec<(String, &'static str)>,
}

pub(super) fn show(ui: &Ui, viewer: &mut Viewer) {
    let mut is_open = true;
    let room = (ui.ctx().content_rect().size() - AROUND).max(vec2(120.0, 60.0));
    let count = (((room.x + GAP) / (COLUMN_POINTS[0] + GAP)) as usize).clamp(1, 3);
    let width = ((room.x + GAP) / count as f32 - GAP).min(COLUMN_POINTS[1]);
    let columns = columns(tables(viewer.painting.is_some()), count);
    let sheet = Window::new("Keys and mouse")
        .open(&mut is_open)
        .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
        .order(Order::Foreground)
        .collapsible(false)
        .resizable(false);
    sheet.show(ui.ctx(), |ui| {
        ui.set_width(count as f32 * (width + GAP) - GAP);
        ScrollArea::vertical().max_height(room.y).show(ui, |ui| {
            ui.horizontal_top(|ui| {
                ui.spacing_mut().item_spacing.x = GAP;
                for column in &columns {
                    ui.vertical(|ui| {
                        ui.set_width(width);
                        ui.spacing_mut().interact_size.y = 16.0;
                        column.iter().for_each(|table| table.show(ui, width));
                    });
                }
            });
        });
    });
    viewer.has_help &= is_open;
}

/// Tables one below the other, each in the column that is the shortest so far.
fn columns(tables: Vec<Table>, count: usize) -> Vec<Vec<Table>> {
    let mut columns: Vec<Vec<Table>> = (0..count).map(|_| Vec::new()).collect();
    for table in tables {
        let lines = |column: &Vec<Table>| column.iter().map(|table| table.rows.len() + 2).sum::<usize>();
        if let Some(shortest) = columns.iter_mut().min_by_key(|column| lines(column)) {
            shortest.push(table);
        }
    }
    columns
}

fn tables(is_painting: bool) -> Vec<Table> {
    let mut tables = Vec::new();
    if is_painting {
        tables.extend(painting());
    } else {
        tables.extend(GESTURES.map(|(title, rows)| Table { title, rows: gestures(rows) }));
    }
    let sections = [Section::Camera, Section::File, Section::Panels, Section::Display];
    tables.extend(sections.map(|section| keys(section, is_painting)));
    tables
}

fn gestures(rows: &[(&str, &'static str)]) -> Vec<(String, &'static str)> {
    rows.iter().map(|&(keys, text)| (keys.to_owned(), text)).collect()
}

/// What painting has; the digits are among the gestures.
fn painting() -> [Table; 2] {
    let is_digit = |command: &Command| {
        matches!(command, Command::Paint(PaintCommand::Opacity(_) | PaintCommand::Flow(_)))
    };
    let rows = paint_shortcuts().into_iter().filter(|s| !is_digit(&s.command)).map(|s| (s.keys(), s.text));
    let title = label_of(&Section::ALL, Section::Painting);
    [Table { title: "Pen and mouse", rows: gestures(&PAINT_GESTURES) }, Table { title, rows: rows.collect() }]
}

/// The keys of a section that the painter has not taken.
fn keys(section: Section, is_painting: bool) -> Table {
    let is_taken = |s: &Shortcut| {
        is_painting && paint_shortcuts().iter().any(|p| p.key == s.key && p.modifiers == s.modifiers)
    };
    let own = shortcuts().into_iter().filter(|s| s.section == section && !is_taken(s));
    Table { title: label_of(&Section::ALL, section), rows: own.map(|s| (s.keys(), s.text)).collect() }
}

impl Table {
    fn show(&self, ui: &mut Ui, width: f32) {
        ui.label(RichText::new(self.title).color(theme::STRONG));
        let grid = Grid::new(("help", self.title)).num_columns(2).spacing([12.0, 3.0]);
        let text_width = (width - KEYS_POINTS - 12.0).max(60.0);
        grid.min_col_width(84.0).max_col_width(text_width).show(ui, |ui| {
            for (keys, text) in &self.rows {
                ui.label(RichText::new(keys).monospace().size(11.5).color(theme::ACCENT));
                ui.label(*text);
                ui.end_row();
            }
        });
        ui.add_space(8.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_is_in_a_column() {
        for is_painting in [false, true] {
            let all = tables(is_painting);
            let rows = all.iter().map(|table| table.rows.len()).sum::<usize>();
            for count in 1..4 {
                let columns = columns(tables(is_painting), count);
                let lines: Vec<usize> =
                    columns.iter().map(|column| column.iter().map(|table| table.rows.len()).sum()).collect();
                assert_eq!((columns.len(), lines.iter().sum::<usize>()), (count, rows));
                assert!(lines.iter().all(|&lines| lines > 0), "{lines:?}");
            }
        }
    }
}
