//! The looks of the gallery: a catalogue, and one look for each technique.

mod catalogue;

pub use catalogue::*;

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = fantex_base::files![
    "gallery/":
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
