//! A clear sky as an environment, computed.
//!
//! The sky's luminance and colour follow A. Preetham, P. Shirley and B. Smits, "A practical analytic model for daylight",
//! 1999: the five-parameter distribution of R. Perez et al. (1993) relative to the zenith, fitted to turbidity. The sun's
//! colour is what their attenuation by molecules and haze leaves of it at three wavelengths. The ground is a diffuse plain
//! that sky and sun light.

use std::f32::consts::PI;

use fantex_base::{Error, Result, parameters};
use glam::{Mat3, Vec3};

use super::{EnvironmentForm, EnvironmentMap};
use crate::{Color, List3};

/// Haziest air of a [`Sky`].
pub const MAX_TURBIDITY: f32 = 10.0;

parameters! {
    /// A clear sky over a plain, `+y` being up.
    #[derive(Copy)]
    pub struct Sky {
        /// To the sun, of any length but zero, world axes. Below the horizon it counts as on it.
        #[serde(with = "List3")]
        pub to_sun: Vec3 = Vec3::new(-0.5, 0.72, 0.7),
        /// Haze, from 2 (after rain) to 10.
        #[schemars(range(min = 2, max = 10))]
        pub turbidity: f32 = 3.0,
        /// Colour of the ground.
        pub ground: Color = Color::opaque(0.18, 0.17, 0.12),
        /// Whether the sun's disc is drawn. Leave it out where a lamp stands for the sun.
        #[serde(rename = "sun")]
        pub has_sun: bool = false,
    }
}

/// Luminances are divided by this many kcd/m², so that a white sheet in the sun is about one.
const WHITE_KCD: f32 = 30.0;

/// Illuminance by the sun above the atmosphere, klx.
const SUN_KLX: f32 = 128.0;

/// Half the sun's angular diameter, radians.
const SUN_RADIUS: f32 = 0.004_65;

impl Sky {
    /// Why this is no sky, or nothing.
    ///
    /// # Errors
    /// A parameter is not finite or outside the model.
    pub fn check(&self) -> Result<()> {
        if !self.to_sun.is_finite() || self.to_sun.try_normalize().is_none() {
            return Err(Error::invalid(format!(
                "the direction to the sun, {}, is no direction; give three finite numbers that are not all zero",
                self.to_sun
            )));
        }
        if !(2.0..=MAX_TURBIDITY).contains(&self.turbidity) {
            return Err(Error::invalid(format!(
                "a turbidity of {} is outside the sky's model; give 2 to {MAX_TURBIDITY}",
                self.turbidity
            )));
        }
        if !self.ground.rgb().is_finite() || self.ground.rgb().min_element() < 0.0 {
            return Err(Error::invalid(format!(
                "the ground's reflectance, {}, must be finite and not negative",
                self.ground.rgb()
            )));
        }
        Ok(())
    }

    /// The sky as a cube with faces of `side` texels. A sun smaller than a texel is spread over one and keeps its light.
    ///
    /// # Errors
    /// As [`Sky::check`] and [`EnvironmentMap::reserve`].
    ///
    /// # Panics
    /// If `side` is zero.
    pub fn to_map(&self, side: u32) -> Result<EnvironmentMap> {
        self.check()?;
        let _held = EnvironmentMap::reserve(EnvironmentForm::Cube, side)?;
        let air = Air::new(self);
        // A plain reflects the mean, weighted by the cosine, of what is above.
        let above = EnvironmentMap::from_function(EnvironmentForm::Cube, 32, |d, _| {
            if d.y > 0.0 { air.sky(d) * d.y } else { Vec3::ZERO }
        });
        let sun_on_plain = air.sun_irradiance() * (air.to_sun.y / PI);
        let ground = self.ground.rgb() * (above.mean(0) * 4.0 + sun_on_plain);
        let texel = 2.0 / side as f32;
        let sun = self.has_sun.then(|| SunDisc::new(&air, SUN_RADIUS.max(0.75 * texel)));
        Ok(EnvironmentMap::from_function(EnvironmentForm::Cube, side, |d, steps| {
            // The horizon runs through texels.
            let half = 0.5 * (steps[0].y.abs() + steps[1].y.abs());
            let share = (0.5 + 0.5 * d.y / half.max(1e-6)).clamp(0.0, 1.0);
            let sky = if share > 0.0 { air.sky(d.with_y(d.y.max(0.0))) } else { Vec3::ZERO };
            let disc = sun.as_ref().map_or(Vec3::ZERO, |sun| sun.mean_over(d, steps));
            ground.lerp(sky + disc, share)
        }))
    }

    /// Colour of a directional light that stands for the sun, linear RGB: what a white diffuse surface that faces it
    /// reflects.
    pub fn sun_color(&self) -> Vec3 {
        Air::new(self).sun_irradiance() / PI
    }
}

/// Perez's distribution `(1 + A e^(B / cos t)) (1 + C e^(D g) + E cos² g)`, `t` from the zenith, `g` from the sun.
struct Perez([f32; 5]);

impl Perez {
    fn at(&self, cos_zenith: f32, cos_sun: f32) -> f32 {
        let [a, b, c, d, e] = self.0;
        let from_sun = cos_sun.clamp(-1.0, 1.0).acos();
        (1.0 + a * (b / cos_zenith).exp()) * (1.0 + c * (d * from_sun).exp() + e * cos_sun * cos_sun)
    }
}

struct Air {
    to_sun: Vec3,
    turbidity: f32,
    /// Of luminance and the chromaticities x and y.
    distributions: [Perez; 3],
    /// Values at the zenith over the distribution there.
    scales: [f32; 3],
}

impl Air {
    fn new(sky: &Sky) -> Self {
        let t = sky.turbidity;
        let to_sun = sky.to_sun.normalize_or(Vec3::Y);
        let to_sun = to_sun.with_y(to_sun.y.max(0.0)).normalize_or(Vec3::X);
        let sun_zenith = to_sun.y.clamp(0.0, 1.0).acos();
        let linear =
            |slopes: [f32; 5], offsets: [f32; 5]| Perez(std::array::from_fn(|i| slopes[i] * t + offsets[i]));
        let distributions = [
            linear([0.1787, -0.3554, -0.0227, 0.1206, -0.0670], [-1.4630, 0.4275, 5.3251, -2.5771, 0.3703]),
            linear([-0.0193, -0.0665, -0.0004, -0.0641, -0.0033], [-0.2592, 0.0008, 0.2125, -0.8989, 0.0452]),
            linear([-0.0167, -0.0950, -0.0079, -0.0441, -0.0109], [-0.2608, 0.0092, 0.2102, -1.6537, 0.0529]),
        ];
        let chi = (4.0 / 9.0 - t / 120.0) * (PI - 2.0 * sun_zenith);
        let luminance = ((4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192).max(0.05);
        let cubic = |rows: [[f32; 4]; 3]| {
            let powers = [sun_zenith.powi(3), sun_zenith.powi(2), sun_zenith, 1.0];
            let of = |row: [f32; 4]| row.iter().zip(powers).map(|(c, p)| c * p).sum::<f32>();
            t * t * of(rows[0]) + t * of(rows[1]) + of(rows[2])
        };
        let x = cubic([
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ]);
        let y = cubic([
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ]);
        let zenith = [luminance, x, y];
        let scales = std::array::from_fn(|i| zenith[i] / distributions[i].at(1.0, to_sun.y));
        Self { to_sun, turbidity: t, distributions, scales }
    }

    /// Linear RGB of the sky in a unit direction that is not below the horizon.
    fn sky(&self, d: Vec3) -> Vec3 {
        let cos_zenith = d.y.max(0.01);
        let cos_sun = d.dot(self.to_sun);
        let [luminance, x, y] =
            std::array::from_fn(|i| self.scales[i] * self.distributions[i].at(cos_zenith, cos_sun));
        let xyz = Vec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance.max(0.0);
        (linear_rgb_from_xyz() * xyz / WHITE_KCD).max(Vec3::ZERO)
    }

    /// Irradiance of a surface that faces the sun, linear RGB: Preetham's attenuation by molecules (Rayleigh) and haze
    /// (Ångström) over the optical mass of F. Kasten (1966), at 650, 570 and 475 nm.
    fn sun_irradiance(&self) -> Vec3 {
        let zenith_degrees = self.to_sun.y.clamp(0.0, 1.0).acos().to_degrees();
        let mass = 1.0 / (self.to_sun.y + 0.15 * (93.885 - zenith_degrees).powf(-1.253));
        let haze = 0.046_08 * self.turbidity - 0.045_86;
        let left = [0.65_f32, 0.57, 0.475].map(|micrometres| {
            (-0.008_735 * micrometres.powf(-4.08) * mass - haze * micrometres.powf(-1.3) * mass).exp()
        });
        Vec3::from(left) * (SUN_KLX / WHITE_KCD)
    }
}

/// A disc of even light with the sun's irradiance.
struct SunDisc {
    to_sun: Vec3,
    cos_radius: f32,
    radiance: Vec3,
}

impl SunDisc {
    fn new(air: &Air, radius: f32) -> Self {
        // 2 pi (1 - cos r), with its digits.
        let steradians = 4.0 * PI * (0.5 * radius).sin().powi(2);
        let radiance = air.sun_irradiance() / steradians;
        Self { to_sun: air.to_sun, cos_radius: radius.cos(), radiance }
    }

    fn mean_over(&self, d: Vec3, steps: [Vec3; 2]) -> Vec3 {
        const SUB: u32 = 8;
        let reach = self.cos_radius.acos() + steps[0].length() + steps[1].length();
        if d.dot(self.to_sun) < reach.cos() {
            return Vec3::ZERO;
        }
        let offset = |i: u32| (i as f32 + 0.5) / SUB as f32 - 0.5;
        let hits = (0..SUB * SUB).filter(|i| {
            let at = d + steps[0] * offset(i % SUB) + steps[1] * offset(i / SUB);
            at.normalize_or(d).dot(self.to_sun) >= self.cos_radius
        });
        self.radiance * (hits.count() as f32 / (SUB * SUB) as f32)
    }
}

/// IEC 61966-2-1.
fn linear_rgb_from_xyz() -> Mat3 {
    Mat3::from_cols(
        Vec3::new(3.2406, -0.9689, 0.0557),
        Vec3::new(-1.5372, 1.8758, -0.2040),
        Vec3::new(-0.4986, 0.0415, 1.0570),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clear_sky_is_blue_above_and_brightest_at_the_sun() {
        let sky = Sky { to_sun: Vec3::new(0.0, 0.6, -0.8), ..Sky::default() };
        let map = sky.to_map(64).unwrap();
        let at = |d: Vec3| map.sample(d, [Vec3::ZERO; 2]);
        let away = at(Vec3::new(0.0, 0.8, 0.6));
        assert!(away.z > 1.3 * away.x, "{away}");
        assert!(at(sky.to_sun).y > 2.0 * away.y);
        assert!(at(Vec3::NEG_Y).max_element() < at(Vec3::new(1.0, 0.05, 0.0)).max_element());
    }
}
