//! Who asks a store that speaks Amazon's protocol: the first that there is of keys in variables, keys in a file, and those of the container in which
//! the program runs, which hold for some hours and are asked for again before that ends.
//!
//! Variables, file and requests are those of Amazon's own programs
//! (<https://docs.aws.amazon.com/sdkref/latest/guide/standardized-credentials.html>).

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use jiff::Timestamp;
use rusty_s3::Credentials;
use serde::Deserialize;

use super::http::client_error;
use super::ranges::{server_error, status_error};
use super::{RetryPolicy, is_transient};

/// Where a store's keys come from.
#[derive(Debug)]
pub(crate) enum Keys {
    /// From nowhere: everybody asks.
    Nobody,
    Given(Credentials),
    Container(ContainerKeys),
}

/// Keys, and until when they hold.
#[derive(Clone, Debug)]
pub(crate) struct HeldKeys {
    pub(crate) credentials: Credentials,
    /// None for ever.
    pub(crate) until: Option<SystemTime>,
}

/// Keys that expire sooner are not used for what may take long.
pub(crate) const MIN_TIME_LEFT: Duration = Duration::from_mins(5);

/// Longest answer that is read.
const MAX_ANSWER_BYTES: u64 = 1 << 16;

/// Where containers ask that are given a path alone.
const CONTAINER_HOST: &str = "http://169.254.170.2";

impl Keys {
    /// By the variables of an environment. Keys of files and containers are Amazon's.
    pub(crate) fn of(variable: &dyn Fn(&str) -> Option<String>, is_google: bool) -> Self {
        let variable = |name: &str| variable(name).filter(|value| !value.trim().is_empty());
        let given = || {
            let (id, secret) = (variable("AWS_ACCESS_KEY_ID")?, variable("AWS_SECRET_ACCESS_KEY")?);
            Some(credentials(id, secret, variable("AWS_SESSION_TOKEN")))
        };
        if let Some(credentials) = given() {
            return Self::Given(credentials);
        }
        if is_google {
            return Self::Nobody;
        }
        if let Some(credentials) = of_file(&variable) {
            return Self::Given(credentials);
        }
        let full = || variable("AWS_CONTAINER_CREDENTIALS_FULL_URI");
        let relative = variable("AWS_CONTAINER_CREDENTIALS_RELATIVE_URI");
        match relative.map(|path| format!("{CONTAINER_HOST}{path}")).or_else(full) {
            None => Self::Nobody,
            Some(url) => Self::Container(ContainerKeys {
                url,
                token: variable("AWS_CONTAINER_AUTHORIZATION_TOKEN"),
                token_file: variable("AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE").map(PathBuf::from),
                failure: Mutex::default(),
            }),
        }
    }

    /// The keys as they are now; none where everybody asks, or where the container gives none.
    pub(crate) fn now(&self) -> Option<HeldKeys> {
        match self {
            Self::Nobody => None,
            Self::Given(credentials) => Some(HeldKeys { credentials: credentials.clone(), until: None }),
            Self::Container(container) => container.now(),
        }
    }

    /// What to do where the store does not let somebody `read` or `write`.
    pub(crate) fn advice(&self, verb: &str) -> String {
        match self {
            Self::Nobody => {
                format!("set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, as not everybody may {verb} it")
            }
            Self::Given(_) => format!(
                "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION, and what they may {verb}"
            ),
            Self::Container(container) => match &*locked(&container.failure) {
                Some(why) => format!("{} gave no keys: {why}", container.url),
                None => format!("check AWS_REGION, and what the keys of this container may {verb}"),
            },
        }
    }
}

fn credentials(id: String, secret: String, token: Option<String>) -> Credentials {
    match token {
        Some(token) => Credentials::new_with_token(id, secret, token),
        None => Credentials::new(id, secret),
    }
}

/// The keys of a profile in Amazon's file; none where there is none.
fn of_file(variable: &dyn Fn(&str) -> Option<String>) -> Option<Credentials> {
    let of_home =
        || Some(Path::new(&variable("HOME").or_else(|| variable("USERPROFILE"))?).join(".aws/credentials"));
    let path = variable("AWS_SHARED_CREDENTIALS_FILE").map(PathBuf::from).or_else(of_home)?;
    let text = std::fs::read_to_string(path).ok()?;
    of_profile(&text, variable("AWS_PROFILE").as_deref().unwrap_or("default"))
}

/// Keys are lines `name = value` below a line `[profile]`.
fn of_profile(text: &str, profile: &str) -> Option<Credentials> {
    let lines = text.lines().map(str::trim);
    let own = lines
        .skip_while(|line| section(line) != Some(profile))
        .skip(1)
        .take_while(|line| section(line).is_none());
    let values: HashMap<_, _> = own
        .filter_map(|line| line.split_once('='))
        .map(|(name, value)| (name.trim(), value.trim()))
        .collect();
    let value =
        |name: &str| values.get(name).map(|value| (*value).to_owned()).filter(|value| !value.is_empty());
    Some(credentials(
        value("aws_access_key_id")?,
        value("aws_secret_access_key")?,
        value("aws_session_token"),
    ))
}

fn section(line: &str) -> Option<&str> {
    Some(line.strip_prefix('[')?.split_once(']')?.0.trim())
}

/// Where a container's keys are asked for.
#[derive(Debug)]
pub(crate) struct ContainerKeys {
    url: String,
    /// Proves who asks, by itself or in a file, which changes.
    token: Option<String>,
    token_file: Option<PathBuf>,
    /// Why there were none the last time.
    failure: Mutex<Option<String>>,
}

/// By address: all objects of a process share them.
static FETCHED: Mutex<Option<HashMap<String, HeldKeys>>> = Mutex::new(None);

/// An answer with keys.
#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Answer {
    access_key_id: String,
    secret_access_key: String,
    token: Option<String>,
    /// RFC 3339.
    expiration: Option<String>,
}

impl ContainerKeys {
    fn now(&self) -> Option<HeldKeys> {
        // Held while they are fetched: others wait for them.
        let mut fetched = locked(&FETCHED);
        let known = fetched.get_or_insert_default().get(&self.url).cloned();
        let holds_for =
            |keys: &HeldKeys, time: Duration| keys.until.is_none_or(|until| SystemTime::now() + time < until);
        if let Some(keys) = known.as_ref().filter(|keys| holds_for(keys, MIN_TIME_LEFT)) {
            return Some(keys.clone());
        }
        match RetryPolicy::NETWORK.run(|| self.fetch(), is_transient, std::thread::sleep) {
            Ok(keys) => {
                *locked(&self.failure) = None;
                fetched.get_or_insert_default().insert(self.url.clone(), keys.clone());
                Some(keys)
            }
            Err(error) => {
                *locked(&self.failure) = Some(error.to_string());
                known.filter(|keys| holds_for(keys, Duration::ZERO))
            }
        }
    }

    fn fetch(&self) -> io::Result<HeldKeys> {
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(5)))
            .max_redirects(0)
            .max_redirects_will_error(false)
            .build();
        let mut request = config.new_agent().get(&self.url);
        let in_file = self.token_file.as_ref().map(std::fs::read_to_string).transpose()?;
        if let Some(token) = in_file.as_deref().or(self.token.as_deref()) {
            request = request.header("authorization", token.trim());
        }
        let mut response = request.call().map_err(client_error)?;
        let status = response.status().as_u16();
        if status != 200 {
            return Err(status_error(status));
        }
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES);
        let text = body.read_to_string().map_err(client_error)?;
        // What is wrong with it may tell of keys.
        let no_keys =
            || server_error(io::ErrorKind::InvalidData, "the answer has no keys, or an end that is no time");
        let answer: Answer = serde_json::from_str(&text).map_err(|_| no_keys())?;
        let Answer { access_key_id, secret_access_key, token, expiration } = answer;
        let until = expiration.map(|text| text.parse::<Timestamp>()).transpose().map_err(|_| no_keys())?;
        let credentials = credentials(access_key_id, secret_access_key, token);
        Ok(HeldKeys { credentials, until: until.map(SystemTime::from) })
    }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::net::TcpListener;
    use std::sync::mpsc::{Receiver, channel};

    use super::*;

    fn of(variables: &[(&str, &str)], is_google: bool) -> Keys {
        let variable = |name: &str| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        };
        Keys::of(&variable, is_google)
    }

    #[test]
    fn the_first_that_there_is_counts() {
        let folder = tempfile::tempdir().unwrap();
        let home = folder.path().to_str().unwrap();
        std::fs::create_dir(folder.path().join(".aws")).unwrap();
        let text = "# mine\n[default]\naws_access_key_id = FILE\naws_secret_access_key=a=b\n\n[ farm ]\n\
                    aws_access_key_id = FARM\naws_secret_access_key = s\naws_session_token = t\n[empty]\n";
        std::fs::write(folder.path().join(".aws/credentials"), text).unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let container = ("AWS_CONTAINER_CREDENTIALS_RELATIVE_URI", "/keys");
        let own = [("AWS_ACCESS_KEY_ID", "OWN"), ("AWS_SECRET_ACCESS_KEY", "s"), ("HOME", home), container];
        let key = |keys: &Keys| keys.now().unwrap().credentials;
        assert_eq!(key(&of(&own, false)).key(), "OWN");
        assert_eq!(key(&of(&own, true)).key(), "OWN");
        let file = key(&of(&own[2..], false));
        assert_eq!((file.key(), file.secret(), file.token()), ("FILE", "a=b", None));
        assert!(matches!(of(&own[2..], true), Keys::Nobody));
        let farm = key(&of(&[("HOME", home), ("AWS_PROFILE", "farm")], false));
        assert_eq!((farm.key(), farm.token()), ("FARM", Some("t")));
        for profile in ["empty", "none"] {
            assert!(matches!(of(&[("HOME", home), ("AWS_PROFILE", profile)], false), Keys::Nobody));
        }
        let nowhere = at("none");
        let elsewhere = [("HOME", home), ("AWS_SHARED_CREDENTIALS_FILE", nowhere.as_str()), container];
        let Keys::Container(keys) = of(&elsewhere, false) else { panic!("no container") };
        assert_eq!(keys.url, "http://169.254.170.2/keys");
        assert!(matches!(of(&[], false), Keys::Nobody));
    }

    /// Gives these answers, one after the other, and tells the headers of the requests, as they came.
    fn serve(answers: Vec<(u16, String)>) -> (String, Receiver<String>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/v1/keys", listener.local_addr().unwrap());
        let (sender, requests) = channel();
        std::thread::spawn(move || {
            for (status, body) in answers {
                let (mut stream, _) = listener.accept().unwrap();
                let lines = BufReader::new(stream.try_clone().unwrap()).lines();
                let head: Vec<String> =
                    lines.map(Result::unwrap).take_while(|line| !line.is_empty()).collect();
                sender.send(head.join("\n").to_ascii_lowercase()).unwrap();
                let length = body.len();
                let answer = format!(
                    "HTTP/1.1 {status} x\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n{body}"
                );
                stream.write_all(answer.as_bytes()).unwrap();
            }
        });
        (url, requests)
    }

    #[test]
    fn keys_of_a_container_are_asked_for_when_they_are_about_to_expire() {
        let answer = |id: &str, left: i64| {
            let until = Timestamp::from_second(Timestamp::now().as_second() + left).unwrap();
            let keys = format!("\"AccessKeyId\":\"{id}\",\"SecretAccessKey\":\"s\",\"Token\":\"t\"");
            (200, format!("{{{keys},\"Expiration\":\"{until}\",\"RoleArn\":\"r\"}}"))
        };
        let (url, requests) = serve(vec![answer("FIRST", 60), answer("SECOND", 3600), (404, String::new())]);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        std::fs::write(&file, "Proof\n").unwrap();
        let variables = [
            ("AWS_CONTAINER_CREDENTIALS_FULL_URI", url.as_str()),
            ("AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE", file.to_str().unwrap()),
        ];
        let keys = || of(&variables, false);
        let id = |keys: &Keys| keys.now().unwrap().credentials.key().to_owned();
        assert_eq!(id(&keys()), "FIRST");
        assert!(requests.recv().unwrap().contains("authorization: proof"));
        // A minute is too short; the next hold, for all objects.
        assert_eq!([id(&keys()), id(&keys())], ["SECOND", "SECOND"]);
        assert!(keys().now().unwrap().until.is_some());
        assert_eq!(requests.try_iter().count(), 1);
    }

    #[test]
    fn a_container_without_keys_is_named() {
        let (url, requests) = serve(vec![(404, String::new()), (200, "{\"Token\":\"secret\"}".to_owned())]);
        let keys = of(
            &[("AWS_CONTAINER_CREDENTIALS_FULL_URI", &url), ("AWS_CONTAINER_AUTHORIZATION_TOKEN", "abc")],
            false,
        );
        assert!(keys.now().is_none());
        assert!(requests.recv().unwrap().contains("authorization: abc"));
        let advice = keys.advice("read");
        assert!(advice.contains(&url) && advice.contains("404"), "{advice}");
        assert!(keys.now().is_none());
        let advice = keys.advice("read");
        assert!(advice.contains("no keys") && !advice.contains("secret"), "{advice}");
    }
}
