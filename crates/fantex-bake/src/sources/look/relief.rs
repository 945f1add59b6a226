//! Normals bent by relief, over a texel.
//!
//! Bump mapping in the form that needs no parametrisation (M. Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU",
//! 2010): the texel's edges are two directions in the surface along which the height's change is known.

use fantex_texture::ShadingPoint;
use fantex_texture::look::{Difference, NormalSpace, Relief};
use fantex_texture::material::TangentFrame;
use glam::{Quat, Vec2, Vec3, Vec4};

use super::answers::Ask;
use crate::SurfacePoint;

/// Shortest step of a difference as a share of the mesh's unit: below, single precision would be seen.
pub(super) const LEAST_STEP: f32 = 5e-5;

/// A material's relief and the frames that it is relative to.
pub(super) struct Reliefs<'a> {
    pub(super) relief: &'a [Relief],
    pub(super) tangents: &'a [Vec<Vec4>],
    pub(super) normals: &'a [Vec3],
    /// World units.
    pub(super) least_step: f32,
}

impl Reliefs<'_> {
    /// The unit normal after all relief. `ask` answers for the point.
    pub(super) fn bend(&self, point: &SurfacePoint, at: &ShadingPoint<'_>, ask: &Ask<'_>) -> Vec3 {
        self.relief.iter().fold(at.normal, |normal, relief| {
            let bent = match relief {
                Relief::Bump { texture, height, difference } => {
                    let height_at = |offset: Vec2| ask(&**texture, offset).x;
                    self.by_height(height_at, *height, *difference, normal, at)
                }
                Relief::Derivatives { texture, uv_set, height, range } => {
                    by_derivatives(ask(&**texture, Vec2::ZERO), *uv_set, height * range, normal, at)
                }
                Relief::Normal { texture, scale, space } => {
                    let texel = ask(&**texture, Vec2::ZERO).truncate() * 2.0 - 1.0;
                    self.by_normal(texel, *scale, *space, normal, point)
                }
            };
            bent.unwrap_or(normal)
        })
    }

    fn by_height(
        &self,
        ask: impl Fn(Vec2) -> f32,
        height: f32,
        difference: Difference,
        normal: Vec3,
        at: &ShadingPoint<'_>,
    ) -> Option<Vec3> {
        let along = |axis: Vec2, edge: Vec3| {
            // Neighbouring texels' heights; farther only where that would be below the digits.
            let step = (self.least_step / edge.length().max(f32::MIN_POSITIVE)).clamp(1.0, 1e6);
            match difference {
                Difference::Forward => (ask(axis * step) - ask(Vec2::ZERO)) / step,
                Difference::Backward => (ask(Vec2::ZERO) - ask(-axis * step)) / step,
                Difference::Central => (ask(axis * step) - ask(-axis * step)) / (2.0 * step),
            }
        };
        let [x, y] = at.position_steps;
        let change = Vec2::new(along(Vec2::X, x), along(Vec2::Y, y)) * height;
        (normal - gradient(at, normal, change)?).try_normalize()
    }

    /// What bent the normal before is kept: the map's normal is turned as the vertex normal was.
    fn by_normal(
        &self,
        texel: Vec3,
        scale: f32,
        space: NormalSpace,
        normal: Vec3,
        point: &SurfacePoint,
    ) -> Option<Vec3> {
        let bent = match space {
            NormalSpace::Object => {
                let upright = point.normal * point.normal.dot(texel);
                upright + (texel - upright) * scale
            }
            NormalSpace::Tangent { uv_set } => {
                let tangents = self.tangents.get(uv_set).filter(|t| !t.is_empty())?;
                let lambda = point.lambda.clamp(Vec3::ZERO, Vec3::ONE);
                let frame = TangentFrame::at(self.normals, tangents, point.triangle, lambda);
                frame.mesh_vector(texel * Vec3::new(scale, scale, 1.0))
            }
        };
        let bent = bent.try_normalize()?;
        Some(if normal == point.normal { bent } else { Quat::from_rotation_arc(point.normal, normal) * bent })
    }
}

/// The gradient in the surface of a function that changes by `change` along the texel's edges.
fn gradient(at: &ShadingPoint<'_>, normal: Vec3, change: Vec2) -> Option<Vec3> {
    let [along_x, along_y] = at.position_steps;
    let x = along_y.cross(normal);
    let determinant = along_x.dot(x);
    let is_plane = determinant.abs() > 1e-6 * along_x.length() * along_y.length();
    let gradient = (x * change.x + normal.cross(along_x) * change.y) / determinant;
    (is_plane && gradient.is_finite()).then_some(gradient)
}

/// `scale` is the world height of a derivative's code of one, per unit of `u` or `v`.
fn by_derivatives(
    texel: Vec4,
    uv_set: usize,
    scale: f32,
    normal: Vec3,
    at: &ShadingPoint<'_>,
) -> Option<Vec3> {
    let uv = at.uv.get(uv_set)?;
    let by_uv = Vec2::new(texel.y * 2.0 - 1.0, texel.z * 2.0 - 1.0) * scale;
    let change = Vec2::new(by_uv.dot(uv.steps[0]), by_uv.dot(uv.steps[1]));
    (normal - gradient(at, normal, change)?).try_normalize()
}
