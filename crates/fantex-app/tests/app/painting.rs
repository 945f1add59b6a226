//! Painting without a window: the pen draws, the worker paints, and what is to be shown is there.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::Modifiers;
use fantex::bake::{BakeOptions, NoProgress, SineSource, bake};
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::glam::DVec2;
use fantex::mesh::generate::torus;
use fantex::mesh::{CleanOptions, clean};
use fantex::paint::{BlendMode, LayerPlace, MaskMeasure, PaintOptions, Painter, Target, Tip};
use fantex::store::{Asset, ChannelKind, PageId, VerifyOptions, group_pages, verify};
use fantex::stream::{AtlasFormat, ParcelTexels};
use fantex::texture::color::{linear_from_srgb, srgb_from_linear};

use fantex_app::camera::ViewPreset;
use fantex_app::notices::Notices;
use fantex_app::paint::{
    Alone, BrushSettings, ColorSource, FillReach, GradientEnd, GradientSettings, GradientShape, LayerAction,
    PaintCommand, PaintSettings, PaintTool, Painting, PenEvent, PenPhase, PictureUse, Presets, SaveState,
    Section, StencilSettings, StencilUse, StickerKind, SymmetryKind, TextureChoice, Viewpoint,
};

/// A torus with 60 000 texels.
pub(crate) fn small_asset(folder: &Path) -> PathBuf {
    let path = folder.join("torus.fan");
    let (mesh, _) = clean(torus(48, 24), &CleanOptions::default()).unwrap();
    let options = CoverOptions { budget: TexelBudget::Total(60_000), ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    bake(&mesh, &cover, &SineSource { k: 9.0 }, &path, &BakeOptions::default(), &NoProgress).unwrap();
    path
}

/// The log of an asset, replayed onto a [`small_asset`].
fn replayed_log(of: &Path) -> (tempfile::TempDir, PathBuf) {
    let log = fantex::paint::StrokeLog::of(&Asset::open(of).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    assert_eq!(log.replay(&mut painter).unwrap().unrecorded, 0);
    painter.commit().unwrap();
    (folder, path)
}

pub(crate) struct Studio {
    pub(crate) path: PathBuf,
    pub(crate) painting: Painting,
    pub(crate) settings: PaintSettings,
    pub(crate) notices: Notices,
    pub(crate) view: Viewpoint,
    _folder: tempfile::TempDir,
}

impl Studio {
    pub(crate) fn open() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = small_asset(folder.path());
        Self::open_at(folder, path, None)
    }

    /// Without a picture.
    fn unseen() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = small_asset(folder.path());
        Self::of(folder, path, None, &[])
    }

    /// `limit`: bytes that the file may have.
    pub(crate) fn open_at(folder: tempfile::TempDir, path: PathBuf, limit: Option<u64>) -> Self {
        Self::of(folder, path, limit, &[AtlasFormat::Bc7])
    }

    /// `formats`: none where there is no picture.
    fn of(folder: tempfile::TempDir, path: PathBuf, limit: Option<u64>, formats: &[AtlasFormat]) -> Self {
        let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
        painter.limit_file(limit);
        let rig = ViewPreset::Top.rig(painter.surface().mesh(), 1.0);
        let painting = Painting::new(painter, None, Arc::new(|| {})).unwrap();
        if !formats.is_empty() {
            painting.exchange().set_formats(formats);
        }
        let mut studio = Self {
            path,
            painting,
            settings: PaintSettings::default(),
            notices: Notices::default(),
            view: Viewpoint { rig, pixels: [500, 500], pixels_per_point: 1.0 },
            _folder: folder,
        };
        studio.settings.brush.size = 30.0;
        studio.wait();
        studio
    }

    pub(crate) fn wait(&mut self) {
        let started = Instant::now();
        loop {
            let is_busy = self.painting.is_busy();
            self.painting.poll(&mut self.settings, &mut self.notices);
            if !is_busy {
                return;
            }
            assert!(started.elapsed() < fantex_test::PATIENCE, "the painter does not end");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    pub(crate) fn pen(&mut self, phase: PenPhase, x: f64, y: f64, modifiers: Modifiers) {
        let event = PenEvent { phase, at: DVec2::new(x, y), pressure: 1.0 };
        let Self { painting, settings, view, notices, .. } = self;
        painting.pen(&[event], settings, view, modifiers, notices);
    }

    pub(crate) fn stroke(&mut self) {
        self.pen(PenPhase::Down, 0.5, 0.85, Modifiers::NONE);
        self.pen(PenPhase::Move, 0.6, 0.84, Modifiers::NONE);
        self.pen(PenPhase::Up, 0.6, 0.84, Modifiers::NONE);
        self.wait();
    }

    pub(crate) fn close(self) -> tempfile::TempDir {
        drop(self.painting);
        self._folder
    }
}

#[test]
fn strokes_are_shown_at_all_levels_before_they_end_and_undone_after() {
    let mut studio = Studio::open();
    // Else the end of the stroke catches up with the hand.
    studio.settings.brush.smoothing = 0.0;
    studio.pen(PenPhase::Down, 0.5, 0.85, Modifiers::NONE);
    studio.pen(PenPhase::Move, 0.6, 0.84, Modifiers::NONE);
    studio.wait();
    assert!(studio.painting.is_drawing());
    let (fresh, stale) = studio.painting.exchange().take_fresh();
    assert!(stale.is_empty());
    let levels: std::collections::BTreeSet<u32> = fresh.keys().map(|page| page.level).collect();
    assert!(levels.contains(&0) && levels.len() > 2, "{levels:?}");
    let painted: Vec<_> = fresh.into_iter().collect();
    studio.pen(PenPhase::Up, 0.6, 0.84, Modifiers::NONE);
    studio.wait();
    // What was shown of coarser levels while the stroke was open is what is kept.
    let (kept, _) = studio.painting.exchange().take_fresh();
    for (page, texels) in painted.iter().filter(|(page, _)| page.level > 0) {
        assert!(kept.get(page) == Some(texels), "{page}");
    }
    assert_eq!(studio.painting.snapshot.done, ["paint"]);
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    // What an undo of several slices changes has to be asked for.
    let (undone, stale) = studio.painting.exchange().take_fresh();
    let is_undone = |(page, texels): &(PageId, ParcelTexels)| {
        stale.contains(page) || undone.get(page).is_some_and(|now| now != texels)
    };
    assert!(painted.iter().all(is_undone));
    assert_eq!(studio.painting.snapshot.undone, ["paint"]);
}

/// Sessions look at layers and steps once their painter has nothing to do.
#[test]
fn what_is_done_is_told_with_the_next_reports() {
    let mut studio = Studio::unseen();
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    while studio.painting.is_busy() {
        std::thread::yield_now();
    }
    assert!(!studio.painting.is_told() && studio.painting.snapshot.layers.is_empty());
    studio.painting.poll(&mut studio.settings, &mut studio.notices);
    assert!(studio.painting.is_told() && studio.painting.snapshot.layers.len() == 1);
}

#[test]
fn everything_is_saved_and_verified_and_comes_back() {
    let mut studio = Studio::open();
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    let Target::Layer(id) = studio.painting.target else { panic!("the new layer is painted on") };
    studio.stroke();
    studio.painting.layer_action(&LayerAction::Blend(id, BlendMode::Multiply), &studio.settings).unwrap();
    studio.painting.layer_action(&LayerAction::Rename(id, "Dirt".into()), &studio.settings).unwrap();
    studio.wait();
    let started = Instant::now();
    while studio.painting.save != SaveState::Saved {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it does not save by itself");
        std::thread::sleep(Duration::from_millis(20));
        studio.wait();
    }
    assert_eq!(crate::errors(&studio.notices), 0);
    let path = studio.path.clone();
    let before = std::fs::read(&path).unwrap();
    let folder = studio.close();
    assert!(std::fs::read(&path).unwrap() == before, "nothing is left to write");
    assert!(verify(&path, &VerifyOptions::default()).unwrap().ok);
    let mut studio = Studio::open_at(folder, path, None);
    let snapshot = &studio.painting.snapshot;
    assert_eq!(snapshot.done, ["add layer", "paint", "layer blend mode", "rename layer"]);
    assert_eq!((snapshot.layers[0].name.as_str(), snapshot.layers[0].blend), ("Dirt", BlendMode::Multiply));
    studio.painting.go_to_step(0);
    studio.wait();
    assert!(studio.painting.snapshot.layers.is_empty());
    assert_eq!(studio.painting.target, Target::Base);
}

#[test]
fn layers_are_dragged_copied_merged_and_seen_in_small() {
    let mut studio = Studio::open();
    for _ in 0..3 {
        studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
        studio.wait();
    }
    studio.stroke();
    let names = |studio: &Studio| -> Vec<String> {
        studio.painting.snapshot.layers.iter().map(|layer| layer.name.clone()).collect()
    };
    let ids: Vec<u64> = studio.painting.snapshot.layers.iter().map(|layer| layer.id()).collect();
    let act = |studio: &mut Studio, action: LayerAction| {
        studio.painting.layer_action(&action, &studio.settings).unwrap();
        studio.wait();
    };
    // A drag past two layers is seen on its way, and is one step.
    let steps = studio.painting.snapshot.done.len();
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Below(ids[1]), false));
    assert_eq!(names(&studio), ["Layer 1", "Layer 3", "Layer 2"]);
    act(&mut studio, LayerAction::MoveTo(ids[2], LayerPlace::Below(ids[0]), true));
    assert_eq!(names(&studio), ["Layer 3", "Layer 1", "Layer 2"]);
    assert_eq!(studio.painting.snapshot.done.len(), steps + 1);
    act(&mut studio, LayerAction::Duplicate(ids[2]));
    assert_eq!(names(&studio), ["Layer 3", "Layer 3 copy", "Layer 1", "Layer 2"]);
    let copy = studio.painting.snapshot.layers[1].id();
    assert_eq!(studio.painting.target, Target::Layer(copy), "the copy is chosen");
    // A mask is chosen when it is made.
    act(&mut studio, LayerAction::AddMask(copy, true));
    assert_eq!(studio.painting.target, Target::Mask(copy));
    act(&mut studio, LayerAction::InvertMask(copy));
    let slope = MaskMeasure::Slope { axis: 1 }.source();
    act(&mut studio, LayerAction::MakeMask(ids[0], Some(slope)));
    assert_eq!(studio.painting.target, Target::Mask(ids[0]));
    // Pictures come when nothing else is to be done: of the layer that was painted red on, and of the made mask.
    let started = Instant::now();
    let wanted = [Target::Base, Target::Layer(ids[2]), Target::Layer(copy), Target::Mask(ids[0])];
    while !wanted.iter().all(|of| studio.painting.thumbnails.contains_key(of)) {
        assert!(started.elapsed() < fantex_test::PATIENCE, "{:?}", studio.painting.thumbnails.keys());
        std::thread::sleep(Duration::from_millis(20));
        studio.wait();
    }
    let shown = |studio: &Studio, of: Target, is: fn(&[u8; 4]) -> bool| {
        studio.painting.thumbnails[&of].iter().filter(|pixel| is(pixel)).count()
    };
    let is_painted = |[r, g, b, a]: &[u8; 4]| *a == 255 && r.max(g).max(b) - r.min(g).min(b) > 40;
    assert!(shown(&studio, Target::Layer(ids[2]), is_painted) > 0);
    assert_eq!(shown(&studio, Target::Layer(ids[1]), is_painted), 0);
    let white = shown(&studio, Target::Mask(ids[0]), |pixel| pixel[0] > 200);
    let black = shown(&studio, Target::Mask(ids[0]), |pixel| pixel[0] < 50 && pixel[3] == 255);
    assert!(white > 50 && black > 50, "{white} {black}");
    // A mask alone is what the atlas is told.
    studio.painting.see_alone(Some(Alone::Mask(ids[0])));
    studio.wait();
    let (_, stale) = studio.painting.exchange().take_fresh();
    assert!(stale.len() > 10, "all is asked for anew");
    act(&mut studio, LayerAction::RemoveMask(ids[0]));
    assert_eq!(studio.painting.seen_alone, None, "there is none any more");
    act(&mut studio, LayerAction::RemoveMask(copy));
    act(&mut studio, LayerAction::MergeDown(copy));
    assert_eq!(names(&studio), ["Layer 3", "Layer 1", "Layer 2"]);
    assert_eq!(crate::errors(&studio.notices), 0);
    studio.painting.go_to_step(0);
    studio.wait();
    assert!(studio.painting.snapshot.layers.is_empty());
}

#[test]
fn a_full_disk_is_said_and_painting_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let bytes = std::fs::metadata(&path).unwrap().len();
    let mut studio = Studio::open_at(folder, path, Some(bytes));
    studio.stroke();
    let started = Instant::now();
    while !matches!(studio.painting.save, SaveState::Failed(_)) {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it does not say so");
        std::thread::sleep(Duration::from_millis(20));
        studio.wait();
    }
    assert!(studio.notices.log().any(|text| text.contains("disk is full")));
    studio.stroke();
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    let snapshot = &studio.painting.snapshot;
    assert_eq!((snapshot.done.len(), snapshot.undone.len()), (1, 1));
    assert_eq!(crate::errors(&studio.notices), 1, "it is said once");
}

#[test]
fn lines_colours_and_turning_are_told_apart() {
    let mut studio = Studio::open();
    // The hole of the torus.
    studio.pen(PenPhase::Down, 0.5, 0.5, Modifiers::NONE);
    assert!(studio.painting.is_turning() && !studio.painting.is_drawing());
    studio.pen(PenPhase::Up, 0.5, 0.5, Modifiers::NONE);
    studio.stroke();
    studio.pen(PenPhase::Down, 0.85, 0.5, Modifiers::SHIFT);
    assert!(!studio.painting.is_drawing(), "a line is done at once");
    studio.pen(PenPhase::Up, 0.85, 0.5, Modifiers::SHIFT);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done.len(), 2);
    let painted = studio.settings.colors.foreground;
    studio.settings.colors.foreground = [0; 3];
    studio.pen(PenPhase::Down, 0.55, 0.845, Modifiers::ALT);
    studio.wait();
    let picked = studio.settings.colors.foreground;
    assert!(picked.iter().zip(painted).all(|(a, b)| a.abs_diff(b) < 12), "{picked:?} {painted:?}");
}

#[test]
fn what_cannot_be_painted_is_said() {
    let mut studio = Studio::open();
    let said = |studio: &mut Studio, text: &str| {
        studio.stroke();
        assert!(studio.notices.log().any(|notice| notice.contains(text)), "{text}");
        assert!(studio.painting.snapshot.done.is_empty());
    };
    studio.settings.tool = PaintTool::Erase;
    said(&mut studio, "add a layer");
    studio.settings.tool = PaintTool::Clone;
    said(&mut studio, "Alt + click");
    studio.settings.tool = PaintTool::Paint;
    studio.settings.channels.color = false;
    said(&mut studio, "No channel");
}

#[test]
fn all_tools_paint_on_a_layer() {
    let mut studio = Studio::open();
    studio.painting.layer_action(&LayerAction::AddFill(false), &studio.settings).unwrap();
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    studio.stroke();
    studio.settings.symmetry.kind = SymmetryKind::Radial;
    for tool in [PaintTool::Blur, PaintTool::Smudge, PaintTool::Sticker, PaintTool::Erase] {
        studio.settings.tool = tool;
        studio.stroke();
    }
    studio.settings.tool = PaintTool::Clone;
    studio.pen(PenPhase::Down, 0.55, 0.845, Modifiers::ALT);
    studio.pen(PenPhase::Up, 0.55, 0.845, Modifiers::ALT);
    studio.stroke();
    studio.settings.tool = PaintTool::Fill;
    studio.stroke();
    studio.settings.fill = FillReach::Color;
    studio.stroke();
    studio.settings.tool = PaintTool::Gradient;
    studio.stroke();
    let done = &studio.painting.snapshot.done;
    assert_eq!(
        done[2..],
        ["paint", "blur", "smudge", "text and pictures", "erase", "clone", "fill", "fill", "gradient"],
        "{done:?}"
    );
    assert_eq!(crate::errors(&studio.notices), 0);
    let asset = Asset::open(&studio.path).unwrap();
    drop(studio);
    assert!(asset.generation() >= 1);
}

#[test]
fn the_mirror_s_line_lies_on_the_model() {
    let studio = Studio::open();
    let mut section = Section::default();
    section.follow(&studio.painting.surface, 0, 0.0);
    let seen = section.seen(&studio.painting.surface, &studio.view);
    assert_eq!(seen.len(), 2, "both sides of the ring");
    assert!(seen.iter().flatten().all(|p| p.x.abs() < 1e-9 && p.y > -1e-6), "seen from above");
    // A plane that moves all the time is followed within a while.
    let seen = seen.to_vec();
    assert!(section.update(&studio.painting.surface, 0, 0.0, &studio.view) && section.parts() == seen);
    let started = Instant::now();
    while !section.update(&studio.painting.surface, 0, 0.1, &studio.view) {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it stays behind");
    }
    assert!(section.parts().iter().flatten().all(|p| (p.x - 0.1).abs() < 1e-9));
    let is_current = section.update(&studio.painting.surface, 0, 0.2, &studio.view);
    let at = if is_current { 0.2 } else { 0.1 };
    assert!(section.parts().iter().flatten().all(|p| (p.x - at).abs() < 1e-9));
}

/// Left half white, right half transparent orange.
fn save_slide(folder: &Path) -> PathBuf {
    let texel = |i: usize| [1.0, 0.5, 0.0, if i % 32 < 16 { 1.0 } else { 0.0 }];
    let texels: Vec<[f32; 4]> = (0..32 * 32).map(texel).collect();
    let path = folder.join("slide.png");
    fantex::texture::Image::from_linear_rgba(32, 32, &texels).save(&path).unwrap();
    path
}

/// What is seen at a place of the picture, sRGB.
fn picked(studio: &mut Studio, x: f64, y: f64) -> [u8; 3] {
    let before = studio.settings.colors.foreground;
    let tool = std::mem::replace(&mut studio.settings.tool, PaintTool::Pick);
    studio.pen(PenPhase::Down, x, y, Modifiers::NONE);
    studio.pen(PenPhase::Up, x, y, Modifiers::NONE);
    studio.wait();
    studio.settings.tool = tool;
    std::mem::replace(&mut studio.settings.colors.foreground, before)
}

#[test]
fn a_picture_over_the_view_masks_colours_and_is_projected() {
    let mut studio = Studio::open();
    let slide = save_slide(studio.path.parent().unwrap());
    let [left, right] = [0.42, 0.58].map(|x| (x, 0.85));
    let before = [left, right].map(|(x, y)| picked(&mut studio, x, y));
    studio.settings.stencil = StencilSettings { is_on: true, image: Some(slide), ..Default::default() };
    studio.settings.brush =
        BrushSettings { size: 60.0, hardness: 1.0, flow: 1.0, smoothing: 0.0, ..Default::default() };
    studio.settings.colors.foreground = [0x20, 0x40, 0xf0];
    let swipe = |studio: &mut Studio| {
        studio.pen(PenPhase::Down, 0.4, 0.85, Modifiers::NONE);
        studio.pen(PenPhase::Move, 0.6, 0.85, Modifiers::NONE);
        studio.pen(PenPhase::Up, 0.6, 0.85, Modifiers::NONE);
        studio.wait();
        [left, right].map(|(x, y)| picked(studio, x, y))
    };
    let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 16);
    let found = swipe(&mut studio);
    assert!(near(found[0], [0x20, 0x40, 0xf0]), "{found:?}");
    assert!(near(found[1], before[1]), "{found:?} {before:?}");
    studio.settings.stencil.paints = StencilUse::Colors;
    studio.settings.stencil.place.mirrored = true;
    let found = swipe(&mut studio);
    assert!(near(found[1], [255, 188, 0]), "{found:?}");
    assert!(near(found[0], [0x20, 0x40, 0xf0]), "{found:?}");
    // All of it at once, from a place where there is no surface either.
    studio.settings.stencil.place.mirrored = false;
    let Studio { painting, settings, view, notices, .. } = &mut studio;
    painting.project(settings, view, notices);
    studio.wait();
    let far = picked(&mut studio, 0.12, 0.5);
    assert!(near(far, [255, 188, 0]), "{far:?}");
    assert_eq!(studio.painting.snapshot.done, ["paint", "paint", "project"]);
    assert_eq!(crate::errors(&studio.notices), 0);
    // Without a picture it says so.
    studio.settings.stencil.image = None;
    let Studio { painting, settings, view, notices, .. } = &mut studio;
    painting.project(settings, view, notices);
    assert!(studio.notices.log().any(|text| text.contains("choose one")));
    // All is in the log, and can be painted on another density.
    let path = studio.path.clone();
    let folder = studio.close();
    let log = fantex::paint::StrokeLog::of(&Asset::open(&path).unwrap()).unwrap();
    let mut again =
        Painter::open(&small_asset(tempfile::tempdir().unwrap().path()), &PaintOptions::default()).unwrap();
    let summary = log.replay(&mut again).unwrap();
    assert_eq!((summary.strokes, summary.unrecorded), (3, 0));
    drop(folder);
}

/// Who paints on at once gets the same as who waits between strokes.
#[test]
fn strokes_in_a_hurry_are_the_same() {
    let pages_after = |waits: bool| {
        let mut studio = Studio::open();
        studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
        studio.wait();
        studio.stroke();
        studio.painting.layer_action(&LayerAction::Select(Target::Base), &studio.settings).unwrap();
        studio.settings.brush.smoothing = 0.0;
        for i in 0..6 {
            // Under the layer, and across each other.
            let (x, y) = (0.35 + 0.05 * f64::from(i), 0.8 + 0.02 * f64::from(i % 3));
            studio.pen(PenPhase::Down, x, y, Modifiers::NONE);
            studio.pen(PenPhase::Move, x + 0.1, 0.85, Modifiers::NONE);
            studio.pen(PenPhase::Up, x + 0.1, 0.85, Modifiers::NONE);
            if waits {
                studio.wait();
            }
        }
        studio.wait();
        assert_eq!(studio.painting.snapshot.done.len(), 8);
        assert_eq!(crate::errors(&studio.notices), 0);
        let path = studio.path.clone();
        let _folder = studio.close();
        let painter = Painter::open(&path, &PaintOptions::default()).unwrap();
        let editor = painter.editor();
        let cover = editor.asset().shared_cover();
        let pages = (0u32..).zip(&cover.groups).flat_map(|(g, group)| group_pages(g, group));
        pages.map(|page| editor.read_page_raw(0, page).unwrap()).collect::<Vec<_>>()
    };
    assert!(pages_after(false) == pages_after(true));
}

#[test]
fn tips_shape_strokes_and_are_in_the_log() {
    let shown_with = |tip: Option<Tip>| {
        let mut studio = Studio::open();
        studio.settings.brush.tip = tip;
        studio.stroke();
        assert_eq!(crate::errors(&studio.notices), 0);
        let shown = studio.painting.exchange().take_fresh().0;
        let path = studio.path.clone();
        let _folder = studio.close();
        let log = fantex::paint::StrokeLog::of(&Asset::open(&path).unwrap()).unwrap();
        assert_eq!(log.strokes.strokes[0].brush.tip, tip);
        shown
    };
    let round = shown_with(None);
    let chalk = shown_with(Some(Tip::Chalk));
    assert!(chalk == shown_with(Some(Tip::Chalk)), "the same each time");
    assert!(chalk != round && chalk != shown_with(Some(Tip::Sponge)));
}

#[test]
fn what_the_hand_does_is_in_the_log() {
    let mut studio = Studio::open();
    studio.settings.texture = TextureChoice { source: ColorSource::Solid, scale: 0.4, ..Default::default() };
    studio.settings.symmetry.kind = SymmetryKind::Mirror;
    studio.stroke();
    studio.settings.tool = PaintTool::Fill;
    studio.settings.fill = FillReach::Color;
    studio.stroke();
    studio.settings.tool = PaintTool::Sticker;
    studio.stroke();
    studio.painting.apply_placing();
    studio.settings.sticker = StickerKind::Picture;
    studio.settings.picture = Some(save_slide(studio.path.parent().unwrap()));
    studio.stroke();
    studio.settings.tool = PaintTool::Clone;
    studio.pen(PenPhase::Down, 0.15, 0.5, Modifiers::ALT);
    studio.pen(PenPhase::Up, 0.15, 0.5, Modifiers::ALT);
    studio.stroke();
    studio.settings.tool = PaintTool::Gradient;
    studio.settings.gradient.end = GradientEnd::Nothing;
    studio.settings.brush.opacity = 0.5;
    studio.settings.fill = FillReach::Whole;
    studio.stroke();
    assert_eq!(studio.painting.snapshot.done.len(), 6);
    let all = |studio: &mut Studio| {
        let places = [(0.5, 0.85), (0.6, 0.84), (0.45, 0.82), (0.3, 0.75), (0.55, 0.86)];
        places.map(|(x, y)| picked(studio, x, y))
    };
    let found = all(&mut studio);
    let path = studio.path.clone();
    let _folder = studio.close();
    let (folder, path) = replayed_log(&path);
    let mut studio = Studio::open_at(folder, path, None);
    let replayed = all(&mut studio);
    for (a, b) in found.iter().zip(&replayed) {
        assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) < 24), "{found:?} {replayed:?}");
    }
}

#[test]
fn gradients_mix_light_by_the_way_along_the_drag() {
    let mut studio = Studio::open();
    studio.settings.fill = FillReach::Whole;
    // All that lies highest is as deep in the picture as where the drag begins.
    let mesh = studio.painting.surface.mesh();
    let top = mesh.positions.iter().map(|p| p.y).fold(f32::MIN, f32::max);
    let crest = mesh.positions.iter().filter(|p| p.y > top - 1e-4);
    let crest = crest.map(|&p| studio.view.project(mesh.world_from_mesh.point(p)).unwrap());
    let crest: Vec<DVec2> = crest.collect();
    assert!(crest.len() > 40);
    let begin = crest.iter().copied().min_by(|a, b| a.x.total_cmp(&b.x)).unwrap();
    let end = DVec2::new(0.8, 0.35);
    let (white, red, blue) = ([255; 3], [200, 30, 10], [20, 60, 220]);
    let mut lay = |gradient: GradientSettings, ground: [u8; 3]| {
        studio.settings.tool = PaintTool::Fill;
        studio.settings.colors.foreground = ground;
        studio.stroke();
        studio.settings.tool = PaintTool::Gradient;
        (studio.settings.gradient, studio.settings.colors.background) = (gradient, blue);
        studio.settings.colors.foreground = red;
        studio.pen(PenPhase::Down, begin.x, begin.y, Modifiers::NONE);
        studio.pen(PenPhase::Move, 0.5, 0.9, Modifiers::NONE);
        assert_eq!(studio.painting.gradient_line(), Some([begin, DVec2::new(0.5, 0.9)]));
        studio.pen(PenPhase::Up, end.x, end.y, Modifiers::NONE);
        studio.wait();
        crest.iter().step_by(3).map(|at| (*at, picked(&mut studio, at.x, at.y))).collect::<Vec<_>>()
    };
    let check = |found: &[(DVec2, [u8; 3])], last: [u8; 3], share: &dyn Fn(DVec2) -> f64| {
        for (at, color) in found {
            let share = share(*at).clamp(0.0, 1.0) as f32;
            for k in 0..3 {
                let [a, b] = [red[k], last[k]].map(|c| linear_from_srgb(f32::from(c) / 255.0));
                let expected = 255.0 * srgb_from_linear(a + (b - a) * share);
                assert!((f32::from(color[k]) - expected).abs() < 6.0, "{at} {color:?}[{k}] {expected}");
            }
        }
    };
    let along = end - begin;
    let straight = |at: DVec2| (at - begin).dot(along) / along.length_squared();
    let found = lay(GradientSettings::default(), white);
    check(&found, blue, &straight);
    let round = GradientSettings { shape: GradientShape::Round, end: GradientEnd::Nothing, is_smooth: true };
    let found = lay(round, white);
    let smooth = |at: DVec2| {
        let t = ((at - begin).length() / along.length()).min(1.0);
        t * t * (3.0 - 2.0 * t)
    };
    check(&found, white, &smooth);
    // A click is no drag, and Esc or another tool gives one up.
    let done = studio.painting.snapshot.done.len();
    studio.pen(PenPhase::Down, begin.x, begin.y, Modifiers::NONE);
    studio.pen(PenPhase::Up, begin.x, begin.y, Modifiers::NONE);
    assert!(studio.notices.log().any(|notice| notice.contains("drag from where")));
    studio.pen(PenPhase::Down, begin.x, begin.y, Modifiers::NONE);
    assert!(studio.painting.drop_placing());
    studio.pen(PenPhase::Up, end.x, end.y, Modifiers::NONE);
    studio.pen(PenPhase::Down, begin.x, begin.y, Modifiers::NONE);
    studio.settings.tool = PaintTool::Fill;
    studio.pen(PenPhase::Up, end.x, end.y, Modifiers::NONE);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done.len(), done);
}

/// A torus with 3 000 000 texels.
fn large_asset(folder: &Path) -> PathBuf {
    let path = folder.join("large.fan");
    let (mesh, _) = clean(torus(96, 48), &CleanOptions::default()).unwrap();
    let options = CoverOptions { budget: TexelBudget::Total(3_000_000), tile: 64, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    bake(&mesh, &cover, &SineSource { k: 9.0 }, &path, &BakeOptions::default(), &NoProgress).unwrap();
    path
}

/// Waits until a share of what takes long is done.
fn wait_for_work(studio: &mut Studio) {
    let started = Instant::now();
    while studio.painting.work.as_ref().is_none_or(|work| work.share < 0.1) {
        assert!(started.elapsed() < fantex_test::PATIENCE && studio.painting.is_busy(), "it is told of");
        studio.painting.poll(&mut studio.settings, &mut studio.notices);
        studio.painting.look_from(&studio.view);
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Each of them is told of, can be given up, and goes on where it was when the program was closed.
#[test]
fn fills_and_projections_are_told_of_given_up_and_taken_up_again() {
    let fill: fn(&mut Studio) = |studio| {
        (studio.settings.tool, studio.settings.fill) = (PaintTool::Fill, FillReach::Whole);
        studio.pen(PenPhase::Down, 0.5, 0.85, Modifiers::NONE);
        studio.pen(PenPhase::Up, 0.5, 0.85, Modifiers::NONE);
    };
    let project: fn(&mut Studio) = |studio| {
        let image = Some(save_slide(studio.path.parent().unwrap()));
        studio.settings.stencil = StencilSettings { is_on: true, image, ..Default::default() };
        let Studio { painting, settings, view, notices, .. } = studio;
        painting.project(settings, view, notices);
    };
    for (begin, label) in [(fill, "fill"), (project, "project")] {
        let folder = tempfile::tempdir().unwrap();
        let path = large_asset(folder.path());
        let mut studio = Studio::open_at(folder, path.clone(), None);
        let before = picked(&mut studio, 0.3, 0.75);
        begin(&mut studio);
        wait_for_work(&mut studio);
        studio.painting.give_up_work();
        studio.wait();
        assert!(studio.painting.work.is_none() && studio.painting.snapshot.done.is_empty());
        assert_eq!(picked(&mut studio, 0.3, 0.75), before);
        // Closed in the middle of it, it goes on when it is opened again.
        begin(&mut studio);
        wait_for_work(&mut studio);
        let folder = studio.close();
        assert!(verify(&path, &VerifyOptions::default()).unwrap().ok);
        let mut studio = Studio::open_at(folder, path, None);
        assert_eq!(studio.painting.snapshot.done, [label]);
        assert_ne!(picked(&mut studio, 0.3, 0.75), before);
        studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
        studio.wait();
        assert_eq!(picked(&mut studio, 0.3, 0.75), before);
        assert_eq!(crate::errors(&studio.notices), 0);
    }
}

/// With *Alt turns*, `Alt` + drag turns the view, `Alt` + click picks, and strokes begin where they meet the model.
#[test]
fn alt_turns_and_strokes_begin_beside_the_model() {
    let mut studio = Studio::open();
    studio.settings.alt_turns = true;
    let outside = |studio: &mut Studio, phase| studio.pen(phase, 0.02, 0.85, Modifiers::NONE);
    outside(&mut studio, PenPhase::Down);
    assert!(!studio.painting.is_turning() && !studio.painting.is_drawing());
    studio.pen(PenPhase::Move, 0.5, 0.85, Modifiers::NONE);
    assert!(studio.painting.is_drawing());
    studio.pen(PenPhase::Up, 0.5, 0.85, Modifiers::NONE);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done, ["paint"]);
    assert_eq!(studio.painting.missed_for(0.0), None);
    // One that does not meet it is told of.
    outside(&mut studio, PenPhase::Down);
    outside(&mut studio, PenPhase::Up);
    assert!(studio.painting.missed_for(1.0).is_some());
    // A click with a little shake picks, a drag turns and picks nothing.
    for (shift, is_click) in [(0.001, true), (0.1, false)] {
        studio.settings.colors.foreground = [0; 3];
        studio.pen(PenPhase::Down, 0.5, 0.85, Modifiers::ALT);
        studio.pen(PenPhase::Move, 0.5 + shift, 0.85, Modifiers::ALT);
        assert!(studio.painting.is_turning() && !studio.painting.is_drawing());
        // Coming back is no click.
        studio.pen(PenPhase::Move, 0.5, 0.85, Modifiers::ALT);
        studio.pen(PenPhase::Up, 0.5, 0.85, Modifiers::ALT);
        studio.wait();
        let picked = studio.settings.colors.foreground;
        // The dab is as small as the texels: what is picked is between its red and the grey around.
        let is_reddish = picked[0] > 200 && picked[1] < 160;
        assert!(if is_click { is_reddish } else { picked == [0; 3] }, "{shift}: {picked:?}");
    }
    assert_eq!(studio.painting.snapshot.done, ["paint"]);
}

/// Why nothing is painted is told for a while, and no longer once the pen meets the model.
#[test]
fn a_stroke_beside_the_model_is_told_of() {
    let mut studio = Studio::open();
    assert_eq!(studio.painting.missed_for(0.0), None);
    studio.pen(PenPhase::Down, 0.02, 0.02, Modifiers::NONE);
    assert!(studio.painting.is_turning() && studio.painting.missed_for(100.0).is_some(), "while it is down");
    studio.pen(PenPhase::Up, 0.02, 0.02, Modifiers::NONE);
    assert!(studio.painting.missed_for(1.0).is_some_and(|left| left < 4.0));
    assert_eq!(studio.painting.missed_for(100.0), None);
    // Where a kept picture lies over the model the view is turned, and there is nothing to tell.
    studio.pen(PenPhase::Turn, 0.5, 0.85, Modifiers::NONE);
    assert!(studio.painting.is_turning());
    studio.pen(PenPhase::Up, 0.6, 0.85, Modifiers::NONE);
    studio.stroke();
    assert_eq!(studio.painting.missed_for(1.0), None);
    assert_eq!(studio.painting.snapshot.done, ["paint"]);
}

#[test]
fn a_fill_of_everything_is_told_of_given_up_and_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = large_asset(folder.path());
    let mut studio = Studio::open_at(folder, path.clone(), None);
    studio.settings.texture = TextureChoice { source: ColorSource::Solid, ..Default::default() };
    let start = |studio: &mut Studio| {
        studio.painting.layer_action(&LayerAction::AddFill(true), &studio.settings).unwrap();
        wait_for_work(studio);
    };
    start(&mut studio);
    // Meanwhile the layer is there, and a stroke waits.
    assert_eq!(studio.painting.snapshot.layers.len(), 1);
    studio.painting.give_up_work();
    studio.wait();
    assert!(studio.painting.work.is_none() && studio.painting.snapshot.layers.is_empty());
    assert_eq!((studio.painting.snapshot.done.len(), studio.painting.snapshot.undone.len()), (0, 0));
    // Closed in the middle of it, it goes on when it is opened again.
    start(&mut studio);
    let folder = studio.close();
    assert!(verify(&path, &VerifyOptions::default()).unwrap().ok);
    let mut studio = Studio::open_at(folder, path, None);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done, ["add layer"]);
    assert_eq!(studio.painting.target, Target::Layer(studio.painting.snapshot.layers[0].id()));
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    assert!(studio.painting.snapshot.layers.is_empty());
    assert_eq!(crate::errors(&studio.notices), 0);
}

/// A picture is laid as a normal map or as height; without such a channel it is told how to get one. The log lays it again.
#[test]
fn pictures_are_laid_as_normals_and_heights() {
    let mut studio = Studio::open();
    studio.settings.tool = PaintTool::Sticker;
    studio.settings.sticker = StickerKind::Picture;
    studio.settings.picture_use = PictureUse::Normal;
    studio.stroke();
    assert!(studio.painting.snapshot.done.is_empty());
    assert!(studio.notices.shown().any(|notice| notice.text.contains("Add channel")));
    let path = studio.path.clone();
    let folder = studio.close();
    let kinds = [ChannelKind::Normal, ChannelKind::Displacement];
    Painter::open(&path, &PaintOptions::default()).unwrap().add_channels(&kinds).unwrap();
    // Slopes by half to the right everywhere; half a step up.
    let [slope, height] =
        [("slope.png", [0.75, 0.5, 0.86]), ("height.png", [0.8; 3])].map(|(name, numbers)| {
            let file = folder.path().join(name);
            let [r, g, b] = numbers.map(fantex::base::srgb::linear_from_srgb);
            let texels = [[r, g, b, 1.0]; 64];
            fantex::texture::Image::from_linear_rgba(8, 8, &texels).save(&file).unwrap();
            file
        });
    let mut studio = Studio::open_at(folder, path.clone(), None);
    studio.settings.tool = PaintTool::Sticker;
    studio.settings.sticker = StickerKind::Picture;
    studio.settings.brush.size = 120.0;
    let switches = studio.settings.channels;
    let at = studio.view.hit(&studio.painting.surface, DVec2::new(0.5, 0.85)).unwrap();
    for (file, picture_use) in [(slope, PictureUse::Normal), (height, PictureUse::Height)] {
        studio.settings.picture = Some(file);
        studio.settings.picture_use = picture_use;
        studio.pen(PenPhase::Down, 0.5, 0.85, Modifiers::NONE);
        studio.pen(PenPhase::Up, 0.5, 0.85, Modifiers::NONE);
        studio.painting.apply_placing();
        studio.wait();
    }
    assert_eq!(studio.settings.channels, switches, "what the brush paints stays");
    assert_eq!(studio.painting.snapshot.done.len(), 2);
    let _folder = studio.close();
    let values = |path: &Path| Painter::open(path, &PaintOptions::default()).unwrap().pick_all(at).unwrap();
    let found = values(&path);
    let count = found.len();
    // A flat part: the normal leans by half, whatever way the tile lies.
    let leaning = (2.0 * found[count - 2].truncate().truncate() - 1.0).length();
    assert!((leaning - 0.5).abs() < 0.1, "{leaning} {found:?}");
    assert!((found[count - 1].x - 0.8).abs() < 0.02, "{found:?}");
    let (_replayed, path) = replayed_log(&path);
    let replayed = values(&path);
    assert!(
        (0..count).all(|k| (found[k] - replayed[k]).abs().max_element() < 0.05),
        "{found:?} {replayed:?}"
    );
}

/// Whatever the brush else paints; on the base and on layers, not on masks. The log repeats it.
#[test]
fn opacity_is_painted_alone() {
    let mut studio = Studio::open();
    (studio.settings.tool, studio.settings.channels.color) = (PaintTool::Opacity, false);
    studio.settings.brush.flow = 1.0;
    studio.stroke();
    assert_eq!(studio.painting.snapshot.done, ["opacity"]);
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    let layer = studio.painting.snapshot.layers[0].id();
    studio.painting.layer_action(&LayerAction::AddMask(layer, true), &studio.settings).unwrap();
    studio.wait();
    let steps = studio.painting.snapshot.done.len();
    studio.stroke();
    assert_eq!(studio.painting.snapshot.done.len(), steps);
    assert!(studio.notices.shown().any(|notice| notice.text.contains("A mask has no opacity")));
    let at = studio.view.hit(&studio.painting.surface, DVec2::new(0.55, 0.845)).unwrap();
    let path = studio.path.clone();
    let _folder = studio.close();
    let value = |path: &Path| Painter::open(path, &PaintOptions::default()).unwrap().pick(0, at).unwrap();
    let (_replayed, again) = replayed_log(&path);
    let fresh = tempfile::tempdir().unwrap();
    let plain = small_asset(fresh.path());
    let [painted, again, plain] = [&path, &again, &plain].map(|path| value(path));
    assert!(painted.w < 0.1 && plain.w > 0.99, "{painted} {plain}");
    assert!((painted - plain).truncate().abs().max_element() < 0.05, "{painted} {plain}");
    assert!((painted - again).abs().max_element() < 0.05, "{painted} {again}");
}

/// While the picture is still being prepared nobody says in which formats pages are wanted.
#[test]
fn what_changes_before_there_is_a_picture_is_asked_for() {
    let mut studio = Studio::unseen();
    studio.stroke();
    let (fresh, stale) = studio.painting.exchange().take_fresh();
    assert!(fresh.is_empty() && stale.iter().any(|page| page.level == 0));
}

/// A state that is told in between has no mask yet.
#[test]
fn a_new_mask_is_chosen_once_it_is_there() {
    let mut studio = Studio::open();
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    let Target::Layer(id) = studio.painting.target else { panic!("the new layer is painted on") };
    studio.painting.layer_action(&LayerAction::Rename(id, "Dirt".into()), &studio.settings).unwrap();
    studio.painting.layer_action(&LayerAction::AddMask(id, true), &studio.settings).unwrap();
    studio.wait();
    assert_eq!(studio.painting.target, Target::Mask(id));
}

/// Two windows that were opened before either keeps a brush.
#[test]
fn brushes_of_all_windows_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("brushes.json");
    let first = small_asset(folder.path());
    let second = folder.path().join("second.fan");
    std::fs::copy(&first, &second).unwrap();
    let mut notices = Notices::default();
    let mut windows = [first, second].map(|path| {
        let painter = Painter::open(&path, &PaintOptions::default()).unwrap();
        Painting::new(painter, Some(file.clone()), Arc::new(|| {})).unwrap()
    });
    windows.iter_mut().for_each(|window| window.load_presets(&mut notices));
    let mut settings = PaintSettings::default();
    for (window, name) in windows.iter_mut().zip(["Moss", "Rust"]) {
        settings.brush.name = name.into();
        window.keep_brush(&settings, &mut notices);
    }
    let kept = || {
        let brushes = Presets::load(&file).unwrap().brushes;
        ["Moss", "Rust"].map(|name| brushes.iter().any(|brush| brush.name == name))
    };
    assert_eq!(kept(), [true; 2]);
    windows[0].drop_brush("Rust", &mut notices);
    assert_eq!(kept(), [true, false]);
    assert_eq!(crate::errors(&notices), 0);
}
