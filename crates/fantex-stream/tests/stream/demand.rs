//! Demand against a reference that looks at every triangle, point by point.

use std::sync::Arc;

use fantex_cover::{CoverOptions, Group, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, clean, generate, interpolate};
use fantex_store::{PAGE, PageId};
use fantex_stream::{
    AtlasShape, CoveredMesh, Detail, FrameOptions, LoadedParcel, Parcel, ParcelLoader, StreamView, Streamer,
    StreamerOptions,
};
use fantex_texture::filter::FootprintAxes;
use glam::{Mat3, Vec2, Vec3};
use proptest::prelude::*;

fn covered(model: fantex_mesh::Model, texels: u64, tile: u32, double_sided: bool) -> CoveredMesh {
    let (mut mesh, _) = clean(model, &CleanOptions::default()).unwrap();
    mesh.materials.iter_mut().for_each(|m| m.double_sided = double_sided);
    let options = CoverOptions { budget: TexelBudget::Total(texels), tile, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    CoveredMesh { mesh, cover }
}

fn look(eye: Vec3, target: Vec3, fov_degrees: f32) -> StreamView {
    let back = (eye - target).normalize();
    let right = Vec3::Y.cross(back).try_normalize().unwrap_or(Vec3::X);
    let axes = Mat3::from_cols(right, back.cross(right), back);
    StreamView::new(eye, axes, fov_degrees.to_radians(), [1280, 720])
}

/// What a point's look-ups read.
struct Reading {
    group: u32,
    uv: Vec2,
    /// Width of the pixel in texels of level 0.
    width: f32,
    /// The finer of the two levels; the number of levels for the mean alone.
    level: u32,
}

/// The rules of the renderer's look-up.
fn finest_level_read(group: &Group, footprint: [Vec2; 2], anisotropy: f32) -> (f32, u32) {
    let width = |level: u32| {
        let extent = Vec2::from(group.level_extent(level).map(|n| n as f32));
        let [dx, dy] = footprint.map(|d| d * extent);
        FootprintAxes::new(dx, dy).limited_minor(anisotropy)
    };
    let (finest, last) = (width(0), group.level_count() - 1);
    let mut level = 0;
    while width(level) > 1.0 && level < last && width(level + 1) > 1.0 {
        level += 1;
    }
    let mean_only = level == last && width(level) >= 4.0;
    (finest, level + u32::from(mean_only))
}

fn readings(geometry: &CoveredMesh, view: &StreamView, anisotropy: f32, steps: u32) -> Vec<Reading> {
    let CoveredMesh { mesh, cover } = geometry;
    let mut readings = Vec::new();
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t);
        let normal = (b - a).cross(c - a).normalize();
        let double_sided = mesh.materials[mesh.material_of(t)].double_sided;
        for (i, j) in (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| (i, j))) {
            let lambda = Vec3::new(i as f32, j as f32, (steps - i - j) as f32) / steps as f32;
            let p = interpolate([a, b, c], lambda);
            let ray = p - view.eye;
            let depth = -ray.dot(view.axes.z_axis);
            let [x, y] = [ray.dot(view.axes.x_axis), ray.dot(view.axes.y_axis)].map(|n| (n / depth).abs());
            let facing = -normal.dot(ray);
            if depth <= 1e-6
                || x > view.half_extent[0]
                || y > view.half_extent[1]
                || facing.abs() < 1e-6
                || (facing < 0.0 && !double_sided)
            {
                continue;
            }
            // The way on the surface from one pixel to the next, along the picture's axes.
            let steps = [view.axes.x_axis, view.axes.y_axis]
                .map(|axis| (axis - ray * (axis.dot(normal) / ray.dot(normal))) * depth / view.focal_pixels);
            for (slot, _) in cover.weights(t, lambda).iter() {
                let group_index = cover.corner_groups[t][slot];
                let group = &cover.groups[group_index as usize];
                let uv = cover.tile_corners(mesh, t, slot);
                // Barycentric derivatives of the way.
                let (e1, e2) = (b - a, c - a);
                let (d11, d12, d22) = (e1.dot(e1), e1.dot(e2), e2.dot(e2));
                let footprint = steps.map(|d| {
                    let (r1, r2) = (d.dot(e1), d.dot(e2));
                    let determinant = d11 * d22 - d12 * d12;
                    let (l1, l2) = ((d22 * r1 - d12 * r2) / determinant, (d11 * r2 - d12 * r1) / determinant);
                    (uv[1] - uv[0]) * l1 + (uv[2] - uv[0]) * l2
                });
                let (width, level) = finest_level_read(group, footprint, anisotropy);
                let uv = interpolate(uv, lambda);
                readings.push(Reading { group: group_index, uv, width, level });
            }
        }
    }
    readings
}

/// How much finer than needed.
#[derive(Debug, Default)]
struct Excess {
    levels: f64,
    groups: u64,
    most: f64,
    unseen: u64,
}

/// Compares demand with the reference: nothing that is read may be missing.
fn compare(
    geometry: &CoveredMesh,
    streamer: &Streamer,
    view: &StreamView,
    anisotropy: f32,
    steps: u32,
    excess: &mut Excess,
) {
    let statistics = streamer.statistics();
    assert!(statistics.bias_levels == 0.0 && !streamer.has_backlog());
    let mut least = vec![f32::INFINITY; geometry.cover.groups.len()];
    for Reading { group, uv, width, level } in readings(geometry, view, anisotropy, steps) {
        least[group as usize] = least[group as usize].min(width);
        let shape = &geometry.cover.groups[group as usize];
        if level == shape.level_count() {
            continue;
        }
        let detail = streamer.detail(group);
        assert!(
            demanded(detail) <= width.log2().max(0.0) + 1e-4,
            "group {group} is read at level {level}, width {width}, but {detail:?} is wanted"
        );
        let extent = Vec2::from(shape.level_extent(level).map(|n| n as f32));
        let texel = (uv * extent).clamp(Vec2::ZERO, extent - 1.0);
        let page = PageId { group, level, page: [texel.x as u32 / PAGE, texel.y as u32 / PAGE] };
        assert!(streamer.is_missing(Parcel::of(shape, page)), "{page} is read but not wanted");
    }
    for (group, width) in (0..).zip(least) {
        let detail = streamer.detail(group);
        if detail.is_visible() && width.is_finite() {
            let more = f64::from(width.log2().max(0.0) - demanded(detail));
            excess.levels += more;
            excess.most = excess.most.max(more);
            excess.groups += 1;
        } else if detail.is_visible() {
            excess.unseen += 1;
        }
    }
}

/// The width that a detail stands for, as a binary logarithm.
fn demanded(detail: Detail) -> f32 {
    f32::from(detail.0) / Detail::STEPS as f32
}

/// Brings nothing, so that all that is needed stays missing.
struct NoLoader;

impl ParcelLoader for NoLoader {
    fn request(&mut self, _: Parcel, _: f32) {}

    fn cancel(&mut self, _: Parcel) {}

    fn poll(&mut self, _: usize) -> Vec<LoadedParcel> {
        Vec::new()
    }

    fn pending(&self) -> usize {
        0
    }
}

/// Takes over all demand in every update, without a bias.
fn streamer(geometry: &CoveredMesh, max_anisotropy: f32) -> Streamer {
    let atlas = AtlasShape { side: 8192, layers: 16 };
    let (look_ahead_seconds, frame_nanoseconds) = (0.0, 1 << 30);
    let options = StreamerOptions {
        atlas,
        max_anisotropy,
        look_ahead_seconds,
        frame_nanoseconds,
        ..Default::default()
    };
    Streamer::new(Arc::new(geometry.clone()), Box::new(NoLoader), options)
}

/// The excess over several views of a model; each view is reached by moving.
fn excess(name: &str, geometry: &CoveredMesh, anisotropy: f32, distances: &[f32]) -> Excess {
    let mut streamer = streamer(geometry, anisotropy);
    let mut excess = Excess::default();
    for (i, &distance) in distances.iter().enumerate() {
        let angle = i as f32 * 2.4;
        let eye = Vec3::new(angle.sin(), 0.4, angle.cos()).normalize() * distance;
        for step in 0..3 {
            let eye = eye * (1.0 + 0.004 * step as f32);
            let view = look(eye, Vec3::new(0.1, 0.0, 0.0), 50.0);
            streamer.update(Some(&view), FrameOptions::default());
            compare(geometry, &streamer, &view, anisotropy, 5, &mut excess);
        }
    }
    let mean = excess.levels / excess.groups.max(1) as f64;
    let unseen = 100.0 * excess.unseen as f64 / (excess.groups + excess.unseen).max(1) as f64;
    println!(
        "{name:24} anisotropy {anisotropy:2}: {mean:.2} levels too fine on average, {:.2} at most, {unseen:.1} % of the \
         wanted groups not seen",
        excess.most
    );
    excess.levels = mean;
    excess
}

#[test]
fn nothing_that_is_read_is_missing_and_little_else_is_wanted() {
    let distances = [6.0, 2.5, 1.6, 1.2];
    for anisotropy in [16.0, 1.0] {
        for (name, geometry, limit) in [
            ("icosphere, one fan each", covered(generate::icosphere(4), 1 << 22, 0, false), 0.6),
            ("torus, tiles of 64", covered(generate::torus(96, 48), 1 << 20, 64, false), 0.8),
            ("torus, double-sided", covered(generate::torus(96, 48), 1 << 20, 64, true), 0.8),
            // Where tiles bend around an edge, one face of the cube asks for what the other is seen at a slant.
            ("cube, large tiles", covered(generate::cube(4), 6 << 20, 2048, false), 1.2),
            ("landscape, tiles of 64", covered(land(), 1 << 21, 64, false), 0.5),
        ] {
            let excess = excess(name, &geometry, anisotropy, &distances);
            assert!(excess.groups > 0);
            assert!(excess.levels < limit, "{name}: {} levels too fine", excess.levels);
        }
    }
}

/// Coarse pages of the only tile hold so many triangles that they are bounded by chunks of them.
#[test]
fn pages_of_many_triangles_are_demanded_as_they_are_seen() {
    let geometry = covered(generate::grid(160), 4 << 20, 4096, true);
    for anisotropy in [16.0, 1.0] {
        let mut streamer = streamer(&geometry, anisotropy);
        let mut excess = Excess::default();
        for eye in [Vec3::new(0.8, 1.2, 0.5), Vec3::new(0.3, 0.3, 0.2)] {
            let view = look(eye, Vec3::new(0.1, 0.0, 0.0), 50.0);
            streamer.update(Some(&view), FrameOptions::default());
            compare(&geometry, &streamer, &view, anisotropy, 1, &mut excess);
        }
        let mean = excess.levels / excess.groups as f64;
        assert!(excess.groups > 0 && mean < 1.5, "{mean} levels too fine");
    }
}

/// Several streamers share the work of a frame.
#[test]
fn an_update_does_the_work_that_it_is_given() {
    let geometry = covered(generate::icosphere(5), 1 << 22, 0, false);
    let mut streamer = streamer(&geometry, 16.0);
    let view = look(Vec3::new(0.0, 0.4, 2.5), Vec3::ZERO, 50.0);
    let mut requests = 0;
    for nanoseconds in [10_000, 10_000, 1 << 30] {
        streamer.set_frame_nanoseconds(nanoseconds);
        streamer.update(Some(&view), FrameOptions::default());
        let (used, now) = (streamer.used_nanoseconds(), streamer.statistics().requests);
        assert!(used > 0 && used < nanoseconds + 30_000, "{used} of {nanoseconds}");
        let asked = now - std::mem::replace(&mut requests, now);
        assert!(if nanoseconds == 10_000 { asked < 50 } else { asked > 100 }, "{asked} in {nanoseconds}");
    }
}

fn land() -> fantex_mesh::Model {
    let options = generate::LandscapeOptions { triangles: 20_000, ..Default::default() };
    generate::landscape(&options).unwrap().into()
}

#[test]
fn a_bunny_is_demanded_as_it_is_seen() {
    let Some(geometry) = bunny(64) else { return };
    let excess = excess("bunny, tiles of 64", &geometry, 16.0, &[4.0, 1.5]);
    assert!(excess.levels < 1.0);
}

fn bunny(tile: u32) -> Option<CoveredMesh> {
    let path = fantex_test::data("meshes/bunny/stanford_bunny.ply")?;
    let model = fantex_mesh::load(&path, &fantex_mesh::LoadOptions::default()).unwrap();
    Some(covered(model, 4 << 20, tile, false))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Along any path: what was kept from earlier views is still enough, and is nearly what a fresh look gives.
    #[test]
    fn what_is_kept_between_views_stays_valid(
        points in prop::collection::vec((-2.0f32..2.0, -2.0f32..2.0, -2.0f32..2.0), 3..5),
        steps in 2usize..12,
        tile in prop::sample::select(vec![0u32, 48, 512]),
        anisotropy in prop::sample::select(vec![1.0f32, 16.0]),
        double_sided: bool,
    ) {
        let geometry = covered(generate::torus(32, 16), 1 << 19, tile, double_sided);
        let mut kept = streamer(&geometry, anisotropy);
        let mut fresh = streamer(&geometry, anisotropy);
        let points: Vec<Vec3> = points.into_iter().map(Vec3::from).collect();
        for (from, to) in points.iter().zip(&points[1..]) {
            for step in 0..steps {
                let eye = from.lerp(*to, step as f32 / steps as f32);
                let target = to.lerp(*from, 0.3) * 0.3;
                if eye.distance(target) < 1e-3 {
                    continue;
                }
                let view = look(eye, target, 60.0);
                kept.update(Some(&view), FrameOptions::default());
                compare(&geometry, &kept, &view, anisotropy, 2, &mut Excess::default());
                // Without a view all is forgotten.
                for view in [None, Some(&view)] {
                    fresh.update(view, FrameOptions::default());
                }
                for group in 0..geometry.cover.groups.len() as u32 {
                    let (kept, fresh) = (kept.detail(group), fresh.detail(group));
                    if kept.is_visible() && fresh.is_visible() {
                        prop_assert!(kept.0.abs_diff(fresh.0) <= 4 || kept.0.min(fresh.0) < 8, "{kept:?} {fresh:?}");
                    }
                }
            }
        }
    }
}
