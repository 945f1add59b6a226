//! Photographs as a source for a bake.

use fantex_bake::{
    Prefilter, Progress, Source, SourceChannel, SurfacePoint, TriangleFootprint, TriangleSource,
};
use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use glam::{DVec3, Vec3, Vec4};

use crate::blend::{Doubt, KEPT_SHARE, SEEN_CONFIDENCE, kept_weight, seen_share};
use crate::clusters::Clusters;
use crate::pages::{PageReader, PageStore};
use crate::probes::face_normal;
use crate::survey::{BestViews, Survey, survey};
use crate::view::{Seen, Spot, View};
use crate::{PhotoError, PhotoOptions, PhotoReport, Photograph, fill, gains};

/// Photographs laid on a mesh: per point, the views of the photographs that see it best, brought to one exposure, and what is
/// spread along the surface where none does.
///
/// It is a continuous function on the surface (along creases that turn a triangle away at once, a photograph may end at once). The
/// memory that it takes besides the mesh is what [`PhotoOptions::memory_bytes`] says, and about 250 bytes per vertex while it is made.
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
    ///
    /// A photograph cannot be read or is not what its camera took, none of them sees the mesh, the scratch file cannot be written,
    /// or the work was cancelled.
    pub fn new(
        mesh: &'a Mesh,
        photographs: &[Photograph],
        options: &PhotoOptions,
        progress: &dyn Progress,
    ) -> Result<Self, PhotoError> {
        let store = PageStore::new(options.memory_bytes / 2, options.scratch.clone());
        let Survey { mut views, clusters, probes, best, sharpness } =
            survey(mesh, photographs, &store, options, progress)?;
        if views.iter().all(Option::is_none) {
            let eyes: DVec3 = photographs.iter().map(|p| p.camera_from_world.eye()).sum();
            let middle = eyes / photographs.len().max(1) as f64;
            return Err(PhotoError::NothingSeen { photographs: photographs.len(), middle });
        }
        let (of_vertices, spread) = best.split_at(probes.vertices());
        let gains = match options.exposure {
            true => {
                let points: Vec<_> = spread.iter().map(BestViews::observations).collect();
                gains::solve(views.len(), &points)
            }
            false => vec![Vec3::ONE; views.len()],
        };
        for (view, &gain) in views.iter_mut().zip(&gains) {
            view.iter_mut().for_each(|view| view.gain = gain);
        }
        let fill = match options.unseen {
            Some(color) => Fill::Constant(color),
            None => {
                let known =
                    |best: &BestViews| best.color(&gains).filter(|_| best.confidence() >= SEEN_CONFIDENCE);
                let mean = fill::mean(spread.iter().filter_map(known));
                let known: Vec<Option<Vec3>> = of_vertices.iter().map(known).collect();
                Fill::Spread(fill::spread(mesh, &known, mean))
            }
        };
        let unseen = spread.iter().filter(|best| seen_share(best.confidence()) < 0.5).count();
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

    /// How sure it is that a photograph sees a point of a triangle: 0 where none does, 1 far from all edges of what is seen.
    pub fn confidence(&self, triangle: usize, lambda: Vec3) -> f32 {
        let views = self.views_of(triangle);
        let place = self.place(triangle, lambda);
        let looked = look(&views, &PageReader::new(&self.store), &place);
        doubt_of(&looked).confidence()
    }

    fn views_of(&self, triangle: usize) -> Vec<&View> {
        self.clusters.views_of(triangle).filter_map(|view| self.views[view as usize].as_ref()).collect()
    }

    /// A point that may lie beside its triangle is moved onto it.
    fn place(&self, triangle: usize, lambda: Vec3) -> Place {
        let inside = lambda.max(Vec3::ZERO);
        let mut place = Place {
            corners: self.mesh.triangles[triangle],
            lambda: inside / inside.element_sum(),
            spot: Spot {
                position: Vec3::ZERO,
                normal: Vec3::ZERO,
                face: Some(face_normal(self.mesh, triangle)),
            },
        };
        place.spot.position = place.blend(&self.mesh.positions);
        place.spot.normal = place.blend(&self.normals).normalize_or_zero();
        place
    }

    /// The colour of a point.
    fn color(&self, views: &[&View], reader: &PageReader<'_>, point: &SurfacePoint) -> Vec3 {
        let place = self.place(point.triangle, point.lambda);
        let looked = look(views, reader, &place);
        let largest = looked.iter().map(|(_, seen)| seen.weight).fold(0.0, f32::max);
        // Colours count by weight and mask; how much of the masks is open counts as confidence.
        let (mut sum, mut open, mut total) = (Vec3::ZERO, 0.0, 0.0);
        for (view, seen) in looked.iter().filter(|(_, seen)| seen.weight > largest * KEPT_SHARE) {
            let weight = kept_weight(seen.weight, largest);
            let color = view.color(reader, seen, place.spot.position, point.position_steps);
            sum += color.truncate() * (weight * color.w);
            open += weight * color.w;
            total += weight;
        }
        let fill = || match &self.fill {
            Fill::Constant(color) => *color,
            Fill::Spread(colors) => place.blend(colors),
        };
        if open <= 0.0 {
            return fill();
        }
        match seen_share(doubt_of(&looked).confidence() * open / total) {
            1.0 => sum / open,
            share => fill().lerp(sum / open, share),
        }
    }
}

/// A point on a triangle.
struct Place {
    corners: [u32; 3],
    lambda: Vec3,
    spot: Spot,
}

impl Place {
    /// What is given per vertex, at the point.
    fn blend(&self, values: &[Vec3]) -> Vec3 {
        let [a, b, c] = self.corners.map(|v| values[v as usize]);
        a * self.lambda.x + b * self.lambda.y + c * self.lambda.z
    }
}

/// The photographs that see a point.
fn look<'v>(views: &[&'v View], reader: &PageReader<'_>, place: &Place) -> Vec<(&'v View, Seen)> {
    let sees = |&view: &&'v View| Some((view, view.seen(reader, &place.spot)?));
    views.iter().filter_map(sees).collect()
}

fn doubt_of(looked: &[(&View, Seen)]) -> Doubt {
    looked.iter().fold(Doubt::WHOLE, |doubt, (_, seen)| doubt.less(seen.confidence))
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
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let on = TriangleFootprint { triangle: point.triangle, lambda_steps: point.lambda_steps };
        self.on_triangle(&on)(std::slice::from_ref(point), values);
    }

    fn on_triangle(&self, on: &TriangleFootprint) -> TriangleSource<'_> {
        let (views, reader) = (self.views_of(on.triangle), PageReader::new(&self.store));
        Box::new(move |points, values| {
            for (point, value) in points.iter().zip(values) {
                *value = self.color(&views, &reader, point).extend(1.0);
            }
        })
    }
}
