//! Objects in object stores: `s3://bucket/key` in those that speak Amazon's S3, `gs://bucket/key` in Google's, which does, too.
//!
//! The variables are those of Amazon's own programs: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION` (or
//! `AWS_DEFAULT_REGION`), and `AWS_ENDPOINT_URL_S3` (or `AWS_ENDPOINT_URL`) for stores of others. Without a key, objects are read as
//! everybody may.

use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use rusty_s3::signing::sign;
use rusty_s3::{Bucket, Credentials, Method, UrlStyle};

/// How long a signed URL holds.
const SIGNED_TIME: Duration = Duration::from_hours(1);

/// Signed URLs are used for so long; then they are signed anew.
const USED_TIME: Duration = Duration::from_mins(30);

const GOOGLE: &str = "https://storage.googleapis.com";

/// An object, and who asks for it.
#[derive(Debug)]
pub(crate) struct StoredObject {
    bucket: Bucket,
    pub(crate) key: String,
    /// Whether writing may depend on what is there by the headers of Amazon's store. (Google's knows them for reading only.)
    pub(crate) has_conditional_writes: bool,
    /// Whether the store copies ranges of objects into others. (Google's documents no such request; it joins whole objects.)
    copies_ranges: bool,
    credentials: Option<Credentials>,
    signed: Mutex<Option<(Instant, String)>>,
}

impl StoredObject {
    /// The object at a location, by the process' environment; none where the location names no object store.
    ///
    /// # Errors
    /// Bucket or key is missing, or the endpoint is no URL.
    pub(crate) fn at(location: &str) -> io::Result<Option<Self>> {
        Self::with_variables(location, |name| std::env::var(name).ok(), Credentials::from_env())
    }

    fn with_variables(
        location: &str,
        variable: impl Fn(&str) -> Option<String>,
        credentials: Option<Credentials>,
    ) -> io::Result<Option<Self>> {
        let Some((scheme, rest)) = location.split_once("://") else { return Ok(None) };
        let is_google = match scheme.to_ascii_lowercase().as_str() {
            "s3" => false,
            "gs" => true,
            _ => return Ok(None),
        };
        let refused = |why: String| io::Error::new(io::ErrorKind::InvalidInput, why);
        let (name, key) = rest
            .split_once('/')
            .filter(|(name, key)| !name.is_empty() && !key.is_empty())
            .ok_or_else(|| refused(format!("an object is named {scheme}://BUCKET/KEY")))?;
        // In an address they would lead elsewhere.
        if key.split('/').any(|name| matches!(name, "." | "..")) {
            return Err(refused("the names in an object's key are neither '.' nor '..'".to_owned()));
        }
        let first = |names: [&str; 2]| {
            names.into_iter().find_map(|name| variable(name).filter(|value| !value.is_empty()))
        };
        let region = first(["AWS_REGION", "AWS_DEFAULT_REGION"]);
        let region = region.unwrap_or_else(|| if is_google { "auto" } else { "us-east-1" }.to_owned());
        let given = first(["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"]);
        // Elsewhere names of buckets may be no names of hosts, and certificates hold for no dots in them.
        let by_path = is_google || given.is_some() || name.contains('.');
        let style = if by_path { UrlStyle::Path } else { UrlStyle::VirtualHost };
        let endpoint = given.unwrap_or_else(|| match is_google {
            true => GOOGLE.to_owned(),
            false => format!("https://s3.{region}.amazonaws.com"),
        });
        let wrong = |error: &dyn std::fmt::Display| {
            refused(format!("{endpoint} is no endpoint of an object store ({error}); see AWS_ENDPOINT_URL"))
        };
        let url = endpoint.parse().map_err(|error| wrong(&error))?;
        let bucket =
            Bucket::new(url, style, name.to_owned(), region.clone()).map_err(|error| wrong(&error))?;
        Ok(Some(Self {
            bucket,
            key: key.to_owned(),
            has_conditional_writes: !is_google,
            copies_ranges: !is_google,
            credentials,
            signed: Mutex::default(),
        }))
    }

    /// Where the object is read now.
    pub(crate) fn url(&self) -> String {
        let mut signed = self.signed.lock().unwrap_or_else(PoisonError::into_inner);
        match &*signed {
            Some((since, url)) if since.elapsed() < USED_TIME => url.clone(),
            _ => {
                let url = self.signed(Method::Get, &[], &[]);
                *signed = Some((Instant::now(), url.clone()));
                url
            }
        }
    }

    /// The address of a request that is made now. Query and headers are sorted by name, names of headers in lower case; the headers come with
    /// the request.
    pub(crate) fn signed(&self, method: Method, query: &[(&str, &str)], headers: &[(&str, &str)]) -> String {
        let mut url = self.bucket.object_url(&self.key);
        let Some(credentials) = &self.credentials else {
            if !query.is_empty() {
                url.query_pairs_mut().extend_pairs(query);
            }
            return url.into();
        };
        let (now, expires) = (Timestamp::now(), SIGNED_TIME.as_secs());
        let (key, secret, token) = (credentials.key(), credentials.secret(), credentials.token());
        let (query, headers) = (query.iter().copied(), headers.iter().copied());
        sign(&now, method, url, key, secret, token, self.bucket.region(), expires, query, headers).into()
    }

    /// What the store calls the object when it copies ranges of it; none where it does not.
    pub(crate) fn copy_source(&self) -> Option<String> {
        let url = self.bucket.object_url(&self.key);
        let key = url.path().strip_prefix(self.bucket.base_url().path())?;
        self.copies_ranges.then(|| format!("{}/{key}", self.bucket.name()))
    }

    /// What to do where the store does not let somebody `read` or `write`.
    pub(crate) fn advice(&self, verb: &str) -> String {
        match self.credentials {
            Some(_) => format!(
                "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION, and what they may {verb}"
            ),
            None => {
                format!("set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, as not everybody may {verb} it")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(location: &str, variables: &[(&str, &str)], has_key: bool) -> StoredObject {
        let variable = |name: &str| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        };
        let credentials = has_key.then(|| Credentials::new("ID", "SECRET"));
        StoredObject::with_variables(location, variable, credentials).unwrap().unwrap()
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
            assert_eq!(object(location, variables, false).url(), url);
            let signed = object(location, variables, true).url();
            assert!(
                signed.starts_with(&format!("{url}?")) && signed.contains("X-Amz-Signature="),
                "{signed}"
            );
            assert!(signed.contains("X-Amz-Credential=ID%2F") && !signed.contains("SECRET"), "{signed}");
        }
        let object = object("s3://scans/a.fan", &[], true);
        assert_eq!(object.url(), object.url(), "signed once");
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
        let none = |location: &str| StoredObject::with_variables(location, |_| None, None);
        assert!(none("https://a.org/b.fan").unwrap().is_none());
        assert!(none("b.fan").unwrap().is_none());
        for location in ["s3://", "s3://bucket", "s3:///key", "gs://bucket/"] {
            let sentence = none(location).unwrap_err().to_string();
            assert!(sentence.contains("BUCKET/KEY"), "{sentence}");
        }
        for location in ["s3://bucket/../other/key", "s3://bucket/a/./b"] {
            let sentence = none(location).unwrap_err().to_string();
            assert!(sentence.contains("neither '.' nor '..'"), "{sentence}");
        }
        let endpoint = |_: &str| Some("not a url".to_owned());
        let sentence = StoredObject::with_variables("s3://a/b", endpoint, None).unwrap_err().to_string();
        assert!(sentence.contains("AWS_ENDPOINT_URL"), "{sentence}");
    }
}
