//! The survey: every photograph is read once, and asked what it sees.

use std::path::Path;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use fantex_bake::Progress;
use fantex_base::{Error, ReadLimits, Result, input};
use fantex_mesh::{Mesh, corner_normals, interpolate, morton};
use fantex_texture::Image;
use glam::{DVec2, Vec3};
use half::f16;
use image::{ColorType, ImageDecoder as _, ImageFormat, ImageReader};
use rayon::prelude::*;

use crate::blend::{Blend, KEPT_SHARE};
use crate::pyramid::{PageReader, PageStore, Pyramid, level_for_width};
use crate::sight::SightMap;
use crate::view::{Mask, Seen, Spot, View, have_one_shape, mesh_camera, seen};
use crate::{PhotoOptions, Photograph, scratch_error};

/// Side of the patch around a probe whose colour is taken, mesh units: large beside errors of the cameras, small beside the model.
const PATCH: f32 = 0.006;
/// Bytes per pixel of a photograph's finest level, and the next one: of images with 8 bits, and of others.
const LEVEL_BYTES: [u64; 2] = [6, 10];
/// Bytes per pixel of a mask.
const MASK_BYTES: u64 = 3;
/// Bytes that asking a photograph takes per probe: what it sees there, with which weight, resolution and colour.
const PROBE_BYTES: u64 = 80;
const BEST: usize = 4;
/// Probes that see less of a mask than this are not seen.
const MIN_ALPHA: f32 = 0.05;

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

    pub(crate) fn weight(&self) -> f32 {
        self.0[0].weight
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

    /// What they see together, with the photographs' gains.
    pub(crate) fn blend(&self, gains: &[Vec3]) -> Blend {
        let mut blend = Blend::default();
        for best in self.views() {
            let color = Vec3::from(best.color.map(f16::to_f32)) * gains[best.view as usize];
            blend.add(best.weight, color, best.confidence.to_f32());
        }
        blend
    }
}

pub(crate) struct Survey {
    /// One per photograph; nothing for those that see nothing.
    pub(crate) views: Vec<Option<View>>,
    pub(crate) clusters: Clusters,
    pub(crate) probes: Probes,
    pub(crate) best: Vec<BestViews>,
    /// Pixels of the best view per mesh unit, per probe; 0 where there is none.
    pub(crate) sharpness: Vec<f32>,
}

struct Surveyed {
    view: View,
    weights: Vec<f32>,
    /// Probe, what is remembered of it, pixels of the file per mesh unit.
    seen: Vec<(u32, BestView, f32)>,
}

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
) -> Result<Survey> {
    let probes = Probes::new(mesh);
    let mut clusters = Clusters::new(mesh);
    let mut best = vec![BestViews::NONE; probes.spots.len()];
    let mut sharpness = vec![0.0; probes.spots.len()];
    let mut views = Vec::with_capacity(photographs.len());
    let total = photographs.iter().map(pixels).sum();
    let reading = Reading { mesh, probes: &probes, store, options, progress, done: AtomicU64::new(0), total };
    let limits = ReadLimits::current();
    for (first, batch) in batches(photographs, probes.spots.len(), options.memory_bytes / 2) {
        let read: Vec<Option<Surveyed>> = batch
            .par_iter()
            .enumerate()
            .map(|(i, photograph)| limits.run(|| reading.survey((first + i) as u32, photograph)))
            .collect::<Result<_>>()?;
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

/// Bytes that reading a photograph takes per pixel: decoded, and as levels. What the file's header does not tell is 8-bit RGB, as JPEG
/// is, whose header is not worth reading the whole file.
fn bytes_per_pixel(path: &Path) -> u64 {
    let color = || {
        let file = std::io::BufReader::new(input::open(path).ok()?);
        let reader = ImageReader::new(file).with_guessed_format().ok()?;
        match reader.format()? {
            ImageFormat::Jpeg | ImageFormat::WebP => None,
            _ => input::guarded(|| Some(reader.into_decoder().ok()?.color_type()))?,
        }
    };
    let color = color().unwrap_or(ColorType::Rgb8);
    let is_deep = color.bytes_per_pixel() > color.channel_count();
    u64::from(color.bytes_per_pixel()) + LEVEL_BYTES[usize::from(is_deep)]
}

/// Runs of photographs that are read at the same time, with the index of the first.
fn batches(photographs: &[Photograph], probes: usize, memory_bytes: u64) -> Vec<(usize, &[Photograph])> {
    let bytes = |photograph: &Photograph| {
        let mask = photograph.mask.as_ref().map_or(0, |_| MASK_BYTES);
        pixels(photograph) * (bytes_per_pixel(&photograph.path) + mask) + probes as u64 * PROBE_BYTES
    };
    let largest = photographs.iter().map(bytes).max().unwrap_or(1).max(1);
    let fitting = memory_bytes / largest;
    let at_once = (fitting as usize).clamp(1, rayon::current_num_threads());
    photographs.chunks(at_once).enumerate().map(|(i, batch)| (i * at_once, batch)).collect()
}

fn cancelled() -> Error {
    Error::cancelled("reading photographs was cancelled")
}

impl Reading<'_> {
    fn survey(&self, number: u32, photograph: &Photograph) -> Result<Option<Surveyed>> {
        if self.progress.is_cancelled() {
            return Err(cancelled());
        }
        let surveyed = self.look(number, photograph)?;
        let pixels = pixels(photograph);
        self.progress.report(self.done.fetch_add(pixels, Relaxed) + pixels, self.total);
        Ok(surveyed)
    }

    fn look(&self, number: u32, photograph: &Photograph) -> Result<Option<Surveyed>> {
        let scratch = |source| scratch_error(&self.options.scratch, source);
        let camera = mesh_camera(photograph, self.mesh);
        let map = SightMap::draw(self.mesh, &camera, self.progress).ok_or_else(cancelled)?;
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
                    let is_masked = color.w < MIN_ALPHA;
                    (!is_masked).then_some((probe as u32, entry, seen.resolution * scale.x as f32))
                },
            )
            .collect::<Vec<_>>();
        let seen = seen.into_iter().flatten().collect();
        Ok(Some(Surveyed { view, weights, seen }))
    }
}

/// Pixels of the file per pixel of the camera.
fn file_scale(photograph: &Photograph, image: &Image) -> Result<DVec2> {
    let (found, expected) = ([image.width, image.height], photograph.camera.size);
    match have_one_shape(found, expected) {
        true => Ok(DVec2::from(found.map(f64::from)) / DVec2::from(expected.map(f64::from))),
        false => {
            let message = format!(
                "{} has {found:?} pixels, but its camera took {expected:?}, which is another shape; give the photographs that \
                 the cameras were calibrated with, or the same made smaller",
                photograph.path.display()
            );
            Err(Error::malformed(message).with_path(&photograph.path))
        }
    }
}

// ---- The exposure of the photographs, from what several of them see of the same surface.
//
// Every photograph gets a factor per channel, in linear light, such that colours of the same point agree as well as possible: least
// squares over all points and the photographs that see them, as panorama stitchers do (M. Brown and D. G. Lowe, "Automatic
// Panoramic Image Stitching using Invariant Features", 2007), with two changes. Differences of logarithms are
// summed, not of colours: a factor then is a summand, dark and light surfaces count alike, and factors do not
// shrink towards zero, where all differences vanish. And large residuals count less (P. J. Huber, "Robust Estimation of a Location
// Parameter", 1964), because highlights move with the camera and models do not fit everywhere.

#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    pub(crate) view: u32,
    /// Above 0.
    pub(crate) weight: f32,
    /// Linear.
    pub(crate) color: Vec3,
}

/// What is darker or lighter than this says little about the exposure.
const USABLE: std::ops::RangeInclusive<f32> = 0.004..=0.96;
/// Residuals above this, about 10 %, count less.
const HUBER: f64 = 0.1;
/// Repetitions with new weights of the residuals.
const REWEIGHTINGS: usize = 6;
/// Steps of the conjugate gradients.
const MAX_STEPS: usize = 200;
/// The pull towards 1, as a share of the mean weight of a photograph's observations.
const PULL: f64 = 1e-3;

/// The factors per photograph that make `points` agree; 1 for photographs that share nothing with others.
pub(crate) fn solve_gains(views: usize, points: &[Vec<Observation>]) -> Vec<Vec3> {
    let channels = [0, 1, 2].map(|channel| solve_channel(views, points, channel));
    (0..views)
        .map(|view| Vec3::from([0, 1, 2].map(|channel: usize| channels[channel][view].exp() as f32)))
        .collect()
}

#[derive(Clone, Copy)]
struct Term {
    view: usize,
    log: f64,
    weight: f64,
}

fn solve_channel(views: usize, points: &[Vec<Observation>], channel: usize) -> Vec<f64> {
    let points: Vec<Vec<Term>> =
        points.iter().map(|point| terms(point, channel)).filter(|p| p.len() > 1).collect();
    let mut gains = vec![0.0; views];
    let mut robust: Vec<Vec<Term>> = points.clone();
    for _ in 0..REWEIGHTINGS {
        gains = least_squares(&robust, gains);
        for (robust, point) in robust.iter_mut().zip(&points) {
            let mean = mean_of(robust, |term| term.log + gains[term.view]);
            for (robust, term) in robust.iter_mut().zip(point) {
                let residual = (term.log + gains[term.view] - mean).abs();
                robust.weight = term.weight * (HUBER / residual.max(HUBER));
            }
        }
    }
    gains
}

/// What can be used of a point's observations, with weights relative to the best.
fn terms(point: &[Observation], channel: usize) -> Vec<Term> {
    let largest = point.iter().map(|o| o.weight).fold(0.0, f32::max);
    let usable = point.iter().filter(|o| USABLE.contains(&o.color[channel]) && o.weight > 0.0);
    let term = |o: &Observation| Term {
        view: o.view as usize,
        log: f64::from(o.color[channel]).ln(),
        // The root brings weights closer together: views that are not the best measure exposure nearly as well.
        weight: f64::from(o.weight / largest).sqrt().max(1e-3),
    };
    usable.map(term).collect()
}

fn mean_of(point: &[Term], value: impl Fn(&Term) -> f64) -> f64 {
    let weight: f64 = point.iter().map(|term| term.weight).sum();
    point.iter().map(|term| term.weight * value(term)).sum::<f64>() / weight
}

/// The minimum of the sum over points of `weight (log + gain - mean)^2`, by conjugate gradients (M. Hestenes and E. Stiefel, 1952);
/// the means have been eliminated.
fn least_squares(points: &[Vec<Term>], start: Vec<f64>) -> Vec<f64> {
    let views = start.len();
    let total: f64 = points.iter().flatten().map(|term| term.weight).sum();
    let pull = PULL * total / views.max(1) as f64 + f64::MIN_POSITIVE;
    let apply = |x: &[f64]| {
        let mut y: Vec<f64> = x.iter().map(|x| pull * x).collect();
        for point in points {
            let mean = mean_of(point, |term| x[term.view]);
            point.iter().for_each(|term| y[term.view] += term.weight * (x[term.view] - mean));
        }
        y
    };
    let mut right = vec![0.0; views];
    for point in points {
        let mean = mean_of(point, |term| term.log);
        point.iter().for_each(|term| right[term.view] -= term.weight * (term.log - mean));
    }
    conjugate_gradients(apply, &right, start, MAX_STEPS, 1e-9)
}

/// Solves a symmetric, positive definite system.
pub(crate) fn conjugate_gradients(
    apply: impl Fn(&[f64]) -> Vec<f64>,
    right: &[f64],
    start: Vec<f64>,
    most_steps: usize,
    tolerance: f64,
) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = start;
    let mut residual: Vec<f64> = right.iter().zip(apply(&x)).map(|(b, ax)| b - ax).collect();
    let mut direction = residual.clone();
    let mut squared = dot(&residual, &residual);
    let enough = tolerance * tolerance * dot(right, right).max(squared);
    for _ in 0..most_steps {
        if squared <= enough {
            break;
        }
        let applied = apply(&direction);
        let step = squared / dot(&direction, &applied);
        if !step.is_finite() {
            break;
        }
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        residual.iter_mut().zip(&applied).for_each(|(r, a)| *r -= step * a);
        let next = dot(&residual, &residual);
        let share = next / squared;
        direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + share * *d);
        squared = next;
    }
    x
}

// ---- Which photographs a part of the surface needs.
//
// Triangles that lie close together form a cluster. A photograph belongs to a cluster if it sees one of its vertices or
// of the points spread over it, unless it weighs so little everywhere in it that blending drops it anyway. So a bake looks, per
// texel, at a dozen photographs instead of hundreds, and touches the pages of few.

/// Triangles of a cluster in large meshes.
const MAX_TRIANGLES: usize = 64;
/// Clusters that a small mesh is cut into at least.
const MIN_CLUSTERS: usize = 512;
/// Weights between the points that were asked may be this much larger.
const MARGIN: f32 = 8.0;

#[derive(Debug)]
pub(crate) struct Clusters {
    of_triangle: Vec<u32>,
    /// Per cluster its photographs, ascending, with the largest weight that they have in it.
    views: Vec<Vec<(u32, f32)>>,
}

impl Clusters {
    /// Clusters without photographs: triangles in the order of a space-filling curve (G. M. Morton, 1966), cut into runs.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let count = mesh.triangles.len();
        let size = (count / MIN_CLUSTERS).clamp(1, MAX_TRIANGLES);
        let mut order: Vec<(u32, u32)> = (0..count)
            .map(|t| {
                let [a, b, c] = mesh.triangle_positions(t);
                (morton((a + b + c) / 3.0), t as u32)
            })
            .collect();
        order.sort_unstable();
        let mut of_triangle = vec![0; count];
        for (rank, (_, triangle)) in order.into_iter().enumerate() {
            of_triangle[triangle as usize] = (rank / size) as u32;
        }
        Self { of_triangle, views: vec![Vec::new(); count.div_ceil(size)] }
    }

    /// Adds a photograph, in ascending order, with its weights at all probes.
    pub(crate) fn add(&mut self, view: u32, mesh: &Mesh, probes: &Probes, weights: &[f32]) {
        let largest = self.extremes(mesh, probes, weights, 0.0, f32::max);
        for (cluster, largest) in self.views.iter_mut().zip(largest) {
            if largest > 0.0 {
                cluster.push((view, largest));
            }
        }
    }

    /// Drops photographs that weigh next to nothing beside the best one everywhere in a cluster. `best` is the largest weight at every
    /// probe.
    pub(crate) fn prune(&mut self, mesh: &Mesh, probes: &Probes, best: &[f32]) {
        let smallest = self.extremes(mesh, probes, best, f32::INFINITY, f32::min);
        for (views, smallest) in self.views.iter_mut().zip(smallest) {
            views.retain(|&(_, largest)| largest * MARGIN >= smallest * KEPT_SHARE);
        }
    }

    /// The photographs that may see a triangle, ascending.
    pub(crate) fn views_of(&self, triangle: usize) -> impl Iterator<Item = u32> {
        self.views[self.of_triangle[triangle] as usize].iter().map(|&(view, _)| view)
    }

    /// The largest or smallest of the values at the probes of every cluster.
    fn extremes(
        &self,
        mesh: &Mesh,
        probes: &Probes,
        values: &[f32],
        start: f32,
        pick: fn(f32, f32) -> f32,
    ) -> Vec<f32> {
        let mut extremes = vec![start; self.views.len()];
        let (vertices, spread) = values.split_at(probes.vertices());
        for (triangle, &cluster) in mesh.triangles.iter().zip(&self.of_triangle) {
            let extreme = &mut extremes[cluster as usize];
            *extreme = triangle.iter().fold(*extreme, |e, &v| pick(e, vertices[v as usize]));
        }
        for (&triangle, &value) in probes.triangles.iter().zip(spread) {
            let extreme = &mut extremes[self.of_triangle[triangle as usize] as usize];
            *extreme = pick(*extreme, value);
        }
        extremes
    }
}

// ---- Points of the surface that the survey asks every photograph about: all vertices, and points spread evenly over the area.

const SPREAD: usize = 1 << 15;

/// The points: vertices first, then the spread points.
#[derive(Debug)]
pub(crate) struct Probes {
    pub(crate) spots: Vec<Spot>,
    /// The triangle of every spread point.
    pub(crate) triangles: Vec<u32>,
}

impl Probes {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let normals = vertex_normals(mesh);
        let vertices = mesh.positions.iter().zip(&normals);
        let mut spots: Vec<Spot> =
            vertices.map(|(&position, &normal)| Spot { position, normal, face: None }).collect();
        let mut triangles = Vec::with_capacity(SPREAD);
        for (triangle, lambda) in spread_points(mesh, SPREAD) {
            let corners = mesh.triangles[triangle].map(|v| normals[v as usize]);
            spots.push(Spot {
                position: interpolate(mesh.triangle_positions(triangle), lambda),
                normal: interpolate(corners, lambda).normalize_or_zero(),
                face: Some(face_normal(mesh, triangle)),
            });
            triangles.push(triangle as u32);
        }
        Self { spots, triangles }
    }

    pub(crate) fn vertices(&self) -> usize {
        self.spots.len() - self.triangles.len()
    }
}

pub(crate) fn face_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle);
    (b - a).cross(c - a).normalize_or_zero()
}

fn vertex_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.positions.len()];
    let corners = corner_normals(mesh, 180.0);
    for (triangle, corners) in mesh.triangles.iter().zip(corners.chunks(3)) {
        triangle.iter().zip(corners).for_each(|(&v, &normal)| sums[v as usize] += normal);
    }
    sums.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Points that are spread evenly over the area: one in each of `count` equal parts of the surface, in the order of the triangles.
/// Where in a triangle they lie follows M. Roberts' sequence ("The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
fn spread_points(mesh: &Mesh, count: usize) -> impl Iterator<Item = (usize, Vec3)> {
    let mut sum = 0.0;
    let areas: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
            sum += (b - a).cross(c - a).length();
            sum
        })
        .collect();
    let mut triangle = 0;
    let points = if areas.is_empty() { 0 } else { count };
    (0..points).map(move |i| {
        let at = sum * (i as f64 + 0.5) / count as f64;
        while areas[triangle] < at && triangle + 1 < areas.len() {
            triangle += 1;
        }
        let [u, v] =
            [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (i as f64 * step).fract() as f32);
        // The unit square folded onto a triangle.
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        (triangle, Vec3::new(1.0 - u - v, u, v))
    })
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate};

    use crate::{CameraFromWorld, PhotoCamera};

    use super::*;

    #[test]
    fn the_best_views_stay_in_order() {
        let entry = |view: u32, weight: f32| BestView {
            view,
            weight,
            color: [f16::from_f32(weight); 3],
            confidence: f16::from_f32(0.5),
        };
        let mut best = BestViews::NONE;
        assert_eq!((best.blend(&[]).color(), best.blend(&[]).seen_share()), (None, 0.0));
        let added = [(0, 0.25), (1, 0.5), (2, 0.125), (3, 0.5), (4, 0.75), (5, 0.0)]
            .map(|(v, w)| best.add(entry(v, w)));
        assert_eq!(added, [true, true, false, false, true, false]);
        assert_eq!(best.views().map(|b| b.view).collect::<Vec<_>>(), [4, 1, 3, 0]);
        assert_eq!(best.weight(), 0.75);
        let blend = best.blend(&[Vec3::ONE; 6]);
        assert!(blend.is_sure());
        let color = blend.color().unwrap();
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
            let batches = batches(&many, 1000, memory);
            assert_eq!(batches.iter().map(|b| b.1.len()).sum::<usize>(), 7);
            assert!(batches.iter().all(|(first, batch)| first + batch.len() <= 7));
            if memory < 1 << 30 {
                assert_eq!(batches.len(), 7, "one at a time");
            }
        }
        // Pixels are not all: a mesh of many vertices takes more.
        assert_eq!(batches(&many, 10_000_000, 1_500_000_000).len(), 7);
    }

    #[test]
    fn the_header_tells_the_depth() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        image::RgbImage::new(4, 2).save(path("8.png")).unwrap();
        image::RgbImage::new(4, 2).save(path("8.jpg")).unwrap();
        image::ImageBuffer::<image::Rgb<u16>, _>::new(4, 2).save(path("16.png")).unwrap();
        image::ImageBuffer::<image::Rgb<u16>, _>::new(4, 2).save(path("16.tif")).unwrap();
        image::Rgb32FImage::new(4, 2).save(path("float.exr")).unwrap();
        let names = ["8.png", "8.jpg", "16.png", "16.tif", "float.exr", "none.png"];
        assert_eq!(names.map(|name| bytes_per_pixel(&path(name))), [9, 9, 16, 16, 22, 9]);
    }

    /// Points that each see three photographs of a ring, with known exposures and some highlights.
    fn ring(exposures: &[Vec3], highlights: bool) -> Vec<Vec<Observation>> {
        let views = exposures.len();
        (0..4000)
            .map(|i: usize| {
                let surface = Vec3::new(0.1, 0.2, 0.3) * (0.5 + (i % 17) as f32 / 17.0);
                let color = |view: usize, k: usize| {
                    let shine = if highlights && (i + k).is_multiple_of(13) { 1.7 } else { 1.0 };
                    surface * exposures[view] * shine
                };
                (0..3)
                    .map(|k| {
                        let view = (i + k) % views;
                        Observation { view: view as u32, weight: 1.0 / (1 + k) as f32, color: color(view, k) }
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn gains_undo_exposures_up_to_a_common_factor() {
        let exposures: Vec<Vec3> =
            (0..12).map(|i| Vec3::new(1.0, 0.9, 1.1) * (1.0 + 0.3 * (i as f32 * 1.7).sin())).collect();
        for highlights in [false, true] {
            let gains = solve_gains(12, &ring(&exposures, highlights));
            let products: Vec<Vec3> = gains.iter().zip(&exposures).map(|(g, e)| *g * *e).collect();
            let mean = products.iter().sum::<Vec3>() / 12.0;
            let worst = products.iter().map(|p| (*p / mean - 1.0).abs().max_element()).fold(0.0, f32::max);
            assert!(worst < if highlights { 0.02 } else { 2e-3 }, "{worst}");
            // The pull keeps the whole from drifting.
            let logs: f32 = gains.iter().map(|g| g.y.ln()).sum::<f32>() / 12.0;
            assert!(logs.abs() < 1e-3, "{logs}");
        }
    }

    #[test]
    fn photographs_that_share_nothing_stay_as_they_are() {
        assert_eq!(solve_gains(3, &[]), vec![Vec3::ONE; 3]);
        let alone = |view: u32| vec![Observation { view, weight: 1.0, color: Vec3::splat(0.2) }];
        assert_eq!(solve_gains(2, &[alone(0), alone(1)]), vec![Vec3::ONE; 2]);
        // Black and burnt-out points say nothing.
        let pair = |a: f32, b: f32| {
            [(0, a), (1, b)]
                .map(|(view, c)| Observation { view, weight: 1.0, color: Vec3::splat(c) })
                .to_vec()
        };
        assert_eq!(solve_gains(2, &[pair(0.5, 1.0), pair(0.0, 0.1)]), vec![Vec3::ONE; 2]);
        let gains = solve_gains(2, &vec![pair(0.2, 0.4); 50]);
        assert!((gains[0].x / gains[1].x - 2.0).abs() < 0.01, "{gains:?}");
    }

    #[test]
    fn points_are_spread_by_area_and_lie_on_their_triangles() {
        let (mesh, _) = clean(generate::icosphere(2), &CleanOptions::default()).unwrap();
        let probes = Probes::new(&mesh);
        assert_eq!(probes.vertices(), mesh.positions.len());
        assert_eq!(probes.triangles.len(), SPREAD);
        let total = mesh.area();
        let mut counts = vec![0_u32; mesh.triangles.len()];
        for (&t, spot) in probes.triangles.iter().zip(&probes.spots[probes.vertices()..]) {
            counts[t as usize] += 1;
            let [a, b, c] = mesh.triangle_positions(t as usize);
            assert!((b - a).cross(c - a).normalize().dot(spot.position - a).abs() < 1e-5);
        }
        for (t, &count) in counts.iter().enumerate() {
            let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
            let expected = 0.5 * (b - a).cross(c - a).length() / total * SPREAD as f64;
            assert!((f64::from(count) - expected).abs() <= 1.01, "{t}: {count} of {expected}");
        }
        // Normals of a sphere are its directions.
        for spot in &probes.spots {
            assert!(spot.position.normalize().dot(spot.normal) > 0.99);
        }
    }
}
