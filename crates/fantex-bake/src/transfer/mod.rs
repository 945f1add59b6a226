//! From one mesh to another: what a detailed mesh looks like, baked onto a coarse one.
//!
//! Every point of the coarse mesh looks along its smooth normal, outwards and inwards, for the detailed surface (P. Cignoni,
//! C. Montani, C. Rocchini, R. Scopigno and M. Tarini, "Preserving attribute values on simplified meshes by resampling detail
//! textures", 1999). How far it looks is the *cage*; where nothing is found, the nearest point stands in, and is counted.
//! The meshes are brought together by their places in the world.
//!
//! - [`TransferSource`] bakes normals and any [`Source`] of the detailed mesh into fan tiles;
//! - [`bake_normal_map`] makes an ordinary image of normals for a coarse mesh with texture coordinates.

mod normal_map;
mod projector;
mod source;

pub use self::normal_map::{NormalMapError, NormalMapOptions, NormalSpace, bake_normal_map};
pub use self::source::{TransferOptions, TransferSource};

/// How well two meshes fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TransferReport {
    /// How far points looked for the detailed surface, world units.
    pub cage: f64,
    /// Points of the coarse mesh that were looked up.
    pub points: u64,
    /// Those whose rays found nothing, so that the nearest point stood in.
    pub missed: u64,
}

/// Why nothing can be transferred.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// The cage is no length.
    #[error(
        "the cage is {cage} world units, but must be a positive number; leave it out to have it measured"
    )]
    Cage {
        /// What was asked for.
        cage: f64,
    },
    /// A mesh without triangles.
    #[error("the {which} mesh has no triangles")]
    Empty {
        /// `coarse` or `detailed`.
        which: &'static str,
    },
    /// Too few or too many rays.
    #[error("samples is {samples}, but a texel takes 1 to {most} rays along each side")]
    Samples {
        /// What was asked for.
        samples: u32,
        /// The most.
        most: u32,
    },
}

/// Rays along a texel's side at most.
const MOST_SAMPLES: u32 = 64;

/// Checks the number of rays along a texel's side.
fn check_samples(samples: u32) -> Result<(), TransferError> {
    if (1..=MOST_SAMPLES).contains(&samples) {
        Ok(())
    } else {
        Err(TransferError::Samples { samples, most: MOST_SAMPLES })
    }
}

/// Centres of `n * n` cells of a texel, from -0.5 to 0.5 along its sides.
fn cells(n: u32) -> impl Iterator<Item = [f32; 2]> {
    let at = move |i: u32| (i as f32 + 0.5) / n as f32 - 0.5;
    (0..n * n).map(move |i| [at(i % n), at(i / n)])
}

/// Barycentric coordinates beside a triangle, moved onto it.
fn on_triangle(lambda: glam::Vec3) -> glam::Vec3 {
    let inside = lambda.max(glam::Vec3::ZERO);
    inside / inside.element_sum()
}
