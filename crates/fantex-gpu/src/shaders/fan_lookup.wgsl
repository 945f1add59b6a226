// Filtered look-ups in one tile: which levels, how many probes, where they lie in the atlas.
//
// The rules are those of `TileLookup` (fantex-store, sampler/lookup.rs); tests/gpu/sampler.rs compares them point by point.

// NEAREST, BILINEAR, TRILINEAR or ANISOTROPIC.
override FAN_FILTER: u32 = 3u;

// Whether tiles may be cut into several pages.
override FAN_PAGED: bool = true;

// Whether a branch saves what it goes round: on graphics cards. Software adapters execute both sides.
override FAN_BRANCHES: bool = true;

// Which channels the asset has.
override FAN_BASE_COLOR: bool = false;
override FAN_NORMAL: bool = false;
override FAN_MATERIAL: bool = false;
override FAN_EMISSION: bool = false;
override FAN_LIGHT: bool = false;
override FAN_ANISOTROPY: bool = false;

struct FanParams {
    // One over the atlas' sides in texels.
    atlas_scale: vec2<f32>,
    // Width of the blend band.
    delta: f32,
    max_anisotropy: f32,
    // Per kind of channel, its number in the means.
    mean_of: vec4<u32>,
    mean_of_light: u32,
    // Channels of the means.
    channels: u32,
    mean_of_anisotropy: u32,
}

@group(1) @binding(0) var<uniform> fan: FanParams;
// Per group: number of its first page; quarters of its columns and (<< 16) rows at level 0.
@group(1) @binding(1) var<storage, read> fan_groups: array<vec2<u32>>;
// A word per page, in rows: zero where there is nothing, else quarters of a place in the atlas: column, row << 12, and 1 << 31; in
// tiles of one page per level also how many levels coarser it is << 24. A texture: software adapters read storage buffers lane by lane.
@group(1) @binding(2) var fan_pages: texture_2d<u32>;
// Per group and channel four halves.
@group(1) @binding(3) var<storage, read> fan_means: array<vec2<u32>>;
// Per group the projection direction and the x axis.
@group(1) @binding(4) var<storage, read> fan_frames: array<array<f32, 6>>;
@group(1) @binding(5) var fan_sampler: sampler;
@group(1) @binding(6) var fan_base_color: texture_2d<f32>;
@group(1) @binding(7) var fan_normal: texture_2d<f32>;
@group(1) @binding(8) var fan_material: texture_2d<f32>;
@group(1) @binding(9) var fan_emission: texture_2d<f32>;
@group(1) @binding(10) var fan_light: texture_2d<f32>;
@group(1) @binding(11) var fan_anisotropy: texture_2d<f32>;

const NEAREST = 0u;
const BILINEAR = 1u;
const TRILINEAR = 2u;
const ANISOTROPIC = 3u;

// The bits of 1.0.
const ONE_BITS = 0x3F800000;

// Sides of a page in texels, log2.
const PAGE_SHIFT = 8u;
// Pages in a row of the table, log2.
const PAGE_ROW_SHIFT = 12u;
// Tiles along a footprint at most: MAX_FOOTPRINT (fantex-store, sampler/lookup.rs).
const MAX_FOOTPRINT = 16384.0;
// Texels over which a page fades into the coarser level towards a neighbour that is not resident.
const FADE_TEXELS = 8.0;

// A group's pages and extent.
struct FanGroup {
    first_page: u32,
    quarters: vec2<u32>,
}

// Values of all channels in one tile; linear, normals as stored.
struct TileSample {
    base_color: vec4<f32>,
    material: vec4<f32>,
    emission: vec4<f32>,
    light: vec4<f32>,
    normal: vec2<f32>,
    anisotropy: vec2<f32>,
    // Detail level: the one asked for, and the mean of those that were there.
    wanted_level: f32,
    shown_level: f32,
}

// Of numbers below 2^31, as signed ones: those are converted more quickly.
fn floats(v: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(bitcast<vec2<i32>>(v));
}

fn fan_group(packed: vec2<u32>) -> FanGroup {
    return FanGroup(packed.x, vec2<u32>(packed.y & 0xFFFFu, packed.y >> 16u));
}

// Group::level_count, less one: the last level is the first whose longer side is 4.
fn last_level(group: FanGroup) -> u32 {
    return firstLeadingBit(max(group.quarters.x, group.quarters.y) * 2u / 3u) + 1u;
}

// Group::level_extent: halved per level, rounded to the nearest multiple of 4 (halves up), at least 4.
fn level_extent(group: FanGroup, level: u32) -> vec2<u32> {
    let half_unit = (1u << level) >> 1u;
    return max((group.quarters + half_unit) >> vec2<u32>(level), vec2<u32>(1u)) * 4u;
}

// The footprint of a pixel in tile coordinates, as far as its axes depend on it: the matrix J J^T of the derivatives, and the
// determinant of J.
struct Footprint {
    xx: f32,
    xy: f32,
    yy: f32,
    determinant: f32,
}

// Derivatives of triangles that are seen edge-on may be infinite, or no numbers.
fn bounded(derivative: vec2<f32>) -> vec2<f32> {
    let held = clamp(derivative, vec2<f32>(-MAX_FOOTPRINT), vec2<f32>(MAX_FOOTPRINT));
    return select(vec2<f32>(0.0), held, derivative == derivative);
}

fn footprint(unbounded_dx: vec2<f32>, unbounded_dy: vec2<f32>) -> Footprint {
    let dx = bounded(unbounded_dx);
    let dy = bounded(unbounded_dy);
    return Footprint(
        dx.x * dx.x + dy.x * dy.x,
        dx.x * dx.y + dy.x * dy.y,
        dx.y * dx.y + dy.y * dy.y,
        abs(dx.x * dy.y - dx.y * dy.x),
    );
}

// Squares of the longer axis, of the shorter axis as the anisotropy limits it, and the direction of the longer one (not
// normalised), in texels of an extent.
struct Axes {
    major2: f32,
    minor2: f32,
    direction: vec2<f32>,
}

fn axes(f: Footprint, extent: vec2<f32>) -> Axes {
    let xx = f.xx * extent.x * extent.x;
    let yy = f.yy * extent.y * extent.y;
    let xy = f.xy * extent.x * extent.y;
    let half_difference = 0.5 * (xx - yy);
    let root = sqrt(half_difference * half_difference + xy * xy);
    let major2 = 0.5 * (xx + yy) + root;
    let determinant = f.determinant * extent.x * extent.y;
    let minor2 = determinant * determinant / max(major2, 1e-30);
    let limit = fan.max_anisotropy * fan.max_anisotropy;
    let direction = select(
        vec2<f32>(xy, root - half_difference),
        vec2<f32>(half_difference + root, xy),
        half_difference >= 0.0,
    );
    return Axes(major2, max(minor2, major2 / limit), direction);
}

// Square of the pixel's width in texels of an extent.
fn squared_width(f: Footprint, extent: vec2<f32>) -> f32 {
    let a = axes(f, extent);
    return select(a.major2, a.minor2, FAN_FILTER == ANISOTROPIC);
}

struct Levels {
    // The finer level; the one after it (after the last: the mean) has the share `coarse_share`.
    fine: u32,
    coarse_share: f32,
}

// The levels between which the pixel is one texel wide: the finer one is the last level in which it is wider than a texel.
//
// If every level had exactly half the texels of the one before, the finest one's width would tell. Rounding takes or adds at
// most two of six texels, less than a level, and where a bound stands for the width the guess is too late by less than
// another. The walk from there seldom takes more than the step that software adapters take anyway, unless the tile is long.
fn choose_levels(group: FanGroup, f: Footprint) -> Levels {
    if FAN_FILTER < TRILINEAR {
        return Levels(0u, 0.0);
    }
    let last = last_level(group);
    let extent = floats(group.quarters * 4u);
    // The trace is at least the square of the longer axis, and at most twice that.
    let bound = f.xx * extent.x * extent.x + f.yy * extent.y * extent.y;
    let finest = select(squared_width(f, extent), bound, FAN_FILTER == TRILINEAR);
    // Half the exponent: the binary logarithm of the width, rounded down.
    var fine = u32(clamp((bitcast<i32>(finest) - ONE_BITS) >> 24u, 0, i32(last)));
    var here = squared_width(f, floats(level_extent(group, fine)));
    var next = squared_width(f, floats(level_extent(group, fine + 1u)));
    // To where the width falls below a texel between two levels.
    loop {
        let is_late = here <= 1.0 && fine > 0u;
        let is_early = here > 1.0 && next > 1.0 && fine < last;
        // Written so that it ends with what is not a number, too.
        if FAN_BRANCHES && !(is_late || is_early) {
            break;
        }
        let other = squared_width(f, floats(level_extent(group, select(fine + 2u, fine - 1u, is_late))));
        let before = here;
        here = select(select(here, next, is_early), other, is_late);
        next = select(select(next, other, is_early), before, is_late);
        fine = select(select(fine, fine + 1u, is_early), fine - 1u, is_late);
        continuing {
            break if !((here <= 1.0 && fine > 0u) || (here > 1.0 && next > 1.0 && fine < last));
        }
    }
    // After the last level comes the mean, as if it had a quarter of the texels along each side.
    next = select(next, here * 0.0625, fine >= last);
    let wide = log2(here);
    let share = clamp(wide / (wide - log2(next)), 0.0, 1.0);
    return Levels(fine, select(share, 0.0, here <= 1.0));
}

struct Probes {
    count: u32,
    // The way, in tile coordinates, that they are spread over.
    span: vec2<f32>,
}

fn choose_probes(group: FanGroup, f: Footprint) -> Probes {
    if FAN_FILTER != ANISOTROPIC {
        return Probes(1u, vec2<f32>(0.0));
    }
    let extent = floats(group.quarters * 4u);
    let finest = axes(f, extent);
    let major = sqrt(finest.major2);
    let count = clamp(ceil(major / max(sqrt(finest.minor2), 1.0)), 1.0, 64.0);
    let length2 = dot(finest.direction, finest.direction);
    let direction = select(vec2<f32>(1.0, 0.0), finest.direction * inverseSqrt(length2), length2 > 0.0);
    return Probes(u32(count), direction * major / extent);
}

// A level of a tile: its texels, its pages.
struct Level {
    extent: vec2<u32>,
    first_page: u32,
    page_columns: u32,
}

fn tile_level(group: FanGroup, level: u32) -> Level {
    // Most levels have one page.
    var first = group.first_page + level;
    let extent = level_extent(group, level);
    if max(group.quarters.x, group.quarters.y) > 64u {
        for (var l = 0u; l < level; l += 1u) {
            let pages = page_grid(level_extent(group, l));
            if FAN_BRANCHES && pages.x * pages.y == 1u {
                break;
            }
            first += pages.x * pages.y - 1u;
        }
    }
    return Level(extent, first, page_grid(extent).x);
}

// The level after one of a given number.
fn next_level(group: FanGroup, level: Level, number: u32) -> Level {
    let extent = level_extent(group, number + 1u);
    let pages = page_grid(level.extent);
    return Level(extent, level.first_page + pages.x * pages.y, page_grid(extent).x);
}

// Columns and rows of pages.
fn page_grid(extent: vec2<u32>) -> vec2<u32> {
    return (extent + 255u) >> vec2<u32>(PAGE_SHIFT);
}

fn page_word(page: u32) -> u32 {
    let at = vec2<u32>(page & ((1u << PAGE_ROW_SHIFT) - 1u), page >> PAGE_ROW_SHIFT);
    return textureLoad(fan_pages, at, 0).x;
}

// Levels between a page and the one that stands for it.
fn levels_coarser(entry: u32) -> u32 {
    return (entry >> 24u) & 0x7Fu;
}

// Of a page itself, whatever stands for it; 0 where it is not resident.
fn page_entry(level: Level, page: vec2<u32>) -> u32 {
    let word = page_word(level.first_page + page.y * level.page_columns + page.x);
    return select(word, 0u, levels_coarser(word) != 0u);
}

// First texel of a resident page.
fn page_place(entry: u32) -> vec2<u32> {
    return vec2<u32>(entry & 0xFFFu, (entry >> 12u) & 0xFFFu) * 4u;
}

// Adds a bilinear look-up at a position in the atlas, in texels.
fn tap(sum: ptr<function, TileSample>, place: vec2<f32>, weight: f32) {
    tap_at(sum, place * fan.atlas_scale, weight);
}

// The same at texture coordinates.
fn tap_at(sum: ptr<function, TileSample>, at: vec2<f32>, weight: f32) {
    if FAN_BASE_COLOR {
        (*sum).base_color += weight * textureSampleLevel(fan_base_color, fan_sampler, at, 0.0);
    }
    if FAN_NORMAL {
        (*sum).normal += weight * textureSampleLevel(fan_normal, fan_sampler, at, 0.0).xy;
    }
    if FAN_MATERIAL {
        (*sum).material += weight * textureSampleLevel(fan_material, fan_sampler, at, 0.0);
    }
    if FAN_EMISSION {
        (*sum).emission += weight * textureSampleLevel(fan_emission, fan_sampler, at, 0.0);
    }
    if FAN_LIGHT {
        (*sum).light += weight * textureSampleLevel(fan_light, fan_sampler, at, 0.0);
    }
    if FAN_ANISOTROPY {
        (*sum).anisotropy += weight * textureSampleLevel(fan_anisotropy, fan_sampler, at, 0.0).xy;
    }
}

fn mean(index: u32) -> vec4<f32> {
    let halves = fan_means[index];
    return vec4<f32>(unpack2x16float(halves.x), unpack2x16float(halves.y));
}

// The mean of a group, per channel.
fn add_mean(sum: ptr<function, TileSample>, group_index: u32, weight: f32) {
    let first = group_index * fan.channels;
    if FAN_BASE_COLOR {
        (*sum).base_color += weight * mean(first + fan.mean_of.x);
    }
    if FAN_NORMAL {
        (*sum).normal += weight * mean(first + fan.mean_of.y).xy;
    }
    if FAN_MATERIAL {
        (*sum).material += weight * mean(first + fan.mean_of.z);
    }
    if FAN_EMISSION {
        (*sum).emission += weight * mean(first + fan.mean_of.w);
    }
    if FAN_LIGHT {
        (*sum).light += weight * mean(first + fan.mean_of_light);
    }
    if FAN_ANISOTROPY {
        (*sum).anisotropy += weight * mean(first + fan.mean_of_anisotropy).xy;
    }
}

// The share of a level at a position in one of its pages, 1 where all that a look-up reads is resident. It falls to
// nothing before a look-up touches a page that is not, so that the picture is continuous whatever is resident.
fn residency(level: Level, page: vec2<u32>, local: vec2<f32>) -> f32 {
    // Towards the nearer neighbours; at the tile's own border there is none.
    let after = local > vec2<f32>(128.0);
    let pages = page_grid(level.extent);
    let exists = select(page > vec2<u32>(0u), page + 1u < pages, after);
    let near = select(vec2<f32>(1e9), select(local, 256.0 - local, after), exists);
    let rise = clamp((near - 0.5) / FADE_TEXELS, vec2<f32>(0.0), vec2<f32>(1.0));
    let neighbour = select(page - 1u, page + 1u, after);
    var share = select(0.0, 1.0, page_entry(level, page) != 0u);
    if rise.x < 1.0 {
        if page_entry(level, vec2<u32>(neighbour.x, page.y)) == 0u {
            share = min(share, rise.x);
        }
    }
    if rise.y < 1.0 {
        if page_entry(level, vec2<u32>(page.x, neighbour.y)) == 0u {
            share = min(share, rise.y);
        }
    }
    if max(rise.x, rise.y) < 1.0 {
        if page_entry(level, neighbour) == 0u {
            share = min(share, max(rise.x, rise.y));
        }
    }
    return share;
}

// All channels of a tile at tile coordinates with their derivatives per pixel.
//
// Each of the two levels, the finer first, takes the share of its weight that is resident and hands on the rest to the next
// coarser one; the mean takes what is left. So there is always a picture, and it is continuous.
//
// Software adapters execute both sides of a branch, and a loop's body once more than needed if its test comes first:
// that is why loops test at their end, and why the common case is a function of its own.
fn tile_sample(group_index: u32, packed_group: vec2<u32>, uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> TileSample {
    let group = fan_group(packed_group);
    let pixel = footprint(dx, dy);
    let levels = choose_levels(group, pixel);
    let probes = choose_probes(group, pixel);
    var sum = TileSample();
    var left = 0.0;
    if !FAN_PAGED {
        left = add_levels(&sum, group, levels, probes, uv);
    } else if FAN_BRANCHES {
        // Most pixels read one page of each level.
        let fine = tile_level(group, levels.fine);
        let fine_page = only_page(fine, probes, uv);
        let has_coarse = levels.coarse_share > 0.0 && levels.fine < last_level(group);
        var coarse_page = OnlyPage(true, vec2<f32>(0.0), vec2<f32>(0.0));
        if has_coarse {
            coarse_page = only_page(next_level(group, fine, levels.fine), probes, uv);
        }
        if fine_page.is_there && coarse_page.is_there {
            add_page(&sum, fine_page, probes, uv, 1.0 - levels.coarse_share);
            sum.shown_level = (1.0 - levels.coarse_share) * f32(levels.fine);
            if has_coarse {
                add_page(&sum, coarse_page, probes, uv, levels.coarse_share);
                sum.shown_level += levels.coarse_share * f32(levels.fine + 1u);
            } else {
                left = levels.coarse_share;
            }
        } else {
            left = add_paged_levels(&sum, group, levels, probes, uv);
        }
    } else {
        left = add_paged_levels(&sum, group, levels, probes, uv);
    }
    if left > 0.0 {
        add_mean(&sum, group_index, left);
        sum.shown_level += left * f32(last_level(group) + 1u);
    }
    sum.wanted_level = f32(levels.fine) + levels.coarse_share;
    return sum;
}

// Half a texel inside a level, in its texels.
fn held_inside(uv: vec2<f32>, extent: vec2<f32>) -> vec2<f32> {
    let position = clamp(uv * extent, vec2<f32>(0.5), extent - 0.5);
    return select(position, floor(position) + 0.5, FAN_FILTER == NEAREST);
}

// Of a tile whose levels have one page each. Returns the weight that nothing resident takes.
fn add_levels(
    sum: ptr<function, TileSample>,
    group: FanGroup,
    levels: Levels,
    probes: Probes,
    uv: vec2<f32>,
) -> f32 {
    let fine_entry = page_word(group.first_page + levels.fine);
    // The finest resident level of the coarser ones, if there is one.
    let coarse_entry = select(0u, page_word(group.first_page + levels.fine + 1u), levels.fine < last_level(group));
    let coarse_level = levels.fine + 1u + levels_coarser(coarse_entry);
    let has_fine = fine_entry != 0u && levels_coarser(fine_entry) == 0u;
    let fine_weight = select(0.0, 1.0 - levels.coarse_share, has_fine);
    let coarse_weight = select(0.0, 1.0 - fine_weight, coarse_entry != 0u);
    let fine_extent = floats(level_extent(group, levels.fine));
    let coarse_extent = floats(level_extent(group, coarse_level));
    let fine_place = floats(page_place(fine_entry));
    let coarse_place = floats(page_place(coarse_entry));
    // Not a loop over one probe: that would cost a seventh of the frame.
    if FAN_FILTER != ANISOTROPIC {
        tap(sum, fine_place + held_inside(uv, fine_extent), fine_weight);
        tap(sum, coarse_place + held_inside(uv, coarse_extent), coarse_weight);
    } else {
        if !FAN_BRANCHES || fine_weight > 0.0 {
            add_probes(sum, fine_place, fine_extent, probes, uv, fine_weight);
        }
        if !FAN_BRANCHES || coarse_weight > 0.0 {
            add_probes(sum, coarse_place, coarse_extent, probes, uv, coarse_weight);
        }
    }
    (*sum).shown_level = fine_weight * f32(levels.fine) + coarse_weight * f32(coarse_level);
    return 1.0 - fine_weight - coarse_weight;
}

// Adds all probes in a level whose first texel lies, or would lie, at `place` in the atlas.
fn add_probes(
    sum: ptr<function, TileSample>,
    place: vec2<f32>,
    extent: vec2<f32>,
    probes: Probes,
    uv: vec2<f32>,
    weight: f32,
) {
    let per_probe = 1.0 / f32(probes.count);
    // In texture coordinates.
    let low = (place + 0.5) * fan.atlas_scale;
    let high = (place + extent - 0.5) * fan.atlas_scale;
    let step = probes.span * per_probe * extent * fan.atlas_scale;
    let first = (place + (uv + probes.span * (0.5 * per_probe - 0.5)) * extent) * fan.atlas_scale;
    let own_weight = weight * per_probe;
    var i = 0u;
    loop {
        tap_at(sum, clamp(first + f32(i) * step, low, high), own_weight);
        i += 1u;
        continuing {
            break if i >= probes.count;
        }
    }
}

// The page of a level that a pixel reads, if that is one only.
struct OnlyPage {
    // Resident, and no probe comes near another page, which may be missing (see `residency`).
    is_there: bool,
    // Where the level's first texel would lie in the atlas.
    place: vec2<f32>,
    extent: vec2<f32>,
}

fn only_page(level: Level, probes: Probes, uv: vec2<f32>) -> OnlyPage {
    let extent = vec2<f32>(level.extent);
    let reach = 0.5 * abs(probes.span);
    let low = held_inside(uv - reach, extent);
    let high = held_inside(uv + reach, extent);
    let page = vec2<u32>(low) >> vec2<u32>(PAGE_SHIFT);
    let origin = vec2<f32>(page << vec2<u32>(PAGE_SHIFT));
    let is_first = page == vec2<u32>(0u);
    let is_last = origin + 256.0 >= extent;
    let margin = 0.5 + FADE_TEXELS;
    let is_apart = (is_first | (low - origin >= vec2<f32>(margin))) & (is_last | (high - origin <= vec2<f32>(256.0 - margin)));
    let entry = page_entry(level, page);
    return OnlyPage(all(is_apart) && entry != 0u, floats(page_place(entry)) - origin, extent);
}

fn add_page(sum: ptr<function, TileSample>, page: OnlyPage, probes: Probes, uv: vec2<f32>, weight: f32) {
    if FAN_FILTER != ANISOTROPIC {
        tap(sum, page.place + held_inside(uv, page.extent), weight);
    } else {
        add_probes(sum, page.place, page.extent, probes, uv, weight);
    }
}

// Adds a level's probes, each from its own page; returns the weight that is resident. A look-up across the border of pages is made of
// single texels.
fn add_across_pages(
    sum: ptr<function, TileSample>,
    level: Level,
    probes: Probes,
    uv: vec2<f32>,
    whole_weight: f32,
) -> f32 {
    let extent = vec2<f32>(level.extent);
    let per_probe = 1.0 / f32(probes.count);
    var taken = 0.0;
    var probe = 0u;
    var texel = 0u;
    loop {
        let at = uv + probes.span * ((f32(probe) + 0.5) * per_probe - 0.5);
        let position = held_inside(at, extent);
        let page = vec2<u32>(position) >> vec2<u32>(PAGE_SHIFT);
        let local = position - vec2<f32>(page << vec2<u32>(PAGE_SHIFT));
        let share = residency(level, page, local);
        let is_crossing = any(local < vec2<f32>(0.5)) || any(local > vec2<f32>(255.5));
        // Of four texels, the one of this step.
        let corner = vec2<u32>(texel & 1u, texel >> 1u);
        let first = floor(position - 0.5);
        let fraction = position - 0.5 - first;
        let portions = select(1.0 - fraction, fraction, corner == vec2<u32>(1u));
        let single = vec2<u32>(first) + corner;
        let tap_page = select(page, single >> vec2<u32>(PAGE_SHIFT), is_crossing);
        let tap_local = select(local, vec2<f32>(single & vec2<u32>(255u)) + 0.5, is_crossing);
        let weight = whole_weight * per_probe * share * select(1.0, portions.x * portions.y, is_crossing);
        let entry = page_entry(level, tap_page);
        tap(sum, floats(page_place(entry)) + tap_local, weight);
        taken += weight;
        texel += 1u;
        if !is_crossing || texel == 4u {
            texel = 0u;
            probe += 1u;
        }
        continuing {
            break if probe >= probes.count;
        }
    }
    return taken;
}

// The same for any tile.
fn add_paged_levels(
    sum: ptr<function, TileSample>,
    group: FanGroup,
    levels: Levels,
    probes: Probes,
    uv: vec2<f32>,
) -> f32 {
    let last = last_level(group);
    var left = 1.0 - levels.coarse_share;
    var coarse = levels.coarse_share;
    var level_index = levels.fine;
    var level = tile_level(group, level_index);
    loop {
        let taken = add_across_pages(sum, level, probes, uv, left);
        (*sum).shown_level += taken * f32(level_index);
        // What rounding leaves over is none.
        left = select(left - taken, 0.0, left - taken < 1e-5) + coarse;
        coarse = 0.0;
        level = next_level(group, level, level_index);
        level_index += 1u;
        continuing {
            break if level_index > last || left <= 0.0;
        }
    }
    return left;
}
