// Textures of a WebGPU device that are filled piece by piece.

import { ExternalTexture } from "three";

/** WebGPU's names of formats, sides of their blocks in texels, and bytes of a block. */
const FORMATS = {
    "bc1": ["bc1-rgba-unorm", 4, 8],
    "bc1-srgb": ["bc1-rgba-unorm-srgb", 4, 8],
    "bc4": ["bc4-r-unorm", 4, 8],
    "bc5": ["bc5-rg-unorm", 4, 16],
    "bc7": ["bc7-rgba-unorm", 4, 16],
    "bc7-srgb": ["bc7-rgba-unorm-srgb", 4, 16],
    "r8": ["r8unorm", 1, 1],
    "rg8": ["rg8unorm", 1, 2],
    "rgba8": ["rgba8unorm", 1, 4],
    "rgba8-srgb": ["rgba8unorm-srgb", 1, 4],
    "rgba16f": ["rgba16float", 1, 8],
    "rgba32f": ["rgba32float", 1, 16],
    "r32ui": ["r32uint", 1, 4],
    "rg32ui": ["rg32uint", 1, 8],
};

/** A texture without levels. */
class GpuTexture {
    #device;
    #texture;
    #format;

    constructor(device, size, format) {
        this.#device = device;
        this.#format = format;
        const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
        this.#texture = device.createTexture({ size: [...size], format: format[0], usage });
        this.external = new ExternalTexture(this.#texture);
    }

    /** Replaces a rectangle. */
    set(x, y, width, height, data) {
        const [, side, bytes] = this.#format;
        const layout = { bytesPerRow: Math.ceil(width / side) * bytes };
        this.#device.queue.writeTexture({ texture: this.#texture, origin: [x, y] }, data, layout, [width, height]);
    }

    dispose() {
        this.external.dispose();
        this.#texture.destroy();
    }
}

/** The device that a renderer of three draws with. */
export class GpuDevice {
    #device;

    constructor(device) {
        this.#device = device;
        this.maxSide = device.limits.maxTextureDimension2D;
    }

    hasFormat(format) {
        return FORMATS[format][1] === 1 || this.#device.features.has("texture-compression-bc");
    }

    /** A device says so by itself, later. */
    takeOutOfMemory() {
        return false;
    }

    /** How it is filtered is said by the renderer's samplers. */
    create(extent, format) {
        return new GpuTexture(this.#device, extent, FORMATS[format]);
    }

    prepareUploads() {}
}
