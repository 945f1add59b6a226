//! The viewer where answers are late, and where nobody sees it.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde_json::json;

use super::driver::Browser;
use super::three::{WHOLE, address, page};
use super::{bottle, browser, serve};

/// A server that passes on what another one answers, the asset's bytes late.
pub(super) struct SlowServer {
    pub(super) address: SocketAddr,
    /// Milliseconds that a request for the asset waits before it is passed on.
    pub(super) delay: Arc<AtomicU64>,
}

impl SlowServer {
    /// Passes on to the server of an address, and ends with the test's process.
    pub(super) fn before(url: &str, delay: Duration) -> Self {
        let host = url.trim_start_matches("http://").split('/').next().unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let delay = Arc::new(AtomicU64::new(delay.as_millis() as u64));
        let waits = Arc::clone(&delay);
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let server = TcpStream::connect(&host).unwrap();
                let (answers, back) = (server.try_clone().unwrap(), client.try_clone().unwrap());
                let waits = Arc::clone(&waits);
                std::thread::spawn(move || {
                    pass_on(client, server, |request| {
                        if request.windows(5).any(|part| part == b".fan ") {
                            std::thread::sleep(Duration::from_millis(waits.load(Ordering::Relaxed)));
                        }
                    });
                });
                std::thread::spawn(move || pass_on(answers, back, |_| {}));
            }
        });
        Self { address, delay }
    }
}

/// Copies until one side closes its connection; calls `wait` with what it passes on next.
fn pass_on(mut from: TcpStream, mut to: TcpStream, wait: impl Fn(&[u8])) {
    let mut bytes = [0; 1 << 14];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        wait(&bytes[..count]);
        if to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    to.shutdown(Shutdown::Both).unwrap_or_default();
}

/// Waits until the page says something that contains this.
fn wait_for_sentence(browser: &Browser, part: &str) {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let said = browser.run("return document.getElementById('line').textContent");
        if said.as_str().is_some_and(|said| said.contains(part)) {
            return;
        }
        assert!(Instant::now() < deadline, "the page says {said}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_slow_server_is_waited_for_and_named() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    let slow = SlowServer::before(&served.url, Duration::from_secs(12));
    browser.open(&format!("http://{}/", slow.address));
    wait_for_sentence(&browser, "Still loading: the connection is slow.");
    assert_ne!(browser.run("return document.documentElement.dataset.state"), "failed");
    slow.delay.store(0, Ordering::Relaxed);
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
}

#[test]
fn a_slow_device_is_not_taken_for_a_slow_connection() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = bottle(folder.path(), "1M");
    let (_server, served) = serve(&asset, &[]);
    // The next frame never comes.
    let script = "window.requestAnimationFrame = () => 0";
    browser.command("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": script }));
    browser.open(&served.url);
    wait_for_sentence(&browser, "Still drawing: this device is slow.");
    assert_eq!(browser.run("return document.documentElement.dataset.state"), "loading");
}

#[test]
#[ignore = "waits for a minute"]
fn a_server_that_never_answers_is_given_up() {
    let Some((browser, _pages, page)) = page() else { return };
    // Connections to it are made, and nobody reads what comes.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/bottle.fan", silent.local_addr().unwrap());
    browser.open(&address(&page, &url, WHOLE, ""));
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!(state, "failed");
    assert!(said.contains("bottle.fan") && said.contains("did not answer within 60 seconds"), "{said}");
}

#[test]
fn a_hidden_page_fetches_nothing_and_goes_on_when_it_is_seen() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    // So large that coming closer asks for more of it.
    let asset = bottle(folder.path(), "8M");
    let (_server, served) = serve(&asset, &[]);
    browser.open(&served.url);
    browser.wait_for(&["sharp"]);
    let requests = || browser.run("return performance.getEntriesByType('resource').length").as_u64().unwrap();
    browser.hide();
    browser.run("document.documentElement.dataset.state = 'hidden'");
    let before = requests();
    browser.press("+", 12);
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(requests(), before, "a page that nobody sees fetches something");
    assert_eq!(browser.run("return document.documentElement.dataset.state"), "hidden");
    browser.show();
    let (state, said) = browser.wait_for(&["sharp", "failed"]);
    assert_eq!((state.as_str(), said.as_str()), ("sharp", ""));
    assert!(requests() > before, "nothing was fetched for the new view");
}
