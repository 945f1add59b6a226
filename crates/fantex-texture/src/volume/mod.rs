//! Three-dimensional textures: measured volumes and stacks of images.
//!
//! A volume fills the unit cube: voxel `i` of an axis with `n` has its centre at `(i + 1/2) / n`. Where the cube stands in an
//! object's space is said by a [`SpaceMatrix`](crate::coordinates::SpaceMatrix) around the look-up
//! ([`InSpace`](crate::coordinates::InSpace)).

mod file;

use std::sync::Arc;

use fantex_base::input::{Held, hold};
use fantex_base::{Error, Result, counted};
use glam::{Vec3, Vec4};

use crate::color::unorm16;
use crate::filter::{
    Kernel, Overlap, Reconstruction, Taps, TexelSource, filled_rows, halved_axis, resolve, stored_channels,
    with_samples,
};
use crate::{AlphaUse, ColorSpace, Depth, Filtering, Image, Samples, ShadingPoint, Texture, Wrap};

pub use self::file::{ByteOrder, RawLayout};

/// The longest side of a volume, in voxels.
pub const MAX_VOLUME_SIDE: u32 = 65_536;

/// A discrete three-dimensional texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    size: [u32; 3],
    channels: u8,
    space: ColorSpace,
    samples: Samples,
    spacing: Vec3,
}

impl Volume {
    /// A volume of `size[0] * size[1] * size[2]` voxels with 1 (grey), 2 (grey + alpha), 3 (RGB) or 4 (RGBA) channels:
    /// x fastest, then y, then z, channels interleaved. `space` is the encoding of the colour channels; floats that are
    /// encoded in sRGB are decoded at every look-up.
    ///
    /// # Errors
    /// A side is 0 or above [`MAX_VOLUME_SIDE`], the channels are not 1 to 4, or the samples do not fit the size.
    pub fn new(size: [u32; 3], channels: u8, space: ColorSpace, samples: Samples) -> Result<Self> {
        let expected = checked_samples(size, channels)?;
        if samples.len() as u64 != expected {
            let ([x, y, z], got) = (size, samples.len());
            let (channels, expected) = (counted(channels, "channel"), counted(expected, "number"));
            return Err(Error::invalid(format!(
                "a volume of {x} x {y} x {z} voxels with {channels} takes {expected}, not {got}"
            )));
        }
        Ok(Self { size, channels, space, samples, spacing: Vec3::ONE })
    }

    /// A stack of images of one size and kind, the first at the lowest z; row 0 of an image lies at the lowest y.
    ///
    /// # Errors
    /// There is no image, one differs from the first, or a side is too long.
    pub fn from_slices(slices: &[Image]) -> Result<Self> {
        let first = slices.first().ok_or_else(|| Error::invalid("a volume needs at least one slice"))?;
        let kind =
            |image: &Image| (image.width, image.height, image.channels, image.space, image.samples.depth());
        if let Some(index) = slices.iter().position(|slice| kind(slice) != kind(first)) {
            return Err(Error::invalid(format!(
                "slice {index} of the volume differs from slice 0 in size, channels or depth; all must be equal"
            )));
        }
        let size = [first.width, first.height, u32::try_from(slices.len()).unwrap_or(u32::MAX)];
        checked_samples(size, first.channels)?;
        macro_rules! joined {
            ($variant:ident) => {
                Samples::$variant(
                    slices
                        .iter()
                        .flat_map(|slice| match &slice.samples {
                            Samples::$variant(values) => values.as_slice(),
                            _ => &[],
                        })
                        .copied()
                        .collect(),
                )
            };
        }
        let samples = match first.samples.depth() {
            Depth::U8 => joined!(U8),
            Depth::U16 => joined!(U16),
            Depth::F32 => joined!(F32),
        };
        Self::new(size, first.channels, first.space, samples)
    }

    /// The same volume with the distances between voxels, in any unit; all three must be above 0 and finite, others stay
    /// as they were.
    #[must_use]
    pub fn with_spacing(mut self, spacing: Vec3) -> Self {
        if spacing.is_finite() && spacing.min_element() > 0.0 {
            self.spacing = spacing;
        }
        self
    }

    /// Voxels along x, y and z.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// 1 grey, 2 grey + alpha, 3 RGB, 4 RGBA.
    pub fn channels(&self) -> u8 {
        self.channels
    }

    /// Encoding of the colour channels.
    pub fn space(&self) -> ColorSpace {
        self.space
    }

    /// The numbers: x fastest, then y, then z, channels interleaved.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Distances between voxels along x, y and z, in the file's unit; 1 where none was said.
    pub fn spacing(&self) -> Vec3 {
        self.spacing
    }

    /// Size times spacing: the proportions of the volume.
    pub fn extent(&self) -> Vec3 {
        Vec3::from(self.size.map(|n| n as f32)) * self.spacing
    }

    fn has_alpha(&self) -> bool {
        self.channels == 2 || self.channels == 4
    }

    /// Bytes of the samples.
    pub fn byte_len(&self) -> u64 {
        self.samples.len() as u64 * sample_bytes(self.samples.depth())
    }
}

fn sample_bytes(depth: Depth) -> u64 {
    match depth {
        Depth::U8 => 1,
        Depth::U16 => 2,
        Depth::F32 => 4,
    }
}

/// Samples of a volume of this size.
fn checked_samples(size: [u32; 3], channels: u8) -> Result<u64> {
    if size.iter().any(|side| !(1..=MAX_VOLUME_SIDE).contains(side)) || !(1..=4).contains(&channels) {
        let ([x, y, z], channels) = (size, counted(channels, "channel"));
        return Err(Error::too_large(format!(
            "a volume of {x} x {y} x {z} voxels with {channels} is not possible: each side must be 1 to \
             {MAX_VOLUME_SIDE}, the channels 1 to 4"
        )));
    }
    // At most 2^50.
    Ok(size.iter().map(|&side| u64::from(side)).product::<u64>() * u64::from(channels))
}

// ---- Mip levels of volumes, made as those of images: half as many voxels along each axis, rounded down, at least one, each the
// mean over its stretch of the voxels below, in linear light.

/// How the voxels of coarser levels are stored.
fn level_depth(base: Depth) -> Depth {
    if base == Depth::U8 { Depth::U16 } else { Depth::F32 }
}

/// Voxels along each axis of the next coarser level; `None` after a single voxel.
fn next_size(size: [u32; 3]) -> Option<[u32; 3]> {
    (size != [1; 3]).then(|| size.map(|side| (side / 2).max(1)))
}

/// Bytes of a volume with all its levels; saturates.
fn bytes_with_levels(size: [u32; 3], channels: u8, depth: Depth) -> u64 {
    let bytes = |size: [u32; 3], depth| {
        let voxels = size.iter().fold(1_u64, |product, &side| product.saturating_mul(u64::from(side)));
        voxels.saturating_mul(u64::from(channels) * sample_bytes(depth))
    };
    let coarser = std::iter::successors(next_size(size), |&size| next_size(size));
    coarser.map(|size| bytes(size, level_depth(depth))).fold(bytes(size, depth), u64::saturating_add)
}

/// All levels above `base`, down to a single voxel.
fn build(base: &Volume, alpha: AlphaUse) -> Vec<Volume> {
    let depth = level_depth(base.samples.depth());
    let mut levels: Vec<Volume> = Vec::new();
    loop {
        let parent = levels.last().unwrap_or(base);
        let Some(size) = next_size(parent.size) else { return levels };
        let kernel = Halve { parent, size, alpha, depth };
        let samples = with_samples(&parent.samples, parent.channels, parent.space, alpha, kernel);
        let spacing = parent.extent() / Vec3::from(size.map(|side| side as f32));
        let level = Volume { size, channels: parent.channels, space: ColorSpace::Linear, samples, spacing };
        levels.push(level);
    }
}

struct Halve<'a> {
    parent: &'a Volume,
    size: [u32; 3],
    alpha: AlphaUse,
    depth: Depth,
}

impl Kernel for Halve<'_> {
    type Output = Samples;

    fn run<T: TexelSource>(self, voxels: T) -> Samples {
        let [columns, rows, slices] = self.parent.size.map(halved_axis);
        let [parent_width, parent_height, _] = self.parent.size.map(|side| side as usize);
        let channels = usize::from(self.parent.channels);
        let voxel = |slice: &Overlap, row: &Overlap, column: &Overlap| {
            let mut sum = Vec4::ZERO;
            for (z, slice_weight) in slice.parents() {
                for (y, row_weight) in row.parents() {
                    let first = (z * parent_height + y) * parent_width;
                    for (x, weight) in column.parents() {
                        sum += voxels.fetch(first + x) * (slice_weight * row_weight * weight);
                    }
                }
            }
            stored_channels(resolve(sum, self.alpha), channels)
        };
        debug_assert_eq!(self.size.map(|side| side as usize), [columns.len(), rows.len(), slices.len()]);
        // All rows of all slices.
        let (len, count) = (columns.len() * channels, slices.len() * rows.len());
        let row = |index: usize| {
            let (slice, row) = (&slices[index / rows.len()], &rows[index % rows.len()]);
            let voxel = &voxel;
            columns.iter().flat_map(move |column| voxel(slice, row, column).into_iter().take(channels))
        };
        match self.depth {
            Depth::U16 => Samples::U16(filled_rows(len, count, &|index, out| {
                out.iter_mut().zip(row(index)).for_each(|(out, value)| *out = unorm16(value));
            })),
            _ => Samples::F32(filled_rows(len, count, &|index, out| {
                out.iter_mut().zip(row(index)).for_each(|(out, value)| *out = value);
            })),
        }
    }
}

// ---- A filtered volume.

/// Reconstruction and anti-aliasing of a look-up in a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum VolumeFilter {
    /// The nearest voxel of level 0.
    Nearest,
    /// Eight voxels of level 0.
    Linear,
    /// Eight voxels of each of two levels, by the longer axis of the footprint.
    #[default]
    Mipmapped,
}

/// Options of a look-up in a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VolumeOptions {
    /// Along x, y and z.
    pub wrap: [Wrap; 3],
    /// Reconstruction and anti-aliasing.
    pub filter: VolumeFilter,
}

impl Default for VolumeOptions {
    /// Edge voxels go on outside; filtered by levels.
    fn default() -> Self {
        Self { wrap: [Wrap::Clamp; 3], filter: VolumeFilter::default() }
    }
}

/// A volume with its mip levels.
#[derive(Clone, Debug)]
pub struct VolumeTexture {
    base: Arc<Volume>,
    /// Level 1 and up.
    coarser: Vec<Volume>,
    alpha: AlphaUse,
    /// All levels, in the budget for input.
    _held: Held,
}

/// Most cells along an edge of the footprint in a mean over it.
const MAX_CELLS: f32 = 16.0;

impl VolumeTexture {
    /// Builds the mip levels; alpha, if there is any, is the coverage of a voxel.
    pub fn new(base: Arc<Volume>) -> Self {
        Self::with_alpha_use(base, AlphaUse::Coverage)
    }

    /// Builds the mip levels; `alpha` says whether every filter weights a voxel's colour by its alpha.
    pub fn with_alpha_use(base: Arc<Volume>, alpha: AlphaUse) -> Self {
        let alpha = if base.has_alpha() { alpha } else { AlphaUse::Independent };
        let coarser = build(&base, alpha);
        let bytes = bytes_with_levels(base.size, base.channels, base.samples.depth());
        Self { base, coarser, alpha, _held: hold(bytes) }
    }

    /// Levels, at least 1.
    pub fn level_count(&self) -> usize {
        1 + self.coarser.len()
    }

    /// A level: 0 is the volume itself, the last has one voxel.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, level: usize) -> &Volume {
        if level == 0 { &self.base } else { &self.coarser[level - 1] }
    }

    /// Bytes of all levels.
    pub fn byte_len(&self) -> u64 {
        self.base.byte_len() + self.coarser.iter().map(Volume::byte_len).sum::<u64>()
    }

    /// Filtered linear RGBA (straight alpha; grey volumes give r = g = b, volumes without alpha give 1) at `p`, in `[0,1]`
    /// along each axis; `steps` is its change along the footprint's edges.
    pub fn sample(&self, p: Vec3, steps: [Vec3; 2], options: &VolumeOptions) -> Vec4 {
        let sum = match options.filter {
            VolumeFilter::Nearest => self.reconstructed::<1>(0, p, options.wrap),
            VolumeFilter::Linear => self.reconstructed::<2>(0, p, options.wrap),
            VolumeFilter::Mipmapped => self.mipmapped(p, options.wrap, self.width_voxels(steps)),
        };
        Vec4::from_array(resolve(sum, self.alpha))
    }

    /// The mean linear RGBA over the parallelogram around `p` with the edges `steps`: in cells as wide as half the shorter
    /// edge, but not below a voxel, at most sixteen along an edge.
    pub fn sample_area(&self, p: Vec3, steps: [Vec3; 2], options: &VolumeOptions) -> Vec4 {
        if options.filter == VolumeFilter::Nearest {
            return self.sample(p, steps, options);
        }
        let voxels = self.voxels();
        let [a, b] = steps.map(|step| (step * voxels).length());
        let width = (0.5 * a.min(b)).max(a.max(b) / MAX_CELLS).max(1.0);
        let [columns, rows] = [a, b].map(|edge| (edge / width).ceil().clamp(1.0, MAX_CELLS));
        let mut sum = Vec4::ZERO;
        for row in 0..rows as u32 {
            for column in 0..columns as u32 {
                let along = (column as f32 + 0.5) / columns - 0.5;
                let down = (row as f32 + 0.5) / rows - 0.5;
                sum += self.mipmapped(p + steps[0] * along + steps[1] * down, options.wrap, width);
            }
        }
        Vec4::from_array(resolve(sum / (columns * rows), self.alpha))
    }

    fn voxels(&self) -> Vec3 {
        Vec3::from(self.base.size.map(|side| side as f32))
    }

    /// The longer axis of the ellipse into which the footprint maps a circle, in voxels: the larger singular value.
    fn width_voxels(&self, steps: [Vec3; 2]) -> f32 {
        let [a, b] = steps.map(|step| step * self.voxels());
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        (0.5 * (aa + bb) + (0.5 * (aa - bb)).hypot(ab)).sqrt()
    }

    fn mipmapped(&self, p: Vec3, wrap: [Wrap; 3], width_voxels: f32) -> Vec4 {
        let last = self.coarser.len();
        // A NaN is no width.
        let lod = if width_voxels > 1.0 { width_voxels.log2().min(last as f32) } else { 0.0 };
        let (fine, share) = (lod as usize, lod.fract());
        let value = self.reconstructed::<2>(fine, p, wrap);
        if share == 0.0 {
            return value;
        }
        value.lerp(self.reconstructed::<2>(fine + 1, p, wrap), share)
    }

    fn reconstructed<const N: usize>(&self, level: usize, p: Vec3, wrap: [Wrap; 3]) -> Vec4
    where
        Taps<N>: Reconstruction,
    {
        let volume = self.level(level);
        let taps = std::array::from_fn(|axis| Taps::at(p[axis], volume.size[axis], wrap[axis]));
        let kernel = TensorProduct { size: volume.size, taps };
        with_samples(&volume.samples, volume.channels, volume.space, self.alpha, kernel)
    }
}

/// The weighted sum over the tensor product of three axes' taps.
struct TensorProduct<const N: usize> {
    size: [u32; 3],
    taps: [Taps<N>; 3],
}

impl<const N: usize> Kernel for TensorProduct<N> {
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, voxels: T) -> Vec4 {
        let [x, y, z] = self.taps;
        let [width, height, _] = self.size.map(|side| side as usize);
        let mut sum = Vec4::ZERO;
        for (slice, slice_weight) in z.pairs() {
            for (row, row_weight) in y.pairs() {
                let first = (slice * height + row) * width;
                let mut row_sum = Vec4::ZERO;
                for (column, weight) in x.pairs() {
                    row_sum += voxels.fetch(first + column) * weight;
                }
                sum += row_sum * (slice_weight * row_weight);
            }
        }
        sum
    }
}

/// A volume in space, looked up at the position of the surface point: the volume fills the cube from (0, 0, 0) to
/// (1, 1, 1).
#[derive(Clone, Debug)]
pub struct VolumeLookup {
    /// The volume.
    pub texture: Arc<VolumeTexture>,
    /// Wrap modes and filter.
    pub options: VolumeOptions,
}

impl Texture for VolumeLookup {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        match at.filtering {
            Filtering::Own => self.texture.sample(at.position, at.position_steps, &self.options),
            Filtering::Area => self.texture.sample_area(at.position, at.position_steps, &self.options),
        }
    }
}
