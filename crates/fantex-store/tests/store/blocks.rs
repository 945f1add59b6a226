//! Block formats: encoding and decoding.

use fantex_store::{PageTexels, Quality, TexelFormat, TexelSlice, decode, decode_plain, encode, encode_many};
use half::f16;

/// A smooth picture with some structure.
fn picture([width, height]: [u32; 2], alpha: bool) -> Vec<[f32; 4]> {
    (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let wave = |kx: f32, ky: f32, phase: f32| 0.5 + 0.4 * (kx * x + ky * y + phase).sin();
            let a = if alpha { wave(0.1, 0.07, 2.0) } else { 1.0 };
            [wave(0.11, 0.05, 0.0), wave(0.03, 0.13, 1.0), wave(0.07, -0.09, 2.0), a]
        })
        .collect()
}

fn rms(a: &[[f32; 4]], b: &[[f32; 4]], channels: usize) -> f32 {
    let sum: f32 = a.iter().zip(b).flat_map(|(a, b)| (0..channels).map(|k| (a[k] - b[k]).powi(2))).sum();
    (sum / (a.len() * channels) as f32).sqrt()
}

#[test]
fn every_format_comes_back_within_its_precision() {
    for (format, bound) in [
        (TexelFormat::Bc1, 0.025),
        (TexelFormat::Bc4, 0.015),
        (TexelFormat::Bc5, 0.015),
        (TexelFormat::Bc7, 0.02),
        (TexelFormat::R8, 0.002),
        (TexelFormat::Rg8, 0.002),
        (TexelFormat::Rgba8, 0.002),
        (TexelFormat::Rgba32F, 0.0),
    ] {
        for extent in [[4, 4], [8, 4], [4, 12], [20, 36], [256, 64]] {
            let texels = picture(extent, format == TexelFormat::Bc7);
            let bytes = encode(format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
            assert_eq!(bytes.len(), format.bytes(extent));
            let back = decode(format, extent, &bytes).unwrap();
            let error = rms(&texels, &back, format.channel_count());
            assert!(error <= bound, "{format:?} {extent:?}: {error}");
            let missing = [0.0, 0.0, 0.0, 1.0];
            assert_eq!(back[0][format.channel_count()..], missing[format.channel_count()..]);
        }
    }
}

#[test]
fn pages_encode_alike_alone_and_together() {
    let extents = [[4, 4], [16, 8], [12, 20], [64, 64], [8, 8]];
    let pictures: Vec<_> = extents.iter().enumerate().map(|(i, &e)| picture(e, i % 2 == 1)).collect();
    let pages: Vec<_> = extents
        .iter()
        .zip(&pictures)
        .map(|(&extent, p)| PageTexels { extent, texels: TexelSlice::F32(p.as_slice()), read: None })
        .collect();
    for format in TexelFormat::ALL {
        let together = encode_many(format, Quality::UltraFast, &pages).unwrap();
        for (&PageTexels { extent, texels, .. }, bytes) in pages.iter().zip(&together) {
            assert_eq!(*bytes, encode(format, Quality::UltraFast, extent, texels).unwrap(), "{format:?}");
        }
    }
}

#[test]
fn blocks_that_nothing_reads_are_zeros_and_the_others_as_ever() {
    for extent in [[4, 4], [64, 48], [256, 256], [36, 20]] {
        let texels = picture(extent, false);
        let texels = TexelSlice::F32(&texels);
        let blocks = (extent[0] * extent[1] / 16) as usize;
        for read in [vec![true; blocks], vec![false; blocks], (0..blocks).map(|b| b * b % 7 < 3).collect()] {
            for format in [TexelFormat::Bc1, TexelFormat::Bc4, TexelFormat::Bc5, TexelFormat::Bc7] {
                let whole = encode(format, Quality::UltraFast, extent, texels).unwrap();
                let page = PageTexels { extent, texels, read: Some(&read) };
                let part = encode_many(format, Quality::UltraFast, &[page]).unwrap().remove(0);
                assert_eq!(part.len(), whole.len());
                let length = format.block_bytes();
                for (block, (part, whole)) in part.chunks(length).zip(whole.chunks(length)).enumerate() {
                    assert!(
                        part == if read[block] { whole } else { &[0; 16][..length] },
                        "{format:?} {block}"
                    );
                }
            }
        }
    }
    let (texels, read) = (picture([8, 8], false), [true; 3]);
    let page = PageTexels { extent: [8, 8], texels: TexelSlice::F32(&texels), read: Some(&read) };
    let error = encode_many(TexelFormat::Bc7, Quality::UltraFast, &[page]).unwrap_err();
    assert!(error.to_string().contains("3 blocks"), "{error}");
}

#[test]
fn opaque_pages_stay_opaque() {
    let extent = [32, 32];
    let texels = picture(extent, false);
    for format in [TexelFormat::Bc1, TexelFormat::Bc7] {
        for quality in [Quality::UltraFast, Quality::VeryFast, Quality::Fast, Quality::Basic] {
            let bytes = encode(format, quality, extent, TexelSlice::F32(&texels)).unwrap();
            let back = decode(format, extent, &bytes).unwrap();
            let least = back.iter().map(|t| t[3]).fold(1.0, f32::min);
            // BC7's mode 6 shares the lowest bit of alpha with the colours.
            let bound = if format == TexelFormat::Bc7 { 254.0 / 255.0 } else { 1.0 };
            assert!(least >= bound, "{format:?} {quality:?}: {least}");
        }
    }
}

/// Among others that vary, opaque or not.
#[test]
fn blocks_of_one_color_are_exact_in_bc7() {
    let extent = [64, 32];
    let colors: [[u8; 3]; 6] = [[0; 3], [255, 0, 0], [255; 3], [128, 127, 200], [1, 254, 77], [255, 128, 0]];
    for alpha in [255_u8, 0, 77] {
        let mut texels = picture(extent, false);
        for (i, texel) in texels.iter_mut().enumerate() {
            let block = i / 64 / 4 * 16 + i % 64 / 4;
            if block % 3 != 0 {
                let [r, g, b] = colors[block % 5 + block % 2].map(|value| f32::from(value) / 255.0);
                *texel = [r, g, b, f32::from(alpha) / 255.0];
            }
        }
        for quality in [Quality::UltraFast, Quality::VeryFast, Quality::Fast, Quality::Basic] {
            let bytes = encode(TexelFormat::Bc7, quality, extent, TexelSlice::F32(&texels)).unwrap();
            let back = decode(TexelFormat::Bc7, extent, &bytes).unwrap();
            for (i, (a, b)) in texels.iter().zip(&back).enumerate() {
                let block = i / 64 / 4 * 16 + i % 64 / 4;
                let is_exact = (0..4).all(|k| (a[k] - b[k]).abs() < 1e-6);
                assert!(block % 3 == 0 || is_exact, "{quality:?} block {block}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn bc1_keeps_cut_outs() {
    let extent = [16, 16];
    let mut texels = picture(extent, false);
    for (i, texel) in texels.iter_mut().enumerate() {
        texel[3] = if i % 5 < 2 { 0.0 } else { 1.0 };
    }
    let bytes = encode(TexelFormat::Bc1, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
    let back = decode(TexelFormat::Bc1, extent, &bytes).unwrap();
    for (a, b) in texels.iter().zip(&back) {
        assert_eq!(a[3], b[3]);
        assert!(a[3] == 0.0 || (0..3).all(|k| (a[k] - b[k]).abs() < 0.12), "{a:?} {b:?}");
    }
}

/// The exact palette of one BC1 block, rounded to the nearest step, for all pairs of 5-bit and 6-bit end points.
#[test]
fn bc1_rounds_to_the_nearest_step() {
    let nearest = |numerator: u32, denominator: u32| (2 * 255 * numerator + denominator) / (2 * denominator);
    for a in 0..64u16 {
        for b in 0..64u16 {
            let end = |g: u16| ((g >> 1) << 11) | (g << 5) | (g >> 1);
            let (c0, c1) = (end(a), end(b));
            let mut block = [0u8; 8];
            block[..2].copy_from_slice(&c0.to_le_bytes());
            block[2..4].copy_from_slice(&c1.to_le_bytes());
            block[4] = 0b11_10_01_00;
            let back = decode(TexelFormat::Bc1, [4, 4], &block).unwrap();
            let step = |i: usize, k: usize| (back[i][k] * 255.0).round() as u32;
            let (g0, g1, r0, r1) = (u32::from(a), u32::from(b), u32::from(a >> 1), u32::from(b >> 1));
            if c0 > c1 {
                assert_eq!(step(2, 1), nearest(2 * g0 + g1, 3 * 63));
                assert_eq!(step(3, 0), nearest(r0 + 2 * r1, 3 * 31));
            } else {
                assert_eq!(step(2, 1), nearest(g0 + g1, 2 * 63));
                assert_eq!(back[3], [0.0; 4]);
            }
            assert_eq!(step(0, 1), nearest(g0, 63));
            assert_eq!(step(1, 2), nearest(r1, 31));
        }
    }
}

#[test]
fn bc4_values_are_exact_ratios() {
    // Indices 0..8, then zeros.
    let indices = [0b1000_1000, 0b1100_0110, 0b1111_1010, 0, 0, 0];
    let block = |e0, e1| [vec![e0, e1], indices.to_vec()].concat();
    let values = |e0, e1| -> Vec<f32> {
        decode(TexelFormat::Bc4, [4, 4], &block(e0, e1)).unwrap()[..8].iter().map(|t| t[0]).collect()
    };
    let wide = values(210, 0);
    for (value, sevenths) in wide.iter().zip([7, 0, 6, 5, 4, 3, 2, 1]) {
        assert!((value - 210.0 / 255.0 * sevenths as f32 / 7.0).abs() < 1e-7);
    }
    let narrow = values(0, 200);
    for (value, expected) in narrow.iter().zip([0.0, 200.0, 40.0, 80.0, 120.0, 160.0, 0.0, 255.0]) {
        assert!((value - expected / 255.0).abs() < 1e-7);
    }
}

#[test]
fn reserved_bc7_blocks_are_transparent_black() {
    let block: Vec<u8> = (0..16).map(|i| if i == 0 { 0 } else { 0xa5 }).collect();
    assert_eq!(decode(TexelFormat::Bc7, [4, 4], &block).unwrap(), vec![[0.0; 4]; 16]);
}

#[test]
fn wrong_sizes_are_errors() {
    let texels = vec![[0u8; 4]; 16];
    let slice = TexelSlice::U8(&texels);
    assert!(encode(TexelFormat::Bc7, Quality::UltraFast, [4, 8], slice).is_err());
    assert!(encode(TexelFormat::Bc7, Quality::UltraFast, [2, 8], slice).is_err());
    assert!(encode(TexelFormat::R8, Quality::UltraFast, [0, 4], slice).is_err());
    assert!(decode(TexelFormat::Bc7, [4, 4], &[0; 15]).is_err());
    assert!(decode(TexelFormat::Bc7, [5, 4], &[0; 16]).is_err());
}

/// No bit pattern makes a decoder panic or leave 0..1.
#[test]
fn any_bits_decode() {
    let mut state = 1u64;
    for _ in 0..2000 {
        let block: Vec<u8> = (0..256)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 56) as u8
            })
            .collect();
        for format in TexelFormat::ALL {
            let texels = decode(format, [4, 4], &block[..format.block_bytes()]).unwrap();
            assert!(texels.iter().flatten().all(|x| x.is_finite()));
        }
    }
}

/// Every format's plain texels are the decoded ones, rounded.
#[test]
fn plain_texels_are_the_decoded_ones() {
    let extent = [8, 12];
    let texels: Vec<[f32; 4]> = (0..96)
        .map(|i| {
            let x = i as f32 / 96.0;
            [x, 1.0 - x, (7.0 * x).fract(), 1.0]
        })
        .collect();
    for format in TexelFormat::ALL {
        let bytes = encode(format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
        let decoded = decode(format, extent, &bytes).unwrap();
        let plain = decode_plain(format, false, extent, &bytes).unwrap();
        let channels = format.channel_count();
        for (i, texel) in decoded.iter().enumerate() {
            for (k, value) in texel.iter().take(channels).enumerate() {
                let at = i * channels + k;
                if format == TexelFormat::Rgba32F {
                    let half = f16::from_le_bytes([plain[2 * at], plain[2 * at + 1]]);
                    assert_eq!(half, f16::from_f32(*value));
                } else {
                    assert_eq!(f32::from(plain[at]), (value * 255.0).round(), "{format:?} {value}");
                }
            }
        }
        let texel_bytes = if format == TexelFormat::Rgba32F { 8 } else { channels };
        assert_eq!(plain.len(), 96 * texel_bytes);
    }
    assert!(decode_plain(TexelFormat::Bc7, true, [4, 4], &[0; 15]).is_err());
}

#[test]
fn floats_beyond_the_half_floats_range_are_clamped() {
    let texel = [1e9f32, -1e9, 0.5, 1.0].map(f32::to_le_bytes).concat();
    let plain = decode_plain(TexelFormat::Rgba32F, true, [4, 4], &texel.repeat(16)).unwrap();
    let half = |k: usize| f16::from_le_bytes([plain[2 * k], plain[2 * k + 1]]).to_f32();
    assert_eq!((half(0), half(1), half(3)), (65504.0, -65504.0, 1.0));
    assert!((half(2) - 0.214).abs() < 1e-3);
}
