//! Environments rendered from the scene: six pictures from the middle of an object, which is left out of them
//! (N. Greene, "Environment mapping and other applications of world projections", 1986).

use fantex_base::{Error, Result, input};
use fantex_mesh::{Mesh, SurfacePoint, interpolate};
use fantex_scene::MirrorView;
use fantex_texture::environment::{CubeFace, EnvironmentForm, EnvironmentMap, EnvironmentProxy};
use glam::{DVec3, Vec3, Vec3A};

use crate::illumination::PreparedLights;
use crate::render::{check_lamps, render_lit};
use crate::{
    Background, Camera, Coverage, EnvironmentLight, Hit, Lights, MaterialSample, Picture, RenderOptions,
    Shaded, SmoothPoint, Surface,
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
/// What `picture` returns; or a picture has another size, or none; or there is not enough [memory](input::memory_left) for the
/// cube.
pub fn capture_with(
    center: DVec3,
    side: u32,
    mut picture: impl FnMut(&Camera) -> Result<Picture>,
) -> Result<EnvironmentMap> {
    let face_texels = u64::from(side).saturating_mul(u64::from(side));
    let what = format_args!("an environment of 6 faces of {side} x {side} texels");
    let _held = input::reserve(what, face_texels.saturating_mul(6 * CUBE_TEXEL_BYTES))?;
    let mut texels = Vec::with_capacity(6 * face_texels as usize);
    for camera in &cube_cameras(center) {
        let face = picture(camera)?;
        if face.width != side || face.height != side || side == 0 {
            return Err(Error::invalid(format!(
                "an environment needs pictures of {side}x{side} pixels, not {}x{}",
                face.width, face.height
            )));
        }
        // Texel middles are pixel middles: both cut the face's square evenly.
        texels.extend(face.rgba.iter().map(|&[r, g, b, a]| Vec3A::new(r, g, b) * a));
    }
    Ok(EnvironmentMap::from_charts(EnvironmentForm::Cube, side, texels))
}

/// Memory for a texel of a cube that is captured: as it comes, and in the map.
const CUBE_TEXEL_BYTES: u64 = 2 * size_of::<Vec3A>() as u64;

/// What a mesh looks like from `center` (world space) without the triangles that are `hidden`: those of the object that
/// will reflect it.
///
/// # Errors
/// As [`render`](crate::render()).
pub fn capture_environment(
    mesh: &Mesh,
    surface: &dyn Surface,
    lights: &Lights,
    center: DVec3,
    options: &CaptureOptions,
    hidden: &(dyn Fn(usize) -> bool + Sync),
) -> Result<EnvironmentMap> {
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
    check_lamps(lights)?;
    // All faces show the same shadows.
    let lights = PreparedLights::new(lights, &rest, &part, &render_options)?;
    capture_with(center, options.side, |camera| {
        Ok(render_lit(&rest, &part, camera, &lights, &render_options)?.picture)
    })
}

struct PartialSurface<'a> {
    surface: &'a dyn Surface,
    /// Their numbers in the whole mesh.
    kept: &'a [usize],
}

impl PartialSurface<'_> {
    fn own_hit(&self, hit: &Hit) -> Hit {
        let triangle = self.kept[hit.triangle()] as u32;
        Hit { at: SurfacePoint { triangle, ..hit.at }, ..*hit }
    }
}

impl Surface for PartialSurface<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        self.surface.shade(&self.own_hit(hit))
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        self.surface.alpha(&self.own_hit(hit))
    }

    fn casts_shadow(&self, triangle: usize) -> bool {
        self.surface.casts_shadow(self.kept[triangle])
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.surface.smooth_point(&self.own_hit(hit))
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.surface.coverage(self.kept[triangle])
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.surface.is_double_sided(self.kept[triangle])
    }
}

// An object that mirrors an environment of its own.
//
// The extended Phong model: a term `reflectance * C_env(r)` is added to what the lights do, `r` being the mirrored view
// ray. It is for objects whose environment was captured from where they stand, while the rest of the scene has another.

/// A mirrored environment.
#[derive(Clone, Debug)]
pub struct ObjectReflection {
    /// What is mirrored.
    pub environment: EnvironmentLight,
    /// Linear RGB: how much of it.
    pub reflectance: Vec3,
    /// Perceptual roughness of the mirror, 0..1.
    pub roughness: f32,
    /// The shape of the surroundings and the place where the environment was taken, world space; without, they are
    /// infinitely far away.
    pub proxy: Option<(EnvironmentProxy, DVec3)>,
}

/// A surface some of whose triangles mirror an environment, in addition to what they show.
pub struct ReflectingSurface<'a> {
    mesh: &'a Mesh,
    surface: &'a dyn Surface,
    reflection: ObjectReflection,
    is_mirror: &'a (dyn Fn(usize) -> bool + Sync),
}

impl<'a> ReflectingSurface<'a> {
    /// Adds a reflection to the triangles for which `is_mirror` is true.
    pub fn new(
        mesh: &'a Mesh,
        surface: &'a dyn Surface,
        reflection: ObjectReflection,
        is_mirror: &'a (dyn Fn(usize) -> bool + Sync),
    ) -> Self {
        Self { mesh, surface, reflection, is_mirror }
    }

    fn mirrored(&self, hit: &Hit, material: &MaterialSample) -> Vec3 {
        let reflection = &self.reflection;
        let view = MirrorView::new(material.normal, material.normal_steps, hit.to_eye);
        let (direction, steps) = match reflection.proxy {
            Some((proxy, center)) => {
                let corners = self.mesh.triangle_positions(hit.triangle());
                let scale = self.mesh.world_from_mesh.scale as f32;
                let position = self.mesh.world_from_mesh.point(hit.position(self.mesh)).as_vec3();
                let position_steps = hit.lambda_steps.map(|step| interpolate(corners, step) * scale);
                proxy.corrected_footprint(
                    position,
                    position_steps,
                    view.direction,
                    view.steps,
                    center.as_vec3(),
                )
            }
            None => (view.direction, view.steps),
        };
        reflection.environment.reflected(direction, steps, reflection.roughness) * reflection.reflectance
    }
}

impl ReflectingSurface<'_> {
    fn with_reflection(&self, hit: &Hit, material: MaterialSample) -> MaterialSample {
        if !(self.is_mirror)(hit.triangle()) {
            return material;
        }
        let mirrored = self.mirrored(hit, &material);
        MaterialSample { mirrored: material.mirrored + mirrored, lookups: material.lookups + 1, ..material }
    }
}

impl Surface for ReflectingSurface<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (material, finish) = self.surface.shade(hit);
        (self.with_reflection(hit, material), finish)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let first = out.len();
        self.surface.shade_all(hits, out);
        for (hit, (material, _)) in hits.iter().zip(&mut out[first..]) {
            *material = self.with_reflection(hit, *material);
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        self.surface.alpha(hit)
    }

    fn casts_shadow(&self, triangle: usize) -> bool {
        self.surface.casts_shadow(triangle)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.surface.smooth_point(hit)
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.surface.coverage(triangle)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.surface.is_double_sided(triangle)
    }
}
