//! Requests to a store, which are made again where that may help.

use std::io::{self, Read};
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use rusty_s3::Method;
use ureq::http::{self, HeaderValue};
use ureq::{Body, SendBody};

use super::ObjectTarget;
use super::refusal::{Refusal, refusal_of};
use super::sent_file::Upload;
use crate::read::RetryPolicy;
use crate::read::http::client_error;
use crate::read::object::SignedRequest;

/// Requests are tried again for about 25 s.
pub(super) const RETRIES: RetryPolicy = RetryPolicy::PATIENT;

/// Where an upload has begun, so that what is sent would be lost, those without an answer are tried again for so long: a network may be gone.
const MAX_OUTAGE: Duration = Duration::from_secs(3600);

/// Between two attempts.
const MAX_PAUSE: Duration = Duration::from_secs(30);

/// How often a pause looks whether the upload has ended.
const CANCEL_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Time for a request, beside what its bytes take at [`MIN_BYTES_PER_SECOND`]. Large objects are put together within it.
const REQUEST_TIME: Duration = Duration::from_secs(180);

const MIN_BYTES_PER_SECOND: u64 = 70_000;

/// Largest answer that is read: one says why a request failed.
const MAX_ANSWER_BYTES: u64 = 1 << 20;

/// What a store said.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) tag: Option<String>,
    pub(super) mark: Option<String>,
    pub(super) length: Option<u64>,
    pub(super) body: String,
}

/// A request. Query and headers are sorted by name; the headers are signed.
#[derive(Clone, Copy)]
pub(super) struct Request<'a> {
    pub(super) method: Method,
    pub(super) query: &'a [(&'a str, &'a str)],
    pub(super) headers: &'a [(&'a str, &'a str)],
}

/// What a request brings.
pub(super) trait Content {
    /// The number of bytes, and the bytes from the first on; none for a request without a body.
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>>;

    /// Bytes that the store copies for the request.
    fn copied_bytes(&self) -> u64 {
        0
    }
}

pub(super) struct NoBody;

impl Content for NoBody {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        Ok(None)
    }
}

/// A short body.
pub(super) struct Text(io::Cursor<String>);

impl Text {
    pub(super) fn new(text: String) -> Self {
        Self(io::Cursor::new(text))
    }
}

impl Content for Text {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        self.0.set_position(0);
        Ok(Some((self.0.get_ref().len() as u64, &mut self.0)))
    }
}

impl ObjectTarget {
    pub(super) fn ask(&self, request: Request<'_>, content: &mut dyn Content) -> Result<Answer, Refusal> {
        self.ask_watched(request, content, None)
    }

    /// Sends a request, again where that may help, unless the upload is ended.
    pub(super) fn ask_watched(
        &self,
        request: Request<'_>,
        content: &mut dyn Content,
        upload: Option<&Upload<'_>>,
    ) -> Result<Answer, Refusal> {
        let is_ended = || upload.is_some_and(Upload::is_ended);
        let has_parts = upload.is_some_and(|upload| upload.has_parts.load(Relaxed));
        let started = Instant::now();
        for attempt in 0.. {
            if is_ended() {
                return Err(Refusal::cancelled());
            }
            match self.ask_once(request, content) {
                Err(_) if is_ended() => return Err(Refusal::cancelled()),
                Err(refusal) => match pause_after(&refusal, attempt, started.elapsed(), has_parts) {
                    Some(time) => pause(time, is_ended),
                    None => return Err(refusal),
                },
                answer => return answer,
            }
        }
        Err(Refusal::cancelled())
    }

    pub(super) fn ask_once(
        &self,
        request: Request<'_>,
        content: &mut dyn Content,
    ) -> Result<Answer, Refusal> {
        let Request { method, query, headers } = request;
        let copied = content.copied_bytes();
        let body = content.begin()?;
        let length = body.as_ref().map_or(0, |(length, _)| *length);
        let SignedRequest { url, headers: own } = self.object.signed(method, query, headers, length);
        let mut builder = http::Request::builder().method(method.to_str()).uri(url);
        for (name, value) in headers {
            builder = builder.header(*name, *value);
        }
        for (name, value) in &own {
            builder = builder.header(*name, value.as_str());
        }
        let mut response = match body {
            Some((length, bytes)) => {
                let builder = builder.header(http::header::CONTENT_LENGTH, length);
                self.run(builder.body(SendBody::from_reader(bytes)), length + copied)?
            }
            None => self.run(builder.body(SendBody::none()), copied)?,
        };
        let text = |name: &str| {
            let value: Option<&HeaderValue> = response.headers().get(name);
            value.and_then(|value| value.to_str().ok()).map(str::to_owned)
        };
        let (tag, mark, status) = (text("etag"), text(self.mark_name()), response.status().as_u16());
        let length = text("content-length").and_then(|length| length.parse().ok());
        // Azure's; there without a body, too.
        let code = text("x-ms-error-code");
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES).lossy_utf8(true);
        let body = body.read_to_string().map_err(client_error)?;
        // Stores that begin to answer before they are done say in the body that they failed.
        let code = code.or_else(|| element(&body, "Code").filter(|_| body.contains("<Error>")));
        match (status, code) {
            (200..=299, None) => Ok(Answer { tag, mark, length, body }),
            (200..=299, Some(code)) => Err(refusal_of(500, Some(&code))),
            (status, code) => Err(refusal_of(status, code.as_deref())),
        }
    }

    /// Sends a request for which so many bytes are sent or copied.
    fn run(
        &self,
        request: Result<http::Request<SendBody<'_>>, http::Error>,
        length: u64,
    ) -> io::Result<http::Response<Body>> {
        let request = request.map_err(|error| client_error(error.into()))?;
        let time = REQUEST_TIME + Duration::from_secs(length / MIN_BYTES_PER_SECOND);
        let request = self.agent.configure_request(request).timeout_global(Some(time)).build();
        self.agent.run(request).map_err(client_error)
    }
}

/// How long to wait before another attempt, the first of which was made `since` then; none where there is to be none. `has_parts`: of an upload that has
/// begun.
fn pause_after(refusal: &Refusal, attempt: u32, since: Duration, has_parts: bool) -> Option<Duration> {
    let is_outage = has_parts && refusal.status == 0 && since < MAX_OUTAGE;
    let is_worth = refusal.may_succeed_later() && (is_outage || attempt < RETRIES.retries);
    is_worth.then(|| RETRIES.pause(attempt).min(MAX_PAUSE))
}

/// Waits for a time, or until `is_ended`.
pub(super) fn pause(time: Duration, is_ended: impl Fn() -> bool) {
    let started = Instant::now();
    while let Some(left) = time.checked_sub(started.elapsed()).filter(|left| !left.is_zero()) {
        if is_ended() {
            return;
        }
        std::thread::sleep(left.min(CANCEL_POLL_INTERVAL));
    }
}

/// The text of the first element of a name in a short XML document.
pub(super) fn element(document: &str, name: &str) -> Option<String> {
    let (_, rest) = document.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once(&format!("</{name}>"))?;
    let text = text.trim().replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">");
    Some(text.replace("&amp;", "&"))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn an_upload_that_has_begun_outlasts_a_network_that_is_gone() {
        let gone = || Refusal::from(io::Error::from(io::ErrorKind::ConnectionRefused));
        let minutes = |count: u64| Duration::from_secs(60 * count);
        for (refusal, attempt, since, has_parts, wanted) in [
            (gone(), 0, minutes(0), true, Some(RETRIES.first_pause)),
            (gone(), RETRIES.retries, minutes(1), true, Some(Duration::from_millis(25_600))),
            (gone(), 90, minutes(40), true, Some(MAX_PAUSE)),
            (gone(), 130, minutes(61), true, None),
            (gone(), RETRIES.retries, minutes(1), false, None),
            (
                refusal_of(503, None),
                RETRIES.retries - 1,
                minutes(0),
                true,
                Some(Duration::from_millis(12_800)),
            ),
            (refusal_of(503, None), RETRIES.retries, minutes(0), true, None),
            (refusal_of(403, None), 0, minutes(0), true, None),
            (Refusal::cancelled(), 0, minutes(0), true, None),
        ] {
            assert_eq!(pause_after(&refusal, attempt, since, has_parts), wanted, "{refusal:?} {attempt}");
        }
    }

    #[test]
    fn pauses_end_with_the_upload() {
        let asked = AtomicUsize::new(0);
        let started = Instant::now();
        pause(Duration::from_secs(3600), || asked.fetch_add(1, Relaxed) == 1);
        assert!(started.elapsed() < Duration::from_secs(60));
        pause(Duration::from_millis(1), || false);
        pause(Duration::ZERO, || panic!("there is no pause"));
    }
}
