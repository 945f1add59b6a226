//! Fill layers that show a texture graph.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_cover::NOBODY;
use fantex_texture::Texture;
use glam::Vec4;
use serde::{Deserialize, Serialize};

use super::{LayerContent, Layers};
use crate::tile_paint::{Rect, TexelPage, shade};
use crate::{PaintError, Surface, TextureGraph};

/// Textures of a graph, one per channel of the asset.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GraphFill {
    /// Where they are defined.
    pub graph: TextureGraph,
    /// Their names; none where the layer does not show in a channel. Channels beyond the list have none.
    pub textures: Vec<Option<String>>,
}

/// The textures of all layers that are shown, ready to be asked.
#[derive(Clone, Debug, Default)]
pub(crate) struct FillTextures {
    layers: BTreeMap<u64, (GraphFill, Vec<Option<Arc<dyn Texture>>>)>,
}

impl FillTextures {
    /// Makes what is missing and drops what is no longer shown.
    pub(crate) fn update(&mut self, surface: &Surface, layers: &Layers) -> Result<(), PaintError> {
        let mut known = std::mem::take(&mut self.layers);
        for layer in layers.stack.iter().filter(|layer| layer.visible && layer.opacity > 0.0) {
            let LayerContent::Graph(fill) = &layer.content else { continue };
            let made = match known.remove(&layer.id()) {
                Some((before, textures)) if before == *fill => textures,
                _ => {
                    let texture = |name: &Option<String>| {
                        name.as_ref().map(|name| fill.graph.texture(surface, name)).transpose()
                    };
                    let textures = fill.textures.iter().map(texture).collect::<Result<_, _>>();
                    textures.map_err(|source| {
                        let layer = layer.name.clone();
                        PaintError::Graph { layer, source: Box::new(source) }
                    })?
                }
            };
            self.layers.insert(layer.id(), (fill.clone(), made));
        }
        Ok(())
    }

    /// Values in a rectangle of a page, per channel and texel (transparent elsewhere); `is_hidden` says where none are needed.
    pub(crate) fn values(
        &self,
        surface: &Surface,
        layer: u64,
        map: &TexelPage,
        rect: Rect,
        is_hidden: impl Fn(usize) -> bool,
    ) -> Vec<Vec<Vec4>> {
        let Some((_, textures)) = self.layers.get(&layer) else { return Vec::new() };
        let width = map.block.extent[0];
        let mut values = vec![Vec::new(); textures.len()];
        for (values, texture) in values.iter_mut().zip(textures) {
            let Some(texture) = texture else { continue };
            values.resize(map.owner.len(), Vec4::ZERO);
            for (x, y) in rect.texels() {
                let texel = (y * width + x) as usize;
                let owner = map.owner[texel];
                if owner != NOBODY && !is_hidden(texel) {
                    let triangle = &map.triangles[owner as usize];
                    let lambda = map.lambda(triangle, x, y);
                    values[texel] = shade(surface, triangle, lambda, |point| texture.evaluate(point));
                }
            }
        }
        values
    }
}
