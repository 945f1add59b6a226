//! Models that are made of a source, without an asset between.

use std::path::Path;

use fantex_bake::{
    LightMapOptions, LightMapSource, LightScene, LookSource, NoProgress, Source, SourceChannel, TexelPoint,
    TrianglePlane, VertexColorSource,
};
use fantex_base::{ErrorKind, Random};
use fantex_export::{ChannelMap, ExportOptions, ExportSummary, UvChoice, export_source};
use fantex_mesh::generate::{cube, icosphere};
use fantex_mesh::{Mesh, Model, SurfacePoint, shading_normals};
use fantex_store::ChannelKind;
use glam::{DVec3, Vec3, Vec4};
use tempfile::TempDir;

use crate::models::check_glb;
use crate::support::{Waves, bottle, cleaned, files, opened};

fn exported(mesh: &Mesh, source: &dyn Source, texels: f64, path: &Path) -> ExportSummary {
    let texels_per_unit = (texels / mesh.area()).sqrt() as f32;
    let options = ExportOptions { force: true, ..ExportOptions::default() };
    let summary = export_source(mesh, source, texels_per_unit, path, &options, &NoProgress).unwrap();
    check_glb(path);
    assert!(summary.density_share > 0.9, "{summary:?}");
    summary
}

/// A point of a triangle, and what a source gives there.
fn values_at(
    mesh: &Mesh,
    normals: &[Vec3],
    source: &dyn Source,
    triangle: usize,
    lambda: Vec3,
) -> (TexelPoint, Vec<Vec4>) {
    let point = TrianglePlane::new(mesh, normals, triangle, [Vec3::ZERO; 2]).point(lambda);
    let mut values = vec![Vec4::ZERO; source.channels().len()];
    source.evaluate(&point, &mut values);
    (point, values)
}

/// The likeness of a written model to a source at random points of the surface, in dB: of each channel that both have.
fn likeness(mesh: &Mesh, source: &dyn Source, path: &Path) -> Vec<(ChannelKind, f64)> {
    let back = opened(path);
    assert_eq!(back.triangles.len(), mesh.triangles.len());
    let shown = LookSource::of_model(&back).unwrap();
    let normals = [mesh, &back].map(shading_normals);
    let kinds = [source, &shown].map(|source| source.channels().iter().map(|c| c.kind).collect::<Vec<_>>());
    let mut random = Random::new(5);
    let mut sums = vec![0.0; kinds[0].len()];
    let samples = 20_000;
    for _ in 0..samples {
        let triangle = random.below(mesh.triangles.len() as u64) as usize;
        let (r, share) = (random.unit().sqrt() as f32, random.unit() as f32);
        let lambda = Vec3::new(1.0 - r, r * (1.0 - share), r * share);
        let truth = values_at(mesh, &normals[0], source, triangle, lambda).1;
        let read = values_at(&back, &normals[1], &shown, triangle, lambda).1;
        for (channel, kind) in kinds[0].iter().enumerate() {
            if let Some(other) = kinds[1].iter().position(|k| k == kind) {
                let off = (truth[channel] - read[other]).truncate();
                sums[channel] += f64::from(off.length_squared()) / 3.0;
            }
        }
    }
    let db = |sum: f64| -10.0 * (sum / f64::from(samples)).log10();
    kinds[0].iter().copied().zip(sums.into_iter().map(db)).collect()
}

#[test]
fn all_channels_are_those_of_the_source() {
    use ChannelKind::{BaseColor, Emission, Normal, OcclusionRoughnessMetallic};
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    let mesh = cleaned(icosphere(4));
    let kinds = vec![BaseColor, Normal, OcclusionRoughnessMetallic, Emission];
    let waves = Waves { kinds, brightness: 3.0, ..Waves::color(9.0) };
    let summary = exported(&mesh, &waves, 1e6, &path);
    assert_eq!(summary.maps.len(), 4);
    for (kind, db) in likeness(&mesh, &waves, &path) {
        eprintln!("{kind:?} {db:.1} dB");
        assert!(db > 40.0, "{kind:?} {db}");
    }
    assert_eq!(files(folder.path()), ["x.glb"]);
}

#[test]
fn light_brighter_than_one_keeps_its_strength() {
    let kinds = vec![ChannelKind::BaseColor, ChannelKind::Emission];
    let waves = Waves { kinds, brightness: 6.0, ..Waves::color(5.0) };
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    exported(&cleaned(icosphere(3)), &waves, 65_536.0, &path);
    let strength = opened(&path).materials[0].emission;
    assert!((strength.x - 5.4).abs() < 0.1, "{strength}");
}

/// A model's own textures, laid anew: what they show is what they were.
#[test]
fn the_bottle_gets_coordinates_of_its_own_or_keeps_its_own() {
    let mesh = bottle();
    let source = LookSource::of_model(&mesh).unwrap();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    let summary = exported(&mesh, &source, 2e6, &path);
    assert!(summary.charts > 5, "{summary:?}");
    for (kind, db) in likeness(&mesh, &source, &path) {
        eprintln!("{kind:?} {db:.1} dB");
        assert!(db > 30.0, "{kind:?} {db}");
    }
    let options = ExportOptions { uv: UvChoice::OfAsset, force: true, ..ExportOptions::default() };
    let summary = export_source(&mesh, &source, 100.0, &path, &options, &NoProgress).unwrap();
    assert_eq!(summary.charts, 0);
    assert_eq!(opened(&path).corners.uv_sets[0][0], mesh.corners.uv_sets[0][0]);
}

/// Colours of vertices, some of which are no numbers.
#[test]
fn what_is_no_number_stays_where_it_is() {
    struct Half;
    impl Source for Half {
        fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
            let is_left = point.position.x < 0.0;
            values[0] = if is_left { Vec4::splat(f32::NAN) } else { Vec4::new(0.5, 0.25, 1.0, 1.0) };
        }
    }
    let mesh = cleaned(icosphere(4));
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    exported(&mesh, &Half, 1e5, &path);
    let back = opened(&path);
    let shown = LookSource::of_model(&back).unwrap();
    let normals = shading_normals(&back);
    for t in 0..back.triangles.len() {
        let (point, value) = values_at(&back, &normals, &shown, t, Vec3::splat(1.0 / 3.0));
        let expected = if point.position.x < 0.0 { Vec3::ZERO } else { Vec3::new(0.5, 0.25, 1.0) };
        let off = (value[0].truncate() - expected).abs().max_element();
        assert!(off < 0.01 || point.position.x.abs() < 0.05, "{point:?} {value:?}");
    }
}

/// Normals of a smoother surface are shown on normals without creases.
#[test]
fn normals_that_cross_creases_have_frames_without_creases() {
    struct Smooth;
    impl Source for Smooth {
        fn channels(&self) -> Vec<SourceChannel> {
            [ChannelKind::BaseColor, ChannelKind::Normal].map(SourceChannel::new).to_vec()
        }
        fn crosses_creases(&self) -> bool {
            true
        }
        fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
            values[0] = Vec4::ONE;
            values[1] = point.position.normalize().extend(0.0);
        }
    }
    let mesh = cleaned(cube(6));
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    exported(&mesh, &Smooth, 1e5, &path);
    let back = opened(&path);
    let shown = LookSource::of_model(&back).unwrap();
    let normals = shading_normals(&back);
    let normal = shown.channels().iter().position(|c| c.kind == ChannelKind::Normal).unwrap();
    let mut worst: f32 = 0.0;
    for t in 0..back.triangles.len() {
        for lambda in [[0.96, 0.02, 0.02], [0.02, 0.49, 0.49], [0.3, 0.3, 0.4]] {
            let (point, values) = values_at(&back, &normals, &shown, t, Vec3::from(lambda));
            worst =
                worst.max(values[normal].truncate().normalize().angle_between(point.position).to_degrees());
        }
    }
    assert!(worst < 3.0, "{worst} degrees");
}

#[test]
fn vertex_colours_become_a_picture() {
    let mut model = icosphere(4);
    model.corners.colors = model
        .triangles
        .as_flattened()
        .iter()
        .map(|&v| (model.positions[v as usize] * 0.5 + 0.5).as_vec3().extend(1.0))
        .collect();
    let mesh = cleaned(model);
    let source = VertexColorSource::new(&mesh).unwrap();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    let summary = exported(&mesh, &source, 1e6, &path);
    assert_eq!(summary.maps, [ChannelMap::BaseColor]);
    let found = likeness(&mesh, &source, &path);
    assert!(found[0].1 > 48.0, "{found:?}");
}

/// A picture is no larger than it must be, and never nearly empty.
#[test]
fn narrow_surfaces_get_pictures_of_moderate_size() {
    let folder = TempDir::new().unwrap();
    let side_of = |model: Model, texels: f64| {
        let mesh = cleaned(model);
        let source = Waves::color(3.0);
        let texels_per_unit = (texels / mesh.area()).sqrt() as f32;
        let texels = Some((2.0 * texels) as u64);
        let options = ExportOptions { force: true, texels, ..ExportOptions::default() };
        let path = folder.path().join("x.glb");
        let summary = export_source(&mesh, &source, texels_per_unit, &path, &options, &NoProgress).unwrap();
        (summary.sizes[0][0], summary)
    };
    // Needles of a hundredth of a texel's width, one beside the other in space, far apart in any picture.
    let mut needles = Model::default();
    for i in 0..300 {
        let at = DVec3::new(0.0, 0.01 * f64::from(i), 0.0);
        let first = needles.positions.len() as u32;
        needles.positions.extend([at, at + DVec3::X, at + DVec3::new(1.0, 1e-5, 0.0)]);
        needles.triangles.push([first, first + 1, first + 2]);
    }
    let (side, summary) = side_of(needles, 250_000.0);
    assert!(side <= 2048, "{side}: {summary:?}");
    // A long strip in a spiral, whose rectangle is mostly empty.
    let mut spiral = Model::default();
    for i in 0..400u32 {
        let angle = f64::from(i) * 0.05;
        let out = DVec3::new(angle.cos(), angle.sin(), 0.0);
        spiral.positions.extend([out * (2.0 + 0.3 * angle), out * (2.2 + 0.3 * angle)]);
        if i > 0 {
            let first = 2 * i - 2;
            spiral.triangles.extend([[first, first + 1, first + 3], [first, first + 3, first + 2]]);
        }
    }
    let (side, summary) = side_of(spiral, 100_000.0);
    let surface = summary.used_share * f64::from(side).powi(2);
    assert!(summary.density_share >= 0.95 && surface < 400_000.0, "{side}: {summary:?}");
}

#[test]
fn light_needs_an_asset() {
    let mesh = cleaned(icosphere(2));
    let sky = |direction: Vec3| direction.abs();
    let reflector = |_: SurfacePoint| Vec3::ONE;
    let scene = LightScene { lights: Vec::new(), sky: &sky, reflector: &reflector };
    let source = LightMapSource::new(&mesh, &scene, LightMapOptions::default()).unwrap();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.glb");
    let refused = export_source(&mesh, &source, 10.0, &path, &ExportOptions::default(), &NoProgress);
    assert_eq!(refused.unwrap_err().kind(), ErrorKind::Unsupported);
    assert!(files(folder.path()).is_empty());
}
