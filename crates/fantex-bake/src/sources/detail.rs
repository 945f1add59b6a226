//! Surface-detail polygons over another source.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use fantex_texture::{DetailPlane, SurfaceDetail};
use glam::{Vec2, Vec4};

use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// Where the polygons lie.
#[derive(Clone, Debug, PartialEq)]
pub enum DetailPlacement {
    /// In the plane of a face, mesh space.
    Face {
        /// The plane.
        plane: DetailPlane,
        /// The triangles of the face, in any order.
        triangles: Vec<u32>,
    },
    /// In the plane of a set of texture coordinates.
    UvSet(usize),
}

/// Why details cannot be placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DetailSourceError {
    /// The mesh lacks the set of texture coordinates.
    #[error(
        "the mesh has {available} sets of texture coordinates, but details are placed in set {uv_set} (from 0)"
    )]
    NoUvSet {
        /// What was asked for.
        uv_set: usize,
        /// How many there are.
        available: usize,
    },
    /// The source below has no base colour.
    #[error("the source below the details gives no base colour")]
    NoBaseColor,
    /// A material without a colour.
    #[error("detail polygons use material {material}, but there are only {colors} colours")]
    NoColor {
        /// The material.
        material: u32,
        /// How many colours there are.
        colors: usize,
    },
}

/// A source whose base colour is covered by polygons, each in the colour of its material, with exact shares per texel.
pub struct DetailSource<'a> {
    below: &'a dyn Source,
    detail: &'a SurfaceDetail,
    placement: DetailPlacement,
    /// Corner coordinates, where details lie in texture space.
    uv: &'a [Vec2],
    colors: Vec<Vec4>,
    base_color: usize,
}

impl<'a> DetailSource<'a> {
    /// `colors` are linear RGBA with straight alpha, by the polygons' material.
    ///
    /// # Errors
    ///
    /// No such texture coordinates, no base colour below, or a material without a colour.
    pub fn new(
        mesh: &'a Mesh,
        below: &'a dyn Source,
        detail: &'a SurfaceDetail,
        mut placement: DetailPlacement,
        colors: Vec<Vec4>,
    ) -> Result<Self, DetailSourceError> {
        let sets = &mesh.corners.uv_sets;
        let uv = match &mut placement {
            DetailPlacement::Face { triangles, .. } => {
                triangles.sort_unstable();
                &[]
            }
            DetailPlacement::UvSet(uv_set) => {
                let set = sets.get(*uv_set).filter(|set| set.len() == 3 * mesh.triangles.len());
                let missing = DetailSourceError::NoUvSet { uv_set: *uv_set, available: sets.len() };
                set.map(Vec::as_slice).ok_or(missing)?
            }
        };
        let base_color = below.channels().iter().position(|c| c.kind == ChannelKind::BaseColor);
        let base_color = base_color.ok_or(DetailSourceError::NoBaseColor)?;
        if let Some(material) = detail.materials().find(|&m| m as usize >= colors.len()) {
            return Err(DetailSourceError::NoColor { material, colors: colors.len() });
        }
        Ok(Self { below, detail, placement, uv, colors, base_color })
    }

    /// Coordinates and footprint in the details' plane; `None` off the face.
    fn place(&self, point: &SurfacePoint) -> Option<(Vec2, [Vec2; 2])> {
        match &self.placement {
            DetailPlacement::Face { plane, triangles } => {
                triangles.binary_search(&(point.triangle as u32)).ok()?;
                Some((plane.uv(point.position), plane.footprint(point.position_steps)))
            }
            DetailPlacement::UvSet(_) => {
                let [a, b, c] = [0, 1, 2].map(|k| self.uv[3 * point.triangle + k]);
                let blend = |l: glam::Vec3| a * l.x + b * l.y + c * l.z;
                Some((blend(point.lambda), point.lambda_steps.map(blend)))
            }
        }
    }
}

impl Source for DetailSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let mut channels = self.below.channels();
        channels[self.base_color].has_alpha |= self.colors.iter().any(|c| c.w < 1.0);
        channels
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        self.below.evaluate(point, values);
        let Some((uv, footprint)) = self.place(point) else { return };
        let below = values[self.base_color];
        // Colours count in proportion to their coverage.
        let weighted = |c: Vec4| (c.truncate() * c.w).extend(c.w);
        let color = |material: Option<u32>| material.map_or(below, |m| self.colors[m as usize]);
        let mean = self.detail.coverage(uv, footprint).mean(|material| weighted(color(material)));
        if mean.w > 0.0 {
            values[self.base_color] = (mean.truncate() / mean.w).extend(mean.w);
        }
    }
}
