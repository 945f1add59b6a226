//! Photographs as a source for a bake.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};

use fantex_bake::{Progress, Source, TexelPoint, for_each_run};
use fantex_base::{Error, ErrorKind, Result, counted};
use fantex_mesh::{Mesh, SurfacePoint};
use glam::{DVec3, Vec3, Vec4};

use crate::Photograph;
use crate::blend::{Blend, joint_confidence};
use crate::pyramid::{PageReader, PageStore};
use crate::survey::{BestViews, Clusters, Survey, conjugate_gradients, face_normal, solve_gains, survey};
use crate::view::{Seen, Spot, View};

/// Photographs laid on a mesh: per point, the views of the photographs that see it best, brought to one exposure, and what is
/// spread along the surface where none does.
///
/// It is a continuous function on the surface (along creases that turn a triangle away at once, a photograph may end at once). The
/// memory that it takes besides the mesh is what [`PhotoOptions::memory_bytes`] says, and about 250 bytes per vertex while it is made.
/// Photographs that are read at the same time, which take another 80 bytes per vertex each, fit into the former; one is read in any
/// case.
pub struct PhotoSource<'a> {
    mesh: &'a Mesh,
    /// One per vertex.
    normals: Vec<Vec3>,
    views: Vec<Option<View>>,
    clusters: Clusters,
    store: PageStore,
    fill: Fill,
    density: Vec<f32>,
    report: PhotoReport,
}

impl std::fmt::Debug for PhotoSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PhotoSource").field("report", &self.report).finish_non_exhaustive()
    }
}

/// What unseen surface looks like, linear.
enum Fill {
    Constant(Vec3),
    /// One per vertex.
    Spread(Vec<Vec3>),
}

impl<'a> PhotoSource<'a> {
    /// Reads all photographs, one after the other as memory allows, and works out exposures and the fill. Progress counts pixels.
    ///
    /// # Errors
    /// A photograph cannot be read or is not what its camera took, none of them sees the mesh, the scratch file cannot be written,
    /// or the work was cancelled.
    pub fn new(
        mesh: &'a Mesh,
        photographs: &[Photograph],
        options: &PhotoOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let store = PageStore::new(options.memory_bytes / 2, options.scratch.clone());
        let Survey { mut views, clusters, probes, best, sharpness } =
            survey(mesh, photographs, &store, options, progress)?;
        if views.iter().all(Option::is_none) {
            let eyes: DVec3 = photographs.iter().map(|p| p.camera_from_world.eye()).sum();
            let middle = eyes / photographs.len().max(1) as f64;
            let photographs = counted(photographs.len(), "photograph");
            return Err(Error::unsupported(format!(
                "none of {photographs} sees the model: it must lie in the coordinates of the cameras, whose middle is \
                 at {middle:.6}, and its triangles must be seen from outside"
            )));
        }
        let (of_vertices, spread) = best.split_at(probes.vertices());
        let gains = match options.exposure {
            true => {
                let points: Vec<_> = spread.iter().map(BestViews::observations).collect();
                solve_gains(views.len(), &points)
            }
            false => vec![Vec3::ONE; views.len()],
        };
        for (view, &gain) in views.iter_mut().zip(&gains) {
            view.iter_mut().for_each(|view| view.gain = gain);
        }
        let fill = match options.unseen {
            Some(color) => Fill::Constant(color),
            None => {
                let known = |best: &BestViews| {
                    let blend = best.blend(&gains);
                    blend.color().filter(|_| blend.is_sure())
                };
                let mean = mean(spread.iter().filter_map(known));
                let known: Vec<Option<Vec3>> = of_vertices.iter().map(known).collect();
                Fill::Spread(spread_known(mesh, &known, mean))
            }
        };
        let unseen = spread.iter().filter(|best| best.blend(&gains).seen_share() < 0.5).count();
        let [memory_bytes, scratch_bytes] = store.bytes();
        let report = PhotoReport {
            photographs: photographs.len(),
            used: views.iter().flatten().count(),
            masked: photographs.iter().filter(|photograph| photograph.mask.is_some()).count(),
            unseen_share: unseen as f64 / spread.len().max(1) as f64,
            gains,
            memory_bytes,
            scratch_bytes,
        };
        let density = density(mesh, &sharpness);
        let normals = probes.spots[..probes.vertices()].iter().map(|spot| spot.normal).collect();
        Ok(Self { mesh, normals, views, clusters, store, fill, density, report })
    }

    /// What was found out.
    pub fn report(&self) -> &PhotoReport {
        &self.report
    }

    /// Pixels per mesh unit of the photograph that sees a triangle best, per triangle; where none does, a quarter of the mean.
    pub fn density(&self) -> Vec<f32> {
        self.density.clone()
    }

    /// Why pages could not be read back from the scratch file, if that happened: what was baked since is not to be used.
    pub fn failure(&self) -> Option<&std::io::Error> {
        self.store.failure()
    }

    /// How sure it is that a photograph sees a point of a triangle: 0 where none does, 1 far from all edges of what is seen. What masks leave out of it
    /// counts as seen.
    pub fn confidence(&self, triangle: usize, lambda: Vec3) -> f32 {
        let views = self.views_of(triangle);
        let at = SurfacePoint { triangle: triangle as u32, lambda }.clamped();
        let looked = look(&views, &PageReader::new(&self.store), &self.spot(at));
        joint_confidence(looked.iter().map(|(_, seen)| seen.confidence))
    }

    fn views_of(&self, triangle: usize) -> Vec<&View> {
        self.clusters.views_of(triangle).filter_map(|view| self.views[view as usize].as_ref()).collect()
    }

    /// What is given per vertex, at a point.
    fn blend(&self, at: SurfacePoint, values: &[Vec3]) -> Vec3 {
        at.interpolate(self.mesh.triangles[at.index()].map(|v| values[v as usize]))
    }

    fn spot(&self, at: SurfacePoint) -> Spot {
        Spot {
            position: at.position(self.mesh),
            normal: self.blend(at, &self.normals).normalize_or_zero(),
            face: Some(face_normal(self.mesh, at.index())),
        }
    }

    fn color(&self, views: &[&View], reader: &PageReader<'_>, point: &TexelPoint) -> Vec3 {
        // It may lie beside its triangle.
        let at = point.at.clamped();
        let spot = self.spot(at);
        let mut looked = look(views, reader, &spot);
        looked.sort_by(|(_, a), (_, b)| b.weight.total_cmp(&a.weight));
        let mut blend = Blend::default();
        for (view, seen) in looked {
            if blend.is_settled(seen.weight) {
                break;
            }
            let color = view.color(reader, &seen, spot.position, point.position_steps);
            blend.add(seen.weight * color.w, color.truncate(), seen.confidence * color.w);
        }
        let fill = || match &self.fill {
            Fill::Constant(color) => *color,
            Fill::Spread(colors) => self.blend(at, colors),
        };
        match (blend.color(), blend.seen_share()) {
            (None, _) => fill(),
            (Some(color), 1.0) => color,
            (Some(color), share) => fill().lerp(color, share),
        }
    }
}

fn look<'v>(views: &[&'v View], reader: &PageReader<'_>, spot: &Spot) -> Vec<(&'v View, Seen)> {
    let sees = |&view: &&'v View| Some((view, view.seen(reader, spot)?));
    views.iter().filter_map(sees).collect()
}

/// Pixels per mesh unit of the sharpest corner.
fn density(mesh: &Mesh, sharpness: &[f32]) -> Vec<f32> {
    let of_triangle = |corners: &[u32; 3]| corners.iter().map(|&v| sharpness[v as usize]).fold(0.0, f32::max);
    let mut density: Vec<f32> = mesh.triangles.iter().map(of_triangle).collect();
    let (sum, count) =
        density.iter().filter(|&&d| d > 0.0).fold((0.0, 0), |(sum, n), &d| (sum + f64::from(d), n + 1));
    let coarse = (0.25 * sum / f64::from(count.max(1))).max(1.0) as f32;
    density.iter_mut().filter(|d| **d <= 0.0).for_each(|d| *d = coarse);
    density
}

impl Source for PhotoSource<'_> {
    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.evaluate_all(std::slice::from_ref(point), values);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        for_each_run(points, values, 1, TexelPoint::is_on_triangle_of, |points, values| {
            let (views, reader) = (self.views_of(points[0].at.index()), PageReader::new(&self.store));
            for (point, value) in points.iter().zip(values) {
                *value = self.color(&views, &reader, point).extend(1.0);
            }
        });
    }
}

// ---- Colours for what no photograph sees: those of the surroundings, spread along the surface.
//
// Vertices that are seen keep their colours; those in between become the mean of their neighbours, weighted by one over the length of
// the edge: the solution of Laplace's equation on the graph of edges. It has no extremes of its own, is smooth,
// and meets what is seen. Parts of the mesh where nothing is seen at all get the mean of everything that is.

const MAX_STEPS: usize = 400;
/// The residual that is small enough, relative to the start.
const TOLERANCE: f64 = 1e-4;
/// What a model looks like that no photograph sees.
const GREY: Vec3 = Vec3::splat(0.18);

/// The mean of what is seen.
pub(crate) fn mean(seen: impl Iterator<Item = Vec3>) -> Vec3 {
    let (sum, count) =
        seen.fold((DVec3::ZERO, 0.0), |(sum, count), color| (sum + color.as_dvec3(), count + 1.0));
    if count > 0.0 { (sum / count).as_vec3() } else { GREY }
}

/// One colour per vertex. `seen` says which are known; the others are found. `mean` is that of the whole surface that is seen: of a
/// coarse mesh that may be much, without a single vertex.
pub(crate) fn spread_known(mesh: &Mesh, seen: &[Option<Vec3>], mean: Vec3) -> Vec<Vec3> {
    let known: Vec<Vec3> = seen.iter().copied().flatten().collect();
    if known.len() == seen.len() {
        return known;
    }
    let edges = Edges::of(mesh);
    let mut colors = nearest_known(&edges, seen, mean);
    // Unknown vertices that are connected with known ones, in the order of their numbers.
    let unknowns: Vec<u32> =
        (0..seen.len() as u32).filter(|&v| seen[v as usize].is_none() && colors[v as usize].1).collect();
    let mut place = vec![u32::MAX; seen.len()];
    for (i, &v) in (0..).zip(&unknowns) {
        place[v as usize] = i;
    }
    for channel in 0..3 {
        let start: Vec<f64> = unknowns.iter().map(|&v| f64::from(colors[v as usize].0[channel])).collect();
        let apply = |x: &[f64]| {
            let row = |(&v, &own): (&u32, &f64)| {
                edges
                    .of_vertex(v)
                    .map(|(n, w)| w * (own - x.get(place[n as usize] as usize).unwrap_or(&0.0)))
                    .sum()
            };
            unknowns.iter().zip(x).map(row).collect::<Vec<f64>>()
        };
        let right: Vec<f64> = unknowns
            .iter()
            .map(|&v| {
                let known =
                    edges.of_vertex(v).filter_map(|(n, w)| Some(w * f64::from(seen[n as usize]?[channel])));
                known.sum()
            })
            .collect();
        let solved = conjugate_gradients(apply, &right, start, MAX_STEPS, TOLERANCE);
        for (&v, value) in unknowns.iter().zip(solved) {
            colors[v as usize].0[channel] = value as f32;
        }
    }
    let (low, high) =
        known.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &c| (low.min(c), high.max(c)));
    let bounded = |color: Vec3| if known.is_empty() { color } else { color.clamp(low, high) };
    colors.into_iter().map(|(color, _)| bounded(color)).collect()
}

/// The colour of a known vertex that is the fewest edges away, and whether there is one: where the solver starts.
fn nearest_known(edges: &Edges, seen: &[Option<Vec3>], mean: Vec3) -> Vec<(Vec3, bool)> {
    let mut colors: Vec<(Vec3, bool)> = seen.iter().map(|c| (c.unwrap_or(mean), c.is_some())).collect();
    let mut front: VecDeque<u32> = (0..seen.len() as u32).filter(|&v| seen[v as usize].is_some()).collect();
    while let Some(v) = front.pop_front() {
        let color = colors[v as usize].0;
        for (neighbour, _) in edges.of_vertex(v) {
            let slot = &mut colors[neighbour as usize];
            if !slot.1 {
                *slot = (color, true);
                front.push_back(neighbour);
            }
        }
    }
    colors
}

/// The edges at every vertex, with one over their length.
struct Edges {
    first: Vec<u32>,
    neighbours: Vec<(u32, f32)>,
}

impl Edges {
    fn of(mesh: &Mesh) -> Self {
        let mut pairs: Vec<[u32; 2]> = mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut first = vec![0_u32; mesh.positions.len() + 1];
        pairs.iter().for_each(|&[v, _]| first[v as usize + 1] += 1);
        (1..first.len()).for_each(|v| first[v] += first[v - 1]);
        let length = |[a, b]: [u32; 2]| mesh.positions[a as usize].distance(mesh.positions[b as usize]);
        let neighbours = pairs.into_iter().map(|pair| (pair[1], 1.0 / length(pair).max(1e-6))).collect();
        Self { first, neighbours }
    }

    fn of_vertex(&self, v: u32) -> impl Iterator<Item = (u32, f64)> {
        let range = self.first[v as usize] as usize..self.first[v as usize + 1] as usize;
        self.neighbours[range].iter().map(|&(n, w)| (n, f64::from(w)))
    }
}

// ---- Options, outcome and errors.

/// How photographs are laid on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoOptions {
    /// Bytes that photographs may take: half for their pages in memory, half for those that are being read.
    pub memory_bytes: u64,
    /// Folder for a file (without a name) of what does not fit into memory.
    pub scratch: PathBuf,
    /// Solve for a factor per photograph and channel such that they agree.
    pub exposure: bool,
    /// Linear colour of what no photograph sees; `None` spreads the colours of its surroundings.
    pub unseen: Option<Vec3>,
    /// Length of a texel's side on the surface, mesh units: photographs are kept no finer than that needs. `None` keeps every pixel.
    pub texel_size: Option<f32>,
}

impl Default for PhotoOptions {
    /// 1 GiB, the system's folder of temporary files, exposure solved, unseen surface filled, every pixel kept.
    fn default() -> Self {
        Self {
            memory_bytes: 1 << 30,
            scratch: std::env::temp_dir(),
            exposure: true,
            unseen: None,
            texel_size: None,
        }
    }
}

/// What was found out about a set of photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoReport {
    /// Photographs of the set.
    pub photographs: usize,
    /// Those that see some of the surface.
    pub used: usize,
    /// Those that have a mask in a file of its own.
    pub masked: usize,
    /// Share of the area that no photograph sees, 0..=1, measured at 32 768 points.
    pub unseen_share: f64,
    /// Factors of red, green and blue, linear light, per photograph in the set's order; 1 where exposure is not solved for.
    pub gains: Vec<Vec3>,
    /// Bytes of pages in memory.
    pub memory_bytes: u64,
    /// Bytes of pages in the scratch file.
    pub scratch_bytes: u64,
}

/// Pages could not be written to or read from the scratch file in `folder`.
pub(crate) fn scratch_error(folder: &Path, source: io::Error) -> Error {
    let message = format!("cannot keep photographs in {}: {source}", folder.display());
    Error::new(ErrorKind::Io, message).with_path(folder).with_source(source)
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate};

    use super::*;

    fn sphere() -> Mesh {
        clean(generate::icosphere(4), &CleanOptions::default()).unwrap().0
    }

    #[test]
    fn the_fill_is_smooth_and_within_what_is_known() {
        let mesh = sphere();
        // Red above, blue below, nothing in the middle.
        let seen: Vec<Option<Vec3>> = mesh
            .positions
            .iter()
            .map(|p| (p.y.abs() > 0.4).then_some(if p.y > 0.0 { Vec3::X } else { Vec3::Z }))
            .collect();
        let colors = spread_known(&mesh, &seen, mean(seen.iter().copied().flatten()));
        for (color, seen) in colors.iter().zip(&seen) {
            assert!(seen.is_none_or(|seen| seen == *color));
            assert!(color.min_element() >= 0.0 && color.max_element() <= 1.0);
        }
        // Half of each on the equator, more red above it.
        for (p, color) in mesh.positions.iter().zip(&colors) {
            if p.y.abs() < 0.02 {
                assert!((color.x - 0.5).abs() < 0.05 && (color.z - 0.5).abs() < 0.05, "{p} {color}");
            }
            if p.y > 0.2 && p.y < 0.35 {
                assert!(color.x > 0.6, "{p} {color}");
            }
        }
        let steps = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let largest = steps
            .map(|[a, b]| (colors[a as usize] - colors[b as usize]).abs().max_element())
            .fold(0.0, f32::max);
        assert!(largest < 0.25, "{largest}");
    }

    #[test]
    fn nothing_seen_is_grey_and_everything_seen_stays() {
        let mesh = sphere();
        let count = mesh.positions.len();
        assert_eq!(mean(std::iter::empty()), GREY);
        // Seen, though no vertex is.
        let red = mean([Vec3::X, 0.5 * Vec3::X].into_iter());
        assert_eq!(spread_known(&mesh, &vec![None; count], red), vec![0.75 * Vec3::X; count]);
        let all: Vec<Option<Vec3>> = mesh.positions.iter().map(|&p| Some(p.abs())).collect();
        assert_eq!(
            spread_known(&mesh, &all, GREY),
            mesh.positions.iter().map(|p| p.abs()).collect::<Vec<_>>()
        );
    }
}
