//! Noise, waves and solids.

use std::f32::consts::TAU;
use std::sync::Arc;

use fantex_look::Key;
use fantex_look::data::{
    BrickTable, CheckerTable, CloudsTable, FractalName, GraniteTable, LandscapeTable, MarbleTable,
    MetricName, NoiseName, NoiseTable, PlaceTable, RockTable, SinesTable, WaveTable, WoodTable,
};
use glam::{Vec3, Vec4};

use super::convert::{linear_rgb, vec3};
use super::{Made, Resolver};
use crate::coordinates::InSpace;
use crate::look::Slot;
use crate::noise::{CellularMetric, Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, Wave, Waves};
use crate::{
    Allowed, Brick, Checker, Clouds, Granite, Landscape, Marble, NoiseTexture, Rock, ShadingPoint,
    SolidPoint, SolidTexture, Texture, WavesTexture, Wood,
};

type Node = Arc<dyn Texture>;

/// The face of a brick wall as a relief.
struct BrickRelief(Brick);

impl Texture for BrickRelief {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let point = SolidPoint { p: at.position, n: at.normal, footprint: at.width(), time: at.time };
        Vec3::splat(self.0.height(&point)).extend(1.0)
    }
}

impl Resolver<'_> {
    fn seed(&self, seed: u32) -> u32 {
        self.options.seed.wrapping_add(seed)
    }

    /// A texture of its own space, in the object's.
    fn in_place(&self, texture: impl Texture + 'static, place: &PlaceTable, key: &Key) -> Made<Node> {
        let matrix = self.place(place, &key.name("place"))?;
        Ok(Arc::new(InSpace { input: Slot::Texture(Arc::new(texture)), matrix }))
    }

    pub(super) fn noise(&self, table: &NoiseTable, key: &Key) -> Made<Node> {
        let octaves =
            Fractal { octaves: table.octaves, lacunarity: table.lacunarity as f32, gain: table.gain as f32 };
        let kind = match table.fractal {
            FractalName::None => FractalKind::Single,
            FractalName::Fbm => FractalKind::Fbm,
            FractalName::Turbulence => FractalKind::Turbulence,
            FractalName::Ridged => FractalKind::Ridged,
        };
        let seed = self.seed(table.seed);
        let noise = FractalNoise::new(family(table), kind, octaves, seed);
        let texture = NoiseTexture {
            warp: table.warp as f32,
            warp_noise: Noise::new(seed ^ 0x1b87_3593),
            amplitude: table.amplitude as f32,
            offset: table.offset as f32,
            speed: table.evolve as f32,
            ..NoiseTexture::new(noise, table.cell as f32)
        };
        self.accept(key, texture.validate())?;
        self.in_place(texture, &table.place, key)
    }

    pub(super) fn sines(&self, table: &SinesTable, key: &Key) -> Made<Node> {
        let waves = table.waves.iter().enumerate().map(|(index, wave)| {
            let at = key.name("waves").index(index).name("direction");
            let direction = vec3(wave.direction);
            let length =
                Allowed::Positive.check("a wave", "the length of the direction", &[direction.length()]);
            self.accept(&at, length)?;
            Ok(wave_along(direction.normalize(), wave))
        });
        let waves = Waves(waves.collect::<Made<_>>()?);
        self.in_place(WavesTexture { waves, offset: table.offset as f32 }, &table.place, key)
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
        self.in_place(SolidTexture(wood), &table.place, key)
    }

    pub(super) fn marble(&self, table: &MarbleTable, key: &Key) -> Made<Node> {
        let mut marble = Marble::new(self.seed(table.seed));
        marble.frequency = table.frequency as f32;
        marble.warp = table.warp as f32;
        marble.stone = linear_rgb(table.stone);
        marble.cloud = linear_rgb(table.cloud);
        marble.vein = linear_rgb(table.vein);
        self.in_place(SolidTexture(marble), &table.place, key)
    }

    pub(super) fn clouds(&self, table: &CloudsTable, key: &Key) -> Made<Node> {
        let mut clouds = Clouds::new(self.seed(table.seed));
        clouds.size = table.size as f32;
        clouds.cover = table.cover as f32;
        clouds.softness = table.softness as f32;
        clouds.speed = table.speed as f32;
        clouds.sky = linear_rgb(table.sky);
        clouds.cloud = linear_rgb(table.cloud);
        clouds.sky_alpha = table.sky_alpha as f32;
        self.accept(key, clouds.validate())?;
        self.in_place(SolidTexture(clouds), &table.place, key)
    }

    pub(super) fn granite(&self, table: &GraniteTable, key: &Key) -> Made<Node> {
        let mut granite = Granite::new(self.seed(table.seed));
        granite.grain = table.grain as f32;
        granite.feldspar = linear_rgb(table.feldspar);
        granite.quartz = linear_rgb(table.quartz);
        granite.mica = linear_rgb(table.mica);
        self.accept(key, granite.validate())?;
        self.in_place(SolidTexture(granite), &table.place, key)
    }

    pub(super) fn rock(&self, table: &RockTable, key: &Key) -> Made<Node> {
        let mut rock = Rock::new(self.seed(table.seed));
        rock.frequency = table.frequency as f32;
        rock.folding = table.folding as f32;
        self.in_place(SolidTexture(rock), &table.place, key)
    }

    pub(super) fn checker(&self, table: &CheckerTable, key: &Key) -> Made<Node> {
        let (even, odd) = (linear_rgb(table.even), linear_rgb(table.odd));
        let checker = Checker { cell: table.cell as f32, even, odd };
        self.accept(key, checker.validate())?;
        self.in_place(SolidTexture(checker), &table.place, key)
    }

    pub(super) fn brick(&self, table: &BrickTable, key: &Key) -> Made<Node> {
        let mut brick = Brick::new(self.seed(table.seed));
        brick.size = vec3(table.size.map(|length| length.0));
        brick.mortar_width = table.mortar_width as f32;
        brick.shift = table.shift as f32;
        brick.brick = linear_rgb(table.brick);
        brick.mortar = linear_rgb(table.mortar);
        brick.variation = table.variation as f32;
        self.accept(key, brick.validate())?;
        match table.relief {
            true => self.in_place(BrickRelief(brick), &table.place, key),
            false => self.in_place(SolidTexture(brick), &table.place, key),
        }
    }

    pub(super) fn landscape(&self, table: &LandscapeTable, key: &Key) -> Made<Node> {
        let half_height = (0.5 * (self.bounds.max.y - self.bounds.min.y) / self.radius()).max(1e-6);
        let mut landscape = Landscape::new(self.seed(table.seed), half_height);
        landscape.sand_line = table.sand_line as f32;
        landscape.snow_line = table.snow_line as f32;
        self.in_place(SolidTexture(landscape), &table.place, key)
    }
}

fn family(table: &NoiseTable) -> NoiseFamily {
    let metric = match table.metric {
        MetricName::Euclidean => CellularMetric::Euclidean,
        MetricName::Manhattan => CellularMetric::Manhattan,
        MetricName::Chebyshev => CellularMetric::Chebyshev,
    };
    match table.family {
        NoiseName::Perlin => NoiseFamily::Perlin,
        NoiseName::Simplex => NoiseFamily::Simplex,
        NoiseName::Cellular => NoiseFamily::Cellular(metric),
        NoiseName::CellularBorders => NoiseFamily::CellularBorders(metric),
        NoiseName::CellularIds => NoiseFamily::CellularIds(metric),
        NoiseName::White => NoiseFamily::White,
    }
}

/// Crests run against the direction's way where the speed is positive in phase, so the angular speed is negative: the wave
/// moves along its direction.
fn wave_along(direction: Vec3, wave: &WaveTable) -> Wave {
    Wave {
        wave_vector: direction * (TAU / wave.length as f32),
        amplitude: wave.amplitude as f32,
        phase: wave.phase.to_radians() as f32,
        angular_speed: -TAU * wave.speed as f32,
    }
}
