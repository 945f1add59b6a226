//! Fans in other programs' files: glTF with four sets of coordinates, USD and MaterialX with the texture function as a graph.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, GlbHeader, Material, Mesh, shading_normals};
use fantex_store::Asset;
use glam::{DVec3, Vec2, Vec3};
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};
use serde_json::{Value, json};

use crate::fans::{FanSheetOptions, FanSheets, SheetMap, fan_sheets};
use crate::model_file::Outputs;
use crate::pictures::Depth;
use crate::{ChannelMap, ExportSummary};

/// Writes an asset with its fans: a `.glb` with sheets inside, or a `.usda` with a MaterialX file and sheets beside it. All files appear
/// at the end, or none.
///
/// Vertices are split by corners. `TEXCOORD_0` to `2` (in USD `st`, `st1`, `st2`, v upwards) are a corner's places in the tiles of the
/// fans at its triangle's corners 0, 1 and 2; the first two barycentric coordinates are `TEXCOORD_3` (`st3`).
///
/// # Errors
/// Those of [`fan_sheets`]; the output's extension is none of these, a file exists, or it cannot be written.
pub fn export_fans(
    asset: &Arc<Asset>,
    output: &Path,
    options: &FanSheetOptions,
    force: bool,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if !["glb", "usda"].contains(&extension.as_str()) {
        let path = output.display();
        return Err(Error::invalid(format!("fans are written as .glb or .usda, and {path} is neither"))
            .with_path(output));
    }
    let sheets = fan_sheets(asset, options, progress)?;
    let corners = Corners::new(asset.mesh(), &sheets);
    let mut outputs = Outputs::new(force);
    let failed = |source| Error::writing(output, source);
    let stem = output.file_stem().map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
    match extension.as_str() {
        "glb" => {
            let pictures: Vec<Vec<u8>> = sheets
                .sheets
                .iter()
                .flat_map(|sheet| {
                    sheets.maps.iter().zip(&sheet.pictures).map(move |(map, samples)| (sheet, map, samples))
                })
                .map(|(sheet, map, samples)| encoded(sheet.size, map, samples))
                .collect::<std::io::Result<_>>()
                .map_err(failed)?;
            let (file, _) = outputs.create(output)?;
            write_glb(asset.mesh(), &sheets, &corners, &pictures, &stem, output, &file)?;
        }
        _ => {
            for (index, sheet) in sheets.sheets.iter().enumerate() {
                for (map, samples) in sheets.maps.iter().zip(&sheet.pictures) {
                    let path = output.with_file_name(picture_name(&stem, &sheets, index, map));
                    let (mut file, _) = outputs.create(&path)?;
                    let bytes = encoded(sheet.size, map, samples).map_err(|e| Error::writing(&path, e))?;
                    file.write_all(&bytes).map_err(|e| Error::writing(&path, e))?;
                }
            }
            let path = output.with_extension("mtlx");
            let (mut file, _) = outputs.create(&path)?;
            file.write_all(materialx(&stem, &sheets, &corners, &asset.mesh().materials).as_bytes())
                .map_err(|e| Error::writing(&path, e))?;
            let (file, _) = outputs.create(output)?;
            write_usda(asset.mesh(), &sheets, &corners, &stem, &file).map_err(failed)?;
        }
    }
    let texels = sheets.sheets.iter().map(|sheet| u64::from(sheet.size[0]) * u64::from(sheet.size[1])).sum();
    Ok(ExportSummary {
        files: outputs.commit()?,
        sides: sheets.sheets.iter().map(|sheet| sheet.size[0].max(sheet.size[1])).collect(),
        maps: sheets.maps.iter().map(|map| map.map).collect(),
        charts: asset.cover().groups.len(),
        padding: options.gutter,
        used_share: sheets.used_share,
        density_share: 1.0,
        texels,
        vertices: corners.positions.len(),
        ..ExportSummary::default()
    })
}

fn picture_name(stem: &str, sheets: &FanSheets, sheet: usize, map: &SheetMap) -> String {
    let number = if sheets.sheets.len() > 1 { format!("-{}", sheet + 1) } else { String::new() };
    format!("{stem}-fans-{}{number}.png", map.map.name())
}

fn encoded(size: [u32; 2], map: &SheetMap, samples: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(match map.components {
        1 => ColorType::Grayscale,
        3 => ColorType::Rgb,
        _ => ColorType::Rgba,
    });
    encoder.set_depth(if map.depth == Depth::Eight { BitDepth::Eight } else { BitDepth::Sixteen });
    if map.is_srgb {
        encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(bytes)
}

/// The mesh with a vertex for each different corner.
#[derive(Default)]
struct Corners {
    /// World units, relative to `translation`.
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// In the three tiles; then the first two barycentric coordinates.
    uv: Vec<[Vec2; 4]>,
    translation: DVec3,
    parts: Vec<Part>,
}

/// What has one material and one sheet.
struct Part {
    material: usize,
    sheet: u32,
    triangles: Vec<[u32; 3]>,
}

impl Corners {
    fn new(mesh: &Mesh, sheets: &FanSheets) -> Self {
        let world = |v: usize| mesh.world_from_mesh.point(mesh.positions[v]);
        let is_exact = (0..mesh.positions.len()).all(|v| world(v).as_vec3().as_dvec3() == world(v));
        let translation = if is_exact { DVec3::ZERO } else { mesh.world_from_mesh.offset };
        let mut corners = Self { translation, ..Self::default() };
        let normals = shading_normals(mesh);
        let mut known: HashMap<(u32, [u32; 11]), u32> = HashMap::new();
        let mut part_of: HashMap<(usize, u32), usize> = HashMap::new();
        for t in 0..mesh.triangles.len() {
            let triangle = [0, 1, 2].map(|k| {
                let v = mesh.triangles[t][k];
                let normal = normals[3 * t + k];
                let [a, b, c] = [0, 1, 2].map(|slot| sheets.uv[t][slot][k]);
                let lambda = [Vec2::X, Vec2::Y, Vec2::ZERO][k];
                let key = [normal.x, normal.y, normal.z, a.x, a.y, b.x, b.y, c.x, c.y, lambda.x, lambda.y];
                *known.entry((v, key.map(f32::to_bits))).or_insert_with(|| {
                    corners.positions.push((world(v as usize) - translation).as_vec3());
                    corners.normals.push(normal);
                    corners.uv.push([a, b, c, lambda]);
                    (corners.positions.len() - 1) as u32
                })
            });
            let key = (mesh.material_of(t), sheets.sheet_of_triangle[t]);
            let part = *part_of.entry(key).or_insert_with(|| {
                corners.parts.push(Part { material: key.0, sheet: key.1, triangles: Vec::new() });
                corners.parts.len() - 1
            });
            corners.parts[part].triangles.push(triangle);
        }
        corners
    }

    fn triangles(&self) -> impl Iterator<Item = [u32; 3]> {
        self.parts.iter().flat_map(|part| part.triangles.iter().copied())
    }
}

// ---- glTF. Programs that know no fans show each triangle by the tile of its first corner.

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

fn write_glb(
    mesh: &Mesh,
    sheets: &FanSheets,
    corners: &Corners,
    pictures: &[Vec<u8>],
    name: &str,
    path: &Path,
    out: &File,
) -> Result<()> {
    let count = corners.positions.len();
    let triangles: usize = corners.parts.iter().map(|part| part.triangles.len()).sum();
    let (mut views, mut offset) = (Vec::new(), 0);
    let mut view = |bytes: usize, target: Option<u32>| {
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        offset += bytes.next_multiple_of(4);
        views.push(view);
        views.len() - 1
    };
    let vertices = Some(34962);
    let attributes = [
        ("POSITION", "VEC3", view(12 * count, vertices)),
        ("NORMAL", "VEC3", view(12 * count, vertices)),
        ("TEXCOORD_0", "VEC2", view(8 * count, vertices)),
        ("TEXCOORD_1", "VEC2", view(8 * count, vertices)),
        ("TEXCOORD_2", "VEC2", view(8 * count, vertices)),
        ("TEXCOORD_3", "VEC2", view(8 * count, vertices)),
    ];
    let index_view = view(12 * triangles, Some(34963));
    let image_views: Vec<usize> = pictures.iter().map(|picture| view(picture.len(), None)).collect();
    let (low, high) = corners
        .positions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
    let mut accessors: Vec<Value> = attributes
        .iter()
        .map(|(_, kind, view)| json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": kind }))
        .collect();
    accessors[0]["min"] = json!(low.to_array());
    accessors[0]["max"] = json!(high.to_array());
    let (mut primitives, mut materials, mut first) = (Vec::new(), Vec::new(), 0);
    for part in &corners.parts {
        let own: serde_json::Map<String, Value> =
            attributes.iter().enumerate().map(|(i, (name, ..))| ((*name).to_owned(), i.into())).collect();
        primitives.push(json!({
            "attributes": own, "indices": accessors.len(), "material": materials.len(), "mode": 4,
        }));
        accessors.push(json!({
            "bufferView": index_view, "byteOffset": 12 * first, "componentType": UNSIGNED_INT,
            "count": 3 * part.triangles.len(), "type": "SCALAR",
        }));
        materials.push(material_json(&mesh.materials, part, sheets));
        first += part.triangles.len();
    }
    let mut node = json!({ "name": name, "mesh": 0 });
    if corners.translation != DVec3::ZERO {
        node["translation"] = json!(corners.translation.to_array());
    }
    let names = sheets
        .sheets
        .iter()
        .enumerate()
        .flat_map(|(index, _)| sheets.maps.iter().map(move |map| picture_name(name, sheets, index, map)));
    let images: Vec<Value> = names
        .zip(&image_views)
        .map(|(name, view)| json!({ "name": name, "mimeType": "image/png", "bufferView": view }))
        .collect();
    let textures: Vec<Value> =
        (0..images.len()).map(|source| json!({ "source": source, "sampler": 0 })).collect();
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "fantex" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "name": name, "primitives": primitives, "extras": { "fantexDelta": sheets.delta } }],
        "materials": materials,
        "buffers": [{ "byteLength": offset }],
        "bufferViews": views,
        "accessors": accessors,
        "images": images,
        "textures": textures,
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }],
    });
    if sheets.maps.is_empty() {
        for key in ["images", "textures", "samplers"] {
            document.as_object_mut().map(|members| members.remove(key));
        }
    }
    let header = GlbHeader::new(document.to_string(), offset as u64).map_err(|bytes| {
        let text =
            format!("{} would take {bytes} bytes, but a GLB file holds 4 GiB; write a .usda", path.display());
        Error::too_large(text).with_path(path)
    })?;
    let write = || {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        header.write(&mut out)?;
        for vectors in [&corners.positions, &corners.normals] {
            vectors.iter().flat_map(|v| v.to_array()).try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        for set in 0..4 {
            let numbers = corners.uv.iter().flat_map(|uv| uv[set].to_array());
            numbers.map(f32::to_le_bytes).try_for_each(|bytes| out.write_all(&bytes))?;
        }
        corners.triangles().flatten().try_for_each(|index| out.write_all(&index.to_le_bytes()))?;
        for picture in pictures {
            out.write_all(picture)?;
            out.write_all(&[0; 3][..picture.len().wrapping_neg() % 4])?;
        }
        out.flush()
    };
    write().map_err(|source: std::io::Error| Error::writing(path, source))
}

fn material_json(materials: &[Material], part: &Part, sheets: &FanSheets) -> Value {
    let default_material = Material::default();
    let material = materials.get(part.material).unwrap_or(&default_material);
    let texture = |kind: ChannelMap| {
        let map = sheets.maps.iter().position(|map| map.map == kind)?;
        Some(part.sheet as usize * sheets.maps.len() + map)
    };
    let mut pbr = json!({});
    match texture(ChannelMap::BaseColor) {
        Some(index) => pbr["baseColorTexture"] = json!({ "index": index }),
        None => pbr["baseColorFactor"] = json!(material.base_color.to_array()),
    }
    let mut value = json!({ "doubleSided": material.double_sided });
    match texture(ChannelMap::OcclusionRoughnessMetallic) {
        Some(index) => {
            pbr["metallicRoughnessTexture"] = json!({ "index": index });
            value["occlusionTexture"] = json!({ "index": index });
        }
        None => {
            pbr["metallicFactor"] = material.metallic.into();
            pbr["roughnessFactor"] = material.roughness.into();
        }
    }
    value["pbrMetallicRoughness"] = pbr;
    if let Some(index) = texture(ChannelMap::Emission) {
        value["emissiveTexture"] = json!({ "index": index });
        value["emissiveFactor"] = json!([1, 1, 1]);
    }
    if !material.name.is_empty() {
        value["name"] = material.name.clone().into();
    }
    match material.alpha {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            value["alphaMode"] = "MASK".into();
            value["alphaCutoff"] = cutoff.max(0.0).into();
        }
        AlphaMode::Blend => value["alphaMode"] = "BLEND".into(),
    }
    let mut extras = json!({ "fantexDelta": sheets.delta });
    // Object space, so no program that knows no fans may take it for its own.
    if let Some(index) = texture(ChannelMap::Normal) {
        extras["fantexObjectNormalTexture"] = index.into();
    }
    if let Some(map) = sheets.maps.iter().find(|map| map.map == ChannelMap::Emission) {
        extras["fantexEmissionScale"] = map.scale.into();
    }
    value["extras"] = extras;
    value
}

// ---- MaterialX (Academy Software Foundation, "MaterialX Specification", version 1.39): the texture function of standard nodes.

/// A node: category, type, name, and its inputs as (name, type, value).
struct Node {
    category: &'static str,
    kind: &'static str,
    name: String,
    inputs: Vec<(&'static str, &'static str, Input)>,
}

enum Input {
    Value(String),
    Node(String),
}

/// Builds a graph, node by node.
#[derive(Default)]
struct Graph {
    nodes: Vec<Node>,
}

impl Graph {
    fn add(
        &mut self,
        category: &'static str,
        kind: &'static str,
        name: impl Into<String>,
        inputs: Vec<(&'static str, &'static str, Input)>,
    ) -> Input {
        let name = name.into();
        self.nodes.push(Node { category, kind, name: name.clone(), inputs });
        Input::Node(name)
    }

    fn binary(&mut self, category: &'static str, name: impl Into<String>, a: Input, b: Input) -> Input {
        self.add(category, "float", name, vec![("in1", "float", a), ("in2", "float", b)])
    }

    /// The weights of the three fans and their sum; their names are `a0`, `a1`, `a2` and `sum`.
    fn weights(&mut self, delta: f32) {
        let set = |name: &str| Input::Value(name.to_owned());
        let float = |name: &str| Input::Node(name.to_owned());
        self.add("geompropvalue", "vector2", "corner", vec![("geomprop", "string", set("st3"))]);
        for (index, name) in ["0", "1"].into_iter().zip(["l0", "l1"]) {
            let inputs = vec![("in", "vector2", float("corner")), ("index", "integer", set(index))];
            self.add("extract", "float", name, inputs);
        }
        self.binary("add", "l01", float("l0"), float("l1"));
        self.binary("subtract", "l2", set("1"), float("l01"));
        for i in 0..3 {
            let [j, k] = [(i + 1) % 3, (i + 2) % 3];
            self.binary("max", format!("other{i}"), float(&format!("l{j}")), float(&format!("l{k}")));
            self.binary("subtract", format!("over{i}"), float(&format!("l{i}")), float(&format!("other{i}")));
            self.binary("add", format!("raised{i}"), float(&format!("over{i}")), set(&delta.to_string()));
            self.binary("max", format!("a{i}"), float(&format!("raised{i}")), set("0"));
        }
        self.binary("add", "a01", float("a0"), float("a1"));
        self.binary("add", "sum", float("a01"), float("a2"));
        for (i, name) in ["st", "st1", "st2"].into_iter().enumerate() {
            self.add("geompropvalue", "vector2", format!("uv{i}"), vec![("geomprop", "string", set(name))]);
        }
    }

    /// The weighted mean of three look-ups in a picture.
    fn blended(&mut self, name: &str, kind: &'static str, file: &str) -> Input {
        let node = |name: String| Input::Node(name);
        for i in 0..3 {
            let inputs = vec![
                ("file", "filename", Input::Value(file.to_owned())),
                ("texcoord", "vector2", node(format!("uv{i}"))),
                ("uaddressmode", "string", Input::Value("clamp".to_owned())),
                ("vaddressmode", "string", Input::Value("clamp".to_owned())),
            ];
            self.add("image", kind, format!("{name}{i}"), inputs);
            let inputs =
                vec![("in1", kind, node(format!("{name}{i}"))), ("in2", "float", node(format!("a{i}")))];
            self.add("multiply", kind, format!("{name}_part{i}"), inputs);
        }
        let pair = |a: String, b: String| vec![("in1", kind, node(a)), ("in2", kind, node(b))];
        self.add("add", kind, format!("{name}_two"), pair(format!("{name}_part0"), format!("{name}_part1")));
        self.add("add", kind, format!("{name}_all"), pair(format!("{name}_two"), format!("{name}_part2")));
        let inputs =
            vec![("in1", kind, node(format!("{name}_all"))), ("in2", "float", node("sum".to_owned()))];
        self.add("divide", kind, name.to_owned(), inputs)
    }

    /// Everything that a sheet's material reads; its nodes `color`, `opacity`, `roughness`, `metallic`, `emission`, `normal` are those that
    /// are named in the result.
    fn of_sheet(
        sheets: &FanSheets,
        file: impl Fn(&SheetMap) -> String,
    ) -> (Self, Vec<(&'static str, &'static str)>) {
        let mut graph = Self::default();
        graph.weights(sheets.delta);
        let mut outputs = Vec::new();
        let node = |name: &str| Input::Node(name.to_owned());
        let value = |text: &str| Input::Value(text.to_owned());
        for map in &sheets.maps {
            let file = file(map);
            match map.map {
                ChannelMap::BaseColor if map.components == 4 => {
                    graph.blended("color_opacity", "color4", &file);
                    for (k, name) in ["r", "g", "b", "opacity"].into_iter().enumerate() {
                        let inputs = vec![
                            ("in", "color4", node("color_opacity")),
                            ("index", "integer", value(&k.to_string())),
                        ];
                        graph.add("extract", "float", name, inputs);
                    }
                    let inputs = vec![
                        ("in1", "float", node("r")),
                        ("in2", "float", node("g")),
                        ("in3", "float", node("b")),
                    ];
                    graph.add("combine3", "color3", "color", inputs);
                    outputs.extend([("color", "color3"), ("opacity", "float")]);
                }
                ChannelMap::BaseColor => {
                    graph.blended("color", "color3", &file);
                    outputs.push(("color", "color3"));
                }
                ChannelMap::OcclusionRoughnessMetallic => {
                    graph.blended("orm", "vector3", &file);
                    for (k, name) in [("1", "roughness"), ("2", "metallic")] {
                        graph.add(
                            "extract",
                            "float",
                            name,
                            vec![("in", "vector3", node("orm")), ("index", "integer", value(k))],
                        );
                        outputs.push((name, "float"));
                    }
                }
                ChannelMap::Normal => {
                    graph.blended("stored_normal", "vector3", &file);
                    let scaled =
                        vec![("in1", "vector3", node("stored_normal")), ("in2", "float", value("2"))];
                    graph.add("multiply", "vector3", "doubled_normal", scaled);
                    let shifted =
                        vec![("in1", "vector3", node("doubled_normal")), ("in2", "float", value("1"))];
                    graph.add("subtract", "vector3", "object_normal", shifted);
                    let inputs = vec![
                        ("in", "vector3", node("object_normal")),
                        ("fromspace", "string", value("object")),
                        ("tospace", "string", value("world")),
                    ];
                    graph.add("transformnormal", "vector3", "turned_normal", inputs);
                    graph.add(
                        "normalize",
                        "vector3",
                        "normal",
                        vec![("in", "vector3", node("turned_normal"))],
                    );
                    outputs.push(("normal", "vector3"));
                }
                ChannelMap::Emission => {
                    graph.blended("emission_stored", "color3", &file);
                    let inputs = vec![
                        ("in1", "color3", node("emission_stored")),
                        ("in2", "float", value(&map.scale.to_string())),
                    ];
                    graph.add("multiply", "color3", "emission", inputs);
                    outputs.push(("emission", "color3"));
                }
                _ => {}
            }
        }
        (graph, outputs)
    }
}

/// Inputs of `standard_surface`, and the outputs of the graph that feed them.
const SURFACE_INPUTS: [(&str, &str, &str); 6] = [
    ("base_color", "color3", "color"),
    ("specular_roughness", "float", "roughness"),
    ("metalness", "float", "metallic"),
    ("emission_color", "color3", "emission"),
    ("normal", "vector3", "normal"),
    ("opacity", "color3", "opacity"),
];

fn surface_name(part: &Part) -> String {
    format!("material_{}_sheet_{}", part.material, part.sheet)
}

/// A MaterialX document: a graph per sheet, a material per part.
fn materialx(stem: &str, sheets: &FanSheets, corners: &Corners, materials: &[Material]) -> String {
    let mut text =
        String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.38\" colorspace=\"lin_rec709\">\n");
    // Writing to a string cannot fail.
    let mut line = |text_line: String| text.push_str(&(text_line + "\n"));
    for index in 0..sheets.sheets.len() {
        let (graph, outputs) =
            Graph::of_sheet(sheets, |map| escaped(&picture_name(stem, sheets, index, map)));
        line(format!("  <nodegraph name=\"fans_{index}\">"));
        for node in &graph.nodes {
            line(format!("    <{} name=\"{}\" type=\"{}\">", node.category, node.name, node.kind));
            for (name, kind, input) in &node.inputs {
                let space = if *kind == "filename" && is_srgb_node(node) {
                    " colorspace=\"srgb_texture\""
                } else {
                    ""
                };
                line(match input {
                    Input::Value(value) => {
                        format!("      <input name=\"{name}\" type=\"{kind}\" value=\"{value}\"{space}/>")
                    }
                    Input::Node(node) => {
                        format!("      <input name=\"{name}\" type=\"{kind}\" nodename=\"{node}\"/>")
                    }
                });
            }
            line(format!("    </{}>", node.category));
        }
        for (name, kind) in &outputs {
            line(format!("    <output name=\"{name}_out\" type=\"{kind}\" nodename=\"{name}\"/>"));
        }
        if outputs.iter().any(|(name, _)| *name == "opacity") {
            line("    <convert name=\"opacity_color\" type=\"color3\">".to_owned());
            line("      <input name=\"in\" type=\"float\" nodename=\"opacity\"/>".to_owned());
            line("    </convert>".to_owned());
            line(
                "    <output name=\"opacity_color_out\" type=\"color3\" nodename=\"opacity_color\"/>"
                    .to_owned(),
            );
        }
        line("  </nodegraph>".to_owned());
    }
    let default_material = Material::default();
    let (_, outputs) = Graph::of_sheet(sheets, |_| String::new());
    for part in &corners.parts {
        let material = materials.get(part.material).unwrap_or(&default_material);
        let name = surface_name(part);
        let has = |output: &str| outputs.iter().any(|(name, _)| *name == output);
        line(format!("  <standard_surface name=\"{name}_surface\" type=\"surfaceshader\">"));
        line("    <input name=\"base\" type=\"float\" value=\"1\"/>".to_owned());
        for (input, kind, output) in SURFACE_INPUTS.into_iter().filter(|(.., output)| has(output)) {
            let output = if output == "opacity" { "opacity_color" } else { output };
            line(format!(
                "    <input name=\"{input}\" type=\"{kind}\" nodegraph=\"fans_{}\" output=\"{output}_out\"/>",
                part.sheet
            ));
        }
        let c = material.base_color;
        if !has("color") {
            line(format!(
                "    <input name=\"base_color\" type=\"color3\" value=\"{}, {}, {}\"/>",
                c.x, c.y, c.z
            ));
        }
        if !has("roughness") {
            line(format!(
                "    <input name=\"specular_roughness\" type=\"float\" value=\"{}\"/>",
                material.roughness
            ));
            line(format!("    <input name=\"metalness\" type=\"float\" value=\"{}\"/>", material.metallic));
        }
        if has("emission") {
            line("    <input name=\"emission\" type=\"float\" value=\"1\"/>".to_owned());
        }
        line("  </standard_surface>".to_owned());
        line(format!("  <surfacematerial name=\"{name}\" type=\"material\">"));
        line(format!(
            "    <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"{name}_surface\"/>"
        ));
        line("  </surfacematerial>".to_owned());
    }
    line("</materialx>".to_owned());
    text
}

/// Whether a node reads a picture of colours.
fn is_srgb_node(node: &Node) -> bool {
    node.category == "image" && node.kind.starts_with("color")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

// ---- USD as text (Pixar, "OpenUSD"): the mesh with primvars, its materials by reference to the MaterialX file.

fn write_usda(
    mesh: &Mesh,
    sheets: &FanSheets,
    corners: &Corners,
    stem: &str,
    out: &File,
) -> std::io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 20, out);
    let list = |items: &mut dyn Iterator<Item = String>| {
        let mut text = String::from("[");
        for (i, item) in items.enumerate() {
            text.push_str(if i > 0 { ", " } else { "" });
            text.push_str(&item);
        }
        text.push(']');
        text
    };
    let triple = |v: &Vec3| format!("({}, {}, {})", v.x, v.y, v.z);
    let triangles: usize = corners.parts.iter().map(|part| part.triangles.len()).sum();
    let mut head = String::new();
    writeln!(
        head,
        "#usda 1.0\n(\n    defaultPrim = \"Model\"\n    doc = \"Written by fantex\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n"
    )
    .and_then(|()| writeln!(head, "def Xform \"Model\"\n{{"))
    .map_err(std::io::Error::other)?;
    out.write_all(head.as_bytes())?;
    if corners.translation != DVec3::ZERO {
        let DVec3 { x, y, z } = corners.translation;
        writeln!(out, "    double3 xformOp:translate = ({x}, {y}, {z})")?;
        writeln!(out, "    uniform token[] xformOpOrder = [\"xformOp:translate\"]")?;
    }
    let is_double_sided = mesh.materials.iter().any(|material| material.double_sided);
    writeln!(
        out,
        "    def Mesh \"Surface\" (\n        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{"
    )?;
    writeln!(out, "        uniform bool doubleSided = {}", u8::from(is_double_sided))?;
    writeln!(out, "        uniform token subdivisionScheme = \"none\"")?;
    writeln!(out, "        int[] faceVertexCounts = {}", list(&mut (0..triangles).map(|_| "3".to_owned())))?;
    let indices = corners.triangles().flatten();
    writeln!(out, "        int[] faceVertexIndices = {}", list(&mut indices.map(|i| i.to_string())))?;
    writeln!(out, "        point3f[] points = {}", list(&mut corners.positions.iter().map(triple)))?;
    writeln!(
        out,
        "        normal3f[] normals = {} (\n            interpolation = \"vertex\"\n        )",
        list(&mut corners.normals.iter().map(triple))
    )?;
    for (set, name) in ["st", "st1", "st2", "st3"].into_iter().enumerate() {
        // v upwards; barycentric coordinates stay.
        let place = |uv: &[Vec2; 4]| match set {
            3 => format!("({}, {})", uv[3].x, uv[3].y),
            _ => format!("({}, {})", uv[set].x, 1.0 - uv[set].y),
        };
        writeln!(
            out,
            "        texCoord2f[] primvars:{name} = {} (\n            interpolation = \"vertex\"\n        )",
            list(&mut corners.uv.iter().map(place))
        )?;
    }
    let mut first = 0;
    for part in &corners.parts {
        let end = first + part.triangles.len();
        let name = surface_name(part);
        writeln!(
            out,
            "        def GeomSubset \"{name}\" (\n            prepend apiSchemas = [\"MaterialBindingAPI\"]\n        )\n        {{"
        )?;
        writeln!(
            out,
            "            uniform token elementType = \"face\"\n            uniform token familyName = \"materialBind\""
        )?;
        writeln!(out, "            int[] indices = {}", list(&mut (first..end).map(|i| i.to_string())))?;
        writeln!(out, "            rel material:binding = </Model/Materials/{name}>\n        }}")?;
        first = end;
    }
    writeln!(out, "    }}\n    def Scope \"Materials\"\n    {{")?;
    for part in &corners.parts {
        write_usd_material(&mut out, mesh, sheets, part, stem)?;
    }
    writeln!(out, "    }}\n}}")?;
    out.flush()
}

/// A material of MaterialX nodes as USD's shading schema has them.
fn write_usd_material(
    out: &mut impl Write,
    mesh: &Mesh,
    sheets: &FanSheets,
    part: &Part,
    stem: &str,
) -> std::io::Result<()> {
    let default_material = Material::default();
    let material = mesh.materials.get(part.material).unwrap_or(&default_material);
    let name = surface_name(part);
    let place = format!("/Model/Materials/{name}");
    let (graph, outputs) =
        Graph::of_sheet(sheets, |map| picture_name(stem, sheets, part.sheet as usize, map));
    writeln!(out, "        def Material \"{name}\"\n        {{")?;
    writeln!(out, "            token outputs:mtlx:surface.connect = <{place}/surface.outputs:out>")?;
    for node in &graph.nodes {
        writeln!(out, "            def Shader \"{}\"\n            {{", node.name)?;
        writeln!(out, "                uniform token info:id = \"{}\"", definition(node))?;
        for (input, kind, from) in &node.inputs {
            let usd = usd_type(kind);
            match from {
                Input::Node(node) => writeln!(
                    out,
                    "                {usd} inputs:{input}.connect = <{place}/{node}.outputs:out>"
                )?,
                Input::Value(value) if *kind == "filename" => {
                    writeln!(
                        out,
                        "                asset inputs:{input} = @./{value}@ (\n                    colorSpace = \"{}\"\n                )",
                        if is_srgb_node(node) { "srgb_texture" } else { "raw" }
                    )?;
                }
                Input::Value(value) if *kind == "string" => {
                    writeln!(out, "                {usd} inputs:{input} = \"{value}\"")?;
                }
                Input::Value(value) => writeln!(out, "                {usd} inputs:{input} = {value}")?,
            }
        }
        writeln!(out, "                {} outputs:out\n            }}", usd_type(node.kind))?;
    }
    let has = |output: &str| outputs.iter().any(|(name, _)| *name == output);
    if has("opacity") {
        writeln!(
            out,
            "            def Shader \"opacity_color\"\n            {{\n                uniform token info:id = \"ND_convert_float_color3\""
        )?;
        writeln!(
            out,
            "                float inputs:in.connect = <{place}/opacity.outputs:out>\n                color3f outputs:out\n            }}"
        )?;
    }
    writeln!(
        out,
        "            def Shader \"surface\"\n            {{\n                uniform token info:id = \"ND_standard_surface_surfaceshader\""
    )?;
    writeln!(out, "                float inputs:base = 1")?;
    for (input, kind, output) in SURFACE_INPUTS.into_iter().filter(|(.., output)| has(output)) {
        let output = if output == "opacity" { "opacity_color" } else { output };
        writeln!(
            out,
            "                {} inputs:{input}.connect = <{place}/{output}.outputs:out>",
            usd_type(kind)
        )?;
    }
    let c = material.base_color;
    if !has("color") {
        writeln!(out, "                color3f inputs:base_color = ({}, {}, {})", c.x, c.y, c.z)?;
    }
    if !has("roughness") {
        writeln!(out, "                float inputs:specular_roughness = {}", material.roughness)?;
        writeln!(out, "                float inputs:metalness = {}", material.metallic)?;
    }
    if has("emission") {
        writeln!(out, "                float inputs:emission = 1")?;
    }
    writeln!(out, "                token outputs:out\n            }}\n        }}")
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

/// The name of a node's definition in MaterialX's library.
fn definition(node: &Node) -> String {
    let Node { category, kind, inputs, .. } = node;
    let second = inputs.get(1).map(|(_, kind, _)| *kind);
    match *category {
        "geompropvalue" | "image" | "normalize" | "transformnormal" | "combine3" => {
            format!("ND_{category}_{kind}")
        }
        "extract" => format!("ND_extract_{}", inputs[0].1),
        // A vector or colour with a number.
        _ if second == Some("float") && *kind != "float" => format!("ND_{category}_{kind}FA"),
        _ => format!("ND_{category}_{kind}"),
    }
}
