//! The npm package for three.js in a real browser: its pictures beside the CPU renderer's, what it says, and what it leaves behind.
//!
//! Skipped where the package has not been built (`cargo xtask web`), or where there is no three.js (`npm ci` in `three`), no Chromium with its
//! driver, or no Python, whose server hands out the page.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fantex::texture::compare::{compare_where, psnr_db};
use fantex::texture::{Image, Samples};
use fantex_test::{skip, workspace};
use serde_json::Value;

use super::driver::Browser;
use super::{Running, SIZE, bottle, fantex, serve, serve_folder, text};

/// Where pictures are taken from: eye, target, opening angle.
pub(super) type View = [&'static str; 3];

/// All of a bottle.
pub(super) const WHOLE: View = ["0.25,0.15,0.45", "0,0,0", "35"];

/// A part of it.
pub(super) const NEAR: View = ["0.06,0.05,0.16", "0.03,0,0.03", "35"];

/// A browser and the page's address, where both are to be had.
pub(super) fn page() -> Option<(Browser, Running, String)> {
    let folder = workspace().join("three");
    if !folder.join("built/fantex_three_bg.wasm").is_file() {
        skip("the package for three.js is not built (cargo xtask web)");
        return None;
    }
    if !folder.join("node_modules/three/package.json").is_file() {
        skip("three.js is not installed (npm ci in the folder three)");
        return None;
    }
    let Some(browser) = Browser::start(SIZE) else {
        skip("no chromium with chromedriver");
        return None;
    };
    let Some((server, url)) = serve_folder(&folder) else {
        skip("no python3");
        return None;
    };
    Some((browser, server, format!("{url}test/page.html")))
}

/// The page's address with an asset, the view, and more.
pub(super) fn address(page: &str, asset: &str, view: View, more: &str) -> String {
    let [eye, target, fov] = view;
    format!("{page}?asset={asset}&eye={eye}&target={target}&fov={fov}{more}")
}

pub(super) fn load(browser: &Browser, url: &str) {
    browser.open(url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
}

/// What the page's canvas shows.
pub(super) fn picture(browser: &Browser, path: &Path) -> Image {
    decoded(&browser.run("return test.picture()"), path)
}

/// The picture of a `data:` address, which is kept as a file.
pub(super) fn decoded(url: &Value, path: &Path) -> Image {
    let (_, base64) = url.as_str().unwrap().split_once("base64,").unwrap();
    std::fs::write(path, STANDARD.decode(base64).unwrap()).unwrap();
    Image::load(path).unwrap()
}

/// The CPU renderer's picture of the same view, and which of its pixels count.
pub(super) struct Expected {
    picture: Image,
    /// Those that no edge crosses: one sample gives the same there as 64, within a byte. Elsewhere renderers differ by where their samples lie.
    counts: Vec<bool>,
}

impl Expected {
    pub(super) fn render(asset: &Path, view: View, folder: &Path, more: &[&str]) -> Self {
        let [eye, target, fov] = view;
        let size = format!("{}x{}", SIZE[0], SIZE[1]);
        let path = folder.join("expected.png");
        let picture = |samples: &str| {
            let view =
                ["--eye", eye, "--target", target, "--fov", fov, "--size", &size, "--samples", samples];
            let rest = ["--background", "transparent", "--force"];
            fantex(&[&["render", text(asset), "-o", text(&path)], &view[..], &rest, more].concat());
            Image::load(&path).unwrap()
        };
        let [single, many] = ["1", "64"].map(|samples| texels(&picture(samples)));
        let is_same = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1);
        let counts: Vec<bool> =
            single.iter().zip(&many).map(|pair| pair.0[3] == 255 && is_same(pair)).collect();
        let (covered, counted) =
            (single.iter().filter(|texel| texel[3] > 0).count(), counts.iter().filter(|c| **c).count());
        assert!(counted * 100 > covered * 95, "{counted} of {covered} pixels count");
        Self { picture: picture("8"), counts }
    }

    pub(super) fn psnr_db(&self, shown: &Image) -> f64 {
        compare_where(&self.picture, shown, &self.counts).unwrap().psnr_db
    }
}

/// sRGB and alpha, row by row.
fn texels(picture: &Image) -> Vec<[u8; 4]> {
    let Samples::U8(samples) = &picture.samples else { panic!("a PNG has bytes") };
    assert_eq!(picture.channels, 4);
    samples.as_chunks().0.to_vec()
}

/// A bottle that no lamp lights.
pub(super) fn unlit_bottle(folder: &Path, texels: &str) -> PathBuf {
    let source = workspace().join("assets/WaterBottle");
    let model = folder.join("model");
    std::fs::create_dir(&model).unwrap();
    for entry in source.read_dir().unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file()) {
        std::fs::copy(entry.path(), model.join(entry.file_name())).unwrap();
    }
    let path = model.join("WaterBottle.gltf");
    let mut gltf: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for material in gltf["materials"].as_array_mut().unwrap() {
        material["extensions"] = serde_json::json!({ "KHR_materials_unlit": {} });
    }
    gltf["extensionsUsed"] = serde_json::json!(["KHR_materials_unlit"]);
    std::fs::write(&path, gltf.to_string()).unwrap();
    let asset = folder.join("unlit.fan");
    fantex(&["bake", text(&path), "-o", text(&asset), "--texels", texels]);
    asset
}

#[test]
fn three_shows_the_texture_function() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = unlit_bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let expected = Expected::render(&asset, WHOLE, folder.path(), &[]);
    // Compressed as it is stored, and decoded.
    for (compressed, query) in [(true, ""), (false, "&compressed=0")] {
        load(&browser, &address(&page, &info.asset_url, WHOLE, query));
        assert_eq!(browser.run("return test.fan().isCompressed"), compressed);
        let shown = picture(&browser, &folder.path().join("shown.png"));
        let decibels = expected.psnr_db(&shown);
        println!("compressed {compressed}: {decibels:.1} dB");
        // Measured 49.1 dB: nearly all pixels are equal, or a byte apart.
        assert!(decibels > 45.0, "compressed {compressed}: {decibels} dB");
    }
}

#[test]
fn three_shows_tiles_of_several_pages() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = unlit_bottle(folder.path(), "6M");
    let (_server, info) = serve(&asset, &["--share"]);
    let expected = Expected::render(&asset, NEAR, folder.path(), &[]);
    load(&browser, &address(&page, &info.asset_url, NEAR, ""));
    assert_eq!(
        browser
            .run("return [test.fan().material].flat().some((material) => 'FAN_PAGED' in material.defines)"),
        true
    );
    let decibels = expected.psnr_db(&picture(&browser, &folder.path().join("shown.png")));
    println!("{decibels:.1} dB");
    // Measured 63.1 dB.
    assert!(decibels > 50.0, "{decibels} dB");
}

#[test]
fn three_lights_all_channels() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    // The sun alone: three's ambient light is not the CPU renderer's.
    let black = folder.path().join("black.png");
    Image::from_linear_rgb(2, 1, &[[0.0; 4]; 2]).save(&black).unwrap();
    let sun = "1,2,3";
    let lit = ["--light", sun, "--environment", text(&black)];
    let expected = Expected::render(&asset, WHOLE, folder.path(), &lit);
    load(&browser, &address(&page, &info.asset_url, WHOLE, &format!("&sun={sun}")));
    let decibels = |name: &str| expected.psnr_db(&picture(&browser, &folder.path().join(name)));
    let all = decibels("shown.png");
    println!("{all:.1} dB");
    // Measured 36.4 dB: light that three's metals reflect several times in their roughness makes them brighter.
    assert!(all > 35.0, "{all} dB");
    for channel in ["FAN_NORMAL", "FAN_MATERIAL", "FAN_EMISSION", "FAN_BASE_COLOR"] {
        browser.run(&format!("test.set('{channel}', false)"));
        let without = decibels("without.png");
        browser.run(&format!("test.set('{channel}', true)"));
        println!("and without {channel}: {without:.1} dB");
        assert!(without < all - 0.3, "{channel} changes nothing: {without} dB");
    }
}

#[test]
fn three_shows_again_what_a_lost_context_took() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    load(&browser, &address(&page, &info.asset_url, WHOLE, "&sun=1,2,3"));
    let before = picture(&browser, &folder.path().join("before.png"));
    browser.run(
        "window.lost = test.renderer.getContext().getExtension('WEBGL_lose_context'); lost.loseContext()",
    );
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert_eq!(browser.run("return test.renderer.getContext().isContextLost()"), true);
    browser.run("document.documentElement.dataset.state = 'lost'; lost.restoreContext()");
    std::thread::sleep(std::time::Duration::from_millis(500));
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
    let after = picture(&browser, &folder.path().join("after.png"));
    // Tiles may lie elsewhere in the atlas, where coordinates are rounded otherwise.
    let decibels = psnr_db(&before, &after).unwrap();
    assert!(decibels > 60.0, "{decibels} dB");
}

#[test]
fn three_leaves_nothing_behind() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    load(&browser, &address(&page, &info.asset_url, WHOLE, "&sun=1,2,3"));
    let before = browser.run("return test.before");
    let during = browser.run("return test.counts()");
    assert!(during["geometries"].as_u64() > before["geometries"].as_u64(), "{during}");
    // Textures that three does not count are counted as the context's own.
    browser.run(
        "const gl = test.renderer.getContext(); const remove = gl.deleteTexture; window.removed = 0;
         gl.deleteTexture = (texture) => { removed += gl.isTexture(texture) ? 1 : 0; remove.call(gl, texture); }",
    );
    let after = browser.run("return test.dispose()");
    let with_sun = |counts: &Value| {
        let mut counts = counts.clone();
        counts["children"] = 1.into();
        counts
    };
    assert_eq!(with_sun(&after), with_sun(&before));
    assert_eq!(after["children"], 1, "only the sun is left");
    let channels = 4;
    assert_eq!(browser.run("return removed"), channels + 4, "atlases, page table, groups, means, frames");
}

#[test]
fn three_says_what_is_wrong() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let said = |url: &str| {
        browser.open(url);
        let (state, said) = browser.wait_for(&["sharp", "failed"]);
        assert_eq!(state, "failed");
        said
    };
    // In a worker, and on the page. What the browser's cache has already it hands out in ranges.
    for (more, file) in [("", "/package.json"), ("&worker=0", "/README.md")] {
        let missing = said(&address(&page, &info.asset_url.replace("bottle", "vase"), WHOLE, more));
        assert!(missing.contains("vase.fan") && missing.contains("404 Not Found"), "{missing}");
        // Python's server knows no ranges, and hands out this file beside the page.
        let whole = said(&address(&page, file, WHOLE, more));
        assert!(whole.contains("does not support range requests"), "{whole}");
    }
}

#[test]
fn every_material_of_three_shows_the_channels() {
    let Some((browser, _pages, page)) = page() else { return };
    for renderer in ["webgl", "webgpu", "webgl2"] {
        browser.open(&page.replace("page.html", &format!("materials.html?renderer={renderer}")));
        let (state, rows) = browser.wait_for(&["sharp", "failed"]);
        assert_eq!(state, "sharp", "{rows}");
        let rows: Vec<(String, [u8; 4], String)> = serde_json::from_str(&rows).unwrap();
        assert_eq!(rows.len(), 26);
        for (name, pixel, error) in &rows {
            assert_eq!(error, "", "{renderer}, {name}: the device says");
            let [red, green, blue, _] = *pixel;
            match name.as_str() {
                // What is cut out casts no shadow.
                "opaque" => assert!(green < 8, "{renderer}: the floor is {pixel:?}, without a shadow"),
                "cut out" => {
                    assert!(green > 64, "{renderer}: the floor is {pixel:?}, in the shadow of nothing")
                }
                // Towards the camera.
                "MeshNormalMaterial" => {
                    let is_near =
                        [red, green, blue].iter().zip([128, 128, 255]).all(|(a, b)| a.abs_diff(b) <= 1);
                    assert!(is_near, "{renderer}, {name}: {pixel:?}");
                }
                _ => assert!(green > 64 && red < 8 && blue < 8, "{renderer}, {name}: {pixel:?} is not green"),
            }
        }
    }
}

/// A sphere of 1280 triangles with smooth waves on it that no lamp lights, in tiles of one fan each: a third of it lies in blend bands.
fn waves(folder: &Path) -> PathBuf {
    let (model, look, asset) = (folder.join("ball.obj"), folder.join("waves.toml"), folder.join("waves.fan"));
    let ball = fantex::mesh::generate::icosphere(3);
    let mut obj = String::new();
    for [x, y, z] in ball.positions.iter().map(|p| p.to_array()) {
        obj += &format!("v {x} {y} {z}\n");
    }
    for [a, b, c] in ball.triangles.iter().map(|t| t.map(|v| v + 1)) {
        obj += &format!("f {a} {b} {c}\n");
    }
    std::fs::write(&model, obj).unwrap();
    let text_of_look = "
        [textures.waves]
        kind = \"sines\"
        offset = 0.5
        waves = [
            { direction = [1, 0.3, 0], length = 1.5, amplitude = 0.2 },
            { direction = [0.2, 1, 0.4], length = 0.9, amplitude = 0.2, phase = 40 },
        ]
        [materials.\"*\"]
        base_color = \"waves\"
        color_use = \"replace\"
        lighting = \"unlit\"
    ";
    std::fs::write(&look, text_of_look).unwrap();
    fantex(&[
        "bake",
        text(&model),
        "-o",
        text(&asset),
        "--look",
        text(&look),
        "--texels",
        "256k",
        "--tile",
        "16",
    ]);
    asset
}

/// The largest difference of neighbouring pixels that both lie on the surface, and whose other neighbours do, too; 0 to 1.
fn largest_step(picture: &Image) -> f32 {
    let [width, height] = [picture.width, picture.height];
    let is_covered = |x: u32, y: u32| picture.linear_texel(x, y)[3] == 1.0;
    let is_inner = |x: u32, y: u32| {
        (x.saturating_sub(3)..=(x + 3).min(width - 1)).all(|x| is_covered(x, y))
            && (y.saturating_sub(3)..=(y + 3).min(height - 1)).all(|y| is_covered(x, y))
    };
    let mut largest = 0.0_f32;
    for (x, y) in (0..height - 1).flat_map(|y| (0..width - 1).map(move |x| (x, y))) {
        for [right, down] in [[1, 0], [0, 1]] {
            if is_inner(x, y) && is_inner(x + right, y + down) {
                let [here, there] =
                    [[x, y], [x + right, y + down]].map(|[x, y]| picture.linear_texel(x, y)[0]);
                largest = largest.max((here - there).abs());
            }
        }
    }
    largest
}

#[test]
fn three_shows_no_seams_at_any_level() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = waves(folder.path());
    let (_server, info) = serve(&asset, &["--share"]);
    let [eye, target, fov] = ["0,0.5,4", "0,0,0", "35"];
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let path = folder.path().join("expected.png");
    let view =
        ["--eye", eye, "--target", target, "--fov", fov, "--size", &size, "--background", "transparent"];
    fantex(&[&["render", text(&asset), "-o", text(&path)], &view[..]].concat());
    let smooth = largest_step(&Image::load(&path).unwrap());
    for error_target in ["1", "4", "16"] {
        let query =
            format!("?asset={}&eye={eye}&target={target}&fov={fov}&error={error_target}", info.asset_url);
        load(&browser, &format!("{page}{query}"));
        let shown = largest_step(&picture(&browser, &folder.path().join("shown.png")));
        println!("texels of {error_target} pixels: {shown:.4}, the texture itself {smooth:.4}");
        // Measured 0.0203, 0.0203, 0.0259 beside 0.0203: neighbouring tiles of four texels differ by more than a step, and blend over some pixels.
        assert!(
            shown < 1.5 * smooth,
            "texels of {error_target} pixels: {shown}, the texture itself {smooth}"
        );
    }
}
