//! Objects in object stores: `s3://bucket/key` in those that speak Amazon's S3, `gs://bucket/key` in Google's, which does, too, and
//! `az://container/blob` in Azure's Blob Storage.

use std::io;

use rusty_s3::Method;

use super::azure::AzureBlob;
use super::s3::S3Object;

/// An object, and who asks for it.
#[derive(Debug)]
pub(crate) struct StoredObject {
    pub(crate) key: String,
    pub(crate) store: Store,
}

/// What holds an object, by the protocol that it speaks.
#[derive(Debug)]
pub(crate) enum Store {
    S3(Box<S3Object>),
    Azure(Box<AzureBlob>),
}

/// A request as it is sent.
#[derive(Debug)]
pub(crate) struct SignedRequest {
    pub(crate) url: String,
    /// Headers beside those that it was made with.
    pub(crate) headers: Vec<(&'static str, String)>,
}

impl StoredObject {
    /// The object at a location, by the process' environment; none where the location names no object store.
    ///
    /// # Errors
    /// Bucket or key is missing, the endpoint is no URL, or the variables name no account.
    pub(crate) fn at(location: &str) -> io::Result<Option<Self>> {
        Self::with_variables(location, |name| std::env::var(name).ok())
    }

    fn with_variables(location: &str, variable: impl Fn(&str) -> Option<String>) -> io::Result<Option<Self>> {
        let Some((scheme, rest)) = location.split_once("://") else { return Ok(None) };
        let scheme = scheme.to_ascii_lowercase();
        let parts = match scheme.as_str() {
            "s3" | "gs" => "BUCKET/KEY",
            "az" => "CONTAINER/BLOB",
            _ => return Ok(None),
        };
        let refused = |why: String| io::Error::new(io::ErrorKind::InvalidInput, why);
        let (name, key) = rest
            .split_once('/')
            .filter(|(name, key)| !name.is_empty() && !key.is_empty())
            .ok_or_else(|| refused(format!("an object is named {scheme}://{parts}")))?;
        // In an address they would lead elsewhere.
        if key.split('/').any(|name| matches!(name, "." | "..")) {
            return Err(refused("the names in an object's key are neither '.' nor '..'".to_owned()));
        }
        let store = match scheme.as_str() {
            "az" => Store::Azure(Box::new(AzureBlob::new((name, key), variable)?)),
            scheme => Store::S3(Box::new(S3Object::new((name, key), scheme == "gs", variable)?)),
        };
        Ok(Some(Self { key: key.to_owned(), store }))
    }

    /// The request for the bytes of a range, which is the header `Range`.
    pub(crate) fn reading(&self, range: &str) -> SignedRequest {
        match &self.store {
            Store::S3(object) => SignedRequest { url: object.url(), headers: Vec::new() },
            Store::Azure(blob) => blob.signed(Method::Get, &[], &[("range", range)], 0),
        }
    }

    /// A request that is made now, with a body of so many bytes. Query and headers are sorted by name, names of headers in lower case.
    pub(crate) fn signed(
        &self,
        method: Method,
        query: &[(&str, &str)],
        headers: &[(&str, &str)],
        length: u64,
    ) -> SignedRequest {
        match &self.store {
            Store::S3(object) => {
                SignedRequest { url: object.signed(method, query, headers), headers: Vec::new() }
            }
            Store::Azure(blob) => blob.signed(method, query, headers, length),
        }
    }

    /// Whether a part of an object is asked for of one version by the header `If-Range`. (Azure's store has no such header; its answers name
    /// their versions.)
    pub(crate) fn knows_if_range(&self) -> bool {
        matches!(self.store, Store::S3(_))
    }

    /// Whether writing may depend on what is there by the headers `If-Match` and `If-None-Match`.
    pub(crate) fn has_conditional_writes(&self) -> bool {
        match &self.store {
            Store::S3(object) => object.has_conditional_writes,
            Store::Azure(_) => true,
        }
    }

    /// Whether a refusal with this status may be for want of rights.
    pub(crate) fn may_lack_rights(&self, status: u16) -> bool {
        match &self.store {
            // What strangers may not see they are told is not there, or in conflict with the account's settings.
            Store::Azure(blob) if blob.is_asked_by_strangers() => matches!(status, 401 | 403 | 404 | 409),
            _ => matches!(status, 401 | 403),
        }
    }

    /// What the store calls the object when it copies ranges of it; none where it does not.
    pub(crate) fn copy_source(&self) -> Option<String> {
        match &self.store {
            Store::S3(object) => object.copy_source(),
            Store::Azure(_) => None,
        }
    }

    /// What to do where the store does not let somebody `read` or `write`.
    pub(crate) fn advice(&self, verb: &str) -> String {
        match &self.store {
            Store::S3(object) => object.advice(verb),
            Store::Azure(blob) => blob.advice(verb),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(location: &str, variables: &[(&str, &str)], has_key: bool) -> StoredObject {
        let key = [("AWS_ACCESS_KEY_ID", "ID"), ("AWS_SECRET_ACCESS_KEY", "SECRET")];
        let key = if has_key { &key[..] } else { &[] };
        let variable = |name: &str| {
            variables
                .iter()
                .chain(key)
                .find(|(known, _)| *known == name)
                .map(|(_, value)| (*value).to_owned())
        };
        StoredObject::with_variables(location, variable).unwrap().unwrap()
    }

    #[test]
    fn objects_have_the_addresses_that_their_stores_give_them() {
        for (location, variables, url) in [
            ("s3://scans/cave.fan", &[][..], "https://scans.s3.us-east-1.amazonaws.com/cave.fan"),
            (
                "S3://scans/a/b c.fan",
                &[("AWS_REGION", "eu-west-1")],
                "https://scans.s3.eu-west-1.amazonaws.com/a/b%20c.fan",
            ),
            (
                "s3://my.scans/a.fan",
                &[("AWS_DEFAULT_REGION", "eu-west-1")],
                "https://s3.eu-west-1.amazonaws.com/my.scans/a.fan",
            ),
            (
                "s3://scans/a.fan",
                &[("AWS_ENDPOINT_URL", "http://127.0.0.1:9000")],
                "http://127.0.0.1:9000/scans/a.fan",
            ),
            ("gs://scans/a.fan", &[], "https://storage.googleapis.com/scans/a.fan"),
        ] {
            let of = |has_key| object(location, variables, has_key).reading("bytes=0-1");
            assert_eq!(of(false).url, url);
            let SignedRequest { url: signed, headers } = of(true);
            assert!(
                signed.starts_with(&format!("{url}?")) && signed.contains("X-Amz-Signature="),
                "{signed}"
            );
            assert!(signed.contains("X-Amz-Credential=ID%2F") && !signed.contains("SECRET"), "{signed}");
            assert!(headers.is_empty());
        }
        let object = object("s3://scans/a.fan", &[], true);
        assert_eq!(object.reading("bytes=0-1").url, object.reading("bytes=2-3").url, "signed once");
    }

    #[test]
    fn objects_are_copied_by_bucket_and_key() {
        let path = [("AWS_ENDPOINT_URL", "http://127.0.0.1:9000/s3")];
        for variables in [&[][..], &path] {
            let named = |location: &str| object(location, variables, true).copy_source();
            assert_eq!(named("s3://scans/a/b c.part").as_deref(), Some("scans/a/b%20c.part"));
            assert_eq!(named("s3://my.scans/a.part").as_deref(), Some("my.scans/a.part"));
        }
        assert_eq!(object("gs://scans/a.part", &[], true).copy_source(), None);
    }

    #[test]
    fn what_names_no_object_is_refused() {
        let none = |location: &str| StoredObject::with_variables(location, |_| None);
        assert!(none("https://a.org/b.fan").unwrap().is_none());
        assert!(none("b.fan").unwrap().is_none());
        for (location, words) in [
            ("s3://", "s3://BUCKET/KEY"),
            ("s3://bucket", "s3://BUCKET/KEY"),
            ("s3:///key", "s3://BUCKET/KEY"),
            ("gs://bucket/", "gs://BUCKET/KEY"),
            ("az://container", "az://CONTAINER/BLOB"),
        ] {
            let sentence = none(location).unwrap_err().to_string();
            assert!(sentence.contains(words), "{sentence}");
        }
        for location in ["s3://bucket/../other/key", "s3://bucket/a/./b", "az://container/../other"] {
            let sentence = none(location).unwrap_err().to_string();
            assert!(sentence.contains("neither '.' nor '..'"), "{sentence}");
        }
        let endpoint = |_: &str| Some("not a url".to_owned());
        let sentence = StoredObject::with_variables("s3://a/b", endpoint).unwrap_err().to_string();
        assert!(sentence.contains("AWS_ENDPOINT_URL"), "{sentence}");
    }
}
