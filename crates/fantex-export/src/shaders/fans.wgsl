// Fans of fantex: three look-ups in a sheet, blended, are the texture of the surface.
//
// uv0, uv1, uv2: TEXCOORD_0, TEXCOORD_1 and TEXCOORD_2, the places in the tiles of a triangle's three fans.
// corner: TEXCOORD_3, the first two barycentric coordinates.
// Sheets are filtered linearly and clamped; those of colours and light have a format of sRGB.

const FAN_DELTA: f32 = $DELTA;

// The share of each look-up; the three sum to one.
fn fan_weights(corner: vec2<f32>) -> vec3<f32> {
    let l = vec3<f32>(corner, 1.0 - corner.x - corner.y);
    let a = max(l - max(l.yzx, l.zxy) + FAN_DELTA, vec3<f32>(0.0));
    return a / (a.x + a.y + a.z);
}

// What a sheet shows.
fn fan_sample(
    sheet: texture_2d<f32>,
    sheet_sampler: sampler,
    uv0: vec2<f32>,
    uv1: vec2<f32>,
    uv2: vec2<f32>,
    weights: vec3<f32>,
) -> vec4<f32> {
    return weights.x * textureSample(sheet, sheet_sampler, uv0)
        + weights.y * textureSample(sheet, sheet_sampler, uv1)
        + weights.z * textureSample(sheet, sheet_sampler, uv2);
}

// The unit normal in object space, from the sheet of normals.
fn fan_normal(
    sheet: texture_2d<f32>,
    sheet_sampler: sampler,
    uv0: vec2<f32>,
    uv1: vec2<f32>,
    uv2: vec2<f32>,
    weights: vec3<f32>,
) -> vec3<f32> {
    return normalize(fan_sample(sheet, sheet_sampler, uv0, uv1, uv2, weights).xyz * 2.0 - 1.0);
}
