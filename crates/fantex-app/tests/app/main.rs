//! The viewer without a window: its state, its panels, its painter.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod brush;
mod camera;
mod document;
mod exchange;
mod figures;
mod painting;
mod panels;
mod session;
mod settings;
mod viewer;
