// The page's half of an open asset: what it has asked its engine for, and what has come.

import { startEngine } from "./transport.js";

const NOTHING = { demand: -1, progress: { share: 0, isSettled: false, uploadedBytes: 0, damaged: 0 }, damage: null };

/** The core, compiled once for all engines. */
let compiling = null;

function compiled(wasmUrl) {
    // Bundlers look for the address in this form.
    compiling ??= compile(wasmUrl ?? new URL("../built/fantex_three_bg.wasm", import.meta.url));
    // What could not be fetched may be there the next time.
    compiling.catch(() => { compiling = null; });
    return compiling;
}

async function compile(url) {
    const response = await fetch(url);
    if (!response.ok) throw new Error(`cannot load ${url}: the server answers ${response.status} ${response.statusText}`);
    // Compiled while it comes, where the server says what it is.
    if (response.headers.get("content-type") === "application/wasm") return WebAssembly.compileStreaming(response);
    return WebAssembly.compile(await response.arrayBuffer());
}

/**
 * Asks for the latest view, once the last answer has come: whatever the engine's pace, one question is on its way at most, and one answer
 * waits to be handed over.
 */
export class FanStream {
    #transport;
    #onLoaded;
    #opened;
    #opening;
    #failure = null;
    #view = new Float64Array(15);
    /** Counts what was asked for: views, atlases, another try. */
    #demand = 0;
    /** What was asked for when the present atlas was begun. */
    #atlasDemand = 0;
    /** Whether an answer is on its way. */
    #isAsking = false;
    #askedAt = null;
    /** The answer to be handed over. */
    #updated = null;
    /** What the last one said that was. */
    #latest = NOTHING;
    /** Bytes that the engine may write into again. */
    #spare = null;

    constructor(transport, onLoaded) {
        this.#transport = transport;
        this.#onLoaded = onLoaded;
        this.#opened = new Promise((resolve, reject) => { this.#opening = { resolve, reject }; });
        // It may fail before anybody waits for it.
        this.#opened.catch(() => {});
        transport.onAnswer = (answer) => this.#receive(answer);
    }

    /**
     * Opens an asset; resolves to `{ stream, asset }`, see the engine's `assetOf`.
     *
     * @param request `url`; `headers` of requests by name; `credentials`: whether these go to servers elsewhere.
     * @param options `worker`, `wasmUrl`, `concurrency`, `cacheBytes`.
     * @param onLoaded Called with the number of bytes that have come.
     * @param signal Ends it.
     */
    static async open(request, options, onLoaded, signal) {
        const module = compiled(options.wasmUrl);
        const stream = new FanStream(await startEngine(options.worker, signal), onLoaded);
        try {
            const aborted = new Promise((_, reject) => { signal.addEventListener("abort", () => reject(signal.reason), { once: true }); });
            signal.throwIfAborted();
            const asset = await Promise.race([stream.#open(module, request, options), aborted]);
            return { stream, asset };
        } catch (error) {
            stream.close();
            throw error;
        }
    }

    async #open(module, request, { concurrency, cacheBytes }) {
        this.#transport.post({ type: "open", module: await module, ...request, concurrency, cacheBytes }, []);
        return this.#opened;
    }

    #receive(answer) {
        switch (answer.type) {
            case "loaded": this.#onLoaded(answer.bytes); break;
            case "opened": this.#opening.resolve(answer.asset); break;
            case "updated":
                this.#isAsking = false;
                // What was for an atlas that is gone goes with it.
                if (answer.demand >= this.#atlasDemand) this.#updated = answer;
                break;
            case "failed":
                // What failed first tells most.
                this.#failure ??= new Error(answer.sentence);
                this.#opening.reject(this.#failure);
                break;
        }
    }

    /** Whether the core runs in a worker. */
    get usesWorker() {
        return this.#transport.usesWorker;
    }

    /** Begins with an empty atlas, also after another one was lost: one of the asset's. */
    begin(atlas, { cacheBytes, anisotropy }) {
        this.#demand += 1;
        this.#atlasDemand = this.#demand;
        this.#updated = null;
        this.#latest = NOTHING;
        this.#transport.post({ type: "begin", atlas, cacheBytes, anisotropy }, []);
    }

    /** Hands what has come to `sink`, and asks for what a view needs, see the core's `update`. Throws what went wrong in the engine. */
    update(view, sink) {
        if (view.some((number, i) => !Object.is(number, this.#view[i]))) {
            this.#view.set(view);
            this.#demand += 1;
        }
        this.#handOver(sink);
        this.#ask();
        if (this.#failure !== null) throw this.#failure;
        // On the page the answer is there already.
        this.#handOver(sink);
    }

    #ask() {
        if (this.#isAsking) return;
        this.#isAsking = true;
        const now = performance.now();
        const seconds = this.#askedAt === null ? 0 : (now - this.#askedAt) / 1000;
        this.#askedAt = now;
        const spare = this.#spare;
        this.#spare = null;
        const message = { type: "update", view: this.#view, seconds, demand: this.#demand, spare };
        this.#transport.post(message, spare === null ? [] : [spare.buffer]);
    }

    #handOver(sink) {
        if (this.#updated === null) return;
        const { demand, bytes, rectangles, rows, progress, damage } = this.#updated;
        this.#updated = null;
        this.#latest = { demand, progress, damage };
        let first = 0;
        for (let i = 0; i < rectangles.length; i += 6) {
            const [channel, x, y, width, height, length] = rectangles.slice(i, i + 6);
            sink.texels(channel, x, y, width, height, bytes.subarray(first, first + length));
            first += length;
        }
        for (const { x, y, words } of rows) sink.words(x, y, words);
        this.#spare = bytes;
    }

    /** How far streaming is. */
    get progress() {
        const { demand, progress } = this.#latest;
        // An answer to an earlier view says nothing about this one.
        return { ...progress, isSettled: progress.isSettled && demand === this.#demand };
    }

    /** Why the first part that cannot be read cannot be; null where all can. */
    get damage() {
        return this.#latest.damage;
    }

    /** Asks once more for what could not be read. */
    retry() {
        this.#demand += 1;
        this.#transport.post({ type: "retry" }, []);
    }

    /** Ends the engine. */
    close() {
        this.#transport.close();
    }
}
