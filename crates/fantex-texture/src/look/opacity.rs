//! The opacity of a material.

use glam::Vec2;

use super::{LookMaterial, Opacity, Slot};
use crate::ShadingPoint;

/// Points along each axis of the footprint at which a cut-out's alpha is compared with its threshold.
const POINTS: u32 = 4;

/// Width of the points' own footprints, as a share of the pixel's: small, for what they average is lost to the comparison.
const POINT_SHARE: f32 = 1.0 / 64.0;

/// Means of alpha below and above which it is zero or one on the whole footprint.
const NOWHERE: f32 = 1e-3;
const EVERYWHERE: f32 = 1.0 - 1e-3;

impl LookMaterial {
    /// The opacity at a point, 0..1; `base_alpha` is the base colour's alpha there.
    ///
    /// A cut-out is as opaque as the share of the footprint whose alpha reaches the threshold. Comparing the filtered alpha would
    /// be all or nothing; a fence would vanish, or become a wall, as soon as its bars are narrower than pixels.
    pub fn opacity_at(&self, at: &ShadingPoint<'_>, base_alpha: f32) -> f32 {
        match self.opacity {
            Opacity::Opaque => 1.0,
            Opacity::Blend => (base_alpha * self.alpha.evaluate_number(at)).clamp(0.0, 1.0),
            Opacity::Mask { threshold } => {
                let mean = base_alpha * self.alpha.evaluate_number(at);
                let slots = [&self.base_color, &self.alpha];
                let is_constant = slots.iter().all(|slot| matches!(slot, Slot::Constant(_)));
                if is_constant || mean <= NOWHERE || mean >= EVERYWHERE {
                    return f32::from(u8::from(mean >= threshold));
                }
                let mut random = Random::of_point(at);
                let is_there = |i: &u32| {
                    let offset = random.cell(i % POINTS, i / POINTS) - 0.5;
                    at.part(offset, POINT_SHARE, |there| self.alpha_at(there)) >= threshold
                };
                (0..POINTS * POINTS).filter(is_there).count() as f32 / (POINTS * POINTS) as f32
            }
        }
    }

    fn alpha_at(&self, at: &ShadingPoint<'_>) -> f32 {
        self.base_color.evaluate(at).w * self.alpha.evaluate_number(at)
    }
}

/// Random points that are the same wherever and whenever a point of the surface is asked. Regular ones would beat with the
/// regular patterns that cut-outs often have.
struct Random(u32);

impl Random {
    fn of_point(at: &ShadingPoint) -> Self {
        Self(at.position.to_array().iter().fold(0x9E37_79B9, |hash, x| mixed(hash ^ x.to_bits())))
    }

    /// A point of a cell of the square that is divided into [`POINTS`] times as many.
    fn cell(&mut self, x: u32, y: u32) -> Vec2 {
        self.0 = mixed(self.0.wrapping_add(0x9E37_79B9));
        let [low, high] = [self.0 & 0xFFFF, self.0 >> 16].map(|bits| bits as f32 / 65536.0);
        Vec2::new(x as f32 + low, y as f32 + high) / POINTS as f32
    }
}

/// The finaliser of MurmurHash3 (A. Appleby, 2011).
fn mixed(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x85EB_CA6B);
    x = (x ^ x >> 13).wrapping_mul(0xC2B2_AE35);
    x ^ x >> 16
}
