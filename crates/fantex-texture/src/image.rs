//! Images in memory, from and to files.

/// How the numbers of a colour channel encode light. Alpha is always linear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorSpace {
    /// IEC 61966-2-1 transfer curve.
    Srgb,
    /// Proportional to light (or to whatever the texture means: roughness, a normal's coordinate).
    Linear,
}

/// The samples of an image, row-major from the top, channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 8 bits, 0..255 for 0..1.
    U8(Vec<u8>),
    /// 16 bits, 0..65535 for 0..1.
    U16(Vec<u16>),
    /// Any range.
    F32(Vec<f32>),
}

/// A discrete two-dimensional texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows, row 0 on top.
    pub height: u32,
    /// 1 grey, 2 grey + alpha, 3 RGB, 4 RGBA.
    pub channels: u8,
    /// Encoding of the colour channels.
    pub space: ColorSpace,
    /// `width * height * channels` numbers.
    pub samples: Samples,
}
