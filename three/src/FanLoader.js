import { Loader } from "three";

import { FanMesh } from "./FanMesh.js";
import { FanStream } from "./FanStream.js";

const DEFAULTS = {
    cacheBytes: 256 * 2 ** 20,
    concurrency: 6,
    errorTarget: 1,
    anisotropy: 8,
    compressed: true,
    physical: false,
    worker: true,
    wasmUrl: undefined,
};

function checked(options) {
    const unknown = Object.keys(options).find((name) => !(name in DEFAULTS));
    if (unknown !== undefined) throw new TypeError(`FanLoader has no option "${unknown}"; it has ${Object.keys(DEFAULTS).join(", ")}`);
    const given = Object.fromEntries(Object.entries(options).filter(([, value]) => value !== undefined));
    const all = { ...DEFAULTS, ...given };
    for (const name of ["cacheBytes", "concurrency", "errorTarget", "anisotropy"]) {
        if (!(all[name] > 0 && Number.isFinite(all[name]))) throw new RangeError(`FanLoader's option ${name} is ${all[name]}; a number above 0 is expected`);
    }
    return { ...all, concurrency: Math.ceil(all.concurrency), anisotropy: Math.min(Math.max(all.anisotropy, 1), 16) };
}

/** Opens assets (`.fan`) by address. Of each it fetches what a view needs. */
export class FanLoader extends Loader {
    #options;
    /** What is being opened. */
    #loads = new Set();

    constructor(options = {}, manager) {
        super(manager);
        this.#options = checked(options);
    }

    /** Calls back with a `FanMesh` when mesh and mean colours are there; texels follow by its `update`. */
    load(url, onLoad, onProgress, onError) {
        const item = this.manager.resolveURL(this.path + url);
        this.manager.itemStart(item);
        this.#open(item, onProgress)
            .then(onLoad)
            .catch((error) => {
                if (onError) onError(error);
                else console.error(error);
                this.manager.itemError(item);
            })
            .finally(() => this.manager.itemEnd(item));
    }

    /** Ends what is being loaded: that fails with an `AbortError`. In a worker it leaves nothing; on the page requests under way run out. */
    abort() {
        for (const load of this.#loads) load.abort();
        return this;
    }

    async #open(item, onProgress) {
        // Workers have no document.
        const url = new URL(item, globalThis.document?.baseURI ?? location.href).href;
        const load = new AbortController();
        const abort = () => load.abort();
        const { abortController: ofAll } = this.manager;
        this.#loads.add(load);
        ofAll?.signal.addEventListener("abort", abort);
        try {
            const progress = (loaded) => onProgress?.(new ProgressEvent("progress", { loaded }));
            const request = { url, headers: { ...this.requestHeader }, credentials: this.withCredentials };
            const { stream, asset } = await FanStream.open(request, this.#options, progress, load.signal);
            return new FanMesh(stream, asset, this.#options);
        } finally {
            this.#loads.delete(load);
            ofAll?.signal.removeEventListener("abort", abort);
        }
    }
}
