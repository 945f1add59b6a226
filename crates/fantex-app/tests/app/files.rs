//! Files that are painted with, and that change meanwhile.

use std::path::Path;

use eframe::egui::Modifiers;
use fantex::paint::StrokeLog;
use fantex::store::Asset;
use fantex::texture::Image;
use fantex_app::paint::{ColorSource, PaintTool, PenPhase, StencilSettings, StickerKind, TextureChoice};

use crate::painting::Studio;

/// A picture of one colour.
fn save_picture(path: &Path, side: u32) {
    let texels = vec![[1.0, 0.5, 0.0, 1.0]; (side * side) as usize];
    Image::from_linear_rgba(side, 2 * side, &[&texels[..], &texels[..]].concat()).save(path).unwrap();
}

#[test]
fn files_are_read_again_when_they_have_changed() {
    let mut studio = Studio::open();
    let at = |name: &str| studio.path.with_file_name(name);
    let (picture, look) = (at("picture.png"), at("look.toml"));
    std::fs::write(&picture, "no picture").unwrap();
    let stencil = StencilSettings { is_on: true, image: Some(picture.clone()), ..Default::default() };
    assert!(studio.painting.stencil(&stencil).is_err());
    save_picture(&picture, 8);
    let aspect = studio.painting.stencil(&stencil).unwrap().unwrap().aspect();
    assert_eq!(aspect, 0.5);
    std::fs::remove_file(&picture).unwrap();
    assert!(studio.painting.stencil(&stencil).is_err());

    std::fs::write(&look, "[textures.a]\nkind = \"wod\"\n").unwrap();
    let choice =
        TextureChoice { source: ColorSource::Look, look: Some(look.clone()), ..TextureChoice::default() };
    assert!(studio.painting.texture(&choice).is_err());
    std::fs::write(&look, "[textures.a]\nkind = \"wood\"\n").unwrap();
    assert_eq!(studio.painting.texture(&choice).unwrap().unwrap().name, "a");
    std::fs::write(&look, "[textures.other]\nkind = \"wood\"\n").unwrap();
    assert_eq!(studio.painting.texture(&choice).unwrap().unwrap().name, "other");
}

/// What lies on the surface is what was read when it was laid there.
#[test]
fn the_log_holds_the_picture_that_was_painted() {
    let mut studio = Studio::open();
    let picture = studio.path.with_file_name("picture.png");
    save_picture(&picture, 8);
    let painted = std::fs::read(&picture).unwrap();
    let settings = &mut studio.settings;
    (settings.tool, settings.sticker) = (PaintTool::Sticker, StickerKind::Picture);
    settings.picture = Some(picture.clone());
    studio.pen(PenPhase::Down, 0.5, 0.85, Modifiers::NONE);
    studio.pen(PenPhase::Up, 0.5, 0.85, Modifiers::NONE);
    studio.wait();
    save_picture(&picture, 16);
    assert!(std::fs::read(&picture).unwrap() != painted);
    studio.settings.sticker_degrees += 30.0;
    let Studio { painting, settings, view, notices, .. } = &mut studio;
    painting.follow_placing(settings, view, notices);
    assert!(painting.apply_placing());
    studio.wait();
    assert_eq!(crate::errors(&studio.notices), 0);
    let path = studio.path.clone();
    let folder = studio.close();
    let log = StrokeLog::of(&Asset::open(&path).unwrap()).unwrap();
    std::fs::create_dir(folder.path().join("log")).unwrap();
    log.save(&folder.path().join("log/strokes.json")).unwrap();
    let files = std::fs::read_dir(folder.path().join("log/files")).unwrap();
    let kept: Vec<Vec<u8>> = files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect();
    assert_eq!(kept, [painted]);
}
