//! What is asked before a model is painted on, before an asset is exported, and before a channel is removed.

use std::path::Path;

use eframe::egui::{Align2, Area, Id, Order, Rect, RichText, Ui, vec2};
use fantex::OwnLook;
use fantex::base::numbered;
use fantex::store::ChannelKind;

use super::bar::short_place;
use super::scene::card;
use super::widgets::{choice, hint, row};
use crate::export::{ExportSettings, Preset};
use crate::paint::{Answer, NewAsset, Question, channel_name};
use crate::text::grouped;
use crate::theme;
use crate::viewer::{Asked, Viewer};

/// Millions of texels to choose from.
const MILLIONS: [u64; 8] = [1, 2, 4, 8, 16, 32, 64, 128];

pub(super) fn show(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let Some(asked) = &mut viewer.asked else { return };
    if let Some(answer) = dialog(ui, "asked", rect, |ui| question(ui, asked)) {
        viewer.answer(answer);
    }
}

/// What is exported, and how far that is.
pub(super) fn exporting(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let Some(exporting) = &mut viewer.exporting else { return };
    let is_asked = exporting.is_asked();
    if !is_asked {
        ui.ctx().request_repaint_after_secs(0.1);
    }
    let (mut settings, share) = (exporting.settings.clone(), exporting.share());
    let answer = dialog(ui, "exporting", rect, |ui| {
        if is_asked {
            return export_choices(ui, &mut settings);
        }
        ui.horizontal(|ui| {
            ui.label(format!("Writing … {:.0} %", share * 100.0));
            ui.button("Cancel").clicked().then_some(false)
        })
        .inner
    });
    exporting.settings = settings.clone();
    match answer {
        Some(true) => viewer.choose_export(settings),
        Some(false) => viewer.command(crate::command::Command::Cancel),
        None => {}
    }
}

/// Whether a channel is to be removed.
pub(super) fn removal(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let Some(kind) = viewer.removal else { return };
    let sentence = viewer.removal_sentence(kind);
    let answer = dialog(ui, "removal", rect, |ui| {
        title(ui, format!("Remove {}", channel_name(kind)));
        ui.label(sentence);
        ui.horizontal(|ui| {
            let is_sure = ui.button("Remove the channel").clicked().then_some(true);
            is_sure.or(ui.button("Cancel").clicked().then_some(false))
        })
        .inner
    });
    match answer {
        Some(true) => viewer.remove_channels(&[kind]),
        Some(false) => viewer.removal = None,
        None => {}
    }
}

/// A card in the middle of `rect`, over what is there.
fn dialog<R>(ui: &Ui, id: &str, rect: Rect, contents: impl FnOnce(&mut Ui) -> R) -> R {
    let area = Area::new(Id::unique(id)).order(Order::Middle).fixed_pos(rect.center());
    let shown = area.pivot(Align2::CENTER_CENTER).show(ui.ctx(), |ui| {
        card().show(ui, |ui| {
            ui.set_width(380.0f32.min(rect.width() - 40.0));
            ui.spacing_mut().item_spacing = vec2(8.0, 6.0);
            contents(ui)
        })
    });
    shown.inner.inner
}

fn title(ui: &mut Ui, text: String) {
    ui.label(RichText::new(text).heading().color(theme::STRONG));
}

/// Whether it is exported, once that is said.
fn export_choices(ui: &mut Ui, settings: &mut ExportSettings) -> Option<bool> {
    title(ui, "Export".to_owned());
    let before = settings.preset;
    row(ui, "For", |ui| choice(ui, "export preset", &mut settings.preset, &Preset::ALL));
    if settings.preset != before {
        settings.points_down = settings.preset.points_down();
    }
    let mut sides = vec![(None, "as dense as the asset".to_owned())];
    sides.extend([512u32, 1024, 2048, 4096, 8192].map(|n| (Some(n), format!("{n} x {n}"))));
    row(ui, "Pictures", |ui| choice(ui, "export side", &mut settings.side, &sides));
    let has_normals = matches!(settings.preset, Preset::Unreal | Preset::Unity);
    ui.add_enabled_ui(has_normals, |ui| {
        let tip = "As DirectX has it: the green of the normal map is turned over";
        ui.checkbox(&mut settings.points_down, "Normals with -Y").on_hover_text(tip)
    });
    hint(ui, "Layers are exported as they are seen.");
    ui.horizontal(|ui| {
        let is_chosen = ui.button("Choose a file …").clicked().then_some(true);
        is_chosen.or(ui.button("Cancel").clicked().then_some(false))
    })
    .inner
}

fn name(path: &Path) -> String {
    short_place(&path.file_name().unwrap_or_default().to_string_lossy())
}

/// The answer, once there is one: none to leave it.
fn question(ui: &mut Ui, asked: &mut Asked) -> Option<Option<Answer>> {
    let model = short_place(&asked.place.name());
    match &asked.question {
        Question::New { asset, look } => {
            title(ui, format!("Paint on {model}"));
            hint(
                ui,
                &format!("It becomes the asset {} beside it; its own file stays as it is.", name(asset)),
            );
            new_asset(ui, &mut asked.new, look)
        }
        Question::Foreign { asset, triangles, texels, strokes } => {
            title(ui, format!("{} is of another mesh", name(asset)));
            let (count, noun) = (grouped(*strokes as u64), numbered(*strokes, "stroke"));
            let difference = difference(&model, *triangles);
            ui.label(format!("{difference} The asset has {count} {noun} in its log."));
            foreign_asset(ui, &mut asked.new, *texels)
        }
    }
}

/// What the asset of a model is to be like.
fn new_asset(ui: &mut Ui, new: &mut NewAsset, look: &OwnLook) -> Option<Option<Answer>> {
    let own = if look.is_limited { "as its textures repeat" } else { "as it has" };
    texel_row(ui, &mut new.texels, look.texels, own);
    hard_edges_row(ui, &mut new.hard_edges, "none, continuous everywhere");
    row(ui, "Channels", |ui| {
        ui.vertical(|ui| {
            let mut always = true;
            ui.add_enabled_ui(false, |ui| ui.checkbox(&mut always, "Colour, occlusion, roughness, metallic"));
            let mut channel = |kind, value: &mut bool, text| {
                let is_known = look.channels.contains(&kind);
                let mut shown = is_known || *value;
                ui.add_enabled_ui(!is_known, |ui| ui.checkbox(&mut shown, text));
                *value = shown && !is_known;
            };
            channel(ChannelKind::Emission, &mut new.emission, "Emission");
            channel(ChannelKind::Normal, &mut new.normal, "Normal");
            channel(ChannelKind::Displacement, &mut new.height, "Height");
        })
        .response
    });
    let mut answer = None;
    ui.horizontal(|ui| {
        if ui.button("Make and paint").clicked() {
            answer = Some(Some(Answer::New(new.clone())));
        }
        if ui.button("Cancel").clicked() {
            answer = Some(None);
        }
    });
    answer
}

/// How the meshes of a model and of the asset beside it differ.
fn difference(model: &str, triangles: [usize; 2]) -> String {
    let counted = |count: usize| format!("{} {}", grouped(count as u64), numbered(count as u64, "triangle"));
    match triangles.map(counted) {
        [ours, theirs] if ours != theirs => format!("{model} has {ours}, the asset's mesh {theirs}."),
        [both, _] => format!("{model} and the asset's mesh have {both}, but at other places."),
    }
}

/// What becomes of an asset of another mesh, which has so many texels.
fn foreign_asset(ui: &mut Ui, new: &mut NewAsset, texels: u64) -> Option<Option<Answer>> {
    texel_row(ui, &mut new.texels, Some(texels), "as it has");
    hard_edges_row(ui, &mut new.hard_edges, "as the asset");
    let mut answer = None;
    ui.horizontal_wrapped(|ui| {
        let tip = "Makes a new asset of the model and repeats the strokes at their places; the old one is kept under another name";
        if ui.button("Repeat the strokes on the new mesh").on_hover_text(tip).clicked() {
            let texels = new.texels.or(Some(texels));
            answer = Some(Some(Answer::Replay(NewAsset { texels, ..new.clone() })));
        }
        let tip = "The model's new shape is not seen";
        if ui.button("Paint on the old asset").on_hover_text(tip).clicked() {
            answer = Some(Some(Answer::Keep));
        }
        if ui.button("Cancel").clicked() {
            answer = Some(None);
        }
    });
    answer
}

/// `own`: how many it gets where none are chosen; and `why`.
fn texel_row(ui: &mut Ui, texels: &mut Option<u64>, own: Option<u64>, why: &str) {
    let first = own.map_or("8 million".into(), |own| format!("{:.1} million, {why}", own as f64 * 1e-6));
    let mut all = vec![(None, first)];
    let others = MILLIONS.into_iter().filter(|&n| own.is_some() || n != 8);
    all.extend(others.map(|n| (Some(n * 1_000_000), format!("{n} million"))));
    row(ui, "Texels", |ui| choice(ui, "new texels", texels, &all));
}

/// `own`: what it means where no angle is chosen.
fn hard_edges_row(ui: &mut Ui, degrees: &mut Option<f32>, own: &str) {
    let mut all = vec![(None, own.to_owned())];
    all.extend([30.0, 45.0, 60.0, 80.0].map(|angle| (Some(angle), format!("from {angle}° on"))));
    let tip = "Cuts the texture at edges whose two triangles' normals differ by at least so much, so that flat faces are sharper up to their edges. \
        It is not continuous across these.";
    row(ui, "Hard edges", |ui| choice(ui, "new hard edges", degrees, &all).on_hover_text(tip));
}
