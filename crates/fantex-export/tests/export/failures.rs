//! What goes wrong leaves nothing behind.

use std::sync::atomic::{AtomicBool, Ordering};

use fantex_bake::{NoProgress, Progress};
use fantex_export::{ChannelMap, Depth, ExportError, ExportOptions, export_channel, export_model};

use crate::support::{baked_bottle, files};

#[test]
fn sizes_that_no_picture_has_are_refused() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("x.glb");
    for (side, padding, sentence) in [
        (Some(1000), None, "a picture cannot have 1000 x 1000 texels; give a power of two from 16 to 32768"),
        (
            Some(65_536),
            None,
            "a picture cannot have 65536 x 65536 texels; give a power of two from 16 to 32768",
        ),
        (None, Some(3), "the padding cannot be 3 texels; give a power of two up to 64"),
    ] {
        let options = ExportOptions { side, padding, ..ExportOptions::default() };
        let error = export_model(&baked.asset, &path, &options, &NoProgress).unwrap_err();
        assert_eq!(error.to_string(), sentence);
    }
    let unknown = export_model(&baked.asset, &baked.path("x.fbx"), &ExportOptions::default(), &NoProgress);
    assert!(matches!(unknown, Err(ExportError::UnknownKind { .. })));
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

#[test]
fn existing_files_stay_unless_forced() {
    let baked = baked_bottle(1 << 12);
    std::fs::write(baked.path("x.bin"), "mine").unwrap();
    let options = ExportOptions { side: Some(64), ..ExportOptions::default() };
    let error = export_model(&baked.asset, &baked.path("x.gltf"), &options, &NoProgress).unwrap_err();
    assert!(matches!(error, ExportError::Exists { .. }), "{error}");
    assert_eq!(files(baked.folder.path()), ["asset.fan", "x.bin"]);
    let options = ExportOptions { force: true, ..options };
    export_model(&baked.asset, &baked.path("x.gltf"), &options, &NoProgress).unwrap();
    assert_ne!(std::fs::read(baked.path("x.bin")).unwrap(), b"mine");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("nowhere/x.glb");
    let error = export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap_err();
    assert!(error.to_string().starts_with(&format!("cannot write {}: ", path.display())), "{error}");
}

#[test]
fn a_cancelled_export_leaves_nothing() {
    /// Stops after the first report.
    struct Impatient(AtomicBool);
    impl Progress for Impatient {
        fn report(&self, _: u64, _: u64) {
            self.0.store(true, Ordering::Relaxed);
        }

        fn is_cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed)
        }
    }
    let baked = baked_bottle(1 << 16);
    let watch = Impatient(AtomicBool::new(false));
    let options = ExportOptions { side: Some(1024), with_ktx2: true, ..ExportOptions::default() };
    let error = export_model(&baked.asset, &baked.path("x.gltf"), &options, &watch).unwrap_err();
    assert!(matches!(error, ExportError::Cancelled));
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

#[test]
fn packing_can_be_cancelled() {
    struct Stopped;
    impl Progress for Stopped {
        fn report(&self, _: u64, _: u64) {
            panic!("nothing was to be written");
        }

        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let baked = baked_bottle(1 << 14);
    for side in [None, Some(512)] {
        let options = ExportOptions { side, ..ExportOptions::default() };
        let error = export_model(&baked.asset, &baked.path("x.glb"), &options, &Stopped).unwrap_err();
        assert!(matches!(error, ExportError::Cancelled), "{error}");
    }
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

#[test]
fn a_picture_that_must_be_whole_in_memory_says_so() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("x.exr");
    let options = ExportOptions { side: Some(4096), memory_bytes: 64 << 20, ..ExportOptions::default() };
    let error =
        export_channel(&baked.asset, ChannelMap::BaseColor, Depth::Eight, &path, &options, &NoProgress)
            .unwrap_err();
    assert!(matches!(error, ExportError::Memory { .. }), "{error}");
    assert!(!path.exists());
}
