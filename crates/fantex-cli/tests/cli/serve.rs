//! `fantex serve`, as browsers, `curl` and our own reader ask it.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{COLORED_PLY, fails, fantex, json, run, succeeds, write};

/// The program while it serves, and what it has printed.
struct Serving {
    child: Child,
    port: u16,
    asset_url: String,
    _stdout: BufReader<ChildStdout>,
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.child.kill().unwrap_or_default();
        drop(self.child.wait());
    }
}

fn serve(asset: &Path, options: &[&str]) -> Serving {
    let mut command = fantex();
    command.args(["--json", "serve"]).arg(asset).args(options);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut text = String::new();
    while !text.trim_end().ends_with('}') {
        assert_ne!(stdout.read_line(&mut text).unwrap(), 0, "{text}");
    }
    let info: Value = serde_json::from_str(&text).unwrap();
    let url = info["url"].as_str().unwrap();
    let port = url.trim_end_matches('/').rsplit_once(':').unwrap().1.parse().unwrap();
    Serving { child, port, asset_url: info["asset_url"].as_str().unwrap().to_owned(), _stdout: stdout }
}

/// Status, headers in lower case, body.
type Answer = (u16, Vec<String>, Vec<u8>);

fn read_answer(input: &mut impl BufRead, has_body: bool) -> Answer {
    let mut line = String::new();
    input.read_line(&mut line).unwrap();
    let status = line.split(' ').nth(1).unwrap().parse().unwrap();
    let mut headers = Vec::new();
    loop {
        line.clear();
        input.read_line(&mut line).unwrap();
        match line.trim() {
            "" => break,
            header => headers.push(header.to_ascii_lowercase()),
        }
    }
    let length = header(&headers, "content-length").map_or(0, |length| length.parse().unwrap());
    let mut body = vec![0; if has_body { length } else { 0 }];
    input.read_exact(&mut body).unwrap();
    (status, headers, body)
}

fn header<'a>(headers: &'a [String], name: &str) -> Option<&'a str> {
    headers.iter().find_map(|header| header.strip_prefix(name)?.strip_prefix(": "))
}

/// One request, with these lines below `Host`.
fn ask(port: u16, line: &str, headers: &str) -> Answer {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let host = if headers.contains("Host:") { "" } else { "Host: localhost\r\n" };
    write!(stream, "{line} HTTP/1.1\r\n{host}{headers}\r\n").unwrap();
    read_answer(&mut BufReader::new(stream), !line.starts_with("HEAD"))
}

fn small_asset(folder: &Path) -> Vec<u8> {
    let model = write(folder, "colored.ply", COLORED_PLY);
    succeeds(&[&"bake", &model, &"-o", &folder.join("a b.fan"), &"--texels", &"16k"]);
    std::fs::read(folder.join("a b.fan")).unwrap()
}

#[test]
fn ranges_versions_and_refusals_are_those_of_the_standard() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_asset(folder.path());
    let length = bytes.len();
    let Serving { port, ref asset_url, .. } = serve(&folder.path().join("a b.fan"), &[]);
    assert_eq!(*asset_url, format!("http://127.0.0.1:{port}/a%20b.fan"));
    let get = "GET /a%20b.fan";

    let (status, headers, body) = ask(port, get, "");
    assert_eq!((status, &body), (200, &bytes));
    assert_eq!(header(&headers, "accept-ranges"), Some("bytes"));
    assert_eq!(header(&headers, "content-type"), Some("application/octet-stream"));
    assert_eq!(header(&headers, "access-control-allow-origin"), None);
    let tag = header(&headers, "etag").unwrap().to_owned();
    let (status, headers, body) = ask(port, "HEAD /a%20b.fan", "");
    assert_eq!((status, body.len()), (200, 0));
    assert_eq!(header(&headers, "content-length"), Some(length.to_string().as_str()));

    let (status, headers, body) = ask(port, get, "Range: bytes=100-8191\r\n");
    assert_eq!((status, &body[..]), (206, &bytes[100..8192]));
    assert_eq!(header(&headers, "content-range"), Some(format!("bytes 100-8191/{length}").as_str()));
    assert_eq!(header(&headers, "etag"), Some(tag.as_str()));
    let (status, _, body) = ask(port, get, "Range: bytes=-10\r\n");
    assert_eq!((status, &body[..]), (206, &bytes[length - 10..]));
    let (status, headers, _) = ask(port, get, &format!("Range: bytes={length}-\r\n"));
    assert_eq!(
        (status, header(&headers, "content-range")),
        (416, Some(format!("bytes */{length}").as_str()))
    );

    // Ranges are for GET alone.
    let (status, headers, _) = ask(port, "HEAD /a%20b.fan", "Range: bytes=0-9\r\n");
    assert_eq!((status, header(&headers, "content-length")), (200, Some(length.to_string().as_str())));

    let if_range = |tag: &str| ask(port, get, &format!("Range: bytes=0-9\r\nIf-Range: {tag}\r\n"));
    assert_eq!((if_range(&tag).0, if_range("\"other\"").0), (206, 200));
    let (status, _, body) = ask(port, get, &format!("If-None-Match: W/{tag}\r\n"));
    assert_eq!((status, body.len()), (304, 0));
    assert_eq!(ask(port, get, "If-Match: \"other\"\r\n").0, 412);

    for (line, headers, status) in [
        ("GET /", "", 200),
        ("GET /?x=1", "", 200),
        ("POST /", "Content-Length: 3\r\n", 405),
        ("OPTIONS /a%20b.fan", "Access-Control-Request-Headers: range\r\n", 405),
        ("GET /../etc/passwd", "", 404),
        ("GET /%2e%2e/%2e%2e/etc/passwd", "", 404),
        ("GET //etc/passwd", "", 404),
        ("GET /colored.ply", "", 404),
        ("GET /", "Host: example.org\r\n", 403),
        ("GET x", "", 400),
    ] {
        assert_eq!(ask(port, line, headers).0, status, "{line}");
    }
    // Several requests over one connection, the first two at once.
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let request = format!("{get} HTTP/1.1\r\nHost: 127.0.0.1\r\nRange: bytes=5-9\r\n\r\n");
    stream.write_all(request.repeat(2).as_bytes()).unwrap();
    let mut input = BufReader::new(stream.try_clone().unwrap());
    for round in 0..3 {
        assert_eq!(read_answer(&mut input, true).2, bytes[5..10], "{round}");
        stream.write_all(request.as_bytes()).unwrap();
    }
}

#[test]
fn our_own_reader_reads_what_is_served() {
    let folder = tempfile::tempdir().unwrap();
    small_asset(folder.path());
    let serving = serve(&folder.path().join("a b.fan"), &["--share"]);
    let url = &serving.asset_url;
    let of_file = json(&[&"info", &folder.path().join("a b.fan")]);
    let of_url = json(&[&"info", url]);
    assert_eq!(of_file["triangles"], of_url["triangles"]);
    assert!(of_url["triangles"].is_number(), "{of_url}");
    succeeds(&[&"verify", url]);
    // Pages of other addresses ask first.
    let (status, headers, _) =
        ask(serving.port, "OPTIONS /a%20b.fan", "Access-Control-Request-Headers: range\r\n");
    assert_eq!(status, 204);
    assert!(header(&headers, "access-control-allow-headers").unwrap().contains("range"));
    assert!(header(&headers, "access-control-allow-methods").unwrap().contains("get"));
    assert_eq!(header(&headers, "access-control-allow-origin"), Some("*"));
    let curl = Command::new("curl").args(["-s", "-S", "-r", "0-7", "-D", "-", url]).output();
    let Ok(output) = curl else { return fantex_test::skip("no curl") };
    let text = String::from_utf8_lossy(&output.stdout).to_ascii_lowercase();
    assert!(text.starts_with("http/1.1 206 ") && output.stdout.ends_with(b"\x89FAN\r\n\x1a\n"), "{text}");
    assert!(text.contains("access-control-allow-origin: *"), "{text}");
    assert!(text.contains("timing-allow-origin: *"), "{text}");
}

/// Whoever comes when all places are taken hears that, and gets one once another is free.
#[test]
fn too_many_connections_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_asset(folder.path());
    let serving = serve(&folder.path().join("a b.fan"), &[]);
    let connect = |_| TcpStream::connect(("127.0.0.1", serving.port));
    let Ok(idle) = (0..256).map(connect).collect::<Result<Vec<_>, _>>() else {
        return fantex_test::skip("so many files may not be open at a time");
    };
    let deadline = Instant::now() + fantex_test::PATIENCE;
    let asked_until = |wanted: u16| loop {
        let answer = ask(serving.port, "GET /a%20b.fan", "");
        if answer.0 == wanted {
            break answer;
        }
        assert!(Instant::now() < deadline, "{wanted} is not answered");
        std::thread::sleep(Duration::from_millis(20));
    };
    let (_, headers, _) = asked_until(503);
    assert_eq!(header(&headers, "retry-after"), Some("1"));
    drop(idle);
    assert_eq!(asked_until(200).2, bytes);
}

#[test]
fn a_world_is_served_with_the_assets_that_it_names() {
    let folder = tempfile::tempdir().unwrap();
    small_asset(folder.path());
    let place = |name: &str| folder.path().join(name);
    std::fs::create_dir(place("some houses")).unwrap();
    std::fs::copy(place("a b.fan"), place("some houses/\u{fc}.fan")).unwrap();
    std::fs::copy(place("a b.fan"), place("another.fan")).unwrap();
    let index = place("the town.fanworld");
    json(&[&"world", &index, &place("a b.fan"), &place("some houses/\u{fc}.fan")]);
    let serving = serve(&index, &[]);
    let port = serving.port;
    assert_eq!(serving.asset_url, format!("http://127.0.0.1:{port}/the%20town.fanworld"));

    let (status, headers, body) = ask(port, "GET /the%20town.fanworld", "");
    assert_eq!((status, &body), (200, &std::fs::read(&index).unwrap()));
    assert_eq!(header(&headers, "content-type"), Some("application/json"));
    let bytes = std::fs::read(place("a b.fan")).unwrap();
    for asset in ["GET /a%20b.fan", "GET /some%20houses/%C3%BC.fan"] {
        let (status, headers, body) = ask(port, asset, "Range: bytes=3-99\r\n");
        assert_eq!((status, &body[..]), (206, &bytes[3..100]), "{asset}");
        assert!(header(&headers, "etag").is_some());
    }
    for (line, status) in [
        ("GET /", 200),
        ("GET /another.fan", 404),
        ("GET /some%20houses", 404),
        ("GET /some%20houses/../another.fan", 404),
    ] {
        assert_eq!(ask(port, line, "").0, status, "{line}");
    }

    // As the other programs read it: everything is there, and sound.
    let [of_file, of_url] =
        [index.to_str().unwrap(), serving.asset_url.as_str()].map(|place| json(&[&"info", &place]));
    for key in ["objects", "triangles", "texels", "low", "high"] {
        assert_eq!(of_file[key], of_url[key], "{key}");
    }
    assert_eq!(json(&[&"verify", &serving.asset_url])["ok"], true);
    let [here, there] = ["here.png", "there.png"].map(place);
    let size = [&"--size" as &dyn AsRef<std::ffi::OsStr>, &"160x120"];
    succeeds(&[&[&"render" as &dyn AsRef<std::ffi::OsStr>, &index, &"-o", &here][..], &size].concat());
    succeeds(
        &[&[&"render" as &dyn AsRef<std::ffi::OsStr>, &serving.asset_url, &"-o", &there][..], &size].concat(),
    );
    assert_eq!(std::fs::read(here).unwrap(), std::fs::read(there).unwrap());
}

#[test]
fn an_asset_that_is_replaced_has_another_version() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_asset(folder.path());
    let path = folder.path().join("a b.fan");
    let serving = serve(&path, &[]);
    let get = "GET /a%20b.fan";
    let tag = |answer: Answer| header(&answer.1, "etag").unwrap().to_owned();
    let first = tag(ask(serving.port, get, "Range: bytes=0-9\r\n"));
    std::fs::rename(write(folder.path(), "new.fan", [&bytes[..], b"more"].concat()), &path).unwrap();
    let (status, headers, body) =
        ask(serving.port, get, &format!("Range: bytes=0-9\r\nIf-Range: {first}\r\n"));
    assert_eq!((status, body.len()), (200, bytes.len() + 4));
    assert_ne!(header(&headers, "etag"), Some(first.as_str()));
    std::fs::remove_file(&path).unwrap();
    assert_eq!(ask(serving.port, get, "").0, 404);
}

#[test]
fn what_cannot_be_served_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_asset(folder.path());
    let model = folder.path().join("colored.ply");
    fails(1, &["colored.ply", "is not an asset"], &[&"serve", &model]);
    fails(1, &["missing.fan"], &[&"serve", &folder.path().join("missing.fan")]);
    fails(1, &["has an address already"], &[&"serve", &"https://example.org/a.fan"]);
    let world = folder.path().join("town.fanworld");
    fails(1, &["cannot read", "town.fanworld"], &[&"serve", &world]);
    json(&[&"world", &world, &folder.path().join("a b.fan")]);
    let index = std::fs::read_to_string(&world).unwrap();
    std::fs::write(&world, index.replace("a b.fan", "missing.fan")).unwrap();
    fails(1, &["missing.fan"], &[&"serve", &world]);
    std::fs::write(&world, index.replace("a b.fan", "../a b.fan")).unwrap();
    fails(1, &["outside its folder"], &[&"serve", &world]);
    fails(1, &["does not lie below its folder"], &[&"serve", &world, &"--allow-outside"]);
    json(&[&"world", &world, &"--remove", &"../a b.fan", &"--allow-outside"]);
    fails(1, &["nothing to show"], &[&"serve", &world]);
    assert_eq!(run(&[&"serve", &"a.fan", &"--port", &"0"]).status.code(), Some(2));
    let damaged = write(folder.path(), "half.fan", &bytes[..bytes.len() / 2]);
    fails(1, &["half.fan", "truncated"], &[&"serve", &damaged]);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    fails(1, &["port", &port, "--port"], &[&"serve", &folder.path().join("a b.fan"), &"--port", &port]);
}

#[test]
fn pages_that_cannot_be_written_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    small_asset(folder.path());
    let (asset, page) = (folder.path().join("a b.fan"), folder.path().join("page"));
    let export = [&"export" as &dyn AsRef<std::ffi::OsStr>, &asset, &"-o", &page, &"--web"];
    let with_base = [&export[..], &[&"--base-url", &"example.org"]].concat();
    fails(2, &["--base-url", "https://"], &with_base);
    fails(2, &["--web"], &[&"export", &asset, &"-o", &page, &"--title", &"x"]);
    match fantex_web::files() {
        None => {
            fails(1, &["without the viewer", "cargo xtask web"], &export);
            assert!(!page.exists(), "nothing is left behind");
        }
        Some(_) => {
            succeeds(&export);
            assert!(page.join("index.html").is_file() && page.join("a b.fan").is_file());
            fails(1, &["exists", "--force"], &export);
            let (index, page) = (folder.path().join("a.fanworld"), folder.path().join("town"));
            std::fs::create_dir(folder.path().join("houses")).unwrap();
            std::fs::copy(&asset, folder.path().join("houses/c.fan")).unwrap();
            json(&[&"world", &index, &asset, &folder.path().join("houses/c.fan")]);
            let info = json(&[&"export", &index, &"-o", &page, &"--web"]);
            let copies = ["a.fanworld", "a b.fan", "houses/c.fan"];
            assert!(copies.iter().all(|name| page.join(name).is_file()), "{info}");
            assert_eq!(json(&[&"verify", &page.join("a.fanworld")])["ok"], true);
            let html = std::fs::read_to_string(page.join("index.html")).unwrap();
            assert!(
                html.contains("data-asset=\"a.fanworld\"") && html.contains("<title>a</title>"),
                "{html}"
            );
        }
    }
}

#[test]
fn a_page_gets_the_preview_that_the_asset_has() {
    if fantex_web::files().is_none() {
        return fantex_test::skip("the viewer for browsers is not built (cargo xtask web)");
    }
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let (model, asset) = (place("land.ply"), place("land.fan"));
    // So many triangles that it gets one where it has none.
    succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"250k"]);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=landscape", &"--texels", &"300k"]);
    let exported = |page: &str| {
        json(&[&"export", &asset, &"-o", &place(page), &"--web"]);
        json(&[&"info", &place(page).join("land.fan")])["preview_bytes"].as_u64()
    };
    assert!(exported("without").is_some());
    assert!(json(&[&"info", &asset])["preview_bytes"].is_null(), "the asset itself stays as it is");
    let made = json(&[&"preview", &asset, &"--triangles", &"1k", &"--texels", &"10k"]);
    assert_eq!(exported("with"), made["bytes"].as_u64());
    // Then the page asks for the same bytes of the copy and of the asset.
    assert_eq!(std::fs::read(place("with/land.fan")).unwrap(), std::fs::read(&asset).unwrap());
}

#[cfg(unix)]
#[test]
#[expect(unsafe_code, reason = "a signal to the program")]
fn ctrl_c_ends_it_well() {
    let folder = tempfile::tempdir().unwrap();
    small_asset(folder.path());
    let mut serving = serve(&folder.path().join("a b.fan"), &[]);
    // A connection that asks nothing keeps it from nothing.
    let _idle = TcpStream::connect(("127.0.0.1", serving.port)).unwrap();
    // SAFETY: the process is a child that has not been waited for, so the number names it.
    assert_eq!(unsafe { libc::kill(serving.child.id() as libc::pid_t, libc::SIGINT) }, 0);
    let deadline = Instant::now() + fantex_test::PATIENCE;
    let status = loop {
        match serving.child.try_wait().unwrap() {
            Some(status) => break status,
            None => assert!(Instant::now() < deadline, "it goes on"),
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(status.code(), Some(0));
}
