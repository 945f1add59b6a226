//! Lights, as a scene states them.

use std::sync::Arc;

use fantex_base::parameters;
use fantex_texture::environment::{PrefilteredEnvironment, mirrored, mirrored_steps};
use fantex_texture::{Filtering, ImageTexture, SampleOptions, ShadingPoint, Texture, UvPoint, Wrap};
use glam::{DVec3, Quat, Vec2, Vec3, Vec4};

use crate::Camera;

/// One lamp.
#[derive(Clone, Debug)]
pub struct Light {
    /// Where its light comes from.
    pub kind: LightKind,
    /// Linear RGB: what a white, perfectly diffuse surface that faces the light reflects to every side (for lamps with a
    /// falloff, at the distance where the falloff is one).
    pub color: Vec3,
    /// How it casts shadows; without, it shines through everything.
    pub shadow: Option<ShadowOptions>,
}

/// Where the light of a lamp comes from. World space.
#[derive(Clone, Debug)]
pub enum LightKind {
    /// From one direction, as from the sun.
    Directional {
        /// From the surface to the light; any length but zero.
        to_light: Vec3,
    },
    /// From a point, to all sides.
    Point {
        /// The point.
        position: DVec3,
        /// How it weakens with distance.
        falloff: Falloff,
    },
    /// From a point, into a cone.
    Spot(SpotLight),
    /// From a slide projector.
    Projector(Projector),
}

/// A lamp that shines into a cone, world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotLight {
    /// The cone's apex.
    pub position: DVec3,
    /// Along the cone's axis, away from the lamp; any length but zero.
    pub direction: Vec3,
    /// Angle between the axis and the border of the full light, degrees, 0 to 90.
    pub inner_degrees: f32,
    /// Angle between the axis and the border of all light, degrees, 0 to 90.
    pub outer_degrees: f32,
    /// How it weakens with distance.
    pub falloff: Falloff,
}

/// A lamp whose colour is a texture: `L'_i = C_tex(f^-1(l_i)) L_i`, where `f` projects the cookie into the scene (M. Segal
/// et al., "Fast Shadows and Lighting Effects Using Texture Mapping", 1992). Nothing outside the cookie or behind the lamp
/// is lit. World space.
#[derive(Clone, Debug)]
pub struct Projector {
    /// The pinhole, or the middle of the cookie of an orthographic projector.
    pub position: DVec3,
    /// A point on which the cookie's middle falls.
    pub target: DVec3,
    /// Points to the top of the cookie; need not be orthogonal to the axis.
    pub up: DVec3,
    /// How the light spreads.
    pub lens: Lens,
    /// Width of the cookie over its height.
    pub aspect: f64,
    /// What is projected.
    pub cookie: Cookie,
    /// How the light weakens with distance.
    pub falloff: Falloff,
}

/// How a projector's light spreads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// From a point.
    Perspective {
        /// Vertical opening angle, between 0 and 180.
        fov_degrees: f64,
    },
    /// In parallel.
    Orthographic {
        /// Height of the picture in world units, positive.
        height: f64,
    },
}

/// What a projector projects (the slide, or gobo): linear RGB times alpha.
#[derive(Clone, Debug)]
pub enum Cookie {
    /// An image, filtered over the pixel's footprint; outside it there is no light, whatever its wrap mode.
    Image {
        /// The image, upright.
        image: Arc<ImageTexture>,
        /// How it is filtered.
        options: SampleOptions,
    },
    /// Any texture: texture coordinates are `[0,1]` over the cookie, the position is `(u - 0.5, 0.5 - v, 0)`.
    Texture(Arc<dyn Texture>),
}

impl Cookie {
    /// The mean over a footprint around a place of the cookie, at a time in seconds: linear RGBA, straight alpha.
    pub fn color(&self, uv: Vec2, steps: [Vec2; 2], time: f32) -> Vec4 {
        match self {
            Self::Image { image, options } => {
                let options = SampleOptions { wrap: [Wrap::Clamp; 2], ..*options };
                Vec4::from_array(image.sample(uv, steps, &options))
            }
            Self::Texture(texture) => texture.evaluate(&ShadingPoint {
                position: Vec3::new(uv.x - 0.5, 0.5 - uv.y, 0.0),
                position_steps: steps.map(|step| Vec3::new(step.x, -step.y, 0.0)),
                normal: Vec3::Z,
                normal_steps: [Vec3::ZERO; 2],
                uv: &[UvPoint { uv, steps }],
                vertex_color: Vec4::ONE,
                eye: None,
                time,
                filtering: Filtering::Own,
            }),
        }
    }
}

/// How light weakens with the distance from its lamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Falloff {
    /// Not at all.
    #[default]
    None,
    /// With the square of the distance, as physics has it.
    InverseSquare {
        /// World units at which the factor is one, positive.
        reference: f64,
        /// World units beyond which there is no light at all: the square law is brought smoothly to zero
        /// (glTF's KHR_lights_punctual).
        range: Option<f64>,
    },
}

impl Falloff {
    /// Factor of the light at a distance in world units.
    pub fn factor(&self, distance: f64) -> f32 {
        match *self {
            Self::None => 1.0,
            Self::InverseSquare { reference, range } => {
                let window = range.map_or(1.0, |range| 1.0 - (distance / range).powi(4)).clamp(0.0, 1.0);
                // A point at the lamp itself must not turn infinite.
                let relative = (distance / reference).max(1e-3);
                (window / (relative * relative)) as f32
            }
        }
    }
}

impl Light {
    /// A lamp without shadows.
    pub fn new(kind: LightKind, color: Vec3) -> Self {
        Self { kind, color, shadow: None }
    }

    /// Light from one direction; `to_light` has any length but zero.
    pub fn directional(to_light: Vec3, color: Vec3) -> Self {
        Self::new(LightKind::Directional { to_light }, color)
    }

    /// Why the lamp cannot shine, or nothing.
    fn defect(&self) -> Option<&'static str> {
        if !self.color.is_finite() {
            return Some("its colour is not finite");
        }
        let kind = match &self.kind {
            LightKind::Directional { to_light } => {
                (!(to_light.is_finite() && *to_light != Vec3::ZERO)).then_some("it has no direction")
            }
            LightKind::Point { position, falloff } => place_defect(*position, falloff),
            LightKind::Spot(spot) => spot.defect(),
            LightKind::Projector(projector) => projector.defect(),
        };
        kind.or_else(|| self.shadow.and_then(|shadow| shadow.defect()))
    }

    /// The same lamp with shadows.
    pub fn with_shadow(self, shadow: ShadowOptions) -> Self {
        Self { shadow: Some(shadow), ..self }
    }
}

fn place_defect(position: DVec3, falloff: &Falloff) -> Option<&'static str> {
    let is_positive = |length: f64| length > 0.0 && length.is_finite();
    match *falloff {
        _ if !position.is_finite() => Some("its position is not finite"),
        Falloff::InverseSquare { reference, range }
            if !is_positive(reference) || range.is_some_and(|r| !is_positive(r)) =>
        {
            Some("the distances of its falloff must be positive")
        }
        _ => None,
    }
}

/// How the light of a spot fades across its cone, by the cosine of the angle to the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeFalloff {
    /// There is no light below.
    pub cosine_outer: f32,
    /// From there to the full light.
    pub cosine_range: f32,
}

impl ConeFalloff {
    /// Narrower ramps of the cosine are as wide as this: few steps of single precision.
    const MIN_RANGE: f32 = 1e-6;

    /// Between the borders of the full light and of all light, as angles to the axis.
    pub fn new(inner_degrees: f32, outer_degrees: f32) -> Self {
        let [inner, outer] = [inner_degrees, outer_degrees].map(|angle| angle.to_radians().cos());
        Self { cosine_outer: outer, cosine_range: (inner - outer).max(Self::MIN_RANGE) }
    }

    /// The share of the light at an angle of this cosine: as KHR_lights_punctual has it, the square of a linear ramp.
    #[inline]
    pub fn share(&self, cosine: f32) -> f32 {
        let ramp = ((cosine - self.cosine_outer) / self.cosine_range).clamp(0.0, 1.0);
        ramp * ramp
    }
}

impl SpotLight {
    /// How its light fades across the cone.
    pub fn cone(&self) -> ConeFalloff {
        ConeFalloff::new(self.inner_degrees, self.outer_degrees)
    }

    fn defect(&self) -> Option<&'static str> {
        let Self { position, direction, inner_degrees, outer_degrees, falloff } = self;
        if !(direction.is_finite() && *direction != Vec3::ZERO) {
            Some("it has no direction")
        } else if !(0.0..=90.0).contains(inner_degrees) || !(0.0..=90.0).contains(outer_degrees) {
            Some("the angles of its cone must be between 0 and 90 degrees")
        } else if inner_degrees > outer_degrees {
            Some("the inner angle of its cone is larger than the outer one")
        } else {
            place_defect(*position, falloff)
        }
    }
}

impl Projector {
    fn defect(&self) -> Option<&'static str> {
        let direction = self.target - self.position;
        let opening = match self.lens {
            Lens::Perspective { fov_degrees } => fov_degrees > 0.0 && fov_degrees < 180.0,
            Lens::Orthographic { height } => height > 0.0 && height.is_finite(),
        };
        if !(direction.is_finite() && direction != DVec3::ZERO && self.up.is_finite()) {
            Some("its position and target are the same point, or not finite")
        } else if !opening {
            Some("its opening angle must be between 0 and 180 degrees, its height positive")
        } else if !(self.aspect > 0.0 && self.aspect.is_finite()) {
            Some("the aspect of its cookie must be positive")
        } else {
            place_defect(self.position, &self.falloff)
        }
    }
}

/// Light from everywhere: an environment, or one colour from above, one from below, mixed by height in between.
#[derive(Clone, Debug, PartialEq)]
pub struct AmbientLight {
    /// Linear RGB from straight above.
    pub sky: Vec3,
    /// Linear RGB from straight below.
    pub ground: Vec3,
    /// Unit vector upwards.
    pub up: Vec3,
    /// Takes the place of both colours.
    pub environment: Option<EnvironmentLight>,
}

impl AmbientLight {
    /// The same colour from all sides.
    pub fn uniform(color: Vec3) -> Self {
        Self { sky: color, ground: color, up: Vec3::Y, environment: None }
    }

    /// Colour from a (unit) direction; also what a white surface with that normal reflects.
    pub fn radiance_from(&self, direction: Vec3) -> Vec3 {
        self.ground.lerp(self.sky, 0.5 + 0.5 * direction.dot(self.up))
    }
}

/// All light of a scene.
#[derive(Clone, Debug)]
pub struct Lights {
    /// Light from everywhere.
    pub ambient: AmbientLight,
    /// Light from certain directions and places.
    pub lamps: Vec<Light>,
}

impl Default for Lights {
    /// A sun high in front (+z) and to the left, and a sky a little brighter than the ground.
    fn default() -> Self {
        Self::sun(Vec3::new(-0.5, 0.8, 0.7))
    }
}

impl Lights {
    /// A white sun and a sky. Together they stay below one, so that a white model does not burn out.
    pub fn sun(to_light: Vec3) -> Self {
        Self {
            ambient: AmbientLight { sky: Vec3::splat(0.33), ..AmbientLight::uniform(Vec3::splat(0.2)) },
            lamps: vec![Light::directional(to_light, Vec3::splat(0.65))],
        }
    }

    /// The light of an environment alone.
    pub fn environment(light: EnvironmentLight) -> Self {
        Self { ambient: AmbientLight::environment(light), lamps: Vec::new() }
    }

    /// A sun over the photographer's left shoulder: every side of a model gets its picture in good light.
    pub fn behind(camera: &Camera) -> Self {
        let back = (camera.eye - camera.target).normalize_or(glam::DVec3::Z);
        let right = camera.up.cross(back).normalize_or(glam::DVec3::X);
        let up = back.cross(right);
        Self::sun((back - right * 0.6 + up * 0.7).as_vec3())
    }

    /// The first lamp that cannot shine, counted from 0, and why; or nothing.
    pub fn defect(&self) -> Option<(usize, &'static str)> {
        self.lamps.iter().enumerate().find_map(|(lamp, light)| Some((lamp, light.defect()?)))
    }

    /// All lamps with shadows.
    pub fn with_shadows(mut self, shadow: ShadowOptions) -> Self {
        self.lamps.iter_mut().for_each(|lamp| lamp.shadow = Some(shadow));
        self
    }
}

// How lamps cast shadows.

parameters! {
    /// A shadow map.
    #[derive(Copy)]
    #[schemars(rename = "Shadow")]
    pub struct ShadowOptions {
        /// Texels along each side of the map. A sun has one map over the whole scene, a point light six.
        #[serde(rename = "size")]
        #[schemars(range(min = ShadowOptions::MIN_RESOLUTION, max = ShadowOptions::MAX_RESOLUTION))]
        pub resolution: u32 = 2048,
        /// How far a receiver is lifted towards the lamp, in texels of the map.
        #[schemars(range(min = 0, max = 1000))]
        pub bias: f32 = 1.0,
        /// How far a receiver is lifted along its normal where light grazes it, in texels of the map.
        #[serde(rename = "normal_bias")]
        #[schemars(range(min = 0, max = 1000))]
        pub normal_offset: f32 = 1.5,
        /// Half the width of the border, in world units.
        #[schemars(range(min = 0))]
        pub softness: f32 = 0.0,
        /// Radius of the lamp in world units (of the sun: the tangent of its angle): borders grow wider with the distance.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub lamp_radius: Option<f32> = None,
    }
}

/// How soft the border of a shadow is; never sharper than the map and the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Penumbra {
    /// As sharp as the map.
    Sharp,
    /// With the same half width everywhere, world units.
    Even(f32),
    /// Wider the farther the shadow falls, by the lamp's radius in world units (for parallel light: the tangent of the angle
    /// that the radius appears under, 0.0047 for the sun): R. Fernando, "Percentage-Closer Soft Shadows", 2005.
    Lamp(f32),
}

impl ShadowOptions {
    /// Least texels along a side.
    pub const MIN_RESOLUTION: u32 = 16;

    /// Most texels along a side: 256 MiB per map.
    pub const MAX_RESOLUTION: u32 = 8_192;

    /// How soft the border is.
    pub fn penumbra(&self) -> Penumbra {
        match self.lamp_radius {
            Some(radius) => Penumbra::Lamp(radius),
            None if self.softness == 0.0 => Penumbra::Sharp,
            None => Penumbra::Even(self.softness),
        }
    }

    /// Why no shadow can be cast, or nothing.
    pub fn defect(&self) -> Option<&'static str> {
        let width = self.lamp_radius.unwrap_or(self.softness);
        if !(Self::MIN_RESOLUTION..=Self::MAX_RESOLUTION).contains(&self.resolution) {
            Some("its shadow map must have between 16 and 8192 texels along a side")
        } else if !(self.bias.is_finite() && self.normal_offset.is_finite()) {
            Some("the bias of its shadows is not finite")
        } else if !(width.is_finite() && width >= 0.0) {
            Some("the penumbra of its shadows must not be negative")
        } else {
            None
        }
    }
}

// Light from the surroundings: two colours, or an environment map.

/// Light from an environment map.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    /// The map and its reflections in rough surfaces.
    pub map: Arc<PrefilteredEnvironment>,
    /// Factor of its light.
    pub strength: f32,
    /// Degrees by which it is turned to the left (seen from above: counter-clockwise) about `+y`.
    pub rotation_degrees: f32,
}

impl PartialEq for EnvironmentLight {
    /// Maps are equal if they are the same one.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.map, &other.map)
            && self.strength == other.strength
            && self.rotation_degrees == other.rotation_degrees
    }
}

impl EnvironmentLight {
    /// A map as it stands.
    pub fn new(map: Arc<PrefilteredEnvironment>) -> Self {
        Self { map, strength: 1.0, rotation_degrees: 0.0 }
    }

    /// What a white diffuse surface with a unit normal reflects, linear RGB.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        self.map.irradiance().diffuse(self.map_from_world() * normal) * self.strength
    }

    /// Light around a direction, gathered by a perceptual roughness (0..1), linear RGB; `steps` are the changes of the unit
    /// direction along the pixel's edges. World axes.
    pub fn reflected(&self, direction: Vec3, steps: [Vec3; 2], roughness: f32) -> Vec3 {
        let turn = self.map_from_world();
        self.map.reflected(turn * direction, steps.map(|step| turn * step), roughness) * self.strength
    }

    fn map_from_world(&self) -> Quat {
        Quat::from_rotation_y(-self.rotation_degrees.to_radians())
    }
}

/// The mirror direction of a point and how it changes over the pixel.
#[derive(Clone, Copy, Debug)]
pub struct MirrorView {
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit vector to where the eye looks in the mirror.
    pub direction: Vec3,
    /// Its change along the pixel's edges.
    pub steps: [Vec3; 2],
}

impl MirrorView {
    /// Neighbouring pixels look along nearly parallel rays: only the normal's change counts, which on anything but flat
    /// mirrors is far larger.
    pub fn new(normal: Vec3, normal_steps: [Vec3; 2], to_eye: Vec3) -> Self {
        let steps = mirrored_steps(normal, normal_steps, to_eye, [Vec3::ZERO; 2]);
        Self { normal, direction: mirrored(normal, to_eye), steps }
    }
}

impl AmbientLight {
    /// The light of an environment map.
    pub fn environment(light: EnvironmentLight) -> Self {
        Self { environment: Some(light), ..Self::uniform(Vec3::ZERO) }
    }

    /// What a white diffuse surface with a unit normal reflects.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        match &self.environment {
            Some(light) => light.diffuse(normal),
            None => self.radiance_from(normal),
        }
    }

    /// What a surface of a perceptual roughness gathers around the mirror direction. The lobe of a rough surface leans
    /// from there towards the normal (S. Lagarde and C. de Rousiers, "Moving Frostbite to physically based rendering",
    /// 2014, for GGX).
    pub fn specular(&self, view: &MirrorView, roughness: f32) -> Vec3 {
        let alpha = (roughness * roughness).clamp(0.0, 1.0);
        match &self.environment {
            Some(light) => {
                let share = (1.0 - alpha) * ((1.0 - alpha).sqrt() + alpha);
                let middle = view.normal.lerp(view.direction, share).normalize_or(view.normal);
                light.reflected(middle, view.steps, roughness)
            }
            None => self.radiance_from(view.direction.lerp(view.normal, alpha).normalize_or(view.normal)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_cones_have_their_full_light_on_the_axis() {
        for (inner, outer) in [(0.0, 0.1), (0.0, 0.5), (0.0, 0.81), (0.3, 0.3), (15.0, 20.0), (0.0, 90.0)] {
            let cone = ConeFalloff::new(inner, outer);
            assert_eq!(cone.share(1.0), 1.0, "{inner} {outer}");
            assert_eq!(cone.share((outer * 1.1).to_radians().cos()), 0.0, "{inner} {outer}");
        }
        // The square of the ramp, in double precision.
        let [inner, outer, at] = [0.0, 0.5, 0.3].map(|angle: f64| angle.to_radians().cos());
        let expected = ((at - outer) / (inner - outer)).powi(2);
        assert!((f64::from(ConeFalloff::new(0.0, 0.5).share(at as f32)) - expected).abs() < 5e-3);
    }
}
