//! The first picture of an asset far away, over a connection of given latency and bandwidth: with a preview, and without.

use std::error::Error;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread::sleep;
use std::time::{Duration, Instant};

use fantex::mesh::generate::{LandscapeOptions, landscape};
use fantex::render::{FanSurface, FilterOptions, Lights, RenderOptions, render};
use fantex::scene::Camera;
use fantex::store::{Asset, ByteSource, FileSource, PageCache};
use fantex::{Baker, Mesh, Preview, PreviewOptions, Source};

use crate::{Measured, Row};

const TRIANGLES: u64 = 1_000_000;
const TEXELS: u64 = 64_000_000;

const LINKS: [(&str, Link); 2] = [
    ("50 ms, 100 Mbit/s", Link { latency: Duration::from_millis(50), bytes_per_second: 12.5e6 }),
    ("50 ms, 20 Mbit/s", Link { latency: Duration::from_millis(50), bytes_per_second: 2.5e6 }),
];

#[derive(Clone, Copy, Debug)]
struct Link {
    latency: Duration,
    bytes_per_second: f64,
}

/// A file behind a link: every read waits for its latency, and for its bytes.
#[derive(Debug)]
struct Remote {
    file: FileSource,
    link: Link,
    bytes: AtomicU64,
}

impl ByteSource for Remote {
    fn location(&self) -> &Path {
        self.file.location()
    }

    fn length(&self) -> io::Result<u64> {
        self.file.length()
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let count = self.file.read_at(bytes, offset)?;
        self.bytes.fetch_add(count as u64, Relaxed);
        sleep(self.link.latency + Duration::from_secs_f64(count as f64 / self.link.bytes_per_second));
        Ok(count)
    }
}

/// A landscape of 64 M texels on a million triangles.
pub(crate) fn rows() -> Measured {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("land.fan");
    let land = landscape(&LandscapeOptions { triangles: TRIANGLES, ..LandscapeOptions::default() })?;
    let positions: Vec<[f64; 3]> = land.positions.iter().map(|p| p.as_dvec3().to_array()).collect();
    let mesh = Mesh::from_triangles(&positions, &land.triangles)?;
    Baker::new(&mesh).texels(TEXELS).source(Source::solid("landscape")).write(&path)?;
    drop(mesh);
    let started = Instant::now();
    Preview::add_to(&path, &PreviewOptions::default())?;
    let mut rows = vec![Row::new("preview of a million triangles", started.elapsed().as_secs_f64(), "s")];
    for (name, link) in LINKS {
        let (with, without) = (first_picture(&path, link, true)?, first_picture(&path, link, false)?);
        let (seconds, bytes) =
            (format!("first picture over {name}"), format!("bytes before it, over {name}"));
        rows.push(Row::new(seconds, with.0, "s").beside(Some(without.0)));
        rows.push(Row::new(bytes, with.1, "MB").beside(Some(without.1)));
    }
    Ok(rows)
}

/// Seconds and megabytes until a picture of the preview is drawn; without it, until the asset is open, so that its mean colours can be drawn.
fn first_picture(path: &Path, link: Link, has_preview: bool) -> Result<(f64, f64), Box<dyn Error>> {
    let remote = Arc::new(Remote { file: FileSource::open(path)?, link, bytes: AtomicU64::new(0) });
    let started = Instant::now();
    // The connection is made first.
    sleep(link.latency);
    if has_preview {
        let preview = Arc::new(Asset::open_preview(&*remote)?.ok_or("there is no preview")?);
        let cache = PageCache::new(Arc::clone(&preview), 64 << 20);
        let options = RenderOptions { width: 640, height: 360, samples: 1, ..RenderOptions::default() };
        let camera = Camera::framing_mesh(preview.mesh(), Camera::THREE_QUARTER, 640.0 / 360.0);
        let surface = FanSurface::of_asset(&cache, FilterOptions::default());
        render(preview.mesh(), &surface, &camera, &Lights::behind(&camera), &options)?;
    } else {
        Asset::open_source(remote.clone())?;
    }
    Ok((started.elapsed().as_secs_f64(), remote.bytes.load(Relaxed) as f64 / 1e6))
}
