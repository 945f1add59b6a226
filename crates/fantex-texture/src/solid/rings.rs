//! Rings about an axis, by the textbook's recipe for wood (D. R. Peachey, "Solid Texturing of Complex Surfaces", 1985).

use fantex_base::parameters;
use glam::{Quat, Vec3};

use super::{Recipe, Solid, SolidPoint, opaque};
use crate::{Allowed, Color};

parameters! {
    /// Rings about the y axis: light where `round(radius) mod period` is below `light_units`, else dark. The radius, in units, is
    /// `sqrt(x^2 + z^2) / unit + eccentricity sin(lobes angle + twist y)`, after the axis was tilted.
    #[derive(Copy)]
    pub struct Rings {
        /// Length of a unit of the radius.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub unit: f32 = 0.01,
        /// Units after which the rings repeat.
        #[schemars(range(min = 1))]
        pub period: u32 = 12,
        /// Units of a period that are light.
        pub light_units: u32 = 8,
        /// Units by which the radius waves around the axis.
        pub eccentricity: f32 = 0.0,
        /// Waves around the axis.
        pub lobes: f32 = 20.0,
        /// Turn of the waves along the axis, radians per unit of the place.
        pub twist: f32 = 0.0,
        /// Angle between the axis and y, in degrees.
        pub tilt: f64 = 0.0,
        /// Colour of the light units.
        pub light: Color = Color::opaque(0.56, 0.31, 0.13),
        /// Colour of the others.
        pub dark: Color = Color::opaque(0.20, 0.075, 0.022),
    }
}

impl Recipe for Rings {
    type Solid = Self;

    fn prepared(&self, _seed: u32) -> Self {
        *self
    }

    fn check(&self) -> fantex_base::Result<()> {
        Allowed::Positive.check("rings", "the unit", &[self.unit])?;
        Allowed::Positive.check("rings", "the period", &[self.period as f32])?;
        let numbers = [self.eccentricity, self.lobes, self.twist, self.tilt as f32];
        Allowed::Finite.check("rings", "a number", &numbers)?;
        Allowed::NotNegative.check("rings", "colour", &self.light.rgb().to_array())?;
        Allowed::NotNegative.check("rings", "colour", &self.dark.rgb().to_array())
    }
}

impl Solid for Rings {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        assert_eq!(at.len(), colors.len(), "one colour for every point");
        let upright = Quat::from_rotation_z(self.tilt.to_radians() as f32);
        for (at, color) in at.iter().zip(colors) {
            let Vec3 { x, y, z } = upright * at.p;
            let wave = self.eccentricity * (self.lobes * x.atan2(z) + self.twist * y).sin();
            let radius = x.hypot(z) / self.unit + wave;
            // Rounding cuts at halves.
            let share = self.light_share(radius + 0.5, at.footprint / self.unit);
            *color = opaque(self.dark.rgb().lerp(self.light.rgb(), share));
        }
    }
}

impl Rings {
    /// The light part of an interval of the radius.
    fn light_share(&self, center: f32, width: f32) -> f32 {
        let (period, light) = (f64::from(self.period), f64::from(self.light_units.min(self.period)));
        let center = f64::from(center);
        if width < 1e-4 {
            return f32::from(u8::from(center.floor().rem_euclid(period) < light));
        }
        let up_to = |radius: f64| {
            let rings = (radius / period).floor();
            rings * light + (radius - rings * period).min(light)
        };
        let half = 0.5 * f64::from(width);
        ((up_to(center + half) - up_to(center - half)) / f64::from(width)) as f32
    }
}
