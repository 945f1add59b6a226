//! The graphs below the scene.

use eframe::egui::{Rect, Sense, Ui, vec2};

use super::widgets::Chart;
use crate::document::bytes_text;
use crate::theme;
use crate::viewer::Viewer;

/// Milliseconds of a frame at 60 per second.
const SMOOTH_MS: f32 = 16.7;

pub(super) fn show(ui: &mut Ui, viewer: &Viewer) {
    let graphs = &viewer.graphs;
    let milliseconds = |ms: f32| format!("{ms:.1} ms");
    let percent = |share: f32| format!("{:.0} %", share * 100.0);
    let pages = |count: f32| format!("{count:.0} pages");
    let rate = |bytes: f32| format!("{}/s", bytes_text(f64::from(bytes)));
    let charts = [
        Chart {
            title: "Frame",
            history: &graphs.frame_ms,
            color: theme::ACCENT,
            top: 20.0,
            limit: Some(SMOOTH_MS),
            text: &milliseconds,
        },
        Chart {
            title: "Pool",
            history: &graphs.pool,
            color: theme::GOOD,
            top: 1.0,
            limit: None,
            text: &percent,
        },
        Chart {
            title: "Queue",
            history: &graphs.queue,
            color: theme::WARNING,
            top: 10.0,
            limit: None,
            text: &pages,
        },
        Chart {
            title: "Uploads",
            history: &graphs.bandwidth,
            color: theme::VIOLET,
            top: 1e6,
            limit: None,
            text: &rate,
        },
    ];
    let gap = 8.0;
    let (rect, _) = ui.allocate_exact_size(ui.available_size(), Sense::hover());
    let width = (rect.width() - gap * (charts.len() - 1) as f32) / charts.len() as f32;
    for (i, chart) in charts.iter().enumerate() {
        let left = rect.left_top() + vec2((width + gap) * i as f32, 0.0);
        chart.paint(ui, Rect::from_min_size(left, vec2(width, rect.height())));
    }
}
