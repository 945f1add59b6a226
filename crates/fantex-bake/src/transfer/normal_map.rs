//! An ordinary normal map: an image over the coarse mesh's texture coordinates.

use fantex_mesh::{Mesh, corner_tangents, shading_normals};
use fantex_texture::Image;
use fantex_texture::material::TangentFrame;
use glam::{DVec2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::projector::Projector;
use super::{TransferError, TransferReport, cells, check_samples, on_triangle};

/// The axes that a normal map's colours are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalSpace {
    /// Tangent, bitangent (to the top of the image) and shading normal of the coarse mesh, as glTF has them.
    #[default]
    Tangent,
    /// The axes of the model.
    Object,
}

/// How to bake a normal map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMapOptions {
    /// Columns and rows, 1 to 8192 each.
    pub size: [u32; 2],
    /// The set of texture coordinates.
    pub uv_set: usize,
    /// What colours are relative to.
    pub space: NormalSpace,
    /// Texels by which the edges of charts are continued, so that filters do not read what lies beside; at most 256.
    pub padding: u32,
    /// Rays along each side of a texel, 1 to 64.
    pub samples: u32,
    /// As [`TransferOptions::cage`](super::TransferOptions::cage).
    pub cage: Option<f64>,
}

impl Default for NormalMapOptions {
    /// Tangent space, 1024 x 1024, 8 texels of padding, four rays per texel, a measured cage.
    fn default() -> Self {
        Self { size: [1024; 2], uv_set: 0, space: NormalSpace::Tangent, padding: 8, samples: 2, cage: None }
    }
}

const MOST_TEXELS: u32 = 8192;
const MOST_PADDING: u32 = 256;
/// Nobody's texel.
const EMPTY: u32 = u32::MAX;

/// Why there is no normal map.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NormalMapError {
    /// The image would have no or too many texels.
    #[error("the size is {0} x {1} texels, but must be 1 to {MOST_TEXELS} along each side")]
    Size(u32, u32),
    /// Too much padding.
    #[error("the padding is {0} texels, but must be at most {MOST_PADDING}")]
    Padding(u32),
    /// The coarse mesh lacks the set of texture coordinates.
    #[error(
        "the coarse mesh has {available} sets of texture coordinates, but set {uv_set} (from 0) is asked for"
    )]
    NoUvSet {
        /// What was asked for.
        uv_set: usize,
        /// How many there are.
        available: usize,
    },
    /// The meshes cannot be brought together.
    #[error(transparent)]
    Transfer(#[from] TransferError),
}

/// Bakes the shading normals of `detailed` into an image over the texture coordinates of `coarse`: linear RGB floats, with
/// -1..1 as 0..1 (convert to the depth that you store).
///
/// A texel belongs to the first triangle that covers its centre; coordinates outside 0..1 wrap. Tangents are the coarse
/// mesh's own, or those of [`corner_tangents`]. The result does not depend on the number of threads.
///
/// # Errors
///
/// An option out of range, no such texture coordinates, or an empty mesh.
pub fn bake_normal_map(
    coarse: &Mesh,
    detailed: &Mesh,
    options: &NormalMapOptions,
) -> Result<(Image, TransferReport), NormalMapError> {
    let uv = check(coarse, options)?;
    let projector = Projector::new(coarse, detailed, options.cage)?;
    let charts = Charts::new(coarse, uv, options.size);
    let frames = Frames::new(coarse, uv, options.space);
    let [width, height] = options.size;
    let normal_at = |texel: usize| {
        let owner = charts.owners[texel];
        (owner != EMPTY).then(|| {
            let at = |offset: [f32; 2]| charts.lambda(owner as usize, texel, offset);
            let normal = |offset| {
                let lambda = on_triangle(at(offset));
                let found = projector.find(owner as usize, lambda);
                frames.relative(owner as usize, lambda, projector.shading_normal(found))
            };
            let sum: Vec3 = cells(options.samples).map(normal).sum();
            sum.try_normalize().unwrap_or(frames.nothing())
        })
    };
    let mut normals: Vec<Option<Vec3>> =
        (0..charts.owners.len()).into_par_iter().with_min_len(256).map(normal_at).collect();
    for _ in 0..options.padding {
        normals = grown(&normals, width as usize);
    }
    let encoded = |n: Option<Vec3>| (n.unwrap_or(frames.nothing()) * 0.5 + 0.5).to_array();
    let samples = normals.into_iter().flat_map(encoded).collect();
    Ok((Image::from_linear(width, height, 3, samples), projector.report()))
}

/// The texture coordinates, if all is well.
fn check<'a>(coarse: &'a Mesh, options: &NormalMapOptions) -> Result<&'a [Vec2], NormalMapError> {
    let [width, height] = options.size;
    if options.size.iter().any(|n| !(1..=MOST_TEXELS).contains(n)) {
        return Err(NormalMapError::Size(width, height));
    }
    if options.padding > MOST_PADDING {
        return Err(NormalMapError::Padding(options.padding));
    }
    check_samples(options.samples)?;
    let sets = &coarse.corners.uv_sets;
    let set = sets.get(options.uv_set).filter(|set| set.len() == 3 * coarse.triangles.len());
    set.map(Vec::as_slice).ok_or(NormalMapError::NoUvSet { uv_set: options.uv_set, available: sets.len() })
}

/// Which triangle every texel belongs to.
struct Charts<'a> {
    uv: &'a [Vec2],
    size: [u32; 2],
    /// Row by row.
    owners: Vec<u32>,
}

impl<'a> Charts<'a> {
    fn new(mesh: &Mesh, uv: &'a [Vec2], size: [u32; 2]) -> Self {
        let mut owners = vec![EMPTY; size[0] as usize * size[1] as usize];
        for triangle in 0..mesh.triangles.len() {
            let corners = corners_in_texels(uv, size, triangle);
            let (low, high) = corners
                .iter()
                .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), &c| (low.min(c), high.max(c)));
            if !(low.is_finite() && high.is_finite() && low.abs().max(high.abs()).max_element() < 1e9) {
                continue;
            }
            // Texel centres within the box; one that is larger than the image covers everything in its first copy.
            let range = |k: usize| {
                let first = (low[k] - 0.5).ceil() as i64;
                first..=((high[k] - 0.5).floor() as i64).min(first + i64::from(size[k]) - 1)
            };
            for y in range(1) {
                for x in range(0) {
                    let lambda = lambda_at(corners, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                    if lambda.is_some_and(|l| l.min_element() >= 0.0) {
                        let column = x.rem_euclid(size[0].into()) as usize;
                        let row = y.rem_euclid(size[1].into()) as usize;
                        let owner = &mut owners[row * size[0] as usize + column];
                        *owner = (*owner).min(triangle as u32);
                    }
                }
            }
        }
        Self { uv, size, owners }
    }

    /// Barycentric coordinates of a place in a texel (-0.5..0.5) on its owner.
    fn lambda(&self, owner: usize, texel: usize, offset: [f32; 2]) -> Vec3 {
        let width = self.size[0] as usize;
        let corners = corners_in_texels(self.uv, self.size, owner);
        let centre = DVec2::new((texel % width) as f64 + 0.5, (texel / width) as f64 + 0.5);
        // The copy of the image in which the texel lies on the triangle.
        let size = DVec2::new(self.size[0].into(), self.size[1].into());
        let low = corners[0].min(corners[1]).min(corners[2]);
        let copy = ((low - centre) / size).ceil() * size;
        let place = centre + copy + DVec2::new(offset[0].into(), offset[1].into());
        lambda_at(corners, place).map_or(Vec3::splat(1.0 / 3.0), |l| l.as_vec3())
    }
}

fn corners_in_texels(uv: &[Vec2], size: [u32; 2], triangle: usize) -> [DVec2; 3] {
    let size = DVec2::new(size[0].into(), size[1].into());
    [0, 1, 2].map(|k| uv[3 * triangle + k].as_dvec2() * size)
}

/// Barycentric coordinates of a point in the plane; `None` for a triangle without area.
fn lambda_at([a, b, c]: [DVec2; 3], p: DVec2) -> Option<glam::DVec3> {
    let area = (b - a).perp_dot(c - a);
    let lambda =
        glam::DVec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)) / area;
    lambda.is_finite().then_some(lambda)
}

/// The axes at every point of the coarse mesh.
enum Frames {
    Tangent { normals: Vec<Vec3>, tangents: Vec<Vec4> },
    Object,
}

impl Frames {
    fn new(mesh: &Mesh, uv: &[Vec2], space: NormalSpace) -> Self {
        if space == NormalSpace::Object {
            return Self::Object;
        }
        let normals = shading_normals(mesh);
        let tangents = match mesh.corners.tangents.len() == 3 * mesh.triangles.len() {
            true => mesh.corners.tangents.clone(),
            false => corner_tangents(mesh, &normals, |t| Some([0, 1, 2].map(|k| uv[3 * t + k]))),
        };
        Self::Tangent { normals, tangents }
    }

    /// A unit normal relative to the axes, of unit length.
    fn relative(&self, triangle: usize, lambda: Vec3, normal: Vec3) -> Vec3 {
        match self {
            Self::Object => normal,
            Self::Tangent { normals, tangents } => {
                TangentFrame::at(normals, tangents, triangle, lambda).relative(normal).unwrap_or(Vec3::Z)
            }
        }
    }

    /// Where there is no surface.
    fn nothing(&self) -> Vec3 {
        match self {
            Self::Object => Vec3::ZERO,
            Self::Tangent { .. } => Vec3::Z,
        }
    }
}

/// Empty texels beside full ones take the mean of these.
fn grown(normals: &[Option<Vec3>], width: usize) -> Vec<Option<Vec3>> {
    let height = normals.len() / width;
    let grow = |texel: usize| {
        if normals[texel].is_some() {
            return normals[texel];
        }
        let (x, y) = (texel % width, texel / width);
        let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
        let around = rows.flat_map(|row| {
            let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
            columns.filter_map(move |column| normals[row * width + column])
        });
        around.reduce(|a, b| a + b).map(|sum| sum.try_normalize().unwrap_or(sum))
    };
    (0..normals.len()).into_par_iter().with_min_len(1 << 12).map(grow).collect()
}
