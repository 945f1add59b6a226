// Drawing a shadow map: bind group 0.

struct Caster {
    // From mesh to clip space of the map; depth is reversed.
    clip_from_mesh: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> caster: Caster;

// What lets more light through than this casts no shadow.
const MIN_SHADOW_ALPHA: f32 = 0.5;
