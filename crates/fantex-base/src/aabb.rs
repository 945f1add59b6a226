//! Axis-aligned boxes.

use std::ops::{Add, Mul, Sub};

use glam::{DVec2, DVec3, Vec2, Vec3};

/// A vector whose components can be compared one by one.
pub trait Corner:
    Copy + PartialEq + Add<Output = Self> + Sub<Output = Self> + Mul<Self::Scalar, Output = Self>
{
    /// Type of a component.
    type Scalar;
    /// All components plus infinity.
    const INFINITY: Self;
    /// All components minus infinity.
    const NEG_INFINITY: Self;
    /// One half.
    const HALF: Self::Scalar;

    /// The smaller component, one by one.
    fn low(self, other: Self) -> Self;
    /// The larger component, one by one.
    fn high(self, other: Self) -> Self;
    /// Whether every component is at most the other's.
    fn is_below(self, other: Self) -> bool;
}

macro_rules! corner {
    ($($vector:ty: $scalar:ty),*) => {
        $(impl Corner for $vector {
            type Scalar = $scalar;
            const INFINITY: Self = Self::INFINITY;
            const NEG_INFINITY: Self = Self::NEG_INFINITY;
            const HALF: $scalar = 0.5;

            #[inline]
            fn low(self, other: Self) -> Self {
                self.min(other)
            }

            #[inline]
            fn high(self, other: Self) -> Self {
                self.max(other)
            }

            #[inline]
            fn is_below(self, other: Self) -> bool {
                self.cmple(other).all()
            }
        })*
    };
}

corner!(Vec2: f32, Vec3: f32, DVec2: f64, DVec3: f64);

/// An axis-aligned box, or rectangle, by its corners. Boxes include their borders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb<V = Vec3> {
    /// Smallest coordinates.
    pub min: V,
    /// Largest coordinates.
    pub max: V,
}

impl<V: Corner> Aabb<V> {
    /// Holds nothing; the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: V::INFINITY, max: V::NEG_INFINITY };

    /// The smallest box around points; [`Aabb::EMPTY`] without any.
    pub fn of_points(points: impl IntoIterator<Item = V>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::with)
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        !self.min.is_below(self.max)
    }

    /// The smallest box around it and a point.
    #[inline]
    pub fn with(self, point: V) -> Self {
        Self { min: self.min.low(point), max: self.max.high(point) }
    }

    /// The smallest box around both.
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.low(other.min), max: self.max.high(other.max) }
    }

    /// Whether a point lies inside or on the border.
    #[inline]
    pub fn contains(&self, point: V) -> bool {
        self.min.is_below(point) && point.is_below(self.max)
    }

    /// Whether they share a point.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.is_below(other.max) && other.min.is_below(self.max)
    }

    /// The middle.
    #[inline]
    pub fn center(&self) -> V {
        (self.min + self.max) * V::HALF
    }

    /// The lengths of its sides.
    #[inline]
    pub fn size(&self) -> V {
        self.max - self.min
    }
}

impl Aabb<Vec3> {
    /// The lengths of its sides; a side without length counts as 1, so that what divides by it stays finite.
    pub fn extent(&self) -> Vec3 {
        let size = self.size();
        Vec3::select(size.cmpgt(Vec3::ZERO), size, Vec3::ONE)
    }
}

impl Aabb<DVec3> {
    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let is_high = glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0);
            DVec3::select(is_high, self.max, self.min)
        })
    }
}
