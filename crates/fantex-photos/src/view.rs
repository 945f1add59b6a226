//! A photograph, ready to be looked up from the surface.
//!
//! ```text
//!  weight = (clearance * border * lens * facing * quality)^6       quality = cos(angle) * pixels per mesh unit
//!            `------------ confidence -----------'
//! ```
//!
//! Every factor is a continuous function of a point and its smooth normal and falls to zero before the photograph ends: at what hides
//! the point and at outlines (clearance), at the picture's border, at the end of the lens' valid radius, and where the surface
//! turns away. (Only where a crease turns a triangle away at once do they fall at once, along the crease.) The high power makes the best view dominate, so that photographs which do not fit exactly are not mixed more than the
//! transition between them needs.

use fantex_mesh::Mesh;
use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use crate::Photograph;
use crate::pages::PageReader;
use crate::pyramid::Pyramid;
use crate::sight::{MeshCamera, Sight};

/// Surfaces that are seen under a smaller cosine are not taken from a photograph.
const SMALLEST_COSINE: f32 = 0.15;
/// The cosine from which on facing counts in full; the quality goes on.
const FULL_COSINE: f32 = 0.35;
/// The cosine of the triangle itself from which on it counts; below, nothing in front of it need be far enough away to be told apart.
const FULL_FACE_COSINE: f64 = 0.1;
/// Width of the border in which the weight falls to zero, as a share of the picture's shorter side.
const BORDER_SHARE: f64 = 0.04;
/// The share of the lens' valid radius in which it does.
const LENS_SHARE: f64 = 0.04;

/// A point of the surface that is looked at, mesh space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub(crate) position: Vec3,
    /// Unit normal, smooth over creases, so that neighbouring triangles agree.
    pub(crate) normal: Vec3,
    /// The triangle's own unit normal; not given at vertices, which have several.
    pub(crate) face: Option<Vec3>,
}

/// How a photograph sees a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// Pixels of the camera.
    pub(crate) pixel: DVec2,
    /// Above 0, and comparable between photographs of one point.
    pub(crate) weight: f32,
    /// In (0, 1]: how far the point is from not being seen.
    pub(crate) confidence: f32,
    /// Pixels of the camera per mesh unit, across the line of sight.
    pub(crate) resolution: f32,
}

/// A photograph and what is in it, in mesh space.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) camera: MeshCamera,
    pub(crate) sight: Sight,
    pub(crate) pyramid: Pyramid,
    /// Factor of its colours.
    pub(crate) gain: Vec3,
}

/// The camera of a photograph in mesh space.
pub(crate) fn mesh_camera(photograph: &Photograph, mesh: &Mesh) -> MeshCamera {
    MeshCamera {
        camera: photograph.camera,
        rotation: photograph.camera_from_world.rotation,
        eye: (photograph.camera_from_world.eye() - mesh.world_from_mesh.offset) / mesh.world_from_mesh.scale,
    }
}

/// How a camera sees a point of the surface.
pub(crate) fn seen(camera: &MeshCamera, sight: &Sight, reader: &PageReader<'_>, spot: &Spot) -> Option<Seen> {
    let position = spot.position;
    let to_eye = camera.eye - position.as_dvec3();
    let distance = to_eye.length();
    let cosine = (spot.normal.as_dvec3().dot(to_eye) / distance) as f32;
    if cosine.is_nan() || cosine <= SMALLEST_COSINE {
        return None;
    }
    let face_cosine = spot.face.map_or(1.0, |face| face.as_dvec3().dot(to_eye) / distance);
    if face_cosine <= 0.0 {
        return None;
    }
    let p_camera = camera.in_camera(position.as_dvec3());
    let on_picture = camera.camera.project(p_camera)?;
    let size = DVec2::from(camera.camera.size.map(f64::from));
    let inside = on_picture.pixel.min(size - on_picture.pixel).min_element();
    if inside <= 0.0 {
        return None;
    }
    let border = ramp(inside / (BORDER_SHARE * size.min_element()));
    let lens = ramp(on_picture.room / LENS_SHARE);
    let facing = ramp(f64::from((cosine - SMALLEST_COSINE) / (FULL_COSINE - SMALLEST_COSINE)));
    let depth = camera.camera.lens.depth(p_camera);
    let clearance = sight.clearance(reader, on_picture.pixel, depth, camera.focal());
    let confidence = clearance * border * lens * facing * ramp(face_cosine / FULL_FACE_COSINE);
    let resolution = (camera.focal() / distance) as f32;
    let quality = cosine * resolution;
    // Resolutions are a few thousand pixels per mesh unit: their sixth power is a number yet. Confidences are inside of the power, so that
    // much worse views take over in time: outside, they would in the last pixel of a good one, which looks like a step.
    let weight = (confidence * quality * 1e-3).powi(6);
    (weight > 0.0 && weight.is_finite()).then_some(Seen {
        pixel: on_picture.pixel,
        weight,
        confidence,
        resolution,
    })
}

/// From 0 at 0 to 1 at 1 and beyond, straight.
fn ramp(x: f64) -> f32 {
    x.clamp(0.0, 1.0) as f32
}

/// From 0 at 0 to 1 at 1 and beyond, smooth at both ends.
pub(crate) fn smooth(x: f64) -> f32 {
    let x = x.clamp(0.0, 1.0);
    (x * x * (3.0 - 2.0 * x)) as f32
}

impl View {
    /// How the photograph sees a point.
    pub(crate) fn seen(&self, reader: &PageReader<'_>, spot: &Spot) -> Option<Seen> {
        seen(&self.camera, &self.sight, reader, spot)
    }

    /// The mean colour with its gain, and alpha, of what is seen over a parallelogram of the surface with these sides, mesh space.
    pub(crate) fn color(
        &self,
        reader: &PageReader<'_>,
        seen: &Seen,
        position: Vec3,
        sides: [Vec3; 2],
    ) -> Vec4 {
        let scale = self.pixel_scale();
        let sides = sides.map(|side| {
            let half = side.as_dvec3() * 0.5;
            let at = |p: DVec3| self.camera.camera.project(self.camera.in_camera(p)).map(|seen| seen.pixel);
            let [ahead, behind] = [half, -half].map(|half| at(position.as_dvec3() + half));
            let across = match (ahead, behind) {
                (Some(ahead), Some(behind)) => (ahead - behind) * scale,
                _ => DVec2::ZERO,
            };
            across.as_vec2().clamp_length_max(1e4)
        });
        self.mean(reader, seen, sides)
    }

    /// As [`View::color`], over a square of the surface that is turned towards the camera.
    pub(crate) fn color_within(&self, reader: &PageReader<'_>, seen: &Seen, side: f32) -> Vec4 {
        let pixels = side * seen.resolution;
        let scale = self.pixel_scale().as_vec2();
        self.mean(reader, seen, [Vec2::X * pixels * scale, Vec2::Y * pixels * scale])
    }

    fn mean(&self, reader: &PageReader<'_>, seen: &Seen, sides: [Vec2; 2]) -> Vec4 {
        let mean = self.pyramid.mean(reader, seen.pixel * self.pixel_scale(), sides);
        (mean.truncate() * self.gain).extend(mean.w)
    }

    /// Pixels of the file per pixel of the camera: photographs may have been made smaller after their calibration.
    fn pixel_scale(&self) -> DVec2 {
        DVec2::from(self.pyramid.size.map(f64::from)) / DVec2::from(self.camera.camera.size.map(f64::from))
    }
}
