//! Texture coordinates for a mesh, without an asset.

use fantex_bake::{NoProgress, Progress};
use fantex_base::{Error, ErrorKind, Result};
use fantex_mesh::{CleanOptions, CornerOrigins, Mesh, Model, clean_traced};
use glam::{DVec3, Vec2};
use rustc_hash::FxHashMap;

use crate::layout::{AtlasRequest, coordinates};
use crate::vertex_copies::VertexCopies;
use crate::{ExportOptions, MAX_SIDE};

/// How a mesh is unwrapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnwrapOptions {
    /// Columns and rows of a square picture, a power of two.
    pub side: u32,
    /// Texels that are a chart's own around it, a power of two up to [`MAX_PADDING`](crate::MAX_PADDING); without it, a 128th of the
    /// side, 2 to 16, less where there are very many charts.
    pub padding: Option<u32>,
    /// The picture is that square. Else it has any sides that hold the charts well, of whole paddings, and about as many texels at most: less
    /// of it stays empty where charts are few.
    pub is_square: bool,
}

impl Default for UnwrapOptions {
    /// A square of 2048 texels a side.
    fn default() -> Self {
        Self { side: 2048, padding: None, is_square: true }
    }
}

/// Texture coordinates of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unwrapped {
    /// Of each triangle's corners, 0..1 along both sides of the picture, origin top left, v downwards.
    pub uv: Vec<[Vec2; 3]>,
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// Pieces.
    pub charts: usize,
    /// Texels around every piece that are its own.
    pub padding: u32,
}

/// Cuts a mesh into few charts that see the surface at little stretch, and packs them into a picture.
///
/// # Errors
/// An option is out of its range, or there are too many charts for the picture.
pub fn unwrap_mesh(mesh: &Mesh, options: &UnwrapOptions) -> Result<Unwrapped> {
    unwrap_with(mesh, options, &NoProgress).map_err(|error| error.context("cannot unwrap the mesh"))
}

fn check(options: &UnwrapOptions) -> Result<()> {
    let UnwrapOptions { side, padding, .. } = *options;
    ExportOptions { side: Some(side), padding, ..ExportOptions::default() }.check()
}

fn unwrap_with(mesh: &Mesh, options: &UnwrapOptions, progress: &dyn Progress) -> Result<Unwrapped> {
    check(options)?;
    let UnwrapOptions { side, padding, is_square } = *options;
    let texels_per_unit = (f64::from(side).powi(2) / mesh.area()).sqrt() as f32;
    let request =
        AtlasRequest { texels_per_unit, texels: None, side: Some(side), largest_side: side, padding };
    let (uv, charts, packed) = coordinates(mesh, &request, is_square, progress)?;
    Ok(Unwrapped { uv, size: packed.size(), charts, padding: packed.block })
}

/// A mesh whose vertices are split where texture coordinates differ: one coordinate for each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplitMesh {
    /// The vertex that each was before.
    pub vertices: Vec<u32>,
    /// Indices into `vertices`, as many triangles as before, in their order.
    pub triangles: Vec<[u32; 3]>,
    /// Of each vertex, 0..1, origin top left, v downwards.
    pub uv: Vec<Vec2>,
}

impl SplitMesh {
    /// Splits the vertices of triangles; `uv`: of each triangle's corners.
    pub fn new(triangles: &[[u32; 3]], uv: &[[Vec2; 3]]) -> Self {
        let mut split = Self::default();
        let count = triangles.as_flattened().iter().max().map_or(0, |&last| last as usize + 1);
        let mut copies = VertexCopies::new(count);
        let mut copy = |vertex: u32, uv: Vec2| {
            let (copy, is_new) = copies.find_or_add(vertex, uv.to_array().map(f32::to_bits));
            if is_new {
                split.vertices.push(vertex);
                split.uv.push(uv);
            }
            copy
        };
        let corners = triangles.iter().zip(uv);
        split.triangles = corners.map(|(vertices, uv)| [0, 1, 2].map(|k| copy(vertices[k], uv[k]))).collect();
        split
    }
}

/// Unwraps triangles as they come: repeated, without area, with positions that are no numbers. Each gets coordinates: one that repeats
/// another has the other's, one without area lies in a point. Where there are more pieces than the square holds, it grows up to
/// [`MAX_SIDE`] texels a side. `size` is that in the end. `clean` says which vertices are joined.
///
/// # Errors
/// An index or an option is out of its range, there are more pieces than the largest square holds, or `progress` asked to stop.
pub fn unwrap_triangles(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    clean: &CleanOptions,
    options: &UnwrapOptions,
    progress: &dyn Progress,
) -> Result<(SplitMesh, Unwrapped)> {
    let refused = |error: Error| error.context("cannot unwrap the mesh");
    check(options).map_err(refused)?;
    let wrong = |(_, t): &(usize, &[u32; 3])| t.iter().any(|&v| v as usize >= positions.len());
    if let Some((i, t)) = triangles.iter().enumerate().find(wrong) {
        let count = positions.len();
        let message = format!("triangle {i} has the vertices {t:?}, but there are {count} positions");
        return Err(refused(Error::invalid(message)));
    }
    let model = Model {
        name: "the mesh".to_owned(),
        positions: positions.to_vec(),
        triangles: triangles.to_vec(),
        ..Model::default()
    };
    let mut corners = vec![[Vec2::ZERO; 3]; triangles.len()];
    let (mesh, _, origins) = match clean_traced(model, clean) {
        Ok(cleaned) => cleaned,
        // Nothing has an area.
        Err(error) if error.kind() == ErrorKind::Malformed => {
            let unwrapped = Unwrapped { size: [options.side; 2], ..Unwrapped::default() };
            return Ok((SplitMesh::new(triangles, &corners), unwrapped));
        }
        Err(error) => return Err(refused(error)),
    };
    let mut options = *options;
    let unwrapped = loop {
        match unwrap_with(&mesh, &options, progress) {
            Err(error) if error.kind() == ErrorKind::TooLarge && options.side < MAX_SIDE => options.side *= 2,
            result => break result.map_err(refused)?,
        }
    };
    let mut is_laid = vec![false; triangles.len()];
    for (t, uv) in unwrapped.uv.iter().enumerate() {
        let source = origins.triangle(t);
        (0..3).for_each(|k| corners[source][origins.corner(t, k)] = uv[k]);
        is_laid[source] = true;
    }
    lay_rest(positions, triangles, &mesh, &origins, &is_laid, &mut corners);
    Ok((SplitMesh::new(triangles, &corners), unwrapped))
}

/// Coordinates of the triangles that cleaning has dropped.
fn lay_rest(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    mesh: &Mesh,
    origins: &CornerOrigins,
    is_laid: &[bool],
    corners: &mut [[Vec2; 3]],
) {
    if is_laid.iter().all(|&laid| laid) {
        return;
    }
    // Where a vertex of the input is in the mesh, one of its coordinates, and which triangle has three such vertices in their order.
    let mut of_vertex: FxHashMap<u32, (u32, Vec2)> = FxHashMap::default();
    let mut of_triangle: FxHashMap<[u32; 3], usize> = FxHashMap::default();
    // Loose triangles have vertices of their own at the same places.
    let mut at_place: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    let place = |vertex: u32| positions[vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
    for (t, vertices) in mesh.triangles.iter().enumerate() {
        let source = origins.triangle(t);
        for (k, &vertex) in vertices.iter().enumerate() {
            let corner = origins.corner(t, k);
            let own = triangles[source][corner];
            of_vertex.entry(own).or_insert((vertex, corners[source][corner]));
            at_place.entry(place(own)).or_insert(own);
        }
        let welded = triangles[source].map(|v| of_vertex[&v].0);
        of_triangle.entry(rotated(welded).0).or_insert(source);
    }
    for (i, t) in triangles.iter().enumerate().filter(|&(i, _)| !is_laid[i]) {
        let known = t.map(|v| {
            let same = || of_vertex.get(at_place.get(&place(v))?);
            of_vertex.get(&v).or_else(same).copied()
        });
        if let [Some((a, _)), Some((b, _)), Some((c, _))] = known {
            let (key, turn) = rotated([a, b, c]);
            if let Some(&twin) = of_triangle.get(&key) {
                let twin_turn = rotated(triangles[twin].map(|v| of_vertex[&v].0)).1;
                corners[i] = [0, 1, 2].map(|k| corners[twin][(k + 3 - turn + twin_turn) % 3]);
                continue;
            }
        }
        corners[i] = [known.into_iter().flatten().next().map_or(Vec2::ZERO, |(_, uv)| uv); 3];
    }
}

/// A triangle that begins with its smallest vertex, and which corner that was.
fn rotated([a, b, c]: [u32; 3]) -> ([u32; 3], usize) {
    match a.min(b).min(c) {
        least if least == a => ([a, b, c], 0),
        least if least == b => ([b, c, a], 1),
        _ => ([c, a, b], 2),
    }
}
