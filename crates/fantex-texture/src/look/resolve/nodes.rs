//! Textures without files: solids, noise, what is made of other textures, numbers of the surface.

use std::f32::consts::TAU;
use std::sync::Arc;

use fantex_look::Key;
use fantex_look::data::{
    BrickTable, CheckerTable, CloudsTable, CombineName, CombineTable, ContoursTable, DistanceTable,
    FractalName, GraniteTable, HeightTable, LandscapeTable, LayerName, LayerTable, LayersTable, MarbleTable,
    MathTable, MetricName, MixTable, NoiseName, NoiseTable, PlaceTable, PlacedTable, PolygonTable,
    PolygonsTable, RampTable, RemapTable, RockTable, SinesTable, SlopeTable, SwizzleTable, TextureTable,
    WaveTable, WoodTable,
};
use glam::{Vec3, Vec4};

use super::{Made, Resolver, linear_color, linear_rgb, vec2, vec3};
use crate::combine::{
    Binary, Channel, Combine, Contours, Field, Layer, LayerMode, Layers, LineWidth, Mix, RampTexture, Remap,
    Swizzle,
};
use crate::coordinates::{InSpace, Parameter};
use crate::look::Slot;
use crate::noise::{CellularMetric, Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, Wave, Waves};
use crate::{
    Allowed, Brick, Checker, Clouds, DetailPolygon, Granite, Landscape, Marble, NoiseTexture,
    PolygonsTexture, Rock, ShadingPoint, SolidPoint, SolidTexture, Texture, WavesTexture, Wood,
};

// Textures made of other textures, and numbers of the surface.

type Node = Arc<dyn Texture>;

impl Resolver<'_> {
    pub(super) fn ramp(&mut self, table: &RampTable, key: &Key) -> Made<Node> {
        let ramp = self.accept(&key.name("stops"), super::ramp(&table.stops, table.interpolation))?;
        let input = self.input(&table.input, &key.name("input"))?;
        Ok(Arc::new(RampTexture { input, channel: Channel::Red, ramp: Arc::new(ramp) }))
    }

    pub(super) fn contours(&mut self, table: &ContoursTable, key: &Key) -> Made<Node> {
        let contours = Contours {
            input: self.input(&table.input, &key.name("input"))?,
            channel: Channel::Red,
            spacing: table.spacing as f32,
            offset: table.offset as f32,
            width: match table.width {
                Some(width) => LineWidth::Input(width as f32),
                None => LineWidth::Pixels(table.pixels as f32),
            },
            color: self.input(&table.color, &key.name("color"))?,
            over: self.input(&table.over, &key.name("over"))?,
        };
        self.accept(key, contours.check())?;
        Ok(Arc::new(contours))
    }

    pub(super) fn combine(&mut self, table: &CombineTable, key: &Key) -> Made<Node> {
        let combine = Combine {
            mode: super::combine_mode(table.mode),
            texture: self.input(&table.texture, &key.name("texture"))?,
            fragment: self.input(&table.fragment, &key.name("fragment"))?,
            constant: linear_color(table.constant),
        };
        self.accept(key, combine.check())?;
        Ok(Arc::new(combine))
    }

    pub(super) fn layers(&mut self, table: &LayersTable, key: &Key) -> Made<Node> {
        let base = self.input(&table.base, &key.name("base"))?;
        let layers = &table.layers;
        let layers =
            layers.iter().enumerate().map(|(i, layer)| self.layer(layer, &key.name("layers").index(i)));
        let layers = layers.collect::<Made<Vec<Layer>>>()?;
        Ok(Arc::new(Layers { base, layers }))
    }

    fn layer(&mut self, table: &LayerTable, key: &Key) -> Made<Layer> {
        let constant = linear_color(table.constant);
        let combined = |mode| LayerMode::Combine { mode: super::combine_mode(mode), constant };
        Ok(Layer {
            texture: self.input(&table.texture, &key.name("texture"))?,
            mode: match table.mode {
                LayerName::Over => LayerMode::Over,
                LayerName::Replace => combined(CombineName::Replace),
                LayerName::Modulate => combined(CombineName::Modulate),
                LayerName::Decal => combined(CombineName::Decal),
                LayerName::Blend => combined(CombineName::Blend),
            },
            mask: self.input(&table.mask, &key.name("mask"))?,
            opacity: self.input(&table.opacity, &key.name("opacity"))?,
        })
    }

    pub(super) fn mix(&mut self, table: &MixTable, key: &Key) -> Made<Node> {
        let a = self.input(&table.a, &key.name("a"))?;
        let b = self.input(&table.b, &key.name("b"))?;
        Ok(Arc::new(Mix { a, b, mask: self.input(&table.mask, &key.name("mask"))? }))
    }

    pub(super) fn math(&mut self, table: &MathTable, key: &Key) -> Made<Node> {
        let a = self.input(&table.a, &key.name("a"))?;
        let b = self.input(&table.b, &key.name("b"))?;
        Ok(Arc::new(Binary { operation: super::operation(table.operation), a, b }))
    }

    pub(super) fn remap(&mut self, table: &RemapTable, key: &Key) -> Made<Node> {
        let [from, to] = [table.from, table.to].map(|range| range.map(|n| n as f32));
        let input = self.input(&table.input, &key.name("input"))?;
        let remap = Remap { input, from, to, clamp: table.clamp };
        self.accept(key, remap.check())?;
        Ok(Arc::new(remap))
    }

    pub(super) fn swizzle(&mut self, table: &SwizzleTable, key: &Key) -> Made<Node> {
        let input = self.input(&table.input, &key.name("input"))?;
        Ok(Arc::new(Swizzle { input, channels: table.channels.map(super::channel_name) }))
    }

    pub(super) fn placed(&mut self, table: &PlacedTable, key: &Key) -> Made<Node> {
        let input = self.input(&table.texture, &key.name("texture"))?;
        Ok(Arc::new(InSpace { input, matrix: self.place(&table.place, &key.name("place"))? }))
    }

    /// Without an origin, from 0 to 1 over the bounding box along the direction.
    pub(super) fn height(&mut self, table: &HeightTable, key: &Key) -> Made<Node> {
        let direction = vec3(table.direction).normalize_or_zero();
        let parameter = match table.origin {
            Some(origin) => {
                Parameter::Along { origin: vec3(origin), direction: direction / table.unit as f32 }
            }
            None => {
                let reach = direction.abs().dot(self.extent());
                Parameter::Along {
                    origin: self.bounds.center() - direction * (0.5 * reach),
                    direction: direction / reach.max(f32::MIN_POSITIVE),
                }
            }
        };
        self.parameter(parameter, &key.name("direction"))
    }

    pub(super) fn distance(&mut self, table: &DistanceTable, key: &Key) -> Made<Node> {
        self.parameter(Parameter::Distance { center: vec3(table.center) }, key)
    }

    pub(super) fn slope(&mut self, table: &SlopeTable, key: &Key) -> Made<Node> {
        self.parameter(Parameter::Slope { up: vec3(table.up) }, &key.name("up"))
    }

    fn parameter(&self, parameter: Parameter, key: &Key) -> Made<Node> {
        self.accept(key, parameter.check())?;
        Ok(Arc::new(parameter))
    }

    /// The kinds without numbers of their own.
    pub(super) fn field(&self, table: &TextureTable) -> Node {
        match table {
            TextureTable::Facing(_) => Arc::new(Parameter::Facing),
            TextureTable::Time(_) => Arc::new(Parameter::Time),
            TextureTable::Normal(_) => Arc::new(Field::Normal),
            TextureTable::Uv(table) => Arc::new(Field::Uv { set: table.set as usize }),
            TextureTable::Position(_) => {
                let (center, half) = (self.bounds.center(), 0.5 * self.extent());
                Arc::new(Field::Position { min: center - half, max: center + half })
            }
            _ => Arc::new(Field::VertexColor),
        }
    }
}

// Noise, waves and solids.

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

// Polygons.

impl Resolver<'_> {
    pub(super) fn polygons(&mut self, table: &PolygonsTable, key: &Key) -> Made<Arc<dyn Texture>> {
        let list = key.name("polygons");
        let polygons: Vec<DetailPolygon> = (0..).zip(&table.polygons).map(polygon).collect();
        let colors = table.polygons.iter().enumerate();
        let colors = colors.map(|(i, polygon)| self.input(&polygon.color, &list.index(i).name("color")));
        let colors = colors.collect::<Made<Vec<_>>>()?;
        let base = self.input(&table.base, &key.name("base"))?;
        let place = (
            self.coordinates(&table.coordinates, &key.name("coordinates"))?,
            self.matrix(&table.matrix, &key.name("matrix"))?,
        );
        let texture = PolygonsTexture::new(&polygons, colors, base, place, table.repeat);
        Ok(Arc::new(self.accept(&list, texture)?))
    }
}

fn polygon((material, table): (u32, &PolygonTable)) -> DetailPolygon {
    let outlines = table.outlines.iter().map(|outline| outline.iter().map(|&corner| vec2(corner)).collect());
    DetailPolygon { outlines: outlines.collect(), material, priority: table.priority }
}
