//! The survey: every photograph is read once, and asked what it sees.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use fantex_bake::Progress;
use fantex_mesh::Mesh;
use fantex_texture::Image;
use glam::{DVec2, Vec3};
use half::f16;
use rayon::prelude::*;

use crate::blend::{Doubt, KEPT_SHARE, kept_weight};
use crate::clusters::Clusters;
use crate::gains::Observation;
use crate::mask::Mask;
use crate::pages::{PageReader, PageStore};
use crate::photograph::have_one_shape;
use crate::probes::Probes;
use crate::pyramid::{Pyramid, level_for_width};
use crate::sight::SightMap;
use crate::view::{Seen, View, mesh_camera, seen};
use crate::{PhotoError, PhotoOptions, Photograph};

/// Side of the patch around a probe whose colour is taken, mesh units: large beside errors of the cameras, small beside the model.
const PATCH: f32 = 0.006;
/// Bytes that reading a photograph takes per pixel: decoded, as its finest level, and the next one.
const BYTES_PER_PIXEL: u64 = 9;
/// The same with a mask.
const MASKED_BYTES_PER_PIXEL: u64 = 12;
/// Best views that are remembered per probe.
const BEST: usize = 4;
/// Probes that see less of a mask than this are not seen.
const SMALLEST_ALPHA: f32 = 0.05;

/// One of the best views of a probe.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BestView {
    view: u32,
    weight: f32,
    color: [f16; 3],
    confidence: f16,
}

/// The best views of a probe, best first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BestViews([BestView; BEST]);

impl BestViews {
    const NONE: Self =
        Self([BestView { view: u32::MAX, weight: 0.0, color: [f16::ZERO; 3], confidence: f16::ZERO }; BEST]);

    /// Keeps a view if it is one of the best; true if it is the best. Of equals the first one stays.
    fn add(&mut self, new: BestView) -> bool {
        let place = self.0.iter().position(|old| new.weight > old.weight);
        if let Some(place) = place {
            self.0[place..].rotate_right(1);
            self.0[place] = new;
        }
        place == Some(0)
    }

    fn views(&self) -> impl Iterator<Item = &BestView> {
        self.0.iter().filter(|best| best.weight > 0.0)
    }

    /// The largest weight.
    pub(crate) fn weight(&self) -> f32 {
        self.0[0].weight
    }

    /// How sure it is that the probe is seen.
    pub(crate) fn confidence(&self) -> f32 {
        self.views().fold(Doubt::WHOLE, |doubt, best| doubt.less(best.confidence.to_f32())).confidence()
    }

    /// What the best views see, for exposure.
    pub(crate) fn observations(&self) -> Vec<Observation> {
        let observation = |best: &BestView| Observation {
            view: best.view,
            weight: best.weight,
            color: Vec3::from(best.color.map(f16::to_f32)),
        };
        self.views().map(observation).collect()
    }

    /// The blended colour, with the photographs' gains.
    pub(crate) fn color(&self, gains: &[Vec3]) -> Option<Vec3> {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for best in self.views().filter(|best| best.weight > self.weight() * KEPT_SHARE) {
            let weight = kept_weight(best.weight, self.weight());
            sum += Vec3::from(best.color.map(f16::to_f32)) * gains[best.view as usize] * weight;
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    }
}

/// What the survey finds.
pub(crate) struct Survey {
    /// One per photograph; nothing for those that see nothing.
    pub(crate) views: Vec<Option<View>>,
    pub(crate) clusters: Clusters,
    pub(crate) probes: Probes,
    pub(crate) best: Vec<BestViews>,
    /// Pixels of the best view per mesh unit, per probe; 0 where there is none.
    pub(crate) sharpness: Vec<f32>,
}

/// One photograph's part.
struct Surveyed {
    view: View,
    /// Per probe.
    weights: Vec<f32>,
    /// Probe, what is remembered of it, pixels of the file per mesh unit.
    seen: Vec<(u32, BestView, f32)>,
}

/// What reading the photographs shares.
struct Reading<'a> {
    mesh: &'a Mesh,
    probes: &'a Probes,
    store: &'a PageStore,
    options: &'a PhotoOptions,
    progress: &'a dyn Progress,
    done: AtomicU64,
    total: u64,
}

/// Reads all photographs into `store`. Progress counts pixels.
pub(crate) fn survey(
    mesh: &Mesh,
    photographs: &[Photograph],
    store: &PageStore,
    options: &PhotoOptions,
    progress: &dyn Progress,
) -> Result<Survey, PhotoError> {
    let probes = Probes::new(mesh);
    let mut clusters = Clusters::new(mesh);
    let mut best = vec![BestViews::NONE; probes.spots.len()];
    let mut sharpness = vec![0.0; probes.spots.len()];
    let mut views = Vec::with_capacity(photographs.len());
    let total = photographs.iter().map(pixels).sum();
    let reading = Reading { mesh, probes: &probes, store, options, progress, done: AtomicU64::new(0), total };
    for (first, batch) in batches(photographs, options.memory_bytes / 2) {
        let read: Vec<Option<Surveyed>> = batch
            .par_iter()
            .enumerate()
            .map(|(i, photograph)| reading.survey((first + i) as u32, photograph))
            .collect::<Result<_, PhotoError>>()?;
        for surveyed in read {
            let Some(Surveyed { view, weights, seen }) = surveyed else {
                views.push(None);
                continue;
            };
            clusters.add(views.len() as u32, mesh, &probes, &weights);
            for (probe, entry, pixels) in seen {
                if best[probe as usize].add(entry) {
                    sharpness[probe as usize] = pixels;
                }
            }
            views.push(Some(view));
        }
    }
    let largest: Vec<f32> = best.iter().map(BestViews::weight).collect();
    clusters.prune(mesh, &probes, &largest);
    Ok(Survey { views, clusters, probes, best, sharpness })
}

fn pixels(photograph: &Photograph) -> u64 {
    photograph.camera.size.map(u64::from).iter().product()
}

/// Runs of photographs that are read at the same time, with the index of the first.
fn batches(photographs: &[Photograph], memory_bytes: u64) -> Vec<(usize, &[Photograph])> {
    let bytes = |photograph: &Photograph| match photograph.mask {
        Some(_) => pixels(photograph) * MASKED_BYTES_PER_PIXEL,
        None => pixels(photograph) * BYTES_PER_PIXEL,
    };
    let largest = photographs.iter().map(bytes).max().unwrap_or(1).max(1);
    let fitting = memory_bytes / largest;
    let at_once = (fitting as usize).clamp(1, rayon::current_num_threads());
    photographs.chunks(at_once).enumerate().map(|(i, batch)| (i * at_once, batch)).collect()
}

impl Reading<'_> {
    fn survey(&self, number: u32, photograph: &Photograph) -> Result<Option<Surveyed>, PhotoError> {
        if self.progress.is_cancelled() {
            return Err(PhotoError::Cancelled);
        }
        let surveyed = self.look(number, photograph)?;
        let pixels = pixels(photograph);
        self.progress.report(self.done.fetch_add(pixels, Relaxed) + pixels, self.total);
        Ok(surveyed)
    }

    fn look(&self, number: u32, photograph: &Photograph) -> Result<Option<Surveyed>, PhotoError> {
        let scratch = |source| PhotoError::Scratch { folder: self.options.scratch.clone(), source };
        let camera = mesh_camera(photograph, self.mesh);
        let map = SightMap::draw(self.mesh, &camera);
        let sight = map.store(self.store).map_err(scratch)?;
        let spots = self.probes.spots.par_iter().with_min_len(1 << 11);
        let looked: Vec<Option<Seen>> = spots
            .map_init(|| PageReader::new(self.store), |reader, spot| seen(&camera, &sight, reader, spot))
            .collect();
        let mut resolutions: Vec<f32> = looked.iter().flatten().map(|seen| seen.resolution).collect();
        if resolutions.is_empty() {
            return Ok(None);
        }
        let image = Image::load(&photograph.path)?;
        let size = [image.width, image.height];
        let mask = photograph.mask.as_deref().map(|path| Mask::load(path, size)).transpose()?;
        let scale = file_scale(photograph, &image)?;
        let middle = resolutions.len() / 2;
        let resolution = *resolutions.select_nth_unstable_by(middle, f32::total_cmp).1;
        let finest =
            self.options.texel_size.map_or(0, |texel| level_for_width(texel * resolution * scale.x as f32));
        let is_seen = |rect| map.sees_any(rect, 1.0 / scale);
        let pyramid = Pyramid::new(image, mask.as_ref(), finest, self.store, is_seen).map_err(scratch)?;
        let view = View { camera, sight, pyramid, gain: Vec3::ONE };
        let weights = looked.iter().map(|seen| seen.map_or(0.0, |seen| seen.weight)).collect();
        let seen = looked
            .par_iter()
            .enumerate()
            .with_min_len(1 << 11)
            .map_init(
                || PageReader::new(self.store),
                |reader, (probe, seen)| {
                    let seen = seen.as_ref()?;
                    let color = view.color_within(reader, seen, PATCH);
                    let entry = BestView {
                        view: number,
                        weight: seen.weight * color.w,
                        color: color.truncate().to_array().map(f16::from_f32),
                        confidence: f16::from_f32(seen.confidence * color.w),
                    };
                    let is_masked = color.w < SMALLEST_ALPHA;
                    (!is_masked).then_some((probe as u32, entry, seen.resolution * scale.x as f32))
                },
            )
            .collect::<Vec<_>>();
        let seen = seen.into_iter().flatten().collect();
        Ok(Some(Surveyed { view, weights, seen }))
    }
}

/// Pixels of the file per pixel of the camera.
fn file_scale(photograph: &Photograph, image: &Image) -> Result<DVec2, PhotoError> {
    let (found, expected) = ([image.width, image.height], photograph.camera.size);
    match have_one_shape(found, expected) {
        true => Ok(DVec2::from(found.map(f64::from)) / DVec2::from(expected.map(f64::from))),
        false => Err(PhotoError::Shape { path: photograph.path.clone(), found, expected }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CameraFromWorld, PhotoCamera};

    #[test]
    fn the_best_views_stay_in_order() {
        let entry = |view: u32, weight: f32| BestView {
            view,
            weight,
            color: [f16::from_f32(weight); 3],
            confidence: f16::from_f32(0.5),
        };
        let mut best = BestViews::NONE;
        assert_eq!(best.confidence(), 0.0);
        assert_eq!(best.color(&[]), None);
        let added = [(0, 0.25), (1, 0.5), (2, 0.125), (3, 0.5), (4, 0.75), (5, 0.0)]
            .map(|(v, w)| best.add(entry(v, w)));
        assert_eq!(added, [true, true, false, false, true, false]);
        assert_eq!(best.views().map(|b| b.view).collect::<Vec<_>>(), [4, 1, 3, 0]);
        assert_eq!(best.weight(), 0.75);
        assert!((best.confidence() - 0.9375).abs() < 1e-6);
        let color = best.color(&[Vec3::ONE; 6]).unwrap();
        assert!(color.x > 0.5 && color.x < 0.75, "{color}");
    }

    #[test]
    fn batches_follow_the_memory() {
        let photograph = Photograph {
            name: String::new(),
            path: std::path::PathBuf::new(),
            mask: None,
            camera: PhotoCamera::pinhole([6000, 4000], 5000.0),
            camera_from_world: CameraFromWorld::looking_at(glam::DVec3::Z, glam::DVec3::ZERO, glam::DVec3::Y),
        };
        let many = vec![photograph; 7];
        for memory in [0, 1 << 28, 1 << 40] {
            let batches = batches(&many, memory);
            assert_eq!(batches.iter().map(|b| b.1.len()).sum::<usize>(), 7);
            assert!(batches.iter().all(|(first, batch)| first + batch.len() <= 7));
            if memory < 1 << 30 {
                assert_eq!(batches.len(), 7, "one at a time");
            }
        }
    }
}
