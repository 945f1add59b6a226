//! Models, images and textures for looks.

use std::sync::Arc;

use fantex_mesh::Mesh;
use fantex_render::{Bounds, Camera};
use fantex_test::{data, opened};
use fantex_texture::look::LookMaterial;
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, ShadingPoint, Texture};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3, Vec4};

/// An image through the first texture coordinates.
pub(crate) struct UvImage {
    pub(crate) image: ImageTexture,
    pub(crate) options: SampleOptions,
    /// Factor of the coordinates.
    pub(crate) repeat: f32,
}

impl UvImage {
    pub(crate) fn new(image: Image, repeat: f32) -> Arc<Self> {
        let options = SampleOptions { filter: Filter::Anisotropic, ..SampleOptions::default() };
        Arc::new(Self { image: ImageTexture::new(Arc::new(image)), options, repeat })
    }
}

impl Texture for UvImage {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let Some(point) = at.uv.first() else { return Vec4::ONE };
        let steps = point.steps.map(|s| s * self.repeat);
        Vec4::from_array(self.image.sample(point.uv * self.repeat, steps, &self.options))
    }
}

/// A texture that is a function.
pub(crate) struct Function<F>(pub(crate) F);

impl<F: Fn(&ShadingPoint<'_>) -> Vec4 + Send + Sync> Texture for Function<F> {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        (self.0)(at)
    }
}

pub(crate) fn model(name: &str) -> Option<Mesh> {
    Some(opened(&data(name)?))
}

pub(crate) fn image(name: &str) -> Option<Image> {
    Some(Image::load(&data(name)?).unwrap())
}

/// An image whose channels are numbers, not colours.
pub(crate) fn image_as_numbers(name: &str) -> Option<Image> {
    Some(Image { space: ColorSpace::Linear, ..image(name)? })
}

pub(crate) fn look(material: LookMaterial) -> Vec<Arc<LookMaterial>> {
    vec![Arc::new(material)]
}

/// A level square of side one around the origin that faces +y, with texture coordinates.
pub(crate) fn ground() -> Mesh {
    let mesh = super::square();
    let flat = |p: &Vec3| Vec3::new(p.x, 0.0, -p.y);
    Mesh { positions: mesh.positions.iter().map(flat).collect(), ..mesh }
}

/// The placement that makes a mesh two units large and lets it stand on the origin.
pub(crate) fn standing(mesh: &Mesh, rotation: DQuat) -> DAffine3 {
    let bounds = Bounds::of_mesh(mesh);
    let scale = 2.0 / (bounds.max - bounds.min).max_element();
    let centred = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), rotation, DVec3::ZERO)
        * DAffine3::from_translation(-bounds.center());
    let lowest = mesh
        .positions
        .iter()
        .map(|&p| centred.transform_point3(mesh.world_from_mesh.point(p)).y)
        .fold(f64::INFINITY, f64::min);
    DAffine3::from_translation(DVec3::Y * -lowest) * centred
}

/// A camera that looks at something two units large that stands on the origin.
pub(crate) fn in_front(distance: f64) -> Camera {
    let target = DVec3::new(0.0, 0.7, 0.0);
    let eye = target + DVec3::new(0.45, 0.42, 1.0).normalize() * distance;
    Camera { eye, target, up: DVec3::Y, fov_degrees: 35.0 }
}

/// Bars with gaps as an image with alpha: `period` texels, of which `bar` are covered.
pub(crate) fn bars(side: u32, period: u32, bar: u32) -> Image {
    let texel = |i: u32| {
        let (x, y) = (i % side, i / side);
        let covered = x % period < bar || y % period < bar;
        [0.35, 0.2, 0.1, if covered { 1.0 } else { 0.0 }]
    };
    Image::from_linear_rgba(side, side, &(0..side * side).map(texel).collect::<Vec<_>>())
}

/// The steps of a point's first texture coordinates.
pub(crate) fn uv(at: &ShadingPoint<'_>) -> Vec2 {
    at.uv.first().map_or(Vec2::ZERO, |p| p.uv)
}
