//! Objects of a world as whoever shows them sees them: what the choice needs to know of them, and their previews.

use std::path::Path;

use fantex_base::{Error, Result};
use fantex_mesh::WorldFromMesh;
use fantex_store::Asset;
use fantex_stream::{SurfaceSamples, ViewObject, ViewPreview, open_preview};
use glam::DVec3;

use crate::{World, WorldObject};

/// Memory that a triangle of an open object takes: mesh, cover and what demand knows of it, in main and in graphics memory. (Of landscapes
/// of 0.5 and 1.9 M triangles in the viewer, on a software adapter: 637.)
const TRIANGLE_BYTES: u64 = 640;

/// The same of a preview, of which only what is drawn is kept.
const PREVIEW_TRIANGLE_BYTES: u64 = 256;

/// Texels of a preview take so many bytes each, in all channels.
const PREVIEW_TEXEL_BYTES: u64 = 4;

/// The objects as seen in the space that they are drawn in, of whose surfaces nothing is known.
pub(crate) fn view_objects(world: &World, space: &WorldFromMesh) -> Vec<ViewObject> {
    world.objects.iter().map(|object| view_object(object, space)).collect()
}

fn view_object(object: &WorldObject, space: &WorldFromMesh) -> ViewObject {
    let preview = object.preview.map(|preview| ViewPreview {
        bytes: preview.triangles * PREVIEW_TRIANGLE_BYTES + preview.texels * PREVIEW_TEXEL_BYTES,
        detail: (preview.detail / space.scale) as f32,
    });
    ViewObject {
        bounds: [object.low, object.high].map(|corner| space.inverse_point(DVec3::from(corner))),
        surface: SurfaceSamples::default(),
        whole_bytes: object.triangles * TRIANGLE_BYTES,
        preview,
    }
}

/// Opens the preview of an asset whose world says that it has one.
pub(crate) fn preview_of(place: &Path) -> Result<Asset> {
    open_preview(place)?.ok_or_else(|| {
        Error::not_found(format!("{} has no preview, although its world says so", place.display()))
    })
}
