//! Exports for other programs.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use fantex::Mesh;
use fantex::bake::{NoProgress, Progress};
use fantex::glam::DVec2;
use fantex::mesh::generate::torus;
use fantex::paint::{PaintOptions, Painter};
use fantex::store::{Asset, VerifyOptions, group_pages, verify};
use fantex::texture::{Image, Samples};
use fantex_app::camera::ViewPreset;
use fantex_app::command::Command;
use fantex_app::document::{Document, Place};
use fantex_app::export::{ExportSettings, Preset, export};
use fantex_app::paint::{LayerAction, NewAsset, PenEvent, PenPhase, bake_model};
use fantex_app::viewer::{FileDialog, Request, SceneInput, Viewer};

use crate::panels::{empty, wait_painted, with_painting};

fn texels(path: &Path) -> (usize, Vec<u8>) {
    let image = Image::load(path).unwrap();
    let Samples::U8(samples) = image.samples else { panic!("not 8 bits") };
    (image.channels as usize, samples)
}

#[test]
fn presets_write_what_programs_want() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mesh = Mesh::from_model(torus(24, 12), "torus").unwrap();
    let new = NewAsset { texels: Some(20_000), normal: true, ..NewAsset::default() };
    bake_model(&mesh, &new, &at("torus.fan"), &NoProgress).unwrap();
    let of_user = at("y_MetallicSmoothness.part.png");
    std::fs::write(&of_user, "mine").unwrap();
    let run = |preset: Preset, name: &str| {
        let settings = ExportSettings { preset, side: Some(256), points_down: preset.points_down() };
        let files = export(&at("torus.fan"), &at(name), &settings, &NoProgress).unwrap();
        files
            .into_iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(run(Preset::Gltf, "one.glb"), ["one.glb"]);
    let files = run(Preset::Blender, "b.gltf");
    assert!(
        files.iter().any(|name| name == "b.gltf") && files.iter().any(|name| name.ends_with(".png")),
        "{files:?}"
    );
    let files = run(Preset::Unreal, "u.glb");
    assert_eq!(files, ["u.glb", "u_BaseColor.png", "u_Normal.png", "u_ORM.png"]);
    let files = run(Preset::Unity, "y.glb");
    assert_eq!(
        files,
        ["y.glb", "y_BaseMap.png", "y_Normal.png", "y_MetallicSmoothness.png", "y_Occlusion.png"]
    );

    let ((channels, down), (_, up)) = (texels(&at("u_Normal.png")), texels(&at("y_Normal.png")));
    let turned =
        down.chunks(channels).zip(up.chunks(channels)).all(|(d, u)| d[0] == u[0] && d[1] == 255 - u[1]);
    assert!(turned && down.len() == 256 * 256 * channels);
    // Not metallic, roughness 0.6, wherever there is surface.
    let (channels, both) = texels(&at("y_MetallicSmoothness.png"));
    assert_eq!(channels, 4);
    let count = both.chunks(4).filter(|p| p[0] <= 2 && p[3].abs_diff(102) <= 3).count();
    assert!(count > 256 * 256 / 3, "{count}");
    assert_eq!(std::fs::read(of_user).unwrap(), b"mine");
}

/// Wants to go on for so many questions.
struct Patience(AtomicU32);

impl Progress for Patience {
    fn report(&self, _: u64, _: u64) {}

    fn is_cancelled(&self) -> bool {
        self.0.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

#[test]
fn exports_that_are_cancelled_leave_all_files_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let asset = crate::painting::small_asset(folder.path());
    std::fs::write(folder.path().join("y.glb"), "before").unwrap();
    let settings = ExportSettings { preset: Preset::Unity, side: Some(128), ..ExportSettings::default() };
    let mut cancelled = 0;
    for questions in [0, 1, 2, 3, 5, 8, 12, 20, 40] {
        let patience = Patience(AtomicU32::new(questions));
        if export(&asset, &folder.path().join("y.glb"), &settings, &patience).is_ok() {
            break;
        }
        cancelled += 1;
        assert_eq!(std::fs::read(folder.path().join("y.glb")).unwrap(), b"before", "{questions}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "{questions}");
    }
    assert!(cancelled > 0);
}

/// A stroke between two places of the scene.
fn draw(viewer: &mut Viewer, from: [f64; 2], to: [f64; 2]) {
    let event = |phase, [x, y]: [f64; 2]| PenEvent { phase, at: DVec2::new(x, y), pressure: 1.0 };
    let pen = vec![event(PenPhase::Down, from), event(PenPhase::Move, to), event(PenPhase::Up, to)];
    viewer.navigate(&SceneInput { pen, ..SceneInput::default() }, 0.016);
    wait_painted(viewer);
}

/// Until what is asked for is written, or refused.
fn wait_written(viewer: &mut Viewer) {
    let started = Instant::now();
    while viewer.exporting.is_some() {
        assert!(started.elapsed() < Duration::from_secs(60), "it is not written");
        viewer.poll();
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Steps, layers, and the pages of the first channel.
fn contents(path: &Path) -> (Vec<String>, usize, Vec<Vec<u8>>) {
    let painter = Painter::open(path, &PaintOptions::default()).unwrap();
    let editor = painter.editor();
    let cover = editor.asset().shared_cover();
    let ids = (0u32..).zip(&cover.groups).flat_map(|(g, group)| group_pages(g, group));
    let pages = ids.map(|id| editor.read_page_raw(0, id).unwrap()).collect();
    let steps = painter.history().done().iter().map(|step| step.label.clone()).collect();
    (steps, painter.layers().len(), pages)
}

/// A copy holds what is painted so far, with layers and history; the painter goes on with the asset itself.
#[test]
fn copies_hold_what_is_painted_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    (viewer.scene_pixels, viewer.pixels_per_point) = ([500, 500], 1.0);
    viewer.show(ViewPreset::Top);
    wait_painted(&mut viewer);
    let Some(Place::File(original)) = viewer.document.as_ref().map(|document| document.place.clone()) else {
        panic!("a file is painted on");
    };
    viewer.layer_action(&LayerAction::Add);
    wait_painted(&mut viewer);
    draw(&mut viewer, [0.5, 0.85], [0.6, 0.84]);
    viewer.command(Command::SaveCopy);
    assert_eq!(viewer.take_requests(), [Request::Dialog(FileDialog::SaveCopy)], "it asks where to");
    let copy = folder.path().join("copy.fan");
    viewer.take_file(FileDialog::SaveCopy, copy.clone());
    wait_written(&mut viewer);
    assert!(viewer.notices.log().any(|text| text.starts_with("Saved") && text.contains("copy.fan")));
    assert!(verify(&copy, &VerifyOptions::default()).unwrap().ok);
    let copied = contents(&copy);
    assert_eq!((copied.0.as_slice(), copied.1), (&["add layer".to_owned(), "paint".to_owned()][..], 1));

    // What comes later is in the asset alone.
    let bytes = std::fs::read(&copy).unwrap();
    draw(&mut viewer, [0.4, 0.83], [0.3, 0.75]);
    assert_eq!(viewer.document.as_ref().unwrap().place, Place::File(original.clone()));
    // The asset itself is no copy.
    viewer.copy_to(original.clone());
    wait_written(&mut viewer);
    assert_eq!(crate::errors(&viewer.notices), 1);
    assert!(viewer.notices.log().any(|text| text.contains("is the asset itself")));
    viewer.close();
    assert!(std::fs::read(&copy).unwrap() == bytes);
    let now = contents(&original);
    assert_eq!(now.0, ["add layer", "paint", "paint"]);
    assert!(now.2 != copied.2);
    // Without its last step it is what the copy is.
    let mut painter = Painter::open(&original, &PaintOptions::default()).unwrap();
    assert!(painter.undo().unwrap());
    painter.commit().unwrap();
    drop(painter);
    assert!(contents(&original) == copied);
}

/// The asset that was to be copied is not open any more: nothing else is copied instead.
#[test]
fn copies_that_wait_are_given_up_with_their_asset() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    (viewer.scene_pixels, viewer.pixels_per_point) = ([500, 500], 1.0);
    viewer.show(ViewPreset::Top);
    wait_painted(&mut viewer);
    let copy = folder.path().join("copy.fan");
    draw(&mut viewer, [0.5, 0.85], [0.6, 0.84]);
    viewer.copy_to(copy.clone());
    assert!(viewer.exporting.is_some());
    viewer.close();
    let other = Asset::open(&crate::painting::small_asset(tempfile::tempdir().unwrap().path())).unwrap();
    let place = Place::File(folder.path().join("other.fan"));
    viewer.document = Some(Document::of_asset(place, Arc::new(other)));
    viewer.poll();
    assert!(viewer.exporting.is_none() && !copy.exists());
    assert!(viewer.notices.log().any(|text| text.contains("copy.fan was not written")));
}

#[test]
fn copies_are_checked_before_they_get_their_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = crate::painting::small_asset(folder.path());
    let asset = Arc::new(Asset::open(&path).unwrap());
    let damaged = asset.cluster_range(asset.clusters().last().unwrap()).start as usize;
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[damaged] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let mut viewer = empty();
    viewer.document = Some(Document::of_asset(Place::File(path), asset));
    let copy = folder.path().join("copy.fan");
    std::fs::write(&copy, "before").unwrap();
    viewer.copy_to(copy.clone());
    wait_written(&mut viewer);
    assert_eq!(crate::errors(&viewer.notices), 1);
    assert!(viewer.notices.log().any(|text| text.contains("does not match its checksums")));
    assert_eq!(std::fs::read(&copy).unwrap(), b"before");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
}
