//! From visible samples to pixel colours.

use glam::{Vec2, Vec3, Vec4};

use crate::fixed::SUBPIXELS;
use crate::hit::{HitFinder, Seen};
use crate::illumination::PreparedLights;
use crate::pattern::{SamplePattern, bits};
use crate::primitive::TILE;
use crate::raster::{Fragment, NO_TRIANGLE, TileSamples};
use crate::shading::evaluate_all;
use crate::sky_box;
use crate::{RenderOptions, ShadingRate, Surface};

/// The finished pixels of a tile.
#[derive(Debug)]
pub(crate) struct PixelColors {
    /// Linear RGB and straight alpha, row-major over the tile's extent.
    pub(crate) rgba: Vec<[f32; 4]>,
    /// Materials evaluated.
    pub(crate) shaded: u64,
    /// Filtered look-ups.
    pub(crate) lookups: u64,
}

/// All that is needed to colour pixels.
pub(crate) struct Resolve<'a> {
    pub(crate) surface: &'a dyn Surface,
    pub(crate) hits: HitFinder<'a>,
    pub(crate) lights: &'a PreparedLights<'a>,
    pub(crate) options: &'a RenderOptions,
    pub(crate) pattern: &'a SamplePattern,
}

/// Samples of a pixel that share one evaluation of the material.
#[derive(Clone, Copy, Debug)]
struct Piece<'a> {
    /// Index in the tile, row-major with stride [`TILE`].
    pixel: u32,
    triangle: u32,
    mask: u64,
    /// Where the triangle lets something through.
    layer: Option<&'a Fragment>,
}

/// Pieces that are shaded together: enough to fill vectors, few enough to stay in the cache.
const AT_ONCE: usize = 128;

impl Resolve<'_> {
    /// Colours a tile. `rect` is its first pixel and extent.
    pub(crate) fn tile(&self, rect: [[u32; 2]; 2], mut visibility: TileSamples) -> PixelColors {
        let [origin, [columns, rows]] = rect;
        let fragments = visibility.take_fragments();
        let pieces = self.pieces([columns, rows], &visibility, &fragments);
        let mut result = PixelColors {
            rgba: Vec::with_capacity((columns * rows) as usize),
            shaded: pieces.len() as u64,
            lookups: 0,
        };
        let colors = self.shade(origin, &pieces, &mut result.lookups);
        let (mut pieces, mut colors) = (pieces.as_slice(), colors.as_slice());
        let (full, mut samples) = (self.pattern.full_mask(), vec![Vec4::ZERO; self.pattern.len()]);
        for y in 0..rows {
            for x in 0..columns {
                let index = y * TILE + x;
                let count = pieces.iter().take_while(|piece| piece.pixel == index).count();
                let own;
                (own, pieces) = pieces.split_at(count);
                let shades;
                (shades, colors) = colors.split_at(count);
                let pixel = [origin[0] + x, origin[1] + y];
                match (own, shades) {
                    ([], _) => {
                        result.rgba.push(straight(self.behind(pixel)));
                        continue;
                    }
                    ([piece], [color]) if piece.layer.is_none() && piece.mask == full => {
                        result.rgba.push(color.truncate().extend(1.0).to_array());
                        continue;
                    }
                    _ => {}
                }
                self.background(pixel, visibility.visible(index), &mut samples);
                for (piece, color) in own.iter().zip(shades).filter(|(piece, _)| piece.layer.is_none()) {
                    bits(piece.mask).for_each(|s| samples[s] = color.truncate().extend(1.0));
                }
                self.layers(pixel, own, shades, &mut samples);
                result.rgba.push(straight(samples.iter().sum::<Vec4>() / samples.len() as f32));
            }
        }
        result
    }

    /// What is to be shaded, pixel by pixel: what is opaque, then the layers.
    fn pieces<'f>(
        &self,
        [columns, rows]: [u32; 2],
        visibility: &TileSamples,
        fragments: &'f [Fragment],
    ) -> Vec<Piece<'f>> {
        let mut pieces = Vec::with_capacity((columns * rows) as usize);
        let mut rest = fragments;
        for y in 0..rows {
            for x in 0..columns {
                let pixel = y * TILE + x;
                let visible = visibility.visible(pixel);
                let mut open = self.pattern.full_mask();
                while open != 0 {
                    let triangle = visible[open.trailing_zeros() as usize];
                    let mask = bits(open).filter(|&s| visible[s] == triangle).fold(0, |m, s| m | 1 << s);
                    open &= !mask;
                    if triangle != NO_TRIANGLE {
                        let parts = self.shading_parts(mask);
                        pieces.extend(parts.map(|mask| Piece { pixel, triangle, mask, layer: None }));
                    }
                }
                let (own, later) = rest.split_at(rest.partition_point(|f| f.pixel <= pixel));
                rest = later;
                for fragment in own {
                    let triangle = fragment.triangle;
                    let parts = self.shading_parts(fragment.mask);
                    pieces.extend(parts.map(|mask| Piece { pixel, triangle, mask, layer: Some(fragment) }));
                }
            }
        }
        pieces
    }

    /// What is seen of a pixel where no triangle is, premultiplied.
    fn behind(&self, pixel: [u32; 2]) -> Vec4 {
        let (projection, ambient) = (self.hits.projection, &self.lights.ambient);
        sky_box::behind(&self.options.background, pixel, self.options, projection, ambient)
    }

    /// Fills the samples that see no triangle.
    fn background(&self, pixel: [u32; 2], visible: &[u32], samples: &mut [Vec4]) {
        if !visible.contains(&NO_TRIANGLE) {
            return;
        }
        let color = self.behind(pixel);
        for (sample, _) in samples.iter_mut().zip(visible).filter(|(_, seen)| **seen == NO_TRIANGLE) {
            *sample = color;
        }
    }

    /// Lays the layers among the pieces of a pixel over its samples, the farthest first.
    fn layers(&self, pixel: [u32; 2], pieces: &[Piece], colors: &[Vec4], samples: &mut [Vec4]) {
        if pieces.last().is_none_or(|piece| piece.layer.is_none()) {
            return;
        }
        let corner = pixel.map(|c| c as i32 * SUBPIXELS);
        for (s, offset) in self.pattern.offsets().iter().enumerate() {
            let position = [corner[0] + offset[0], corner[1] + offset[1]];
            let mut here: Vec<(f32, Vec4)> = pieces
                .iter()
                .zip(colors)
                .filter(|(piece, _)| piece.mask >> s & 1 == 1)
                .filter_map(|(piece, &color)| Some((piece.layer?.nearness.at(position), color)))
                .collect();
            // Stable: of equally near layers the later triangle lies on top.
            here.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, color) in here {
                let premultiplied = (color.truncate() * color.w).extend(color.w);
                samples[s] = premultiplied + samples[s] * (1.0 - color.w);
            }
        }
    }

    /// The sets of samples that share one evaluation of the material.
    fn shading_parts(&self, mask: u64) -> impl Iterator<Item = u64> + use<> {
        let per_sample = self.options.shading_rate == ShadingRate::PerSample;
        let count = if per_sample { mask.count_ones() } else { 1 };
        let mut rest = mask;
        (0..count).map(move |_| {
            let part = if per_sample { 1 << rest.trailing_zeros() } else { mask };
            rest &= !part;
            part
        })
    }

    /// The light from every piece, seen in the middle of its samples, and its opacity; adds the look-ups that it took.
    fn shade(&self, origin: [u32; 2], pieces: &[Piece], lookups: &mut u64) -> Vec<Vec4> {
        let mut colors = Vec::with_capacity(pieces.len());
        let (mut seen, mut hits) = (Vec::with_capacity(AT_ONCE), Vec::with_capacity(AT_ONCE));
        let (mut materials, mut light) = (Vec::with_capacity(AT_ONCE), Vec::with_capacity(AT_ONCE));
        for pieces in pieces.chunks(AT_ONCE) {
            seen.clear();
            hits.clear();
            materials.clear();
            light.clear();
            seen.extend(pieces.iter().map(|piece| self.seen(origin, piece)));
            self.hits.find_all(&seen, &mut hits);
            self.surface.shade_all(&hits, &mut materials);
            let shaded = (hits.as_slice(), materials.as_slice());
            let (shading, finder) = (self.options.shading, &self.hits);
            evaluate_all(shading, shaded, finder, self.surface, self.lights, &mut light);
            for ((material, _), &light) in materials.iter().zip(&light) {
                *lookups += u64::from(material.lookups);
                // One texel that is not a number must not spoil its pixel's other samples.
                let light = if light.is_finite() { light } else { Vec3::ZERO };
                colors.push((light * self.options.exposure).extend(material.alpha.clamp(0.0, 1.0)));
            }
        }
        colors
    }

    /// The middle of a piece's samples, in pixels.
    fn seen(&self, origin: [u32; 2], piece: &Piece) -> Seen {
        let corner = [origin[0] + piece.pixel % TILE, origin[1] + piece.pixel / TILE];
        let corner = Vec2::new(corner[0] as f32, corner[1] as f32);
        (piece.triangle, corner + self.pattern.centroid(piece.mask))
    }
}

/// Straight from premultiplied alpha.
fn straight(premultiplied: Vec4) -> [f32; 4] {
    match premultiplied.w {
        w if w >= 1.0 - 1e-6 => premultiplied.truncate().extend(1.0).to_array(),
        w if w <= 0.0 => [0.0; 4],
        w => (premultiplied.truncate() / w).extend(w).to_array(),
    }
}
