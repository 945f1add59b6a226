//! The texture function as a graph of standard nodes (Academy Software Foundation, "MaterialX Specification", version 1.39).

use fantex_base::markup_escaped;
use fantex_mesh::{AlphaMode, Material};
use glam::Vec3;

use crate::ChannelMap;
use crate::fan_files::PictureFiles;
use crate::model_file::Geometry;

/// A node: category, type, name, and its inputs as (name, type, value).
pub(crate) struct Node {
    category: &'static str,
    pub(crate) kind: &'static str,
    pub(crate) name: String,
    pub(crate) inputs: Vec<NodeInput>,
}

/// Name, type and value.
pub(crate) type NodeInput = (&'static str, &'static str, Input);

pub(crate) enum Input {
    Value(String),
    Node(String),
}

fn value(text: impl Into<String>) -> Input {
    Input::Value(text.into())
}

fn node(name: impl Into<String>) -> Input {
    Input::Node(name.into())
}

impl Node {
    /// Whether it reads a picture of colours.
    pub(crate) fn is_color(&self) -> bool {
        self.category == "image" && self.kind.starts_with("color")
    }

    /// The name of its definition in MaterialX's library.
    pub(crate) fn definition(&self) -> String {
        let Self { category, kind, inputs, .. } = self;
        let second = inputs.get(1).map(|(_, kind, _)| *kind);
        match *category {
            "extract" => format!("ND_extract_{}", inputs[0].1),
            "convert" => format!("ND_convert_{}_{kind}", inputs[0].1),
            // A vector or colour with a number.
            "add" | "subtract" | "multiply" | "divide" if second == Some("float") && *kind != "float" => {
                format!("ND_{category}_{kind}FA")
            }
            _ => format!("ND_{category}_{kind}"),
        }
    }
}

/// The graph of a sheet.
#[derive(Default)]
pub(crate) struct Graph {
    pub(crate) nodes: Vec<Node>,
    /// Names and types of the nodes that a surface reads: `color`, `opacity` and one for each threshold of cut-outs, `roughness`,
    /// `metallic`, `emission`, `normal`.
    outputs: Vec<(String, &'static str)>,
}

impl Graph {
    fn add(
        &mut self,
        category: &'static str,
        kind: &'static str,
        name: impl Into<String>,
        inputs: Vec<NodeInput>,
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
        self.add("geompropvalue", "vector2", "corner", vec![("geomprop", "string", value("st3"))]);
        for (index, name) in ["0", "1"].into_iter().zip(["l0", "l1"]) {
            let inputs = vec![("in", "vector2", node("corner")), ("index", "integer", value(index))];
            self.add("extract", "float", name, inputs);
        }
        self.binary("add", "l01", node("l0"), node("l1"));
        self.binary("subtract", "l2", value("1"), node("l01"));
        for i in 0..3 {
            let [j, k] = [(i + 1) % 3, (i + 2) % 3];
            self.binary("max", format!("other{i}"), node(format!("l{j}")), node(format!("l{k}")));
            self.binary("subtract", format!("over{i}"), node(format!("l{i}")), node(format!("other{i}")));
            self.binary("add", format!("raised{i}"), node(format!("over{i}")), value(delta.to_string()));
            self.binary("max", format!("a{i}"), node(format!("raised{i}")), value("0"));
        }
        self.binary("add", "a01", node("a0"), node("a1"));
        self.binary("add", "sum", node("a01"), node("a2"));
        for (i, name) in ["st", "st1", "st2"].into_iter().enumerate() {
            self.add("geompropvalue", "vector2", format!("uv{i}"), vec![("geomprop", "string", value(name))]);
        }
    }

    /// The weighted mean of three look-ups in a picture.
    fn blended(&mut self, name: &str, kind: &'static str, file: &str) -> Input {
        for i in 0..3 {
            let inputs = vec![
                ("file", "filename", value(file)),
                ("texcoord", "vector2", node(format!("uv{i}"))),
                ("uaddressmode", "string", value("clamp")),
                ("vaddressmode", "string", value("clamp")),
            ];
            self.add("image", kind, format!("{name}{i}"), inputs);
            let inputs =
                vec![("in1", kind, node(format!("{name}{i}"))), ("in2", "float", node(format!("a{i}")))];
            self.add("multiply", kind, format!("{name}_part{i}"), inputs);
        }
        let pair = |a: String, b: String| vec![("in1", kind, node(a)), ("in2", kind, node(b))];
        self.add("add", kind, format!("{name}_two"), pair(format!("{name}_part0"), format!("{name}_part1")));
        self.add("add", kind, format!("{name}_all"), pair(format!("{name}_two"), format!("{name}_part2")));
        let inputs = vec![("in1", kind, node(format!("{name}_all"))), ("in2", "float", node("sum"))];
        self.add("divide", kind, name.to_owned(), inputs)
    }

    /// Opacities that are 0 below a threshold and else 1, for the thresholds of all materials.
    fn cut_outs(&mut self, materials: &[Material]) -> Vec<(String, &'static str)> {
        let mut outputs = Vec::new();
        for material in materials {
            let AlphaMode::Mask(threshold) = material.alpha else { continue };
            let output = (cut_out_name(threshold), "color3");
            if outputs.contains(&output) {
                continue;
            }
            let name = format!("{}_number", output.0);
            let inputs = vec![
                ("value1", "float", node("alpha")),
                ("value2", "float", value(threshold.to_string())),
                ("in1", "float", value("1")),
                ("in2", "float", value("0")),
            ];
            let number = self.add("ifgreatereq", "float", name, inputs);
            self.add("convert", "color3", output.0.clone(), vec![("in", "float", number)]);
            outputs.push(output);
        }
        outputs
    }

    /// Everything that the materials of a sheet read.
    pub(crate) fn of_sheet(pictures: &PictureFiles<'_>, sheet: usize, materials: &[Material]) -> Self {
        let mut graph = Self::default();
        graph.weights(pictures.sheets.delta);
        let mut cut_outs = Vec::new();
        for map in &pictures.sheets.maps {
            let file = pictures.file(sheet, map);
            match map.map {
                ChannelMap::BaseColor if map.components == 4 => {
                    graph.color_and_opacity(&file, pictures.is_exr);
                    cut_outs = graph.cut_outs(materials);
                }
                ChannelMap::BaseColor => {
                    graph.blended("color", "color3", &file);
                    graph.output("color", "color3");
                }
                ChannelMap::OcclusionRoughnessMetallic => graph.roughness_and_metallic(&file),
                ChannelMap::Normal => graph.normal(&file),
                ChannelMap::Emission => graph.emission(&file, pictures.scale(map)),
                _ => {}
            }
        }
        graph.outputs.append(&mut cut_outs);
        graph
    }

    fn output(&mut self, name: &str, kind: &'static str) {
        self.outputs.push((name.to_owned(), kind));
    }

    /// Colours of a picture with alpha, which in OpenEXR they are multiplied with; and the alpha, named `alpha`.
    fn color_and_opacity(&mut self, file: &str, is_associated: bool) {
        self.blended("color_opacity", "color4", file);
        for (k, name) in ["r", "g", "b", "alpha"].into_iter().enumerate() {
            let inputs =
                vec![("in", "color4", node("color_opacity")), ("index", "integer", value(k.to_string()))];
            self.add("extract", "float", name, inputs);
        }
        let inputs =
            vec![("in1", "float", node("r")), ("in2", "float", node("g")), ("in3", "float", node("b"))];
        let name = if is_associated { "associated_color" } else { "color" };
        self.add("combine3", "color3", name, inputs);
        if is_associated {
            self.binary("max", "divisor", node("alpha"), value("0.0001"));
            let inputs = vec![("in1", "color3", node(name)), ("in2", "float", node("divisor"))];
            self.add("divide", "color3", "color", inputs);
        }
        self.add("convert", "color3", "opacity", vec![("in", "float", node("alpha"))]);
        self.output("color", "color3");
        self.output("opacity", "color3");
    }

    fn roughness_and_metallic(&mut self, file: &str) {
        self.blended("orm", "vector3", file);
        for (component, name) in [("1", "roughness"), ("2", "metallic")] {
            let inputs = vec![("in", "vector3", node("orm")), ("index", "integer", value(component))];
            self.add("extract", "float", name, inputs);
            self.output(name, "float");
        }
    }

    /// A world-space normal of one in object space that is stored as 0..1.
    fn normal(&mut self, file: &str) {
        self.blended("stored_normal", "vector3", file);
        let scaled = vec![("in1", "vector3", node("stored_normal")), ("in2", "float", value("2"))];
        self.add("multiply", "vector3", "doubled_normal", scaled);
        let shifted = vec![("in1", "vector3", node("doubled_normal")), ("in2", "float", value("1"))];
        self.add("subtract", "vector3", "object_normal", shifted);
        let inputs = vec![
            ("in", "vector3", node("object_normal")),
            ("fromspace", "string", value("object")),
            ("tospace", "string", value("world")),
        ];
        self.add("transformnormal", "vector3", "turned_normal", inputs);
        self.add("normalize", "vector3", "normal", vec![("in", "vector3", node("turned_normal"))]);
        self.output("normal", "vector3");
    }

    /// The picture holds values divided by `scale`.
    fn emission(&mut self, file: &str, scale: f32) {
        self.blended("emission_stored", "color3", file);
        let inputs =
            vec![("in1", "color3", node("emission_stored")), ("in2", "float", value(scale.to_string()))];
        self.add("multiply", "color3", "emission", inputs);
        self.output("emission", "color3");
    }

    /// The inputs of a material's `standard_surface`: nodes where a sheet has a picture, factors elsewhere.
    pub(crate) fn surface(&self, material: &Material) -> Vec<NodeInput> {
        let number = |number: f32| Input::Value(number.to_string());
        let color = |c: Vec3| Input::Value(format!("{}, {}, {}", c.x, c.y, c.z));
        let picture = |output: &str| {
            let is_drawn = self.outputs.iter().any(|(name, _)| name == output);
            is_drawn.then(|| Input::Node(output.to_owned()))
        };
        let or = |output: &str, factor: Input| picture(output).unwrap_or(factor);
        let own_color = or("color", color(material.base_color.truncate()));
        let mut inputs = vec![("emission", "float", number(1.0))];
        if material.unlit {
            // Its colour is the picture, whatever shines on it.
            inputs.extend([
                ("base", "float", number(0.0)),
                ("specular", "float", number(0.0)),
                ("emission_color", "color3", own_color),
            ]);
        } else {
            inputs.extend([
                ("base", "float", number(1.0)),
                ("base_color", "color3", own_color),
                ("specular_roughness", "float", or("roughness", number(material.roughness))),
                ("metalness", "float", or("metallic", number(material.metallic))),
                ("emission_color", "color3", or("emission", color(material.emission))),
            ]);
            inputs.extend(picture("normal").map(|normal| ("normal", "vector3", normal)));
        }
        let alpha = material.base_color.w;
        let opacity = match material.alpha {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(threshold) => {
                Some((cut_out_name(threshold), if alpha < threshold { 0.0 } else { 1.0 }))
            }
            AlphaMode::Blend => Some(("opacity".to_owned(), alpha)),
        };
        inputs.extend(
            opacity.map(|(output, factor)| ("opacity", "color3", or(&output, color(Vec3::splat(factor))))),
        );
        inputs
    }
}

/// The node of opacities that are cut off at a threshold.
fn cut_out_name(threshold: f32) -> String {
    format!("opacity_from_{threshold}").replace(['.', '-'], "_")
}

/// The name of a material on a sheet.
pub(crate) fn surface_name((material, sheet): (usize, usize)) -> String {
    format!("material_{material}_sheet_{sheet}")
}

/// A MaterialX document: a graph per sheet, a material for each material and sheet that have triangles together.
pub(crate) fn materialx(pictures: &PictureFiles<'_>, geometry: &Geometry, materials: &[Material]) -> String {
    // Version 1.38 has all of these nodes, too, and is read by more programs.
    let mut text =
        String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.38\" colorspace=\"lin_rec709\">\n");
    let mut line = |text_line: String| text.push_str(&(text_line + "\n"));
    let graphs: Vec<Graph> =
        (0..pictures.sheets.sheets.len()).map(|sheet| Graph::of_sheet(pictures, sheet, materials)).collect();
    for (index, graph) in graphs.iter().enumerate() {
        line(format!("  <nodegraph name=\"fans_{index}\">"));
        for node in &graph.nodes {
            line(format!("    <{} name=\"{}\" type=\"{}\">", node.category, node.name, node.kind));
            for (name, kind, input) in &node.inputs {
                let is_color = *kind == "filename" && node.is_color();
                let space = pictures.color_space();
                let space = if is_color { format!(" colorspace=\"{space}\"") } else { String::new() };
                let from = match input {
                    Input::Value(value) => format!("value=\"{}\"{space}", markup_escaped(value)),
                    Input::Node(node) => format!("nodename=\"{node}\""),
                };
                line(format!("      <input name=\"{name}\" type=\"{kind}\" {from}/>"));
            }
            line(format!("    </{}>", node.category));
        }
        for (name, kind) in &graph.outputs {
            line(format!("    <output name=\"{name}_out\" type=\"{kind}\" nodename=\"{name}\"/>"));
        }
        line("  </nodegraph>".to_owned());
    }
    let default_material = Material::default();
    for (material, sheet) in geometry.looks() {
        let name = surface_name((material, sheet));
        line(format!("  <standard_surface name=\"{name}_surface\" type=\"surfaceshader\">"));
        for (input, kind, from) in graphs[sheet].surface(materials.get(material).unwrap_or(&default_material))
        {
            let from = match from {
                Input::Value(value) => format!("value=\"{value}\""),
                Input::Node(node) => format!("nodegraph=\"fans_{sheet}\" output=\"{node}_out\""),
            };
            line(format!("    <input name=\"{input}\" type=\"{kind}\" {from}/>"));
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
