//! The viewer without a window: its state, its panels, its painter.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod adjusting;
mod brush;
mod camera;
mod document;
mod exchange;
mod export;
mod figures;
mod files;
mod gizmo;
mod glyphs;
mod layer_groups;
mod leaving;
mod live;
mod narrow;
mod painting;
mod panels;
mod pen;
mod placing;
mod pointing;
mod session;
mod settings;
mod shell;
mod text;
mod viewer;

use fantex_app::notices::{Notices, Severity};

/// Errors on the screen.
fn errors(notices: &Notices) -> usize {
    notices.clone().shown().filter(|notice| notice.severity == Severity::Error).count()
}
