// A small picture of an atlas: each pixel is the mean of up to four of the texels that it covers.

struct About {
    // Components of a texel: 1, 2 or 4.
    components: u32,
    // Whether reading has decoded sRGB, which is encoded again.
    is_srgb: u32,
    unused: vec2u,
}

@group(0) @binding(0) var atlas: texture_2d<f32>;
@group(0) @binding(1) var<uniform> about: About;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) share: vec2f,
}

// One triangle over the whole picture.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let at = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    return Corner(vec4f(at * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0), 0.0, 1.0), at);
}

fn encoded(linear: vec3f) -> vec3f {
    let low = linear * 12.92;
    let high = 1.055 * pow(max(linear, vec3f(0.0)), vec3f(1.0 / 2.4)) - 0.055;
    return select(high, low, linear <= vec3f(0.0031308));
}

@fragment
fn texel(in: Corner) -> @location(0) vec4f {
    let extent = vec2f(textureDimensions(atlas));
    let size = max(abs(vec2f(dpdx(in.share.x), dpdy(in.share.y))) * extent, vec2f(1.0));
    let first = in.share * extent - 0.5 * size;
    var sum = vec4f(0.0);
    for (var i = 0u; i < 4u; i++) {
        let at = first + size * (vec2f(f32(i & 1u), f32(i >> 1u)) * 0.5 + 0.25);
        let texel = clamp(vec2i(at), vec2i(0), vec2i(extent) - 1);
        sum += textureLoad(atlas, texel, 0);
    }
    let mean = sum * 0.25;
    if about.components == 1u {
        return vec4f(mean.rrr, 1.0);
    }
    if about.components == 2u {
        return vec4f(mean.rg, 1.0, 1.0);
    }
    return vec4f(select(clamp(mean.rgb, vec3f(0.0), vec3f(1.0)), encoded(mean.rgb), about.is_srgb == 1u), 1.0);
}
