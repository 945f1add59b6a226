// From a material and lights to the light that reaches the eye: the formulas of the CPU renderer.

// Shading, in the order of fantex_scene::Shading.
override SHADING: u32 = 0u;

// Samples per pixel, 1 or 4.
override SAMPLES: u32 = 1u;

const PI: f32 = 3.14159265;

// Reflectance of dielectrics at normal incidence (refractive index 1.5).
const DIELECTRIC: f32 = 0.04;

// Roughness below which highlights of a directional light would be smaller than any pixel.
const SMALLEST_ALPHA: f32 = 2e-3;

// Nodes of the split sum's table along each axis.
const SPLIT_SUM_NODES: f32 = 24.0;

// Roughness below which mirror images are so sharp that the change of a bent normal over the pixel matters.
const SHINY: f32 = 0.3;

// What the surface is made of, at a fragment.
struct MaterialSample {
    // Linear.
    base_color: vec3<f32>,
    // Opacity, the cut-out threshold already applied.
    alpha: f32,
    // Unit shading normal on the side that is seen, and its change along the pixel's edges.
    normal: vec3<f32>,
    normal_dx: vec3<f32>,
    normal_dy: vec3<f32>,
    occlusion: f32,
    // Perceptual.
    roughness: f32,
    metallic: f32,
    emission: vec3<f32>,
    // Whether the base colour is the picture.
    unlit: bool,
}

// Alpha that is so near to 0 or 1, half a step of 8 bits, lies inside: there no slope is asked for.
const INSIDE: f32 = 0.0019608;

// What a cut-out leaves of a pixel.
struct CutOut {
    @location(0) light: vec4<f32>,
    @builtin(sample_mask) samples: u32,
}

// The samples of a pixel, a bit each, where alpha reaches the threshold, were it a ramp as steep as it is here: edges are then as smooth as
// those of triangles. The places of samples are those of Direct3D's and Vulkan's standard.
fn cut_out_samples(alpha: f32, threshold: f32) -> u32 {
    // Inside, beside a triangle's edge, the slope may be that of texels beyond, which are empty.
    let is_inside = alpha <= INSIDE || alpha >= 1.0 - INSIDE;
    let slope = select(vec2<f32>(dpdx(alpha), dpdy(alpha)), vec2<f32>(0.0), SAMPLES == 1u || is_inside);
    let ramp = vec4<f32>(alpha) + slope.x * vec4<f32>(-0.125, 0.375, -0.375, 0.125)
        + slope.y * vec4<f32>(-0.375, -0.125, 0.125, 0.375);
    let covered = vec4<u32>(clamp(ramp, vec4<f32>(0.0), vec4<f32>(1.0)) >= vec4<f32>(threshold));
    return dot(covered, vec4<u32>(1u, 2u, 4u, 8u));
}

fn split_sum(roughness: f32, n_v: f32) -> vec2<f32> {
    let at = (clamp(vec2<f32>(n_v, roughness), vec2<f32>(0.0), vec2<f32>(1.0)) * (SPLIT_SUM_NODES - 1.0) + 0.5)
        / SPLIT_SUM_NODES;
    return textureSampleLevel(split_sum_table, smooth_sampler, at, 0.0).rg;
}

// Height-correlated Smith shadowing of GGX: G / (4 (n.l) (n.v)).
fn smith_visibility(n_l: f32, n_v: f32, a2: f32) -> f32 {
    let towards_light = n_v * sqrt(n_l * n_l * (1.0 - a2) + a2);
    let towards_eye = n_l * sqrt(n_v * n_v * (1.0 - a2) + a2);
    return 0.5 / (towards_light + towards_eye);
}

fn lamp_color(lamp_index: u32, at: SurfacePoint, light: Incoming) -> vec3<f32> {
    if HAS_SHADOWS {
        return light.color * visibility(lamp_index, at, light.to_light);
    }
    return light.color;
}

// glTF 2.0, appendix B: a dielectric (Lambert under a Fresnel coat) mixed with a metal; GGX microfacets.
fn metallic_roughness(at: SurfacePoint, m: MaterialSample) -> vec3<f32> {
    let n = m.normal;
    let n_v = max(dot(n, at.to_eye), 1e-3);
    let alpha = clamp(m.roughness * m.roughness, SMALLEST_ALPHA, 1.0);
    let a2 = alpha * alpha;
    let diffuse_color = m.base_color * (1.0 - m.metallic);
    let f0 = mix(vec3<f32>(DIELECTRIC), m.base_color, m.metallic);
    let total = split_sum(m.roughness, n_v);
    let mirrored = f0 * total.x + total.y;
    var sum = diffuse_color * (1.0 - mirrored) * ambient_diffuse(n)
        + mirrored * ambient_specular(n, m.normal_dx, m.normal_dy, at.to_eye, m.roughness);
    sum *= m.occlusion;
    for (var i = 0u; i < frame.lamp_count; i += 1u) {
        let light = incoming(i, at);
        let n_l = dot(n, light.to_light);
        if n_l > 0.0 && any(light.color > vec3<f32>(0.0)) {
            let h = unit_or(at.to_eye + light.to_light, n);
            let toward = 1.0 - clamp(dot(at.to_eye, h), 0.0, 1.0);
            let toward2 = toward * toward;
            let fresnel = f0 + (1.0 - f0) * (toward2 * toward2 * toward);
            let n_h = clamp(dot(n, h), 0.0, 1.0);
            let d = (1.0 - n_h) * (1.0 + n_h) + n_h * n_h * a2;
            // pi times density times shadowing.
            let shape = a2 / (d * d) * smith_visibility(n_l, n_v, a2);
            let response = diffuse_color * (1.0 - fresnel) + fresnel * shape;
            sum += response * n_l * lamp_color(i, at, light);
        }
    }
    return sum;
}

fn blinn_phong(at: SurfacePoint, m: MaterialSample) -> vec3<f32> {
    let n = m.normal;
    let alpha = clamp(m.roughness * m.roughness, SMALLEST_ALPHA, 1.0);
    let shininess = max(2.0 / (alpha * alpha) - 2.0, 0.0);
    let specular = mix(vec3<f32>(DIELECTRIC), m.base_color, m.metallic) * ((shininess + 8.0) / 8.0);
    let diffuse = m.base_color * (1.0 - m.metallic);
    var sum = m.base_color * m.occlusion * ambient_diffuse(n);
    for (var i = 0u; i < frame.lamp_count; i += 1u) {
        let light = incoming(i, at);
        let n_l = dot(n, light.to_light);
        if n_l > 0.0 && any(light.color > vec3<f32>(0.0)) {
            let n_h = max(dot(n, unit_or(light.to_light + at.to_eye, n)), 0.0);
            // A power of zero is one only where the exponent is zero.
            let height = select(pow(n_h, shininess), select(0.0, 1.0, shininess <= 0.0), n_h <= 0.0);
            sum += (diffuse * n_l + specular * height) * lamp_color(i, at, light);
        }
    }
    return sum;
}

fn light_to_eye(at: SurfacePoint, m: MaterialSample) -> vec3<f32> {
    if SHADING == 2u {
        return m.base_color;
    }
    if SHADING == 3u {
        return m.normal * 0.5 + 0.5;
    }
    if SHADING == 4u {
        return vec3<f32>(m.occlusion, m.roughness, m.metallic);
    }
    if SHADING == 5u {
        return m.emission;
    }
    if m.unlit {
        return m.base_color;
    }
    if SHADING == 1u {
        return m.emission + blinn_phong(at, m);
    }
    return m.emission + metallic_roughness(at, m);
}

// The fragment's colour: linear light times exposure, premultiplied by the opacity.
fn shade(at: SurfacePoint, m: MaterialSample) -> vec4<f32> {
    return exposed(light_to_eye(at, m), m.alpha);
}

// The same of light towards the eye.
fn exposed(to_eye: vec3<f32>, opacity: f32) -> vec4<f32> {
    let light = to_eye * frame.exposure;
    // One texel that is not a number must not spoil its pixel's other samples; half floats end at 65504.
    let is_finite = all(abs(light) < vec3<f32>(1e30));
    let shown = select(vec3<f32>(0.0), min(light, vec3<f32>(6e4)), is_finite);
    let alpha = clamp(opacity, 0.0, 1.0);
    return vec4<f32>(shown * alpha, alpha);
}
