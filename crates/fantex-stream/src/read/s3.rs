//! Objects in stores that speak Amazon's S3, Google's among them.
//!
//! The variables are those of Amazon's own programs: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION` (or
//! `AWS_DEFAULT_REGION`), and `AWS_ENDPOINT_URL_S3` (or `AWS_ENDPOINT_URL`) for stores of others. Without a key, objects are read as
//! everybody may.

use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use jiff::Timestamp;
use rusty_s3::signing::sign;
use rusty_s3::{Bucket, Credentials, Method, UrlStyle};

/// How long a signed URL holds.
const SIGNED_TIME: Duration = Duration::from_hours(1);

/// Signed URLs are used for so long; then they are signed anew. Stores go by the time of day, which passes while a machine sleeps.
const USED_TIME: Duration = Duration::from_mins(30);

const GOOGLE: &str = "https://storage.googleapis.com";

/// An object, and who asks for it.
#[derive(Debug)]
pub(crate) struct S3Object {
    bucket: Bucket,
    key: String,
    /// Whether writing may depend on what is there by the headers of Amazon's store. (Google's knows them for reading only.)
    pub(crate) has_conditional_writes: bool,
    /// Whether the store copies ranges of objects into others. (Google's documents no such request; it joins whole objects.)
    copies_ranges: bool,
    credentials: Option<Credentials>,
    signed: Mutex<Option<(SystemTime, String)>>,
}

impl S3Object {
    /// The object of a key in a bucket, in Google's store or by the variables of an environment.
    ///
    /// # Errors
    /// The endpoint is no URL.
    pub(crate) fn new(
        (name, key): (&str, &str),
        is_google: bool,
        variable: impl Fn(&str) -> Option<String>,
        credentials: Option<Credentials>,
    ) -> io::Result<Self> {
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
            let why = format!("{endpoint} is no endpoint of an object store ({error}); see AWS_ENDPOINT_URL");
            io::Error::new(io::ErrorKind::InvalidInput, why)
        };
        let url = endpoint.parse().map_err(|error| wrong(&error))?;
        let bucket =
            Bucket::new(url, style, name.to_owned(), region.clone()).map_err(|error| wrong(&error))?;
        Ok(Self {
            bucket,
            key: key.to_owned(),
            has_conditional_writes: !is_google,
            copies_ranges: !is_google,
            credentials,
            signed: Mutex::default(),
        })
    }

    /// Where the object is read now.
    pub(crate) fn url(&self) -> String {
        let mut signed = self.signed.lock().unwrap_or_else(PoisonError::into_inner);
        match &*signed {
            Some((since, url)) if since.elapsed().is_ok_and(|age| age < USED_TIME) => url.clone(),
            _ => {
                let url = self.signed(Method::Get, &[], &[]);
                *signed = Some((SystemTime::now(), url.clone()));
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

    #[test]
    fn addresses_are_signed_anew_once_they_are_old() {
        let credentials = Some(Credentials::new("ID", "SECRET"));
        let object = S3Object::new(("scans", "a.fan"), false, |_| None, credentials).unwrap();
        let now = SystemTime::now();
        for (since, is_used) in [(now, true), (now - 2 * USED_TIME, false), (now + 2 * USED_TIME, false)] {
            *object.signed.lock().unwrap() = Some((since, "known".to_owned()));
            assert_eq!(object.url() == "known", is_used);
        }
    }
}
