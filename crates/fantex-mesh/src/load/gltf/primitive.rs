//! Primitives: from accessors to triangles with corner attributes.

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};

use super::accessor::Reader;
use super::scene::MeshInstance;
use super::schema::{Accessor, Primitive};
use super::{Document, Error, GltfProblem, get, material};
use crate::load::builder::pad;
use crate::{Model, counted};

/// More sets than this are not read: nobody needs them, and a set's number must not decide how much is allocated.
const MAX_UV_SETS: usize = 8;

/// Appends all instances of all meshes to the model.
pub(super) fn load_all(
    document: &Document,
    instances: &[MeshInstance],
    model: &mut Model,
) -> Result<(), Error> {
    let mut loader = Loader { document, model, default_material: None, skipped: Skipped::default() };
    let mut is_loaded = vec![false; document.root.meshes.len()];
    for instance in instances {
        let said_so_far = (loader.skipped, loader.model.notes.len());
        let mesh = &document.root.meshes[instance.mesh];
        if mesh.weights.iter().any(|&w| w != 0.0) {
            loader.model.notes.push(format!("the morph targets of mesh {} were left out", instance.mesh));
        }
        for (index, primitive) in mesh.primitives.iter().enumerate() {
            let label = format!("primitive {index} of mesh {}", instance.mesh);
            loader.load(primitive, &label, &instance.world_from_mesh)?;
        }
        // What is to be said of a mesh is said once, however often it stands in the world.
        if std::mem::replace(&mut is_loaded[instance.mesh], true) {
            loader.skipped = said_so_far.0;
            loader.model.notes.truncate(said_so_far.1);
        }
    }
    loader.finish();
    Ok(())
}

/// Primitives that are not loaded.
#[derive(Clone, Copy, Default)]
struct Skipped {
    points_or_lines: usize,
    without_positions: usize,
}

struct Loader<'a, 'm> {
    document: &'a Document<'a>,
    model: &'m mut Model,
    /// Index of the material for primitives without one, once needed.
    default_material: Option<u32>,
    skipped: Skipped,
}

/// How vertices make triangles.
#[derive(Clone, Copy)]
enum Mode {
    List,
    Strip,
    Fan,
}

impl Loader<'_, '_> {
    fn finish(self) {
        let notes = &mut self.model.notes;
        let Skipped { points_or_lines, without_positions } = self.skipped;
        if points_or_lines > 0 {
            let primitives = counted(points_or_lines, "primitive");
            notes.push(format!("skipped {primitives} of points or lines"));
        }
        if without_positions > 0 {
            let primitives = counted(without_positions, "primitive");
            notes.push(format!("skipped {primitives} without positions"));
        }
        // One material everywhere needs no list.
        if self.model.materials.len() <= 1 {
            self.model.triangle_materials.clear();
        }
    }

    fn load(&mut self, primitive: &Primitive, label: &str, world_from_mesh: &DAffine3) -> Result<(), Error> {
        let mode = match primitive.mode.unwrap_or(4) {
            0..=3 => {
                self.skipped.points_or_lines += 1;
                return Ok(());
            }
            4 => Mode::List,
            5 => Mode::Strip,
            6 => Mode::Fan,
            mode => return Err(GltfProblem::Mode { primitive: label.to_owned(), mode }.into()),
        };
        let Some(&positions) = primitive.attributes.get("POSITION") else {
            self.skipped.without_positions += 1;
            return Ok(());
        };
        check_compression(self.document, primitive, positions)?;
        let positions = Reader::new(self.document, positions, label)?;
        let file = self.document.file;
        let first_position = self.model.positions.len();
        file.check_positions(first_position + positions.count())?;

        let triangles = self.read_triangles(primitive, label, mode, positions.count())?;
        let is_mirrored = world_from_mesh.matrix3.determinant() < 0.0;
        let triangles =
            triangles.into_iter().map(|[a, b, c]| if is_mirrored { [a, c, b] } else { [a, b, c] });
        let triangles: Vec<[u32; 3]> = triangles.collect();
        file.check_triangles(self.model.triangles.len() + triangles.len())?;

        let positions: Vec<[f32; 3]> =
            positions.read_floats("POSITION", "three floats or integers", false)?;
        let world = |p: &[f32; 3]| world_from_mesh.transform_point3(Vec3::from(*p).as_dvec3());
        self.model.positions.extend(positions.iter().map(world));

        let attributes = Attributes { primitive, label, count: positions.len(), triangles: &triangles };
        self.append_attributes(&attributes, world_from_mesh, is_mirrored)?;
        let offset = first_position as u32;
        self.model.triangles.extend(triangles.iter().map(|t| t.map(|v| v + offset)));
        let material = self.material_of(primitive, label)?;
        self.model.triangle_materials.resize(self.model.triangles.len(), material);
        Ok(())
    }

    /// Vertex triples, each within `count`.
    fn read_triangles(
        &mut self,
        primitive: &Primitive,
        label: &str,
        mode: Mode,
        count: usize,
    ) -> Result<Vec<[u32; 3]>, GltfProblem> {
        let indices: Vec<u32> = match primitive.indices {
            Some(accessor) => Reader::new(self.document, accessor, label)?.read_indices("indices")?,
            None => (0..count as u32).collect(),
        };
        if let Some(&index) = indices.iter().find(|&&index| index as usize >= count) {
            return Err(GltfProblem::Vertex { primitive: label.to_owned(), index, count });
        }
        let (lists, rest) = indices.as_chunks::<3>();
        Ok(match mode {
            Mode::List => {
                if !rest.is_empty() {
                    let rest = counted(rest.len(), "index");
                    self.model.notes.push(format!("{label}: ignored {rest} after the last whole triangle"));
                }
                lists.to_vec()
            }
            Mode::Strip => strip(&indices),
            Mode::Fan => fan(&indices),
        })
    }

    /// The model's material for a primitive.
    fn material_of(&mut self, primitive: &Primitive, label: &str) -> Result<u32, GltfProblem> {
        if let Some(material) = primitive.material {
            get(&self.document.root.materials, material, "material", || label.to_owned())?;
            return Ok(material as u32);
        }
        let materials = &mut self.model.materials;
        Ok(*self.default_material.get_or_insert_with(|| {
            materials.push(material::default_material());
            materials.len() as u32 - 1
        }))
    }

    fn append_attributes(
        &mut self,
        attributes: &Attributes,
        world_from_mesh: &DAffine3,
        is_mirrored: bool,
    ) -> Result<(), GltfProblem> {
        let before = 3 * self.model.triangles.len();
        let document = self.document;
        let corners = &mut self.model.corners;
        if let Some(normals) = attributes.read::<3>(document, "NORMAL", "three floats or integers", false)? {
            let world = normal_transform(world_from_mesh);
            let normals: Vec<Vec3> = normals.into_iter().map(|n| turned(&world, Vec3::from(n))).collect();
            pad(&mut corners.normals, before, Vec3::ZERO);
            attributes.spread(&normals, &mut corners.normals);
        }
        if let Some(tangents) = attributes.read::<4>(document, "TANGENT", "four floats or integers", false)? {
            let linear = world_from_mesh.matrix3;
            // The bitangent is w * cross(normal, tangent), and a mirror turns cross products round.
            let sign = if is_mirrored { -1.0 } else { 1.0 };
            let world = |[x, y, z, w]: [f32; 4]| turned(&linear, Vec3::new(x, y, z)).extend(sign * w);
            let tangents: Vec<Vec4> = tangents.into_iter().map(world).collect();
            pad(&mut corners.tangents, before, Vec4::ZERO);
            attributes.spread(&tangents, &mut corners.tangents);
        }
        if let Some(colors) = attributes.read_colors(document)? {
            pad(&mut corners.colors, before, Vec4::ONE);
            attributes.spread(&colors, &mut corners.colors);
        }
        for set in 0..MAX_UV_SETS {
            let name = format!("TEXCOORD_{set}");
            let Some(uvs) = attributes.read::<2>(document, &name, "two floats or integers", false)? else {
                continue;
            };
            let uvs: Vec<Vec2> = uvs.into_iter().map(Vec2::from).collect();
            pad(&mut corners.uv_sets, set + 1, Vec::new());
            pad(&mut corners.uv_sets[set], before, Vec2::ZERO);
            attributes.spread(&uvs, &mut corners.uv_sets[set]);
        }
        Ok(())
    }
}

/// Refuses a primitive that is there in compressed form only, though the file does not say that it requires the extension.
fn check_compression(
    document: &Document,
    primitive: &Primitive,
    positions: usize,
) -> Result<(), GltfProblem> {
    const COMPRESSION: &str = "KHR_draco_mesh_compression";
    let has_data = |a: &Accessor| a.buffer_view.is_some() || a.sparse.is_some();
    let is_plain = document.root.accessors.get(positions).is_none_or(has_data);
    if is_plain || !primitive.extensions.contains_key(COMPRESSION) {
        return Ok(());
    }
    Err(GltfProblem::RequiredExtensions { extensions: vec![COMPRESSION.to_owned()] })
}

/// What reading the attributes of a primitive needs.
struct Attributes<'a> {
    primitive: &'a Primitive,
    label: &'a str,
    /// Number of positions, which all attributes must match.
    count: usize,
    triangles: &'a [[u32; 3]],
}

impl Attributes<'_> {
    fn reader<'a>(&self, document: &'a Document, name: &str) -> Result<Option<Reader<'a>>, GltfProblem> {
        let Some(&accessor) = self.primitive.attributes.get(name) else { return Ok(None) };
        let reader = Reader::new(document, accessor, self.label)?;
        if reader.count() != self.count {
            return Err(GltfProblem::AttributeCount {
                primitive: self.label.to_owned(),
                positions: self.count,
                attribute: name.to_owned(),
                count: reader.count(),
            });
        }
        Ok(Some(reader))
    }

    fn read<const N: usize>(
        &self,
        document: &Document,
        name: &str,
        expected: &'static str,
        always_normalized: bool,
    ) -> Result<Option<Vec<[f32; N]>>, GltfProblem> {
        let reader = self.reader(document, name)?;
        reader.map(|reader| reader.read_floats(name, expected, always_normalized)).transpose()
    }

    /// Linear RGBA from three or four numbers; integers are always fractions.
    fn read_colors(&self, document: &Document) -> Result<Option<Vec<Vec4>>, GltfProblem> {
        const EXPECTED: &str = "three or four floats or integers";
        let Some(reader) = self.reader(document, "COLOR_0")? else { return Ok(None) };
        let colors = match reader.width() {
            3 => reader
                .read_floats("COLOR_0", EXPECTED, true)?
                .into_iter()
                .map(|c| Vec3::from(c).extend(1.0))
                .collect(),
            _ => reader.read_floats("COLOR_0", EXPECTED, true)?.into_iter().map(Vec4::from_array).collect(),
        };
        Ok(Some(colors))
    }

    /// From one value per vertex to one per corner.
    fn spread<T: Copy>(&self, of_vertex: &[T], of_corner: &mut Vec<T>) {
        of_corner.extend(self.triangles.iter().flatten().map(|&v| of_vertex[v as usize]));
    }
}

/// Every other triangle of a strip is turned round to keep the orientation.
fn strip(indices: &[u32]) -> Vec<[u32; 3]> {
    let triangle = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
    indices.windows(3).enumerate().map(triangle).collect()
}

fn fan(indices: &[u32]) -> Vec<[u32; 3]> {
    let Some((&centre, rim)) = indices.split_first() else { return Vec::new() };
    rim.windows(2).map(|w| [w[0], w[1], centre]).collect()
}

/// Normals follow the inverse transpose. Where there is none (a node flattened to nothing), the result is not finite and
/// the triangle's own normal replaces it later.
fn normal_transform(world_from_mesh: &DAffine3) -> DMat3 {
    world_from_mesh.matrix3.inverse().transpose()
}

/// A direction under a linear map, not normalised.
fn turned(linear: &DMat3, direction: Vec3) -> Vec3 {
    let turned: DVec3 = *linear * direction.as_dvec3();
    turned.normalize_or_zero().as_vec3()
}
