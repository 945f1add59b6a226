//! Shadow maps (L. Williams, "Casting Curved Shadows on Curved Surfaces", 1978).
//!
//! ```text
//!  lamp, scene --lamp_views--> LampView(s) --draw--> nearness per texel --filter--> share of the light that arrives
//! ```
//!
//! A map holds, for every texel, how near to the lamp the nearest surface is. Nearness is linear over the map on every plane
//! (it is `1 / depth`, or where light is parallel the distance from the far end), so a receiver is compared not with one
//! number but with its own facet's plane under every texel of the filter: no bias can be too small on a plane, however it
//! is inclined.

use fantex_mesh::{Mesh, SurfacePoint};
use fantex_scene::{FittedView, LampView, Penumbra, Projected, ShadowOptions, Spread, lamp_views};
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::Interpolation;
use crate::hit::{Hit, ScreenBarycentrics};
use crate::primitive::{
    CHUNK, Chunk, Primitive, SUBPIXELS, TILE, TileGrid, clip, doubled_area, screen, snap,
};
use crate::raster::{Fragment, SamplePattern, TileSamples};
use crate::{Coverage, Light, Surface};

#[derive(Debug)]
pub(crate) struct ShadowMaps {
    faces: Vec<ShadowFace>,
    options: ShadowOptions,
    /// Mesh units per world unit.
    mesh_per_world: f32,
}

#[derive(Debug)]
struct ShadowFace {
    view: LampView,
    resolution: u32,
    /// Largest depth of the scene, mesh units.
    far: f64,
    /// Row-major; zero where there is no surface.
    nearness: Vec<f32>,
}

/// Who asks whether light arrives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// Mesh space.
    pub(crate) position: Vec3,
    /// Change of the position along the pixel's edges, mesh space.
    pub(crate) steps: [Vec3; 2],
    /// Unit normal of the facet on the side that is seen.
    pub(crate) facet_normal: Vec3,
    /// Unit normal of the smooth surface on the side that is seen.
    pub(crate) normal: Vec3,
}

impl ShadowMaps {
    /// Draws the maps of a lamp; none where it has no shadows.
    pub(crate) fn draw(light: &Light, mesh: &Mesh, surface: &dyn Surface) -> Option<Self> {
        let options = light.shadow?;
        let casters = (0..mesh.triangles.len())
            .filter(|&triangle| surface.casts_shadow(triangle))
            .flat_map(|triangle| mesh.triangle_positions(triangle));
        let faces = lamp_views(&light.kind, &mesh.world_from_mesh, &mesh.positions, casters)
            .into_iter()
            .map(|fitted| draw_face(fitted, options.resolution, mesh, surface))
            .collect();
        Some(Self { faces, options, mesh_per_world: (1.0 / mesh.world_from_mesh.scale) as f32 })
    }

    /// Share of the lamp's light that arrives, 0..1. `to_light` is a unit vector.
    pub(crate) fn visibility(&self, receiver: &Receiver, to_light: Vec3) -> f32 {
        let face = match &self.faces[..] {
            [only] => only,
            six => &six[cube_face(receiver.position.as_dvec3() - six[0].view.origin)],
        };
        face_visibility(face, &self.options, self.mesh_per_world, receiver, to_light)
    }
}

/// Index of the cube's face that a direction meets, in the order of [`lamp_views`].
fn cube_face(direction: DVec3) -> usize {
    let axis = direction.abs().max_position();
    2 * axis + usize::from(direction[axis] < 0.0)
}

impl ShadowFace {
    /// The map's measure of a depth, larger for what is nearer: positive up to the far end and some way beyond.
    fn nearness_of(&self, depth: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / depth,
            Spread::Parallel => 1.0 + (self.far - depth) / self.far,
        }
    }

    fn depth_of(&self, nearness: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / nearness,
            Spread::Parallel => self.far * (2.0 - nearness),
        }
    }

    /// Change of the nearness per unit of depth (positive: per unit towards the lamp).
    fn nearness_per_depth(&self, depth: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / (depth * depth),
            Spread::Parallel => 1.0 / self.far,
        }
    }
}

// Drawing a map: the nearest surface under the middle of every texel.

/// What lets more light through than this casts no shadow.
const MIN_ALPHA: f32 = 0.5;

/// Draws one map. Both sides of every triangle that casts shadows do; layered ones where their alpha is at least a half.
fn draw_face(fitted: FittedView, resolution: u32, mesh: &Mesh, surface: &dyn Surface) -> ShadowFace {
    let FittedView { view, far } = fitted;
    let mut face = ShadowFace { view, resolution, far, nearness: Vec::new() };
    let grid = TileGrid { size: [resolution; 2] };
    let pattern = SamplePattern::new(1);
    let chunks = Caster { face: &face, mesh, surface }.prepare(&grid);
    let tiles: Vec<Vec<f32>> = (0..grid.len())
        .into_par_iter()
        .map(|tile| {
            let mut samples = TileSamples::new(&pattern, grid.rect(tile));
            let primitives = || chunks.iter().flat_map(|c| c.in_tile(&grid, tile));
            primitives().filter(|p| !p.layered).for_each(|p| samples.add_opaque(p));
            primitives().filter(|p| p.layered).for_each(|p| samples.add_layered(p));
            let caster = Caster { face: &face, mesh, surface };
            caster.finish(grid.rect(tile), samples)
        })
        .collect();
    face.nearness = assemble(&grid, &tiles);
    face
}

fn assemble(grid: &TileGrid, tiles: &[Vec<f32>]) -> Vec<f32> {
    let side = grid.size[0] as usize;
    let mut nearness = vec![0.0; side * side];
    for (tile, values) in tiles.iter().enumerate() {
        let [[x0, y0], [columns, rows]] = grid.rect(tile).map(|corner| corner.map(|c| c as usize));
        for row in 0..rows {
            let source = &values[row * TILE as usize..][..columns];
            nearness[(y0 + row) * side + x0..][..columns].copy_from_slice(source);
        }
    }
    nearness
}

struct Caster<'a> {
    face: &'a ShadowFace,
    mesh: &'a Mesh,
    surface: &'a dyn Surface,
}

impl Caster<'_> {
    fn prepare(&self, grid: &TileGrid) -> Vec<Chunk> {
        let triangles = self.mesh.triangles.len();
        (0..triangles.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let range = chunk * CHUNK..triangles.min((chunk + 1) * CHUNK);
                let mut primitives = Vec::with_capacity(range.len());
                range.for_each(|triangle| self.add(triangle, &mut primitives));
                Chunk::new(primitives, grid)
            })
            .collect()
    }

    /// Screen-homogeneous coordinates in texels.
    fn projected(&self, p_mesh: Vec3) -> DVec3 {
        let side = f64::from(self.face.resolution);
        self.face.view.homogeneous(p_mesh) * DVec3::new(side, side, 1.0)
    }

    fn add(&self, triangle: usize, out: &mut Vec<Primitive>) {
        if !self.surface.casts_shadow(triangle) {
            return;
        }
        let positions = self.mesh.triangle_positions(triangle);
        let corners = positions.map(|p| self.projected(p));
        let side = f64::from(self.face.resolution);
        let beside = (0..2).any(|i| {
            corners.iter().all(|h| h[i] < 0.0) || corners.iter().all(|h| h[i] > side * h.z.max(0.0))
        });
        if beside {
            return;
        }
        let near = match self.face.view.spread() {
            Spread::Perspective => self.face.far * 1e-4,
            Spread::Parallel => 0.5,
        };
        let polygon = clip(corners, near);
        let parallel_depth = (self.face.view.spread() == Spread::Parallel)
            .then(|| DepthPlane::new(corners, positions.map(|p| self.face.view.project(p).depth)));
        let nearness = |h: DVec3| {
            let depth = parallel_depth.as_ref().map_or(h.z, |plane| plane.at(screen(h)));
            self.face.nearness_of(depth) as f32
        };
        let layered = self.surface.coverage(triangle) == Coverage::Layered;
        for pair in polygon.corners().get(1..).unwrap_or(&[]).windows(2) {
            let h = [polygon.corners()[0], pair[0], pair[1]];
            let (mut corners, mut nearness) = (h.map(|h| snap(screen(h))), h.map(nearness));
            let area = doubled_area(&corners);
            if area == 0 {
                continue;
            }
            if area < 0 {
                corners.swap(1, 2);
                nearness.swap(1, 2);
            }
            out.push(Primitive { corners, nearness, triangle: triangle as u32, layered });
        }
    }

    /// The nearness of a tile's texels, with stride [`TILE`].
    fn finish(&self, [origin, _]: [[u32; 2]; 2], mut samples: TileSamples) -> Vec<f32> {
        let fragments = samples.take_fragments();
        let mut nearness = samples.into_nearness();
        for fragment in &fragments {
            let [x, y] = [fragment.pixel % TILE + origin[0], fragment.pixel / TILE + origin[1]];
            let middle = [x, y].map(|c| c as i32 * SUBPIXELS + SUBPIXELS / 2);
            let own = fragment.nearness.at(middle);
            let nearest = &mut nearness[fragment.pixel as usize];
            if own > *nearest && self.alpha(fragment, Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) >= MIN_ALPHA
            {
                *nearest = own;
            }
        }
        nearness
    }

    /// The opacity of a layered triangle in the middle of a texel.
    fn alpha(&self, fragment: &Fragment, texel: Vec2) -> f32 {
        let corners = self.mesh.triangle_positions(fragment.triangle as usize);
        let projected = corners.map(|p| self.projected(p));
        let [lambda, dx, dy] = ScreenBarycentrics::new(projected, Interpolation::Perspective).at(texel);
        let at = SurfacePoint { triangle: fragment.triangle, lambda };
        let [a, b, c] = corners;
        let to_lamp = match self.face.view.spread() {
            Spread::Perspective => {
                let p = at.interpolate(corners);
                (self.face.view.origin - p.as_dvec3()).as_vec3().normalize_or(Vec3::Y)
            }
            Spread::Parallel => -self.face.view.forward().as_vec3(),
        };
        let front = (b - a).cross(c - a).dot(to_lamp) >= 0.0;
        self.surface.alpha(&Hit { at, lambda_steps: [dx, dy], front, to_eye: to_lamp })
    }
}

/// Depth of a triangle's plane over the screen, where light is parallel.
struct DepthPlane {
    origin: DVec2,
    depth: f64,
    slope: DVec2,
}

impl DepthPlane {
    fn new(corners: [DVec3; 3], depths: [f64; 3]) -> Self {
        let [a, b, c] = corners.map(|h| h.truncate());
        let (x, y) = (b - a, c - a);
        let (dx, dy) = (depths[1] - depths[0], depths[2] - depths[0]);
        let slope = DVec2::new(dx * y.y - dy * x.y, dy * x.x - dx * y.x) / x.perp_dot(y);
        let slope = if slope.is_finite() { slope } else { DVec2::ZERO };
        Self { origin: a, depth: depths[0], slope }
    }

    fn at(&self, p: DVec2) -> f64 {
        self.depth + self.slope.dot(p - self.origin)
    }
}

// Asking a map: percentage-closer filtering over the receiver's footprint (W. Reeves, D. Salesin and R. Cook, "Rendering
// Antialiased Shadows with Depth Maps", 1987).

/// Half the least width of the filter, in texels.
const MIN_RADIUS: f32 = 1.25;

/// Most texels along each side of the filter that are asked; larger filters skip some.
const MAX_TAPS: i32 = 16;

/// Largest tangent of the angle between light and normal for which a receiver's plane is followed.
const MAX_STEEPNESS: f64 = 12.0;

/// Share of the light that arrives, 0..1.
fn face_visibility(
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
    let penumbra = match options.penumbra() {
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
    asked.radius = pixel.max(Vec2::splat(penumbra.max(MIN_RADIUS)));
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
        let steepest = MAX_STEEPNESS * texel_width * face.nearness_per_depth(depth);
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
        Self { low, high, first, last, stride: ((last - first + MAX_TAPS) / MAX_TAPS).max(1) }
    }

    fn iter(&self) -> impl Iterator<Item = (i32, f32)> {
        (self.first..=self.last).step_by(self.stride as usize).map(|i| {
            let covered = (self.high.min(i as f32 + 1.0) - self.low.max(i as f32)).clamp(0.0, 1.0);
            (i, covered)
        })
    }
}
