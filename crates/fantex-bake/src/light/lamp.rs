//! Lights that are sampled on purpose: from one direction, from a small ball, from a ball behind a cone.

use fantex_mesh::{Mesh, WorldFromMesh};
use glam::{DVec3, Vec3};

use super::LightMapError;

/// A light, in world space. Colours are linear RGB: what a white, perfectly diffuse surface that faces the light reflects (for
/// lights with a position: at a distance of one world unit, falling off with the square of the distance).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BakeLight {
    /// Light from one direction, as from the sun.
    Directional {
        /// From the surface to the light; any length but zero.
        to_light: Vec3,
        /// Not negative.
        color: Vec3,
        /// Half the angle under which the light is seen, 0 to 90 degrees (the sun: 0.27). 0 gives hard shadows.
        radius_degrees: f32,
    },
    /// Light from a ball.
    Point {
        /// Its centre.
        position: DVec3,
        /// Not negative.
        color: Vec3,
        /// Radius, not negative; 0 gives hard shadows.
        radius: f64,
    },
    /// Light from a ball, within a cone.
    Spot {
        /// Its centre.
        position: DVec3,
        /// From the light along the cone's axis; any length but zero.
        axis: Vec3,
        /// Not negative.
        color: Vec3,
        /// Radius, not negative; 0 gives hard shadows.
        radius: f64,
        /// Up to this angle from the axis the light has its full strength, 0 to `outer_degrees`.
        inner_degrees: f32,
        /// From this angle on there is none, above `inner_degrees`, at most 180.
        outer_degrees: f32,
    },
}

/// A light in mesh space, ready to be sampled.
#[derive(Clone, Copy, Debug)]
pub(super) enum Lamp {
    Directional { to_light: Vec3, color: Vec3, cos_radius: f32 },
    Ball { position: Vec3, color: Vec3, radius: f32, cone: Option<Cone> },
}

/// What a spot light lets through.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    axis: Vec3,
    cos_inner: f32,
    cos_outer: f32,
}

impl Cone {
    /// The share of the light that leaves along a unit direction (KHR_lights_punctual's curve).
    fn share(&self, from_light: Vec3) -> f32 {
        let t = (self.axis.dot(from_light) - self.cos_outer) / (self.cos_inner - self.cos_outer).max(1e-6);
        t.clamp(0.0, 1.0).powi(2)
    }
}

/// A direction to a light, and what would arrive along it.
pub(super) struct LampSample {
    /// Unit vector.
    pub(super) to_light: Vec3,
    /// Nothing beyond this distance casts a shadow, mesh units.
    pub(super) distance: f32,
    /// What a white surface reflects, per cosine between its normal and `to_light`.
    pub(super) color: Vec3,
}

/// A lamp as it is seen from a point.
struct Appearance {
    /// Unit vector to its middle.
    axis: Vec3,
    /// Cosine of half the angle under which it is seen.
    cos_radius: f32,
    /// As in [`LampSample`], the same in all its directions.
    color: Vec3,
}

impl Lamp {
    /// In the mesh's space.
    pub(super) fn new(mesh: &Mesh, index: usize, light: &BakeLight) -> Result<Self, LightMapError> {
        let checks = Checks { light: index };
        let of_mesh = &mesh.world_from_mesh;
        match *light {
            BakeLight::Directional { to_light, color, radius_degrees } => {
                checks.color(color)?;
                let cos_radius = checks.angle("radius_degrees", radius_degrees, 0.0, 90.0)?.cos();
                Ok(Self::Directional { to_light: checks.direction("to_light", to_light)?, color, cos_radius })
            }
            BakeLight::Point { position, color, radius } => {
                checks.ball(of_mesh, position, color, radius, None)
            }
            BakeLight::Spot { position, axis, color, radius, inner_degrees, outer_degrees } => {
                let inner = checks.angle("inner_degrees", inner_degrees, 0.0, outer_degrees)?;
                let outer = checks.angle("outer_degrees", outer_degrees, inner_degrees, 180.0)?;
                let axis = checks.direction("axis", axis)?;
                let cone = Cone { axis, cos_inner: inner.cos(), cos_outer: outer.cos() };
                checks.ball(of_mesh, position, color, radius, Some(cone))
            }
        }
    }

    /// A random direction from `point` to the light; `None` where no light goes there.
    pub(super) fn sample(&self, point: Vec3, random: [f32; 2]) -> Option<LampSample> {
        let Appearance { axis, cos_radius, color } = self.seen_from(point)?;
        let to_light = in_cone(axis, cos_radius, random);
        let distance = match *self {
            Self::Directional { .. } => f32::INFINITY,
            Self::Ball { position, radius, .. } => {
                let to_centre = position - point;
                let along = to_light.dot(to_centre);
                let within = along * along - to_centre.length_squared() + radius * radius;
                (along - within.max(0.0).sqrt()).max(0.0)
            }
        };
        Some(LampSample { to_light, distance, color })
    }

    /// What a surface at `point` reflects at most if nothing is in between, as the mean of the channels. Where it is 0, it
    /// reflects nothing.
    pub(super) fn most_light(&self, point: Vec3, normal: Vec3) -> f32 {
        self.seen_from(point).map_or(0.0, |seen| {
            let (cos, cos_radius) = (seen.axis.dot(normal).clamp(-1.0, 1.0), seen.cos_radius);
            // The cosine to the nearest direction of the cone.
            let highest = if cos >= cos_radius {
                1.0
            } else {
                cos * cos_radius + ((1.0 - cos * cos) * (1.0 - cos_radius * cos_radius)).max(0.0).sqrt()
            };
            seen.color.element_sum() / 3.0 * highest.max(0.0)
        })
    }

    /// `None` where no light goes.
    fn seen_from(&self, point: Vec3) -> Option<Appearance> {
        match *self {
            Self::Directional { to_light, color, cos_radius } => {
                Some(Appearance { axis: to_light, cos_radius, color })
            }
            Self::Ball { position, color, radius, cone } => {
                let to_centre = position - point;
                let squared = to_centre.length_squared();
                if squared < f32::MIN_POSITIVE {
                    return None;
                }
                let axis = to_centre / squared.sqrt();
                let share = cone.map_or(1.0, |c| c.share(-axis));
                if share == 0.0 {
                    return None;
                }
                let r2 = radius * radius;
                if r2 >= squared {
                    // Inside the ball light comes from everywhere.
                    return Some(Appearance { axis, cos_radius: -1.0, color: color * share * (4.0 / r2) });
                }
                // The ball's radiance is color / r2; a uniform direction in its cone has the density 1 / solid angle, and
                // the solid angle divided by pi is 2 (1 - cos) = 2 sin2 / (1 + cos), which tends to r2 / squared.
                let cos_radius = (1.0 - (r2 / squared).min(1.0)).sqrt();
                let color = color * (share * 2.0 / (1.0 + cos_radius) / squared);
                Some(Appearance { axis, cos_radius, color })
            }
        }
    }
}

/// A direction within the cone around `axis`, uniform over its solid angle.
fn in_cone(axis: Vec3, cos_radius: f32, [u, v]: [f32; 2]) -> Vec3 {
    if cos_radius >= 1.0 {
        return axis;
    }
    let cos = 1.0 - u * (1.0 - cos_radius);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (std::f32::consts::TAU * v).sin_cos();
    let (x, y) = axis.any_orthonormal_pair();
    (x * (sin * cos_phi) + y * (sin * sin_phi) + axis * cos).normalize()
}

/// The ranges of a light's numbers.
struct Checks {
    light: usize,
}

impl Checks {
    fn fail(&self, what: &'static str, value: f64, allowed: &'static str) -> LightMapError {
        LightMapError::Light { light: self.light, what, value, allowed }
    }

    fn color(&self, color: Vec3) -> Result<(), LightMapError> {
        match color.to_array().into_iter().find(|c| !(c.is_finite() && *c >= 0.0)) {
            Some(c) => Err(self.fail("color", c.into(), "finite and not negative")),
            None => Ok(()),
        }
    }

    fn direction(&self, what: &'static str, v: Vec3) -> Result<Vec3, LightMapError> {
        v.try_normalize()
            .ok_or_else(|| self.fail(what, v.length().into(), "a vector of finite, positive length"))
    }

    /// Radians.
    fn angle(&self, what: &'static str, degrees: f32, least: f32, most: f32) -> Result<f32, LightMapError> {
        if (least..=most).contains(&degrees) {
            return Ok(degrees.to_radians());
        }
        let allowed = match what {
            "radius_degrees" => "0 to 90",
            "inner_degrees" => "0 to outer_degrees",
            _ => "inner_degrees to 180",
        };
        Err(self.fail(what, degrees.into(), allowed))
    }

    fn ball(
        &self,
        of_mesh: &WorldFromMesh,
        position: DVec3,
        color: Vec3,
        radius: f64,
        cone: Option<Cone>,
    ) -> Result<Lamp, LightMapError> {
        self.color(color)?;
        if !position.is_finite() {
            return Err(self.fail("position", position.length(), "finite"));
        }
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(self.fail("radius", radius, "finite and not negative"));
        }
        // A mesh unit is `scale` world units, and light falls off with the square of the distance.
        let color = (color.as_dvec3() / (of_mesh.scale * of_mesh.scale)).as_vec3();
        let radius = (radius / of_mesh.scale) as f32;
        Ok(Lamp::Ball { position: of_mesh.inverse_point(position), color, radius, cone })
    }
}
