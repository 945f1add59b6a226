//! Pictures of floats, which are kept whole until they are written.

use std::path::PathBuf;

use fantex_texture::Image;

use crate::error::ExportError;
use crate::maps::{Components, Map};
use crate::texels::RowSink;

/// Collects a map and writes it as OpenEXR.
pub(crate) struct FloatSink {
    /// Where it is written, and what errors name.
    temporary: PathBuf,
    side: u32,
    components: Components,
    samples: Vec<f32>,
}

impl FloatSink {
    /// Bytes that a picture takes.
    pub(crate) fn memory_bytes(side: u32, map: &Map) -> u64 {
        // The samples, their copy on the way, and the encoded file.
        3 * 4 * u64::from(side) * u64::from(side) * map.components.count() as u64
    }

    /// Begins a square picture that is written to `temporary`.
    pub(crate) fn new(temporary: PathBuf, side: u32, map: &Map) -> Self {
        Self { temporary, side, components: map.components, samples: Vec::new() }
    }
}

impl RowSink for FloatSink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<(), ExportError> {
        match self.components {
            Components::One(k) => self.samples.extend(values.iter().map(|v| v[k])),
            Components::Rgb => self.samples.extend(values.iter().flat_map(|v| [v[0], v[1], v[2]])),
            Components::Rgba => self.samples.extend_from_slice(values.as_flattened()),
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ExportError> {
        let samples = std::mem::take(&mut self.samples);
        let channels = self.components.count() as u8;
        Ok(Image::from_linear(self.side, self.side, channels, samples).save(&self.temporary)?)
    }
}
