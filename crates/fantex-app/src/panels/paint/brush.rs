//! The brush: its preview, its numbers, and the brushes that are kept.

use crate::paint::{
    AlphaShown, BLEND_MODES, BrushSettings, FillReach, GradientEnd, GradientShape, PaintSettings, PaintTool,
    PictureUse, SizeUnit, StickerKind, TIPS, preview_stroke,
};
use crate::panels::paint::color::name_field;
use crate::panels::widgets::{
    cached_texture, choice, decimals_of, file_button, framed_picture, heading, hint, number, row, segments,
};
use crate::settings::label_of;
use crate::theme;
use crate::viewer::{FileDialog, Request, Viewer};
use eframe::egui::{Button, Color32, ColorImage, RichText, TextEdit, Ui, vec2};
use fantex::paint::BlendMode;

/// Pixels of the preview, before the screen's own scale.
const PREVIEW: [usize; 2] = [244, 64];

pub(crate) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let diagonal = viewer.scale().diagonal as f32;
    let paint = &mut viewer.settings.paint;
    ui.label(RichText::new(label_of(&PaintTool::ALL, paint.tool)).heading().color(theme::STRONG));
    hint(ui, paint.tool.hint());
    ui.add_space(2.0);
    if paint.tool == PaintTool::Fill {
        return fill(ui, paint);
    }
    if paint.tool == PaintTool::Gradient {
        return gradient(ui, paint);
    }
    if paint.tool == PaintTool::Sticker {
        if sticker(ui, paint, diagonal) {
            viewer.request(Request::Dialog(FileDialog::Sticker));
        }
        return;
    }
    if paint.tool == PaintTool::Pick {
        return;
    }
    preview(
        ui,
        &paint.brush,
        match paint.tool {
            PaintTool::Erase | PaintTool::Opacity => [0xe8; 3],
            _ => paint.colors.foreground,
        },
    );
    size(ui, &mut paint.brush, diagonal);
    let brush = &mut paint.brush;
    percent(ui, "Hardness", &mut brush.hardness, "Share of the brush that is full (Shift + [ and ])");
    if paint.tool == PaintTool::Opacity {
        percent(ui, "Goes to", &mut paint.opacity_to, "0 lets what lies behind be seen, 100 hides it");
    }
    let brush = &mut paint.brush;
    percent(ui, "Opacity", &mut brush.opacity, "Most that one stroke covers (digits)");
    percent(ui, "Flow", &mut brush.flow, "What each dab adds (Shift + digits)");
    if paint.tool == PaintTool::Paint {
        // Brushes erase with a tool of their own.
        let modes: Vec<_> = BLEND_MODES.into_iter().filter(|(mode, _)| *mode != BlendMode::Erase).collect();
        row(ui, "Blend", |ui| choice(ui, "brush blend", &mut brush.blend, &modes));
    }
    if paint.tool == PaintTool::Smudge {
        percent(ui, "Strength", &mut paint.smudge, "How far colours are carried");
    }
    if paint.tool == PaintTool::Blur {
        percent(ui, "Reach", &mut paint.blur_radius, "How far around is averaged, in diameters");
    }
    if paint.tool == PaintTool::Opacity {
        alpha_shown(ui, viewer);
    }
    let paint = &mut viewer.settings.paint;
    let brush = &mut paint.brush;
    let tip =
        "Dabs go on beyond gaps that are small beside them, as where triangles do not meet at their corners";
    row(ui, "Across gaps", |ui| ui.checkbox(&mut brush.across_gaps, "").on_hover_text(tip));
    let tip = "Nothing that is hidden or turned away: on thin parts paint does not reach the back";
    row(ui, "Only what I see", |ui| ui.checkbox(&mut brush.only_seen, "").on_hover_text(tip));
    if brush.only_seen {
        let tip = "Surfaces turned away from you by more stay as they are";
        number("Up to", "°", 0, tip).show(ui, &mut brush.seen_degrees, 10.0..=90.0);
    }
    let open = ui.collapsing("Stroke", |ui| stroke_options(ui, paint));
    open.header_response.on_hover_text("Spacing, smoothing, jitter, pressure, stamp");
    if open.body_returned == Some(true) {
        viewer.request(Request::Dialog(FileDialog::Stamp));
    }
}

/// How dabs follow the hand; whether a stamp is to be chosen.
fn stroke_options(ui: &mut Ui, paint: &mut PaintSettings) -> bool {
    let brush = &mut paint.brush;
    percent(ui, "Smoothing", &mut brush.smoothing, "How far the brush lags behind the hand");
    number("Spacing", "", 2, "Distance of dabs in diameters").show(ui, &mut brush.spacing, 0.02..=2.0);
    number("Scatter", "", 2, "Random distance from the way, in radii").show(
        ui,
        &mut brush.jitter.position,
        0.0..=4.0,
    );
    percent(ui, "Vary size", &mut brush.jitter.size, "Random change from dab to dab");
    percent(ui, "Vary flow", &mut brush.jitter.flow, "Random change from dab to dab");
    percent(ui, "Pressure: size", &mut brush.pressure.size, "How far pressure goes into the size");
    percent(ui, "Pressure: flow", &mut brush.pressure.flow, "How far pressure goes into the flow");
    let asks_stamp = stamp(ui, brush);
    let tip = "Above 0 less force does more, below 0 more force is needed";
    number("Pen feel", "", 1, tip).show(ui, &mut paint.pen_softness, -1.0..=1.0);
    let tip = "Alt + drag turns the view, and strokes may begin beside the model (Alt + click still picks)";
    row(ui, "Alt turns", |ui| ui.checkbox(&mut paint.alt_turns, "").on_hover_text(tip));
    asks_stamp
}

/// What the model's materials make of the opacity.
pub(crate) fn alpha_shown(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &viewer.painting else { return };
    let known = painting.alpha_shown();
    let mut shown = known;
    let tip =
        "What all materials of the model make of the opacity; the asset is saved and opened again for it";
    row(ui, "Shows", |ui| choice(ui, "alpha shown", &mut shown, &AlphaShown::ALL).on_hover_text(tip));
    if shown != known {
        viewer.show_alpha(shown);
    }
}

/// How far a fill goes.
fn fill(ui: &mut Ui, paint: &mut PaintSettings) {
    row(ui, "Fills", |ui| choice(ui, "fill", &mut paint.fill, &FillReach::ALL));
    match paint.fill {
        FillReach::Angle => {
            let bend = number("Bend", "°", 0, "Edges that bend more end the fill");
            bend.show(ui, &mut paint.fill_degrees, 1.0..=90.0);
        }
        FillReach::Color | FillReach::AllOfColor => {
            let tolerance = number("Tolerance", "", 2, "How different colours may be");
            tolerance.show(ui, &mut paint.fill_tolerance, 0.01..=1.0);
        }
        FillReach::Connected | FillReach::Whole => {}
    }
    percent(ui, "Opacity", &mut paint.brush.opacity, "How much is covered");
}

fn gradient(ui: &mut Ui, paint: &mut PaintSettings) {
    let gradient = &mut paint.gradient;
    let shapes = ui.horizontal(|ui| segments(ui, &mut gradient.shape, &GradientShape::ALL));
    shapes.response.on_hover_text("Alike across the drag, or around its beginning");
    row(ui, "Ends in", |ui| choice(ui, "gradient end", &mut gradient.end, &GradientEnd::ALL));
    let tip = "Colours change slowly at both ends";
    row(ui, "Smooth", |ui| ui.checkbox(&mut gradient.is_smooth, "").on_hover_text(tip));
    fill(ui, paint);
}

/// A text or a picture. Returns whether another picture is wanted.
fn sticker(ui: &mut Ui, paint: &mut PaintSettings, diagonal: f32) -> bool {
    let mut is_asked = false;
    ui.horizontal(|ui| segments(ui, &mut paint.sticker, &StickerKind::ALL));
    match paint.sticker {
        StickerKind::Text => {
            let field = ui.add(TextEdit::multiline(&mut paint.text).desired_rows(2).desired_width(240.0));
            name_field(&field, "Text");
        }
        StickerKind::Picture => {
            let tip = "A picture to lay onto the surface";
            is_asked = row(ui, "Picture", |ui| file_button(ui, paint.picture.as_deref(), tip)).clicked();
            let shown = ui.horizontal(|ui| segments(ui, &mut paint.picture_use, &PictureUse::ALL));
            shown
                .response
                .on_hover_text("A colour, a normal map (green upwards), or a height whose grey is level");
        }
    }
    size(ui, &mut paint.brush, diagonal);
    number("Angle", "°", 0, "How it is turned").show(ui, &mut paint.sticker_degrees, -180.0..=180.0);
    percent(ui, "Opacity", &mut paint.brush.opacity, "How much is covered");
    is_asked
}

/// What shapes the dabs. Returns whether another picture is wanted.
fn stamp(ui: &mut Ui, brush: &mut BrushSettings) -> bool {
    let mut is_asked = false;
    row(ui, "Tip", |ui| {
        let tip = "Shape of the dabs, of those that come with the program";
        choice(ui, "brush tip", &mut brush.tip, &TIPS).on_hover_text(tip)
    });
    row(ui, "Stamp", |ui| {
        let name = brush
            .stamp
            .as_ref()
            .and_then(|path| path.file_stem())
            .map(|name| name.to_string_lossy().into_owned());
        let button = Button::new(name.unwrap_or_else(|| "None …".into())).truncate();
        let tip = "A picture whose alpha or brightness shapes the brush, instead of the tip";
        let response = ui.add(button).on_hover_text(tip);
        is_asked = response.clicked();
        if brush.stamp.is_some() && ui.small_button("×").on_hover_text("Without a picture").clicked() {
            brush.stamp = None;
        }
        response
    });
    if brush.stamp.is_some() || brush.tip.is_some() {
        number("Angle", "°", 0, "Of tip or stamp").show(ui, &mut brush.angle_degrees, -180.0..=180.0);
        let before = brush.jitter.angle.to_degrees();
        let mut turn = before;
        number("Vary angle", "°", 0, "Random change from dab to dab").show(ui, &mut turn, 0.0..=180.0);
        if turn != before {
            brush.jitter.angle = turn.to_radians();
        }
    }
    is_asked
}

/// A share as per cent.
pub(crate) fn percent(ui: &mut Ui, name: &str, value: &mut f32, tip: &str) {
    let mut whole = *value * 100.0;
    let before = whole;
    number(name, " %", 0, tip).show(ui, &mut whole, 0.0..=100.0);
    if whole != before {
        *value = whole / 100.0;
    }
}

/// `diagonal`: of the model, world units.
fn size(ui: &mut Ui, brush: &mut BrushSettings, diagonal: f32) {
    let ([low, high], decimals) = match brush.unit {
        SizeUnit::World => {
            let [least, most] = BrushSettings::WORLD_SIZE;
            let range = [1e-4 * diagonal, diagonal].map(|size| size.clamp(least, most));
            (range, decimals_of(f64::from(brush.size)))
        }
        SizeUnit::Pixels | SizeUnit::Texels => ([BrushSettings::SIZE[0], 500.0], 0),
    };
    let high = brush.size.max(high);
    let size = number("Size", "", decimals, "Diameter ([ and ])");
    size.logarithmic().show(ui, &mut brush.size, low..=high);
    row(ui, "Measured in", |ui| {
        let inner = ui.horizontal(|ui| segments(ui, &mut brush.unit, &SizeUnit::ALL));
        inner.response.on_hover_text("Pixels of the screen, units of the model's file, or texels")
    });
}

/// A stroke in the brush's colour on a dark sheet.
fn preview(ui: &mut Ui, brush: &BrushSettings, [r, g, b]: [u8; 3]) {
    let scale = ui.ctx().pixels_per_point().max(1.0);
    let [width, height] = PREVIEW.map(|n| (n as f32 * scale) as usize);
    let id = ui.scope_id().with("brush preview");
    let texture = cached_texture(ui, id, (brush.clone(), [r, g, b], width), || {
        let sized = BrushSettings { size: brush.size * scale, ..brush.clone() };
        let coverage = preview_stroke(&sized, width, height);
        let mix = |ground: u8, ink: u8, share: f32| {
            (f32::from(ground) + (f32::from(ink) - f32::from(ground)) * share) as u8
        };
        // A light sheet under dark colours.
        let is_dark = 0.3 * f32::from(r) + 0.59 * f32::from(g) + 0.11 * f32::from(b) < 70.0;
        let ground = if is_dark { 0xb8 } else { 0x24 };
        let pixels = coverage.iter().map(|&share| {
            Color32::from_rgb(mix(ground, r, share), mix(ground, g, share), mix(ground, b, share))
        });
        ColorImage::new([width, height], pixels.collect())
    });
    framed_picture(ui, &texture, vec2(PREVIEW[0] as f32, PREVIEW[1] as f32));
}

/// Brushes that are kept: a click takes one.
pub(crate) fn presets(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &mut viewer.painting else { return };
    let brush = &mut viewer.settings.paint.brush;
    heading(ui, "Brushes");
    let (mut taken, mut dropped) = (None, None);
    let size = vec2(118.0, 22.0);
    for pair in painting.presets.brushes.chunks(2) {
        ui.horizontal(|ui| {
            for preset in pair {
                let button =
                    Button::selectable(preset.name == brush.name, preset.name.as_str()).min_size(size);
                let response = ui.add(button);
                response.context_menu(|ui| {
                    if ui.button("Delete").clicked() {
                        dropped = Some(preset.name.clone());
                        ui.close();
                    }
                });
                if response.on_hover_text("Click takes it, right click deletes it").clicked() {
                    taken = Some(preset.clone());
                }
            }
        });
    }
    if let Some(preset) = taken {
        *brush = preset;
    }
    let (mut is_kept, mut is_restored) = (false, false);
    if painting.presets.lacks_own() {
        let tip = "Brings the program's own brushes back that were deleted";
        is_restored = ui.button("Restore").on_hover_text(tip).clicked();
    }
    ui.horizontal(|ui| {
        let field = TextEdit::singleline(&mut brush.name).desired_width(170.0).hint_text("Name of the brush");
        name_field(&ui.add(field), "Name of the brush");
        is_kept = ui.button("Keep").on_hover_text("Saves the brush under this name").clicked();
    });
    if is_kept && !brush.name.trim().is_empty() {
        painting.keep_brush(&viewer.settings.paint, &mut viewer.notices);
    }
    if let Some(name) = dropped {
        painting.drop_brush(&name, &mut viewer.notices);
    }
    if is_restored {
        painting.restore_brushes(&mut viewer.notices);
    }
}
