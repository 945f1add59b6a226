//! A world for the CPU renderer: what a picture needs of its objects, as one mesh with one surface.

use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use fantex_mesh::{Mesh, SurfacePoint, WorldFromMesh};
use fantex_render::{Coverage, FanSurface, FilterOptions, Hit, Shaded, SmoothPoint, Surface};
use fantex_scene::Camera;
use fantex_store::{Damage, PageCache};
use fantex_stream::{ObjectDetail, StreamView, choose_objects, open_asset};

use crate::World;

/// The objects of a world that a camera sees: whole where their previews are too coarse, by these elsewhere.
#[derive(Debug)]
pub struct WorldScene {
    mesh: Mesh,
    objects: Vec<SceneObject>,
    whole: usize,
    coarse: usize,
}

#[derive(Debug)]
struct SceneObject {
    /// Its first triangle in the scene's mesh.
    first: u32,
    cache: PageCache,
    /// Lengths in the space of the scene per length in its own.
    scale: f32,
}

/// Decoded texels of an object get at least so much memory, bytes.
const LEAST_CACHE: u64 = 4 << 20;

impl WorldScene {
    /// Opens what a picture of `size` pixels needs of a world that was read at `index`, a path or an address. Meshes take about half of
    /// `memory_bytes` at most, decoded texels the other half.
    ///
    /// # Errors
    /// There is no object, or all lie in one point; an asset cannot be opened, or has no preview although the index says so.
    pub fn open(
        index: &Path,
        world: &World,
        camera: &Camera,
        size: [u32; 2],
        memory_bytes: u64,
    ) -> Result<Self> {
        let space = world.space_to_show(index)?;
        let (view, shapes) = (stream_view(camera, size, &space), world.view_objects(&space));
        let choice = choose_objects(&shapes, &view, memory_bytes / 2, &[]);
        let wanted = choose_objects(&shapes, &view, u64::MAX, &[]);
        let chosen =
            || choice.details.iter().enumerate().filter(|(_, detail)| **detail > ObjectDetail::Absent);
        let cache_bytes = (memory_bytes / 2 / chosen().count().max(1) as u64).max(LEAST_CACHE);
        let mut scene = Self {
            mesh: Mesh { world_from_mesh: space, ..Mesh::default() },
            objects: Vec::with_capacity(chosen().count()),
            whole: choice.details.iter().filter(|detail| **detail == ObjectDetail::Whole).count(),
            coarse: choice
                .details
                .iter()
                .zip(&wanted.details)
                .filter(|(detail, wanted)| detail < wanted)
                .count(),
        };
        for (object, detail) in chosen() {
            let place = World::asset_place(index, &world.objects[object]);
            let asset = match detail {
                ObjectDetail::Whole => open_asset(&place)?,
                _ => World::open_preview(&place)?,
            };
            scene.add(PageCache::new(Arc::new(asset), cache_bytes as usize));
        }
        Ok(scene)
    }

    fn add(&mut self, cache: PageCache) {
        let mesh = cache.asset().mesh();
        let (from, to) = (mesh.world_from_mesh, self.mesh.world_from_mesh);
        let (first, vertices) = (self.mesh.triangles.len() as u32, self.mesh.positions.len() as u32);
        let moved = |&p| if from == to { p } else { to.inverse_point(from.point(p)) };
        self.mesh.positions.extend(mesh.positions.iter().map(moved));
        self.mesh.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|v| v + vertices)));
        let scale = (from.scale / to.scale) as f32;
        self.objects.push(SceneObject { first, cache, scale });
    }

    /// The triangles of all open objects, in the space that these share, without attributes.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// How many objects are open whole, and how many by their previews.
    pub fn counts(&self) -> [usize; 2] {
        [self.whole, self.objects.len() - self.whole]
    }

    /// Objects that are coarser than the picture could show, or missing, because there is not enough memory.
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
            first: object.first,
            surface: FanSurface::of_asset(&object.cache, filter),
            scale: object.scale,
        };
        WorldSurface { parts: self.objects.iter().map(part).collect() }
    }
}

/// A camera's view of the space that objects share.
fn stream_view(camera: &Camera, size: [u32; 2], space: &WorldFromMesh) -> StreamView {
    let (eye, axes) = (space.inverse_point(camera.eye), camera.axes().as_mat3());
    StreamView::new(eye, axes, camera.fov_degrees.to_radians() as f32, size)
}

/// The surfaces of a world's objects, each for its triangles.
#[derive(Debug)]
pub struct WorldSurface {
    parts: Vec<Part>,
}

#[derive(Debug)]
struct Part {
    first: u32,
    surface: FanSurface,
    /// See [`SceneObject`].
    scale: f32,
}

impl WorldSurface {
    /// Which part a triangle belongs to.
    fn index(&self, triangle: usize) -> usize {
        self.parts.partition_point(|part| part.first as usize <= triangle) - 1
    }

    /// The part that is hit, and the hit as it sees it. (Spaces differ in place and scale, not in direction.)
    fn local(&self, hit: &Hit) -> (&Part, Hit) {
        let part = &self.parts[self.index(hit.triangle())];
        (part, part.local(hit))
    }
}

impl Part {
    fn local(&self, hit: &Hit) -> Hit {
        Hit { at: SurfacePoint { triangle: hit.at.triangle - self.first, ..hit.at }, ..*hit }
    }
}

impl Surface for WorldSurface {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (part, hit) = self.local(hit);
        part.surface.shade(&hit)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        for run in hits.chunk_by(|a, b| self.index(a.triangle()) == self.index(b.triangle())) {
            let part = &self.parts[self.index(run[0].triangle())];
            let local: Vec<Hit> = run.iter().map(|hit| part.local(hit)).collect();
            part.surface.shade_all(&local, out);
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
        let part = &self.parts[self.index(triangle)];
        part.surface.coverage(triangle - part.first as usize)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        let part = &self.parts[self.index(triangle)];
        part.surface.is_double_sided(triangle - part.first as usize)
    }
}
