// The page around the viewer: events, animation frames, what is said. What is drawn and loaded is decided in WebAssembly.

/** The module around the viewer, which is fetched beside what the viewer asks for first. */
const viewerModule = import("./fantex_web.js");

const canvas = document.querySelector("canvas");
const line = document.getElementById("line");
const bar = document.querySelector("progress");
const preview = document.querySelector("img");

/** Graphics memory for texels. */
const POOL_BYTES = (navigator.deviceMemory ?? 8) < 4 ? 128 * 2 ** 20 : 256 * 2 ** 20;

/** Radians are Rust's affair: a step of the keyboard in canvas heights. */
const KEY_STEP = 0.05;

/** Time for one request, as the viewer's own have it. */
const MAX_REQUEST_MILLISECONDS = 60_000;

/** Bytes of one request: the viewer asks for long ranges piece by piece. */
const MAX_REQUEST_BYTES = 2_097_152;

/** Time between two looks at whether the device is still there, while nothing is drawn. */
const CHECK_MILLISECONDS = 2000;

/** Time without anything new after which the page says that it waits. */
const SLOW_MILLISECONDS = 8000;

/** What a trap of WebAssembly means; it says something else itself. */
const TRAPPED = "The asset needs more memory than this browser gives a page, or the viewer has failed.";

const isTrap = (error) => error instanceof WebAssembly.RuntimeError;

/** What an error says. */
const sentence = (error) => (isTrap(error) ? TRAPPED : error?.message ?? String(error));

let viewer = null;
let scheduled = false;
/** The first picture has been drawn, which may be long after it was asked for. */
let hasPicture = false;
/** More is to come. */
let isLoading = false;
/** Tells of a wait that is long. */
let timer = null;
/** When the last frame began. */
let lastFrame = 0;
/** Bytes of texels that were there when something new came last. */
let uploadedBytes = -1;

/** Says something, with buttons for what can be done about it. Said again, it stays as it is. */
function say(text, kind = "", ...actions) {
    if (line.dataset.said === text) return;
    line.dataset.said = text;
    line.dataset.kind = kind;
    line.textContent = text;
    for (const { name, run } of actions) {
        const button = document.createElement("button");
        button.textContent = name;
        button.addEventListener("click", run);
        line.append(button);
    }
}

/** What the viewer asks for first of a range. */
function firstPiece(range) {
    const [first, last] = range.split("-").map(Number);
    return `${first}-${Math.min(last, first + MAX_REQUEST_BYTES - 1)}`;
}

/** Requests for the starts of ranges of the asset, by these, before the viewer is there to make them. Answers without ranges keep their bodies: none is wanted. */
function fetchAhead(asset, ranges) {
    const controller = new AbortController();
    const timedOut = () => controller.abort(new DOMException("no answer", "TimeoutError"));
    const timeout = setTimeout(timedOut, MAX_REQUEST_MILLISECONDS);
    const answers = new Map();
    for (const range of ranges.map(firstPiece)) {
        const request = { headers: { range: `bytes=${range}` }, signal: controller.signal };
        const answer = fetch(asset, request).then(async (response) => {
            if (response.status !== 206) return response;
            const { status, headers } = response;
            return new Response(await response.arrayBuffer(), { status, headers });
        });
        // Whoever takes it sees the error.
        answer.catch(() => {});
        answers.set(range, answer);
    }
    const stop = () => {
        clearTimeout(timeout);
        controller.abort();
    };
    return { answers, stop };
}

/** For what the page cannot mend: a file that has changed, a lost device. */
const RELOAD = { name: "Load again", run: () => location.reload() };

const SLOW = "Still loading: the connection is slow.";
const SLOW_DEVICE = "Still drawing: this device is slow.";

/** Something new has come: ends the sentence that the page waits, and waits for the next where there is one. Pages that nobody sees get no frames. */
function cameNew(isMore = isLoading) {
    isLoading = isMore;
    clearTimeout(timer);
    if ([SLOW, SLOW_DEVICE].includes(line.dataset.said)) say("");
    if (!isMore || document.hidden) return;
    timer = setTimeout(() => {
        if (line.dataset.kind === "error") return;
        // A device that is behind holds frames back.
        const isBehind = viewer && performance.now() - lastFrame > SLOW_MILLISECONDS / 2;
        say(isBehind ? SLOW_DEVICE : SLOW);
    }, SLOW_MILLISECONDS);
}

/** What the page is doing, for tests, style sheets and whoever measures: a mark on the page's time line tells when it began. */
function enter(state) {
    if (document.documentElement.dataset.state === state) return;
    document.documentElement.dataset.state = state;
    performance.mark(`fantex ${state}`);
    bar.hidden = state === "sharp" || state === "failed";
}

function fail(text) {
    viewer = null;
    cameNew(false);
    enter("failed");
    preview.hidden = false;
    canvas.hidden = true;
    say(text, "error", RELOAD);
}

// Promises of a task that traps are never settled.
for (const kind of ["error", "unhandledrejection"]) {
    addEventListener(kind, ({ error, reason = error }) => {
        if (isTrap(reason)) fail(TRAPPED);
    });
}

// Servers on one's own machine have no picture.
preview.addEventListener("error", () => { preview.hidden = true; });

function schedule() {
    if (!scheduled && viewer) {
        scheduled = true;
        requestAnimationFrame(frame);
    }
}

let isDamaged = false;

function retryDamaged() {
    isDamaged = false;
    viewer?.retry();
    say("");
    schedule();
}

// The network is there again.
window.addEventListener("online", () => { if (isDamaged) retryDamaged(); });

function frame(now) {
    scheduled = false;
    if (!viewer) return;
    lastFrame = performance.now();
    try {
        const progress = viewer.frame(now);
        // How far it is while nothing is finished cannot be told.
        progress.share > 0 ? (bar.value = progress.share) : bar.removeAttribute("value");
        if (progress.is_settled || progress.uploaded_bytes !== uploadedBytes) cameNew(!progress.is_settled);
        uploadedBytes = progress.uploaded_bytes;
        enter(progress.is_preview ? "preview" : progress.is_settled ? "sharp" : "sharpening");
        bar.hidden = progress.is_settled;
        if (!hasPicture && viewer.has_picture()) {
            hasPicture = true;
            performance.mark("fantex picture");
        }
        if (progress.damaged > 0) {
            const retry = { name: "Try again", run: retryDamaged };
            isDamaged = true;
            say(`Some of it cannot be read, and stays coarse or is missing: ${viewer.damage()}`, "error", retry, RELOAD);
        }
        if (!progress.is_settled || !hasPicture) schedule();
        progress.free();
    } catch (error) {
        fail(sentence(error));
    }
}

// The canvas has as many pixels as the screen gives it.

function fit(entry) {
    const box = entry?.devicePixelContentBoxSize?.[0];
    const width = box ? box.inlineSize : Math.round(canvas.clientWidth * devicePixelRatio);
    const height = box ? box.blockSize : Math.round(canvas.clientHeight * devicePixelRatio);
    if (!viewer) {
        canvas.width = Math.max(width, 1);
        canvas.height = Math.max(height, 1);
        return;
    }
    viewer.resize(width, height);
    schedule();
}

function watchSize() {
    const observer = new ResizeObserver((entries) => fit(entries[entries.length - 1]));
    try {
        observer.observe(canvas, { box: "device-pixel-content-box" });
    } catch {
        observer.observe(canvas);
    }
}

// Hands: one pointer turns, with another button or the shift key it shifts; two come closer and shift.

const pointers = new Map();

function change(act) {
    if (!viewer) return;
    act();
    schedule();
}

function place(event) {
    const box = canvas.getBoundingClientRect();
    return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height, height: box.height };
}

canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.focus({ preventScroll: true });
});

canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const others = [...pointers.entries()].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
    const { height } = place(event);
    const [right, down] = [(event.clientX - before.x) / height, (event.clientY - before.y) / height];
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    change(() => {
        if (others.length === 0) {
            const shifts = event.shiftKey || (event.buttons & 6) !== 0;
            shifts ? viewer.pan(right, down) : viewer.orbit(right, down);
            return;
        }
        const [other] = others;
        const length = (x, y) => Math.max(Math.hypot(x - other.x, y - other.y), 1);
        const middle = place({ clientX: (event.clientX + other.x) / 2, clientY: (event.clientY + other.y) / 2 });
        viewer.pan(right / 2, down / 2);
        viewer.zoom(middle.x, middle.y, length(before.x, before.y) / length(event.clientX, event.clientY));
    });
});

for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
}

canvas.addEventListener("contextmenu", (event) => event.preventDefault());

canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    const { x, y } = place(event);
    change(() => viewer.zoom(x, y, Math.exp(Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.002)));
}, { passive: false });

function press(event) {
    const keys = {
        ArrowLeft: [-KEY_STEP, 0], ArrowRight: [KEY_STEP, 0], ArrowUp: [0, -KEY_STEP], ArrowDown: [0, KEY_STEP],
    };
    const actions = {
        "+": () => viewer.zoom(0.5, 0.5, 0.9), "=": () => viewer.zoom(0.5, 0.5, 0.9), "-": () => viewer.zoom(0.5, 0.5, 1 / 0.9),
        Home: () => viewer.reset(), "0": () => viewer.reset(),
    };
    const step = keys[event.key];
    const action = step ? () => (event.shiftKey ? viewer.pan(...step) : viewer.orbit(...step)) : actions[event.key];
    if (action && !event.ctrlKey && !event.metaKey && !event.altKey) {
        event.preventDefault();
        change(action);
    }
}

canvas.addEventListener("keydown", press);

// There is nothing else on the page that arrow keys could be meant for.
document.body.addEventListener("keydown", (event) => {
    if (event.target === document.body) press(event);
});

document.addEventListener("visibilitychange", () => {
    cameNew();
    schedule();
});

// A page that rests asks for no frames, and only a frame finds out that the device is lost.
setInterval(() => {
    if (viewer?.is_lost()) schedule();
}, CHECK_MILLISECONDS);

async function main() {
    enter("loading");
    if (!navigator.gpu) {
        const where = isSecureContext ? "" : " It is off for pages whose address begins with http:// and is not this machine's.";
        fail(`This browser has no WebGPU, which is what the viewer draws with; current versions of Chrome, Edge, Safari and Firefox do.${where}`);
        return;
    }
    say("Loading ...");
    cameNew(true);
    fit();
    const { asset: place, ranges } = document.body.dataset;
    const asset = new URL(place, location.href).href;
    const ahead = fetchAhead(asset, ranges?.split(" ").filter((range) => range) ?? []);
    // The browser starts what draws, which takes a while the first time.
    navigator.gpu.requestAdapter({ powerPreference: "high-performance" }).catch(() => {});
    try {
        const { default: init, Viewer } = await viewerModule;
        await init({ module_or_path: new URL("fantex_web_bg.wasm", import.meta.url) });
        viewer = await Viewer.open(canvas, asset, POOL_BYTES, ahead.answers);
    } catch (error) {
        fail(sentence(error));
        return;
    } finally {
        ahead.stop();
    }
    say("");
    cameNew(true);
    watchSize();
    schedule();
}

main();
