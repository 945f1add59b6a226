//! What a network loses for a while comes when it is there again.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

use fantex_base::Error;
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, clean, generate};
use fantex_stream::{
    CameraKeyframe, CoveredMesh, FrameOptions, LoadedParcel, Outline, Parcel, ParcelLoader, ParcelTexels,
    Streamer, StreamerOptions,
};

/// Answers at once: by an error of a kind, or, without one, by texels.
struct Server {
    geometry: Arc<CoveredMesh>,
    error: Arc<Mutex<Option<io::ErrorKind>>>,
    asked: Arc<AtomicU32>,
    pending: Vec<Parcel>,
    is_remote: bool,
}

impl ParcelLoader for Server {
    fn request(&mut self, parcel: Parcel, _: f32) {
        self.asked.fetch_add(1, Relaxed);
        self.pending.push(parcel);
    }

    fn cancel(&mut self, parcel: Parcel) {
        self.pending.retain(|&other| other != parcel);
    }

    fn poll(&mut self, _: usize) -> Vec<LoadedParcel> {
        let error = *self.error.lock().unwrap();
        let loaded = |parcel: Parcel| {
            let extent = parcel.layout(&self.geometry.cover).extent;
            let texels = match error {
                Some(kind) => Err(Error::reading(Path::new("https://a.org/a.fan"), kind.into())),
                None => Ok(ParcelTexels {
                    extent,
                    outline: Outline::WHOLE,
                    channels: vec![Arc::from(vec![0; 16])],
                }),
            };
            LoadedParcel { parcel, texels }
        };
        self.pending.drain(..).map(loaded).collect()
    }

    fn pending(&self) -> usize {
        self.pending.len()
    }

    fn is_remote(&self) -> bool {
        self.is_remote
    }
}

/// A streamer whose loader fails, and who looks at it for many frames of a quarter of a second.
struct Stage {
    streamer: Streamer,
    geometry: Arc<CoveredMesh>,
    error: Arc<Mutex<Option<io::ErrorKind>>>,
    asked: Arc<AtomicU32>,
}

impl Stage {
    fn new(kind: io::ErrorKind, is_remote: bool) -> Self {
        let (mesh, _) = clean(generate::icosphere(3), &CleanOptions::default()).unwrap();
        let options =
            CoverOptions { budget: TexelBudget::Total(1 << 18), tile: 64, ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        let geometry = Arc::new(CoveredMesh { mesh, cover });
        let error = Arc::new(Mutex::new(Some(kind)));
        let asked = Arc::new(AtomicU32::new(0));
        let loader = Server {
            geometry: geometry.clone(),
            error: error.clone(),
            asked: asked.clone(),
            pending: Vec::new(),
            is_remote,
        };
        let streamer = Streamer::new(geometry.clone(), Box::new(loader), StreamerOptions::default());
        Self { streamer, geometry, error, asked }
    }

    /// Looks for so many quarters of a second; how many parcels were asked for.
    fn look(&mut self, frames: u32) -> u32 {
        let camera = CameraKeyframe {
            seconds: 0.0,
            eye: [0.0, 0.0, 3.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 45.0,
            is_cut: false,
        };
        let view = camera.view(&self.geometry.mesh.world_from_mesh, [640, 360]);
        let before = self.asked.load(Relaxed);
        for _ in 0..frames {
            let frame = FrameOptions { upload_bytes: 1 << 24, elapsed_seconds: 0.25 };
            self.streamer.update(view.as_ref(), frame);
            self.streamer.sanity_check();
        }
        self.asked.load(Relaxed) - before
    }

    fn damaged(&self) -> usize {
        self.streamer.damaged().count()
    }
}

#[test]
fn what_a_network_has_lost_is_asked_for_again_ever_more_rarely() {
    let mut stage = Stage::new(io::ErrorKind::ConnectionRefused, true);
    stage.look(60);
    let damaged = stage.damaged() as u32;
    assert!(damaged > 10);
    assert_eq!(stage.streamer.statistics().recoverable as u32, damaged);
    // In four minutes once in a minute, at the end.
    let asked = stage.look(4 * 240);
    assert!((damaged..=6 * damaged).contains(&asked), "{asked} of {damaged}");
    assert_eq!(stage.damaged() as u32, damaged);
    *stage.error.lock().unwrap() = None;
    stage.look(250);
    assert_eq!((stage.damaged(), stage.streamer.statistics().missing), (0, 0));
    assert!(stage.streamer.is_settled());
    assert!(stage.streamer.statistics().resident.parcels > 0);
    assert_eq!(stage.look(40), 0);
}

#[test]
fn what_stays_wrong_is_asked_for_once() {
    for (kind, is_remote) in [(io::ErrorKind::NotFound, true), (io::ErrorKind::ConnectionRefused, false)] {
        let mut stage = Stage::new(kind, is_remote);
        stage.look(60);
        assert!(stage.damaged() > 10 && stage.streamer.statistics().recoverable == 0);
        assert_eq!(stage.look(400), 0);
    }
}
