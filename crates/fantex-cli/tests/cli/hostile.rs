//! Files that were made to do harm: memory, devices, paths, names, time.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::{COLORED_PLY, CUBE_OBJ, bottle, fails, fantex, files, run, stderr, succeeds, write};

/// Runs the program with 64 MiB for input and 1.2 GiB of addresses for all there is (programs, threads, files in memory).
#[cfg(target_os = "linux")]
fn confined(folder: &Path, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_fantex");
    let script = format!("ulimit -v 1250000; exec '{program}' --threads 2 --memory 64M {arguments}");
    Command::new("bash").args(["-c", &script]).current_dir(folder).output().unwrap()
}

/// Runs the program in a folder, with words that have no spaces.
fn run_in(folder: &Path, arguments: &str) -> Output {
    fantex().current_dir(folder).args(arguments.split(' ')).output().unwrap()
}

/// Numbers as bytes, lowest first.
fn le(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

/// An OpenEXR file without pixels, of so many by so many, in tiles where their side is given.
fn exr([width, height]: [i32; 2], tile: Option<u32>) -> Vec<u8> {
    let mut bytes = le(&[20_000_630, if tile.is_some() { 0x202 } else { 2 }]);
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend([name.as_bytes(), b"\0", kind.as_bytes(), b"\0"].concat());
        bytes.extend(le(&[value.len() as u32]));
        bytes.extend(value);
    };
    let channels = ["B", "G", "R"].map(|name| [name.as_bytes(), b"\0", &le(&[2, 0, 1, 1])].concat());
    attribute("channels", "chlist", &[channels.concat(), vec![0]].concat());
    attribute("compression", "compression", &[3]);
    let window = le(&[0, 0, width as u32 - 1, height as u32 - 1]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &le(&[0, 0, 15, 15]));
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1.0_f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1.0_f32.to_le_bytes());
    if let Some(side) = tile {
        attribute("tiles", "tiledesc", &[le(&[side, side]), vec![0]].concat());
    }
    bytes.push(0);
    bytes.resize(bytes.len() + 1500, 0);
    bytes
}

fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    // Checksums are those of the PNG format, by the bit.
    let mut crc = u32::MAX;
    for &byte in kind.iter().chain(data) {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
        }
    }
    [&(data.len() as u32).to_be_bytes()[..], kind, data, &(!crc).to_be_bytes()].concat()
}

fn png([width, height]: [u32; 2], color: u8, between: &[u8]) -> Vec<u8> {
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, color, 0, 0, 0]].concat();
    [
        b"\x89PNG\r\n\x1a\n".as_slice(),
        &chunk(b"IHDR", &header),
        between,
        &chunk(b"IDAT", &[]),
        &chunk(b"IEND", &[]),
    ]
    .concat()
}

/// Zeros as a zlib stream that is 158 times shorter: one block of fixed codes, nothing but the longest repetition.
fn packed_zeros(megabytes: usize) -> Vec<u8> {
    let mut bits: Vec<bool> = vec![true, true, false];
    // The literal 0, then length 258 (code 285) at distance 1 (code 0).
    bits.extend([false, false, true, true, false, false, false, false]);
    for _ in 0..(megabytes << 20) / 258 {
        bits.extend([true, true, false, false, false, true, false, true]);
        bits.extend([false; 5]);
    }
    bits.extend([false; 7]);
    let pack = |bits: &[bool]| bits.iter().enumerate().fold(0, |byte, (i, &bit)| byte | u8::from(bit) << i);
    [vec![0x78, 0x01], bits.chunks(8).map(pack).collect()].concat()
}

/// Images that claim more than they hold: one sentence, and no more memory than there may be.
#[cfg(target_os = "linux")]
#[test]
fn images_that_claim_too_much_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "cube.obj", CUBE_OBJ);
    let side = 16_383_u32;
    let lossless =
        [&b"RIFF\x1a\0\0\0WEBPVP8L\x0e\0\0\0\x2f"[..], &le(&[side | side << 14]), &[0; 9]].concat();
    let profile = [b"x\0\0".as_slice(), &packed_zeros(700)].concat();
    let ktx_header = [37, 1, side, side, 0, 0, 1, 1, 0];
    let ktx_rest = [0_u32; 14];
    let ktx = [b"\xabKTX 20\xbb\r\n\x1a\n".as_slice(), &le(&ktx_header), &le(&ktx_rest), &[0; 64]].concat();
    let tags: [(u16, u16, u32); 9] = [
        (256, 4, 60_000),
        (257, 4, 60_000),
        (258, 3, 32),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (279, 4, 16),
        (339, 3, 3),
    ];
    let entry = |&(tag, kind, value): &(u16, u16, u32)| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &le(&[1, value])].concat()
    };
    let entries: Vec<u8> = tags.iter().flat_map(entry).collect();
    let tiff = [b"II*\0\x08\0\0\0\x09\0".as_slice(), &entries, &[0; 64]].concat();
    for (name, bytes, word) in [
        ("window.exr", exr([60_000, 60_000], None), "parts in"),
        ("tile.exr", exr([30_000, 30_000], Some(30_000)), "--memory"),
        ("tiles.exr", exr([4000, 4000], Some(1)), "parts in"),
        ("wide.exr", exr([i32::MAX - 1, 16], None), "data window"),
        ("lossless.webp", lossless, "each side must be"),
        ("profile.png", png([16, 16], 2, &chunk(b"iCCP", &profile)), "profile.png"),
        ("large.png", png([30_000, 30_000], 6, &[]), "--memory"),
        ("grey.tif", tiff, "--memory"),
        ("texels.ktx2", ktx, "texels.ktx2"),
    ] {
        write(folder.path(), name, bytes);
        let output = confined(
            folder.path(),
            &format!("bake cube.obj -o out.fan --texels 4k --source image={name},mapping=box"),
        );
        let errors = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {errors}");
        assert!(
            errors.contains(word) && errors.contains(name) && errors.lines().count() == 1,
            "{name}: {errors}"
        );
    }
}

/// A few letters that ask for gigabytes.
#[cfg(target_os = "linux")]
#[test]
fn amplification_is_bounded_by_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let zeroed = |count: u32, nodes: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{"componentType":5126,"count":{count},"type":"VEC3"}}]}}"#
        )
    };
    let many: Vec<u32> = (1..4000).collect();
    let group = format!("{{\"children\":{many:?}}}{}", ",{\"mesh\":0}".repeat(3999));
    write(folder.path(), "zeroed.gltf", zeroed(16_000_000, "{\"mesh\":0}"));
    write(folder.path(), "instances.gltf", zeroed(30_000, &group));
    for name in ["zeroed.gltf", "instances.gltf"] {
        let output = confined(folder.path(), &format!("info {name}"));
        let errors = stderr(&output);
        assert!(output.status.code() == Some(1) && errors.contains("--memory"), "{name}: {errors}");
    }
    let size =
        confined(folder.path(), &format!("render {} -o out.png --size 16384x16384", bottle().display()));
    assert!(size.status.code() == Some(1) && stderr(&size).contains("--memory"), "{}", stderr(&size));
    let asset = folder.path().join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    fails(1, &["section", "--memory"], &[&"info", &asset, &"--memory", &"100k"]);
}

/// Nothing but files is read, and nobody waits.
#[cfg(target_os = "linux")]
#[test]
fn devices_and_pipes_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "cube.obj", CUBE_OBJ);
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let place = |name: &str| folder.path().join(name).display().to_string();
    for special in ["/dev/zero".to_owned(), pipe.display().to_string()] {
        std::fs::remove_file(folder.path().join("link.png")).unwrap_or_default();
        std::os::unix::fs::symlink(&special, folder.path().join("link.png")).unwrap();
        write(
            folder.path(),
            "look.toml",
            format!(
                "[textures.t]\nkind = \"image\"\nimage = \"{special}\"\n[materials.m]\nbase_color = \"t\"\n"
            ),
        );
        for arguments in [
            vec!["info".into(), special.clone()],
            vec![
                "bake".into(),
                place("cube.obj"),
                "-o".into(),
                place("o.fan"),
                "--source".into(),
                format!("image={},mapping=box", place("link.png")),
            ],
            vec![
                "render".into(),
                place("cube.obj"),
                "--look".into(),
                special.clone(),
                "-o".into(),
                place("o.png"),
            ],
            vec![
                "render".into(),
                place("cube.obj"),
                "--look".into(),
                place("look.toml"),
                "-o".into(),
                place("o.png"),
            ],
            vec![
                "render".into(),
                place("cube.obj"),
                "--environment".into(),
                special.clone(),
                "-o".into(),
                place("o.png"),
            ],
            vec!["verify".into(), special.clone()],
        ] {
            let mut child =
                fantex().args(&arguments).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
            let deadline = Instant::now() + fantex_test::PATIENCE;
            while child.try_wait().unwrap().is_none() {
                if Instant::now() > deadline {
                    child.kill().unwrap();
                    panic!("{arguments:?} does not end");
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            let errors = stderr(&child.wait_with_output().unwrap());
            assert!(
                errors.contains("not a regular file") || errors.contains("is not an asset"),
                "{arguments:?}: {errors}"
            );
        }
    }
}

/// Files of a model lie with it.
#[test]
fn models_name_nothing_outside_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    write(folder.path(), "secret.bin", [0; 36]);
    write(folder.path(), "secret.mtl", "newmtl a\nKd 1 0 0\n");
    let gltf = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"../secret.bin","byteLength":36}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}]}"#;
    let model = write(&folder.path().join("in"), "model.gltf", gltf);
    fails(1, &["outside its folder", "--allow-outside"], &[&"info", &model]);
    let allowed = stderr(&run(&[&"info", &model, &"--allow-outside"]));
    assert!(!allowed.contains("outside"), "{allowed}");
    let object = write(&folder.path().join("in"), "model.obj", format!("mtllib ../secret.mtl\n{CUBE_OBJ}"));
    let report = |arguments: &[&dyn AsRef<std::ffi::OsStr>]| {
        String::from_utf8_lossy(&succeeds(arguments).stdout).into_owned()
    };
    assert!(report(&[&"info", &object]).contains("outside its folder"));
    assert!(!report(&[&"info", &object, &"--allow-outside"]).contains("outside"));
}

/// By whatever name.
#[test]
fn no_command_writes_what_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let asset = at("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let picture = at("picture.png");
    succeeds(&[&"render", &model, &"-o", &picture, &"--size", &"64x32"]);
    let look = write(folder.path(), "look.toml", "[materials.m]\nbase_color = [1.0, 0.0, 0.0]\n");
    std::fs::hard_link(&asset, at("hard.fan")).unwrap();
    std::fs::hard_link(&picture, at("hard.png")).unwrap();
    std::fs::hard_link(&look, at("hard.png.toml")).unwrap();
    let before: Vec<Vec<u8>> = [&asset, &model, &picture, &look].map(|p| std::fs::read(p).unwrap()).into();
    let names = files(folder.path());
    for arguments in [
        "paint bottle.fan --export-log bottle.fan",
        "paint bottle.fan --export-log hard.fan",
        "bake colored.ply -o colored.ply",
        "bake colored.ply --source image=picture.png,mapping=box -o hard.png --texels 4k",
        "render colored.ply --environment picture.png -o hard.png --size 64x32",
        "render colored.ply --look look.toml -o hard.png.toml",
        "render bottle.fan -o hard.fan",
        "export bottle.fan -o hard.fan --channel base-color",
        "info colored.ply --layout colored.ply",
    ] {
        let output = run_in(folder.path(), &format!("--force {arguments}"));
        assert!(output.status.code() != Some(0), "{}", stderr(&output));
        assert_eq!(files(folder.path()), names);
        for (path, bytes) in [&asset, &model, &picture, &look].into_iter().zip(&before) {
            assert!(
                std::fs::read(path).unwrap() == *bytes,
                "{} has changed: {}",
                path.display(),
                stderr(&output)
            );
        }
    }
}

/// `damaged.fan`, no cluster of which can be read, and the model `colored.ply` that it was baked from.
fn damaged_asset(folder: &Path) -> [PathBuf; 2] {
    let model = write(folder, "colored.ply", COLORED_PLY);
    let asset = folder.join("good.fan");
    let whole: [&dyn AsRef<std::ffi::OsStr>; 2] = [&"--longest-edge", &"0"];
    let bake: [&dyn AsRef<std::ffi::OsStr>; 8] =
        [&"bake", &model, &"-o", &asset, &"--texels", &"64k", &"--format", &"rgba8"];
    succeeds(&[bake.as_slice(), &whole].concat());
    let mut bytes = std::fs::read(&asset).unwrap();
    // In every cluster: each begins at a multiple of 4096, after one for the sections.
    bytes[3 * 4096 + 16..].iter_mut().step_by(4096).for_each(|byte| *byte ^= 0x10);
    [write(folder, "damaged.fan", bytes), model]
}

/// Damage is always said; with --strict it is an error.
#[test]
fn damaged_tiles_are_said_and_strictly_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [damaged, _] = damaged_asset(folder.path());
    let picture = folder.path().join("o.png");
    let shown = succeeds(&[&"render", &damaged, &"-o", &picture, &"--size", &"512x512", &"--quiet"]);
    assert!(stderr(&shown).contains("coarser texels stand in"), "{}", stderr(&shown));
    let strict: [&dyn AsRef<std::ffi::OsStr>; 8] =
        [&"render", &damaged, &"-o", &picture, &"--size", &"512x512", &"--force", &"--strict"];
    fails(1, &["coarser texels stand in"], &strict);
    let exported = folder.path().join("o.glb");
    let said = succeeds(&[&"export", &damaged, &"-o", &exported, &"--quiet"]);
    assert!(stderr(&said).contains("coarser texels stand in"), "{}", stderr(&said));
    fails(1, &["coarser texels stand in"], &[&"export", &damaged, &"-o", &exported, &"--force", &"--strict"]);
}

/// With --strict nothing is written where coarser texels stand in, and what is there stays.
#[test]
fn strict_failures_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [damaged, model] = damaged_asset(folder.path());
    let at = |name: &str| folder.path().join(name);
    let before = std::fs::read(&damaged).unwrap();
    let there = write(folder.path(), "there.glb", "there");
    let strokes = write(
        folder.path(),
        "blur.json",
        r#"{"version": 1, "strokes": [{"label": "soft", "tool": {"blur": {"radius": {"texels": 8}}},
            "channels": [{"kind": "base_color"}], "samples": [{"at": {"position": [0, 0, 0]}}]}]}"#,
    );
    let source = format!("mesh={}", damaged.display());
    let names = files(folder.path());
    let stands_in: &[&str] = &["damaged.fan", "coarser texels stand in"];
    let flags: [&dyn AsRef<std::ffi::OsStr>; 2] = [&"--strict", &"--force"];
    let refused = |words: &[&str], arguments: &[&dyn AsRef<std::ffi::OsStr>]| {
        fails(1, words, &[arguments, &flags].concat());
        assert_eq!(files(folder.path()), names);
        assert!(std::fs::read(&damaged).unwrap() == before, "the asset has changed");
        assert_eq!(std::fs::read(&there).unwrap(), b"there");
    };
    let (glb, png, fan) = (at("new.glb"), at("new.png"), at("new.fan"));
    refused(stands_in, &[&"export", &damaged, &"-o", &glb, &"--size", &"256"]);
    refused(stands_in, &[&"export", &damaged, &"-o", &there, &"--size", &"256"]);
    refused(stands_in, &[&"export", &damaged, &"-o", &png, &"--channel", &"base-color", &"--size", &"256"]);
    refused(stands_in, &[&"export", &damaged, &"-o", &png, &"--turntable", &"2", &"--size", &"256"]);
    refused(stands_in, &[&"export", &damaged, &"-o", &glb, &"--fans"]);
    refused(stands_in, &[&"bake", &model, &"-o", &fan, &"--source", &source, &"--texels", &"16k"]);
    refused(stands_in, &[&"preview", &damaged, &"--texels", &"100k"]);
    refused(&[], &[&"paint", &damaged, &"--replay", &strokes]);
    let said =
        succeeds(&[&"bake", &model, &"-o", &fan, &"--source", &source, &"--texels", &"16k", &"--quiet"]);
    assert!(stderr(&said).contains("coarser texels stand in"), "{}", stderr(&said));
}

/// Names in files cannot move the cursor, change colours or titles.
#[test]
fn no_escape_sequence_reaches_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    write(
        folder.path(),
        "look.toml",
        "[textures.\"\\u001b]0;title\\u0007\"]\nkind = \"image\"\nimage = \"\\u001b[31mred\"\n[materials.m]\nbase_color = \"\\u001b]0;title\\u0007\"\n",
    );
    write(folder.path(), "cube.obj", CUBE_OBJ);
    for arguments in ["info look.toml", "render cube.obj --look look.toml -o o.png"] {
        let output = run_in(folder.path(), arguments);
        let all = [output.stdout, output.stderr].concat();
        assert!(
            !all.contains(&0x1b) && !all.contains(&7),
            "{}",
            String::from_utf8_lossy(&all).escape_debug()
        );
    }
}

/// A palette of one byte makes a decoder panic; nobody hears of it.
#[test]
fn panics_of_decoders_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let image = write(folder.path(), "palette.png", png([16, 16], 3, &chunk(b"PLTE", &[1])));
    let source = format!("image={},mapping=box", image.display());
    let asset = folder.path().join("o.fan");
    let output = run(&[&"bake", &model, &"-o", &asset, &"--source", &source, &"--texels", &"4k"]);
    let errors = stderr(&output);
    assert!(output.status.code() == Some(1) && errors.lines().count() == 1, "{errors}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_error_is_no_panic() {
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = fantex().args(["info", "/nowhere.obj"]).stderr(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let output = fantex().arg("info").arg(bottle()).stderr(full()).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
}

/// Work that grows faster than the file is refused or bounded.
#[test]
fn small_files_take_no_minutes() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let started = Instant::now();
    // Each level uses the one below twice.
    let mut doubling =
        "[materials.m]\nbase_color = \"t40\"\n[textures.t0]\nkind = \"color\"\ncolor = [1.0, 0.0, 0.0]\n"
            .to_owned();
    for i in 1..=40 {
        writeln!(doubling, "[textures.t{i}]\nkind = \"mix\"\na = \"t{0}\"\nb = \"t{0}\"\nmask = 0.5", i - 1)
            .unwrap();
    }
    let doubling = write(folder.path(), "doubling.toml", doubling);
    let picture = folder.path().join("o.png");
    fails(1, &["evaluated for each point"], &[&"render", &model, &"--look", &doubling, &"-o", &picture]);
    let mut chain = "[textures.t0]\nkind = \"color\"\ncolor = [1.0, 0.0, 0.0]\n".to_owned();
    for i in 1..=20_000 {
        writeln!(chain, "[textures.t{i}]\nkind = \"mix\"\na = \"t{}\"\nb = 1.0\nmask = 0.5", i - 1).unwrap();
    }
    fails(1, &["in a row"], &[&"info", &write(folder.path(), "chain.toml", chain)]);
    // An outline that crosses itself everywhere.
    let corners = 16_384_u32;
    let mut star = String::new();
    for i in 0..corners {
        let angle = f64::from(i) * 2.399_963;
        writeln!(star, "v {} {} 0", angle.cos() * f64::from(1 + i % 7), angle.sin() * f64::from(1 + i % 5))
            .unwrap();
    }
    star += "f";
    (1..=corners).for_each(|i| write!(star, " {i}").unwrap());
    succeeds(&[&"info", &write(folder.path(), "star.obj", star), &"--texels", &"64k"]);
    // One vertex with 200 000 triangles.
    let rim = 200_000_u32;
    let mut umbrella = "v 0 0 0.5\n".to_owned();
    for i in 0..rim {
        let angle = f64::from(i) / f64::from(rim) * std::f64::consts::TAU;
        writeln!(umbrella, "v {} {} 0", angle.cos(), angle.sin()).unwrap();
    }
    (0..rim).for_each(|i| writeln!(umbrella, "f 1 {} {}", i + 2, (i + 1) % rim + 2).unwrap());
    succeeds(&[&"info", &write(folder.path(), "umbrella.obj", umbrella), &"--texels", &"64k"]);
    eprintln!("{:.1} s", started.elapsed().as_secs_f64());
}

/// What a killed process has left goes with the next one's work; what is in use stays.
#[cfg(target_os = "linux")]
#[test]
fn what_killed_processes_left_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let old = |name: &str| {
        let path = write(folder.path(), name, "left");
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_modified(std::time::SystemTime::now() - Duration::from_secs(3600)).unwrap();
        file
    };
    old(".fantex-stale");
    let used = old(".fantex-used.tmp");
    used.lock_shared().unwrap();
    write(folder.path(), ".fantex-young", "young");
    succeeds(&[&"bake", &model, &"-o", &folder.path().join("a.fan"), &"--texels", &"4k"]);
    assert_eq!(files(folder.path()), [".fantex-used.tmp", ".fantex-young", "a.fan", "colored.ply"]);
    // Locks of assets lie in the folder for temporary files.
    std::fs::create_dir(folder.path().join("tmp")).unwrap();
    old("tmp/.fantex-1-2-3.lock");
    let mut over = fantex();
    over.env("TMPDIR", folder.path().join("tmp")).arg("bake").arg(&model).args(["--texels", "4k", "--force"]);
    let output = over.arg("-o").arg(folder.path().join("a.fan")).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(files(&folder.path().join("tmp")), [] as [&str; 0]);
}

/// Serves ranges of a file, a connection at a time, until the process ends.
fn serve(bytes: Vec<u8>) -> String {
    use std::io::{BufRead, BufReader, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/asset.fan", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let bytes = bytes.clone();
            std::thread::spawn(move || {
                let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
                while let Some(Ok(line)) = lines.next() {
                    if let Some(range) = line.to_ascii_lowercase().strip_prefix("range: bytes=") {
                        let ends: Vec<usize> = range.split('-').map(|n| n.parse().unwrap()).collect();
                        let last = ends[1].min(bytes.len() - 1);
                        let body = &bytes[ends[0]..=last];
                        let head = format!(
                            "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes {}-{last}/{}\r\nContent-Length: {}\r\n\r\n",
                            ends[0],
                            bytes.len(),
                            body.len()
                        );
                        let sent = [head.as_bytes(), body].concat();
                        if (&stream).write_all(&sent).is_err() {
                            return;
                        }
                    }
                }
            });
        }
    });
    url
}

#[test]
fn commands_read_assets_on_web_servers() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "colored.ply", COLORED_PLY);
    assert!(run_in(folder.path(), "bake colored.ply -o a.fan --texels 16k").status.success());
    let url = serve(std::fs::read(folder.path().join("a.fan")).unwrap());
    for arguments in [
        "info URL",
        "verify URL",
        "render URL -o r.png --size 64x64",
        "compare URL a.fan --size 64x64 --views 1",
        "export URL -o e.png --channel base-color",
    ] {
        let output = run_in(folder.path(), &arguments.replace("URL", &url));
        assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    }
}
