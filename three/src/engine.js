// The half of an open asset that owns the core: it reads, unpacks, and decides what is resident. It runs in a worker, or on the page where
// there is none, and knows neither three nor a device. Messages come, answers go:
//
//   open { module, url, headers, credentials,        loaded { bytes }, again and again; opened { asset }, see `assetOf`
//          concurrency, cacheBytes }
//   begin { atlas, cacheBytes, anisotropy }          none: the atlas, one of `asset.atlases`, is empty from now on
//   update { view, seconds, demand, spare }          updated { demand, bytes, rectangles, rows, progress, damage }, see `Changes`
//   retry, close                                     none
//
// What goes wrong is answered by failed { sentence }.

import init, { FanCore } from "../built/fantex_three.js";
import { TRAPPED, isTrap, orTrap } from "./trap.js";

/** Sides of textures that devices have. With less than the least one tables have no room, and several cards say more than the greatest but keep less. */
const MAX_SIDES = [16384, 8192, 4096];

/** The least room for the texels of an update, bytes. */
const MIN_ROOM = 1 << 20;

/** Takes a page's messages for one asset. */
export class Engine {
    #answer;
    #sliceMilliseconds;
    #core = null;
    #isClosed = false;

    /**
     * @param answer Called with each answer, and with those buffers in it that may be given away.
     * @param sliceMilliseconds Time of an update that goes into unpacking.
     */
    constructor(answer, sliceMilliseconds) {
        this.#answer = answer;
        this.#sliceMilliseconds = sliceMilliseconds;
    }

    /** Takes a message. All but `open` are done, and answered, when the call returns. */
    async receive(message) {
        try {
            switch (message.type) {
                case "open": await this.#open(message); break;
                case "begin": this.#begin(message); break;
                case "update": this.#update(message); break;
                case "retry": this.#core.retry(); break;
                case "close": this.#close(); break;
            }
        } catch (error) {
            const sentence = isTrap(error) ? TRAPPED : error.message ?? String(error);
            this.#answer({ type: "failed", sentence }, []);
        }
    }

    async #open({ module, url, headers, credentials, concurrency, cacheBytes }) {
        await init({ module_or_path: module });
        if (this.#isClosed) return;
        const onLoaded = (bytes) => this.#answer({ type: "loaded", bytes }, []);
        const core = await orTrap(FanCore.open(url, concurrency, Object.entries(headers).flat(), credentials, onLoaded));
        if (this.#isClosed) {
            core.free();
            return;
        }
        this.#core = core;
        const asset = assetOf(core, cacheBytes);
        const { groups, means, frames } = asset.tables;
        const arrays = [...Object.values(asset.vertices), groups, means, frames];
        this.#answer({ type: "opened", asset }, arrays.map(({ buffer }) => buffer));
    }

    #begin({ atlas: { compressed, maxSide }, cacheBytes, anisotropy }) {
        this.#core.begin(compressed, maxSide, cacheBytes, anisotropy, this.#sliceMilliseconds);
    }

    #update({ view, seconds, demand, spare }) {
        const changes = new Changes(spare);
        this.#core.update(view, seconds, changes);
        const { bytes, rectangles, rows } = changes;
        const [progress, damage] = [progressOf(this.#core), this.#core.damage() ?? null];
        this.#answer({ type: "updated", demand, bytes, rectangles, rows, progress, damage }, [bytes.buffer]);
    }

    #close() {
        this.#isClosed = true;
        this.#core?.free();
        this.#core = null;
    }
}

/** What an update hands over. */
class Changes {
    #length = 0;
    /** Texels, one rectangle after the other; then room. */
    bytes;
    /** Six numbers each: the channel, `x`, `y`, `width` and `height` in its atlas, the number of bytes. */
    rectangles = [];
    /** Words of the page table, each `{ x, y, words }` within one row. */
    rows = [];

    /** `spare`: bytes of an earlier update that nobody needs any more, or null. */
    constructor(spare) {
        this.bytes = spare ?? new Uint8Array();
    }

    /** See the core's `Sink`. */
    texels(channel, x, y, width, height, bytes) {
        const end = this.#length + bytes.length;
        if (end > this.bytes.length) {
            const filled = this.bytes.subarray(0, this.#length);
            this.bytes = new Uint8Array(Math.max(end, 2 * this.bytes.length, MIN_ROOM));
            this.bytes.set(filled);
        }
        this.bytes.set(bytes, this.#length);
        this.#length = end;
        this.rectangles.push(channel, x, y, width, height, bytes.length);
    }

    /** See the core's `Sink`. */
    words(x, y, words) {
        this.rows.push({ x, y, words: words.slice() });
    }
}

/** All of an asset that a page draws with, but the texels. */
function assetOf(core, cacheBytes) {
    const geometry = core.geometry();
    const { positions, normals, uv01, uv2, groups, corners, indices, runs, is_paged: isPaged } = geometry;
    geometry.free();
    return {
        vertices: { positions, normals, uv01, uv2, groups, corners, indices },
        bounds: boundsOf(positions),
        runs,
        isPaged,
        channels: channelsOf(core),
        materials: core.materials().map(materialOf),
        origin: core.origin(),
        delta: core.delta(),
        tables: {
            pageExtent: core.page_extent(),
            groups: core.groups(),
            means: core.means(),
            frames: paddedFrames(core.frames()),
        },
        // Known before the device is: a page makes its textures without waiting for an answer, and its first picture shows the mean colours.
        atlases: MAX_SIDES.flatMap((maxSide) => [false, true].map((compressed) => (
            { compressed, maxSide, extent: core.atlas_extent(compressed, maxSide, cacheBytes) }
        ))),
    };
}

/** The box of points, and the sphere around its middle. */
function boundsOf(positions) {
    const [min, max] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (let i = 0; i < positions.length; i += 3) {
        for (let k = 0; k < 3; k++) {
            min[k] = Math.min(min[k], positions[i + k]);
            max[k] = Math.max(max[k], positions[i + k]);
        }
    }
    const centre = [0, 1, 2].map((k) => 0.5 * (min[k] + max[k]));
    let square = 0;
    for (let i = 0; i < positions.length; i += 3) {
        const [x, y, z] = [positions[i] - centre[0], positions[i + 1] - centre[1], positions[i + 2] - centre[2]];
        square = Math.max(square, x * x + y * y + z * z);
    }
    return { min, max, centre, radius: Math.sqrt(square) };
}

function channelsOf(core) {
    const numbers = core.channels();
    return Array.from({ length: numbers.length / 4 }, (_, i) => {
        const [kind, format, srgb, isDrawn] = numbers.subarray(4 * i, 4 * i + 4);
        return { kind, format, srgb: srgb === 1, isDrawn: isDrawn === 1 };
    });
}

function materialOf(own) {
    const { name, emission, metallic, roughness, unlit } = own;
    const [baseColor, alphaMode, alphaThreshold, doubleSided] = [own.base_color, own.alpha_mode, own.alpha_threshold, own.double_sided];
    own.free();
    return { name, baseColor, emission, metallic, roughness, alphaMode, alphaThreshold, doubleSided, unlit };
}

function progressOf(core) {
    const progress = core.progress();
    const { share, is_settled: isSettled, uploaded_bytes: uploadedBytes, damaged } = progress;
    progress.free();
    return { share, isSettled, uploadedBytes, damaged };
}

/** Six numbers per group as two texels of four. */
function paddedFrames(frames) {
    const padded = new Float32Array(frames.length / 6 * 8);
    for (let i = 0; i < frames.length / 6; i++) padded.set(frames.subarray(6 * i, 6 * i + 6), 8 * i);
    return padded;
}
