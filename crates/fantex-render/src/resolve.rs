//! From visible samples to pixel colours.

use glam::{Vec2, Vec3, Vec4};

use crate::fixed::SUBPIXELS;
use crate::hit::HitFinder;
use crate::illumination::PreparedLights;
use crate::pattern::{SamplePattern, bits};
use crate::primitive::TILE;
use crate::raster::{Fragment, NO_TRIANGLE, TileSamples};
use crate::shading::evaluate;
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

/// The colours of a pixel's samples (premultiplied) while it is being resolved, and counts.
struct PixelState {
    samples: Vec<Vec4>,
    shaded: u64,
    lookups: u64,
}

impl Resolve<'_> {
    /// Colours a tile. `rect` is its first pixel and extent.
    pub(crate) fn tile(&self, rect: [[u32; 2]; 2], mut visibility: TileSamples) -> PixelColors {
        let [origin, [columns, rows]] = rect;
        let fragments = visibility.take_fragments();
        let mut rest = fragments.as_slice();
        let mut state = PixelState { samples: vec![Vec4::ZERO; self.pattern.len()], shaded: 0, lookups: 0 };
        let mut rgba = Vec::with_capacity((columns * rows) as usize);
        for y in 0..rows {
            for x in 0..columns {
                let index = y * TILE + x;
                let own = rest.partition_point(|f| f.pixel <= index);
                let (layers, later) = rest.split_at(own);
                rest = later;
                let pixel = [origin[0] + x, origin[1] + y];
                self.opaque(pixel, visibility.visible(index), &mut state);
                self.layers(pixel, layers, &mut state);
                rgba.push(straight(state.samples.iter().sum::<Vec4>() / state.samples.len() as f32));
            }
        }
        PixelColors { rgba, shaded: state.shaded, lookups: state.lookups }
    }

    /// Fills the samples with what is opaque, or the background.
    fn opaque(&self, pixel: [u32; 2], visible: &[u32], state: &mut PixelState) {
        let mut open = self.pattern.full_mask();
        while open != 0 {
            let triangle = visible[open.trailing_zeros() as usize];
            let mask = bits(open).filter(|&s| visible[s] == triangle).fold(0, |m, s| m | 1 << s);
            open &= !mask;
            if triangle == NO_TRIANGLE {
                let (projection, ambient) = (self.hits.projection, &self.lights.ambient);
                let color =
                    sky_box::behind(&self.options.background, pixel, self.options, projection, ambient);
                bits(mask).for_each(|s| state.samples[s] = color);
                continue;
            }
            for part in self.shading_parts(mask) {
                let color = self.shade(pixel, triangle, part, state).truncate().extend(1.0);
                bits(part).for_each(|s| state.samples[s] = color);
            }
        }
    }

    /// Lays the fragments of layered triangles over the samples, the farthest first.
    fn layers(&self, pixel: [u32; 2], fragments: &[Fragment], state: &mut PixelState) {
        if fragments.is_empty() {
            return;
        }
        let corner = pixel.map(|c| c as i32 * SUBPIXELS);
        let mut pieces: Vec<(&Fragment, u64, Vec4)> = Vec::new();
        for fragment in fragments {
            for part in self.shading_parts(fragment.mask) {
                pieces.push((fragment, part, self.shade(pixel, fragment.triangle, part, state)));
            }
        }
        for (s, offset) in self.pattern.offsets().iter().enumerate() {
            let position = [corner[0] + offset[0], corner[1] + offset[1]];
            let mut here: Vec<_> = pieces.iter().filter(|p| p.1 >> s & 1 == 1).collect();
            // Stable: of equally near layers the later triangle lies on top.
            here.sort_by(|a, b| a.0.nearness.at(position).total_cmp(&b.0.nearness.at(position)));
            for (_, _, color) in here {
                let premultiplied = (color.truncate() * color.w).extend(color.w);
                state.samples[s] = premultiplied + state.samples[s] * (1.0 - color.w);
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

    /// The light from a triangle, seen in the middle of some samples of a pixel, and its opacity.
    fn shade(&self, pixel: [u32; 2], triangle: u32, mask: u64, state: &mut PixelState) -> Vec4 {
        let corner = Vec2::new(pixel[0] as f32, pixel[1] as f32);
        let hit = self.hits.find(triangle, corner + self.pattern.centroid(mask));
        let (material, finish) = self.surface.shade(&hit);
        state.shaded += 1;
        state.lookups += u64::from(material.lookups);
        let arriving = self.lights.at(self.hits.mesh, self.surface, &hit);
        let light = evaluate(self.options.shading, &material, finish.as_ref(), hit.to_eye, &arriving);
        // One texel that is not a number must not spoil its pixel's other samples.
        let light = if light.is_finite() { light } else { Vec3::ZERO };
        (light * self.options.exposure).extend(material.alpha.clamp(0.0, 1.0))
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
