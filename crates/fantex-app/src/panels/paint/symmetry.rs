//! Symmetry of strokes.

use eframe::egui::Ui;

use crate::paint::SymmetryKind;
use crate::panels::widgets::{NumberRow, heading, row, segments};
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let diagonal = viewer.scale().diagonal;
    let symmetry = &mut viewer.settings.paint.symmetry;
    heading(ui, "Symmetry");
    ui.horizontal(|ui| segments(ui, &mut symmetry.kind, &SymmetryKind::ALL, SymmetryKind::label));
    if symmetry.kind == SymmetryKind::Off {
        return;
    }
    row(ui, "Axis", |ui| {
        let axes =
            |ui: &mut Ui| segments(ui, &mut symmetry.axis, &[0, 1, 2], |axis| ["X", "Y", "Z"][axis.min(2)]);
        ui.horizontal(axes).response
    });
    match symmetry.kind {
        SymmetryKind::Mirror => {
            let half = 0.5 * diagonal;
            let offset =
                NumberRow { name: "Offset", decimals: 3, tip: "From the model's middle", ..NumberRow::PLAIN };
            offset.show(ui, &mut symmetry.offset, -half..=half);
        }
        _ => {
            let count = NumberRow { name: "Copies", decimals: 0, ..NumberRow::PLAIN };
            count.show(ui, &mut symmetry.count, 2..=24);
        }
    }
    ui.checkbox(&mut symmetry.shows_plane, "Show it in the scene");
}
