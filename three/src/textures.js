// Textures of a WebGL 2 context that the core fills piece by piece: the atlas of each channel, the page table, tables of groups.
//
// They are made with the context's own calls, since three uploads whole images only, and shown to three as external textures.

import { ExternalTexture } from "three";

/** Columns of tables, as a binary logarithm; the shaders know it. */
const ROW_SHIFT = 12;
const COLUMNS = 1 << ROW_SHIFT;

/** Kinds of channel, as files number them. */
export const BASE_COLOR = 0, NORMAL = 1, MATERIAL = 2, EMISSION = 3, LIGHT = 5;
const DRAWN = [BASE_COLOR, NORMAL, MATERIAL, EMISSION, LIGHT];

/** Formats of texels, as files number them. */
const [BC1, BC4, BC5, BC7, R8, RG8, RGBA8, RGBA32F] = [0, 1, 2, 3, 4, 5, 6, 7];

/** The context's compressed formats by that number: the extension, its constant, and both for values that are sRGB. */
const COMPRESSED = new Map([
    [BC1, [["WEBGL_compressed_texture_s3tc", "COMPRESSED_RGBA_S3TC_DXT1_EXT"], ["WEBGL_compressed_texture_s3tc_srgb", "COMPRESSED_SRGB_ALPHA_S3TC_DXT1_EXT"]]],
    [BC4, [["EXT_texture_compression_rgtc", "COMPRESSED_RED_RGTC1_EXT"]]],
    [BC5, [["EXT_texture_compression_rgtc", "COMPRESSED_RED_GREEN_RGTC2_EXT"]]],
    [BC7, [["EXT_texture_compression_bptc", "COMPRESSED_RGBA_BPTC_UNORM_EXT"], ["EXT_texture_compression_bptc", "COMPRESSED_SRGB_ALPHA_BPTC_UNORM_EXT"]]],
]);

/** The compressed format of a channel; none where texels are not compressed, undefined where the context has not got it. */
function compressedFormat(gl, { format, srgb }) {
    const names = COMPRESSED.get(format);
    if (!names) return null;
    const [extension, constant] = names[srgb ? 1 : 0];
    return gl.getExtension(extension)?.[constant];
}

/** Whether a context has all compressed formats of an asset's channels. */
export function hasCompressedFormats(gl, channels) {
    return channels.every((channel) => compressedFormat(gl, channel) !== undefined);
}

/** Internal format, format and type of a channel whose texels are not compressed, or are decoded. */
function plainFormat(gl, { format, srgb }) {
    switch (format) {
        case BC4: case R8: return [gl.R8, gl.RED, gl.UNSIGNED_BYTE];
        case BC5: case RG8: return [gl.RG8, gl.RG, gl.UNSIGNED_BYTE];
        case RGBA32F: return [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT];
        default: return [srgb ? gl.SRGB8_ALPHA8 : gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE];
    }
}

/** A texture without levels. */
class PieceTexture {
    constructor(renderer, [width, height], { internal, format, type }, filter) {
        const gl = renderer.getContext();
        this.renderer = renderer;
        this.format = format;
        this.type = type;
        this.internal = internal;
        this.handle = gl.createTexture();
        this.external = new ExternalTexture(this.handle);
        this.bind();
        gl.texStorage2D(gl.TEXTURE_2D, 1, internal, width, height);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    }

    bind() {
        const { state } = this.renderer;
        const gl = this.renderer.getContext();
        state.activeTexture(gl.TEXTURE0);
        state.bindTexture(gl.TEXTURE_2D, this.handle);
    }

    /** Replaces a rectangle. */
    set(x, y, width, height, data) {
        const gl = this.renderer.getContext();
        this.bind();
        if (this.format === null) {
            gl.compressedTexSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, this.internal, data);
        } else {
            gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, this.format, this.type, data);
        }
    }

    dispose() {
        this.external.dispose();
        this.renderer.getContext().deleteTexture(this.handle);
        this.renderer.state.unbindTexture();
    }
}

/** Has the context take data as they are, row after row. */
function prepareUploads(renderer) {
    const gl = renderer.getContext();
    // three keeps track of these where it can.
    const set = renderer.state.pixelStorei?.bind(renderer.state) ?? gl.pixelStorei.bind(gl);
    set(gl.UNPACK_ALIGNMENT, 1);
    set(gl.UNPACK_FLIP_Y_WEBGL, false);
    set(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    set(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
}

/** A table of items of so many numbers each, in rows of `COLUMNS` texels. */
function table(renderer, data, numbers, format) {
    const gl = renderer.getContext();
    const items = Math.max(Math.ceil(data.length / numbers), 1);
    const rows = Math.ceil(items / COLUMNS);
    if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
        throw new Error(`the asset has ${items} entries in a table, more than a texture of this device holds; bake it with larger tiles`);
    }
    const texture = new PieceTexture(renderer, [COLUMNS, rows], format, gl.NEAREST);
    const whole = Math.floor(data.length / numbers / COLUMNS);
    if (whole > 0) texture.set(0, 0, COLUMNS, whole, data.subarray(0, whole * COLUMNS * numbers));
    const rest = data.length / numbers - whole * COLUMNS;
    if (rest > 0) texture.set(0, whole, rest, 1, data.subarray(whole * COLUMNS * numbers));
    return texture;
}

/** All textures of an asset in one context; what the core hands texels and words to. */
export class FanTextures {
    /**
     * @param renderer A `WebGLRenderer`.
     * @param core The open asset.
     * @param channels Its channels.
     * @param options `cacheBytes`, `anisotropy`, `compressed`.
     */
    constructor(renderer, core, channels, options) {
        const gl = renderer.getContext();
        this.renderer = renderer;
        const compressed = options.compressed && hasCompressedFormats(gl, channels);
        const side = gl.getParameter(gl.MAX_TEXTURE_SIZE);
        // Several cards say more than they keep.
        this.extent = core.begin(compressed, Math.min(side, 16384), options.cacheBytes, options.anisotropy);
        prepareUploads(renderer);
        this.atlases = channels.map((channel, index) => {
            // Of several channels of a kind the first one counts.
            const first = channels.findIndex((other) => other.kind === channel.kind);
            if (!DRAWN.includes(channel.kind) || first !== index) return null;
            const own = compressed ? compressedFormat(gl, channel) : null;
            const [internal, format, type] = own ? [own, null, null] : plainFormat(gl, channel);
            return new PieceTexture(renderer, this.extent, { internal, format, type }, gl.LINEAR);
        });
        const words = { internal: gl.R32UI, format: gl.RED_INTEGER, type: gl.UNSIGNED_INT };
        this.pages = new PieceTexture(renderer, core.page_extent(), words, gl.NEAREST);
        const groups = { internal: gl.RG32UI, format: gl.RG_INTEGER, type: gl.UNSIGNED_INT };
        const halves = { internal: gl.RGBA16F, format: gl.RGBA, type: gl.HALF_FLOAT };
        const floats = { internal: gl.RGBA32F, format: gl.RGBA, type: gl.FLOAT };
        this.groups = table(renderer, core.groups(), 2, groups);
        this.means = table(renderer, core.means(), 4, halves);
        this.frames = table(renderer, paddedFrames(core.frames()), 4, floats);
        this.isCompressed = compressed;
    }

    /** To be called before the core hands anything over. */
    prepare() {
        prepareUploads(this.renderer);
    }

    /** See the core's `Sink`. */
    texels(channel, x, y, width, height, bytes) {
        const atlas = this.atlases[channel];
        if (!atlas) return;
        const halves = atlas.type === this.renderer.getContext().HALF_FLOAT;
        atlas.set(x, y, width, height, halves ? new Uint16Array(bytes.slice().buffer) : bytes);
    }

    /** See the core's `Sink`. */
    words(x, y, words) {
        this.pages.set(x, y, words.length, 1, words);
    }

    dispose() {
        for (const texture of [...this.atlases, this.pages, this.groups, this.means, this.frames]) {
            texture?.dispose();
        }
    }
}

/** Six numbers per group as two texels of four. */
function paddedFrames(frames) {
    const padded = new Float32Array(frames.length / 6 * 8);
    for (let i = 0; i < frames.length / 6; i++) padded.set(frames.subarray(6 * i, 6 * i + 6), 8 * i);
    return padded;
}
