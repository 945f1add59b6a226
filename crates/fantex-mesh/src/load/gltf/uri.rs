//! Bytes behind URIs: data URIs and relative paths.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::BufferProblem;
use crate::load::locate;

/// What a URI points to.
pub(super) enum Target {
    Bytes(Vec<u8>),
    File(PathBuf),
}

/// Exporters disagree about the padding at the end.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Decodes a data URI, or resolves a relative path against `folder`.
pub(super) fn resolve(uri: &str, folder: &Path) -> Result<Target, BufferProblem> {
    if let Some(data) = uri.strip_prefix("data:") {
        return decode_data(data).map(Target::Bytes);
    }
    let not_relative = || BufferProblem::NotRelative { uri: uri.chars().take(60).collect() };
    if uri.starts_with('/') || uri.starts_with('\\') || has_scheme(uri) {
        return Err(not_relative());
    }
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8_lossy();
    // A name that is absolute only once decoded must not get around the check above.
    let path = Path::new(decoded.as_ref());
    if decoded.is_empty() || decoded.starts_with(['/', '\\']) || path.is_absolute() {
        return Err(not_relative());
    }
    Ok(Target::File(locate(folder, path)))
}

/// `[media type][;base64],DATA`
fn decode_data(data: &str) -> Result<Vec<u8>, BufferProblem> {
    let (media_type, content) = data.split_once(',').ok_or(BufferProblem::DataUri("it has no comma"))?;
    if !media_type.ends_with(";base64") {
        return Ok(percent_encoding::percent_decode_str(content).collect());
    }
    BASE64.decode(content.trim_end()).map_err(|_| BufferProblem::DataUri("it is not base64"))
}

/// True for `http:`, `file:`, `C:` and the like.
fn has_scheme(uri: &str) -> bool {
    uri.split_once(':').is_some_and(|(scheme, _)| {
        !scheme.is_empty() && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    })
}
