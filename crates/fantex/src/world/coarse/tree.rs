//! The tree of coarse assets: one for each run of objects that follow each other, then one for each run of these, up to a single one.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_store::Asset;

use super::{FinerSurface, measured};
use crate::preview::{coarse_mesh, is_worth_it};
use crate::{PreviewOptions, World};

/// Objects, or coarse assets, that a coarse asset stands for, at most.
pub(crate) const RUN: usize = 16;

/// An object or a coarse asset.
pub(crate) struct Node {
    /// The numbers of the objects that it is or stands for, ascending.
    pub(crate) objects: Vec<usize>,
    /// As the index names it.
    pub(crate) asset: String,
    /// Whether it is an object: then its preview is what it shows from afar.
    pub(crate) is_object: bool,
    /// False for an object without a preview.
    pub(crate) is_coarse: bool,
    /// Length of the finest detail of its preview, or of itself, world units.
    pub(crate) detail: f64,
}

/// How large a coarse asset is to be.
pub(crate) struct CoarseSize {
    /// Triangles, about.
    pub(crate) triangles: usize,
    /// Stored texels at level 0, per channel.
    pub(crate) texels: u64,
    /// Triangles that somebody has asked for.
    pub(crate) asked: Option<usize>,
}

/// What coarse assets are made of, and where they go.
pub(crate) trait CoarseMaker {
    /// Is told the runs of a level before one of them is made: per object the number of its run. One of no run, which is shown beside all of them, has
    /// a number of its own.
    fn begin_level(&mut self, runs: &[u32]);

    /// Opens what a node shows from afar.
    fn open(&self, node: &Node) -> Result<Asset>;

    /// What the nodes of a run show as one surface, and which of its vertices stay, as other runs have them, too; ascending.
    fn surface(&self, run: &[Node], finer: &[Arc<Asset>], memory_bytes: u64) -> (FinerSurface, Vec<u32>);

    /// The size of the coarse asset of some objects in which so many vertices stay.
    fn size(&self, world: &World, objects: &[usize], kept: usize) -> CoarseSize;

    /// Has the next coarse asset written to a file, and puts it where it belongs. Gives its name in the index, and the asset.
    fn put(&mut self, write: &mut dyn FnMut(&Path) -> Result<()>) -> Result<(String, Asset)>;
}

/// Makes the coarse assets, of a run of nodes after the other, until one stands for all. A run stays as it is where one of its nodes shows nothing from
/// afar, or where its coarse asset would be hardly smaller. Returns how many runs these are.
pub(crate) fn add_coarse(
    world: &mut World,
    mut nodes: Vec<Node>,
    maker: &mut dyn CoarseMaker,
    (memory_bytes, strict): (u64, bool),
    progress: &dyn Progress,
) -> Result<u64> {
    let mut left_out = 0;
    while nodes.len() > 1 {
        let count = nodes.len().div_ceil(RUN);
        let end = |run: usize| run * nodes.len() / count;
        let runs: Vec<&[Node]> = (0..count).map(|run| &nodes[end(run)..end(run + 1)]).collect();
        maker.begin_level(&runs_of_objects(&runs, world.objects.len()));
        let mut above = Vec::with_capacity(count);
        for run in runs {
            if progress.is_cancelled() {
                return Err(Error::cancelled("making coarse assets was cancelled"));
            }
            if run.iter().any(|node| !node.is_coarse) {
                left_out += 1;
                continue;
            }
            let mut objects: Vec<usize> = run.iter().flat_map(|node| node.objects.iter().copied()).collect();
            objects.sort_unstable();
            let finer = run.iter().map(|node| maker.open(node).map(Arc::new));
            let finer = finer.collect::<Result<Vec<_>>>()?;
            let (surface, kept) = maker.surface(run, &finer, memory_bytes / 2);
            let CoarseSize { triangles, texels, asked } = maker.size(world, &objects, kept.len());
            if surface.mesh().triangles.is_empty() {
                left_out += 1;
                continue;
            }
            let mesh = coarse_mesh(surface.mesh(), triangles, &kept)?;
            if !is_worth_it(&mesh, surface.mesh(), asked) {
                left_out += 1;
                continue;
            }
            let options = PreviewOptions { memory_bytes, strict, ..PreviewOptions::default() };
            let (asset, open) =
                maker.put(&mut |path| surface.write_coarse((&mesh, texels), &options, path, progress))?;
            let detail = run.iter().map(|node| node.detail).fold(0.0, f64::max);
            let parts = run.iter().map(|node| node.asset.clone()).collect();
            let finer: Vec<_> = finer.iter().map(|asset| asset.shared_mesh()).collect();
            let coarse = measured(&asset, &open, parts, &finer, detail);
            above.push(Node { objects, asset, is_object: false, is_coarse: true, detail: coarse.detail });
            world.coarse.push(coarse);
        }
        nodes = above;
    }
    Ok(left_out)
}

/// Per object the number of its run.
fn runs_of_objects(runs: &[&[Node]], objects: usize) -> Vec<u32> {
    let mut of_objects: Vec<u32> = (0..objects).map(|object| (runs.len() + object) as u32).collect();
    for (number, run) in (0u32..).zip(runs) {
        run.iter().flat_map(|node| &node.objects).for_each(|&object| of_objects[object] = number);
    }
    of_objects
}
