//! Objects that are sent in parts: begun, filled by several requests at once, and made of what came.

use std::io;
use std::sync::atomic::Ordering::Relaxed;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use rusty_s3::Method;

use super::lanes::{Lane, put_in_lanes};
use super::refusal::Refusal;
use super::request::{Content, NoBody, RETRIES, Request, Text, element};
use super::sent_file::Upload;
use super::{ObjectTarget, Replace};
use crate::read::object::Store;
use crate::read::ranges::server_error;

/// Bytes of a part, unless there would be too many; a file of no more is one request. Stores want at least 5 MiB.
pub(super) const PART_BYTES: u64 = 8 << 20;

/// Stores take 10 000.
const MAX_PARTS: u64 = 9_000;

/// Parts under way at once.
pub(super) const CONNECTIONS: usize = 4;

/// Uploads in parts that are begun anew after their stores have lost one to a conflict at its end.
const NEW_UPLOADS: u32 = 1;

impl ObjectTarget {
    pub(super) fn put_in_parts(
        &self,
        upload: &Upload<'_>,
        replace: &Replace,
        mark: &str,
    ) -> Result<(), Refusal> {
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
    pub(super) fn make_of_parts<E: From<Refusal>>(
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
    pub(super) fn begin(&self, mark: &str) -> Result<String, Refusal> {
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
    pub(super) fn abort(&self, id: &str, retries: u32) {
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
    pub(super) fn put_part(
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
}

/// The name of an upload's block: Base64 of at most 64 bytes, as long as the names of all others.
fn name_of_block(id: &str, number: usize) -> String {
    STANDARD.encode(format!("{id}{number:05}"))
}

/// Bytes of each part but the last, whole mebibytes.
fn part_bytes(length: u64) -> u64 {
    length.div_ceil(MAX_PARTS).next_multiple_of(1 << 20).max(PART_BYTES)
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
}
