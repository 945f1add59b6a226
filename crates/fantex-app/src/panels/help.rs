//! The help sheet: keys and mouse.

use eframe::egui::{Align2, Grid, Order, RichText, Ui, Window, vec2};

use crate::command::Command;
use crate::command::{GESTURES, PAINT_GESTURES, Section, shortcuts};
use crate::paint::{PaintCommand, paint_shortcuts};
use crate::theme;
use crate::viewer::Viewer;

pub(super) fn show(ui: &Ui, viewer: &mut Viewer) {
    let mut is_open = true;
    let screen = ui.ctx().content_rect();
    let is_painting = viewer.painting.is_some();
    let sheet = Window::new("Keys and mouse")
        .open(&mut is_open)
        .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
        .order(Order::Foreground)
        .collapsible(false)
        .resizable(false)
        .max_height(screen.height() - 80.0);
    sheet.show(ui.ctx(), |ui| {
        ui.horizontal_top(|ui| {
            ui.spacing_mut().interact_size.y = 16.0;
            if viewer.painting.is_some() {
                column(ui, 330.0, painting);
                ui.add_space(20.0);
            }
            if viewer.painting.is_none() {
                column(ui, 290.0, gestures);
            }
            ui.add_space(20.0);
            column(ui, 240.0, |ui| {
                keys(ui, Section::Camera, is_painting);
                keys(ui, Section::Panels, is_painting);
            });
            ui.add_space(20.0);
            column(ui, 290.0, |ui| {
                keys(ui, Section::File, is_painting);
                keys(ui, Section::Display, is_painting);
            });
        });
    });
    viewer.has_help &= is_open;
}

fn column(ui: &mut Ui, width: f32, add: impl FnOnce(&mut Ui)) {
    ui.vertical(|ui| {
        ui.set_width(width);
        add(ui);
    });
}

fn gestures(ui: &mut Ui) {
    for (title, rows) in GESTURES {
        table(ui, title, rows.iter().map(|&(keys, text)| (keys.to_owned(), text)));
    }
}

/// What painting has; the digits are among the gestures.
fn painting(ui: &mut Ui) {
    table(ui, "Pen and mouse", PAINT_GESTURES.iter().map(|&(keys, text)| (keys.to_owned(), text)));
    let is_digit = |command: &Command| {
        matches!(command, Command::Paint(PaintCommand::Opacity(_) | PaintCommand::Flow(_)))
    };
    let rows = paint_shortcuts().into_iter().filter(|s| !is_digit(&s.command)).map(|s| (s.keys(), s.text));
    table(ui, Section::Painting.label(), rows);
}

fn keys(ui: &mut Ui, section: Section, is_painting: bool) {
    let is_taken = |s: &crate::command::Shortcut| {
        is_painting && paint_shortcuts().iter().any(|p| p.key == s.key && p.modifiers == s.modifiers)
    };
    let rows =
        shortcuts().into_iter().filter(|s| s.section == section && !is_taken(s)).map(|s| (s.keys(), s.text));
    table(ui, section.label(), rows);
}

fn table(ui: &mut Ui, title: &str, rows: impl Iterator<Item = (String, &'static str)>) {
    ui.label(RichText::new(title).color(theme::STRONG));
    Grid::new(("help", title)).num_columns(2).spacing([12.0, 3.0]).min_col_width(84.0).show(ui, |ui| {
        for (keys, text) in rows {
            ui.label(RichText::new(keys).monospace().size(11.5).color(theme::ACCENT));
            ui.label(text);
            ui.end_row();
        }
    });
    ui.add_space(8.0);
}
