//! Names of the files of a split: an index, sectors, coarse assets, and generations of these.

use std::path::Path;

use fantex_stream::url_of;

use super::Split;
use crate::WORLD_EXTENSION;

pub(super) const SECTOR_PREFIX: &str = "sector-";
pub(super) const COARSE_PREFIX: &str = "coarse-";

impl Split {
    /// The file name of the index of the sectors of an asset at a path or an address.
    pub(crate) fn index_name(asset: &Path) -> String {
        let asset = url_of(asset).map_or(asset, |url| Path::new(url.split(['?', '#']).next().unwrap_or(url)));
        let name = asset.file_stem().map_or_else(|| "world".into(), |stem| stem.to_string_lossy());
        format!("{name}.{WORLD_EXTENSION}")
    }

    /// Whether a file name is that of a sector or of a coarse asset; such assets of a world go when another takes its place.
    pub(crate) fn is_asset_name(file: &str) -> bool {
        parts_of_name(file).is_some()
    }

    /// The file name of a sector or a coarse asset in the world of a generation, whatever its own is. Worlds that take each other's places are of
    /// different generations, so that their assets can lie side by side.
    pub(crate) fn name_in_generation(file: &str, generation: u32) -> String {
        parts_of_name(file).map_or_else(|| file.to_owned(), |(stem, _)| name_of_generation(stem, generation))
    }
}

/// The file name of a stem, without an extension, in a generation.
pub(crate) fn name_of_generation(stem: &str, generation: u32) -> String {
    match generation {
        1 => format!("{stem}.fan"),
        _ => format!("{stem}-{generation}.fan"),
    }
}

/// The name of a sector's or a coarse asset's file without its generation, and that: `sector-0001.fan` has the first, `sector-0001-2.fan` the second.
fn parts_of_name(file: &str) -> Option<(&str, u32)> {
    numbered_name(file, &[SECTOR_PREFIX, COARSE_PREFIX])
}

/// The same of a file whose name begins with one of some words, before its number.
pub(crate) fn numbered_name<'f>(file: &'f str, prefixes: &[&str]) -> Option<(&'f str, u32)> {
    let name = file.strip_suffix(".fan")?;
    let prefix = prefixes.iter().find(|prefix| name.starts_with(**prefix))?;
    let (number, generation) = match name[prefix.len()..].split_once('-') {
        Some((_, generation)) if generation.starts_with(['+', '0']) => return None,
        Some((number, generation)) => (number, generation.parse::<u32>().ok().filter(|&number| number > 1)?),
        None => (&name[prefix.len()..], 1),
    };
    let is_number = number.len() >= 4 && number.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| (&name[..prefix.len() + number.len()], generation))
}

/// The generation of a sector's or a coarse asset's file.
pub(crate) fn generation_of(file: &str) -> Option<u32> {
    Some(parts_of_name(file)?.1)
}

/// The file of a sector or a coarse asset, counted from 0.
pub(super) fn file_name(prefix: &str, number: usize) -> String {
    format!("{prefix}{:04}.fan", number + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_sectors_tell_their_generation() {
        for (file, parts) in [
            ("sector-0001.fan", Some(("sector-0001", 1))),
            ("coarse-12345-17.fan", Some(("coarse-12345", 17))),
            ("sector-0001-2.fan", Some(("sector-0001", 2))),
            ("sector-0001-1.fan", None),
            ("sector-0001-02.fan", None),
            ("sector-0001-+2.fan", None),
            ("sector-0001-.fan", None),
            ("sector-001.fan", None),
            ("sector-0001-2-3.fan", None),
            ("sector-0001.part", None),
            ("a-sector-0001.fan", None),
        ] {
            assert_eq!(parts_of_name(file), parts, "{file}");
        }
        let name = Split::name_in_generation;
        assert_eq!(name("sector-0001.fan", 1), "sector-0001.fan");
        assert_eq!(name("sector-0001-2.fan", 1), "sector-0001.fan");
        assert_eq!(name("coarse-0001-2.fan", 3), "coarse-0001-3.fan");
        assert_eq!(name("houses/church.fan", 3), "houses/church.fan");
    }
}
