//! Small scenes with a floor.

use fantex_mesh::Mesh;
use fantex_render::{
    AmbientLight, Background, Camera, Light, Lights, Picture, RenderOptions, Scene, SceneObject, Shading,
    Surface, render,
};
use fantex_texture::look::{LightingModel, LookMaterial, Slot};
use glam::{DAffine3, DVec3, Vec3};

use super::ray;

pub(crate) fn options(shading: Shading) -> RenderOptions {
    RenderOptions {
        width: 120,
        height: 90,
        samples: 4,
        shading,
        background: Background::Color(Vec3::ZERO),
        ..RenderOptions::default()
    }
}

pub(crate) fn picture(scene: &Scene, camera: &Camera, lights: &Lights, options: &RenderOptions) -> Picture {
    render(scene.mesh(), scene, camera, lights, options).unwrap().picture
}

/// White, diffuse, without any highlight: what is seen is the light that arrives.
pub(crate) fn matte() -> LookMaterial {
    LookMaterial {
        lighting: LightingModel::BlinnPhong,
        specular: Slot::number(0.0),
        shininess: Some(Slot::number(1.0)),
        ..LookMaterial::default()
    }
}

pub(crate) fn lit_by(lamps: Vec<Light>) -> Lights {
    Lights { ambient: AmbientLight::uniform(Vec3::ZERO), lamps }
}

/// The point of the plane `y = 0` under the middle of a pixel.
pub(crate) fn on_ground(camera: &Camera, size: [u32; 2], x: u32, y: u32) -> Option<DVec3> {
    let way = ray(camera, size, f64::from(x) + 0.5, f64::from(y) + 0.5);
    (way.y < 0.0).then(|| camera.eye - way * (camera.eye.y / way.y))
}

pub(crate) fn above(height: f64) -> Camera {
    Camera { eye: DVec3::new(0.3, height, 0.8), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 50.0 }
}

/// A square of side one at height 0.5 above a floor of side 6.
pub(crate) fn roof<'a>(
    floor: &'a Mesh,
    square: &'a Mesh,
    below: &'a dyn Surface,
    roof: &'a dyn Surface,
) -> Scene<'a> {
    let raised = DAffine3::from_translation(DVec3::Y * 0.5);
    Scene::new(vec![
        SceneObject::new(floor, below).placed(DAffine3::from_scale(DVec3::splat(6.0))),
        SceneObject::new(square, roof).placed(raised),
    ])
    .unwrap()
}
