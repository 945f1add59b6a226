// Draws one triangle of one green tile, of which nothing but its mean is resident, by every material of three and every set of channels, with
// a shadow and surroundings. The state's line has a row for each: its name, the pixel in the middle, the context's error.

import * as THREE from "three";

import { fanUniforms, patchMaterial, shadowMaterials } from "../src/materials.js";

const LIT = ["MeshStandardMaterial", "MeshPhysicalMaterial", "MeshLambertMaterial", "MeshPhongMaterial", "MeshToonMaterial"];
const OTHERS = ["MeshBasicMaterial", "MeshMatcapMaterial", "MeshNormalMaterial"];

const renderer = new THREE.WebGLRenderer();
renderer.setSize(64, 64);
renderer.shadowMap.enabled = true;
const gl = renderer.getContext();

function texture(internal, format, type, data, width) {
    const handle = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, handle);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, 1, 0, format, type, data);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return new THREE.ExternalTexture(handle);
}

/** Of all channels that are drawn: green, plain normals, rough, dark, white light. */
const channels = [0, 1, 2, 3, 5].map((kind) => ({ kind, format: 6, srgb: false }));
const means = [[0, 1, 0, 1], [0.5, 0.5, 0, 1], [1, 1, 0, 1], [0, 0, 0, 1], [1, 1, 1, 1]];
const uniforms = fanUniforms({ delta: () => 0.1 }, channels, 8);
uniforms.fanGroupTable.value = texture(gl.RG32UI, gl.RG_INTEGER, gl.UNSIGNED_INT, new Uint32Array([0, 1 | 1 << 16]), 1);
uniforms.fanPages.value = texture(gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, new Uint32Array([0]), 1);
uniforms.fanMeans.value = texture(gl.RGBA32F, gl.RGBA, gl.FLOAT, new Float32Array(means.flat()), means.length);
uniforms.fanFrames.value = texture(gl.RGBA32F, gl.RGBA, gl.FLOAT, new Float32Array([0, 0, 1, 1, 0, 0, 0, 0]), 2);
for (const name of ["fanBaseColor", "fanNormalMap", "fanMaterial", "fanEmission", "fanLight"]) {
    uniforms[name].value = texture(gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 0, 0, 255]), 1);
}
renderer.resetState();

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
for (const light of [new THREE.DirectionalLight(), new THREE.PointLight()]) {
    light.castShadow = true;
    light.position.set(1, 1, 2);
    scene.add(light);
}
scene.fog = new THREE.Fog(0x000000, 10, 20);
scene.environment = new THREE.PMREMGenerator(renderer).fromScene(new THREE.Scene()).texture;

const rows = [];
const all = { FAN_BASE_COLOR: "", FAN_NORMAL: "", FAN_MATERIAL: "", FAN_EMISSION: "", FAN_LIGHT: "" };
for (const name of [...LIT, ...OTHERS]) {
    for (const defines of [all, { ...all, FAN_PAGED: "", FAN_ANISOTROPIC: "" }, { FAN_BASE_COLOR: "" }]) {
        const own = name === "MeshBasicMaterial" ? { ...defines, FAN_UNLIT: "" } : defines;
        const material = new THREE[name]({ side: THREE.DoubleSide, alphaTest: 0.1 });
        const mesh = new THREE.Mesh(geometry, patchMaterial(material, uniforms, own));
        mesh.castShadow = mesh.receiveShadow = true;
        [mesh.customDepthMaterial, mesh.customDistanceMaterial] = shadowMaterials(uniforms, defines);
        scene.add(mesh);
        renderer.render(scene, camera);
        const pixel = new Uint8Array(4);
        gl.readPixels(32, 32, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        rows.push([name, [...pixel], gl.getError()]);
        scene.remove(mesh);
    }
}
document.getElementById("line").textContent = JSON.stringify(rows);
document.documentElement.dataset.state = "sharp";
