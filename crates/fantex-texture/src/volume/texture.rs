//! A filtered volume.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use super::{Volume, levels};
use crate::filter::{Kernel, Reconstruction, Taps, TexelSource, resolve, with_samples};
use crate::{AlphaUse, Filtering, ShadingPoint, Texture, Wrap};

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
        let coarser = levels::build(&base, alpha);
        Self { base, coarser, alpha }
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

    /// Voxels along each axis of level 0.
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
