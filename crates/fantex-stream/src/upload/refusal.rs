//! Why a store did not do what was asked, and what may help.
//!
//! A condition that does not hold is answered with 412; Azure's store says 409 where a blob was to be new. In Amazon's 409 means that something
//! else was happening to the object at that moment, and that the request is to be made again
//! (<https://docs.aws.amazon.com/AmazonS3/latest/userguide/conditional-writes.html>): whether an object is there it does not say.

use std::io;

use crate::read::is_transient;
use crate::read::ranges::{server_error, status_error};

/// Why it did not do what was asked.
#[derive(Debug)]
pub(super) struct Refusal {
    /// 0 without an answer.
    pub(super) status: u16,
    /// The store's word for it.
    pub(super) code: Option<String>,
    pub(super) error: io::Error,
}

impl From<io::Error> for Refusal {
    fn from(error: io::Error) -> Self {
        Self { status: 0, code: None, error }
    }
}

/// Prefixes of the codes with which Azure's store refuses for other reasons than a condition that does not hold, although the status is the same:
/// a lease, a policy, a container that is being deleted, a blob of another type, no public access.
const UNRELATED_CODES: [&str; 5] = ["Lease", "BlobImmutable", "Container", "InvalidBlobType", "PublicAccess"];

/// Azure's code for a list of blocks some of which are not there: the end of one upload drops the blocks of all others to the same name.
pub(super) const LOST_PARTS: &str = "InvalidBlockList";

/// Codes with which stores that speak S3 ask for the same request again.
const MOMENTARY_CODES: [&str; 2] = ["ConditionalRequestConflict", "OperationAborted"];

impl Refusal {
    /// Of what the caller ends.
    pub(super) fn cancelled() -> Self {
        io::Error::new(io::ErrorKind::Interrupted, "it was ended").into()
    }

    pub(super) fn is_cancelled(&self) -> bool {
        self.status == 0 && self.error.kind() == io::ErrorKind::Interrupted
    }

    /// Whether the object is not what the request expected: another one was there, or came meanwhile.
    pub(super) fn is_conflict(&self) -> bool {
        let code = self.code.as_deref().unwrap_or_default();
        match self.status {
            409 => code.ends_with("AlreadyExists") && !code.starts_with("Container"),
            412 => !UNRELATED_CODES.iter().any(|start| code.starts_with(start)),
            _ => false,
        }
    }

    /// Whether something else was happening to the object at that moment.
    pub(super) fn is_momentary(&self) -> bool {
        self.status == 409 && self.code.as_deref().is_none_or(|code| MOMENTARY_CODES.contains(&code))
    }

    /// Whether the object is gone that was to be replaced.
    pub(super) fn has_no_object(&self) -> bool {
        self.status == 404 && self.code.as_deref() == Some("NoSuchKey")
    }

    /// Whether parts are gone that were there.
    pub(super) fn has_lost_parts(&self) -> bool {
        self.code.as_deref() == Some(LOST_PARTS)
    }

    /// Whether nothing becomes of an upload in parts whose end was refused so, and another one may well become something.
    pub(super) fn ends_upload(&self) -> bool {
        self.is_momentary() || self.code.as_deref() == Some("NoSuchUpload")
    }

    /// Whether the same request may well succeed a moment later.
    pub(super) fn may_succeed_later(&self) -> bool {
        let is_final = matches!(self.status, 409 | 412 | 501) || self.is_cancelled();
        self.is_momentary() || !is_final && is_transient(&self.error)
    }
}

/// The refusal of an answer, with the store's word for it.
pub(super) fn refusal_of(status: u16, code: Option<&str>) -> Refusal {
    let error = status_error(status);
    let kind = match (status, code) {
        // The body came too slowly.
        (400, Some("RequestTimeout")) => io::ErrorKind::TimedOut,
        _ => error.kind(),
    };
    let sentence = code.map_or_else(|| error.to_string(), |code| format!("{error} ({code})"));
    Refusal { status, code: code.map(str::to_owned), error: server_error(kind, sentence) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_pass_is_tried_again() {
        for (status, code, passes) in [
            (500, Some("InternalError"), true),
            (503, Some("SlowDown"), true),
            (400, Some("RequestTimeout"), true),
            (409, Some("ConditionalRequestConflict"), true),
            (409, Some("OperationAborted"), true),
            (409, None, true),
            (409, Some("BlobAlreadyExists"), false),
            (409, Some("BlobImmutableDueToPolicy"), false),
            (400, Some("InvalidPart"), false),
            (403, None, false),
            (404, Some("NoSuchUpload"), false),
            (412, None, false),
            (501, Some("NotImplemented"), false),
        ] {
            assert_eq!(refusal_of(status, code).may_succeed_later(), passes, "{status} {code:?}");
        }
        assert!(!Refusal::cancelled().may_succeed_later());
        let said = refusal_of(403, Some("SignatureDoesNotMatch")).error.to_string();
        assert_eq!(said, "the server answered with status 403 Forbidden (SignatureDoesNotMatch)");
    }

    #[test]
    fn an_object_that_is_there_is_told_from_what_happens_to_it() {
        for (status, code, is_conflict) in [
            (409, Some("BlobAlreadyExists"), true),
            (412, Some("ConditionNotMet"), true),
            (412, Some("PreconditionFailed"), true),
            (412, None, true),
            (412, Some("LeaseIdMissing"), false),
            (409, Some("ConditionalRequestConflict"), false),
            (409, Some("OperationAborted"), false),
            (409, Some("BlobImmutableDueToPolicy"), false),
            (409, Some("ContainerBeingDeleted"), false),
            (409, None, false),
            (400, Some("InvalidBlockList"), false),
        ] {
            assert_eq!(refusal_of(status, code).is_conflict(), is_conflict, "{status} {code:?}");
        }
        for (status, code, ends) in [
            (409, Some("ConditionalRequestConflict"), true),
            (404, Some("NoSuchUpload"), true),
            (404, Some("NoSuchBucket"), false),
            (412, Some("PreconditionFailed"), false),
            (400, Some("InvalidPart"), false),
        ] {
            assert_eq!(refusal_of(status, code).ends_upload(), ends, "{status} {code:?}");
        }
    }
}
