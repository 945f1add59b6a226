//! The camera that shows a whole world.

use std::path::Path;

use fantex_base::{Error, Result};
use fantex_mesh::WorldFromMesh;
use fantex_scene::{Camera, Framed, maxima_of};
use fantex_stream::open_asset;
use glam::{DVec3, Vec3};

use crate::World;

/// Of worlds with more triangles previews are asked, which depart from the surface by less than is seen from where all is.
const MAX_WHOLE_TRIANGLES: u64 = 2_000_000;

/// The camera that looks at a world from `direction` and shows it whole and as large as possible, as [`Camera::framing_mesh`] would show a mesh
/// of all its vertices. `index` is where the world was read. Only those of its assets are opened that may lie outermost, of large worlds by
/// their previews.
///
/// # Errors
/// One of these cannot be opened.
pub fn frame_world(
    index: &Path,
    world: &World,
    direction: DVec3,
    aspect: f64,
    fov_degrees: f64,
) -> Result<Camera> {
    let closed = (0..world.objects.len()).collect();
    let triangles = world.objects.iter().fold(0u64, |sum, object| sum.saturating_add(object.triangles));
    let is_small = triangles <= MAX_WHOLE_TRIANGLES;
    let mut vertices = Vertices { index, world, is_small, opened: Vec::new(), closed, error: None };
    let camera = Camera::framing(&mut vertices, direction, aspect, DVec3::Y, fov_degrees);
    vertices.error.map_or(Ok(camera), Err)
}

/// The vertices of a world: of objects that are open, and of others that lie in their boxes.
struct Vertices<'a> {
    index: &'a Path,
    world: &'a World,
    is_small: bool,
    /// Of each asset, mesh space.
    opened: Vec<(WorldFromMesh, Vec<Vec3>)>,
    /// Objects.
    closed: Vec<usize>,
    error: Option<Error>,
}

impl Vertices<'_> {
    /// The vertices of an object, which is closed until then; of one that cannot be opened its corners.
    fn open(&mut self, object: usize) -> &(WorldFromMesh, Vec<Vec3>) {
        self.closed.retain(|&other| other != object);
        let of_object = &self.world.objects[object];
        let place = World::asset_place(self.index, of_object);
        let opened = match of_object.preview.is_some() && !self.is_small {
            true => World::open_preview(&place),
            false => open_asset(&place),
        };
        let vertices = match opened {
            Ok(asset) => (asset.mesh().world_from_mesh, asset.mesh().positions.clone()),
            Err(error) => {
                self.error.get_or_insert(error);
                let space = WorldFromMesh::default();
                (space, of_object.corners().map(|corner| space.inverse_point(corner)).to_vec())
            }
        };
        self.opened.push(vertices);
        &self.opened[self.opened.len() - 1]
    }
}

fn points((space, positions): &(WorldFromMesh, Vec<Vec3>)) -> impl Iterator<Item = DVec3> {
    positions.iter().map(|&p| space.point(p))
}

impl Framed for Vertices<'_> {
    /// Opens what may hold a larger value than all that is open.
    fn maxima<const N: usize>(&mut self, functions: impl Fn(DVec3) -> [f64; N]) -> [f64; N] {
        let mut maxima = maxima_of(self.opened.iter().flat_map(points), &functions);
        let objects = &self.world.objects;
        let bounds = |&object: &usize| (object, maxima_of(objects[object].corners().into_iter(), &functions));
        let mut bounds: Vec<(usize, [f64; N])> = self.closed.iter().map(bounds).collect();
        for i in 0..N {
            bounds.sort_by(|(_, a), (_, b)| a[i].total_cmp(&b[i]));
            while let Some((object, _)) = bounds.pop_if(|(_, bound)| bound[i] > maxima[i]) {
                let found = maxima_of(points(self.open(object)), &functions);
                maxima = std::array::from_fn(|k| maxima[k].max(found[k]));
            }
        }
        maxima
    }
}
