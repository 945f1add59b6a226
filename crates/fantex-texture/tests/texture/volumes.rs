//! Volumes: files, filters, space.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use fantex_base::ErrorKind;
use fantex_base::input::{ReadLimits, ReadOptions};
use fantex_texture::coordinates::{InSpace, NormalAxes, SpaceMatrix};
use fantex_texture::look::Slot;
use fantex_texture::{
    ByteOrder, ColorSpace, Depth, Filtering, Image, RawLayout, Samples, ShadingPoint, Texture, Volume,
    VolumeFilter, VolumeLookup, VolumeOptions, VolumeTexture, Wrap,
};
use glam::{Mat4, Vec3, Vec4};
use proptest::prelude::*;

use crate::common::{Random, data_folder, shading_point};

const FILTERS: [VolumeFilter; 3] = [VolumeFilter::Nearest, VolumeFilter::Linear, VolumeFilter::Mipmapped];
const PLENTY: u64 = 1 << 30;

fn volume(size: [u32; 3], channels: u8, mut value: impl FnMut(Vec3) -> [f32; 4]) -> VolumeTexture {
    let mut samples = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let texel = value(Vec3::new(x as f32, y as f32, z as f32) + 0.5);
                samples.extend_from_slice(&texel[..usize::from(channels)]);
            }
        }
    }
    let volume = Volume::new(size, channels, ColorSpace::Linear, Samples::F32(samples));
    let volume = volume.unwrap_or_else(|error| panic!("{error}"));
    VolumeTexture::new(Arc::new(volume))
}

fn options(wrap: Wrap, filter: VolumeFilter) -> VolumeOptions {
    VolumeOptions { wrap: [wrap; 3], filter }
}

#[test]
fn constants_and_ramps_are_reproduced() {
    let size = [9, 6, 13];
    let extent = Vec3::new(9.0, 6.0, 13.0);
    let flat = volume(size, 3, |_| [0.25, 0.5, 0.75, 1.0]);
    let ramp = |p: Vec3| [0.1 * p.x, 0.2 * p.y, 0.05 * p.z + 0.01 * p.x, 1.0];
    let ramps = volume(size, 3, ramp);
    let mut random = Random::new(1);
    for _ in 0..500 {
        let steps = [random.vector(), random.vector()].map(|v| v * 4.0_f32.powf(random.unit() * 5.0 - 5.0));
        for filter in FILTERS {
            for wrap in [Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
                let p = random.vector() * 3.0;
                for got in [
                    flat.sample(p, steps, &options(wrap, filter)),
                    flat.sample_area(p, steps, &options(wrap, filter)),
                ] {
                    assert!((got - Vec4::new(0.25, 0.5, 0.75, 1.0)).abs().max_element() < 2e-6, "{got}");
                }
            }
        }
        let voxel = Vec3::ONE + Vec3::new(random.unit(), random.unit(), random.unit()) * (extent - 2.0);
        let got = ramps.sample(voxel / extent, [Vec3::ZERO; 2], &VolumeOptions::default());
        assert!((got - Vec4::from_array(ramp(voxel))).abs().max_element() < 1e-5, "{got}");
    }
}

#[test]
fn every_axis_wraps_by_its_own_mode() {
    let size = [3, 4, 5];
    let mut random = Random::new(2);
    let noise = volume(size, 1, |_| [random.unit(); 4]);
    let Samples::F32(values) = noise.level(0).samples() else { panic!() };
    let wrapped = |index: i32, n: u32, wrap: Wrap| {
        let n = n as i32;
        match wrap {
            Wrap::Clamp => Some(index.clamp(0, n - 1)),
            Wrap::Border => (0..n).contains(&index).then_some(index),
            Wrap::Repeat => Some(index.rem_euclid(n)),
            Wrap::Mirror => Some(index.rem_euclid(2 * n).min(2 * n - 1 - index.rem_euclid(2 * n))),
        }
    };
    let wraps = [Wrap::Clamp, Wrap::Border, Wrap::Repeat, Wrap::Mirror];
    for (a, b, c) in [(0, 1, 2), (1, 2, 3), (2, 3, 0), (3, 0, 1)] {
        let wrap = [wraps[a], wraps[b], wraps[c]];
        for (x, y, z) in (-7..9).flat_map(|x| (-7..9).map(move |y| (x, y, x - y))) {
            let center = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, z as f32 + 0.5);
            let at = [wrapped(x, 3, wrap[0]), wrapped(y, 4, wrap[1]), wrapped(z, 5, wrap[2])];
            let expected = match at {
                [Some(x), Some(y), Some(z)] => values[((z * 4 + y) * 3 + x) as usize],
                _ => 0.0,
            };
            for filter in FILTERS {
                let p = center / Vec3::new(3.0, 4.0, 5.0);
                let got = noise.sample(p, [Vec3::ZERO; 2], &VolumeOptions { wrap, filter }).x;
                assert!(
                    (got - expected).abs() < 1e-5,
                    "{wrap:?} {filter:?} at {x} {y} {z}: {got}, {expected}"
                );
            }
        }
    }
}

#[test]
fn levels_of_any_size_keep_the_mean() {
    let mut random = Random::new(3);
    for size in [[1, 1, 1], [2, 2, 2], [5, 1, 3], [7, 6, 9], [16, 4, 8]] {
        let count = size.iter().product::<u32>() as usize * 3;
        let bytes: Vec<u8> = (0..count).map(|_| random.bits() as u8).collect();
        let shorts = bytes.iter().map(|&byte| u16::from(byte) * 257).collect();
        let floats = bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect();
        for samples in [Samples::U8(bytes.clone()), Samples::U16(shorts), Samples::F32(floats)] {
            let texture =
                VolumeTexture::new(Arc::new(Volume::new(size, 3, ColorSpace::Linear, samples).unwrap()));
            let truth =
                bytes.iter().step_by(3).map(|&b| f64::from(b) / 255.0).sum::<f64>() / (count / 3) as f64;
            let last = texture.level(texture.level_count() - 1);
            assert_eq!(last.size(), [1; 3]);
            let got = texture.sample(Vec3::splat(0.5), [Vec3::splat(64.0); 2], &VolumeOptions::default()).x;
            assert!((f64::from(got) - truth).abs() < 5e-5, "{size:?}: {got} against {truth}");
        }
    }
}

/// Over one footprint, the mean of the levels stays near the mean of many look-ups at level 0.
#[test]
fn area_stays_near_the_truth() {
    let waves = volume([48; 3], 1, |p| [0.5 + 0.5 * (p.x * 0.4 + p.y * 0.25).sin() * (p.z * 0.3).cos(); 4]);
    let wrap = options(Wrap::Mirror, VolumeFilter::Mipmapped);
    let linear = options(Wrap::Mirror, VolumeFilter::Linear);
    let mut random = Random::new(4);
    for _ in 0..60 {
        let p = random.vector() * 0.5 + 0.5;
        let a = random.direction();
        let b = a.any_orthonormal_vector();
        let steps = [a * (0.5 + 15.0 * random.unit()) / 48.0, b * (0.5 + 6.0 * random.unit()) / 48.0];
        let mut truth = 0.0;
        for i in 0..400 {
            let [s, t] = [i % 20, i / 20].map(|k| (k as f32 + 0.5) / 20.0 - 0.5);
            truth += waves.sample(p + steps[0] * s + steps[1] * t, [Vec3::ZERO; 2], &linear).x / 400.0;
        }
        let got = waves.sample_area(p, steps, &wrap).x;
        assert!((got - truth).abs() < 0.06, "{got} against {truth}");
    }
}

#[test]
fn volumes_stand_in_space_by_a_matrix() {
    let texture = Arc::new(volume([8; 3], 1, |p| [p.x / 8.0; 4]));
    let lookup = VolumeLookup { texture, options: VolumeOptions::default() };
    let placed = InSpace {
        input: Slot::Texture(Arc::new(lookup)),
        matrix: SpaceMatrix::new(
            Mat4::from_translation(Vec3::splat(0.5)) * Mat4::from_scale(Vec3::splat(0.5)),
        )
        .unwrap(),
        normal_axes: NormalAxes::Object,
    };
    for filtering in [Filtering::Own, Filtering::Area] {
        for x in [-0.5, 0.0, 0.25, 0.7] {
            let at = ShadingPoint { filtering, ..shading_point(Vec3::new(x, 0.0, 0.0), Vec3::Y) };
            let got = placed.evaluate(&at);
            assert!((got.x - (0.5 * x + 0.5)).abs() < 1e-5 && got.w == 1.0, "{got} at {x}");
        }
    }
}

#[test]
fn slices_are_stacked() {
    let slice = |grey: f32| Image::from_linear(2, 3, 1, vec![grey; 6]);
    let stack = Volume::from_slices(&[slice(0.0), slice(0.5), slice(1.0)]).unwrap();
    assert_eq!(stack.size(), [2, 3, 3]);
    let texture = VolumeTexture::new(Arc::new(stack));
    let linear = options(Wrap::Clamp, VolumeFilter::Linear);
    assert!((texture.sample(Vec3::new(0.5, 0.5, 1.0 / 3.0), [Vec3::ZERO; 2], &linear).x - 0.25).abs() < 1e-6);
    let unequal = Volume::from_slices(&[slice(0.0), Image::from_linear(3, 2, 1, vec![0.0; 6])]);
    assert!(unequal.unwrap_err().to_string().starts_with("slice 1 of the volume differs"));
    assert!(Volume::from_slices(&[]).unwrap_err().to_string().contains("at least one slice"));
    let short = Volume::new([2, 2, 2], 1, ColorSpace::Linear, Samples::U8(vec![0; 7])).unwrap_err();
    assert!(short.to_string().ends_with("takes 8 numbers, not 7"), "{short}");
    let folder = tempfile::tempdir().unwrap();
    let paths = [0.0, 1.0].map(|grey| folder.path().join(format!("{grey}.png")));
    paths.iter().zip([0.0, 1.0]).for_each(|(path, grey)| slice(grey).save(path).unwrap());
    assert_eq!(Volume::load_slices(&paths, ColorSpace::Srgb, PLENTY).unwrap().size(), [2, 3, 2]);
    let error = Volume::load_slices(&paths, ColorSpace::Srgb, 8).unwrap_err();
    assert!(
        error.to_string().contains("with its levels would take 14 bytes of memory, 8 bytes are"),
        "{error}"
    );
}

const HEADER: &str = "NDims = 3\nDimSize = 2 3 4\nElementSpacing = 1 2 3.5\nElementType = MET_UCHAR\n\
                      ElementDataFile = numbers.raw\n";

fn write(folder: &Path, header: &str, numbers: &[u8]) -> std::path::PathBuf {
    let path = folder.join("volume.mhd");
    let written = fs::write(folder.join("numbers.raw"), numbers).and_then(|()| fs::write(&path, header));
    written.unwrap_or_else(|error| panic!("{error}"));
    path
}

#[test]
fn meta_images_of_all_kinds_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = (0..24).collect();
    let path = write(folder.path(), HEADER, &bytes);
    let volume = Volume::load_meta_image(&path, PLENTY).unwrap();
    assert_eq!((volume.size(), volume.spacing()), ([2, 3, 4], Vec3::new(1.0, 2.0, 3.5)));
    assert_eq!(volume.samples(), &Samples::U8(bytes.clone()));
    assert_eq!(volume.extent(), Vec3::new(2.0, 6.0, 14.0));

    // Numbers at the end of the file itself, with two channels.
    let mut local = b"DimSize = 2 3 2\nElementNumberOfChannels = 2\nElementType = MET_UCHAR\n".to_vec();
    local.extend_from_slice(b"ElementDataFile = LOCAL\n");
    local.extend_from_slice(&bytes);
    let mha = folder.path().join("volume.mha");
    fs::write(&mha, &local).unwrap();
    let volume = Volume::load_meta_image(&mha, PLENTY).unwrap();
    assert_eq!((volume.channels(), volume.samples()), (2, &Samples::U8(bytes)));

    // Highest byte first; after a header of unknown length.
    let wide = "DimSize = 1 1 2\nElementByteOrderMSB = True\nHeaderSize = -1\nElementType = MET_USHORT\n\
                ElementDataFile = numbers.raw";
    let path = write(folder.path(), wide, &[9, 9, 9, 0x12, 0x34, 0xff, 0x00]);
    let volume = Volume::load_meta_image(&path, PLENTY).unwrap();
    assert_eq!(volume.samples(), &Samples::U16(vec![0x1234, 0xff00]));

    let layout = RawLayout {
        size: [1, 1, 2],
        channels: 1,
        depth: Depth::F32,
        byte_order: ByteOrder::Little,
        space: ColorSpace::Linear,
        skip: 1,
    };
    let floats: Vec<u8> =
        [0_u8].into_iter().chain([2.5_f32, f32::NAN].into_iter().flat_map(f32::to_le_bytes)).collect();
    write(folder.path(), "", &floats);
    let volume = Volume::load_raw(folder.path().join("numbers.raw"), &layout, PLENTY).unwrap();
    assert_eq!(volume.samples(), &Samples::F32(vec![2.5, 0.0]));
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let fails = |header: &str| {
        let path = write(folder.path(), header, &[0; 24]);
        Volume::load_meta_image(path, 1 << 20).unwrap_err()
    };
    for (from, to, part) in [
        ("NDims = 3", "NDims = 2", "line 1: NDims is '2'; it must be 3"),
        ("2 3 4", "2 3", "line 2: DimSize is '2 3'"),
        ("2 3 4", "2 0 4", "each side must be 1 to"),
        ("2 3 4", "2 3 5", "ends after 24 bytes; the volume needs 30"),
        ("2 3 4", "2000 3000 4000", "would take 29428 MiB of memory"),
        ("2 3 4", "70000 3000 4000", "70000 x 3000 x 4000"),
        ("1 2 3.5", "1 -2 3", "line 3: ElementSpacing"),
        ("MET_UCHAR", "MET_DOUBLE", "MET_UCHAR, MET_USHORT or MET_FLOAT"),
        ("numbers.raw", "LIST", "ElementDataFile is 'LIST'"),
        ("numbers.raw", "absent.raw", "cannot read"),
        ("ElementDataFile", "CompressedData = True\nElementDataFile", "unpack the file first"),
        ("ElementDataFile = numbers.raw\n", "", "ends without ElementDataFile"),
        ("DimSize = 2 3 4\n", "", "ends without DimSize"),
        ("ElementType", "what is this\nElementType", "line 4: a MetaImage header has lines like"),
    ] {
        let error = fails(&HEADER.replace(from, to)).to_string();
        assert!(error.contains(part), "{from} -> {to}: {error}");
    }
    let error = Volume::load_meta_image(folder.path().join("absent.mhd"), PLENTY).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotFound, "{error}");
}

#[test]
fn headers_name_no_files_outside_their_folders() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    let secret = folder.path().join("secret.raw");
    fs::write(&secret, [7; 24]).unwrap();
    for name in ["../secret.raw", secret.to_str().unwrap()] {
        let path = write(&inner, &HEADER.replace("numbers.raw", name), &[0; 24]);
        let error = Volume::load_meta_image(&path, PLENTY).unwrap_err().to_string();
        assert!(error.contains("line 5") && error.contains("which lies outside its folder"), "{error}");
        let allowed = ReadLimits::new(ReadOptions { allow_outside: true, ..ReadOptions::default() });
        let volume = allowed.run(|| Volume::load_meta_image(&path, PLENTY)).unwrap();
        assert_eq!(volume.samples(), &Samples::U8(vec![7; 24]));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn damaged_headers_are_survived(seed in any::<u64>(), flips in 1..8_usize) {
        let folder = tempfile::tempdir().unwrap();
        let mut random = Random::new(seed);
        let mut header = HEADER.as_bytes().to_vec();
        for _ in 0..flips {
            let bit = random.bits() as usize % (8 * header.len());
            header[bit / 8] ^= 1 << (bit % 8);
        }
        header.truncate(1 + random.bits() as usize % header.len());
        fs::write(folder.path().join("numbers.raw"), [0; 24]).unwrap();
        let path = folder.path().join("volume.mhd");
        fs::write(&path, header).unwrap();
        if let Ok(volume) = Volume::load_meta_image(&path, 1 << 20) {
            let [x, y, z] = volume.size();
            prop_assert_eq!(volume.samples().len() as u32, x * y * z * u32::from(volume.channels()));
        }
    }
}

#[test]
fn the_head_is_read() {
    let Some(folder) = data_folder("volumes") else { return };
    let path = folder.join("HeadMRVolume.mhd");
    let head = Volume::load_meta_image(&path, PLENTY).unwrap();
    assert_eq!((head.size(), head.channels(), head.spacing()), ([48, 62, 42], 1, Vec3::splat(4.0)));
    let error = Volume::load_meta_image(&path, 100_000).unwrap_err();
    assert!(error.to_string().contains("100000 bytes are left"), "{error}");
    let raw = fs::read(folder.join("HeadMRVolume.raw")).unwrap();
    let texture = VolumeTexture::new(Arc::new(head));
    let voxel = Vec3::new(20.0, 30.0, 25.0);
    let p = (voxel + 0.5) / Vec3::new(48.0, 62.0, 42.0);
    let got = texture.sample(p, [Vec3::ZERO; 2], &VolumeOptions::default());
    let expected = f32::from(raw[(25 * 62 + 30) * 48 + 20]) / 255.0;
    assert!((got.x - expected).abs() < 1e-4 && expected > 0.0, "{got} against {expected}");
}

#[test]
fn absurd_arguments_are_survived() {
    let texture = volume([5, 3, 4], 4, |p| [p.x, p.y, p.z, 0.5]);
    let absurd = [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, f32::MIN, 1e12, 0.0, 1e-38];
    for x in absurd {
        for y in absurd {
            for filter in FILTERS {
                for wrap in [Wrap::Clamp, Wrap::Border, Wrap::Repeat, Wrap::Mirror] {
                    let options = options(wrap, filter);
                    let v = Vec3::new(x, y, 0.3);
                    texture.sample(v, [Vec3::ZERO; 2], &options);
                    texture.sample(Vec3::ZERO, [v, v], &options);
                    texture.sample_area(v, [Vec3::X, v], &options);
                }
            }
        }
    }
}
