//! Transfer from detailed to coarse meshes: normals against formulas, tangent space against object space, colours.

use fantex_bake::{
    Fit, NormalMapOptions, NormalSpace, Prefilter, Source, SourceChannel, TexelPoint, TransferOptions,
    TransferSource, bake_normal_map,
};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{
    CleanOptions, DisplaceOptions, LoadOptions, Material, Mesh, Refinement, SurfacePoint, TriangleBvh, clean,
    corner_tangents, displace, generate, interpolate, lambda_step, load, shading_normals,
};
use fantex_store::{ChannelKind, TileId, TileSource, TileTexels};
use fantex_texture::Image;
use fantex_texture::material::TangentFrame;
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::common::{OfPosition, baked, cleaned, cover, data_folder, float_options, loaded, sample};

/// Angles in degrees, ascending.
struct Angles(Vec<f32>);

impl Angles {
    fn new(angles: impl Iterator<Item = f32>) -> Self {
        let mut degrees: Vec<f32> = angles.map(f32::to_degrees).collect();
        degrees.sort_by(f32::total_cmp);
        Self(degrees)
    }

    fn percentile(&self, share: f32) -> f32 {
        self.0[((self.0.len() - 1) as f32 * share) as usize]
    }

    fn show(&self, name: &str) {
        let at = [0.5, 0.95, 1.0].map(|s| self.percentile(s));
        eprintln!("{name}: median {:.2}, 95 % {:.2}, largest {:.2} degrees", at[0], at[1], at[2]);
    }
}

/// Height of a bumpy unit sphere.
fn bumps(u: Vec3) -> f32 {
    0.03 * (7.0 * u.x).sin() * (8.0 * u.y + 1.0).sin() * (6.0 * u.z + 2.0).sin()
}

/// Normal of the sphere with these bumps: `r u - (gradient of r along the sphere)`.
fn bumpy_normal(u: Vec3) -> Vec3 {
    let h = 1e-3;
    let gradient = Vec3::AXES.map(|axis| (bumps(u + axis * h) - bumps(u - axis * h)) / (2.0 * h));
    let gradient = Vec3::from(gradient);
    let along = gradient - u * gradient.dot(u);
    (u * (1.0 + bumps(u)) - along).normalize()
}

fn bumpy_sphere() -> Mesh {
    let sphere = cleaned(generate::icosphere(4));
    let refinement = Refinement::Uniform { longest_edge: 0.02 };
    let options = DisplaceOptions { refinement, ..DisplaceOptions::default() };
    // Flat triangles are lifted to the sphere, too.
    displace(&sphere, &options, |p| 1.0 - p.position.length() + bumps(p.position.normalize())).unwrap().0
}

fn at(mesh: &Mesh, triangle: usize, lambda: Vec3) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle);
    interpolate([a, b, c], lambda)
}

#[test]
fn normals_of_a_bumpy_sphere_arrive_on_a_coarse_one() {
    let detailed = bumpy_sphere();
    let coarse = cleaned(generate::icosphere(2));
    assert!(detailed.world_from_mesh.scale > coarse.world_from_mesh.scale, "two different spaces");
    let source = TransferSource::new(&coarse, &detailed, None, &TransferOptions::default()).unwrap();
    let cover = cover(&coarse, 64, 200_000);
    let asset = baked(&coarse, &cover, &source, &float_options(Fit::Sharp));
    let report = source.report();
    assert_eq!(report.missed, 0, "{report:?}");
    assert!((0.03..0.1).contains(&report.cage), "{report:?}");
    let normals = shading_normals(&coarse);
    let lambdas = [Vec3::splat(1.0 / 3.0), Vec3::new(0.6, 0.3, 0.1), Vec3::new(0.05, 0.15, 0.8)];
    let points = || (0..coarse.triangles.len()).flat_map(|t| lambdas.map(|l| (t, l)));
    let error = |(triangle, lambda): (usize, Vec3)| {
        let vertex_normal: Vec3 =
            (0..3).map(|k| normals[3 * triangle + k] * lambda[k]).sum::<Vec3>().normalize();
        let texel = sample_in_shading_frame(&asset.cache, triangle, lambda, vertex_normal);
        // The ray goes along the smooth normal; where it meets the bumpy sphere is found by walking.
        let p = at(&coarse, triangle, lambda);
        let mut t = 0.0;
        for _ in 0..50 {
            let q = p + vertex_normal * t;
            t += 1.0 + bumps(q.normalize()) - q.length();
        }
        texel.angle_between(bumpy_normal((p + vertex_normal * t).normalize()))
    };
    let angles = Angles::new(points().map(error));
    angles.show("baked");
    assert!(angles.percentile(0.5) < 0.6 && angles.percentile(0.95) < 1.5 && angles.percentile(1.0) < 4.0);
    let plain = Angles::new(points().map(|(t, l)| {
        let u = at(&coarse, t, l).normalize();
        u.angle_between(bumpy_normal(u))
    }));
    assert!(plain.percentile(0.5) > 5.0, "the bumps matter");
}

/// The stored normal, in mesh space.
fn sample_in_shading_frame(
    cache: &fantex_store::PageCache,
    triangle: usize,
    lambda: Vec3,
    vertex_normal: Vec3,
) -> Vec3 {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let mut sum = Vec3::ZERO;
    for (slot, weight) in cover.weights(triangle, lambda).iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let group = cover.corner_groups[triangle][slot];
        let texel = cache.tile(0, TileId { group, level: 0 }).bilinear(interpolate([a, b, c], lambda));
        let [x, y] = [texel[0], texel[1]].map(|v| 2.0 * v - 1.0);
        let [x_axis, y_axis] = cover.groups[group as usize].shading_axes(vertex_normal);
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        sum += weight * (x_axis * x + y_axis * y + vertex_normal * z);
    }
    sum.normalize()
}

/// The edges of an octahedron bend by 70 degrees. Its normals are those of a sphere right up to them, on both sides alike.
#[test]
fn normals_of_a_smooth_mesh_cross_the_creases_of_a_coarse_one() {
    let sphere = cleaned(generate::icosphere(5));
    let octahedron = || {
        let mut model = generate::icosphere(0);
        model.positions = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]).collect();
        model.triangles = (0..8_u32)
            .map(|i| {
                let [x, y, z] = [i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2)];
                if i.count_ones() % 2 == 0 { [x, y, z] } else { [x, z, y] }
            })
            .collect();
        model.corners = Default::default();
        cleaned(model)
    };
    // A mesh without normals, and one with those of its facets.
    let mut faceted = octahedron();
    let facets = |t: usize| [faceted.facet_normal(t).as_vec3(); 3];
    faceted.corners.normals = (0..8).flat_map(facets).collect();
    for coarse in [octahedron(), faceted] {
        let source = TransferSource::new(&coarse, &sphere, None, &TransferOptions::default()).unwrap();
        let asset = baked(&coarse, &cover(&coarse, 512, 400_000), &source, &float_options(Fit::Sharp));
        let mesh = asset.cache.asset().mesh();
        let normals = shading_normals(mesh);
        let ray_normals = fantex_mesh::corner_normals(&coarse, 180.0);
        let mut worst = 0.0_f32;
        for triangle in 0..8 {
            for (i, beside) in (1..40).flat_map(|i| [0.0, 0.01, 0.3].map(|beside| (i, beside))) {
                let lambda = Vec3::new(
                    (1.0 - beside) * i as f32 / 40.0,
                    (1.0 - beside) * (1.0 - i as f32 / 40.0),
                    beside,
                );
                for turn in 0..3 {
                    let lambda = Vec3::from_array(std::array::from_fn(|k| lambda[(k + turn) % 3]));
                    let blend = |normals: &[Vec3]| {
                        (0..3).map(|k| normals[3 * triangle + k] * lambda[k]).sum::<Vec3>().normalize()
                    };
                    let stored = sample_in_shading_frame(&asset.cache, triangle, lambda, blend(&normals));
                    // The unit sphere along the ray, in the world.
                    let p = mesh.world_from_mesh.point(at(mesh, triangle, lambda));
                    let ray = blend(&ray_normals).as_dvec3();
                    let half = p.dot(ray);
                    let hit = p + ray * ((half * half + 1.0 - p.length_squared()).sqrt() - half);
                    worst = worst.max(stored.angle_between(hit.as_vec3()).to_degrees());
                }
            }
        }
        assert!(worst < 1.5, "{worst} degrees");
    }
}

#[test]
fn a_simplified_bunny_gets_its_normals_back() {
    let Some(folder) = data_folder() else { return };
    let bunny = folder.join("meshes/bunny/stanford_bunny.ply");
    let detailed = cleaned(load(&bunny, &LoadOptions::default()).unwrap());
    let welded = CleanOptions { weld_distance: 0.003, ..CleanOptions::default() };
    let (coarse, _) = clean(load(&bunny, &LoadOptions::default()).unwrap(), &welded).unwrap();
    assert!(coarse.triangles.len() * 5 < detailed.triangles.len(), "{}", coarse.triangles.len());
    let source = TransferSource::new(&coarse, &detailed, None, &TransferOptions::default()).unwrap();
    let (bvh, detailed_normals) = (TriangleBvh::new(&detailed), shading_normals(&detailed));
    let coarse_normals = shading_normals(&coarse);
    let to_detailed = |p: Vec3| detailed.world_from_mesh.inverse_point(coarse.world_from_mesh.point(p));
    let mut errors = [Vec::new(), Vec::new()];
    for triangle in (0..coarse.triangles.len()).step_by(3) {
        let lambda = Vec3::new(0.3, 0.3, 0.4);
        let blend = |normals: &[Vec3], t: usize, l: Vec3| {
            (0..3).map(|k| normals[3 * t + k] * l[k]).sum::<Vec3>().normalize_or(Vec3::Z)
        };
        let own = blend(&coarse_normals, triangle, lambda);
        let point = fantex_bake::TexelPoint {
            at: SurfacePoint { triangle: triangle as u32, lambda },
            lambda_steps: [Vec3::ZERO; 2],
            position: at(&coarse, triangle, lambda),
            position_steps: [Vec3::ZERO; 2],
            normal: own,
        };
        let mut values = [Vec4::ZERO];
        source.evaluate(&point, &mut values);
        let nearest = bvh.nearest_point(to_detailed(point.position), f32::INFINITY).unwrap();
        let truth = blend(&detailed_normals, nearest.point.index(), nearest.point.lambda);
        errors[0].push(own.angle_between(truth));
        errors[1].push(values[0].truncate().angle_between(truth));
    }
    let [own, transferred] = errors.map(|e| Angles::new(e.into_iter()));
    own.show("coarse");
    transferred.show("transferred");
    let report = source.report();
    eprintln!("{report:?}");
    assert!(transferred.percentile(0.5) < 0.3 * own.percentile(0.5));
    assert!(transferred.percentile(0.95) < 0.7 * own.percentile(0.95));
    assert!(report.missed * 50 < report.points, "{report:?}");
}

#[test]
fn tangent_space_decoded_is_object_space() {
    let Some(folder) = data_folder() else { return };
    let coarse = loaded(&folder, "meshes/spot/spot_control_mesh.obj");
    let detailed = loaded(&folder, "meshes/spot/spot_triangulated.obj");
    let options =
        NormalMapOptions { size: [256, 256], samples: 1, padding: 0, ..NormalMapOptions::default() };
    let (tangent, report) = bake_normal_map(&coarse, &detailed, &options).unwrap();
    eprintln!("{report:?}");
    assert!(report.missed * 20 < report.points, "{report:?}");
    let object_space = NormalMapOptions { space: NormalSpace::Object, ..options };
    let (object, _) = bake_normal_map(&coarse, &detailed, &object_space).unwrap();
    let uv = &coarse.corners.uv_sets[0];
    let normals = shading_normals(&coarse);
    let corner_uv = |t: usize| [0, 1, 2].map(|k| uv[3 * t + k]);
    let tangents = corner_tangents(&coarse, &normals, |t| Some(corner_uv(t)));
    let material = Material::default();
    let lambda_at = |triangle: usize, p: Vec2| {
        let [a, b, c] = corner_uv(triangle).map(|uv| uv * 256.0);
        let area = (b - a).perp_dot(c - a);
        Vec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)) / area
    };
    let (mut seen, mut outwards) = (0, 0);
    for triangle in 0..coarse.triangles.len() {
        let centre = corner_uv(triangle).into_iter().sum::<Vec2>() * (256.0 / 3.0);
        let (x, y) = (centre.x.floor(), centre.y.floor());
        let p = Vec2::new(x + 0.5, y + 0.5);
        let lambda = lambda_at(triangle, p);
        // Texture coordinates overlap here and there: the first triangle has the texel.
        let is_taken = (0..triangle).any(|t| lambda_at(t, p).min_element() > -1e-4);
        if lambda.min_element() < 0.02 || is_taken {
            continue;
        }
        let texel = |image: &Image| Vec4::from(image.linear_texel(x as u32, y as u32));
        let decoded =
            TangentFrame::at(&normals, &tangents, triangle, lambda).bend(&material, texel(&tangent)).unwrap();
        let exact = texel(&object).truncate() * 2.0 - 1.0;
        assert!(exact.is_normalized() && decoded.distance(exact) < 1e-4, "{triangle}: {decoded} {exact}");
        outwards += usize::from(texel(&tangent).z > 0.5);
        seen += 1;
    }
    assert!(seen > 200 && outwards * 100 > 95 * seen, "{seen} {outwards}");
}

#[test]
fn charts_are_continued_by_the_padding_and_no_farther() {
    let mut model = generate::grid(1);
    let corner = |c: usize| model.positions[model.triangles[c / 3][c % 3] as usize];
    // The square takes the middle of the image.
    let uv: Vec<Vec2> = (0..6).map(corner).map(|p| Vec2::new(p.x as f32, p.z as f32) * 0.25 + 0.5).collect();
    model.corners.uv_sets = vec![uv];
    let mesh = cleaned(model);
    for padding in [0, 5] {
        let options = NormalMapOptions {
            size: [64, 64],
            padding,
            space: NormalSpace::Object,
            ..NormalMapOptions::default()
        };
        let (image, report) = bake_normal_map(&mesh, &mesh, &options).unwrap();
        assert_eq!(report.missed, 0);
        let filled = |x: u32| image.linear_texel(x, 32)[1] == 1.0;
        let full: Vec<u32> = (0..64).filter(|&x| filled(x)).collect();
        assert_eq!((full.len() as u32, full[0]), (32 + 2 * padding, 16 - padding));
        assert_eq!(image.linear_texel(0, 0), [0.5, 0.5, 0.5, 1.0]);
    }
}

#[test]
fn colours_of_another_mesh_arrive_where_they_belong() {
    let detailed = bumpy_sphere();
    let coarse = cleaned(generate::icosphere(3));
    let scale = detailed.world_from_mesh.scale as f32;
    let color = |p: Vec3| (0.5 + 0.5 * (p * scale * 3.0)).extend(0.7);
    let paint = OfPosition(color);
    let source = TransferSource::new(&coarse, &detailed, Some(&paint), &TransferOptions::default()).unwrap();
    let kinds: Vec<ChannelKind> = source.channels().iter().map(|c| c.kind).collect();
    assert_eq!(kinds, [ChannelKind::Normal, ChannelKind::BaseColor]);
    let cover = cover(&coarse, 64, 50_000);
    let options = TransferOptions { normals: false, ..TransferOptions::default() };
    let on = |threads: usize| {
        let source = TransferSource::new(&coarse, &detailed, Some(&paint), &options).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let asset = pool.install(|| baked(&coarse, &cover, &source, &float_options(Fit::Sharp)));
        (std::fs::read(&asset.path).unwrap(), source.report(), asset)
    };
    let (bytes, report, asset) = on(1);
    let (same_bytes, same_report, _) = on(3);
    assert!(bytes == same_bytes && report == same_report);
    for triangle in (0..coarse.triangles.len()).step_by(5) {
        let lambda = Vec3::new(0.2, 0.3, 0.5);
        let read = sample(&asset.cache, 0, 0, triangle, lambda);
        let p = at(&coarse, triangle, lambda);
        let u = p.normalize();
        let expected = color(u * (1.0 + bumps(u)) / scale);
        assert!((read - expected).truncate().length() < 0.02, "{triangle}: {read} {expected}");
    }
}

/// A colour per triangle.
struct OfTriangle(Vec<Vec4>);

impl Source for OfTriangle {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = self.0[point.at.index()];
    }
}

/// Highlights that are stretched along x, all over a plane; their direction is to and fro by turns.
struct ToAndFro;

impl Source for ToAndFro {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel::new(ChannelKind::Anisotropy)]
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = Vec3::new(1.0_f32.copysign(point.position.x), 0.0, 0.05).extend(0.8);
    }
}

#[test]
fn directions_that_differ_by_their_sign_do_not_cancel() {
    let mesh = cleaned(generate::grid(3));
    let options = TransferOptions { normals: false, ..TransferOptions::default() };
    let source = TransferSource::new(&mesh, &mesh, Some(&ToAndFro), &options).unwrap();
    let triangle = (0..mesh.triangles.len())
        .find(|&t| {
            mesh.triangle_positions(t).iter().any(|p| p.x < -0.01)
                && at(&mesh, t, Vec3::splat(1.0 / 3.0)).x > 0.0
        })
        .unwrap();
    let corners = mesh.triangle_positions(triangle);
    let first = corners.iter().position(|p| p.x < -0.01).unwrap();
    let other = corners.iter().position(|p| p.x > 0.01).unwrap();
    // Where the side between them crosses the seam.
    let share = corners[first].x / (corners[first].x - corners[other].x);
    let mut lambda = Vec3::ZERO;
    lambda[first] = 1.0 - share;
    lambda[other] = share;
    let lambda = lambda * 0.9 + Vec3::splat(0.1 / 3.0);
    let steps = [Vec3::X * 0.3, Vec3::Z * 0.3];
    let point = TexelPoint {
        at: SurfacePoint { triangle: triangle as u32, lambda },
        lambda_steps: steps.map(|step| lambda_step(corners, step)),
        position: at(&mesh, triangle, lambda),
        position_steps: steps,
        normal: mesh.facet_normal(triangle).as_vec3(),
    };
    let mut values = [Vec4::ZERO];
    source.evaluate(&point, &mut values);
    let [x, _, z, strength] = values[0].to_array();
    assert!(x.abs() > 0.99 && z.abs() < 0.1 && (strength - 0.8).abs() < 0.01, "{}", values[0]);
}

/// Smooth normals beside the upper edges of the inner box point at the lid of the outer one, which is nearer than its walls.
#[test]
fn beside_creases_points_show_what_faces_as_they_do() {
    let coarse = cleaned(generate::cube(4));
    let mut model = generate::cube(4);
    model.positions.iter_mut().for_each(|p| *p *= DVec3::new(1.1, 1.01, 1.1));
    let detailed = cleaned(model);
    let color = |mesh: &Mesh, triangle: usize| 0.5 * mesh.facet_normal(triangle).as_vec3() + 0.5;
    let paint = OfTriangle((0..detailed.triangles.len()).map(|t| color(&detailed, t).extend(1.0)).collect());
    let options = TransferOptions { normals: false, ..TransferOptions::default() };
    let source = TransferSource::new(&coarse, &detailed, Some(&paint), &options).unwrap();
    let near = [Vec3::new(0.9, 0.05, 0.05), Vec3::new(0.05, 0.9, 0.05), Vec3::new(0.05, 0.05, 0.9)];
    for triangle in 0..coarse.triangles.len() {
        for lambda in near.into_iter().chain([Vec3::splat(1.0 / 3.0)]) {
            let point = TexelPoint {
                at: SurfacePoint { triangle: triangle as u32, lambda },
                lambda_steps: [Vec3::ZERO; 2],
                position: at(&coarse, triangle, lambda),
                position_steps: [Vec3::ZERO; 2],
                normal: coarse.facet_normal(triangle).as_vec3(),
            };
            let mut values = [Vec4::ZERO];
            source.evaluate(&point, &mut values);
            let (found, expected) = (values[0].truncate(), color(&coarse, triangle));
            assert!(found.distance(expected) < 1e-3, "{triangle} {lambda}: {found} {expected}");
        }
    }
}

/// What jumps at creases, as light does.
struct Jumping(OfTriangle);

impl Source for Jumping {
    fn channels(&self) -> Vec<SourceChannel> {
        self.0.channels()
    }

    fn prefilter(&self) -> Prefilter {
        self.0.prefilter()
    }

    fn jumps_at_creases(&self) -> bool {
        true
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.0.evaluate(point, values);
    }
}

/// A cube whose faces have different colours, transferred to another cube: no colour runs over an edge.
#[test]
fn what_jumps_at_creases_does_so_on_another_mesh() {
    let (coarse, detailed) = (cleaned(generate::cube(2)), cleaned(generate::cube(4)));
    let color = |mesh: &Mesh, triangle: usize| 0.5 * mesh.facet_normal(triangle).as_vec3() + 0.5;
    let paint = OfTriangle((0..detailed.triangles.len()).map(|t| color(&detailed, t).extend(1.0)).collect());
    let paint = Jumping(paint);
    let options = TransferOptions { normals: false, ..TransferOptions::default() };
    let source = TransferSource::new(&coarse, &detailed, Some(&paint), &options).unwrap();
    let options = CoverOptions {
        budget: TexelBudget::Total(20_000),
        cut_creases: source.jumps_at_creases(),
        ..CoverOptions::default()
    };
    let cover = build_cover(&coarse, &options).unwrap().0;
    let asset = baked(&coarse, &cover, &source, &float_options(Fit::Sharp));
    for triangle in 0..coarse.triangles.len() {
        for lambda in [Vec3::new(0.96, 0.02, 0.02), Vec3::new(0.02, 0.96, 0.02), Vec3::new(0.02, 0.02, 0.96)]
        {
            let found = sample(&asset.cache, 0, 0, triangle, lambda).truncate();
            let expected = color(&coarse, triangle);
            assert!(found.distance(expected) < 1e-2, "{triangle} {lambda}: {found} {expected}");
        }
    }
}

/// Coordinates that repeat an image: each texel lies on the triangle in some copy, often not in the first.
#[test]
fn repeated_coordinates_fill_all_texels_that_they_cover() {
    let mut model = generate::grid(1);
    model.triangles.truncate(1);
    for repeats in [1.0, 1.5, 2.0] {
        let corners = [Vec2::ZERO, Vec2::new(repeats, 0.0), Vec2::splat(repeats)];
        model.corners.uv_sets = vec![corners.to_vec()];
        model.corners.normals.clear();
        let mesh = cleaned(model.clone());
        let space = NormalSpace::Object;
        let options = NormalMapOptions { size: [16, 16], padding: 0, space, ..NormalMapOptions::default() };
        let (image, report) = bake_normal_map(&mesh, &mesh, &options).unwrap();
        assert_eq!(report.missed, 0);
        // Centres of the texels of all copies: on or below the diagonal.
        let columns = (16.0 * repeats) as u32;
        let mut covered = [[false; 16]; 16];
        for (y, x) in (0..columns).flat_map(|y| (y..columns).map(move |x| (y as usize, x as usize))) {
            covered[y % 16][x % 16] = true;
        }
        for (y, x) in (0..16).flat_map(|y| (0..16).map(move |x| (y, x))) {
            let is_full = image.linear_texel(x, y)[1] == 1.0;
            assert_eq!(is_full, covered[y as usize][x as usize], "{repeats}: {x} {y}");
        }
    }
}

#[test]
fn a_cage_that_is_too_small_is_counted() {
    let sphere = |radius: f64| {
        let mut model = generate::icosphere(3);
        model.positions.iter_mut().for_each(|p| *p *= radius);
        cleaned(model)
    };
    let (coarse, detailed) = (sphere(1.0), sphere(1.2));
    let missed = |cage: Option<f64>| {
        let options = NormalMapOptions { size: [32, 32], samples: 1, cage, ..NormalMapOptions::default() };
        let mut coarse = coarse.clone();
        coarse.corners.uv_sets =
            vec![(0..3 * coarse.triangles.len()).map(|c| [Vec2::ZERO, Vec2::X, Vec2::Y][c % 3]).collect()];
        let (_, report) = bake_normal_map(&coarse, &detailed, &options).unwrap();
        (report.missed, report.points)
    };
    assert_eq!(missed(None).0, 0);
    assert_eq!(missed(Some(0.25)).0, 0);
    let (all, points) = missed(Some(0.05));
    assert!(all == points && points > 400, "{all} of {points}");
}

#[test]
fn what_cannot_be_transferred_is_refused() {
    let mesh = cleaned(generate::icosphere(1));
    let empty = Mesh::default();
    let transfer = |coarse, detailed, options: TransferOptions| {
        TransferSource::new(coarse, detailed, None, &options).unwrap_err().to_string()
    };
    let good = TransferOptions::default();
    assert_eq!(transfer(&empty, &mesh, good), "the coarse mesh has no triangles");
    assert_eq!(transfer(&mesh, &empty, good), "the detailed mesh has no triangles");
    let cage = TransferOptions { cage: Some(0.0), ..good };
    assert!(transfer(&mesh, &mesh, cage).starts_with("the cage is 0 "));
    let samples = TransferOptions { samples: 0, ..good };
    assert!(transfer(&mesh, &mesh, samples).starts_with("samples is 0, "));
    let map = |options| bake_normal_map(&mesh, &mesh, &options).unwrap_err().to_string();
    let good = NormalMapOptions::default();
    assert!(map(good).contains("0 sets of texture coordinates, but set 0 "));
    let mut unfolded = cleaned(generate::icosphere(1));
    unfolded.corners.uv_sets = vec![vec![Vec2::ZERO; 3 * unfolded.triangles.len()]];
    let error = bake_normal_map(&unfolded, &mesh, &NormalMapOptions { uv_set: 1, ..good }).unwrap_err();
    assert!(error.to_string().contains("1 set of texture coordinates, but set 1 "), "{error}");
    for size in [[0, 4], [4, 1 << 20]] {
        assert!(map(NormalMapOptions { size, ..good }).contains(&format!("{} x {}", size[0], size[1])));
    }
    assert!(map(NormalMapOptions { padding: 257, ..good }).starts_with("the padding is 257 "));
}
