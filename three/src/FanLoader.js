import { Loader } from "three";

import init, { FanCore } from "../built/fantex_three.js";
import { FanMesh } from "./FanMesh.js";

const DEFAULTS = {
    cacheBytes: 256 * 2 ** 20,
    concurrency: 6,
    errorTarget: 1,
    anisotropy: 8,
    compressed: true,
    physical: false,
    wasmUrl: undefined,
};

/** The core, once for all loaders. */
let core = null;

function ready(wasmUrl) {
    // Bundlers look for the address in this form.
    core ??= init({ module_or_path: wasmUrl ?? new URL("../built/fantex_three_bg.wasm", import.meta.url) });
    // What could not be fetched may be there the next time.
    core.catch(() => { core = null; });
    return core;
}

function checked(options) {
    const unknown = Object.keys(options).find((name) => !(name in DEFAULTS));
    if (unknown !== undefined) throw new TypeError(`FanLoader has no option "${unknown}"; it has ${Object.keys(DEFAULTS).join(", ")}`);
    const all = { ...DEFAULTS, ...options };
    for (const name of ["cacheBytes", "concurrency", "errorTarget", "anisotropy"]) {
        if (!(all[name] > 0 && Number.isFinite(all[name]))) throw new RangeError(`FanLoader's option ${name} is ${all[name]}; a number above 0 is expected`);
    }
    return { ...all, concurrency: Math.ceil(all.concurrency), anisotropy: Math.min(Math.max(all.anisotropy, 1), 16) };
}

/** Opens assets (`.fan`) by address. Of each it fetches what a view needs. */
export class FanLoader extends Loader {
    #options;

    constructor(options = {}, manager) {
        super(manager);
        this.#options = checked(options);
    }

    /** Calls back with a `FanMesh` when mesh and mean colours are there; texels follow by its `update`. */
    load(url, onLoad, onProgress, onError) {
        const item = this.manager.resolveURL(this.path + url);
        this.manager.itemStart(item);
        this.#open(new URL(item, document.baseURI).href, onProgress)
            .then(onLoad)
            .catch((error) => {
                if (onError) onError(error);
                else console.error(error);
                this.manager.itemError(item);
            })
            .finally(() => this.manager.itemEnd(item));
    }

    async #open(url, onProgress) {
        await ready(this.#options.wasmUrl);
        const progress = (loaded) => onProgress?.(new ProgressEvent("progress", { loaded }));
        return new FanMesh(await FanCore.open(url, this.#options.concurrency, progress), this.#options);
    }
}
