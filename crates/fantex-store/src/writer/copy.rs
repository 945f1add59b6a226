//! Assets made of tiles of another asset: pages are copied as they are encoded.

use std::collections::BTreeMap;
use std::path::Path;

use fantex_base::Result;
use fantex_cover::Cover;
use fantex_mesh::Mesh;
use rayon::prelude::*;

use super::{AssetWriter, CreateOptions, EncodedPage, WriteSummary};
use crate::layout::ClusterPages;
use crate::{Asset, ClusterId, PageId, group_pages};

/// Bytes of pages that are read before they are packed.
const BATCH_BYTES: usize = 8 << 20;

/// Writes an asset whose groups are some of another asset's: group `i` of `cover` has the tile of group `groups[i]`, in all channels and at all
/// levels, byte for byte once unpacked, and its mean. `groups` ascends. `done` is told, batch by batch, how many texels of tiles at level 0
/// have been copied in all, and may end it.
///
/// Takes some 32 MiB of memory for texels, more where clusters are large; the bytes do not depend on the number of threads.
///
/// # Errors
/// The file exists and is not to be overwritten or cannot be written; the asset's texels cannot be read or are damaged; a tile has another extent than
/// its group; what `done` returns.
pub fn copy_groups(
    path: &Path,
    options: &CreateOptions,
    (mesh, cover): (&Mesh, &Cover),
    (asset, groups): (&Asset, &[u32]),
    done: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<WriteSummary> {
    let mut writer = AssetWriter::create(path, options, mesh, cover, asset.channels())?;
    let mut source = PageReader { asset, clusters: BTreeMap::new() };
    let mut batch = Vec::new();
    let (mut bytes, mut texels) = (0, 0);
    for (own, &group) in (0..).zip(groups) {
        for page in group_pages(group, &asset.cover().groups[group as usize]) {
            bytes += (0..asset.channels().len())
                .map(|channel| asset.page_bytes(channel, page))
                .sum::<Result<usize>>()?;
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
    let channels = asset.channels().len();
    let means = groups.iter().flat_map(|&group| (0..channels).map(move |channel| asset.mean(channel, group)));
    writer.finish(&means.collect::<Vec<_>>())
}

/// Reads pages of an asset in ascending order of their groups, each cluster about once.
struct PageReader<'a> {
    asset: &'a Asset,
    /// Those of the last batch.
    clusters: BTreeMap<ClusterId, ClusterPages>,
}

impl PageReader<'_> {
    /// Pages of the asset, named by the groups that they get.
    fn read(&mut self, pages: &[(u32, PageId)]) -> Result<Vec<EncodedPage>> {
        let asset = self.asset;
        let clusters: Vec<ClusterId> =
            pages.iter().map(|&(_, page)| asset.cluster_of(page)).collect::<Result<_>>()?;
        let mut due = clusters.clone();
        due.sort_unstable();
        due.dedup();
        self.clusters.retain(|cluster, _| due.binary_search(cluster).is_ok());
        due.retain(|cluster| !self.clusters.contains_key(cluster));
        let read: Vec<_> = due
            .into_par_iter()
            .map(|cluster| Ok((cluster, asset.read_cluster(cluster)?)))
            .collect::<Result<_>>()?;
        self.clusters.extend(read);
        let page = |(&(group, id), cluster): (&(u32, PageId), &ClusterId)| {
            let in_channel = |channel| Ok(asset.page_in(&self.clusters[cluster], channel, id)?.to_vec());
            let channels = (0..asset.channels().len()).map(in_channel).collect::<Result<_>>()?;
            Ok(EncodedPage { id: PageId { group, ..id }, channels })
        };
        pages.iter().zip(&clusters).map(page).collect()
    }
}
