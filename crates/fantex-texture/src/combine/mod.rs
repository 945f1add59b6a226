//! Textures made of textures: environment modes, layers, arithmetic, colour scales and contour lines.
//!
//! Every node is plain data with [`Slot`]s as inputs. Colours are linear with straight alpha; where two are
//! mixed, each counts by its alpha.

/// A node depends on the eye and on the time if one of these inputs does.
macro_rules! depends_on {
    ($($input:ident),+) => {
        fn is_view_dependent(&self) -> bool {
            $(self.$input.is_view_dependent())||+
        }

        fn is_animated(&self) -> bool {
            $(self.$input.is_animated())||+
        }
    };
}

mod contours;
mod field;
mod layers;
mod math;
mod mode;
mod ramp;

use glam::Vec4;

pub use contours::{Contours, LineWidth};
pub use field::Field;
pub use layers::{Layer, LayerMode, Layers};
pub use math::{Binary, Channel, Clamp, Mix, Operation, Remap, ScaleOffset, Swizzle};
pub use mode::{Combine, CombineMode};
pub use ramp::RampTexture;

use crate::ShadingPoint;
use crate::look::Slot;

/// From `a` to `b` by `share` (0..1); colours count by their alpha.
pub(crate) fn mix(a: Vec4, b: Vec4, share: f32) -> Vec4 {
    let alpha = a.w + (b.w - a.w) * share;
    if alpha <= 0.0 {
        return a.lerp(b, share);
    }
    let color = (a * (a.w * (1.0 - share)) + b * (b.w * share)) / alpha;
    color.truncate().extend(alpha)
}

/// The number of an input at a point, and the width of the interval over which it varies within the footprint: that of the
/// box with the same variance as the parallelogram. Exact where the input varies along one edge only.
fn interval(input: &Slot, channel: Channel, at: &ShadingPoint<'_>) -> (f32, f32) {
    let number = |at: &ShadingPoint<'_>| channel.of(input.evaluate(at));
    let center = number(at);
    if matches!(input, Slot::Constant(_)) {
        return (center, 0.0);
    }
    let beside = |a: f32, b: f32| at.shifted(a, b, number);
    let dx = beside(0.5, 0.0) - beside(-0.5, 0.0);
    let dy = beside(0.0, 0.5) - beside(0.0, -0.5);
    (center, dx.hypot(dy))
}
