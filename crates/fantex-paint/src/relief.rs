//! Painted height shows in the normals.
//!
//! Slopes of a height field over a normal map add up: with the normal `(x, y, z)` in the shading frame and the change `d` of the height,
//! `(x / z, y / z) - grad d` are the slopes of the new one ("partial derivative blending", Hill and Barre-Brisebois, "Blending in
//! Detail", 2012). So painting height bends the normals that are there, and paint on several layers adds up before it does.
//! Gradients are central differences along the tile's texels, of second order to one side where the page or the surface ends; pages and
//! tiles are therefore worked on alone, and agree to that order.

use fantex_store::{Asset, ChannelKind, TexelFormat};
use glam::{Vec3, Vec4};

use crate::composite::position_steps;
use crate::texel_page::{Rect, TexelPage};
use crate::{ChannelPaint, Paint, PaintColor, Surface};

/// World units from height 0 to height 1, in diagonals of the model's box.
pub const HEIGHT_RANGE: f32 = 0.02;

/// The channels of an asset's relief.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relief {
    pub(crate) height: usize,
    pub(crate) normal: usize,
    /// Whether heights beyond 0..1 are kept.
    is_float: bool,
    /// Mesh units from height 0 to height 1.
    range: f32,
}

impl Relief {
    /// None where the asset lacks height or normals.
    pub(crate) fn of(surface: &Surface, asset: &Asset) -> Option<Self> {
        let height = asset.channel_of_kind(ChannelKind::Displacement)?;
        let normal = asset.channel_of_kind(ChannelKind::Normal)?;
        let is_float = asset.channels()[height].format == TexelFormat::Rgba32F;
        let range = HEIGHT_RANGE * surface.mesh().bounds().extent().length();
        Some(Self { height, normal, is_float, range })
    }

    /// Lets a paint of heights change the normals, too.
    pub(crate) fn join(&self, paint: &mut Paint) {
        let paints = |channel| paint.channels.iter().any(|painted| painted.channel == channel);
        if paints(self.height) && !paints(self.normal) {
            paint.channels.push(ChannelPaint::new(self.normal, PaintColor::Relief));
        }
    }

    /// The texels of a page whose normals depend on heights within a rectangle, and the other way round.
    pub(crate) fn reach(rect: Rect, extent: [u32; 2]) -> Rect {
        if rect.is_empty() { rect } else { rect.grown(extent).grown(extent) }
    }

    /// Bends the normals (as stored) of a page in a rectangle. `before` and `after`: heights of the page. Calls `bent` for each texel
    /// that changes.
    pub(crate) fn bend(
        &self,
        surface: &Surface,
        map: &TexelPage,
        rect: Rect,
        [before, after]: [&[Vec4]; 2],
        normals: &mut [Vec4],
        mut bent: impl FnMut(usize),
    ) {
        let limited = |x: f32| if self.is_float { x } else { x.clamp(0.0, 1.0) };
        let raised = |texel: usize| limited(after[texel].x) - limited(before[texel].x);
        let extent = map.block.extent;
        let at = |place: [u32; 2], axis: usize, step: i32| {
            let mut place = place.map(|n| n as i32);
            place[axis] += step;
            if place[axis] < 0 || place[axis] >= extent[axis] as i32 {
                return None;
            }
            let texel = map.texel(place.map(|n| n as u32));
            map.is_valid(texel).then(|| raised(texel))
        };
        for place in rect.texels() {
            let texel = map.texel(place);
            if !map.is_valid(texel) {
                continue;
            }
            let here = raised(texel);
            let changes = [0, 1].map(|axis| difference(here, |step| at(place, axis, step)));
            if changes == [0.0; 2] {
                continue;
            }
            let gradient = gradient(position_steps(surface, map.triangle(place)), changes) * self.range;
            let group = &surface.cover().groups[map.group as usize];
            let normal = surface.normal(map.point(place).clamped());
            let stored = normals[texel];
            let tangent = group.tangent_from_stored(stored.truncate().truncate(), normal);
            let along = gradient - normal * normal.dot(gradient);
            let z = (1.0 - tangent.length_squared()).max(MIN_Z * MIN_Z).sqrt();
            let slope = tangent / z - along;
            let new = slope / (1.0 + slope.length_squared()).sqrt();
            let [x, y] = group.stored_from_tangent(new, normal).to_array();
            normals[texel] = Vec4::new(x, y, stored.z, stored.w);
            bent(texel);
        }
    }
}

/// Normals that lie flatter count as this steep.
const MIN_Z: f32 = 0.05;

/// The change per texel along an axis; `at` gives the values some texels away, where there are any.
fn difference(here: f32, at: impl Fn(i32) -> Option<f32>) -> f32 {
    let one_sided = |sign: i32, near: f32| match at(2 * sign) {
        Some(far) => 2.0 * near - 1.5 * here - 0.5 * far,
        None => near - here,
    };
    match (at(-1), at(1)) {
        (Some(left), Some(right)) => 0.5 * (right - left),
        (None, Some(right)) => one_sided(1, right),
        (Some(left), None) => -one_sided(-1, left),
        (None, None) => 0.0,
    }
}

/// The gradient in the plane of two steps along which a function changes by so much.
fn gradient([a, b]: [Vec3; 2], [da, db]: [f32; 2]) -> Vec3 {
    let (aa, ab, bb) = (a.dot(a), a.dot(b), b.dot(b));
    let determinant = aa * bb - ab * ab;
    // Slivers say nothing about directions.
    if determinant <= 1e-6 * aa * bb {
        return Vec3::ZERO;
    }
    (a * (da * bb - db * ab) + b * (db * aa - da * ab)) / determinant
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_exact_for_parabolas_wherever_the_page_ends() {
        let parabola = |x: f32| 0.3 * x * x - 1.2 * x + 0.4;
        for here in -2..3 {
            let slope = 0.6 * here as f32 - 1.2;
            for missing in [-3..-2, -2..0, 1..3] {
                let at = |step: i32| (!missing.contains(&step)).then(|| parabola((here + step) as f32));
                let found = difference(parabola(here as f32), at);
                assert!((found - slope).abs() < 1e-5, "{here} {missing:?}: {found} {slope}");
            }
        }
        assert_eq!(difference(1.0, |_| None), 0.0);
        assert_eq!(difference(1.0, |step| (step == -1).then_some(0.5)), 0.5);
    }

    #[test]
    fn gradients_of_linear_functions_are_found_in_slanting_axes() {
        let (a, b) = (Vec3::new(0.5, 0.1, 0.0), Vec3::new(0.3, -0.4, 0.0));
        let expected = Vec3::new(1.5, -2.0, 0.0);
        let found = gradient([a, b], [a.dot(expected), b.dot(expected)]);
        assert!((found - expected).length() < 1e-5, "{found}");
        assert_eq!(gradient([a, a], [1.0, 1.0]), Vec3::ZERO);
    }
}
