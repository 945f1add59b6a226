// Fans of fantex: three look-ups in a sheet, blended, are the texture of the surface.
//
// uv0, uv1, uv2: TEXCOORD_0, TEXCOORD_1 and TEXCOORD_2, the places in the tiles of a triangle's three fans.
// corner: TEXCOORD_3, the first two barycentric coordinates.
// Sheets are filtered linearly and clamped; those of colours and light are sRGB textures.

const float FAN_DELTA = $DELTA;

// The share of each look-up; the three sum to one.
vec3 fan_weights(vec2 corner) {
    vec3 l = vec3(corner, 1.0 - corner.x - corner.y);
    vec3 a = max(l - max(l.yzx, l.zxy) + vec3(FAN_DELTA), vec3(0.0));
    return a / (a.x + a.y + a.z);
}

// What a sheet shows.
vec4 fan_sample(sampler2D sheet, vec2 uv0, vec2 uv1, vec2 uv2, vec3 weights) {
    return weights.x * texture(sheet, uv0) + weights.y * texture(sheet, uv1) + weights.z * texture(sheet, uv2);
}

// The unit normal in object space, from the sheet of normals.
vec3 fan_normal(sampler2D sheet, vec2 uv0, vec2 uv1, vec2 uv2, vec3 weights) {
    return normalize(fan_sample(sheet, uv0, uv1, uv2, weights).xyz * 2.0 - vec3(1.0));
}
