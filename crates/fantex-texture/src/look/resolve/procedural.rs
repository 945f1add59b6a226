//! Noise and solids.

use std::sync::Arc;

use fantex_look::Key;
use fantex_look::data::{
    FractalName, LandscapeTable, MarbleTable, NoiseTable, PlaceTable, RockTable, WoodTable,
};
use glam::{Vec3, Vec4};

use super::convert::linear_rgb;
use super::{Made, Resolver};
use crate::coordinates::InSpace;
use crate::look::Slot;
use crate::noise::{Fractal, Noise};
use crate::{Landscape, Marble, Rock, ShadingPoint, Solid, SolidPoint, Texture, Wood};

type Node = Arc<dyn Texture>;

/// A solid at the position.
struct SolidTexture<S>(S);

impl<S: Solid> Texture for SolidTexture<S> {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec4::from_array(self.0.color(&SolidPoint { p: at.position, n: at.normal, footprint: at.width() }))
    }
}

struct NoiseTexture {
    noise: Noise,
    fractal: Fractal,
    sum: FractalName,
    per_unit: f32,
    amplitude: f32,
    offset: f32,
}

impl Texture for NoiseTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (p, footprint) = (at.position * self.per_unit, at.width() * self.per_unit);
        let value = match self.sum {
            FractalName::None | FractalName::Fbm => self.noise.fbm(p, self.fractal, footprint),
            FractalName::Turbulence => self.noise.turbulence(p, self.fractal, footprint),
            FractalName::Ridged => self.noise.ridged(p, self.fractal, footprint),
        };
        Vec3::splat(self.offset + self.amplitude * value).extend(1.0)
    }
}

impl Resolver<'_> {
    fn seed(&self, seed: u32) -> u32 {
        self.options.seed.wrapping_add(seed)
    }

    /// A texture of its own space, in the object's.
    fn placed_solid(&self, texture: impl Texture + 'static, place: &PlaceTable, key: &Key) -> Made<Node> {
        let matrix = self.place(place, &key.name("place"))?;
        Ok(Arc::new(InSpace { input: Slot::Texture(Arc::new(texture)), matrix }))
    }

    pub(super) fn noise(&self, table: &NoiseTable, key: &Key) -> Made<Node> {
        let octaves = if table.fractal == FractalName::None { 1 } else { table.octaves };
        let texture = NoiseTexture {
            noise: Noise::new(self.seed(table.seed)),
            fractal: Fractal { octaves, lacunarity: table.lacunarity as f32, gain: table.gain as f32 },
            sum: table.fractal,
            per_unit: 1.0 / table.cell as f32,
            amplitude: table.amplitude as f32,
            offset: table.offset as f32,
        };
        self.placed_solid(texture, &table.place, key)
    }

    pub(super) fn wood(&self, table: &WoodTable, key: &Key) -> Made<Node> {
        let mut wood = Wood::new(self.seed(table.seed));
        wood.period = table.ring as f32;
        wood.eccentricity = table.eccentricity as f32;
        wood.twist = table.twist as f32;
        wood.tilt = table.tilt.to_radians() as f32;
        wood.wobble = table.wobble as f32;
        wood.grain = table.grain as f32;
        wood.early = linear_rgb(table.early);
        wood.late = linear_rgb(table.late);
        self.placed_solid(SolidTexture(wood), &table.place, key)
    }

    pub(super) fn marble(&self, table: &MarbleTable, key: &Key) -> Made<Node> {
        self.placed_solid(SolidTexture(Marble::new(self.seed(table.seed))), &table.place, key)
    }

    pub(super) fn rock(&self, table: &RockTable, key: &Key) -> Made<Node> {
        self.placed_solid(SolidTexture(Rock::new(self.seed(table.seed))), &table.place, key)
    }

    pub(super) fn landscape(&self, table: &LandscapeTable, key: &Key) -> Made<Node> {
        let half_height = (0.5 * (self.bounds.max.y - self.bounds.min.y) / self.radius()).max(1e-6);
        let landscape = Landscape::new(self.seed(table.seed), half_height);
        self.placed_solid(SolidTexture(landscape), &table.place, key)
    }
}
