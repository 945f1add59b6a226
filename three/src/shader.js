// The texture function in GLSL: the groups that have weight at a fragment, their tiles' levels, the places of these in the atlas.
//
// The rules are those of `fan_lookup.wgsl` and `fan.wgsl` in fantex-gpu. Defines: FAN_BASE_COLOR, FAN_NORMAL, FAN_MATERIAL, FAN_EMISSION,
// FAN_LIGHT for channels that are there; FAN_UNLIT where the base colour is the picture; FAN_PAGED where tiles may be cut into several pages;
// FAN_SINGLE_TILE where triangles lie in one tile each; FAN_ANISOTROPIC, else trilinear. `shaderNodes.js` says the same in three's language.

/** Declarations of the vertex shader. */
export const VERTEX_DECLARATIONS = /* glsl */ `
in vec4 fanUv01;
in vec2 fanUv2;
in uvec3 fanGroups;
in vec4 fanCorner;
// Per group: number of its first page; quarters of its columns and (<< 16) rows at level 0.
uniform usampler2D fanGroupTable;
out vec4 vFanUv01;
// Place in the third tile; barycentric coordinates of the first two corners.
out vec4 vFanUv2Lambda;
// Object space.
out vec3 vFanNormal;
flat out uvec3 vFanGroups;
flat out uvec4 vFanRecords01;
flat out uvec2 vFanRecord2;

uvec2 fanRecord(uint group) {
    return texelFetch(fanGroupTable, ivec2(group & 4095u, group >> 12u), 0).xy;
}
`;

/** Statements of the vertex shader's main function. */
export const VERTEX_STATEMENTS = /* glsl */ `
vFanUv01 = fanUv01;
vFanUv2Lambda = vec4(fanUv2, fanCorner.xy);
vFanNormal = normal;
vFanGroups = fanGroups;
vFanRecords01 = uvec4(fanRecord(fanGroups.x), fanRecord(fanGroups.y));
vFanRecord2 = fanRecord(fanGroups.z);
`;

const UNIFORMS = /* glsl */ `
in vec4 vFanUv01;
in vec4 vFanUv2Lambda;
in vec3 vFanNormal;
flat in uvec3 vFanGroups;
flat in uvec4 vFanRecords01;
flat in uvec2 vFanRecord2;

#if defined(FAN_NORMAL) && !defined(USE_NORMALMAP_OBJECTSPACE)
uniform mat3 normalMatrix;
#endif

// A word per page: zero where there is nothing, else quarters of a place in the atlas: column, row << 12, and 1 << 31; in tiles of one page
// per level also how many levels coarser it is << 24.
uniform usampler2D fanPages;
// Per group and channel.
uniform sampler2D fanMeans;
// Two texels per group: the projection direction and the first part of the x axis; the rest of it.
uniform sampler2D fanFrames;
// One over the atlas' sides in texels.
uniform vec2 fanAtlasScale;
uniform float fanDelta;
uniform float fanMaxAnisotropy;
// Channels of the means; per kind of channel its number among them.
uniform uint fanChannels;
uniform uvec4 fanMeanOf;
uniform uint fanMeanOfLight;
uniform float fanOcclusionIntensity;
uniform sampler2D fanBaseColor;
uniform sampler2D fanNormalMap;
uniform sampler2D fanMaterial;
uniform sampler2D fanEmission;
uniform sampler2D fanLight;
`;

const LOOKUP = /* glsl */ `
const float FAN_FADE_TEXELS = 8.0;
// Tiles along a footprint at most.
const float FAN_MAX_FOOTPRINT = 16384.0;

struct FanTile {
    vec4 baseColor;
    vec4 material;
    vec4 emission;
    vec4 light;
    vec2 normal;
};

struct FanGroup {
    uint firstPage;
    uvec2 quarters;
};

FanGroup fanGroup(uvec2 record) {
    return FanGroup(record.x, uvec2(record.y & 0xFFFFu, record.y >> 16u));
}

// The last level is the first whose longer side is 4.
uint fanLastLevel(FanGroup group) {
    uint n = max(group.quarters.x, group.quarters.y) * 2u / 3u;
    // The exponent of a float is the place of the highest bit.
    return n == 0u ? 0u : uint((floatBitsToInt(float(n)) >> 23) - 126);
}

// Halved per level, rounded to the nearest multiple of 4 (halves up), at least 4.
uvec2 fanLevelExtent(FanGroup group, uint level) {
    uint halfUnit = (1u << level) >> 1u;
    return max((group.quarters + halfUnit) >> level, uvec2(1u)) * 4u;
}

// The footprint of a pixel in tile coordinates: the matrix J J^T of the derivatives, and the determinant of J.
struct FanFootprint {
    float xx;
    float xy;
    float yy;
    float determinant;
};

// Derivatives of triangles that are seen edge-on may be infinite, or no numbers.
vec2 fanBounded(vec2 derivative) {
    vec2 held = clamp(derivative, vec2(-FAN_MAX_FOOTPRINT), vec2(FAN_MAX_FOOTPRINT));
    return vec2(isnan(derivative.x) ? 0.0 : held.x, isnan(derivative.y) ? 0.0 : held.y);
}

FanFootprint fanFootprint(vec2 unboundedDx, vec2 unboundedDy) {
    vec2 dx = fanBounded(unboundedDx);
    vec2 dy = fanBounded(unboundedDy);
    return FanFootprint(
        dx.x * dx.x + dy.x * dy.x,
        dx.x * dx.y + dy.x * dy.y,
        dx.y * dx.y + dy.y * dy.y,
        abs(dx.x * dy.y - dx.y * dy.x));
}

// Squares of the longer axis, of the shorter axis as the anisotropy limits it, and the direction of the longer one (not normalised), in
// texels of an extent.
struct FanAxes {
    float major2;
    float minor2;
    vec2 direction;
};

FanAxes fanAxes(FanFootprint f, vec2 extent) {
    float xx = f.xx * extent.x * extent.x;
    float yy = f.yy * extent.y * extent.y;
    float xy = f.xy * extent.x * extent.y;
    float halfDifference = 0.5 * (xx - yy);
    float root = sqrt(halfDifference * halfDifference + xy * xy);
    float major2 = 0.5 * (xx + yy) + root;
    float determinant = f.determinant * extent.x * extent.y;
    float minor2 = determinant * determinant / max(major2, 1e-30);
    vec2 direction = halfDifference >= 0.0 ? vec2(halfDifference + root, xy) : vec2(xy, root - halfDifference);
    return FanAxes(major2, max(minor2, major2 / (fanMaxAnisotropy * fanMaxAnisotropy)), direction);
}

// Square of the pixel's width in texels of an extent.
float fanSquaredWidth(FanFootprint f, vec2 extent) {
    FanAxes a = fanAxes(f, extent);
#ifdef FAN_ANISOTROPIC
    return a.minor2;
#else
    return a.major2;
#endif
}

struct FanLevels {
    // The finer level; the one after it (after the last: the mean) has the share coarseShare.
    uint fine;
    float coarseShare;
};

// The levels between which the pixel is one texel wide: the finer one is the last level in which it is wider than a texel. The exponent of
// the finest level's width is a guess, from which the rest is a walk of few steps.
FanLevels fanChooseLevels(FanGroup group, FanFootprint f) {
    uint last = fanLastLevel(group);
    float finest = fanSquaredWidth(f, vec2(group.quarters * 4u));
    uint fine = uint(clamp((floatBitsToInt(finest) - 0x3F800000) >> 24, 0, int(last)));
    float here = fanSquaredWidth(f, vec2(fanLevelExtent(group, fine)));
    float next = fanSquaredWidth(f, vec2(fanLevelExtent(group, fine + 1u)));
    for (int i = 0; i < 20; i++) {
        if (here <= 1.0 && fine > 0u) {
            fine -= 1u;
            next = here;
            here = fanSquaredWidth(f, vec2(fanLevelExtent(group, fine)));
        } else if (here > 1.0 && next > 1.0 && fine < last) {
            fine += 1u;
            here = next;
            next = fanSquaredWidth(f, vec2(fanLevelExtent(group, fine + 1u)));
        } else {
            break;
        }
    }
    // After the last level comes the mean, as if it had a quarter of the texels along each side.
    if (fine >= last) next = here * 0.0625;
    float wide = log2(here);
    float share = clamp(wide / (wide - log2(next)), 0.0, 1.0);
    return FanLevels(fine, here <= 1.0 ? 0.0 : share);
}

struct FanProbes {
    int count;
    // The way, in tile coordinates, that they are spread over.
    vec2 span;
};

FanProbes fanChooseProbes(FanGroup group, FanFootprint f) {
#ifdef FAN_ANISOTROPIC
    vec2 extent = vec2(group.quarters * 4u);
    FanAxes finest = fanAxes(f, extent);
    float major = sqrt(finest.major2);
    float count = clamp(ceil(major / max(sqrt(finest.minor2), 1.0)), 1.0, 64.0);
    float length2 = dot(finest.direction, finest.direction);
    vec2 direction = length2 > 0.0 ? finest.direction * inversesqrt(length2) : vec2(1.0, 0.0);
    return FanProbes(int(count), direction * major / extent);
#else
    return FanProbes(1, vec2(0.0));
#endif
}

uint fanWord(uint page) {
    return texelFetch(fanPages, ivec2(page & 4095u, page >> 12u), 0).x;
}

// Levels between a page and the one that stands for it.
uint fanLevelsCoarser(uint word) {
    return (word >> 24u) & 0x7Fu;
}

// First texel of a resident page.
vec2 fanPlace(uint word) {
    return vec2(uvec2(word & 0xFFFu, (word >> 12u) & 0xFFFu) * 4u);
}

// Adds a bilinear look-up at a position in the atlas, in texels.
void fanTap(inout FanTile sum, vec2 place, float weight) {
    vec2 at = place * fanAtlasScale;
#ifdef FAN_BASE_COLOR
    sum.baseColor += weight * textureLod(fanBaseColor, at, 0.0);
#endif
#ifdef FAN_NORMAL
    sum.normal += weight * textureLod(fanNormalMap, at, 0.0).xy;
#endif
#ifdef FAN_MATERIAL
    sum.material += weight * textureLod(fanMaterial, at, 0.0);
#endif
#ifdef FAN_EMISSION
    sum.emission += weight * textureLod(fanEmission, at, 0.0);
#endif
#ifdef FAN_LIGHT
    sum.light += weight * textureLod(fanLight, at, 0.0);
#endif
}

vec4 fanMean(uint index) {
    return texelFetch(fanMeans, ivec2(index & 4095u, index >> 12u), 0);
}

void fanAddMean(inout FanTile sum, uint group, float weight) {
    uint first = group * fanChannels;
#ifdef FAN_BASE_COLOR
    sum.baseColor += weight * fanMean(first + fanMeanOf.x);
#endif
#ifdef FAN_NORMAL
    sum.normal += weight * fanMean(first + fanMeanOf.y).xy;
#endif
#ifdef FAN_MATERIAL
    sum.material += weight * fanMean(first + fanMeanOf.z);
#endif
#ifdef FAN_EMISSION
    sum.emission += weight * fanMean(first + fanMeanOf.w);
#endif
#ifdef FAN_LIGHT
    sum.light += weight * fanMean(first + fanMeanOfLight);
#endif
}

// Half a texel inside a level, in its texels.
vec2 fanHeldInside(vec2 uv, vec2 extent) {
    return clamp(uv * extent, vec2(0.5), extent - 0.5);
}

// Of a tile whose levels have one page each. Returns the weight that nothing resident takes.
float fanAddLevels(inout FanTile sum, FanGroup group, FanLevels levels, FanProbes probes, vec2 uv) {
    uint fineWord = fanWord(group.firstPage + levels.fine);
    // The finest resident level of the coarser ones, if there is one.
    uint coarseWord = levels.fine < fanLastLevel(group) ? fanWord(group.firstPage + levels.fine + 1u) : 0u;
    uint coarseLevel = levels.fine + 1u + fanLevelsCoarser(coarseWord);
    bool hasFine = fineWord != 0u && fanLevelsCoarser(fineWord) == 0u;
    float fineWeight = hasFine ? 1.0 - levels.coarseShare : 0.0;
    float coarseWeight = coarseWord != 0u ? 1.0 - fineWeight : 0.0;
    vec2 fineExtent = vec2(fanLevelExtent(group, levels.fine));
    vec2 coarseExtent = vec2(fanLevelExtent(group, coarseLevel));
    float perProbe = 1.0 / float(probes.count);
    for (int i = 0; i < probes.count; i++) {
        vec2 at = uv + probes.span * ((float(i) + 0.5) * perProbe - 0.5);
        if (fineWeight > 0.0) {
            fanTap(sum, fanPlace(fineWord) + fanHeldInside(at, fineExtent), fineWeight * perProbe);
        }
        if (coarseWeight > 0.0) {
            fanTap(sum, fanPlace(coarseWord) + fanHeldInside(at, coarseExtent), coarseWeight * perProbe);
        }
    }
    return 1.0 - fineWeight - coarseWeight;
}

#ifdef FAN_PAGED
// A level of a tile: its texels, its pages.
struct FanLevel {
    uvec2 extent;
    uint firstPage;
    uint pageColumns;
};

FanLevel fanTileLevel(FanGroup group, uint level) {
    uint first = group.firstPage;
    for (uint l = 0u; l < level; l++) {
        uvec2 pages = (fanLevelExtent(group, l) + 255u) >> 8u;
        first += pages.x * pages.y;
    }
    uvec2 extent = fanLevelExtent(group, level);
    return FanLevel(extent, first, (extent.x + 255u) >> 8u);
}

// Of a page itself, whatever stands for it; 0 where it is not resident.
uint fanEntry(FanLevel level, uvec2 page) {
    uint word = fanWord(level.firstPage + page.y * level.pageColumns + page.x);
    return fanLevelsCoarser(word) != 0u ? 0u : word;
}

// The share of a level at a position in one of its pages, 1 where all that a look-up reads is resident. It falls to nothing before a look-up
// touches a page that is not, so that the picture is continuous whatever is resident.
float fanResidency(FanLevel level, uvec2 page, vec2 local) {
    // Towards the nearer neighbours; at the tile's own border there is none.
    bvec2 after = greaterThan(local, vec2(128.0));
    uvec2 pages = (level.extent + 255u) >> 8u;
    bool right = after.x ? page.x + 1u < pages.x : page.x > 0u;
    bool down = after.y ? page.y + 1u < pages.y : page.y > 0u;
    vec2 near = vec2(after.x ? 256.0 - local.x : local.x, after.y ? 256.0 - local.y : local.y);
    near = vec2(right ? near.x : 1e9, down ? near.y : 1e9);
    vec2 rise = clamp((near - 0.5) / FAN_FADE_TEXELS, vec2(0.0), vec2(1.0));
    uvec2 neighbour = uvec2(after.x ? page.x + 1u : page.x - 1u, after.y ? page.y + 1u : page.y - 1u);
    float share = fanEntry(level, page) != 0u ? 1.0 : 0.0;
    if (rise.x < 1.0 && fanEntry(level, uvec2(neighbour.x, page.y)) == 0u) share = min(share, rise.x);
    if (rise.y < 1.0 && fanEntry(level, uvec2(page.x, neighbour.y)) == 0u) share = min(share, rise.y);
    if (max(rise.x, rise.y) < 1.0 && fanEntry(level, neighbour) == 0u) share = min(share, max(rise.x, rise.y));
    return share;
}

// The same for any tile. A look-up across the border of pages is made of single texels, each from its own page.
float fanAddPagedLevels(inout FanTile sum, FanGroup group, FanLevels levels, FanProbes probes, vec2 uv) {
    uint last = fanLastLevel(group);
    float perProbe = 1.0 / float(probes.count);
    float left = 1.0 - levels.coarseShare;
    float coarse = levels.coarseShare;
    for (uint index = levels.fine; index <= last; index++) {
        FanLevel level = fanTileLevel(group, index);
        vec2 extent = vec2(level.extent);
        float taken = 0.0;
        for (int probe = 0; probe < probes.count; probe++) {
            vec2 at = uv + probes.span * ((float(probe) + 0.5) * perProbe - 0.5);
            vec2 position = fanHeldInside(at, extent);
            uvec2 page = uvec2(position) >> 8u;
            vec2 local = position - vec2(page << 8u);
            float share = fanResidency(level, page, local);
            if (share <= 0.0) continue;
            float weight = left * perProbe * share;
            taken += weight;
            if (all(greaterThanEqual(local, vec2(0.5))) && all(lessThanEqual(local, vec2(255.5)))) {
                fanTap(sum, fanPlace(fanEntry(level, page)) + local, weight);
                continue;
            }
            vec2 first = floor(position - 0.5);
            vec2 fraction = position - 0.5 - first;
            for (uint texel = 0u; texel < 4u; texel++) {
                uvec2 corner = uvec2(texel & 1u, texel >> 1u);
                uvec2 single = uvec2(first) + corner;
                vec2 portions = mix(1.0 - fraction, fraction, vec2(corner));
                float portion = portions.x * portions.y;
                if (portion > 0.0) {
                    vec2 place = fanPlace(fanEntry(level, single >> 8u));
                    fanTap(sum, place + vec2(single & 255u) + 0.5, weight * portion);
                }
            }
        }
        // What rounding leaves over is none.
        left = (left - taken < 1e-5 ? 0.0 : left - taken) + coarse;
        coarse = 0.0;
        if (left <= 0.0) break;
    }
    return left;
}
#endif

// All channels of a tile at tile coordinates with their derivatives per pixel. Each of the two levels, the finer first, takes the share of its
// weight that is resident and hands on the rest to the next coarser one; the mean takes what is left.
FanTile fanSample(uint groupIndex, uvec2 record, vec2 uv, vec2 dx, vec2 dy) {
    FanGroup group = fanGroup(record);
    FanFootprint pixel = fanFootprint(dx, dy);
    FanLevels levels = fanChooseLevels(group, pixel);
    FanProbes probes = fanChooseProbes(group, pixel);
    FanTile sum = FanTile(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec2(0.0));
    float left;
#ifdef FAN_PAGED
    if (max(group.quarters.x, group.quarters.y) > 64u) {
        left = fanAddPagedLevels(sum, group, levels, probes, uv);
    } else {
        left = fanAddLevels(sum, group, levels, probes, uv);
    }
#else
    left = fanAddLevels(sum, group, levels, probes, uv);
#endif
    if (left > 0.0) fanAddMean(sum, groupIndex, left);
    return sum;
}
`;

const BLEND = /* glsl */ `
vec3 fanUnitOr(vec3 v, vec3 otherwise) {
    float length2 = dot(v, v);
    return length2 > 1e-12 ? v * inversesqrt(length2) : otherwise;
}

#ifdef FAN_NORMAL
// The x axis of a tile's shading frame, object space: the smallest rotation that takes the projection direction to the vertex normal turns it.
vec3 fanShadingAxis(uint group, vec3 vertexNormal) {
    uint texel = 2u * group;
    ivec2 at = ivec2(texel & 4095u, texel >> 12u);
    vec4 first = texelFetch(fanFrames, at, 0);
    vec4 second = texelFetch(fanFrames, at + ivec2(1, 0), 0);
    vec3 d = first.xyz;
    vec3 x = vec3(first.w, second.xy);
    vec3 turned = x - (d + vertexNormal) * (dot(x, vertexNormal) / max(1.0 + dot(d, vertexNormal), 1e-4));
    vec3 otherwise = abs(vertexNormal.x) > 0.8 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
    return fanUnitOr(turned - vertexNormal * dot(turned, vertexNormal), otherwise);
}

// A stored normal in object space.
vec3 fanObjectNormal(vec2 stored, vec3 xAxis, vec3 vertexNormal) {
    vec3 yAxis = cross(vertexNormal, xAxis);
    vec2 xy = stored * 2.0 - 1.0;
    float z = sqrt(max(1.0 - dot(xy, xy), 0.0));
    return fanUnitOr(xAxis * xy.x + yAxis * xy.y + vertexNormal * z, vertexNormal);
}
#endif

// Weights of the groups at a triangle's corners: corners of the same group count as the first of them.
vec3 fanWeights(uvec3 groups, vec3 lambda) {
    vec3 w = max(lambda - max(lambda.yzx, lambda.zxy) + fanDelta, vec3(0.0));
    w /= w.x + w.y + w.z;
    if (groups.x == groups.y) w = vec3(w.x + w.y, 0.0, w.z);
    if (groups.x == groups.z) w = vec3(w.x + w.z, w.y, 0.0);
    if (groups.y == groups.z) w = vec3(w.x, w.y + w.z, 0.0);
    return w;
}

// The texture function at a fragment.
struct FanSurface {
    vec4 baseColor;
    // Occlusion, roughness, metallic.
    vec3 material;
    vec3 emission;
    // Irradiance over pi that was baked.
    vec3 light;
    // Object space, the front's.
    vec3 normal;
};

void fanAddTile(inout FanSurface surface, float weight, uint group, uvec2 record, vec2 uv, vec2 dx, vec2 dy, vec3 vertexNormal) {
    FanTile tile = fanSample(group, record, uv, dx, dy);
    surface.baseColor += weight * tile.baseColor;
    surface.material += weight * tile.material.rgb;
    surface.emission += weight * tile.emission.rgb;
    surface.light += weight * tile.light.rgb;
#ifdef FAN_NORMAL
    surface.normal += weight * fanObjectNormal(tile.normal, fanShadingAxis(group, vertexNormal), vertexNormal);
#endif
}

FanSurface fanSurface() {
    vec4 dx01 = dFdx(vFanUv01);
    vec4 dy01 = dFdy(vFanUv01);
    vec3 vertexNormal = normalize(vFanNormal);
    FanSurface surface = FanSurface(vec4(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
#ifdef FAN_SINGLE_TILE
    fanAddTile(surface, 1.0, vFanGroups.x, vFanRecords01.xy, vFanUv01.xy, dx01.xy, dy01.xy, vertexNormal);
#else
    vec2 dx2 = dFdx(vFanUv2Lambda.xy);
    vec2 dy2 = dFdy(vFanUv2Lambda.xy);
    vec2 lambda01 = vFanUv2Lambda.zw;
    vec3 w = fanWeights(vFanGroups, max(vec3(lambda01, 1.0 - lambda01.x - lambda01.y), vec3(0.0)));
    for (int slot = 0; slot < 3; slot++) {
        float weight = slot == 0 ? w.x : slot == 1 ? w.y : w.z;
        if (weight <= 0.0) continue;
        vec2 uv = slot == 0 ? vFanUv01.xy : slot == 1 ? vFanUv01.zw : vFanUv2Lambda.xy;
        vec2 dx = slot == 0 ? dx01.xy : slot == 1 ? dx01.zw : dx2;
        vec2 dy = slot == 0 ? dy01.xy : slot == 1 ? dy01.zw : dy2;
        uvec2 record = slot == 0 ? vFanRecords01.xy : slot == 1 ? vFanRecords01.zw : vFanRecord2;
        uint group = slot == 0 ? vFanGroups.x : slot == 1 ? vFanGroups.y : vFanGroups.z;
        fanAddTile(surface, weight, group, record, uv, dx, dy, vertexNormal);
    }
#endif
    return surface;
}
`;

/** Declarations of the fragment shader. */
export const FRAGMENT_DECLARATIONS = UNIFORMS + LOOKUP + BLEND;

/** Statements at the beginning of the fragment shader's main function. */
export const FRAGMENT_STATEMENTS = /* glsl */ `
FanSurface fan = fanSurface();
`;

/** What stands in the place of three's chunks in fragment shaders. */
export const FRAGMENT_CHUNKS = {
    "#include <map_fragment>": /* glsl */ `
#ifdef FAN_BASE_COLOR
    diffuseColor *= vec4(max(fan.baseColor.rgb, vec3(0.0)), clamp(fan.baseColor.a, 0.0, 1.0));
#endif
#if defined(FAN_LIGHT) && defined(FAN_UNLIT)
    diffuseColor.rgb *= max(fan.light, vec3(0.0));
#endif
#include <map_fragment>
`,
    "#include <roughnessmap_fragment>": /* glsl */ `
#include <roughnessmap_fragment>
#ifdef FAN_MATERIAL
    roughnessFactor *= clamp(fan.material.g, 0.0, 1.0);
#endif
`,
    "#include <metalnessmap_fragment>": /* glsl */ `
#include <metalnessmap_fragment>
#ifdef FAN_MATERIAL
    metalnessFactor *= clamp(fan.material.b, 0.0, 1.0);
#endif
`,
    "#include <normal_fragment_maps>": /* glsl */ `
#ifdef FAN_NORMAL
    normal = fanUnitOr(normalMatrix * fanUnitOr(fan.normal, normalize(vFanNormal)), normal);
    #ifdef FLIP_SIDED
        normal = -normal;
    #endif
    #ifdef DOUBLE_SIDED
        normal *= faceDirection;
    #endif
#endif
#include <normal_fragment_maps>
`,
    "#include <emissivemap_fragment>": /* glsl */ `
#ifdef FAN_EMISSION
    totalEmissiveRadiance *= max(fan.emission, vec3(0.0));
#endif
#include <emissivemap_fragment>
`,
    "#include <lights_fragment_maps>": /* glsl */ `
#ifdef FAN_LIGHT
    irradiance += max(fan.light, vec3(0.0)) * PI;
#endif
#include <lights_fragment_maps>
`,
    // As three's own chunk, with the channel in the place of the map.
    "#include <aomap_fragment>": /* glsl */ `
#if defined(FAN_MATERIAL) && defined(STANDARD)
    float ambientOcclusion = (clamp(fan.material.r, 0.0, 1.0) - 1.0) * fanOcclusionIntensity + 1.0;
    reflectedLight.indirectDiffuse *= ambientOcclusion;
    #ifdef USE_CLEARCOAT
        clearcoatSpecularIndirect *= ambientOcclusion;
    #endif
    #ifdef USE_SHEEN
        sheenSpecularIndirect *= ambientOcclusion;
    #endif
    #ifdef USE_ENVMAP
        float dotNV = saturate(dot(geometryNormal, geometryViewDir));
        reflectedLight.indirectSpecular *= computeSpecularOcclusion(dotNV, ambientOcclusion, material.roughness);
    #endif
#endif
#include <aomap_fragment>
`,
};
