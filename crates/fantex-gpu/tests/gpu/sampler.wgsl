// A value of the texture function per pixel.

// 0 base colour, 1 normal, 2 material.
override POINT_CHANNEL: u32 = 0u;

struct PointQuery {
    lambda: vec4<f32>,
    groups: vec4<f32>,
    vertex_normal: vec4<f32>,
    // Per corner: tile coordinates, then their changes per pixel.
    slots: array<vec4<f32>, 6>,
}

@group(3) @binding(0) var<storage, read> point_queries: array<PointQuery>;

@vertex
fn vs_points(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fs_points(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let number = u32(at.y) * 64u + u32(at.x);
    if number >= arrayLength(&point_queries) {
        return vec4<f32>(0.0);
    }
    var query = point_queries[number];
    var groups = vec3<u32>(query.groups.xyz);
    var w = fan_weights(groups, query.lambda.xyz);
    var blend = FanBlend();
    for (var slot = 0u; slot < 3u; slot += 1u) {
        if w[slot] > 0.0 {
            let steps = query.slots[2u * slot + 1u];
            let group = groups[slot];
            let tile = tile_sample(group, fan_groups[group], query.slots[2u * slot].xy, steps.xy, steps.zw);
            add_tile(&blend, tile, group, query.vertex_normal.xyz, w[slot]);
        }
    }
    if POINT_CHANNEL == 1u {
        return vec4<f32>(unit_or(blend.normal, query.vertex_normal.xyz), 0.0);
    }
    return select(blend.material, blend.base_color, POINT_CHANNEL == 0u);
}
