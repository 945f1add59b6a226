// What is seen where no surface is: one triangle over the whole picture, behind everything.

@vertex
fn vs_sky(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u));
    return vec4<f32>(corner * 4.0 - 1.0, 0.0, 1.0);
}

fn ray(position: vec2<f32>) -> vec3<f32> {
    return normalize(frame.ray_corner + frame.ray_right * position.x + frame.ray_down * position.y);
}

@fragment
fn fs_sky(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    // The middle of the pixel, also where only some of its samples are sky.
    let middle = floor(position.xy) + 0.5;
    if frame.background_is_light == 0u {
        return mix(frame.background_top, frame.background_bottom, middle.y / frame.height);
    }
    let ahead = ray(middle);
    if !HAS_ENVIRONMENT {
        return vec4<f32>(two_colors(ahead) * frame.exposure, 1.0);
    }
    let right = ray(middle + vec2<f32>(0.5, 0.0)) - ray(middle - vec2<f32>(0.5, 0.0));
    let down = ray(middle + vec2<f32>(0.0, 0.5)) - ray(middle - vec2<f32>(0.0, 0.5));
    let light = environment_reflected(ahead, right, down, frame.background_blur) * frame.exposure;
    return vec4<f32>(min(light, vec3<f32>(6e4)), 1.0);
}
