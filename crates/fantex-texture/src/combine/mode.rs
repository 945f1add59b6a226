//! The texture environment modes of OpenGL 1.1.

use glam::Vec4;

use crate::look::Slot;
use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

/// What becomes of the fragment's colour `F` under a texel `T`, with a constant colour `C`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum CombineMode {
    /// `T`, alpha too.
    Replace,
    /// `T F`, alpha too.
    #[default]
    Modulate,
    /// `a_T T + (1 - a_T) F`; alpha stays the fragment's.
    Decal,
    /// `F (1 - T) + C T`; alphas are multiplied.
    Blend,
}

impl CombineMode {
    /// The combined linear RGBA.
    pub fn apply(self, texel: Vec4, fragment: Vec4, constant: Vec4) -> Vec4 {
        let (t, f, c) = (texel.truncate(), fragment.truncate(), constant.truncate());
        match self {
            Self::Replace => texel,
            Self::Modulate => texel * fragment,
            Self::Decal => (t * texel.w + f * (1.0 - texel.w)).extend(fragment.w),
            Self::Blend => (f * (1.0 - t) + c * t).extend(texel.w * fragment.w),
        }
    }
}

/// A texture over a fragment's colour.
#[derive(Clone, Debug)]
pub struct Combine {
    /// How.
    pub mode: CombineMode,
    /// `T`.
    pub texture: Slot,
    /// `F`.
    pub fragment: Slot,
    /// `C`, linear RGBA; of importance for [`CombineMode::Blend`].
    pub constant: Vec4,
}

impl Combine {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        Allowed::Finite.check("an environment mode", "the constant colour", &self.constant.to_array())
    }
}

impl Texture for Combine {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.mode.apply(self.texture.evaluate(at), self.fragment.evaluate(at), self.constant)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let mut fragments = vec![Vec4::ZERO; at.len()];
        self.texture.evaluate_all(at, values);
        self.fragment.evaluate_all(at, &mut fragments);
        for (texel, fragment) in values.iter_mut().zip(fragments) {
            *texel = self.mode.apply(*texel, fragment, self.constant);
        }
    }

    depends_on!(texture, fragment);
}
