//! Material channels and texel formats.

/// What a channel means to a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelKind {
    /// RGB colour, alpha = opacity.
    BaseColor,
    /// Shading normal: x and y (in -1..1 stored as 0..1) of the unit normal in the *shading frame* of the tile: z is the
    /// interpolated vertex normal `N`, x is the group's `frame.x_axis` turned by the smallest rotation that takes
    /// `frame.direction` to `N`, y = z cross x. `(0.5, 0.5)` is the vertex normal itself.
    Normal,
    /// Red = occlusion, green = perceptual roughness, blue = metallic.
    OcclusionRoughnessMetallic,
    /// RGB emitted light.
    Emission,
    /// A scalar height.
    Displacement,
}

/// How the texels of a channel are stored. Rows of blocks from the top (v = 0), blocks from the left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TexelFormat {
    /// 8 bytes per 4x4 block, RGB + 1 bit alpha.
    Bc1,
    /// 8 bytes per 4x4 block, one channel.
    Bc4,
    /// 16 bytes per 4x4 block, two channels.
    Bc5,
    /// 16 bytes per 4x4 block, RGBA.
    Bc7,
    /// One byte.
    R8,
    /// Two bytes.
    Rg8,
    /// Four bytes.
    Rgba8,
    /// Sixteen bytes, little-endian floats.
    Rgba32F,
}

/// One material channel of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it means.
    pub kind: ChannelKind,
    /// How its texels are stored.
    pub format: TexelFormat,
    /// True where the stored numbers are sRGB-encoded (alpha never is).
    pub srgb: bool,
}
