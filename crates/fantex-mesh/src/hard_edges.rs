//! Edges at which a surface bends so far that it counts as two.

use std::f64::consts::PI;

use fantex_base::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;

use crate::Mesh;

/// Normals of triangles are known so well, as a cosine: what is built at 90 degrees counts as bent by 90.
const SLACK: f64 = 1e-6;

/// Angles that edges may be told by, degrees.
const ANGLES: std::ops::RangeInclusive<f32> = 0.0..=180.0;

/// Refuses what is no angle between two normals, in degrees.
///
/// # Errors
/// It is none: below 0, above 180, no number.
pub fn check_hard_edges(degrees: f32) -> Result<()> {
    match ANGLES.contains(&degrees) {
        true => Ok(()),
        false => Err(Error::invalid(format!(
            "hard edges are told by an angle of 0 to 180 degrees between the normals of two triangles, got {degrees}"
        ))),
    }
}

/// The hard edges of a mesh: where two triangles continue each other whose normals differ by at least an angle. (60 degrees finds those
/// of a box, 0 all edges.)
#[derive(Clone, Debug)]
pub struct HardEdges<'m> {
    mesh: &'m Mesh,
    normals: Vec<DVec3>,
    angle: HardAngle,
}

impl<'m> HardEdges<'m> {
    /// Of a mesh, from so many degrees on.
    pub fn of(mesh: &'m Mesh, degrees: f32) -> Self {
        let triangles = (0..mesh.triangles.len()).into_par_iter().with_min_len(1 << 12);
        let normals = triangles.map(|t| mesh.facet_normal(t)).collect();
        Self { mesh, normals, angle: HardAngle::new(degrees) }
    }

    /// Whether the edge with these ends, at which two triangles continue each other, is hard.
    #[inline]
    pub fn is_hard(&self, triangles: [u32; 2], [from, to]: [u32; 2]) -> bool {
        let is_forward = |t: u32| {
            let triangle = self.mesh.triangles[t as usize];
            (0..3).any(|k| triangle[k] == from && triangle[(k + 1) % 3] == to)
        };
        self.angle.is_reached(triangles.map(|t| (self.normals[t as usize], is_forward(t))))
    }
}

/// How far triangles bend at a hard edge, at least.
#[derive(Clone, Copy, Debug)]
pub struct HardAngle {
    /// The largest cosine between the normals.
    cosine: f64,
}

impl HardAngle {
    /// So many degrees.
    pub fn new(degrees: f32) -> Self {
        Self { cosine: libm::cos(f64::from(degrees).to_radians().clamp(0.0, PI)) + SLACK }
    }

    /// Whether two triangles bend so far: their normals, and whether they run along the edge in the one direction or in the other. Where both
    /// run in the same, one is seen from its back.
    #[inline]
    pub fn is_reached(self, [(a, is_forward), (b, other_is)]: [(DVec3, bool); 2]) -> bool {
        let cosine = a.dot(b);
        (if is_forward == other_is { -cosine } else { cosine }) <= self.cosine
    }
}
