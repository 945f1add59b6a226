//! Objects that are written to stores: whole or not at all.
//!
//! A small file is one request. A larger one goes in parts, several under way, of which the store makes the object when it is told to; before
//! that nobody sees them. In stores that speak S3 (<https://docs.aws.amazon.com/AmazonS3/latest/userguide/mpuoverview.html>) an upload that fails
//! is aborted. Azure's (<https://learn.microsoft.com/rest/api/storageservices/put-block-list>) knows parts, its blocks, of a blob, not of an
//! upload: they are named after their upload, and the store drops them after a week. Parts are read from the file while they are sent, so that
//! memory does not grow with them.

use std::fs::File;
use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fantex_base::{Error, Result, files};
use rusty_s3::Method;
use ureq::http::{self, HeaderValue};
use ureq::{Body, SendBody};

use crate::read::RetryPolicy;
use crate::read::http::client_error;
use crate::read::object::{SignedRequest, Store, StoredObject};
use crate::read::ranges::server_error;

use self::lanes::{Lane, put_in_lanes};
use self::refusal::{LOST_PARTS, Refusal, refusal_of};

pub use self::assemble::{Assembled, SharedRun};

mod assemble;
mod lanes;
mod pieces;
mod refusal;

/// An object in a store, to be written or removed.
#[derive(Debug)]
pub struct ObjectTarget {
    location: PathBuf,
    object: StoredObject,
    agent: ureq::Agent,
}

/// What an object that is written may take the place of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Replace {
    /// Of none.
    Nothing,
    /// Of one with this [version](ObjectTarget::version).
    Version(String),
    /// Of any.
    Anything,
}

/// Bytes of a part, unless there would be too many; a file of no more is one request. Stores want at least 5 MiB.
const PART_BYTES: u64 = 8 << 20;

/// Stores take 10 000.
const MAX_PARTS: u64 = 9_000;

/// Parts under way at once.
const CONNECTIONS: usize = 4;

/// Uploads in parts that are begun anew after their stores have lost one to a conflict at its end.
const NEW_UPLOADS: u32 = 1;

/// Connections that are kept.
const MAX_CONNECTIONS: usize = CONNECTIONS + assemble::COPIES;

/// Requests are tried again for about 25 s.
const RETRIES: RetryPolicy = RetryPolicy::PATIENT;

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
struct Answer {
    tag: Option<String>,
    mark: Option<String>,
    length: Option<u64>,
    body: String,
}

/// A request. Query and headers are sorted by name; the headers are signed.
#[derive(Clone, Copy)]
struct Request<'a> {
    method: Method,
    query: &'a [(&'a str, &'a str)],
    headers: &'a [(&'a str, &'a str)],
}

/// What a request brings.
trait Content {
    /// The number of bytes, and the bytes from the first on; none for a request without a body.
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>>;

    /// Bytes that the store copies for the request.
    fn copied_bytes(&self) -> u64 {
        0
    }
}

struct NoBody;

impl Content for NoBody {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        Ok(None)
    }
}

/// A short body.
struct Text(io::Cursor<String>);

impl Text {
    fn new(text: String) -> Self {
        Self(io::Cursor::new(text))
    }
}

impl Content for Text {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        self.0.set_position(0);
        Ok(Some((self.0.get_ref().len() as u64, &mut self.0)))
    }
}

/// A run of a file's bytes.
struct Section<'a, R> {
    file: R,
    start: u64,
    length: u64,
    /// Bytes that are not sent yet.
    left: u64,
    upload: &'a Upload<'a>,
}

impl<R: Read + Seek> Content for Section<'_, R> {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        // What was sent in vain.
        self.upload.sent.fetch_sub(self.length - self.left, Relaxed);
        self.file.seek(SeekFrom::Start(self.start))?;
        self.left = self.length;
        Ok(Some((self.length, self)))
    }
}

impl<R: Read> Read for Section<'_, R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.upload.is_ended() {
            return Err(io::Error::other("the upload was ended"));
        }
        let most = bytes.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let count = self.file.read(&mut bytes[..most])?;
        if count == 0 && self.left > 0 {
            let message = "the file became shorter while it was sent";
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        self.left -= count as u64;
        self.upload.sent.fetch_add(count as u64, Relaxed);
        Ok(count)
    }
}

/// What the threads of an upload share.
struct Upload<'a> {
    path: &'a Path,
    length: u64,
    /// When the file was changed last, as far as the system tells.
    modified: Option<SystemTime>,
    sent: AtomicU64,
    /// Somebody wants no more, or a part has failed.
    stops: AtomicBool,
    /// There are parts in the store, or soon will be.
    has_parts: AtomicBool,
    watch: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
}

impl<'a> Upload<'a> {
    fn of(path: &'a Path, watch: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync)) -> Result<Self> {
        let found = path.metadata().map_err(|error| Error::reading(path, error))?;
        let (sent, stops, has_parts) = (AtomicU64::new(0), AtomicBool::new(false), AtomicBool::new(false));
        Ok(Self { path, length: found.len(), modified: found.modified().ok(), sent, stops, has_parts, watch })
    }

    /// Refuses a file that somebody has written to since the upload began: what was read of it may be of several states.
    fn check_unchanged(&self) -> io::Result<()> {
        let found = self.path.metadata()?;
        if (found.len(), found.modified().ok()) == (self.length, self.modified) {
            return Ok(());
        }
        let message = format!(
            "{} was changed while it was sent; send it again when it is finished",
            self.path.display()
        );
        Err(io::Error::new(io::ErrorKind::InvalidData, message))
    }

    /// Reports; whether somebody wants no more.
    fn is_cancelled(&self) -> bool {
        (self.watch)(self.sent.load(Relaxed), self.length).is_break()
    }

    /// Reports; whether to stop.
    fn is_ended(&self) -> bool {
        if self.is_cancelled() {
            self.stops.store(true, Relaxed);
        }
        self.stops.load(Relaxed)
    }

    fn section(&self, start: u64, length: u64) -> io::Result<Section<'_, File>> {
        let file = File::open(self.path)?;
        Ok(Section { file, start, length, left: length, upload: self })
    }

    /// All of a small file, as it is now.
    fn whole(&self) -> io::Result<Section<'_, io::Cursor<Vec<u8>>>> {
        let file = io::Cursor::new(std::fs::read(self.path)?);
        self.check_unchanged()?;
        Ok(Section { file, start: 0, length: self.length, left: self.length, upload: self })
    }
}

impl ObjectTarget {
    /// The object at `s3://BUCKET/KEY`, `gs://BUCKET/KEY` or `az://CONTAINER/BLOB`, with the keys and at the endpoint that the variables `AWS_...`
    /// or `AZURE_...` name. Sends nothing yet.
    ///
    /// # Errors
    /// The address names no object, or no store that is written to.
    pub fn at(location: &Path) -> Result<Self> {
        let refused = |why: String| Error::invalid(format!("cannot write {}: {why}", location.display()));
        let text = location.to_str().ok_or_else(|| refused("the address is not UTF-8".to_owned()))?;
        let object = StoredObject::at(text).map_err(|error| refused(error.to_string()))?;
        let object = object.ok_or_else(|| {
            refused(
                "only s3://, gs:// and az:// addresses are written to; give one of these, or a path"
                    .to_owned(),
            )
        })?;
        if object.key.ends_with('/') {
            return Err(refused("it names a folder; give the name of an object, too".to_owned()));
        }
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .accept_encoding("identity")
            .max_idle_connections(MAX_CONNECTIONS)
            .max_idle_connections_per_host(MAX_CONNECTIONS)
            .timeout_connect(Some(Duration::from_secs(10)))
            .max_redirects(0)
            .max_redirects_will_error(false)
            .build();
        Ok(Self { location: location.to_owned(), object, agent: config.new_agent() })
    }

    /// The address.
    pub fn location(&self) -> &Path {
        &self.location
    }

    /// What tells the object from others that were or will be there, such as a checksum; empty where the store does not tell. None where there is
    /// no object.
    ///
    /// # Errors
    /// The store does not answer, or does not say.
    pub fn version(&self) -> Result<Option<String>> {
        let found = self.head(None).map_err(|refusal| self.failed(refusal))?;
        Ok(found.map(|answer| answer.tag.unwrap_or_default()))
    }

    /// As [`version`](Self::version), and none where these keys may not look and [`Replace::Nothing`] tells: who may write need not be allowed to. Of
    /// what is not there Amazon's store says that to keys that may not list the bucket.
    ///
    /// # Errors
    /// The store does not answer, or does not say for another reason.
    pub fn visible_version(&self) -> Result<Option<String>> {
        match self.head(None) {
            Err(refusal) if refusal.status == 403 && self.object.has_conditional_writes() => Ok(None),
            Err(refusal) => Err(self.failed(refusal)),
            Ok(found) => Ok(found.map(|answer| answer.tag.unwrap_or_default())),
        }
    }

    /// Refuses, before any work is done, what could not be written at its end.
    ///
    /// # Errors
    /// The object is there, unless it may be replaced (`force`); the store does not answer, has no such bucket, or does not let these keys write.
    pub fn check(&self, force: bool) -> Result<()> {
        match self.head(None) {
            Ok(Some(_)) if !force => return Err(files::exists(&self.location)),
            // Who may write need not be allowed to look.
            Err(refusal) if refusal.status != 403 => return Err(self.failed(refusal)),
            _ => {}
        }
        self.try_to_write().map_err(|refusal| self.failed(refusal))
    }

    /// Makes a local file the object. `watch` is told often, from several threads, how many bytes of how many are sent, from none to all of them, and
    /// may end it.
    ///
    /// # Errors
    /// An object is there that may not be replaced ([`AlreadyExists`](fantex_base::ErrorKind::AlreadyExists), or
    /// [`Conflict`](fantex_base::ErrorKind::Conflict) where it has another version); the file cannot be read, or is written to meanwhile; the store refuses;
    /// it was ended. Then there is no new object.
    pub fn put(
        &self,
        path: &Path,
        replace: &Replace,
        watch: &(dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    ) -> Result<()> {
        let upload = Upload::of(path, watch)?;
        if upload.is_ended() {
            return Err(self.refused(replace, Refusal::cancelled()));
        }
        let mark = new_mark();
        let put = match upload.length {
            0..=PART_BYTES => self.put_at_once(&upload, replace, &mark),
            _ => self.put_in_parts(&upload, replace, &mark),
        };
        put.map_err(|refusal| self.refused(replace, refusal))?;
        // Only told: it is there.
        upload.sent.store(upload.length, Relaxed);
        upload.is_ended();
        Ok(())
    }

    /// Removes the object, if it is there.
    ///
    /// # Errors
    /// The store does not answer or refuses.
    pub fn remove(&self) -> Result<()> {
        let request = Request { method: Method::Delete, query: &[], headers: &[] };
        match self.ask(request, &mut NoBody) {
            Err(refusal) if refusal.status != 404 => Err(self.failed(refusal)),
            _ => Ok(()),
        }
    }

    /// Why the object was not written.
    fn refused(&self, replace: &Replace, refusal: Refusal) -> Error {
        match replace {
            _ if refusal.is_cancelled() => {
                Error::cancelled(format!("writing {} was ended", self.location.display()))
            }
            Replace::Nothing if refusal.is_conflict() => files::exists(&self.location),
            Replace::Version(_) if refusal.is_conflict() || refusal.has_no_object() => {
                let location = self.location.display();
                Error::conflict(format!(
                    "{location} was changed by somebody else meanwhile, and stays as it is; run the command again"
                ))
            }
            _ => self.failed(refusal),
        }
    }

    fn failed(&self, refusal: Refusal) -> Error {
        let is_momentary = refusal.is_momentary();
        let Refusal { status, code, error } = refusal;
        let advised = |advice: &str| server_error(error.kind(), format!("{error}; {advice}"));
        let advised = match (status, code.as_deref()) {
            _ if self.object.may_lack_rights(status) => advised(&self.object.advice("write")),
            // The bucket of another region.
            (300..=399, _) => advised("check AWS_REGION and AWS_ENDPOINT_URL"),
            _ if is_momentary => {
                advised("something else was done to it at the same time; run the command again")
            }
            (_, Some("NoSuchUpload")) => advised("the store has dropped the upload; run the command again"),
            (_, Some(LOST_PARTS)) => {
                advised("another upload to it has ended meanwhile; run the command again")
            }
            // Its blocks have names of another length.
            (_, Some("InvalidBlobOrBlock")) => {
                advised("another program has begun to write it, which counts until that ends, or for a week")
            }
            _ => return Error::writing(&self.location, error),
        };
        Error::writing(&self.location, advised)
    }

    /// The header of its own by which an upload knows its object again.
    fn mark_name(&self) -> &'static str {
        match self.object.store {
            Store::S3(_) => "x-amz-meta-fantex-upload",
            // A letter or `_`, then letters, digits and `_`.
            Store::Azure(_) => "x-ms-meta-fantexupload",
        }
    }

    /// Begins what does not become an object.
    fn try_to_write(&self) -> Result<(), Refusal> {
        let id = self.begin(&new_mark())?;
        match self.object.store {
            Store::S3(_) => self.abort(&id, RETRIES.retries),
            Store::Azure(_) => drop(self.put_part(&id, 1, &mut Text::new("0".to_owned()), None)?),
        }
        Ok(())
    }

    /// What the store says of the object; none where there is none.
    fn head(&self, upload: Option<&Upload<'_>>) -> Result<Option<Answer>, Refusal> {
        let request = Request { method: Method::Head, query: &[], headers: &[] };
        match self.ask_watched(request, &mut NoBody, upload) {
            Ok(answer) => Ok(Some(answer)),
            Err(refusal) if refusal.status == 404 => Ok(None),
            Err(refusal) => Err(refusal),
        }
    }

    fn put_at_once(&self, upload: &Upload<'_>, replace: &Replace, mark: &str) -> Result<(), Refusal> {
        let mut content = upload.whole()?;
        self.publish(upload, replace, mark, &mut |condition| {
            let kind = match self.object.store {
                Store::S3(_) => None,
                Store::Azure(_) => Some(("x-ms-blob-type", "BlockBlob")),
            };
            // Sorted: "if-..." comes before "x-...".
            let headers: Vec<_> =
                condition.into_iter().chain(kind).chain([(self.mark_name(), mark)]).collect();
            let request = Request { method: Method::Put, query: &[], headers: &headers };
            self.ask_watched(request, &mut content, Some(upload))
        })
    }

    fn put_in_parts(&self, upload: &Upload<'_>, replace: &Replace, mark: &str) -> Result<(), Refusal> {
        let first = self.begin(mark)?;
        self.make_of_parts(upload, replace, mark, first, &|id| -> Result<_, Refusal> {
            let tags = self.put_parts(upload, id)?;
            upload.check_unchanged()?;
            Ok(tags)
        })
    }

    /// Makes the object by an upload in parts that has begun as `first`; `put` sends all parts of an upload and gives their tags. Where the store has
    /// lost the upload to a conflict at its end, everything is sent once more, as Amazon's documentation asks for
    /// (<https://docs.aws.amazon.com/AmazonS3/latest/API/API_CompleteMultipartUpload.html>, `If-None-Match`).
    fn make_of_parts<E: From<Refusal>>(
        &self,
        upload: &Upload<'_>,
        replace: &Replace,
        mark: &str,
        first: String,
        put: &dyn Fn(&str) -> Result<Vec<String>, E>,
    ) -> Result<(), E> {
        upload.has_parts.store(true, Relaxed);
        let mut id = first;
        for attempt in 0.. {
            let made = put(&id).map(|tags| self.complete(upload, replace, mark, &id, &tags));
            if !matches!(made, Ok(Ok(()))) {
                // Who ends an upload does not wait for a network that is gone.
                self.abort(&id, if upload.is_cancelled() { 1 } else { RETRIES.retries });
            }
            match made? {
                Err(refusal) if attempt < NEW_UPLOADS && refusal.ends_upload() => {
                    upload.sent.store(0, Relaxed);
                    self.check_replaced(upload, replace)?;
                    id = self.begin(mark)?;
                }
                made => return made.map_err(E::from),
            }
        }
        Err(Refusal::cancelled().into())
    }

    /// Has the object made of the parts with these tags.
    fn complete(
        &self,
        upload: &Upload<'_>,
        replace: &Replace,
        mark: &str,
        id: &str,
        tags: &[String],
    ) -> Result<(), Refusal> {
        let (method, query, own, list) = match self.object.store {
            Store::S3(_) => (Method::Post, [("uploadId", id)], None, list_of_parts(tags)),
            // The blob's own headers come with the list.
            Store::Azure(_) => {
                let own = Some((self.mark_name(), mark));
                (Method::Put, [("comp", "blocklist")], own, list_of_blocks(tags))
            }
        };
        let mut content = Text::new(list);
        self.publish(upload, replace, mark, &mut |condition| {
            let headers: Vec<_> = condition.into_iter().chain(own).collect();
            let request = Request { method, query: &query, headers: &headers };
            self.ask_watched(request, &mut content, Some(upload))
        })
    }

    /// Begins an upload in parts; gives its name.
    fn begin(&self, mark: &str) -> Result<String, Refusal> {
        if let Store::Azure(_) = self.object.store {
            return Ok(mark.to_owned());
        }
        let headers = [(self.mark_name(), mark)];
        let request = Request { method: Method::Post, query: &[("uploads", "1")], headers: &headers };
        let answer = self.ask(request, &mut Text::new(String::new()))?;
        element(&answer.body, "UploadId").ok_or_else(|| {
            let message = "the store answered something else than the name of an upload";
            server_error(io::ErrorKind::InvalidData, message).into()
        })
    }

    /// Drops the parts of an upload, as far as the store does that; tries again so often. What it keeps nobody sees.
    fn abort(&self, id: &str, retries: u32) {
        if let Store::Azure(_) = self.object.store {
            return;
        }
        let query = [("uploadId", id)];
        let request = Request { method: Method::Delete, query: &query, headers: &[] };
        for attempt in 0..=retries {
            match self.ask_once(request, &mut NoBody) {
                Err(refusal) if attempt < retries && refusal.may_succeed_later() => {
                    std::thread::sleep(RETRIES.pause(attempt));
                }
                _ => return,
            }
        }
    }

    /// Sends all parts; gives what names them in the list of parts, in order.
    fn put_parts(&self, upload: &Upload<'_>, id: &str) -> Result<Vec<String>, Refusal> {
        let part_bytes = part_bytes(upload.length);
        let count = upload.length.div_ceil(part_bytes) as usize;
        let lane = Lane { numbers: (0..count).collect(), at_once: CONNECTIONS };
        put_in_lanes::<Refusal>(upload, count, &[lane], &|number| {
            let start = number as u64 * part_bytes;
            let mut part = upload.section(start, part_bytes.min(upload.length - start))?;
            self.put_part(id, number + 1, &mut part, Some(upload))
        })
    }

    /// Sends a part, counted from 1; gives what names it in the list of parts: its tag, or the name of the block.
    fn put_part(
        &self,
        id: &str,
        number: usize,
        content: &mut dyn Content,
        upload: Option<&Upload<'_>>,
    ) -> Result<String, Refusal> {
        let (number, block) = (number.to_string(), name_of_block(id, number));
        let (query, has_tag) = match self.object.store {
            Store::S3(_) => ([("partNumber", number.as_str()), ("uploadId", id)], true),
            Store::Azure(_) => ([("blockid", block.as_str()), ("comp", "block")], false),
        };
        let request = Request { method: Method::Put, query: &query, headers: &[] };
        let answer = self.ask_watched(request, content, upload)?;
        let name = if has_tag { answer.tag } else { Some(block) };
        name.ok_or_else(|| {
            server_error(io::ErrorKind::InvalidData, "the store took a part and gave no tag for it").into()
        })
    }

    /// Sends the request that makes the object, on the condition that is to hold.
    fn publish<'a>(
        &self,
        upload: &Upload<'_>,
        replace: &'a Replace,
        mark: &'a str,
        send: &mut dyn FnMut(Option<(&'a str, &'a str)>) -> Result<Answer, Refusal>,
    ) -> Result<(), Refusal> {
        let condition = match replace {
            Replace::Nothing => Some(("if-none-match", "*")),
            Replace::Version(version) if !version.is_empty() => Some(("if-match", version.as_str())),
            Replace::Version(_) | Replace::Anything => None,
        };
        let condition = condition.filter(|_| self.object.has_conditional_writes());
        // Not all stores look at the condition.
        self.check_replaced(upload, replace)?;
        let mut done = send(condition);
        if condition.is_some() && done.as_ref().is_err_and(|refusal| refusal.status == 501) {
            self.check_replaced(upload, replace)?;
            done = send(None);
        }
        match done {
            Ok(_) => Ok(()),
            // The answer to an earlier attempt may have been lost.
            Err(_) if matches!(self.head(None), Ok(Some(there)) if there.mark.as_deref() == Some(mark)) => {
                Ok(())
            }
            // Somebody else was faster.
            Err(refusal) if refusal.has_lost_parts() || refusal.is_momentary() => {
                self.check_replaced(upload, replace).and(Err(refusal))
            }
            Err(refusal) => Err(refusal),
        }
    }

    /// Looks whether what would be replaced may be.
    fn check_replaced(&self, upload: &Upload<'_>, replace: &Replace) -> Result<(), Refusal> {
        if *replace == Replace::Anything {
            return Ok(());
        }
        let may_be_replaced = match (replace, self.head(Some(upload))) {
            (Replace::Version(version), Ok(Some(there))) => {
                version.is_empty() || there.tag.as_ref() == Some(version)
            }
            (_, Ok(there)) => *replace == Replace::Nothing && there.is_none(),
            // Who may write need not be allowed to look.
            (_, Err(refusal)) if refusal.status == 403 => true,
            (_, Err(refusal)) => return Err(refusal),
        };
        if may_be_replaced { Ok(()) } else { Err(refusal_of(412, None)) }
    }

    fn ask(&self, request: Request<'_>, content: &mut dyn Content) -> Result<Answer, Refusal> {
        self.ask_watched(request, content, None)
    }

    /// Sends a request, again where that may help, unless the upload is ended.
    fn ask_watched(
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

    fn ask_once(&self, request: Request<'_>, content: &mut dyn Content) -> Result<Answer, Refusal> {
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
fn pause(time: Duration, is_ended: impl Fn() -> bool) {
    let started = Instant::now();
    while let Some(left) = time.checked_sub(started.elapsed()).filter(|left| !left.is_zero()) {
        if is_ended() {
            return;
        }
        std::thread::sleep(left.min(CANCEL_POLL_INTERVAL));
    }
}

/// What no other upload is marked with.
fn new_mark() -> String {
    format!("{:016x}", RandomState::new().build_hasher().finish())
}

/// The name of an upload's block: Base64 of at most 64 bytes, as long as the names of all others.
fn name_of_block(id: &str, number: usize) -> String {
    STANDARD.encode(format!("{id}{number:05}"))
}

/// Bytes of each part but the last, whole mebibytes.
fn part_bytes(length: u64) -> u64 {
    length.div_ceil(MAX_PARTS).next_multiple_of(1 << 20).max(PART_BYTES)
}

/// The text of the first element of a name in a short XML document.
fn element(document: &str, name: &str) -> Option<String> {
    let (_, rest) = document.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once(&format!("</{name}>"))?;
    let text = text.trim().replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">");
    Some(text.replace("&amp;", "&"))
}

/// The parts that become an object, by their tags.
fn list_of_parts(tags: &[String]) -> String {
    let escaped = |tag: &String| tag.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let part = |(number, tag): (usize, &String)| {
        format!("<Part><PartNumber>{}</PartNumber><ETag>{}</ETag></Part>", number + 1, escaped(tag))
    };
    let parts: String = tags.iter().enumerate().map(part).collect();
    format!("<CompleteMultipartUpload>{parts}</CompleteMultipartUpload>")
}

/// The blocks that become a blob.
fn list_of_blocks(names: &[String]) -> String {
    let blocks: String = names.iter().map(|name| format!("<Latest>{name}</Latest>")).collect();
    format!("<?xml version=\"1.0\" encoding=\"utf-8\"?><BlockList>{blocks}</BlockList>")
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn parts_are_few_enough_and_large_enough() {
        for length in [PART_BYTES + 1, 50 << 30, 5 << 40] {
            let part = part_bytes(length);
            assert!(length.div_ceil(part) <= 10_000, "{length}");
            assert!((5 << 20..=5 << 30).contains(&part), "{length}");
        }
        assert_eq!(part_bytes(1 << 30), PART_BYTES);
    }

    #[test]
    fn answers_are_understood() {
        let begun = "<?xml version=\"1.0\"?>\n<InitiateMultipartUploadResult xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\">\
                     <Bucket>b</Bucket><UploadId> a&amp;b </UploadId></InitiateMultipartUploadResult>";
        assert_eq!(element(begun, "UploadId").as_deref(), Some("a&b"));
        assert_eq!(element(begun, "Code"), None);
        assert_eq!(element("<UploadId>a", "UploadId"), None);
        let list = list_of_parts(&["\"1\"".to_owned(), "<&>".to_owned()]);
        assert!(list.contains("<PartNumber>1</PartNumber><ETag>\"1\"</ETag>"), "{list}");
        assert!(list.contains("<PartNumber>2</PartNumber><ETag>&lt;&amp;&gt;</ETag>"), "{list}");
        let names = [1, 9_000].map(|number| name_of_block("0123456789abcdef", number));
        assert_eq!(names, ["MDEyMzQ1Njc4OWFiY2RlZjAwMDAx", "MDEyMzQ1Njc4OWFiY2RlZjA5MDAw"]);
        let list = list_of_blocks(&names);
        let blocks =
            "<Latest>MDEyMzQ1Njc4OWFiY2RlZjAwMDAx</Latest><Latest>MDEyMzQ1Njc4OWFiY2RlZjA5MDAw</Latest>";
        assert!(list.ends_with(&format!("<BlockList>{blocks}</BlockList>")), "{list}");
    }

    #[test]
    fn a_file_that_is_written_to_is_not_sent() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        std::fs::write(&path, "first").unwrap();
        let watch = |_: u64, _: u64| ControlFlow::Continue(());
        let upload = Upload::of(&path, &watch).unwrap();
        let mut read = String::new();
        upload.whole().unwrap().read_to_string(&mut read).unwrap();
        assert_eq!(read, "first");
        upload.check_unchanged().unwrap();
        std::fs::write(&path, "longer").unwrap();
        let said = upload.whole().err().unwrap().to_string();
        assert!(said.contains("a.fan was changed while it was sent"), "{said}");
        // Of the same length.
        std::fs::write(&path, "other").unwrap();
        let later = SystemTime::now() + Duration::from_secs(2);
        File::options().write(true).open(&path).unwrap().set_modified(later).unwrap();
        upload.check_unchanged().unwrap_err();
    }

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

    #[test]
    fn addresses_that_nothing_is_written_to_are_refused() {
        for (place, words) in [
            ("https://a.org/b.fan", "only s3://, gs:// and az://"),
            ("abfs://bucket/b.fan", "only s3://, gs:// and az://"),
            ("s3://bucket", "BUCKET/KEY"),
            ("az://container", "CONTAINER/BLOB"),
            ("s3://bucket/folder/", "names a folder"),
        ] {
            let error = ObjectTarget::at(Path::new(place)).unwrap_err();
            assert_eq!(error.kind(), fantex_base::ErrorKind::InvalidArgument);
            let sentence = error.to_string();
            assert!(sentence.contains(words) && sentence.contains(place), "{sentence}");
        }
    }
}
