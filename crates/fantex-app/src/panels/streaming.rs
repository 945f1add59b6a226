//! The page about streaming: what is resident, what is coming, what is damaged.

use eframe::egui::load::SizedTexture;
use eframe::egui::{
    Align, Color32, ComboBox, DragValue, Grid, Image, Layout, Rect, RichText, Sense, Ui, vec2,
};

use crate::document::Document;
use crate::figures::{DamagedPart, ObjectFigures, StreamFigures};
use crate::panels::AtlasTexture;
use crate::panels::widgets::{Chart, dot, facts, gauge, heading, hint, number, row};
use crate::settings::StreamingSettings;
use crate::text::{bytes_text, grouped};
use crate::theme;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    heading(ui, "Pool");
    settings(ui, &mut viewer.settings.streaming);
    if !viewer.document.as_ref().is_some_and(Document::is_streamed) {
        return hint(ui, "Only assets (.fan) are streamed; a model lies whole in the graphics memory.");
    }
    if show_figures(ui, &viewer.figures) {
        viewer.retries += 1;
    }
}

/// What streaming tells of an asset. True once what could not be read is to be read again.
fn show_figures(ui: &mut Ui, figures: &StreamFigures) -> bool {
    gauge(ui, figures.occupancy(), theme::ACCENT).on_hover_text("Share of the pool that holds tiles");
    let [width, height, layers] = figures.atlas;
    let used =
        format!("{} of {}", bytes_text(figures.used_bytes as f64), bytes_text(figures.pool_bytes as f64));
    let mut pool = vec![("In use", used)];
    if figures.objects.is_none() {
        pool.push(("Atlas", format!("{width} × {height} texels, {layers} layers")));
    }
    facts(ui, "pool facts", pool);
    if let Some(objects) = &figures.objects {
        show_objects(ui, objects);
    }
    heading(ui, "Now");
    facts(
        ui,
        "stream facts",
        [
            ("Wanted parcels there", format!("{:.1} %", figures.hit_rate() * 100.0)),
            ("To come", grouped(figures.missing)),
            ("Being read", grouped(figures.queue)),
            ("Level bias", format!("{:.2}", figures.bias)),
            (
                "Uploaded",
                format!(
                    "{} parcels, {}",
                    grouped(figures.uploaded_parcels),
                    bytes_text(figures.uploaded_bytes as f64)
                ),
            ),
            ("Evicted", format!("{} parcels", grouped(figures.evicted_parcels))),
        ],
    );
    if figures.objects.is_none() {
        heading(ui, "Resident per level");
        levels(ui, figures);
    }
    heading(ui, "Damaged");
    damage(ui, figures)
}

/// What there is of a world's objects.
fn show_objects(ui: &mut Ui, objects: &ObjectFigures) {
    heading(ui, "Objects");
    facts(
        ui,
        "object facts",
        [
            ("Whole", grouped(objects.whole)),
            ("By their previews", grouped(objects.previews)),
            ("Coarse, each for several", grouped(objects.coarse)),
            ("To come", grouped(objects.missing)),
            ("Triangles", grouped(objects.triangles)),
            ("Geometry", bytes_text(objects.geometry_bytes as f64)),
        ],
    );
    for (name, reason) in &objects.failed {
        ui.label(RichText::new(format!("{name} could not be opened")).color(theme::WARNING))
            .on_hover_text(reason);
    }
}

fn settings(ui: &mut Ui, streaming: &mut StreamingSettings) {
    let [least, most] = StreamingSettings::POOL_MIB;
    let size = number("Size", " MiB", 0, "Graphics memory for texels; nothing beyond it is taken");
    size.logarithmic().show(ui, &mut streaming.pool_mib, least..=most);
    let [least, most] = StreamingSettings::GEOMETRY_MIB;
    let hint =
        "Memory for the meshes of a world's objects; those that are far away are shown by their previews";
    number("Geometry", " MiB", 0, hint).logarithmic().show(ui, &mut streaming.geometry_mib, least..=most);
    let [least, most] = StreamingSettings::UPLOAD_KIB;
    row(ui, "Per frame", |ui| {
        let value = DragValue::new(&mut streaming.upload_kib).range(least..=most).speed(64).suffix(" KiB");
        ui.add(value).on_hover_text("Most texels that go to the graphics memory in one frame")
    });
    row(ui, "Loading", |ui| {
        ui.checkbox(&mut streaming.is_running, "on").on_hover_text("Off: what is there stays (L)")
    });
}

fn levels(ui: &mut Ui, figures: &StreamFigures) {
    if figures.levels.is_empty() {
        return hint(ui, "Nothing has been wanted yet.");
    }
    Grid::new("levels").num_columns(3).spacing([10.0, 4.0]).show(ui, |ui| {
        for (level, now) in figures.levels.iter().enumerate() {
            ui.horizontal(|ui| {
                dot(ui, theme::level_color(level));
                ui.label(level.to_string());
            });
            let share = if now.texels == 0 { 0.0 } else { now.resident as f32 / now.texels as f32 };
            ui.scope(|ui| {
                ui.set_width(110.0);
                gauge(ui, share, theme::level_color(level));
            });
            ui.label(format!("{:.1} % of {}", 100.0 * share, texels_text(now.texels)));
            ui.end_row();
        }
    });
}

/// `12.3 M texels`.
fn texels_text(texels: u64) -> String {
    let units = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match units.into_iter().find(|(size, _)| texels as f64 >= *size) {
        Some((size, unit)) => format!("{:.1} {unit} texels", texels as f64 / size),
        None => format!("{texels} texels"),
    }
}

/// What could not be read. True once it is to be read again.
fn damage(ui: &mut Ui, figures: &StreamFigures) -> bool {
    let has_failed = figures.objects.as_ref().is_some_and(|objects| !objects.failed.is_empty());
    if figures.damaged_count == 0 && !has_failed {
        hint(ui, "None: everything that was read was whole.");
        return false;
    }
    if figures.damaged_count > 0 {
        let text = format!("{} could not be read; coarser levels stand in.", grouped(figures.damaged_count));
        ui.label(RichText::new(text).color(theme::WARNING));
    }
    for DamagedPart { part, reason } in &figures.damaged {
        ui.label(RichText::new(part).color(theme::TEXT)).on_hover_text(reason);
    }
    let tip = "Once the network, the disk or the file is there again";
    ui.button("Read again").on_hover_text(tip).clicked()
}

/// Returns the channel that was chosen, if another was.
pub(super) fn show_atlas(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTexture) -> Option<usize> {
    let mut chosen = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new("Live atlas").color(theme::STRONG));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            chosen = channel(ui, viewer, atlas);
        });
    });
    ui.separator();
    let Some(id) = atlas.id else {
        hint(
            ui,
            match &viewer.document {
                None => "Open an asset: its tiles appear here as they are streamed.",
                Some(document) if document.asset().is_some() => {
                    "This channel is not in the atlas: what is drawn does not read it."
                }
                Some(_) => "Only assets (.fan) are streamed through an atlas.",
            },
        );
        return chosen;
    };
    let [width, height] = atlas.extent.map(|n| n.max(1) as f32);
    let room = ui.available_size() - vec2(0.0, 44.0);
    let scale = (room.x / width).min(room.y / height).max(0.0);
    let size = vec2(width, height) * scale;
    ui.add(Image::from_texture(SizedTexture::new(id, size)).bg_fill(Color32::BLACK));
    let figures = &viewer.figures;
    let used = format!(
        "{:.0} % in use, {} × {} texels",
        figures.occupancy() * 100.0,
        atlas.extent[0],
        atlas.extent[1]
    );
    ui.label(RichText::new(used).color(theme::TEXT));
    hint(ui, "Tiles of all levels share it; those that are not needed make room.");
    chosen
}

fn channel(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTexture) -> Option<usize> {
    let channels = viewer.document.as_ref().map(|document| &document.channels).filter(|all| all.len() > 1)?;
    let mut now = atlas.channel.min(channels.len() - 1);
    let before = now;
    let list = ComboBox::from_id_salt("atlas channel").selected_text(channels[now].kind).show_ui(ui, |ui| {
        for (i, channel) in channels.iter().enumerate() {
            ui.selectable_value(&mut now, i, channel.kind);
        }
    });
    list.response.on_hover_text("The channel that is shown");
    (now != before).then_some(now)
}

/// Milliseconds of a frame at 60 per second.
const SMOOTH_MS: f32 = 16.7;

pub(super) fn show_graphs(ui: &mut Ui, viewer: &Viewer) {
    let graphs = &viewer.graphs;
    let milliseconds = |ms: f32| format!("{ms:.1} ms");
    let percent = |share: f32| format!("{:.0} %", share * 100.0);
    let pages = |count: f32| format!("{count:.0} pages");
    let rate = |bytes: f32| format!("{}/s", bytes_text(f64::from(bytes)));
    let chart = |title, history, color, top, limit, text| Chart { title, history, color, top, limit, text };
    let charts = [
        chart("Frame", &graphs.frame_ms, theme::ACCENT, 20.0, Some(SMOOTH_MS), &milliseconds),
        chart("Pool", &graphs.pool, theme::GOOD, 1.0, None, &percent),
        chart("Queue", &graphs.queue, theme::WARNING, 10.0, None, &pages),
        chart("Uploads", &graphs.bandwidth, theme::VIOLET, 1e6, None, &rate),
    ];
    let gap = 8.0;
    let (rect, _) = ui.allocate_exact_size(ui.available_size(), Sense::hover());
    let width = (rect.width() - gap * (charts.len() - 1) as f32) / charts.len() as f32;
    for (i, chart) in charts.iter().enumerate() {
        let left = rect.left_top() + vec2((width + gap) * i as f32, 0.0);
        chart.paint(ui, Rect::from_min_size(left, vec2(width, rect.height())));
    }
}
