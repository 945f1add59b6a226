//! The npm package with three's `WebGPURenderer`, on WebGPU and on its WebGL 2 backend: beside the CPU renderer, and beside `WebGLRenderer`.

use std::path::Path;

use fantex::texture::Image;
use fantex::texture::compare::psnr_db;

use super::driver::Browser;
use super::three::{Expected, NEAR, View, WHOLE, address, decoded, load, page, picture, unlit_bottle};
use super::{bottle, serve, text};

/// Pictures of one asset.
struct Pictures<'a> {
    browser: &'a Browser,
    page: &'a str,
    asset: &'a str,
    folder: &'a Path,
}

impl Pictures<'_> {
    fn load(&self, renderer: &str, view: View, more: &str) {
        load(self.browser, &address(self.page, self.asset, view, &format!("{more}&renderer={renderer}")));
    }

    fn shown(&self, renderer: &str, view: View, more: &str) -> Image {
        self.load(renderer, view, more);
        picture(self.browser, &self.folder.join(format!("{renderer}.png")))
    }
}

#[test]
fn nodes_show_the_texture_function() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    // All of it, and a part of it that lies in tiles of several pages.
    for (texels, view) in [("1M", WHOLE), ("6M", NEAR)] {
        let folder = folder.path().join(texels);
        std::fs::create_dir(&folder).unwrap();
        let asset = unlit_bottle(&folder, texels);
        let (_server, info) = serve(&asset, &["--share"]);
        let expected = Expected::render(&asset, view, &folder, &[]);
        let pictures = Pictures { browser: &browser, page: &page, asset: &info.asset_url, folder: &folder };
        for (renderer, more, compressed) in
            [("webgpu", "", true), ("webgpu", "&compressed=0", false), ("webgl2", "", true)]
        {
            let decibels = expected.psnr_db(&pictures.shown(renderer, view, more));
            assert_eq!(browser.run("return test.fan().isCompressed"), compressed);
            println!("{renderer}, {texels}, compressed {compressed}: {decibels:.1} dB");
            // Measured 48.7, 48.7 and 49.2 dB, near 63.1 dB.
            assert!(decibels > 45.0, "{renderer}, {texels}, compressed {compressed}: {decibels} dB");
        }
    }
}

#[test]
fn nodes_are_lit_as_shaders_are() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let pictures = Pictures { browser: &browser, page: &page, asset: &info.asset_url, folder: folder.path() };
    // A sun alone, as the CPU renderer knows it.
    let black = folder.path().join("black.png");
    Image::from_linear_rgb(2, 1, &[[0.0; 4]; 2]).save(&black).unwrap();
    let lit = ["--light", "1,2,3", "--environment", text(&black)];
    let expected = Expected::render(&asset, WHOLE, folder.path(), &lit);
    let sunny = ["webgl", "webgpu", "webgl2"].map(|renderer| pictures.shown(renderer, WHOLE, "&sun=1,2,3"));
    let beside_cpu = sunny.each_ref().map(|picture| expected.psnr_db(picture));
    let beside_shaders = [1, 2].map(|k| psnr_db(&sunny[0], &sunny[k]).unwrap());
    println!("sun: {beside_cpu:.1?} dB beside the CPU, {beside_shaders:.1?} dB beside WebGLRenderer");
    // Measured 36.6 dB for all: light that three's metals reflect several times makes them brighter.
    assert!(beside_cpu[1] > 35.0 && beside_cpu[2] > 35.0, "{beside_cpu:?} dB");
    // Measured 54.8 (samples of edges lie elsewhere) and 97.4 dB.
    assert!(beside_shaders[0] > 45.0 && beside_shaders[1] > 60.0, "{beside_shaders:?} dB");
    // A lamp with a shadow and surroundings in fog; in linear light.
    let [shaders, nodes] = ["webgl", "webgpu"].map(|renderer| pictures.shown(renderer, WHOLE, "&room=fog"));
    let fog = psnr_db(&shaders, &nodes).unwrap();
    println!("shadow, surroundings, fog: {fog:.1} dB");
    // Measured 47.9 dB.
    assert!(fog > 40.0, "{fog} dB");
    // The same without fog, with tone mapping, as the canvas shows it.
    let [shaders, nodes] = ["webgl", "webgpu"].map(|renderer| {
        pictures.load(renderer, WHOLE, "&room=tone");
        decoded(&browser.run("return test.canvasPicture()"), &folder.path().join("canvas.png"))
    });
    let tones = psnr_db(&shaders, &nodes).unwrap();
    println!("tone mapping: {tones:.1} dB");
    // Measured 64.8 dB.
    assert!(tones > 35.0, "{tones} dB");
}

#[test]
fn nodes_leave_nothing_behind() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    for renderer in ["webgpu", "webgl2"] {
        let more = format!("&sun=1,2,3&renderer={renderer}");
        load(&browser, &address(&page, &info.asset_url, WHOLE, &more));
        let before = browser.run("return test.before");
        let during = browser.run("return test.counts()");
        assert!(during["textures"].as_u64() > before["textures"].as_u64(), "{during}");
        // Textures that three does not count are counted as the device's own.
        browser.run(
            "const [owner, name] = test.renderer.backend.isWebGPUBackend
                 ? [GPUTexture.prototype, 'destroy'] : [test.renderer.backend.gl, 'deleteTexture'];
             const remove = owner[name]; window.removed = 0;
             owner[name] = function (...texture) { removed += 1; return remove.apply(this, texture); }",
        );
        let mut after = browser.run("return test.dispose()");
        assert_eq!(after["children"], 1, "only the sun is left");
        after["children"] = before["children"].clone();
        assert_eq!(after, before, "{renderer}");
        let channels = 4;
        assert_eq!(
            browser.run("return removed"),
            channels + 4,
            "{renderer}: atlases, page table, groups, means, frames"
        );
    }
}
