//! Opening of objects and previews, beside what draws: by threads, in browsers by tasks of the page.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::Sender;

#[cfg(not(target_arch = "wasm32"))]
use fantex_base::Error;
use fantex_base::Result;
use fantex_mesh::WorldFromMesh;
use fantex_store::Asset;
#[cfg(target_arch = "wasm32")]
use fantex_stream::MAX_COARSE_BYTES;
use fantex_stream::read::FileReadOptions;
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, CoveredMesh, Geometry, SurfaceSamples, World};

use crate::{FanModel, Gpu, Model as _, StreamedModel};

/// What to open.
pub(super) struct Order {
    /// Its number.
    pub(super) object: usize,
    /// Where its asset is.
    pub(super) place: PathBuf,
    /// What of it.
    pub(super) what: What,
    /// The space that all objects are drawn in.
    pub(super) space: WorldFromMesh,
    /// For texels of a whole one.
    pub(super) pool_bytes: u64,
}

/// What there is of objects and coarse assets.
#[derive(Clone, Copy)]
pub(super) enum What {
    Preview,
    Whole,
    /// The coarse asset, which is small.
    Coarse,
}

#[cfg(not(target_arch = "wasm32"))]
impl What {
    fn failed(self, error: Error) -> OpenedDetail {
        match self {
            Self::Whole => OpenedDetail::Whole(Err(error)),
            Self::Preview | Self::Coarse => OpenedDetail::Preview(Err(error)),
        }
    }

    /// What `open` gives, be it that it panics.
    fn opened_by(self, place: &Path, open: impl FnOnce() -> OpenedDetail) -> OpenedDetail {
        // What it leaves half done goes with it.
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(open)).unwrap_or_else(|_| {
            let place = place.display();
            self.failed(Error::unavailable(format!(
                "cannot open {place}: the program failed on it; please report the file"
            )))
        })
    }
}

/// Objects, previews and coarse assets that are opened at a time.
const OPENED_AT_ONCE: usize = 2;

/// Previews and coarse assets that are fetched at a time from addresses, beside as many objects: they mostly wait for answers.
const FETCHED_AT_ONCE: usize = 6;

/// How many are being opened.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Opening {
    wholes: usize,
    /// Previews and coarse assets.
    small: usize,
}

impl Opening {
    pub(super) fn is_none(self) -> bool {
        self.wholes + self.small == 0
    }

    /// Whether there can be no more, of whatever kind.
    pub(super) fn is_full(self) -> bool {
        self.wholes >= OPENED_AT_ONCE && self.small >= FETCHED_AT_ONCE
    }

    /// Whether another may be opened: a whole object or something small, from an address or from a file.
    pub(super) fn may_add(self, is_whole: bool, is_remote: bool) -> bool {
        match (is_remote, is_whole) {
            (false, _) => self.wholes + self.small < OPENED_AT_ONCE,
            (true, true) => self.wholes < OPENED_AT_ONCE,
            (true, false) => self.small < FETCHED_AT_ONCE,
        }
    }

    pub(super) fn count(&mut self, is_whole: bool) -> &mut usize {
        if is_whole { &mut self.wholes } else { &mut self.small }
    }
}

/// What has been opened.
pub(super) struct Opened {
    pub(super) object: usize,
    pub(super) result: OpenedDetail,
}

pub(super) enum OpenedDetail {
    /// A preview or a coarse asset.
    Preview(Result<Box<(FanModel, SurfaceSamples)>>),
    Whole(Result<Box<StreamedModel>>),
}

/// Begins to open something; what comes of it is sent, be it that the system refuses a thread, or that the thread panics.
#[cfg(not(target_arch = "wasm32"))]
pub(super) fn begin(gpu: &Arc<Gpu>, order: Order, sender: Sender<Opened>) {
    let (gpu, place, object, what) = (Arc::clone(gpu), order.place.clone(), order.object, order.what);
    let refused = sender.clone();
    let open = move || {
        let Order { object, place, what, space, pool_bytes } = order;
        let in_memory = |asset: Result<Asset>| {
            let small = asset.and_then(|asset| small(&gpu, asset, &space));
            OpenedDetail::Preview(small.map(Box::new))
        };
        let result = what.opened_by(&place, || match what {
            What::Whole => OpenedDetail::Whole(open_whole(&gpu, &place, &space, pool_bytes).map(Box::new)),
            What::Preview => in_memory(World::open_preview(&place)),
            What::Coarse => in_memory(World::open_coarse(&place)),
        });
        // Whoever dropped the world does not want it.
        sender.send(Opened { object, result }).unwrap_or_default();
    };
    let thread = std::thread::Builder::new().name("fantex-object".into());
    if let Err(source) = thread.spawn(open) {
        let message = format!("cannot start a thread to open {}: {source}", place.display());
        let result = what.failed(Error::unavailable(message));
        refused.send(Opened { object, result }).unwrap_or_default();
    }
}

/// As above, by a task of the page: meshes and covers are fetched beside what is drawn, and unpacked between two frames.
#[cfg(target_arch = "wasm32")]
pub(super) fn begin(gpu: &Arc<Gpu>, order: Order, sender: Sender<Opened>) {
    let gpu = Arc::clone(gpu);
    fantex_stream::read::spawn(async move {
        let Order { object, place, what, space, pool_bytes } = order;
        let in_memory = |asset: Result<Asset>| {
            let small = asset.and_then(|asset| small(&gpu, asset, &space));
            OpenedDetail::Preview(small.map(Box::new))
        };
        let result = match what {
            What::Whole => {
                OpenedDetail::Whole(fetch_whole(&gpu, &place, &space, pool_bytes).await.map(Box::new))
            }
            What::Preview => in_memory(fetch_preview(&place).await),
            What::Coarse => in_memory(fetch_coarse(&place).await),
        };
        // Whoever dropped the world does not want it.
        sender.send(Opened { object, result }).unwrap_or_default();
    });
}

#[cfg(not(target_arch = "wasm32"))]
fn open_whole(gpu: &Gpu, place: &Path, space: &WorldFromMesh, pool_bytes: u64) -> Result<StreamedModel> {
    let asset = Arc::new(fantex_stream::open_asset(place)?);
    let loader = ClusterLoader::open(Arc::clone(&asset), &loader_options(gpu))?;
    whole(gpu, &asset, loader, space, pool_bytes)
}

/// Requests at a time for the texels of an object: browsers allow a server six, for all objects together.
#[cfg(target_arch = "wasm32")]
const CONNECTIONS: usize = 2;

/// Time of a frame that goes into unpacking the texels of an object.
#[cfg(target_arch = "wasm32")]
const UNPACKING_SLICE: std::time::Duration = std::time::Duration::from_millis(2);

#[cfg(target_arch = "wasm32")]
async fn fetch_whole(
    gpu: &Gpu,
    place: &Path,
    space: &WorldFromMesh,
    pool_bytes: u64,
) -> Result<StreamedModel> {
    let file = remote_file(place);
    let asset = Arc::new(std::rc::Rc::clone(&file).start().await?.asset().await?);
    let reader = Box::new(file.reader(CONNECTIONS));
    let loader = ClusterLoader::without_threads(asset.clone(), reader, &loader_options(gpu), UNPACKING_SLICE);
    whole(gpu, &asset, loader, space, pool_bytes)
}

#[cfg(target_arch = "wasm32")]
async fn fetch_preview(place: &Path) -> Result<Asset> {
    let preview = remote_file(place).start().await?.preview().await?;
    preview.ok_or_else(|| World::no_preview(place))
}

#[cfg(target_arch = "wasm32")]
async fn fetch_coarse(place: &Path) -> Result<Asset> {
    World::coarse_from(place, remote_file(place).fetch_whole(MAX_COARSE_BYTES).await?)
}

#[cfg(target_arch = "wasm32")]
fn remote_file(place: &Path) -> std::rc::Rc<fantex_stream::read::RemoteFile> {
    std::rc::Rc::new(fantex_stream::read::RemoteFile::new(place.to_string_lossy().into_owned()))
}

/// Reads of an object in flight at most: where the system has no completion queue, each takes a thread.
const READS_IN_FLIGHT: usize = 4;

/// Caches are small, and threads few: many objects have their own.
fn loader_options(gpu: &Gpu) -> ClusterLoaderOptions {
    ClusterLoaderOptions {
        block_compressed: gpu.has_block_compression(),
        worker_threads: 1,
        in_flight_bytes: 4 << 20,
        cache_bytes: 8 << 20,
        stored_cache_bytes: 16 << 20,
        ready_bytes: 4 << 20,
        file: FileReadOptions { depth: READS_IN_FLIGHT, ..FileReadOptions::default() },
        ..ClusterLoaderOptions::default()
    }
}

/// A whole object on the device, without texels.
fn whole(
    gpu: &Gpu,
    asset: &Arc<Asset>,
    loader: ClusterLoader,
    space: &WorldFromMesh,
    pool_bytes: u64,
) -> Result<StreamedModel> {
    StreamedModel::with_pages(gpu, asset, geometry_in(asset, space), Box::new(loader), pool_bytes)
}

/// A preview or a coarse asset on the device, with all its texels.
fn small(gpu: &Gpu, asset: Asset, space: &WorldFromMesh) -> Result<(FanModel, SurfaceSamples)> {
    let asset = Arc::new(asset);
    let model = FanModel::complete(gpu, &asset, &*geometry_in(&asset, space))?;
    let surface = SurfaceSamples::of(&model.space().points);
    Ok((model, surface))
}

/// The asset itself, where it lies in that space.
fn geometry_in(asset: &Arc<Asset>, space: &WorldFromMesh) -> Arc<dyn Geometry> {
    let from = asset.mesh().world_from_mesh;
    if from == *space {
        return Arc::<Asset>::clone(asset);
    }
    let (mut mesh, mut cover) = (asset.mesh().clone(), asset.cover().clone());
    mesh.move_to(*space);
    cover.move_between(&from, space);
    Arc::new(CoveredMesh { mesh, cover })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_from_addresses_wait_beside_each_other_and_keep_no_object_waiting() {
        let mut opening = Opening::default();
        for is_whole in [false, true] {
            while opening.may_add(is_whole, true) {
                assert!(!opening.is_full());
                *opening.count(is_whole) += 1;
            }
        }
        assert_eq!((opening.wholes, opening.small), (OPENED_AT_ONCE, FETCHED_AT_ONCE));
        assert!(opening.is_full());
        let mut opening = Opening { wholes: 1, small: 0 };
        assert!(opening.may_add(false, false));
        *opening.count(false) += 1;
        assert!(!opening.may_add(true, false) && !opening.may_add(false, false) && !opening.is_none());
    }

    #[test]
    fn a_panic_is_a_failure_of_what_was_to_be_opened() {
        let told = |what: What| match what.opened_by(Path::new("a.fan"), || panic!("on purpose")) {
            OpenedDetail::Preview(result) => (false, result.err().unwrap().to_string()),
            OpenedDetail::Whole(result) => (true, result.err().unwrap().to_string()),
        };
        let sentence = "cannot open a.fan: the program failed on it; please report the file";
        for (what, is_whole) in [(What::Preview, false), (What::Whole, true), (What::Coarse, false)] {
            assert_eq!(told(what), (is_whole, sentence.to_owned()));
        }
    }
}
