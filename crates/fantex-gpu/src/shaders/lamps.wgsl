// Light from lamps: what arrives at a point, and what shadow maps leave of it.

// Whether any lamp casts shadows.
override HAS_SHADOWS: bool = false;

// Half the least width of the shadow filter, in texels.
const MIN_RADIUS: f32 = 1.25;

// Most texels along each side of the filter that are asked; larger filters ask one of each cell of 2^level texels.
const MAX_TAPS: f32 = 16.0;

// Texels along each side of the filter from which on the cells of the next level are asked, too: all the more, the larger the
// filter, so that nothing jumps where the level does.
const BLENDED_TAPS: f32 = 12.0;

// Largest tangent of the angle between light and normal for which a receiver's plane is followed.
const STEEPEST: f32 = 12.0;

// Where a fragment lies.
struct SurfacePoint {
    // Mesh space.
    position: vec3<f32>,
    // Change of the position along the pixel's edges.
    position_dx: vec3<f32>,
    position_dy: vec3<f32>,
    to_eye: vec3<f32>,
    // Unit normals on the side that is seen: of the facet, and interpolated without relief.
    facet_normal: vec3<f32>,
    vertex_normal: vec3<f32>,
}

// From the offset from the eye, interpolated at the pixel's centre (not centroid, whose differences mean nothing along a
// triangle's edges: they would show as wrong shadows), and the interpolated normal of the front side. To be called where all
// fragments of a quad are.
fn surface_point(offset: vec3<f32>, front_normal: vec3<f32>, front: bool) -> SurfacePoint {
    var at: SurfacePoint;
    at.position = frame.eye + offset;
    at.position_dx = dpdx(offset);
    at.position_dy = dpdy(offset);
    at.to_eye = unit_or(-offset, vec3<f32>(0.0, 0.0, 1.0));
    let facet = unit_or(cross(at.position_dy, at.position_dx), at.to_eye);
    at.facet_normal = select(-facet, facet, dot(facet, at.to_eye) >= 0.0);
    let side = select(-1.0, 1.0, front);
    at.vertex_normal = unit_or(front_normal, at.facet_normal * side) * side;
    return at;
}

// Light of one lamp at a point.
struct Incoming {
    to_light: vec3<f32>,
    // Without shadow.
    color: vec3<f32>,
}

fn falloff(lamp_index: u32, distance_mesh: f32) -> f32 {
    let inverse_reference = lamps[lamp_index].inverse_reference;
    if inverse_reference <= 0.0 {
        return 1.0;
    }
    let distance = distance_mesh * frame.world_per_mesh;
    let in_range = distance * lamps[lamp_index].inverse_range;
    let squared = in_range * in_range;
    let window = clamp(1.0 - squared * squared, 0.0, 1.0);
    let relative = max(distance * inverse_reference, 1e-3);
    return window / (relative * relative);
}

// The share of the footprint's bounding box that lies in the unit square.
fn share_inside(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> f32 {
    let half = max(0.5 * (abs(dx) + abs(dy)), vec2<f32>(1e-6));
    let inside = max((min(uv + half, vec2<f32>(1.0)) - max(uv - half, vec2<f32>(0.0))) / (2.0 * half), vec2<f32>(0.0));
    return inside.x * inside.y;
}

fn cookie_light(lamp_index: u32, at: SurfacePoint) -> vec3<f32> {
    let view = lamps[lamp_index].cookie_from_mesh;
    let h = view * vec4<f32>(at.position, 1.0);
    if h.z <= 0.0 || h.w <= 0.0 {
        return vec3<f32>(0.0);
    }
    let uv = h.xy / h.z;
    let hx = view * vec4<f32>(at.position_dx, 0.0);
    let hy = view * vec4<f32>(at.position_dy, 0.0);
    let dx = (hx.xy - uv * hx.z) / h.z;
    let dy = (hy.xy - uv * hy.z) / h.z;
    let share = share_inside(uv, dx, dy);
    let inside = clamp(uv, vec2<f32>(0.0), vec2<f32>(1.0));
    // Cookies hold colour times alpha.
    return textureSampleGrad(cookies, smooth_sampler, inside, lamps[lamp_index].cookie, dx, dy).rgb * share;
}

fn incoming(lamp_index: u32, at: SurfacePoint) -> Incoming {
    let kind = lamps[lamp_index].kind;
    var light: Incoming;
    light.color = lamps[lamp_index].color;
    light.to_light = lamps[lamp_index].direction;
    if kind == 0u {
        return light;
    }
    let way = lamps[lamp_index].position - at.position;
    if kind == 4u {
        light.to_light = -lamps[lamp_index].direction;
        let depth = -dot(way, lamps[lamp_index].direction);
        light.color *= cookie_light(lamp_index, at) * falloff(lamp_index, depth);
        return light;
    }
    light.to_light = unit_or(way, vec3<f32>(0.0, 1.0, 0.0));
    light.color *= falloff(lamp_index, length(way));
    if kind == 2u {
        let cosine = -dot(light.to_light, lamps[lamp_index].direction);
        let ramp = clamp((cosine - lamps[lamp_index].cosine_outer) * lamps[lamp_index].inverse_cosine_range, 0.0, 1.0);
        light.color *= ramp * ramp;
    } else if kind == 3u {
        light.color *= cookie_light(lamp_index, at);
    }
    return light;
}

// A receiver in the terms of a shadow map. Its `nearness` is what the map stores, as `FittedView` has it: near / depth, or where
// light is parallel the distance from the far end over the whole depth; both are linear over the map on every plane.
struct Asked {
    // In texels.
    at: vec2<f32>,
    depth: f32,
    nearness: f32,
    // Change of the nearness per texel along the receiver's plane.
    slope: vec2<f32>,
}

// What a box covers along one axis of a map.
struct Span {
    low: f32,
    high: f32,
    side: u32,
    // Cells have 2^level texels: so many that no more than MAX_TAPS are covered.
    level: u32,
    // Share of the cells of the next level, 0..1.
    blend: f32,
}

fn span(middle: f32, radius: f32, side: u32) -> Span {
    var s: Span;
    s.low = middle - radius;
    s.high = middle + radius;
    s.side = side;
    s.level = 0u;
    var taps = 2.0 * radius;
    // Beyond the map there is nothing to ask.
    while taps > MAX_TAPS && (1u << s.level) < side {
        taps *= 0.5;
        s.level += 1u;
    }
    s.blend = clamp((taps - BLENDED_TAPS) / (MAX_TAPS - BLENDED_TAPS), 0.0, 1.0);
    return s;
}

// The cell at a place. Cells lie fixed in the map.
fn cell_at(s: Span, place: f32, level: u32) -> u32 {
    return min(u32(max(place, 0.0)), s.side - 1u) >> level;
}

// How many texels of a cell the box covers.
fn covered(s: Span, cell: u32, level: u32) -> f32 {
    let first = f32(cell << level);
    let end = f32(min((cell + 1u) << level, s.side));
    return max(min(s.high, end) - max(s.low, first), 0.0);
}

// The texel that stands for a cell along one axis: another one in each of neighbouring rows of cells (`beside` is the cell's
// place along the other axis), so that edges along an axis are as smooth as others (J. van der Corput's sequence).
fn texel_of(cell: u32, level: u32, beside: u32, side: u32) -> u32 {
    let within = (reverseBits(beside) >> (31u - level)) >> 1u;
    return min((cell << level) + within, side - 1u);
}

// Over the filter's box: x the weight of texels that hide the receiver, y their depth times weight, z all weight.
fn blockers(face: u32, asked: Asked, radius: vec2<f32>) -> vec3<f32> {
    let side = u32(shadow_faces[face].resolution);
    let layer = shadow_faces[face].layer;
    let first = shadow_faces[face].at;
    let columns = span(asked.at.x, radius.x, side);
    let rows = span(asked.at.y, radius.y, side);
    var sum = vec3<f32>(0.0);
    for (var pass_index = 0u; pass_index < 4u; pass_index += 1u) {
        let up = vec2<u32>(pass_index & 1u, pass_index >> 1u);
        let share = select(1.0 - columns.blend, columns.blend, up.x == 1u)
            * select(1.0 - rows.blend, rows.blend, up.y == 1u);
        if share == 0.0 {
            continue;
        }
        let level = vec2<u32>(columns.level, rows.level) + up;
        let last = vec2<u32>(cell_at(columns, columns.high, level.x), cell_at(rows, rows.high, level.y));
        for (var cell_y = cell_at(rows, rows.low, level.y); cell_y <= last.y; cell_y += 1u) {
            let weight_y = covered(rows, cell_y, level.y) * share;
            for (var cell_x = cell_at(columns, columns.low, level.x); cell_x <= last.x; cell_x += 1u) {
                let weight = covered(columns, cell_x, level.x) * weight_y;
                let texel = vec2<u32>(
                    texel_of(cell_x, level.x, cell_y, side),
                    texel_of(cell_y, level.y, cell_x, side),
                );
                let from_middle = vec2<f32>(texel) + 0.5 - asked.at;
                let own = max(asked.nearness + dot(asked.slope, from_middle), 0.0);
                let nearest = textureLoad(shadow_maps, first + texel, layer, 0);
                if nearest > own {
                    sum += vec3<f32>(weight, weight * depth_of(face, nearest), 0.0);
                }
                sum.z += weight;
            }
        }
    }
    return sum;
}

fn depth_of(face: u32, nearness: f32) -> f32 {
    let near = shadow_faces[face].near;
    if near > 0.0 {
        return near / nearness;
    }
    return shadow_faces[face].far * (1.0 - nearness);
}

// Width and height of a map at a depth, the larger.
fn map_width(face: u32, depth: f32) -> f32 {
    let half = max(shadow_faces[face].half_width, shadow_faces[face].half_height);
    return select(2.0 * half, 2.0 * half * depth, shadow_faces[face].near > 0.0);
}

// The index of the face of six that looks into a direction: +x, -x, +y, -y, +z, -z.
fn cube_face(d: vec3<f32>) -> u32 {
    let a = abs(d);
    if a.x >= a.y && a.x >= a.z {
        return select(0u, 1u, d.x < 0.0);
    }
    if a.y >= a.z {
        return select(2u, 3u, d.y < 0.0);
    }
    return select(4u, 5u, d.z < 0.0);
}

// The share of a lamp's light that arrives.
fn visibility(lamp_index: u32, at: SurfacePoint, to_light: vec3<f32>) -> f32 {
    let count = lamps[lamp_index].face_count;
    var face = lamps[lamp_index].first_face;
    if count == 0u {
        return 1.0;
    }
    let first_face = face;
    if count > 1u {
        face += cube_face(at.position - shadow_faces[face].origin);
    }
    let side = shadow_faces[face].resolution;
    let straight = shadow_faces[face].map_from_mesh * vec4<f32>(at.position, 1.0);
    if straight.z <= 0.0 || straight.w <= 0.0 {
        return 1.0;
    }
    let texel = map_width(face, straight.w) / side;
    let cosine = clamp(dot(at.vertex_normal, to_light), 0.0, 1.0);
    let lift = shadow_faces[face].normal_offset * sqrt(1.0 - cosine * cosine) * texel;
    let lifted = at.position + at.vertex_normal * lift;
    if count > 1u {
        // The lift may lead across a face's border.
        face = first_face + cube_face(lifted - shadow_faces[face].origin);
    }
    let view = shadow_faces[face].map_from_mesh;
    let h = view * vec4<f32>(lifted, 1.0);
    let uv = h.xy / h.z;
    if h.z <= 0.0 || h.w <= 0.0 || any(abs(uv - 0.5) > vec2<f32>(0.5)) {
        return 1.0;
    }
    let near = shadow_faces[face].near;
    let far = shadow_faces[face].far;
    let depth = max(h.w - shadow_faces[face].bias * texel, 0.5 * h.w);
    var asked: Asked;
    asked.at = uv * side;
    asked.depth = h.w;
    asked.nearness = select((far - depth) / far, near / depth, near > 0.0);
    asked.slope = vec2<f32>(0.0);
    if dot(at.facet_normal, to_light) > 0.0 {
        let n = at.facet_normal;
        let along = vec2<f32>(
            dot(n, shadow_faces[face].right) * shadow_faces[face].half_width,
            -dot(n, shadow_faces[face].up) * shadow_faces[face].half_height,
        ) * 2.0;
        let perspective = along * (near / (dot(n, lifted - shadow_faces[face].origin) * side));
        let parallel = along / (dot(n, shadow_faces[face].forward) * side * far);
        let per_depth = select(1.0 / far, near / (depth * depth), near > 0.0);
        let steepest = vec2<f32>(STEEPEST * texel * per_depth);
        asked.slope = clamp(select(parallel, perspective, near > 0.0), -steepest, steepest);
    }
    let hx = view * vec4<f32>(at.position_dx, 0.0);
    let hy = view * vec4<f32>(at.position_dy, 0.0);
    let step_x = (hx.xy - uv * hx.z) / h.z * side;
    let step_y = (hy.xy - uv * hy.z) / h.z * side;
    let pixel = 0.5 * (abs(step_x) + abs(step_y));
    var penumbra = 0.0;
    let width = shadow_faces[face].penumbra_width;
    if shadow_faces[face].penumbra == 1u {
        penumbra = width / texel;
    } else if shadow_faces[face].penumbra == 2u {
        let widest = select(width * min(asked.depth, far), width, near > 0.0);
        let found = blockers(face, asked, max(vec2<f32>(widest / texel), pixel));
        if found.x <= 0.0 {
            return 1.0;
        }
        let blocker = found.y / found.x;
        let gap = max(asked.depth - blocker, 0.0);
        penumbra = select(width * gap, width * gap / blocker, near > 0.0) / texel;
    }
    let sum = blockers(face, asked, max(pixel, vec2<f32>(max(penumbra, MIN_RADIUS))));
    return select(1.0, 1.0 - sum.x / sum.z, sum.z > 0.0);
}
