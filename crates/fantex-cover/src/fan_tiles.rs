//! One fan per tile: every fan is classified and laid flat in one pass.
//!
//! Fans are visited along a space-filling curve, which is the order of the tiles, and everything about a fan is derived from
//! one gathering of its ring while that is in the first cache.

use fantex_mesh::{Fans, morton};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::Frame;
use crate::cost::Region;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Laid, unfolded_rectangle};
use crate::groups::pad;
use crate::nominal::NominalDensity;
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::surface::{Ring, Surface};
use crate::unroll::FlatCorners;
use crate::watch::Watch;

/// Lays every fan flat, in the order of a Morton curve.
pub(crate) fn lay_fans(
    surface: &Surface<'_>,
    density: &NominalDensity<'_>,
    delta: f32,
    watch: &Watch<'_>,
) -> Vec<Laid> {
    let curve = curve(surface);
    curve
        .par_iter()
        .with_min_len(1 << 10)
        .map_init(Layer::default, |layer, &key| {
            let fan = key as u32;
            if fan.is_multiple_of(1024) {
                watch.add(1024);
            }
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

/// All fans along a Morton curve through mesh space: the place on the curve above, the fan below.
fn curve(surface: &Surface<'_>) -> Vec<u64> {
    let key = |fan: usize| u64::from(morton(surface.fan_center(fan))) << 32 | fan as u64;
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
        let pad = pad(density);
        let (x, y) = cone.axis.any_orthonormal_pair();
        let mut corners = FlatCorners::default();
        let (rectangle, x_axis) = match layout {
            Layout::Projected => {
                self.outline(x, y, delta);
                let r = self.rectangles.smallest_around_star(&self.outline, pad);
                (r, (x * r.x_axis.x + y * r.x_axis.y).normalize())
            }
            Layout::Unfolded => {
                let unfolded = unfolded_rectangle(surface, fan as usize, delta, pad, &mut self.rectangles);
                let (rectangle, unfolded) = unfolded.unwrap_or((Rectangle::POINT, corners));
                corners = unfolded;
                (rectangle, x)
            }
        };
        let frame = Frame { origin: self.ring.center, direction: cone.axis, x_axis };
        let (min, size, density) = (rectangle.min, rectangle.size, Vec2::splat(density));
        let region = Region { size, area: size.x * size.y, outline: 2.0 * (size.x + size.y) };
        Laid { frame, min, region, density, fan, fans: 1, layout, corners, folds }
    }

    /// The outline of the projected partial fan, counter-clockwise: see `outline_points`.
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
