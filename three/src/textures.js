// Textures that the core fills piece by piece: the atlas of each channel, the page table, tables of groups.
//
// They are made with the device's own calls (`webgl.js`, `webgpu.js`), since three uploads whole images only, and shown to three as external
// textures.

import { FloatType, HalfFloatType, LinearFilter, NearestFilter, UnsignedByteType, UnsignedIntType } from "three";

import { GlDevice } from "./webgl.js";
import { GpuDevice } from "./webgpu.js";

/** Columns of tables, that of pages among them; the shaders know it. WebGL 2 promises half as many, so not every device has them. */
const COLUMNS = 4096;

/** Kinds of channel, as files number them. */
export const BASE_COLOR = 0, NORMAL = 1, MATERIAL = 2, EMISSION = 3, LIGHT = 5;

/** Formats of texels, as files number them: how devices that have it hold them, and how others do. */
const FORMATS = [
    { block: "bc1", plain: "rgba8" },
    { block: "bc4", plain: "r8" },
    { block: "bc5", plain: "rg8" },
    { block: "bc7", plain: "rgba8" },
    { block: null, plain: "r8" },
    { block: null, plain: "rg8" },
    { block: null, plain: "rgba8" },
    { block: null, plain: "rgba16f" },
];

/** What three is told of a texture's texels. */
const TYPES = { r32ui: UnsignedIntType, rg32ui: UnsignedIntType, rgba16f: HalfFloatType, rgba32f: FloatType };

/** Formats for values that are sRGB have names of their own. */
function named(format, srgb) {
    return srgb && ["bc1", "bc7", "rgba8"].includes(format) ? `${format}-srgb` : format;
}

/** The device for a renderer's context. */
export function deviceOf(renderer) {
    if (renderer.isWebGLRenderer) return new GlDevice(renderer.getContext(), renderer.state);
    const { backend } = renderer;
    return backend.isWebGPUBackend ? new GpuDevice(backend.device) : new GlDevice(backend.gl, backend.state);
}

/** Whether a device has all compressed formats of channels. */
function hasBlockFormats(device, channels) {
    return channels.every(({ format, srgb }) => !FORMATS[format].block || device.hasFormat(named(FORMATS[format].block, srgb)));
}

/** A texture of a device, as three sees it. */
export function createTexture(device, extent, format, isFiltered) {
    const texture = device.create(extent, format, isFiltered);
    const { external } = texture;
    external.type = TYPES[format] ?? UnsignedByteType;
    external.minFilter = external.magFilter = isFiltered ? LinearFilter : NearestFilter;
    external.generateMipmaps = false;
    return texture;
}

/** Refuses devices whose textures cannot hold any table. */
function checkDevice({ maxSide }) {
    if (maxSide < COLUMNS) {
        throw new Error(`the device has textures of at most ${maxSide} x ${maxSide} texels, and a FanMesh needs ${COLUMNS} x ${COLUMNS}; show it on another device`);
    }
}

/** A table in rows of `COLUMNS` texels. */
function emptyTable(device, [columns, rows], format) {
    if (rows > device.maxSide) {
        throw new Error(`the asset has ${rows} rows of ${columns} entries in a table, and a texture of this device has ${device.maxSide} rows; bake it with larger tiles`);
    }
    return createTexture(device, [columns, rows], format, false);
}

/** A table of items of so many numbers each. */
function table(device, data, numbers, format) {
    const items = Math.max(Math.ceil(data.length / numbers), 1);
    const texture = emptyTable(device, [COLUMNS, Math.ceil(items / COLUMNS)], format);
    const whole = Math.floor(data.length / numbers / COLUMNS);
    if (whole > 0) texture.set(0, 0, COLUMNS, whole, data.subarray(0, whole * COLUMNS * numbers));
    const rest = data.length / numbers - whole * COLUMNS;
    if (rest > 0) texture.set(0, whole, rest, 1, data.subarray(whole * COLUMNS * numbers));
    return texture;
}

/** All textures of an asset on one device; what the core hands texels and words to. */
export class FanTextures {
    #device;

    /**
     * @param renderer A renderer of three that is ready to draw.
     * @param asset The asset's `channels`, `tables` and `atlases`.
     * @param wantsCompressed Whether texels stay compressed where the device has the formats.
     */
    constructor(renderer, { channels, tables, atlases }, wantsCompressed) {
        const device = deviceOf(renderer);
        checkDevice(device);
        this.#device = device;
        this.renderer = renderer;
        const drawn = channels.filter(({ isDrawn }) => isDrawn);
        const compressed = wantsCompressed && hasBlockFormats(device, drawn);
        /** The one of the asset's for this device. */
        this.atlas = atlases.find((atlas) => atlas.compressed === compressed && atlas.maxSide <= device.maxSide);
        this.extent = this.atlas.extent;
        this.isCompressed = compressed && drawn.some(({ format }) => FORMATS[format].block !== null);
        device.prepareUploads();
        try {
            this.#make(channels, tables, compressed);
        } catch (error) {
            this.dispose();
            throw error;
        }
    }

    #make(channels, tables, compressed) {
        const device = this.#device;
        // What others were refused is not meant.
        device.takeOutOfMemory();
        this.atlases = channels.map(({ format, srgb, isDrawn }) => {
            if (!isDrawn) return null;
            const { block, plain } = FORMATS[format];
            return createTexture(device, this.extent, named(compressed && block ? block : plain, srgb), true);
        });
        this.pages = emptyTable(device, tables.pageExtent, "r32ui");
        this.groups = table(device, tables.groups, 2, "rg32ui");
        this.means = table(device, tables.means, 4, "rgba16f");
        this.frames = table(device, tables.frames, 4, "rgba32f");
        if (device.takeOutOfMemory()) {
            const [width, height] = this.extent;
            throw new Error(`the device has no graphics memory for textures of ${width} x ${height} texels, one for each channel of an asset; a FanLoader with less cacheBytes makes smaller ones`);
        }
    }

    /** To be called before the core hands anything over. */
    prepare() {
        this.#device.prepareUploads();
    }

    /** See the core's `Sink`. */
    texels(channel, x, y, width, height, bytes) {
        this.atlases[channel].set(x, y, width, height, bytes);
    }

    /** See the core's `Sink`. */
    words(x, y, words) {
        this.pages.set(x, y, words.length, 1, words);
    }

    dispose() {
        for (const texture of [...(this.atlases ?? []), this.pages, this.groups, this.means, this.frames]) {
            texture?.dispose();
        }
    }
}
