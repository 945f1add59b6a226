//! One fan per tile, the thesis' own case: every fan is decided about and laid flat in one go.
//!
//! Fans are visited along a space-filling curve, which is the order of the tiles, and everything about a fan is derived from
//! one gathering of its ring while that is in the first cache.

use fantex_mesh::Fans;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::Frame;
use crate::density::NominalDensity;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Laid, unfolded_rectangle};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::ring::Ring;
use crate::surface::Surface;

/// Lays every fan flat, in the order of a Morton curve. Fans that neither can be projected nor unfolded are marked
/// [`Layout::Split`].
pub(crate) fn lay_fans(surface: &Surface<'_>, density: &NominalDensity<'_>, delta: f32) -> Vec<Laid> {
    let curve = curve(surface);
    curve
        .par_iter()
        .with_min_len(1 << 10)
        .map_init(Layer::default, |layer, &key| {
            let fan = key as u32;
            layer.lay(surface, fan, density.of_fan(surface, fan as usize), delta)
        })
        .collect()
}

/// The group of each fan, where every group is one fan.
pub(crate) fn fan_groups(fans: &Fans, laid: &[Laid]) -> Vec<u32> {
    let mut groups = vec![0; fans.len()];
    for (group, laid) in (0..).zip(laid) {
        groups[laid.fan as usize] = group;
    }
    groups
}

/// All fans along a Morton curve through mesh space, 10 bits per axis: the place on the curve above, the fan below.
fn curve(surface: &Surface<'_>) -> Vec<u64> {
    let spread = |x: f32| {
        let mut bits = ((x + 1.0) * 511.5) as u32 & 1023;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    let key = |fan: usize| {
        let [x, y, z] = surface.fan_center(fan).to_array().map(spread);
        u64::from(x | y << 1 | z << 2) << 32 | fan as u64
    };
    let mut keys: Vec<u64> = (0..surface.fans.len()).into_par_iter().with_min_len(1 << 12).map(key).collect();
    keys.par_sort_unstable();
    keys
}

/// Lays single fans flat. Keeps its buffers.
#[derive(Default)]
struct Layer {
    ring: Ring,
    spokes: Vec<Vec2>,
    outline: Vec<Vec2>,
    rectangles: RectangleFinder,
}

impl Layer {
    fn lay(&mut self, surface: &Surface<'_>, fan: u32, density: f32, delta: f32) -> Laid {
        self.ring.gather(surface, fan as usize);
        let FanShape { layout, cone, folds, .. } = FanShape::of(&self.ring, surface, fan as usize);
        let pad = 1.0 / density.max(f32::MIN_POSITIVE);
        let (x, y) = cone.axis.any_orthonormal_pair();
        let (rectangle, x_axis) = match layout {
            Layout::Projected => {
                self.outline(x, y, delta);
                let r = self.rectangles.smallest_around_star(&self.outline, pad);
                (r, (x * r.x_axis.x + y * r.x_axis.y).normalize())
            }
            Layout::Unfolded | Layout::Split => {
                let unfolded = unfolded_rectangle(surface, fan as usize, delta, pad, &mut self.rectangles);
                (unfolded.map_or(Rectangle::POINT, |u| u.0), x)
            }
        };
        let frame = Frame { origin: self.ring.center, direction: cone.axis, x_axis };
        Laid { frame, min: rectangle.min, size: rectangle.size, density, fan, layout, folds }
    }

    /// The outline of the projected partial fan, counter-clockwise: see `region` for its points.
    fn outline(&mut self, x: Vec3, y: Vec3, delta: f32) {
        let (along_spoke, between) = (0.5 + 0.5 * delta, (1.0 + delta) / 3.0);
        self.spokes.clear();
        self.spokes.extend(self.ring.spokes.iter().map(|s| Vec2::new(s.dot(x), s.dot(y))));
        self.outline.clear();
        if !self.ring.closed {
            self.outline.push(Vec2::ZERO);
        }
        for pair in self.spokes.windows(2) {
            self.outline.push(pair[0] * along_spoke);
            self.outline.push((pair[0] + pair[1]) * between);
        }
        if !self.ring.closed
            && let Some(&last) = self.spokes.last()
        {
            self.outline.push(last * along_spoke);
        }
    }
}
