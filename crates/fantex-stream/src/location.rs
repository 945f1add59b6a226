//! Assets in files and on web servers.

use std::path::Path;
use std::sync::Arc;

use fantex_store::{Asset, OpenError};

use crate::read::HttpSource;

/// Connections while an asset is opened: one.
const OPENING_CONNECTIONS: usize = 1;

/// The URL that a location is, if it is none of a file.
pub fn url_of(location: &Path) -> Option<&str> {
    let text = location.to_str()?;
    let scheme = text.split_once("://")?.0.to_ascii_lowercase();
    matches!(scheme.as_str(), "http" | "https").then_some(text)
}

/// Opens an asset at a path or at a URL (`http://` or `https://`, from any server that supports range requests).
pub fn open_asset(location: &Path) -> Result<Asset, OpenError> {
    match url_of(location) {
        Some(url) => Asset::open_source(Arc::new(HttpSource::new(url, OPENING_CONNECTIONS))),
        None => Asset::open(location),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_told_from_paths() {
        assert_eq!(url_of(Path::new("https://example.org/a.fan")), Some("https://example.org/a.fan"));
        assert!(url_of(Path::new("HTTP://example.org/a.fan")).is_some());
        for path in ["a.fan", "/tmp/http/a.fan", "http:/a.fan", "C:\\a.fan", "ftp://example.org/a.fan"] {
            assert_eq!(url_of(Path::new(path)), None, "{path}");
        }
    }
}
