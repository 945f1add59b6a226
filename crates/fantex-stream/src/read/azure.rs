//! Blobs in Azure's Blob Storage.
//!
//! The variables are those of Azure's own programs: `AZURE_STORAGE_ACCOUNT` (or `AZURE_STORAGE_ACCOUNT_NAME`), and to prove who asks
//! `AZURE_STORAGE_SAS_TOKEN` (a shared access signature), which is a part of addresses, or `AZURE_STORAGE_ACCOUNT_KEY` (or
//! `AZURE_STORAGE_KEY`), by which requests are signed
//! (<https://learn.microsoft.com/rest/api/storageservices/authorize-with-shared-key>). Without these, blobs are read as everybody may.
//! `AZURE_ENDPOINT_URL` is the address of the blob service where it is not Azure's public one.

use std::fmt;
use std::io;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fantex_base::uri_escaped;
use hmac::{Hmac, KeyInit as _, Mac as _};
use jiff::Timestamp;
use rusty_s3::Method;
use sha2::Sha256;
use ureq::http::Uri;
use ureq::http::uri::InvalidUri;

use super::object::SignedRequest;

/// The version of the protocol. From 2019-12-12 on blocks may have 4000 MiB.
const VERSION: &str = "2020-10-02";

/// A blob, and who asks for it.
#[derive(Debug)]
pub(crate) struct AzureBlob {
    account: String,
    /// Scheme and host of its address.
    origin: String,
    /// Path of its address.
    path: String,
    credentials: Credentials,
}

/// What proves who asks.
enum Credentials {
    Nothing,
    /// A part of addresses.
    Token(String),
    /// Signs with an account's key.
    Key(Box<Hmac<Sha256>>),
}

impl fmt::Debug for Credentials {
    /// Without the secret.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nothing => "Nothing",
            Self::Token(_) => "Token",
            Self::Key(_) => "Key",
        })
    }
}

impl AzureBlob {
    /// The blob of a name in a container, by the variables of an environment.
    ///
    /// # Errors
    /// They name no account, or have an endpoint, a token or a key that is none.
    pub(crate) fn new(
        (container, name): (&str, &str),
        variable: impl Fn(&str) -> Option<String>,
    ) -> io::Result<Self> {
        let value = |name: &str| {
            let value = variable(name)?.trim().to_owned();
            (!value.is_empty()).then_some(value)
        };
        let account = value("AZURE_STORAGE_ACCOUNT").or_else(|| value("AZURE_STORAGE_ACCOUNT_NAME"));
        if let Some(account) = &account
            && !is_account(account)
        {
            return Err(refused(format!("AZURE_STORAGE_ACCOUNT is {account}, which names no account")));
        }
        let endpoint = match (value("AZURE_ENDPOINT_URL"), &account) {
            (Some(endpoint), _) => endpoint,
            (None, Some(account)) => format!("https://{account}.blob.core.windows.net"),
            (None, None) => {
                let why = "set AZURE_STORAGE_ACCOUNT to the name of the storage account";
                return Err(refused(why.to_owned()));
            }
        };
        let (origin, base, named) = parts_of(&endpoint)?;
        let token = value("AZURE_STORAGE_SAS_TOKEN");
        let key = value("AZURE_STORAGE_ACCOUNT_KEY").or_else(|| value("AZURE_STORAGE_KEY"));
        let credentials = match (token, key) {
            (Some(token), _) => Credentials::Token(checked_token(&token)?),
            (None, Some(key)) => Credentials::Key(Box::new(parsed_key(&key)?)),
            (None, None) => Credentials::Nothing,
        };
        Ok(Self {
            account: account.unwrap_or(named),
            origin,
            path: format!("{base}/{}", uri_escaped(&format!("{container}/{name}"))),
            credentials,
        })
    }

    /// Whether nothing tells the store who asks.
    pub(crate) fn is_asked_by_strangers(&self) -> bool {
        matches!(self.credentials, Credentials::Nothing)
    }

    /// A request that is made now, with a body of so many bytes. Names of headers are in lower case.
    pub(crate) fn signed(
        &self,
        method: Method,
        query: &[(&str, &str)],
        headers: &[(&str, &str)],
        length: u64,
    ) -> SignedRequest {
        let date = Timestamp::now().strftime("%a, %d %b %Y %H:%M:%S GMT").to_string();
        let mut own = vec![("x-ms-version", VERSION.to_owned())];
        let mut parts: Vec<String> =
            query.iter().map(|(name, value)| format!("{name}={}", uri_escaped(value))).collect();
        match &self.credentials {
            Credentials::Nothing => {}
            Credentials::Token(token) => parts.push(token.clone()),
            Credentials::Key(key) => {
                own.push(("x-ms-date", date));
                let mut all = headers.to_vec();
                all.extend(own.iter().map(|(name, value)| (*name, value.as_str())));
                let text =
                    text_to_sign(method, (self.account.as_str(), self.path.as_str()), query, &all, length);
                let signature = signature(key, &text);
                own.push(("authorization", format!("SharedKey {}:{signature}", self.account)));
            }
        }
        let mark = if parts.is_empty() { "" } else { "?" };
        let url = format!("{}{}{mark}{}", self.origin, self.path, parts.join("&"));
        SignedRequest { url, headers: own }
    }

    /// What to do where the store does not let somebody `read` or `write`.
    pub(crate) fn advice(&self, verb: &str) -> String {
        match self.credentials {
            Credentials::Nothing => format!(
                "set AZURE_STORAGE_SAS_TOKEN or AZURE_STORAGE_ACCOUNT_KEY, if not everybody may {verb} it"
            ),
            Credentials::Token(_) => {
                format!("check AZURE_STORAGE_SAS_TOKEN: how long it holds, and whether who has it may {verb}")
            }
            Credentials::Key(_) => {
                "check AZURE_STORAGE_ACCOUNT, AZURE_STORAGE_ACCOUNT_KEY and this machine's clock".to_owned()
            }
        }
    }
}

fn refused(why: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, why)
}

fn is_account(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
}

/// Origin and path of an endpoint, without a slash at the end, and the account that it names: by its path as emulators have it, else by its host.
fn parts_of(endpoint: &str) -> io::Result<(String, String, String)> {
    // It may be a token, which is shown to nobody.
    if endpoint.contains('?') {
        let why = "AZURE_ENDPOINT_URL has a query; give a token in AZURE_STORAGE_SAS_TOKEN";
        return Err(refused(why.to_owned()));
    }
    let wrong = |why: &str| {
        refused(format!("{endpoint} is no endpoint of a blob service ({why}); see AZURE_ENDPOINT_URL"))
    };
    let uri: Uri = endpoint.parse().map_err(|error: InvalidUri| wrong(&error.to_string()))?;
    let (Some(scheme @ ("http" | "https")), Some(host)) = (uri.scheme_str(), uri.authority()) else {
        return Err(wrong("one begins with http:// or https://"));
    };
    let base = uri.path().trim_end_matches('/');
    let by_host = || host.host().split('.').next();
    let account = base.split('/').nth(1).or_else(by_host).unwrap_or_default();
    Ok((format!("{scheme}://{host}"), base.to_owned(), account.to_owned()))
}

/// A token as addresses have it.
fn checked_token(token: &str) -> io::Result<String> {
    let token = token.trim_start_matches(['?', '&']);
    let is_sound = token.bytes().all(|byte| byte.is_ascii_graphic() && !b"?#\"<>".contains(&byte));
    if is_sound && token.split('&').any(|part| part.starts_with("sig=")) {
        return Ok(token.to_owned());
    }
    let why = "AZURE_STORAGE_SAS_TOKEN is no shared access signature, a query with a part sig=";
    Err(refused(why.to_owned()))
}

fn parsed_key(key: &str) -> io::Result<Hmac<Sha256>> {
    let bytes = STANDARD.decode(key).ok().filter(|bytes| !bytes.is_empty());
    let hmac = bytes.and_then(|bytes| Hmac::<Sha256>::new_from_slice(&bytes).ok());
    hmac.ok_or_else(|| {
        refused("AZURE_STORAGE_ACCOUNT_KEY is no key of an account, which is Base64".to_owned())
    })
}

fn signature(key: &Hmac<Sha256>, text: &str) -> String {
    let mut hmac = key.clone();
    hmac.update(text.as_bytes());
    STANDARD.encode(hmac.finalize().into_bytes())
}

/// What of a request is signed. The address' path is as it is sent, and the query's values are not.
fn text_to_sign(
    method: Method,
    (account, path): (&str, &str),
    query: &[(&str, &str)],
    headers: &[(&str, &str)],
    length: u64,
) -> String {
    let value = |name: &str| headers.iter().find(|(known, _)| *known == name).map_or("", |&(_, value)| value);
    let length = if length == 0 { String::new() } else { length.to_string() };
    let standard = [
        method.to_str(),
        value("content-encoding"),
        value("content-language"),
        &length,
        value("content-md5"),
        value("content-type"),
        value("date"),
        value("if-modified-since"),
        value("if-match"),
        value("if-none-match"),
        value("if-unmodified-since"),
        value("range"),
    ];
    let lines = |pairs: Vec<(&str, &str)>, begin: &str, end: &str| -> String {
        pairs.iter().map(|(name, value)| format!("{begin}{name}:{value}{end}")).collect()
    };
    let mut own: Vec<_> = headers.iter().copied().filter(|(name, _)| name.starts_with("x-ms-")).collect();
    own.sort_unstable();
    let mut query = query.to_vec();
    query.sort_unstable();
    let (standard, own, query) = (standard.join("\n"), lines(own, "", "\n"), lines(query, "\n", ""));
    format!("{standard}\n{own}/{account}{path}{query}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACCOUNT: (&str, &str) = ("AZURE_STORAGE_ACCOUNT", "scanner");
    const KEY: (&str, &str) = ("AZURE_STORAGE_ACCOUNT_KEY", "YmFy");

    fn blob(variables: &[(&str, &str)]) -> io::Result<AzureBlob> {
        let variable = |name: &str| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        };
        AzureBlob::new(("scans", "old town/b c.fan"), variable)
    }

    /// Requests of Microsoft's own tests (Azure/go-autorest, `autorest/authorization_storage_test.go`) and what they expect.
    #[test]
    fn signatures_are_those_that_others_make() {
        let key = parsed_key("YmFy").unwrap();
        let signed = |path: &str, query: &[(&str, &str)], date: &str, version: &str| {
            let headers =
                [("content-type", "application/json"), ("x-ms-version", version), ("x-ms-date", date)];
            signature(&key, &text_to_sign(Method::Get, ("golangrocksonazure", path), query, &headers, 0))
        };
        assert_eq!(
            signed("/some/blob.dat", &[], "Wed, 23 Sep 2015 16:40:05 GMT", "2015-02-21"),
            "nYRqgbumDOTPs+Vv1FLH+hm0KPjwwt+Fmj/i16W+lO0="
        );
        let query = [("restype", "service"), ("comp", "properties")];
        assert_eq!(
            signed("/", &query, "Tue, 10 Mar 2020 10:04:41 GMT", "2018-11-09"),
            "BfdIC0K5OwkRbZjewqRXgjQJ2PBMZDoaBCCL3qhrEIs="
        );
    }

    #[test]
    fn what_is_signed_has_each_part_in_its_place() {
        let headers = [
            ("if-none-match", "*"),
            ("range", "bytes=3-9"),
            ("x-ms-version", VERSION),
            ("x-ms-blob-type", "BlockBlob"),
        ];
        let query = [("comp", "block"), ("blockid", "a+b/c=")];
        let text = text_to_sign(Method::Put, ("scanner", "/scans/a%20b.fan"), &query, &headers, 17);
        let expected = "PUT\n\n\n17\n\n\n\n\n\n*\n\nbytes=3-9\nx-ms-blob-type:BlockBlob\nx-ms-version:2020-10-02\n\
                        /scanner/scans/a%20b.fan\nblockid:a+b/c=\ncomp:block";
        assert_eq!(text, expected);
    }

    #[test]
    fn blobs_have_the_addresses_that_their_accounts_give_them() {
        let emulator = ("AZURE_ENDPOINT_URL", "http://127.0.0.1:10000/devstoreaccount1/");
        let cloud = ("AZURE_ENDPOINT_URL", "https://scanner.blob.core.chinacloudapi.cn");
        for (variables, url, account) in [
            (&[ACCOUNT][..], "https://scanner.blob.core.windows.net/scans/old%20town/b%20c.fan", "scanner"),
            (
                &[("AZURE_STORAGE_ACCOUNT_NAME", "scanner")],
                "https://scanner.blob.core.windows.net/scans/old%20town/b%20c.fan",
                "scanner",
            ),
            (
                &[emulator],
                "http://127.0.0.1:10000/devstoreaccount1/scans/old%20town/b%20c.fan",
                "devstoreaccount1",
            ),
            (&[cloud], "https://scanner.blob.core.chinacloudapi.cn/scans/old%20town/b%20c.fan", "scanner"),
            (
                &[("AZURE_STORAGE_ACCOUNT", "other"), cloud],
                "https://scanner.blob.core.chinacloudapi.cn/scans/old%20town/b%20c.fan",
                "other",
            ),
        ] {
            let read = |blob: &AzureBlob| blob.signed(Method::Get, &[], &[("range", "bytes=0-1")], 0);
            let public = blob(variables).unwrap();
            assert!(public.is_asked_by_strangers() && public.account == account, "{public:?}");
            let request = read(&public);
            assert_eq!((request.url.as_str(), request.headers.len()), (url, 1));

            let request = read(&blob(&[variables, &[KEY]].concat()).unwrap());
            assert_eq!(request.url, url);
            let names: Vec<_> = request.headers.iter().map(|(name, _)| *name).collect();
            assert_eq!(names, ["x-ms-version", "x-ms-date", "authorization"]);
            let proof = &request.headers[2].1;
            assert!(proof.starts_with(&format!("SharedKey {account}:")) && proof.ends_with('='), "{proof}");

            // A token goes before a key.
            let token = ("AZURE_STORAGE_SAS_TOKEN", "?sv=1&sig=a%2Bb%3D");
            let with_token = blob(&[variables, &[KEY, token]].concat()).unwrap();
            let request = with_token.signed(Method::Put, &[("blockid", "a+b="), ("comp", "block")], &[], 5);
            assert_eq!(request.url, format!("{url}?blockid=a%2Bb%3D&comp=block&sv=1&sig=a%2Bb%3D"));
            assert_eq!(request.headers.len(), 1);
            assert!(!format!("{with_token:?}").contains("a%2Bb"), "{with_token:?}");
        }
    }

    #[test]
    fn variables_that_lead_to_no_account_are_refused() {
        for (variables, words) in [
            (&[][..], "set AZURE_STORAGE_ACCOUNT"),
            (&[("AZURE_STORAGE_ACCOUNT", "a.org/")], "AZURE_STORAGE_ACCOUNT is a.org/"),
            (&[ACCOUNT, ("AZURE_STORAGE_KEY", "no key")], "AZURE_STORAGE_ACCOUNT_KEY is no key"),
            (&[ACCOUNT, ("AZURE_STORAGE_SAS_TOKEN", "sv=1 &sig=a")], "AZURE_STORAGE_SAS_TOKEN is no"),
            (&[ACCOUNT, ("AZURE_STORAGE_SAS_TOKEN", "sv=1")], "AZURE_STORAGE_SAS_TOKEN is no"),
            (&[("AZURE_ENDPOINT_URL", "not a url")], "not a url is no endpoint"),
            (&[("AZURE_ENDPOINT_URL", "127.0.0.1:10000")], "begins with http://"),
            (&[("AZURE_ENDPOINT_URL", "ftp://a.org/b")], "begins with http://"),
            (&[("AZURE_ENDPOINT_URL", "https://a.org/?sig=secret")], "AZURE_ENDPOINT_URL has a query"),
        ] {
            let sentence = blob(variables).unwrap_err().to_string();
            assert!(sentence.contains(words) && !sentence.contains("secret"), "{sentence}");
        }
    }
}
