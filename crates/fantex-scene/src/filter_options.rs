//! How textures are filtered.

use fantex_texture::Filter;

/// How textures are filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterOptions {
    /// Reconstruction and anti-aliasing.
    pub filter: Filter,
    /// Longest ratio of the footprint's axes that `Anisotropic` and `Ewa` honour.
    pub max_anisotropy: f32,
}

impl Default for FilterOptions {
    /// Anisotropic, up to 16.
    fn default() -> Self {
        Self { filter: Filter::Anisotropic, max_anisotropy: 16.0 }
    }
}
