// The atlas of a channel as a picture: each pixel is the mean of up to four of the texels that it covers.

struct AtlasFormat {
    // Components of a texel: 1, 2 or 4.
    components: u32,
    // Whether reading has decoded sRGB, which is encoded again.
    is_srgb: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var atlas_texture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> atlas_format: AtlasFormat;

struct AtlasVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

// One triangle over the whole target.
@vertex
fn vs_fan_atlas(@builtin(vertex_index) index: u32) -> AtlasVarying {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return AtlasVarying(vec4<f32>(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0), corner);
}

@fragment
fn fs_fan_atlas(in: AtlasVarying) -> @location(0) vec4<f32> {
    let extent = vec2<f32>(textureDimensions(atlas_texture));
    let size = max(abs(vec2<f32>(dpdx(in.uv.x), dpdy(in.uv.y))) * extent, vec2<f32>(1.0));
    let first = in.uv * extent - 0.5 * size;
    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        let at = first + size * (vec2<f32>(f32(i & 1u), f32(i >> 1u)) * 0.5 + 0.25);
        sum += textureLoad(atlas_texture, clamp(vec2<i32>(at), vec2<i32>(0), vec2<i32>(extent) - 1), 0);
    }
    let mean = clamp(sum * 0.25, vec4<f32>(0.0), vec4<f32>(1.0));
    if atlas_format.components == 1u {
        return vec4<f32>(mean.rrr, 1.0);
    }
    if atlas_format.components == 2u {
        return vec4<f32>(mean.rg, 1.0, 1.0);
    }
    let encoded = select(1.055 * pow(mean.rgb, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * mean.rgb, mean.rgb <= vec3<f32>(0.0031308));
    return vec4<f32>(select(mean.rgb, encoded, atlas_format.is_srgb == 1u), 1.0);
}
