// What every shader of a frame is given: bind group 0. Lengths are mesh units unless they say otherwise; directions are the
// same in mesh and world space.

struct Frame {
    // From offsets from the eye to clip space. Depth is reversed (1 near, 0 infinitely far).
    clip_from_offset: mat4x4<f32>,
    // The eye as the sum of two floats, so that offsets from it keep their digits.
    eye: vec3<f32>,
    exposure: f32,
    eye_rest: vec3<f32>,
    world_per_mesh: f32,
    // The direction through a position in pixels is ray_corner + x ray_right + y ray_down, not normalised.
    ray_corner: vec3<f32>,
    width: f32,
    ray_right: vec3<f32>,
    height: f32,
    ray_down: vec3<f32>,
    // Filter::Trilinear and friends: most probes of an anisotropic look-up.
    max_anisotropy: f32,
    background_top: vec4<f32>,
    background_bottom: vec4<f32>,
    ambient_sky: vec3<f32>,
    background_blur: f32,
    ambient_ground: vec3<f32>,
    environment_strength: f32,
    ambient_up: vec3<f32>,
    // Of the turn that takes world directions to the environment's.
    environment_cosine: f32,
    environment_sine: f32,
    lamp_count: u32,
    // Overlay, see DrawOptions; 0 is none.
    overlay: u32,
    // 0 clip, 1 Reinhard, 2 filmic, 3 light as it is.
    tone_map: u32,
    tone_white: f32,
    // 1 where the target does not encode sRGB by itself.
    encode_srgb: u32,
    // 1 where the background is the environment's light.
    background_is_light: u32,
    seconds: f32,
    // Irradiance of the environment as spherical harmonics, in the order of IrradianceHarmonics.
    harmonics: array<vec4<f32>, 9>,
}

struct Lamp {
    // 0 directional, 1 point, 2 spot, 3 projector with a perspective lens, 4 with a parallel one.
    kind: u32,
    // Shadow maps: the first and their number, 0, 1 or 6.
    first_face: u32,
    face_count: u32,
    // Layer of a projector's cookie.
    cookie: u32,
    color: vec3<f32>,
    // One over the distance at which the falloff is one, world units; 0 without falloff.
    inverse_reference: f32,
    position: vec3<f32>,
    // One over the distance where light ends, world units; 0 without end.
    inverse_range: f32,
    // Directional: to the light. Others: along the axis, away from the lamp. Unit.
    direction: vec3<f32>,
    cosine_outer: f32,
    inverse_cosine_range: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
    // Projector: from (p, 1) to (u w, v w, w, depth) of its cookie.
    cookie_from_mesh: mat4x4<f32>,
}

struct ShadowFace {
    // From (p, 1) to (u w, v w, w, depth).
    map_from_mesh: mat4x4<f32>,
    right: vec3<f32>,
    half_width: f32,
    up: vec3<f32>,
    half_height: f32,
    forward: vec3<f32>,
    // Largest depth.
    far: f32,
    origin: vec3<f32>,
    // Perspective: the near plane. Parallel light: 0.
    near: f32,
    resolution: f32,
    layer: u32,
    // Texels.
    bias: f32,
    normal_offset: f32,
    // 0 sharp, 1 even, 2 by the lamp's size.
    penumbra: u32,
    // Mesh units; of a parallel lamp's size the tangent.
    penumbra_width: f32,
    // The first of its texels in the layer.
    at: vec2<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(2) var<storage, read> shadow_faces: array<ShadowFace>;
@group(0) @binding(3) var shadow_maps: texture_depth_2d_array;
@group(0) @binding(4) var environment_sharp: texture_cube<f32>;
@group(0) @binding(5) var environment_first: texture_cube<f32>;
@group(0) @binding(6) var environment_rough: texture_cube_array<f32>;
@group(0) @binding(7) var split_sum_table: texture_2d<f32>;
@group(0) @binding(8) var cookies: texture_2d_array<f32>;
@group(0) @binding(9) var smooth_sampler: sampler;

// The offset of a mesh-space point from the eye.
fn offset_from_eye(position: vec3<f32>) -> vec3<f32> {
    return (position - frame.eye) - frame.eye_rest;
}

fn clip_position(offset: vec3<f32>) -> vec4<f32> {
    return frame.clip_from_offset * vec4<f32>(offset, 1.0);
}

fn unit_or(v: vec3<f32>, otherwise: vec3<f32>) -> vec3<f32> {
    let squared = dot(v, v);
    return select(otherwise, v * inverseSqrt(squared), squared > 1e-30);
}
