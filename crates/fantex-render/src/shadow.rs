//! Shadow maps (L. Williams, "Casting Curved Shadows on Curved Surfaces", 1978).
//!
//! ```text
//!  lamp, scene --lamp_views--> LampView(s) --draw--> nearness per texel --filter--> share of the light that arrives
//! ```
//!
//! A map holds, for every texel, how near to the lamp the nearest surface is. [Nearness](FittedView) is linear over the map on
//! every plane, so a receiver is compared not with one number but with its own facet's plane under every texel of the filter:
//! no bias can be too small on a plane, however it is inclined.

use fantex_base::input::{self, Held};
use fantex_base::{Result, counted};
use fantex_mesh::{Mesh, SurfacePoint};
use fantex_scene::{FittedView, Penumbra, Projected, ShadowOptions, Spread, lamp_views};
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::Interpolation;
use crate::hit::{Hit, ScreenBarycentrics};
use crate::primitive::{Chunk, Primitive, SUBPIXELS, TILE, TileGrid, clip, doubled_area, screen, snap};
use crate::raster::{Fragment, MAX_LAYERED, SamplePattern, TileSamples};
use crate::{Coverage, Light, Surface};

#[derive(Debug)]
pub(crate) struct ShadowMaps {
    faces: Vec<ShadowFace>,
    options: ShadowOptions,
    /// Mesh units per world unit.
    mesh_per_world: f32,
    _held: Held,
}

/// Where the maps of a lamp look, and the memory for them.
#[derive(Debug)]
pub(crate) struct ShadowPlan {
    views: Vec<FittedView>,
    options: ShadowOptions,
    held: Held,
}

#[derive(Debug)]
struct ShadowFace {
    fitted: FittedView,
    resolution: u32,
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

impl ShadowPlan {
    /// The maps of a lamp, by its number in the scene; none where it has no shadows.
    ///
    /// # Errors
    /// They take more memory than is left.
    pub(crate) fn new(
        lamp: usize,
        light: &Light,
        mesh: &Mesh,
        surface: &dyn Surface,
    ) -> Result<Option<Self>> {
        let Some(options) = light.shadow else { return Ok(None) };
        let casters = (0..mesh.triangles.len())
            .filter(|&triangle| surface.casts_shadow(triangle))
            .flat_map(|triangle| mesh.triangle_positions(triangle));
        let views = lamp_views(&light.kind, &mesh.world_from_mesh, &mesh.positions, casters);
        let (count, side) = (views.len(), options.resolution);
        let maps = counted(count, "map");
        let what = format_args!("the shadow of lamp {lamp} of the scene ({maps} of {side} x {side} texels)");
        let texels = count as u64 * u64::from(side) * u64::from(side);
        let held = input::reserve(what, texels * size_of::<f32>() as u64)?;
        Ok(Some(Self { views, options, held }))
    }

    /// Draws the maps.
    pub(crate) fn draw(self, mesh: &Mesh, surface: &dyn Surface) -> ShadowMaps {
        let Self { views, options, held } = self;
        let faces =
            views.into_iter().map(|fitted| draw_face(fitted, options.resolution, mesh, surface)).collect();
        let mesh_per_world = (1.0 / mesh.world_from_mesh.scale) as f32;
        ShadowMaps { faces, options, mesh_per_world, _held: held }
    }
}

impl ShadowMaps {
    /// Share of the lamp's light that arrives, 0..1. `to_light` is a unit vector.
    pub(crate) fn visibility(&self, receiver: &Receiver, to_light: Vec3) -> f32 {
        let (lifted, face) = match &self.faces[..] {
            [only] => (Lifted::new(only, &self.options, receiver, to_light), only),
            six => {
                let towards =
                    |position: Vec3| &six[cube_face(position.as_dvec3() - six[0].fitted.view.origin)];
                let lifted = Lifted::new(towards(receiver.position), &self.options, receiver, to_light);
                // The lift may lead across a face's border.
                let face = lifted.map_or(&six[0], |lifted| towards(lifted.position));
                (lifted, face)
            }
        };
        lifted.map_or(1.0, |lifted| {
            face_visibility(face, &self.options, self.mesh_per_world, receiver, &lifted, to_light)
        })
    }
}

/// Index of the cube's face that a direction meets, in the order of [`lamp_views`].
fn cube_face(direction: DVec3) -> usize {
    let axis = direction.abs().max_position();
    2 * axis + usize::from(direction[axis] < 0.0)
}

// Drawing a map: the nearest surface under the middle of every texel.

/// What lets more light through than this casts no shadow.
const MIN_ALPHA: f32 = 0.5;

/// Draws one map. Both sides of every triangle that casts shadows do; layered ones where their alpha is at least a half.
fn draw_face(fitted: FittedView, resolution: u32, mesh: &Mesh, surface: &dyn Surface) -> ShadowFace {
    let mut face = ShadowFace { fitted, resolution, nearness: Vec::new() };
    let grid = TileGrid { size: [resolution; 2] };
    let pattern = SamplePattern::new(1);
    let caster = Caster { face: &face, mesh, surface };
    let chunks = caster.prepare(&grid);
    let draw_tile = |tile: usize| {
        let mut samples = TileSamples::new(&pattern, grid.rect(tile));
        let primitives = || chunks.iter().flat_map(|c| c.in_tile(&grid, tile));
        primitives().filter(|p| !p.layered).for_each(|p| samples.add_opaque(p));
        caster.finish(grid.rect(tile), &samples, || primitives().filter(|p| p.layered))
    };
    let (side, columns) = (resolution as usize, grid.columns() as usize);
    let mut nearness = vec![0.0; side * side];
    let bands = nearness.par_chunks_mut(side * TILE as usize);
    bands.enumerate().for_each(|(band, rows)| {
        let tiles: Vec<Vec<f32>> =
            (band * columns..(band + 1) * columns).into_par_iter().map(draw_tile).collect();
        for (row, texels) in rows.chunks_mut(side).enumerate() {
            for (tile, texels) in tiles.iter().zip(texels.chunks_mut(TILE as usize)) {
                texels.copy_from_slice(&tile[row * TILE as usize..][..texels.len()]);
            }
        }
    });
    face.nearness = nearness;
    face
}

struct Caster<'a> {
    face: &'a ShadowFace,
    mesh: &'a Mesh,
    surface: &'a dyn Surface,
}

impl Caster<'_> {
    fn prepare(&self, grid: &TileGrid) -> Vec<Chunk> {
        let (triangles, chunk_len) = (self.mesh.triangles.len(), grid.chunk_len());
        (0..triangles.div_ceil(chunk_len))
            .into_par_iter()
            .map(|chunk| {
                let range = chunk * chunk_len..triangles.min((chunk + 1) * chunk_len);
                let mut primitives = Vec::new();
                range.for_each(|triangle| self.add(triangle, &mut primitives));
                Chunk::new(primitives, grid)
            })
            .collect()
    }

    /// Screen-homogeneous coordinates in texels.
    fn projected(&self, p_mesh: Vec3) -> DVec3 {
        let side = f64::from(self.face.resolution);
        self.face.fitted.view.homogeneous(p_mesh) * DVec3::new(side, side, 1.0)
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
        let fitted = &self.face.fitted;
        let (polygon, parallel_depth) = match fitted.view.spread() {
            Spread::Perspective => (clip(corners, fitted.near()), None),
            Spread::Parallel => {
                let plane = DepthPlane::new(corners, positions.map(|p| fitted.view.project(p).depth));
                // What lies behind the lamp casts no shadow.
                (clip(corners, 0.5).clipped(plane.homogeneous(), fitted.near()), Some(plane))
            }
        };
        let nearness = |h: DVec3| {
            let depth = parallel_depth.as_ref().map_or(h.z, |plane| plane.at(screen(h)));
            fitted.nearness_of(depth) as f32
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
    fn finish<'p, I: Iterator<Item = &'p Primitive>>(
        &self,
        [origin, _]: [[u32; 2]; 2],
        samples: &TileSamples,
        layered: impl Fn() -> I,
    ) -> Vec<f32> {
        let mut nearness = samples.nearness().to_vec();
        samples.for_each_part(
            layered,
            |_| 1,
            MAX_LAYERED,
            |_, fragments| {
                for fragment in fragments {
                    let [x, y] = [fragment.pixel % TILE + origin[0], fragment.pixel / TILE + origin[1]];
                    let middle = [x, y].map(|c| c as i32 * SUBPIXELS + SUBPIXELS / 2);
                    let own = fragment.nearness.at(middle);
                    let nearest = &mut nearness[fragment.pixel as usize];
                    let texel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    if own > *nearest && self.alpha(fragment, texel) >= MIN_ALPHA {
                        *nearest = own;
                    }
                }
            },
        );
        nearness
    }

    /// The opacity of a layered triangle in the middle of a texel.
    fn alpha(&self, fragment: &Fragment, texel: Vec2) -> f32 {
        let corners = self.mesh.triangle_positions(fragment.triangle as usize);
        let projected = corners.map(|p| self.projected(p));
        let [lambda, dx, dy] = ScreenBarycentrics::new(projected, Interpolation::Perspective).at(texel);
        let at = SurfacePoint { triangle: fragment.triangle, lambda };
        let [a, b, c] = corners;
        let to_lamp = match self.face.fitted.view.spread() {
            Spread::Perspective => {
                let p = at.interpolate(corners);
                (self.face.fitted.view.origin - p.as_dvec3()).as_vec3().normalize_or(Vec3::Y)
            }
            Spread::Parallel => -self.face.fitted.view.forward().as_vec3(),
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

    /// What times `(x, y, 1)` is the depth.
    fn homogeneous(&self) -> DVec3 {
        self.slope.extend(self.depth - self.slope.dot(self.origin))
    }
}

// Asking a map: percentage-closer filtering over the receiver's footprint (W. Reeves, D. Salesin and R. Cook, "Rendering
// Antialiased Shadows with Depth Maps", 1987).

/// Half the least width of the filter, in texels.
const MIN_RADIUS: f32 = 1.25;

/// Most texels along each side of the filter that are asked; larger filters ask one of each cell of `2^level` texels.
const MAX_TAPS: f32 = 16.0;

/// Texels along each side of the filter from which on the cells of the next level are asked, too: all the more, the larger the
/// filter, so that nothing jumps where the level does.
const BLENDED_TAPS: f32 = 12.0;

/// Largest tangent of the angle between light and normal for which a receiver's plane is followed.
const MAX_STEEPNESS: f64 = 12.0;

/// Share of the light that arrives, 0..1.
fn face_visibility(
    face: &ShadowFace,
    options: &ShadowOptions,
    mesh_per_world: f32,
    receiver: &Receiver,
    lifted: &Lifted,
    to_light: Vec3,
) -> f32 {
    let Some(mut asked) = Asked::new(face, options, receiver, lifted, to_light) else { return 1.0 };
    let footprint = [receiver.steps[0], receiver.steps[1]].map(|step| asked.texels(face, step));
    let pixel = 0.5 * (footprint[0].abs() + footprint[1].abs());
    let texel = asked.texel_width as f32;
    let penumbra = match options.penumbra() {
        Penumbra::Sharp => 0.0,
        Penumbra::Even(half_width) => half_width * mesh_per_world / texel,
        Penumbra::Lamp(size) => {
            let size = match face.fitted.view.spread() {
                Spread::Perspective => f64::from(size * mesh_per_world),
                Spread::Parallel => f64::from(size),
            };
            let search = Vec2::splat(asked.widest_penumbra(face, size) as f32 / texel).max(pixel);
            let Some(blocker) = asked.mean_blocker_depth(face, search) else { return 1.0 };
            let gap = (asked.depth - blocker).max(0.0);
            let width = match face.fitted.view.spread() {
                Spread::Perspective => size * gap / blocker,
                Spread::Parallel => size * gap,
            };
            width as f32 / texel
        }
    };
    asked.radius = pixel.max(Vec2::splat(penumbra.max(MIN_RADIUS)));
    asked.lit_share(face)
}

/// A receiver that is lifted along its normal where light grazes it.
#[derive(Clone, Copy, Debug)]
struct Lifted {
    /// Mesh space.
    position: Vec3,
    /// Mesh units per texel at the receiver.
    texel_width: f64,
}

impl Lifted {
    /// `None` behind the lamp. `face` is the one that sees the receiver.
    fn new(face: &ShadowFace, options: &ShadowOptions, receiver: &Receiver, to_light: Vec3) -> Option<Self> {
        let straight = face.fitted.view.project(receiver.position);
        if straight.w <= 0.0 || straight.depth <= 0.0 {
            return None;
        }
        let texel_width =
            face.fitted.view.extent_at(straight.depth).max_element() / f64::from(face.resolution);
        let cosine = receiver.normal.dot(to_light).clamp(0.0, 1.0);
        let lift = options.normal_offset * (1.0 - cosine * cosine).sqrt() * texel_width as f32;
        Some(Self { position: receiver.position + receiver.normal * lift, texel_width })
    }
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
    fn new(
        face: &ShadowFace,
        options: &ShadowOptions,
        receiver: &Receiver,
        &Lifted { position: lifted, texel_width }: &Lifted,
        to_light: Vec3,
    ) -> Option<Self> {
        let side = f64::from(face.resolution);
        let projected = face.fitted.view.project(lifted);
        let inside = (projected.uv - 0.5).abs().max_element() <= 0.5;
        if !inside || projected.w <= 0.0 || projected.depth <= 0.0 {
            return None;
        }
        let depth = (projected.depth - f64::from(options.bias) * texel_width).max(projected.depth * 0.5);
        let nearness = face.fitted.nearness_of(depth);
        let steepest = MAX_STEEPNESS * texel_width * face.fitted.nearness_per_depth(depth);
        // A facet that is turned away from the lamp says nothing about the surface that the lamp sees.
        let faces_lamp = receiver.facet_normal.dot(to_light) > 0.0;
        let slope = if faces_lamp {
            let plane = face.fitted.nearness_slope(lifted.as_dvec3(), receiver.facet_normal.as_dvec3());
            (plane / side).clamp(DVec2::splat(-steepest), DVec2::splat(steepest))
        } else {
            DVec2::ZERO
        };
        let at = projected.uv * side;
        Some(Self { at, depth: projected.depth, projected, nearness, slope, texel_width, radius: Vec2::ONE })
    }

    fn texels(&self, face: &ShadowFace, step: Vec3) -> Vec2 {
        face.fitted.view.step(&self.projected, step) * face.resolution as f32
    }

    /// The share of the filter's box in which nothing is nearer than the receiver's plane, continuous in the box's place and size.
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
        match face.fitted.view.spread() {
            Spread::Perspective => size,
            Spread::Parallel => size * self.depth.min(face.fitted.far),
        }
    }

    /// Mean depth of what is nearer than the receiver around it.
    fn mean_blocker_depth(&self, face: &ShadowFace, radius: Vec2) -> Option<f64> {
        let (mut sum, mut total) = (0.0, 0.0);
        self.for_each_texel(face, radius, |nearest, own, weight| {
            if f64::from(nearest) > own {
                sum += face.fitted.depth_of(f64::from(nearest)) * f64::from(weight);
                total += f64::from(weight);
            }
        });
        (total > 0.0).then(|| sum / total)
    }

    /// Calls `visit(nearness of the map, nearness of the receiver's plane, weight)`.
    fn for_each_texel(&self, face: &ShadowFace, radius: Vec2, mut visit: impl FnMut(f32, f64, f32)) {
        let side = face.resolution;
        let [columns, rows] = [0, 1].map(|i| Span::new(self.at[i] as f32, radius[i], side));
        let levels = |span: &Span| {
            [(0, 1.0 - span.blend), (1, span.blend)].map(|(up, share)| (span.level + up, share))
        };
        for (level_y, share_y) in levels(&rows) {
            for (level_x, share_x) in levels(&columns) {
                let share = share_x * share_y;
                if share == 0.0 {
                    continue;
                }
                for (cell_y, weight_y) in rows.cells(level_y) {
                    for (cell_x, weight_x) in columns.cells(level_x) {
                        let x = texel_of(cell_x, level_x, cell_y, side);
                        let y = texel_of(cell_y, level_y, cell_x, side);
                        let from_middle = DVec2::new(f64::from(x), f64::from(y)) + 0.5 - self.at;
                        // Not below that of an empty texel, which hides nothing however far the receiver lies behind
                        // the map's end.
                        let own = (self.nearness + self.slope.dot(from_middle)).max(0.0);
                        let nearest = face.nearness[y as usize * side as usize + x as usize];
                        visit(nearest, own, weight_x * weight_y * share);
                    }
                }
            }
        }
    }
}

/// What a box covers along one axis of a map.
struct Span {
    low: f32,
    high: f32,
    side: u32,
    /// Cells have `2^level` texels: so many that no more than [`MAX_TAPS`] are covered.
    level: u32,
    /// Share of the cells of the next level, 0..1.
    blend: f32,
}

impl Span {
    fn new(middle: f32, radius: f32, side: u32) -> Self {
        let mut taps = 2.0 * radius;
        let mut level = 0;
        // Beyond the map there is nothing to ask.
        while taps > MAX_TAPS && 1 << level < side {
            taps *= 0.5;
            level += 1;
        }
        let blend = ((taps - BLENDED_TAPS) / (MAX_TAPS - BLENDED_TAPS)).clamp(0.0, 1.0);
        Self { low: middle - radius, high: middle + radius, side, level, blend }
    }

    /// The cells that the box touches, and how many texels of them it covers. They lie fixed in the map.
    fn cells(&self, level: u32) -> impl Iterator<Item = (u32, f32)> {
        let cell = |c: f32| (c.max(0.0) as u32).min(self.side - 1) >> level;
        (cell(self.low)..=cell(self.high)).map(move |i| {
            let (first, end) = (i << level, ((i + 1) << level).min(self.side));
            let covered = self.high.min(end as f32) - self.low.max(first as f32);
            (i, covered.max(0.0))
        })
    }
}

/// The texel that stands for a cell along one axis: another one in each of neighbouring rows of cells (`beside` is the cell's
/// place along the other axis), so that edges along an axis are as smooth as others (J. van der Corput's sequence).
fn texel_of(cell: u32, level: u32, beside: u32, side: u32) -> u32 {
    let within = beside.reverse_bits() >> (31 - level) >> 1;
    ((cell << level) + within).min(side - 1)
}
