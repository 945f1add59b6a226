//! What servers answer to range requests (RFC 9110, section 14), whoever sends these.

use std::io;

/// A server's answer that cannot be used.
pub(crate) fn server_error(kind: io::ErrorKind, message: impl Into<String>) -> io::Error {
    io::Error::new(kind, message.into())
}

fn other_range() -> io::Error {
    let message = "the server answered a range request with a range that was not asked for";
    server_error(io::ErrorKind::InvalidData, message)
}

/// A body that was shorter than its head said.
pub fn ended_early(got: usize, expected: usize) -> io::Error {
    let message = format!("the connection ended after {got} of {expected} bytes");
    server_error(io::ErrorKind::ConnectionAborted, message)
}

/// The error of a status that says no.
pub(crate) fn status_error(status: u16) -> io::Error {
    let kind = match status {
        401 | 403 => io::ErrorKind::PermissionDenied,
        // Too early, too many, or the server's own trouble: may pass.
        408 | 425 | 429 | 500..=599 => io::ErrorKind::Other,
        404 | 410 => io::ErrorKind::NotFound,
        _ => io::ErrorKind::Unsupported,
    };
    let name = match status {
        401 => " Unauthorized",
        403 => " Forbidden",
        404 => " Not Found",
        410 => " Gone",
        429 => " Too Many Requests",
        500 => " Internal Server Error",
        503 => " Service Unavailable",
        _ => "",
    };
    server_error(kind, format!("the server answered with status {status}{name}"))
}

/// The head of an answer to a request for a range.
#[derive(Clone, Copy, Debug)]
pub struct RangeAnswer<'a> {
    /// Status code.
    pub status: u16,
    /// The header `Content-Range`.
    pub content_range: Option<&'a str>,
    /// What tells versions of a file apart: the header `ETag`, or `Last-Modified` where there is none.
    pub version: Option<&'a str>,
}

/// What an answer that can be used brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answered {
    /// Bytes of the body: fewer than asked for where the file ends before, and where the server sends no more at once.
    pub length: usize,
    /// Bytes of the whole file, where the answer tells.
    pub total: Option<u64>,
}

impl RangeAnswer<'_> {
    /// What the answer brings to a request for `length` bytes from `offset` on, where earlier answers came from the version
    /// `known`.
    ///
    /// # Errors
    /// The server refused, sends whole files only, has another version of the file, or answered something else.
    pub fn check(&self, offset: u64, length: usize, known: Option<&str>) -> io::Result<Answered> {
        if self.is_of_other_version(known) {
            let message = "the file on the server has changed since it was opened; open it again";
            return Err(server_error(io::ErrorKind::Unsupported, message));
        }
        let range = self.content_range.and_then(parsed_range);
        match (self.status, range) {
            (206, Some(ContentRange { first_last: Some((first, last)), total }))
                if first == offset && last >= first =>
            {
                let count = (last - first).saturating_add(1).min(length as u64);
                Ok(Answered { length: count as usize, total })
            }
            (206, _) => Err(other_range()),
            // The range lies beyond the end.
            (416, range) => Ok(Answered { length: 0, total: range.and_then(|range| range.total) }),
            (200, _) => {
                let message = "the server sends only whole files: it does not support range requests, which streaming needs";
                Err(server_error(io::ErrorKind::Unsupported, message))
            }
            (status, _) => Err(status_error(status)),
        }
    }

    /// Whether it brings bytes of another version of the file than the one that is `known`.
    pub(crate) fn is_of_other_version(&self, known: Option<&str>) -> bool {
        match (known, self.version, self.status) {
            (Some(known), Some(found), 200..=299) => known != found,
            _ => false,
        }
    }
}

/// A `Content-Range` header: first and last byte (none where the request could not be met), and the file's length.
struct ContentRange {
    first_last: Option<(u64, u64)>,
    /// None where the server does not know it.
    total: Option<u64>,
}

fn parsed_range(value: &str) -> Option<ContentRange> {
    let (range, total) = value.trim().strip_prefix("bytes ")?.split_once('/')?;
    let first_last = match range.trim() {
        "*" => None,
        range => {
            let (first, last) = range.split_once('-')?;
            Some((first.parse().ok()?, last.parse().ok()?))
        }
    };
    let total = match total.trim() {
        "*" if first_last.is_some() => None,
        total => Some(total.parse().ok()?),
    };
    Some(ContentRange { first_last, total })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_ranges_are_understood_or_refused() {
        let parsed = |value: &str| parsed_range(value).map(|range| (range.first_last, range.total));
        assert_eq!(parsed("bytes 0-8191/100000"), Some((Some((0, 8191)), Some(100_000))));
        assert_eq!(parsed("bytes */17"), Some((None, Some(17))));
        assert_eq!(parsed("bytes 0-1/*"), Some((Some((0, 1)), None)));
        for wrong in ["bytes */*", "bytes 5/7", "items 0-1/2", "bytes a-b/c", ""] {
            assert_eq!(parsed(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn answers_are_taken_or_refused_with_their_reason() {
        let answer = |status, content_range, version| RangeAnswer { status, content_range, version };
        let check = |answer: RangeAnswer<'_>| answer.check(100, 50, Some("v1"));
        let ok = |length, total| Some(Answered { length, total });
        let part = |range| answer(206, Some(range), Some("v1"));
        assert_eq!(check(part("bytes 100-149/1000")).ok(), ok(50, Some(1000)));
        assert_eq!(check(part("bytes 100-119/120")).ok(), ok(20, Some(120)));
        assert_eq!(check(part("bytes 100-149/*")).ok(), ok(50, None));
        assert_eq!(check(answer(416, Some("bytes */90"), None)).ok(), ok(0, Some(90)));
        let all = format!("bytes 0-{}/{0}", u64::MAX);
        let whole = answer(206, Some(&all), None).check(0, 50, None);
        assert_eq!(whole.ok(), ok(50, Some(u64::MAX)));
        for (wrong, sentence) in [
            (part("bytes 0-49/1000"), "not asked for"),
            (answer(206, None, None), "not asked for"),
            (answer(206, Some("bytes 100-149/1000"), Some("v2")), "has changed"),
            (answer(200, None, Some("v2")), "has changed"),
            (answer(200, None, None), "only whole files"),
            (answer(404, None, Some("v2")), "404 Not Found"),
            (answer(503, None, None), "status 503"),
        ] {
            let said = check(wrong).unwrap_err().to_string();
            assert!(said.contains(sentence), "{said}");
        }
        // As pages see answers from elsewhere: without the range, with the date.
        let hidden = |version| answer(206, None, version).is_of_other_version(Some("v1"));
        assert!(hidden(Some("v2")) && !hidden(Some("v1")) && !hidden(None));
        assert!(!answer(206, None, Some("v2")).is_of_other_version(None));
        assert!(!answer(404, None, Some("v2")).is_of_other_version(Some("v1")));
    }
}
