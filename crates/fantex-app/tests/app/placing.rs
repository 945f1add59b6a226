//! Texts and pictures before they are applied: handles, live preview, applying, taking away.

use eframe::egui::Modifiers;
use fantex::glam::{DVec2, Vec4};
use fantex::paint::{PaintOptions, Painter, StrokeLog};
use fantex::store::{Asset, PageId, group_pages};
use fantex_app::paint::{LayerAction, PaintCommand, PaintTool, PenPhase, SymmetryKind, Viewpoint};

use crate::painting::Studio;

const FREE: Modifiers = Modifiers::NONE;

fn click(studio: &mut Studio, x: f64, y: f64) {
    studio.pen(PenPhase::Down, x, y, FREE);
    studio.pen(PenPhase::Up, x, y, FREE);
    follow(studio);
}

/// Lets frames go by until the painter shows what is placed.
fn follow(studio: &mut Studio) {
    for _ in 0..2 {
        studio.wait();
        let Studio { painting, settings, view, notices, .. } = studio;
        painting.follow_placing(settings, view, notices);
    }
    studio.wait();
}

fn drag(studio: &mut Studio, from: DVec2, to: DVec2) {
    studio.pen(PenPhase::Down, from.x, from.y, FREE);
    studio.pen(PenPhase::Move, to.x, to.y, FREE);
    studio.pen(PenPhase::Up, to.x, to.y, FREE);
    follow(studio);
}

fn with_sticker() -> Studio {
    let mut studio = Studio::open();
    studio.settings.tool = PaintTool::Sticker;
    studio.settings.text = "HH".into();
    studio.settings.brush.size = 60.0;
    studio
}

/// All that the file holds: pages of all levels, and attachments but for the log.
fn contents(path: &std::path::Path) -> Vec<(PageId, Vec<u8>)> {
    let painter = Painter::open(path, &PaintOptions::default()).unwrap();
    let asset = painter.editor().asset().clone();
    let mut all = Vec::new();
    for (g, group) in (0u32..).zip(&asset.cover().groups) {
        for page in group_pages(g, group) {
            let channels = 0..asset.channels().len();
            all.extend(channels.map(|c| (page, painter.editor().read_page_raw(c, page).unwrap())));
        }
    }
    all
}

#[test]
fn what_is_taken_away_leaves_nothing_and_what_is_applied_is_one_step() {
    let mut studio = with_sticker();
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    let path = studio.path.clone();
    click(&mut studio, 0.5, 0.85);
    assert!(studio.painting.is_placing());
    assert_eq!(studio.painting.snapshot.done, ["add layer"], "nothing is applied");
    // It is shown, at level 0 and above.
    let (shown, _) = studio.painting.exchange().take_fresh();
    assert!(shown.keys().any(|page| page.level == 0) && shown.keys().any(|page| page.level > 1));
    studio.painting.drop_placing();
    studio.wait();
    let (back, _) = studio.painting.exchange().take_fresh();
    for (page, texels) in &shown {
        assert!(back.get(page).is_some_and(|now| now != texels), "{page} shows what was there");
    }
    let folder = studio.close();
    let mut studio = Studio::open_at(folder, path.clone(), None);
    assert_eq!(studio.painting.snapshot.done, ["add layer"]);
    assert_eq!(StrokeLog::of(&Asset::open(&path).unwrap()).unwrap().strokes.strokes.len(), 1);
    studio.settings.tool = PaintTool::Sticker;
    click(&mut studio, 0.5, 0.85);
    studio.painting.command(&PaintCommand::Apply, &mut studio.settings);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done, ["add layer", "text and pictures"]);
    assert!(!studio.painting.is_placing());
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    assert_eq!(studio.painting.snapshot.done, ["add layer"]);
}

/// A closed window, and one that dies, leave what is not applied out of the file.
#[test]
fn what_is_not_applied_is_not_saved() {
    let mut studio = with_sticker();
    studio.stroke();
    studio.painting.drop_placing();
    studio.wait();
    let path = studio.path.clone();
    let folder = studio.close();
    let before = contents(&path);
    let mut studio = Studio::open_at(folder, path.clone(), None);
    studio.settings.tool = PaintTool::Sticker;
    click(&mut studio, 0.5, 0.85);
    std::thread::sleep(std::time::Duration::from_millis(2500));
    studio.wait();
    let copy = path.with_file_name("copy.fan");
    std::fs::copy(&path, &copy).unwrap();
    assert!(contents(&copy) == before, "the file as a crash leaves it");
    let _folder = studio.close();
    assert!(contents(&path) == before);
}

#[test]
fn characters_that_the_font_lacks_are_told_of() {
    let mut studio = with_sticker();
    let told = |studio: &Studio, words: &str| studio.notices.log().any(|text| text.contains(words));
    click(&mut studio, 0.5, 0.85);
    assert!(!told(&studio, "the font lacks"));
    studio.settings.text = "H\u{6f22}".into();
    follow(&mut studio);
    assert!(told(&studio, "the font lacks '\u{6f22}':"), "a text that is changed");
    studio.painting.drop_placing();
    studio.settings.text = "\u{5b57}".into();
    click(&mut studio, 0.5, 0.85);
    assert!(told(&studio, "the font lacks '\u{5b57}':"), "a text that is placed");
}

#[test]
fn handles_are_measured_in_points() {
    let mut studio = with_sticker();
    click(&mut studio, 0.5, 0.85);
    let ordinary = studio.painting.placing_outline(&studio.view).unwrap();
    studio.view = Viewpoint { pixels: [1000, 1000], pixels_per_point: 2.0, ..studio.view };
    assert_eq!(studio.painting.placing_outline(&studio.view).unwrap(), ordinary, "on a dense screen");
    // Twelve points beside a corner, outside the picture.
    let (_, _, size) = studio.painting.placing_place().unwrap();
    let outward = (ordinary.corners[1] - ordinary.middle).normalize();
    let beside = ordinary.corners[1] + outward * 12.0 / 500.0;
    drag(&mut studio, beside, ordinary.middle.lerp(beside, 0.5));
    let (_, _, half) = studio.painting.placing_place().unwrap();
    assert!((half / size - 0.5).abs() < 0.05, "the corner was not taken: {half} {size}");
}

#[test]
fn handles_move_scale_and_turn() {
    let mut studio = with_sticker();
    click(&mut studio, 0.5, 0.85);
    let outline = |studio: &Studio| studio.painting.placing_outline(&studio.view).unwrap();
    let (middle, first) = (outline(&studio).middle, outline(&studio));
    assert!(middle.distance(DVec2::new(0.5, 0.85)) < 0.01);
    // By the middle: it comes along.
    drag(&mut studio, DVec2::new(0.5, 0.85), DVec2::new(0.58, 0.84));
    assert!(outline(&studio).middle.distance(DVec2::new(0.58, 0.84)) < 0.01);
    let (_, degrees, size) = studio.painting.placing_place().unwrap();
    // By a corner: half as far from the middle is half as large.
    let corner = outline(&studio).corners[1];
    let middle = outline(&studio).middle;
    drag(&mut studio, corner, middle.lerp(corner, 0.5));
    let (_, turned, half) = studio.painting.placing_place().unwrap();
    assert!((half / size - 0.5).abs() < 0.02 && turned == degrees, "{half} {size}");
    assert!(
        (studio.settings.brush.size - 30.0).abs() < 1.0,
        "the brush follows: {}",
        studio.settings.brush.size
    );
    // By the knob, to the left of the middle: the picture's upper side comes there.
    let (knob, middle) = (outline(&studio).knob, outline(&studio).middle);
    let arm = knob - middle;
    drag(&mut studio, knob, middle + DVec2::new(-arm.length(), 0.0));
    let (_, turned, same) = studio.painting.placing_place().unwrap();
    let expected = -arm.angle_to(DVec2::NEG_X).to_degrees();
    let apart = (f64::from(turned - degrees) - expected + 180.0).rem_euclid(360.0) - 180.0;
    assert!(apart.abs() < 1.0 && (same - half).abs() < 1e-6, "{turned} {expected}");
    let arm = outline(&studio).knob - outline(&studio).middle;
    assert!(arm.normalize().dot(DVec2::NEG_X) > 0.95, "{arm}");
    assert_eq!(studio.settings.sticker_degrees, turned, "the panel shows it");
    // A press elsewhere on the surface brings it there; beside the model the view is turned.
    click(&mut studio, 0.5, 0.15);
    assert!(outline(&studio).middle.distance(DVec2::new(0.5, 0.15)) < 0.01);
    studio.pen(PenPhase::Down, 0.01, 0.01, FREE);
    assert!(studio.painting.is_turning());
    studio.pen(PenPhase::Up, 0.01, 0.01, FREE);
    assert!(first.outline.len() > 16 && studio.painting.snapshot.done.is_empty());
}

/// Alt may be held by the time at which the button is let go.
#[test]
fn what_is_let_go_does_not_follow_the_pointer() {
    let mut studio = with_sticker();
    click(&mut studio, 0.5, 0.85);
    studio.pen(PenPhase::Down, 0.5, 0.85, FREE);
    studio.pen(PenPhase::Move, 0.55, 0.84, FREE);
    studio.pen(PenPhase::Up, 0.55, 0.84, Modifiers::ALT);
    let middle = |studio: &Studio| studio.painting.placing_outline(&studio.view).unwrap().middle;
    let there = middle(&studio);
    studio.pen(PenPhase::Move, 0.62, 0.84, FREE);
    assert_eq!(middle(&studio), there);
}

/// What is applied is what was shown, and the log lays it again.
#[test]
fn the_preview_is_what_is_applied_with_colour_text_and_symmetry_as_they_are_by_then() {
    let mut studio = with_sticker();
    studio.settings.symmetry.kind = SymmetryKind::Mirror;
    click(&mut studio, 0.62, 0.84);
    studio.settings.text = "I".into();
    studio.settings.colors.foreground = [20, 200, 40];
    studio.settings.sticker_degrees = 30.0;
    follow(&mut studio);
    let finest = |studio: &Studio| -> Vec<_> {
        let (fresh, _) = studio.painting.exchange().take_fresh();
        fresh.into_iter().filter(|(page, _)| page.level == 0).collect()
    };
    let shown = finest(&studio);
    // Another tool applies it.
    studio.settings.tool = PaintTool::Paint;
    follow(&mut studio);
    assert_eq!(studio.painting.snapshot.done, ["text and pictures"]);
    let applied = finest(&studio);
    assert!(applied.iter().all(|page| shown.contains(page)), "applying changes nothing");
    let at = studio.view.hit(&studio.painting.surface, DVec2::new(0.62, 0.84)).unwrap();
    let path = studio.path.clone();
    let _folder = studio.close();
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    let color: Vec4 = painter.pick(0, at).unwrap();
    assert!(color.y > 2.0 * color.x && color.y > 2.0 * color.z, "{color}");
    let stroke = &StrokeLog::of(painter.editor().asset()).unwrap().strokes.strokes[0];
    let text = stroke.text.as_ref().unwrap();
    assert_eq!((text.text.as_str(), text.angle.abs().round()), ("I", 30.0));
}

#[test]
fn undo_takes_it_away_and_strokes_of_layers_apply_it() {
    let mut studio = with_sticker();
    click(&mut studio, 0.5, 0.85);
    studio.painting.command(&PaintCommand::Undo, &mut studio.settings);
    studio.wait();
    assert!(!studio.painting.is_placing());
    assert!(studio.painting.snapshot.done.is_empty() && studio.painting.snapshot.undone.is_empty());
    click(&mut studio, 0.5, 0.85);
    studio.painting.layer_action(&LayerAction::Add, &studio.settings).unwrap();
    studio.wait();
    assert_eq!(studio.painting.snapshot.done, ["text and pictures", "add layer"]);
    // A text that is empty for a moment stays as it is; one that cannot begin is told.
    click(&mut studio, 0.5, 0.85);
    studio.settings.text.clear();
    follow(&mut studio);
    assert!(studio.painting.is_placing());
    studio.painting.drop_placing();
    click(&mut studio, 0.5, 0.85);
    assert!(!studio.painting.is_placing());
    assert!(studio.notices.shown().any(|notice| notice.text.contains("There is no text")));
}

/// The painter shows it when it is ready; what is applied is where the window shows it.
#[test]
fn what_is_applied_lies_where_it_is_seen() {
    let mut studio = with_sticker();
    studio.settings.text = "I".into();
    studio.settings.colors.foreground = [20, 200, 40];
    click(&mut studio, 0.5, 0.85);
    let way = [(PenPhase::Down, 0.5), (PenPhase::Move, 0.54), (PenPhase::Move, 0.58), (PenPhase::Move, 0.62)];
    way.into_iter().for_each(|(phase, x)| studio.pen(phase, x, 0.84, FREE));
    let seen = studio.painting.placing_outline(&studio.view).unwrap().middle;
    studio.pen(PenPhase::Up, 0.62, 0.84, FREE);
    studio.painting.command(&PaintCommand::Apply, &mut studio.settings);
    studio.wait();
    let at = studio.view.hit(&studio.painting.surface, seen).unwrap();
    let path = studio.path.clone();
    let _folder = studio.close();
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    let color: Vec4 = painter.pick(0, at).unwrap();
    assert!(color.y > 2.0 * color.x && color.y > 2.0 * color.z, "{color}");
}
