import { Camera, Loader, LoadingManager, Material, Mesh, Vector3, WebGLRenderer } from "three";
import type { WebGPURenderer } from "three/webgpu";

export interface FanLoaderOptions {
    /** Graphics memory for the texels of each mesh, bytes; 256 MiB unless given. An asset takes no more than it has texels for. */
    cacheBytes?: number;
    /** Requests at a time; 6 unless given. */
    concurrency?: number;
    /** Pixels that a texel may be wide on the screen; 1 unless given, more is coarser. */
    errorTarget?: number;
    /** Greatest anisotropy that look-ups honour, 1 (trilinear) to 16; 8 unless given. */
    anisotropy?: number;
    /** Whether texels stay compressed in graphics memory where the device has the formats; true unless given. */
    compressed?: boolean;
    /** Whether lit materials are `MeshPhysicalMaterial`, else `MeshStandardMaterial`; false unless given. */
    physical?: boolean;
    /**
     * Whether assets are read and unpacked in workers, one for each mesh; true unless given. Where a page may have none, that is done on
     * the page in any case.
     */
    worker?: boolean;
    /** Address of `fantex_three_bg.wasm`, where the bundler does not find it by itself. */
    wasmUrl?: string | URL;
}

/** Opens assets (`.fan`) by address. Of each it fetches what a view needs. */
export class FanLoader extends Loader<FanMesh> {
    constructor(options?: FanLoaderOptions, manager?: LoadingManager);
    /**
     * Ends what is being loaded: that fails with an `AbortError`, and leaves nothing. (Without a worker, requests under way run out, and what
     * they bring is dropped.)
     */
    abort(): this;
}

export interface FanProgress {
    /** Share of the visible tiles that are as sharp as the view asks for, 0 to 1. */
    share: number;
    /** Whether nothing is on its way for the view of the last `update`: the picture stays until the view changes. */
    isSettled: boolean;
    /** Bytes of texels uploaded so far. */
    uploadedBytes: number;
    /** Parts that cannot be read; coarser ones stand in for them. */
    damaged: number;
}

/** A mesh whose texels are streamed. Made by `FanLoader`. */
export class FanMesh extends Mesh {
    private constructor();
    readonly isFanMesh: true;
    /** Pixels that a texel may be wide on the screen. */
    errorTarget: number;
    /** Where the geometry's zero lies in the coordinates of the model's file: zero, unless these are too large for single precision. */
    readonly origin: Vector3;
    /** Whether the core runs in a worker of its own, else on the page. */
    readonly usesWorker: boolean;
    /** How far streaming is. */
    readonly progress: FanProgress;
    /** Why the first part that cannot be read cannot be; null where all can. */
    readonly damage: string | null;
    /** Whether texels lie compressed in graphics memory; null before the first frame. */
    readonly isCompressed: boolean | null;
    /**
     * Fetches what a camera's view needs, and brings what has come to the device. To be called before every frame. Throws why the core or its
     * worker has failed, from then on at every call.
     */
    update(camera: Camera, renderer: WebGLRenderer | WebGPURenderer): void;
    /** Has another material of three show this asset's channels, for good; returns it. A material shows those of one mesh. */
    patch<M extends Material>(material: M): M;
    /** Asks once more for what could not be read. */
    retry(): void;
    /**
     * Ends streaming and its worker, and frees memory and graphics memory. Materials given to `patch` stay the page's. (Without a worker,
     * requests under way run out, and what they bring is dropped.)
     */
    dispose(): void;
}
