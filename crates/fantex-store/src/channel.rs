//! Material channels, texel formats, and the section that lists them.

use std::fmt;
use std::ops::Range;

use fantex_base::{Error, Result};

use crate::bytes::{ByteReader, ByteWriter};
use crate::error::{out_of_range, too_many, wrong_count};
use crate::limits::MAX_CHANNELS;

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
    /// RGB light that arrives: irradiance over pi, linear, which is what a white, perfectly diffuse surface reflects. May
    /// exceed 1.
    Light,
    /// A highlight that is stretched along a direction in the surface. With the angle `t` from the x axis of the tile's
    /// shading frame (see [`ChannelKind::Normal`]) to the direction, and the strength `s` from -1 to 1, negative where it is
    /// stretched across: red and green are `s cos 2t` and `s sin 2t`, -1..1 stored as 0..1. (Directions that are opposite to each
    /// other are the same, and so are their numbers, so these can be averaged.)
    Anisotropy,
}

impl std::fmt::Display for ChannelKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::BaseColor => "base colour",
            Self::Normal => "normal",
            Self::OcclusionRoughnessMetallic => "occlusion, roughness, metallic",
            Self::Emission => "emission",
            Self::Displacement => "displacement",
            Self::Light => "light",
            Self::Anisotropy => "anisotropy",
        })
    }
}

impl ChannelKind {
    /// All kinds, ordered by their code in files.
    pub(crate) const ALL: [Self; 7] = [
        Self::BaseColor,
        Self::Normal,
        Self::OcclusionRoughnessMetallic,
        Self::Emission,
        Self::Displacement,
        Self::Light,
        Self::Anisotropy,
    ];
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

/// As `bc7`: in the words of options, where there is one.
impl fmt::Display for TexelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bc1 => "bc1",
            Self::Bc4 => "bc4",
            Self::Bc5 => "bc5",
            Self::Bc7 => "bc7",
            Self::R8 => "r8",
            Self::Rg8 => "rg8",
            Self::Rgba8 => "rgba8",
            Self::Rgba32F => "float",
        })
    }
}

impl TexelFormat {
    /// All formats, ordered by their code in files.
    pub const ALL: [Self; 8] =
        [Self::Bc1, Self::Bc4, Self::Bc5, Self::Bc7, Self::R8, Self::Rg8, Self::Rgba8, Self::Rgba32F];

    /// Bytes of 4x4 texels.
    pub const fn block_bytes(self) -> usize {
        match self {
            Self::Bc1 | Self::Bc4 => 8,
            Self::Bc5 | Self::Bc7 | Self::R8 => 16,
            Self::Rg8 => 32,
            Self::Rgba8 => 64,
            Self::Rgba32F => 256,
        }
    }

    /// Whether texels come in blocks of 4x4; else in rows.
    pub const fn is_compressed(self) -> bool {
        matches!(self, Self::Bc1 | Self::Bc4 | Self::Bc5 | Self::Bc7)
    }

    /// Bytes of a rectangle of texels whose sides are multiples of 4.
    pub const fn bytes(self, extent: [u32; 2]) -> usize {
        (extent[0] as usize / 4) * (extent[1] as usize / 4) * self.block_bytes()
    }

    /// The bytes of the 4x4 block at a texel (multiples of 4) of a page with so many columns of texels: one range, or one for each of
    /// four rows.
    pub fn block_ranges(self, columns: u32, [x, y]: [u32; 2]) -> impl Iterator<Item = Range<usize>> {
        let [columns, x, y] = [columns, x, y].map(|n| n as usize / 4);
        let rows = if self.is_compressed() { 1 } else { 4 };
        let length = self.block_bytes() / rows;
        (0..rows).map(move |row| {
            let first = ((y * rows + row) * columns + x) * length;
            first..first + length
        })
    }

    /// Channels it stores: 1, 2 or 4. Missing ones read as `0, 0, 1` (green, blue, alpha).
    pub const fn channel_count(self) -> usize {
        match self {
            Self::Bc4 | Self::R8 => 1,
            Self::Bc5 | Self::Rg8 => 2,
            Self::Bc1 | Self::Bc7 | Self::Rgba8 | Self::Rgba32F => 4,
        }
    }
}

/// One material channel of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it means.
    pub kind: ChannelKind,
    /// How its texels are stored.
    pub format: TexelFormat,
    /// True where the stored numbers are sRGB-encoded (alpha never is). Only formats of four channels can be.
    pub srgb: bool,
}

const FLAG_SRGB: u8 = 1;

pub(crate) fn check_channels(channels: &[Channel]) -> Result<()> {
    if channels.len() > MAX_CHANNELS {
        return Err(too_many("channels", channels.len() as u64, MAX_CHANNELS as u64));
    }
    if channels.is_empty() {
        return Err(wrong_count("channels", 1, 0));
    }
    match channels.iter().position(|c| c.srgb && c.format.channel_count() < 4) {
        Some(channel) => Err(Error::malformed(format!(
            "channel {channel} is sRGB-encoded, which formats of one or two channels cannot be"
        ))),
        None => Ok(()),
    }
}

pub(crate) fn encode_channels(channels: &[Channel]) -> Vec<u8> {
    let mut out = ByteWriter::default();
    out.u32(channels.len() as u32);
    for channel in channels {
        out.u8(code(&ChannelKind::ALL, channel.kind));
        out.u8(code(&TexelFormat::ALL, channel.format));
        out.u8(if channel.srgb { FLAG_SRGB } else { 0 });
        out.u8(0);
    }
    out.bytes
}

pub(crate) fn decode_channels(bytes: &[u8]) -> Result<Vec<Channel>> {
    let mut input = ByteReader::new(bytes);
    let count = input.count(MAX_CHANNELS, "channels")?;
    let mut channels = Vec::with_capacity(count);
    for index in 0..count {
        let kind = decoded(&ChannelKind::ALL, input.u8("a channel")?, "kind of channel", index)?;
        let format = decoded(&TexelFormat::ALL, input.u8("a channel")?, "format of channel", index)?;
        let flags = decoded(&[0, FLAG_SRGB], input.u8("a channel")?, "flags of channel", index)?;
        decoded(&[0], input.u8("a channel")?, "reserved byte of channel", index)?;
        channels.push(Channel { kind, format, srgb: flags == FLAG_SRGB });
    }
    input.end()?;
    check_channels(&channels)?;
    Ok(channels)
}

fn code<T: PartialEq>(all: &[T], item: T) -> u8 {
    all.iter().position(|x| *x == item).unwrap_or(0) as u8
}

fn decoded<T: Copy>(all: &[T], code: u8, what: &'static str, index: usize) -> Result<T> {
    all.get(usize::from(code)).copied().ok_or(out_of_range(what, index, u64::from(code), all.len() as u64))
}
