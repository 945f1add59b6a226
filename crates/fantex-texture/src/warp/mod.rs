//! Closed-form maps between texture and image space, and the two ways to texture an image by them.
//!
//! Texture coordinates are `[0,1]` over the texture; image coordinates are pixels, `x` to the right and `y` downwards, pixel
//! centres at half integers.
//!
//! ```text
//!                  map                         warp_forward: scan the texture, spread each texel's colour
//!  texture (u,v) -------> image (x,y)
//!                <-------                      warp_inverse: scan the image, look each pixel's colour up
//!                 inverse
//! ```
//!
//! Paul Heckbert, "Fundamentals of texture mapping and image warping", 1989, has the maps and their inverses.

mod affine;
mod bilinear;
mod forward;
mod inverse;
mod projective;

use glam::{DMat2, DVec2};

pub use affine::AffineMap;
pub use bilinear::BilinearMap;
pub use forward::{Spread, warp_forward};
pub use inverse::warp_inverse;
pub use projective::ProjectiveMap;

/// A map from texture coordinates to a position in an image.
pub trait PlaneMap: Send + Sync {
    /// The position of the texture coordinates `uv`.
    fn map(&self, uv: DVec2) -> DVec2;

    /// The texture coordinates that are seen at a position, or `None` where the texture is not seen.
    fn inverse(&self, position: DVec2) -> Option<DVec2>;

    /// The derivatives of the position by `u` (first column) and `v`.
    fn jacobian(&self, uv: DVec2) -> DMat2;
}

/// Why corners or a matrix make no map.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlaneMapError {
    /// A number is infinite or NaN.
    #[error("a map between texture and image needs finite numbers")]
    NotFinite,
    /// The texture or the image is squeezed into a line or a point: no inverse exists.
    #[error(
        "the corners of a map between texture and image must span an area: three of them lie on one line"
    )]
    Singular,
}

/// Why an image cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WarpError {
    /// A side of the image is 0 or too long.
    #[error("cannot warp into {width} x {height} pixels; both sides must be between 1 and {MAX_SIDE}")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// The longest side of a warped image, in pixels (16 bytes each).
pub const MAX_SIDE: u32 = 16_384;

fn check_size([width, height]: [u32; 2]) -> Result<(), WarpError> {
    let is_side = |n: u32| (1..=MAX_SIDE).contains(&n);
    if is_side(width) && is_side(height) { Ok(()) } else { Err(WarpError::Size { width, height }) }
}
