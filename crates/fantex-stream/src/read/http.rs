//! Reads from a web server or an object store by range requests (RFC 9110, section 14).

use std::io;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, OnceLock};
use std::time::{Duration, Instant};

use fantex_store::ByteSource;
use ureq::Body;
use ureq::http::{HeaderValue, Response, header};

use super::file::start_threads;
use super::object::{SignedRequest, StoredObject};
use super::ranges::{Answered, RangeAnswer, ended_early, server_error};
use super::{LaneReader, MAX_READ_BYTES, ReadBuffer, ReaderInfo, ReaderKind, RetryPolicy, is_transient};

/// A file on a web server, or an object in an object store. Connections are kept and shared by all sources.
#[derive(Debug)]
pub struct HttpSource {
    url: String,
    /// The URL again, in the form that messages about files have.
    location: PathBuf,
    /// None on a web server; an error where the URL names no object.
    object: io::Result<Option<StoredObject>>,
    /// Time for one request.
    request_time: Duration,
    connections: usize,
    is_patient: bool,
    length: OnceLock<u64>,
    /// Tag or date of the file that the first answer came from; none where the server tells neither.
    version: OnceLock<Option<String>>,
}

/// Bytes that are asked for at once.
const MAX_REQUEST_BYTES: usize = 4 << 20;

/// Time for one request: 70 kB/s for the longest.
const MAX_REQUEST_TIME: Duration = Duration::from_secs(60);

/// Time after which a read that failed is not tried again.
const MAX_READ_TIME: Duration = Duration::from_secs(90);

/// Redirects of one request.
const MAX_REDIRECTS: u32 = 8;

/// Unused connections that are kept, for a while.
const MAX_IDLE_CONNECTIONS: usize = 32;

/// One for all sources: a world has hundreds of assets on one server.
static AGENT: LazyLock<ureq::Agent> = LazyLock::new(|| {
    let config = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .accept_encoding("identity")
        .max_idle_connections(MAX_IDLE_CONNECTIONS)
        .max_idle_connections_per_host(MAX_IDLE_CONNECTIONS)
        .timeout_connect(Some(Duration::from_secs(10)))
        .timeout_recv_response(Some(Duration::from_secs(20)))
        .timeout_per_read(Some(Duration::from_secs(20)))
        .max_redirects(0)
        .max_redirects_will_error(false)
        .build();
    config.new_agent()
});

pub(crate) fn client_error(error: ureq::Error) -> io::Error {
    let kind = match &error {
        // An end where a response was due.
        ureq::Error::Io(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            io::ErrorKind::ConnectionAborted
        }
        ureq::Error::Io(error) => error.kind(),
        ureq::Error::Timeout(_) => io::ErrorKind::TimedOut,
        ureq::Error::BadUri(_) | ureq::Error::TooManyRedirects => io::ErrorKind::InvalidInput,
        _ => io::ErrorKind::Other,
    };
    io::Error::new(kind, error)
}

impl HttpSource {
    /// A file at a URL (`http://`, `https://`, `s3://bucket/key`, `gs://bucket/key`, `az://container/blob`), read over at most `connections` at
    /// a time. A request ends after a minute. Sends nothing yet. Object stores are asked with the keys and at the endpoint that the variables
    /// `AWS_...` and `AZURE_...` name.
    pub fn new(url: &str, connections: usize) -> Self {
        Self::with_request_time(url, connections, MAX_REQUEST_TIME)
    }

    /// As [`HttpSource::new`], with another time for a request of at most 4 MiB, all redirects and the whole answer included.
    pub fn with_request_time(url: &str, connections: usize, time: Duration) -> Self {
        Self {
            url: url.to_owned(),
            location: PathBuf::from(url),
            object: StoredObject::at(url),
            request_time: time,
            connections: connections.max(1),
            is_patient: false,
            length: OnceLock::new(),
            version: OnceLock::new(),
        }
    }

    /// For long work, which is not to end with a network that is gone for some seconds.
    #[must_use]
    pub(crate) fn patient(self) -> Self {
        Self { is_patient: true, ..self }
    }

    /// Reads this version and no other. Without one, that of the first answer.
    #[must_use]
    pub(crate) fn of_version(self, version: Option<&str>) -> Self {
        match version {
            Some(version) => Self { version: OnceLock::from(Some(version.to_owned())), ..self },
            None => self,
        }
    }

    /// The URL.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// What the store of this object calls it when it copies from it; none where it copies no ranges.
    pub(crate) fn copy_source(&self) -> Option<String> {
        self.object.as_ref().ok()?.as_ref()?.copy_source()
    }

    /// The strong tag of the version that is read, once something has been, where the server tells one.
    pub(crate) fn tag(&self) -> Option<&str> {
        self.version.get()?.as_deref().filter(|version| version.starts_with('"'))
    }

    /// The answer to a request for a range, behind all redirects. A range of another version of the file is not asked for.
    fn request(&self, range: &str) -> io::Result<Response<Body>> {
        let (SignedRequest { mut url, mut headers }, knows_if_range) = match &self.object {
            Ok(Some(object)) => (object.reading(range), object.knows_if_range()),
            Ok(None) => (SignedRequest { url: self.url.clone(), headers: Vec::new() }, true),
            Err(error) => return Err(server_error(error.kind(), error.to_string())),
        };
        for _ in 0..=MAX_REDIRECTS {
            let request = AGENT.get(&url).config().timeout_global(Some(self.request_time)).build();
            let mut request = request.header(header::RANGE, range);
            for (name, value) in &headers {
                request = request.header(*name, value.as_str());
            }
            // Weak tags are not for ranges.
            if let Some(Some(version)) = self.version.get()
                && knows_if_range
                && !version.starts_with("W/")
            {
                request = request.header(header::IF_RANGE, version);
            }
            let response = request.call().map_err(client_error)?;
            let target = response.headers().get(header::LOCATION).and_then(|target| target.to_str().ok());
            match target.filter(|_| matches!(response.status().as_u16(), 301 | 302 | 303 | 307 | 308)) {
                Some(target) => {
                    url = redirected(&url, target)?;
                    // They prove to one server who asks.
                    headers.clear();
                }
                None => return Ok(response),
            }
        }
        Err(server_error(
            io::ErrorKind::InvalidInput,
            format!("the server redirects more than {MAX_REDIRECTS} times"),
        ))
    }

    /// Reads what as many requests as there are connections bring, which are made at the same time.
    fn read_parts(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let offsets = (offset..).step_by(MAX_REQUEST_BYTES);
        let mut parts = bytes.chunks_mut(MAX_REQUEST_BYTES).zip(offsets);
        let Some((first, offset)) = parts.next() else { return Ok(0) };
        let read = |part: &mut [u8], offset| self.read_part(part, offset).map(|got| (got, part.len()));
        let lengths = std::thread::scope(|scope| {
            let others: Vec<_> =
                parts.map(|(part, offset)| scope.spawn(move || read(part, offset))).collect();
            let mut lengths = vec![read(first, offset)];
            for other in others {
                match other.join() {
                    Ok(length) => lengths.push(length),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
            lengths
        });
        let mut filled = 0;
        for length in lengths {
            let (got, asked) = length?;
            filled += got;
            if got < asked {
                break;
            }
        }
        Ok(filled)
    }

    /// Reads at most one request's bytes. Queued reads are made once; their owner retries.
    fn read_part(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let started = Instant::now();
        let worth = |error: &io::Error| is_transient(error) && started.elapsed() < MAX_READ_TIME;
        self.patience().run(|| self.read_once(bytes, offset), worth, std::thread::sleep)
    }

    /// A server that has never answered may not be there at all, which is told soon.
    fn patience(&self) -> RetryPolicy {
        match self.version.get() {
            Some(_) if self.is_patient => RetryPolicy::PATIENT,
            _ => RetryPolicy::NETWORK,
        }
    }

    /// Reads the bytes from `offset` on, in one request unless the server sends fewer at once; returns how many there were.
    fn read_once(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let mut filled = 0;
        loop {
            let next = offset.saturating_add(filled as u64);
            let got = self.read_answer(&mut bytes[filled..], next)?;
            filled += got;
            let is_end = |length: &u64| next.saturating_add(got as u64) >= *length;
            if got == 0 || filled == bytes.len() || self.length.get().is_some_and(is_end) {
                return Ok(filled);
            }
        }
    }

    /// Reads, in one request, bytes from `offset` on; returns how many came.
    fn read_answer(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let Some(last) = (bytes.len() as u64).checked_sub(1) else { return Ok(0) };
        let range = format!("bytes={offset}-{}", offset.saturating_add(last));
        let mut response = self.request(&range)?;
        let text = |name| response.headers().get(name).and_then(|value: &HeaderValue| value.to_str().ok());
        let answer = RangeAnswer {
            status: response.status().as_u16(),
            content_range: text(header::CONTENT_RANGE),
            version: text(header::ETAG).or_else(|| text(header::LAST_MODIFIED)),
        };
        let known = self.version.get().and_then(Option::as_deref);
        let checked = answer.check(offset, bytes.len(), known);
        let Answered { length: expected, total } =
            checked.map_err(|error| self.advised(error, answer.status))?;
        if expected > 0 {
            // Of several first answers one tells the version of all.
            let version = self.version.get_or_init(|| answer.version.map(str::to_owned));
            answer.check(offset, bytes.len(), version.as_deref())?;
        }
        if let Some(total) = total {
            self.length.get_or_init(|| total);
        }
        if expected == 0 {
            return Ok(0);
        }
        let is_all = response.body().content_length() == Some(expected as u64);
        let mut reader = response.body_mut().as_reader();
        let got = fill(&mut reader, &mut bytes[..expected])?;
        if got < expected {
            return Err(ended_early(got, expected));
        }
        // A connection is used again once the end of the answer has been read.
        if is_all {
            fill(&mut reader, &mut [0]).unwrap_or_default();
        }
        Ok(got)
    }
}

impl HttpSource {
    /// What a server refuses, with what may be done about it.
    fn advised(&self, error: io::Error, status: u16) -> io::Error {
        match &self.object {
            Ok(Some(object)) if object.may_lack_rights(status) => {
                server_error(error.kind(), format!("{error}; {}", object.advice("read")))
            }
            _ => error,
        }
    }
}

/// Reads until `bytes` are full or nothing comes any more. A connection that breaks counts as one that ended.
fn fill(reader: &mut impl Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match reader.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
            // What the client ran out of is wrapped in it.
            Err(error) => return Err(client_error(error.into())),
        }
    }
    Ok(filled)
}

impl ByteSource for HttpSource {
    fn location(&self) -> &Path {
        &self.location
    }

    fn length(&self) -> io::Result<u64> {
        if self.length.get().is_none() {
            self.read_at(&mut [0], 0)?;
        }
        self.length.get().copied().ok_or_else(|| {
            server_error(io::ErrorKind::InvalidData, "the server does not tell how long the file is")
        })
    }

    fn version(&self) -> Option<&str> {
        self.version.get()?.as_deref()
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let mut filled = 0;
        for part in bytes.chunks_mut(MAX_REQUEST_BYTES * self.connections) {
            let got = self.read_parts(part, offset + filled as u64)?;
            filled += got;
            if got < part.len() {
                break;
            }
        }
        Ok(filled)
    }
}

/// Where a redirect leads.
fn redirected(url: &str, target: &str) -> io::Result<String> {
    let (scheme, rest) = url.split_once("://").unwrap_or(("http", url));
    let host = rest.split(['/', '?']).next().unwrap_or(rest);
    let lower = target.to_ascii_lowercase();
    if lower.starts_with("http://") || lower.starts_with("https://") {
        return Ok(target.to_owned());
    }
    if let Some(rest) = target.strip_prefix("//") {
        return Ok(format!("{scheme}://{rest}"));
    }
    if target.starts_with('/') {
        return Ok(format!("{scheme}://{host}{target}"));
    }
    if target.split(['/', '?', '#']).next().is_some_and(|start| start.contains(':')) {
        let message = format!("the server redirects to {target}, which is no http:// or https:// address");
        return Err(server_error(io::ErrorKind::InvalidInput, message));
    }
    let path = rest.split('?').next().unwrap_or(rest);
    let folder = path.rfind('/').map_or(host, |end| &path[..end]);
    Ok(format!("{scheme}://{folder}/{target}"))
}

/// A queued reader of a file on a web server, over `connections` at a time (browsers use six).
///
/// # Errors
/// The system refuses a thread.
pub fn http_reader(source: Arc<HttpSource>, connections: usize) -> io::Result<LaneReader> {
    let depth = connections.clamp(1, 64);
    let info = ReaderInfo { kind: ReaderKind::Http, direct: false, depth };
    start_threads(info, "fan-http", move |request, pool| {
        if request.length > MAX_READ_BYTES {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        let mut memory = pool.take(request.length);
        let start = memory.start;
        let result = source.read_once(&mut memory.bytes[start..start + request.length], request.offset);
        let buffer = ReadBuffer::new(memory, 0..request.length, Arc::clone(pool));
        match result? {
            count if count == request.length => Ok(buffer),
            _ => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_that_has_answered_is_waited_for() {
        let source = HttpSource::new("https://a.org/b.fan", 1).patient();
        assert_eq!(source.patience(), RetryPolicy::NETWORK);
        source.version.set(None).unwrap();
        let patience = source.patience();
        let pauses: Duration = (0..patience.retries).map(|attempt| patience.pause(attempt)).sum();
        assert!((Duration::from_secs(20)..MAX_READ_TIME).contains(&pauses), "{pauses:?}");
    }

    #[test]
    fn redirects_stay_on_the_web() {
        let to = |target| redirected("http://a.org:80/x/y.fan?z=1", target);
        for (target, url) in [
            ("https://b.org/c", "https://b.org/c"),
            ("//b.org/c", "http://b.org/c"),
            ("/c?d:e", "http://a.org:80/c?d:e"),
            ("c.fan", "http://a.org:80/x/c.fan"),
        ] {
            assert_eq!(to(target).unwrap(), url);
        }
        for target in ["file:///etc/passwd", "FILE:/etc/passwd", "ftp://b.org/c"] {
            let sentence = to(target).unwrap_err().to_string();
            assert!(sentence.contains(target) && sentence.contains("no http://"), "{sentence}");
        }
    }
}
