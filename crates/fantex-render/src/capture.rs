//! Environments rendered from the scene: six pictures from the middle of an object, which is left out of them
//! (N. Greene, "Environment mapping and other applications of world projections", 1986).

use fantex_mesh::Mesh;
use fantex_texture::environment::{CubeFace, EnvironmentForm, EnvironmentMap};
use glam::{DVec3, Vec3};

use crate::{
    Background, Camera, Coverage, Hit, Lights, MaterialSample, Picture, RenderError, RenderOptions, Surface,
    render,
};

/// How an environment is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Texels along the side of a face.
    pub side: u32,
    /// Samples per texel, 1..=64.
    pub samples: u32,
    /// What is seen between the objects; gradients and colours are the same on every face.
    pub background: Background,
}

impl Default for CaptureOptions {
    /// 256 texels, 4 samples, black.
    fn default() -> Self {
        Self { side: 256, samples: 4, background: Background::Color(Vec3::ZERO) }
    }
}

/// The cameras of the six faces in the order of [`CubeFace::ALL`]: right angles from a point, world space.
pub fn cube_cameras(center: DVec3) -> [Camera; 6] {
    CubeFace::ALL.map(|face| Camera {
        eye: center,
        target: center + face.forward().as_dvec3(),
        up: face.up().as_dvec3(),
        fov_degrees: 90.0,
    })
}

/// The cube of whatever `picture` shows the six [`cube_cameras`]: it must give square pictures of `side` pixels.
///
/// # Errors
///
/// What `picture` returns; [`RenderError::Size`] for pictures of another size, or none.
pub fn capture_with(
    center: DVec3,
    side: u32,
    mut picture: impl FnMut(&Camera) -> Result<Picture, RenderError>,
) -> Result<EnvironmentMap, RenderError> {
    let mut faces = Vec::with_capacity(6);
    for camera in &cube_cameras(center) {
        let face = picture(camera)?;
        if face.width != side || face.height != side || side == 0 {
            return Err(RenderError::Size { width: face.width, height: face.height });
        }
        faces.push(face);
    }
    let form = EnvironmentForm::Cube;
    // Texel middles are pixel middles: both cut the face's square evenly.
    Ok(EnvironmentMap::from_function(form, side, |direction, _| {
        let at = form.locate(direction);
        let [x, y] = (at.uv * side as f32).to_array().map(|c| (c as u32).min(side - 1));
        let [r, g, b, a] = faces[at.chart].pixel(x, y);
        Vec3::new(r, g, b) * a
    }))
}

/// What a mesh looks like from `center` (world space) without the triangles that are `hidden`: those of the object that
/// will reflect it.
///
/// # Errors
///
/// As [`render`].
pub fn capture_environment(
    mesh: &Mesh,
    surface: &dyn Surface,
    lights: &Lights,
    center: DVec3,
    options: &CaptureOptions,
    hidden: &(dyn Fn(usize) -> bool + Sync),
) -> Result<EnvironmentMap, RenderError> {
    let kept: Vec<usize> = (0..mesh.triangles.len()).filter(|&triangle| !hidden(triangle)).collect();
    let rest = Mesh {
        positions: mesh.positions.clone(),
        triangles: kept.iter().map(|&triangle| mesh.triangles[triangle]).collect(),
        world_from_mesh: mesh.world_from_mesh,
        ..Mesh::default()
    };
    let part = PartialSurface { surface, kept: &kept };
    let render_options = RenderOptions {
        width: options.side,
        height: options.side,
        samples: options.samples,
        background: options.background,
        ..RenderOptions::default()
    };
    capture_with(center, options.side, |camera| {
        Ok(render(&rest, &part, camera, lights, &render_options)?.picture)
    })
}

/// The surface of some of a mesh's triangles.
struct PartialSurface<'a> {
    surface: &'a dyn Surface,
    /// Their numbers in the whole mesh.
    kept: &'a [usize],
}

impl Surface for PartialSurface<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        self.surface.shade_inputs(&Hit { triangle: self.kept[hit.triangle], ..*hit })
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.surface.coverage(self.kept[triangle])
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.surface.is_double_sided(self.kept[triangle])
    }
}
