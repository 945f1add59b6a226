//! Vectors of numbers in the widest form that the processor has, for what is worked out for many points at once.
//!
//! Every step that is made in vectors is that of a scalar path in the same order, without fused multiplications: so results
//! are equal, and do not depend on the processor. Closures are not compiled for the vectors' instruction set unless they are
//! inlined, which the compiler declines: so each step is a function that must be.

use fearless_simd::{Select, Simd, prelude::*};

/// Three coordinates or colours of many points.
pub(crate) type Vector<F> = [F; 3];

#[inline(always)]
pub(crate) fn dot<S: Simd>(a: Vector<S::f32s>, b: Vector<S::f32s>) -> S::f32s {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn add<S: Simd>(a: Vector<S::f32s>, b: Vector<S::f32s>) -> Vector<S::f32s> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn sub<S: Simd>(a: Vector<S::f32s>, b: Vector<S::f32s>) -> Vector<S::f32s> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn mul<S: Simd>(a: Vector<S::f32s>, b: Vector<S::f32s>) -> Vector<S::f32s> {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

#[inline(always)]
pub(crate) fn scaled<S: Simd>(a: Vector<S::f32s>, factor: S::f32s) -> Vector<S::f32s> {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// As [`glam::Vec3::lerp`].
#[inline(always)]
pub(crate) fn lerp<S: Simd>(
    simd: S,
    from: Vector<S::f32s>,
    to: Vector<S::f32s>,
    share: S::f32s,
) -> Vector<S::f32s> {
    add::<S>(scaled::<S>(from, S::f32s::splat(simd, 1.0) - share), scaled::<S>(to, share))
}

/// As [`glam::Vec3::normalize_or`].
#[inline(always)]
pub(crate) fn normalize_or<S: Simd>(
    simd: S,
    a: Vector<S::f32s>,
    fallback: Vector<S::f32s>,
) -> Vector<S::f32s> {
    let reciprocal = S::f32s::splat(simd, 1.0) / dot::<S>(a, a).sqrt();
    // Comparisons with NaN are false.
    let is_usable = reciprocal.simd_gt(S::f32s::splat(simd, 0.0))
        & reciprocal.simd_lt(S::f32s::splat(simd, f32::INFINITY));
    let unit = scaled::<S>(a, reciprocal);
    [
        is_usable.select(unit[0], fallback[0]),
        is_usable.select(unit[1], fallback[1]),
        is_usable.select(unit[2], fallback[2]),
    ]
}

/// The same three numbers for all points.
#[inline(always)]
pub(crate) fn splat<S: Simd>(simd: S, v: glam::Vec3) -> Vector<S::f32s> {
    [S::f32s::splat(simd, v.x), S::f32s::splat(simd, v.y), S::f32s::splat(simd, v.z)]
}

#[inline(always)]
pub(crate) fn clamped<S: Simd>(simd: S, x: S::f32s, low: f32, high: f32) -> S::f32s {
    x.max(S::f32s::splat(simd, low)).min(S::f32s::splat(simd, high))
}
