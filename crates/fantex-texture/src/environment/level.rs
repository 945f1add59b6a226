//! One resolution of a map: its charts, each with an apron of texels that belong to its neighbours.
//!
//! With the apron, interpolation inside a chart never asks whether it has reached the chart's edge, and the aprons are
//! chosen so that both sides of every seam give the same value:
//!
//! * cube: the texels that adjoin across the edge; at the corners, where three faces meet, the mean of their three texels;
//! * sphere: across the date line the other end of the row; beyond a pole `2 mean - row`, so that exactly at the pole
//!   every longitude gives the row's mean;
//! * paraboloids: what the other paraboloid holds there; across the rim the two cross-fade over three texels;
//! * mirror ball: the mean around the rim, which is one direction.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use super::form::paraboloid_uv;
use super::{ChartPoint, CubeFace, EnvironmentForm, EnvironmentMap};
use crate::filter::{Overlap, overlaps};

#[derive(Clone)]
pub(super) struct Level {
    pub(super) form: EnvironmentForm,
    /// Columns and rows of a chart, without the apron.
    pub(super) size: [u32; 2],
    apron: usize,
    stride: usize,
    /// Texels of one chart with its apron.
    page: usize,
    texels: Vec<Vec3A>,
    /// A mirror ball's rim.
    rim: Vec3A,
}

impl Level {
    pub(super) fn byte_len(&self) -> usize {
        size_of_val(self.texels.as_slice())
    }

    /// A level whose texels are given chart by chart, row by row. Texels outside a disc are ignored.
    pub(super) fn new(form: EnvironmentForm, size: [u32; 2], inner: &[Vec3A]) -> Self {
        let [width, height] = size.map(|n| n as usize);
        let apron = if form.is_disc() { 2 } else { 1 };
        let stride = width + 2 * apron;
        let page = stride * (height + 2 * apron);
        let texels = vec![Vec3A::ZERO; page * form.charts()];
        let mut level = Self { form, size, apron, stride, page, texels, rim: Vec3A::ZERO };
        for (row, values) in inner.chunks_exact(width).enumerate() {
            let first = level.index(row / height, 0, (row % height) as i32);
            level.texels[first..first + width].copy_from_slice(values);
        }
        match form {
            EnvironmentForm::Cube => level.surround_faces(),
            EnvironmentForm::Sphere => level.surround_sphere(),
            EnvironmentForm::DualParaboloid => level.surround_discs(),
            EnvironmentForm::MirrorBall => level.surround_ball(),
        }
        level
    }

    fn index(&self, chart: usize, x: i32, y: i32) -> usize {
        let apron = self.apron as i32;
        chart * self.page + (y + apron) as usize * self.stride + (x + apron) as usize
    }

    /// The texel in a column and row; the apron's have coordinates below zero or beyond the size.
    pub(super) fn texel(&self, chart: usize, x: i32, y: i32) -> Vec3A {
        self.texels[self.index(chart, x, y)]
    }

    pub(super) fn texel_uv(&self, x: i32, y: i32) -> Vec2 {
        let [width, height] = self.size.map(|n| n as f32);
        Vec2::new((x as f32 + 0.5) / width, (y as f32 + 0.5) / height)
    }

    /// Linear interpolation between four texels of a chart with its apron.
    #[inline]
    fn bilinear(&self, at: ChartPoint) -> Vec3A {
        let apron = self.apron as f32;
        let x = (at.uv.x * self.size[0] as f32 + (apron - 0.5)).max(0.0);
        let y = (at.uv.y * self.size[1] as f32 + (apron - 0.5)).max(0.0);
        let column = (x as usize).min(self.stride - 2);
        let row = (y as usize).min(self.size[1] as usize + 2 * self.apron - 2);
        let [fx, fy] = [x - column as f32, y - row as f32];
        let first = at.chart * self.page + row * self.stride + column;
        let texels = &self.texels[first..first + self.stride + 2];
        let above = texels[0] + (texels[1] - texels[0]) * fx;
        let [left, right] = [texels[self.stride], texels[self.stride + 1]];
        let below = left + (right - left) * fx;
        above + (below - above) * fy
    }

    /// The continuous reconstruction in a direction.
    #[inline]
    pub(super) fn look_up(&self, direction: Vec3) -> Vec3A {
        match self.form {
            EnvironmentForm::Cube | EnvironmentForm::Sphere => self.bilinear(self.form.locate(direction)),
            EnvironmentForm::DualParaboloid => self.across_the_rim(direction.normalize_or(Vec3::NEG_Z)),
            EnvironmentForm::MirrorBall => {
                let at = self.form.locate(direction);
                let inside = 1.0 - (at.uv * 2.0 - 1.0).length();
                let share = (inside * self.size[0] as f32 / 3.0).clamp(0.0, 1.0);
                self.rim + (self.bilinear(at) - self.rim) * share
            }
        }
    }

    fn across_the_rim(&self, d: Vec3) -> Vec3A {
        let band = (1.5 / self.size[0] as f32).min(0.5);
        let front = (0.5 - 0.5 * d.z / band).clamp(0.0, 1.0);
        let of = |chart| self.bilinear(ChartPoint { chart, uv: paraboloid_uv(chart, d) });
        match front {
            0.0 => of(1),
            1.0 => of(0),
            _ => of(1) + (of(0) - of(1)) * front,
        }
    }

    fn surround_faces(&mut self) {
        let n = self.size[0] as i32;
        for face in CubeFace::ALL {
            let chart = face as usize;
            for i in 0..n {
                for (x, y) in [(-1, i), (n, i), (i, -1), (i, n)] {
                    let value = self.beyond_edge(face, x, y);
                    let index = self.index(chart, x, y);
                    self.texels[index] = value;
                }
            }
            for (x, y) in [(-1, -1), (n, -1), (-1, n), (n, n)] {
                let (inner_x, inner_y) = (x.clamp(0, n - 1), y.clamp(0, n - 1));
                let three = self.texel(chart, inner_x, inner_y)
                    + self.texel(chart, x, inner_y)
                    + self.texel(chart, inner_x, y);
                let index = self.index(chart, x, y);
                self.texels[index] = three / 3.0;
            }
        }
    }

    /// The texel of the neighbouring face that adjoins the edge at a place one texel outside.
    fn beyond_edge(&self, face: CubeFace, x: i32, y: i32) -> Vec3A {
        let n = self.size[0] as f32;
        let st = (self.texel_uv(x, y) * 2.0 - 1.0).clamp(Vec2::NEG_ONE, Vec2::ONE);
        // Fold the face's plane at the edge: half a texel down the neighbour.
        let direction = face.forward() * (1.0 - 1.0 / n) + face.right() * st.x - face.up() * st.y;
        let at = EnvironmentForm::Cube.locate(direction);
        let [column, row] = (at.uv * n).to_array().map(|c| (c as i32).clamp(0, self.size[0] as i32 - 1));
        self.texel(at.chart, column, row)
    }

    fn surround_sphere(&mut self) {
        let [width, height] = self.size.map(|n| n as i32);
        for (row, beyond) in [(0, -1), (height - 1, height)] {
            let mean = (0..width).map(|x| self.texel(0, x, row)).sum::<Vec3A>() / width as f32;
            for x in 0..width {
                let index = self.index(0, x, beyond);
                self.texels[index] = mean * 2.0 - self.texel(0, x, row);
            }
        }
        for y in -1..=height {
            let [first, last] = [self.texel(0, 0, y), self.texel(0, width - 1, y)];
            let [before, after] = [self.index(0, -1, y), self.index(0, width, y)];
            (self.texels[before], self.texels[after]) = (last, first);
        }
    }

    /// A coarser level as look-ups read it. Towards the poles of a sphere its texels get ever narrower than they are high; each becomes the
    /// mean of so many of its row that all are as wide as high, and a level fits a footprint by its angle alone.
    pub(super) fn evened(mut self) -> Self {
        if self.form != EnvironmentForm::Sphere {
            return self;
        }
        let [width, height] = self.size.map(|n| n as usize);
        let own = self.apron..self.apron + width;
        let texels_along = width as f64 / (2 * height) as f64;
        let rows = self.texels.par_chunks_exact_mut(self.stride).skip(self.apron).take(height);
        rows.enumerate().for_each(|(y, row)| {
            let polar = (y as f64 + 0.5) / height as f64 * PI;
            blur_ring(&mut row[own.clone()], texels_along / polar.sin());
        });
        self.surround_sphere();
        self
    }

    fn is_own(&self, x: i32, y: i32) -> bool {
        let n = self.size[0] as i32;
        (0..n).contains(&x) && (0..n).contains(&y) && self.form.is_inside(self.texel_uv(x, y))
    }

    /// The places of a disc's chart that are not its own.
    fn strange_places(&self) -> Vec<(i32, i32)> {
        let n = self.size[0] as i32;
        let places = -2..n + 2;
        let all = places.clone().flat_map(|y| places.clone().map(move |x| (x, y)));
        all.filter(|&(x, y)| !self.is_own(x, y)).collect()
    }

    fn surround_discs(&mut self) {
        for (x, y) in self.strange_places() {
            for chart in 0..2 {
                let d = self.form.direction(ChartPoint { chart, uv: self.texel_uv(x, y) });
                let value = self.own_bilinear(1 - chart, paraboloid_uv(1 - chart, d));
                let index = self.index(chart, x, y);
                self.texels[index] = value;
            }
        }
    }

    /// Interpolation that uses only a chart's own texels.
    fn own_bilinear(&self, chart: usize, uv: Vec2) -> Vec3A {
        let p = uv * self.size[0] as f32 - 0.5;
        let first = p.floor();
        let f = p - first;
        let (mut sum, mut weights) = (Vec3A::ZERO, 0.0);
        for (dx, wx) in [(0, 1.0 - f.x), (1, f.x)] {
            for (dy, wy) in [(0, 1.0 - f.y), (1, f.y)] {
                let (x, y) = (first.x as i32 + dx, first.y as i32 + dy);
                if self.is_own(x, y) {
                    sum += self.texel(chart, x, y) * (wx * wy);
                    weights += wx * wy;
                }
            }
        }
        if weights > 0.0 {
            return sum / weights;
        }
        // One step towards the middle there are texels of the disc.
        self.own_bilinear(chart, uv + (Vec2::splat(0.5) - uv) * (1.0 / self.size[0] as f32).max(0.1))
    }

    fn surround_ball(&mut self) {
        let n = self.size[0] as i32;
        let ring = 1.0 - 3.0 / n as f32;
        let (mut sum, mut count) = (Vec3A::ZERO, 0.0);
        for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
            if self.is_own(x, y) && (self.texel_uv(x, y) * 2.0 - 1.0).length() >= ring {
                sum += self.texel(0, x, y);
                count += 1.0;
            }
        }
        self.rim = sum / f32::max(count, 1.0);
        for (x, y) in self.strange_places() {
            let index = self.index(0, x, y);
            self.texels[index] = self.rim;
        }
    }
}

/// Each texel of a ring becomes the mean of `width` texels around it.
fn blur_ring(ring: &mut [Vec3A], width: f64) {
    let count = ring.len();
    let width = width.min(count as f64);
    if width <= 1.0 {
        return;
    }
    // The sum of all texels before each: the mean over an interval is a difference of two.
    let mut sums = Vec::with_capacity(count + 1);
    let mut total = DVec3::ZERO;
    sums.push(total);
    for texel in ring.iter() {
        total += Vec3::from(*texel).as_dvec3();
        sums.push(total);
    }
    let up_to = |place: f64| {
        let turns = (place / count as f64).floor();
        let place = place - turns * count as f64;
        let texel = (place as usize).min(count - 1);
        total * turns + sums[texel] + (sums[texel + 1] - sums[texel]) * (place - texel as f64)
    };
    for (x, texel) in ring.iter_mut().enumerate() {
        let center = x as f64 + 0.5;
        let mean = (up_to(center + 0.5 * width) - up_to(center - 0.5 * width)) / width;
        *texel = Vec3A::from(mean.as_vec3()).max(Vec3A::ZERO);
    }
}

// ---- Coarser levels.
//
// A texel of the next level is the mean of those it covers, weighted by the solid angle that each subtends, so that the
// light of the whole map is the same at every level. Sides are halved and rounded down; where a side is odd, a texel of
// the next level covers parts of texels, which count by their share.

/// The next coarser level, or nothing below one texel per chart.
pub(super) fn halve(fine: &Level) -> Option<Level> {
    if fine.size == [1, 1] {
        return None;
    }
    let size = fine.size.map(|n| (n / 2).max(1));
    let [columns, rows] = [0, 1].map(|axis| overlaps(fine.size[axis], size[axis], size[axis]));
    let row_count = size[1] as usize;
    let inner: Vec<Vec3A> = (0..fine.form.charts() * row_count)
        .into_par_iter()
        .flat_map_iter(|row| {
            let (chart, row_span) = (row / row_count, &rows[row % row_count]);
            columns.iter().map(move |column_span| mean(fine, chart, column_span, row_span))
        })
        .collect();
    Some(Level::new(fine.form, size, &inner))
}

fn mean(fine: &Level, chart: usize, columns: &Overlap, rows: &Overlap) -> Vec3A {
    let (mut sum, mut weights) = (Vec3A::ZERO, 0.0);
    let signed = |(texel, share): (usize, f32)| (texel as i32, share);
    for (y, row_share) in rows.parents().map(signed) {
        for (x, column_share) in columns.parents().map(signed) {
            let uv = fine.texel_uv(x, y);
            if fine.form.is_inside(uv) {
                let weight = row_share * column_share * fine.form.texel_steradians(fine.size, x, y);
                sum += fine.texel(chart, x, y) * weight;
                weights += weight;
            }
        }
    }
    // A coarse texel may lie outside a disc with all it covers; it is not its own then, and will be filled.
    if weights > 0.0 { sum / weights } else { Vec3A::ZERO }
}

// ---- From one form to another.
//
// Every texel of the new map is the mean of `SUBTEXELS²` filtered look-ups spread over it, each with its share of the
// texel as footprint. What a conversion to as many texels loses, measured on a forest that all forms resolve (root mean
// square of sRGB-encoded values over all directions; `tests/texture/environments.rs` asserts it):
//
// | between | there | there and back |
// |---|---|---|
// | sphere, cube, paraboloids | 0.009 to 0.011 (39 to 41 dB) | 0.014 to 0.016 (36 to 37 dB) |
// | to a mirror ball | 0.024 (32 dB) | 0.030 (30 dB) |

/// Look-ups along each side of a texel.
const SUBTEXELS: u32 = 2;

impl EnvironmentMap {
    /// The same light in another form with `side` rows per chart (and columns: twice as many for a sphere).
    ///
    /// For a resolution like the source's, charts side by side should have as many texels: a cube of side `n`, a sphere of
    /// `2 n` rows, paraboloids of side `2 n` and a mirror ball of side `4 n` resolve about the same detail everywhere.
    ///
    /// # Panics
    /// If `side` is zero.
    pub fn converted(&self, form: EnvironmentForm, side: u32) -> Self {
        let size = form.chart_size(side);
        if form == self.form() && size == self.chart_size() {
            return self.clone();
        }
        let sub = Vec2::new(1.0 / (size[0] * SUBTEXELS) as f32, 1.0 / (size[1] * SUBTEXELS) as f32);
        Self::from_texels(form, size, |chart, x, y| {
            let first = Vec2::new((x * SUBTEXELS) as f32, (y * SUBTEXELS) as f32);
            let direction = |at: Vec2| form.direction(ChartPoint { chart, uv: at * sub });
            let mut sum = Vec3::ZERO;
            for (i, j) in (0..SUBTEXELS).flat_map(|j| (0..SUBTEXELS).map(move |i| (i, j))) {
                let at = first + Vec2::new(i as f32, j as f32) + 0.5;
                let along = |half: Vec2| direction(at + half) - direction(at - half);
                sum += self.sample(direction(at), [along(Vec2::X * 0.5), along(Vec2::Y * 0.5)]);
            }
            sum / (SUBTEXELS * SUBTEXELS) as f32
        })
    }

    /// Texels along a face of a cube that resolves about as much.
    pub(super) fn side_as_cube(&self) -> u32 {
        let [width, height] = self.chart_size();
        let side = match self.form() {
            EnvironmentForm::Cube => width,
            EnvironmentForm::Sphere => width / 4,
            EnvironmentForm::DualParaboloid => height / 2,
            EnvironmentForm::MirrorBall => height / 3,
        };
        side.max(1)
    }
}
