// Fans of fantex: three look-ups in a sheet, blended, are the texture of the surface.
//
// uv0, uv1, uv2: TEXCOORD_0, TEXCOORD_1 and TEXCOORD_2, the places in the tiles of a triangle's three fans.
// corner: TEXCOORD_3, the first two barycentric coordinates.
// Sheets are filtered linearly and clamped; those of colours and light have a format of sRGB.

#ifndef FAN_SAMPLE
// A look-up; an engine's own macro, or SampleLevel where there are no derivatives, can stand here.
#define FAN_SAMPLE(sheet, sheetSampler, uv) sheet.Sample(sheetSampler, uv)
#endif

static const float FAN_DELTA = $DELTA;

// The share of each look-up; the three sum to one.
float3 FanWeights(float2 corner)
{
    float3 l = float3(corner, 1.0 - corner.x - corner.y);
    float3 a = max(l - max(l.yzx, l.zxy) + FAN_DELTA, 0.0);
    return a / (a.x + a.y + a.z);
}

// What a sheet shows.
float4 FanSample(Texture2D sheet, SamplerState sheetSampler, float2 uv0, float2 uv1, float2 uv2, float3 weights)
{
    return weights.x * FAN_SAMPLE(sheet, sheetSampler, uv0)
        + weights.y * FAN_SAMPLE(sheet, sheetSampler, uv1)
        + weights.z * FAN_SAMPLE(sheet, sheetSampler, uv2);
}

// The unit normal in object space, from the sheet of normals.
float3 FanNormal(Texture2D sheet, SamplerState sheetSampler, float2 uv0, float2 uv1, float2 uv2, float3 weights)
{
    return normalize(FanSample(sheet, sheetSampler, uv0, uv1, uv2, weights).xyz * 2.0 - 1.0);
}
