//! Fans without fantex: sheets of tiles, and where each triangle reads them.
//!
//! ```text
//!  Cover, Asset --pack, copy--> sheets: all tiles of a channel in one picture, with a gutter around each
//!        `----------> three texture coordinates per corner: in the tiles of the triangle's corners 0, 1 and 2
//! ```
//!
//! A shader that interpolates the three coordinates and the barycentric coordinates `l` has the texture function: with
//! `a_i = max(0, l_i - max(l_j, l_k) + delta)` it is the mean of the three look-ups, weighted by `a_i`. At a sheet's level 0, filtered
//! bilinearly, that is the function of level 0 exactly. Coarser levels of a sheet stay inside the tile and its gutter down to the level
//! at which a texel is half as wide as the gutter.

use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_cover::{
    Cover, Footprints, GroupTriangles, NO_OWNER, StoredBlocks, TexelBlock, TexelTriangle, pack_within,
};
use fantex_mesh::{Mesh, SurfacePoint, shading_normals};
use fantex_store::{Asset, ChannelKind, PageCache, TexelFormat, TileId, TileSource, TileTexels};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::export::{Components, Map, brightest, cancelled, scale_of, told};
use crate::pictures::{Depth, halves, samples};
use crate::{ChannelMap, MAX_SIDE};

/// How sheets are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanSheetOptions {
    /// Texels around each tile that continue it, a power of two up to [`MAX_GUTTER`].
    pub gutter: u32,
    /// The most columns and rows of a sheet. Where one does not suffice there are several; each has all tiles that its triangles read.
    pub largest_side: u32,
    /// Bytes that sheets may take.
    pub memory_bytes: u64,
}

/// The widest gutter.
pub const MAX_GUTTER: u32 = 64;

impl Default for FanSheetOptions {
    /// Gutters of 4 texels, 8192 columns, 1 GiB.
    fn default() -> Self {
        Self { gutter: 4, largest_side: 8192, memory_bytes: 1 << 30 }
    }
}

/// An asset for programs that know no fans but can read three textures at once.
#[derive(Clone, Debug)]
pub struct FanSheets {
    /// Width of the blend band.
    pub delta: f32,
    /// Per triangle and corner slot the coordinates of the triangle's three corners in the tile of that slot, in its sheet: 0..1, origin
    /// top left, v downwards.
    pub uv: Vec<[[Vec2; 3]; 3]>,
    /// The sheet of each triangle.
    pub sheet_of_triangle: Vec<u32>,
    /// What the sheets show.
    pub maps: Vec<SheetMap>,
    /// The sheets.
    pub sheets: Vec<FanSheet>,
    /// Share of the sheets that tiles cover.
    pub used_share: f64,
    /// Pages of the asset that could not be read and were replaced by coarser ones; the first, with its reason.
    pub damage: Option<(u64, String)>,
}

/// What a picture of a sheet shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetMap {
    /// The map. Normals are in **object space**, each coordinate mapped from -1..1 to 0..1.
    pub map: ChannelMap,
    /// 1, 3, or 4 with opacity.
    pub components: usize,
    /// Bits per sample: normals have 16.
    pub depth: Depth,
    /// Whether colours are sRGB-encoded.
    pub is_srgb: bool,
    /// What values were divided by to lie in 0..1.
    pub scale: f32,
}

/// All tiles that some triangles read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FanSheet {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Samples of each map, row-major from the top; those of 16 bits big-endian.
    pub pictures: Vec<Vec<u8>>,
}

/// Packs an asset's tiles into sheets.
///
/// # Errors
/// An option is out of its range, a tile is larger than a sheet may be, the sheets take more memory than is allowed, or `progress` asked
/// to stop.
pub fn fan_sheets(
    asset: &Arc<Asset>,
    options: &FanSheetOptions,
    progress: &dyn Progress,
) -> Result<FanSheets> {
    let packer = Packer::new(asset, options, progress)?;
    let bytes = |(sheet, map)| packer.picture_bytes(sheet, map, SampleKind::Fixed);
    packer.check_memory(packer.pictures().map(bytes).sum())?;
    let mut sheets = packer.described();
    packer.draw(&[SampleKind::Fixed], progress, &mut |drawn| {
        sheets.sheets[drawn.sheet].pictures.push(drawn.samples);
        Ok(())
    })?;
    sheets.damage = told(&packer.cache.damage());
    Ok(sheets)
}

/// How the samples of a picture are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SampleKind {
    /// Fixed-point numbers, colours sRGB-encoded, as [`samples`] makes them.
    Fixed,
    /// Linear half floats, as [`halves`] makes them.
    Half,
}

/// A finished picture.
pub(crate) struct DrawnMap {
    pub(crate) sheet: usize,
    /// Its place in [`Packer::maps`].
    pub(crate) map: usize,
    pub(crate) kind: SampleKind,
    /// Row-major from the top.
    pub(crate) samples: Vec<u8>,
}

/// Makes sheets, one picture after the other.
pub(crate) struct Packer<'a> {
    pub(crate) cache: PageCache,
    options: FanSheetOptions,
    plans: Vec<Plan>,
    pub(crate) maps: Vec<Map>,
    /// Light that PNG cuts off at 1, with its largest number.
    pub(crate) cut_off: Vec<(ChannelMap, f32)>,
    pub(crate) shapes: Shapes<'a>,
}

impl<'a> Packer<'a> {
    pub(crate) fn new(
        asset: &'a Arc<Asset>,
        options: &FanSheetOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let FanSheetOptions { gutter, largest_side, memory_bytes } = *options;
        if !gutter.is_power_of_two() || gutter > MAX_GUTTER {
            return Err(Error::invalid(format!(
                "a gutter cannot be {gutter} texels; give a power of two up to {MAX_GUTTER}"
            )));
        }
        if !(64..=MAX_SIDE).contains(&largest_side) {
            return Err(Error::invalid(format!(
                "a sheet cannot have {largest_side} columns; give 64 to {MAX_SIDE}"
            )));
        }
        let (mesh, cover) = (asset.mesh(), asset.cover());
        let of_group = GroupTriangles::of(cover);
        let plans = plan(mesh, cover, &of_group, gutter, largest_side)?;
        let cache = PageCache::new(Arc::clone(asset), (memory_bytes / 8) as usize);
        let maps: Vec<Map> = MAPS
            .into_iter()
            .filter_map(|kind| Map::of(asset, kind))
            .map(|map| map.scaled(scale_of(&cache, &map, progress)))
            .collect();
        // Of a material's light a factor tells how bright it is; a light map has none.
        let cut_off = maps
            .iter()
            .filter(|map| map.kind == ChannelMap::Light)
            .map(|map| (map.kind, brightest(&cache, map, progress)))
            .filter(|(_, largest)| *largest > 1.0)
            .collect();
        let shapes = Shapes {
            mesh,
            cover,
            of_group,
            normals: shading_normals(mesh),
            stored: cover.stored_blocks(mesh),
        };
        Ok(Self { cache, options: *options, plans, maps, cut_off, shapes })
    }

    /// The asset's channels that no sheet shows.
    pub(crate) fn left_out(&self) -> Vec<ChannelKind> {
        let kinds = self.cache.asset().channels().iter().map(|channel| channel.kind);
        kinds.filter(|&kind| self.maps.iter().all(|map| map.kind.channel() != kind)).collect()
    }

    /// Numbers of sheet and map of all pictures, in the order in which they are made.
    pub(crate) fn pictures(&self) -> impl Iterator<Item = (usize, usize)> {
        let maps = self.maps.len();
        (0..self.plans.len()).flat_map(move |sheet| (0..maps).map(move |map| (sheet, map)))
    }

    pub(crate) fn picture_bytes(&self, sheet: usize, map: usize, kind: SampleKind) -> u64 {
        self.plans[sheet].texels() * texel_bytes(&self.maps[map], kind) as u64
    }

    /// # Errors
    /// Pictures of so many bytes do not fit: tiles in work and pages read have the rest.
    pub(crate) fn check_memory(&self, picture_bytes: u64) -> Result<()> {
        let allowed = self.options.memory_bytes / 4 * 3;
        if picture_bytes <= allowed {
            return Ok(());
        }
        Err(Error::too_large(format!(
            "pictures of the sheets need {picture_bytes} bytes at once, but {allowed} of the memory are theirs; give more --memory or allow \
             smaller sheets"
        )))
    }

    /// Everything but the pictures.
    pub(crate) fn described(&self) -> FanSheets {
        let Shapes { mesh, cover, .. } = &self.shapes;
        let mut sheets = FanSheets {
            delta: cover.delta,
            uv: vec![[[Vec2::ZERO; 3]; 3]; mesh.triangles.len()],
            sheet_of_triangle: vec![0; mesh.triangles.len()],
            maps: self.maps.iter().map(sheet_map).collect(),
            sheets: self
                .plans
                .iter()
                .map(|plan| FanSheet { size: plan.size, pictures: Vec::new() })
                .collect(),
            used_share: 0.0,
            damage: None,
        };
        for (index, plan) in (0u32..).zip(&self.plans) {
            for &t in &plan.triangles {
                sheets.sheet_of_triangle[t as usize] = index;
                sheets.uv[t as usize] = plan.corners(mesh, cover, t as usize, self.options.gutter);
            }
        }
        let texels: u64 = self.plans.iter().map(Plan::texels).sum();
        sheets.used_share = texels_of_tiles(cover, &self.plans) as f64 / texels.max(1) as f64;
        sheets
    }

    /// Makes each picture, in each of `kinds`, and hands it on.
    pub(crate) fn draw(
        &self,
        kinds: &[SampleKind],
        progress: &dyn Progress,
        keep: &mut dyn FnMut(DrawnMap) -> Result<()>,
    ) -> Result<()> {
        let pictures = self.maps.len() * kinds.len();
        let total = texels_of_tiles(self.shapes.cover, &self.plans) * pictures as u64;
        let mut done = 0;
        let each_kind = |(sheet, map)| kinds.iter().map(move |&kind| (sheet, map, kind));
        for (sheet, map, kind) in self.pictures().flat_map(each_kind) {
            let mut tell = |texels| {
                done += texels;
                progress.report(done, total);
                if progress.is_cancelled() { Err(cancelled()) } else { Ok(()) }
            };
            let look = PictureLook { map: &self.maps[map], kind, gutter: self.options.gutter };
            let samples = self.plans[sheet].picture(&self.cache, look, &self.shapes, &mut tell)?;
            keep(DrawnMap { sheet, map, kind, samples })?;
        }
        Ok(())
    }
}

/// What sheets are made of, in their order.
const MAPS: [ChannelMap; 5] = [
    ChannelMap::BaseColor,
    ChannelMap::OcclusionRoughnessMetallic,
    ChannelMap::Normal,
    ChannelMap::Emission,
    ChannelMap::Light,
];

/// Bits per sample of a sheet's picture.
pub(crate) fn depth_of(map: &Map) -> Depth {
    if map.kind == ChannelMap::Normal { Depth::Sixteen } else { Depth::Eight }
}

fn texel_bytes(map: &Map, kind: SampleKind) -> usize {
    let is_byte = kind == SampleKind::Fixed && depth_of(map) == Depth::Eight;
    map.components.count() * if is_byte { 1 } else { 2 }
}

fn encoded(values: &[[f32; 4]], map: &Map, kind: SampleKind) -> Vec<u8> {
    match kind {
        SampleKind::Fixed => samples(values, map, depth_of(map)),
        SampleKind::Half => halves(values, map.components),
    }
}

fn sheet_map(map: &Map) -> SheetMap {
    SheetMap {
        map: map.kind,
        components: map.components.count(),
        depth: depth_of(map),
        is_srgb: map.is_srgb,
        scale: map.scale,
    }
}

fn tile_texels(cover: &Cover, group: u32) -> u64 {
    let [width, height] = cover.groups[group as usize].extent;
    u64::from(width) * u64::from(height)
}

fn texels_of_tiles(cover: &Cover, plans: &[Plan]) -> u64 {
    plans.iter().flat_map(|plan| &plan.groups).map(|&group| tile_texels(cover, group)).sum()
}

/// The surface that object-space normals are turned on.
pub(crate) struct Shapes<'a> {
    mesh: &'a Mesh,
    cover: &'a Cover,
    of_group: GroupTriangles,
    /// Unit, per corner.
    pub(crate) normals: Vec<Vec3>,
    stored: StoredBlocks,
}

/// One sheet.
struct Plan {
    size: [u32; 2],
    triangles: Vec<u32>,
    /// Ascending.
    groups: Vec<u32>,
    /// First column and row of each group's cell, gutter included.
    cells: Vec<[u32; 2]>,
}

/// What a picture shows, and how it is laid out.
#[derive(Clone, Copy)]
struct PictureLook<'a> {
    map: &'a Map,
    kind: SampleKind,
    gutter: u32,
}

/// Cells are this often the gutter wide, so that coarser texels begin and end with them.
fn cell_extent(cover: &Cover, group: u32, gutter: u32) -> [u32; 2] {
    // Packing wants multiples of 4.
    let unit = gutter.max(4);
    cover.groups[group as usize]
        .extent
        .map(|length| (length.next_multiple_of(gutter) + 2 * gutter).next_multiple_of(unit))
}

/// Divides the triangles among few sheets. Each takes as many as its tiles allow, in an order that keeps neighbours together, since
/// tiles that the triangles of two sheets read are in both, and all others that read no more than these tiles.
fn plan(
    mesh: &Mesh,
    cover: &Cover,
    of_group: &GroupTriangles,
    gutter: u32,
    largest_side: u32,
) -> Result<Vec<Plan>> {
    let mut rest = triangle_order(mesh, cover, of_group);
    let mut is_held = vec![false; cover.groups.len()];
    let mut seen = vec![0; cover.groups.len()];
    let mut turn = 0;
    // Coarser texels end with the sheet, too.
    let unit = gutter.max(4);
    // The sheet of so many triangles, where there is room for their tiles.
    let mut sheet_of = |triangles: &[u32]| {
        turn += 1;
        let is_new = |group: &u32| std::mem::replace(&mut seen[*group as usize], turn) != turn;
        let mut groups: Vec<u32> =
            triangles.iter().flat_map(|&t| cover.corner_groups[t as usize]).filter(is_new).collect();
        groups.sort_unstable();
        let extents: Vec<[u32; 2]> = groups.iter().map(|&group| cell_extent(cover, group, gutter)).collect();
        let packing = pack_within(&extents, largest_side / unit * unit)?;
        let size = [packing.width, packing.height].map(|length| length.next_multiple_of(unit));
        Some(Plan { size, triangles: triangles.to_vec(), groups, cells: packing.positions })
    };
    let mut plans = Vec::new();
    while !rest.is_empty() {
        if let Some(whole) = sheet_of(&rest) {
            plans.push(whole);
            break;
        }
        let (mut fitting, mut too_many, mut best) = (0, rest.len(), None);
        while too_many - fitting > 1 {
            let middle = fitting.midpoint(too_many);
            match sheet_of(&rest[..middle]) {
                None => too_many = middle,
                found => (fitting, best) = (middle, found),
            }
        }
        let Some(mut plan) = best else {
            let tiles = cover.corner_groups[rest[0] as usize];
            let side = tiles.into_iter().flat_map(|group| cell_extent(cover, group, gutter)).max();
            return Err(Error::too_large(format!(
                "a triangle reads three tiles that do not fit into a sheet of {largest_side} columns and rows together (one is {} texels long); \
                 allow a larger one",
                side.unwrap_or(0)
            )));
        };
        plan.groups.iter().for_each(|&group| is_held[group as usize] = true);
        let reads_held =
            |t: &u32| cover.corner_groups[*t as usize].iter().all(|&group| is_held[group as usize]);
        let (own, others): (Vec<u32>, Vec<u32>) = rest[fitting..].iter().copied().partition(reads_held);
        plan.groups.iter().for_each(|&group| is_held[group as usize] = false);
        plan.triangles.extend(own);
        plans.push(plan);
        rest = others;
    }
    Ok(plans)
}

/// Triangles in the order of the first of their groups, groups in the order of a tree that halves space.
fn triangle_order(mesh: &Mesh, cover: &Cover, of_group: &GroupTriangles) -> Vec<u32> {
    let center = |group: u32| {
        let triangles = of_group.of_group(group);
        let middle = |t: &u32| mesh.triangle_positions(*t as usize).into_iter().sum::<Vec3>() / 3.0;
        triangles.iter().map(middle).sum::<Vec3>() / triangles.len().max(1) as f32
    };
    let count = cover.groups.len() as u32;
    let centers: Vec<Vec3> = (0..count).into_par_iter().map(center).collect();
    let mut groups: Vec<u32> = (0..count).collect();
    halve_space(&mut groups, &centers);
    let mut rank = vec![0u32; groups.len()];
    for (place, &group) in (0..).zip(&groups) {
        rank[group as usize] = place;
    }
    let mut order: Vec<u32> = (0..cover.corner_groups.len() as u32).collect();
    order.sort_by_key(|&t| {
        cover.corner_groups[t as usize].map(|group| rank[group as usize]).into_iter().min()
    });
    order
}

/// Sorts by halves along the longest axis, and halves of halves.
fn halve_space(groups: &mut [u32], centers: &[Vec3]) {
    if groups.len() < 2 {
        return;
    }
    let at = |group: &u32| centers[*group as usize];
    let (low, high) = groups.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), group| {
        (low.min(at(group)), high.max(at(group)))
    });
    let axis = (high - low).max_position();
    let middle = groups.len() / 2;
    groups.select_nth_unstable_by(middle, |a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
    let (first, second) = groups.split_at_mut(middle);
    halve_space(first, centers);
    halve_space(second, centers);
}

impl Plan {
    fn texels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Coordinates of a triangle's corners in the tiles of its three slots.
    fn corners(&self, mesh: &Mesh, cover: &Cover, triangle: usize, gutter: u32) -> [[Vec2; 3]; 3] {
        let size = Vec2::from(self.size.map(|n| n as f32));
        [0, 1, 2].map(|slot| {
            let group = cover.corner_groups[triangle][slot];
            let place = self.groups.binary_search(&group).unwrap_or_default();
            let origin = Vec2::from(self.cells[place].map(|n| (n + gutter) as f32));
            let extent = Vec2::from(cover.groups[group as usize].extent.map(|n| n as f32));
            cover.tile_corners(mesh, triangle, slot).map(|uv| (origin + uv * extent) / size)
        })
    }

    /// One map of the sheet. `tell` hears of finished texels.
    fn picture(
        &self,
        cache: &PageCache,
        PictureLook { map, kind, gutter }: PictureLook<'_>,
        shapes: &Shapes<'_>,
        tell: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Vec<u8>> {
        let texel = texel_bytes(map, kind);
        let background = encoded(&[map.background], map, kind);
        let mut picture = background.repeat(self.texels() as usize);
        let row_bytes = self.size[0] as usize * texel;
        for places in (0..self.groups.len()).collect::<Vec<_>>().chunks(TOGETHER) {
            let tiles: Vec<Vec<u8>> = places
                .par_iter()
                .map(|&place| {
                    let group = self.groups[place];
                    let (mut texels, is_empty) = texels_of(cache, map, shapes, group);
                    let extent = shapes.cover.groups[group as usize].extent;
                    let columns = extent[0] / BLOCK;
                    fill(&mut texels, extent, |[column, row]| {
                        shapes.stored.contains(group, [column, row])
                            && !is_empty[(row * columns + column) as usize]
                    });
                    encoded(&texels, map, kind)
                })
                .collect();
            for (&place, tile) in places.iter().zip(tiles) {
                let group = self.groups[place];
                let [width, height] = shapes.cover.groups[group as usize].extent;
                let [cell_width, cell_height] = cell_extent(shapes.cover, group, gutter);
                let [left, top] = self.cells[place];
                let tile_bytes = width as usize * texel;
                for y in 0..cell_height {
                    let source = y.saturating_sub(gutter).min(height - 1) as usize * tile_bytes;
                    let source = &tile[source..source + tile_bytes];
                    let start = (top + y) as usize * row_bytes + left as usize * texel;
                    let (before, after) =
                        (gutter as usize * texel, (cell_width - gutter - width) as usize * texel);
                    let target = &mut picture[start..start + before + tile_bytes + after];
                    target[before..before + tile_bytes].copy_from_slice(source);
                    target[..before]
                        .chunks_exact_mut(texel)
                        .for_each(|t| t.copy_from_slice(&source[..texel]));
                    let last = &source[tile_bytes - texel..];
                    target[before + tile_bytes..]
                        .chunks_exact_mut(texel)
                        .for_each(|t| t.copy_from_slice(last));
                }
            }
            tell(places.iter().map(|&place| tile_texels(shapes.cover, self.groups[place])).sum())?;
        }
        Ok(picture)
    }
}

/// Tiles that are decoded before they are laid into the sheet.
const TOGETHER: usize = 64;

/// The texels of a tile at level 0 as the sheet has them: linear, normals in object space, mapped to 0..1. And which blocks hold zeros
/// alone, as those do that nothing reads, where a format's zeros are nothing else.
fn texels_of(cache: &PageCache, map: &Map, shapes: &Shapes<'_>, group: u32) -> (Vec<[f32; 4]>, Vec<bool>) {
    let tile = cache.tile(map.channel, TileId { group, level: 0 });
    let [width, height] = shapes.cover.groups[group as usize].extent;
    // A damaged tile is a coarser one in its place.
    let [has_width, has_height] = tile.extent();
    let is_whole = [has_width, has_height] == [width, height];
    let stored = |x: u32, y: u32| match is_whole {
        true => tile.texel(x, y),
        false => tile.bilinear(Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32)),
    };
    let columns = width / BLOCK;
    let says_empty = map.components != Components::Rgba
        && cache.asset().channels()[map.channel].format != TexelFormat::Bc1;
    let is_normal = map.kind.channel() == ChannelKind::Normal;
    let mut is_empty = vec![says_empty; (columns * (height / BLOCK)) as usize];
    let mut note = |x: u32, y: u32, value: [f32; 4]| {
        // Opaque black has an alpha of one; normals are two numbers that cannot both be zero.
        if value[..2] != [0.0; 2] || (!is_normal && value[2..] != [0.0; 2]) {
            is_empty[(y / BLOCK * columns + x / BLOCK) as usize] = false;
        }
        value
    };
    if !is_normal {
        let mut result = Vec::with_capacity((width * height) as usize);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let [r, g, b, a] = note(x, y, stored(x, y));
            result.push([r / map.scale, g / map.scale, b / map.scale, a]);
        }
        return (result, is_empty);
    }
    let own = &shapes.cover.groups[group as usize];
    let corners = |t: u32| {
        let groups = shapes.cover.corner_groups[t as usize];
        let slot = groups.iter().position(|&g| g == group)?;
        let extent = Vec2::new(width as f32, height as f32);
        let corners = shapes.cover.tile_corners(shapes.mesh, t as usize, slot).map(|uv| uv * extent);
        TexelTriangle::new(t, groups.map(|g| g == group), corners)
    };
    let triangles: Vec<TexelTriangle> =
        shapes.of_group.of_group(group).iter().filter_map(|&t| corners(t)).collect();
    let mut result = Vec::with_capacity((width * height) as usize);
    // Bands, so that owners of large tiles take little memory.
    for top in (0..height).step_by(BAND as usize) {
        let block = TexelBlock { origin: [0, top], extent: [width, BAND.min(height - top)] };
        let touching = triangles.iter().filter(|triangle| triangle.touches(block)).copied().collect();
        let mut footprints = Footprints { triangles: touching, ..Footprints::default() };
        footprints.cover(block, shapes.cover.delta);
        for y in top..top + block.extent[1] {
            for x in 0..width {
                let owner = footprints.owner[((y - top) * width + x) as usize];
                let vertex_normal = match owner {
                    NO_OWNER => own.frame.direction,
                    owner => {
                        let triangle = &footprints.triangles[owner as usize];
                        let lambda = triangle.lambda(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                        let point = SurfacePoint { triangle: triangle.triangle, lambda };
                        let smooth = point.smooth_normal(&shapes.normals);
                        smooth.unwrap_or_else(|| point.facet_normal(shapes.mesh))
                    }
                };
                let [nx, ny, ..] = note(x, y, stored(x, y));
                let normal = own.normal_from_stored(Vec2::new(nx, ny), vertex_normal) * 0.5 + 0.5;
                result.push([normal.x, normal.y, normal.z, 1.0]);
            }
        }
    }
    (result, is_empty)
}

/// Rows of a tile whose owners are found at once.
const BAND: u32 = 256;

/// Texels along a side of a block that is stored or not.
const BLOCK: u32 = 4;

/// Gives blocks that are not stored the colours of those around them, so that coarser levels of a sheet hold nothing foreign: means of
/// what is stored go up a pyramid, and down again to where there is nothing (S. Gortler, R. Grzeszczuk, R. Szeliski and M. Cohen,
/// "The Lumigraph", 1996).
fn fill(texels: &mut [[f32; 4]], [width, height]: [u32; 2], is_stored: impl Fn([u32; 2]) -> bool) {
    let (columns, rows) = ((width / BLOCK) as usize, (height / BLOCK) as usize);
    let places = |block: usize| {
        let (left, top) = (block % columns * BLOCK as usize, block / columns * BLOCK as usize);
        (0..BLOCK as usize)
            .flat_map(move |y| (0..BLOCK as usize).map(move |x| (top + y) * width as usize + left + x))
    };
    let mean_of = |block: usize| {
        let stored = is_stored([(block % columns) as u32, (block / columns) as u32]);
        let sum = places(block).fold(Vec4::ZERO, |sum, place| sum + Vec4::from(texels[place]));
        stored.then(|| sum / (BLOCK * BLOCK) as f32)
    };
    let mut levels: Vec<(usize, Vec<Option<Vec4>>)> =
        vec![(columns, (0..columns * rows).map(mean_of).collect())];
    if levels[0].1.iter().all(Option::is_some) {
        return;
    }
    while let Some((width, means)) = levels.last().filter(|(_, means)| means.len() > 1) {
        let (wide, high) = (width.div_ceil(2), (means.len() / width).div_ceil(2));
        let parent = |place: usize| {
            let (x, y) = (place % wide * 2, place / wide * 2);
            let children = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            let known = children
                .into_iter()
                .filter(|&(x, y)| x < *width && y < means.len() / width)
                .filter_map(|(x, y)| means[y * width + x]);
            let (count, sum) = known.fold((0, Vec4::ZERO), |(count, sum), mean| (count + 1, sum + mean));
            (count > 0).then(|| sum / count as f32)
        };
        let parents = (0..wide * high).map(parent).collect();
        levels.push((wide, parents));
    }
    for level in (1..levels.len()).rev() {
        let (below, above) = levels.split_at_mut(level);
        let ((width, means), (wide, parents)) = (&mut below[level - 1], &above[0]);
        for (place, mean) in means.iter_mut().enumerate().filter(|(_, mean)| mean.is_none()) {
            *mean = parents[place / *width / 2 * wide + place % *width / 2];
        }
    }
    for (block, mean) in levels[0].1.iter().enumerate() {
        if let (Some(mean), false) = (mean, is_stored([(block % columns) as u32, (block / columns) as u32])) {
            places(block).for_each(|place| texels[place] = mean.to_array());
        }
    }
}
