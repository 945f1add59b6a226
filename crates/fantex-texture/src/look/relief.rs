//! Normals bent by relief, over a footprint: what pictures and bakes share.
//!
//! Bump mapping in the form that needs no parametrisation (M. Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU",
//! 2010): Blinn's `N' = N + (F_u (N x P_v) - F_v (N x P_u)) / |N|` holds for any two directions in the surface, and the edges
//! of the footprint are two whose changes of position and height are at hand.

use std::borrow::Cow;
use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_mesh::{Mesh, corner_tangents};
use glam::{Quat, Vec2, Vec3, Vec4};

use super::{Difference, LookMaterial, NormalSpace, Relief, TangentSpace};
use crate::filter::wrap_index;
use crate::material::{TangentFrame, own_tangents};
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

/// The red of an image by column and row, also beyond its edges: 0 where it does not go on.
pub(crate) fn height_map(heights: &Image, wrap: [Wrap; 2]) -> impl Fn(i32, i32) -> f32 + Sync {
    let size = [heights.width, heights.height];
    move |x, y| {
        let [x, y] = [(x, 0), (y, 1)].map(|(at, axis)| wrap_index(at, size[axis], wrap[axis]));
        x.zip(y).map_or(0.0, |(x, y)| heights.linear_texel(x as u32, y as u32)[0])
    }
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
        let height = height_map(heights, wrap);
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

/// The tangents that materials ask for.
#[derive(Clone, Debug, Default)]
pub struct LookTangents<'a> {
    /// One per corner. Triangles whose material does not ask for a space have arbitrary ones.
    spaces: Vec<(TangentSpace, Cow<'a, [Vec4]>)>,
}

impl<'a> LookTangents<'a> {
    /// Those of a mesh whose materials, an entry each, are `materials`; the last one stands for any after it. `normals` has a unit
    /// normal per corner.
    pub fn new(mesh: &'a Mesh, normals: &[Vec3], materials: &[Arc<LookMaterial>]) -> Self {
        let mut spaces: Vec<(TangentSpace, Cow<'_, [Vec4]>)> = Vec::new();
        for space in materials.iter().flat_map(|material| tangent_spaces(material)) {
            if spaces.iter().all(|(known, _)| *known != space) {
                spaces
                    .extend(tangents_of(mesh, normals, materials, &space).map(|tangents| (space, tangents)));
            }
        }
        Self { spaces }
    }

    /// The frame at the point `lambda`, which lies inside `triangle`; `None` where the mesh lacks the texture coordinates.
    pub fn frame(
        &self,
        space: &TangentSpace,
        normals: &[Vec3],
        triangle: usize,
        lambda: Vec3,
    ) -> Option<TangentFrame> {
        let (_, tangents) = self.spaces.iter().find(|(known, _)| known == space)?;
        Some(TangentFrame::at(normals, tangents, triangle, lambda))
    }
}

/// The spaces that a material refers to.
fn tangent_spaces(material: &LookMaterial) -> impl Iterator<Item = TangentSpace> {
    let of_reliefs = material.relief.iter().filter_map(|relief| match relief {
        Relief::Normal { space: NormalSpace::Tangent(space), .. } => Some(*space),
        _ => None,
    });
    let of_highlight = material.anisotropy.as_ref().map(|anisotropy| TangentSpace::of_set(anisotropy.uv_set));
    of_reliefs.chain(of_highlight)
}

fn tangents_of<'a>(
    mesh: &'a Mesh,
    normals: &[Vec3],
    materials: &[Arc<LookMaterial>],
    space: &TangentSpace,
) -> Option<Cow<'a, [Vec4]>> {
    let uv = mesh.corners.uv_sets.get(space.uv_set).filter(|uv| uv.len() == 3 * mesh.triangles.len())?;
    // To maps of others, the mesh's own tangents belong to its first set.
    if let Some(own) = own_tangents(mesh).filter(|_| space.of_model || space.uv_set == 0) {
        return Some(Cow::Borrowed(own));
    }
    let last = materials.len().saturating_sub(1);
    let uses: Vec<bool> =
        materials.iter().map(|material| tangent_spaces(material).any(|s| s == *space)).collect();
    let tangents = corner_tangents(mesh, normals, |t| {
        let corner = |k: usize| space.uv_transform.transform_point2(uv[3 * t + k]);
        uses[mesh.material_of(t).min(last)].then(|| [0, 1, 2].map(corner))
    });
    Some(Cow::Owned(tangents))
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate, shading_normals};
    use glam::Mat3;

    use super::*;
    use crate::ImageTexture;
    use crate::material::{ImageSlots, MaterialTextures, TextureLayer, normal_map_tangents};

    /// Normal maps of models bend alike in looks and in the models' own materials.
    #[test]
    fn tangents_of_models_are_those_of_their_normal_maps() {
        let mut mesh = clean(generate::cube(2), &CleanOptions::default()).unwrap().0;
        let corners = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]);
        let first: Vec<Vec2> = corners.map(|p| Vec2::new(p.x + 0.3 * p.z, p.y - 0.2 * p.z)).collect();
        let second = first.iter().map(|uv| Vec2::new(uv.y, 2.0 * uv.x)).collect();
        mesh.corners.uv_sets = vec![first, second];
        let normals = shading_normals(&mesh);
        let texture = Arc::new(ImageTexture::new(Arc::new(Image::from_linear(1, 1, 3, vec![0.5; 3]))));
        let uv_transform = Mat3::from_angle(1.0) * Mat3::from_scale(Vec2::new(2.0, -1.0));
        for (uv_set, own) in [(0, false), (1, false), (0, true), (1, true)] {
            mesh.corners.tangents = if own { vec![Vec4::Z; 3 * mesh.triangles.len()] } else { Vec::new() };
            let layer = TextureLayer {
                uv_set,
                uv_transform,
                wrap: [Wrap::Repeat; 2],
                nearest: false,
                texture: Arc::clone(&texture),
            };
            let textures: MaterialTextures = ImageSlots { normal: Some(layer), ..ImageSlots::default() };
            let space = TangentSpace { uv_set, uv_transform, of_model: true };
            let relief = Relief::Normal {
                texture: Arc::new(Vec4::ONE),
                scale: 1.0,
                space: NormalSpace::Tangent(space),
            };
            let material = Arc::new(LookMaterial { relief: vec![relief], ..LookMaterial::default() });
            let tangents = LookTangents::new(&mesh, &normals, &[material]);
            let [(_, found)] = &tangents.spaces[..] else { panic!("one space: {tangents:?}") };
            assert_eq!(**found, normal_map_tangents(&mesh, &normals, &[textures])[..], "{uv_set} {own}");
        }
    }
}
