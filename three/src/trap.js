// What is done about traps of WebAssembly: memory at an end, or a mistake of the core's.

/** What a page is told of one. */
export const TRAPPED = "the asset needs more memory than this browser gives, or the core of @fantex/three has failed";

export const isTrap = (error) => error instanceof WebAssembly.RuntimeError;

/** A promise of the core's that fails where a task of the core's traps: by itself it would never be settled. */
export async function orTrap(promise) {
    const kinds = ["error", "unhandledrejection"];
    let onError;
    const trap = new Promise((_, reject) => {
        onError = ({ error, reason = error }) => { if (isTrap(reason)) reject(reason); };
    });
    for (const kind of kinds) addEventListener(kind, onError);
    try {
        return await Promise.race([promise, trap]);
    } finally {
        for (const kind of kinds) removeEventListener(kind, onError);
    }
}
