// The two ways between a page and an engine. Both have `post(message, buffers)`, `onAnswer` and `close()`.

import { TRAPPED } from "./trap.js";

/** On the page it takes what a frame has to spare. */
const SLICE_MILLISECONDS = 6;

/** To an engine in a worker. */
class WorkerTransport {
    usesWorker = true;
    onAnswer = () => {};
    #worker;

    constructor(worker) {
        this.#worker = worker;
        worker.onmessage = ({ data }) => this.onAnswer(data);
        worker.onerror = ({ message = "" }) => {
            // Errors come as text from a worker.
            const sentence = message.includes("RuntimeError") ? TRAPPED : message || "the worker of a FanMesh has ended";
            this.onAnswer({ type: "failed", sentence });
        };
    }

    /** The buffers change hands. */
    post(message, buffers) {
        this.#worker.postMessage(message, buffers);
    }

    /** Its memory and its requests end with the worker. */
    close() {
        this.onAnswer = () => {};
        this.#worker.terminate();
    }
}

/** To an engine on the page: answers are there when `post` returns, but for those to `open`. */
class PageTransport {
    usesWorker = false;
    onAnswer = () => {};
    #engine;

    constructor(Engine) {
        this.#engine = new Engine((answer) => this.onAnswer(answer), SLICE_MILLISECONDS);
    }

    post(message) {
        this.#engine.receive(message);
    }

    close() {
        this.onAnswer = () => {};
        this.#engine.receive({ type: "close" });
    }
}

/** A worker that has said that it is there; null where pages may have none, or its script cannot be had, or `signal` says to end. */
function startWorker(signal) {
    return new Promise((resolve) => {
        try {
            // Bundlers look for the script in this form.
            const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
            const give = (what) => {
                if (what === null) worker.terminate();
                resolve(what);
            };
            worker.onmessage = () => give(worker);
            worker.onerror = (event) => {
                event.preventDefault();
                give(null);
            };
            signal.addEventListener("abort", () => give(null), { once: true });
        } catch {
            resolve(null);
        }
    });
}

/** Starts an engine, in a worker where one is wanted and can be made, else on the page. */
export async function startEngine(wantsWorker, signal) {
    const worker = wantsWorker ? await startWorker(signal) : null;
    signal.throwIfAborted();
    if (worker !== null) return new WorkerTransport(worker);
    const { Engine } = await import("./engine.js");
    return new PageTransport(Engine);
}
