// The shadow of a fan-textured mesh.

struct FanCasterVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv01: vec4<f32>,
    @location(1) uv2_lambda: vec4<f32>,
    @location(2) @interpolate(flat) groups: vec3<u32>,
}

@vertex
fn vs_fan_solid(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return caster.clip_from_mesh * vec4<f32>(position, 1.0);
}

@vertex
fn vs_fan_plain_caster(vertex: FanPlainVertex) -> FanCasterVarying {
    var out: FanCasterVarying;
    out.clip = caster.clip_from_mesh * vec4<f32>(vertex.position, 1.0);
    out.uv01 = vec4<f32>(vertex.uv, vertex.uv);
    out.uv2_lambda = vec4<f32>(vertex.uv, 1.0, 0.0);
    out.groups = vec3<u32>(vertex.group);
    return out;
}

@vertex
fn vs_fan_border_caster(vertex: FanBorderVertex) -> FanCasterVarying {
    var out: FanCasterVarying;
    let corner = vertex.index % 3u;
    out.clip = caster.clip_from_mesh * vec4<f32>(vertex.position, 1.0);
    out.uv01 = vec4<f32>(vertex.uv0, vertex.uv1);
    out.uv2_lambda = vec4<f32>(vertex.uv2, f32(corner == 0u), f32(corner == 1u));
    out.groups = vertex.groups;
    return out;
}

@fragment
fn fs_fan_caster(in: FanCasterVarying) {
    let lambda01 = in.uv2_lambda.zw;
    let w = fan_weights(in.groups, max(vec3<f32>(lambda01, 1.0 - lambda01.x - lambda01.y), vec3<f32>(0.0)));
    let dx01 = dpdx(in.uv01);
    let dy01 = dpdy(in.uv01);
    let dx2 = dpdx(in.uv2_lambda.xy);
    let dy2 = dpdy(in.uv2_lambda.xy);
    var alpha = 0.0;
    for (var slot = 0u; slot < 3u; slot += 1u) {
        if w[slot] > 0.0 {
            let uv = select(select(in.uv01.zw, in.uv2_lambda.xy, slot == 2u), in.uv01.xy, slot == 0u);
            let dx = select(select(dx01.zw, dx2, slot == 2u), dx01.xy, slot == 0u);
            let dy = select(select(dy01.zw, dy2, slot == 2u), dy01.xy, slot == 0u);
            let group = in.groups[slot];
            alpha += w[slot] * tile_sample(group, fan_groups[group], uv, dx, dy).base_color.a;
        }
    }
    alpha = select(fan_factors.base_color.a, alpha, FAN_BASE_COLOR);
    if alpha < select(fan_factors.alpha_threshold, MIN_SHADOW_ALPHA, FAN_ALPHA_MODE == 2u) {
        discard;
    }
}
