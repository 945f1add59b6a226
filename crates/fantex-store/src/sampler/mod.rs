//! The texture function: from a point of the surface to filtered values.
//!
//! ```text
//!  SurfacePoint --Cover::taps--> group, weight, tile coordinates   (one to three)
//!                                  | footprint --TileLookup--> levels, probes
//!                                  v
//!                 TileSource --tile(channel, group, level)--> TileTexels --filter--> linear RGBA
//!                                  |
//!                                  v  normals and stretches from their tile's frame into mesh space
//!                               weighted sum
//! ```
//!
//! A [`Sampler`] owns what it reads, so it can be kept, and used by many threads. The way of single points is the reference; that
//! of many (`batch`) differs from it by at most 1e-5.

mod batch;
mod levels;
mod lookup;
mod pages;

use std::sync::{Arc, OnceLock};

use fantex_base::{Error, Result};
use fantex_cover::{Cover, Tap, stretch_axes};
use fantex_mesh::{Mesh, SurfacePoint, shading_normals};
use fantex_texture::FilterOptions;
use fantex_texture::filter::TexelGrid;
use glam::{Vec2, Vec3, Vec4};

pub use batch::ManyValues;
pub use lookup::TileLookup;

use crate::{Channel, ChannelKind, PageCache, TileId};

/// Something that has the tiles of a cover: an asset's cache, tiles in memory, or a cache with changes that are not committed.
pub trait TileSource: Sync {
    /// A handle to one tile at one level.
    type Tile: TileTexels;

    /// The tile of a group at a level of [`Group::level_count`](fantex_cover::Group::level_count), or a coarser one in its place.
    fn tile(&self, channel: usize, id: TileId) -> Self::Tile;

    /// The tile for look-ups whose texels all lie in one of its pages, by column and row.
    fn tile_at_page(&self, channel: usize, id: TileId, _page: [u32; 2]) -> Self::Tile {
        self.tile(channel, id)
    }

    /// One bilinear look-up in a tile, as [`TileTexels::bilinear`] makes it.
    fn bilinear(&self, channel: usize, id: TileId, uv: Vec2) -> [f32; 4] {
        self.tile(channel, id).bilinear(uv)
    }

    /// Mean linear RGBA of a group.
    fn mean(&self, channel: usize, group: u32) -> [f32; 4];
}

/// Texels of one tile at one level, **linear** RGBA.
pub trait TileTexels {
    /// Columns and rows.
    fn extent(&self) -> [u32; 2];

    /// Bilinear look-up at tile coordinates, clamped half a texel inside the tile.
    fn bilinear(&self, uv: Vec2) -> [f32; 4];

    /// The texel at a column and row of the tile.
    fn texel(&self, x: u32, y: u32) -> [f32; 4];

    /// The stored texels of the tile's only page, or of the one it was asked for, where they are of a kind that can be looked up many
    /// at once. That differs from [`TileTexels::bilinear`] by at most 1e-5.
    fn grid(&self) -> Option<TexelGrid<'_>> {
        None
    }
}

impl<S: TileSource + ?Sized> TileSource for &S {
    type Tile = S::Tile;

    fn tile(&self, channel: usize, id: TileId) -> Self::Tile {
        (**self).tile(channel, id)
    }

    fn tile_at_page(&self, channel: usize, id: TileId, page: [u32; 2]) -> Self::Tile {
        (**self).tile_at_page(channel, id, page)
    }

    fn bilinear(&self, channel: usize, id: TileId, uv: Vec2) -> [f32; 4] {
        (**self).bilinear(channel, id, uv)
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        (**self).mean(channel, group)
    }
}

/// The part of the surface that a sample stands for: the parallelogram of two changes of the barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Change of the barycentric coordinates along each edge, as from one pixel to the next; the sum of each is zero.
    pub lambda_steps: [Vec3; 2],
}

impl Footprint {
    /// A point: the finest level is read.
    pub const NONE: Self = Self { lambda_steps: [Vec3::ZERO; 2] };
}

/// A point to sample, with what its values depend on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplePoint {
    /// Where.
    pub point: SurfacePoint,
    /// What it stands for.
    pub footprint: Footprint,
    /// The interpolated unit vertex normal there ([`Sampler::vertex_normal`]), from which stored normals and stretches deviate.
    pub vertex_normal: Vec3,
}

/// The values of all channels that renderers use; zero where an asset has no such channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceValues {
    /// Colour and opacity.
    pub base_color: Vec4,
    /// Unit shading normal, mesh space, on the front; the vertex normal without a channel.
    pub normal: Vec3,
    /// Occlusion, perceptual roughness, metallic.
    pub occlusion_roughness_metallic: Vec4,
    /// Emitted light.
    pub emission: Vec4,
    /// Light that arrives.
    pub light: Vec4,
    /// How highlights are stretched; none without a channel.
    pub stretch: Option<Stretch>,
    /// Look-ups in tiles that this took, over all channels.
    pub lookups: u32,
}

/// How a highlight is stretched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Unit vector in the surface along which it is long, mesh space.
    pub direction: Vec3,
    /// 0 to 1.
    pub strength: f32,
}

/// The channels of [`SurfaceValues`].
const VALUE_KINDS: [ChannelKind; 6] = [
    ChannelKind::BaseColor,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Normal,
    ChannelKind::Light,
    ChannelKind::Anisotropy,
];

/// Filtered look-ups in the texture function of a mesh with a cover and tiles.
///
/// Values are **linear** RGBA. Of the channel [`ChannelKind::Normal`] the first three are the unit normal in mesh space, of
/// [`ChannelKind::Anisotropy`] the unit direction in mesh space along which a highlight is long, then its strength from 0 to 1.
#[derive(Clone, Debug)]
pub struct Sampler<S = PageCache> {
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
    channels: Arc<[Channel]>,
    tiles: S,
    filter: FilterOptions,
    /// The channels of [`VALUE_KINDS`].
    value_channels: [Option<usize>; VALUE_KINDS.len()],
    /// Per corner; made when they are first asked for.
    normals: OnceLock<Arc<[Vec3]>>,
}

impl Sampler {
    /// Samples an asset through its cache, and shares that.
    pub fn of_cache(cache: &PageCache, filter: FilterOptions) -> Self {
        let asset = cache.asset();
        Self::new(asset.shared_mesh(), asset.shared_cover(), asset.channels(), cache.clone(), filter)
    }

    /// The cache.
    pub fn cache(&self) -> &PageCache {
        &self.tiles
    }
}

impl<S: TileSource> Sampler<S> {
    /// Samples a mesh with a cover whose tiles have these channels.
    pub fn new(
        mesh: Arc<Mesh>,
        cover: Arc<Cover>,
        channels: &[Channel],
        tiles: S,
        filter: FilterOptions,
    ) -> Self {
        let value_channels = VALUE_KINDS.map(|kind| channels.iter().position(|c| c.kind == kind));
        let (channels, normals) = (channels.into(), OnceLock::new());
        Self { mesh, cover, channels, tiles, filter, value_channels, normals }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// The cover.
    pub fn cover(&self) -> &Arc<Cover> {
        &self.cover
    }

    /// The channels.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The tiles.
    pub fn tiles(&self) -> &S {
        &self.tiles
    }

    /// How it filters.
    pub fn filter(&self) -> FilterOptions {
        self.filter
    }

    /// Whether there is a channel of a kind.
    pub fn has(&self, kind: ChannelKind) -> bool {
        self.channels.iter().any(|channel| channel.kind == kind)
    }

    /// The interpolated unit vertex normal at a point, on the triangle's front.
    pub fn vertex_normal(&self, point: SurfacePoint) -> Vec3 {
        let normals = self.normals.get_or_init(|| shading_normals(&self.mesh).into());
        point.smooth_normal(normals).unwrap_or_else(|| facet_normal(&self.mesh, point))
    }

    /// The value of a channel at a point of the surface.
    ///
    /// # Errors
    /// There is no channel of that kind, or no such triangle.
    pub fn sample(&self, kind: ChannelKind, point: SurfacePoint, footprint: Footprint) -> Result<Vec4> {
        let channel = self.channel(kind)?;
        self.check(point)?;
        Ok(self.sample_channel(channel, point, footprint))
    }

    /// The values of a channel at many points, within 1e-5 of those that [`sample`](Self::sample) gives (of normals: before they
    /// are brought to unit length); faster where points lie beside each other.
    ///
    /// # Errors
    /// There is no channel of that kind, or no such triangle.
    pub fn sample_many(&self, kind: ChannelKind, points: &[(SurfacePoint, Footprint)]) -> Result<Vec<Vec4>> {
        let channel = self.channel(kind)?;
        points.iter().try_for_each(|&(point, _)| self.check(point))?;
        Ok(self.sample_channel_many(channel, points))
    }

    /// As [`sample`](Self::sample), of a channel given by its index.
    ///
    /// # Panics
    /// If there is no such channel or triangle.
    pub fn sample_channel(&self, channel: usize, point: SurfacePoint, footprint: Footprint) -> Vec4 {
        let kind = self.channels[channel].kind;
        let vertex_normal = self.vertex_normal_for(kind, point);
        let mut sum = Vec4::ZERO;
        for tap in self.taps(point) {
            let stored = self.lookup(&tap, footprint).sample(&self.tiles, channel);
            sum += self.in_mesh_space(kind, stored, tap.group, vertex_normal) * tap.weight;
        }
        value_of_sum(kind, sum, vertex_normal)
    }

    /// A point with its vertex normal.
    pub fn sample_point(&self, point: SurfacePoint, footprint: Footprint) -> SamplePoint {
        SamplePoint { point, footprint, vertex_normal: self.vertex_normal(point) }
    }

    /// The values of all channels that renderers use.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn values(&self, at: &SamplePoint) -> SurfaceValues {
        let (mut sums, mut lookups) = ([Vec4::ZERO; VALUE_KINDS.len()], 0);
        for tap in self.taps(at.point) {
            let lookup = self.lookup(&tap, at.footprint);
            for (place, &channel) in self.value_channels.iter().enumerate() {
                let Some(channel) = channel else { continue };
                let stored = lookup.sample(&self.tiles, channel);
                sums[place] +=
                    self.in_mesh_space(VALUE_KINDS[place], stored, tap.group, at.vertex_normal) * tap.weight;
                lookups += 1;
            }
        }
        self.values_of_sums(&sums, at.vertex_normal, lookups)
    }

    /// The look-ups of the texture function at a point, in tiles of [`tiles`](Self::tiles).
    #[inline]
    pub fn taps(&self, point: SurfacePoint) -> impl ExactSizeIterator<Item = Tap> {
        self.cover.taps(&self.mesh, point)
    }

    /// The filtered look-up that a tap stands for.
    #[inline]
    pub fn lookup(&self, tap: &Tap, footprint: Footprint) -> TileLookup {
        let group = &self.cover.groups[tap.group as usize];
        let steps = tap.steps(footprint.lambda_steps);
        TileLookup::new(tap.group, group, tap.uv, steps, &self.filter)
    }

    fn channel(&self, kind: ChannelKind) -> Result<usize> {
        let channel = self.channels.iter().position(|channel| channel.kind == kind);
        channel.ok_or_else(|| Error::not_found(format!("there is no {kind} channel")))
    }

    fn check(&self, point: SurfacePoint) -> Result<()> {
        let count = self.mesh.triangles.len();
        if (point.triangle as usize) < count {
            return Ok(());
        }
        Err(Error::invalid(format!("there is no triangle {}: the mesh has {count}", point.triangle)))
    }

    /// The vertex normal where values of a kind depend on it.
    fn vertex_normal_for(&self, kind: ChannelKind, point: SurfacePoint) -> Vec3 {
        match kind {
            ChannelKind::Normal | ChannelKind::Anisotropy => self.vertex_normal(point),
            _ => Vec3::ZERO,
        }
    }

    /// A stored value in a form that can be added to those of other tiles: normals in mesh space, stretches relative to
    /// [`stretch_axes`], all else as it is.
    #[inline]
    fn in_mesh_space(&self, kind: ChannelKind, stored: Vec4, group: u32, vertex_normal: Vec3) -> Vec4 {
        let group = || &self.cover.groups[group as usize];
        let pair = Vec2::new(stored.x, stored.y);
        match kind {
            ChannelKind::Normal => group().normal_from_stored(pair, vertex_normal).extend(0.0),
            ChannelKind::Anisotropy => {
                let Vec2 { x, y } = group().stretch_from_stored(pair, vertex_normal);
                Vec4::new(x, y, 0.0, 0.0)
            }
            _ => stored,
        }
    }

    #[inline]
    fn values_of_sums(
        &self,
        sums: &[Vec4; VALUE_KINDS.len()],
        vertex_normal: Vec3,
        lookups: u32,
    ) -> SurfaceValues {
        let [base_color, occlusion_roughness_metallic, emission, normal, light, stretch] = *sums;
        let has_stretch = self.value_channels[5].is_some();
        let stretch = has_stretch.then(|| {
            let value = value_of_sum(ChannelKind::Anisotropy, stretch, vertex_normal);
            Stretch { direction: value.truncate(), strength: value.w }
        });
        let has_normal = self.value_channels[3].is_some();
        let normal = match has_normal {
            true => value_of_sum(ChannelKind::Normal, normal, vertex_normal).truncate(),
            false => vertex_normal,
        };
        SurfaceValues { base_color, normal, occlusion_roughness_metallic, emission, light, stretch, lookups }
    }
}

/// The value of a channel, of the weighted sum of its tiles' values in mesh space.
#[inline]
fn value_of_sum(kind: ChannelKind, sum: Vec4, vertex_normal: Vec3) -> Vec4 {
    match kind {
        ChannelKind::Normal => sum.truncate().try_normalize().unwrap_or(vertex_normal).extend(1.0),
        ChannelKind::Anisotropy => {
            let sum = Vec2::new(sum.x, sum.y);
            let [x, y] = stretch_axes(vertex_normal);
            let (sine, cosine) = (0.5 * sum.to_angle()).sin_cos();
            (x * cosine + y * sine).extend(sum.length().min(1.0))
        }
        _ => sum,
    }
}

/// Unit normal of a triangle's front, whatever its area.
fn facet_normal(mesh: &Mesh, point: SurfacePoint) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(point.triangle as usize).map(|p| p.as_dvec3());
    (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
}
