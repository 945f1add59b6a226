//! Verifying assets: structure, checksums and the continuity certificate.

mod continuity;
mod mesh_faults;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

pub use continuity::{Continuity, ExemptEdges, LevelChoice, WorstJump};
pub use mesh_faults::MeshFault;

use crate::{Asset, ClusterId, OpenError, PageCache};

/// A jump of the texture function across an edge up to this passes. It lies far below half a step of 8 bits (2e-3), so
/// nothing of it can be seen, and far above what rounding makes (below 1e-6: both sides take the same tile coordinates up
/// to the order of additions).
pub const JUMP_BOUND: f32 = 1e-4;

/// How to verify. The number of threads is that of the current rayon pool.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Bytes of decoded pages to keep.
    pub memory_bytes: usize,
}

impl Default for VerifyOptions {
    /// 256 MiB.
    fn default() -> Self {
        Self { memory_bytes: 256 << 20 }
    }
}

/// What verification found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VerifyReport {
    /// Nothing damaged (texels, headers, attachments), no fault of the mesh, no jump above [`JUMP_BOUND`].
    pub ok: bool,
    /// Tile levels with damage (all channels of a tile's level count as one).
    pub damaged_tiles: u64,
    /// The first few clusters that could not be read, in words.
    pub first_damage: Vec<String>,
    /// Header slots that are damaged (0 or 1: without any the asset does not open).
    pub damaged_headers: u32,
    /// Attachments (layers, history) that cannot be read; their damaged list counts as one.
    pub damaged_attachments: u64,
    /// Guarantees of a clean mesh that do not hold; at most one of each kind.
    pub mesh_faults: Vec<MeshFault>,
    /// The certificate.
    pub continuity: Continuity,
    /// Detail levels of the tile with the most.
    pub levels: u32,
    /// Length of the file.
    pub bytes: u64,
}

/// Opens and verifies an asset on the current rayon pool.
pub fn verify(path: &Path, options: &VerifyOptions) -> Result<VerifyReport, OpenError> {
    Ok(verify_asset(&Arc::new(Asset::open(path)?), options))
}

/// Verifies an open asset on the current rayon pool.
pub fn verify_asset(asset: &Arc<Asset>, options: &VerifyOptions) -> VerifyReport {
    let damage = check_clusters(asset);
    // A large tile may have pages in several clusters.
    let damaged_tiles: BTreeSet<_> = damage.iter().flat_map(|d| &d.tiles).collect();
    let cache = PageCache::new(Arc::clone(asset), options.memory_bytes);
    let continuity = continuity::certify(&cache);
    let mut report = VerifyReport {
        ok: false,
        damaged_tiles: damaged_tiles.len() as u64,
        first_damage: damage.into_iter().map(|d| d.what).take(16).collect(),
        damaged_headers: asset.damaged_headers(),
        damaged_attachments: count_damaged_attachments(asset),
        mesh_faults: mesh_faults::find(asset.mesh()),
        continuity,
        levels: asset.level_count(),
        bytes: asset.file_bytes(),
    };
    report.ok = report.damaged_tiles == 0
        && report.damaged_headers == 0
        && report.damaged_attachments == 0
        && report.mesh_faults.is_empty()
        && report.continuity.needless_splits == 0
        && report.continuity.largest_jump <= JUMP_BOUND;
    report
}

fn count_damaged_attachments(asset: &Asset) -> u64 {
    asset.attachments().map_or(1, |list| {
        list.par_iter().filter(|(name, record)| asset.read_attachment(name, record).is_err()).count() as u64
    })
}

struct ClusterDamage {
    what: String,
    /// Group and level of the tiles that have pages in the cluster.
    tiles: Vec<(u32, u32)>,
}

/// Reads every cluster. A cluster that unpacks to its recorded length, which opening compared with the cover, holds pages
/// of the right lengths, and every bit pattern of a page decodes.
fn check_clusters(asset: &Asset) -> Vec<ClusterDamage> {
    let all: Vec<ClusterId> = asset.clusters().collect();
    let damage = all.par_iter().filter_map(|&cluster| {
        let error = asset.read_cluster(cluster).err()?;
        let level = cluster.level;
        let has_level = |&g: &u32| level < asset.cover().groups[g as usize].level_count();
        let tiles = asset.groups_in_cluster(cluster).filter(has_level).map(|g| (g, level)).collect();
        Some(ClusterDamage { what: error.to_string(), tiles })
    });
    damage.collect()
}
