//! Which triangles are in which sector, and how one is written.

use std::collections::HashSet;
use std::path::Path;

use fantex_bake::Progress;
use fantex_base::{Result, UnionFind, input};
use fantex_cover::{Cover, GroupTriangles};
use fantex_mesh::{Edges, Mesh, corners_of, morton, shading_normals};
use fantex_store::{Asset, AssetEditor, CreateOptions, EditOptions, GroupCopy};
use glam::Vec3;
use rayon::prelude::*;

use super::SectorPreviews;
use crate::preview::{coarse_mesh, is_worth_it};
use crate::world::coarse::{Place, place};
use crate::{Preview, PreviewOptions};

/// Which triangles are in which sector.
pub(super) struct Plan<'a> {
    pub(super) mesh: &'a Mesh,
    cover: &'a Cover,
    /// Ascending triangles of each sector.
    pub(super) sectors: Vec<Vec<u32>>,
    /// Per vertex whether several sectors have it.
    is_shared: Vec<bool>,
    /// Shading normals per corner.
    normals: Vec<Vec3>,
    /// Triangles with a corner in each group.
    in_group: Vec<u32>,
    /// Of all tiles at level 0.
    pub(super) texels: u64,
}

/// Bytes that a plan takes per triangle: edges while it is made (48), normals (36), numbers of triangles.
const PLAN_BYTES: u64 = 100;

impl<'a> Plan<'a> {
    pub(super) fn of(asset: &'a Asset, triangles: usize) -> Result<Self> {
        let (mesh, cover) = (asset.mesh(), asset.cover());
        let count = mesh.triangles.len();
        let what = format_args!("splitting {} with {count} triangles", asset.path().display()).to_string();
        let _held = input::reserve(what, PLAN_BYTES * count as u64)?;
        let sectors = sectors(mesh, cover, triangles);
        let alone: Vec<u32> = (0..sectors.len() as u32).collect();
        let is_shared = shared_vertices(mesh, &sectors, &alone);
        let normals = shading_normals(mesh);
        let mut in_group = vec![0; cover.groups.len()];
        for triangle in 0..mesh.triangles.len() as u32 {
            cover.groups_of(triangle).for_each(|group| in_group[group as usize] += 1);
        }
        Ok(Self { mesh, cover, sectors, is_shared, normals, in_group, texels: cover.texels() })
    }

    /// Places in the mesh space of those vertices of some sectors that are marked.
    pub(super) fn places(&self, is_marked: &[bool], sectors: &[usize]) -> HashSet<Place> {
        let triangles = sectors.iter().flat_map(|&sector| &self.sectors[sector]);
        let vertices = triangles.flat_map(|&triangle| self.mesh.triangles[triangle as usize]);
        let marked = vertices.filter(|&vertex| is_marked[vertex as usize]);
        marked.map(|vertex| place(self.mesh.positions[vertex as usize])).collect()
    }

    pub(super) fn sector(&self, number: usize) -> Sector {
        let triangles = &self.sectors[number];
        let (mut mesh, vertices) = self.mesh.subset(triangles);
        mesh.corners.normals = corners_of(&self.normals, triangles);
        let border = (0u32..).zip(&vertices).filter(|(_, vertex)| self.is_shared[**vertex as usize]);
        let border = border.map(|(own, _)| own).collect();
        let (cover, groups) = self.cover.subset(triangles);
        let own = GroupTriangles::of(&cover);
        let is_partial = (0u32..).zip(&groups);
        let is_partial = is_partial.map(|(own_group, &group)| {
            own.of_group(own_group).len() < self.in_group[group as usize] as usize
        });
        Sector { mesh, is_partial: is_partial.collect(), cover, groups, border }
    }
}

/// Per vertex whether sectors of several runs have it. `runs`: per sector the number of its run.
pub(super) fn shared_vertices(mesh: &Mesh, sectors: &[Vec<u32>], runs: &[u32]) -> Vec<bool> {
    let mut is_shared = vec![false; mesh.positions.len()];
    let mut first_run = vec![u32::MAX; mesh.positions.len()];
    for (sector, &number) in sectors.iter().zip(runs) {
        let triangles = sector.iter().map(|&t| mesh.triangles[t as usize]);
        for vertex in triangles.flatten().map(|vertex| vertex as usize) {
            match first_run[vertex] {
                u32::MAX => first_run[vertex] = number,
                first => is_shared[vertex] |= first != number,
            }
        }
    }
    is_shared
}

/// Ascending triangles of each sector, of which there are about so many.
fn sectors(mesh: &Mesh, cover: &Cover, triangles: usize) -> Vec<Vec<u32>> {
    let keys = keys(mesh, cover);
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.par_sort_unstable_by_key(|&triangle| (keys[triangle as usize], triangle));
    let (all, wanted) = (order.len(), order.len().div_ceil(triangles));
    let (mut sectors, mut sector) = (Vec::new(), Vec::new());
    let (mut before, mut current) = (0, 0);
    let key = |triangle: &u32| keys[*triangle as usize];
    for group in order.chunk_by(|a, b| key(a).group == key(b).group) {
        let is_large = group.len() > triangles / 2;
        // A small group stays whole.
        let pieces: Vec<&[u32]> = match is_large {
            true => group.chunk_by(|a, b| key(a) == key(b)).collect(),
            false => vec![group],
        };
        for piece in pieces {
            let due = before * wanted / all;
            if due > current {
                sectors.push(std::mem::take(&mut sector));
                current = due;
            }
            sector.extend_from_slice(piece);
            before += piece.len();
        }
    }
    sectors.push(sector);
    sectors.iter_mut().for_each(|sector: &mut Vec<u32>| sector.sort_unstable());
    sectors
}

/// Where a triangle stands in the order in which sectors are cut: by group, and within large groups along a curve through space.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    group: u32,
    curve: u32,
}

/// The keys of all triangles: the lowest group at the corners; triangles that belong together have the lowest key of all of them.
fn keys(mesh: &Mesh, cover: &Cover) -> Vec<Key> {
    let mut sets = joined_triangles(mesh);
    let key = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        let [p, q, r] = mesh.triangle_positions(t);
        Key { group: a.min(b).min(c), curve: morton((p + q + r) / 3.0) }
    };
    let mut keys: Vec<Key> = cover.corner_groups.par_iter().enumerate().map(key).collect();
    for triangle in 0..keys.len() as u32 {
        let set = sets.find(triangle) as usize;
        keys[set] = keys[set].min(keys[triangle as usize]);
    }
    // The smallest member of a set stands for it, so its key is final when the others take it.
    for triangle in 0..keys.len() as u32 {
        keys[triangle as usize] = keys[sets.find(triangle) as usize];
    }
    keys
}

/// Sets of triangles that stay together: the two sides of a leaf, and those around an edge of more than two triangles, which continue each
/// other by what else lies there. (Where two leaves meet, front continues front and back back, whether or not the other leaf is there.)
fn joined_triangles(mesh: &Mesh) -> UnionFind {
    let mut sets = UnionFind::new(mesh.triangles.len());
    for edge in Edges::of(&mesh.triangles).iter().filter(|edge| edge.triangle_count() > 1) {
        let mut at_edge: Vec<(u32, u32)> =
            edge.triangles().map(|(triangle, third)| (third, triangle)).collect();
        at_edge.sort_unstable();
        let mut leaves = 0;
        for pair in at_edge.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            leaves += 1;
            sets.union(pair[0].1, pair[1].1);
        }
        let are_two_leaves = at_edge.len() == 4 && leaves == 2 && at_edge[1].0 != at_edge[2].0;
        if at_edge.len() > 2 && !are_two_leaves {
            at_edge.windows(2).for_each(|pair| {
                sets.union(pair[0].1, pair[1].1);
            });
        }
    }
    sets
}

/// A part of the asset before it is written.
pub(super) struct Sector {
    pub(super) mesh: Mesh,
    pub(super) cover: Cover,
    /// Which group of the whole each group is.
    groups: Vec<u32>,
    /// Whether other sectors have triangles in it, too.
    is_partial: Vec<bool>,
    /// Vertices that other sectors have, too.
    border: Vec<u32>,
}

impl Sector {
    pub(super) fn write(
        &self,
        path: &Path,
        whole: &Asset,
        report: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        let options = CreateOptions::default();
        let Self { mesh, cover, groups, is_partial, .. } = self;
        GroupCopy { mesh, cover, from: whole, groups, is_partial }.write(path, &options, report).map(drop)
    }

    /// Adds its preview, unless that would be hardly smaller: then its triangles are returned.
    pub(super) fn add_preview(
        &self,
        path: &Path,
        previews: &SectorPreviews,
        memory_bytes: u64,
        progress: &dyn Progress,
    ) -> Result<Option<u64>> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let triangles = previews.triangles(self.mesh.triangles.len(), self.border.len());
        let texels = previews.texels(self.cover.stored_texels(&self.mesh), triangles);
        let options = PreviewOptions {
            triangles,
            texels: Some(texels),
            keeps_borders: true,
            memory_bytes,
            strict: false,
        };
        let coarse = coarse_mesh(editor.asset().mesh(), triangles, &self.border)?;
        if !is_worth_it(&coarse, editor.asset().mesh(), previews.triangles) {
            return Ok(Some(coarse.triangles.len() as u64));
        }
        Preview::of_coarse(editor.asset(), &coarse, &options, progress)?.attach(&mut editor)?;
        Ok(None)
    }
}
