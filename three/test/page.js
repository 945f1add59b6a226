// The page of the tests in a browser: one asset, a camera and lights from the address, the picture on request. `renderer` is `webgl`,
// `webgpu`, or `webgl2` for WebGPURenderer with its other backend; `size` its columns and rows. `worker=0` does without a worker, `no-workers`
// forbids them, `count` counts them; `end=loading` and `end=streaming` end in the middle of that.

import {
    ACESFilmicToneMapping, Box3, CircleGeometry, Color, DataTexture, DataUtils, DirectionalLight, EquirectangularReflectionMapping, FloatType, Fog, HalfFloatType,
    LinearFilter, Mesh, MeshStandardMaterial, NoToneMapping, PerspectiveCamera, RenderTarget, Scene, SphereGeometry, Vector3, WebGLRenderTarget,
    WebGLRenderer,
} from "three";

import { FanLoader } from "@fantex/three";

const query = new URLSearchParams(location.search);
const numbers = (name) => query.get(name).split(",").map(Number);

const line = document.getElementById("line");
const canvas = document.querySelector("canvas");

function enter(state, text = "") {
    document.documentElement.dataset.state = state;
    line.textContent = text;
}

async function makeRenderer(name) {
    // Samples of a pixel are averaged before tone mapping by one renderer, after it by the other.
    const options = { canvas, antialias: !query.has("room"), alpha: true };
    if (name === "webgl") return new WebGLRenderer({ ...options, preserveDrawingBuffer: true });
    const { WebGPURenderer } = await import("three/webgpu");
    const renderer = new WebGPURenderer({ ...options, forceWebGL: name === "webgl2" });
    await renderer.init();
    return renderer;
}

const renderer = await makeRenderer(query.get("renderer") ?? "webgl");
const isWebGpu = renderer.backend?.isWebGPUBackend === true;
renderer.toneMapping = NoToneMapping;
const [width, height] = query.has("size") ? numbers("size") : [640, 480];
renderer.setSize(width, height);
renderer.setClearColor(new Color(0, 0, 0), 0);
const scene = new Scene();
const camera = new PerspectiveCamera(Number(query.get("fov") ?? 35), width / height, 0.001, 1000);
if (query.has("eye")) {
    camera.position.set(...numbers("eye"));
    camera.lookAt(new Vector3(...numbers("target")));
}
if (query.has("sun")) {
    // White, perfectly diffuse surfaces that face it reflect 0.65.
    const sun = new DirectionalLight(0xffffff, 0.65 * Math.PI);
    sun.position.set(...numbers("sun"));
    scene.add(sun);
}

/** A floor with a shadow, surroundings, and fog or tone mapping. (WebGLRenderer mixes fog into the mapped tones, WebGPURenderer before.) */
function furnish(what) {
    const box = new Box3().setFromObject(fan);
    const radius = box.getSize(new Vector3()).length() / 2;
    const centre = box.getCenter(new Vector3());
    if (what === "fog") scene.fog = new Fog(0x8899aa, radius, 8 * radius);
    else renderer.toneMapping = ACESFilmicToneMapping;
    // Bright above, dim below, a warm side.
    const sky = new Float32Array(64 * 32 * 4).map((_, i) => {
        const [channel, column, row] = [i % 4, Math.floor(i / 4) % 64, Math.floor(i / 256)];
        return channel === 3 ? 1 : 0.1 + (row > 16 ? 0.8 : 0) + (channel === 0 && column > 32 ? 0.5 : 0);
    });
    scene.environment = new DataTexture(sky, 64, 32, undefined, FloatType);
    scene.environment.mapping = EquirectangularReflectionMapping;
    scene.environment.minFilter = scene.environment.magFilter = LinearFilter;
    scene.environment.needsUpdate = true;
    const floor = new Mesh(new CircleGeometry(6 * radius, 32), new MeshStandardMaterial({ color: 0x999999, roughness: 1 }));
    floor.rotation.x = -Math.PI / 2;
    floor.position.set(centre.x, box.min.y, centre.z);
    floor.receiveShadow = fan.receiveShadow = fan.castShadow = true;
    const lamp = new DirectionalLight(0xffffff, 2);
    lamp.position.copy(centre).add(new Vector3(-1.5, 2, 1).multiplyScalar(2 * radius));
    lamp.target = fan;
    lamp.castShadow = true;
    lamp.shadow.mapSize.set(1024, 1024);
    Object.assign(lamp.shadow.camera, { left: -2 * radius, right: 2 * radius, top: 2 * radius, bottom: -2 * radius, near: radius, far: 12 * radius });
    lamp.shadow.camera.updateProjectionMatrix();
    lamp.shadow.bias = -0.001;
    lamp.shadow.normalBias = 0.002 * radius;
    scene.add(floor, lamp);
    renderer.shadowMap.enabled = true;
}

/** What the device and the page hold. */
function counts() {
    const { memory, programs } = renderer.info;
    return { geometries: memory.geometries, textures: memory.textures, programs: programs?.length ?? 0, children: scene.children.length };
}

let started = 0;

if (query.has("count")) {
    window.Worker = class extends Worker {
        constructor(url, options) {
            super(`/test/locked.js?${url}`, options);
            started += 1;
        }
    };
}

/** How many workers were started, and how many live: the browser takes its lock away from one that has ended. */
async function workers() {
    return [started, (await navigator.locks.query()).held.length];
}

/** Milliseconds of the page's longest task (which counts from 50 on), and of the longest `update`, from the first byte until the asset is sharp. */
const longest = { task: 0, update: 0 };
const tasks = new PerformanceObserver((list) => list.getEntries().forEach(noteTask));

function noteTask({ duration }) {
    longest.task = Math.max(longest.task, duration);
}

function update() {
    const start = performance.now();
    fan.update(camera, renderer);
    longest.update = Math.max(longest.update, performance.now() - start);
}

let fan = null;

/** Whether the device still draws an earlier frame. */
let isBusy = false;
let isDrawn = false;

function frame() {
    if (fan === null || isBusy) return;
    update();
    const { isSettled } = fan.progress;
    if (query.get("end") === "streaming" && fan.progress.uploadedBytes > 0) {
        test.dispose();
        enter("ended");
        return;
    }
    if (isSettled && !isDrawn) {
        tasks.takeRecords().forEach(noteTask);
        tasks.disconnect();
    }
    // Software takes long to draw: the picture is drawn when it is whole.
    if (isSettled && !isDrawn) draw();
    isDrawn = isSettled;
    enter(isSettled ? "sharp" : "sharpening", fan.damage ?? "");
}

function draw() {
    renderer.render(scene, camera);
    if (!isWebGpu) return;
    isBusy = true;
    renderer.backend.device.queue.onSubmittedWorkDone().then(() => { isBusy = false; });
}

async function load() {
    enter("loading");
    tasks.observe({ type: "longtask" });
    const loaded = [];
    try {
        const loader = new FanLoader({
            compressed: query.get("compressed") !== "0",
            anisotropy: Number(query.get("anisotropy") ?? 16),
            errorTarget: Number(query.get("error") ?? 1),
            worker: query.get("worker") !== "0",
            // As pages that hand on what they may not have been given.
            cacheBytes: undefined,
        });
        fan = await loader.loadAsync(query.get("asset"), (event) => {
            loaded.push(event.loaded);
            if (query.get("end") === "loading") loader.abort();
        });
    } catch (error) {
        enter("failed", error.name === "AbortError" ? error.name : error.message);
        return;
    }
    scene.add(fan);
    if (query.has("room")) furnish(query.get("room"));
    window.test.loaded = loaded;
    renderer.setAnimationLoop(frame);
}

/**
 * The picture as a PNG. Canvases mean the samples of a pixel as sRGB values; as the CPU renderer does it in linear light, the scene is drawn
 * into a target of half floats, and encoded here.
 */
async function picture() {
    const options = { samples: 4, type: HalfFloatType };
    const target = renderer.isWebGLRenderer ? new WebGLRenderTarget(width, height, options) : new RenderTarget(width, height, options);
    fan.update(camera, renderer);
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    const halves = await readPixels(target, width, height);
    target.dispose();
    const image = new ImageData(width, height);
    const encoded = (value) => value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
    for (let i = 0; i < halves.length; i += 4) {
        const row = Math.floor(i / 4 / width);
        // WebGL's first row is the lowest one.
        const to = isWebGpu ? i : i + 4 * width * (height - 1 - 2 * row);
        const [red, green, blue, alpha] = [0, 1, 2, 3].map((k) => DataUtils.fromHalfFloat(halves[i + k]));
        [red, green, blue].forEach((value, k) => {
            image.data[to + k] = Math.round(255 * encoded(Math.min(Math.max(value / Math.max(alpha, 1e-6), 0), 1)));
        });
        image.data[to + 3] = Math.round(255 * alpha);
    }
    const flat = Object.assign(document.createElement("canvas"), { width, height });
    flat.getContext("2d").putImageData(image, 0, 0);
    return flat.toDataURL("image/png");
}

async function readPixels(target, width, height) {
    if (!renderer.isWebGLRenderer) return renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height);
    const halves = new Uint16Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, halves);
    return halves;
}

/** What the canvas shows, with tone mapping. */
function canvasPicture() {
    fan.update(camera, renderer);
    renderer.render(scene, camera);
    return canvas.toDataURL("image/png");
}

/** Milliseconds per frame, from the call until the device has drawn `batch` of them: the least, and the median. */
async function frameTimes(count, batch = 1) {
    renderer.setAnimationLoop(null);
    const times = [];
    for (let i = 0; i < count; i++) {
        const start = performance.now();
        for (let frame = 0; frame < batch; frame++) {
            fan?.update(camera, renderer);
            renderer.render(scene, camera);
        }
        await finished();
        times.push((performance.now() - start) / batch);
    }
    times.sort((a, b) => a - b);
    return [times[0], times[Math.floor(count / 2)]];
}

async function finished() {
    if (isWebGpu) return renderer.backend.device.queue.onSubmittedWorkDone();
    const gl = renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

/** In the place of an asset: an ordinary model with ordinary textures. */
async function loadPlain(url) {
    const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
    const { scene: model } = await new GLTFLoader().loadAsync(url);
    model.traverse(({ material }) => {
        for (const name of ["map", "normalMap", "roughnessMap", "emissiveMap"]) {
            if (material?.[name]) material[name].anisotropy = Number(query.get("anisotropy") ?? 1);
        }
    });
    scene.add(model);
    renderer.render(scene, camera);
    enter("sharp");
}

/** What the driver calls. */
window.test = {
    renderer, counts, picture, canvasPicture, frameTimes, workers, longest,
    fan: () => fan,
    /** Has the material read a channel or do without it. */
    set(define, isRead) {
        for (const material of [fan.material].flat()) {
            if (isRead) material.defines[define] = "";
            else delete material.defines[define];
            material.needsUpdate = true;
        }
    },
    dispose() {
        renderer.setAnimationLoop(null);
        fan.dispose();
        fan = null;
        renderer.render(scene, camera);
        return counts();
    },
};

// What three makes for lit materials once and for all is there before the asset.
const plain = new Mesh(new SphereGeometry(), new MeshStandardMaterial());
scene.add(plain);
renderer.render(scene, camera);
scene.remove(plain);
plain.geometry.dispose();
plain.material.dispose();
renderer.render(scene, camera);
window.test.before = counts();
if (query.has("asset")) load();
if (query.has("plain")) loadPlain(query.get("plain"));
