//! Normals bent by relief, over a footprint: what pictures and bakes share.
//!
//! Bump mapping in the form that needs no parametrisation (M. Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU",
//! 2010): Blinn's `N' = N + (F_u (N x P_v) - F_v (N x P_u)) / |N|` holds for any two directions in the surface, and the edges
//! of the footprint are two whose changes of position and height are at hand.

use fantex_base::{Error, Result};
use fantex_mesh::{Mesh, corner_tangents};
use glam::{Quat, Vec2, Vec3, Vec4};

use super::{Difference, LookMaterial, NormalSpace, Relief};
use crate::filter::wrap_index;
use crate::material::TangentFrame;
use crate::{Image, UvPoint, Wrap};

/// Shortest step of a difference as a share of the mesh's unit: below, single precision would be seen.
pub const MIN_RELIEF_STEP: f32 = 5e-5;

/// The edges of a footprint as axes of gradients in the surface.
#[derive(Clone, Copy, Debug)]
pub struct GradientAxes {
    x: Vec3,
    y: Vec3,
    determinant: f32,
}

impl GradientAxes {
    /// `None` where the edges are parallel in the plane of the unit `normal`.
    pub fn new([along_x, along_y]: [Vec3; 2], normal: Vec3) -> Option<Self> {
        let x = along_y.cross(normal);
        let determinant = along_x.dot(x);
        let is_plane = determinant.abs() > 1e-6 * along_x.length() * along_y.length();
        is_plane.then(|| Self { x, y: normal.cross(along_x), determinant })
    }

    /// The gradient in the surface of a function that changes by `change` along the edges.
    pub fn gradient(&self, change: Vec2) -> Vec3 {
        (self.x * change.x + self.y * change.y) / self.determinant
    }

    /// The gradient of a height whose derivatives by `u` and `v` a texel holds in green and blue; `scale` is the world height of a
    /// derivative's code of one.
    pub fn of_derivatives(&self, texel: Vec4, uv: &UvPoint, scale: f32) -> Vec3 {
        let by_uv = Vec2::new(texel.y * 2.0 - 1.0, texel.z * 2.0 - 1.0) * scale;
        self.gradient(Vec2::new(by_uv.dot(uv.steps[0]), by_uv.dot(uv.steps[1])))
    }
}

/// Change of a height along the edges of a footprint, from differences over `steps` times these. `height` is asked at points
/// moved by so many edges.
pub fn height_change(difference: Difference, steps: [f32; 2], height: impl Fn(Vec2) -> f32) -> Vec2 {
    let here = match difference {
        Difference::Central => 0.0,
        Difference::Forward | Difference::Backward => height(Vec2::ZERO),
    };
    let along = |axis: Vec2, step: f32| match difference {
        Difference::Forward => (height(axis * step) - here) / step,
        Difference::Backward => (here - height(-axis * step)) / step,
        Difference::Central => (height(axis * step) - height(-axis * step)) / (2.0 * step),
    };
    Vec2::new(along(Vec2::X, steps[0]), along(Vec2::Y, steps[1]))
}

/// A height and its derivatives in one image.
#[derive(Clone, Debug)]
pub struct DerivativeTexture {
    /// Red is the height; green and blue are `0.5 + 0.5 d / range` of its derivatives by `u` (to the right, 1 over the image) and `v`
    /// (downwards). Linear, floating-point.
    pub image: Image,
    /// The largest derivative that green and blue hold.
    pub range: f32,
}

impl DerivativeTexture {
    /// Of the red of an image, from differences over one texel (central ones: over two). Without a `range`, that of the largest
    /// derivative is taken, so that nothing is cut off.
    ///
    /// # Errors
    /// The range is not a positive number.
    pub fn new(heights: &Image, difference: Difference, wrap: [Wrap; 2], range: Option<f32>) -> Result<Self> {
        if let Some(range) = range.filter(|range| !(range.is_finite() && *range > 0.0)) {
            return Err(Error::invalid(format!(
                "the range of derivatives is {range}, but must be a positive number"
            )));
        }
        let size = [heights.width, heights.height];
        let height = |x: i32, y: i32| {
            let [x, y] = [(x, 0), (y, 1)].map(|(at, axis)| wrap_index(at, size[axis], wrap[axis]));
            x.zip(y).map_or(0.0, |(x, y)| heights.linear_texel(x as u32, y as u32)[0])
        };
        let texels = size.map(|n| n as f32);
        let derivatives: Vec<[f32; 3]> = (0..size[1] as i32)
            .flat_map(|y| (0..size[0] as i32).map(move |x| (x, y)))
            .map(|(x, y)| {
                let at = |offset: Vec2| height(x + offset.x as i32, y + offset.y as i32);
                let change = height_change(difference, [1.0; 2], at);
                [height(x, y), change.x * texels[0], change.y * texels[1]]
            })
            .collect();
        let steepest = derivatives.iter().fold(0.0_f32, |most, [_, u, v]| most.max(u.abs()).max(v.abs()));
        let range = range.unwrap_or(if steepest > 0.0 { steepest } else { 1.0 });
        let code = |d: f32| 0.5 + 0.5 * d / range;
        let samples = derivatives.into_iter().flat_map(|[h, u, v]| [h, code(u), code(v)]).collect();
        Ok(Self { image: Image::from_linear(size[0], size[1], 3, samples), range })
    }
}

/// The unit normal that a decoded texel of a normal map bends `normal` to, in tangent space or (without a frame) in the model's
/// axes. An earlier relief's effect stays: the map's normal is turned as the vertex normal was. `None` where it is no direction.
pub fn normal_by_map(
    normal: Vec3,
    vertex_normal: Vec3,
    texel: Vec3,
    scale: f32,
    frame: Option<&TangentFrame>,
) -> Option<Vec3> {
    let bent = match frame {
        Some(frame) => frame.mesh_vector(texel * Vec3::new(scale, scale, 1.0)),
        None => {
            let upright = vertex_normal * vertex_normal.dot(texel);
            upright + (texel - upright) * scale
        }
    };
    let bent = bent.try_normalize()?;
    Some(if normal == vertex_normal { bent } else { Quat::from_rotation_arc(vertex_normal, normal) * bent })
}

/// The tangents that materials ask for: per set of texture coordinates one per corner, none for sets that nothing refers to or the
/// mesh lacks. `normals` has a unit normal per corner.
pub fn look_tangents<'m>(
    mesh: &Mesh,
    normals: &[Vec3],
    materials: impl Iterator<Item = &'m LookMaterial> + Clone,
) -> Vec<Vec<Vec4>> {
    let corners = 3 * mesh.triangles.len();
    let of_set = |(set, uv): (usize, &Vec<Vec2>)| {
        if uv.len() != corners || !materials.clone().any(|material| refers_to(material, set)) {
            return Vec::new();
        }
        // The mesh's own tangents belong to its first set.
        if set == 0 && mesh.corners.tangents.len() == corners {
            return mesh.corners.tangents.clone();
        }
        corner_tangents(mesh, normals, |t| Some([uv[3 * t], uv[3 * t + 1], uv[3 * t + 2]]))
    };
    mesh.corners.uv_sets.iter().enumerate().map(of_set).collect()
}

fn refers_to(material: &LookMaterial, set: usize) -> bool {
    let by_relief = material.relief.iter().any(|relief| {
        matches!(relief, Relief::Normal { space: NormalSpace::Tangent { uv_set }, .. } if *uv_set == set)
    });
    by_relief || material.anisotropy.as_ref().is_some_and(|anisotropy| anisotropy.uv_set == set)
}
