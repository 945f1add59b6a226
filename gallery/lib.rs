//! The looks of the gallery: a catalogue, and one look for each technique.

mod catalogue;

pub use catalogue::*;

/// Files of this folder as `(path in the workspace, content)`.
macro_rules! files {
    ($($name:literal)*) => { &[$((concat!("gallery/", $name), include_bytes!($name))),*] };
}

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = files![
    "alpha.toml"
    "anisotropy.toml"
    "bump.toml"
    "captured.toml"
    "color-use.toml"
    "combine.toml"
    "cube-texture.toml"
    "details.toml"
    "displacement.toml"
    "everything.toml"
    "gallery.toml"
    "gloss.toml"
    "glow.toml"
    "horizon.toml"
    "interpolation.toml"
    "layers.toml"
    "magnified.toml"
    "noise.toml"
    "normal-map.toml"
    "o-maps.toml"
    "projector.toml"
    "reflection.toml"
    "s-maps-irregular.toml"
    "s-maps.toml"
    "shadows.toml"
    "sines.toml"
    "sky.toml"
    "stone.toml"
    "tabulated.toml"
    "terrain.toml"
    "texture-coordinates.toml"
    "toon.toml"
    "triplanar.toml"
    "volume.toml"
    "waves.toml"
    "wood.toml"
    "wraps.toml"
];

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn every_file_is_listed() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut names = Vec::new();
        for sub in [""] {
            for entry in folder.join(sub).read_dir().unwrap() {
                let path = entry.unwrap().path();
                let is_own = path.extension().is_some_and(|e| e == "rs") || path.ends_with("Cargo.toml");
                if path.is_file() && !is_own {
                    let name = path.strip_prefix(folder).unwrap().display().to_string();
                    names.push(format!("gallery/{name}"));
                }
            }
        }
        names.sort();
        let mut listed: Vec<&str> = super::FILES.iter().map(|(name, _)| *name).collect();
        listed.sort_unstable();
        assert_eq!(listed, names);
    }
}
