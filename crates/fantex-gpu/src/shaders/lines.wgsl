// Lines along the edges of the mesh.

struct Lines {
    // Linear RGB, premultiplied by the opacity.
    color: vec4<f32>,
}

@group(1) @binding(0) var<uniform> lines: Lines;

// How much nearer lines are than the surface that they lie on, as a share of the distance.
const LIFT: f32 = 5e-4;

@vertex
fn vs_lines(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return clip_position(offset_from_eye(position) * (1.0 - LIFT));
}

@fragment
fn fs_lines() -> @location(0) vec4<f32> {
    return lines.color;
}
