//! Pictures of streaming, drawn from what the streamer decides, without a graphics card: a mountain, seen from its foot.
//!
//! ```text
//! StreamView --Streamer--> resident levels --ResidentTiles--> FanSurface --> pictures
//!                |  ^
//!                v  | parcels, the most urgent first, so many per frame
//!             DirectLoader
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex::glam::{DVec3, Vec2, Vec3};
use fantex::render::{
    Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Lights, RenderOptions, Surface, render,
};
use fantex::store::{Asset, PageCache, Sampler, Tile, TileId, TileSource, TileTexels};
use fantex::stream::{
    AtlasFormat, AtlasPlace, AtlasShape, CameraKeyframe, FrameOptions, LoadedParcel, Outline, Parcel,
    ParcelLoader, ParcelTexels, StreamView, Streamer, StreamerOptions,
};
use fantex::texture::Image;
use fantex::{Mesh, Result, Source};

use super::{Gallery, Pictures};
use crate::text::counted;

/// Pixels of the view whose tiles are asked for.
const VIEW: [u32; 2] = [320, 200];

/// Texels of the baked mountain.
const TEXELS: u64 = 4_000_000;

pub(super) fn bake_terrain(gallery: &Gallery<'_>, path: &std::path::Path) -> Result<()> {
    let mesh = Mesh::load(gallery.shipped.file("assets/models/mount-st-helens.ply"))?;
    let look = Source::look(gallery.shipped.file("gallery/layers.toml"));
    fantex::Baker::new(&mesh).source(look).texels(TEXELS).tile(128).write(path)?;
    Ok(())
}

/// Reads at once what is asked for, and hands over so many parcels in a frame, the most urgent first.
struct DirectLoader {
    asset: Arc<Asset>,
    asked: BTreeMap<Parcel, f32>,
    per_frame: usize,
    has_given: bool,
}

impl DirectLoader {
    fn outline(&self, parcel: Parcel) -> Result<ParcelTexels> {
        let asset = &self.asset;
        let layout = parcel.layout(asset.cover());
        let outline = Outline::of_stored(&layout, asset.channels(), |channel, page| {
            asset.read_page_raw(channel, page)
        })?;
        // The pictures are made from the file: no texels need to be copied.
        let channels = asset.channels().iter().map(|_| Arc::from([])).collect();
        Ok(ParcelTexels { extent: layout.extent, outline, channels })
    }
}

impl ParcelLoader for DirectLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        self.asked.insert(parcel, urgency);
    }

    fn cancel(&mut self, parcel: Parcel) {
        self.asked.remove(&parcel);
    }

    fn poll(&mut self, _max_bytes: usize) -> Vec<LoadedParcel> {
        // A frame asks until nothing comes.
        self.has_given = !self.has_given;
        if !self.has_given {
            return Vec::new();
        }
        let mut urgent: Vec<(Parcel, f32)> =
            self.asked.iter().map(|(&parcel, &urgency)| (parcel, urgency)).collect();
        urgent.sort_by(|a, b| b.1.total_cmp(&a.1));
        urgent.truncate(self.per_frame);
        let arrive = |(parcel, _)| {
            self.asked.remove(&parcel);
            LoadedParcel { parcel, texels: self.outline(parcel) }
        };
        urgent.into_iter().map(arrive).collect()
    }

    fn pending(&self) -> usize {
        self.asked.len()
    }
}

/// The tiles of an asset, none finer than what is resident.
struct ResidentTiles<'c> {
    cache: &'c PageCache,
    /// Per group; its mean where it has none.
    levels: Vec<Option<u32>>,
}

enum ResidentTile {
    Stored(Tile),
    Mean([f32; 4]),
}

impl TileSource for ResidentTiles<'_> {
    type Tile = ResidentTile;

    fn tile(&self, channel: usize, id: TileId) -> ResidentTile {
        match self.levels[id.group as usize] {
            Some(level) => {
                ResidentTile::Stored(self.cache.tile(channel, TileId { level: id.level.max(level), ..id }))
            }
            None => ResidentTile::Mean(self.cache.mean(channel, id.group)),
        }
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.cache.mean(channel, group)
    }
}

impl TileTexels for ResidentTile {
    fn extent(&self) -> [u32; 2] {
        match self {
            Self::Stored(tile) => tile.extent(),
            Self::Mean(_) => [1, 1],
        }
    }

    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        match self {
            Self::Stored(tile) => tile.bilinear(uv),
            Self::Mean(mean) => *mean,
        }
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        match self {
            Self::Stored(tile) => tile.texel(x, y),
            Self::Mean(mean) => *mean,
        }
    }
}

/// A view of the mountain while its tiles arrive.
struct Scene<'g> {
    cache: &'g PageCache,
    options: RenderOptions,
    camera: Camera,
    view: StreamView,
    streamer: Streamer,
    places: BTreeMap<Parcel, (AtlasPlace, ParcelTexels)>,
}

impl<'g> Scene<'g> {
    fn new(gallery: &'g Gallery<'_>, atlas: AtlasShape, per_frame: usize) -> Result<Self> {
        let cache = &gallery.terrain()?.cache;
        let asset = cache.asset().clone();
        let options = gallery.options([960, 600]);
        let (eye, target) = (DVec3::new(2.2, 1.75, 3.6), DVec3::new(0.2, 1.75, -0.6));
        let camera = Camera { eye, target, up: DVec3::Y, fov_degrees: 50.0 };
        // The same tiles, however large the picture is drawn.
        let view = CameraKeyframe::looking(0.0, eye, target)
            .view(&asset.mesh().world_from_mesh, VIEW)
            .unwrap_or_else(|| unreachable!("the picture has pixels"));
        let loader =
            DirectLoader { asset: asset.clone(), asked: BTreeMap::new(), per_frame, has_given: false };
        let streamer = Streamer::new(
            asset,
            Box::new(loader),
            StreamerOptions { atlas, max_anisotropy: 1.0, ..StreamerOptions::default() },
        );
        Ok(Self { cache, options, camera, view, streamer, places: BTreeMap::new() })
    }

    fn advance(&mut self, frames: u32) {
        for _ in 0..frames {
            for upload in self.streamer.update(Some(&self.view), FrameOptions::default()).uploads {
                self.places.insert(upload.parcel, (upload.place, upload.texels));
            }
        }
    }

    /// Until all that the view needs has come.
    fn settle(&mut self) {
        self.advance(2);
        for _ in 0..1000 {
            if self.streamer.is_settled() {
                break;
            }
            self.advance(1);
        }
    }

    fn rendered(&self, surface: &dyn Surface) -> Result<Image> {
        let lights = Lights::behind(&self.camera);
        Ok(render(self.cache.asset().mesh(), surface, &self.camera, &lights, &self.options)?
            .picture
            .to_srgb_image())
    }

    /// The finest level that is there, per group.
    fn resident_levels(&self) -> Vec<Option<u32>> {
        (0..self.cache.asset().cover().groups.len() as u32).map(|g| self.streamer.resident_level(g)).collect()
    }

    /// With the tiles that are there.
    fn picture(&self) -> Result<Image> {
        let asset = self.cache.asset();
        let tiles = ResidentTiles { cache: self.cache, levels: self.resident_levels() };
        let (mesh, cover) = (asset.shared_mesh(), asset.shared_cover());
        let sampler = Sampler::new(mesh, cover, asset.channels(), tiles, FilterOptions::default());
        self.rendered(&FanSurface::new(sampler))
    }

    /// Each tile's resident level as a colour.
    fn levels(&self) -> Result<Image> {
        let asset = self.cache.asset();
        let (cover, levels) = (asset.cover(), self.resident_levels());
        let surface = FlatSurface::new(asset.mesh(), FlatShading::Smooth, |hit| {
            let groups = cover.corner_groups[hit.triangle()];
            let color = |slot: usize| level_color(levels[groups[slot] as usize]);
            cover
                .weights(hit.triangle(), hit.at.lambda)
                .iter()
                .map(|(slot, weight)| color(slot) * weight)
                .sum()
        });
        self.rendered(&surface)
    }

    /// The first layer of the atlas: what is resident, at its place.
    fn atlas(&self) -> Result<Image> {
        let side = self.streamer.atlas().side;
        let mut texels = vec![[0.05, 0.05, 0.06, 1.0]; (side * side) as usize];
        let cover = self.cache.asset().cover();
        for (parcel, (place, stored)) in &self.places {
            if self.streamer.is_missing(*parcel) || place.layer != 0 {
                continue;
            }
            let spans: Vec<[u32; 2]> = stored.outline.spans(stored.extent).collect();
            for slot in parcel.layout(cover).slots {
                let page = self.cache.asset().read_page(0, slot.page)?;
                for (i, texel) in (0..).zip(&page.rgba) {
                    let [x, y] = [slot.at[0] + i % page.extent[0], slot.at[1] + i / page.extent[0]];
                    let [first, end] = spans[(y / 4) as usize];
                    if (first..end).contains(&(x / 4)) && texel[3] > 0.0 {
                        let [x, y] = [u32::from(place.x) + x, u32::from(place.y) + y];
                        texels[(y * side + x) as usize] = *texel;
                    }
                }
            }
        }
        Ok(to_srgb(&Image::from_linear_rgb(side, side, &texels)))
    }
}

fn to_srgb(image: &Image) -> Image {
    image.clone().converted(fantex::texture::Depth::U8, fantex::texture::ColorSpace::Srgb)
}

/// From red, the finest, over yellow and green to blue; grey for tiles of which nothing is there.
fn level_color(level: Option<u32>) -> Vec3 {
    const COLORS: [[f32; 3]; 6] = [
        [0.85, 0.1, 0.08],
        [0.9, 0.45, 0.05],
        [0.85, 0.8, 0.1],
        [0.2, 0.65, 0.15],
        [0.1, 0.55, 0.65],
        [0.12, 0.2, 0.7],
    ];
    level.map_or(Vec3::splat(0.4), |level| COLORS[(level as usize).min(COLORS.len() - 1)].into())
}

const ROOMY: AtlasShape = AtlasShape { side: 1024, layers: 2 };

/// The same view while its tiles arrive.
pub(super) fn arrival(gallery: &Gallery<'_>) -> Pictures {
    let mut scene = Scene::new(gallery, ROOMY, 4)?;
    let mut drawn = vec![("before anything has arrived: the mean of each tile".to_owned(), scene.picture()?)];
    for frames in [16, 24] {
        scene.advance(frames);
        let parcels = counted(scene.places.len() as u64, "parcel");
        let text = format!("after {parcels}, {} still missing", scene.streamer.missing().len());
        drawn.push((text, scene.picture()?));
    }
    scene.settle();
    let figures = scene.streamer.statistics();
    let asset = scene.cache.asset();
    let stored = asset.cover().stored_texels(asset.mesh());
    let text = format!(
        "sharp: {} parcels of {:.1} million texels, of {:.1} million that the asset has at its finest level",
        figures.resident.parcels,
        figures.resident.texels as f64 / 1e6,
        stored as f64 / 1e6
    );
    drawn.push((text, scene.picture()?));
    Ok(drawn)
}

/// One tile on all its levels; the levels that a view has; the atlas.
pub(super) fn levels(gallery: &Gallery<'_>) -> Pictures {
    let mut scene = Scene::new(gallery, ROOMY, 1000)?;
    scene.settle();
    Ok(vec![
        ("one tile on each of its levels".to_owned(), gallery.reduced(pyramid(scene.cache)?)?),
        (
            "which level is resident where: red the finest, blue coarse, grey nothing".to_owned(),
            scene.levels()?,
        ),
        (
            "the atlas: what is resident, of all levels, side by side".to_owned(),
            gallery.reduced(scene.atlas()?)?,
        ),
    ])
}

/// The levels of the first of the largest tiles side by side.
fn pyramid(cache: &PageCache) -> Result<Image> {
    let groups = &cache.asset().cover().groups;
    let (number, group) = (0..)
        .zip(groups)
        .min_by_key(|(_, group)| std::cmp::Reverse(group.extent[0] * group.extent[1]))
        .unwrap_or_else(|| unreachable!("a cover has groups"));
    let extents: Vec<[u32; 2]> = (0..group.level_count()).map(|level| group.level_extent(level)).collect();
    let gap = 8;
    let width: u32 = extents.iter().map(|extent| extent[0] + gap).sum::<u32>() + gap;
    let height = extents[0][1] + 2 * gap;
    let mut texels = vec![[0.9, 0.9, 0.9, 1.0]; (width * height) as usize];
    let mut left = gap;
    for (level, extent) in (0..).zip(&extents) {
        let tile = cache.tile(0, TileId { group: number, level });
        for (x, y) in (0..extent[1]).flat_map(|y| (0..extent[0]).map(move |x| (x, y))) {
            let texel = tile.texel(x, y);
            // Blocks that nothing reads are zero.
            if texel[3] > 0.0 {
                texels[((gap + y) * width + left + x) as usize] = texel;
            }
        }
        left += extent[0] + gap;
    }
    Ok(to_srgb(&Image::from_linear_rgb(width, height, &texels)))
}

/// Pools that hold all of a view, or a part.
pub(super) fn pools(gallery: &Gallery<'_>) -> Pictures {
    let mut drawn = Vec::new();
    for shape in [ROOMY, AtlasShape { side: 512, layers: 1 }, AtlasShape { side: 256, layers: 1 }] {
        let mut scene = Scene::new(gallery, shape, 1000)?;
        scene.settle();
        let figures = scene.streamer.statistics();
        let text = format!(
            "a pool of {} KiB; what is needed is {:.1} levels coarser than the pixels ask for",
            shape.bytes(&[AtlasFormat::Bc7]) / 1024,
            figures.bias_levels
        );
        drawn.push((text, scene.picture()?));
    }
    Ok(drawn)
}

/// The asset's file from its beginning to its end: a square for each 4096 bytes, bright where the view has made the loader read.
pub(super) fn reads(gallery: &Gallery<'_>) -> Pictures {
    const COLUMNS: u32 = 64;
    const SQUARE: u32 = 12;
    let mut scene = Scene::new(gallery, ROOMY, 1000)?;
    scene.settle();
    let asset = scene.cache.asset();
    let sectors = asset.file_bytes().div_ceil(4096) as u32;
    let mut colors = vec![Vec3::splat(0.5); sectors as usize];
    let mut is_read = std::collections::BTreeSet::new();
    for page in scene.places.keys().flat_map(|parcel| parcel.pages(asset.cover())) {
        is_read.insert(asset.cluster_of(page)?);
    }
    for cluster in asset.clusters() {
        let range = asset.cluster_range(cluster);
        let color = level_color(Some(cluster.level)) * if is_read.contains(&cluster) { 1.0 } else { 0.12 };
        colors[(range.start / 4096) as usize..range.end.div_ceil(4096) as usize].fill(color);
    }
    let size = [COLUMNS * SQUARE, sectors.div_ceil(COLUMNS) * SQUARE];
    let texel = |i: u32| {
        let [x, y] = [i % size[0], i / size[0]];
        let is_line = x % SQUARE == 0 || y % SQUARE == 0;
        let color = colors.get((y / SQUARE * COLUMNS + x / SQUARE) as usize).filter(|_| !is_line);
        color.copied().unwrap_or(Vec3::splat(0.9)).extend(1.0).to_array()
    };
    let texels: Vec<[f32; 4]> = (0..size[0] * size[1]).map(texel).collect();
    let picture = to_srgb(&Image::from_linear_rgb(size[0], size[1], &texels));
    let text = format!(
        "{} of the file's {} clusters are read for the view, one request each",
        is_read.len(),
        asset.clusters().count()
    );
    Ok(vec![(text, gallery.reduced(picture)?)])
}
