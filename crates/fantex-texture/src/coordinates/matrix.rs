//! The texture matrices of two- and three-dimensional textures.

use fantex_base::parameters;
use glam::{DAffine3, DMat4, DQuat, DVec2, DVec3, EulerRot, Mat2, Mat3, Mat4, Quat, Vec2, Vec3, Vec4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::eye::unit_with_steps;
use crate::invalid_option::singular;
use crate::look::Slot;
use crate::{Allowed, Dependence, List2, List3, Scale, ShadingPoint, Texture, UvPoint};

// The texture matrix: affine and projective maps of texture coordinates before the look-up, animated or not.

parameters! {
    /// A map of coordinates before the look-up: `matrix`, then scale and rotation about the pivot, then the shift. It acts on the
    /// coordinates: a scale of 2 shows the texture twice as often, half as large; a shift of 0.1 moves the image by a tenth of its
    /// size to the left.
    #[derive(Copy)]
    #[schemars(rename = "Matrix")]
    pub struct TextureMatrixOptions {
        /// A projective map of (u, v, 1) by rows.
        #[serde(rename = "projective")]
        pub matrix: Option<Projective> = None,
        /// The coordinates that scale and rotation leave in place.
        #[serde(with = "List2")]
        pub pivot: Vec2 = Vec2::ZERO,
        /// Factors of u and v.
        pub scale: Scale = Scale::Uniform(1.0),
        /// Rotation in degrees, from u towards v.
        #[serde(rename = "rotate")]
        pub rotation: f32 = 0.0,
        /// Added to u and v.
        #[serde(rename = "translate", with = "List2")]
        pub translation: Vec2 = Vec2::ZERO,
        /// Added to the shift each second.
        #[serde(rename = "move", with = "List2")]
        pub translation_per_second: Vec2 = Vec2::ZERO,
        /// Added to the rotation each second, in degrees.
        #[serde(rename = "spin")]
        pub rotation_per_second: f32 = 0.0,
        /// By which the scale is multiplied each second.
        #[serde(rename = "grow")]
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub scale_per_second: f32 = 1.0,
    }
}

/// A map of `(u, v, 1)`; files hold its rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "[[f32; 3]; 3]", into = "[[f32; 3]; 3]")]
#[schemars(inline)]
pub struct Projective(pub Mat3);

impl From<[[f32; 3]; 3]> for Projective {
    fn from(rows: [[f32; 3]; 3]) -> Self {
        Self(Mat3::from_cols_array_2d(&rows).transpose())
    }
}

impl From<Projective> for [[f32; 3]; 3] {
    fn from(map: Projective) -> Self {
        map.0.transpose().to_cols_array_2d()
    }
}

impl TextureMatrixOptions {
    fn matrix(&self) -> Mat3 {
        self.matrix.map_or(Mat3::IDENTITY, |map| map.0)
    }

    fn scale(&self) -> Vec2 {
        let [x, y, _] = self.scale.axes();
        DVec2::new(x, y).as_vec2()
    }

    fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a texture matrix";
        let matrix = self.matrix();
        Allowed::Finite.check(OWNER, "the matrix", &matrix.to_cols_array())?;
        Allowed::Positive.check(
            OWNER,
            "the largest number of the last row",
            &[matrix.row(2).abs().max_element()],
        )?;
        Allowed::Finite.check(OWNER, "the pivot", &self.pivot.to_array())?;
        Allowed::NotZero.check(OWNER, "the scale", &self.scale().to_array())?;
        Allowed::Finite.check(OWNER, "the rotation", &[self.rotation])?;
        Allowed::Finite.check(OWNER, "the translation", &self.translation.to_array())?;
        Allowed::Positive.check(OWNER, "the scale per second", &[self.scale_per_second])?;
        Allowed::Finite.check(OWNER, "the rotation per second", &[self.rotation_per_second])?;
        Allowed::Finite.check(OWNER, "the translation per second", &self.translation_per_second.to_array())
    }

    fn is_animated(&self) -> bool {
        self.scale_per_second != 1.0
            || self.rotation_per_second != 0.0
            || self.translation_per_second != Vec2::ZERO
    }

    fn at(&self, time: f32) -> Mat3 {
        let scale = self.scale() * Vec2::splat(self.scale_per_second).powf(time);
        let rotation = (self.rotation + self.rotation_per_second * time).to_radians();
        let translation = self.translation + self.translation_per_second * time;
        Mat3::from_translation(self.pivot + translation)
            * Mat3::from_mat2(Mat2::from_scale_angle(Vec2::ONE, rotation) * Mat2::from_diagonal(scale))
            * Mat3::from_translation(-self.pivot)
            * self.matrix()
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
    /// A number is out of range.
    pub fn new(options: TextureMatrixOptions) -> fantex_base::Result<Self> {
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

/// A map of space: any affine or projective map, then a turn and a shift that grow with time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpaceMatrix {
    start: Mat4,
    /// The direction is the axis, the length the angle in degrees.
    rotation_per_second: Vec3,
    translation_per_second: Vec3,
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
    const OWNER: &str = "a space matrix";

    /// A map of `(x, y, z, 1)` as columns.
    ///
    /// # Errors
    /// The matrix is not finite, or has no inverse.
    pub fn new(matrix: Mat4) -> fantex_base::Result<Self> {
        Allowed::Finite.check(Self::OWNER, "the matrix", &matrix.to_cols_array())?;
        // Of small or large scales, single precision does not hold the determinant.
        if !matrix.as_dmat4().inverse().is_finite() {
            return Err(singular(Self::OWNER, "the matrix"));
        }
        Ok(Self { start: matrix, ..Self::default() })
    }

    /// The same in motion: each second turned about an axis, by its length in degrees, and shifted.
    ///
    /// # Errors
    /// A number is not finite.
    pub fn moving(self, rotation: Vec3, translation: Vec3) -> fantex_base::Result<Self> {
        Allowed::Finite.check(Self::OWNER, "the rotation per second", &rotation.to_array())?;
        Allowed::Finite.check(Self::OWNER, "the translation per second", &translation.to_array())?;
        Ok(Self { rotation_per_second: rotation, translation_per_second: translation, ..self })
    }

    /// Whether it changes with time.
    pub fn is_animated(&self) -> bool {
        self.rotation_per_second != Vec3::ZERO || self.translation_per_second != Vec3::ZERO
    }

    /// The matrix at a time in seconds.
    pub fn at(&self, time: f32) -> Mat4 {
        if !self.is_animated() {
            return self.start;
        }
        let rotation = Quat::from_scaled_axis(self.rotation_per_second * time * f32::to_radians(1.0));
        Mat4::from_rotation_translation(rotation, self.translation_per_second * time) * self.start
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

    /// The transformed unit normal of a shading point, with its change along the footprint's edges: normals transform by the inverse
    /// transpose of the map's derivative. As they were where that has no inverse.
    fn apply_to_normal(&self, at: &ShadingPoint<'_>) -> (Vec3, [Vec3; 2]) {
        let matrix = self.at(at.time);
        let mapped = matrix * at.position.extend(1.0);
        let w = away_from_zero(mapped.w);
        let position = mapped.truncate() / w;
        let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis]
            .map(|change| (change.truncate() - position * change.w) / w);
        let derivative = Mat3::from_cols(x, y, z);
        let normal_matrix = (derivative * (1.0 / power_of_two(&derivative))).inverse().transpose();
        unit_with_steps(normal_matrix, at.normal, at.normal_steps).unwrap_or((at.normal, at.normal_steps))
    }
}

/// A power of two that is about the largest number of a matrix: it makes the determinant a number that single precision holds, and
/// rounds nothing.
fn power_of_two(matrix: &Mat3) -> f32 {
    const EXPONENT: u32 = 0x7f80_0000;
    let largest = matrix.to_cols_array().iter().fold(0.0, |most: f32, number| most.max(number.abs()));
    f32::from_bits(largest.clamp(f32::MIN_POSITIVE, 1e37).to_bits() & EXPONENT)
}

/// The axes of the normal that a placed texture is asked with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalAxes {
    /// The object's: recipes that depend on the slope still follow the surface.
    #[default]
    Object,
    /// The texture's own: recipes whose faces lie along axes.
    Texture,
}

/// A texture asked elsewhere: at the transformed position. Its texture coordinates and its eye stay; its normal stays or is
/// transformed with the position.
#[derive(Clone, Debug)]
pub struct InSpace {
    /// The texture.
    pub input: Slot,
    /// From the object's space to the texture's.
    pub matrix: SpaceMatrix,
    /// The axes of the normal.
    pub normal_axes: NormalAxes,
}

impl InSpace {
    fn transformed<'a>(&self, at: &ShadingPoint<'a>) -> ShadingPoint<'a> {
        let SpacePoint { position, steps } = self.matrix.apply(at);
        let there = ShadingPoint { position, position_steps: steps, ..*at };
        match self.normal_axes {
            NormalAxes::Object => there,
            NormalAxes::Texture => {
                let (normal, normal_steps) = self.matrix.apply_to_normal(at);
                ShadingPoint { normal, normal_steps, ..there }
            }
        }
    }
}

impl Texture for InSpace {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.input.evaluate(&self.transformed(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let there: Vec<_> = at.iter().map(|at| self.transformed(at)).collect();
        self.input.evaluate_all(&there, values);
    }

    fn depends_on(&self, what: Dependence) -> bool {
        what == Dependence::Time && self.matrix.is_animated() || self.input.depends_on(what)
    }
}

parameters! {
    /// Where a texture of space lies in the object: recipes are placed like an object of their own. A scale of 2 makes the
    /// pattern twice as large.
    #[derive(Copy)]
    pub struct Place {
        /// The point of the object that is the pattern's origin, in world units, object space.
        pub center: [f64; 3] = [0.0; 3],
        /// Size of the pattern's unit: factors of the unit that `unit` names.
        pub scale: Scale = Scale::Uniform(1.0),
        /// What is one unit of the pattern.
        pub unit: PlaceUnit = PlaceUnit::Model,
        /// Rotation of the pattern about x, then y, then z, in degrees.
        pub rotate: [f64; 3] = [0.0; 3],
        /// Shift of the pattern each second, in its units.
        #[serde(rename = "move", with = "List3")]
        pub shift_per_second: Vec3 = Vec3::ZERO,
        /// Rotation of the pattern each second: the direction is the axis, the length the angle in degrees.
        #[serde(with = "List3")]
        pub spin: Vec3 = Vec3::ZERO,
    }
}

/// A unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlaceUnit {
    /// The radius of the model's bounding sphere.
    #[default]
    Model,
    /// The world's unit.
    World,
}

impl Place {
    /// From the object's space to the pattern's. The pattern is an object of its own, so its motion is the inverse of that of the
    /// coordinates. `model_radius` is that of the model's bounding sphere.
    ///
    /// # Errors
    /// A number is out of range.
    pub fn matrix(&self, model_radius: f32) -> fantex_base::Result<SpaceMatrix> {
        let scale = DVec3::from_array(self.scale.axes()) * self.unit_length(model_radius);
        let [x, y, z] = self.rotate.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        let object_from_pattern =
            DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::from_array(self.center));
        SpaceMatrix::new(DMat4::from(object_from_pattern.inverse()).as_mat4())?
            .moving(-self.spin, -self.shift_per_second)
    }

    /// Where a height of the object lies along the y axis of a pattern that is not turned. `model_radius` as in [`Place::matrix`].
    pub fn height(&self, y: f32, model_radius: f32) -> f32 {
        let unit = self.unit_length(model_radius) * self.scale.axes()[1];
        ((f64::from(y) - self.center[1]) / unit) as f32
    }

    fn unit_length(&self, model_radius: f32) -> f64 {
        match self.unit {
            PlaceUnit::World => 1.0,
            PlaceUnit::Model => f64::from(model_radius),
        }
    }
}

/// A texture of space and where it lies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct InPlace<T> {
    /// The texture.
    #[serde(flatten)]
    pub texture: T,
    /// Where it lies.
    #[serde(default)]
    pub place: Place,
}
