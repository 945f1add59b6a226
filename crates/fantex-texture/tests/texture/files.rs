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
    .chain(container_samples())
    .collect()
}

fn container_samples() -> Vec<(&'static str, Vec<u8>)> {
    let texels: Vec<u8> = (0..96).collect();
    let packed = zstd::bulk::compress(&texels[..24], 3).unwrap_or_default();
    vec![
        ("a.ktx2", ktx2(43, [2, 3], 1, 2, &packed)),
        ("b.ktx2", ktx2(143, [6, 5], 1, 0, &texels)),
        ("c.ktx2", ktx2(146, [5, 3], 1, 0, &texels)),
        ("a.dds", dds([2, 2, 0, 2], MASKED_BGRA, 0, &texels)),
        ("b.dds", dds([7, 5, 0, 1], coded(b"DXT5"), 0, &texels)),
    ]
}

/// A KTX2 file of plain RGBA bytes.
fn ktx2(format: u32, [width, height]: [u32; 2], faces: u32, packing: u32, level: &[u8]) -> Vec<u8> {
    let mut bytes = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    for word in [format, 1, width, height, 0, 0, faces, 1, packing, 0, 0, 0, 0, 0, 0, 0, 0] {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    for wide in [104, level.len() as u64, level.len() as u64] {
        bytes.extend_from_slice(&wide.to_le_bytes());
    }
    bytes.extend_from_slice(level);
    bytes
}

/// A DDS file; `pixels` are the flags, the code, the bits and four masks, `complexity` says cube or volume.
fn dds(
    [width, height, depth, levels]: [u32; 4],
    pixels: [u32; 7],
    complexity: u32,
    texels: &[u8],
) -> Vec<u8> {
    let mut words = vec![124, 0x1007, height, width, 0, depth, levels];
    words.extend([0; 11]);
    words.push(32);
    words.extend(pixels);
    words.extend([0x1000, complexity, 0, 0, 0]);
    let mut bytes = b"DDS ".to_vec();
    words.into_iter().for_each(|word: u32| bytes.extend_from_slice(&word.to_le_bytes()));
    assert_eq!(bytes.len(), 128);
    bytes.extend_from_slice(texels);
    bytes
}

const MASKED_BGRA: [u32; 7] = [0x41, 0, 32, 0xff_0000, 0xff00, 0xff, 0xff00_0000];

fn coded(code: &[u8; 4]) -> [u32; 7] {
    [4, u32::from_le_bytes(*code), 0, 0, 0, 0, 0]
}

fn decode_all(bytes: &[u8]) -> Result<Vec<Image>, LoadImageError> {
    Image::decode_all(bytes, "file", ColorSpace::Srgb, ImageLimits { side: 4096, bytes: 1 << 20 })
}

#[test]
fn ktx2_files_are_read() {
    let texels: Vec<u8> = (0..6 * 2 * 3 * 4).collect();
    let cube = decode_all(&ktx2(43, [2, 3], 6, 0, &texels)).unwrap();
    assert_eq!(cube.len(), 6);
    for (face, image) in cube.iter().enumerate() {
        assert_eq!((image.width, image.height, image.space), (2, 3, ColorSpace::Srgb));
        assert_eq!(image.samples, Samples::U8(texels[face * 24..face * 24 + 24].to_vec()));
    }
    // Packed; the file says linear, whatever is the default.
    let packed = zstd::bulk::compress(&texels[..24], 3).unwrap();
    let image = Image::decode(&ktx2(37, [2, 3], 1, 2, &packed), "a.ktx2", ColorSpace::Srgb).unwrap();
    assert_eq!((image.space, image.samples), (ColorSpace::Linear, Samples::U8(texels[..24].to_vec())));
    // Red and green stay red and green.
    let image = &decode_all(&ktx2(16, [2, 1], 1, 0, &[1, 2, 3, 4])).unwrap()[0];
    assert_eq!((image.channels, &image.samples), (3, &Samples::U8(vec![1, 2, 0, 3, 4, 0])));
    // A block of BC1: red, all indices 0.
    let image = &decode_all(&ktx2(132, [3, 2], 1, 0, &[0, 0xf8, 0, 0, 0, 0, 0, 0])).unwrap()[0];
    assert_eq!(image.samples, Samples::U8([255, 0, 0, 255].repeat(6)));

    for (bytes, part) in [
        (ktx2(0, [2, 3], 1, 0, &texels), "Basis Universal"),
        (ktx2(43, [2, 3], 1, 1, &texels), "Basis Universal"),
        (ktx2(43, [2, 3], 1, 3, &texels), "packed by method 3"),
        (ktx2(147, [2, 3], 1, 0, &texels), "format 147 (VkFormat)"),
        (ktx2(43, [2, 3], 5, 0, &texels), "5 for the number of faces"),
        (ktx2(43, [2, 3], 1, 2, &texels), "damaged"),
        (ktx2(43, [4, 30], 1, 0, &texels), "480 are needed"),
        (ktx2(43, [0, 3], 1, 0, &texels), "each side must be 1 to 4096"),
        (ktx2(43, [4000, 4000], 1, 0, &texels), "more than 1048576 bytes"),
    ] {
        let error = decode_all(&bytes).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("'file'"), "{part}: {error}");
    }
}

#[test]
fn dds_files_are_read() {
    let texels: Vec<u8> = (0..200).collect();
    let image = &decode_all(&dds([2, 1, 0, 0], MASKED_BGRA, 0, &texels)).unwrap()[0];
    assert_eq!(image.samples, Samples::U8(vec![2, 1, 0, 3, 6, 5, 4, 7]));
    assert_eq!(image.space, ColorSpace::Srgb);
    // Six faces of 2 x 2 with a second level of one texel each.
    let cube = decode_all(&dds([2, 2, 0, 2], MASKED_BGRA, 0xfe00, &texels)).unwrap();
    assert_eq!(cube.len(), 6);
    for (face, image) in cube.iter().enumerate() {
        let Samples::U8(samples) = &image.samples else { panic!() };
        assert_eq!(samples[2], 20 * face as u8);
    }
    // Three slices of a volume.
    let volume = decode_all(&dds([2, 1, 3, 1], MASKED_BGRA, 0x20_0000, &texels)).unwrap();
    assert_eq!(volume.len(), 3);
    let bytes = dds([4, 4, 0, 1], coded(b"DXT1"), 0, &[0xe0, 0x07, 0, 0, 0, 0, 0, 0]);
    assert_eq!(decode_all(&bytes).unwrap()[0].samples, Samples::U8([0, 255, 0, 255].repeat(16)));
    // The extension: BC7 in sRGB, of which there is too little.
    let mut extended = Vec::new();
    [99_u32, 3, 0, 1, 0].into_iter().for_each(|word| extended.extend_from_slice(&word.to_le_bytes()));
    extended.extend_from_slice(&[0; 15]);
    for (bytes, part) in [
        (dds([4, 4, 0, 1], coded(b"DX10"), 0, &extended), "ends after 163 bytes; 164 are needed"),
        (dds([4, 4, 0, 1], coded(b"WHAT"), 0, &texels), "format WHAT"),
        (dds([4, 4, 0, 77], coded(b"DXT1"), 0, &texels), "77 for the number of levels"),
        (dds([4, 4, 0, 1], [0x40, 0, 16, 0xf800, 0x7e0, 0x1f, 0], 0, &texels), "16 bits with masks f800"),
        (dds([4, 4, 0, 1], MASKED_BGRA, 0x200, &texels), "0 for the number of faces"),
    ] {
        let error = decode_all(&bytes).unwrap_err().to_string();
        assert!(error.contains(part), "{part}: {error}");
    }
    assert!(decode_all(b"DDS ").is_err());
}

#[test]
fn shipped_light_maps_are_read() {
    let Some(folder) = data_folder("images/lightmap") else { return };
    for name in ["CornellBox-Box", "CornellBox-Large", "CornellBox-Small"] {
        let path = folder.join(format!("{name}.zstd.ktx2"));
        let image = Image::load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((image.width, image.height, image.channels), (1024, 1024, 3));
        let Samples::F32(values) = &image.samples else { panic!("light maps are floats") };
        // Light: never negative, lit somewhere, and more of it than paper white in few places.
        assert!(values.iter().all(|value| *value >= 0.0 && value.is_finite()));
        let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64;
        eprintln!("{name}: mean {mean:.4}, largest {:.3}", values.iter().copied().fold(0.0, f32::max));
        assert!(mean > 0.001 && mean < 10.0, "{name}: mean {mean}");
    }
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
    let all = panic::catch_unwind(|| Image::decode_all(bytes, what, ColorSpace::Srgb, limits).is_ok());
    assert!(all.is_ok(), "{what} panicked");
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
