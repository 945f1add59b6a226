//! Pictures with the halo of what glows in them.

use fantex_mesh::Mesh;
use fantex_scene::Glow;

use crate::{Background, Camera, Lights, RenderError, RenderOptions, Rendering, Shading, Surface, render};

/// Renders twice, the picture and what it emits, and adds the halo of the latter. The time is that of both passes and the
/// filter.
///
/// # Errors
///
/// As [`render`].
pub fn render_with_glow(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &Lights,
    options: &RenderOptions,
    glow: &Glow,
) -> Result<Rendering, RenderError> {
    let start = std::time::Instant::now();
    let seen = render(mesh, surface, camera, lights, options)?;
    let emission =
        RenderOptions { shading: Shading::Emission, background: Background::Transparent, ..options.clone() };
    let emitted = render(mesh, surface, camera, lights, &emission)?;
    let picture = seen.picture.with_glow(&emitted.picture, glow);
    let mut stats = seen.stats;
    stats.shaded += emitted.stats.shaded;
    stats.lookups += emitted.stats.lookups;
    stats.elapsed = start.elapsed();
    Ok(Rendering { picture, stats })
}
