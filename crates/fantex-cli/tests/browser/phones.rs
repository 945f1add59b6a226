//! Devices without compressed textures in BC formats, as phones are: texels are decoded, and the pictures are the same.

use std::path::Path;

use fantex::texture::Image;
use fantex::texture::compare::psnr_db;
use serde_json::json;

use super::driver::Browser;
use super::three::{Expected, WHOLE, address, load, page, picture, unlit_bottle};
use super::{SIZE, bottle, browser, fantex, serve, text};

/// Has every page of a browser see a device without BC, and note the formats of textures that it makes.
fn take_block_compression(browser: &Browser) {
    let script = r#"
        window.formats = [];
        const features = Object.getOwnPropertyDescriptor(GPUAdapter.prototype, "features").get;
        Object.defineProperty(GPUAdapter.prototype, "features", {
            get() { return new Set([...features.call(this)].filter((name) => !name.startsWith("texture-compression-bc"))); },
        });
        const { createTexture } = GPUDevice.prototype;
        GPUDevice.prototype.createTexture = function (descriptor) {
            formats.push(descriptor.format);
            return createTexture.call(this, descriptor);
        };
        const { getExtension, texStorage2D } = WebGL2RenderingContext.prototype;
        WebGL2RenderingContext.prototype.getExtension = function (name) {
            return /s3tc|rgtc|bptc/.test(name) ? null : getExtension.call(this, name);
        };
        WebGL2RenderingContext.prototype.texStorage2D = function (target, levels, format, ...size) {
            formats.push(format);
            return texStorage2D.call(this, target, levels, format, ...size);
        };
    "#;
    browser.command("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": script }));
}

#[test]
fn the_viewer_decodes_where_the_device_has_no_block_compression() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    take_block_compression(&browser);
    browser.open(&served.url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
    let formats = browser.run("return formats.join()");
    let formats = formats.as_str().unwrap();
    assert!(formats.contains("rgba8unorm") && !formats.contains("bc"), "{formats}");
    let decibels =
        psnr_db(&expected(&asset, folder.path()), &browser.picture_after("Home", folder.path())).unwrap();
    println!("{decibels:.1} dB");
    // As with block compression.
    assert!(decibels > 42.0, "{decibels} dB");
}

fn expected(asset: &Path, folder: &Path) -> Image {
    let path = folder.join("expected.png");
    fantex(&["render", text(asset), "-o", text(&path), "--size", &format!("{}x{}", SIZE[0], SIZE[1])]);
    Image::load(&path).unwrap()
}

#[test]
fn three_decodes_where_the_device_has_no_block_compression() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = unlit_bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let expected = Expected::render(&asset, WHOLE, folder.path(), &[]);
    take_block_compression(&browser);
    for renderer in ["webgl", "webgpu"] {
        load(&browser, &address(&page, &info.asset_url, WHOLE, &format!("&renderer={renderer}")));
        assert_eq!(browser.run("return test.fan().isCompressed"), false, "{renderer}");
        let decoded = "rgba8unorm-srgb";
        let is_decoded = format!("return formats.some((format) => ['{decoded}', 0x8C43].includes(format))");
        assert_eq!(browser.run(&is_decoded), true, "{renderer}");
        let decibels = expected.psnr_db(&picture(&browser, &folder.path().join("shown.png")));
        println!("{renderer}: {decibels:.1} dB");
        assert!(decibels > 45.0, "{renderer}: {decibels} dB");
    }
}
