//! Options and outcome of a bake.

use fantex_store::EncodeQuality;

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
    pub quality: EncodeQuality,
    /// Overwrite an existing asset.
    pub force: bool,
    /// Bytes that texels in flight may take, whatever the texture's size.
    pub memory_bytes: u64,
}

/// Progress of a long operation, and the wish to end it. Called from several threads.
pub trait Progress: Sync {
    /// `done` of `total` texels are finished.
    fn report(&self, done: u64, total: u64);

    /// True once the user wants to stop; the operation then ends soon and leaves nothing behind.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Neither shows nor stops anything.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn report(&self, _done: u64, _total: u64) {}
}

/// What was baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSummary {
    /// Texels at level 0, per channel.
    pub texels: u64,
    /// Bytes of the asset.
    pub bytes: u64,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Seconds of all threads together spent evaluating the source.
    pub bake_seconds: f64,
    /// Seconds of all threads together spent encoding blocks.
    pub encode_seconds: f64,
    /// Seconds spent packing and writing.
    pub write_seconds: f64,
}
