// The page of the tests in a browser: one asset, a camera and lights from the address, the picture on request.

import {
    Color, DirectionalLight, MeshBasicMaterial, NoToneMapping, PerspectiveCamera, Scene, Vector3, WebGLRenderer,
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

/** What the driver calls. */
window.test = {
    renderer, scene, camera, counts, load, MeshBasicMaterial,
    fan: () => fan,
    picture() {
        frame();
        return canvas.toDataURL("image/png");
    },
    dispose() {
        renderer.setAnimationLoop(null);
        fan.dispose();
        fan = null;
        renderer.render(scene, camera);
        return counts();
    },
};

// Something to compare with when it is gone again.
renderer.render(scene, camera);
window.test.before = counts();
if (query.has("asset")) load();
