
// A point per pixel.

struct SheetPoint {
    uv0: vec2<f32>,
    uv1: vec2<f32>,
    uv2: vec2<f32>,
    corner: vec2<f32>,
}

@group(0) @binding(0) var sheet: texture_2d<f32>;
@group(0) @binding(1) var sheet_sampler: sampler;
@group(0) @binding(2) var<storage, read> points: array<SheetPoint>;

@vertex
fn vs_points(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fs_values(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let point = points[u32(at.y) * 64u + u32(at.x)];
    return fan_sample(sheet, sheet_sampler, point.uv0, point.uv1, point.uv2, fan_weights(point.corner));
}

@fragment
fn fs_normals(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let point = points[u32(at.y) * 64u + u32(at.x)];
    let weights = fan_weights(point.corner);
    return vec4<f32>(fan_normal(sheet, sheet_sampler, point.uv0, point.uv1, point.uv2, weights), 0.0);
}
