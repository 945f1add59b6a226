//! The inspector: pages about the model, its cover, streaming, light and view.

use eframe::egui::{ScrollArea, Ui};

use super::widgets::segments;
use super::{cover, light, model, streaming, view};
use crate::settings::Tab;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    ui.horizontal(|ui| segments(ui, &mut viewer.settings.panels.tab, &Tab::ALL, Tab::label));
    ui.separator();
    let tab = viewer.settings.panels.tab;
    ScrollArea::vertical().id_salt(tab.label()).auto_shrink([false, false]).show(ui, |ui| match tab {
        Tab::Model => model::show(ui, viewer),
        Tab::Cover => cover::show(ui, viewer),
        Tab::Streaming => streaming::show(ui, viewer),
        Tab::Light => light::show(ui, viewer, seconds),
        Tab::View => view::show(ui, viewer, seconds),
    });
}
