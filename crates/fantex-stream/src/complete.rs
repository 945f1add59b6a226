//! All texels of a small asset at once: for what is never streamed, such as previews.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use fantex_base::{Error, Result};
use fantex_store::{Asset, ClusterId, ClusterPages, PageId, page_grid};

use crate::drawing::AtlasGrid;
use crate::loader::stored_texels;
use crate::{
    AtlasFormat, AtlasPlace, AtlasShape, FrameChanges, PageTable, ParcelUpload, TableChange, TableEntry,
};

/// Sides of layers that are tried.
const SIDES: [u32; 5] = [256, 512, 1024, 2048, 4096];

/// An atlas that holds all pages of an asset, and what brings them there. `longest` is the most texels per side of a texture.
///
/// # Errors
/// The asset cannot be read, is damaged, or has more texels than an atlas.
pub fn complete_atlas(
    asset: &Asset,
    formats: &[AtlasFormat],
    longest: u32,
) -> Result<(AtlasShape, FrameChanges)> {
    let pages = pages_by_height(asset)?;
    let area: u64 =
        pages.iter().map(|(_, extent)| extent.iter().map(|&n| u64::from(n)).product::<u64>()).sum();
    let side =
        SIDES.into_iter().find(|&side| u64::from(side).pow(2) >= area).unwrap_or(SIDES[SIDES.len() - 1]);
    let (places, layers) = shelves(&pages, side.min(longest));
    let shape = AtlasShape { side, layers: layers.into() };
    let is_enough = |shape: &AtlasShape| AtlasGrid::fitting(*shape, longest).layers >= u32::from(layers);
    let shape = (shape.layers..=128).map(|layers| AtlasShape { layers, ..shape }).find(is_enough);
    let shape = shape.ok_or_else(|| {
        let location = asset.path().display();
        Error::too_large(format!("{location} has too many texels to have all of them in the atlas at once"))
    })?;
    let table = PageTable::new(asset.cover());
    let mut clusters = Clusters { asset, unpacked: HashMap::new() };
    let mut changes = FrameChanges::default();
    for ((page, _), place) in pages.into_iter().zip(places) {
        let cluster = clusters.of(page)?;
        let parcel = page.into();
        let texels =
            stored_texels(asset, formats, parcel, |channel, page| asset.page_in(cluster, channel, page))?;
        changes.uploads.push(ParcelUpload { parcel, place, texels });
        let index = table.index(asset.cover(), page);
        changes.entries.push(TableChange { index, entry: TableEntry::at(place) });
    }
    changes.entries.sort_by_key(|change| change.index);
    Ok((AtlasGrid::fitting(shape, longest), changes))
}

/// All pages with their extents, the highest first.
fn pages_by_height(asset: &Asset) -> Result<Vec<(PageId, [u32; 2])>> {
    let mut pages = Vec::new();
    for (group, tile) in (0..).zip(&asset.cover().groups) {
        for level in 0..tile.level_count() {
            let [columns, rows] = page_grid(tile.level_extent(level));
            for page in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
                let id = PageId { group, level, page };
                pages.push((id, asset.page_extent(0, id)?));
            }
        }
    }
    pages.sort_by_key(|(_, [columns, rows])| std::cmp::Reverse((*rows, *columns)));
    Ok(pages)
}

/// Places in layers of shelves, and how many layers that takes. Pages must come with the highest first.
fn shelves(pages: &[(PageId, [u32; 2])], side: u32) -> (Vec<AtlasPlace>, u16) {
    let (mut layer, mut x, mut y, mut shelf) = (0, 0, 0, 0);
    let mut places = Vec::with_capacity(pages.len());
    for (_, [columns, rows]) in pages {
        if x + columns > side {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        if y + rows > side {
            (layer, x, y, shelf) = (layer + 1, 0, 0, 0);
        }
        places.push(AtlasPlace { layer, x: x as u16, y: y as u16 });
        (x, shelf) = (x + columns, shelf.max(*rows));
    }
    (places, layer + 1)
}

struct Clusters<'a> {
    asset: &'a Asset,
    unpacked: HashMap<ClusterId, ClusterPages>,
}

impl Clusters<'_> {
    /// The cluster that holds a page.
    fn of(&mut self, page: PageId) -> Result<&ClusterPages> {
        let cluster = self.asset.cluster_of(page)?;
        match self.unpacked.entry(cluster) {
            Entry::Occupied(entry) => Ok(entry.into_mut()),
            Entry::Vacant(entry) => {
                let range = self.asset.cluster_range(cluster);
                let mut stored = vec![0; (range.end - range.start) as usize];
                let read = self.asset.source().read_exact_at(&mut stored, range.start);
                read.map_err(|source| self.asset.read_error(&range, source.into()))?;
                Ok(entry.insert(self.asset.unpack_cluster(cluster, &stored)?))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn pages_on_shelves_do_not_overlap(extents in prop::collection::vec([1u32..=64, 1..=64], 1..200)) {
            let page = |group: usize| PageId { group: group as u32, level: 0, page: [0, 0] };
            let mut pages: Vec<_> = extents.iter().enumerate().map(|(i, e)| (page(i), e.map(|n| 4 * n))).collect();
            pages.sort_by_key(|(_, [columns, rows])| std::cmp::Reverse((*rows, *columns)));
            let (places, layers) = shelves(&pages, 512);
            let mut taken = vec![[false; 128 * 128]; usize::from(layers)];
            for ((_, [columns, rows]), place) in pages.iter().zip(places) {
                let [x, y] = [place.x, place.y].map(|n| u32::from(n / 4));
                for cell in (y..y + rows / 4).flat_map(|y| (x..x + columns / 4).map(move |x| (y * 128 + x) as usize)) {
                    prop_assert!(!std::mem::replace(&mut taken[usize::from(place.layer)][cell], true));
                }
            }
        }
    }
}
