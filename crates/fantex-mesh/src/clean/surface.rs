//! The triangles while they are being cleaned: dropping, renumbering and turning them, and their attributes with them.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::Vec3;
use rayon::prelude::*;

use super::first::Repeat;
use crate::{CornerAttributes, Material, Mesh, Model, WorldFromMesh};

/// Triangles per parallel task.
const BLOCK: usize = 1 << 14;

/// The triangles while they are being cleaned, and which triangle of the model each of them was.
pub(super) struct Surface {
    /// Vertex indices.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index of each triangle in the model; `None` while nothing was dropped.
    sources: Option<Vec<u32>>,
}

impl Surface {
    /// Takes the triangles out of the model.
    pub(super) fn new(model: &mut Model) -> Self {
        Self { triangles: std::mem::take(&mut model.triangles), sources: None }
    }

    /// Keeps the triangles that the predicate accepts; returns how many were dropped.
    pub(super) fn retain(&mut self, keep: impl Fn([u32; 3]) -> bool + Sync) -> u64 {
        let dropped: Vec<u32> = self
            .triangles
            .par_iter()
            .enumerate()
            .with_min_len(BLOCK)
            .filter(|&(_, &t)| !keep(t))
            .map(|(i, _)| i as u32)
            .collect();
        self.remove(&dropped);
        dropped.len() as u64
    }

    /// Removes triangles, given by ascending index.
    pub(super) fn remove(&mut self, dropped: &[u32]) {
        if dropped.is_empty() {
            return;
        }
        let mut keep = vec![true; self.triangles.len()];
        dropped.iter().for_each(|&t| keep[t as usize] = false);
        let sources = self.sources.take().unwrap_or_else(|| (0..self.triangles.len() as u32).collect());
        self.sources = Some(kept(sources, &keep));
        self.triangles = kept(std::mem::take(&mut self.triangles), &keep);
    }

    /// Replaces every welded vertex by the one it was welded to.
    pub(super) fn weld(&mut self, welded: &[Repeat], vertex_count: usize) {
        if welded.is_empty() {
            return;
        }
        let mut target: Vec<u32> = (0..vertex_count as u32).collect();
        welded.iter().for_each(|repeat| target[repeat.element as usize] = repeat.first);
        self.renumber(&target);
    }

    fn renumber(&mut self, target: &[u32]) {
        let renumber = |t: &mut [u32; 3]| *t = t.map(|v| target[v as usize]);
        self.triangles.par_iter_mut().with_min_len(BLOCK).for_each(renumber);
    }

    /// Drops unused vertices, keeping the order of the others.
    pub(super) fn compact_vertices(&mut self, positions: Vec<Vec3>) -> Vec<Vec3> {
        let used = used_vertices(&self.triangles, positions.len());
        if used.par_iter().all(|&u| u) {
            return positions;
        }
        let mut next = 0;
        let target: Vec<u32> = used
            .iter()
            .map(|&used| {
                let index = next;
                next += u32::from(used);
                index
            })
            .collect();
        self.renumber(&target);
        kept(positions, &used)
    }

    /// Turns the flagged triangles round (corners 1 and 2 change places); returns how many.
    pub(super) fn turn(&mut self, flags: &[bool]) -> u64 {
        let flagged = self.triangles.iter_mut().zip(flags).filter(|(_, turn)| **turn);
        flagged.map(|(t, _)| t.swap(1, 2)).count() as u64
    }

    /// Joins everything to a mesh; `turned` flags the triangles that were turned (empty: none).
    pub(super) fn into_mesh(
        self,
        model: Model,
        positions: Vec<Vec3>,
        turned: &[bool],
        world_from_mesh: WorldFromMesh,
    ) -> Mesh {
        let sources = self.sources.as_deref();
        let triangle_materials = match sources {
            Some(sources) if !model.triangle_materials.is_empty() => {
                sources.iter().map(|&s| model.triangle_materials[s as usize]).collect()
            }
            _ => model.triangle_materials,
        };
        let corners = model.corners;
        let corners = CornerAttributes {
            normals: follow(corners.normals, sources, turned),
            uv_sets: corners.uv_sets.into_iter().map(|set| follow(set, sources, turned)).collect(),
            colors: follow(corners.colors, sources, turned),
            tangents: follow(corners.tangents, sources, turned),
        };
        let materials = if model.materials.is_empty() { vec![Material::default()] } else { model.materials };
        Mesh {
            positions,
            triangles: self.triangles,
            corners,
            triangle_materials,
            materials,
            images: model.images,
            world_from_mesh,
        }
    }
}

/// Corner values after dropping and turning triangles.
fn follow<T: Copy + Send + Sync>(values: Vec<T>, sources: Option<&[u32]>, turned: &[bool]) -> Vec<T> {
    if values.is_empty() {
        return values;
    }
    let mut values = match sources {
        Some(sources) => {
            sources.iter().flat_map(|&s| [0, 1, 2].map(|k| values[3 * s as usize + k])).collect()
        }
        None => values,
    };
    for (corners, _) in values.chunks_exact_mut(3).zip(turned).filter(|(_, turn)| **turn) {
        corners.swap(1, 2);
    }
    values
}

/// The flagged elements.
fn kept<T: Copy>(values: Vec<T>, keep: &[bool]) -> Vec<T> {
    values.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| value).collect()
}

/// One flag per vertex: a triangle uses it.
pub(super) fn used_vertices(triangles: &[[u32; 3]], vertex_count: usize) -> Vec<bool> {
    let used: Vec<AtomicBool> = (0..vertex_count).map(|_| AtomicBool::new(false)).collect();
    triangles
        .par_iter()
        .with_min_len(BLOCK)
        .flatten_iter()
        .for_each(|&v| used[v as usize].store(true, Relaxed));
    used.into_iter().map(AtomicBool::into_inner).collect()
}
