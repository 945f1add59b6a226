//! Layers: any number of them over what was baked.
//!
//! ```text
//!  layers/base/PAGE      the page's bytes under all layers     --.     (also of coarser levels: `base_levels.rs`)
//!  layers/ID/page/PAGE   straight linear RGBA per channel, f16   |-- flatten --> the page that everybody reads
//!  layers/ID/mask/PAGE   one f16 per texel                     --'
//!  layers/index          what there is, from the bottom to the top
//! ```
//!
//! All are attachments of the asset, and the asset's own texels are the flattened result: readers that know nothing of layers
//! show what the painter sees. Only pages of level 0 on which something was painted are kept; coarser levels are made of the
//! flattened texels, or are those of the base. Blending follows [`BlendMode`](crate::BlendMode), from the bottom to the top
//! (`layer_stack.rs`); layers may lie in groups (`layer_groups.rs`).

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fantex_base::{Error, Result};
use fantex_store::{AssetEditor, ChannelKind, PAGE, PageId, page_grid};
use glam::{Vec3, Vec4};
use half::f16;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::composite::{PaintContext, composite};
use crate::error::encoded;
use crate::graph::{check_files, found_folder, kept_folder};
use crate::history::PageStep;
use crate::layer_groups::{check_depth, move_layer, tidy};
use crate::layer_moves::check_moves;
use crate::layer_stack::LayerStack;
use crate::steps::Changes;
use crate::stroke_check::check_layer;
use crate::stroke_page::StrokePage;
use crate::texel_page::Rect;
use crate::work::{FlattenWork, Work};
use crate::{
    BlendMode, ChannelPaint, GraphFill, GroupKind, LayerMove, LayerPlace, MaskSource, Painter,
    StrokeSettings, Tool,
};

pub(crate) const INDEX: &str = "layers/index";

/// Greatest number of a layer that is read.
const MAX_LAYER_ID: u64 = 1 << 48;

/// Layers of an asset at most: much goes over all of them for each.
const MAX_LAYERS: usize = 4096;

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
    /// The layers that name it as their [`parent`](Layer::parent).
    Group(GroupKind),
}

/// One layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Names its pages; never used twice.
    pub(crate) id: u64,
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
    /// Makes the mask outside of what was painted on it, in place of that number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_source: Option<MaskSource>,
    /// The mask shows where it hid, and hides where it showed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mask_inverted: bool,
    /// The group that it belongs to, by number; none where it belongs to none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<u64>,
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
            mask_source: None,
            mask_inverted: false,
            parent: None,
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

    /// True where it shows something that was not painted.
    pub(crate) fn is_everywhere(&self) -> bool {
        matches!(self.content, LayerContent::Fill(_) | LayerContent::Graph(_))
            && self.mask.is_none_or(|outside| {
                let outside = if self.mask_inverted { 1.0 - outside } else { outside };
                self.mask_source.is_some() || outside > 0.0
            })
    }

    /// True where it takes opacity from what lies below it.
    pub fn erases(&self) -> bool {
        self.blend == BlendMode::Erase && self.group_kind() != Some(GroupKind::PassThrough)
    }

    pub(crate) fn shows(&self, channel: usize) -> bool {
        self.visible && self.opacity > 0.0 && self.channels.get(channel).copied().unwrap_or(true)
    }
}

/// What a stroke paints on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
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
    pub(crate) fn load(editor: &AssetEditor) -> Result<Self> {
        let Some(bytes) = editor.attachment(INDEX)? else { return Ok(Self::default()) };
        let path = editor.asset().path();
        let damaged = |why: &str| {
            let name = path.display();
            let sentence = format!("the layers of {name} are damaged: {why}; its texels are not affected");
            Error::damaged(sentence).with_path(path)
        };
        let mut layers: Self =
            serde_json::from_slice(&bytes).map_err(|_| damaged("their list cannot be read"))?;
        let mut seen = BTreeSet::new();
        if !layers.stack.iter().all(|layer| seen.insert(layer.id)) {
            return Err(damaged("their numbers repeat"));
        }
        if layers.next_id > MAX_LAYER_ID {
            return Err(damaged("their numbers are too large"));
        }
        if layers.stack.iter().any(|layer| layer.id >= layers.next_id) {
            return Err(damaged("the number of the next one is not above theirs"));
        }
        check_values(&layers.stack).map_err(|error| damaged(&error.to_string()))?;
        find_folders(&mut layers.stack, path);
        tidy(&mut layers.stack);
        check_stack(&layers.stack, path)?;
        Ok(layers)
    }

    /// As they are kept in an asset.
    pub(crate) fn encoded(&self, asset: &Path) -> Result<Vec<u8>> {
        let mut layers = self.clone();
        keep_folders(&mut layers.stack, asset);
        encoded(&layers)
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

/// Refuses layers with which the asset could not be opened: too many, numbers that are too large, values that mean nothing, looks that name files which do not lie with it,
/// groups that are nested too deeply.
///
/// # Errors
/// There is one, and that is not allowed.
pub(crate) fn check_stack(stack: &[Layer], asset: &Path) -> Result<()> {
    if stack.len() > MAX_LAYERS {
        let count = stack.len();
        let sentence = format!("there are {count} layers, but an asset has {MAX_LAYERS} at most: merge some");
        return Err(Error::too_large(sentence));
    }
    if let Some(layer) = stack.iter().find(|layer| layer.id >= MAX_LAYER_ID) {
        let sentence =
            format!("the layer number {} is too large: numbers go up to {}", layer.id, MAX_LAYER_ID - 1);
        return Err(Error::invalid(sentence));
    }
    check_values(stack)?;
    check_depth(stack)?;
    stack.iter().try_for_each(|layer| match &layer.content {
        LayerContent::Graph(fill) => check_files(&fill.graph, asset),
        _ => Ok(()),
    })
}

fn check_values(stack: &[Layer]) -> Result<()> {
    stack
        .iter()
        .enumerate()
        .try_for_each(|(index, layer)| check_layer(format_args!("layers[{index}]"), layer))
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

/// What the names of all attachments of layers begin with.
const LAYERS: &str = "layers/";

/// What the names of the attachments that hold something begin with.
pub(crate) fn prefix(target: Target) -> String {
    match target {
        Target::Base => "layers/base/".to_owned(),
        Target::Layer(layer) => format!("layers/{layer:010}/page/"),
        Target::Mask(layer) => format!("layers/{layer:010}/mask/"),
    }
}

/// The attachment that a stroke changes on a page of level 0.
pub(crate) fn page_name(target: Target, id: PageId) -> String {
    format!("{}{:010}/{:05}/{:05}", prefix(target), id.group, id.page[1], id.page[0])
}

/// The layer of which an attachment holds something that was painted, on it or its mask.
fn layer_of_name(name: &str) -> Option<u64> {
    name.strip_prefix(LAYERS)?.split_once('/')?.0.parse().ok()
}

/// The page of any level whose base an attachment keeps, by its name after the prefix.
pub(crate) fn base_page_of_suffix(suffix: &str) -> Option<PageId> {
    match suffix.match_indices('/').nth(2) {
        None => page_of_suffix(suffix),
        Some((end, _)) => {
            let level = suffix[end + 1..].parse().ok()?;
            Some(PageId { level, ..page_of_suffix(&suffix[..end])? })
        }
    }
}

/// The page that a name stands for, after its prefix.
pub(crate) fn page_of_suffix(suffix: &str) -> Option<PageId> {
    let mut numbers = suffix.split('/').map(|number| number.parse::<u32>().ok());
    let (group, y, x) = (numbers.next()??, numbers.next()??, numbers.next()??);
    numbers.next().is_none().then_some(PageId { group, level: 0, page: [x, y] })
}

/// Where the bytes of a page of any level are kept while something lies over them.
pub(crate) fn base_name(id: PageId) -> String {
    let name = page_name(Target::Base, id);
    if id.level == 0 { name } else { format!("{name}/{:02}", id.level) }
}

/// The same for the means of a group: four f32 per channel.
pub(crate) fn base_mean_name(group: u32) -> String {
    format!("{}{group:010}/mean", prefix(Target::Base))
}

// Pages of layers as bytes: half floats, so that neither darkness nor light beyond 1 is lost.

/// Bytes of a texel's RGBA.
pub(crate) const TEXEL_BYTES: usize = 8;

/// What is painted on a page of a layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Held {
    /// `values[channel][texel]`: straight linear RGBA.
    pub(crate) values: Vec<Vec<Vec4>>,
    /// Alphas of occlusion, roughness and metallic per texel, where they are not one; else empty.
    pub(crate) parts: Vec<Vec3>,
}

/// Bytes of a texel's three alphas.
const PARTS_BYTES: usize = 6;

impl Held {
    /// Channel after channel, then the alphas of components.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let values = self.values.iter().flatten().flat_map(|v| v.to_array());
        let parts = self.parts.iter().flat_map(|v| v.to_array());
        values.chain(parts).map(half_of).flat_map(f16::to_le_bytes).collect()
    }

    /// Inverse of [`encode`](Self::encode). Channels that were added later are empty: transparent; so is a page of another length.
    pub(crate) fn decode(bytes: &[u8], channels: usize, texels: usize) -> Self {
        let empty = vec![Vec4::ZERO; texels];
        let known = bytes.len() / (texels * TEXEL_BYTES).max(1);
        let all = known * texels * TEXEL_BYTES;
        let is_whole = bytes.len() == all || bytes.len() == all + texels * PARTS_BYTES;
        if !is_whole || known > channels {
            return Self { values: vec![empty; channels], parts: Vec::new() };
        }
        let half = |b: &[u8], k: usize| float_of([b[2 * k], b[2 * k + 1]]);
        let texel = |b: &[u8]| Vec4::from_array(std::array::from_fn(|k| half(b, k)));
        let (values, parts) = bytes.split_at(all);
        let channel = |c: &[u8]| c.chunks_exact(TEXEL_BYTES).map(texel).collect();
        let part = |b: &[u8]| Vec3::from_array(std::array::from_fn(|k| half(b, k)));
        let mut values: Vec<Vec<Vec4>> =
            values.chunks_exact((texels * TEXEL_BYTES).max(1)).map(channel).collect();
        values.resize(channels, empty);
        Self { values, parts: parts.chunks_exact(PARTS_BYTES).map(part).collect() }
    }

    /// Alphas of a texel's components; `value` is that of the channel that has them.
    pub(crate) fn alphas(&self, texel: usize, value: Vec4) -> Vec3 {
        self.parts.get(texel).copied().unwrap_or(Vec3::splat(value.w))
    }
}

/// One number per texel; no number where nothing was painted.
fn encode_mask(mask: &[f32]) -> Vec<u8> {
    let half = |x: f32| if x.is_nan() { f16::NAN } else { half_of(x) };
    mask.iter().flat_map(|&x| half(x).to_le_bytes()).collect()
}

/// Inverse of [`encode_mask`]; on a page of another length nothing was painted.
pub(crate) fn decode_mask(bytes: &[u8], texels: usize) -> Vec<f32> {
    if bytes.len() != 2 * texels {
        return vec![f32::NAN; texels];
    }
    bytes.chunks_exact(2).map(|b| mask_of([b[0], b[1]])).collect()
}

/// A texel of a mask; NaN where nothing was painted.
fn mask_of(bytes: [u8; 2]) -> f32 {
    if f16::from_le_bytes(bytes).is_nan() { f32::NAN } else { float_of(bytes) }
}

fn half_of(x: f32) -> f16 {
    let limit = f32::from(f16::MAX);
    f16::from_f32(if x.is_nan() { 0.0 } else { x.clamp(-limit, limit) })
}

pub(crate) fn float_of(bytes: [u8; 2]) -> f32 {
    let x = f16::from_le_bytes(bytes).to_f32();
    if x.is_finite() { x } else { 0.0 }
}

// Adding, removing and changing layers.

impl Painter {
    /// All layers, from the bottom to the top.
    pub fn layers(&self) -> &[Layer] {
        &self.layers.stack
    }

    /// Puts a layer on top; returns its number, by which strokes name it.
    ///
    /// # Errors
    /// The asset cannot be read or changed, or a texture of a fill layer cannot be evaluated.
    pub fn add_layer(&mut self, layer: Layer) -> Result<u64> {
        let number = self.start_add_layer(layer, LayerPlace::Top)?;
        self.finish_work()?;
        Ok(number)
    }

    /// The same, at a place; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`add_layer`](Self::add_layer).
    pub fn start_add_layer(&mut self, layer: Layer, place: LayerPlace) -> Result<u64> {
        let mut number = 0;
        self.change_layers("add layer", &[], |layers| {
            number = layers.add(layer);
            move_layer(&mut layers.stack, number, place);
        })?;
        Ok(number)
    }

    /// Changes layers in any way: order, groups, names, visibility, opacity, blending, masks; or removes some. One step of the
    /// history. Layers that `change` invents are dropped: use [`add_layer`](Self::add_layer). Members of groups are brought to lie
    /// directly below these.
    ///
    /// # Errors
    /// As [`add_layer`](Self::add_layer).
    pub fn edit_layers(&mut self, label: &str, change: impl FnOnce(&mut Vec<Layer>)) -> Result<()> {
        self.start_edit_layers(label, change)?;
        self.finish_work()
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`add_layer`](Self::add_layer).
    pub fn start_edit_layers(&mut self, label: &str, change: impl FnOnce(&mut Vec<Layer>)) -> Result<()> {
        self.change_layers(label, &[], |layers| {
            let known: BTreeSet<u64> = layers.stack.iter().map(Layer::id).collect();
            change(&mut layers.stack);
            let mut seen = BTreeSet::new();
            layers.stack.retain(|layer| known.contains(&layer.id()) && seen.insert(layer.id()));
        })
    }

    /// Replaces all layers by others, numbers included: one step of the history. What was painted on numbers that stay, stays; numbers
    /// that come anew have nothing painted on them; what is copied and merged comes first.
    ///
    /// # Errors
    /// As [`add_layer`](Self::add_layer).
    pub fn set_layers(&mut self, label: &str, stack: Vec<Layer>, moves: &[LayerMove]) -> Result<()> {
        self.change_layers(label, moves, |layers| {
            let mut seen = BTreeSet::new();
            layers.stack = stack.into_iter().filter(|layer| seen.insert(layer.id())).collect();
            let next = layers.stack.iter().map(|layer| layer.id().saturating_add(1)).max().unwrap_or(0);
            layers.next_id = layers.next_id.max(next);
        })?;
        self.finish_work()
    }

    /// # Errors
    /// As [`add_layer`](Self::add_layer). What was begun is taken back then, which is work.
    pub(crate) fn change_layers(
        &mut self,
        label: &str,
        moves: &[LayerMove],
        change: impl FnOnce(&mut Layers),
    ) -> Result<()> {
        self.finish_work()?;
        self.end()?;
        let mut after = self.layers.clone();
        change(&mut after);
        tidy(&mut after.stack);
        let path = self.editor.asset().path().to_owned();
        check_moves(&self.layers, &after, moves)?;
        if after == self.layers {
            return Ok(());
        }
        check_stack(&after.stack, &path)?;
        self.fills.update(&self.surface, &after)?;
        self.begin_step(label);
        let before = std::mem::replace(&mut self.layers, after);
        if let Err(error) = self.enter_layers(label, &before, moves) {
            // What is done so far is in the step. Without a history it stays, and layers are those of the asset.
            self.layers = match self.options.history {
                true => before,
                false => Layers::load(&self.editor).unwrap_or(before),
            };
            self.take_back().unwrap_or_default();
            return Err(error);
        }
        let pages = self.pages_to_flatten(&before.stack);
        self.work = Some(Work::Flatten(FlattenWork::new(label, before.stack, &pages)));
        Ok(())
    }

    /// Enters layers that have changed into the asset, the history and the log, with what was painted on them.
    fn enter_layers(&mut self, label: &str, before: &Layers, moves: &[LayerMove]) -> Result<()> {
        self.forget_leftovers(before)?;
        moves.iter().try_for_each(|&step| self.move_painted(before, step))?;
        self.forget_masks(before)?;
        if !self.options.history {
            self.drop_deleted();
        }
        let path = self.editor.asset().path().to_owned();
        let list = self.layers.encoded(&path)?;
        self.attach(INDEX, list)?;
        let mut stack = self.layers.stack.clone();
        keep_folders(&mut stack, &path);
        let (label, set_layers, layer_moves) = (label.to_owned(), Some(stack), moves.to_vec());
        self.log(&StrokeSettings { label, set_layers, layer_moves, ..StrokeSettings::default() })
    }

    /// Drops what lies under numbers that come anew: it was painted on deleted layers that had them.
    fn forget_leftovers(&mut self, before: &Layers) -> Result<()> {
        let numbers = |layers: &Layers| -> BTreeSet<u64> { layers.stack.iter().map(Layer::id).collect() };
        let new = &numbers(&self.layers) - &numbers(before);
        if new.is_empty() {
            return Ok(());
        }
        let is_left = |name: &String| layer_of_name(name).is_some_and(|id| new.contains(&id));
        let names = self.editor.attachment_names_with(LAYERS);
        let left: Vec<String> = names.into_iter().filter(is_left).collect();
        left.iter().try_for_each(|name| self.detach(name))
    }

    /// Drops what was painted on deleted layers, which no step of the history brings back.
    pub(crate) fn drop_deleted(&mut self) {
        let known: BTreeSet<u64> = self.layers.stack.iter().map(Layer::id).collect();
        for name in self.editor.attachment_names_with(LAYERS) {
            if layer_of_name(&name).is_some_and(|id| !known.contains(&id)) {
                self.editor.detach(&name);
            }
        }
    }

    pub(crate) fn flatten_pages(&mut self, ids: &[PageId], changes: &mut Changes) -> Result<()> {
        let maps = self.maps.get(&self.surface, ids, self.options.budget());
        let (editor, layers, surface, fills) = (&self.editor, &self.layers, &*self.surface, &self.fills);
        let flat = ids.par_iter().zip(&maps).map(|(&id, map)| {
            let rect = Rect::of(map.block.extent);
            LayerStack { editor, layers, id, surface, map, fills, rect, replaced: None }.flatten()
        });
        let flat: Vec<Vec<Vec<u8>>> = flat.collect::<Result<_>>()?;
        for ((&id, flat), map) in ids.iter().zip(flat).zip(maps) {
            let before = base_bytes(&self.editor, id, None)?;
            // The base is kept from the moment on at which something lies over it.
            let is_first_layered = !self.editor.has_attachment(&base_name(id));
            if is_first_layered {
                self.editor.attach(&base_name(id), before.concat())?;
            }
            let mut channels = Vec::with_capacity(flat.len());
            for (channel, (before, after)) in before.into_iter().zip(flat).enumerate() {
                if before != after {
                    self.editor.replace(id, channel, after.clone())?;
                    channels.push((channel, before, after));
                }
            }
            if !channels.is_empty() {
                changes.add(id, Rect::of(map.block.extent));
            }
            self.remember(PageStep { id, channels, is_first_layered })?;
        }
        Ok(())
    }

    /// Pages on which some layer shows or has shown something, ascending.
    pub(crate) fn pages_to_flatten(&self, before: &[Layer]) -> Vec<PageId> {
        if self.layers.stack.iter().chain(before).any(Layer::is_everywhere) {
            return self.all_pages();
        }
        let masks = self.layers.stack.iter().map(|layer| Target::Mask(layer.id()));
        self.pages_of_targets(masks.chain([Target::Base]))
    }

    /// Pages of which something is kept for one of the targets, ascending.
    pub(crate) fn pages_of_targets(&self, targets: impl Iterator<Item = Target>) -> Vec<PageId> {
        let mut pages = BTreeSet::new();
        for prefix in targets.map(prefix) {
            let names = self.editor.attachment_names_with(&prefix);
            let suffixes = names.iter().filter_map(|name| name.strip_prefix(&prefix));
            pages.extend(suffixes.filter_map(page_of_suffix).filter(|id| self.has_page(*id)));
        }
        pages.into_iter().collect()
    }

    pub(crate) fn has_page(&self, id: PageId) -> bool {
        let group = self.editor.asset().cover().groups.get(id.group as usize);
        group.is_some_and(|group| group.extent.iter().zip(id.page).all(|(&n, page)| page < n.div_ceil(PAGE)))
    }

    pub(crate) fn all_pages(&self) -> Vec<PageId> {
        let groups = (0u32..).zip(&self.editor.asset().cover().groups);
        let pages = groups.flat_map(|(group, shape)| {
            let [columns, rows] = page_grid(shape.extent);
            (0..rows).flat_map(move |y| (0..columns).map(move |x| PageId { group, level: 0, page: [x, y] }))
        });
        pages.collect()
    }
}

/// A page's bytes under all layers, per channel: from the attachment that keeps them, or, where nothing lies over the page
/// yet, the page itself.
pub(crate) fn base_bytes(editor: &AssetEditor, id: PageId, kept: Option<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
    let lengths = page_lengths(editor, id)?;
    let Some(kept) = kept.filter(|kept| kept.len() == lengths.iter().sum::<usize>()) else {
        return (0..lengths.len()).map(|channel| editor.read_page_raw(channel, id)).collect();
    };
    let mut rest = kept.as_slice();
    let pages = lengths.iter().filter_map(|&length| rest.split_off(..length));
    Ok(pages.map(<[u8]>::to_vec).collect())
}

/// The same in one channel, from the attachment that the asset has.
pub(crate) fn base_page(editor: &AssetEditor, channel: usize, id: PageId) -> Result<Vec<u8>> {
    let lengths = page_lengths(editor, id)?;
    let start = lengths[..channel].iter().sum::<usize>();
    let kept = editor.attachment(&base_name(id))?;
    match kept.filter(|kept| kept.len() == lengths.iter().sum::<usize>()) {
        Some(kept) => Ok(kept[start..start + lengths[channel]].to_vec()),
        None => editor.read_page_raw(channel, id),
    }
}

/// The bytes that a page takes, per channel.
fn page_lengths(editor: &AssetEditor, id: PageId) -> Result<Vec<usize>> {
    let asset = editor.asset();
    (0..asset.channels().len()).map(|channel| asset.page_bytes(channel, id)).collect()
}

// A stroke onto a layer, a mask, or what lies under the layers.

#[derive(Debug, Default)]
pub(crate) struct ShownPage {
    /// Bytes per affected channel.
    pub(crate) channels: Vec<Vec<u8>>,
    pub(crate) attachments: Vec<(String, Vec<u8>)>,
}

impl ShownPage {
    pub(crate) fn put(self, editor: &mut AssetEditor, id: PageId, affected: &[usize]) -> Result<()> {
        for (&channel, bytes) in affected.iter().zip(self.channels) {
            editor.replace(id, channel, bytes)?;
        }
        self.attachments.into_iter().try_for_each(|(name, contents)| editor.attach(&name, contents))
    }
}

pub(crate) struct LayeredPage<'a> {
    pub(crate) stack: LayerStack<'a>,
    pub(crate) page: &'a StrokePage,
    pub(crate) context: &'a PaintContext<'a>,
    pub(crate) target: Target,
    pub(crate) affected: &'a [usize],
}

impl LayeredPage<'_> {
    /// The page with the stroke.
    pub(crate) fn show(&self) -> Result<ShownPage> {
        // Kept behind the bytes of the channels.
        let before = self.page.originals.last().map_or(&[][..], Vec::as_slice);
        let contents = match self.target {
            Target::Base => self.painted_base(before)?,
            Target::Layer(_) => self.painted_layer(before),
            Target::Mask(layer) => self.painted_mask(before, self.stack.layers.find(layer)),
        };
        let LayerStack { editor, id, .. } = self.stack;
        let name = page_name(self.target, id);
        let mut flat = LayerStack { replaced: Some((&name, &contents)), ..self.stack }.flatten()?;
        let channels = self.affected.iter().map(|&channel| std::mem::take(&mut flat[channel])).collect();
        let mut attachments = Vec::new();
        if self.target != Target::Base && !editor.has_attachment(&base_name(id)) {
            attachments.push((base_name(id), base_bytes(editor, id, None)?.concat()));
        }
        attachments.push((name, contents));
        Ok(ShownPage { channels, attachments })
    }

    fn painted_base(&self, before: &[u8]) -> Result<Vec<u8>> {
        let LayerStack { editor, map, id, .. } = self.stack;
        let mut base = base_bytes(editor, id, Some(before.to_vec()))?;
        let originals: Vec<Vec<u8>> =
            self.context.paint.channels.iter().map(|painted| base[painted.channel].clone()).collect();
        let page = StrokePage {
            originals: originals.clone(),
            stale: self.page.touched,
            decoded: OnceLock::new(),
            ..self.page.clone()
        };
        let painted = composite(editor.asset(), map, id, &page, originals, self.context)?;
        for (channel, bytes) in self.context.paint.channels.iter().zip(painted) {
            base[channel.channel] = bytes;
        }
        Ok(base.concat())
    }

    fn painted_layer(&self, before: &[u8]) -> Vec<u8> {
        let channels = self.stack.editor.asset().channels().len();
        let mut held = Held::decode(before, channels, self.page.coverage.len());
        let asset = self.stack.editor.asset();
        let with_parts = asset.channel_of_kind(ChannelKind::OcclusionRoughnessMetallic);
        let is_partial =
            |painted: &ChannelPaint| painted.components != [true; 3] && Some(painted.channel) == with_parts;
        if let Some(values) = with_parts.and_then(|channel| held.values.get(channel))
            && held.parts.is_empty()
            && self.context.paint.channels.iter().any(is_partial)
        {
            held.parts = values.iter().map(|value| Vec3::splat(value.w)).collect();
        }
        let is_opacity = matches!(self.context.paint.tool, Tool::Opacity { .. });
        self.for_each_covered(|texel, place| {
            for (number, painted) in self.context.paint.channels.iter().enumerate() {
                if let Some(color) = self.context.color(self.stack.map, self.page, place, number) {
                    let (paint, covered) = (self.context.paint, self.page.covered(texel));
                    let value = &mut held.values[painted.channel][texel];
                    // Nothing was painted there that could be seen.
                    if is_opacity && *value == Vec4::ZERO {
                        continue;
                    }
                    if Some(painted.channel) == with_parts && !held.parts.is_empty() {
                        let before = value.truncate();
                        let alphas = &mut held.parts[texel];
                        for k in (0..3).filter(|&k| painted.components[k]) {
                            let after = paint.apply(before.extend(alphas[k]), color, covered);
                            (value[k], alphas[k]) = (after[k], after.w);
                        }
                        value.w = alphas.max_element();
                    } else {
                        *value = painted.keep(*value, paint.apply(*value, color, covered));
                    }
                }
            }
        });
        held.encode()
    }

    fn painted_mask(&self, before: &[u8], layer: Option<&Layer>) -> Vec<u8> {
        let mut mask = decode_mask(before, self.page.coverage.len());
        let Some(layer) = layer else { return encode_mask(&mask) };
        let outside = layer.mask.unwrap_or(1.0);
        self.for_each_covered(|texel, place| {
            if mask[texel].is_nan() {
                mask[texel] = self.stack.unpainted_mask(layer, outside, place);
            }
            if let Some(color) = self.context.color(self.stack.map, self.page, place, 0) {
                // Luminance (ITU-R BT.709).
                let seen = color.truncate().dot(Vec3::new(0.2126, 0.7152, 0.0722)).clamp(0.0, 1.0);
                let goal = if layer.mask_inverted { 1.0 - seen } else { seen };
                let share = self.page.covered(texel) * self.context.paint.opacity.clamp(0.0, 1.0);
                mask[texel] += (goal - mask[texel]) * share;
            }
        });
        encode_mask(&mask)
    }

    fn for_each_covered(&self, mut visit: impl FnMut(usize, [u32; 2])) {
        for place in self.page.touched.texels() {
            let texel = self.stack.map.texel(place);
            if self.page.covered(texel) > 0.0 && self.stack.map.is_valid(texel) {
                visit(texel, place);
            }
        }
    }
}
