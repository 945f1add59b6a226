//! A map and its look-ups.

use std::f32::consts::PI;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use fantex_base::input::{Held, hold, reserve};
use fantex_base::{Error, Result};
use glam::{Vec2, Vec3, Vec3A, Vec4};
use rayon::prelude::*;

use super::level::{Level, halve};
use super::{ChartPoint, CubeFace, EnvironmentForm, EnvironmentLayout};
use crate::image_file::BRIGHTEST;
use crate::{ColorSpace, Dependence, Image, ShadingPoint, Texture};

/// Longest ratio of a footprint's axes that [`EnvironmentMap::sample`] honours.
pub const MAX_ENVIRONMENT_ANISOTROPY: f32 = 16.0;

/// Bytes per texel while a map is made: a vector, and what levels keep of it.
const MAKING_BYTES: u64 = 22;

/// Light from every direction: linear RGB, at least 0, any brightness; with coarser levels down to one texel per chart.
///
/// Look-ups are continuous over the whole sphere of directions: no seams at the edges of cubes, the rims of paraboloids,
/// the date line and the poles.
#[derive(Clone)]
pub struct EnvironmentMap {
    levels: Vec<Level>,
    /// In the budget for input.
    _held: Held,
}

impl fmt::Debug for EnvironmentMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "EnvironmentMap({:?}, {:?} texels per chart)", self.form(), self.chart_size())
    }
}

impl EnvironmentMap {
    /// A map whose texels are computed: `radiance` gets the unit direction of a texel's middle and the changes of the
    /// direction along the texel's width and height. Sphere charts have `2 side` columns and `side` rows, others `side`
    /// each. Values that are not finite or negative are replaced by the nearest allowed ones, NaN by 0.
    ///
    /// # Panics
    /// If `side` is zero.
    pub fn from_function(
        form: EnvironmentForm,
        side: u32,
        radiance: impl Fn(Vec3, [Vec3; 2]) -> Vec3 + Sync,
    ) -> Self {
        let size = form.chart_size(side);
        let texel = Vec2::new(1.0 / size[0] as f32, 1.0 / size[1] as f32);
        Self::from_texels(form, size, |chart, x, y| {
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) * texel;
            if !form.is_inside(uv) {
                return Vec3::ZERO;
            }
            let along = |step: Vec2| {
                let [before, after] = [uv - step * 0.5, uv + step * 0.5];
                form.direction(ChartPoint { chart, uv: after })
                    - form.direction(ChartPoint { chart, uv: before })
            };
            let steps = [along(Vec2::X * texel), along(Vec2::Y * texel)];
            radiance(form.direction(ChartPoint { chart, uv }), steps)
        })
    }

    /// Counts the memory that a map of this size takes while it is made.
    ///
    /// # Errors
    /// The [budget](fantex_base::input::ReadLimits) does not allow it.
    pub fn reserve(form: EnvironmentForm, side: u32) -> Result<Held> {
        let ([columns, rows], charts) = (form.chart_size(side).map(u64::from), form.charts() as u64);
        let what = format_args!("an environment of {charts} x {columns} x {rows} texels");
        reserve(what, (charts * columns * rows).saturating_mul(MAKING_BYTES))
    }

    /// A map of texels that are given chart by chart and row by row, as many as [`from_function`](Self::from_function) asks for:
    /// linear RGB, replaced as there.
    ///
    /// # Panics
    /// If `side` is zero, or texels are missing or left over.
    pub fn from_charts(form: EnvironmentForm, side: u32, mut texels: Vec<Vec3A>) -> Self {
        let size = form.chart_size(side);
        texels.par_iter_mut().for_each(|texel| *texel = allowed(Vec3::from(*texel)));
        Self::from_finest(form, size, texels)
    }

    pub(super) fn from_texels(
        form: EnvironmentForm,
        size: [u32; 2],
        texel: impl Fn(usize, u32, u32) -> Vec3 + Sync,
    ) -> Self {
        let texel = &texel;
        let [columns, rows] = size.map(|n| n as usize);
        let mut inner = vec![Vec3A::ZERO; form.charts() * columns * rows];
        inner.par_chunks_mut(columns).enumerate().for_each(|(row, texels)| {
            let (chart, y) = (row / rows, (row % rows) as u32);
            (0..).zip(texels).for_each(|(x, inner)| *inner = allowed(texel(chart, x, y)));
        });
        Self::from_finest(form, size, inner)
    }

    /// From allowed texels of level 0.
    fn from_finest(form: EnvironmentForm, size: [u32; 2], texels: Vec<Vec3A>) -> Self {
        let count = form.charts() * size[0] as usize * size[1] as usize;
        assert!(count > 0 && texels.len() == count, "an environment map needs {count} texels, at least 1");
        let mut levels = vec![Level::new(form, size, &texels)];
        drop(texels);
        let mut coarser = halve(&levels[0]);
        while let Some(level) = coarser {
            coarser = halve(&level);
            levels.push(level.evened());
        }
        let bytes: usize = levels.iter().map(Level::byte_len).sum();
        Self { levels, _held: hold(bytes as u64) }
    }

    /// The layout of the directions.
    pub fn form(&self) -> EnvironmentForm {
        self.levels[0].form
    }

    /// Columns and rows of a chart at level 0.
    pub fn chart_size(&self) -> [u32; 2] {
        self.levels[0].size
    }

    /// Levels, at least 1; the last has one texel per chart.
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// Columns and rows of a chart of a level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level_size(&self, level: usize) -> [u32; 2] {
        self.levels[level].size
    }

    /// Linear RGB of a texel. Outside the disc of a paraboloid or ball, what continues the map.
    ///
    /// # Panics
    /// Outside the map.
    pub fn texel(&self, level: usize, chart: usize, x: u32, y: u32) -> Vec3 {
        let [width, height] = self.levels[level].size;
        assert!(chart < self.form().charts() && x < width && y < height, "texel {x},{y} of chart {chart}");
        self.levels[level].texel(chart, x as i32, y as i32).into()
    }

    /// The mean over all directions at one level, linear RGB: what a white diffuse ball reflects in the mean.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn mean(&self, level: usize) -> Vec3 {
        let sum = self.integrate(level, |_, weight, color| [color * weight, Vec3::splat(weight)]);
        sum[0] / sum[1]
    }

    /// Sums `term(direction, steradians, color)` over the texels of a level: in parallel, in a fixed order.
    pub(super) fn integrate<const N: usize>(
        &self,
        level: usize,
        term: impl Fn(Vec3, f32, Vec3) -> [Vec3; N] + Sync,
    ) -> [Vec3; N] {
        let level = &self.levels[level];
        let form = level.form;
        let [width, height] = level.size;
        let rows: Vec<[Vec3; N]> = (0..form.charts() * height as usize)
            .into_par_iter()
            .map(|row| {
                let (chart, y) = (row / height as usize, (row % height as usize) as i32);
                let mut sum = [Vec3::ZERO; N];
                for x in 0..width as i32 {
                    let uv = level.texel_uv(x, y);
                    if form.is_inside(uv) {
                        let direction = form.direction(ChartPoint { chart, uv });
                        let steradians = form.texel_steradians(level.size, x, y);
                        let terms = term(direction, steradians, level.texel(chart, x, y).into());
                        (0..N).for_each(|i| sum[i] += terms[i]);
                    }
                }
                sum
            })
            .collect();
        let mut total = [glam::DVec3::ZERO; N];
        rows.iter().for_each(|row| (0..N).for_each(|i| total[i] += row[i].as_dvec3()));
        total.map(|sum| sum.as_vec3())
    }

    /// Light from a direction (of any length but zero), linear RGB: the mean over the footprint whose edges are `steps`,
    /// changes of the *unit* direction (for a sky box: to the next pixel on the right and below; for a mirror see
    /// [`CubeTexture`](super::CubeTexture)). Up to [`MAX_ENVIRONMENT_ANISOTROPY`] trilinear probes along the longer edge.
    pub fn sample(&self, direction: Vec3, steps: [Vec3; 2]) -> Vec3 {
        let d = direction.normalize_or(Vec3::NEG_Z);
        let texels = steps.map(|step| self.in_texels(d, step));
        let lengths = texels.map(Vec2::length);
        let longer = usize::from(lengths[1] > lengths[0]);
        let major = lengths[longer];
        if major.is_nan() || major <= 1.0 {
            return self.levels[0].look_up(d).into();
        }
        let minor = (texels[0].perp_dot(texels[1]).abs() / major).max(major / MAX_ENVIRONMENT_ANISOTROPY);
        let width = minor.max(1.0);
        let probes = (major / width).ceil().clamp(1.0, MAX_ENVIRONMENT_ANISOTROPY);
        let level = width.log2();
        let mut sum = Vec3::ZERO;
        for probe in 0..probes as u32 {
            let along = (probe as f32 + 0.5) / probes - 0.5;
            sum += self.sample_level(d + steps[longer] * along, level);
        }
        sum / probes
    }

    /// A change of a unit direction in texels of level 0.
    fn in_texels(&self, d: Vec3, step: Vec3) -> Vec2 {
        let [width, height] = self.levels[0].size.map(|n| n as f32);
        let texels_per_radian = match self.form() {
            // Towards the rim the texels get ever longer and thinner, and first order means little; but each has the solid
            // angle of a square of 4 / width.
            EnvironmentForm::MirrorBall => width / 4.0,
            // Towards the poles they get ever narrower, but what coarser levels hold of them does not.
            EnvironmentForm::Sphere => height / PI,
            form => return form.uv_step(d, step) * Vec2::new(width, height),
        };
        let (right, down) = d.any_orthonormal_pair();
        Vec2::new(right.dot(step), down.dot(step)) * texels_per_radian
    }

    /// Light from a direction, linear RGB, at a level between 0 and the last, linear between levels.
    pub fn sample_level(&self, direction: Vec3, level: f32) -> Vec3 {
        let last = self.levels.len() - 1;
        let level = level.clamp(0.0, last as f32);
        let fine = level as usize;
        let share = level - fine as f32;
        let value = self.levels[fine].look_up(direction);
        if share == 0.0 {
            return value.into();
        }
        value.lerp(self.levels[(fine + 1).min(last)].look_up(direction), share).into()
    }

    pub(super) fn level(&self, level: usize) -> &Level {
        &self.levels[level.min(self.levels.len() - 1)]
    }
}

/// Suns are brighter than [`BRIGHTEST`], but one infinite texel would spoil every mean that it enters.
fn allowed(color: Vec3) -> Vec3A {
    // Not `clamp`, which keeps NaN.
    Vec3A::from(color.to_array().map(|c| if c > 0.0 { c.min(BRIGHTEST) } else { 0.0 }))
}

// ---- Maps from files.

/// Most texels of a picture: a map takes 21 bytes per texel.
const MAX_TEXELS: u64 = 1 << 27;

impl EnvironmentMap {
    /// Reads a panorama, a cube's cross or a strip of its faces, told apart by their proportions, in any format that
    /// [`Image::load`] reads, or a KTX2 or DDS file of a cube. See [`EnvironmentLayout`] for the orientation.
    ///
    /// # Errors
    /// The file is no image, is too large or has other proportions.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let images = Image::load_all(path, ColorSpace::Srgb)?;
        if let Ok(faces) = <&[Image; 6]>::try_from(&images[..]) {
            check_limit(path, &faces[0], 6)?;
            if let Some(map) = Self::from_faces(faces) {
                return Ok(map);
            }
        }
        let Some(image) = images.first() else {
            return Err(Error::malformed(format!("'{}' holds no image", path.display())).with_path(path));
        };
        check_limit(path, image, 1)?;
        let (width, height) = (image.width, image.height);
        EnvironmentLayout::of_size(width, height).and_then(|layout| Self::from_image(image, layout)).ok_or_else(
            || {
                Error::malformed(format!(
                    "'{}' has {width} x {height} texels, which is no environment; give a panorama (2:1), a cube's cross (4:3 \
                     or 3:4), a strip of its faces (6:1 or 1:6), a KTX2 or DDS file of a cube or, in a look with layout = \
                     \"mirror_ball\", a mirror ball (1:1)",
                    path.display()
                ))
                .with_path(path)
            },
        )
    }

    /// As [`EnvironmentMap::load`], with the layout said.
    ///
    /// # Errors
    /// The file is no image, is too large or does not have the layout's proportions.
    pub fn load_as(path: impl AsRef<Path>, layout: EnvironmentLayout) -> Result<Self> {
        let (path, image) = load_within_limit(path.as_ref())?;
        let (width, height, [columns, rows]) = (image.width, image.height, layout.cells());
        Self::from_image(&image, layout).ok_or_else(|| {
            let name = path.display();
            let message =
                format!("'{name}' has {width} x {height} texels, but its layout needs {columns} : {rows}");
            Error::malformed(message).with_path(path)
        })
    }

    /// Reads the six faces of a cube in the order of [`CubeFace::ALL`], which is that of KTX, each as seen from inside.
    ///
    /// # Errors
    /// A file is no image, or they are not squares of one size.
    pub fn load_faces(paths: [&Path; CubeFace::ALL.len()]) -> Result<Self> {
        let mut faces = Vec::with_capacity(paths.len());
        for path in paths {
            let (path, image) = load_within_limit(path)?;
            let side = faces.first().map_or(image.width, |first: &Image| first.width);
            let (width, height) = (image.width, image.height);
            if width != side || height != side {
                let message = format!(
                    "face '{}' of a cube has {width} x {height} texels; all six must be squares of {side} x {side}, as the first \
                     is wide",
                    path.display()
                );
                return Err(Error::malformed(message).with_path(path));
            }
            faces.push(image);
        }
        Ok(Self::of_cube_faces(&faces))
    }
}

fn load_within_limit(path: &Path) -> Result<(&Path, Image)> {
    let image = Image::load(path)?;
    check_limit(path, &image, 1)?;
    Ok((path, image))
}

/// Whether an environment may have as many texels as so many images of this size.
fn check_limit(path: &Path, Image { width, height, .. }: &Image, images: u64) -> Result<()> {
    let texels = images * u64::from(*width) * u64::from(*height);
    drop(reserve(format_args!("the environment '{}'", path.display()), texels.saturating_mul(MAKING_BYTES))?);
    if texels <= MAX_TEXELS {
        return Ok(());
    }
    let count = if images > 1 { format!("{images} x ") } else { String::new() };
    let message = format!(
        "'{}' has {count}{width} x {height} texels, more than the {MAX_TEXELS} that an environment may have; scale it down",
        path.display()
    );
    Err(Error::too_large(message).with_path(path))
}

// ---- An environment as a texture of a material: reflection mapping as a colour, a picture around an object.

/// Which direction looks a map up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DirectionSource {
    /// The view ray, mirrored at the normal (J. Blinn and M. Newell 1976). Without an eye, as in a bake, the normal.
    #[default]
    Reflection,
    /// The normal.
    Normal,
    /// From a centre to the point: the map as paint on the object.
    Position {
        /// The centre, object space.
        center: Vec3,
    },
    /// The view ray as it goes on behind the surface: the surface is a window. Without an eye, against the normal.
    View,
}

/// An environment map looked up by a direction of the surface point; alpha is 1.
#[derive(Clone, Debug)]
pub struct CubeTexture {
    /// The map; of any form.
    pub map: Arc<EnvironmentMap>,
    /// Which direction looks it up.
    pub source: DirectionSource,
    /// Degrees by which the map is turned to the left (seen from above: counter-clockwise) about `+y`.
    pub rotation_degrees: f32,
    /// A shape for the surroundings, object space, with the place where the map was taken; without, they are infinitely
    /// far away. For reflections and views.
    pub proxy: Option<(EnvironmentProxy, Vec3)>,
}

impl CubeTexture {
    /// A map as it stands, infinitely far away.
    pub fn new(map: Arc<EnvironmentMap>, source: DirectionSource) -> Self {
        Self { map, source, rotation_degrees: 0.0, proxy: None }
    }

    /// Unit direction and its change along the footprint's edges.
    fn direction(&self, at: &ShadingPoint<'_>) -> (Vec3, [Vec3; 2]) {
        match (self.source, at.eye) {
            (DirectionSource::Reflection, Some(eye)) => eye.mirrored_with_steps(at.normal, at.normal_steps),
            (DirectionSource::Reflection | DirectionSource::Normal, _) => (at.normal, at.normal_steps),
            (DirectionSource::Position { center }, _) => {
                let from_center = at.position - center;
                let scale = from_center.length_recip();
                let scale = if scale.is_finite() { scale } else { 0.0 };
                ((from_center * scale).normalize_or(at.normal), at.position_steps.map(|step| step * scale))
            }
            (DirectionSource::View, Some(eye)) => (-eye.direction, [Vec3::ZERO; 2]),
            (DirectionSource::View, None) => (-at.normal, at.normal_steps.map(|step| -step)),
        }
    }
}

impl Texture for CubeTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (mut direction, mut steps) = self.direction(at);
        if let Some((proxy, center)) = self.proxy
            && matches!(self.source, DirectionSource::Reflection | DirectionSource::View)
        {
            (direction, steps) =
                proxy.corrected_footprint(at.position, at.position_steps, direction, steps, center);
        }
        let map_from_object = glam::Quat::from_rotation_y(-self.rotation_degrees.to_radians());
        let color = self.map.sample(map_from_object * direction, steps.map(|step| map_from_object * step));
        color.extend(1.0)
    }

    fn depends_on(&self, what: Dependence) -> bool {
        what == Dependence::Eye && matches!(self.source, DirectionSource::Reflection | DirectionSource::View)
    }
}

// ---- Reflections of surroundings that are not infinitely far away.
//
// A map shows what is seen from its centre. A point beside the centre sees the walls of a room in other directions; if the
// room is roughly a box or a ball, those follow from where the point's ray meets it (S. Lagarde and A. Zanuttini, "Local
// image-based lighting with parallax-corrected cubemaps", 2012).

/// The shape that stands for the surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnvironmentProxy {
    /// An axis-aligned box.
    Box {
        /// Smallest coordinates.
        min: Vec3,
        /// Largest coordinates.
        max: Vec3,
    },
    /// A ball.
    Ball {
        /// Its centre.
        center: Vec3,
        /// Its radius.
        radius: f32,
    },
}

impl EnvironmentProxy {
    /// The direction in which a map taken at `map_center` shows what a ray from `position` along `direction` meets. Rays
    /// that do not start inside the shape keep their direction. All in one space, of the same units.
    pub fn corrected(&self, position: Vec3, direction: Vec3, map_center: Vec3) -> Vec3 {
        let distance = match *self {
            Self::Box { min, max } => {
                if position.cmplt(min).any() || position.cmpgt(max).any() {
                    return direction;
                }
                // Along each axis to the wall that lies ahead; an axis along which the ray stands still has none.
                let ahead = Vec3::select(direction.cmpgt(Vec3::ZERO), max, min);
                let distances = (ahead - position) / direction;
                let bounded = Vec3::select(direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, distances);
                bounded.min_element()
            }
            Self::Ball { center, radius } => {
                let from_center = position - center;
                let length2 = direction.length_squared();
                let along = from_center.dot(direction);
                let outside = from_center.length_squared() - radius * radius;
                if outside > 0.0 {
                    return direction;
                }
                ((along * along - length2 * outside).sqrt() - along) / length2
            }
        };
        let corrected = position + direction * distance - map_center;
        if corrected.is_finite() && corrected != Vec3::ZERO { corrected } else { direction }
    }

    /// As [`EnvironmentProxy::corrected`], as a unit direction, with its change along a footprint's edges (by differences:
    /// where an edge reaches over a corner of the box, it is the chord).
    pub fn corrected_footprint(
        &self,
        position: Vec3,
        position_steps: [Vec3; 2],
        direction: Vec3,
        direction_steps: [Vec3; 2],
        map_center: Vec3,
    ) -> (Vec3, [Vec3; 2]) {
        let at =
            |position, direction| self.corrected(position, direction, map_center).normalize_or(direction);
        let middle = at(position, direction);
        let steps = [0, 1].map(|i| at(position + position_steps[i], direction + direction_steps[i]) - middle);
        (middle, steps)
    }
}
