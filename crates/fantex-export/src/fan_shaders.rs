//! The texture function in other programs' shading languages. Tests run each on random points and compare it with the sampler.

use fantex_mesh::{AlphaMode, Material};

use crate::ChannelMap;
use crate::fans::{FanSheets, SheetMap};

/// A shading language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ShaderLanguage {
    /// GLSL from version 1.30 or ES 3.00 on: functions.
    Glsl,
    /// WGSL: functions.
    Wgsl,
    /// HLSL from shader model 4 on: functions.
    Hlsl,
    /// A whole spatial shader for Godot 4. Its mesh comes from a glTF, whose third and fourth coordinates Godot gives as `CUSTOM0`.
    Godot,
}

impl ShaderLanguage {
    /// The usual extension of its files.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Glsl => "glsl",
            Self::Wgsl => "wgsl",
            Self::Hlsl => "hlsl",
            Self::Godot => "gdshader",
        }
    }
}

const GLSL: &str = include_str!("shaders/fans.glsl");
const WGSL: &str = include_str!("shaders/fans.wgsl");
const HLSL: &str = include_str!("shaders/fans.hlsl");

impl FanSheets {
    /// The texture function with this asset's blend band: `fan_weights`, `fan_sample` and `fan_normal` (in HLSL `FanWeights`, `FanSample`
    /// and `FanNormal`). For Godot a shader with a uniform per sheet; of `material` it takes how it shows through, whether both sides are
    /// seen, and the factors of what has no sheet.
    pub fn shader(&self, language: ShaderLanguage, material: &Material) -> String {
        let functions = match language {
            ShaderLanguage::Glsl | ShaderLanguage::Godot => GLSL,
            ShaderLanguage::Wgsl => WGSL,
            ShaderLanguage::Hlsl => HLSL,
        };
        let functions = functions.replace("$DELTA", &format!("{:?}", self.delta));
        if language == ShaderLanguage::Godot { self.godot(&functions, material) } else { functions }
    }

    fn godot(&self, functions: &str, material: &Material) -> String {
        let Spatial { uniforms, lines } = Spatial::new(self, material);
        let culling = if material.double_sided { "cull_disabled" } else { "cull_back" };
        let shading = if material.unlit { ", unshaded" } else { "" };
        let (uniforms, lines) = (uniforms.join("\n"), lines.join("\n    "));
        format!(
            "shader_type spatial;\nrender_mode {culling}{shading};\n\n{functions}\n{uniforms}\n\n\
             // TEXCOORD_2 and TEXCOORD_3.\nvarying vec4 fan_places;\n\n\
             void vertex() {{\n    fan_places = CUSTOM0;\n}}\n\nvoid fragment() {{\n    {lines}\n}}\n"
        )
    }
}

/// What is a material's own in a spatial shader.
struct Spatial {
    uniforms: Vec<String>,
    /// Of the fragment function.
    lines: Vec<String>,
}

impl Spatial {
    fn new(sheets: &FanSheets, material: &Material) -> Self {
        let weights = "vec3 weights = fan_weights(fan_places.zw);".to_owned();
        let mut spatial = Self { uniforms: Vec::new(), lines: vec![weights] };
        let map = |kind: ChannelMap| sheets.maps.iter().find(|map| map.map == kind);
        spatial.color(map(ChannelMap::BaseColor), material);
        if map(ChannelMap::OcclusionRoughnessMetallic).is_some() {
            let orm = spatial.look_up("fan_sample", "orm", "");
            spatial.lines.push(format!("vec3 orm_here = {orm}.rgb;"));
            spatial.lines.extend(
                ["AO = orm_here.r;", "ROUGHNESS = orm_here.g;", "METALLIC = orm_here.b;"].map(str::to_owned),
            );
        } else {
            spatial.lines.push(format!("ROUGHNESS = {:?};", material.roughness));
            spatial.lines.push(format!("METALLIC = {:?};", material.metallic));
        }
        if map(ChannelMap::Normal).is_some() {
            let normal = spatial.look_up("fan_normal", "object_normal", "");
            let side = if material.double_sided { "(FRONT_FACING ? 1.0 : -1.0) * " } else { "" };
            spatial.lines.push(format!(
                "NORMAL = {side}normalize((VIEW_MATRIX * vec4(MODEL_NORMAL_MATRIX * {normal}, 0.0)).xyz);"
            ));
        }
        match map(ChannelMap::Emission) {
            Some(map) => {
                let light = spatial.look_up("fan_sample", "emission", "source_color, ");
                spatial.lines.push(format!("EMISSION = {:?} * {light}.rgb;", map.scale));
            }
            None => {
                let [r, g, b] = material.emission.to_array();
                spatial.lines.push(format!("EMISSION = vec3({r:?}, {g:?}, {b:?});"));
            }
        }
        spatial
    }

    fn color(&mut self, map: Option<&SheetMap>, material: &Material) {
        let color = match map {
            Some(_) => self.look_up("fan_sample", "base_color", "source_color, "),
            None => {
                let [r, g, b, a] = material.base_color.to_array();
                format!("vec4({r:?}, {g:?}, {b:?}, {a:?})")
            }
        };
        self.lines.push(format!("vec4 color = {color};"));
        self.lines.push("ALBEDO = color.rgb;".to_owned());
        if material.alpha != AlphaMode::Opaque {
            self.lines.push("ALPHA = color.a;".to_owned());
        }
        if let AlphaMode::Mask(cutoff) = material.alpha {
            self.lines.push(format!("ALPHA_SCISSOR_THRESHOLD = {cutoff:?};"));
        }
    }

    /// A sheet's uniform, and the call of a function that reads it.
    fn look_up(&mut self, function: &str, sheet: &str, hint: &str) -> String {
        let filter = "filter_linear_mipmap_anisotropic, repeat_disable";
        self.uniforms.push(format!("uniform sampler2D {sheet} : {hint}{filter};"));
        format!("{function}({sheet}, UV, UV2, fan_places.xy, weights)")
    }
}
