// Fan-textured triangles: from vertices to material samples.

// 0 none, 1 groups, 2 fans, 3 levels, 4 residency, 5 blend bands.
override FAN_OVERLAY: u32 = 0u;

// Values of all groups at a fragment, blended.
struct FanBlend {
    base_color: vec4<f32>,
    material: vec4<f32>,
    emission: vec4<f32>,
    // Mesh space, front side, not normalised.
    normal: vec3<f32>,
    light: vec3<f32>,
    // Relative to stretch_axis, -1 to 1.
    stretch: vec2<f32>,
    overlay: vec3<f32>,
}

// The x axis of a tile's shading frame, mesh space (Group::shading_axes).
fn fan_shading_axis(group: u32, vertex_normal: vec3<f32>) -> vec3<f32> {
    let frame = fan_frames[group];
    let d = vec3<f32>(frame[0], frame[1], frame[2]);
    let x = vec3<f32>(frame[3], frame[4], frame[5]);
    // The smallest rotation that takes d to the vertex normal.
    let turned = x - (d + vertex_normal) * (dot(x, vertex_normal) / max(1.0 + dot(d, vertex_normal), 1e-4));
    let otherwise = select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), abs(vertex_normal.x) > 0.8);
    return unit_or(turned - vertex_normal * dot(turned, vertex_normal), otherwise);
}

// A stored normal in mesh space.
fn fan_mesh_normal(stored: vec2<f32>, x_axis: vec3<f32>, vertex_normal: vec3<f32>) -> vec3<f32> {
    let y_axis = cross(vertex_normal, x_axis);
    let xy = stored * 2.0 - 1.0;
    let z = sqrt(max(1.0 - dot(xy, xy), 0.0));
    return unit_or(x_axis * xy.x + y_axis * xy.y + vertex_normal * z, vertex_normal);
}

// From red (finest) over yellow, green, cyan to violet.
fn fan_level_color(level: f32) -> vec3<f32> {
    let hue = min(level * 0.6, 5.0);
    return clamp(vec3<f32>(abs(hue - 3.0) - 1.0, 2.0 - abs(hue - 2.0), 2.0 - abs(hue - 4.0)), vec3<f32>(0.05), vec3<f32>(0.9));
}

// Green where the wanted level is there; from yellow to red the more levels are missing.
fn fan_residency_color(missing: f32) -> vec3<f32> {
    if missing < 0.01 {
        return vec3<f32>(0.1, 0.55, 0.15);
    }
    return mix(vec3<f32>(0.9, 0.8, 0.1), vec3<f32>(0.85, 0.05, 0.05), clamp(missing / 3.0, 0.0, 1.0));
}

fn add_tile(sum: ptr<function, FanBlend>, tile: TileSample, group: u32, vertex_normal: vec3<f32>, weight: f32) {
    (*sum).base_color += weight * tile.base_color;
    (*sum).material += weight * tile.material;
    (*sum).emission += weight * tile.emission;
    if FAN_LIGHT {
        (*sum).light += weight * tile.light.rgb;
    }
    if FAN_NORMAL || FAN_ANISOTROPY {
        let axis = fan_shading_axis(group, vertex_normal);
        if FAN_NORMAL {
            (*sum).normal += weight * fan_mesh_normal(tile.normal, axis, vertex_normal);
        }
        if FAN_ANISOTROPY {
            (*sum).stretch += weight * turned_stretch(tile.anisotropy * 2.0 - 1.0, axis, vertex_normal);
        }
    }
    if FAN_OVERLAY == 1u || FAN_OVERLAY == 2u {
        (*sum).overlay += weight * fan_number_color(group);
    }
    if FAN_OVERLAY == 3u {
        (*sum).overlay += weight * fan_level_color(tile.shown_level);
    }
    if FAN_OVERLAY == 4u {
        (*sum).overlay += weight * fan_residency_color(tile.shown_level - tile.wanted_level);
    }
}

fn fan_shade(at: SurfacePoint, blend: FanBlend, front: bool) -> CutOut {
    let side = select(-1.0, 1.0, front);
    var m: MaterialSample;
    let base = select(fan_factors.base_color, blend.base_color, FAN_BASE_COLOR);
    m.base_color = max(base.rgb, vec3<f32>(0.0));
    m.alpha = 1.0;
    var samples = 0xfu;
    if FAN_ALPHA_MODE == 1u {
        samples = cut_out_samples(base.a, fan_factors.alpha_threshold);
        if samples == 0u {
            discard;
        }
    }
    if FAN_ALPHA_MODE == 2u {
        m.alpha = clamp(base.a, 0.0, 1.0);
    }
    let made_of = select(vec3<f32>(1.0, fan_factors.roughness, fan_factors.metallic), blend.material.rgb, FAN_MATERIAL);
    m.occlusion = clamp(made_of.x, 0.0, 1.0);
    m.roughness = clamp(made_of.y, 0.0, 1.0);
    m.metallic = clamp(made_of.z, 0.0, 1.0);
    m.emission = select(fan_factors.emission, max(blend.emission.rgb, vec3<f32>(0.0)), FAN_EMISSION);
    m.normal = at.vertex_normal;
    m.normal_dx = dpdx(at.vertex_normal);
    m.normal_dy = dpdy(at.vertex_normal);
    if FAN_NORMAL {
        m.normal = unit_or(blend.normal, at.vertex_normal * side) * side;
        let dx = dpdx(m.normal);
        let dy = dpdy(m.normal);
        if m.roughness < SHINY {
            m.normal_dx = dx;
            m.normal_dy = dy;
        }
    }
    m.unlit = fan_factors.unlit == 1u;
    if FAN_OVERLAY != 0u {
        m.base_color = blend.overlay;
        m.occlusion = 1.0;
        m.roughness = 0.9;
        m.metallic = 0.0;
        m.emission = vec3<f32>(0.0);
    }
    if (FAN_TOON || FAN_LIGHT || FAN_ANISOTROPY) && FAN_OVERLAY == 0u && SHADING <= 1u {
        if m.unlit && FAN_LIGHT {
            m.base_color *= max(blend.light, vec3<f32>(0.0));
        }
        if !m.unlit {
            let light = m.emission + finished_light(at, m, blend.light, blend.stretch, at.vertex_normal * side);
            return CutOut(exposed(light, m.alpha), samples);
        }
    }
    return CutOut(shade(at, m), samples);
}

struct FanPlainVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) offset: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>,
    // Group and its record.
    @location(3) @interpolate(flat) group: vec3<u32>,
}

@vertex
fn vs_fan_plain(vertex: FanPlainVertex) -> FanPlainVarying {
    var out: FanPlainVarying;
    out.offset = offset_from_eye(vertex.position);
    out.clip = clip_position(out.offset);
    out.normal = from_octahedral(vertex.normal);
    out.uv = vertex.uv;
    out.group = vec3<u32>(vertex.group, fan_groups[vertex.group]);
    return out;
}

fn fan_plain(in: FanPlainVarying, front: bool) -> CutOut {
    let at = surface_point(in.offset, in.normal, front);
    let tile = tile_sample(in.group.x, in.group.yz, in.uv, dpdx(in.uv), dpdy(in.uv));
    var blend = FanBlend();
    add_tile(&blend, tile, in.group.x, at.vertex_normal * select(-1.0, 1.0, front), 1.0);
    if FAN_OVERLAY == 5u {
        blend.overlay = vec3<f32>(0.35);
    }
    return fan_shade(at, blend, front);
}

@fragment
fn fs_fan_plain(in: FanPlainVarying, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    return fan_plain(in, front).light;
}

@fragment
fn fs_fan_plain_cut_out(in: FanPlainVarying, @builtin(front_facing) front: bool) -> CutOut {
    return fan_plain(in, front);
}

struct FanBorderVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) offset: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) uv01: vec4<f32>,
    // Coordinates in the third tile; barycentric coordinates of the first two corners.
    @location(3) uv2_lambda: vec4<f32>,
    // Groups and their records.
    @location(4) @interpolate(flat) groups: vec3<u32>,
    @location(5) @interpolate(flat) records01: vec4<u32>,
    @location(6) @interpolate(flat) record2: vec2<u32>,
}

@vertex
fn vs_fan_border(vertex: FanBorderVertex) -> FanBorderVarying {
    var out: FanBorderVarying;
    let corner = vertex.index % 3u;
    out.offset = offset_from_eye(vertex.position);
    out.clip = clip_position(out.offset);
    out.normal = from_octahedral(vertex.normal);
    out.uv01 = vec4<f32>(vertex.uv0, vertex.uv1);
    out.uv2_lambda = vec4<f32>(vertex.uv2, f32(corner == 0u), f32(corner == 1u));
    out.groups = vertex.groups;
    out.records01 = vec4<u32>(fan_groups[vertex.groups.x], fan_groups[vertex.groups.y]);
    out.record2 = fan_groups[vertex.groups.z];
    return out;
}

fn fan_border(in: FanBorderVarying, front: bool) -> CutOut {
    let at = surface_point(in.offset, in.normal, front);
    let front_normal = at.vertex_normal * select(-1.0, 1.0, front);
    let lambda01 = in.uv2_lambda.zw;
    let w = fan_weights(in.groups, max(vec3<f32>(lambda01, 1.0 - lambda01.x - lambda01.y), vec3<f32>(0.0)));
    let dx01 = dpdx(in.uv01);
    let dy01 = dpdy(in.uv01);
    let dx2 = dpdx(in.uv2_lambda.xy);
    let dy2 = dpdy(in.uv2_lambda.xy);
    var blend = FanBlend();
    // A bit per slot that has weight, at least one.
    var slots = u32(w.x > 0.0) | (u32(w.y > 0.0) << 1u) | (u32(w.z > 0.0) << 2u);
    if FAN_OVERLAY == 5u {
        blend.overlay = select(vec3<f32>(0.35), vec3<f32>(0.9, 0.45, 0.05) , countOneBits(slots) > 1u);
    }
    loop {
        let slot = firstTrailingBit(slots);
        slots &= slots - 1u;
        let is_first = slot == 0u;
        let is_last = slot == 2u;
        let uv = select(select(in.uv01.zw, in.uv2_lambda.xy, is_last), in.uv01.xy, is_first);
        let dx = select(select(dx01.zw, dx2, is_last), dx01.xy, is_first);
        let dy = select(select(dy01.zw, dy2, is_last), dy01.xy, is_first);
        let record = select(select(in.records01.zw, in.record2, is_last), in.records01.xy, is_first);
        let group = select(select(in.groups.y, in.groups.z, is_last), in.groups.x, is_first);
        let weight = select(select(w.y, w.z, is_last), w.x, is_first);
        add_tile(&blend, tile_sample(group, record, uv, dx, dy), group, front_normal, weight);
        continuing {
            break if slots == 0u;
        }
    }
    return fan_shade(at, blend, front);
}

@fragment
fn fs_fan_border(in: FanBorderVarying, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    return fan_border(in, front).light;
}

@fragment
fn fs_fan_border_cut_out(in: FanBorderVarying, @builtin(front_facing) front: bool) -> CutOut {
    return fan_border(in, front);
}
