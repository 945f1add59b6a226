// Draws one triangle of one green tile, of which nothing but its mean is resident, by every material of three and every set of channels, with
// a shadow and surroundings. The state's line has a row for each: its name, the pixel in the middle, what the device says is wrong. Two more
// rows are of a floor in its shadow, where the tile is opaque, and where it is cut out. The address takes ?renderer=webgl, webgpu or webgl2.

import * as THREE from "three";

import { fanUniforms, patchMaterial, shadowMaterials } from "../src/materials.js";
import { createTexture, deviceOf } from "../src/textures.js";

const LIT = ["MeshStandardMaterial", "MeshPhysicalMaterial", "MeshLambertMaterial", "MeshPhongMaterial", "MeshToonMaterial"];
const OTHERS = ["MeshBasicMaterial", "MeshMatcapMaterial", "MeshNormalMaterial"];

async function makeRenderer(name) {
    if (name === "webgl") return [new THREE.WebGLRenderer(), patchMaterial];
    const { WebGPURenderer, PMREMGenerator } = await import("three/webgpu");
    const { addNodes } = await import("../src/materialNodes.js");
    const renderer = new WebGPURenderer({ forceWebGL: name === "webgl2" });
    await renderer.init();
    return [renderer, (material, uniforms, defines) => { addNodes(material, uniforms, defines); return material; }, PMREMGenerator];
}

const [renderer, patch, PMREMGenerator = THREE.PMREMGenerator] = await makeRenderer(new URLSearchParams(location.search).get("renderer") ?? "webgl");
renderer.setSize(64, 64);
renderer.shadowMap.enabled = true;
const device = deviceOf(renderer);

function texture(format, width, data) {
    const made = createTexture(device, [width, 1], format, format.startsWith("rgba8"));
    made.set(0, 0, width, 1, data);
    return made.external;
}

/** Of all channels that are drawn: green, plain normals, rough, dark, white light. */
const channels = [0, 1, 2, 3, 5].map((kind) => ({ kind, format: 6, srgb: false }));

function uniformsOf(opacity) {
    const means = [[0, 1, 0, opacity], [0.5, 0.5, 0, 1], [1, 1, 0, 1], [0, 0, 0, 1], [1, 1, 1, 1]];
    const uniforms = fanUniforms(0.1, channels, 8);
    device.prepareUploads();
    uniforms.fanGroupTable.value = texture("rg32ui", 1, new Uint32Array([0, 1 | 1 << 16]));
    uniforms.fanPages.value = texture("r32ui", 1, new Uint32Array([0]));
    uniforms.fanMeans.value = texture("rgba32f", means.length, new Float32Array(means.flat()));
    uniforms.fanFrames.value = texture("rgba32f", 2, new Float32Array([0, 0, 1, 1, 0, 0, 0, 0]));
    for (const name of ["fanBaseColor", "fanNormalMap", "fanMaterial", "fanEmission", "fanLight"]) {
        uniforms[name].value = texture("rgba8", 1, new Uint8Array([255, 0, 0, 255]));
    }
    return uniforms;
}

const geometry = new THREE.BufferGeometry();
geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, 0, 1, 0]), 3));
geometry.setAttribute("normal", new THREE.BufferAttribute(new Int16Array([0, 0, 32767, 0, 0, 32767, 0, 0, 32767]), 3, true));
geometry.setAttribute("fanUv01", new THREE.BufferAttribute(new Float32Array(12), 4));
geometry.setAttribute("fanUv2", new THREE.BufferAttribute(new Float32Array(6), 2));
geometry.setAttribute("fanGroups", new THREE.BufferAttribute(new Uint32Array(9), 3));
geometry.setAttribute("fanCorner", new THREE.BufferAttribute(new Uint8Array([255, 0, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0]), 4, true));

const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 10);
camera.position.z = 3;
const lights = [new THREE.DirectionalLight(), new THREE.PointLight()];
for (const light of lights) {
    light.castShadow = true;
    light.position.set(1, 1, 2);
    scene.add(light);
}
scene.fog = new THREE.Fog(0x000000, 10, 20);
scene.environment = new PMREMGenerator(renderer).fromScene(new THREE.Scene()).texture;

const flat = Object.assign(document.createElement("canvas"), { width: 64, height: 64 }).getContext("2d", { willReadFrequently: true });
const rows = [];

/** Draws, and notes a pixel. */
async function note(name, x = 32, y = 32) {
    const gpu = renderer.backend?.device;
    gpu?.pushErrorScope("validation");
    renderer.render(scene, camera);
    const image = new Image();
    image.src = renderer.domElement.toDataURL("image/png");
    await image.decode();
    flat.clearRect(0, 0, 64, 64);
    flat.drawImage(image, 0, 0);
    const pixel = [...flat.getImageData(x, y, 1, 1).data];
    const error = gpu ? (await gpu.popErrorScope())?.message : (renderer.getContext().getError() || "");
    rows.push([name, pixel, String(error ?? "")]);
}

function meshOf(material, uniforms, defines) {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.castShadow = mesh.receiveShadow = true;
    [mesh.customDepthMaterial, mesh.customDistanceMaterial] = shadowMaterials(uniforms, defines);
    return mesh;
}

const all = { FAN_BASE_COLOR: "", FAN_NORMAL: "", FAN_MATERIAL: "", FAN_EMISSION: "", FAN_LIGHT: "" };

async function main() {
    const opaque = uniformsOf(1);
    for (const name of [...LIT, ...OTHERS]) {
        for (const defines of [all, { ...all, FAN_PAGED: "", FAN_ANISOTROPIC: "" }, { FAN_BASE_COLOR: "", FAN_SINGLE_TILE: "" }]) {
            const own = name === "MeshBasicMaterial" ? { ...defines, FAN_UNLIT: "" } : defines;
            const material = patch(new THREE[name]({ side: THREE.DoubleSide, alphaTest: 0.1 }), opaque, own);
            const mesh = meshOf(material, opaque, defines);
            scene.add(mesh);
            await note(name);
            scene.remove(mesh);
        }
    }
    // A floor behind the triangle, and the place of its shadow that the camera sees beside it.
    lights[0].position.set(2, 0, 2);
    lights[1].visible = false;
    const floor = new THREE.Mesh(new THREE.PlaneGeometry(4, 4), new THREE.MeshLambertMaterial());
    floor.position.z = -1;
    floor.receiveShadow = true;
    scene.add(floor);
    for (const [name, uniforms] of [["opaque", opaque], ["cut out", uniformsOf(0)]]) {
        const material = patch(new THREE.MeshLambertMaterial({ alphaTest: 0.5, side: THREE.DoubleSide }), uniforms, all);
        const mesh = meshOf(material, uniforms, all);
        scene.add(mesh);
        await note(name, 6, 47);
        scene.remove(mesh);
    }
}

const state = await main().then(() => "sharp", (error) => { rows.push(["", [], String(error.stack)]); return "failed"; });
document.getElementById("line").textContent = JSON.stringify(rows);
document.documentElement.dataset.state = state;
