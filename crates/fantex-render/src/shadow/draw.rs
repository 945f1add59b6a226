//! Drawing a map: the nearest surface under the middle of every texel.

use fantex_mesh::Mesh;
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::ShadowFace;
use crate::clip::{clip, screen};
use crate::fixed::{SUBPIXELS, doubled_area, snap};
use crate::hit::{Hit, Interpolation, ScreenBarycentrics};
use crate::pattern::SamplePattern;
use crate::primitive::{CHUNK, Chunk, Primitive, TILE, TileGrid};
use crate::raster::{Fragment, TileSamples};
use crate::{Coverage, Surface};
use fantex_scene::{FittedView, Spread};

/// What lets more light through than this casts no shadow.
const LEAST_ALPHA: f32 = 0.5;

/// Draws one map. Both sides of every triangle that casts shadows do; layered ones where their alpha is at least a half.
pub(super) fn draw(fitted: FittedView, resolution: u32, mesh: &Mesh, surface: &dyn Surface) -> ShadowFace {
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
            if own > *nearest
                && self.alpha(fragment, Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) >= LEAST_ALPHA
            {
                *nearest = own;
            }
        }
        nearness
    }

    /// The opacity of a layered triangle in the middle of a texel.
    fn alpha(&self, fragment: &Fragment, texel: Vec2) -> f32 {
        let triangle = fragment.triangle as usize;
        let corners = self.mesh.triangle_positions(triangle);
        let projected = corners.map(|p| self.projected(p));
        let [lambda, dlambda_dx, dlambda_dy] =
            ScreenBarycentrics::new(projected, Interpolation::Perspective).at(texel);
        let [a, b, c] = corners;
        let to_lamp = match self.face.view.spread() {
            Spread::Perspective => {
                let p = a * lambda.x + b * lambda.y + c * lambda.z;
                (self.face.view.origin - p.as_dvec3()).as_vec3().normalize_or(Vec3::Y)
            }
            Spread::Parallel => -self.face.view.forward().as_vec3(),
        };
        let front = (b - a).cross(c - a).dot(to_lamp) >= 0.0;
        let hit = Hit { triangle, lambda, dlambda_dx, dlambda_dy, front, to_eye: to_lamp };
        self.surface.alpha(&hit)
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
