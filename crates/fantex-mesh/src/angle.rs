//! Angles with the same bits on every machine.
//!
//! The mathematical library of a system may choose among implementations by the processor that it runs on (glibc takes one
//! with fused multiplications where there are any), and they differ in the last bit. A last bit decides which of two equal
//! groupings a cover takes, and seeds the noise of light that is traced at a place of the surface: meshes, covers and all
//! that grows from them would depend on the machine. So their angles come from the crate `libm`, one source for all.

use glam::{DVec3, Vec2};

/// The unit vector that an angle in radians turns the x axis to.
#[inline]
pub fn unit_vector(angle: f32) -> Vec2 {
    Vec2::new(libm::cosf(angle), libm::sinf(angle))
}

/// The angle between two vectors of any length but zero, radians.
#[inline]
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    let cosine = a.dot(b) / (a.length_squared() * b.length_squared()).sqrt();
    libm::acos(cosine.clamp(-1.0, 1.0))
}
