//! How the viewer looks: calm and dark, so that the scene is the brightest thing.

use eframe::egui::style::{Selection, WidgetVisuals, Widgets};
use eframe::egui::{
    self, Color32, CornerRadius, FontFamily, FontId, Margin, Shadow, Stroke, TextStyle, Theme, Visuals, vec2,
};

/// Panels.
pub const PANEL: Color32 = Color32::from_rgb(0x1b, 0x1d, 0x21);
/// Bars above and below.
pub const BAR: Color32 = Color32::from_rgb(0x15, 0x17, 0x1a);
/// Behind graphs and lists.
pub const WELL: Color32 = Color32::from_rgb(0x12, 0x13, 0x16);
/// Lines between panels.
pub const LINE: Color32 = Color32::from_rgb(0x2b, 0x2e, 0x34);
/// Ordinary text.
pub const TEXT: Color32 = Color32::from_rgb(0xcf, 0xd4, 0xdb);
/// Names of values, hints.
pub const FAINT: Color32 = Color32::from_rgb(0x8b, 0x93, 0x9e);
/// Headings and what is chosen.
pub const STRONG: Color32 = Color32::from_rgb(0xf0, 0xf2, 0xf5);
/// What can be acted on.
pub const ACCENT: Color32 = Color32::from_rgb(0x5a, 0xa9, 0xe6);
/// All is well.
pub const GOOD: Color32 = Color32::from_rgb(0x6c, 0xc0, 0x8b);
/// Something is not as it should be.
pub const WARNING: Color32 = Color32::from_rgb(0xe6, 0xb4, 0x50);
/// Something failed.
pub const ERROR: Color32 = Color32::from_rgb(0xe8, 0x6c, 0x63);

/// A fourth colour for graphs.
pub const VIOLET: Color32 = Color32::from_rgb(0x9d, 0x8f, 0xe0);

/// Levels that have a colour of their own; coarser ones share the last.
pub const COLORED_LEVELS: usize = 9;

/// The colour of a detail level, as the overlay of levels has it: from red (the finest) round the circle of hues.
pub fn level_color(level: usize) -> Color32 {
    let hue = (level as f32 * 0.6).min(5.0);
    let linear = [(hue - 3.0).abs() - 1.0, 2.0 - (hue - 2.0).abs(), 2.0 - (hue - 4.0).abs()];
    let [r, g, b] = linear.map(|c| c.clamp(0.05, 0.9));
    egui::Rgba::from_rgb(r, g, b).into()
}

/// Puts the look on.
pub fn apply(ctx: &egui::Context) {
    ctx.set_theme(Theme::Dark);
    ctx.style_mut_of(Theme::Dark, |style| {
        let font = |size: f32, family: FontFamily| FontId::new(size, family);
        style.text_styles = [
            (TextStyle::Small, font(11.0, FontFamily::Proportional)),
            (TextStyle::Body, font(13.0, FontFamily::Proportional)),
            (TextStyle::Button, font(13.0, FontFamily::Proportional)),
            (TextStyle::Heading, font(16.0, FontFamily::Proportional)),
            (TextStyle::Monospace, font(12.0, FontFamily::Monospace)),
        ]
        .into();
        style.spacing.item_spacing = vec2(8.0, 6.0);
        style.spacing.button_padding = vec2(8.0, 3.0);
        style.spacing.interact_size = vec2(36.0, 22.0);
        style.spacing.slider_width = 120.0;
        style.spacing.combo_width = 120.0;
        style.spacing.menu_margin = Margin::same(6);
        style.spacing.window_margin = Margin::same(14);
        style.interaction.tooltip_delay = 0.4;
        style.visuals = visuals();
    });
}

fn visuals() -> Visuals {
    let corner_radius = CornerRadius::same(4);
    let widget = |fill: Color32, text: Color32, border: Color32| WidgetVisuals {
        bg_fill: fill,
        weak_bg_fill: fill,
        bg_stroke: Stroke::new(1.0, border),
        corner_radius,
        fg_stroke: Stroke::new(1.0, text),
        expansion: 0.0,
    };
    let gray = Color32::from_gray;
    Visuals {
        widgets: Widgets {
            noninteractive: widget(PANEL, TEXT, LINE),
            inactive: widget(Color32::from_rgb(0x2a, 0x2d, 0x33), TEXT, Color32::TRANSPARENT),
            hovered: widget(Color32::from_rgb(0x35, 0x39, 0x41), STRONG, gray(0x50)),
            active: widget(Color32::from_rgb(0x40, 0x45, 0x4e), STRONG, ACCENT),
            open: widget(Color32::from_rgb(0x2f, 0x33, 0x3a), STRONG, LINE),
        },
        selection: Selection {
            bg_fill: Color32::from_rgb(0x2f, 0x5d, 0x82),
            stroke: Stroke::new(1.0, STRONG),
        },
        weak_text_color: Some(FAINT),
        hyperlink_color: ACCENT,
        faint_bg_color: Color32::from_rgb(0x20, 0x22, 0x27),
        extreme_bg_color: WELL,
        code_bg_color: WELL,
        warn_fg_color: WARNING,
        error_fg_color: ERROR,
        window_fill: Color32::from_rgb(0x1f, 0x22, 0x27),
        window_stroke: Stroke::new(1.0, gray(0x3c)),
        window_corner_radius: CornerRadius::same(8),
        menu_corner_radius: CornerRadius::same(6),
        window_shadow: Shadow { offset: [0, 6], blur: 24, spread: 0, color: Color32::from_black_alpha(120) },
        popup_shadow: Shadow { offset: [0, 4], blur: 12, spread: 0, color: Color32::from_black_alpha(110) },
        panel_fill: PANEL,
        ..Visuals::dark()
    }
}
