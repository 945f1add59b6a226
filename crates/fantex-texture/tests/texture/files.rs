//! Reading and writing of image files.

use std::fs;
use std::panic;

use fantex_texture::{ColorSpace, Depth, Image, ImageLimits, LoadImageError, Samples, SaveImageError};
use proptest::prelude::*;

use crate::common::{Random, data_folder};

fn sample_image(depth: Depth, channels: u8) -> Image {
    let (width, height) = (13, 7);
    let count = width as usize * height as usize * usize::from(channels);
    let mut random = Random(u64::from(channels));
    let samples = match depth {
        Depth::U8 => Samples::U8((0..count).map(|_| random.bits() as u8).collect()),
        Depth::U16 => Samples::U16((0..count).map(|_| random.bits() as u16).collect()),
        Depth::F32 => Samples::F32((0..count).map(|_| 0.25 + random.unit() * 3.0).collect()),
    };
    let space = if depth == Depth::F32 { ColorSpace::Linear } else { ColorSpace::Srgb };
    Image { width, height, channels, space, samples }
}

#[test]
fn lossless_formats_give_back_what_was_saved() {
    let folder = tempfile::tempdir().unwrap();
    for (name, depth, channels) in [
        ("a.png", Depth::U8, 1),
        ("a.png", Depth::U8, 2),
        ("a.png", Depth::U8, 3),
        ("a.png", Depth::U8, 4),
        ("a.png", Depth::U16, 1),
        ("a.png", Depth::U16, 2),
        ("a.png", Depth::U16, 3),
        ("a.png", Depth::U16, 4),
        ("a.tif", Depth::U8, 3),
        ("a.tif", Depth::U16, 4),
        ("a.tiff", Depth::F32, 3),
        ("a.webp", Depth::U8, 3),
        ("a.webp", Depth::U8, 4),
        ("a.exr", Depth::F32, 3),
        ("a.exr", Depth::F32, 4),
    ] {
        let image = sample_image(depth, channels);
        let path = folder.path().join(name);
        image.save(&path).unwrap_or_else(|error| panic!("{error}"));
        let back = Image::load(&path).unwrap_or_else(|error| panic!("{error}"));
        if (depth, channels) == (Depth::F32, 4) {
            // Multiplied and divided by alpha.
            assert_eq!((back.width, back.height, back.channels), (image.width, image.height, 4));
            let (Samples::F32(a), Samples::F32(b)) = (&image.samples, &back.samples) else { panic!() };
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5 * a.abs()));
        } else {
            assert!(back == image, "{name} {depth:?} {channels}");
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5, "no temporary file is left");
}

#[test]
fn floats_become_srgb_bytes_in_png() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    Image::from_linear_rgba(1, 1, &[[0.5, 0.0, 2.0, 0.5]]).save(&path).unwrap();
    let back = Image::load(&path).unwrap();
    assert_eq!(back.samples, Samples::U8(vec![188, 0, 255, 128]));
    // Grey goes everywhere.
    for name in ["g.jpg", "g.hdr", "g.exr", "g.webp", "g.tif"] {
        let grey = Image::from_linear(2, 2, 1, vec![0.5; 4]);
        let path = folder.path().join(name);
        grey.save(&path).unwrap_or_else(|error| panic!("{error}"));
        let texel = Image::load(&path).unwrap_or_else(|error| panic!("{error}")).linear_texel(1, 1);
        assert!(texel[..3].iter().all(|value| (value - 0.5).abs() < 0.01), "{name}: {texel:?}");
    }
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.png");
    let error = Image::load(&missing).unwrap_err();
    assert!(matches!(error, LoadImageError::Read { .. }) && error.to_string().contains("missing.png"));
    let error = Image::decode(b"", "empty.png", ColorSpace::Srgb).unwrap_err();
    assert!(matches!(error, LoadImageError::UnknownFormat { .. }), "{error}");
    let error = Image::decode(b"no picture at all", "x", ColorSpace::Srgb).unwrap_err();
    assert!(matches!(error, LoadImageError::UnknownFormat { .. }), "{error}");

    let image = sample_image(Depth::U8, 4);
    let saved = |name: &str| image.save(folder.path().join(name));
    assert!(matches!(saved("a.xyz"), Err(SaveImageError::UnknownExtension { .. })));
    assert!(matches!(saved("a.jpg"), Err(SaveImageError::Channels { .. })));
    assert!(matches!(saved("no/such/folder.png"), Err(SaveImageError::Write { .. })));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn limits_are_checked_before_decoding() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    sample_image(Depth::U8, 3).save(&path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let within = |side, bytes_limit| {
        let limits = ImageLimits { side, bytes: bytes_limit };
        Image::decode_within(&bytes, "a.png", ColorSpace::Srgb, limits)
    };
    assert!(matches!(within(12, 1 << 20), Err(LoadImageError::Size { limit: 12, .. })));
    assert!(matches!(within(100, 272), Err(LoadImageError::Memory { limit: 272, .. })));
    assert!(within(13, 1 << 20).is_ok());
}

#[test]
fn every_shipped_image_loads() {
    let Some(folder) = data_folder("images") else { return };
    let mut loaded = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        if !["png", "jpg", "exr", "hdr"].contains(&extension) {
            continue;
        }
        let image = Image::load(&path).unwrap_or_else(|error| panic!("{error}"));
        // The size as the file's own header tells it.
        let (width, height) = image::image_dimensions(&path).unwrap();
        assert_eq!((image.width, image.height), (width, height), "{}", path.display());
        assert_eq!(image.samples.len(), width as usize * height as usize * usize::from(image.channels));
        assert_eq!(image.samples.depth() == Depth::F32, ["exr", "hdr"].contains(&extension));
        loaded += 1;
    }
    assert!(loaded >= 10, "only {loaded} images");
}

fn encoded_samples() -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("{error}"));
    [
        ("a.png", Depth::U8, 4),
        ("b.png", Depth::U16, 3),
        ("a.jpg", Depth::U8, 3),
        ("a.tif", Depth::U16, 3),
        ("a.webp", Depth::U8, 4),
        ("a.hdr", Depth::F32, 3),
        ("a.exr", Depth::F32, 4),
    ]
    .into_iter()
    .map(|(name, depth, channels)| {
        let path = folder.path().join(name);
        sample_image(depth, channels).save(&path).unwrap_or_else(|error| panic!("{error}"));
        (name, fs::read(&path).unwrap_or_else(|error| panic!("{error}")))
    })
    .collect()
}

/// Decoding never panics and never gives an image whose samples do not fit its size.
fn survives(bytes: &[u8], what: &str) {
    let limits = ImageLimits { side: 4096, bytes: 1 << 26 };
    let result = panic::catch_unwind(|| Image::decode_within(bytes, what, ColorSpace::Srgb, limits));
    match result.unwrap_or_else(|_| panic!("{what} panicked")) {
        Ok(image) => {
            let expected = image.width as usize * image.height as usize * usize::from(image.channels);
            assert_eq!(image.samples.len(), expected, "{what}");
        }
        Err(error) => assert!(error.to_string().contains(what), "{error}"),
    }
}

#[test]
fn truncated_files_are_survived() {
    for (name, bytes) in encoded_samples() {
        for length in 0..bytes.len() {
            survives(&bytes[..length], name);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn damaged_files_are_survived(seed in any::<u64>(), flips in 1..12_usize) {
        static SAMPLES: std::sync::LazyLock<Vec<(&'static str, Vec<u8>)>> =
            std::sync::LazyLock::new(encoded_samples);
        let mut random = Random(seed);
        for (name, bytes) in SAMPLES.iter() {
            let mut damaged = bytes.clone();
            for _ in 0..flips {
                let bit = random.bits() as usize % (8 * damaged.len());
                damaged[bit / 8] ^= 1 << (bit % 8);
            }
            survives(&damaged, name);
        }
    }
}
