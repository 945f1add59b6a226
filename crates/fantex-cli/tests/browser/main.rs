//! The viewer for browsers in a real one: its pictures beside the CPU renderer's, and what it says where it cannot show any.
//!
//! Skipped where the viewer has not been built (`cargo xtask web`), or where there is no Chromium with its driver.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod driver;
mod figures;
mod hands;
mod network;
mod phones;
mod three;
mod webgpu;
mod workers;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use driver::Browser;
use fantex::glam::DVec3;
use fantex::render::Camera;
use fantex::texture::Image;
use fantex::texture::compare::psnr_db;
use fantex::{World, WorldObject};
use fantex_test::{skip, workspace};

const SIZE: [u32; 2] = [640, 480];

/// A browser, where the page can be shown at all.
fn browser() -> Option<Browser> {
    if fantex_web::files().is_none() {
        skip("the viewer for browsers is not built (cargo xtask web)");
        return None;
    }
    let browser = Browser::start(SIZE);
    if browser.is_none() {
        skip("no chromium with chromedriver");
    }
    browser
}

fn fantex(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_fantex")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A program that ends with the value.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().unwrap_or_default();
        drop(self.0.wait());
    }
}

/// What `fantex serve` tells.
#[derive(serde::Deserialize)]
struct Served {
    /// Of the page.
    url: String,
    asset_url: String,
}

/// Serves an asset and its page.
fn serve(asset: &Path, options: &[&str]) -> (Running, Served) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fantex"));
    command.args(["--json", "--quiet", "serve"]).arg(asset).args(options).stdout(Stdio::piped());
    let mut child = Running(command.spawn().unwrap());
    let mut output = BufReader::new(child.0.stdout.take().unwrap());
    let mut json = String::new();
    while !json.trim_end().ends_with('}') {
        assert_ne!(output.read_line(&mut json).unwrap(), 0, "{json}");
    }
    (child, serde_json::from_str(&json).unwrap())
}

/// Python's server, which pages at other addresses may read, and which compresses what pages consist of, as hosts do.
const FOLDER_SERVER: &str = "
import functools, gzip, http.server, os, sys
@functools.cache
def compressed(path):
    with open(path, 'rb') as file:
        return gzip.compress(file.read())
class Handler(http.server.SimpleHTTPRequestHandler):
    def end_headers(self):
        self.send_header('Access-Control-Allow-Origin', '*')
        super().end_headers()
    def do_GET(self):
        path = self.translate_path(self.path)
        if not (path.endswith(('.html', '.js', '.wasm')) and os.path.isfile(path)):
            return super().do_GET()
        body = compressed(path)
        self.send_response(200)
        self.send_header('Content-Type', self.guess_type(path))
        self.send_header('Content-Encoding', 'gzip')
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)
handler = functools.partial(Handler, directory=sys.argv[1])
http.server.test(handler, http.server.ThreadingHTTPServer, port=0, bind='127.0.0.1')
";

/// Serves a folder by a server that knows no ranges, Python's; its address. None where there is no Python.
fn serve_folder(folder: &Path) -> Option<(Running, String)> {
    let mut python = Command::new("python3");
    python.args(["-u", "-c", FOLDER_SERVER]).arg(folder);
    let mut python = Running(python.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?);
    let mut line = String::new();
    BufReader::new(python.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let port = line.split("port ").nth(1).unwrap().split(' ').next().unwrap();
    Some((python, format!("http://127.0.0.1:{port}/")))
}

fn bottle(folder: &Path, texels: &str) -> PathBuf {
    let (model, asset) = (workspace().join("assets/WaterBottle/WaterBottle.gltf"), folder.join("bottle.fan"));
    fantex(&["bake", text(&model), "-o", text(&asset), "--texels", texels]);
    asset
}

#[test]
fn pictures_are_those_of_the_cpu_renderer() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    browser.open(&served.url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
    let shown = browser.picture_after("Home", folder.path());
    let expected = folder.path().join("expected.png");
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    fantex(&["render", text(&asset), "-o", text(&expected), "--size", &size]);
    let expected = Image::load(&expected).unwrap();
    let decibels = psnr_db(&expected, &shown).unwrap();
    println!("{decibels:.1} dB");
    // Edges have 4 samples here and 8 there; measured 48.1 dB.
    assert!(decibels > 42.0, "{decibels} dB");
    // Turned, it is another picture, which becomes sharp, too.
    browser.press("ArrowLeft", 4);
    drop(browser.picture_after("ArrowLeft", folder.path()));
    browser.wait_for(&["sharp"]);
    let turned = browser.picture_after("ArrowLeft", folder.path());
    let difference = psnr_db(&shown, &turned).unwrap();
    assert!(difference < 30.0, "the arrow keys turn nothing");
}

#[test]
fn a_preview_is_shown_first() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (model, asset) = (folder.path().join("land.ply"), folder.path().join("land.fan"));
    fantex(&["generate", "landscape", "-o", text(&model), "--triangles", "60k"]);
    fantex(&["bake", text(&model), "-o", text(&asset), "--source", "solid=landscape", "--texels", "1M"]);
    fantex(&["preview", text(&asset), "--triangles", "2k", "--texels", "50k"]);
    let (_server, served) = serve(&asset, &[]);
    browser.open(&served.url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
    let marks = browser.run("return performance.getEntriesByType('mark').map((mark) => mark.name)");
    let marks = marks.as_array().unwrap().iter().filter_map(serde_json::Value::as_str);
    // When the device has drawn the first picture depends on the device.
    let marks: Vec<&str> = marks.filter(|mark| *mark != "fantex picture").collect();
    assert!(marks.starts_with(&["fantex loading", "fantex preview"]), "{marks:?}");
    assert_eq!(marks.last(), Some(&"fantex sharp"), "{marks:?}");
    // What is there in the end is the asset.
    let shown = browser.picture_after("Home", folder.path());
    let expected = folder.path().join("expected.png");
    fantex(&["render", text(&asset), "-o", text(&expected), "--size", &format!("{}x{}", SIZE[0], SIZE[1])]);
    let decibels = psnr_db(&Image::load(&expected).unwrap(), &shown).unwrap();
    println!("{decibels:.1} dB");
    // Measured 46.2 dB.
    assert!(decibels > 40.0, "{decibels} dB");
}

/// The viewer's camera of a world, which shows the boxes of its assets: where it stands, what it looks at, and its angle.
fn camera_of_boxes(world: &World) -> [String; 3] {
    let corners = world.objects.iter().flat_map(WorldObject::corners);
    let camera =
        Camera::framing_points(corners, Camera::THREE_QUARTER, f64::from(SIZE[0]) / f64::from(SIZE[1]));
    let text = |place: DVec3| format!("{},{},{}", place.x, place.y, place.z);
    [text(camera.eye), text(camera.target), camera.fov_degrees.to_string()]
}

#[test]
fn a_world_comes_as_it_is_seen() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let (model, asset) = (place("land.ply"), place("land.fan"));
    fantex(&["generate", "landscape", "-o", text(&model), "--triangles", "60k"]);
    fantex(&["bake", text(&model), "-o", text(&asset), "--source", "solid=landscape", "--texels", "1M"]);
    // A few sectors, and so many that there are coarse assets.
    for (triangles, has_coarse) in [("15k", false), ("3k", true)] {
        let sectors = place(&format!("sectors of {triangles}"));
        fantex(&["split", text(&asset), "-o", text(&sectors), "--triangles", triangles]);
        assert_eq!(sectors.join("coarse-0001.fan").exists(), has_coarse);
        let index = sectors.join("land.fanworld");
        let (_server, served) = serve(&index, &[]);
        browser.open(&served.url);
        let (state, said) = browser.wait_for(&["sharp", "failed"]);
        assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
        let shown = browser.picture_after("Home", folder.path());
        let expected = place("expected.png");
        let size = format!("{}x{}", SIZE[0], SIZE[1]);
        let [eye, target, fov] = camera_of_boxes(&World::open(&index).unwrap());
        let seen = ["--eye", &eye, "--target", &target, "--fov", &fov];
        fantex(
            &[&["render", text(&index), "-o", text(&expected), "--size", &size, "--force"][..], &seen]
                .concat(),
        );
        let decibels = psnr_db(&Image::load(&expected).unwrap(), &shown).unwrap();
        println!("{triangles}: {decibels:.1} dB");
        assert!(decibels > 38.0, "{decibels} dB");

        // An asset that has gone is named; the others are shown.
        std::fs::remove_file(sectors.join("sector-0001.fan")).unwrap();
        browser.open(&served.url);
        let (state, said) = browser.wait_for(&["sharp", "failed"]);
        assert_eq!(state, "sharp");
        assert!(said.contains("sector-0001.fan") && said.contains("404"), "{said}");
    }
}

#[test]
fn an_exported_page_needs_a_server_with_ranges_and_says_so() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (asset, page) = (bottle(folder.path(), "1M"), folder.path().join("page"));
    let title = "A <b>bottle</b>";
    fantex(&["export", text(&asset), "-o", text(&page), "--web", "--title", title, "--credits", "CC0"]);
    let preview = Image::load(page.join("preview.png")).unwrap();
    assert_eq!([preview.width, preview.height], [1200, 630]);
    let Some((_python, url)) = serve_folder(&page) else { return skip("no python3") };
    browser.open(&url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!(state, "failed");
    assert!(said.contains("does not support range requests"), "{said}");
    assert_eq!(browser.run("return document.title"), title);
}

#[test]
fn what_is_missing_is_said() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    std::fs::remove_file(&asset).unwrap();
    browser.open(&served.url);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!(state, "failed");
    assert!(said.contains("404 Not Found"), "{said}");
}

#[test]
fn an_asset_that_changes_underneath_is_named_and_what_is_there_stays() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    // So large that coming closer asks for more of it.
    let asset = bottle(folder.path(), "8M");
    let (_server, served) = serve(&asset, &[]);
    browser.open(&served.url);
    assert_eq!(browser.wait_for(&["sharp", "failed"]).0, "sharp");
    let mut changed = std::fs::read(&asset).unwrap();
    changed.push(0);
    let other = folder.path().join("other.fan");
    std::fs::write(&other, changed).unwrap();
    std::fs::rename(other, &asset).unwrap();
    browser.press("+", 12);
    // By then a frame has asked for what the view needs.
    drop(browser.picture_after("+", folder.path()));
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!(state, "sharp");
    assert!(said.contains("stays coarse") && said.contains("has changed since it was opened"), "{said}");
}
