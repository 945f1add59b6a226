//! Single pictures, and KTX2 byte by byte.

use fantex_bake::{BakeFormat, NoProgress};
use fantex_export::{ChannelMap, Depth, ExportError, ExportOptions, export_channel};
use fantex_mesh::generate::icosphere;
use fantex_store::ChannelKind;
use fantex_texture::compare::psnr_db;
use fantex_texture::{ColorSpace, Image, Samples};

use crate::support::{Baked, Waves, baked, baked_bottle, cleaned};

const SIDE: u32 = 128;

fn options() -> ExportOptions<'static> {
    ExportOptions { side: Some(SIDE), ..ExportOptions::default() }
}

fn sphere() -> Baked {
    use ChannelKind::{BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic};
    let kinds = vec![BaseColor, Normal, OcclusionRoughnessMetallic, Emission, Displacement, Light];
    baked(&cleaned(icosphere(3)), &Waves { kinds, ..Waves::color(3.0) }, 1 << 14, BakeFormat::Float)
}

fn export(baked: &Baked, map: ChannelMap, depth: Depth, name: &str) -> Image {
    let path = baked.path(name);
    export_channel(&baked.asset, map, depth, &path, &options(), &NoProgress).unwrap();
    let space = match map {
        ChannelMap::BaseColor | ChannelMap::Emission | ChannelMap::Light => ColorSpace::Srgb,
        _ => ColorSpace::Linear,
    };
    Image::load_as(&path, space).unwrap()
}

const ALL: [ChannelMap; 10] = [
    ChannelMap::BaseColor,
    ChannelMap::Opacity,
    ChannelMap::Normal,
    ChannelMap::OcclusionRoughnessMetallic,
    ChannelMap::Occlusion,
    ChannelMap::Roughness,
    ChannelMap::Metallic,
    ChannelMap::Emission,
    ChannelMap::Displacement,
    ChannelMap::Light,
];

#[test]
fn every_channel_is_the_same_in_every_format() {
    let baked = sphere();
    for map in ALL {
        let name = |e: &str| format!("{}.{e}", map.name());
        let exact = export(&baked, map, Depth::Eight, &name("exr"));
        let shorts = export(&baked, map, Depth::Sixteen, &format!("16-{}", name("png")));
        let bytes = export(&baked, map, Depth::Eight, &name("png"));
        assert!(matches!(shorts.samples, Samples::U16(_)) && matches!(bytes.samples, Samples::U8(_)));
        // OpenEXR has no grey here.
        assert!(exact.channels == bytes.channels || [bytes.channels, exact.channels] == [1, 3], "{map:?}");
        let [coarse, fine] = [&bytes, &shorts].map(|image| psnr_db(&exact, image).unwrap());
        assert!(coarse > 50.0 && fine > 80.0, "{map:?}: {coarse} and {fine} dB");
        let packed = export(&baked, map, Depth::Eight, &name("ktx2"));
        // Two coordinates of a normal are stored; the third follows.
        let db = if map == ChannelMap::Normal {
            red_psnr_db(&bytes, &packed)
        } else {
            psnr_db(&bytes, &packed).unwrap()
        };
        assert!(db > 38.0, "{map:?} as KTX2: {db} dB");
    }
}

/// PSNR of the first channel of two 8-bit images.
fn red_psnr_db(a: &Image, b: &Image) -> f64 {
    let red = |image: &Image| -> Vec<f64> {
        let Samples::U8(samples) = &image.samples else { panic!("8 bits") };
        samples.chunks(usize::from(image.channels)).map(|t| f64::from(t[0]) / 255.0).collect()
    };
    let squares: f64 = red(a).iter().zip(red(b)).map(|(a, b)| (a - b).powi(2)).sum();
    -10.0 * (squares / f64::from(a.width * a.height)).log10()
}

fn word(bytes: &[u8], offset: usize) -> u32 {
    u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

fn wide(bytes: &[u8], offset: usize) -> u64 {
    u64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap())
}

#[test]
fn ktx2_says_what_it_holds() {
    let baked = sphere();
    // Format, type size, descriptor's model and transfer function, bytes of a block, bits of the samples.
    type Expected = (ChannelMap, u32, u32, [u32; 2], u32, &'static [[u32; 2]]);
    let expected: [Expected; 6] = [
        (ChannelMap::BaseColor, 146, 1, [134, 2], 16, &[[0, 128]]),
        (ChannelMap::OcclusionRoughnessMetallic, 145, 1, [134, 1], 16, &[[0, 128]]),
        (ChannelMap::Normal, 141, 1, [132, 1], 16, &[[0, 64], [1, 64]]),
        (ChannelMap::Roughness, 139, 1, [131, 1], 8, &[[0, 64]]),
        (ChannelMap::Displacement, 70, 2, [1, 1], 2, &[[0, 16]]),
        (ChannelMap::Light, 97, 2, [1, 1], 8, &[[0xc0, 16], [0xc1, 16], [0xc2, 16], [0xcf, 16]]),
    ];
    for (map, format, type_size, model, unit_bytes, samples) in expected {
        export(&baked, map, Depth::Eight, "x.ktx2");
        let bytes = std::fs::read(baked.path("x.ktx2")).unwrap();
        assert_eq!(&bytes[..12], b"\xabKTX 20\xbb\r\n\x1a\n");
        let header: Vec<u32> = (0..9).map(|i| word(&bytes, 12 + 4 * i)).collect();
        assert_eq!(header, [format, type_size, SIDE, SIDE, 0, 0, 1, 8, 2], "{map:?}");
        let [dfd, dfd_bytes, pairs, pair_bytes] = [0, 1, 2, 3].map(|i| word(&bytes, 48 + 4 * i) as usize);
        assert_eq!((wide(&bytes, 64), wide(&bytes, 72)), (0, 0));
        assert_eq!((dfd, pairs), (80 + 24 * 8, dfd + dfd_bytes));
        check_descriptor(&bytes[dfd..pairs], model, unit_bytes, samples, type_size == 1);
        assert!(bytes[pairs..pairs + pair_bytes].windows(18).any(|w| w == b"KTXorientation\0rd\0"));
        // From the smallest level to the largest, without gaps, up to the end.
        let mut offset = (pairs + pair_bytes) as u64;
        for level in (0..8u32).rev() {
            let entry = 80 + 24 * level as usize;
            let [at, length, unpacked] = [0, 8, 16].map(|i| wide(&bytes, entry + i));
            assert_eq!(at, offset);
            let side = u64::from(SIDE >> level);
            let units = if type_size == 1 { side.div_ceil(4) } else { side };
            assert_eq!(unpacked, units * units * u64::from(unit_bytes));
            let packed = &bytes[at as usize..(at + length) as usize];
            assert_eq!(zstd::bulk::decompress(packed, unpacked as usize).unwrap().len() as u64, unpacked);
            offset += length;
        }
        assert_eq!(offset, bytes.len() as u64);
        std::fs::remove_file(baked.path("x.ktx2")).unwrap();
    }
}

fn check_descriptor(
    dfd: &[u8],
    [model, transfer]: [u32; 2],
    unit_bytes: u32,
    samples: &[[u32; 2]],
    is_block: bool,
) {
    let block_bytes = 24 + 16 * samples.len() as u32;
    assert_eq!([word(dfd, 0), word(dfd, 4), word(dfd, 8)], [4 + block_bytes, 0, 2 | block_bytes << 16]);
    assert_eq!(word(dfd, 12), model | 1 << 8 | transfer << 16);
    assert_eq!(word(dfd, 16), if is_block { 0x0303 } else { 0 });
    assert_eq!([word(dfd, 20), word(dfd, 24)], [unit_bytes, 0]);
    let mut offset = 0;
    for (i, &[channel, bits]) in samples.iter().enumerate() {
        assert_eq!(word(dfd, 28 + 16 * i), offset | (bits - 1) << 16 | channel << 24);
        offset += bits;
    }
    assert_eq!(offset, 8 * unit_bytes);
}

#[test]
fn a_missing_channel_is_named() {
    let baked = baked_bottle(1 << 14);
    let path = baked.path("x.png");
    let error = export_channel(&baked.asset, ChannelMap::Light, Depth::Eight, &path, &options(), &NoProgress)
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "the asset has no channel for light; it has base-color, orm, normal, emission"
            .replace("base-color, orm, normal, emission", &present(&baked))
    );
    assert!(matches!(error, ExportError::NoChannel { .. }) && !path.exists());
}

fn present(baked: &Baked) -> String {
    let name = |kind: ChannelKind| match kind {
        ChannelKind::BaseColor => "base-color",
        ChannelKind::Normal => "normal",
        ChannelKind::OcclusionRoughnessMetallic => "orm",
        ChannelKind::Emission => "emission",
        ChannelKind::Displacement => "displacement",
        ChannelKind::Light => "light",
        ChannelKind::Anisotropy => "anisotropy",
    };
    baked.asset.channels().iter().map(|c| name(c.kind)).collect::<Vec<_>>().join(", ")
}
