//! Asking a map: percentage-closer filtering over the receiver's footprint (W. Reeves, D. Salesin and R. Cook, "Rendering
//! Antialiased Shadows with Depth Maps", 1987).

use glam::{DVec2, Vec2, Vec3};

use fantex_scene::{Penumbra, ShadowOptions};

use super::{Receiver, ShadowFace};
use fantex_scene::{Projected, Spread};

/// Half the least width of the filter, in texels.
const LEAST_RADIUS: f32 = 1.25;

/// Most texels along each side of the filter that are asked; larger filters skip some.
const MOST_TAPS: i32 = 16;

/// Largest tangent of the angle between light and normal for which a receiver's plane is followed.
const STEEPEST: f64 = 12.0;

/// Share of the light that arrives, 0..1.
pub(super) fn visibility(
    face: &ShadowFace,
    options: &ShadowOptions,
    mesh_per_world: f32,
    receiver: &Receiver,
    to_light: Vec3,
) -> f32 {
    let Some(mut asked) = Asked::new(face, options, receiver, to_light) else { return 1.0 };
    let footprint = [receiver.steps[0], receiver.steps[1]].map(|step| asked.texels(face, step));
    let pixel = 0.5 * (footprint[0].abs() + footprint[1].abs());
    let texel = asked.texel_width as f32;
    let penumbra = match options.penumbra {
        Penumbra::Sharp => 0.0,
        Penumbra::Even(half_width) => half_width * mesh_per_world / texel,
        Penumbra::Lamp(size) => {
            let size = match face.view.spread() {
                Spread::Perspective => f64::from(size * mesh_per_world),
                Spread::Parallel => f64::from(size),
            };
            let search = Vec2::splat(asked.widest_penumbra(face, size) as f32 / texel).max(pixel);
            let Some(blocker) = asked.mean_blocker_depth(face, search) else { return 1.0 };
            let gap = (asked.depth - blocker).max(0.0);
            let width = match face.view.spread() {
                Spread::Perspective => size * gap / blocker,
                Spread::Parallel => size * gap,
            };
            width as f32 / texel
        }
    };
    asked.radius = pixel.max(Vec2::splat(penumbra.max(LEAST_RADIUS)));
    asked.lit_share(face)
}

/// A receiver in the terms of a map.
struct Asked {
    /// Position in texels.
    at: DVec2,
    projected: Projected,
    depth: f64,
    /// Nearness of the lifted receiver, and its change per texel along the receiver's plane.
    nearness: f64,
    slope: DVec2,
    /// Mesh units per texel at the receiver.
    texel_width: f64,
    radius: Vec2,
}

impl Asked {
    /// `None` outside the map.
    fn new(face: &ShadowFace, options: &ShadowOptions, receiver: &Receiver, to_light: Vec3) -> Option<Self> {
        let side = f64::from(face.resolution);
        let straight = face.view.project(receiver.position);
        if straight.w <= 0.0 || straight.depth <= 0.0 {
            return None;
        }
        let texel_width = face.view.extent_at(straight.depth).max_element() / side;
        let cosine = receiver.normal.dot(to_light).clamp(0.0, 1.0);
        let lift = options.normal_offset * (1.0 - cosine * cosine).sqrt() * texel_width as f32;
        let lifted = receiver.position + receiver.normal * lift;
        let projected = face.view.project(lifted);
        let inside = (projected.uv - 0.5).abs().max_element() <= 0.5;
        if !inside || projected.w <= 0.0 || projected.depth <= 0.0 {
            return None;
        }
        let depth = (projected.depth - f64::from(options.bias) * texel_width).max(projected.depth * 0.5);
        let nearness = face.nearness_of(depth);
        let steepest = STEEPEST * texel_width * face.nearness_per_depth(depth);
        // A facet that is turned away from the lamp says nothing about the surface that the lamp sees.
        let faces_lamp = receiver.facet_normal.dot(to_light) > 0.0;
        let slope = if faces_lamp {
            let plane = face.view.plane_slope(lifted.as_dvec3(), receiver.facet_normal.as_dvec3());
            let per_texel = match face.view.spread() {
                Spread::Perspective => plane / side,
                Spread::Parallel => -plane / (side * face.far),
            };
            per_texel.clamp(DVec2::splat(-steepest), DVec2::splat(steepest))
        } else {
            DVec2::ZERO
        };
        let at = projected.uv * side;
        Some(Self { at, depth: projected.depth, projected, nearness, slope, texel_width, radius: Vec2::ONE })
    }

    /// A step of the surface in texels.
    fn texels(&self, face: &ShadowFace, step: Vec3) -> Vec2 {
        face.view.step(&self.projected, step) * face.resolution as f32
    }

    /// The share of the filter's box in which nothing is nearer than the receiver's plane. Texels at the box's border count
    /// by the share of them that lies inside, so that the result is continuous.
    fn lit_share(&self, face: &ShadowFace) -> f32 {
        let (mut lit, mut total) = (0.0, 0.0);
        self.for_each_texel(face, self.radius, |nearest, own, weight| {
            total += weight;
            lit += if f64::from(nearest) <= own { weight } else { 0.0 };
        });
        if total > 0.0 { lit / total } else { 1.0 }
    }

    /// Half width of the widest penumbra that can fall here, mesh units.
    fn widest_penumbra(&self, face: &ShadowFace, size: f64) -> f64 {
        match face.view.spread() {
            Spread::Perspective => size,
            Spread::Parallel => size * self.depth.min(face.far),
        }
    }

    /// Mean depth of what is nearer than the receiver around it.
    fn mean_blocker_depth(&self, face: &ShadowFace, radius: Vec2) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        self.for_each_texel(face, radius, |nearest, own, weight| {
            if f64::from(nearest) > own {
                sum += face.depth_of(f64::from(nearest)) * f64::from(weight);
                total += f64::from(weight);
            }
        });
        (total > 0.0).then(|| sum / total)
    }

    /// Calls `visit(nearness of the map, nearness of the receiver's plane, weight)`.
    fn for_each_texel(&self, face: &ShadowFace, radius: Vec2, mut visit: impl FnMut(f32, f64, f32)) {
        let side = face.resolution as i32;
        let [columns, rows] = [0, 1].map(|i| Span::new(self.at[i] as f32, radius[i], side));
        for (y, weight_y) in rows.iter() {
            let row = &face.nearness[y as usize * side as usize..][..side as usize];
            let dy = f64::from(y) + 0.5 - self.at.y;
            for (x, weight_x) in columns.iter() {
                let dx = f64::from(x) + 0.5 - self.at.x;
                // Not below that of an empty texel, which hides nothing however far the receiver lies behind the map's end.
                let own = (self.nearness + self.slope.x * dx + self.slope.y * dy).max(0.0);
                visit(row[x as usize], own, weight_x * weight_y);
            }
        }
    }
}

/// The texels of one axis that a box covers.
struct Span {
    low: f32,
    high: f32,
    first: i32,
    last: i32,
    stride: i32,
}

impl Span {
    fn new(middle: f32, radius: f32, side: i32) -> Self {
        let (low, high) = (middle - radius, middle + radius);
        let clamp = |c: f32| (c.floor() as i32).clamp(0, side - 1);
        let (first, last) = (clamp(low), clamp(high));
        Self { low, high, first, last, stride: ((last - first + MOST_TAPS) / MOST_TAPS).max(1) }
    }

    fn iter(&self) -> impl Iterator<Item = (i32, f32)> {
        (self.first..=self.last).step_by(self.stride as usize).map(|i| {
            let covered = (self.high.min(i as f32 + 1.0) - self.low.max(i as f32)).clamp(0.0, 1.0);
            (i, covered)
        })
    }
}
