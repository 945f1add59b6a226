//! Coarse assets of a world: what several previews, or several finer coarse assets, show together.
//!
//! ```text
//!  previews of a run of sectors --join--> one surface --fewer triangles, outline as it is--> coarse mesh --bake from the surface--> coarse asset
//! ```

#[cfg(feature = "http")]
pub(crate) mod objects;
pub(crate) mod tree;

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use fantex_bake::{AssetSource, Progress, Source, SourceChannel, TexelPoint};
use fantex_base::Result;
use fantex_mesh::{Material, Mesh, SurfacePoint, WorldFromMesh, shading_normals};
use fantex_store::{Asset, ChannelKind, Damage};
use glam::{Vec3, Vec4};

use super::joined::{FirstTriangles, JoinedMesh};
use crate::baker::channels::{AssetChannels, asset_source};
use crate::preview::{CoarseShape, write_coarse};
use crate::{PreviewOptions, WorldCoarse};

/// A position in a mesh space, to the last bit; both zeros are the same.
pub(crate) type Place = [u32; 3];

pub(crate) fn place(p: Vec3) -> Place {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// Meshes as one, with materials and shading normals. What `moved` does to each vertex comes first; then vertices at the same place are one vertex.
pub(crate) fn joined<'m>(
    meshes: impl Iterator<Item = &'m Mesh>,
    space: WorldFromMesh,
    moved: impl Fn(Vec3) -> Vec3,
) -> JoinedMesh {
    let mut joined = JoinedMesh::new(space);
    for (number, mesh) in meshes.enumerate() {
        joined.add(mesh);
        let numbers = add_materials(&mut joined.mesh.materials, &mesh.materials, number == 0);
        let of_triangle = |triangle| numbers.get(mesh.material_of(triangle)).copied().unwrap_or(0);
        let Mesh { corners, triangle_materials, .. } = &mut joined.mesh;
        corners.normals.extend(shading_normals(mesh));
        triangle_materials.extend((0..mesh.triangles.len()).map(of_triangle));
    }
    joined.mesh.positions.iter_mut().for_each(|p| *p = moved(*p));
    weld(&mut joined.mesh);
    joined
}

/// Adds a mesh's materials to those of several, each that looks otherwise once; gives their numbers there.
fn add_materials(all: &mut Vec<Material>, own: &[Material], is_first: bool) -> Vec<u32> {
    if is_first {
        *all = own.to_vec();
    }
    if *all == *own {
        return (0..own.len() as u32).collect();
    }
    // What a mesh without materials has.
    let plain = [Material::default()];
    if all.is_empty() {
        *all = plain.to_vec();
    }
    let own = if own.is_empty() { &plain[..] } else { own };
    let nameless =
        |material: &Material| Material { name: String::new(), place: String::new(), ..material.clone() };
    let mut number = |material: &Material| {
        let known = all.iter().position(|known| nameless(known) == nameless(material));
        known.unwrap_or_else(|| {
            all.push(material.clone());
            all.len() - 1
        }) as u32
    };
    own.iter().map(&mut number).collect()
}

/// What an index says of a coarse asset that stands for these meshes, whose finest detail is so long, world units. Who makes one and who verifies it
/// measure alike.
pub(crate) fn measured(
    name: &str,
    asset: &Asset,
    parts: Vec<String>,
    finer: &[Arc<Mesh>],
    finer_detail: f64,
) -> WorldCoarse {
    let space = finer.first().map_or(asset.mesh().world_from_mesh, |mesh| mesh.world_from_mesh);
    let finer = joined(finer.iter().map(|mesh| &**mesh), space, |p| p).mesh;
    WorldCoarse::of(name, asset, parts, &finer, finer_detail)
}

/// The objects that a coarse asset stands for, ascending, of so many. `parts`: those of [`World::parts`](crate::World::parts).
pub(crate) fn objects_below(parts: &[Vec<usize>], objects: usize, coarse: usize) -> Vec<usize> {
    let (mut found, mut open) = (Vec::new(), vec![coarse]);
    while let Some(coarse) = open.pop() {
        for &part in &parts[coarse] {
            match part.checked_sub(objects) {
                None => found.push(part),
                Some(coarse) => open.push(coarse),
            }
        }
    }
    found.sort_unstable();
    found
}

fn weld(mesh: &mut Mesh) {
    let (mut numbers, mut positions) = (HashMap::with_capacity(mesh.positions.len()), Vec::new());
    let number = |&p: &Vec3| {
        *numbers.entry(place(p)).or_insert_with(|| {
            positions.push(p);
            positions.len() as u32 - 1
        })
    };
    let numbers: Vec<u32> = mesh.positions.iter().map(number).collect();
    mesh.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
    mesh.positions = positions;
}

/// What several small assets show together: a surface and the source of its look, with all channels that one of them has.
pub(crate) struct FinerSurface {
    mesh: Mesh,
    firsts: FirstTriangles,
    /// Which triangles of all assets those of the mesh are; none where they are the same.
    triangles: Option<Vec<u32>>,
    parts: Vec<AssetChannels>,
    channels: Vec<SourceChannel>,
    hard_edges: Option<f32>,
}

impl FinerSurface {
    /// At least one asset. What `moved` does to each vertex comes before those at the same place become one; triangles that have no area then are left
    /// out. Decoded texels take at most `memory_bytes`.
    pub(crate) fn of(
        assets: &[Arc<Asset>],
        space: WorldFromMesh,
        moved: impl Fn(Vec3) -> Vec3,
        memory_bytes: u64,
    ) -> Self {
        let JoinedMesh { mesh, firsts } = joined(assets.iter().map(|asset| asset.mesh()), space, moved);
        let sound: Vec<u32> =
            (0..mesh.triangles.len()).filter(|&t| has_area(&mesh, t)).map(|t| t as u32).collect();
        let (mesh, triangles) = match sound.len() == mesh.triangles.len() {
            true => (mesh, None),
            false => (mesh.subset(&sound).0, Some(sound)),
        };
        let share = memory_bytes / assets.len() as u64;
        let sources: Vec<AssetSource> = assets.iter().map(|asset| asset_source(asset, share)).collect();
        let channels = common_channels(&sources);
        let part = |(source, asset)| AssetChannels::of_asset(source, asset, channels.clone());
        let parts = sources.into_iter().zip(assets).map(part).collect();
        Self { mesh, firsts, triangles, parts, channels, hard_edges: common_hard_edges(assets) }
    }

    /// The surface.
    pub(crate) fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Its vertices at some places, ascending.
    pub(crate) fn vertices_at(&self, places: &HashSet<Place>) -> Vec<u32> {
        let vertices = (0u32..).zip(&self.mesh.positions);
        vertices.filter(|(_, p)| places.contains(&place(**p))).map(|(vertex, _)| vertex).collect()
    }

    /// Writes the asset of a coarser [mesh](crate::preview::coarse_mesh), with so many texels, that looks like this surface. Of `progress` only
    /// cancellation counts.
    ///
    /// # Errors
    /// As [`Preview::of`](crate::Preview::of); the file cannot be written, or is there.
    pub(crate) fn write_coarse(
        &self,
        (coarse, texels): (&Mesh, u64),
        options: &PreviewOptions,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        let shape = CoarseShape { mesh: coarse, texels, hard_edges: self.hard_edges };
        write_coarse(&shape, (&self.mesh, self), options, path, progress).map(drop)
    }
}

/// The angle from which on edges are hard that are so in each of some assets; none where one of them is to be continuous everywhere.
fn common_hard_edges(assets: &[Arc<Asset>]) -> Option<f32> {
    assets.iter().map(|asset| asset.cover().hard_edges).reduce(|a, b| Some(a?.max(b?))).flatten()
}

impl Source for FinerSurface {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn damage(&self) -> Damage {
        let mut all = Damage::default();
        for damage in self.parts.iter().map(Source::damage) {
            all.pages += damage.pages;
            all.first.extend(damage.first);
        }
        all
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        // Mesh spaces differ in place and scale, not in direction.
        let triangle = point.at.triangle;
        let triangle = self.triangles.as_ref().map_or(triangle, |all| all[triangle as usize]);
        let (part, triangle) = self.firsts.locate(triangle);
        let (part, at) = (&self.parts[part], SurfacePoint { triangle, ..point.at });
        part.evaluate(&TexelPoint { at, ..*point }, values);
    }
}

/// The channels of all sources, as the first one that has a channel orders them. Light is one of them only if all have it: without, a surface is lit by what
/// is there.
fn common_channels(sources: &[AssetSource]) -> Vec<SourceChannel> {
    let mut all: Vec<SourceChannel> = Vec::new();
    let mut counts: Vec<usize> = Vec::new();
    for channel in sources.iter().flat_map(Source::channels) {
        match all.iter().position(|known| known.kind == channel.kind) {
            Some(number) => {
                all[number].has_alpha |= channel.has_alpha;
                all[number].exceeds_one |= channel.exceeds_one;
                counts[number] += 1;
            }
            None => {
                all.push(channel);
                counts.push(1);
            }
        }
    }
    let is_common = |(channel, count): (SourceChannel, usize)| {
        (channel.kind != ChannelKind::Light || count == sources.len()).then_some(channel)
    };
    all.into_iter().zip(counts).filter_map(is_common).collect()
}

fn has_area(mesh: &Mesh, triangle: usize) -> bool {
    let [a, b, c] = mesh.triangles[triangle];
    a != b && b != c && c != a && mesh.triangle_area(triangle) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_side_by_side_become_one() {
        let space = WorldFromMesh::default();
        let triangle = |x: f32| Mesh {
            positions: vec![Vec3::X * x, Vec3::X * (x + 0.25), Vec3::new(x, 0.5, -0.0)],
            triangles: vec![[0, 1, 2]],
            world_from_mesh: space,
            ..Mesh::default()
        };
        let mut moved = triangle(0.25);
        moved.move_to(WorldFromMesh { offset: glam::DVec3::ONE, scale: 4.0 });
        let meshes = [triangle(0.0), moved, triangle(0.5)];
        let JoinedMesh { mesh, firsts } = joined(meshes.iter(), space, |p| p);
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 4], [3, 5, 6]]);
        assert_eq!(mesh.positions[3], Vec3::X * 0.5);
        assert_eq!((mesh.corners.normals.len(), mesh.triangle_materials.len()), (9, 3));
        assert_eq!([0, 1, 2].map(|triangle| firsts.locate(triangle)), [(0, 0), (1, 0), (2, 0)]);
    }

    #[test]
    fn materials_that_look_alike_are_one() {
        let named =
            |name: &str, metallic: f32| Material { name: name.into(), metallic, ..Material::default() };
        let mut all = Vec::new();
        assert!(add_materials(&mut all, &[], true).is_empty() && all.is_empty());
        // The mesh without materials has a plain one then.
        let plain = named("plain", Material::default().metallic);
        assert_eq!(add_materials(&mut all, &[named("a", 0.25), plain], false), [1, 0]);
        assert_eq!(add_materials(&mut all, &[], false), [0]);
        assert_eq!(add_materials(&mut all, &[named("c", 0.5), named("b", 0.25)], false), [2, 1]);
        assert_eq!(all.len(), 3);
        let mut same = vec![named("a", 0.5), named("b", 0.5)];
        let own = same.clone();
        assert_eq!(add_materials(&mut same, &own, false), [0, 1]);
    }

    #[test]
    fn triangles_without_area_are_left_out() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, 0.5 * Vec3::X],
            triangles: vec![[0, 1, 2], [0, 1, 1], [0, 3, 1]],
            ..Mesh::default()
        };
        assert_eq!([0, 1, 2].map(|triangle| has_area(&mesh, triangle)), [true, false, false]);
    }
}
