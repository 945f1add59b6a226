//! Reads from a web server by range requests (RFC 9110, section 14).

use std::io;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use fantex_store::ByteSource;
use ureq::http::{HeaderMap, StatusCode, header};

use super::file::{ReadBuffer, start_threads};
use super::{LaneReader, MAX_READ_BYTES, ReaderInfo, ReaderKind, RetryPolicy, is_transient};

/// A file on a web server. Connections are kept and shared by threads.
#[derive(Debug)]
pub struct HttpSource {
    url: String,
    /// The URL again, in the form that messages about files have.
    location: PathBuf,
    agent: ureq::Agent,
    length: OnceLock<u64>,
}

/// A server's answer that cannot be used.
fn server_error(kind: io::ErrorKind, message: impl Into<String>) -> io::Error {
    io::Error::new(kind, message.into())
}

fn other_range() -> io::Error {
    let message = "the server answered a range request with a range that was not asked for";
    server_error(io::ErrorKind::InvalidData, message)
}

fn status_error(status: StatusCode) -> io::Error {
    let kind = match status.as_u16() {
        401 | 403 => io::ErrorKind::PermissionDenied,
        // Too early, too many, or the server's own trouble: may pass.
        408 | 425 | 429 | 500..=599 => io::ErrorKind::Other,
        404 | 410 => io::ErrorKind::NotFound,
        _ => io::ErrorKind::Unsupported,
    };
    server_error(kind, format!("the server answered with status {status}"))
}

fn client_error(error: ureq::Error) -> io::Error {
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
    /// A file at a URL (`http://` or `https://`), read over at most `connections` at a time. Sends nothing yet.
    pub fn new(url: &str, connections: usize) -> Self {
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .accept_encoding("identity")
            .max_idle_connections(connections)
            .max_idle_connections_per_host(connections)
            .timeout_connect(Some(Duration::from_secs(10)))
            .timeout_recv_response(Some(Duration::from_secs(20)))
            .timeout_per_read(Some(Duration::from_secs(20)))
            .build();
        Self {
            url: url.to_owned(),
            location: PathBuf::from(url),
            agent: config.new_agent(),
            length: OnceLock::new(),
        }
    }

    /// The URL.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Reads, in one request, the bytes from `offset` on; returns how many there were.
    fn read_once(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let Some(last) = (bytes.len() as u64).checked_sub(1) else { return Ok(0) };
        let range = format!("bytes={offset}-{}", offset.saturating_add(last));
        let response = self.agent.get(&self.url).header(header::RANGE, range).call();
        let mut response = response.map_err(client_error)?;
        let expected = match response.status() {
            StatusCode::PARTIAL_CONTENT => {
                let range = content_range(response.headers()).ok_or_else(other_range)?;
                self.length.get_or_init(|| range.total);
                match range.first_last {
                    Some((first, last)) if first == offset && last >= first => {
                        (last - first + 1).min(bytes.len() as u64) as usize
                    }
                    _ => return Err(other_range()),
                }
            }
            // The range lies beyond the end.
            StatusCode::RANGE_NOT_SATISFIABLE => {
                if let Some(range) = content_range(response.headers()) {
                    self.length.get_or_init(|| range.total);
                }
                return Ok(0);
            }
            StatusCode::OK => {
                let message = "the server sends only whole files: it does not support range requests, which streaming needs";
                return Err(server_error(io::ErrorKind::Unsupported, message));
            }
            status => return Err(status_error(status)),
        };
        let got = fill(&mut response.body_mut().as_reader(), &mut bytes[..expected])?;
        if got < expected {
            let message = format!("the connection ended after {got} of {expected} bytes");
            return Err(server_error(io::ErrorKind::ConnectionAborted, message));
        }
        Ok(got)
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
            Err(error) => return Err(error),
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
        self.length.get().copied().ok_or_else(other_range)
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        // Queued reads are made once; their owner retries.
        for attempt in 0..RetryPolicy::NETWORK.retries {
            match self.read_once(bytes, offset) {
                Err(error) if is_transient(&error) => {
                    std::thread::sleep(RetryPolicy::NETWORK.pause(attempt));
                }
                result => return result,
            }
        }
        self.read_once(bytes, offset)
    }
}

/// A `Content-Range` header: first and last byte (none where the request could not be met), and the file's length.
struct ContentRange {
    first_last: Option<(u64, u64)>,
    total: u64,
}

fn content_range(headers: &HeaderMap) -> Option<ContentRange> {
    let value = headers.get(header::CONTENT_RANGE)?.to_str().ok()?;
    let (range, total) = value.trim().strip_prefix("bytes ")?.split_once('/')?;
    let first_last = match range.trim() {
        "*" => None,
        range => {
            let (first, last) = range.split_once('-')?;
            Some((first.parse().ok()?, last.parse().ok()?))
        }
    };
    Some(ContentRange { first_last, total: total.trim().parse().ok()? })
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
    fn content_ranges_are_understood_or_refused() {
        let parsed = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::CONTENT_RANGE, value.parse().unwrap());
            content_range(&headers).map(|range| (range.first_last, range.total))
        };
        assert_eq!(parsed("bytes 0-8191/100000"), Some((Some((0, 8191)), 100_000)));
        assert_eq!(parsed("bytes */17"), Some((None, 17)));
        for wrong in ["bytes 0-1/*", "bytes 5/7", "items 0-1/2", "bytes a-b/c", ""] {
            assert_eq!(parsed(wrong), None, "{wrong}");
        }
    }
}
