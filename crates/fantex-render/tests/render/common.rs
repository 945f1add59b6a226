//! Meshes, cameras and rays that several tests share.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_cover::{Cover, Frame, Group, GroupKind, UnfoldedCorners};
use fantex_mesh::{Mesh, interpolate};
use fantex_render::{
    AmbientLight, Background, Camera, FanSurface, FilterOptions, Hit, Light, Lights, Picture, RenderOptions,
    Scene, SceneObject, Shading, Surface, render,
};
use fantex_store::{Channel, Sampler, TileId, TileSource, TileTexels};
use fantex_test::{data, opened};
use fantex_texture::look::{LightingModel, LookMaterial, Slot};
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, ShadingPoint, Texture};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};

/// A small deterministic random number generator (xorshift64*, S. Vigna 2014).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in 0..1.
    pub(crate) fn unit(&mut self) -> f32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in -1..1.
    pub(crate) fn signed(&mut self) -> f32 {
        self.unit() * 2.0 - 1.0
    }
}

/// A bumpy sheet in [-1, 1]^2 around z = 0: points jittered (so little that no cell folds), random diagonals. No part of it hides another from a
/// camera on the z axis.
pub(crate) fn sheet(cells: usize, bumps: f32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    let row = cells + 1;
    for y in 0..=cells {
        for x in 0..=cells {
            let on_border = x == 0 || y == 0 || x == cells || y == cells;
            let jitter = if on_border { 0.0 } else { 0.2 };
            let at = |i: usize, r: f32| (i as f32 + jitter * r) / cells as f32 * 2.0 - 1.0;
            let (px, py) = (at(x, random.signed()), at(y, random.signed()));
            mesh.positions.push(Vec3::new(px, py, bumps * random.signed()));
        }
    }
    for y in 0..cells {
        for x in 0..cells {
            let [a, b, c, d] =
                [y * row + x, y * row + x + 1, (y + 1) * row + x + 1, (y + 1) * row + x].map(|i| i as u32);
            let halves = if random.unit() < 0.5 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            mesh.triangles.extend(halves);
        }
    }
    mesh
}

/// A sphere of radius `radius` around the origin, `segments` x `2 segments` patches.
pub(crate) fn sphere(segments: u32, radius: f32) -> Mesh {
    use std::f32::consts::PI;
    let mut mesh = Mesh::default();
    let ring = 2 * segments;
    mesh.positions.push(Vec3::Y * radius);
    for i in 1..segments {
        let (y, r) = ((PI * i as f32 / segments as f32).cos(), (PI * i as f32 / segments as f32).sin());
        for j in 0..ring {
            let angle = 2.0 * PI * j as f32 / ring as f32;
            mesh.positions.push(Vec3::new(r * angle.sin(), y, r * angle.cos()) * radius);
        }
    }
    mesh.positions.push(Vec3::NEG_Y * radius);
    let bottom = mesh.positions.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * ring + j % ring;
    for j in 0..ring {
        mesh.triangles.push([0, at(1, j), at(1, j + 1)]);
        for i in 1..segments - 1 {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        mesh.triangles.push([bottom, at(segments - 1, j + 1), at(segments - 1, j)]);
    }
    mesh
}

/// A unit square around the origin in the xy plane, facing +z, with upright texture coordinates.
pub(crate) fn square() -> Mesh {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    let mut mesh = Mesh {
        positions: corners.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        materials: vec![fantex_mesh::Material::default()],
        ..Mesh::default()
    };
    let uv = mesh
        .triangles
        .iter()
        .flatten()
        .map(|&v| mesh.positions[v as usize])
        .map(|p| glam::Vec2::new(p.x + 0.5, 0.5 - p.y))
        .collect();
    mesh.corners.uv_sets = vec![uv];
    mesh
}

/// A camera that looks along -z.
pub(crate) fn frontal(distance: f64, fov_degrees: f64) -> Camera {
    Camera { eye: DVec3::Z * distance, target: DVec3::ZERO, up: DVec3::Y, fov_degrees }
}

/// The ray through a position in pixels, by the camera's definition.
pub(crate) fn ray(camera: &Camera, size: [u32; 2], x: f64, y: f64) -> DVec3 {
    let forward = (camera.target - camera.eye).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let [width, height] = size.map(f64::from);
    let tangent = (camera.fov_degrees.to_radians() / 2.0).tan();
    let (sx, sy) = ((x / width * 2.0 - 1.0) * tangent * width / height, (1.0 - y / height * 2.0) * tangent);
    forward + right * sx + up * sy
}

/// The nearest intersection of a ray: triangle and barycentric coordinates.
pub(crate) fn cast(mesh: &Mesh, origin: DVec3, direction: DVec3) -> Option<(usize, DVec3)> {
    let mut best: Option<(f64, usize, DVec3)> = None;
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        let n = (b - a).cross(c - a);
        let s = (a - origin).dot(n) / direction.dot(n);
        let p = origin + direction * s;
        let area = |u: DVec3, v: DVec3| (u - p).cross(v - p).dot(n) / n.length_squared();
        let lambda = DVec3::new(area(b, c), area(c, a), area(a, b));
        if s > 0.0 && lambda.min_element() >= 0.0 && best.is_none_or(|b| s < b.0) {
            best = Some((s, t, lambda));
        }
    }
    best.map(|(_, t, lambda)| (t, lambda))
}

/// A colour that tells triangles apart.
pub(crate) fn triangle_color(hit: &Hit) -> Vec3 {
    let h = hit.at.triangle.wrapping_mul(2_654_435_761);
    Vec3::new((h >> 24) as f32, (h >> 16 & 255) as f32, (h >> 8 & 255) as f32) / 255.0
}

// Pictures that were looked at and found right, in `tests/goldens`.

/// Largest difference of an 8-bit sRGB value from its golden. Visibility and coverage are decided in integers and do
/// not vary; colours go through powers, sines and square roots whose last bits differ between platforms, which can turn
/// a rounding by one step, and by two where two such values meet in a pixel.
const TOLERANCE: u8 = 2;

/// Compares a picture with its golden. `FANTEX_BLESS=1` writes goldens instead; a missing one fails.
pub(crate) fn check_golden(name: &str, picture: &Picture) {
    let path = folder().join(format!("{name}.png"));
    let seen = picture.to_srgb_image();
    if std::env::var_os("FANTEX_BLESS").is_some_and(|v| v == "1") {
        seen.save(&path).unwrap();
        return;
    }
    let golden = Image::load(&path).unwrap_or_else(|e| panic!("no golden (FANTEX_BLESS=1 writes it): {e}"));
    let difference = largest_difference(&golden, &seen);
    if difference.is_none_or(|d| d > TOLERANCE) {
        let actual = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        seen.save(&actual).unwrap();
        panic!(
            "{name} differs from its golden by {difference:?} of 255 (allowed {TOLERANCE}); see {}",
            actual.display()
        );
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens")
}

/// In steps of 8-bit values; `None` for pictures of different shape.
fn largest_difference(a: &Image, b: &Image) -> Option<u8> {
    use fantex_texture::Samples::U8;
    let (U8(x), U8(y)) = (&a.samples, &b.samples) else {
        return None;
    };
    let same_shape = (a.width, a.height, a.channels) == (b.width, b.height, b.channels);
    same_shape.then(|| x.iter().zip(y).map(|(x, y)| x.abs_diff(*y)).max().unwrap_or(0))
}

// Models, images and textures for looks.

/// An image through the first texture coordinates.
pub(crate) struct UvImage {
    pub(crate) image: ImageTexture,
    pub(crate) options: SampleOptions,
    /// Factor of the coordinates.
    pub(crate) repeat: f32,
}

impl UvImage {
    pub(crate) fn new(image: Image, repeat: f32) -> Arc<Self> {
        let options = SampleOptions { filter: Filter::Anisotropic, ..SampleOptions::default() };
        Arc::new(Self { image: ImageTexture::new(Arc::new(image)), options, repeat })
    }
}

impl Texture for UvImage {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let Some(point) = at.uv.first() else { return Vec4::ONE };
        let steps = point.steps.map(|s| s * self.repeat);
        Vec4::from_array(self.image.sample(point.uv * self.repeat, steps, &self.options))
    }
}

/// A texture that is a function.
pub(crate) struct Function<F>(pub(crate) F);

impl<F: Fn(&ShadingPoint<'_>) -> Vec4 + Send + Sync> Texture for Function<F> {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        (self.0)(at)
    }
}

pub(crate) fn model(name: &str) -> Option<Mesh> {
    Some(opened(&data(name)?))
}

pub(crate) fn image(name: &str) -> Option<Image> {
    Some(Image::load(&data(name)?).unwrap())
}

/// An image whose channels are numbers, not colours.
pub(crate) fn image_as_numbers(name: &str) -> Option<Image> {
    Some(Image { space: ColorSpace::Linear, ..image(name)? })
}

pub(crate) fn look(material: LookMaterial) -> Vec<Arc<LookMaterial>> {
    vec![Arc::new(material)]
}

/// A level square of side one around the origin that faces +y, with texture coordinates.
pub(crate) fn ground() -> Mesh {
    let mesh = square();
    let flat = |p: &Vec3| Vec3::new(p.x, 0.0, -p.y);
    Mesh { positions: mesh.positions.iter().map(flat).collect(), ..mesh }
}

/// Bars with gaps as an image with alpha: `period` texels, of which `bar` are covered.
pub(crate) fn bars(side: u32, period: u32, bar: u32) -> Image {
    let texel = |i: u32| {
        let (x, y) = (i % side, i / side);
        let covered = x % period < bar || y % period < bar;
        [0.35, 0.2, 0.1, if covered { 1.0 } else { 0.0 }]
    };
    Image::from_linear_rgba(side, side, &(0..side * side).map(texel).collect::<Vec<_>>())
}

/// The steps of a point's first texture coordinates.
pub(crate) fn uv(at: &ShadingPoint<'_>) -> Vec2 {
    at.uv.first().map_or(Vec2::ZERO, |p| p.uv)
}

// Small scenes with a floor.

pub(crate) fn options(shading: Shading) -> RenderOptions {
    RenderOptions {
        width: 120,
        height: 90,
        samples: 4,
        shading,
        background: Background::Color(Vec3::ZERO),
        ..RenderOptions::default()
    }
}

pub(crate) fn picture(scene: &Scene, camera: &Camera, lights: &Lights, options: &RenderOptions) -> Picture {
    render(scene.mesh(), scene, camera, lights, options).unwrap().picture
}

/// White, diffuse, without any highlight: what is seen is the light that arrives.
pub(crate) fn matte() -> LookMaterial {
    LookMaterial {
        lighting: LightingModel::BlinnPhong,
        specular: Slot::number(0.0),
        shininess: Some(Slot::number(1.0)),
        ..LookMaterial::default()
    }
}

pub(crate) fn lit_by(lamps: Vec<Light>) -> Lights {
    Lights { ambient: AmbientLight::uniform(Vec3::ZERO), lamps }
}

/// The point of the plane `y = 0` under the middle of a pixel.
pub(crate) fn on_ground(camera: &Camera, size: [u32; 2], x: u32, y: u32) -> Option<DVec3> {
    let way = ray(camera, size, f64::from(x) + 0.5, f64::from(y) + 0.5);
    (way.y < 0.0).then(|| camera.eye - way * (camera.eye.y / way.y))
}

pub(crate) fn above(height: f64) -> Camera {
    Camera { eye: DVec3::new(0.3, height, 0.8), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 50.0 }
}

/// A square of side one at height 0.5 above a floor of side 6.
pub(crate) fn roof<'a>(
    floor: &'a Mesh,
    square: &'a Mesh,
    below: &'a dyn Surface,
    roof: &'a dyn Surface,
) -> Scene<'a> {
    let raised = DAffine3::from_translation(DVec3::Y * 0.5);
    Scene::new(vec![
        SceneObject::new(floor, below).placed(DAffine3::from_scale(DVec3::splat(6.0))),
        SceneObject::new(square, roof).placed(raised),
    ])
    .unwrap()
}

// Covers and tiles made by hand.

/// All levels of all tiles of all channels in memory.
#[derive(Default)]
pub(crate) struct MemoryTiles {
    /// `levels[channel][group][level]`
    pub(crate) levels: Vec<Vec<Vec<MemoryTile>>>,
}

#[derive(Clone)]
pub(crate) struct MemoryTile {
    pub(crate) extent: [u32; 2],
    /// Row-major from v = 0.
    pub(crate) rgba: Vec<[f32; 4]>,
}

impl MemoryTile {
    pub(crate) fn mean(&self) -> [f32; 4] {
        [0, 1, 2, 3].map(|c| self.rgba.iter().map(|t| t[c]).sum::<f32>() / self.rgba.len() as f32)
    }
}

impl TileSource for MemoryTiles {
    type Tile = MemoryTile;

    fn tile(&self, channel: usize, id: TileId) -> MemoryTile {
        self.levels[channel][id.group as usize][id.level as usize].clone()
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.levels[channel][group as usize][0].mean()
    }
}

impl TileTexels for MemoryTile {
    fn extent(&self) -> [u32; 2] {
        self.extent
    }

    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        let extent = Vec2::new(self.extent[0] as f32, self.extent[1] as f32);
        let p = (uv * extent - 0.5).clamp(Vec2::ZERO, extent - 1.0);
        let (x, y) = (p.x as u32, p.y as u32);
        let (x1, y1) = ((x + 1).min(self.extent[0] - 1), (y + 1).min(self.extent[1] - 1));
        let [a, b, c, d] = [self.texel(x, y), self.texel(x1, y), self.texel(x, y1), self.texel(x1, y1)];
        let t = p - p.floor();
        [0, 1, 2, 3].map(|i| {
            (a[i] * (1.0 - t.x) + b[i] * t.x) * (1.0 - t.y) + (c[i] * (1.0 - t.x) + d[i] * t.x) * t.y
        })
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        self.rgba[(y * self.extent[0] + x) as usize]
    }
}

/// A surface that reads tiles in memory.
pub(crate) fn fan_surface<'a>(
    mesh: &Mesh,
    cover: &Cover,
    channels: &[Channel],
    tiles: &'a MemoryTiles,
    filter: FilterOptions,
) -> FanSurface<&'a MemoryTiles> {
    FanSurface::new(Sampler::new(Arc::new(mesh.clone()), Arc::new(cover.clone()), channels, tiles, filter))
}

/// One fan per tile, each with its own direction near +z and its own turn; for meshes that face +z.
pub(crate) fn fan_cover(mesh: &Mesh, extent: [u32; 2]) -> Cover {
    let mut random = Random::new(77);
    let mut frame_of = |v: usize| {
        let direction = Vec3::new(0.2 * random.signed(), 0.2 * random.signed(), 1.0).normalize();
        let x_axis = Vec3::new(random.signed(), random.signed(), 0.0).cross(direction).normalize();
        Frame { origin: mesh.positions[v], direction, x_axis }
    };
    let group = |v: usize| {
        let frame = frame_of(v);
        let fan = mesh.triangles.iter().filter(|t| t.contains(&(v as u32))).flatten();
        let reach = fan.fold(0f32, |reach, &w| {
            let q = mesh.positions[w as usize] - frame.origin;
            reach.max(q.dot(frame.x_axis).abs()).max(q.dot(frame.y_axis()).abs())
        });
        let (uv_scale, uv_offset) = (Vec2::splat(0.45 / reach), Vec2::splat(0.5));
        Group { kind: GroupKind::Projected, frame, uv_scale, uv_offset, extent }
    };
    let groups = (0..mesh.positions.len()).map(group).collect();
    Cover {
        delta: 0.2,
        density: 100.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
        corner_groups: mesh.triangles.clone(),
        groups,
        unfolded: UnfoldedCorners::default(),
    }
}

/// Tiles of one channel: `value(point, triangle, lambda, frame)` at the surface point under each texel, at every level.
pub(crate) fn bake(
    mesh: &Mesh,
    cover: &Cover,
    value: impl Fn(Vec3, Option<(usize, Vec3)>, &Frame) -> [f32; 4],
) -> Vec<Vec<MemoryTile>> {
    let tile = |group: &Group, level: u32| {
        let extent @ [columns, rows] = group.level_extent(level);
        let texel = |i: u32| {
            let uv = Vec2::new(
                ((i % columns) as f32 + 0.5) / columns as f32,
                ((i / columns) as f32 + 0.5) / rows as f32,
            );
            let offset = (uv - group.uv_offset) / group.uv_scale;
            let frame = &group.frame;
            let on_plane = frame.origin + frame.x_axis * offset.x + frame.y_axis() * offset.y;
            let above: DVec3 = (on_plane + frame.direction * 2.0).as_dvec3();
            match cast(mesh, above, -frame.direction.as_dvec3()) {
                Some((t, lambda)) => {
                    let lambda = lambda.as_vec3();
                    let [a, b, c] = mesh.triangle_positions(t);
                    value(interpolate([a, b, c], lambda), Some((t, lambda)), frame)
                }
                None => value(on_plane, None, frame),
            }
        };
        MemoryTile { extent, rgba: (0..columns * rows).map(texel).collect() }
    };
    let levels = |group: &Group| (0..group.level_count()).map(|level| tile(group, level)).collect();
    cover.groups.iter().map(levels).collect()
}
