// A mesh with texture coordinates and a material of its own.

struct UvVertex {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec4<f32>,
    // Handedness in w.
    @location(2) tangent: vec4<f32>,
    @location(3) uv01: vec4<f32>,
    @location(4) uv23: vec4<f32>,
    // Linear RGBA.
    @location(5) color: vec4<f32>,
}

// What could run wild beyond a triangle's border is interpolated within it (centroid); what differences are taken of, at the
// pixel's centre.
struct UvVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) offset: vec3<f32>,
    @location(1) @interpolate(perspective, centroid) normal: vec3<f32>,
    @location(2) @interpolate(perspective, centroid) tangent: vec4<f32>,
    @location(3) uv01: vec4<f32>,
    @location(4) uv23: vec4<f32>,
    @location(5) @interpolate(perspective, centroid) color: vec4<f32>,
}

@vertex
fn vs_uv(vertex: UvVertex) -> UvVarying {
    var out: UvVarying;
    out.offset = offset_from_eye(vertex.position);
    out.clip = clip_position(out.offset);
    out.normal = vertex.normal.xyz;
    out.tangent = vertex.tangent;
    out.uv01 = vertex.uv01;
    out.uv23 = vertex.uv23;
    out.color = vertex.color;
    return out;
}

// The unit normal that the normal map gives the front side, relative to axes that are interpolated and used without
// normalisation (M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008).
fn bent_normal(in: UvVarying) -> vec3<f32> {
    let texel = textureSample(normal_texture, normal_sampler, layer_uv(LAYER_NORMAL, in.uv01, in.uv23)).xyz;
    let bent = (texel * 2.0 - 1.0) * vec3<f32>(material.normal_scale, material.normal_scale, 1.0);
    let bitangent = cross(in.normal, in.tangent.xyz) * in.tangent.w;
    return in.tangent.xyz * bent.x + bitangent * bent.y + in.normal * bent.z;
}

fn uv_material(in: UvVarying, at: SurfacePoint, front: bool) -> MaterialSample {
    var m: MaterialSample;
    let base = uv_base_color(in.color, in.uv01, in.uv23);
    m.base_color = max(base.rgb, vec3<f32>(0.0));
    m.alpha = base.a;
    m.occlusion = 1.0;
    m.roughness = material.roughness;
    m.metallic = material.metallic;
    m.emission = material.emission;
    m.unlit = material.unlit == 1u;
    if has_layer(LAYER_OCCLUSION) {
        let texel = textureSample(occlusion_texture, occlusion_sampler, layer_uv(LAYER_OCCLUSION, in.uv01, in.uv23));
        m.occlusion = 1.0 + material.occlusion_strength * (texel.r - 1.0);
    }
    if has_layer(LAYER_METALLIC_ROUGHNESS) {
        let uv = layer_uv(LAYER_METALLIC_ROUGHNESS, in.uv01, in.uv23);
        let texel = textureSample(metallic_roughness_texture, metallic_roughness_sampler, uv);
        m.roughness *= texel.g;
        m.metallic *= texel.b;
    }
    if has_layer(LAYER_EMISSION) {
        let texel = textureSample(emission_texture, emission_sampler, layer_uv(LAYER_EMISSION, in.uv01, in.uv23));
        m.emission *= texel.rgb;
    }
    m.occlusion = clamp(m.occlusion, 0.0, 1.0);
    m.roughness = clamp(m.roughness, 0.0, 1.0);
    m.metallic = clamp(m.metallic, 0.0, 1.0);
    m.normal = at.vertex_normal;
    m.normal_dx = dpdx(m.normal);
    m.normal_dy = dpdy(m.normal);
    if has_layer(LAYER_NORMAL) {
        m.normal = unit_or(bent_normal(in) * select(-1.0, 1.0, front), at.vertex_normal);
        let dx = dpdx(m.normal);
        let dy = dpdy(m.normal);
        if m.roughness < SHINY {
            m.normal_dx = dx;
            m.normal_dy = dy;
        }
    }
    return m;
}

fn uv_shade(in: UvVarying, front: bool) -> CutOut {
    let at = surface_point(in.offset, in.normal, front);
    var m = uv_material(in, at, front);
    var samples = 0xfu;
    if ALPHA_MODE == 1u {
        samples = cut_out_samples(m.alpha, material.alpha_threshold);
        if samples == 0u {
            discard;
        }
    }
    if ALPHA_MODE != 2u {
        m.alpha = 1.0;
    }
    return CutOut(shade(at, m), samples);
}

@fragment
fn fs_uv(in: UvVarying, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    return uv_shade(in, front).light;
}

@fragment
fn fs_uv_cut_out(in: UvVarying, @builtin(front_facing) front: bool) -> CutOut {
    return uv_shade(in, front);
}
