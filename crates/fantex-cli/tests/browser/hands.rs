//! The viewer for hands on glass, for keys alone, for who wants no motion, and where there is no WebGPU.

use std::sync::atomic::Ordering;
use std::time::Duration;

use fantex::texture::compare::psnr_db;
use fantex_test::skip;
use serde_json::{Value, json};

use super::driver::Browser;
use super::network::SlowServer;
use super::{bottle, browser, fantex, serve, serve_folder, text};

/// Moves fingers from their first to their second places, in canvas pixels.
fn touch(browser: &Browser, fingers: &[[[f64; 2]; 2]]) {
    let send = |kind: &str, share: f64| {
        let point = |(id, [from, to]): (usize, &[[f64; 2]; 2])| {
            let place = [0, 1].map(|k| from[k] + share * (to[k] - from[k]));
            json!({ "id": id, "x": place[0], "y": place[1] })
        };
        let points: Vec<Value> = match kind {
            "touchEnd" => Vec::new(),
            _ => fingers.iter().enumerate().map(point).collect(),
        };
        browser.command("Input.dispatchTouchEvent", &json!({ "type": kind, "touchPoints": points }));
    };
    send("touchStart", 0.0);
    (1..=8).for_each(|step| send("touchMove", f64::from(step) / 8.0));
    send("touchEnd", 1.0);
}

/// Presses a key as a keyboard does: it goes to what has the focus.
fn press(browser: &Browser, key: &str) {
    for kind in ["keyDown", "keyUp"] {
        browser.command("Input.dispatchKeyEvent", &json!({ "type": kind, "key": key }));
    }
}

#[test]
fn fingers_and_keys_move_the_camera() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    browser.command("Emulation.setTouchEmulationEnabled", &json!({ "enabled": true, "maxTouchPoints": 5 }));
    browser.open(&served.url);
    assert_eq!(browser.wait_for(&["sharp", "failed"]).0, "sharp");
    // Closer and back again: that has the present picture drawn.
    let picture = || {
        browser.press("+", 1);
        browser.picture_after("-", folder.path())
    };
    let whole = picture();
    let differs = |what: &str| {
        let shown = picture();
        let decibels = psnr_db(&whole, &shown).unwrap();
        assert!(decibels < 30.0, "{what}: {decibels:.1} dB from what was shown before");
        browser.press("Home", 1);
        assert!(psnr_db(&whole, &picture()).unwrap() > 40.0, "Home shows all of it after {what}");
    };
    // Nothing has been clicked on or has the focus.
    assert_eq!(browser.run("return document.activeElement === document.body"), true);
    (0..5).for_each(|_| press(&browser, "ArrowLeft"));
    differs("an arrow key turns");
    press(&browser, "Tab");
    assert_eq!(browser.run("return document.activeElement.tagName"), "CANVAS");
    (0..5).for_each(|_| press(&browser, "+"));
    differs("plus comes closer");
    touch(&browser, &[[[400.0, 240.0], [250.0, 240.0]]]);
    differs("a finger turns");
    touch(&browser, &[[[300.0, 220.0], [200.0, 100.0]], [[340.0, 260.0], [440.0, 380.0]]]);
    differs("two fingers come closer");
    assert_eq!(browser.run("return visualViewport.scale"), 1, "the page itself stays as large as it is");
    touch(&browser, &[[[300.0, 220.0], [400.0, 320.0]], [[340.0, 260.0], [440.0, 360.0]]]);
    differs("two fingers shift");
}

#[test]
fn a_line_tells_that_more_comes_and_rests_where_motion_is_not_wanted() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    let slow = SlowServer::before(&served.url, Duration::from_secs(4));
    for (wish, moving) in [("no-preference", 1), ("reduce", 0)] {
        let wish = json!({ "features": [{ "name": "prefers-reduced-motion", "value": wish }] });
        browser.command("Emulation.setEmulatedMedia", &wish);
        browser.open(&format!("http://{}/", slow.address));
        let line = browser.run(
            "const line = document.querySelector('progress');
             return [line.matches(':indeterminate'), line.getClientRects().length, document.getAnimations().length]",
        );
        assert_eq!(line, json!([true, 1, moving]));
    }
    slow.delay.store(0, Ordering::Relaxed);
    browser.wait_for(&["sharp"]);
    let shown = "return document.querySelector('progress').getClientRects().length";
    assert_eq!(browser.run(shown), 0, "there is no line when all is there");
}

#[test]
fn a_page_without_webgpu_says_so_and_shows_its_picture() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (asset, page) = (bottle(folder.path(), "1M"), folder.path().join("page"));
    fantex(&["export", text(&asset), "-o", text(&page), "--web", "--title", "A bottle"]);
    let Some((_python, url)) = serve_folder(&page) else { return skip("no python3") };
    let (_server, served) = serve(&asset, &[]);
    let missing = "Object.defineProperty(Navigator.prototype, 'gpu', { get() { return undefined } })";
    let refused = "GPU.prototype.requestAdapter = async () => null";
    // Scripts for new pages add up.
    for (script, sentence) in [(refused, "no graphics device"), (missing, "has no WebGPU")] {
        browser.command("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": script }));
        browser.open(&url);
        let (state, said) = browser.wait_for(&["sharp", "failed"]);
        assert_eq!(state, "failed");
        assert!(said.contains(sentence), "{said}");
        browser.wait_until("return document.querySelector('img').naturalWidth === 1200");
        let seen = "const seen = document.elementFromPoint(innerWidth / 2, innerHeight / 2);
                    return [seen.tagName, seen.alt]";
        assert_eq!(browser.run(seen), json!(["IMG", "A bottle"]));
        // Where there is no picture, the sentence stands alone.
        browser.open(&served.url);
        assert_eq!(browser.wait_for(&["sharp", "failed"]).0, "failed");
        browser.wait_until("return document.querySelector('img').hidden");
    }
}
