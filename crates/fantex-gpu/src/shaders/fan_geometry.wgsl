// Vertices of fan-textured triangles, their materials, the weights of their groups.

// 0 opaque, 1 cut out, 2 blended.
override FAN_ALPHA_MODE: u32 = 0u;

// What a material says where there is no channel.
struct FanMaterial {
    // Linear RGBA.
    base_color: vec4<f32>,
    emission: vec3<f32>,
    metallic: f32,
    roughness: f32,
    alpha_threshold: f32,
    unlit: u32,
    // 0 for none; 0 linear, 1 smooth, 2 constant.
    toon_stops: u32,
    toon_interpolation: u32,
    // Linear RGB and the place, ascending.
    toon: array<vec4<f32>, 32>,
}

// A uniform: software adapters read storage buffers lane by lane.
@group(2) @binding(0) var<uniform> fan_factors: FanMaterial;

// A unit vector from the unfolded octahedron.
fn from_octahedral(p: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(p.x) - abs(p.y);
    let fold = max(-z, 0.0);
    return normalize(vec3<f32>(p + select(vec2<f32>(fold), vec2<f32>(-fold), p >= vec2<f32>(0.0)), z));
}

struct FanPlainVertex {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec2<f32>,
    @location(2) uv: vec2<f32>,
    @location(3) group: u32,
}

struct FanBorderVertex {
    @builtin(vertex_index) index: u32,
    @location(0) position: vec3<f32>,
    @location(1) normal: vec2<f32>,
    @location(2) uv0: vec2<f32>,
    @location(3) uv1: vec2<f32>,
    @location(4) uv2: vec2<f32>,
    @location(5) groups: vec3<u32>,
}

// GroupWeights: corners of the same group count as the first of them.
fn fan_weights(groups: vec3<u32>, lambda: vec3<f32>) -> vec3<f32> {
    var w = max(lambda - max(lambda.yzx, lambda.zxy) + fan.delta, vec3<f32>(0.0));
    w /= w.x + w.y + w.z;
    if groups.x == groups.y {
        w = vec3<f32>(w.x + w.y, 0.0, w.z);
    }
    if groups.x == groups.z {
        w = vec3<f32>(w.x + w.z, w.y, 0.0);
    }
    if groups.y == groups.z {
        w = vec3<f32>(w.x, w.y + w.z, 0.0);
    }
    return w;
}

// Colours that differ for neighbouring numbers: hues by the golden ratio.
fn fan_number_color(number: u32) -> vec3<f32> {
    let hue = fract(f32(number % 65536u) * 0.618034) * 6.0;
    let bright = 0.55 + 0.35 * fract(f32(number % 4096u) * 0.754878);
    let rgb = clamp(vec3<f32>(abs(hue - 3.0) - 1.0, 2.0 - abs(hue - 2.0), 2.0 - abs(hue - 4.0)), vec3<f32>(0.0), vec3<f32>(1.0));
    return bright * mix(vec3<f32>(1.0), rgb, 0.75);
}
