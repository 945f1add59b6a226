//! Filtered look-ups in one tile: which levels, how many probes, how they combine.
//!
//! The same rules as for images (`fantex_texture::ImageTexture`), so that a baked surface looks as sharp as its source.
//! Two things differ. A level of a tile is not exactly half the finer one (extents are rounded to multiples of four), so
//! the footprint is measured in each level's own texels. And nothing lies outside a tile: look-ups end at its border.

use fantex_cover::Group;
use fantex_texture::filter::{
    EWA_MINOR_TEXELS, FootprintAxes, MAX_ANISOTROPY, WeightedEllipse, catmull_rom_weights, log2,
};
use fantex_texture::{Filter, FilterOptions};
use glam::{Vec2, Vec4};

use super::{TileSource, TileTexels};
use crate::TileId;

/// A look-up in one tile, planned once for all channels.
#[derive(Clone, Copy, Debug)]
pub struct TileLookup {
    /// The group, and the finer level; the one after it (after the last: the group's mean) has the share `coarse_share`.
    fine: TileId,
    coarse_share: f32,
    level_count: u32,
    uv: Vec2,
    footprint: [Vec2; 2],
    filter: Filter,
    /// Probes and the way, in tile coordinates, that they are spread over.
    pub(super) probes: u32,
    pub(super) span: Vec2,
}

impl TileLookup {
    /// Plans the look-up at `uv` with derivatives `footprint` per pixel, in tile coordinates. A derivative that is no number counts as none.
    #[inline]
    pub fn new(
        group_index: u32,
        group: &Group,
        uv: Vec2,
        footprint: [Vec2; 2],
        options: &FilterOptions,
    ) -> Self {
        let footprint = footprint.map(bounded);
        let mut plan = Self {
            fine: TileId { group: group_index, level: 0 },
            coarse_share: 0.0,
            level_count: group.level_count(),
            uv,
            footprint,
            filter: options.filter,
            probes: 1,
            span: Vec2::ZERO,
        };
        let anisotropy = options.max_anisotropy;
        let finest = || axes(footprint, group.extent);
        let squared_minor = |level: u32| squared_minor(footprint, group.level_extent(level), anisotropy);
        match options.filter {
            Filter::Nearest | Filter::Bilinear | Filter::Bicubic => {}
            Filter::BicubicMipmaps | Filter::Trilinear => {
                plan.choose_levels(|level| squared_major(footprint, group.level_extent(level)));
            }
            Filter::Anisotropic => {
                plan.choose_levels(squared_minor);
                let finest = finest();
                let width = finest.limited_minor(anisotropy).max(1.0);
                plan.probes = (finest.major / width).ceil().clamp(1.0, MAX_ANISOTROPY) as u32;
                plan.span = finest.direction * finest.major / texels(group.extent);
            }
            Filter::Ewa => {
                plan.choose_levels(|level| squared_minor(level) / EWA_MINOR_TEXELS.powi(2));
                let finest = finest().limited(anisotropy);
                plan.footprint = finest.vectors().map(|axis| axis / texels(group.extent));
            }
        }
        plan
    }

    /// Chooses the levels between which the pixel is one texel wide. `squared_width` is the square of the pixel's width in texels of a
    /// level, which does not grow with the level.
    fn choose_levels(&mut self, squared_width: impl Fn(u32) -> f32) {
        let mut here = squared_width(0);
        if here <= 1.0 || here.is_nan() {
            return;
        }
        // Levels are about half as long as the one before: the search starts near its end. (The exponent of a number above 1.)
        let whole_log2 = (here.to_bits() >> 23) - 127;
        let guess = (whole_log2 / 2).saturating_sub(1).min(self.level_count - 1);
        if guess > 0 {
            let there = squared_width(guess);
            if there > 1.0 {
                (self.fine.level, here) = (guess, there);
            }
        }
        loop {
            let is_last = self.coarse().is_none();
            let next = if is_last { here / 16.0 } else { squared_width(self.fine.level + 1) };
            if next <= 1.0 || is_last {
                self.coarse_share = (log2(here) / log2(here / next)).clamp(0.0, 1.0);
                return;
            }
            self.fine.level += 1;
            here = next;
        }
    }

    /// The finer of the two levels that it reads, and the share of the one after it; after the last one comes the group's mean.
    pub fn levels(&self) -> (u32, f32) {
        (self.fine.level, self.coarse_share)
    }

    /// The coarser level; none after the last.
    fn coarse(&self) -> Option<TileId> {
        let level = self.fine.level + 1;
        (level < self.level_count).then_some(TileId { level, ..self.fine })
    }

    /// Linear RGBA of a channel.
    #[inline]
    pub fn sample<S: TileSource>(&self, tiles: &S, channel: usize) -> Vec4 {
        let at_level = |id| {
            if self.probes == 1 && Self::has_probes(self.filter) {
                return Vec4::from_array(tiles.bilinear(channel, id, self.uv));
            }
            self.in_tile(&tiles.tile(channel, id))
        };
        let value = at_level(self.fine);
        if self.coarse_share == 0.0 {
            return value;
        }
        let coarse = match self.coarse() {
            Some(id) => at_level(id),
            None => Vec4::from_array(tiles.mean(channel, self.fine.group)),
        };
        value.lerp(coarse, self.coarse_share)
    }

    /// Whether look-ups by a filter consist of bilinear probes.
    pub(super) fn has_probes(filter: Filter) -> bool {
        matches!(filter, Filter::Bilinear | Filter::Trilinear | Filter::Anisotropic)
    }

    pub(super) fn probe(&self, number: u32) -> Vec2 {
        let along = (number as f32 + 0.5) / self.probes as f32 - 0.5;
        self.uv + self.span * along
    }

    #[inline]
    fn in_tile<T: TileTexels>(&self, tile: &T) -> Vec4 {
        match self.filter {
            Filter::Nearest => nearest(tile, self.uv),
            Filter::Bicubic | Filter::BicubicMipmaps => bicubic(tile, self.uv),
            Filter::Ewa => ewa(tile, self.uv, self.footprint),
            Filter::Bilinear | Filter::Trilinear | Filter::Anisotropic => {
                let probe = |i| Vec4::from_array(tile.bilinear(self.probe(i)));
                (0..self.probes).map(probe).sum::<Vec4>() / self.probes as f32
            }
        }
    }
}

/// Tiles along a footprint: what is longer sees the mean, too, and fourth powers of this in texels are still numbers.
pub(super) const MAX_FOOTPRINT: f32 = (1 << 14) as f32;

fn bounded(derivative: Vec2) -> Vec2 {
    let bounded = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(-MAX_FOOTPRINT, MAX_FOOTPRINT) };
    Vec2::from(derivative.to_array().map(bounded))
}

/// Columns and rows.
fn texels(extent: [u32; 2]) -> Vec2 {
    Vec2::from(extent.map(|n| n as f32))
}

/// The square of the longer axis, in texels, of a footprint in tile coordinates.
#[inline]
fn squared_major(footprint: [Vec2; 2], extent: [u32; 2]) -> f32 {
    let [dx, dy] = footprint.map(|d| d * texels(extent));
    FootprintAxes::squared_major(dx, dy)
}

/// The square of the shorter one, as far as it is widened.
#[inline]
fn squared_minor(footprint: [Vec2; 2], extent: [u32; 2], max_anisotropy: f32) -> f32 {
    let [dx, dy] = footprint.map(|d| d * texels(extent));
    FootprintAxes::squared_limited_minor(dx, dy, max_anisotropy)
}

/// The axes, in texels, of a footprint in tile coordinates.
fn axes(footprint: [Vec2; 2], extent: [u32; 2]) -> FootprintAxes {
    let [dx, dy] = footprint.map(|d| d * texels(extent));
    FootprintAxes::new(dx, dy)
}

/// A texel, clamped to the tile.
fn clamped<T: TileTexels>(tile: &T, x: i32, y: i32) -> Vec4 {
    let [columns, rows] = tile.extent().map(|n| n as i32);
    Vec4::from_array(tile.texel(x.clamp(0, columns - 1) as u32, y.clamp(0, rows - 1) as u32))
}

/// Position in texels, texel `i` having its centre at `i`; held near the tile.
fn texel_position<T: TileTexels>(tile: &T, uv: Vec2) -> Vec2 {
    let extent = texels(tile.extent());
    (uv * extent - 0.5).clamp(Vec2::ZERO, extent - 1.0)
}

fn nearest<T: TileTexels>(tile: &T, uv: Vec2) -> Vec4 {
    let p = texel_position(tile, uv).round();
    clamped(tile, p.x as i32, p.y as i32)
}

fn bicubic<T: TileTexels>(tile: &T, uv: Vec2) -> Vec4 {
    let p = texel_position(tile, uv);
    let first = p.floor();
    let (wx, wy) = (catmull_rom_weights(p.x - first.x), catmull_rom_weights(p.y - first.y));
    let mut sum = Vec4::ZERO;
    for (j, wy) in wy.into_iter().enumerate() {
        for (i, wx) in wx.into_iter().enumerate() {
            let texel = clamped(tile, first.x as i32 + i as i32 - 1, first.y as i32 + j as i32 - 1);
            sum += texel * (wx * wy);
        }
    }
    sum
}

/// The elliptical weighted average of the texels under a footprint.
fn ewa<T: TileTexels>(tile: &T, uv: Vec2, footprint: [Vec2; 2]) -> Vec4 {
    let extent = tile.extent();
    let axes = axes(footprint, extent);
    // What lies farther away than the tile is long would only repeat its border.
    let longest = extent[0].max(extent[1]) as f32;
    let axes = FootprintAxes { major: axes.major.min(longest), minor: axes.minor.min(longest), ..axes };
    let (mut sum, mut total) = (Vec4::ZERO, 0.0);
    for row in WeightedEllipse::new(texel_position(tile, uv), &axes).rows() {
        for (column, weight) in row.weights() {
            sum += clamped(tile, column, row.row) * weight;
            total += weight;
        }
    }
    if total > 0.0 { sum / total } else { nearest(tile, uv) }
}
