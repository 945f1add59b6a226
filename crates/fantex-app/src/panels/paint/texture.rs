//! What the base colour comes from: the foreground, a pattern in space, a texture of a look.

use eframe::egui::{
    Button, Color32, ColorImage, CornerRadius, Rect, RichText, Sense, Stroke, StrokeKind, TextureHandle,
    TextureOptions, Ui, pos2, vec2,
};

use crate::paint::{ColorSource, SOLIDS, TextureChoice};
use crate::panels::widgets::{NumberRow, named_choice, row, segments};
use crate::theme;
use crate::viewer::{Request, Viewer};

/// Texels of the preview.
const PREVIEW: [usize; 2] = [124, 40];

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let choice = &mut viewer.settings.paint.texture;
    let sources = ui.horizontal(|ui| segments(ui, &mut choice.source, &ColorSource::ALL, ColorSource::label));
    sources.response.on_hover_text("What is painted with: a colour, a pattern in space, a texture of a look");
    let mut asks_file = false;
    match choice.source {
        ColorSource::Color => return,
        ColorSource::Solid => solid(ui, choice),
        ColorSource::Look => asks_file = look(ui, choice),
    }
    preview(ui, viewer);
    if asks_file {
        viewer.request(Request::LookDialog);
    }
}

fn solid(ui: &mut Ui, choice: &mut TextureChoice) {
    let mut now = SOLIDS.into_iter().find(|name| *name == choice.solid).unwrap_or(SOLIDS[0]);
    ui.horizontal(|ui| {
        named_choice(ui, "Pattern", &mut now, &SOLIDS, |name| {
            format!("{}{}", name[..1].to_uppercase(), &name[1..])
        });
    });
    if now != choice.solid {
        choice.solid = now.to_owned();
    }
    let scale = NumberRow {
        name: "Scale",
        decimals: 2,
        is_logarithmic: true,
        tip: "Size of the pattern; 1 fits the model",
        ..NumberRow::PLAIN
    };
    scale.show(ui, &mut choice.scale, 0.02..=10.0);
    let seed =
        NumberRow { name: "Seed", decimals: 0, tip: "Another seed is another piece", ..NumberRow::PLAIN };
    seed.show(ui, &mut choice.seed, 0..=99);
}

/// Returns whether another file is wanted.
fn look(ui: &mut Ui, choice: &mut TextureChoice) -> bool {
    let name = choice.look.as_ref().and_then(|path| path.file_name());
    let name = name.map_or("Choose …".into(), |name| name.to_string_lossy().into_owned());
    let is_asked = row(ui, "Look", |ui| {
        ui.add(Button::new(name).truncate()).on_hover_text("A look: a TOML file with textures")
    })
    .clicked();
    let names = known_names(ui, choice);
    if !names.is_empty() {
        let places: Vec<usize> = (0..names.len()).collect();
        let mut at = names.iter().position(|name| *name == choice.name).unwrap_or(0);
        ui.horizontal(|ui| named_choice(ui, "Texture", &mut at, &places, |at| names[at].clone()));
        if choice.name != names[at] {
            choice.name.clone_from(&names[at]);
        }
    }
    is_asked
}

/// The names of the look's textures; read once per file.
fn known_names(ui: &Ui, choice: &TextureChoice) -> Vec<String> {
    let id = ui.scope_id().with("names of textures");
    let known = ui.data(|data| data.get_temp::<(TextureChoice, Vec<String>)>(id));
    let key = TextureChoice { look: choice.look.clone(), ..TextureChoice::default() };
    if let Some((_, names)) = known.filter(|(of, _)| *of == key) {
        return names;
    }
    // What is wrong with it is said by the preview.
    let graph = choice.graph().ok().flatten();
    let names = graph.and_then(|(graph, _)| graph.names().ok()).unwrap_or_default();
    ui.data_mut(|data| data.insert_temp(id, (key, names.clone())));
    names
}

/// A piece of the texture, or what is wrong with it.
fn preview(ui: &mut Ui, viewer: &mut Viewer) {
    let choice = viewer.settings.paint.texture.clone();
    let Some(painting) = &mut viewer.painting else { return };
    let made = match painting.texture(&choice) {
        Ok(made) => made,
        Err(reason) => {
            ui.label(RichText::new(reason).small().color(theme::WARNING));
            return;
        }
    };
    let Some(made) = made else { return };
    let id = ui.scope_id().with("texture preview");
    let known = ui.data(|data| data.get_temp::<(TextureChoice, TextureHandle)>(id));
    let texture = match known.filter(|(of, _)| *of == choice) {
        Some((_, texture)) => texture,
        None => {
            let pixels = made.preview(painting.surface(), PREVIEW);
            let pixels = pixels.into_iter().map(|[r, g, b]| Color32::from_rgb(r, g, b)).collect();
            let image = ColorImage::new(PREVIEW, pixels);
            let texture = ui.ctx().load_texture("texture preview", image, TextureOptions::LINEAR);
            ui.data_mut(|data| data.insert_temp(id, (choice, texture.clone())));
            texture
        }
    };
    let (rect, response) =
        ui.allocate_exact_size(vec2(2.0 * PREVIEW[0] as f32, 2.0 * PREVIEW[1] as f32), Sense::hover());
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    let edge = Stroke::new(1.0, theme::LINE);
    ui.painter().rect_stroke(rect, CornerRadius::same(2), edge, StrokeKind::Inside);
    response.on_hover_text("A slanting cut through the model's middle, as wide as the model");
}
