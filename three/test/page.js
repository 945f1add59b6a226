// The page of the tests in a browser: one asset, a camera and lights from the address, the picture on request.

import {
    Color, DirectionalLight, HalfFloatType, Mesh, MeshStandardMaterial, NoToneMapping, PerspectiveCamera, Scene, SphereGeometry, Vector3,
    WebGLRenderTarget, WebGLRenderer, DataUtils,
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

const renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
renderer.toneMapping = NoToneMapping;
renderer.setSize(640, 480);
renderer.setClearColor(new Color(0, 0, 0), 0);
const scene = new Scene();
const camera = new PerspectiveCamera(Number(query.get("fov") ?? 35), 640 / 480, 0.001, 1000);
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

/** What the device and the page hold. */
function counts() {
    const { memory, programs } = renderer.info;
    return { geometries: memory.geometries, textures: memory.textures, programs: programs?.length ?? 0, children: scene.children.length };
}

let fan = null;

function frame() {
    if (fan === null) return;
    fan.update(camera, renderer);
    renderer.render(scene, camera);
    enter(fan.progress.isSettled ? "sharp" : "sharpening", fan.damage ?? "");
}

async function load() {
    enter("loading");
    const loaded = [];
    try {
        const loader = new FanLoader({ compressed: query.get("compressed") !== "0", anisotropy: Number(query.get("anisotropy") ?? 16), errorTarget: Number(query.get("error") ?? 1) });
        fan = await loader.loadAsync(query.get("asset"), (event) => loaded.push(event.loaded));
    } catch (error) {
        enter("failed", error.message);
        return;
    }
    scene.add(fan);
    window.test.loaded = loaded;
    renderer.setAnimationLoop(frame);
}

/**
 * The picture as a PNG. Canvases mean the samples of a pixel as sRGB values; as the CPU renderer does it in linear light, the scene is drawn
 * into a target of half floats, and encoded here.
 */
function picture() {
    const [width, height] = [canvas.width, canvas.height];
    const target = new WebGLRenderTarget(width, height, { samples: 4, type: HalfFloatType });
    fan.update(camera, renderer);
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    const halves = new Uint16Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, halves);
    target.dispose();
    const image = new ImageData(width, height);
    const encoded = (value) => value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
    for (let i = 0; i < halves.length; i += 4) {
        const row = Math.floor(i / 4 / width);
        const to = i + 4 * width * (height - 1 - 2 * row);
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

/** What the driver calls. */
window.test = {
    renderer, counts, picture,
    fan: () => fan,
    /** Has the material read a channel or do without it. */
    set(define, isRead) {
        if (isRead) fan.material.defines[define] = "";
        else delete fan.material.defines[define];
        fan.material.needsUpdate = true;
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
