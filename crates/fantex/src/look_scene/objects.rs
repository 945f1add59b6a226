//! The objects of a look: models and simple shapes, displaced, where they stand.

use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::input::{self, Held};
use fantex_base::{Error, ErrorKind, Result, counted, grouped};
use fantex_look::data::{ObjectTable, ShapeName, ShapeTable, TextureTable};
use fantex_look::problem;
use fantex_look::{Key, Resolver};
use fantex_mesh::{
    CleanOptions, CornerAttributes, DisplaceOptions, DisplacePoint, LoadOptions, Material, Mesh, Model,
    ObjectSpace, Refinement, clean, displace, load,
};
use fantex_render::{FanSurface, FilterOptions, LookSurface, Surface};
use fantex_store::{Asset, PageCache};
use fantex_texture::look::{LookMaterial, Slot};
use fantex_texture::material::{LeftOut, vertex_color};
use fantex_texture::{Filtering, ShadingPoint, UvPoint};
use glam::{DAffine3, DQuat, DVec2, DVec3, EulerRot, Vec2, Vec3};

use super::{MaterialResolver, ResolvedMaterials};

/// A model of the command line.
#[derive(Clone, Debug)]
pub struct GivenModel {
    /// Its file, for messages and as base of nothing else.
    pub path: PathBuf,
    /// Its geometry and own materials.
    pub mesh: Mesh,
}

/// An object that is ready to be shown.
#[derive(Debug)]
pub(super) struct Object {
    pub(super) shape: Shape,
    /// Images of the model that could not be read.
    pub(super) left_out: LeftOut,
    pub(super) name: Option<String>,
    pub(super) world_from_object: DAffine3,
}

#[derive(Debug)]
pub(super) enum Shape {
    Model { mesh: Box<Mesh>, materials: Vec<Arc<LookMaterial>> },
    Asset(Box<PageCache>),
}

impl Object {
    pub(super) fn mesh(&self) -> &Mesh {
        match &self.shape {
            Shape::Model { mesh, .. } => mesh,
            Shape::Asset(cache) => cache.asset().mesh(),
        }
    }

    /// Tiles of an asset that could not be read.
    pub(super) fn damaged_tiles(&self) -> u64 {
        match &self.shape {
            Shape::Model { .. } => 0,
            Shape::Asset(cache) => cache.damage().pages,
        }
    }

    pub(super) fn surface(&self, time: f32, filter: FilterOptions) -> Box<dyn Surface + '_> {
        match &self.shape {
            Shape::Model { mesh, materials } => {
                let place = self.world_from_object.matrix3.as_mat3();
                Box::new(LookSurface::new(mesh, materials.clone()).at_time(time).in_scene(place))
            }
            Shape::Asset(cache) => FanSurface::boxed(cache, filter),
        }
    }
}

impl MaterialResolver<'_> {
    /// All objects of the look; the given model alone where it has none.
    pub(super) fn objects(&self, given: Option<&GivenModel>) -> Result<Vec<Object>> {
        let tables = &self.file.look().object;
        if tables.is_empty() {
            let given = given.ok_or_else(|| self.nothing_to_show())?;
            return Ok(vec![self.model(given.mesh.clone(), &given.path, None, &ObjectTable::default())?]);
        }
        let objects = tables.iter().enumerate();
        objects.map(|(index, table)| self.object(index, table, given)).collect()
    }

    fn nothing_to_show(&self) -> Error {
        let path = self.file.path();
        Error::malformed(format!(
            "{} names no model: give it an [[object]] with the key 'model' or 'shape', or render a model with --look",
            path.display()
        ))
        .with_path(path)
    }

    fn object(&self, index: usize, table: &ObjectTable, given: Option<&GivenModel>) -> Result<Object> {
        let key = Key::of(["object"]).index(index);
        let (mesh, path) = match (&table.model, &table.shape) {
            (Some(_), Some(_)) => {
                return Err(self.file.error(&key, problem::exclusive("model", "shape")));
            }
            (None, Some(shape)) => {
                let (model, _held) = self.accept(&key.name("shape"), model_of(shape))?;
                (cleaned(model)?, PathBuf::from("shape"))
            }
            (Some(name), None) => {
                let path = self.file.file(name);
                if is_asset(&path) {
                    return self.asset(&path, table, &key);
                }
                let mesh = load(&path, &LoadOptions::default()).and_then(cleaned);
                (self.accept(&key.name("model"), mesh)?, path)
            }
            (None, None) => {
                let given = given.ok_or_else(|| self.nothing_to_show())?;
                (given.mesh.clone(), given.path.clone())
            }
        };
        self.model(mesh, &path, Some(index), table)
    }

    fn asset(&self, path: &Path, table: &ObjectTable, key: &Key) -> Result<Object> {
        if table.material.is_some() || !table.materials.is_empty() {
            let sentence =
                "an asset is baked already and keeps its look; leave the key out, or name the model";
            return Err(self.file.error(&key.name("material"), Error::malformed(sentence)));
        }
        let asset = self.accept(&key.name("model"), Asset::open(path))?;
        // All assets share the memory.
        let names = self.file.look().object.iter().filter_map(|object| object.model.as_ref());
        let assets = names.filter(|name| is_asset(Path::new(&name.0))).count();
        let memory_bytes = self.options.memory_bytes as usize / assets.max(1);
        let cache = PageCache::new(Arc::new(asset), memory_bytes);
        Ok(Object {
            shape: Shape::Asset(Box::new(cache)),
            left_out: LeftOut::default(),
            name: table.name.clone(),
            world_from_object: placement(table),
        })
    }

    fn model(&self, mesh: Mesh, path: &Path, index: Option<usize>, table: &ObjectTable) -> Result<Object> {
        let (mesh, resolved) = self.shape_and_materials(mesh, path, index)?;
        Ok(Object {
            shape: Shape::Model { mesh: Box::new(mesh), materials: resolved.materials },
            left_out: resolved.left_out,
            name: table.name.clone(),
            world_from_object: placement(table),
        })
    }
}

fn is_asset(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("fan"))
}

fn cleaned(model: fantex_mesh::Model) -> Result<Mesh> {
    Ok(clean(model, &CleanOptions::default())?.0)
}

fn placement(table: &ObjectTable) -> DAffine3 {
    let [x, y, z] = table.rotate.map(f64::to_radians);
    DAffine3::from_scale_rotation_translation(
        DVec3::from_array(table.scale.axes()),
        DQuat::from_euler(EulerRot::ZYX, z, y, x),
        DVec3::from_array(table.translate),
    )
}

// ---- Simple shapes with texture coordinates.

/// A point of a shape and its outward normal, by texture coordinates.
type Patch<'a> = &'a dyn Fn(DVec2) -> (DVec3, DVec3);

/// The shape as a model: texture coordinates with their origin at the top left, smooth normals. Its memory counts until it is cleaned.
///
/// # Errors
/// There is not so much left.
pub(super) fn model_of(table: &ShapeTable) -> Result<(Model, Vec<Held>)> {
    let mut shape = Builder::default();
    let size = DVec3::from_array(table.size.map(|length| length.0));
    let (radius, half) = (table.radius, 0.5 * table.height);
    let round = table.segments.unwrap_or(64).max(3);
    let flat = table.segments.unwrap_or(1);
    match table.kind {
        ShapeName::Plane => shape.patch([flat; 2], &|uv| {
            (DVec3::new((uv.x - 0.5) * size.x, 0.0, (uv.y - 0.5) * size.z), DVec3::Y)
        })?,
        ShapeName::Box => {
            for (right, down) in BOX_FACES {
                let out = down.cross(right);
                shape.patch([flat; 2], &|uv| {
                    let on_cube = out + right * (2.0 * uv.x - 1.0) + down * (2.0 * uv.y - 1.0);
                    (on_cube * 0.5 * size, out)
                })?;
            }
        }
        ShapeName::Sphere => shape.patch([round, (round / 2).max(2)], &|uv| {
            let (out, up) = sin_cos(PI * uv.y);
            let normal = (around(uv.x) * out).with_y(up);
            (normal * radius, normal)
        })?,
        ShapeName::Cylinder => {
            shape.patch([round, flat], &|uv| {
                let normal = around(uv.x);
                (normal * radius + DVec3::Y * (half - table.height * uv.y), normal)
            })?;
            for side in [1.0, -1.0] {
                shape.patch([round, 1], &|uv| {
                    let rim = around(if side > 0.0 { uv.x } else { 1.0 - uv.x });
                    (rim * (radius * uv.y) + DVec3::Y * (side * half), DVec3::Y * side)
                })?;
            }
        }
        ShapeName::Torus => shape.patch([round, (round / 2).max(3)], &|uv| {
            let (out, (sin, cos)) = (around(uv.x), sin_cos(TAU * uv.y));
            let normal = out * cos - DVec3::Y * sin;
            (out * radius + normal * table.tube, normal)
        })?,
    }
    Ok(shape.into_model())
}

/// Right and down of each face's image, seen from outside.
const BOX_FACES: [(DVec3, DVec3); 6] = [
    (DVec3::NEG_Z, DVec3::NEG_Y),
    (DVec3::Z, DVec3::NEG_Y),
    (DVec3::X, DVec3::Z),
    (DVec3::X, DVec3::NEG_Z),
    (DVec3::X, DVec3::NEG_Y),
    (DVec3::NEG_X, DVec3::NEG_Y),
];

/// The unit vector to the point of the equator with this `u`: the seam is at the back (-z), `u` grows to the right.
fn around(u: f64) -> DVec3 {
    let (sin, cos) = sin_cos(TAU * (u - 0.5));
    DVec3::new(sin, 0.0, cos)
}

/// Sine and cosine that are exactly 0 where only rounding keeps them from it, so that both sides of a seam and all points of a
/// pole are at one place.
fn sin_cos(angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    let exact = |x: f64| if x.abs() < 1e-15 { 0.0 } else { x };
    (exact(sin), exact(cos))
}

#[derive(Default)]
struct Builder {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    corners: CornerAttributes,
    held: Vec<Held>,
}

/// Bytes per triangle of a shape while it is made and cleaned.
const SHAPE_BYTES: u64 = 140;

impl Builder {
    /// A grid of quadrilaterals; `u` grows to the right and `v` downwards, seen from outside. Quadrilaterals that have
    /// shrunk to a point on one side become triangles when the model is cleaned.
    fn patch(&mut self, [columns, rows]: [u32; 2], patch: Patch<'_>) -> Result<()> {
        let triangles = 2 * u64::from(columns) * u64::from(rows);
        let what = format_args!("a side of {}", counted(triangles, "triangle"));
        self.held.push(input::reserve(what, SHAPE_BYTES * triangles)?);
        if self.corners.uv_sets.is_empty() {
            self.corners.uv_sets.push(Vec::new());
        }
        let first = self.positions.len() as u32;
        let stride = columns + 1;
        let coordinates = |index: u32| {
            let (column, row) = (index % stride, index / stride);
            DVec2::new(f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows))
        };
        for index in 0..stride * (rows + 1) {
            self.positions.push(patch(coordinates(index)).0);
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = row * stride + column;
                for triangle in [[a, a + stride, a + 1], [a + 1, a + stride, a + stride + 1]] {
                    self.triangles.push(triangle.map(|index| first + index));
                    for index in triangle {
                        let uv = coordinates(index);
                        let normal: Vec3 = patch(uv).1.as_vec3();
                        self.corners.uv_sets[0].push(uv.as_vec2());
                        self.corners.normals.push(normal);
                    }
                }
            }
        }
        Ok(())
    }

    fn into_model(self) -> (Model, Vec<Held>) {
        let model = Model {
            name: "shape".into(),
            positions: self.positions,
            triangles: self.triangles,
            corners: self.corners,
            materials: vec![Material::default()],
            ..Model::default()
        };
        (model, self.held)
    }
}

// ---- Displacement mapping.

/// A material's heights, in mesh units.
struct Heights {
    texture: Slot,
    /// Mesh units per unit of the texture.
    height: f32,
    middle: f32,
}

impl MaterialResolver<'_> {
    /// A model with the displacements of its materials as real geometry, and its materials.
    pub(super) fn shape_and_materials(
        &self,
        mesh: Mesh,
        model: &Path,
        object: Option<usize>,
    ) -> Result<(Mesh, ResolvedMaterials)> {
        let resolved = self.materials(&mesh, model, object)?;
        let Some(shape) = displaced(self, &mesh, &resolved)? else { return Ok((mesh, resolved)) };
        let is_landscape = |table: &TextureTable| matches!(table, TextureTable::Landscape(_));
        let has_altitudes = self.file.look().textures.values().any(is_landscape);
        let resolved =
            if has_altitudes { self.materials_on(&mesh, &shape, model, object)? } else { resolved };
        Ok((shape, resolved))
    }
}

/// The mesh with the displacements of its materials as real geometry; none where there are none.
fn displaced(
    resolver: &MaterialResolver<'_>,
    mesh: &Mesh,
    resolved: &ResolvedMaterials,
) -> Result<Option<Mesh>> {
    let scale = mesh.world_from_mesh.scale;
    let mut textures = Resolver::new(resolver.file, mesh, resolver.images, resolver.options);
    let mut heights: Vec<Option<Heights>> = Vec::new();
    let mut options = DisplaceOptions { max_triangles: 0, ..DisplaceOptions::default() };
    let mut edge = f64::INFINITY;
    let mut key = Key::default();
    for name in &resolved.names {
        let table = name.as_ref().and_then(|n| resolver.file.look().materials.get(n)?.displacement.as_ref());
        let (Some(name), Some(table)) = (name, table) else {
            heights.push(None);
            continue;
        };
        let Some(texture) = textures.displacement(name)? else { continue };
        key = Key::of(["materials", name, "displacement"]);
        let height = (table.height / scale) as f32;
        heights.push(Some(Heights { texture, height, middle: table.middle }));
        options.max_triangles = options.max_triangles.max(table.max_triangles);
        // A hundredth of the model's largest extent, which is between 1 and 2 mesh units.
        edge = edge.min(table.edge.map_or(0.01, |edge| edge / scale));
    }
    if heights.iter().all(Option::is_none) {
        return Ok(None);
    }
    options.refinement = Refinement::Uniform { longest_edge: edge as f32 };
    let space = ObjectSpace::of(mesh);
    let ask = |point: &DisplacePoint| match heights.get(mesh.material_of(point.at.index())) {
        Some(Some(heights)) => heights.at(mesh, &space, point, edge as f32),
        _ => 0.0,
    };
    let result = displace(mesh, &options, ask);
    let (displaced, _) = result.map_err(|error| {
        let (given, most) = (edge * scale, grouped(options.max_triangles, ' '));
        let error = match error.kind() {
            ErrorKind::TooLarge => Error::too_large(format!(
                "edges of {given} make more than the {most} triangles of max_triangles; make 'edge' longer or max_triangles larger"
            )),
            _ if edge < f64::from(Refinement::MIN_EDGE) => Error::malformed(format!(
                "edges of {given} are too short for a model of this size; give {} or more",
                f64::from(Refinement::MIN_EDGE) * scale
            )),
            _ => error,
        };
        resolver.file.error(&key, error)
    })?;
    Ok(Some(displaced))
}

impl Heights {
    /// In mesh units, averaged over about one of the small triangles.
    fn at(&self, mesh: &Mesh, space: &ObjectSpace, point: &DisplacePoint, width: f32) -> f32 {
        let (along, across) = point.normal.any_orthonormal_pair();
        let steps_mesh = [along * width, across * width];
        let uv: Vec<UvPoint> =
            mesh.corners.uv_sets.iter().map(|set| uv_point(mesh, set, point, steps_mesh)).collect();
        let at = ShadingPoint {
            position: space.point(point.position),
            position_steps: steps_mesh.map(|step| space.vector(step)),
            normal: point.normal,
            normal_steps: [Vec3::ZERO; 2],
            uv: &uv,
            vertex_color: vertex_color(mesh, point.at.index(), point.at.lambda),
            eye: None,
            time: 0.0,
            filtering: Filtering::Area,
        };
        self.height * (self.texture.evaluate_number(&at) - self.middle)
    }
}

/// Coordinates change with the position as over the flat triangle.
fn uv_point(mesh: &Mesh, set: &[Vec2], point: &DisplacePoint, steps_mesh: [Vec3; 2]) -> UvPoint {
    let triangle = point.at.index();
    let Some(&corners) = set.get(3 * triangle..).and_then(|corners| corners.first_chunk::<3>()) else {
        return UvPoint::default();
    };
    let [a, b, c] = mesh.triangle_positions(triangle);
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(ac);
    let scale = normal.length_squared().recip();
    let steps = steps_mesh.map(|step| {
        let (along_ab, along_ac) = (step.cross(ac).dot(normal) * scale, ab.cross(step).dot(normal) * scale);
        let change = (corners[1] - corners[0]) * along_ab + (corners[2] - corners[0]) * along_ac;
        if change.is_finite() { change } else { Vec2::ZERO }
    });
    UvPoint { uv: point.at.interpolate(corners), steps }
}

#[cfg(test)]
mod tests {
    use fantex_look::data::ShapeLength;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn shapes_are_closed_and_face_outwards() {
        for kind in [ShapeName::Box, ShapeName::Sphere, ShapeName::Cylinder, ShapeName::Torus] {
            let size = [ShapeLength(1.0), ShapeLength(2.0), ShapeLength(3.0)];
            let table = ShapeTable { kind, size, ..ShapeTable::default() };
            let (mesh, report) = clean(model_of(&table).unwrap().0, &CleanOptions::default()).unwrap();
            assert_eq!(report.topology.edges_boundary, 0, "{kind:?}");
            let volume: f32 = (0..mesh.triangles.len())
                .map(|t| {
                    let [a, b, c] = mesh.triangle_positions(t);
                    a.dot(b.cross(c)) / 6.0
                })
                .sum();
            assert!(volume > 0.0, "{kind:?} is inside out");
        }
    }

    #[test]
    fn planes_face_upwards() {
        let table = ShapeTable { kind: ShapeName::Plane, segments: Some(4), ..ShapeTable::default() };
        let (model, _) = model_of(&table).unwrap();
        assert_eq!(model.triangles.len(), 32);
        let [a, b, c] = model.triangles[0].map(|i| model.positions[i as usize]);
        assert!((b - a).cross(c - a).y > 0.0);
    }
}
