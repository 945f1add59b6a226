//! Objects that their store puts together of others: it copies long runs of bytes by itself, and the rest is sent to it.
//!
//! A piece of an upload may be a range of an object in the same store (`UploadPartCopy`,
//! <https://docs.aws.amazon.com/AmazonS3/latest/API/API_UploadPartCopy.html>). Which pieces are is decided by [`pieces`]. What is copied is
//! what was read before: each request names the object's tag (`x-amz-copy-source-if-match`), and the store refuses where it is another.
//!
//! Not all stores do it, and some take only pieces of one length. Where one refuses, nothing is there yet, and all bytes may still be sent.

use std::fs::OpenOptions;
use std::io::{self, Read};
use std::ops::{ControlFlow, Range};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use fantex_base::{Error, Result};
use fantex_store::{ByteSource as _, write_all_at};
use rusty_s3::Method;

use super::lanes::{Lane, put_in_lanes};
use super::parts::CONNECTIONS;
use super::pieces::{Piece, pieces};
use super::refusal::Refusal;
use super::request::{Content, RETRIES, Request, element, pause};
use super::sent_file::Upload;
use super::{ObjectTarget, Replace, new_mark};
use crate::read::{HttpSource, is_transient};

/// Pieces that the store copies at once. Each takes seconds, and none of this machine's time.
pub(super) const COPIES: usize = 32;

/// Bytes of a run that are fetched at once.
const FETCHED_AT_ONCE: u64 = 4 << 20;

/// A run of bytes that an object has from another one.
#[derive(Clone, Debug)]
pub struct SharedRun {
    /// The other object, of which something has been read: what it was then is what is copied.
    pub source: Arc<HttpSource>,
    /// Where the run starts there.
    pub offset: u64,
    /// Where it lies in the object that is made.
    pub range: Range<u64>,
}

/// What came of an object that the store was to put together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Assembled {
    /// It is there. So many of its bytes the store has copied.
    Done(u64),
    /// It is not there, as the store would copy nothing: for this reason, or, without one, because nothing is long enough.
    NotCopied(Option<String>),
}

/// Why there is no object.
enum Failure {
    Refused(Refusal),
    /// What is copied from cannot be read, or has changed.
    Source(Error),
    /// The store does not copy.
    NotCopied(String),
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Source(error)
    }
}

/// The body of a request to copy: it is empty.
struct CopyBody {
    empty: io::Empty,
    copied_bytes: u64,
}

impl Content for CopyBody {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        Ok(Some((0, &mut self.empty)))
    }

    fn copied_bytes(&self) -> u64 {
        self.copied_bytes
    }
}

/// What the threads of an assembly share.
struct Assembly<'a> {
    upload: &'a Upload<'a>,
    id: &'a str,
    pieces: &'a [Piece],
    runs: &'a [SharedRun],
}

impl ObjectTarget {
    /// What lies at an address, if the store of this object copies ranges of it: where both are in one store that does so.
    pub fn source_to_copy(&self, location: &Path) -> Option<Arc<HttpSource>> {
        let source = HttpSource::new(location.to_str()?, CONNECTIONS);
        // All objects of such a store are at one endpoint, with one key.
        (self.object.copy_source().is_some() && source.copy_source().is_some()).then(|| Arc::new(source))
    }

    /// Makes a local file the object, as [`put`](Self::put) does, but for `runs`, which the store copies: by ascending range, from
    /// [`source_to_copy`](Self::source_to_copy). Where something of them has to be sent it is fetched into the file.
    ///
    /// # Errors
    /// As [`put`](Self::put); or a source cannot be read, or has changed since it was read first.
    pub fn assemble(
        &self,
        path: &Path,
        runs: &[SharedRun],
        replace: &Replace,
        watch: &(dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    ) -> Result<Assembled> {
        let upload = Upload::of(path, watch)?;
        let length = upload.length;
        let ranges: Vec<_> = runs.iter().map(|run| run.range.clone()).collect();
        let pieces = pieces(length, &ranges);
        let copied: u64 = pieces.iter().filter(|piece| piece.run.is_some()).map(Piece::length).sum();
        if copied == 0 {
            return Ok(Assembled::NotCopied(None));
        }
        let mark = new_mark();
        let id = self.begin(&mark).map_err(|refusal| self.refused(replace, refusal))?;
        let made = self.make_of_parts(&upload, replace, &mark, id, &|id| {
            self.put_pieces(&Assembly { upload: &upload, id, pieces: &pieces, runs })
        });
        match made.and_then(|()| self.check_made(&mark, length)) {
            Ok(()) => Ok(Assembled::Done(copied)),
            Err(Failure::NotCopied(why)) => Ok(Assembled::NotCopied(Some(why))),
            Err(Failure::Refused(refusal)) if may_be_due_to_copying(&refusal) => {
                Ok(Assembled::NotCopied(Some(refusal.error.to_string())))
            }
            Err(Failure::Refused(refusal)) => Err(self.refused(replace, refusal)),
            Err(Failure::Source(error)) => Err(error),
        }
    }

    /// Puts all pieces there; gives their tags, in order.
    fn put_pieces(&self, assembly: &Assembly<'_>) -> Result<Vec<String>, Failure> {
        let Assembly { upload, pieces, .. } = *assembly;
        let (copied, sent): (Vec<usize>, Vec<usize>) =
            (0..pieces.len()).partition(|&number| pieces[number].run.is_some());
        let lanes = [Lane { numbers: copied, at_once: COPIES }, Lane { numbers: sent, at_once: CONNECTIONS }];
        put_in_lanes::<Failure>(upload, pieces.len(), &lanes, &|number| self.put_piece(assembly, number))
    }

    /// Puts a piece there, counted from 0; gives its tag.
    fn put_piece(&self, assembly: &Assembly<'_>, number: usize) -> Result<String, Failure> {
        let Assembly { upload, id, pieces, runs } = *assembly;
        let piece = &pieces[number];
        if let Some(run) = piece.run {
            return self.copy_piece(assembly, number, &runs[run]);
        }
        fetch(upload, &piece.range, runs)?;
        let mut section = upload.section(piece.range.start, piece.length()).map_err(Refusal::from)?;
        Ok(self.put_part(id, number + 1, &mut section, Some(upload))?)
    }

    /// Has a piece copied from a run.
    fn copy_piece(&self, assembly: &Assembly<'_>, number: usize, run: &SharedRun) -> Result<String, Failure> {
        let Assembly { upload, id, pieces, .. } = *assembly;
        let piece = &pieces[number];
        let (source, version) = (run.source.copy_source(), run.source.tag());
        let (Some(source), Some(version)) = (source, version) else {
            let location = run.source.location().display();
            return Err(Failure::NotCopied(format!("it gives {location} no tag")));
        };
        let first = run.offset + (piece.range.start - run.range.start);
        let (number, range) =
            ((number + 1).to_string(), format!("bytes={first}-{}", first + piece.length() - 1));
        let query = [("partNumber", number.as_str()), ("uploadId", id)];
        let headers = [
            ("x-amz-copy-source", source.as_str()),
            ("x-amz-copy-source-if-match", version),
            ("x-amz-copy-source-range", range.as_str()),
        ];
        let request = Request { method: Method::Put, query: &query, headers: &headers };
        let mut body = CopyBody { empty: io::empty(), copied_bytes: piece.length() };
        let asked = self.ask_watched(request, &mut body, Some(upload));
        let answer = asked.map_err(|refusal| match refusal.status {
            412 => Failure::Source(changed(run.source.location())),
            _ => refusal.into(),
        })?;
        // A store that does not know the headers takes the request for a piece of no bytes, and answers without a document.
        let tag = element(&answer.body, "ETag");
        let tag = tag.ok_or_else(|| Failure::NotCopied("it takes the request for another".to_owned()))?;
        upload.sent.fetch_add(piece.length(), Relaxed);
        Ok(tag)
    }

    /// Checks the object's length, as a store may ignore ranges; an object of another length is removed.
    fn check_made(&self, mark: &str, length: u64) -> Result<(), Failure> {
        // Who may write need not be allowed to look.
        let Ok(Some(made)) = self.head(None) else { return Ok(()) };
        if made.mark.as_deref() != Some(mark) || made.length.is_none_or(|made| made == length) {
            return Ok(());
        }
        self.remove()?;
        Err(Failure::NotCopied("it copies other ranges than it is asked for".to_owned()))
    }
}

/// Whether this may be because pieces are copied, so that sending all bytes may help.
fn may_be_due_to_copying(refusal: &Refusal) -> bool {
    let is_refused = (400..500).contains(&refusal.status) && !is_transient(&refusal.error);
    refusal.status == 501 || is_refused && !refusal.is_conflict() && !refusal.is_momentary()
}

fn changed(location: &Path) -> Error {
    let sentence = format!(
        "{} was changed by somebody else while it was merged, and nothing was written; run the command again",
        location.display()
    );
    Error::conflict(sentence).with_path(location)
}

/// Fetches into the file what a range of it has of runs.
fn fetch(upload: &Upload<'_>, range: &Range<u64>, runs: &[SharedRun]) -> Result<(), Failure> {
    let first = runs.partition_point(|run| run.range.end <= range.start);
    for run in runs[first..].iter().take_while(|run| run.range.start < range.end) {
        let writing = |error| Error::writing(upload.path, error);
        let file = OpenOptions::new().write(true).open(upload.path).map_err(writing)?;
        let end = run.range.end.min(range.end);
        let mut at = run.range.start.max(range.start);
        while at < end {
            let mut bytes = vec![0; (end - at).min(FETCHED_AT_ONCE) as usize];
            read(upload, run, at, &mut bytes)?;
            write_all_at(&file, &bytes, at).map_err(writing)?;
            at += bytes.len() as u64;
        }
    }
    Ok(())
}

/// Reads bytes of a run that lie at `at` in the object, again where that may help, as long as what is sent would be.
fn read(upload: &Upload<'_>, run: &SharedRun, at: u64, bytes: &mut [u8]) -> Result<(), Failure> {
    let offset = run.offset + (at - run.range.start);
    let read = RETRIES.run(
        || match upload.is_ended() {
            true => Err(io::ErrorKind::Interrupted.into()),
            false => run.source.read_exact_at(bytes, offset),
        },
        |error| is_transient(error) && !upload.is_ended(),
        |time| pause(time, || upload.is_ended()),
    );
    match read {
        Ok(()) => Ok(()),
        Err(_) if upload.is_ended() => Err(Refusal::cancelled().into()),
        Err(error) => Err(Error::reading(run.source.location(), error).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::refusal::refusal_of;
    use super::*;

    #[test]
    fn what_stores_refuse_that_do_not_copy_is_told_from_what_nothing_helps() {
        for (status, code, is_refused) in [
            (501, "NotImplemented", true),
            (400, "InvalidPart", true),
            (400, "InvalidArgument", true),
            (403, "AccessDenied", true),
            (405, "MethodNotAllowed", true),
            (400, "RequestTimeout", false),
            (409, "ConditionalRequestConflict", false),
            (412, "PreconditionFailed", false),
            (429, "SlowDown", false),
            (500, "InternalError", false),
            (503, "SlowDown", false),
        ] {
            assert_eq!(may_be_due_to_copying(&refusal_of(status, Some(code))), is_refused, "{status} {code}");
        }
        assert!(!may_be_due_to_copying(&Refusal::cancelled()));
    }

    #[test]
    fn ranges_are_copied_within_a_store_that_copies() {
        let target = ObjectTarget::at(Path::new("s3://a/b.fan")).unwrap();
        assert!(target.source_to_copy(Path::new("s3://c/d.part")).is_some());
        for elsewhere in ["gs://a/d.part", "https://a.org/d.part", "/a/d.part"] {
            assert!(target.source_to_copy(Path::new(elsewhere)).is_none(), "{elsewhere}");
        }
        let google = ObjectTarget::at(Path::new("gs://a/b.fan")).unwrap();
        assert!(google.source_to_copy(Path::new("gs://a/d.part")).is_none());
    }
}
