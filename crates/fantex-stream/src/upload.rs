//! Objects that are written to stores: whole or not at all.
//!
//! A small file is one request. A larger one goes in parts, several under way, of which the store makes the object when it is told to; before
//! that nobody sees them. In stores that speak S3 (<https://docs.aws.amazon.com/AmazonS3/latest/userguide/mpuoverview.html>) an upload that fails
//! is aborted. Azure's (<https://learn.microsoft.com/rest/api/storageservices/put-block-list>) knows parts, its blocks, of a blob, not of an
//! upload: they are named after their upload, and the store drops them after a week. Parts are read from the file while they are sent, so that
//! memory does not grow with them.

use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use fantex_base::{Error, Result, files};
use rusty_s3::Method;

use crate::read::object::{Store, StoredObject};
use crate::read::ranges::server_error;

use self::parts::{CONNECTIONS, PART_BYTES};
use self::refusal::{LOST_PARTS, Refusal, refusal_of};
use self::request::{Answer, NoBody, RETRIES, Request, Text};
use self::sent_file::Upload;

pub use self::assemble::{Assembled, SharedRun};

mod assemble;
mod lanes;
mod parts;
mod pieces;
mod refusal;
mod request;
mod sent_file;

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

/// Connections that are kept.
const MAX_CONNECTIONS: usize = CONNECTIONS + assemble::COPIES;

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
}

/// What no other upload is marked with.
fn new_mark() -> String {
    format!("{:016x}", RandomState::new().build_hasher().finish())
}

#[cfg(test)]
mod tests {
    use super::*;

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
