//! Results on their way to object stores: files on this machine until they are there.
//!
//! What is not finished goes away with the process. What is finished is hours of work, so it has a folder of its own from then on, which goes once
//! everything is sent: it stays where that fails, where somebody ends it, and where the process is killed.

use std::path::Path;

use fantex_base::files::{TemporaryFolder, scratch_folder};
use fantex_base::{ErrorKind, Result};

/// What the names of folders begin with that hold what is finished and not sent.
const UNSENT_PREFIX: &str = "fantex-unsent-";

/// Where something is sent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SendTarget<'a> {
    /// The address.
    pub(crate) place: &'a Path,
    /// Whether what is there may be replaced.
    pub(crate) force: bool,
    /// Whether it is a changed version of what is there, and so worth nothing once somebody else has changed that.
    pub(crate) is_version: bool,
}

/// A folder in that for temporary files, for what is written. It goes away with the value.
#[derive(Debug)]
pub(crate) struct Staging(TemporaryFolder);

impl Staging {
    pub(crate) fn new() -> Result<Self> {
        Ok(Self(scratch_folder()?))
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    /// Sends what is finished: `send` gets the folder. Where that fails, the files stay, and the error says where they are and how `file`, a path
    /// within the folder, is sent there again. A changed version of what somebody else has changed meanwhile
    /// ([`Conflict`](ErrorKind::Conflict)) is not kept: sent later it would undo that.
    ///
    /// # Errors
    /// Those of `send`.
    pub(crate) fn send<T>(
        self,
        file: &Path,
        target: &SendTarget<'_>,
        send: impl FnOnce(&Path) -> Result<T>,
    ) -> Result<T> {
        let folder = self.0.keep(UNSENT_PREFIX);
        match send(&folder) {
            Err(error) if !(target.is_version && error.kind() == ErrorKind::Conflict) => {
                let force = if target.force { " --force" } else { "" };
                let [file, place] = [&*folder.join(file), target.place].map(argument);
                Err(error.leaving(format!(
                    "the finished file is kept, and is sent by: fantex upload {file} -o {place}{force}"
                )))
            }
            sent => {
                // Whatever cannot be removed is in the folder for temporary files.
                std::fs::remove_dir_all(&folder).unwrap_or_default();
                sent
            }
        }
    }
}

/// A path or an address as an argument in a shell.
fn argument(place: &Path) -> String {
    let place = place.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/\\._-+=:@%,~".contains(c);
    match place.chars().all(is_plain) {
        true => place,
        false => format!("'{}'", place.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::Error;

    use super::*;

    #[test]
    fn what_is_not_sent_stays_and_what_is_sent_or_outdated_goes() {
        let finished = || {
            let staging = Staging::new().unwrap();
            let path = staging.path().to_owned();
            std::fs::write(path.join("a b.fan"), "finished").unwrap();
            (staging, path)
        };
        let (staging, path) = finished();
        drop(staging);
        assert!(!path.exists());

        let target = SendTarget { place: Path::new("s3://scans/a.fan"), force: true, is_version: true };
        let mut folder = None;
        let mut send = |staging: Staging, result: Result<()>| {
            staging.send(Path::new("a b.fan"), &target, |path| {
                assert_eq!(std::fs::read(path.join("a b.fan")).unwrap(), b"finished");
                folder = Some(path.to_owned());
                result
            })
        };
        send(finished().0, Ok(())).unwrap();
        let outdated = send(finished().0, Err(Error::conflict("changed"))).unwrap_err();
        assert_eq!((outdated.to_string().as_str(), outdated.remains()), ("changed", None));
        let (staging, path) = finished();
        let error = send(staging, Err(Error::new(ErrorKind::Io, "cannot write"))).unwrap_err();
        assert!(!path.exists());
        let folder = folder.unwrap();
        assert_eq!(std::fs::read(folder.join("a b.fan")).unwrap(), b"finished");
        let sentence = error.to_string();
        let command = format!("fantex upload '{}/a b.fan' -o s3://scans/a.fan --force", folder.display());
        assert!(sentence.starts_with("cannot write; ") && sentence.ends_with(&command), "{sentence}");
        assert!(error.remains().unwrap().ends_with(&command));
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn arguments_are_taken_by_a_shell_as_they_are() {
        for (place, shown) in [
            ("s3://a/b-c_1.fan", "s3://a/b-c_1.fan"),
            ("/tmp/a b.fan", "'/tmp/a b.fan'"),
            ("/tmp/it's", r"'/tmp/it'\''s'"),
            ("$HOME", "'$HOME'"),
        ] {
            assert_eq!(argument(Path::new(place)), shown);
        }
    }
}
