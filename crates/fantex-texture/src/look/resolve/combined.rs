//! Textures made of other textures, and numbers of the surface.

use std::sync::Arc;

use fantex_look::Key;
use fantex_look::data::{
    CombineName, CombineTable, ContoursTable, DistanceTable, HeightTable, LayerName, LayerTable, LayersTable,
    MathTable, MixTable, PlacedTable, RampTable, RemapTable, SlopeTable, SwizzleTable, TextureTable,
};

use super::convert::{self, linear_color, vec3};
use super::{Made, Resolver};
use crate::Texture;
use crate::combine::{
    Binary, Channel, Combine, Contours, Field, Layer, LayerMode, Layers, LineWidth, Mix, RampTexture, Remap,
    Swizzle,
};
use crate::coordinates::{InSpace, Parameter};

type Node = Arc<dyn Texture>;

impl Resolver<'_> {
    pub(super) fn ramp(&mut self, table: &RampTable, key: &Key) -> Made<Node> {
        let ramp = self.accept(&key.name("stops"), convert::ramp(&table.stops, table.interpolation))?;
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
            mode: convert::combine_mode(table.mode),
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
        let combined = |mode| LayerMode::Combine { mode: convert::combine_mode(mode), constant };
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
        Ok(Arc::new(Binary { operation: convert::operation(table.operation), a, b }))
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
        Ok(Arc::new(Swizzle { input, channels: table.channels.map(convert::channel_name) }))
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
