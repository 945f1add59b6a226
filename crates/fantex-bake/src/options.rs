//! Options and outcome of a bake.

use fantex_store::Quality;

/// How texel values are found from the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// Fitted to the bilinear reconstruction (local least squares), with overshoot bounded.
    #[default]
    Sharp,
    /// The source's value at the texel's centre.
    Point,
    /// The mean over the texel.
    Box,
}

/// Block format of the texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeFormat {
    /// BC7 for colours, BC5 for normals.
    #[default]
    Bc7,
    /// BC1 for colours, BC5 for normals.
    Bc1,
    /// 8 bits per channel, uncompressed.
    Rgba8,
    /// 32-bit floats.
    Float,
}

/// Options of [`bake`](crate::bake).
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// How texel values are found.
    pub fit: Fit,
    /// Block format.
    pub format: BakeFormat,
    /// Effort of the block encoder.
    pub quality: Quality,
    /// Overwrite an existing asset.
    pub force: bool,
    /// Bytes that texels in flight may take, whatever the texture's size.
    pub memory_bytes: u64,
}

impl Default for BakeOptions {
    /// Sharp BC7, fast encoder, 512 MiB, no overwriting.
    fn default() -> Self {
        Self {
            fit: Fit::default(),
            format: BakeFormat::default(),
            quality: Quality::default(),
            force: false,
            memory_bytes: 512 << 20,
        }
    }
}

/// What was baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSummary {
    /// Texels at level 0, per channel.
    pub texels: u64,
    /// Bytes of the asset.
    pub bytes: u64,
    /// Of that, texels of all levels and channels, packed.
    pub texel_bytes: u64,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Seconds of all threads together spent evaluating the source.
    pub bake_seconds: f64,
    /// Seconds of all threads together spent encoding blocks.
    pub encode_seconds: f64,
    /// Seconds spent packing and writing.
    pub write_seconds: f64,
}
