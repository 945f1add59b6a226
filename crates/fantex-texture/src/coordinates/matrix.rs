//! The texture matrices of two- and three-dimensional textures.

use glam::{Mat2, Mat3, Mat4, Quat, Vec2, Vec3, Vec4};

use crate::look::Slot;
use crate::{Allowed, InvalidOption, ShadingPoint, Texture, UvPoint};

// The texture matrix: affine and projective maps of texture coordinates before the look-up, animated or not.

/// Steps by which coordinates are transformed, in this order: `matrix`; scale and rotation about the pivot; translation.
///
/// The map acts on coordinates, so a scale of 2 shows the image twice as often, half as large; a translation of 0.1 moves
/// the image by a tenth of its size to the left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureMatrixOptions {
    /// Any affine or projective map of `(u, v, 1)` as columns; with an inverse.
    pub matrix: Mat3,
    /// The coordinates that scale and rotation leave in place.
    pub pivot: Vec2,
    /// Factors of u and v; not 0.
    pub scale: Vec2,
    /// Degrees, from u towards v: clockwise as the image is seen, for the coordinates; the image turns the other way.
    pub rotation: f32,
    /// Added to u and v.
    pub translation: Vec2,
    /// By which the scale is multiplied each second; above 0.
    pub scale_per_second: Vec2,
    /// Added to the rotation each second, degrees.
    pub rotation_per_second: f32,
    /// Added to the translation each second.
    pub translation_per_second: Vec2,
}

impl Default for TextureMatrixOptions {
    /// Coordinates stay as they are.
    fn default() -> Self {
        Self {
            matrix: Mat3::IDENTITY,
            pivot: Vec2::ZERO,
            scale: Vec2::ONE,
            rotation: 0.0,
            translation: Vec2::ZERO,
            scale_per_second: Vec2::ONE,
            rotation_per_second: 0.0,
            translation_per_second: Vec2::ZERO,
        }
    }
}

impl TextureMatrixOptions {
    fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a texture matrix";
        Allowed::Finite.check(OWNER, "the matrix", &self.matrix.to_cols_array())?;
        if !self.matrix.inverse().is_finite() {
            return Err(InvalidOption::Singular { owner: OWNER, field: "the matrix" });
        }
        Allowed::Finite.check(OWNER, "the pivot", &self.pivot.to_array())?;
        Allowed::NotZero.check(OWNER, "the scale", &self.scale.to_array())?;
        Allowed::Finite.check(OWNER, "the rotation", &[self.rotation])?;
        Allowed::Finite.check(OWNER, "the translation", &self.translation.to_array())?;
        Allowed::Positive.check(OWNER, "the scale per second", &self.scale_per_second.to_array())?;
        Allowed::Finite.check(OWNER, "the rotation per second", &[self.rotation_per_second])?;
        Allowed::Finite.check(OWNER, "the translation per second", &self.translation_per_second.to_array())
    }

    fn is_animated(&self) -> bool {
        self.scale_per_second != Vec2::ONE
            || self.rotation_per_second != 0.0
            || self.translation_per_second != Vec2::ZERO
    }

    /// The matrix at a time in seconds.
    fn at(&self, time: f32) -> Mat3 {
        let scale = self.scale * self.scale_per_second.powf(time);
        let rotation = (self.rotation + self.rotation_per_second * time).to_radians();
        let translation = self.translation + self.translation_per_second * time;
        Mat3::from_translation(self.pivot + translation)
            * Mat3::from_mat2(Mat2::from_scale_angle(Vec2::ONE, rotation) * Mat2::from_diagonal(scale))
            * Mat3::from_translation(-self.pivot)
            * self.matrix
    }
}

/// A map of texture coordinates; see [`TextureMatrixOptions`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureMatrix {
    options: TextureMatrixOptions,
    /// At time 0.
    start: Mat3,
    is_animated: bool,
}

impl Default for TextureMatrix {
    /// Coordinates stay as they are.
    fn default() -> Self {
        Self { options: TextureMatrixOptions::default(), start: Mat3::IDENTITY, is_animated: false }
    }
}

impl TextureMatrix {
    /// The map that the options describe.
    ///
    /// # Errors
    ///
    /// A number is out of range, or the matrix has no inverse.
    pub fn new(options: TextureMatrixOptions) -> Result<Self, InvalidOption> {
        options.check()?;
        Ok(Self { options, start: options.at(0.0), is_animated: options.is_animated() })
    }

    /// Whether it changes with time.
    pub fn is_animated(&self) -> bool {
        self.is_animated
    }

    /// The matrix at a time in seconds.
    pub fn at(&self, time: f32) -> Mat3 {
        if self.is_animated { self.options.at(time) } else { self.start }
    }

    /// The transformed coordinates, with the footprint transformed by the map's derivative.
    pub fn apply(&self, point: &UvPoint, time: f32) -> UvPoint {
        let matrix = self.at(time);
        let mapped = matrix * point.uv.extend(1.0);
        // d(x / w) = (dx - (x / w) dw) / w
        let w = away_from_zero(mapped.z);
        let uv = mapped.truncate() / w;
        let steps = point.steps.map(|step| {
            let Vec3 { x, y, z: dw } = matrix * step.extend(0.0);
            (Vec2::new(x, y) - uv * dw) / w
        });
        UvPoint { uv, steps }
    }
}

/// The denominator of a projective map: on its horizon, a small number instead of 0, so that coordinates stay finite.
pub(super) fn away_from_zero(w: f32) -> f32 {
    if w.abs() >= 1e-6 { w } else { 1e-6_f32.copysign(w) }
}

// The texture matrix of three-dimensional textures.

/// Steps by which positions are transformed, in this order: `matrix`; scale and rotation about the pivot; translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpaceMatrixOptions {
    /// Any affine or projective map of `(x, y, z, 1)` as columns; with an inverse.
    pub matrix: Mat4,
    /// The point that scale and rotation leave in place.
    pub pivot: Vec3,
    /// Factors of x, y and z; not 0.
    pub scale: Vec3,
    /// About the pivot: the direction is the axis, the length the angle in degrees.
    pub rotation: Vec3,
    /// Added to the position.
    pub translation: Vec3,
    /// By which the scale is multiplied each second; above 0.
    pub scale_per_second: Vec3,
    /// Turned further each second, after `rotation`: the direction is the axis, the length the angle in degrees.
    pub rotation_per_second: Vec3,
    /// Added to the translation each second.
    pub translation_per_second: Vec3,
}

impl Default for SpaceMatrixOptions {
    /// Positions stay as they are.
    fn default() -> Self {
        Self {
            matrix: Mat4::IDENTITY,
            pivot: Vec3::ZERO,
            scale: Vec3::ONE,
            rotation: Vec3::ZERO,
            translation: Vec3::ZERO,
            scale_per_second: Vec3::ONE,
            rotation_per_second: Vec3::ZERO,
            translation_per_second: Vec3::ZERO,
        }
    }
}

impl SpaceMatrixOptions {
    fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a space matrix";
        Allowed::Finite.check(OWNER, "the matrix", &self.matrix.to_cols_array())?;
        if !self.matrix.inverse().is_finite() {
            return Err(InvalidOption::Singular { owner: OWNER, field: "the matrix" });
        }
        Allowed::Finite.check(OWNER, "the pivot", &self.pivot.to_array())?;
        Allowed::NotZero.check(OWNER, "the scale", &self.scale.to_array())?;
        Allowed::Finite.check(OWNER, "the rotation", &self.rotation.to_array())?;
        Allowed::Finite.check(OWNER, "the translation", &self.translation.to_array())?;
        Allowed::Positive.check(OWNER, "the scale per second", &self.scale_per_second.to_array())?;
        Allowed::Finite.check(OWNER, "the rotation per second", &self.rotation_per_second.to_array())?;
        Allowed::Finite.check(OWNER, "the translation per second", &self.translation_per_second.to_array())
    }

    fn is_animated(&self) -> bool {
        self.scale_per_second != Vec3::ONE
            || self.rotation_per_second != Vec3::ZERO
            || self.translation_per_second != Vec3::ZERO
    }

    /// The matrix at a time in seconds.
    fn at(&self, time: f32) -> Mat4 {
        let turn = |degrees: Vec3| Quat::from_scaled_axis(degrees * f32::to_radians(1.0));
        let placed = Mat4::from_scale_rotation_translation(
            self.scale * self.scale_per_second.powf(time),
            turn(self.rotation_per_second * time) * turn(self.rotation),
            self.pivot + self.translation + self.translation_per_second * time,
        );
        placed * Mat4::from_translation(-self.pivot) * self.matrix
    }
}

/// A map of space; see [`SpaceMatrixOptions`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpaceMatrix {
    options: SpaceMatrixOptions,
    /// At time 0.
    start: Mat4,
    is_animated: bool,
}

impl Default for SpaceMatrix {
    /// Positions stay as they are.
    fn default() -> Self {
        Self { options: SpaceMatrixOptions::default(), start: Mat4::IDENTITY, is_animated: false }
    }
}

/// A position with its change along the footprint's edges: where a solid or a volume is looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpacePoint {
    /// The position.
    pub position: Vec3,
    /// Its change along the footprint's edges.
    pub steps: [Vec3; 2],
}

impl SpaceMatrix {
    /// The map that the options describe.
    ///
    /// # Errors
    ///
    /// A number is out of range, or the matrix has no inverse.
    pub fn new(options: SpaceMatrixOptions) -> Result<Self, InvalidOption> {
        options.check()?;
        Ok(Self { options, start: options.at(0.0), is_animated: options.is_animated() })
    }

    /// Whether it changes with time.
    pub fn is_animated(&self) -> bool {
        self.is_animated
    }

    /// The matrix at a time in seconds.
    pub fn at(&self, time: f32) -> Mat4 {
        if self.is_animated { self.options.at(time) } else { self.start }
    }

    /// The transformed position of a shading point, with the footprint transformed by the map's derivative.
    pub fn apply(&self, at: &ShadingPoint<'_>) -> SpacePoint {
        let matrix = self.at(at.time);
        let mapped = matrix * at.position.extend(1.0);
        let w = away_from_zero(mapped.w);
        let position = mapped.truncate() / w;
        let steps = at.position_steps.map(|step| {
            let change = matrix * step.extend(0.0);
            (change.truncate() - position * change.w) / w
        });
        SpacePoint { position, steps }
    }
}

/// A texture asked elsewhere: at the transformed position. Its normal, its texture coordinates and its eye stay, so that
/// recipes that depend on the slope still follow the surface.
#[derive(Clone, Debug)]
pub struct InSpace {
    /// The texture.
    pub input: Slot,
    /// From the object's space to the texture's.
    pub matrix: SpaceMatrix,
}

impl Texture for InSpace {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let SpacePoint { position, steps } = self.matrix.apply(at);
        self.input.evaluate(&ShadingPoint { position, position_steps: steps, ..*at })
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let there = at.iter().map(|at| {
            let SpacePoint { position, steps } = self.matrix.apply(at);
            ShadingPoint { position, position_steps: steps, ..*at }
        });
        self.input.evaluate_all(&there.collect::<Vec<_>>(), values);
    }

    fn is_view_dependent(&self) -> bool {
        self.input.is_view_dependent()
    }

    fn is_animated(&self) -> bool {
        self.matrix.is_animated() || self.input.is_animated()
    }
}
