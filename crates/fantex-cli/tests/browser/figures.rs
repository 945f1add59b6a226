//! Figures of `docs/web.md` and `docs/three.md`: they are printed, and asserted only where they do not depend on how busy the machine is.
//!
//! `cargo nextest run --workspace --test browser --run-ignored only -E 'test(figures)' --no-capture`

use std::time::{Duration, Instant};

use fantex_test::{skip, workspace};
use serde_json::Value;

use super::driver::Browser;
use super::three::{WHOLE, address, load, page};
use super::{bottle, browser, fantex, serve, serve_folder, text};

/// A line to a home.
const LATENCY: Duration = Duration::from_millis(50);
const BITS_PER_SECOND: f64 = 20e6;

#[test]
#[ignore = "bakes 256 M texels"]
fn figures_of_the_first_picture() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (model, asset) = (folder.path().join("land.ply"), folder.path().join("land.fan"));
    fantex(&["generate", "landscape", "-o", text(&model), "--triangles", "300k"]);
    fantex(&["bake", text(&model), "-o", text(&asset), "--source", "solid=landscape", "--texels", "256M"]);
    fantex(&["preview", text(&asset)]);
    let (_server, served) = serve(&asset, &[]);
    browser.throttle(LATENCY, BITS_PER_SECOND);
    browser.open(&served.url);
    let deadline = Instant::now() + Duration::from_secs(60);
    let first = loop {
        let mark = browser.run("return performance.getEntriesByName('fantex preview')[0]?.startTime");
        if let Some(milliseconds) = mark.as_f64() {
            break milliseconds;
        }
        assert!(Instant::now() < deadline, "there is no picture after a minute");
        std::thread::sleep(Duration::from_millis(100));
    };
    let rows = browser.run(
        "return performance.getEntriesByType('resource')
             .map((entry) => [entry.name.split('/').pop(), entry.responseEnd, entry.transferSize])",
    );
    let before: Vec<(String, f64, u64)> = serde_json::from_value(rows).unwrap();
    let before: Vec<_> = before.into_iter().filter(|(_, end, _)| *end <= first).collect();
    for (name, end, bytes) in &before {
        println!("{:>9.0} ms {:>9} bytes {name}", end, bytes);
    }
    let asset_bytes: u64 = before.iter().filter(|row| row.0 == "land.fan").map(|row| row.2).sum();
    let bytes: u64 = before.iter().map(|row| row.2).sum();
    println!("first picture after {first:.0} ms, {bytes} bytes, {asset_bytes} of them the asset's");
    // Measured 632 kB: the first bytes and the preview.
    assert!(asset_bytes < 800_000, "{asset_bytes} bytes of the asset before the first picture");
}

#[test]
#[ignore = "minutes on a processor"]
fn figures_of_memory_after_flying_around() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "8M");
    let (_server, served) = serve(&asset, &[]);
    browser.open(&served.url);
    browser.wait_for(&["sharp"]);
    let start = memory(&browser);
    println!("WebAssembly's memory when it is sharp {:.1} MB, heap of scripts {:.1} MB", start[0], start[1]);
    let mut most = start[0];
    for round in 0..6 {
        for (key, times) in [("+", 10), ("ArrowLeft", 12), ("-", 10), ("ArrowRight", 5)] {
            browser.run("document.documentElement.dataset.state = 'flying'");
            browser.press(key, times);
            browser.wait_for(&["sharp"]);
        }
        let now = memory(&browser);
        println!("after round {round}: {:.1} MB, {:.1} MB", now[0], now[1]);
        most = most.max(now[0]);
    }
    // Texels pass through; what stays is the mesh, the cover, the directory and room for what is under way.
    assert!(most < start[0] + 32.0, "memory grew from {} to {most} MB", start[0]);
}

/// Megabytes of WebAssembly's memory, and of the scripts' heap.
fn memory(browser: &Browser) -> [f64; 2] {
    let bytes = browser.run(
        "return import(new URL('fantex_web.js', location)).then((module) => module.default())
             .then(({ memory }) => [memory.buffer.byteLength, performance.memory.usedJSHeapSize])",
    );
    [0, 1].map(|k| bytes[k].as_f64().unwrap() / 1e6)
}

#[test]
#[ignore = "minutes on a processor"]
fn figures_of_frame_times_beside_an_ordinary_model() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let Some((_models, models)) = serve_folder(&workspace().join("assets")) else {
        return skip("no python3");
    };
    let model = format!("{models}WaterBottle/WaterBottle.gltf");
    for renderer in ["webgl", "webgpu"] {
        for anisotropy in [1, 8] {
            let more = format!("&sun=1,2,3&renderer={renderer}&anisotropy={anisotropy}");
            let url = address(&page, &info.asset_url, WHOLE, &more);
            let fan = milliseconds(&browser, &url);
            let plain =
                milliseconds(&browser, &address(&page, &model, WHOLE, &more).replace("?asset=", "?plain="));
            let ratio = fan / plain;
            println!(
                "{renderer}, anisotropy {anisotropy}: {fan:.1} ms, an ordinary model {plain:.1} ms, ratio {ratio:.2}"
            );
        }
    }
}

/// Of the fastest of some frames.
fn milliseconds(browser: &Browser, url: &str) -> f64 {
    load(browser, url);
    let times: Value = browser.run("return test.frameTimes(15)");
    times[0].as_f64().unwrap()
}
