//! Figures of `docs/web.md` and `docs/three.md`: they are printed, and asserted only where they do not depend on how busy the machine is.
//!
//! `cargo nextest run --workspace --test browser --run-ignored only -E 'test(figures)' --no-capture`

use std::time::{Duration, Instant};

use fantex_test::{skip, workspace};
use serde_json::Value;

use super::driver::{Browser, is_on_the_card};
use super::three::{WHOLE, address, load, page};
use super::{bottle, browser, fantex, serve, serve_folder, text};

/// A line to a home.
const LATENCY: Duration = Duration::from_millis(50);
const BITS_PER_SECOND: f64 = 20e6;

#[test]
#[ignore = "bakes 256 M texels"]
fn figures_of_the_first_picture() {
    if browser().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (model, asset) = (folder.path().join("land.ply"), folder.path().join("land.fan"));
    fantex(&["generate", "landscape", "-o", text(&model), "--triangles", "300k"]);
    fantex(&["bake", text(&model), "-o", text(&asset), "--source", "solid=landscape", "--texels", "256M"]);
    for name in ["without a preview", "with a preview"] {
        if name == "with a preview" {
            fantex(&["preview", text(&asset)]);
        }
        let (_server, served) = serve(&asset, &["--share"]);
        // The page lies on a host that compresses it, the asset on one with ranges.
        let page = folder.path().join(name);
        fantex(&["export", text(&asset), "-o", text(&page), "--web"]);
        std::fs::remove_file(page.join("land.fan")).unwrap();
        // Whose page asks for the asset's ranges, with and without a preview.
        let index = ureq::get(&served.url).call().unwrap().body_mut().read_to_string().unwrap();
        assert!(index.contains("data-asset=\"land.fan\" data-ranges=\"0-65535 "), "{index}");
        let index = index.replace("data-asset=\"land.fan\"", &format!("data-asset=\"{}\"", served.asset_url));
        std::fs::write(page.join("index.html"), index).unwrap();
        let Some((_host, url)) = serve_folder(&page) else { return skip("no python3") };
        for _ in 0..3 {
            let [first, drawn, page_bytes, asset_bytes] = first_picture(&format!("{url}index.html"));
            println!(
                "{name}: {first:.0} ms, drawn after {drawn:.0} ms, {page_bytes} bytes of the page, {asset_bytes} of the asset"
            );
            // Measured 632 kB and 1.88 MB: the first bytes, and the preview, or mesh, cover and directory.
            let most = if name == "with a preview" { 800e3 } else { 2.2e6 };
            assert!(asset_bytes < most, "{asset_bytes} bytes of the asset before the first picture");
        }
    }
}

/// Milliseconds until a page asks for its first picture, and until the device has drawn it, in a browser that has not seen the page before; bytes
/// of the page's files and of the asset until the former.
fn first_picture(url: &str) -> [f64; 4] {
    let browser = browser().unwrap();
    browser.throttle(LATENCY, BITS_PER_SECOND);
    browser.open(url);
    // Software that draws 295 172 triangles beside other work takes long.
    let deadline = Instant::now() + Duration::from_secs(240);
    loop {
        let row = browser.run(
            "const shown = ['fantex preview', 'fantex sharpening', 'fantex sharp']
                 .flatMap((name) => performance.getEntriesByName(name).map((mark) => mark.startTime));
             const [drawn] = performance.getEntriesByName('fantex picture');
             if (shown.length === 0 || !drawn) return [document.getElementById('line').textContent];
             const first = Math.min(...shown);
             const entries = performance.getEntriesByType('resource').filter((entry) => entry.responseEnd <= first);
             // Of answers from elsewhere sizes are told to pages that may know them: those of the body stand in.
             const bytes = (isAsset) => entries.filter((entry) => entry.name.endsWith('.fan') === isAsset)
                 .reduce((sum, entry) => sum + (entry.transferSize || entry.encodedBodySize), 0);
             return [first, drawn.startTime, bytes(false), bytes(true)]",
        );
        if let Ok(row) = serde_json::from_value(row.clone()) {
            return row;
        }
        assert!(Instant::now() < deadline, "there is no picture after four minutes: {row}");
        std::thread::sleep(Duration::from_millis(100));
    }
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
    let size = if is_on_the_card() { "1920,1080" } else { "640,480" };
    for renderer in ["webgl", "webgpu"] {
        for anisotropy in [1, 8] {
            let more = format!("&sun=1,2,3&renderer={renderer}&anisotropy={anisotropy}&size={size}");
            let url = address(&page, &info.asset_url, WHOLE, &more);
            let fan = milliseconds(&browser, &url);
            let plain =
                milliseconds(&browser, &address(&page, &model, WHOLE, &more).replace("?asset=", "?plain="));
            let ratio = fan / plain;
            println!(
                "{renderer}, {size}, anisotropy {anisotropy}: {fan:.3} ms, an ordinary model {plain:.3} ms, ratio {ratio:.2}"
            );
        }
    }
}

#[test]
#[ignore = "bakes a landscape for a figure"]
fn figures_of_the_longest_task_in_a_worker_and_on_the_page() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (model, asset) = (folder.path().join("land.ply"), folder.path().join("land.fan"));
    fantex(&["generate", "landscape", "-o", text(&model), "--triangles", "300k"]);
    fantex(&["bake", text(&model), "-o", text(&asset), "--source", "solid=landscape", "--texels", "4M"]);
    let (_server, info) = serve(&asset, &["--share"]);
    for _ in 0..3 {
        for (name, more) in [("in a worker", ""), ("on the page", "&worker=0")] {
            load(&browser, &address(&page, &info.asset_url, ["0,400,1200", "0,0,0", "35"], more));
            let longest = browser.run("return [test.longest.task, test.longest.update]");
            let [task, update] = [0, 1].map(|k| longest[k].as_f64().unwrap());
            println!("{name}: the page's longest task {task:.0} ms, the longest update {update:.0} ms");
        }
    }
}

/// Of the fastest of some frames. Cards draw many before the time is taken: one takes less than it takes to wait for it.
fn milliseconds(browser: &Browser, url: &str) -> f64 {
    load(browser, url);
    let batch = if is_on_the_card() { 100 } else { 1 };
    let times: Value = browser.run(&format!("return test.frameTimes(15, {batch})"));
    times[0].as_f64().unwrap()
}
