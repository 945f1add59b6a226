//! Reading and writing of image files.

use std::io::Cursor;
use std::{fs, panic};

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image as ExrImage, WritableImage};
use fantex_base::{ErrorKind, Result};
use fantex_texture::compare::{FlipOptions, compare, compare_where, difference_picture, flip, psnr_db, ssim};
use fantex_texture::environment::{CubeFace, EnvironmentMap};
use fantex_texture::{AlphaUse, ColorSpace, Depth, Image, ImageLimits, Samples};
use glam::Vec3;
use proptest::prelude::*;

use crate::common::{Random, assert_close, data_folder};

fn sample_image(depth: Depth, channels: u8) -> Image {
    let (width, height) = (13, 7);
    let count = width as usize * height as usize * usize::from(channels);
    let mut random = Random::new(u64::from(channels));
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
fn terrain_as_signed_or_floating_point_tiff_is_read() {
    use tiff::encoder::{TiffEncoder, colortype};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let heights = |path| match Image::load(path) {
        Ok(Image { width: 2, height: 2, channels: 1, samples: Samples::F32(values), .. }) => values,
        other => panic!("{other:?}"),
    };
    let encoder = || TiffEncoder::new(fs::File::create(&path).unwrap()).unwrap();
    encoder().write_image::<colortype::GrayI16>(2, 2, &[-32767, 0, 16384, 32767]).unwrap();
    assert_eq!(heights(&path), [-1.0, 0.0, 16384.0 / 32767.0, 1.0]);
    encoder().write_image::<colortype::Gray32Float>(2, 2, &[-12.5, f32::NAN, 4808.7, 1e-3]).unwrap();
    assert_eq!(heights(&path), [-12.5, 0.0, 4808.7, 1e-3]);
    encoder().write_image::<colortype::Gray64Float>(2, 2, &[-12.5, 0.0, 4808.5, 2.0]).unwrap();
    assert_eq!(heights(&path), [-12.5, 0.0, 4808.5, 2.0]);
    encoder().write_image::<colortype::GrayI32>(2, 2, &[i32::MAX, 0, -i32::MAX, 0]).unwrap();
    assert_eq!(heights(&path), [1.0, 0.0, -1.0, 0.0]);
    // Cut short.
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(Image::load(&path).is_err());
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

/// An OpenEXR file of channels by name, 2 x 2 floats each.
fn exr(channels: &[(&str, [f32; 4])]) -> Vec<u8> {
    let channel =
        |(name, values): &(&str, [f32; 4])| AnyChannel::new(*name, FlatSamples::F32(values.to_vec()));
    let mut bytes = Cursor::new(Vec::new());
    let image = ExrImage::from_channels((2, 2), AnyChannels::sort(channels.iter().map(channel).collect()));
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// Heights, masks, depths and single layers of renderers are pictures, too.
#[test]
fn open_exr_files_need_not_have_red_green_and_blue() {
    let [a, b, c, d] = [[0.1, 0.2, 0.3, 0.4], [1.0, 2.0, 3.0, 4.0], [5.0; 4], [0.5, 1.0, 0.25, 0.0]];
    let decoded = |channels: &[(&str, [f32; 4])]| Image::decode(&exr(channels), "a.exr", ColorSpace::Srgb);
    let layer = [("Z", a), ("V.R", a), ("V.G", b), ("V.B", c)];
    for (channels, count, texels) in [
        (&[("Z", b)][..], 1, vec![1.0, 2.0, 3.0, 4.0]),
        (&[("Y", b), ("A", d), ("id", c)][..], 2, vec![2.0, 0.5, 2.0, 1.0, 12.0, 0.25, 4.0, 0.0]),
        (&layer[..], 3, vec![0.1, 1.0, 5.0, 0.2, 2.0, 5.0, 0.3, 3.0, 5.0, 0.4, 4.0, 5.0]),
    ] {
        let image = decoded(channels).unwrap();
        assert_eq!(
            (image.width, image.height, image.channels, image.space),
            (2, 2, count, ColorSpace::Linear)
        );
        assert_eq!(image.samples, Samples::F32(texels), "{channels:?}");
        let whole = exr(channels);
        for end in (0..whole.len()).step_by(5) {
            let error = Image::decode(&whole[..end], "a.exr", ColorSpace::Srgb).unwrap_err().to_string();
            assert!(error.contains("a.exr"), "{end} bytes: {error}");
        }
    }
    let two = [("V.R", a), ("V.G", b), ("V.B", c), ("W.R", a), ("W.G", b), ("W.B", c)];
    for channels in [&[("U", a), ("V", b)][..], &[("Y", a), ("RY", b), ("BY", c)][..], &two[..]] {
        let error = decoded(channels).unwrap_err().to_string();
        assert!(error.contains("its channels are") && error.contains("give it R, G and B"), "{error}");
    }
    let names: Vec<String> = (10..40).map(|number| format!("u{number}")).collect();
    let many: Vec<_> = names.iter().map(|name| (name.as_str(), a)).collect();
    let error = decoded(&many).unwrap_err().to_string();
    assert!(error.contains("u16, u17 and 22 more; give it") && !error.contains("u18"), "{error}");
}

/// One infinite texel, or one that is no number, would spoil all coarser levels.
#[test]
fn numbers_of_images_are_finite() {
    let sun = [f32::INFINITY, f32::NAN, f32::NEG_INFINITY, 2.0];
    let finite = [65_504.0, 0.0, -65_504.0, 2.0];
    let grey = Image::decode(&exr(&[("Y", sun)]), "a.exr", ColorSpace::Srgb).unwrap();
    assert_eq!(grey.samples, Samples::F32(finite.to_vec()));
    let color =
        Image::decode(&exr(&[("R", sun), ("G", sun), ("B", sun)]), "a.exr", ColorSpace::Srgb).unwrap();
    assert_eq!(color.samples, Samples::F32(finite.iter().flat_map(|&value| [value; 3]).collect()));
    // Half floats: an infinite one, one that is none, 1 and 1.
    let halves = [0x7c00_u16, 0x7e00, 0x3c00, 0x3c00].map(u16::to_le_bytes);
    let image = &decode_all(&ktx2(97, [1, 1], 1, 0, halves.as_flattened())).unwrap()[0];
    assert_eq!(image.samples, Samples::F32(vec![65_504.0, 0.0, 1.0, 1.0]));
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.png");
    let error = Image::load(&missing).unwrap_err();
    assert!(error.kind() == ErrorKind::NotFound && error.to_string().contains("missing.png"));
    let error = Image::decode(b"", "empty.png", ColorSpace::Srgb).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");
    let error = Image::decode(b"no picture at all", "x", ColorSpace::Srgb).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");

    let image = sample_image(Depth::U8, 4);
    let saved = |name: &str| image.save(folder.path().join(name)).unwrap_err();
    assert!(saved("a.xyz").to_string().starts_with("cannot tell the image format"));
    assert!(saved("a.jpg").to_string().starts_with("JPEG cannot hold 4 channels"));
    assert_eq!(saved("no/such/folder.png").kind(), ErrorKind::NotFound);
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
    let refused = |side, bytes| within(side, bytes).unwrap_err().to_string();
    assert!(refused(12, 1 << 20).ends_with("each side must be 1 to 12"));
    assert!(refused(100, 272).contains("bytes of memory, 272 bytes are left"));
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
    // UASTC whose description lies within the header: the file may end anywhere behind it.
    let mut early = ktx2(0, [4, 4], 1, 0, &texels[..16]);
    early[16] = 166;
    (early[48], early[52]) = (4, 15);
    vec![
        ("early.ktx2", early),
        ("a.ktx2", ktx2(43, [2, 3], 1, 2, &packed)),
        ("b.ktx2", ktx2(143, [6, 5], 1, 0, &texels)),
        ("c.ktx2", ktx2(146, [5, 3], 1, 0, &texels)),
        ("etc1s.ktx2", include_bytes!("../data/etc1s_alpha.ktx2").to_vec()),
        ("uastc.ktx2", include_bytes!("../data/uastc_alpha_zstd.ktx2").to_vec()),
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

fn decode_all(bytes: &[u8]) -> Result<Vec<Image>> {
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
        (ktx2(43, [4, 30], 1, 0, &texels), "it needs 480"),
        (ktx2(43, [0, 3], 1, 0, &texels), "each side must be 1 to 4096"),
        (ktx2(43, [u32::MAX; 2], 1, 0, &texels), "each side must be 1 to 4096"),
        (ktx2(43, [4000, 4000], 1, 0, &texels), "would take 123 MiB of memory, 1 MiB is left"),
    ] {
        let error = decode_all(&bytes).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("'file'"), "{part}: {error}");
    }
}

/// Each face of a cube's file is seen in its own direction.
#[test]
fn files_of_cubes_are_environments() {
    let folder = tempfile::tempdir().unwrap();
    let texels: Vec<u8> = (0..6 * 4).flat_map(|texel| [10 * (1 + texel / 4), 0, 0, 255]).collect();
    // Six faces of 2 x 2, blue first in the second file.
    let swapped: Vec<u8> = texels.as_chunks().0.iter().flat_map(|&[r, g, b, a]| [b, g, r, a]).collect();
    for (name, bytes) in [
        ("a.ktx2", ktx2(43, [2, 2], 6, 0, &texels)),
        ("a.dds", dds([2, 2, 0, 1], MASKED_BGRA, 0xfe00, &swapped)),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let map = EnvironmentMap::load(&path).unwrap();
        for (face, byte) in CubeFace::ALL.into_iter().zip([10_u8, 20, 30, 40, 50, 60]) {
            let seen = map.sample(face.forward(), [Vec3::ZERO; 2]);
            let encoded = f32::from(byte) / 255.0;
            let expected =
                if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
            assert!((seen.x - expected).abs() < 1e-3 * expected, "{name} {face:?}: {seen}, not {expected}");
        }
    }
    let path = folder.path().join("tall.ktx2");
    fs::write(&path, ktx2(43, [2, 3], 6, 0, &[0; 144])).unwrap();
    let error = EnvironmentMap::load(&path).unwrap_err().to_string();
    assert!(error.contains("2 x 3 texels, which is no environment"), "{error}");
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
        (dds([4, 4, 0, 1], coded(b"DX10"), 0, &extended), "ends after 163 bytes; it needs 164"),
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
fn colours_that_are_multiplied_with_alpha_are_divided() {
    let texel = |bytes: &[u8]| match &decode_all(bytes).unwrap()[0].samples {
        Samples::U8(samples) => [samples[0], samples[1], samples[2], samples[3]],
        other => panic!("{other:?}"),
    };
    // BC2: alpha 8 of 15, and a colour of 5, 6 and 5 bits with all indices 0: 99, 101 and 99.
    let color = (12_u16 << 11 | 25 << 5 | 12).to_le_bytes();
    let block = [&[0x88; 8][..], &color, &[0; 6]].concat();
    let [straight, multiplied] =
        [b"DXT3", b"DXT2"].map(|code| texel(&dds([4, 4, 0, 1], coded(code), 0, &block)));
    assert_eq!(straight, [99, 101, 99, 136]);
    assert_eq!(multiplied, [186, 189, 186, 136]);
    // The extension says it in its last word; 73 is BC2 without a type.
    let extended = |format: u32, mode: u32, texels: &[u8]| {
        let words = [format, 3, 0, 1, mode].map(u32::to_le_bytes).concat();
        texel(&dds([4, 4, 0, 1], coded(b"DX10"), 0, &[&words, texels].concat()))
    };
    assert_eq!(extended(74, 0, &block), straight);
    assert_eq!(extended(73, 2, &block), multiplied);
    // sRGB: light is multiplied, so 99 of 255 is 0.125 / 0.533 of the light.
    assert_eq!(extended(29, 2, &[99, 99, 99, 136].repeat(16)), [133, 133, 133, 136]);
    // Nothing is divided by zero, and nothing overflows.
    assert_eq!(extended(28, 2, &[99, 99, 99, 0].repeat(16)), [99, 99, 99, 0]);
    assert_eq!(extended(28, 2, &[99, 8, 0, 10].repeat(16)), [255, 204, 0, 10]);
}

/// TGA files have no magic number. Colours of both are stored blue first, rows from below where nothing else is said.
#[test]
fn tga_and_bmp_files_are_read() {
    let tga = |kind: u8, bits: u8, flags: u8, texels: &[u8]| {
        let header = [0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, bits, flags];
        [&header[..], texels].concat()
    };
    let rows: Vec<u8> = (0..12).collect();
    let upright = [8, 7, 6, 11, 10, 9, 2, 1, 0, 5, 4, 3];
    // Two runs: three equal texels, and one as it is.
    let runs = [0x82, 10, 20, 30, 0xff, 0x00, 1, 2, 3, 0];
    let mut bmp = b"BM".to_vec();
    for word in [54 + 16, 0, 54, 40, 2, 2, 24 << 16 | 1, 0, 16, 0, 0, 0, 0_u32] {
        bmp.extend_from_slice(&word.to_le_bytes());
    }
    bmp.extend_from_slice(&[0, 1, 2, 3, 4, 5, 0, 0, 6, 7, 8, 9, 10, 11, 0, 0]);
    for (name, bytes, channels, samples) in [
        ("plain", tga(2, 24, 0, &rows), 3, upright.to_vec()),
        ("from above", tga(2, 24, 0x20, &rows), 3, vec![2, 1, 0, 5, 4, 3, 8, 7, 6, 11, 10, 9]),
        (
            "runs",
            tga(10, 32, 0x28, &runs),
            4,
            vec![30, 20, 10, 255, 30, 20, 10, 255, 30, 20, 10, 255, 3, 2, 1, 0],
        ),
        ("grey", tga(3, 8, 0x20, &[1, 2, 3, 4]), 1, vec![1, 2, 3, 4]),
        ("BMP", bmp.clone(), 3, upright.to_vec()),
    ] {
        let image = Image::decode(&bytes, name, ColorSpace::Srgb).unwrap();
        assert_eq!((image.width, image.height, image.channels), (2, 2, channels), "{name}");
        assert_eq!((image.space, image.samples), (ColorSpace::Srgb, Samples::U8(samples)), "{name}");
    }
    for (bytes, part) in [
        (tga(2, 24, 0, &rows[1..]), "'a' is not a readable TGA image"),
        (bmp[..60].to_vec(), "'a' is not a readable BMP image"),
        (tga(2, 23, 0, &rows), "'a' is no image that can be read here"),
        (tga(2, 24, 0xc0, &rows), "'a' is no image that can be read here"),
        (vec![0; 100], "'a' is no image that can be read here"),
    ] {
        let error = Image::decode(&bytes, "a", ColorSpace::Srgb).unwrap_err().to_string();
        assert!(error.contains(part), "{part}: {error}");
    }
    // They are read, not written.
    let error = sample_image(Depth::U8, 3).encoded("a.tga").unwrap_err().to_string();
    assert!(error.contains("use .png"), "{error}");
}

/// Against the formula of `tests/data/README.md`, within what the encoder loses.
#[test]
fn basis_universal_is_read() {
    let files: [(&[u8], bool, f64); 3] = [
        (include_bytes!("../data/etc1s_alpha.ktx2"), true, 14.5),
        (include_bytes!("../data/uastc_alpha_zstd.ktx2"), true, 3.5),
        (include_bytes!("../data/uastc.ktx2"), false, 3.5),
    ];
    for (bytes, has_alpha, most) in files {
        let images = decode_all(bytes).unwrap();
        let [
            Image {
                width: 28,
                height: 20,
                channels: 4,
                space: ColorSpace::Srgb,
                samples: Samples::U8(samples),
            },
        ] = &images[..]
        else {
            panic!("{images:?}")
        };
        let mut squares = 0.0;
        for (i, texel) in samples.as_chunks::<4>().0.iter().enumerate() {
            let (x, y) = (i as i32 % 28, i as i32 / 28);
            let red = 255 * x / 27;
            let expected = [red, 255 * y / 19, 255 - 255 * (x + y) / 46, if has_alpha { red } else { 255 }];
            squares +=
                texel.iter().zip(expected).map(|(a, b)| f64::from(i32::from(*a) - b).powi(2)).sum::<f64>();
        }
        let error = (squares / samples.len() as f64).sqrt();
        assert!(error < most, "{error}");
    }
}

#[test]
fn shipped_light_maps_are_read() {
    let Some(folder) = data_folder("images/lightmap") else { return };
    // Medians of red, found with other tools.
    for (name, median) in
        [("CornellBox-Box", 0.6719), ("CornellBox-Large", 0.5156), ("CornellBox-Small", 0.09375)]
    {
        let path = folder.join(format!("{name}.zstd.ktx2"));
        let image = Image::load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((image.width, image.height, image.channels), (1024, 1024, 3));
        let Samples::F32(values) = &image.samples else { panic!("light maps are floats") };
        // A few hundred texels that no surface uses are undefined in the files.
        assert!(values.iter().all(|value| *value >= 0.0 && value.is_finite()));
        let mut reds: Vec<f32> = values.iter().step_by(3).copied().collect();
        reds.sort_by(f32::total_cmp);
        let got = reds[reds.len() / 2];
        assert!((got - median).abs() < 0.01, "{name}: median of red {got}, expected {median}");
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
        let mut random = Random::new(seed);
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

// ---- Images of another size.

fn noise(width: u32, height: u32, channels: u8) -> Image {
    let mut random = Random::new(7);
    let count = width * height * u32::from(channels);
    Image::from_linear(width, height, channels, (0..count).map(|_| random.unit()).collect())
}

/// The mean over a rectangle of square texels, by hand.
fn mean(image: &Image, x: [f64; 2], y: [f64; 2]) -> f64 {
    let overlap = |texel: u32, [from, to]: [f64; 2]| {
        (to.min(f64::from(texel + 1)) - from.max(f64::from(texel))).max(0.0)
    };
    let mut sum = 0.0;
    for row in 0..image.height {
        for column in 0..image.width {
            let value = f64::from(image.linear_texel(column, row)[0]);
            sum += value * overlap(column, x) * overlap(row, y);
        }
    }
    sum / ((x[1] - x[0]) * (y[1] - y[0]))
}

#[test]
fn smaller_texels_are_exact_means() {
    let image = noise(23, 17, 3);
    for (width, height) in [(22, 16), (10, 17), (7, 3), (1, 1), (23, 5)] {
        let small = image.resized(width, height, AlphaUse::Independent);
        assert_eq!((small.width, small.height, small.channels), (width, height, 3));
        for y in 0..height {
            for x in 0..width {
                let [columns, rows] = [(x, 23.0, width), (y, 17.0, height)]
                    .map(|(i, old, new)| [i, i + 1].map(|i| f64::from(i) * old / f64::from(new)));
                let truth = mean(&image, columns, rows);
                let got = f64::from(small.linear_texel(x, y)[0]);
                assert!((got - truth).abs() < 1e-5, "{width} x {height}, {x},{y}: {got} against {truth}");
            }
        }
    }
}

#[test]
fn larger_images_continue_ramps() {
    let ramp = |x: f32, y: f32| [0.1 + 0.02 * x, 0.8 - 0.03 * y, 0.3 + 0.001 * x * x, 1.0];
    let texels: Vec<[f32; 4]> =
        (0..16 * 12).map(|i| ramp((i % 16) as f32 + 0.5, (i / 16) as f32 + 0.5)).collect();
    let large = Image::from_linear_rgb(16, 12, &texels).resized(40, 31, AlphaUse::Coverage);
    for y in 6..25 {
        for x in 6..34 {
            let expected = ramp((x as f32 + 0.5) * 16.0 / 40.0, (y as f32 + 0.5) * 12.0 / 31.0);
            // A cubic of Catmull and Rom reproduces parabolas sampled at points.
            assert_close(large.linear_texel(x, y), expected, 2e-5, "ramp");
        }
    }
    // One axis up, the other down.
    let mixed = Image::from_linear_rgb(16, 12, &texels).resized(32, 6, AlphaUse::Coverage);
    assert_close(mixed.linear_texel(12, 3), ramp(6.25, 7.0), 1e-3, "mixed");
}

#[test]
fn light_is_averaged_and_transparent_texels_do_not_bleed() {
    let grey = Image {
        width: 2,
        height: 1,
        channels: 1,
        space: ColorSpace::Srgb,
        samples: Samples::U8(vec![0, 255]),
    };
    assert_eq!(grey.resized(1, 1, AlphaUse::Coverage).samples, Samples::U8(vec![188]));
    // As floats, not rounded to bytes before.
    let light = grey.resized_as([1, 1], AlphaUse::Coverage, Depth::F32, ColorSpace::Linear);
    assert_eq!(light.samples, Samples::F32(vec![0.5]));
    let edge = Image { channels: 4, samples: Samples::U8(vec![255, 0, 0, 255, 0, 255, 0, 0]), ..grey };
    assert_eq!(edge.resized(1, 1, AlphaUse::Coverage).samples, Samples::U8(vec![255, 0, 0, 128]));
    assert_eq!(edge.resized(1, 1, AlphaUse::Independent).samples, Samples::U8(vec![188, 188, 0, 128]));
}

// ---- The picture measures on cases whose result is known.

fn picture(width: u32, height: u32, mut texel: impl FnMut(u32, u32) -> [u8; 3]) -> Image {
    let samples = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y));
    Image { width, height, channels: 3, space: ColorSpace::Srgb, samples: Samples::U8(samples.collect()) }
}

fn noisy(amplitude: i32, seed: u64) -> Image {
    let mut random = Random::new(seed);
    picture(64, 48, |x, y| {
        let noise = (random.unit() * (2 * amplitude + 1) as f32) as i32 - amplitude;
        let value = 100 + (40.0 * (x as f32 * 0.3).sin() + 30.0 * (y as f32 * 0.2).cos()) as i32;
        [(value + noise).clamp(0, 255) as u8; 3]
    })
}

#[test]
fn equal_pictures_are_equal() {
    let image = noisy(20, 1);
    let result = compare(&image, &image).unwrap();
    assert_eq!(result.psnr_db, f64::INFINITY);
    assert_eq!(result.ssim, 1.0);
    assert!(result.flip < 1e-6);
    // Nor are others more than equal.
    for grey in [0.15, 0.3, 0.55, 0.9] {
        let flat = |value: f32| Image::from_linear_rgb(16, 16, &[[value, value, value, 1.0]; 256]);
        let found = ssim(&flat(grey), &flat(grey + 1e-6)).unwrap();
        assert!((0.999..=1.0).contains(&found), "{grey}: {found}");
    }
}

#[test]
fn psnr_of_a_constant_offset() {
    let (a, b) = (picture(9, 7, |_, _| [100; 3]), picture(9, 7, |_, _| [110; 3]));
    let expected = 20.0 * (255.0_f64 / 10.0).log10();
    assert!((psnr_db(&a, &b).unwrap() - expected).abs() < 1e-3);
    let picture = difference_picture(&a, &b, 4.0).unwrap();
    assert_eq!(picture.samples, Samples::U8(vec![40; 9 * 7 * 3]));
}

#[test]
fn ssim_of_constants_is_the_luminance_term() {
    let (a, b) = (picture(32, 32, |_, _| [51; 3]), picture(32, 32, |_, _| [102; 3]));
    let (x, y, c1) = (0.2_f64, 0.4, 1e-4);
    let expected = (2.0 * x * y + c1) / (x * x + y * y + c1);
    assert!((ssim(&a, &b).unwrap() - expected).abs() < 1e-3);
}

#[test]
fn ssim_of_opposite_patterns_is_negative() {
    let mut random = Random::new(3);
    let pattern: Vec<u8> = (0..40 * 40).map(|_| 128 + (random.unit() * 80.0) as u8).collect();
    let a = picture(40, 40, |x, y| [pattern[(y * 40 + x) as usize]; 3]);
    let b = picture(40, 40, |x, y| [255 - pattern[(y * 40 + x) as usize]; 3]);
    assert!(ssim(&a, &b).unwrap() < -0.5);
}

#[test]
fn flip_of_black_and_white() {
    // Worked out by hand: distance 100^0.7, largest distance 203.3^0.7 (green against blue), knee at 0.4 of it.
    let (a, b) = (picture(40, 30, |_, _| [0; 3]), picture(40, 30, |_, _| [255; 3]));
    let got = flip(&a, &b, FlipOptions::default()).unwrap();
    assert!((got - 0.9674).abs() < 1e-3, "{got}");
    // Green against blue is the largest distance.
    let (a, b) = (picture(40, 30, |_, _| [0, 255, 0]), picture(40, 30, |_, _| [0, 0, 255]));
    let got = flip(&a, &b, FlipOptions::default()).unwrap();
    assert!((got - 1.0).abs() < 1e-3, "{got}");
}

#[test]
fn measures_grow_with_the_noise_and_are_symmetric() {
    let clean = noisy(0, 1);
    let mut last = (f64::INFINITY, 1.0, 0.0);
    for amplitude in [2, 6, 18, 54] {
        let noisy = noisy(amplitude, 2);
        let result = compare(&clean, &noisy).unwrap();
        let mirrored = compare(&noisy, &clean).unwrap();
        assert!((result.flip - mirrored.flip).abs() < 1e-5 && (result.ssim - mirrored.ssim).abs() < 1e-6);
        assert!(result.psnr_db < last.0 && result.ssim < last.1 && result.flip > last.2, "{result:?}");
        last = (result.psnr_db, result.ssim, result.flip);
    }
}

#[test]
fn fine_noise_is_noticed_less_from_afar() {
    let (a, b) = (noisy(0, 1), noisy(30, 2));
    let near = flip(&a, &b, FlipOptions { pixels_per_degree: 20.0 }).unwrap();
    let far = flip(&a, &b, FlipOptions { pixels_per_degree: 200.0 }).unwrap();
    assert!(far < 0.7 * near, "{far} against {near}");
}

#[test]
fn sizes_must_agree_and_may_be_tiny() {
    let (a, b) = (picture(3, 2, |_, _| [1; 3]), picture(2, 3, |_, _| [1; 3]));
    assert!(compare(&a, &b).unwrap_err().to_string().contains("3 x 2 and 2 x 3"));
    let dot = picture(1, 1, |_, _| [9; 3]);
    assert!(compare(&dot, &dot).unwrap().ssim > 0.999);
}

mod tabulate {
    use fantex_base::ErrorKind;
    use fantex_texture::Tabulation;

    #[test]
    fn tables_hold_means_in_their_order() {
        let table = Tabulation { size: [4, 3, 2], samples: 3, ..Tabulation::default() };
        let texels = table.texels(|[x, y, z]| [x, y, z, 1.0]).unwrap();
        assert_eq!(texels.len(), 24);
        for (i, texel) in texels.iter().enumerate() {
            let expected = [(i % 4) as f32 + 0.5, (i / 4 % 3) as f32 + 0.5, (i / 12) as f32 + 0.5];
            for (axis, n) in [4.0, 3.0, 2.0].into_iter().enumerate() {
                assert!((texel[axis] - expected[axis] / n).abs() < 1e-6, "{i}: {texel:?}");
            }
        }
    }

    #[test]
    fn a_dense_table_looked_up_is_the_function() {
        use fantex_texture::{Filter, ImageTexture, SampleOptions, Wrap};
        use glam::Vec2;
        let function = |[x, y, _]: [f32; 3]| [(6.0 * x).sin() * (5.0 * y).cos(), x * y, 0.0, 1.0];
        let image = Tabulation { size: [512, 512, 1], ..Tabulation::default() }.image(function).unwrap();
        let texture = ImageTexture::new(std::sync::Arc::new(image));
        let options =
            SampleOptions { filter: Filter::Bilinear, wrap: [Wrap::Clamp; 2], ..SampleOptions::default() };
        for i in 0..500 {
            let uv =
                Vec2::new(0.01 + 0.98 * (i as f32 * 0.618).fract(), 0.01 + 0.98 * (i as f32 * 0.414).fract());
            let value = texture.sample(uv, [Vec2::ZERO; 2], &options);
            let exact = function([uv.x, uv.y, 0.0]);
            assert!((value[0] - exact[0]).abs() < 1e-4 && (value[1] - exact[1]).abs() < 1e-4, "{uv}");
        }
    }

    #[test]
    fn tables_of_nothing_or_too_much_are_refused() {
        let constant = |_: [f32; 3]| [0.0; 4];
        let empty = Tabulation { size: [0, 1, 1], ..Tabulation::default() };
        assert_eq!(empty.texels(constant).unwrap_err().kind(), ErrorKind::InvalidArgument);
        let huge = Tabulation { size: [u32::MAX; 3], ..Tabulation::default() };
        assert_eq!(huge.texels(constant).unwrap_err().kind(), ErrorKind::TooLarge);
    }
}

/// The left quarter of a picture differs by a fifth of the sRGB range.
#[test]
fn pictures_are_compared_where_it_counts() {
    let grey = |value: u8, left: u8| {
        let texel = |i: u32| if i % 64 < 16 { left } else { value };
        let samples = Samples::U8((0..64 * 48).flat_map(|i| [texel(i); 3]).collect());
        Image { width: 64, height: 48, channels: 3, space: ColorSpace::Srgb, samples }
    };
    let (reference, test) = (grey(100, 100), grey(100, 151));
    let is_left: Vec<bool> = (0..64 * 48).map(|i| i % 64 < 16).collect();
    let left = compare_where(&reference, &test, &is_left).unwrap();
    // 51 of 255 is a fifth: 20 log10(5).
    assert!((left.psnr_db - 13.979).abs() < 1e-3, "{}", left.psnr_db);
    let whole = compare(&reference, &test).unwrap();
    assert!(
        (whole.psnr_db - left.psnr_db - 6.0206).abs() < 1e-3,
        "a quarter of the error: {}",
        whole.psnr_db
    );
    assert!(left.ssim < whole.ssim && left.flip > 2.0 * whole.flip, "{left:?} {whole:?}");
    // Right of what the windows around its texels reach, nothing differs.
    let is_right: Vec<bool> = (0..64 * 48).map(|i| i % 64 >= 48).collect();
    let right = compare_where(&reference, &test, &is_right).unwrap();
    assert_eq!(right.psnr_db, f64::INFINITY);
    assert!((right.ssim - 1.0).abs() < 1e-9, "{right:?}");
    assert_eq!(compare_where(&reference, &test, &vec![false; 64 * 48]).unwrap(), whole);
    assert!(compare_where(&reference, &test, &[true]).is_err());
}

/// A ramp along u and a step along v: by hand.
#[test]
fn derivatives_are_differences_of_texels() {
    use fantex_texture::Wrap;
    use fantex_texture::look::{DerivativeTexture, Difference};
    let heights: Vec<f32> = (0..12).map(|i| 0.1 * (i % 4) as f32 + if i >= 4 { 0.5 } else { 0.0 }).collect();
    let image = Image::from_linear(4, 3, 1, heights);
    let derivatives = |difference| {
        let texture = DerivativeTexture::new(&image, difference, [Wrap::Clamp; 2], Some(2.0)).unwrap();
        assert_eq!(texture.range, 2.0);
        move |x: u32, y: u32| {
            let [height, u, v, _] = texture.image.linear_texel(x, y);
            [height, (2.0 * u - 1.0) * 2.0, (2.0 * v - 1.0) * 2.0]
        }
    };
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
    let forward = derivatives(Difference::Forward);
    assert!(near(forward(1, 0), [0.1, 0.4, 1.5]), "{:?}", forward(1, 0));
    assert!(near(forward(1, 1), [0.6, 0.4, 0.0]));
    assert!(near(forward(3, 1), [0.8, 0.0, 0.0]), "outside is the last texel");
    let backward = derivatives(Difference::Backward);
    assert!(near(backward(1, 0), [0.1, 0.4, 0.0]));
    assert!(near(backward(1, 1), [0.6, 0.4, 1.5]));
    let central = derivatives(Difference::Central);
    assert!(near(central(1, 0), [0.1, 0.4, 0.75]));
    assert!(near(central(0, 1), [0.5, 0.2, 0.75]));
    let own = DerivativeTexture::new(&image, Difference::Forward, [Wrap::Clamp; 2], None).unwrap();
    assert!((own.range - 1.5).abs() < 1e-6);
    assert!(DerivativeTexture::new(&image, Difference::Forward, [Wrap::Clamp; 2], Some(0.0)).is_err());
}

#[test]
fn tiff_files_with_a_palette_are_refused_with_what_to_do() {
    let mut file = Vec::new();
    let pixels = image::GrayImage::from_pixel(4, 4, image::Luma([99]));
    pixels.write_to(&mut Cursor::new(&mut file), image::ImageFormat::Tiff).unwrap();
    let directory = u32::from_le_bytes(file[4..8].try_into().unwrap()) as usize;
    let fields = u16::from_le_bytes(file[directory..directory + 2].try_into().unwrap());
    let mut places = (0..usize::from(fields)).map(|field| directory + 2 + 12 * field);
    // What samples mean: numbers of colours.
    let meaning = places.find(|&at| file[at..at + 2] == 262_u16.to_le_bytes()).unwrap();
    file[meaning + 8..meaning + 10].copy_from_slice(&3_u16.to_le_bytes());
    let error = Image::decode_within(&file, "pal.tif", ColorSpace::Srgb, ImageLimits::default());
    let error = error.unwrap_err().to_string();
    assert!(error.starts_with("'pal.tif'") && error.ends_with("save it as RGB or as PNG"), "{error}");
}

/// The decoder makes room for all values of a field before it reads one: 200 MB for 1.4 kB here.
#[test]
fn fields_of_tiff_files_hold_no_more_than_the_file() {
    let mut file = Vec::new();
    let pixels = image::GrayImage::from_pixel(4, 4, image::Luma([99]));
    pixels.write_to(&mut Cursor::new(&mut file), image::ImageFormat::Tiff).unwrap();
    let decode = |file: &[u8]| {
        Image::decode_within(
            file,
            "a.tif",
            ColorSpace::Srgb,
            ImageLimits { bytes: 1 << 26, ..ImageLimits::default() },
        )
    };
    assert_eq!(decode(&file).unwrap().samples, Samples::U8(vec![99; 16]));
    let directory = u32::from_le_bytes(file[4..8].try_into().unwrap()) as usize;
    let fields = u16::from_le_bytes(file[directory..directory + 2].try_into().unwrap());
    for field in 0..usize::from(fields) {
        let mut claims = file.clone();
        let count = directory + 2 + 12 * field + 4;
        claims[count..count + 4].copy_from_slice(&6_619_137_u32.to_le_bytes());
        let error = decode(&claims).unwrap_err().to_string();
        assert!(error.contains("claims 6619137 values"), "{error}");
    }
}
