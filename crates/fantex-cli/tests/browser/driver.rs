//! A headless Chromium, driven by the WebDriver protocol (W3C) through `chromedriver`.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fantex::texture::Image;
use fantex_test::PATIENCE;
use serde_json::{Value, json};
use ureq::Agent;

const ARGUMENTS: [&str; 8] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--disable-vulkan-surface",
];

/// WebGPU and WebGL on the processor, so that pictures do not depend on the machine.
const ON_THE_PROCESSOR: [&str; 4] = [
    "--use-vulkan=swiftshader",
    "--use-webgpu-adapter=swiftshader",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
];

/// Both on the graphics card, through Vulkan.
const ON_THE_CARD: [&str; 3] = ["--use-vulkan=native", "--use-angle=vulkan", "--ignore-gpu-blocklist"];

/// Whether pages are drawn by the graphics card: for figures, and to see that it draws the same.
pub(crate) fn is_on_the_card() -> bool {
    std::env::var_os("FANTEX_BROWSER_GPU").is_some()
}

pub(crate) struct Browser {
    driver: Child,
    agent: Agent,
    /// Address of the session.
    session: String,
}

impl Drop for Browser {
    fn drop(&mut self) {
        drop(self.agent.delete(&self.session).call());
        self.driver.kill().unwrap_or_default();
        drop(self.driver.wait());
    }
}

impl Browser {
    /// A window of this size; none where there is no browser or no driver of it.
    pub(crate) fn start([width, height]: [u32; 2]) -> Option<Self> {
        let mut driver = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut lines = BufReader::new(driver.stdout.take()?).lines();
        let port = lines.find_map(|line| {
            let line = line.ok()?;
            let (_, port) = line.split_once("successfully on port ")?;
            port.trim_end_matches('.').parse::<u16>().ok()
        })?;
        // What it says later must go somewhere.
        std::thread::spawn(move || lines.count());
        let config = Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE));
        let mut browser = Self {
            driver,
            agent: config.build().new_agent(),
            session: format!("http://127.0.0.1:{port}/session"),
        };
        let device: &[&str] = if is_on_the_card() { &ON_THE_CARD } else { &ON_THE_PROCESSOR };
        let arguments: Vec<String> = [&ARGUMENTS[..], device]
            .concat()
            .iter()
            .map(ToString::to_string)
            .chain([format!("--window-size={width},{height}")])
            .collect();
        let options = json!({ "args": arguments });
        let capabilities =
            json!({ "alwaysMatch": { "browserName": "chrome", "goog:chromeOptions": options } });
        let answer = browser.post("", &json!({ "capabilities": capabilities })).ok()?;
        browser.session = format!("{}/{}", browser.session, answer["sessionId"].as_str()?);
        browser.post("/timeouts", &json!({ "script": PATIENCE.as_millis() as u64 })).ok()?;
        browser.set_inner_size([width, height]);
        Some(browser)
    }

    fn post(&self, path: &str, body: &Value) -> Result<Value, String> {
        let request =
            self.agent.post(format!("{}{path}", self.session)).header("content-type", "application/json");
        let mut response = request.send(body.to_string()).map_err(|error| error.to_string())?;
        let text = response.body_mut().read_to_string().map_err(|error| error.to_string())?;
        let mut answer: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
        if response.status().is_success() { Ok(answer["value"].take()) } else { Err(text) }
    }

    /// Windows have edges, also those that nobody sees.
    fn set_inner_size(&self, size: [u32; 2]) {
        let edges = self.run("return [outerWidth - innerWidth, outerHeight - innerHeight]");
        let edge = |k: usize| edges[k].as_u64().unwrap() as u32;
        let rect = json!({ "width": size[0] + edge(0), "height": size[1] + edge(1) });
        self.post("/window/rect", &rect).unwrap();
    }

    pub(crate) fn open(&self, url: &str) {
        self.post("/url", &json!({ "url": url })).unwrap();
    }

    /// Calls the browser's own protocol.
    pub(crate) fn command(&self, name: &str, parameters: &Value) {
        self.post("/goog/cdp/execute", &json!({ "cmd": name, "params": parameters })).unwrap();
    }

    /// Has answers come so late and so slowly from now on.
    pub(crate) fn throttle(&self, latency: Duration, bits_per_second: f64) {
        self.command("Network.enable", &json!({}));
        let bytes_per_second = bits_per_second / 8.0;
        let conditions = json!({
            "offline": false,
            "latency": latency.as_millis() as u64,
            "downloadThroughput": bytes_per_second,
            "uploadThroughput": bytes_per_second,
        });
        self.command("Network.emulateNetworkConditions", &conditions);
    }

    /// Opens an empty tab in front of the present one, which is still the one that is driven.
    pub(crate) fn hide(&self) {
        let tab = self.post("/window/new", &json!({ "type": "tab" })).unwrap();
        self.command("Target.activateTarget", &json!({ "targetId": tab["handle"] }));
        self.wait_until("return document.visibilityState === 'hidden'");
    }

    /// Brings the driven tab to the front.
    pub(crate) fn show(&self) {
        self.command("Page.bringToFront", &json!({}));
    }

    /// Runs a function's body in the page.
    pub(crate) fn run(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": script, "args": [] })).unwrap()
    }

    /// Waits until the page is in one of these states, and says in which and what it tells the reader.
    pub(crate) fn wait_for(&self, states: &[&str]) -> (String, String) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let script = "return [document.documentElement.dataset.state ?? '', \
                          document.getElementById('line')?.textContent ?? '']";
            let now = self.run(script);
            let text = |k: usize| now[k].as_str().unwrap_or_default().to_owned();
            if states.contains(&text(0).as_str()) {
                return (text(0), text(1));
            }
            assert!(Instant::now() < deadline, "the page is still {now}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until a function's body returns true in the page.
    pub(crate) fn wait_until(&self, script: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.run(script) != true {
            assert!(Instant::now() < deadline, "not yet: {script}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses a key over the canvas so many times.
    pub(crate) fn press(&self, key: &str, times: u32) {
        self.run(&format!(
            "for (let i = 0; i < {times}; i++)
                 document.querySelector('canvas').dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}' }}))"
        ));
    }

    /// What the canvas shows after a key was pressed; not what the screen shows, as a window that nobody sees may show nothing.
    pub(crate) fn picture_after(&self, key: &str, folder: &std::path::Path) -> Image {
        // The page has asked for a frame when the key's event is over; this one is called after it, in the same frame.
        let script = "const [key, done] = arguments;
                      const canvas = document.querySelector('canvas');
                      canvas.dispatchEvent(new KeyboardEvent('keydown', { key }));
                      requestAnimationFrame(() => done(canvas.toDataURL('image/png')))";
        let url = self.post("/execute/async", &json!({ "script": script, "args": [key] })).unwrap();
        let (_, base64) = url.as_str().unwrap().split_once("base64,").unwrap();
        let path = folder.join("canvas.png");
        std::fs::write(&path, STANDARD.decode(base64).unwrap()).unwrap();
        Image::load(&path).unwrap()
    }
}
