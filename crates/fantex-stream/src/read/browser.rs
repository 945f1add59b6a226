//! Ranges of a file by the browser's `fetch`.

use std::cell::RefCell;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use js_sys::{Map, Promise, Reflect, Uint8Array};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{AbortSignal, Request, RequestCredentials, RequestInit, Response, Url, Window};

use super::fetched::in_pieces;
use super::{
    Answered, Fetched, FetchedFile, LaneReader, RangeAnswer, ReadRequest, ReaderInfo, ReaderKind,
    RetryPolicy, ended_early, is_transient, task_reader, too_long,
};

/// Lets the page, or the worker, run a task beside others.
pub fn spawn(task: impl Future<Output = ()> + 'static) {
    wasm_bindgen_futures::spawn_local(task);
}

/// Time for one request.
const MAX_REQUEST_MILLISECONDS: u32 = 60_000;

/// Bytes of one request: on slow connections, too, they come within its time.
const MAX_REQUEST_BYTES: u64 = 2_097_152;

/// Times that a piece of a range is asked for.
const MAX_ATTEMPTS: u32 = 3;

/// Requests at a time: what browsers allow one server by HTTP/1.1.
pub const BROWSER_CONNECTIONS: usize = 6;

/// What requests bring along so that a server grants them.
#[derive(Clone, Debug, Default)]
pub struct RemoteAccess {
    /// Headers: names and values.
    pub headers: Vec<[String; 2]>,
    /// Whether cookies and the like go to servers elsewhere, too.
    pub sends_credentials: bool,
}

/// A file at an address, of which one version is read.
#[derive(Debug)]
pub struct RemoteFile {
    url: String,
    access: RemoteAccess,
    version: RefCell<Option<String>>,
    /// See [`with_answers`](Self::with_answers).
    answers: Map,
}

impl RemoteFile {
    /// Nothing is fetched yet.
    pub fn new(url: String) -> Self {
        Self::with_answers(url, Map::new().into())
    }

    /// Some ranges are being fetched: `answers` is a `Map` of promises of `Response`s by "FIRST-LAST", the numbers of their bytes. Each is taken
    /// once. Of long ranges these are the first 2 MiB.
    pub fn with_answers(url: String, answers: JsValue) -> Self {
        let (access, version) = Default::default();
        Self { url, access, version, answers: answers.unchecked_into() }
    }

    /// The same file, with what its server asks for.
    pub fn with_access(self, access: RemoteAccess) -> Self {
        Self { access, ..self }
    }

    /// Its address.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// A reader with so many requests at a time, at least one.
    pub fn reader(self: &Rc<Self>, connections: usize) -> LaneReader {
        let info = ReaderInfo { kind: ReaderKind::Http, direct: false, depth: connections.max(1) };
        let file = Rc::clone(self);
        task_reader(info, wasm_bindgen_futures::spawn_local, move |request: ReadRequest| {
            let file = Rc::clone(&file);
            let range = request.offset..request.offset + request.length as u64;
            // Its owner asks again.
            async move { file.fetch_times(range, 1).await.map(|fetched| fetched.bytes) }
        })
    }

    /// Begins to open the asset that it is.
    ///
    /// # Errors
    /// As [`fetch`](Self::fetch).
    pub async fn start(
        self: Rc<Self>,
    ) -> fantex_base::Result<FetchedFile<impl AsyncFn(Range<u64>) -> io::Result<Fetched>>> {
        let location = self.url.clone();
        FetchedFile::start(&location, async move |range: Range<u64>| self.fetch(range).await).await
    }

    /// All of its bytes, where there are at most `most`.
    ///
    /// # Errors
    /// As [`fetch`](Self::fetch), or it is longer.
    pub async fn fetch_whole(&self, most: u64) -> fantex_base::Result<Vec<u8>> {
        let Fetched { bytes, total } =
            self.fetch(0..most).await.map_err(|error| fantex_base::Error::reading(&self.url, error))?;
        match total {
            Some(total) if total > most => Err(too_long(Path::new(&self.url), total, most)),
            _ => Ok(bytes),
        }
    }

    /// The bytes of a range, or those up to the file's end. Long ranges are asked for piece by piece, and pieces that break off again.
    ///
    /// # Errors
    /// No connection, no permission, no time left; the server refuses, has no ranges, or has another version of the file.
    pub async fn fetch(&self, range: Range<u64>) -> io::Result<Fetched> {
        self.fetch_times(range, MAX_ATTEMPTS).await
    }

    async fn fetch_times(&self, range: Range<u64>, attempts: u32) -> io::Result<Fetched> {
        in_pieces(range, MAX_REQUEST_BYTES, async |piece| self.fetch_piece(piece, attempts).await).await
    }

    async fn fetch_piece(&self, range: Range<u64>, attempts: u32) -> io::Result<Fetched> {
        for attempt in 1..attempts {
            match self.fetch_once(&range).await {
                // A server that does not answer at all has had its time.
                Err(error) if is_transient(&error) && error.kind() != io::ErrorKind::TimedOut => {
                    pause(RetryPolicy::NETWORK.pause(attempt - 1)).await;
                }
                result => return result,
            }
        }
        self.fetch_once(&range).await
    }

    /// What one request brings of a range.
    async fn fetch_once(&self, range: &Range<u64>) -> io::Result<Fetched> {
        let length = (range.end - range.start) as usize;
        let response = self.ask(range).await?;
        let header = |name| response.headers().get(name).ok().flatten();
        let version = header("etag").or_else(|| header("last-modified"));
        let content_range = header("content-range");
        let answer = RangeAnswer {
            status: response.status(),
            content_range: content_range.as_deref(),
            version: version.as_deref(),
        };
        let known = self.version.borrow().clone();
        let checked = answer.check(range.start, length, known.as_deref());
        // Servers elsewhere may keep that header from pages. They do not keep the date of the file.
        let is_hidden = response.status() == 206
            && content_range.is_none()
            && !answer.is_of_other_version(known.as_deref());
        let Answered { length: expected, total } = match checked {
            Err(_) if is_hidden => Answered { length, total: None },
            checked => checked?,
        };
        if self.version.borrow().is_none() {
            *self.version.borrow_mut() = version;
        }
        if expected == 0 {
            return Ok(Fetched { bytes: Vec::new(), total });
        }
        let body = JsFuture::from(response.array_buffer().map_err(|error| broken(&error))?).await;
        let mut bytes = Uint8Array::new(&body.map_err(|error| broken_off(&error))?).to_vec();
        bytes.truncate(length);
        if !is_hidden && bytes.len() < expected {
            return Err(ended_early(bytes.len(), expected));
        }
        Ok(Fetched { bytes, total })
    }

    async fn ask(&self, range: &Range<u64>) -> io::Result<Response> {
        let first_last = format!("{}-{}", range.start, range.end - 1);
        let key = JsValue::from_str(&first_last);
        let answer = self.answers.get(&key);
        if !answer.is_undefined() {
            self.answers.delete(&key);
            let answer: Promise = answer.unchecked_into();
            let response = JsFuture::from(answer).await.map_err(|error| self.refused(&error))?;
            return Ok(response.unchecked_into());
        }
        let options = RequestInit::new();
        options.set_signal(Some(&AbortSignal::timeout_with_u32(MAX_REQUEST_MILLISECONDS)));
        if self.access.sends_credentials {
            options.set_credentials(RequestCredentials::Include);
        }
        let request = Request::new_with_str_and_init(&self.url, &options).map_err(|error| broken(&error))?;
        for [name, value] in &self.access.headers {
            request.headers().set(name, value).map_err(|error| broken(&error))?;
        }
        let bytes = format!("bytes={first_last}");
        request.headers().set("range", &bytes).map_err(|error| broken(&error))?;
        // Workers have the same function, and no window.
        let window: Window = js_sys::global().unchecked_into();
        let response = JsFuture::from(window.fetch_with_request(&request))
            .await
            .map_err(|error| self.refused(&error))?;
        Ok(response.unchecked_into())
    }

    /// What `fetch` throws: no connection, no permission (CORS), no time left. It tells only the last from the others.
    fn refused(&self, error: &JsValue) -> io::Error {
        if is_timeout(error) {
            let seconds = MAX_REQUEST_MILLISECONDS / 1000;
            let text = format!("the server did not answer within {seconds} seconds");
            return io::Error::new(io::ErrorKind::TimedOut, text);
        }
        let text = match page_elsewhere(&self.url) {
            Some(page) => {
                format!("the server cannot be reached, or does not let pages of {page} read this file (CORS)")
            }
            None => String::from("the server cannot be reached"),
        };
        io::Error::new(io::ErrorKind::ConnectionAborted, text)
    }
}

/// The page's origin, where an address has another one.
fn page_elsewhere(url: &str) -> Option<String> {
    let location = Reflect::get(&js_sys::global(), &"location".into()).ok()?;
    let page = Reflect::get(&location, &"origin".into()).ok()?.as_string()?;
    let server = Url::new(url).ok()?.origin();
    (server != page).then_some(page)
}

fn is_timeout(error: &JsValue) -> bool {
    error.dyn_ref::<js_sys::Error>().is_some_and(|error| error.name() == "TimeoutError")
}

/// What is thrown on the way to a request.
fn broken(error: &JsValue) -> io::Error {
    io::Error::new(io::ErrorKind::ConnectionAborted, text_of(error))
}

/// What a body throws, some of which may have come.
fn broken_off(error: &JsValue) -> io::Error {
    let text = if is_timeout(error) {
        let seconds = MAX_REQUEST_MILLISECONDS / 1000;
        format!("the connection is too slow: a part of the file did not come within {seconds} seconds")
    } else {
        String::from("the connection broke off")
    };
    io::Error::new(io::ErrorKind::ConnectionAborted, text)
}

/// Lets time go by.
async fn pause(duration: Duration) {
    let promise = Promise::new(&mut |resolve, _| {
        // Workers have the same function, and no window.
        let window: Window = js_sys::global().unchecked_into();
        let milliseconds = duration.as_millis() as i32;
        // Where there are no timers there is no pause.
        if window.set_timeout_with_callback_and_timeout_and_arguments_0(&resolve, milliseconds).is_err() {
            resolve.call0(&JsValue::NULL).unwrap_or_default();
        }
    });
    JsFuture::from(promise).await.unwrap_or_default();
}

/// What a thrown value says.
fn text_of(error: &JsValue) -> String {
    match error.dyn_ref::<js_sys::Error>() {
        Some(error) => String::from(error.message()),
        None => format!("{error:?}"),
    }
}
