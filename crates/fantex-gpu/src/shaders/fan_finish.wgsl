// What assets have beyond metal and roughness: baked light, toon scales, stretched highlights. The formulas of the CPU renderer
// (fantex-render, shading.rs).

// Whether the material has a toon scale.
override FAN_TOON: bool = false;

// Points at which a toon scale is asked to average it.
const TOON_POINTS: u32 = 8u;

fn toon_color(x: f32) -> vec3<f32> {
    var color = fan_factors.toon[0];
    for (var i = 1u; i < fan_factors.toon_stops; i += 1u) {
        let next = fan_factors.toon[i];
        if x < next.w {
            if x > color.w && fan_factors.toon_interpolation < 2u {
                let t = (x - color.w) / (next.w - color.w);
                return mix(color.rgb, next.rgb, select(t, t * t * (3.0 - 2.0 * t), fan_factors.toon_interpolation == 1u));
            }
            return color.rgb;
        }
        color = next;
    }
    return color.rgb;
}

// The mean colour of the scale over a stretch around a place.
fn mean_toon_color(x: f32, width: f32) -> vec3<f32> {
    if width < 1e-4 {
        return toon_color(x);
    }
    var sum = vec3<f32>(0.0);
    for (var i = 0u; i < TOON_POINTS; i += 1u) {
        sum += toon_color(x + width * ((f32(i) + 0.5) / f32(TOON_POINTS) - 0.5));
    }
    return sum / f32(TOON_POINTS);
}

// What a lamp's n.l (negative below the horizon) contributes to diffuse reflection. A shadow lowers the index of a toon scale.
fn diffuse_response(n_l: f32, lit: f32, normal_width: f32) -> vec3<f32> {
    if FAN_TOON {
        let index = select(n_l, n_l * lit, n_l > 0.0);
        return mean_toon_color(index, normal_width * sqrt(max(1.0 - n_l * n_l, 0.0)));
    }
    return vec3<f32>(max(n_l, 0.0) * lit);
}

// An axis in the surface that all tiles' stretches are turned to before they are blended; which one makes no difference.
fn stretch_axis(normal: vec3<f32>) -> vec3<f32> {
    let other = select(vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(1.0, 0.0, 0.0), abs(normal.y) > 0.7);
    return normalize(cross(other, normal));
}

fn rotated(v: vec2<f32>, by: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(v.x * by.x - v.y * by.y, v.x * by.y + v.y * by.x);
}

// A stored stretch relative to stretch_axis, given the x axis of its tile's shading frame. Angles are doubled, so that between
// the two axes is, too.
fn turned_stretch(stored: vec2<f32>, tile_axis: vec3<f32>, normal: vec3<f32>) -> vec2<f32> {
    let x = stretch_axis(normal);
    let axis = vec2<f32>(dot(x, tile_axis), dot(cross(normal, x), tile_axis));
    return rotated(stored, rotated(axis, axis));
}

// An anisotropic highlight's axes, orthonormal, and its slopes along them.
struct HighlightAxes {
    tangent: vec3<f32>,
    bitangent: vec3<f32>,
    alpha: vec2<f32>,
}

// Stretches a slope along a blended stretch (B. Burley, "Physically-Based Shading at Disney", 2012).
fn highlight_axes(stretch: vec2<f32>, front_normal: vec3<f32>, normal: vec3<f32>, alpha: f32) -> HighlightAxes {
    let x = stretch_axis(front_normal);
    let strength = min(length(stretch), 1.0);
    let cosine = select(1.0, stretch.x / length(stretch), strength > 0.0);
    let half = vec2<f32>(sqrt(max(0.5 + 0.5 * cosine, 0.0)), sqrt(max(0.5 - 0.5 * cosine, 0.0)));
    let direction = x * half.x + cross(front_normal, x) * select(half.y, -half.y, stretch.y < 0.0);
    var axes: HighlightAxes;
    axes.bitangent = unit_or(cross(normal, direction), stretch_axis(normal));
    axes.tangent = cross(axes.bitangent, normal);
    let aspect = sqrt(1.0 - 0.9 * strength);
    axes.alpha = clamp(vec2<f32>(alpha / aspect, alpha * aspect), vec2<f32>(1e-3), vec2<f32>(1.0));
    return axes;
}

fn in_axes(axes: HighlightAxes, normal: vec3<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(v, axes.tangent), dot(v, axes.bitangent), dot(v, normal));
}

// pi times density and shadowing of anisotropic GGX facets (E. Heitz, "Understanding the Masking-Shadowing Function in
// Microfacet-Based BRDFs", 2014).
fn anisotropic_shape(axes: HighlightAxes, normal: vec3<f32>, half: vec3<f32>, to_light: vec3<f32>, to_eye: vec3<f32>) -> f32 {
    let h = in_axes(axes, normal, half);
    let l = in_axes(axes, normal, to_light);
    let v = in_axes(axes, normal, to_eye);
    let hx = h.x / axes.alpha.x;
    let hy = h.y / axes.alpha.y;
    let d = hx * hx + hy * hy + h.z * h.z;
    let density = 1.0 / (axes.alpha.x * axes.alpha.y * d * d);
    let slopes = vec3<f32>(axes.alpha, 1.0);
    let shadowing = max(l.z, 1e-3) * length(slopes * v) + max(v.z, 1e-3) * length(slopes * l);
    return density * 0.5 / shadowing;
}

// Light towards the eye without emission: metal and roughness, with what assets have beyond. `front_normal` is the vertex normal
// of the front side.
fn finished_light(
    at: SurfacePoint,
    m: MaterialSample,
    baked_light: vec3<f32>,
    stretch: vec2<f32>,
    front_normal: vec3<f32>,
) -> vec3<f32> {
    let n = m.normal;
    let n_v = max(dot(n, at.to_eye), 1e-3);
    let alpha = clamp(m.roughness * m.roughness, SMALLEST_ALPHA, 1.0);
    let a2 = alpha * alpha;
    let diffuse_color = m.base_color * (1.0 - m.metallic);
    let f0 = mix(vec3<f32>(DIELECTRIC), m.base_color, m.metallic);
    let total = split_sum(m.roughness, n_v);
    let mirrored = f0 * total.x + total.y;
    let normal_width = max(length(m.normal_dx), length(m.normal_dy));
    var axes: HighlightAxes;
    if FAN_ANISOTROPY {
        axes = highlight_axes(stretch, front_normal, n, alpha);
    }
    var diffuse = diffuse_color * (1.0 - mirrored) * ambient_diffuse(n) * m.occlusion;
    var specular = mirrored * ambient_specular(n, m.normal_dx, m.normal_dy, at.to_eye, m.roughness) * m.occlusion;
    for (var i = 0u; i < frame.lamp_count; i += 1u) {
        let light = incoming(i, at);
        let n_l = dot(n, light.to_light);
        if any(light.color > vec3<f32>(0.0)) && (FAN_TOON || n_l > 0.0) {
            var lit = 1.0;
            if HAS_SHADOWS {
                if n_l > 0.0 {
                    lit = visibility(i, at, light.to_light);
                }
            }
            let h = unit_or(at.to_eye + light.to_light, n);
            let toward = 1.0 - clamp(dot(at.to_eye, h), 0.0, 1.0);
            let toward2 = toward * toward;
            let fresnel = f0 + (1.0 - f0) * (toward2 * toward2 * toward);
            diffuse += diffuse_color * (1.0 - fresnel) * diffuse_response(n_l, lit, normal_width) * light.color;
            if n_l > 0.0 {
                let n_h = clamp(dot(n, h), 0.0, 1.0);
                let d = (1.0 - n_h) * (1.0 + n_h) + n_h * n_h * a2;
                var shape = a2 / (d * d) * smith_visibility(n_l, n_v, a2);
                if FAN_ANISOTROPY {
                    shape = anisotropic_shape(axes, n, h, light.to_light, at.to_eye);
                }
                specular += fresnel * (shape * n_l * lit) * light.color;
            }
        }
    }
    if FAN_LIGHT {
        return baked_light * diffuse_color + clamp(baked_light, vec3<f32>(0.0), vec3<f32>(1.0)) * specular;
    }
    return diffuse + specular;
}
