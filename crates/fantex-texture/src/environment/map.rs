//! A map and its look-ups.

use std::fmt;

use glam::{Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use super::level::Level;
use super::reduce::halve;
use super::{ChartPoint, EnvironmentForm};

/// Longest ratio of a footprint's axes that [`EnvironmentMap::sample`] honours.
pub const MAX_ENVIRONMENT_ANISOTROPY: f32 = 16.0;

/// Brightest value of a texel: the largest finite half float. Suns are brighter, but one infinite texel would spoil
/// every mean that it enters.
pub(super) const BRIGHTEST: f32 = 65_504.0;

/// Light from every direction: linear RGB, at least 0, any brightness; with coarser levels down to one texel per chart.
///
/// Look-ups are continuous over the whole sphere of directions: no seams at the edges of cubes, the rims of paraboloids,
/// the date line and the poles.
#[derive(Clone)]
pub struct EnvironmentMap {
    levels: Vec<Level>,
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

    /// A map whose texels are given by chart, column and row.
    pub(super) fn from_texels(
        form: EnvironmentForm,
        size: [u32; 2],
        texel: impl Fn(usize, u32, u32) -> Vec3 + Sync,
    ) -> Self {
        assert!(size[0] > 0 && size[1] > 0, "an environment map needs texels");
        let texel = &texel;
        let inner: Vec<Vec3A> = (0..form.charts() as u32 * size[1])
            .into_par_iter()
            .flat_map_iter(|row| {
                let (chart, y) = ((row / size[1]) as usize, row % size[1]);
                (0..size[0]).map(move |x| allowed(texel(chart, x, y)))
            })
            .collect();
        let mut levels = vec![Level::new(form, size, &inner)];
        while let Some(coarser) = levels.last().and_then(halve) {
            levels.push(coarser);
        }
        Self { levels }
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
        let size = Vec2::new(self.levels[0].size[0] as f32, self.levels[0].size[1] as f32);
        let texels = steps.map(|step| self.form().uv_step(d, step) * size);
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

    /// The level (between levels, too) whose texels have a solid angle, in steradians, in a direction.
    pub fn level_of(&self, direction: Vec3, steradians: f32) -> f32 {
        let [width, height] = self.levels[0].size.map(|n| n as f32);
        let at = self.form().locate(direction);
        let texel = self.form().steradians_per_uv(at.uv) / (width * height);
        0.5 * (steradians / texel.max(1e-12)).max(1e-12).log2()
    }

    /// One level, for loops that look up very often.
    pub(super) fn level(&self, level: usize) -> &Level {
        &self.levels[level.min(self.levels.len() - 1)]
    }
}

fn allowed(color: Vec3) -> Vec3A {
    // `max` takes the other operand where one is NaN.
    Vec3A::from(color.to_array().map(|c| c.max(0.0).min(BRIGHTEST)))
}
