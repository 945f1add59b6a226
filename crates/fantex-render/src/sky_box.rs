//! The surroundings as the picture's background: a sky box, infinitely far away.

use glam::{Vec2, Vec3, Vec4};

use crate::{Background, RenderOptions};
use fantex_scene::AmbientLight;
use fantex_scene::Projection;

/// The light of the surroundings through a pixel, linear RGB: the mean over it, blurred by a perceptual roughness.
fn seen(ambient: &AmbientLight, projection: &Projection, middle: Vec2, blur: f32) -> Vec3 {
    let direction = |p: Vec2| projection.direction(p).as_vec3();
    let ahead = direction(middle);
    match &ambient.environment {
        Some(environment) => {
            let across = |edge: Vec2| direction(middle + edge * 0.5) - direction(middle - edge * 0.5);
            environment.reflected(ahead, [across(Vec2::X), across(Vec2::Y)], blur)
        }
        None => ambient.radiance_from(ahead),
    }
}

/// Premultiplied RGBA behind a pixel. Surroundings are light and so scaled by the exposure, as their reflections are; the
/// other backgrounds are paint.
pub(crate) fn behind(
    background: &Background,
    pixel: [u32; 2],
    options: &RenderOptions,
    projection: &Projection,
    ambient: &AmbientLight,
) -> Vec4 {
    let middle = Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5;
    match *background {
        Background::Transparent => Vec4::ZERO,
        Background::Color(color) => color.extend(1.0),
        Background::Gradient { top, bottom } => {
            top.lerp(bottom, middle.y / options.height as f32).extend(1.0)
        }
        Background::Environment { blur } => {
            (seen(ambient, projection, middle, blur) * options.exposure).extend(1.0)
        }
    }
}
