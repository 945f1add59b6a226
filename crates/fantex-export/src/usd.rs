//! Fans as USD text (Pixar, "OpenUSD"): meshes with primvars, and materials of MaterialX nodes.

use std::fmt::Display;
use std::fs::File;
use std::io;
use std::io::{BufWriter, Write};

use fantex_base::{Error, Result};
use fantex_mesh::{Material, Mesh};
use glam::{DVec3, Vec2, Vec3};

use crate::fan_files::PictureFiles;
use crate::materialx::{Graph, Input, NodeInput, surface_name};
use crate::model_file::{Geometry, Primitive};

/// Writes a model with a mesh per part. Pictures lie beside it.
pub(crate) fn write_usda(
    mesh: &Mesh,
    pictures: &PictureFiles<'_>,
    geometry: &Geometry,
    out: &File,
) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 20, out);
    write_start(&mut out, "Model")?;
    if geometry.translation != DVec3::ZERO {
        let DVec3 { x, y, z } = geometry.translation;
        writeln!(out, "    double3 xformOp:translate = ({x}, {y}, {z})")?;
        writeln!(out, "    uniform token[] xformOpOrder = [\"xformOp:translate\"]")?;
    }
    let default_material = Material::default();
    for primitives in geometry.primitives.chunk_by(|a, b| a.part == b.part) {
        let part = primitives[0].part;
        let name = mesh.parts.names.get(part).map_or("", String::as_str);
        let material = |primitive: &Primitive| mesh.materials.get(primitive.material);
        let mut materials = primitives.iter().map(|p| material(p).unwrap_or(&default_material));
        let is_double_sided = materials.any(|material| material.double_sided);
        write_mesh(&mut out, geometry, primitives, (&identifier(name, part), name), is_double_sided)?;
    }
    writeln!(out, "    def Scope \"Materials\"\n    {{")?;
    for (material, sheet) in geometry.looks() {
        let graph = Graph::of_sheet(pictures, sheet, &mesh.materials);
        let material =
            (mesh.materials.get(material).unwrap_or(&default_material), surface_name((material, sheet)));
        write_material(&mut out, &graph, material, pictures.color_space())?;
    }
    writeln!(out, "    }}\n}}")?;
    out.flush()
}

/// Writes a scene that refers to the files of objects beside it; of each its name and its file.
pub(crate) fn write_usda_objects(root: &str, objects: &[[String; 2]], out: &File) -> io::Result<()> {
    let mut out = BufWriter::new(out);
    write_start(&mut out, &format!("World_{}", plain(root)))?;
    for (number, [name, file]) in objects.iter().enumerate() {
        let name = plain(name);
        writeln!(
            out,
            "    def \"Object_{number}_{name}\" (\n        prepend references = {}\n    )\n    {{\n    }}",
            asset_path(file)
        )?;
    }
    writeln!(out, "}}")?;
    out.flush()
}

/// What a file begins with, up to the contents of its only root.
fn write_start(out: &mut impl Write, root: &str) -> io::Result<()> {
    writeln!(
        out,
        "#usda 1.0\n(\n    defaultPrim = \"{root}\"\n    doc = \"Written by fantex\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n"
    )?;
    writeln!(out, "def Xform \"{root}\"\n{{")
}

/// Refuses what USD allows in no path of a file.
///
/// # Errors
/// The name has a control character.
pub(crate) fn check_file_name(name: &str) -> Result<()> {
    match name.chars().any(char::is_control) {
        true => Err(Error::invalid(format!(
            "USD refers to no file whose name has a control character, as {name:?} has; choose another name"
        ))),
        false => Ok(()),
    }
}

/// The path of a file beside this one.
fn asset_path(name: &str) -> String {
    format!("@@@./{}@@@", name.replace("@@@", "\\@@@"))
}

/// The characters of a name that USD allows in names, `_` for the others.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// The line of metadata with the name that the model has; none for none.
fn display_name(name: &str) -> String {
    let escaped = name.replace('\\', "\\\\").replace('"', "\\\"").replace(char::is_control, " ");
    if name.is_empty() { String::new() } else { format!("        displayName = \"{escaped}\"\n") }
}

/// A name that USD allows, different for each part.
fn identifier(name: &str, part: usize) -> String {
    let plain = plain(name);
    if plain.is_empty() { format!("Surface_{part}") } else { format!("Surface_{part}_{plain}") }
}

/// A part, its vertices counted from 0, with a subset for each of its materials.
fn write_mesh(
    out: &mut impl Write,
    geometry: &Geometry,
    primitives: &[Primitive],
    (name, shown): (&str, &str),
    is_double_sided: bool,
) -> io::Result<()> {
    let start = primitives.first().map_or(0, |p| p.vertices.start);
    let vertices = start..primitives.last().map_or(0, |p| p.vertices.end);
    let triangles: usize = primitives.iter().map(|p| p.triangles.len()).sum();
    let indices = primitives.iter().flat_map(|primitive| {
        let first = primitive.vertices.start - start;
        primitive.triangles.as_flattened().iter().map(move |&v| first + v as usize)
    });
    let triple = |v: &Vec3| format!("({}, {}, {})", v.x, v.y, v.z);
    let shown = display_name(shown);
    writeln!(
        out,
        "    def Mesh \"{name}\" (\n{shown}        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{"
    )?;
    let positions = &geometry.positions[vertices.clone()];
    let corner = |of: fn(Vec3, Vec3) -> Vec3| positions.iter().copied().reduce(of).unwrap_or_default();
    let extent = [corner(Vec3::min), corner(Vec3::max)];
    write_list(out, "        float3[] extent", extent.iter().map(triple))?;
    writeln!(out)?;
    writeln!(out, "        uniform bool doubleSided = {}", u8::from(is_double_sided))?;
    writeln!(out, "        uniform token subdivisionScheme = \"none\"")?;
    writeln!(out, "        uniform token subsetFamily:materialBind:familyType = \"partition\"")?;
    write_list(out, "        int[] faceVertexCounts", (0..triangles).map(|_| 3))?;
    write_list(out, "\n        int[] faceVertexIndices", indices)?;
    write_list(out, "\n        point3f[] points", positions.iter().map(triple))?;
    let per_vertex = " (\n            interpolation = \"vertex\"\n        )";
    write_list(out, "\n        normal3f[] normals", geometry.normals[vertices.clone()].iter().map(triple))?;
    writeln!(out, "{per_vertex}")?;
    for (set, (name, places)) in ["st", "st1", "st2", "st3"].into_iter().zip(&geometry.uv).enumerate() {
        // v upwards; barycentric coordinates stay.
        let place = |uv: &Vec2| format!("({}, {})", uv.x, if set == 3 { uv.y } else { 1.0 - uv.y });
        write_list(
            out,
            &format!("        texCoord2f[] primvars:{name}"),
            places[vertices.clone()].iter().map(place),
        )?;
        writeln!(out, "{per_vertex}")?;
    }
    let mut first = 0;
    for primitive in primitives {
        let end = first + primitive.triangles.len();
        let name = surface_name((primitive.material, primitive.page));
        writeln!(
            out,
            "        def GeomSubset \"{name}\" (\n            prepend apiSchemas = [\"MaterialBindingAPI\"]\n        )\n        {{"
        )?;
        writeln!(
            out,
            "            uniform token elementType = \"face\"\n            uniform token familyName = \"materialBind\""
        )?;
        write_list(out, "            int[] indices", first..end)?;
        writeln!(out, "\n            rel material:binding = </Model/Materials/{name}>\n        }}")?;
        first = end;
    }
    writeln!(out, "    }}")
}

fn write_list(
    out: &mut impl Write,
    name: &str,
    mut items: impl Iterator<Item = impl Display>,
) -> io::Result<()> {
    write!(out, "{name} = [")?;
    if let Some(first) = items.next() {
        write!(out, "{first}")?;
    }
    items.try_for_each(|item| write!(out, ", {item}"))?;
    write!(out, "]")
}

/// A material of MaterialX nodes as USD's shading schema has them.
fn write_material(
    out: &mut impl Write,
    graph: &Graph,
    (material, name): (&Material, String),
    color_space: &str,
) -> io::Result<()> {
    let place = format!("/Model/Materials/{name}");
    let shown = match display_name(&material.name) {
        line if line.is_empty() => line,
        line => format!(" (\n    {line}        )"),
    };
    writeln!(out, "        def Material \"{name}\"{shown}\n        {{")?;
    writeln!(out, "            token outputs:mtlx:surface.connect = <{place}/surface.outputs:out>")?;
    for node in &graph.nodes {
        let output = format!("{} outputs:out", usd_type(node.kind));
        let space = if node.is_color() { color_space } else { "raw" };
        write_shader(out, &place, &node.name, &node.definition(), &node.inputs, (&output, space))?;
    }
    let inputs = graph.surface(material);
    let definition = "ND_standard_surface_surfaceshader";
    write_shader(out, &place, "surface", definition, &inputs, ("token outputs:out", "raw"))?;
    writeln!(out, "        }}")
}

/// A node of the material at `place`, its output, and the colour space of the picture that it reads.
fn write_shader(
    out: &mut impl Write,
    place: &str,
    name: &str,
    definition: &str,
    inputs: &[NodeInput],
    (output, space): (&str, &str),
) -> io::Result<()> {
    writeln!(out, "            def Shader \"{name}\"\n            {{")?;
    writeln!(out, "                uniform token info:id = \"{definition}\"")?;
    for (input, kind, from) in inputs {
        let usd = usd_type(kind);
        write!(out, "                {usd} inputs:{input}")?;
        match from {
            Input::Node(node) => writeln!(out, ".connect = <{place}/{node}.outputs:out>")?,
            Input::Value(value) => match *kind {
                "filename" => writeln!(
                    out,
                    " = {} (\n                    colorSpace = \"{space}\"\n                )",
                    asset_path(value)
                )?,
                "string" => writeln!(out, " = \"{value}\"")?,
                "color3" => writeln!(out, " = ({value})")?,
                _ => writeln!(out, " = {value}")?,
            },
        }
    }
    writeln!(out, "                {output}\n            }}")
}

fn usd_type(kind: &str) -> &'static str {
    match kind {
        "float" => "float",
        "integer" => "int",
        "vector2" => "float2",
        "vector3" => "float3",
        "color3" => "color3f",
        "color4" => "color4f",
        "filename" => "asset",
        _ => "string",
    }
}
