//! Exports for other programs.

use std::path::{Path, PathBuf};
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
use fantex_app::export::{ExportSettings, Exported, Preset, export};
use fantex_app::paint::{LayerAction, NewAsset, PenEvent, PenPhase, bake_model};
use fantex_app::viewer::{Exporting, FileDialog, Request, SceneInput, Viewer};

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
    let asset = Arc::new(Asset::open(&at("torus.fan")).unwrap());
    let run = |preset: Preset, name: &str| {
        let settings = ExportSettings { preset, side: Some(256), points_down: preset.points_down() };
        let exported = export(&asset, &at(name), &settings, |_| false, &NoProgress).unwrap();
        let Exported::Written(files) = exported else { panic!("{exported:?}") };
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

/// Pictures of that name may be those that the model was made of.
#[test]
fn files_beside_a_model_are_replaced_once_that_is_asked_for_again() {
    let folder = tempfile::tempdir().unwrap();
    let asset = Arc::new(Asset::open(&crate::painting::small_asset(folder.path())).unwrap());
    let mut viewer = empty();
    viewer.asks = true;
    let place = Place::File(asset.path().to_owned());
    viewer.document = Some(Document::of_asset(place, asset));
    // Of one the name is known before anything is written, of the other only then.
    for (preset, model, picture) in
        [(Preset::Unity, "u.glb", "u_BaseMap.png"), (Preset::Blender, "b.gltf", "b-base-color.png")]
    {
        let [model, picture] = [model, picture].map(|name| folder.path().join(name));
        let settings = ExportSettings { preset, side: Some(128), ..ExportSettings::default() };
        std::fs::write(&model, "before").unwrap();
        std::fs::write(&picture, "mine").unwrap();
        let read = || [&model, &picture].map(|path| std::fs::read(path).unwrap());
        let mut write = || {
            viewer.export_to(model.clone(), settings.clone());
            while viewer.exporting.as_ref().is_some_and(|exporting| !exporting.is_asked()) {
                viewer.poll();
                std::thread::sleep(Duration::from_millis(2));
            }
            viewer.exporting.as_ref().map(|exporting| exporting.settings.clone())
        };
        assert_eq!(write(), Some(settings.clone()), "it can be asked for again");
        assert_eq!(read(), [b"before".to_vec(), b"mine".to_vec()]);
        assert_eq!(write(), None);
        assert!(read().iter().all(|bytes| bytes.len() > 10));
    }
    let told = viewer
        .notices
        .log()
        .any(|text| text.contains("u.glb was not written: u_BaseMap.png is there already"));
    assert!(told);
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
    let asset = Arc::new(Asset::open(&crate::painting::small_asset(folder.path())).unwrap());
    std::fs::write(folder.path().join("y.glb"), "before").unwrap();
    let settings = ExportSettings { preset: Preset::Unity, side: Some(128), ..ExportSettings::default() };
    let mut cancelled = 0;
    for questions in [0, 1, 2, 3, 5, 8, 12, 20, 40] {
        let patience = Patience(AtomicU32::new(questions));
        if export(&asset, &folder.path().join("y.glb"), &settings, |_| false, &patience).is_ok() {
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
        assert!(started.elapsed() < fantex_test::PATIENCE, "it is not written");
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
    assert_eq!(
        viewer.take_requests(),
        [Request::Dialog(FileDialog::SaveCopy(original.clone()))],
        "it asks where to"
    );
    let copy = folder.path().join("copy.fan");
    viewer.take_file(FileDialog::SaveCopy(original.clone()), copy.clone());
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

/// Where no file can be chosen there is a copy all the same, and it is told where.
#[test]
fn copies_find_their_names_where_there_are_no_dialogs() {
    let folder = tempfile::tempdir().unwrap();
    let (mut viewer, path) = painting_in(folder.path());
    for name in ["torus-copy-001.fan", "torus-copy-002.fan"] {
        viewer.go_on_without(FileDialog::SaveCopy(path.clone()));
        wait_written(&mut viewer);
        let copy = folder.path().join(name);
        assert_eq!(contents(&copy).1, 0);
        assert!(viewer.notices.log().any(|text| *text == format!("Saved {}.", copy.display())));
    }
    viewer.go_on_without(FileDialog::Open);
    assert!(viewer.notices.log().last().unwrap().contains("drop the file onto the window"));
}

/// A viewer that paints on an asset, seen from above, and where that lies.
fn painting_in(folder: &Path) -> (Viewer, PathBuf) {
    let mut viewer = with_painting(folder);
    (viewer.scene_pixels, viewer.pixels_per_point) = ([500, 500], 1.0);
    viewer.show(ViewPreset::Top);
    wait_painted(&mut viewer);
    let path = viewer.asset_path().unwrap();
    (viewer, path)
}

/// Another asset is opened before the question where to is answered, or while the copy waits for the painter.
#[test]
fn copies_are_of_the_asset_that_they_were_asked_of() {
    let folder = tempfile::tempdir().unwrap();
    let (mut viewer, path) = painting_in(folder.path());
    draw(&mut viewer, [0.5, 0.85], [0.6, 0.84]);
    viewer.command(Command::SaveCopy);
    viewer.choose_export(ExportSettings::default());
    let asked = viewer.take_requests();
    let dialogs = asked.into_iter().map(|request| match request {
        Request::Dialog(dialog) => dialog,
        other => panic!("{other:?}"),
    });
    let dialogs: Vec<FileDialog> = dialogs.collect();
    assert!(viewer.exporting.as_ref().is_some_and(Exporting::is_asked));
    let first = folder.path().join("first.fan");
    viewer.copy_to(first.clone());
    viewer.close();
    let elsewhere = tempfile::tempdir().unwrap();
    let other = Asset::open(&crate::painting::small_asset(elsewhere.path())).unwrap();
    let place = Place::File(other.path().to_owned());
    viewer.document = Some(Document::of_asset(place, Arc::new(other)));
    wait_written(&mut viewer);
    assert_eq!(contents(&first), contents(&path), "all that was painted before it was left");
    for (dialog, name) in dialogs.into_iter().zip(["second.fan", "second.glb"]) {
        viewer.take_file(dialog, folder.path().join(name));
        assert!(viewer.exporting.is_none() && !folder.path().join(name).exists());
        assert!(viewer.notices.log().any(|text| text.contains(&format!("{name} was not written"))));
    }
}

/// What is painted where another program has removed the file can still be copied, to the old name, too.
#[test]
fn what_is_painted_on_a_file_that_is_gone_can_be_copied() {
    let folder = tempfile::tempdir().unwrap();
    let (mut viewer, path) = painting_in(folder.path());
    std::fs::remove_file(&path).unwrap();
    draw(&mut viewer, [0.5, 0.85], [0.6, 0.84]);
    let copy = folder.path().join("copy.fan");
    for to in [&copy, &path] {
        viewer.copy_to(to.clone());
        wait_written(&mut viewer);
    }
    assert_eq!(contents(&copy).0, ["paint"]);
    assert!(std::fs::read(&copy).unwrap() == std::fs::read(&path).unwrap());
    // Nothing is lost that is in a copy.
    wait_painted(&mut viewer);
    viewer.poll();
    assert!(viewer.may_close());
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
