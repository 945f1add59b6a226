//! `file://` addresses in arguments.

use std::ffi::OsString;

use percent_encoding::percent_decode_str;

/// Arguments with paths in the place of `file://` addresses (RFC 8089), also after `=`.
pub(crate) fn with_local_files(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    arguments
        .into_iter()
        .map(|argument| argument.to_str().and_then(local_file).map_or(argument, OsString::from))
        .collect()
}

/// None where there is no such address, or one on another machine.
fn local_file(argument: &str) -> Option<String> {
    const SCHEME: &str = "file://";
    let lower = argument.to_ascii_lowercase();
    let start = match lower.starts_with(SCHEME) {
        true => 0,
        false => lower.find(&format!("={SCHEME}"))? + 1,
    };
    let rest = &argument[start + SCHEME.len()..];
    let path = rest.strip_prefix("localhost").unwrap_or(rest);
    let path = percent_decode_str(path).decode_utf8().ok().filter(|path| path.starts_with('/'))?;
    // The drive follows the slash.
    let path = if cfg!(windows) { &path[1..] } else { &*path };
    Some(format!("{}{path}", &argument[..start]))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn local_addresses_become_paths() {
        for (argument, path) in [
            ("file:///a/b%20c.fan", "/a/b c.fan"),
            ("FILE://localhost/a.fan", "/a.fan"),
            ("--output=file:///a.fan", "--output=/a.fan"),
            ("image=file:///a.png,mapping=box", "image=/a.png,mapping=box"),
        ] {
            assert_eq!(local_file(argument).as_deref(), Some(path));
        }
        for argument in ["file://elsewhere/a.fan", "file:a", "a.fan", "https://a.org/b?c=d"] {
            assert_eq!(local_file(argument), None, "{argument}");
        }
    }
}
