//! The same shape with fewer triangles.
//!
//! Edges collapse onto one of their ends in the order of the error that this leaves, the squared distance to the planes of the
//! triangles that were there (M. Garland and P. Heckbert, "Surface simplification using quadric error metrics", 1997), and loose
//! pieces go that are smaller than the error. Where that does not get near the number that is wanted, as on many non-manifold pieces,
//! vertices are united within the cells of a grid (J. Rossignac and P. Borrel, "Multi-resolution 3D approximations for rendering
//! complex scenes", 1993).
//!
//! Of parts with triangles on both sides only the fronts collapse, so that their rims are borders; the backs follow. Triangles at hubs,
//! vertices with thousands of them, do not collapse.

use fantex_base::{Error, Result, UnionFind, counted, input};
use meshoptimizer_rs::{
    Attributes, Limits, Positions, SimplifyOptions, SimplifySettings, VertexFlags, Workspace,
    simplify_sloppy, simplify_with_attributes,
};

use crate::fronts::Fronts;
use crate::{Mesh, Model};

/// Results with more triangles than so many times the number wanted are made coarser by a grid; with fewer than that part of it, loose
/// pieces stay.
const TOLERATED_EXCESS: usize = 2;

/// Where some triangles have backs and others have none, so many of both are left only by trying: at most so often, or until the number
/// is that near to the one that is wanted, as a part of it.
const MAX_TRIES: usize = 3;
const TOLERATED_MISS: f64 = 0.05;

/// Vertices with more triangles are hubs. Their triangles are left alone or go into the grid: the time of collapsing is proportional to the square
/// of their number.
const MAX_VALENCE: u32 = 1 << 12;

/// Triangles that a material keeps at least.
const MIN_TRIANGLES: usize = 8;

/// A model, to be [cleaned](crate::clean), of about `triangles` triangles, each material with its share of them. Triangles have some of the
/// vertices of the mesh; materials are kept, but neither corner attributes nor parts. A mesh with no more triangles keeps them all.
///
/// # Errors
/// This takes more memory than is left of what is [allowed](fantex_base::ReadLimits).
pub fn simplified(mesh: &Mesh, triangles: usize) -> Result<Model> {
    simplified_keeping(mesh, triangles, &[])
}

/// As [`simplified`]; the vertices `kept` stay where they are, and so do the edges between them that a single triangle has, so that the
/// result fits to what they join. Pieces with such vertices may keep more triangles than their share. The model's positions are those of
/// the mesh, with the same numbers.
///
/// # Errors
/// As [`simplified`].
pub fn simplified_keeping(mesh: &Mesh, triangles: usize, kept: &[u32]) -> Result<Model> {
    let (mut left, mut materials) = (Vec::new(), Vec::new());
    let mut simplifier = Simplifier::new(mesh, kept);
    let is_anchored = anchored(mesh, kept);
    let by_material = triangles_by_material(mesh).into_iter().enumerate();
    for (material, own) in by_material {
        let share = triangles as f64 / mesh.triangles.len() as f64;
        let wanted = |own: &[[u32; 3]]| ((share * own.len() as f64).round() as usize).max(MIN_TRIANGLES);
        let (anchored, loose): (Vec<_>, Vec<_>) =
            own.into_iter().partition(|triangle| is_anchored[triangle[0] as usize]);
        for (own, may_lose_pieces) in [(anchored, false), (loose, true)] {
            if !own.is_empty() {
                let wanted = wanted(&own);
                left.extend(simplifier.fewer(own, wanted, may_lose_pieces)?);
            }
        }
        materials.resize(left.len(), material as u32);
    }
    Ok(Model {
        positions: mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)).collect(),
        triangles: left,
        triangle_materials: materials,
        materials: mesh.materials.clone(),
        ..Model::default()
    })
}

/// Per vertex whether its connected piece of the mesh has one of the vertices `kept`.
fn anchored(mesh: &Mesh, kept: &[u32]) -> Vec<bool> {
    let mut is_anchored = vec![false; mesh.positions.len()];
    if kept.is_empty() {
        return is_anchored;
    }
    let mut pieces = UnionFind::new(mesh.positions.len());
    for &[a, b, c] in &mesh.triangles {
        pieces.union(a, b);
        pieces.union(b, c);
    }
    kept.iter().for_each(|&vertex| is_anchored[pieces.find(vertex) as usize] = true);
    (0..mesh.positions.len() as u32).map(|vertex| is_anchored[pieces.find(vertex) as usize]).collect()
}

struct Simplifier {
    positions: Vec<[f32; 3]>,
    /// Vertices between materials stay, so that these go on meeting there, those of triangles at hubs, and those that were asked for.
    flags: Vec<VertexFlags>,
    /// Per vertex.
    is_hub: Vec<bool>,
    workspace: Workspace,
}

impl Simplifier {
    fn new(mesh: &Mesh, kept: &[u32]) -> Self {
        let max_bytes = usize::try_from(input::memory_left()).unwrap_or(usize::MAX);
        let mut flags = flags(mesh);
        let is_hub = hubs(mesh);
        let at_hubs = mesh.triangles.iter().filter(|triangle| is_at_hub(&is_hub, triangle));
        at_hubs.flatten().chain(kept).for_each(|&vertex| flags[vertex as usize] = VertexFlags::LOCK);
        Self {
            positions: mesh.positions.iter().map(|p| p.to_array()).collect(),
            flags,
            is_hub,
            workspace: Workspace::new(Limits { max_bytes, max_work: u64::MAX }),
        }
    }

    /// `may_lose_pieces`: loose pieces may go, and vertices that stay otherwise may be united.
    fn fewer(
        &mut self,
        triangles: Vec<[u32; 3]>,
        wanted: usize,
        may_lose_pieces: bool,
    ) -> Result<Vec<[u32; 3]>> {
        if triangles.len() <= wanted {
            return Ok(triangles);
        }
        let is_at_hub = |triangle: &[u32; 3]| is_at_hub(&self.is_hub, triangle);
        let (at_hubs, others): (Vec<_>, Vec<_>) = triangles.iter().copied().partition(is_at_hub);
        let share = wanted * others.len() / triangles.len();
        let wanted_of_others = wanted.saturating_sub(at_hubs.len()).max(share / TOLERATED_EXCESS);
        let mut left = self.fewer_without_hubs(others, wanted_of_others, may_lose_pieces)?;
        left.extend(at_hubs);
        if may_lose_pieces && left.len() > TOLERATED_EXCESS * wanted {
            let positions = Positions::from_packed(&self.positions);
            let indices = left.as_flattened();
            let rough = simplify_sloppy(indices, positions, None, 3 * wanted, 1.0, &mut self.workspace);
            left = rough.map_err(|e| failed(e, triangles.len()))?.indices.as_chunks::<3>().0.to_vec();
        }
        Ok(if left.is_empty() { triangles } else { left })
    }

    fn fewer_without_hubs(
        &mut self,
        triangles: Vec<[u32; 3]>,
        wanted: usize,
        may_lose_pieces: bool,
    ) -> Result<Vec<[u32; 3]>> {
        if triangles.len() <= wanted || triangles.is_empty() {
            return Ok(triangles);
        }
        let fronts = Fronts::of(&triangles, self.positions.len());
        let mut collapsed = |options| self.collapsed(&fronts, triangles.len(), wanted, options);
        if !may_lose_pieces {
            return collapsed(SimplifyOptions::EMPTY);
        }
        let left = collapsed(SimplifyOptions::PRUNE)?;
        // Where no more edges can collapse, pieces go whatever their size; it may be the whole mesh.
        if left.len() * TOLERATED_EXCESS < wanted { collapsed(SimplifyOptions::EMPTY) } else { Ok(left) }
    }

    /// What is left of `count` triangles when edges between fronts have collapsed, with its backs.
    fn collapsed(
        &mut self,
        fronts: &Fronts,
        count: usize,
        wanted: usize,
        options: SimplifyOptions,
    ) -> Result<Vec<[u32; 3]>> {
        let vertex_count = self.positions.len();
        for &vertex in &fronts.shared {
            self.positions.push(self.positions[vertex as usize]);
        }
        let mut flags = self.flags.clone();
        flags.resize(self.positions.len(), VertexFlags::LOCK);
        fronts.shared.iter().for_each(|&vertex| flags[vertex as usize] = VertexFlags::LOCK);
        let left = self.collapsed_fronts(fronts, &flags, count, wanted, options);
        self.positions.truncate(vertex_count);
        Ok(fronts.with_backs(&left?))
    }

    fn collapsed_fronts(
        &mut self,
        fronts: &Fronts,
        flags: &[VertexFlags],
        count: usize,
        wanted: usize,
        options: SimplifyOptions,
    ) -> Result<Vec<[u32; 3]>> {
        let positions = Positions::from_packed(&self.positions);
        let failed = |error| failed(error, count);
        let none = Attributes::from_interleaved(&[], self.positions.len(), 0, 0, 0).map_err(failed)?;
        let indices = fronts.triangles.as_flattened();
        let mut target = (wanted * fronts.triangles.len() / count).max(1);
        let mut tries = 0;
        loop {
            // The error is in extents of the mesh: the number alone decides.
            let settings = SimplifySettings { target_index_count: 3 * target, target_error: 1.0, options };
            let workspace = &mut self.workspace;
            let left =
                simplify_with_attributes(indices, positions, none, &[], Some(flags), settings, workspace)
                    .map_err(failed)?
                    .indices;
            let left = left.as_chunks::<3>().0;
            tries += 1;
            let left_count = fronts.count_with_backs(left);
            let is_near = left_count.abs_diff(wanted) as f64 <= TOLERATED_MISS * wanted as f64;
            // What keeps more than its target cannot have less.
            let may_come_nearer = fronts.is_mixed() && !left.is_empty() && left.len() <= target;
            if is_near || !may_come_nearer || tries == MAX_TRIES {
                return Ok(left.to_vec());
            }
            target = (target * wanted / left_count).clamp(1, fronts.triangles.len());
        }
    }
}

fn failed(error: meshoptimizer_rs::Error, count: usize) -> Error {
    match error {
        meshoptimizer_rs::Error::LimitExceeded | meshoptimizer_rs::Error::AllocationFailed => {
            let triangles = counted(count, "triangle");
            Error::too_large(format!(
                "making {triangles} coarser takes more memory than is left of what is allowed; allow more"
            ))
        }
        error => Error::unsupported(format!("the mesh cannot be made coarser: {error}")),
    }
}

fn triangles_by_material(mesh: &Mesh) -> Vec<Vec<[u32; 3]>> {
    let mut by_material = vec![Vec::new(); mesh.materials.len().max(1)];
    for (index, &triangle) in mesh.triangles.iter().enumerate() {
        by_material[mesh.material_of(index)].push(triangle);
    }
    by_material
}

/// Which vertices are hubs.
fn hubs(mesh: &Mesh) -> Vec<bool> {
    let mut valences = vec![0_u32; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&vertex| valences[vertex as usize] += 1);
    valences.into_iter().map(|valence| valence > MAX_VALENCE).collect()
}

fn is_at_hub(is_hub: &[bool], triangle: &[u32; 3]) -> bool {
    triangle.iter().any(|&vertex| is_hub[vertex as usize])
}

fn flags(mesh: &Mesh) -> Vec<VertexFlags> {
    let mut flags = vec![VertexFlags::EMPTY; mesh.positions.len()];
    let mut seen = vec![None; mesh.positions.len()];
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let material = mesh.material_of(index);
        for &vertex in triangle {
            if *seen[vertex as usize].get_or_insert(material) != material {
                flags[vertex as usize] = VertexFlags::LOCK;
            }
        }
    }
    flags
}
