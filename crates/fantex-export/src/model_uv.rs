//! The model's own texture coordinates: a picture for every material.

use fantex_base::{Error, Result};
use fantex_mesh::Mesh;
use glam::{DVec3, Vec2};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::charts::doubled_area;
use crate::layout::{Layout, MIN_CHOSEN_SIDE, NOBODY, Page, Placed};

/// Pictures that a triangle's coordinates may reach over, along each side.
const MAX_REPEATS: i32 = 64;

/// Triangles in a picture at most, where one that reaches over several pictures counts once for each: they take some 50 bytes.
const MAX_COPIES: usize = 1 << 24;

/// The texture coordinates that the asset kept of its model.
pub(crate) fn uv_of_asset(mesh: &Mesh) -> Result<Vec<[Vec2; 3]>> {
    let uv = mesh.corners.uv_sets.first().filter(|uv| uv.len() == 3 * mesh.triangles.len());
    uv.map(|uv| uv.as_chunks().0.to_vec()).ok_or_else(|| {
        Error::not_found(
            "the asset holds no texture coordinates of its model; leave --uv source out, or give the model that has some with \
             --model",
        )
    })
}

/// The texture coordinates of a model with the same triangles, in whatever order.
///
/// # Errors
/// The model has none, or a triangle of the asset is not one of its triangles.
pub(crate) fn uv_of_model(mesh: &Mesh, model: &Mesh) -> Result<Vec<[Vec2; 3]>> {
    let uv = uv_of_asset(model).map_err(|_| {
        Error::not_found(
            "the model has no texture coordinates; leave --uv and --model out for an own packing",
        )
    })?;
    let mut places = Places::new(mesh.world_from_mesh.scale.abs());
    let world = |mesh: &Mesh, v: u32| mesh.world_from_mesh.point(mesh.positions[v as usize]);
    let names: Vec<u32> = (0..model.positions.len() as u32).map(|v| places.name(world(model, v))).collect();
    // By its smallest name first, and which corner that is.
    let turned = |names: [u32; 3]| {
        let first = (0..3).min_by_key(|&k| names[k]).unwrap_or(0);
        ([0, 1, 2].map(|k| names[(first + k) % 3]), first)
    };
    let mut by_names = FxHashMap::default();
    for (t, triangle) in model.triangles.iter().enumerate() {
        let (key, first) = turned(triangle.map(|v| names[v as usize]));
        by_names.entry(key).or_insert((t, first));
    }
    let found = |t: usize| {
        let at = |k: usize| places.find(world(mesh, mesh.triangles[t][k]));
        let triangle = || Some([at(0)?, at(1)?, at(2)?]);
        let known = triangle().map(turned).and_then(|(key, first)| Some((*by_names.get(&key)?, first)));
        let ((other, other_first), first) = known.ok_or_else(|| {
            Error::unsupported(format!(
                "triangle {t} of the asset is none of the model's; give the model that the asset was baked from"
            ))
        })?;
        Ok([0, 1, 2].map(|k| uv[other][(k + 3 - first + other_first) % 3]))
    };
    // Collected as they are: a parallel collection into one `Result` names any of the errors, not the first.
    let all: Vec<Result<_, _>> = (0..mesh.triangles.len()).into_par_iter().map(found).collect();
    all.into_iter().collect()
}

/// Corners of the asset have the model's nearest position within this share of the model's half size: files with few digits.
const MATCH_SHARE: f64 = 1e-5;

/// Positions of the model closer than this share count as one: roundings to single precision.
const SAME_SHARE: f64 = 2.5e-7;

/// Points by their places: those that lie together have one name.
struct Places {
    /// Side of a cell, and how far from a named point its name is found.
    length: f64,
    /// How close points with one name lie.
    same: f64,
    cells: FxHashMap<[i64; 3], Vec<u32>>,
    points: Vec<DVec3>,
}

impl Places {
    /// For a model of that half size.
    fn new(half_size: f64) -> Self {
        let [length, same] =
            [MATCH_SHARE, SAME_SHARE].map(|share| (share * half_size).max(f64::MIN_POSITIVE));
        Self { length, same, cells: FxHashMap::default(), points: Vec::new() }
    }

    fn cell(&self, point: DVec3) -> [i64; 3] {
        (point / self.length).floor().to_array().map(|x| x as i64)
    }

    /// The nearest named point's name.
    fn find(&self, point: DVec3) -> Option<u32> {
        self.nearest(point, self.length)
    }

    fn nearest(&self, point: DVec3, within: f64) -> Option<u32> {
        let [x, y, z] = self.cell(point);
        let near = |c: i64| c.saturating_sub(1)..=c.saturating_add(1);
        let cells = near(x).flat_map(|x| near(y).flat_map(move |y| near(z).map(move |z| [x, y, z])));
        let names = cells.filter_map(|cell| self.cells.get(&cell)).flatten();
        let distances = names.map(|&name| (self.points[name as usize].distance_squared(point), name));
        let nearest = distances.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        nearest.filter(|&(squared, _)| squared <= within * within).map(|(_, name)| name)
    }

    /// The point's name; a new one where no named point is near.
    fn name(&mut self, point: DVec3) -> u32 {
        self.nearest(point, self.same).unwrap_or_else(|| {
            let name = self.points.len() as u32;
            self.points.push(point);
            self.cells.entry(self.cell(point)).or_default().push(name);
            name
        })
    }
}

/// Lays the triangles out by given coordinates: a picture for every material, since materials may use the same coordinates.
///
/// # Errors
/// Coordinates that are not finite, or reach over too many pictures.
pub(crate) fn model_uv(
    mesh: &Mesh,
    uv: Vec<[Vec2; 3]>,
    texels_per_unit: f32,
    side: Option<u32>,
    largest_side: u32,
) -> Result<Layout> {
    let mut by_material: Vec<Vec<u32>> = vec![Vec::new(); mesh.materials.len().max(1)];
    (0..mesh.triangles.len()).for_each(|t| by_material[mesh.material_of(t)].push(t as u32));
    let mut layout = Layout { page_of_material: vec![None; by_material.len()], ..Layout::default() };
    let (mut texels, mut area) = (0.0, 0.0);
    for (material, triangles) in by_material.iter().enumerate().filter(|(_, t)| !t.is_empty()) {
        // Triangles that lie in a point or on a line, as those of a palette do, ask for no density.
        let (mut uv_area, mut mesh_area, mut points) = (0.0, 0.0, Vec::new());
        for &t in triangles {
            let [a, b, c] = uv[t as usize];
            let own = 0.5 * (b - a).perp_dot(c - a).abs();
            if own > MIN_UV_AREA {
                uv_area += own;
                mesh_area += 0.5 * doubled_area(mesh, t as usize);
            } else {
                points.push((a + b + c) / 3.0);
            }
        }
        layout.points += points.len();
        let wanted = if uv_area > 0.0 { texels_per_unit * (mesh_area / uv_area).sqrt() } else { 0.0 };
        let side = side.unwrap_or_else(|| {
            // A few percent are not worth four times the texels.
            let wanted = (wanted * 0.9).max(side_that_parts(&points)).min(largest_side as f32);
            (wanted.ceil() as u32).max(MIN_CHOSEN_SIDE).next_power_of_two().min(largest_side)
        });
        texels += uv_area * (side as f32).powi(2);
        area += mesh_area;
        let mut page = Page { side, block: side, ..Page::default() };
        for &t in triangles {
            layout.repeats |= place(t, uv[t as usize], &mut page)?;
        }
        layout.page_of_material[material] = Some(layout.pages.len());
        layout.pages.push(page);
    }
    layout.texels_per_unit = if area > 0.0 { (texels / area).sqrt() } else { texels_per_unit };
    layout.uv = uv;
    Ok(layout)
}

/// A triangle with less area in texture coordinates is a point or a line.
const MIN_UV_AREA: f32 = 1e-12;

/// The side of the largest picture that is made for points alone.
const MAX_SIDE_OF_POINTS: f32 = 2048.0;

/// Columns that put points into different texels, with the texels beside their own: twice those of the palette that they point into.
fn side_that_parts(points: &[Vec2]) -> f32 {
    let least = |coordinate: fn(&Vec2) -> f32| {
        let mut sorted: Vec<f32> = points.iter().map(coordinate).collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let gaps = sorted.windows(2).map(|pair| pair[1] - pair[0]);
        // Nearer ones are one.
        gaps.filter(|&gap| gap * MAX_SIDE_OF_POINTS > 1.0).fold(f32::INFINITY, f32::min)
    };
    (2.0 / least(|p| p.x).min(least(|p| p.y))).min(MAX_SIDE_OF_POINTS)
}

/// Puts a triangle into a picture as often as its repetitions meet it. True where it goes beyond 0..1 by more than half a texel: for less, as
/// of coordinates that were rounded, a picture that ends there does, and one that repeats would mix in the colours of its other side.
fn place(triangle: u32, uv: [Vec2; 3], page: &mut Page) -> Result<bool> {
    let (low, high) = (uv[0].min(uv[1]).min(uv[2]), uv[0].max(uv[1]).max(uv[2]));
    let range = || {
        let (low, high) = (low.to_array(), high.to_array());
        Error::unsupported(format!(
            "the texture coordinates of triangle {triangle} reach from {low:?} to {high:?}; use an own packing (without --uv)"
        ))
    };
    if !(low.is_finite() && high.is_finite() && low.abs().max(high.abs()).max_element() < 1e6) {
        return Err(range());
    }
    let first = low.floor().as_ivec2();
    let last = (high.ceil().as_ivec2() - 1).max(first);
    let count = last - first + 1;
    if count.x.max(count.y) > MAX_REPEATS {
        return Err(range());
    }
    let copies = (count.x * count.y) as usize;
    if copies > 1 && page.placed.len() + copies > MAX_COPIES {
        return Err(Error::too_large(format!(
            "the texture coordinates repeat so often that a picture would have more than {MAX_COPIES} triangles; use an own packing \
             (without --uv)"
        )));
    }
    for y in first.y..=last.y {
        for x in first.x..=last.x {
            let shift = Vec2::new(x as f32, y as f32);
            let corners = uv.map(|c| (c - shift) * page.side as f32);
            page.placed.push(Placed { triangle, chart: 0, corners, continues: NOBODY });
        }
    }
    let margin = 0.5 / page.side as f32;
    Ok(low.min_element() < -margin || high.max_element() > 1.0 + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding moves corners over the borders of any grid: names hold all the same.
    #[test]
    fn a_model_is_known_by_its_places_wherever_they_lie() {
        let mut places = Places::new(1.0);
        let mut random = fantex_base::Random::new(4);
        // Every one lies where two cells meet.
        let points: Vec<DVec3> = (0..300)
            .map(|_| DVec3::from_array([0; 3].map(|_| (random.below(20_000) as f64 - 10_000.0) * 1e-5)))
            .collect();
        let names: Vec<u32> = points.iter().map(|&p| places.name(p)).collect();
        for (&p, &name) in points.iter().zip(&names) {
            let moved = p + DVec3::from_array([0; 3].map(|_| (random.unit() - 0.5) * 2e-7));
            assert_eq!((places.find(moved), places.name(moved)), (Some(name), name));
            let moved = p + DVec3::from_array([0; 3].map(|_| (random.unit() - 0.5) * 8e-6));
            assert_eq!(places.find(moved), Some(name));
        }
        assert_eq!(places.find(DVec3::splat(0.5)), None);
    }

    #[test]
    fn pictures_repeat_only_where_coordinates_leave_them() {
        for (most, repeats) in [(0.5, false), (1.0, false), (1.0 + 1e-6, false), (1.5, true), (-0.5, true)] {
            let mut page = Page { side: 64, block: 64, ..Page::default() };
            let corners = [Vec2::ZERO, Vec2::new(most, 0.0), Vec2::new(0.0, most)];
            assert_eq!(place(0, corners, &mut page).unwrap(), repeats, "{most}");
        }
    }

    #[test]
    fn small_details_are_told_apart() {
        for spacing in [6e-7, 2e-6, 6e-6, 9.5e-6, 1e-4] {
            let mut places = Places::new(1.0);
            let points: Vec<DVec3> =
                (0..81).map(|k| DVec3::new(f64::from(k % 9), f64::from(k / 9), 0.0) * spacing).collect();
            let names: Vec<u32> = points.iter().map(|&p| places.name(p)).collect();
            assert_eq!(names, (0..81).collect::<Vec<u32>>());
            assert!(points.iter().zip(names).all(|(&p, name)| places.find(p) == Some(name)), "{spacing}");
        }
    }
}
