//! Assets made of tiles of another asset: pages are copied as they are encoded.

use std::collections::BTreeMap;
use std::path::Path;

use fantex_base::Result;
use fantex_cover::{Cover, GroupTriangles};
use fantex_mesh::Mesh;
use glam::Vec2;
use rayon::prelude::*;

use super::{AssetWriter, CreateOptions, EncodedPage, WriteSummary};
use crate::layout::{ClusterPages, page_origin};
use crate::{Asset, ClusterId, PageId, TexelFormat, group_pages};

/// Bytes of pages that are read before they are packed.
const BATCH_BYTES: usize = 8 << 20;

/// Texels around what a triangle covers that are copied with it at every level: no filter reads farther.
const MARGIN_TEXELS: f32 = 33.0;

/// Of levels with more blocks, all are copied.
const MAX_MARKED_BLOCKS: usize = 1 << 24;

/// An asset that gets tiles of another one.
#[derive(Clone, Copy, Debug)]
pub struct GroupCopy<'a> {
    /// The new asset's mesh.
    pub mesh: &'a Mesh,
    /// Its cover; extents and tile coordinates are those of the other asset.
    pub cover: &'a Cover,
    /// The other asset.
    pub from: &'a Asset,
    /// For each group of the cover which group of the other asset it is; ascending.
    pub groups: &'a [u32],
    /// For each group whether the other asset has further triangles in it. Of such tiles 4x4 blocks are left out (zero bytes) that lie more than 32
    /// texels, at every level, from what the triangles here cover.
    pub is_partial: &'a [bool],
}

impl GroupCopy<'_> {
    /// Writes the new asset: tiles in all channels and at all levels, byte for byte once unpacked, and means. `done` is told, batch by batch, how many
    /// texels of tiles at level 0 have been copied in all, and may end it.
    ///
    /// Takes some 32 MiB of memory for texels, more where clusters are large; the bytes do not depend on the number of threads.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten or cannot be written; the asset's texels cannot be read or are damaged; a tile has
    /// another extent than its group; what `done` returns.
    pub fn write(
        &self,
        path: &Path,
        options: &CreateOptions,
        done: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<WriteSummary> {
        let asset = self.from;
        let channels = asset.channels().len();
        let mut writer = AssetWriter::create(path, options, self.mesh, self.cover, asset.channels())?;
        let triangles = GroupTriangles::of(self.cover);
        let mut source = PageReader { copy: *self, triangles, clusters: BTreeMap::new() };
        let mut batch = Vec::new();
        let (mut bytes, mut texels) = (0, 0);
        for (own, &group) in (0..).zip(self.groups) {
            for page in group_pages(group, &asset.cover().groups[group as usize]) {
                bytes +=
                    (0..channels).map(|channel| asset.page_bytes(channel, page)).sum::<Result<usize>>()?;
                batch.push((own, page));
                if bytes >= BATCH_BYTES {
                    writer.write_pages(source.read(&batch)?)?;
                    batch.clear();
                    bytes = 0;
                    done(texels)?;
                }
            }
            texels += asset.cover().groups[group as usize].texels();
        }
        writer.write_pages(source.read(&batch)?)?;
        done(texels)?;
        let means = self
            .groups
            .iter()
            .flat_map(|&group| (0..channels).map(move |channel| asset.mean(channel, group)));
        writer.finish(&means.collect::<Vec<_>>())
    }
}

/// Reads pages of an asset in ascending order of their groups, each cluster about once.
struct PageReader<'a> {
    copy: GroupCopy<'a>,
    triangles: GroupTriangles,
    /// Those of the last batch.
    clusters: BTreeMap<ClusterId, ClusterPages>,
}

impl PageReader<'_> {
    /// Pages of the other asset, named by the groups that they get.
    fn read(&mut self, pages: &[(u32, PageId)]) -> Result<Vec<EncodedPage>> {
        let asset = self.copy.from;
        let clusters: Vec<ClusterId> =
            pages.iter().map(|&(_, page)| asset.cluster_of(page)).collect::<Result<_>>()?;
        let mut due = clusters.clone();
        due.sort_unstable();
        due.dedup();
        self.clusters.retain(|cluster, _| due.binary_search(cluster).is_ok());
        due.retain(|cluster| !self.clusters.contains_key(cluster));
        let read = due.into_par_iter().map(|cluster| Ok((cluster, asset.read_cluster(cluster)?)));
        self.clusters.extend(read.collect::<Result<Vec<_>>>()?);
        let masks = self.masks(pages);
        let page = |(&(group, id), cluster): (&(u32, PageId), &ClusterId)| {
            let in_channel = |channel| Ok(asset.page_in(&self.clusters[cluster], channel, id)?.to_vec());
            let mut channels: Vec<Vec<u8>> =
                (0..asset.channels().len()).map(in_channel).collect::<Result<_>>()?;
            if let Some(mask) = masks.get(&(group, id.level)) {
                mask.apply(id.page, asset.page_extent(0, id)?, asset.formats(), &mut channels);
            }
            Ok(EncodedPage { id: PageId { group, ..id }, channels })
        };
        pages.par_iter().zip(&clusters).map(page).collect()
    }

    /// What is kept of the levels of tiles that are needed in part.
    fn masks(&self, pages: &[(u32, PageId)]) -> BTreeMap<(u32, u32), Mask> {
        let levels = pages.iter().map(|&(group, id)| (group, id.level));
        let mut partial: Vec<_> = levels.filter(|&(group, _)| self.copy.is_partial[group as usize]).collect();
        partial.dedup();
        let masks = partial.into_par_iter().filter_map(|(group, level)| {
            Some(((group, level), Mask::of(&self.copy, self.triangles.of_group(group), group, level)?))
        });
        masks.collect()
    }
}

/// The blocks of a tile's level that are kept.
struct Mask {
    /// Blocks per row.
    columns: usize,
    is_kept: Vec<bool>,
}

impl Mask {
    /// Of a level on which some triangles of a group are; none where all blocks are kept.
    fn of(copy: &GroupCopy<'_>, triangles: &[u32], group: u32, level: u32) -> Option<Self> {
        let extent = copy.cover.groups[group as usize].level_extent(level);
        let [columns, rows] = extent.map(|n| n as usize / 4);
        if columns * rows > MAX_MARKED_BLOCKS {
            return None;
        }
        let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
        let mut mask = Self { columns, is_kept: vec![false; columns * rows] };
        for &triangle in triangles {
            let groups = copy.cover.corner_groups[triangle as usize];
            let slot = groups.iter().position(|&g| g == group)?;
            let corners = copy.cover.tile_corners(copy.mesh, triangle as usize, slot).map(|uv| uv * texels);
            let low = corners[0].min(corners[1]).min(corners[2]) - MARGIN_TEXELS;
            let high = corners[0].max(corners[1]).max(corners[2]) + MARGIN_TEXELS;
            // What lies outside is clamped to the outermost texels.
            let [low, high] = [low, high].map(|p| (p.clamp(Vec2::ZERO, texels - 1.0) / 4.0).as_uvec2());
            for y in low.y as usize..=high.y as usize {
                mask.is_kept[y * columns + low.x as usize..=y * columns + high.x as usize].fill(true);
            }
        }
        mask.is_kept.contains(&false).then_some(mask)
    }

    /// Makes the other blocks of a page zero bytes.
    fn apply(&self, page: [u32; 2], extent: [u32; 2], formats: &[TexelFormat], channels: &mut [Vec<u8>]) {
        let [left, top] = page_origin(page);
        for (x, y) in (0..extent[1]).step_by(4).flat_map(|y| (0..extent[0]).step_by(4).map(move |x| (x, y))) {
            let block = (top + y) as usize / 4 * self.columns + (left + x) as usize / 4;
            if !self.is_kept[block] {
                for (channel, format) in channels.iter_mut().zip(formats) {
                    format.block_ranges(extent[0], [x, y]).for_each(|range| channel[range].fill(0));
                }
            }
        }
    }
}
