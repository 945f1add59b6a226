// Light from the surroundings: two colours, or an environment map.

// Whether the surroundings are an environment map.
override HAS_ENVIRONMENT: bool = false;

// Blurred levels beside the environment itself: level k is as a surface of roughness k / 8 reflects it.
const ENVIRONMENT_LEVELS: f32 = 8.0;

fn environment_direction(d: vec3<f32>) -> vec3<f32> {
    let c = frame.environment_cosine;
    let s = frame.environment_sine;
    return vec3<f32>(c * d.x + s * d.z, d.y, c * d.z - s * d.x);
}

fn blurred_environment(d: vec3<f32>, roughness: f32) -> vec3<f32> {
    let level = roughness * ENVIRONMENT_LEVELS;
    let fine = clamp(floor(level), 1.0, ENVIRONMENT_LEVELS - 1.0);
    let share = clamp(level - fine, 0.0, 1.0);
    let layer = i32(fine) - 1;
    let coarse_light = textureSampleLevel(environment_rough, smooth_sampler, d, layer, 0.0).rgb;
    var fine_light: vec3<f32>;
    if layer == 0 {
        fine_light = textureSampleLevel(environment_first, smooth_sampler, d, 0.0).rgb;
    } else {
        fine_light = textureSampleLevel(environment_rough, smooth_sampler, d, layer - 1, 0.0).rgb;
    }
    return mix(fine_light, coarse_light, share);
}

// The roughness whose lobe is as wide as that of `roughness` seen through a footprint.
fn roughness_with_footprint(roughness: f32, dx: vec3<f32>, dy: vec3<f32>) -> f32 {
    let width2 = 0.5 * (dot(dx, dx) + dot(dy, dy));
    let alpha = roughness * roughness;
    return min(sqrt(sqrt(alpha * alpha + min(width2, 4.0) / 24.0)), 1.0);
}

fn sharp_environment(d: vec3<f32>, dx: vec3<f32>, dy: vec3<f32>, roughness: f32) -> vec3<f32> {
    let lobe = roughness * roughness;
    var along_x = dx;
    var along_y = dy;
    if lobe * lobe > max(dot(dx, dx), dot(dy, dy)) {
        let side = unit_or(cross(d, select(vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(1.0, 0.0, 0.0), abs(d.y) > 0.9)), dx);
        along_x = side * lobe;
        along_y = cross(d, side) * lobe;
    }
    return textureSampleGrad(environment_sharp, smooth_sampler, d, along_x, along_y).rgb;
}

// Light around a unit direction of the world, gathered by a perceptual roughness; dx and dy are the changes of the
// direction along the pixel's edges.
fn environment_reflected(direction: vec3<f32>, dx: vec3<f32>, dy: vec3<f32>, roughness: f32) -> vec3<f32> {
    let d = environment_direction(direction);
    let ex = environment_direction(dx);
    let ey = environment_direction(dy);
    let first = 1.0 / ENVIRONMENT_LEVELS;
    var light = blurred_environment(d, roughness_with_footprint(max(roughness, first), ex, ey));
    if roughness < first {
        light = mix(sharp_environment(d, ex, ey, roughness), light, roughness * ENVIRONMENT_LEVELS);
    }
    return light * frame.environment_strength;
}

fn two_colors(direction: vec3<f32>) -> vec3<f32> {
    return mix(frame.ambient_ground, frame.ambient_sky, 0.5 + 0.5 * dot(direction, frame.ambient_up));
}

// What a white diffuse surface with a unit normal reflects.
fn ambient_diffuse(n: vec3<f32>) -> vec3<f32> {
    if !HAS_ENVIRONMENT {
        return two_colors(n);
    }
    let d = environment_direction(n);
    var sum = frame.harmonics[0].rgb * 0.2820948;
    sum += frame.harmonics[1].rgb * (0.4886025 * d.y);
    sum += frame.harmonics[2].rgb * (0.4886025 * d.z);
    sum += frame.harmonics[3].rgb * (0.4886025 * d.x);
    sum += frame.harmonics[4].rgb * (1.0925484 * d.x * d.y);
    sum += frame.harmonics[5].rgb * (1.0925484 * d.y * d.z);
    sum += frame.harmonics[6].rgb * (0.31539157 * (3.0 * d.z * d.z - 1.0));
    sum += frame.harmonics[7].rgb * (1.0925484 * d.x * d.z);
    sum += frame.harmonics[8].rgb * (0.5462742 * (d.x * d.x - d.y * d.y));
    return max(sum, vec3<f32>(0.0)) * frame.environment_strength;
}

// What a surface of a perceptual roughness gathers around the mirror direction of `to_eye`.
fn ambient_specular(n: vec3<f32>, n_dx: vec3<f32>, n_dy: vec3<f32>, to_eye: vec3<f32>, roughness: f32) -> vec3<f32> {
    let alpha = clamp(roughness * roughness, 0.0, 1.0);
    let n_v = dot(n, to_eye);
    let mirrored = n * (2.0 * n_v) - to_eye;
    if !HAS_ENVIRONMENT {
        return two_colors(unit_or(mix(mirrored, n, alpha), n));
    }
    let share = (1.0 - alpha) * (sqrt(1.0 - alpha) + alpha);
    let middle = unit_or(mix(n, mirrored, share), n);
    let dx = n * (2.0 * dot(n_dx, to_eye)) + n_dx * (2.0 * n_v);
    let dy = n * (2.0 * dot(n_dy, to_eye)) + n_dy * (2.0 * n_v);
    return environment_reflected(middle, dx, dy, roughness);
}
