//! A world for the CPU renderer: what a picture needs of its objects and coarse assets, as one mesh with one surface.

use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use fantex_cover::UnfoldedCorner;
use fantex_mesh::{Mesh, SurfacePoint, WorldFromMesh};
use fantex_render::{
    Coverage, DRAWN_TRIANGLE_BYTES, FanSurface, FilterOptions, Hit, Shaded, SmoothPoint, Surface,
};
use fantex_scene::Camera;
use fantex_store::{Damage, PageCache};
use fantex_stream::{ObjectDetail, StreamView, ViewObject, choose_objects, open_asset};
use glam::{Vec2, Vec3};

use super::joined::{FirstTriangles, JoinedMesh};
use crate::World;

/// The objects of a world that a camera sees: whole where their previews are too coarse, by these elsewhere, from afar several by a coarse
/// asset.
#[derive(Debug)]
pub struct WorldScene {
    joined: JoinedMesh,
    objects: Vec<SceneObject>,
    whole: usize,
    /// Coarse assets.
    several: usize,
    /// What is coarser than the picture could show.
    coarse: usize,
}

#[derive(Debug)]
struct SceneObject {
    cache: PageCache,
    /// Lengths in the space of the scene per length in its own.
    scale: f32,
}

/// Decoded texels of an object get at least so much memory, bytes.
const MIN_CACHE_BYTES: u64 = 4 << 20;

/// Memory that a triangle of a whole object takes, bytes. What streaming and graphics cards need besides, which the index's own number counts,
/// is not there. Tables of groups and pages are small beside it.
const TRIANGLE_BYTES: u64 = {
    // Half a vertex, as closed meshes have.
    let geometry = size_of::<[u32; 3]>() + size_of::<Vec3>() / 2;
    let normals = 3 * size_of::<Vec3>();
    let mesh = geometry + normals + 3 * size_of::<Vec2>() + size_of::<u32>();
    // The groups at the corners; one of them is unfolded.
    let cover = size_of::<[u32; 3]>() + size_of::<UnfoldedCorner>();
    let surface = normals + size_of::<bool>();
    // It grows by doubling.
    let joined = 2 * geometry;
    (mesh + cover + surface + joined) as u64 + DRAWN_TRIANGLE_BYTES
};

/// The objects and the coarse assets, with the memory that they take here.
fn view_objects(world: &World, space: &WorldFromMesh) -> Result<Vec<ViewObject>> {
    let mut shapes = world.view_objects(space)?;
    for (shape, object) in shapes.iter_mut().zip(&world.objects) {
        shape.whole_bytes = object.triangles.saturating_mul(TRIANGLE_BYTES);
    }
    Ok(shapes)
}

impl WorldScene {
    /// Opens what a picture of `size` pixels needs of a world that was read at `index`, a path or an address. Meshes take about half of
    /// `memory_bytes` at most, decoded texels the other half.
    ///
    /// # Errors
    /// There is no object, or all lie in one point; coarse assets have [no parts that they can have](World::parts); an asset cannot be opened, or
    /// has no preview although the index says so.
    pub fn open(
        index: &Path,
        world: &World,
        camera: &Camera,
        size: [u32; 2],
        memory_bytes: u64,
    ) -> Result<Self> {
        let space = world.space_to_show(index)?;
        let view = StreamView::in_world(&space, camera.eye, camera.axes(), camera.fov_degrees, size);
        let shapes = view_objects(world, &space)?;
        let choice = choose_objects(&shapes, &view, memory_bytes / 2, &[]);
        let wanted = choose_objects(&shapes, &view, u64::MAX, &[]);
        let drawn: Vec<(usize, ObjectDetail)> = choice.drawn(&shapes).collect();
        let cache_bytes = (memory_bytes / 2 / drawn.len().max(1) as u64).max(MIN_CACHE_BYTES);
        let mut scene = Self {
            joined: JoinedMesh::new(space),
            objects: Vec::with_capacity(drawn.len()),
            whole: drawn.iter().filter(|(_, detail)| *detail == ObjectDetail::Whole).count(),
            several: drawn.iter().filter(|(node, _)| *node >= world.objects.len()).count(),
            coarse: missing(&shapes, &choice.details, &wanted.details),
        };
        let assets: Vec<&str> = world.assets().collect();
        for (node, detail) in drawn {
            let place = World::place_of(index, assets[node]);
            let asset = match detail {
                ObjectDetail::Whole => open_asset(&place)?,
                _ if node < world.objects.len() => World::open_preview(&place)?,
                _ => World::open_coarse(&place)?,
            };
            scene.add(PageCache::new(Arc::new(asset), cache_bytes as usize));
        }
        Ok(scene)
    }

    fn add(&mut self, cache: PageCache) {
        let mesh = cache.asset().mesh();
        let scale = (mesh.world_from_mesh.scale / self.joined.mesh.world_from_mesh.scale) as f32;
        self.joined.add(mesh);
        self.objects.push(SceneObject { cache, scale });
    }

    /// The triangles of all that is open, in the space that it shares, without attributes.
    pub fn mesh(&self) -> &Mesh {
        &self.joined.mesh
    }

    /// How many objects are open whole, how many by their previews, and how many coarse assets are.
    pub fn counts(&self) -> [usize; 3] {
        [self.whole, self.objects.len() - self.whole - self.several, self.several]
    }

    /// Objects and coarse assets that are coarser than the picture could show, or missing, because there is not enough memory.
    pub fn coarse(&self) -> usize {
        self.coarse
    }

    /// What could not be read so far, of all open objects.
    pub fn damage(&self) -> impl Iterator<Item = Damage> + '_ {
        self.objects.iter().map(|object| object.cache.damage())
    }

    /// The appearance of its [mesh](Self::mesh).
    pub fn surface(&self, filter: FilterOptions) -> WorldSurface {
        let part = |object: &SceneObject| Part {
            surface: FanSurface::of_asset(&object.cache, filter),
            scale: object.scale,
        };
        WorldSurface { firsts: self.joined.firsts.clone(), parts: self.objects.iter().map(part).collect() }
    }
}

/// How much of what is drawn would be finer with more memory, or would be there at all.
fn missing(shapes: &[ViewObject], details: &[ObjectDetail], wanted: &[ObjectDetail]) -> usize {
    // What is part of a coarse asset that is drawn is not missing.
    let mut is_covered = vec![false; shapes.len()];
    for (shape, _) in shapes.iter().zip(details).filter(|(_, detail)| **detail < ObjectDetail::Whole) {
        shape.parts.iter().for_each(|&part| is_covered[part] = true);
    }
    let all = details.iter().zip(wanted).zip(is_covered);
    all.filter(|((detail, wanted), is_covered)| detail < wanted && !is_covered).count()
}

/// The surfaces of a world's objects and coarse assets, each for its triangles.
#[derive(Debug)]
pub struct WorldSurface {
    firsts: FirstTriangles,
    parts: Vec<Part>,
}

#[derive(Debug)]
struct Part {
    surface: FanSurface,
    /// See [`SceneObject`].
    scale: f32,
}

impl WorldSurface {
    /// Which part a triangle belongs to, and its number there.
    fn locate(&self, triangle: usize) -> (&Part, usize) {
        let (part, triangle) = self.firsts.locate(triangle as u32);
        (&self.parts[part], triangle as usize)
    }

    /// The part that is hit, and the hit as it sees it. (Spaces differ in place and scale, not in direction.)
    fn local(&self, hit: &Hit) -> (&Part, Hit) {
        let (part, triangle) = self.locate(hit.triangle());
        (part, Hit { at: SurfacePoint { triangle: triangle as u32, ..hit.at }, ..*hit })
    }
}

impl Surface for WorldSurface {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (part, hit) = self.local(hit);
        part.surface.shade(&hit)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let part = |hit: &Hit| self.firsts.locate(hit.triangle() as u32).0;
        for run in hits.chunk_by(|a, b| part(a) == part(b)) {
            let local: Vec<Hit> = run.iter().map(|hit| self.local(hit).1).collect();
            self.parts[part(&run[0])].surface.shade_all(&local, out);
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        let (part, hit) = self.local(hit);
        part.surface.alpha(&hit)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        let (part, hit) = self.local(hit);
        let SmoothPoint { offset, normal } = part.surface.smooth_point(&hit)?;
        Some(SmoothPoint { offset: offset * part.scale, normal })
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        let (part, triangle) = self.locate(triangle);
        part.surface.coverage(triangle)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        let (part, triangle) = self.locate(triangle);
        part.surface.is_double_sided(triangle)
    }
}

#[cfg(test)]
mod tests {
    use fantex_stream::WorldObject;

    use super::*;

    /// Less than in a viewer, where textures and buffers of the graphics card are counted, too.
    #[test]
    fn whole_objects_take_what_the_renderer_needs() {
        let object = WorldObject {
            asset: "a.fan".into(),
            bytes: 1,
            triangles: 1000,
            texels: 1000,
            low: [0.0; 3],
            high: [1.0; 3],
            preview: None,
        };
        let world = World { objects: vec![object], ..World::default() };
        let space = world.space().unwrap();
        let [here, in_viewer] =
            [view_objects(&world, &space), world.view_objects(&space)].map(|all| all.unwrap()[0].whole_bytes);
        assert_eq!(here, 1000 * TRIANGLE_BYTES);
        assert!((200..400).contains(&TRIANGLE_BYTES) && here < in_viewer, "{here} {in_viewer}");
    }
}
