//! Small pictures of textured objects, orthographic and unlit but for a touch of shade.

use std::path::Path;
use std::sync::Arc;

use fantex_base::Aabb;
use fantex_mesh::{LoadOptions, Mesh, generate, load, shading_normals};
use fantex_test::cleaned;
use fantex_texture::combine::{Channel, Contours, RampTexture};
use fantex_texture::coordinates::{Coordinates, ImageLookup, Parameter};
use fantex_texture::look::Slot;
use fantex_texture::warp::{
    AffineMap, BilinearMap, PlaneMap, ProjectiveMap, Spread, warp_forward, warp_inverse,
};
use fantex_texture::{
    ColorRamp, ColorSpace, Depth, Filter, Image, ImageTexture, OMap, Placement, RampInterpolation, SMap,
    SampleOptions, ShadingPoint, ShapeKind, Texture, TriplanarMap, TwoPartMapping, Wrap,
};
use glam::{DVec2, Mat3, Quat, Vec2, Vec3, Vec4};

use crate::common::{data_folder, shading_point};

/// What an orthographic camera sees: the nearest shading point of every pixel.
struct View {
    points: Vec<Option<ShadingPoint<'static>>>,
}

impl View {
    /// The mesh turned by `object_from_view`, filling the picture.
    fn new(mesh: &Mesh, size: u32, turn: Quat) -> Self {
        let normals = shading_normals(mesh);
        let axes = Mat3::from_quat(turn);
        let reach = mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        let pixel = 2.1 * reach / size as f32;
        let mut view = Self { points: vec![None; (size * size) as usize] };
        let mut depths = vec![f32::NEG_INFINITY; view.points.len()];
        for t in 0..mesh.triangles.len() {
            let p = mesh.triangle_positions(t);
            let corner_normals = [0, 1, 2].map(|corner| normals[3 * t + corner]);
            let screen = p.map(|p| {
                let q = axes.transpose() * p;
                Vec3::new(q.x / pixel + 0.5 * size as f32, 0.5 * size as f32 - q.y / pixel, q.z)
            });
            let [a, b, c] = screen.map(|s| s.truncate());
            let area = (b - a).perp_dot(c - a);
            if area >= 0.0 {
                continue;
            }
            let weights = |at: Vec2| {
                Vec3::new((c - b).perp_dot(at - b), (a - c).perp_dot(at - c), (b - a).perp_dot(at - a)) / area
            };
            let blend = |values: [Vec3; 3], w: Vec3| values[0] * w.x + values[1] * w.y + values[2] * w.z;
            let low = a.min(b).min(c).floor().max(Vec2::ZERO);
            let high = a.max(b).max(c).ceil().min(Vec2::splat(size as f32));
            for y in low.y as u32..high.y as u32 {
                for x in low.x as u32..high.x as u32 {
                    let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    let w = weights(at);
                    let depth = blend(screen, w).z;
                    let index = (y * size + x) as usize;
                    if w.min_element() < -1e-5 || depth <= depths[index] {
                        continue;
                    }
                    depths[index] = depth;
                    let steps = [Vec2::X, Vec2::Y].map(|step| weights(at + step) - w);
                    let n = blend(corner_normals, w).normalize();
                    view.points[index] = Some(ShadingPoint {
                        position_steps: steps.map(|step| blend(p, step)),
                        normal_steps: steps.map(|step| blend(corner_normals, step).reject_from_normalized(n)),
                        to_eye: Some(axes.z_axis),
                        ..shading_point(blend(p, w), n)
                    });
                }
            }
        }
        view
    }

    fn picture(&self, texture: &dyn Texture) -> Vec<Vec4> {
        let shade = |at: &ShadingPoint<'_>| {
            let facing = at.normal.dot(at.to_eye.unwrap_or(at.normal)).max(0.0);
            (texture.evaluate(at) * (0.35 + 0.65 * facing)).truncate().extend(1.0)
        };
        self.points.iter().map(|point| point.as_ref().map_or(Vec4::new(0.3, 0.3, 0.35, 1.0), shade)).collect()
    }
}

/// Pictures of one size side by side, in rows.
fn save_sheet(name: &str, size: u32, rows: &[Vec<Vec<Vec4>>]) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let (width, height) = (columns * size, rows.len() as u32 * size);
    let texels: Vec<[f32; 4]> = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let cell = rows[(y / size) as usize].get((x / size) as usize);
            cell.map_or([0.0, 0.0, 0.0, 1.0], |cell| cell[((y % size) * size + x % size) as usize].to_array())
        })
        .collect();
    let path = std::env::temp_dir().join(name);
    let image = Image::from_linear_rgb(width, height, &texels).converted(Depth::U8, ColorSpace::Srgb);
    image.save(&path).expect("the folder of temporary files is writable");
    eprintln!("see {}", path.display());
}

fn bounds(mesh: &Mesh) -> Aabb {
    let fold = |f: fn(Vec3, Vec3) -> Vec3, start| mesh.positions.iter().copied().fold(start, f);
    Aabb { min: fold(Vec3::min, Vec3::INFINITY), max: fold(Vec3::max, Vec3::NEG_INFINITY) }
}

fn lookup(texture: &Arc<ImageTexture>, coordinates: Coordinates) -> ImageLookup {
    let options = SampleOptions { filter: Filter::Anisotropic, ..SampleOptions::default() };
    ImageLookup { coordinates, options, ..ImageLookup::new(Arc::clone(texture)) }
}

fn o_maps(bounds: Aabb) -> [OMap; 4] {
    [OMap::Reflection, OMap::ObjectNormal, OMap::Centroid { center: bounds.center() }, OMap::SurfaceNormal]
}

/// Every S-map (rows) by every O-map (columns; the first column is the S-map of the position itself).
#[test]
#[ignore = "writes pictures to look at"]
fn mapped_objects() {
    let Some(folder) = data_folder("") else { return };
    let size = 220;
    let checker =
        Arc::new(ImageTexture::new(Arc::new(Image::load(folder.join("images/uv_checker_bw.png")).unwrap())));
    for (name, turn) in [
        ("meshes/WaterBottle/WaterBottle.gltf", Quat::from_rotation_y(2.8) * Quat::from_rotation_x(-0.4)),
        ("meshes/suzanne.ply", Quat::from_rotation_y(0.5) * Quat::from_rotation_x(-0.3)),
    ] {
        let mesh = cleaned(load(&folder.join(name), &LoadOptions::default()).unwrap());
        let view = View::new(&mesh, size, turn);
        let bounds = bounds(&mesh);
        let mut rows: Vec<Vec<_>> = ShapeKind::ALL
            .into_iter()
            .map(|kind| {
                let s_map = SMap::new(kind.fit(bounds), &Placement::default()).unwrap();
                let ways = o_maps(bounds).map(|o_map| Coordinates::TwoPart(TwoPartMapping { s_map, o_map }));
                std::iter::once(Coordinates::Surface(s_map))
                    .chain(ways)
                    .map(|coordinates| view.picture(&lookup(&checker, coordinates)))
                    .collect()
            })
            .collect();
        let triplanar = Coordinates::Triplanar(TriplanarMap::fit(bounds));
        let height = || Slot::Texture(Arc::new(Parameter::default()));
        let stops = vec![
            (-0.8, Vec4::new(0.0, 0.05, 0.4, 1.0)),
            (0.0, Vec4::new(0.05, 0.4, 0.05, 1.0)),
            (0.8, Vec4::new(0.8, 0.6, 0.3, 1.0)),
        ];
        let ramp = |interpolation| RampTexture {
            input: height(),
            channel: Channel::Red,
            ramp: ColorRamp::new(stops.clone(), interpolation).unwrap(),
        };
        let over = || Slot::Texture(Arc::new(ramp(RampInterpolation::Linear)));
        let pixels = Contours { over: over(), ..Contours::new(height(), 0.08) };
        let units = Contours { over: over(), width: Some(0.01), ..Contours::new(height(), 0.08) };
        rows.push(vec![
            view.picture(&lookup(&checker, triplanar)),
            view.picture(&pixels),
            view.picture(&units),
            view.picture(&ramp(RampInterpolation::Constant)),
            view.picture(&Parameter::Facing),
        ]);
        let stem = Path::new(name).file_stem().unwrap().to_string_lossy();
        save_sheet(&format!("fantex-mappings-{stem}.png"), size, &rows);
    }
}

/// The Earth as in the reference picture of the test data (its camera is unknown).
#[test]
#[ignore = "writes pictures to look at"]
fn earth() {
    let Some(folder) = data_folder("conformance/spherical_mapping") else { return };
    let earth =
        Arc::new(ImageTexture::new(Arc::new(Image::load(folder.join("earthSpherical.jpg")).unwrap())));
    let mesh = cleaned(generate::icosphere(5));
    let s_map = SMap::new(ShapeKind::Sphere.fit(bounds(&mesh)), &Placement::default()).unwrap();
    let pictures = [0.8_f32, std::f32::consts::PI].map(|turn| {
        let view = View::new(&mesh, 400, Quat::from_rotation_y(turn) * Quat::from_rotation_x(-0.35));
        view.picture(&lookup(&earth, Coordinates::Surface(s_map)))
    });
    save_sheet("fantex-mappings-earth.png", 400, &[pictures.to_vec()]);
}

/// Affine, projective and bilinear maps onto the same corners; below, a floor to the horizon and both forward scans.
#[test]
#[ignore = "writes pictures to look at"]
fn warped_images() {
    let Some(folder) = data_folder("images") else { return };
    let image = Image::load(folder.join("uv_checker_bw.png")).unwrap();
    let texture = ImageTexture::new(Arc::new(image.clone()));
    let size = 300;
    let quad = [(40.0, 60.0), (280.0, 20.0), (200.0, 280.0), (60.0, 200.0)].map(|(x, y)| DVec2::new(x, y));
    let floor =
        [(110.0, 120.0), (190.0, 120.0), (280.0, 290.0), (20.0, 290.0)].map(|(x, y)| DVec2::new(x, y));
    let corners = [DVec2::ZERO, DVec2::X, DVec2::Y];
    let affine = AffineMap::from_points(corners, [quad[0], quad[1], quad[3]]).unwrap();
    let projective = ProjectiveMap::from_quad(quad).unwrap();
    let bilinear = BilinearMap::from_quad(quad).unwrap();
    let horizon = ProjectiveMap::from_quad(floor).unwrap();
    let picture = |image: &Image| -> Vec<Vec4> {
        (0..size * size).map(|i| Vec4::from_array(image.linear_texel(i % size, i / size))).collect()
    };
    let inverse = |map: &dyn PlaneMap, wrap: Wrap| {
        let options = SampleOptions { wrap: [wrap; 2], filter: Filter::Ewa, ..SampleOptions::default() };
        picture(&warp_inverse(&texture, map, [size; 2], &options).unwrap())
    };
    let forward = |spread| {
        let small = ImageTexture::new(Arc::new(image.clone())).level(2).clone();
        picture(&warp_forward(&small, &projective, [size; 2], spread).unwrap())
    };
    let rows = [
        vec![
            inverse(&affine, Wrap::Border),
            inverse(&projective, Wrap::Border),
            inverse(&bilinear, Wrap::Border),
        ],
        vec![inverse(&horizon, Wrap::Repeat), forward(Spread::Bilinear), forward(Spread::Area)],
    ];
    save_sheet("fantex-mappings-warps.png", size, &rows);
}

/// A ball seen along `turn`, `size` pixels wide, in closed form.
fn ball_point(x: f32, y: f32, size: f32, turn: Quat) -> Option<ShadingPoint<'static>> {
    let (x, y) = (2.0 * x / size - 1.0, 1.0 - 2.0 * y / size);
    let squared = x * x + y * y;
    if squared > 0.8 {
        return None;
    }
    let z = (1.0 - squared).sqrt();
    let n = turn * Vec3::new(x, y, z);
    let steps =
        [Vec3::new(1.0, 0.0, -x / z), Vec3::new(0.0, -1.0, y / z)].map(|step| turn * step * (2.0 / size));
    Some(ShadingPoint {
        position_steps: steps,
        normal_steps: steps,
        to_eye: Some(turn * Vec3::Z),
        ..shading_point(n, n)
    })
}

#[test]
fn filtered_seams_and_poles_equal_supersampled_ones() {
    // Waves that fit the image's edges, so that the seam is smooth in truth, and too fine for the picture near the poles.
    let waves = Arc::new(crate::common::texture(256, 128, 3, |x, y| {
        let [u, v] = [(x as f32 + 0.5) / 256.0, (y as f32 + 0.5) / 128.0].map(|t| std::f32::consts::TAU * t);
        [0.5 + 0.4 * (24.0 * u).sin(), 0.5 + 0.4 * (12.0 * v).sin(), 0.5 + 0.4 * (8.0 * (u + v)).cos(), 1.0]
    }));
    let bounds = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };
    let (size, samples) = (64, 8);
    for kind in [ShapeKind::Sphere, ShapeKind::Cylinder] {
        let s_map = SMap::new(kind.fit(bounds), &Placement::default()).unwrap();
        for o_map in [OMap::ObjectNormal, OMap::Centroid { center: Vec3::ZERO }, OMap::SurfaceNormal] {
            // The seam in the middle, seen from 40 degrees above.
            let turn = Quat::from_rotation_y(std::f32::consts::PI) * Quat::from_rotation_x(-0.7);
            let mut filtered = lookup(&waves, Coordinates::TwoPart(TwoPartMapping { s_map, o_map }));
            filtered.options.filter = Filter::Ewa;
            filtered.options.max_anisotropy = 64.0;
            let mut truth = filtered.clone();
            truth.options.filter = Filter::Bilinear;
            let (mut sum, mut count) = (0.0, 0);
            let (mut at_seam, mut elsewhere) = (0.0_f32, 0.0_f32);
            for (x, y) in (0..size * size).map(|i| (i % size, i / size)) {
                let Some(at) = ball_point(x as f32 + 0.5, y as f32 + 0.5, size as f32, turn) else {
                    continue;
                };
                let subsamples = (0..samples * samples).filter_map(|i| {
                    let at = [i % samples, i / samples].map(|k| (k as f32 + 0.5) / samples as f32);
                    ball_point(x as f32 + at[0], y as f32 + at[1], size as f32, turn)
                        .map(|at| truth.evaluate(&at))
                });
                let (total, n) = subsamples.fold((Vec4::ZERO, 0.0), |(sum, n), value| (sum + value, n + 1.0));
                let error = (filtered.evaluate(&at) - total / n).truncate().length();
                sum += error * error;
                count += 1;
                // The seam runs down the middle of the picture. The pole is left out: there the footprint is all round.
                let worst = if x == size / 2 || x + 1 == size / 2 { &mut at_seam } else { &mut elsewhere };
                if at.normal.y < 0.9 {
                    *worst = worst.max(error);
                }
            }
            let rms = (sum / count as f32).sqrt();
            assert!(rms < 0.05, "{kind:?} {o_map:?}: off by {rms}");
            assert!(
                at_seam <= elsewhere,
                "{kind:?} {o_map:?}: off by {at_seam} at the seam, {elsewhere} elsewhere"
            );
        }
    }
}
