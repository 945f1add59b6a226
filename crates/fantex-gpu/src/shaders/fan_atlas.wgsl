// The atlas of a channel as a picture.

// Whether the target does not encode sRGB by itself.
override FAN_ATLAS_ENCODES: bool = false;

@group(0) @binding(0) var atlas_texture: texture_2d<f32>;
@group(0) @binding(1) var atlas_sampler: sampler;

struct AtlasVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

// One triangle over the whole viewport.
@vertex
fn vs_fan_atlas(@builtin(vertex_index) index: u32) -> AtlasVarying {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return AtlasVarying(vec4<f32>(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0), corner);
}

@fragment
fn fs_fan_atlas(in: AtlasVarying) -> @location(0) vec4<f32> {
    let linear = clamp(textureSample(atlas_texture, atlas_sampler, in.uv).rgb, vec3<f32>(0.0), vec3<f32>(1.0));
    let encoded = select(1.055 * pow(linear, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * linear, linear <= vec3<f32>(0.0031308));
    return vec4<f32>(select(linear, encoded, FAN_ATLAS_ENCODES), 1.0);
}
