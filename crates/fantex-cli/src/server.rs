//! A small web server (HTTP/1.1, RFC 9110 and 9112) for this machine alone: a fixed set of names, each with its content, in ranges.
//!
//! It knows no folder, so no path leads anywhere else, and it answers only who asks for this machine by name: a page elsewhere cannot
//! lead its own name here. A thread serves a connection.

use std::collections::BTreeMap;
use std::fs::File;
use std::hash::{DefaultHasher, Hasher};
use std::io::{self, BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, UNIX_EPOCH};

use fantex::base::input;

/// Longest head of a request.
const MAX_HEAD_BYTES: usize = 16 << 10;

/// Connections at a time. Browsers open six per page, `fantex view` about as many for each object of a world that it shows whole.
const MAX_CONNECTIONS: usize = 256;

/// A connection that neither asks nor takes anything for so long is closed.
const IDLE_TIME: Duration = Duration::from_secs(30);

/// So much of a body that nobody wants is read before a connection ends, and for so long is it waited for: a client that is still sending
/// would lose the answer.
const UNREAD_BYTES: u64 = 64 << 10;
const UNREAD_TIME: Duration = Duration::from_secs(1);

/// Time after a connection that could not be taken.
const ACCEPT_PAUSE: Duration = Duration::from_millis(10);

/// Bytes that are read and sent at a time.
const CHUNK_BYTES: u64 = 256 << 10;

/// What is served under one name.
#[derive(Clone, Debug)]
pub(crate) enum Content {
    Bytes(Arc<[u8]>),
    /// Opened anew for each request, so that a file that was replaced is served as it is now.
    File(PathBuf),
}

/// Contents by name, without the slash in front. The empty name is the first page.
#[derive(Debug)]
pub(crate) struct Site {
    contents: BTreeMap<String, (Content, &'static str)>,
    /// Whether pages of other addresses may read it.
    is_shared: bool,
}

impl Site {
    pub(crate) fn new(is_shared: bool) -> Self {
        Self { contents: BTreeMap::new(), is_shared }
    }

    pub(crate) fn add(&mut self, name: &str, content: Content) {
        let kind = content_type(if name.is_empty() { "index.html" } else { name });
        self.contents.insert(name.to_owned(), (content, kind));
    }
}

fn content_type(name: &str) -> &'static str {
    match Path::new(name).extension().and_then(|extension| extension.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("json" | "fanworld") => "application/json",
        Some("txt") => "text/plain; charset=utf-8",
        Some("wasm") => "application/wasm",
        Some("png") => "image/png",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}

/// A server that is reached from this machine only.
#[derive(Debug)]
pub(crate) struct Server {
    listener: TcpListener,
    site: Arc<Site>,
}

impl Server {
    /// Listens at a port of the loopback address; at any free one where `port` is 0.
    pub(crate) fn bind(site: Site, port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        Ok(Self { listener, site: Arc::new(site) })
    }

    pub(crate) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Answers for ever.
    pub(crate) fn run(self) {
        let open = Arc::new(AtomicUsize::new(0));
        for stream in self.listener.incoming() {
            let Ok(stream) = stream else {
                // A client that was gone before it was heard, or no file may be opened for now: others close theirs.
                std::thread::sleep(ACCEPT_PAUSE);
                continue;
            };
            let place = Place::take(&open);
            let site = Arc::clone(&self.site);
            // Whoever closes the connection wants no more.
            let serve = move || match place {
                Some(_place) => serve(stream, &site).unwrap_or_default(),
                None => refuse(stream).unwrap_or_default(),
            };
            // Without a thread the connection is closed.
            drop(std::thread::Builder::new().name("fan-serve".into()).stack_size(256 << 10).spawn(serve));
        }
    }
}

/// One of the connections that are served at a time.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn take(open: &Arc<AtomicUsize>) -> Option<Self> {
        let place = Self(Arc::clone(open));
        (open.fetch_add(1, Ordering::Relaxed) < MAX_CONNECTIONS).then_some(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Tells a client that all places are taken.
fn refuse(stream: TcpStream) -> io::Result<()> {
    let mut full = Answer::text(503, "too many connections are open: try again\n");
    full.headers.push(("Retry-After", "1".into()));
    full.closes = true;
    stream.set_write_timeout(Some(UNREAD_TIME))?;
    full.send(&mut BufWriter::new(&stream))?;
    end(&stream)
}

/// Ends a connection whose client may still be sending.
fn end(stream: &TcpStream) -> io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(UNREAD_TIME))?;
    io::copy(&mut stream.take(UNREAD_BYTES), &mut io::sink()).map(drop)
}

/// Answers the requests of a connection, one after the other.
fn serve(stream: TcpStream, site: &Site) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(IDLE_TIME))?;
    stream.set_write_timeout(Some(IDLE_TIME))?;
    let mut input = BufReader::new(stream.try_clone()?);
    let mut output = BufWriter::new(stream);
    loop {
        let answer = match read_request(&mut input)? {
            Some(request) => answer(site, &request),
            None => return Ok(()),
        };
        answer.send(&mut output)?;
        output.flush()?;
        if answer.closes {
            return end(output.get_ref());
        }
    }
}

// Requests.

/// What of a request's head decides about the answer.
#[derive(Debug, Default)]
struct Request {
    /// The status that answers a head which cannot be understood.
    defect: Option<u16>,
    method: String,
    /// Decoded, without the slash in front and without a query.
    name: String,
    /// By lower-case name; of several of one name the last.
    headers: BTreeMap<String, String>,
    /// The connection ends with it.
    closes: bool,
}

impl Request {
    fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).map(|value| value.trim())
    }
}

/// The next request of a connection; none at its end.
fn read_request(input: &mut impl BufRead) -> io::Result<Option<Request>> {
    let mut head = Vec::new();
    // Lines may end without a carriage return.
    while !(head.ends_with(b"\r\n\r\n") || head.ends_with(b"\n\n")) {
        if head.len() >= MAX_HEAD_BYTES {
            return Ok(Some(Request { defect: Some(431), closes: true, ..Request::default() }));
        }
        let line_end =
            input.by_ref().take((MAX_HEAD_BYTES - head.len()) as u64).read_until(b'\n', &mut head)?;
        if line_end == 0 {
            return Ok(None);
        }
    }
    Ok(Some(parsed(&head)))
}

fn parsed(head: &[u8]) -> Request {
    let mut headers = [httparse::EMPTY_HEADER; 64];
    let mut request = httparse::Request::new(&mut headers);
    let bad = || Request { defect: Some(400), closes: true, ..Request::default() };
    let (Ok(httparse::Status::Complete(_)), Some(method), Some(target)) =
        (request.parse(head), request.method, request.path)
    else {
        return bad();
    };
    // As proxies are asked: the address with its host.
    let (host, target) = match target.split_once("://") {
        Some((_, rest)) => {
            let (host, _) = rest.split_once('/').unwrap_or((rest, ""));
            (Some(host), rest.strip_prefix(host).filter(|path| !path.is_empty()).unwrap_or("/"))
        }
        None => (None, target),
    };
    let path = target.split(['?', '#']).next().unwrap_or_default();
    let name = percent_encoding::percent_decode_str(path).decode_utf8();
    let (Some(name), true) = (name.ok(), path.starts_with('/')) else { return bad() };
    let (method, name) = (method.to_owned(), name[1..].to_owned());
    let text = |header: &httparse::Header<'_>| {
        (header.name.to_ascii_lowercase(), String::from_utf8_lossy(header.value).into_owned())
    };
    let is_old = request.version != Some(1);
    if request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case("host")).count() > 1 {
        return bad();
    }
    let mut headers: BTreeMap<String, String> = request.headers.iter().map(text).collect();
    if let Some(host) = host {
        headers.insert("host".to_owned(), host.to_owned());
    }
    // A body is not read, so nothing may follow it.
    let has_body = headers.contains_key("transfer-encoding")
        || headers.get("content-length").is_some_and(|length| length.trim() != "0");
    let asks_to_close =
        headers.get("connection").is_some_and(|value| value.to_ascii_lowercase().contains("close"));
    Request { defect: None, method, name, headers, closes: is_old || has_body || asks_to_close }
}

/// Whether a request means this machine: the host's name without its port.
fn names_this_machine(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    matches!(name.to_ascii_lowercase().as_str(), "localhost" | "127.0.0.1" | "[::1]")
}

// Answers.

/// What is sent of a content.
enum Body {
    Nothing,
    Text(&'static str),
    Bytes(Arc<[u8]>, Range<u64>),
    File(File, Range<u64>),
}

struct Answer {
    status: u16,
    headers: Vec<(&'static str, String)>,
    /// Bytes of the body, also where a head alone was asked for.
    length: u64,
    body: Body,
    closes: bool,
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        204 => "No Content",
        206 => "Partial Content",
        304 => "Not Modified",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        412 => "Precondition Failed",
        416 => "Range Not Satisfiable",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Internal Server Error",
    }
}

impl Answer {
    fn text(status: u16, text: &'static str) -> Self {
        let headers = vec![("Content-Type", "text/plain; charset=utf-8".to_owned())];
        Self { status, headers, length: text.len() as u64, body: Body::Text(text), closes: false }
    }

    fn send(&self, output: &mut impl Write) -> io::Result<()> {
        write!(output, "HTTP/1.1 {} {}\r\n", self.status, reason(self.status))?;
        for (name, value) in &self.headers {
            write!(output, "{name}: {value}\r\n")?;
        }
        if !matches!(self.status, 204 | 304) {
            write!(output, "Content-Length: {}\r\n", self.length)?;
        }
        let connection = if self.closes { "close" } else { "keep-alive" };
        write!(output, "Connection: {connection}\r\nX-Content-Type-Options: nosniff\r\n\r\n")?;
        match &self.body {
            Body::Nothing => Ok(()),
            Body::Text(text) => output.write_all(text.as_bytes()),
            Body::Bytes(bytes, range) => output.write_all(&bytes[range.start as usize..range.end as usize]),
            Body::File(file, range) => send_file(file, range, output),
        }
    }
}

fn send_file(mut file: &File, range: &Range<u64>, output: &mut impl Write) -> io::Result<()> {
    file.seek(SeekFrom::Start(range.start))?;
    let mut left = range.end - range.start;
    let mut chunk = vec![0; left.min(CHUNK_BYTES) as usize];
    while left > 0 {
        let part = &mut chunk[..left.min(CHUNK_BYTES) as usize];
        // A file that has become shorter: the connection breaks, so that nobody takes less for all.
        file.read_exact(part)?;
        output.write_all(part)?;
        left -= part.len() as u64;
    }
    Ok(())
}

fn answer(site: &Site, request: &Request) -> Answer {
    let mut answer = match request.defect {
        Some(status) => Answer::text(status, "this request cannot be understood\n"),
        None => understood(site, request),
    };
    if site.is_shared {
        let exposed = "Accept-Ranges, Content-Length, Content-Range, ETag";
        answer.headers.push(("Access-Control-Allow-Origin", "*".into()));
        answer.headers.push(("Access-Control-Expose-Headers", exposed.into()));
        answer.headers.push(("Timing-Allow-Origin", "*".into()));
    }
    answer.closes |= request.closes;
    if request.method == "HEAD" {
        answer.body = Body::Nothing;
    }
    answer
}

fn understood(site: &Site, request: &Request) -> Answer {
    if !request.header("host").is_some_and(names_this_machine) {
        return Answer::text(403, "this server is for this machine: ask for 127.0.0.1 or localhost\n");
    }
    if site.is_shared && request.method == "OPTIONS" {
        return preflight();
    }
    if !matches!(request.method.as_str(), "GET" | "HEAD") {
        let mut refused = Answer::text(405, "this server is read only\n");
        refused.headers.push(("Allow", "GET, HEAD".into()));
        return refused;
    }
    let Some((content, kind)) = site.contents.get(&request.name) else {
        return Answer::text(404, "there is nothing of this name\n");
    };
    match Opened::new(content) {
        Ok(opened) => found(opened, kind, request),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Answer::text(404, "the file that was served here has gone\n")
        }
        Err(_) => Answer::text(500, "the file that is served here cannot be read\n"),
    }
}

/// What pages of other addresses may ask for (the Fetch standard's preflight).
fn preflight() -> Answer {
    let headers = [
        ("Access-Control-Allow-Methods", "GET, HEAD"),
        ("Access-Control-Allow-Headers", "Range, If-Range, If-Match, If-None-Match"),
        ("Access-Control-Max-Age", "86400"),
    ];
    let headers = headers.map(|(name, value)| (name, value.to_owned())).into();
    Answer { status: 204, headers, length: 0, body: Body::Nothing, closes: false }
}

/// A content, and what tells its versions apart.
struct Opened<'a> {
    content: &'a Content,
    file: Option<File>,
    length: u64,
    tag: String,
}

impl<'a> Opened<'a> {
    fn new(content: &'a Content) -> io::Result<Self> {
        match content {
            Content::Bytes(bytes) => {
                let mut hasher = DefaultHasher::new();
                hasher.write(bytes);
                let (length, tag) = (bytes.len() as u64, format!("\"{:016x}\"", hasher.finish()));
                Ok(Self { content, file: None, length, tag })
            }
            Content::File(path) => {
                let file = input::open(path)?;
                let metadata = file.metadata()?;
                let age = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
                let (length, time) = (metadata.len(), age.unwrap_or_default().as_nanos());
                let tag = format!("\"{length:x}-{time:x}-{:x}\"", inode(&metadata));
                Ok(Self { content, file: Some(file), length, tag })
            }
        }
    }

    fn body(self, range: Range<u64>) -> Body {
        match (self.content, self.file) {
            (_, Some(file)) => Body::File(file, range),
            (Content::Bytes(bytes), None) => Body::Bytes(Arc::clone(bytes), range),
            (Content::File(_), None) => Body::Nothing,
        }
    }
}

#[cfg(unix)]
fn inode(metadata: &std::fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::ino(metadata)
}

/// Elsewhere length and time must do.
#[cfg(not(unix))]
fn inode(_metadata: &std::fs::Metadata) -> u64 {
    0
}

fn found(opened: Opened<'_>, kind: &str, request: &Request) -> Answer {
    let (length, tag) = (opened.length, opened.tag.clone());
    let mut headers = vec![
        ("ETag", tag.clone()),
        ("Accept-Ranges", "bytes".into()),
        // Kept, and asked about before each use.
        ("Cache-Control", "no-cache".into()),
    ];
    let names_tag = |list: &str| {
        list == "*" || list.split(',').any(|one| one.trim().strip_prefix("W/").unwrap_or(one.trim()) == tag)
    };
    if request.header("if-match").is_some_and(|list| !names_tag(list)) {
        return Answer::text(412, "the file has changed\n");
    }
    if request.header("if-none-match").is_some_and(names_tag) {
        return Answer { status: 304, headers, length: 0, body: Body::Nothing, closes: false };
    }
    headers.push(("Content-Type", kind.to_owned()));
    // A range of another version is not asked for.
    let same_version = request.header("if-range").is_none_or(|version| version == tag);
    // Ranges are for GET alone.
    let is_asked = same_version && request.method == "GET";
    let range = request.header("range").filter(|_| is_asked).and_then(|range| asked(range, length));
    let (status, range) = match range {
        None => (200, 0..length),
        Some(Some(range)) => {
            headers.push(("Content-Range", format!("bytes {}-{}/{length}", range.start, range.end - 1)));
            (206, range)
        }
        Some(None) => {
            let mut refused = Answer::text(416, "the file ends before this range\n");
            refused.headers.push(("Content-Range", format!("bytes */{length}")));
            return refused;
        }
    };
    let sent = range.end - range.start;
    Answer { status, headers, length: sent, body: opened.body(range), closes: false }
}

/// The range that a header asks for: none where it is to be ignored (another unit, several ranges, no range), `Some(None)` where the
/// content has nothing of it.
fn asked(header: &str, length: u64) -> Option<Option<Range<u64>>> {
    let (unit, range) = header.split_once('=')?;
    let (first, last) = range.trim().split_once('-')?;
    let number = |text: &str| {
        let is_number = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        // What is beyond all numbers is beyond the end.
        is_number.then(|| text.parse::<u64>().unwrap_or(u64::MAX))
    };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return None;
    }
    let range = match (first.trim(), last.trim()) {
        ("", last) => length.saturating_sub(number(last)?)..length,
        (first, "") => number(first)?..length,
        (first, last) => {
            let (first, last) = (number(first)?, number(last)?);
            if last < first {
                return None;
            }
            first..last.saturating_add(1).min(length)
        }
    };
    Some((range.start < range.end).then_some(range))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_the_standard() {
        for (header, range) in [
            ("bytes=0-499", Some(Some(0..500))),
            ("bytes=500-999", Some(Some(500..1000))),
            ("bytes=500-5000", Some(Some(500..1000))),
            ("bytes=-500", Some(Some(500..1000))),
            ("bytes=-5000", Some(Some(0..1000))),
            ("Bytes = 9500- ", Some(None)),
            ("bytes=999-", Some(Some(999..1000))),
            ("bytes=0-0", Some(Some(0..1))),
            ("bytes=-0", Some(None)),
            ("bytes=1000-1001", Some(None)),
            ("bytes=1000-", Some(None)),
            ("bytes=99999999999999999999999-", Some(None)),
            ("bytes=0-99999999999999999999999", Some(Some(0..1000))),
            ("bytes=5-3", None),
            ("bytes=0-1,5-6", None),
            ("bytes=a-b", None),
            ("bytes=+1-2", None),
            ("bytes=-", None),
            ("lines=0-1", None),
            ("", None),
        ] {
            assert_eq!(asked(header, 1000), range, "{header}");
        }
        assert_eq!(asked("bytes=0-", 0), Some(None));
    }

    #[test]
    fn heads_are_understood_or_refused() {
        let request =
            parsed(b"GET /a%20b.fan?x=1 HTTP/1.1\r\nHost: localhost:80\r\nRange:  bytes=0-1 \r\n\r\n");
        assert_eq!((request.defect, request.name.as_str(), request.closes), (None, "a b.fan", false));
        assert_eq!(request.header("range"), Some("bytes=0-1"));
        assert!(parsed(b"GET / HTTP/1.1\r\nConnection: Close\r\n\r\n").closes);
        assert!(parsed(b"GET / HTTP/1.0\r\n\r\n").closes);
        assert!(parsed(b"POST / HTTP/1.1\r\nContent-Length: 4\r\n\r\n").closes);
        for wrong in [
            "GET\r\n\r\n",
            "GET /%ff HTTP/1.1\r\n\r\n",
            "GET x HTTP/1.1\r\n\r\n",
            "\0\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: localhost\r\nhost: example.org\r\n\r\n",
        ] {
            assert_eq!(parsed(wrong.as_bytes()).defect, Some(400), "{wrong:?}");
        }
        // With the host in front, which then counts; lines without carriage returns.
        for (line, name) in [("http://127.0.0.1:80/a.fan?x", "a.fan"), ("http://127.0.0.1:80", "")] {
            let head = format!("GET {line} HTTP/1.1\nHost: example.org\n\n");
            let request = read_request(&mut head.as_bytes()).unwrap().unwrap();
            assert_eq!((request.defect, request.name.as_str()), (None, name), "{line}");
            assert_eq!(request.header("host"), Some("127.0.0.1:80"), "{line}");
        }
        let long = format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "x".repeat(MAX_HEAD_BYTES));
        assert_eq!(read_request(&mut long.as_bytes()).unwrap().unwrap().defect, Some(431));
        assert!(read_request(&mut "GET / HT".as_bytes()).unwrap().is_none());
    }

    #[test]
    fn only_this_machine_is_meant() {
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1:1", "[::1]:80", "[::1]"] {
            assert!(names_this_machine(host), "{host}");
        }
        for host in ["example.org", "localhost.example.org:80", "127.0.0.1.example.org", "", "[::2]:80"] {
            assert!(!names_this_machine(host), "{host}");
        }
    }
}
