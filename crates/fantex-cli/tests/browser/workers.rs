//! The npm package with its core in a worker, and on the page: the same pictures, and workers that end.

use std::time::{Duration, Instant};

use fantex::texture::compare::psnr_db;

use super::driver::Browser;
use super::three::{Expected, WHOLE, address, load, page, picture, unlit_bottle};
use super::{bottle, serve};

#[test]
fn the_page_shows_what_a_worker_does() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = unlit_bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let expected = Expected::render(&asset, WHOLE, folder.path(), &[]);
    // With a worker, without one, and where the page's policy forbids them.
    let pictures = [("", true), ("&worker=0", false), ("&no-workers", false)].map(|(more, uses_worker)| {
        load(&browser, &address(&page, &info.asset_url, WHOLE, more));
        assert_eq!(browser.run("return test.fan().usesWorker"), uses_worker, "{more}");
        let shown = picture(&browser, &folder.path().join("shown.png"));
        let decibels = expected.psnr_db(&shown);
        println!("{more}: {decibels:.1} dB");
        assert!(decibels > 45.0, "{more}: {decibels} dB");
        shown
    });
    for other in &pictures[1..] {
        // Tiles may lie elsewhere in the atlas, where coordinates are rounded otherwise.
        let decibels = psnr_db(&pictures[0], other).unwrap();
        assert!(decibels > 60.0, "{decibels} dB");
    }
}

#[test]
fn a_mesh_ends_its_worker() {
    let Some((browser, _pages, page)) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, info) = serve(&asset, &["--share"]);
    let url = |more: &str| address(&page, &info.asset_url, WHOLE, &format!("&count{more}"));
    load(&browser, &url(""));
    assert_eq!(workers(&browser), [1, 1]);
    browser.run("test.dispose()");
    wait_for_workers(&browser, [1, 0]);
    // In the middle of opening, and of streaming.
    for (end, state, sentence) in [("loading", "failed", "AbortError"), ("streaming", "ended", "")] {
        for (more, started) in [("", 1), ("&worker=0", 0)] {
            browser.open(&url(&format!("&end={end}{more}")));
            let (now, said) = browser.wait_for(&["sharp", "failed", "ended"]);
            assert_eq!((now.as_str(), said.as_str()), (state, sentence), "{end}{more}");
            wait_for_workers(&browser, [started, 0]);
            // What comes late finds nothing to do.
            std::thread::sleep(Duration::from_millis(300));
            let (now, said) = browser.wait_for(&["sharp", "failed", "ended"]);
            assert_eq!((now.as_str(), said.as_str()), (state, sentence), "{end}{more}");
        }
    }
}

/// How many workers the page has started, and how many of them live.
fn workers(browser: &Browser) -> [u64; 2] {
    serde_json::from_value(browser.run("return test.workers()")).unwrap()
}

/// Waits until there are so many: a worker that is told to end does so a little later.
fn wait_for_workers(browser: &Browser, expected: [u64; 2]) {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        let now = workers(browser);
        if now == expected {
            return;
        }
        assert!(Instant::now() < deadline, "{now:?} workers, {expected:?} are expected");
        std::thread::sleep(Duration::from_millis(50));
    }
}
