// A colour per partial fan.

struct FanColorVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) offset: vec3<f32>,
    // Barycentric coordinates of the first two corners.
    @location(1) lambda: vec2<f32>,
    @location(2) @interpolate(flat) fans: vec3<u32>,
}

@vertex
fn vs_fan_colors(
    @builtin(vertex_index) index: u32,
    @location(0) position: vec3<f32>,
    @location(1) fans: vec3<u32>,
) -> FanColorVarying {
    var out: FanColorVarying;
    out.offset = offset_from_eye(position);
    out.clip = clip_position(out.offset);
    let corner = index % 3u;
    out.lambda = vec2<f32>(f32(corner == 0u), f32(corner == 1u));
    out.fans = fans;
    return out;
}

@fragment
fn fs_fan_colors(in: FanColorVarying, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let at = surface_point(in.offset, vec3<f32>(0.0), front);
    let lambda = max(vec3<f32>(in.lambda, 1.0 - in.lambda.x - in.lambda.y), vec3<f32>(0.0));
    let w = fan_weights(in.fans, lambda);
    var m: MaterialSample;
    m.base_color = w.x * fan_number_color(in.fans.x) + w.y * fan_number_color(in.fans.y) + w.z * fan_number_color(in.fans.z);
    m.alpha = 1.0;
    m.occlusion = 1.0;
    m.roughness = 0.9;
    m.normal = at.vertex_normal;
    return shade(at, m);
}
