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

use std::fmt;
use std::path::{Path, PathBuf};

use fantex_bake::{Source, TexelPoint};
use fantex_base::{Error, Result, input};
use fantex_mesh::{AlphaMode, CornerNormals, Mesh, RayHit, SURFACE_OFFSET, TriangleBvh};
use fantex_store::ChannelKind;
use fantex_texture::{ColorSpace, Image};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::pyramid::{PageReader, Pyramid};
use crate::sight::{MeshCamera, Sight};
use crate::{Distortion, Lens, OnPlane};

/// Surfaces that are seen under a smaller cosine are not taken from a photograph.
const MIN_COSINE: f32 = 0.15;
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

pub(crate) fn mesh_camera(photograph: &Photograph, mesh: &Mesh) -> MeshCamera {
    MeshCamera {
        camera: photograph.camera,
        rotation: photograph.camera_from_world.rotation,
        eye: (photograph.camera_from_world.eye() - mesh.world_from_mesh.offset) / mesh.world_from_mesh.scale,
    }
}

pub(crate) fn seen(camera: &MeshCamera, sight: &Sight, reader: &PageReader<'_>, spot: &Spot) -> Option<Seen> {
    let position = spot.position;
    let to_eye = camera.eye - position.as_dvec3();
    let distance = to_eye.length();
    let cosine = (spot.normal.as_dvec3().dot(to_eye) / distance) as f32;
    if cosine.is_nan() || cosine <= MIN_COSINE {
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
    let facing = ramp(f64::from((cosine - MIN_COSINE) / (FULL_COSINE - MIN_COSINE)));
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

// ---- A photograph and the camera that took it.

/// A calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoCamera {
    /// Width and height in pixels, as the calibration knows them.
    pub size: [u32; 2],
    /// Focal lengths along x and y, pixels.
    pub focal: DVec2,
    /// Where the axis meets the picture, pixels from the top left corner (pixel centres at half integers).
    pub center: DVec2,
    /// The lens.
    pub lens: Lens,
}

/// Where a point is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnPicture {
    /// Pixels from the top left corner.
    pub pixel: DVec2,
    /// [`OnPlane::room`].
    pub room: f64,
}

impl PhotoCamera {
    /// A camera without distortion, its axis in the middle of the picture, square pixels.
    pub fn pinhole(size: [u32; 2], focal: f64) -> Self {
        let center = DVec2::from(size.map(f64::from)) * 0.5;
        Self { size, focal: DVec2::splat(focal), center, lens: Lens::new(Distortion::PINHOLE) }
    }

    /// Where a point of camera space is seen; it may lie outside of the picture.
    pub fn project(&self, p_camera: DVec3) -> Option<OnPicture> {
        let OnPlane { position, room } = self.lens.project(p_camera)?;
        Some(OnPicture { pixel: self.center + position * self.focal, room })
    }

    /// The unit direction, camera space, that is seen at a position in pixels.
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        self.lens.direction((pixel - self.center) / self.focal)
    }
}

/// The rigid motion that takes world space to camera space: `p_camera = rotation * p_world + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraFromWorld {
    /// A rotation.
    pub rotation: DMat3,
    /// World units.
    pub translation: DVec3,
}

impl CameraFromWorld {
    /// A camera at `eye` that looks at `target`, both world space, with `up` upwards in the picture.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let forward = (target - eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Self { rotation, translation: -(rotation * eye) }
    }

    /// The pinhole, world space.
    pub fn eye(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }
}

/// One photograph of a set.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// As the set of cameras names it.
    pub name: String,
    /// The image file.
    pub path: PathBuf,
    /// An image of the same shape that is black where the photograph is not to be used.
    pub mask: Option<PathBuf>,
    /// What took it.
    pub camera: PhotoCamera,
    /// Where it stood.
    pub camera_from_world: CameraFromWorld,
}

/// How far the sides' ratio of a picture may be from that of another one of the same shape, but for a rounded pixel.
const SHAPE_TOLERANCE: f64 = 0.01;

/// Whether a picture of so many pixels may be another one at another size.
pub(crate) fn have_one_shape(found: [u32; 2], expected: [u32; 2]) -> bool {
    let scale = DVec2::from(found.map(f64::from)) / DVec2::from(expected.map(f64::from));
    (scale.x / scale.y - 1.0).abs() <= SHAPE_TOLERANCE + 1.0 / f64::from(found[0].min(found[1]).max(1))
}

// ---- Masks: which pixels of a photograph are to be used.

/// An image that is black where a photograph is not to be used.
pub(crate) struct Mask {
    image: Image,
    /// Pixels of the photograph.
    size: [u32; 2],
}

impl Mask {
    /// The mask of a photograph of `size` pixels; it may be smaller or larger.
    pub(crate) fn load(path: &Path, size: [u32; 2]) -> Result<Self> {
        let image = Image::load_as(path, ColorSpace::Linear)?;
        let found = [image.width, image.height];
        match have_one_shape(found, size) {
            true => Ok(Self { image, size }),
            false => {
                let message = format!(
                    "the mask {} has {found:?} pixels, but its photograph has {size:?}, which is another shape; give masks that \
                     were made for these photographs",
                    path.display()
                );
                Err(Error::malformed(message).with_path(path))
            }
        }
    }

    /// How much of a pixel of the photograph is to be used: 0 for none of it, 1 for all.
    pub(crate) fn share(&self, x: u32, y: u32) -> f32 {
        let there =
            |at: u32, found: u32, size: u32| (u64::from(at) * u64::from(found) / u64::from(size)) as u32;
        let [width, height] = self.size;
        let at = [there(x, self.image.width, width), there(y, self.image.height, height)];
        let [value, .., alpha] = self.image.linear_texel(at[0], at[1]);
        (value * alpha).clamp(0.0, 1.0)
    }
}

// ---- Taking photographs of a model: sets with known cameras, to try things out and to measure against.

/// How to take a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Rays along each side of a pixel, at least 1.
    pub samples: u32,
    /// Factor of red, green and blue, linear light.
    pub exposure: Vec3,
    /// What is seen beside the model, linear; exposed, too.
    pub background: Vec3,
}

impl Default for CaptureOptions {
    /// Nine rays per pixel, exposed as it is, before a grey wall.
    fn default() -> Self {
        Self { samples: 3, exposure: Vec3::ONE, background: Vec3::splat(0.18) }
    }
}

/// Longest side of a photograph in pixels.
const MAX_PHOTOGRAPH_SIDE: u32 = 16_384;

/// Memory for a pixel: in the picture, in eight bits, and in the file that is written.
const PIXEL_BYTES: u64 = 12 + 3 + 3;

/// A model, and what photographs of it share.
pub struct CaptureScene<'a> {
    mesh: &'a Mesh,
    bvh: TriangleBvh,
    source: &'a dyn Source,
    base_color: Option<usize>,
    channels: usize,
    normals: CornerNormals,
}

impl<'a> CaptureScene<'a> {
    /// A mesh with the base colour of a source.
    pub fn new(mesh: &'a Mesh, source: &'a dyn Source) -> Self {
        let channels = source.channels();
        Self {
            mesh,
            bvh: TriangleBvh::new(mesh),
            source,
            base_color: channels.iter().position(|c| c.kind == ChannelKind::BaseColor),
            channels: channels.len(),
            normals: CornerNormals::of(mesh),
        }
    }

    /// The picture that a photograph's camera takes of the base colour, through its lens: linear RGB, as if lit from everywhere.
    /// Rays go through the lens, so any distortion is exact. Whether somebody wants to stop is asked for each row.
    ///
    /// # Errors
    /// A side is 0 or longer than 16 384 pixels, or the picture takes more memory than is left; or it was ended.
    pub fn capture(
        &self,
        photograph: &Photograph,
        options: &CaptureOptions,
        is_cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<Image> {
        let [width, height] = photograph.camera.size;
        if [width, height].iter().any(|side| !(1..=MAX_PHOTOGRAPH_SIDE).contains(side)) {
            return Err(Error::invalid(format!(
                "cannot take a photograph of {width} x {height} pixels: both sides must be between 1 and {MAX_PHOTOGRAPH_SIDE}"
            )));
        }
        let pixels = u64::from(width) * u64::from(height);
        let what = format_args!("a photograph of {width} x {height} pixels");
        let _held = input::reserve(what, PIXEL_BYTES * pixels)?;
        let camera = mesh_camera(photograph, self.mesh);
        let taker = Taker { scene: self, mesh_from_camera: camera.rotation.transpose(), camera, options };
        let mut samples = vec![0.0; 3 * pixels as usize];
        let rows = samples.par_chunks_mut(3 * width as usize);
        rows.enumerate().try_for_each(|(y, row)| {
            if is_cancelled() {
                return Err(Error::cancelled("the photograph was cancelled"));
            }
            for (x, pixel) in (0..).zip(row.as_chunks_mut::<3>().0) {
                *pixel = taker.pixel([x, y as u32]).to_array();
            }
            Ok(())
        })?;
        Ok(Image::from_linear(width, height, 3, samples))
    }
}

impl fmt::Debug for CaptureScene<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CaptureScene").field("channels", &self.channels).finish_non_exhaustive()
    }
}

struct Taker<'a> {
    scene: &'a CaptureScene<'a>,
    mesh_from_camera: DMat3,
    camera: MeshCamera,
    options: &'a CaptureOptions,
}

/// Surfaces behind each other that a ray passes.
const MAX_LAYERS: usize = 64;

impl Taker<'_> {
    fn pixel(&self, [x, y]: [u32; 2]) -> Vec3 {
        let samples = self.options.samples.max(1);
        let step = 1.0 / f64::from(samples);
        let mut sum = Vec3::ZERO;
        for i in 0..samples * samples {
            let offset = DVec2::new(f64::from(i % samples) + 0.5, f64::from(i / samples) + 0.5) * step;
            let at = DVec2::new(f64::from(x), f64::from(y)) + offset;
            sum += self.seen(at, step);
        }
        sum / (samples * samples) as f32 * self.options.exposure
    }

    fn direction(&self, at: DVec2) -> Option<DVec3> {
        Some(self.mesh_from_camera * self.camera.camera.direction(at)?)
    }

    /// What is seen along a ray: surfaces one behind the other, as far as they let something through.
    fn seen(&self, at: DVec2, step: f64) -> Vec3 {
        let scene = self.scene;
        let Some(direction) = self.direction(at) else { return self.options.background };
        // Rays begin near the mesh, where single precision is enough.
        let start = (self.camera.eye + direction * (self.camera.eye.length() - 2.0).max(0.0)).as_vec3();
        let (mut sum, mut clear, mut beyond) = (Vec3::ZERO, 1.0, f32::NEG_INFINITY);
        for _ in 0..MAX_LAYERS {
            let accept = |hit: &RayHit| hit.distance > beyond;
            let hit = scene.bvh.first_hit_where(start, direction.as_vec3(), f32::INFINITY, accept);
            let Some(hit) = hit else { break };
            let color = self.color(&hit, at, step, direction);
            let material = scene.mesh.materials.get(scene.mesh.material_of(hit.point.index()));
            let alpha = match material.map_or(AlphaMode::Opaque, |material| material.alpha) {
                AlphaMode::Opaque => return sum + color.truncate() * clear,
                AlphaMode::Mask(threshold) => f32::from(u8::from(color.w >= threshold)),
                AlphaMode::Blend => color.w.clamp(0.0, 1.0),
            };
            sum += color.truncate() * (alpha * clear);
            clear *= 1.0 - alpha;
            if clear <= 0.0 {
                return sum;
            }
            // Two triangles meet a ray through their common edge at one distance: that is one layer.
            beyond = hit.distance + SURFACE_OFFSET;
        }
        sum + self.options.background * clear
    }

    /// Base colour and opacity of a surface over the part of it that a ray stands for.
    fn color(&self, hit: &RayHit, at: DVec2, step: f64, direction: DVec3) -> Vec4 {
        let CaptureScene { mesh, source, base_color, channels, ref normals, .. } = *self.scene;
        let corners = mesh.triangle_positions(hit.point.index()).map(|c| c.as_dvec3());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let on_plane = |direction: DVec3| {
            self.camera.eye + direction * (normal.dot(corners[0] - self.camera.eye) / normal.dot(direction))
        };
        let middle = on_plane(direction);
        let steps = [DVec2::X, DVec2::Y].map(|axis| {
            let beside = self.direction(at + axis * step).map(on_plane);
            beside.filter(|p| p.is_finite()).map_or(DVec3::ZERO, |p| p - middle)
        });
        let squared = normal.length_squared();
        let lambda_step = |step: DVec3| {
            let along = |from: DVec3, to: DVec3| normal.cross(to - from).dot(step) / squared;
            let [a, b, c] = corners;
            DVec3::new(along(b, c), along(c, a), along(a, b)).as_vec3()
        };
        let at = hit.point;
        let point = TexelPoint {
            at,
            lambda_steps: steps.map(lambda_step),
            position: at.position(mesh),
            position_steps: steps.map(|s| s.as_vec3()),
            normal: normals.at(mesh, at),
        };
        let mut values = vec![Vec4::ZERO; channels];
        source.evaluate(&point, &mut values);
        base_color.map_or(Vec4::ONE, |channel| values[channel])
    }
}
