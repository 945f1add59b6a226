//! Layers: any number of them over what was baked.
//!
//! ```text
//!  layers/base/PAGE      the page's bytes under all layers     --.
//!  layers/ID/PAGE        straight linear RGBA per channel, f16   |-- flatten --> the page that everybody reads
//!  layers/ID/mask/PAGE   one f16 per texel                     --'
//!  layers/index          what there is, from the bottom to the top
//! ```
//!
//! All are attachments of the asset, and the asset's own texels are the flattened result: readers that know nothing of layers
//! show what the painter sees. Only pages of level 0 on which something was painted are kept; coarser levels are made of the
//! flattened texels. Blending follows [`BlendMode`](crate::BlendMode), from the bottom to the top.

mod edit;
mod flatten;
mod graph;
mod page;
mod stroke;

use std::path::{Path, PathBuf};

use fantex_store::{AssetEditor, PageId};
use glam::Vec4;
use serde::{Deserialize, Serialize};

pub(crate) use flatten::{LayerStack, base_bytes, flatten};
pub(crate) use graph::FillTextures;
pub use graph::GraphFill;
pub(crate) use page::{decode_mask, decode_values, encode_mask, encode_values};
pub(crate) use stroke::{LayeredPage, ShownPage, target_name};

use crate::folders::{found_folder, kept_folder};
use crate::{BlendMode, PaintError};

pub(crate) const INDEX: &str = "layers/index";

/// What a layer shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LayerContent {
    /// What was painted on it.
    Painted,
    /// The same linear RGBA everywhere, one per channel of the asset; its mask says where.
    Fill(Vec<[f32; 4]>),
    /// A texture graph, evaluated where the layer is shown, whenever the graph, the density or the level changes.
    Graph(GraphFill),
}

/// One layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Names its pages; never used twice.
    id: u64,
    /// What the user calls it.
    pub name: String,
    /// Shown at all.
    pub visible: bool,
    /// 0..1.
    pub opacity: f32,
    /// How it lies over what is below.
    pub blend: BlendMode,
    /// Which channels of the asset it shows in; those beyond the list count as shown.
    pub channels: Vec<bool>,
    /// What it shows.
    pub content: LayerContent,
    /// Outside of what was painted on its mask: 1 shows the layer, 0 hides it. None: no mask.
    pub mask: Option<f32>,
}

impl Layer {
    /// An empty, opaque layer to paint on.
    pub fn painted(name: &str) -> Self {
        Self {
            id: 0,
            name: name.to_owned(),
            visible: true,
            opacity: 1.0,
            blend: BlendMode::Normal,
            channels: Vec::new(),
            content: LayerContent::Painted,
            mask: None,
        }
    }

    /// A layer of one colour per channel, hidden until its mask is painted.
    pub fn fill(name: &str, colors: &[Vec4]) -> Self {
        let content = LayerContent::Fill(colors.iter().map(|color| color.to_array()).collect());
        Self { content, mask: Some(0.0), ..Self::painted(name) }
    }

    /// A layer that shows a texture graph everywhere.
    pub fn graph(name: &str, fill: GraphFill) -> Self {
        Self { content: LayerContent::Graph(fill), ..Self::painted(name) }
    }

    /// Its number, which stays as long as it lives.
    pub fn id(&self) -> u64 {
        self.id
    }

    pub(crate) fn shows(&self, channel: usize) -> bool {
        self.visible && self.opacity > 0.0 && self.channels.get(channel).copied().unwrap_or(true)
    }
}

/// What a stroke paints on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Target {
    /// What lies under all layers.
    #[default]
    Base,
    /// A layer, by its number.
    Layer(u64),
    /// A layer's mask: the luminance of the first channel's colour, 0 hides and 1 shows.
    Mask(u64),
}

/// All layers, from the bottom to the top.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Layers {
    pub(crate) next_id: u64,
    pub(crate) stack: Vec<Layer>,
}

impl Layers {
    pub(crate) fn load(editor: &AssetEditor) -> Result<Self, PaintError> {
        let Some(bytes) = editor.attachment(INDEX)? else { return Ok(Self::default()) };
        let path = editor.asset().path();
        let mut layers: Self = serde_json::from_slice(&bytes)
            .map_err(|_| PaintError::Layers { path: path.to_owned(), reason: "their list cannot be read" })?;
        find_folders(&mut layers.stack, path);
        Ok(layers)
    }

    /// As they are kept in an asset.
    pub(crate) fn encoded(&self, asset: &Path) -> Result<Vec<u8>, PaintError> {
        let mut layers = self.clone();
        keep_folders(&mut layers.stack, asset);
        Ok(serde_json::to_vec(&layers).map_err(std::io::Error::other)?)
    }

    pub(crate) fn find(&self, id: u64) -> Option<&Layer> {
        self.stack.iter().find(|layer| layer.id == id)
    }

    /// Puts a layer on top and returns its number.
    pub(crate) fn add(&mut self, mut layer: Layer) -> u64 {
        layer.id = self.next_id;
        self.next_id += 1;
        self.stack.push(layer);
        self.next_id - 1
    }
}

/// Folders of looks as an asset keeps them.
pub(crate) fn keep_folders(stack: &mut [Layer], asset: &Path) {
    change_folders(stack, |folder| kept_folder(asset, folder));
}

/// Folders that were kept in an asset, absolute.
pub(crate) fn find_folders(stack: &mut [Layer], asset: &Path) {
    change_folders(stack, |folder| found_folder(asset, folder));
}

fn change_folders(stack: &mut [Layer], change: impl Fn(&Path) -> PathBuf) {
    for layer in stack {
        if let LayerContent::Graph(fill) = &mut layer.content {
            fill.graph.folder = change(&fill.graph.folder);
        }
    }
}

fn page_suffix(id: PageId) -> String {
    format!("{:010}/{:05}/{:05}", id.group, id.page[1], id.page[0])
}

/// The page that a name stands for, after its prefix.
pub(crate) fn page_of_suffix(suffix: &str) -> Option<PageId> {
    let mut numbers = suffix.split('/').map(|number| number.parse::<u32>().ok());
    let (group, y, x) = (numbers.next()??, numbers.next()??, numbers.next()??);
    numbers.next().is_none().then_some(PageId { group, level: 0, page: [x, y] })
}

pub(crate) const BASE_PREFIX: &str = "layers/base/";

pub(crate) fn base_name(id: PageId) -> String {
    format!("{BASE_PREFIX}{}", page_suffix(id))
}

pub(crate) fn layer_prefix(layer: u64) -> String {
    format!("layers/{layer:010}/page/")
}

pub(crate) fn layer_name(layer: u64, id: PageId) -> String {
    format!("{}{}", layer_prefix(layer), page_suffix(id))
}

pub(crate) fn mask_prefix(layer: u64) -> String {
    format!("layers/{layer:010}/mask/")
}

pub(crate) fn mask_name(layer: u64, id: PageId) -> String {
    format!("{}{}", mask_prefix(layer), page_suffix(id))
}
