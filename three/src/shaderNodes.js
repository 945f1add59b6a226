// The texture function in three's shading language (TSL), for `WebGPURenderer` with either of its backends.
//
// The rules, and the meaning of the tables, are those of `shader.js`.

import {
    Break, Continue, If, Loop, abs, attribute, ceil, clamp, cross, dFdx, dFdy, dot, float, floatBitsToInt, floor, int, inverseSqrt, ivec2,
    log2, max, min, mix, normalLocal, select, sqrt, struct, texture, textureLoad, uint, uniform, uvec2, varying, vec2, vec3, vec4,
} from "three/tsl";
import { Vector2 } from "three";

const FADE_TEXELS = 8;

/** Tiles along a footprint at most. */
const MAX_FOOTPRINT = 16384;

const FanSurface = struct({ baseColor: "vec4", material: "vec3", emission: "vec3", light: "vec3", normal: "vec3" }, "FanSurface");

/** An entry of a table in rows of 4096. */
const entry = (table, index) => textureLoad(table, ivec2(int(index.bitAnd(uint(4095))), int(index.shiftRight(uint(12)))));

/** The last level is the first whose longer side is 4. */
function lastLevel(quarters) {
    const n = max(quarters.x, quarters.y).mul(uint(2)).div(uint(3));
    // The exponent of a float is the place of the highest bit.
    const exponent = floatBitsToInt(float(n)).shiftRight(uint(23)).sub(int(126));
    return select(n.equal(uint(0)), uint(0), uint(exponent));
}

/** Halved per level, rounded to the nearest multiple of 4 (halves up), at least 4. */
function levelExtent(quarters, level) {
    const half = uint(1).shiftLeft(level).shiftRight(uint(1));
    return max(quarters.add(uvec2(half)).shiftRight(uvec2(level)), uvec2(1)).mul(uvec2(4));
}

/** Derivatives of triangles that are seen edge-on may be infinite, or no numbers. */
function bounded(derivative) {
    const held = clamp(derivative, vec2(-MAX_FOOTPRINT), vec2(MAX_FOOTPRINT)).toVar();
    const part = (axis) => select(derivative[axis].equal(derivative[axis]), held[axis], float(0));
    return vec2(part("x"), part("y"));
}

/** The footprint of a pixel in tile coordinates: the matrix J J^T of the derivatives, and the determinant of J. */
function footprintOf(unboundedDx, unboundedDy) {
    const [dx, dy] = [bounded(unboundedDx).toVar(), bounded(unboundedDy).toVar()];
    return {
        xx: dx.x.mul(dx.x).add(dy.x.mul(dy.x)).toVar(),
        xy: dx.x.mul(dx.y).add(dy.x.mul(dy.y)).toVar(),
        yy: dx.y.mul(dx.y).add(dy.y.mul(dy.y)).toVar(),
        determinant: abs(dx.x.mul(dy.y).sub(dx.y.mul(dy.x))).toVar(),
    };
}

function unitOr(v, otherwise) {
    const length2 = dot(v, v).toVar();
    return select(length2.greaterThan(1e-12), v.mul(inverseSqrt(max(length2, 1e-12))), otherwise);
}

/** A stored normal in object space. */
function objectNormal(stored, xAxis, vertexNormal) {
    const yAxis = cross(vertexNormal, xAxis);
    const xy = stored.mul(2).sub(1).toVar();
    const z = sqrt(max(float(1).sub(dot(xy, xy)), 0));
    return unitOr(xAxis.mul(xy.x).add(yAxis.mul(xy.y)).add(vertexNormal.mul(z)).toVar(), vertexNormal);
}

/** Weights of the groups at a triangle's corners: corners of the same group count as the first of them. */
function weightsOf(groups, lambda, delta) {
    const w = max(lambda.sub(max(lambda.yzx, lambda.zxy)).add(delta), vec3(0)).toVar();
    w.divAssign(w.x.add(w.y).add(w.z));
    If(groups.x.equal(groups.y), () => { w.assign(vec3(w.x.add(w.y), 0, w.z)); });
    If(groups.x.equal(groups.z), () => { w.assign(vec3(w.x.add(w.z), w.y, 0)); });
    If(groups.y.equal(groups.z), () => { w.assign(vec3(w.x, w.y.add(w.z), 0)); });
    return w;
}

/** The look-ups of one asset, for some of its channels. */
export class Lookup {
    /**
     * @param uniforms See `fanUniforms`.
     * @param defines See `fanDefines`.
     */
    constructor(uniforms, defines) {
        const value = (name) => uniforms[name].value;
        this.groups = value("fanGroupTable");
        this.pages = value("fanPages");
        this.means = value("fanMeans");
        this.frames = value("fanFrames");
        this.atlasScale = uniform(new Vector2(...value("fanAtlasScale")));
        this.delta = uniform(value("fanDelta"));
        this.maxAnisotropy = uniform(value("fanMaxAnisotropy"));
        this.channels = value("fanChannels");
        this.isAnisotropic = "FAN_ANISOTROPIC" in defines;
        this.isPaged = "FAN_PAGED" in defines;
        this.isSingle = "FAN_SINGLE_TILE" in defines;
        const [base, normal, material, emission] = value("fanMeanOf");
        this.kinds = [
            ["baseColor", "FAN_BASE_COLOR", "fanBaseColor", base],
            ["normal", "FAN_NORMAL", "fanNormalMap", normal],
            ["material", "FAN_MATERIAL", "fanMaterial", material],
            ["emission", "FAN_EMISSION", "fanEmission", emission],
            ["light", "FAN_LIGHT", "fanLight", value("fanMeanOfLight")],
        ].filter(([, define]) => define in defines).map(([name, , map, mean]) => ({ name, map: value(map), mean }));
    }

    has(name) {
        return this.kinds.some((kind) => kind.name === name);
    }

    /** Squares of the longer axis, of the shorter axis as the anisotropy limits it, and the direction of the longer one, in texels. */
    axes(f, extent) {
        const xx = f.xx.mul(extent.x).mul(extent.x).toVar();
        const yy = f.yy.mul(extent.y).mul(extent.y).toVar();
        const xy = f.xy.mul(extent.x).mul(extent.y).toVar();
        const halfDifference = xx.sub(yy).mul(0.5).toVar();
        const root = sqrt(halfDifference.mul(halfDifference).add(xy.mul(xy))).toVar();
        const major2 = xx.add(yy).mul(0.5).add(root).toVar();
        const determinant = f.determinant.mul(extent.x).mul(extent.y).toVar();
        const minor2 = determinant.mul(determinant).div(max(major2, 1e-30));
        const direction = select(halfDifference.greaterThanEqual(0), vec2(halfDifference.add(root), xy), vec2(xy, root.sub(halfDifference)));
        return { major2, minor2: max(minor2, major2.div(this.maxAnisotropy.mul(this.maxAnisotropy))), direction };
    }

    /** Square of the pixel's width in texels of an extent. */
    squaredWidth(f, extent) {
        const { major2, minor2 } = this.axes(f, vec2(extent).toVar());
        return this.isAnisotropic ? minor2 : major2;
    }

    /** The levels between which the pixel is one texel wide, and the share of the coarser one. */
    chooseLevels(quarters, f) {
        const last = lastLevel(quarters).toVar();
        const width = (level) => this.squaredWidth(f, levelExtent(quarters, level));
        const finest = this.squaredWidth(f, quarters.mul(uvec2(4))).toVar();
        const guess = floatBitsToInt(finest).sub(int(0x3F800000)).shiftRight(uint(24));
        const fine = uint(clamp(guess, int(0), int(last))).toVar();
        const here = width(fine).toVar();
        const next = width(fine.add(uint(1))).toVar();
        Loop({ start: 0, end: 20, name: "step" }, () => {
            If(here.lessThanEqual(1).and(fine.greaterThan(uint(0))), () => {
                fine.subAssign(uint(1));
                next.assign(here);
                here.assign(width(fine));
            }).ElseIf(here.greaterThan(1).and(next.greaterThan(1)).and(fine.lessThan(last)), () => {
                fine.addAssign(uint(1));
                here.assign(next);
                next.assign(width(fine.add(uint(1))));
            }).Else(() => { Break(); });
        });
        // After the last level comes the mean, as if it had a quarter of the texels along each side.
        If(fine.greaterThanEqual(last), () => { next.assign(here.mul(0.0625)); });
        const wide = log2(here).toVar();
        const share = clamp(wide.div(wide.sub(log2(next))), 0, 1);
        const coarseShare = select(here.lessThanEqual(1), float(0), share).toVar();
        return { fine, coarseShare, last };
    }

    /** Number of look-ups, and the way in tile coordinates that they are spread over. */
    chooseProbes(quarters, f) {
        if (!this.isAnisotropic) return { count: int(1), span: vec2(0) };
        const extent = vec2(quarters.mul(uvec2(4))).toVar();
        const { major2, minor2, direction } = this.axes(f, extent);
        const major = sqrt(major2).toVar();
        const count = int(clamp(ceil(major.div(max(sqrt(minor2), 1))), 1, 64)).toVar();
        const way = direction.toVar();
        const length2 = dot(way, way).toVar();
        const unit = select(length2.greaterThan(0), way.mul(inverseSqrt(max(length2, 1e-38))), vec2(1, 0));
        return { count, span: unit.mul(major).div(extent).toVar() };
    }

    word(page) {
        return entry(this.pages, page).x;
    }

    /** Adds a bilinear look-up at a position in the atlas, in texels. */
    tap(sums, place, weight) {
        const at = place.mul(this.atlasScale).toVar();
        for (const { name, map } of this.kinds) {
            const texel = texture(map, at).level(0);
            sums[name].addAssign((name === "normal" ? texel.xy : texel).mul(weight));
        }
    }

    addMean(sums, group, weight) {
        const first = group.mul(uint(this.channels)).toVar();
        for (const { name, mean } of this.kinds) {
            const texel = entry(this.means, first.add(uint(mean)));
            sums[name].addAssign((name === "normal" ? texel.xy : texel).mul(weight));
        }
    }

    /** Positions of look-ups along the span. */
    probe(uv, probes, number, perProbe) {
        return uv.add(probes.span.mul(float(number).add(0.5).mul(perProbe).sub(0.5)));
    }

    /** Of a tile whose levels have one page each. Leaves in `left` the weight that nothing resident takes. */
    addLevels(sums, group, levels, probes, uv, left) {
        const { quarters, firstPage } = group;
        const fineWord = this.word(firstPage.add(levels.fine)).toVar();
        const coarseWord = uint(0).toVar();
        If(levels.fine.lessThan(levels.last), () => {
            coarseWord.assign(this.word(firstPage.add(levels.fine).add(uint(1))));
        });
        const coarseLevel = levels.fine.add(uint(1)).add(levelsCoarser(coarseWord)).toVar();
        const hasFine = fineWord.notEqual(uint(0)).and(levelsCoarser(fineWord).equal(uint(0)));
        const fineWeight = select(hasFine, float(1).sub(levels.coarseShare), float(0)).toVar();
        const coarseWeight = select(coarseWord.notEqual(uint(0)), float(1).sub(fineWeight), float(0)).toVar();
        const fineExtent = vec2(levelExtent(quarters, levels.fine)).toVar();
        const coarseExtent = vec2(levelExtent(quarters, coarseLevel)).toVar();
        const perProbe = float(1).div(float(probes.count)).toVar();
        Loop({ start: int(0), end: probes.count, name: "probe" }, ({ probe }) => {
            const at = this.probe(uv, probes, probe, perProbe).toVar();
            If(fineWeight.greaterThan(0), () => {
                this.tap(sums, placeOf(fineWord).add(heldInside(at, fineExtent)), fineWeight.mul(perProbe));
            });
            If(coarseWeight.greaterThan(0), () => {
                this.tap(sums, placeOf(coarseWord).add(heldInside(at, coarseExtent)), coarseWeight.mul(perProbe));
            });
        });
        left.assign(float(1).sub(fineWeight).sub(coarseWeight));
    }

    /** A level of a tile: its texels, its pages. */
    tileLevel(group, level) {
        const first = group.firstPage.toVar();
        Loop({ start: uint(0), end: level, type: "uint", name: "finer" }, ({ finer }) => {
            const pages = levelExtent(group.quarters, finer).add(uvec2(255)).shiftRight(uvec2(8)).toVar();
            first.addAssign(pages.x.mul(pages.y));
        });
        const extent = levelExtent(group.quarters, level).toVar();
        const pages = extent.add(uvec2(255)).shiftRight(uvec2(8)).toVar();
        return { extent, first, pages };
    }

    /** Of a page itself, whatever stands for it; 0 where it is not resident. */
    entryOf(level, page) {
        const word = this.word(level.first.add(page.y.mul(level.pages.x)).add(page.x)).toVar();
        return select(levelsCoarser(word).notEqual(uint(0)), uint(0), word);
    }

    /** The share of a level at a position in one of its pages: falls to nothing before a look-up touches a page that is not resident. */
    residency(level, page, local) {
        const [afterX, afterY] = [local.x.greaterThan(128).toVar(), local.y.greaterThan(128).toVar()];
        const right = select(afterX, page.x.add(uint(1)).lessThan(level.pages.x), page.x.greaterThan(uint(0)));
        const down = select(afterY, page.y.add(uint(1)).lessThan(level.pages.y), page.y.greaterThan(uint(0)));
        const near = (after, position) => select(after, float(256).sub(position), position);
        const nearX = select(right, near(afterX, local.x), float(1e9));
        const nearY = select(down, near(afterY, local.y), float(1e9));
        const rise = clamp(vec2(nearX, nearY).sub(0.5).div(FADE_TEXELS), vec2(0), vec2(1)).toVar();
        const beside = (after, number) => select(after, number.add(uint(1)), number.sub(uint(1)));
        const neighbour = uvec2(beside(afterX, page.x), beside(afterY, page.y)).toVar();
        const isAbsent = (other) => this.entryOf(level, other).equal(uint(0));
        const share = select(isAbsent(page), float(0), float(1)).toVar();
        If(rise.x.lessThan(1), () => {
            If(isAbsent(uvec2(neighbour.x, page.y)), () => { share.assign(min(share, rise.x)); });
        });
        If(rise.y.lessThan(1), () => {
            If(isAbsent(uvec2(page.x, neighbour.y)), () => { share.assign(min(share, rise.y)); });
        });
        const corner = max(rise.x, rise.y).toVar();
        If(corner.lessThan(1), () => {
            If(isAbsent(neighbour), () => { share.assign(min(share, corner)); });
        });
        return share;
    }

    /** The same for any tile. A look-up across the border of pages is made of single texels, each from its own page. */
    addPagedLevels(sums, group, levels, probes, uv, left) {
        const perProbe = float(1).div(float(probes.count)).toVar();
        left.assign(float(1).sub(levels.coarseShare));
        const coarse = levels.coarseShare.toVar();
        Loop({ start: levels.fine, end: levels.last, type: "uint", condition: "<=", name: "number" }, ({ number }) => {
            const level = this.tileLevel(group, number);
            const extent = vec2(level.extent).toVar();
            const taken = float(0).toVar();
            Loop({ start: int(0), end: probes.count, name: "probe" }, ({ probe }) => {
                const position = heldInside(this.probe(uv, probes, probe, perProbe), extent).toVar();
                const page = uvec2(position).shiftRight(uvec2(8)).toVar();
                const local = position.sub(vec2(page.shiftLeft(uvec2(8)))).toVar();
                const share = this.residency(level, page, local);
                If(share.lessThanEqual(0), () => { Continue(); });
                const weight = left.mul(perProbe).mul(share).toVar();
                taken.addAssign(weight);
                const isInside = min(local.x, local.y).greaterThanEqual(0.5).and(max(local.x, local.y).lessThanEqual(255.5));
                If(isInside, () => {
                    this.tap(sums, placeOf(this.entryOf(level, page)).add(local), weight);
                    Continue();
                });
                this.addSingleTexels(sums, level, position, weight);
            });
            // What rounding leaves over is none.
            const rest = left.sub(taken).toVar();
            left.assign(select(rest.lessThan(1e-5), float(0), rest).add(coarse));
            coarse.assign(0);
            If(left.lessThanEqual(0), () => { Break(); });
        });
    }

    addSingleTexels(sums, level, position, weight) {
        const first = floor(position.sub(0.5)).toVar();
        const fraction = position.sub(0.5).sub(first).toVar();
        Loop({ start: uint(0), end: uint(4), type: "uint", name: "texel" }, ({ texel }) => {
            const corner = uvec2(texel.bitAnd(uint(1)), texel.shiftRight(uint(1))).toVar();
            const single = uvec2(first).add(corner).toVar();
            const portions = mix(vec2(1).sub(fraction), fraction, vec2(corner)).toVar();
            const portion = portions.x.mul(portions.y).toVar();
            If(portion.greaterThan(0), () => {
                const place = placeOf(this.entryOf(level, single.shiftRight(uvec2(8))));
                this.tap(sums, place.add(vec2(single.bitAnd(uvec2(255)))).add(0.5), weight.mul(portion));
            });
        });
    }

    /** All channels of a tile at tile coordinates with their derivatives per pixel. */
    sample(number, record, uv, dx, dy) {
        const group = { firstPage: record.x, quarters: uvec2(record.y.bitAnd(uint(0xFFFF)), record.y.shiftRight(uint(16))).toVar() };
        const pixel = footprintOf(dx, dy);
        const levels = this.chooseLevels(group.quarters, pixel);
        const probes = this.chooseProbes(group.quarters, pixel);
        const sums = { baseColor: vec4(0).toVar(), material: vec4(0).toVar(), emission: vec4(0).toVar(), light: vec4(0).toVar(), normal: vec2(0).toVar() };
        const left = float(0).toVar();
        const single = () => this.addLevels(sums, group, levels, probes, uv, left);
        if (this.isPaged) {
            If(max(group.quarters.x, group.quarters.y).greaterThan(uint(64)), () => {
                this.addPagedLevels(sums, group, levels, probes, uv, left);
            }).Else(single);
        } else {
            single();
        }
        If(left.greaterThan(0), () => { this.addMean(sums, number, left); });
        return sums;
    }

    /** The x axis of a tile's shading frame, object space. */
    shadingAxis(group, vertexNormal) {
        const texel = group.mul(uint(2)).toVar();
        const first = entry(this.frames, texel).toVar();
        const second = entry(this.frames, texel.add(uint(1))).toVar();
        const d = first.xyz;
        const x = vec3(first.w, second.xy).toVar();
        const turned = x.sub(d.add(vertexNormal).mul(dot(x, vertexNormal).div(max(dot(d, vertexNormal).add(1), 1e-4)))).toVar();
        const otherwise = select(abs(vertexNormal.x).greaterThan(0.8), vec3(0, 1, 0), vec3(1, 0, 0));
        return unitOr(turned.sub(vertexNormal.mul(dot(turned, vertexNormal))).toVar(), otherwise);
    }

    /** The texture function at a fragment. */
    surface() {
        const groups = varying(attribute("fanGroups", "uvec3"));
        const record = (corner) => varying(entry(this.groups, attribute("fanGroups", "uvec3")[corner]).xy);
        const uv01 = varying(attribute("fanUv01", "vec4"));
        const [dx01, dy01] = [dFdx(uv01).toVar(), dFdy(uv01).toVar()];
        const vertexNormal = varying(normalLocal).normalize().toVar();
        const result = { baseColor: vec4(0).toVar(), material: vec3(0).toVar(), emission: vec3(0).toVar(), light: vec3(0).toVar(), normal: vec3(0).toVar() };
        const add = (weight, group, ...place) => {
            const tile = this.sample(group, ...place);
            for (const { name } of this.kinds) {
                const own = {
                    baseColor: () => tile.baseColor,
                    normal: () => objectNormal(tile.normal, this.shadingAxis(group, vertexNormal), vertexNormal),
                }[name] ?? (() => tile[name].rgb);
                result[name].addAssign(own().mul(weight));
            }
        };
        if (this.isSingle) {
            add(1, groups.x.toVar(), record("x").toVar(), uv01.xy, dx01.xy, dy01.xy);
        } else {
            this.addSlots(add, groups, ["x", "y", "z"].map(record), uv01, dx01, dy01);
        }
        return FanSurface(result.baseColor, result.material, result.emission, result.light, unitOr(result.normal, vertexNormal));
    }

    /** Of a triangle in several tiles. */
    addSlots(add, groups, records, uv01, dx01, dy01) {
        const uv2 = varying(attribute("fanUv2", "vec2"));
        const lambda01 = varying(attribute("fanCorner", "vec4").xy);
        const [dx2, dy2] = [dFdx(uv2).toVar(), dFdy(uv2).toVar()];
        const lambda = max(vec3(lambda01, float(1).sub(lambda01.x).sub(lambda01.y)), vec3(0)).toVar();
        const weights = weightsOf(groups, lambda, this.delta);
        Loop({ start: 0, end: 3, name: "slot" }, ({ slot }) => {
            const of = (first, second, third) => select(slot.equal(int(0)), first, select(slot.equal(int(1)), second, third)).toVar();
            const weight = of(weights.x, weights.y, weights.z);
            If(weight.lessThanEqual(0), () => { Continue(); });
            const place = [of(...records), of(uv01.xy, uv01.zw, uv2), of(dx01.xy, dx01.zw, dx2), of(dy01.xy, dy01.zw, dy2)];
            add(weight, of(groups.x, groups.y, groups.z), ...place);
        });
    }
}

/** Levels between a page and the one that stands for it. */
function levelsCoarser(word) {
    return word.shiftRight(uint(24)).bitAnd(uint(0x7F));
}

/** First texel of a resident page. */
function placeOf(word) {
    return vec2(uvec2(word.bitAnd(uint(0xFFF)), word.shiftRight(uint(12)).bitAnd(uint(0xFFF))).mul(uvec2(4)));
}

/** Half a texel inside a level, in its texels. */
function heldInside(uv, extent) {
    return clamp(uv.mul(extent), vec2(0.5), extent.sub(0.5));
}
