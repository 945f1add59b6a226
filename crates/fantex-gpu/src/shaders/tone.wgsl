// From the light of the frame to what the target shows: straight alpha, the tone map, the target's encoding.

@group(1) @binding(0) var light: texture_2d<f32>;

@vertex
fn vs_tone(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u));
    return vec4<f32>(corner * 4.0 - 1.0, 0.0, 1.0);
}

fn tone_mapped(color: vec3<f32>) -> vec3<f32> {
    if frame.tone_map == 0u {
        return clamp(color, vec3<f32>(0.0), vec3<f32>(1.0));
    }
    if frame.tone_map == 1u {
        let l = dot(color, vec3<f32>(0.2126, 0.7152, 0.0722));
        let white2 = frame.tone_white * frame.tone_white;
        return clamp(color * ((1.0 + l / white2) / (1.0 + l)), vec3<f32>(0.0), vec3<f32>(1.0));
    }
    if frame.tone_map == 2u {
        let curve = color * (2.51 * color + 0.03) / (color * (2.43 * color + 0.59) + 0.14);
        return clamp(curve, vec3<f32>(0.0), vec3<f32>(1.0));
    }
    return color;
}

fn srgb_encoded(linear: vec3<f32>) -> vec3<f32> {
    let curve = 1.055 * pow(linear, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, linear * 12.92, linear <= vec3<f32>(0.0031308));
}

@fragment
fn fs_tone(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let premultiplied = textureLoad(light, vec2<i32>(position.xy), 0);
    let alpha = clamp(premultiplied.a, 0.0, 1.0);
    let straight = premultiplied.rgb / max(alpha, 1e-6);
    var color = tone_mapped(max(straight, vec3<f32>(0.0)));
    if frame.encode_srgb == 1u {
        color = srgb_encoded(color);
    }
    return vec4<f32>(color, alpha);
}
