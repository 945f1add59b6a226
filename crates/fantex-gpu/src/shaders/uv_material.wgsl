// A material with textures: bind group 1.

// Which textures it has, one bit each, in the order of UvMaterial.layers.
override UV_LAYERS: u32 = 0u;

// 0 opaque, 1 cut out, 2 blended.
override ALPHA_MODE: u32 = 0u;

const LAYER_BASE_COLOR: u32 = 0u;
const LAYER_METALLIC_ROUGHNESS: u32 = 1u;
const LAYER_NORMAL: u32 = 2u;
const LAYER_OCCLUSION: u32 = 3u;
const LAYER_EMISSION: u32 = 4u;

struct UvLayer {
    // u and v of the look-up are the products of these rows and (u, v, 1).
    row_u: vec3<f32>,
    // Set of texture coordinates, 0 to 3.
    uv_set: u32,
    row_v: vec3<f32>,
    pad: u32,
}

struct UvMaterial {
    // Linear RGBA.
    base_color: vec4<f32>,
    emission: vec3<f32>,
    metallic: f32,
    roughness: f32,
    normal_scale: f32,
    occlusion_strength: f32,
    alpha_threshold: f32,
    unlit: u32,
    // 1 where the base colour's texels are multiplied by their alpha.
    is_premultiplied: u32,
    pad0: u32,
    pad1: u32,
    layers: array<UvLayer, 5>,
}

@group(1) @binding(0) var<uniform> material: UvMaterial;
@group(1) @binding(1) var base_color_texture: texture_2d<f32>;
@group(1) @binding(2) var metallic_roughness_texture: texture_2d<f32>;
@group(1) @binding(3) var normal_texture: texture_2d<f32>;
@group(1) @binding(4) var occlusion_texture: texture_2d<f32>;
@group(1) @binding(5) var emission_texture: texture_2d<f32>;
@group(1) @binding(6) var base_color_sampler: sampler;
@group(1) @binding(7) var metallic_roughness_sampler: sampler;
@group(1) @binding(8) var normal_sampler: sampler;
@group(1) @binding(9) var occlusion_sampler: sampler;
@group(1) @binding(10) var emission_sampler: sampler;

fn has_layer(layer: u32) -> bool {
    return (UV_LAYERS & (1u << layer)) != 0u;
}

fn layer_uv(layer: u32, uv01: vec4<f32>, uv23: vec4<f32>) -> vec2<f32> {
    let uv_set = material.layers[layer].uv_set;
    let pair = select(uv01, uv23, uv_set >= 2u);
    let uv = vec3<f32>(select(pair.xy, pair.zw, (uv_set & 1u) == 1u), 1.0);
    return vec2<f32>(dot(material.layers[layer].row_u, uv), dot(material.layers[layer].row_v, uv));
}

// Linear RGBA with straight alpha, as the material says it, whatever is made of the alpha.
fn uv_base_color(vertex_color: vec4<f32>, uv01: vec4<f32>, uv23: vec4<f32>) -> vec4<f32> {
    var color = material.base_color * vertex_color;
    if has_layer(LAYER_BASE_COLOR) {
        var texel = textureSample(base_color_texture, base_color_sampler, layer_uv(LAYER_BASE_COLOR, uv01, uv23));
        if material.is_premultiplied == 1u {
            texel = vec4<f32>(texel.rgb / max(texel.a, 1e-5), texel.a);
        }
        color *= texel;
    }
    return color;
}
