// The shadow of a mesh with texture coordinates.

struct CasterVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv01: vec4<f32>,
    @location(1) uv23: vec4<f32>,
    @location(2) color: vec4<f32>,
}

@vertex
fn vs_uv_solid(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return caster.clip_from_mesh * vec4<f32>(position, 1.0);
}

@vertex
fn vs_uv_caster(
    @location(0) position: vec3<f32>,
    @location(3) uv01: vec4<f32>,
    @location(4) uv23: vec4<f32>,
    @location(5) color: vec4<f32>,
) -> CasterVarying {
    var out: CasterVarying;
    out.clip = caster.clip_from_mesh * vec4<f32>(position, 1.0);
    out.uv01 = uv01;
    out.uv23 = uv23;
    out.color = color;
    return out;
}

@fragment
fn fs_uv_caster(in: CasterVarying) {
    let alpha = uv_base_color(in.color, in.uv01, in.uv23).a;
    let least = select(material.alpha_threshold, MIN_SHADOW_ALPHA, ALPHA_MODE == 2u);
    if alpha < least {
        discard;
    }
}
