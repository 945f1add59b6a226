//! Opacity of a look material.

use fantex_texture::ShadingPoint;
use fantex_texture::look::{LookMaterial, Opacity, Slot};
use glam::Vec2;

use super::point::{evaluate_beside, spread};

/// Points of the footprint at which a cut-out's alpha is compared with its threshold.
const POINTS: usize = 16;

/// Width of the points' own footprints, as a share of the pixel's.
const POINT_SHARE: f32 = 1.0 / 16.0;

/// The opacity at a point. `base_alpha` is the base colour's alpha there.
///
/// A cut-out is as opaque as the share of the footprint whose alpha reaches the threshold. Comparing the filtered alpha would
/// be all or nothing; a fence would vanish, or become a wall, as soon as its bars are narrower than pixels.
pub(super) fn alpha(material: &LookMaterial, at: &ShadingPoint, base_alpha: f32) -> f32 {
    match material.opacity {
        Opacity::Opaque => 1.0,
        Opacity::Blend => (base_alpha * material.alpha.evaluate_number(at)).clamp(0.0, 1.0),
        Opacity::Mask { threshold } => {
            let is_constant = [&material.base_color, &material.alpha]
                .iter()
                .all(|slot| matches!(slot, Slot::Constant(_)));
            if is_constant {
                let alpha = base_alpha * material.alpha.evaluate_number(at);
                return f32::from(u8::from(alpha >= threshold));
            }
            let is_there = |&i: &usize| alpha_beside(material, at, spread(i)) >= threshold;
            (0..POINTS).filter(is_there).count() as f32 / POINTS as f32
        }
    }
}

fn alpha_beside(material: &LookMaterial, at: &ShadingPoint, offset: Vec2) -> f32 {
    let value = |slot: &Slot| match slot {
        Slot::Constant(value) => *value,
        Slot::Texture(texture) => evaluate_beside(&**texture, at, offset, POINT_SHARE),
    };
    value(&material.base_color).w * value(&material.alpha).x
}
