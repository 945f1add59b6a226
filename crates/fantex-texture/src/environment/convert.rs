//! From one form to another.
//!
//! Every texel of the new map is the mean of `SUBTEXELS²` filtered look-ups spread over it, each with its share of the
//! texel as footprint. Round trips of the test suite, as the root mean square error of sRGB-encoded, clamped colours over
//! all directions of a picture (`tests/texture/environments.rs` holds them to that): see the table there.

use glam::{Vec2, Vec3};

use super::{ChartPoint, EnvironmentForm, EnvironmentMap};

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

    /// The same light as a cube: itself where it is one, else with sides that resolve about as much.
    pub fn to_cube(&self) -> Self {
        let [width, height] = self.chart_size();
        match self.form() {
            EnvironmentForm::Cube => self.clone(),
            EnvironmentForm::Sphere => self.converted(EnvironmentForm::Cube, (width / 4).max(1)),
            EnvironmentForm::DualParaboloid => self.converted(EnvironmentForm::Cube, (height / 2).max(1)),
            EnvironmentForm::MirrorBall => self.converted(EnvironmentForm::Cube, (height / 3).max(1)),
        }
    }
}
