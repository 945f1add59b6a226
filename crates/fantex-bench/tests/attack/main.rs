//! Damaged files of every kind against their readers: never a panic, never more memory than allowed, never for long.
//!
//! A seeded number of files by default; `cargo xtask fuzz` goes on for a time, from other seeds. What is found names its seed.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use fantex::base::{Random, ReadLimits, ReadOptions};
use fantex::look::{LookFile, LookImages, ResolveOptions, Resolver};
use fantex::paint::{PaintOptions, Painter, StrokeLog, replay};
use fantex::store::{CreateOptions, Plan, VerifyOptions, merge_parts, verify_asset};
use fantex::texture::environment::EnvironmentMap;
use fantex::texture::{ColorSpace, Depth, Image, ImageTexture, Volume};
use fantex::{Baker, Footprint, Source};
use fantex_mesh::{CleanOptions, LoadOptions, clean, generate, load_bytes};
use fantex_test::fan_file::{crafted, sealed_part, section, with_section};
use fantex_test::{cleaned, rounds, workspace};

/// Counts what is allocated.
struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

#[expect(unsafe_code, reason = "an allocator is unsafe to implement; this one only counts and passes on")]
// SAFETY: all calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        PEAK.fetch_max(LIVE.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The budget, and what may be allocated beyond it: the file, tables of decoders, what is worked out from a small model.
const BUDGET: usize = 64 << 20;
const BEYOND: usize = 96 << 20;

/// Far beyond what any of these small files takes.
const MAX_TIME: Duration = Duration::from_secs(120);

/// Damages a file: flipped bits, numbers at the edge, cuts, repetitions; in texts also numbers as they are written.
fn damage(bytes: &[u8], is_text: bool, random: &mut Random) -> Vec<u8> {
    const NUMBERS: [u32; 10] = [0, 1, 2, 0x7f, 0xff, 0xffff, 0x4000, 0x7fff_ffff, 0x8000_0000, u32::MAX];
    const WORDS: [&str; 10] =
        ["0", "-1", "1e30", "1e-30", "NaN", "65536", "4294967295", "99999999999999999999", "\"\"", "[]"];
    let mut bytes = bytes.to_vec();
    for _ in 0..=random.below(4) {
        if bytes.len() < 8 {
            break;
        }
        // Headers are hit as often as all the rest.
        let reach = if random.chance(0.5) { bytes.len().min(256) } else { bytes.len() };
        let at = random.below(reach as u64 - 4) as usize;
        match random.below(if is_text { 7 } else { 5 }) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 => {
                let number = NUMBERS[random.below(10) as usize];
                let number = if random.chance(0.5) { number.to_le_bytes() } else { number.to_be_bytes() };
                bytes[at..at + 4].copy_from_slice(&number);
            }
            3 => bytes.truncate(at + 4),
            4 => {
                let end = (at + 1 + random.below(64) as usize).min(bytes.len());
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            _ => {
                let is_number = |b: &u8| b.is_ascii_digit() || b".-+eE".contains(b);
                if let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit) {
                    let start = at + start;
                    let length =
                        bytes[start..].iter().position(|b| !is_number(b)).unwrap_or(bytes.len() - start);
                    bytes.splice(start..start + length, WORDS[random.below(10) as usize].bytes());
                }
            }
        }
    }
    bytes
}

/// Gives a reader damaged copies of files: `cases` of each where no time is given.
fn attack(files: &[(String, Vec<u8>)], cases: u64, read: impl Fn(&str, &[u8])) {
    let is_text = |bytes: &[u8]| std::str::from_utf8(bytes).is_ok();
    attack_by(|bytes, random| damage(bytes, is_text(bytes), random), files, cases, read);
}

fn attack_by(
    damage: impl Fn(&[u8], &mut Random) -> Vec<u8>,
    files: &[(String, Vec<u8>)],
    cases: u64,
    read: impl Fn(&str, &[u8]),
) {
    // What is counted is the process's memory.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let options = ReadOptions { memory_bytes: BUDGET as u64, ..ReadOptions::default() };
    ReadLimits::new(options).make_default();
    for seed in rounds(cases) {
        for (number, (name, bytes)) in (0..).zip(files) {
            let damaged = damage(bytes, &mut Random::of_seeds([seed, number]));
            let before = LIVE.load(Relaxed);
            PEAK.store(before, Relaxed);
            let started = Instant::now();
            let survived = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| read(name, &damaged)));
            let (peak, time) = (PEAK.load(Relaxed) - before, started.elapsed());
            if survived.is_err() || peak > BUDGET + BEYOND || time > MAX_TIME {
                let kept = std::env::temp_dir().join(format!("fantex-attack-{seed}-{name}"));
                std::fs::write(&kept, &damaged).unwrap();
                panic!("{name}, seed {seed}: {peak} bytes, {time:?}; the file is {}", kept.display());
            }
        }
    }
}

fn shipped(names: &[&str]) -> Vec<(String, Vec<u8>)> {
    files_of("assets", names)
}

fn files_of(folder: &str, names: &[&str]) -> Vec<(String, Vec<u8>)> {
    let read = |name: &&str| {
        let path = workspace().join(folder).join(name);
        (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(path).unwrap())
    };
    names.iter().map(read).collect()
}

/// A small picture in every format, and a few that other programs have written.
fn images() -> Vec<(String, Vec<u8>)> {
    let texels: Vec<[f32; 4]> = (0..24 * 17_u32)
        .map(|i| [i as f32 / 408.0, (i % 24) as f32 / 24.0, (i % 7) as f32 / 7.0, 1.0])
        .collect();
    let image = Image::from_linear_rgb(24, 17, &texels);
    let folder = tempfile::tempdir().unwrap();
    let saved = |(name, image): (&str, Image)| {
        image.save(folder.path().join(name)).unwrap();
        (name.to_owned(), std::fs::read(folder.path().join(name)).unwrap())
    };
    let with_depth = |depth| image.converted(depth, ColorSpace::Srgb);
    let mut files: Vec<_> = [
        ("8.png", with_depth(Depth::U8)),
        ("16.png", with_depth(Depth::U16)),
        ("8.jpg", with_depth(Depth::U8)),
        ("8.tif", with_depth(Depth::U8)),
        ("float.tif", image.clone()),
        ("8.webp", with_depth(Depth::U8)),
        ("float.hdr", image.clone()),
        ("float.exr", image.clone()),
    ]
    .map(saved)
    .into();
    let header = [37_u32, 1, 4, 4, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 104, 0, 64, 0, 64, 0];
    let numbers: Vec<u8> = header.iter().flat_map(|n| n.to_le_bytes()).collect();
    files.push(("texels.ktx2".into(), [b"\xabKTX 20\xbb\r\n\x1a\n".as_slice(), &numbers, &[7; 64]].concat()));
    let mut dds = vec![124_u32, 0x1007, 4, 4, 16, 0, 0];
    dds.extend([0; 11]);
    dds.extend([32, 0x41, 0, 32, 0xff, 0xff00, 0x00ff_0000, 0xff00_0000, 0x1000, 0, 0, 0, 0]);
    let numbers: Vec<u8> = dds.iter().flat_map(|n| n.to_le_bytes()).collect();
    files.push(("texels.dds".into(), [b"DDS ".as_slice(), &numbers, &[7; 64]].concat()));
    let basis = ["etc1s_alpha.ktx2", "uastc.ktx2", "uastc_alpha_zstd.ktx2"];
    files.extend(files_of("crates/fantex-texture/tests/data", &basis));
    files
}

#[test]
#[ignore = "thousands of damaged files"]
fn images_are_refused_or_sound() {
    attack(&images(), 2000, |name, bytes| {
        if let Ok(image) = Image::decode(bytes, name, ColorSpace::Srgb) {
            let texture = ImageTexture::new(image.into());
            assert!(texture.level_count() > 0);
        }
        drop(Image::decode_all(bytes, name, ColorSpace::Linear, Default::default()));
    });
}

#[test]
#[ignore = "thousands of damaged files"]
fn environments_and_volumes_are_refused_or_sound() {
    let folder = tempfile::tempdir().unwrap();
    let header =
        b"ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let volume = ("small.mha".to_owned(), [&header[..], &[9; 512]].concat());
    let files = [images(), vec![volume]].concat();
    attack(&files, 500, |name, bytes| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        if name.ends_with(".mha") {
            drop(Volume::load_meta_image(&path, 1 << 40));
        } else {
            drop(EnvironmentMap::load(&path));
        }
    });
}

#[test]
#[ignore = "thousands of damaged files"]
fn models_are_refused_or_sound() {
    let mut files = shipped(&["models/CornellBox.glb", "models/teapot.stl", "WaterBottle/WaterBottle.gltf"]);
    let compressed = [
        "torus_draco_edgebreaker.glb",
        "torus_draco_sequential.glb",
        "torus_meshopt_ext.glb",
        "torus_meshopt_khr.glb",
    ];
    files.extend(files_of("crates/fantex-mesh/tests/data", &compressed));
    let text = |name: &str, text: &str| (name.to_owned(), text.as_bytes().to_vec());
    files.push(text("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .5 1\nusemtl a\nf 1 2 3 4\nf 1 2 5\nf -4 -3 -1\n"));
    files.push(text("a.ply", "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"));
    attack(&files, 400, |name, bytes| {
        if let Ok(model) = load_bytes(Path::new(name), bytes, &LoadOptions::default()) {
            drop(clean(model, &CleanOptions::default()));
        }
    });
}

/// Files that name others, which lie with them.
#[test]
#[ignore = "thousands of damaged files"]
fn materials_beside_models_are_refused_or_sound() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let material = "newmtl a\nKd 1 0.5 0\nmap_Kd -s 2 2 -o 0.5 0 -bm 0.3 a.png\nmap_d a.png\nnorm a.png\nmap_Pr a.png\n\
        map_Pm a.png\nPr 0.3\nPm 1\nKe 1 1 1\nillum 2\nd 0.5\n";
    let texels: Vec<[f32; 4]> = (0..64).map(|i| [i as f32 / 64.0; 4]).collect();
    Image::from_linear_rgba(8, 8, &texels).save(at("a.png")).unwrap();
    let model = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(at("a.obj"), model).unwrap();
    attack(&[("a.mtl".to_owned(), material.as_bytes().to_vec())], 2000, |name, bytes| {
        std::fs::write(at(name), bytes).unwrap();
        let Ok(mesh) = fantex::Mesh::load(at("a.obj")) else { return };
        drop(Baker::new(&mesh).texels(2000).overwrite(true).write(at("a.fan")));
    });
}

#[test]
#[ignore = "thousands of damaged files"]
fn cameras_of_photographs_are_refused_or_sound() {
    use fantex::glam::DVec3;
    use fantex::photos::{CameraFrame, CameraFromWorld, PhotoCamera, Photograph};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("images")).unwrap();
    let photographs: Vec<_> = (0..3)
        .map(|i| {
            let name = format!("{i}.png");
            std::fs::write(at("images").join(&name), "not looked at").unwrap();
            Photograph {
                path: at("images").join(&name),
                mask: None,
                name,
                camera: PhotoCamera::pinhole([64, 48], 50.0),
                camera_from_world: CameraFromWorld::looking_at(
                    DVec3::new(3.0, f64::from(i), 1.0),
                    DVec3::ZERO,
                    DVec3::Y,
                ),
            }
        })
        .collect();
    fantex::photos::write_colmap_text(folder.path(), &photographs).unwrap();
    fantex::photos::write_colmap_binary(folder.path(), &photographs).unwrap();
    fantex::photos::write_transforms(&at("transforms.json"), &photographs, "images").unwrap();
    let names = ["cameras.bin", "images.bin", "cameras.txt", "images.txt", "transforms.json"];
    let files = names.map(|name| (name.to_owned(), std::fs::read(at(name)).unwrap()));
    attack(&files, 2000, |name, bytes| {
        // Each kind alone in a folder, so that it is what is read.
        let alone = at("alone");
        std::fs::create_dir(&alone).unwrap();
        let kind = name.rsplit('.').next().unwrap();
        for (other, content) in files.iter().filter(|(other, _)| other.ends_with(kind)) {
            std::fs::write(alone.join(other), if other == name { bytes } else { content }).unwrap();
        }
        drop(fantex::photos::read_cameras(&alone, Some(&at("images")), CameraFrame::Original));
        std::fs::remove_dir_all(alone).unwrap();
    });
}

#[test]
#[ignore = "thousands of damaged files"]
fn looks_are_refused_or_sound() {
    let looks = fantex_gallery::FILES.iter().filter(|(name, _)| name.ends_with(".toml"));
    let files: Vec<_> =
        looks.map(|(name, bytes)| (name.rsplit('/').next().unwrap().to_owned(), bytes.to_vec())).collect();
    let mesh = cleaned(generate::icosphere(1));
    let images = LookImages::default();
    attack(&files, 60, |name, bytes| {
        let Ok(text) = std::str::from_utf8(bytes) else { return };
        let Ok(file) = LookFile::parse(text, &workspace().join("gallery").join(name)) else { return };
        let options = ResolveOptions { memory_bytes: 1 << 20, ..ResolveOptions::default() };
        let mut resolver = Resolver::new(&file, &mesh, &images, options);
        for name in file.look().textures.keys() {
            drop(resolver.texture(name));
        }
    });
}

#[test]
#[ignore = "thousands of damaged files"]
fn stroke_files_are_refused_or_read() {
    let stroke = r#"{ "version": 1, "strokes": [{ "label": "a", "brush": { "size": { "texels": 30 }, "hardness": 0.5, "spacing": 0.1 },
        "tool": { "blur": { "radius": { "world": 0.5 } } }, "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
        "samples": [{ "at": { "position": [1, 0, 0] }, "pressure": 0.5 }, { "at": { "position": [0, 1, 0] } }] }] }"#;
    let folder = tempfile::tempdir().unwrap();
    attack(&[("strokes.json".to_owned(), stroke.as_bytes().to_vec())], 4000, |name, bytes| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        drop(fantex::paint::StrokeFile::load(&path));
    });
}

/// Strokes of every tool are applied, with what they name: pictures, looks, texts in other fonts.
#[test]
#[ignore = "thousands of damaged files"]
fn strokes_are_refused_or_applied() {
    let strokes = r##"{ "version": 1, "strokes": [
        { "layer": { "name": "wood", "opacity": 0.5, "fill": { "look": { "file": "a.toml" },
            "textures": [{ "kind": "base_color", "texture": "a" }] } } },
        { "brush": { "size": { "world": 0.8 }, "hardness": 0.5, "flow": 0.7, "spacing": 0.2, "stamp": "a.png", "smoothing": 0.3 },
            "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }], "symmetry": { "radial": { "axis": 1, "center": [0, 0, 0], "count": 3 } },
            "samples": [{ "at": { "position": [1, 0, 0] }, "pressure": 0.5 }, { "at": { "position": [0, 1, 0] }, "tilt": [0.1, 0.2] }] },
        { "brush": { "size": { "texels": 9 } }, "tool": { "blur": { "radius": { "world": 0.1 } } },
            "channels": [{ "kind": "base_color" }], "samples": [{ "at": { "position": [0, 0, 1] } }] },
        { "text": { "text": "two\nlines", "size": { "world": 0.3 }, "angle": 20, "font": "a.ttf" },
            "channels": [{ "kind": "base_color", "color": { "srgb": [0.1, 0.9, 0.1] } }],
            "samples": [{ "at": { "position": [0, 0, 1] } }] },
        { "decal": { "size": { "world": 0.5 }, "shape": "a.png" },
            "channels": [{ "kind": "base_color", "color": { "image": "a.png" } }],
            "samples": [{ "at": { "position": [0, -1, 0] } }] }] }"##;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let mesh = fantex::Mesh::from_model(generate::icosphere(2), "ball").unwrap();
    Baker::new(&mesh).source(Source::solid("clouds")).texels(8000).write(&path).unwrap();
    let asset = std::fs::read(&path).unwrap();
    let texels: Vec<[f32; 4]> = (0..64).map(|i| [i as f32 / 64.0; 4]).collect();
    let at = |name: &str| folder.path().join(name);
    Image::from_linear_rgba(8, 8, &texels).save(at("a.png")).unwrap();
    let files = [
        ("strokes.json", strokes.as_bytes()),
        ("a.ttf", fantex::paint::DEFAULT_FONT),
        ("a.toml", b"[textures.a]\nkind = 'wood'\n"),
        ("a.png", &std::fs::read(at("a.png")).unwrap()),
    ]
    .map(|(name, bytes)| (name.to_owned(), bytes.to_vec()));
    let apply = |strict: bool| {
        std::fs::write(&path, &asset).unwrap();
        let mut painter = Painter::open(&path, &PaintOptions { memory_bytes: 8 << 20, history: true })?;
        let strokes = fantex::paint::StrokeFile::load(&at("strokes.json"))?;
        let applied = replay(&mut painter, &strokes, folder.path());
        drop(painter.commit());
        drop(painter);
        drop(verify_asset(
            fantex::Asset::open(&path)?.shared(),
            &VerifyOptions { memory_bytes: 1 << 20, texels: true },
        ));
        if strict { applied.map(drop) } else { Ok(()) }
    };
    files.iter().for_each(|(name, bytes)| std::fs::write(at(name), bytes).unwrap());
    apply(true).unwrap();
    attack(&files, 150, |name, bytes| {
        std::fs::write(at(name), bytes).unwrap();
        drop(apply(false));
        let (_, good) = files.iter().find(|(known, _)| known == name).unwrap();
        std::fs::write(at(name), good).unwrap();
    });
}

/// A painted asset: texels, layers with a look, history, a log with a stamp.
fn painted() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let mesh = fantex::Mesh::from_model(generate::icosphere(2), "ball").unwrap();
    Baker::new(&mesh).source(Source::solid("clouds")).texels(8000).write(&path).unwrap();
    let texels: Vec<[f32; 4]> = (0..64).map(|i| [i as f32 / 64.0; 4]).collect();
    Image::from_linear_rgba(8, 8, &texels).save(folder.path().join("a.png")).unwrap();
    let strokes = r##"{ "version": 1, "strokes": [
        { "layer": { "name": "wood", "fill": { "look": { "inline": { "text": "[textures.a]\nkind = 'wood'\n" } },
            "textures": [{ "kind": "base_color", "texture": "a" }] } } },
        { "brush": { "size": { "world": 0.8 }, "stamp": "a.png" },
            "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
            "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] } }] }] }"##;
    let strokes = serde_json::from_str(strokes).unwrap();
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    replay(&mut painter, &strokes, folder.path()).unwrap();
    painter.commit().unwrap();
    drop(painter);
    std::fs::read(&path).unwrap()
}

#[test]
#[ignore = "thousands of damaged files"]
fn assets_with_right_checksums_are_refused_or_sound() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("one/two");
    std::fs::create_dir_all(&inside).unwrap();
    let craft = |bytes: &[u8], random: &mut Random| {
        let seed = random.below(u64::MAX);
        let change =
            |raw: &[u8]| damage(raw, std::str::from_utf8(raw).is_ok(), &mut Random::of_seeds([seed, 0]));
        crafted(bytes, &mut |n| random.below(n), change)
    };
    attack_by(craft, &[("a.fan".to_owned(), painted())], 3000, |name, bytes| {
        let path = inside.join(name);
        std::fs::write(&path, bytes).unwrap();
        let Ok(asset) = fantex::Asset::open(&path) else { return };
        drop(verify_asset(asset.shared(), &VerifyOptions { memory_bytes: 1 << 20, texels: true }));
        let sampler = asset.sampler(1 << 20);
        let points = [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]].map(|p| asset.nearest_point(p));
        for (point, channel) in points.into_iter().flatten().zip(asset.channels()) {
            if let Ok(value) = sampler.sample(channel.kind, point, Footprint::NONE) {
                assert!(value.is_finite(), "{value}");
            }
        }
        if let Ok(log) = StrokeLog::of(&asset) {
            drop(log.save(&inside.join("log.json")));
        }
        drop((sampler, asset));
        if let Ok(mut painter) = Painter::open(&path, &PaintOptions { memory_bytes: 8 << 20, history: true })
        {
            drop(painter.undo());
            drop(painter.undo());
            drop(painter.redo());
            drop(painter.commit());
        }
        let beside = |folder: &Path| folder.read_dir().unwrap().count();
        assert_eq!([beside(folder.path()), beside(&folder.path().join("one"))], [1, 1], "files elsewhere");
    });
}

/// Plans and parts with right checksums: what is merged opens, and what its texels are is seen then.
#[test]
#[ignore = "thousands of damaged files"]
fn plans_and_parts_are_refused_or_sound() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mesh = fantex::Mesh::from_model(generate::icosphere(2), "ball").unwrap();
    let baker = || Baker::new(&mesh).source(Source::solid("clouds")).texels(8000).overwrite(true);
    baker().write_plan(at("plan"), b"note").unwrap();
    let plan = Plan::open(&at("plan")).unwrap();
    let parts = [1, 2, 3].map(|number| at(&format!("part{number}")));
    for (number, path) in (1..).zip(&parts) {
        baker().write_part(&plan, number, 3, path).unwrap();
    }
    let files: Vec<_> = ["plan", "part1", "part2", "part3"]
        .map(|name| (name.to_owned(), std::fs::read(at(name)).unwrap()))
        .into();
    let craft = |bytes: &[u8], random: &mut Random| {
        if !bytes.starts_with(b"FANPART2") {
            let index = random.below(4) as usize;
            return with_section(bytes, index, &damage(&section(bytes, index), false, random));
        }
        // The plan that it names stays.
        let mut damaged = damage(bytes, false, random);
        let named = damaged.len().min(24);
        damaged[..named].copy_from_slice(&bytes[..named]);
        sealed_part(&damaged)
    };
    attack_by(craft, &files, 1500, |name, bytes| {
        let path = at("damaged");
        std::fs::write(&path, bytes).unwrap();
        let (own, damaged) = match name {
            "plan" => (Plan::open(&path), usize::MAX),
            _ => (Ok(plan.clone()), name[4..].parse::<usize>().unwrap() - 1),
        };
        let Ok(own) = own else { return };
        let mut parts = parts.clone();
        if let Some(part) = parts.get_mut(damaged) {
            part.clone_from(&path);
        } else {
            drop(baker().write_part(&own, 1, 3, at("other")));
        }
        let is_sound = merge_parts(&own, &parts, None, &|_, _| ControlFlow::Continue(())).is_ok();
        let create = CreateOptions { force: true, ..CreateOptions::default() };
        let merged =
            merge_parts(&own, &parts, Some((&at("merged"), &create)), &|_, _| ControlFlow::Continue(()));
        assert_eq!(merged.is_ok(), is_sound, "a check finds what a merge finds: {merged:?}");
        if is_sound {
            let asset = fantex::Asset::open(at("merged")).unwrap();
            drop(verify_asset(asset.shared(), &VerifyOptions { memory_bytes: 1 << 20, texels: true }));
        }
    });
}
