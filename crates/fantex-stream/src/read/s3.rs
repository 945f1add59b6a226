//! Objects in stores that speak Amazon's S3, Google's among them.
//!
//! The variables are those of Amazon's own programs: `AWS_REGION` (or `AWS_DEFAULT_REGION`), `AWS_ENDPOINT_URL_S3` (or `AWS_ENDPOINT_URL`) for
//! stores of others, and those of [keys](Keys). Without a key, objects are read as everybody may.

use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use jiff::Timestamp;
use rusty_s3::signing::sign;
use rusty_s3::{Bucket, Method, UrlStyle};

use super::keys::{HeldKeys, Keys, MIN_TIME_LEFT};

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
    keys: Keys,
    signed: Mutex<Option<SignedUrl>>,
}

/// Where an object is read by who has signed the address.
#[derive(Clone, Debug)]
struct SignedUrl {
    url: String,
    since: SystemTime,
    /// Of the keys; none for ever.
    until: Option<SystemTime>,
}

impl SignedUrl {
    fn is_usable(&self) -> bool {
        self.since.elapsed().is_ok_and(|age| age < USED_TIME)
            && self.until.is_none_or(|until| SystemTime::now() + MIN_TIME_LEFT < until)
    }
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
            keys: Keys::of(&variable, is_google),
            signed: Mutex::default(),
        })
    }

    /// Where the object is read now.
    pub(crate) fn url(&self) -> String {
        let mut signed = self.signed.lock().unwrap_or_else(PoisonError::into_inner);
        match &*signed {
            Some(known) if known.is_usable() => known.url.clone(),
            _ => {
                let keys = self.keys.now();
                let url = self.signed_by(keys.as_ref(), Method::Get, &[], &[]);
                // A container that gave none is asked again.
                let is_known = keys.is_some() || matches!(self.keys, Keys::Nobody);
                let (since, until) = (SystemTime::now(), keys.and_then(|keys| keys.until));
                *signed = is_known.then(|| SignedUrl { url: url.clone(), since, until });
                url
            }
        }
    }

    /// The address of a request that is made now. Query and headers are sorted by name, names of headers in lower case; the headers come with
    /// the request.
    pub(crate) fn signed(&self, method: Method, query: &[(&str, &str)], headers: &[(&str, &str)]) -> String {
        self.signed_by(self.keys.now().as_ref(), method, query, headers)
    }

    fn signed_by(
        &self,
        keys: Option<&HeldKeys>,
        method: Method,
        query: &[(&str, &str)],
        headers: &[(&str, &str)],
    ) -> String {
        let mut url = self.bucket.object_url(&self.key);
        let Some(HeldKeys { credentials, .. }) = keys else {
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
        self.keys.advice(verb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_signed_anew_once_they_are_old() {
        let object = S3Object::new(("scans", "a.fan"), false, |_| None).unwrap();
        let now = SystemTime::now();
        for (since, until, is_used) in [
            (now, None, true),
            (now - 2 * USED_TIME, None, false),
            (now + 2 * USED_TIME, None, false),
            (now, Some(now + 2 * MIN_TIME_LEFT), true),
            (now, Some(now + MIN_TIME_LEFT / 2), false),
        ] {
            *object.signed.lock().unwrap() = Some(SignedUrl { url: "known".to_owned(), since, until });
            assert_eq!(object.url() == "known", is_used);
        }
    }
}
