//! Pictures of a baked asset beside those of its model, by processor time: `fantex bench render` for machines that others use, too.
//!
//! ```text
//! fantex bake bottle.gltf -o bottle.fan --texels 16M
//! cargo run --release -p fantex-render --example picture_speed -- bottle.gltf bottle.fan [ROUNDS] [fans | model]
//! ```
//!
//! Pictures of 1280x720 pixels with one and with four samples; both kinds take turns. Printed are the cheapest of each, on Linux. With
//! a last word only those of one kind are made, for a profiler.

use std::sync::Arc;

use fantex_mesh::{CleanOptions, LoadOptions, clean, load};
use fantex_render::{FanSurface, LookSurface, RenderOptions, Surface, render};
use fantex_scene::{Camera, FilterOptions, Lights};
use fantex_store::{Asset, PageCache};
use fantex_texture::Filter;

type Failure = Box<dyn std::error::Error>;

const MEMORY_BYTES: usize = 1 << 30;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let (Some(model), Some(asset)) = (arguments.next(), arguments.next()) else {
        return Err("expected a model and an asset that was baked from it".into());
    };
    let rounds = arguments.next().map_or(Ok(10), |text| text.parse::<u32>())?;
    let only = arguments.next();
    let (mesh, ..) = clean(load(model.as_ref(), &LoadOptions::default())?, &CleanOptions::default())?;
    let cache = PageCache::new(Arc::new(Asset::open(asset.as_ref())?), MEMORY_BYTES);
    for filter in [Filter::Trilinear, Filter::Anisotropic] {
        for samples in [1, 4] {
            let options = RenderOptions { samples, ..RenderOptions::default() };
            let aspect = f64::from(options.width) / f64::from(options.height);
            let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, aspect);
            let filter = FilterOptions { filter, ..FilterOptions::default() };
            let fans = FanSurface::of_asset(&cache, filter);
            let own = LookSurface::of_model(&mesh, filter)?;
            let milliseconds = |surface: &dyn Surface| -> Result<f64, Failure> {
                let before = processor_nanoseconds();
                render(&mesh, surface, &camera, &Lights::behind(&camera), &options)?;
                Ok((processor_nanoseconds() - before) as f64 * 1e-6)
            };
            let mut best = [f64::INFINITY; 2];
            for _ in 0..rounds {
                let surfaces: [(&str, &dyn Surface); 2] = [("fans", &fans), ("model", &own)];
                for ((kind, surface), best) in surfaces.into_iter().zip(&mut best) {
                    if only.as_ref().is_none_or(|only| only == kind) {
                        *best = best.min(milliseconds(surface)?);
                    }
                }
            }
            let [fans, model] = best;
            println!(
                "{:?}, {samples} samples: fans {fans:.1} ms, model {model:.1} ms, ratio {:.2}",
                filter.filter,
                fans / model
            );
        }
    }
    Ok(())
}

/// Of all threads that run; 0 where the system does not tell.
fn processor_nanoseconds() -> u64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = |thread: std::fs::DirEntry| -> Option<u64> {
        std::fs::read_to_string(thread.path().join("schedstat")).ok()?.split(' ').next()?.parse().ok()
    };
    threads.filter_map(nanoseconds).sum()
}
