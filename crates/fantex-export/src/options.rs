//! What an export is asked for.

use crate::error::ExportError;

/// Texture coordinates of an exported model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum UvChoice<'a> {
    /// A packing of its own.
    #[default]
    Atlas,
    /// Those that the asset kept of its model.
    OfAsset,
    /// Those of this model, which must have the asset's triangles.
    OfModel(&'a fantex_mesh::Mesh),
}

/// How to export.
#[derive(Clone, Debug)]
pub struct ExportOptions<'a> {
    /// Whose texture coordinates.
    pub uv: UvChoice<'a>,
    /// Columns and rows of the pictures, a power of two; without it, as many as give the density of the asset.
    pub side: Option<u32>,
    /// The most columns that are chosen without `side`.
    pub largest_side: u32,
    /// Texels around the charts of an own packing, a power of two; without it, a 128th of the side, 2 to 16.
    pub padding: Option<u32>,
    /// Write each picture of a model as KTX2, too, beside it.
    pub with_ktx2: bool,
    /// Overwrite existing files.
    pub force: bool,
    /// Bytes that texels may take.
    pub memory_bytes: u64,
}

impl Default for ExportOptions<'_> {
    /// An own packing of at most 8192 columns, PNG alone, no overwriting, 1 GiB.
    fn default() -> Self {
        Self {
            uv: UvChoice::default(),
            side: None,
            largest_side: 8192,
            padding: None,
            with_ktx2: false,
            force: false,
            memory_bytes: 1 << 30,
        }
    }
}

/// The smallest picture.
pub const LEAST_SIDE: u32 = 16;

/// The largest picture.
pub const MOST_SIDE: u32 = 32_768;

/// The widest padding.
pub const MOST_PADDING: u32 = 64;

impl ExportOptions<'_> {
    /// Refuses sizes that no picture has.
    pub(crate) fn check(&self) -> Result<(), ExportError> {
        for side in self.side.into_iter().chain([self.largest_side]) {
            if !side.is_power_of_two() || !(LEAST_SIDE..=MOST_SIDE).contains(&side) {
                return Err(ExportError::Side { side, least: LEAST_SIDE, most: MOST_SIDE });
            }
        }
        match self.padding {
            Some(padding) if !padding.is_power_of_two() || padding > MOST_PADDING => {
                Err(ExportError::Padding { padding, most: MOST_PADDING })
            }
            _ => Ok(()),
        }
    }
}
