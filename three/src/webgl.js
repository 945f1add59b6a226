// Textures of a WebGL 2 context that are filled piece by piece.

import { ExternalTexture } from "three";

/** Compressed formats: the extension and its constant. */
const BLOCKS = {
    "bc1": ["WEBGL_compressed_texture_s3tc", "COMPRESSED_RGBA_S3TC_DXT1_EXT"],
    "bc1-srgb": ["WEBGL_compressed_texture_s3tc_srgb", "COMPRESSED_SRGB_ALPHA_S3TC_DXT1_EXT"],
    "bc4": ["EXT_texture_compression_rgtc", "COMPRESSED_RED_RGTC1_EXT"],
    "bc5": ["EXT_texture_compression_rgtc", "COMPRESSED_RED_GREEN_RGTC2_EXT"],
    "bc7": ["EXT_texture_compression_bptc", "COMPRESSED_RGBA_BPTC_UNORM_EXT"],
    "bc7-srgb": ["EXT_texture_compression_bptc", "COMPRESSED_SRGB_ALPHA_BPTC_UNORM_EXT"],
};

/** Other formats: names of the internal format, the format and the type. */
const PLAIN = {
    "r8": ["R8", "RED", "UNSIGNED_BYTE"],
    "rg8": ["RG8", "RG", "UNSIGNED_BYTE"],
    "rgba8": ["RGBA8", "RGBA", "UNSIGNED_BYTE"],
    "rgba8-srgb": ["SRGB8_ALPHA8", "RGBA", "UNSIGNED_BYTE"],
    "rgba16f": ["RGBA16F", "RGBA", "HALF_FLOAT"],
    "rgba32f": ["RGBA32F", "RGBA", "FLOAT"],
    "r32ui": ["R32UI", "RED_INTEGER", "UNSIGNED_INT"],
    "rg32ui": ["RG32UI", "RG_INTEGER", "UNSIGNED_INT"],
};

/** Errors that a context may keep at a time. */
const MAX_ERRORS = 8;

/** A texture without levels. */
class GlTexture {
    #device;
    #handle;
    #formats;

    /** `formats`: the internal format, and the format and the type of data, without the latter two where it is compressed. */
    constructor(device, [width, height], formats, isFiltered) {
        const { gl } = device;
        const filter = isFiltered ? gl.LINEAR : gl.NEAREST;
        this.#device = device;
        this.#formats = formats;
        this.#handle = gl.createTexture();
        this.external = new ExternalTexture(this.#handle);
        device.bind(this.#handle);
        gl.texStorage2D(gl.TEXTURE_2D, 1, formats[0], width, height);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    }

    /** Replaces a rectangle. */
    set(x, y, width, height, data) {
        const { gl } = this.#device;
        const [internal, format, type] = this.#formats;
        this.#device.bind(this.#handle);
        if (format === undefined) {
            gl.compressedTexSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, internal, data);
        } else {
            const isHalf = type === gl.HALF_FLOAT && !(data instanceof Uint16Array);
            gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, format, type, isHalf ? new Uint16Array(data.slice().buffer) : data);
        }
    }

    dispose() {
        this.external.dispose();
        this.#device.gl.deleteTexture(this.#handle);
        this.#device.state.unbindTexture();
    }
}

/** The context that a renderer of three draws with. */
export class GlDevice {
    /** `state`: what three knows of the context's state. */
    constructor(gl, state) {
        this.gl = gl;
        this.state = state;
        this.maxSide = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    }

    /** The internal format of a compressed format; undefined where the context has not got it. */
    #block(format) {
        const [extension, constant] = BLOCKS[format];
        return this.gl.getExtension(extension)?.[constant];
    }

    hasFormat(format) {
        return format in PLAIN || this.#block(format) !== undefined;
    }

    /** Whether the context has refused memory since this was asked last. It waits for the device. */
    takeOutOfMemory() {
        const { gl } = this;
        const errors = Array.from({ length: MAX_ERRORS }, () => gl.getError());
        return errors.includes(gl.OUT_OF_MEMORY);
    }

    create(extent, format, isFiltered) {
        const formats = format in BLOCKS ? [this.#block(format)] : PLAIN[format].map((name) => this.gl[name]);
        return new GlTexture(this, extent, formats, isFiltered);
    }

    bind(handle) {
        this.state.activeTexture(this.gl.TEXTURE0);
        this.state.bindTexture(this.gl.TEXTURE_2D, handle);
    }

    /** Has the context take data as they are, row after row. */
    prepareUploads() {
        const { gl } = this;
        // three keeps track of these where it can.
        const set = this.state.pixelStorei?.bind(this.state) ?? gl.pixelStorei.bind(gl);
        set(gl.UNPACK_ALIGNMENT, 1);
        set(gl.UNPACK_FLIP_Y_WEBGL, false);
        set(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
        set(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
        gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
    }
}
