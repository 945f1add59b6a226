import { Box3, BufferAttribute, BufferGeometry, Matrix4, Mesh, Sphere, Vector2, Vector3 } from "three";

import { definesOf, fanDefines, fanUniforms, patchMaterial, setTextures, shadowMaterials, surfaceMaterial } from "./materials.js";
import { FanTextures } from "./textures.js";

/** How far away the eye of an orthographic camera is taken to be, in sizes of what it sees. */
const ORTHOGRAPHIC_DISTANCE = 1000;

/** Numbers per run of triangles, see the core's `FanGeometry`. */
const RUN_LENGTH = 6;

/** Nodes for `WebGPURenderer`, once a page draws with one. */
let nodes = null;
let nodesFailure = null;

/** Has three's shading language be there, which other pages do without; whether it is. */
function hasNodes() {
    if (nodesFailure !== null) throw nodesFailure;
    if (nodes === null) {
        nodes = import("./materialNodes.js").then((module) => { nodes = module; }, (error) => {
            nodesFailure = new Error(`FanMesh cannot load what WebGPURenderer needs; the page must find the module three/tsl: ${error.message}`);
        });
    }
    return !(nodes instanceof Promise);
}

/** Materials that show a mesh's channels. */
const shown = new WeakSet();

const objectFromCamera = new Matrix4();
const size = new Vector2();

/** A mesh whose texels are streamed. Made by `FanLoader`. */
export class FanMesh extends Mesh {
    #stream;
    /** What textures are made of: the asset's `channels`, `tables` and `atlases`. */
    #asset;
    #options;
    #defines;
    #uniforms;
    #textures = null;
    /** Why there can be none. */
    #failure = null;
    #isLost = false;
    #canvas = null;
    /** Materials made for the asset's. */
    #own = [];
    /** Materials that show the channels, with their shaders' defines. */
    #patched = new Map();
    /** Those of them that wait to be drawn. */
    #hidden = new Set();
    #view = new Float64Array(15);
    #onLost = () => { this.#isLost = true; };

    constructor(stream, asset, options) {
        super();
        this.isFanMesh = true;
        this.type = "FanMesh";
        const { channels, tables, atlases } = asset;
        this.#stream = stream;
        this.#asset = { channels, tables, atlases };
        this.#options = options;
        /** Whether the core runs in a worker. */
        this.usesWorker = stream.usesWorker;
        /** Pixels that a texel may be wide on the screen. */
        this.errorTarget = options.errorTarget;
        /** Where the geometry's zero lies in the coordinates of the model's file. */
        this.origin = new Vector3(...asset.origin);
        this.position.copy(this.origin);
        this.geometry = geometryOf(asset);
        this.#uniforms = fanUniforms(asset.delta, channels, options.anisotropy);
        this.#defines = fanDefines(channels, asset.isPaged, options.anisotropy);
        this.#setMaterials(asset);
    }

    #setMaterials({ runs, materials: own, channels }) {
        const kinds = new Map();
        const materials = [];
        for (let i = 0; i < runs.length; i += RUN_LENGTH) {
            const [first, count, ...kind] = runs.subarray(i, i + RUN_LENGTH);
            const key = kind.join();
            if (!kinds.has(key)) {
                const [number, isOpposed, hasSeveralTiles, isPaged] = kind;
                const material = surfaceMaterial(own[number], isOpposed === 1, channels, this.#options.physical);
                kinds.set(key, materials.length);
                materials.push(this.#patch(material, definesOf(this.#defines, hasSeveralTiles === 1, isPaged === 1)));
            }
            this.geometry.addGroup(first, count, kinds.get(key));
        }
        if (materials.length === 1) this.geometry.clearGroups();
        this.material = materials.length === 1 ? materials[0] : [...materials];
        if (materials.some((material) => material.alphaTest > 0)) {
            [this.customDepthMaterial, this.customDistanceMaterial] = shadowMaterials(this.#uniforms, this.#defines);
            materials.push(this.customDepthMaterial, this.customDistanceMaterial);
        }
        this.#own = materials;
    }

    /** Has another material of three show this asset's channels, for good; returns it. */
    patch(material) {
        return this.#patched.has(material) ? material : this.#patch(material, this.#defines);
    }

    #patch(material, defines) {
        if (shown.has(material)) {
            throw new Error("a material shows the channels of one FanMesh; this one was given to the patch of another, so make a new one");
        }
        shown.add(material);
        const unlit = material.isMeshBasicMaterial ? { FAN_UNLIT: "" } : {};
        this.#patched.set(material, defines);
        if (this.#textures?.renderer.isWebGPURenderer) nodes.addNodes(material, this.#uniforms, defines);
        return material.isNodeMaterial ? material : patchMaterial(material, this.#uniforms, { ...defines, ...unlit });
    }

    /** Fetches what a camera's view needs, and brings what has come to the device. To be called before every frame. */
    update(camera, renderer) {
        if (this.#stream === null || !this.#prepare(renderer)) return;
        camera.updateWorldMatrix(true, false);
        this.updateWorldMatrix(true, false);
        this.#look(camera, renderer);
        this.#textures.prepare();
        this.#stream.update(this.#view, this.#textures);
    }

    /** The view that the core is told of, see its `update`. */
    #look(camera, renderer) {
        const view = this.#view;
        renderer.getDrawingBufferSize(size);
        const { elements } = objectFromCamera.copy(this.matrixWorld).invert().multiply(camera.matrixWorld);
        const projection = camera.projectionMatrix.elements;
        const lengths = [0, 4, 8].map((k) => Math.hypot(elements[k], elements[k + 1], elements[k + 2]));
        for (let k = 0; k < 3; k++) {
            view[k] = elements[12 + k];
            for (let axis = 0; axis < 3; axis++) view[3 + 3 * axis + k] = elements[4 * axis + k] / lengths[axis];
        }
        // Off-centre views are taken for the symmetric ones that contain them.
        view[12] = (1 + Math.abs(projection[8])) / projection[0];
        view[13] = (1 + Math.abs(projection[9])) / projection[5];
        view[14] = 0.5 * size.y * projection[5] / this.errorTarget;
        if (camera.isOrthographicCamera) {
            view[12] = (1 + Math.abs(projection[12])) / projection[0] * lengths[0];
            view[13] = (1 + Math.abs(projection[13])) / projection[5] * lengths[1];
            const distance = ORTHOGRAPHIC_DISTANCE * Math.max(view[12], view[13], this.geometry.boundingSphere.radius);
            for (let k = 0; k < 3; k++) view[k] += distance * view[9 + k];
            view[12] /= distance;
            view[13] /= distance;
            view[14] *= distance / lengths[1];
        }
    }

    /** Makes the textures for a renderer's context where there are none; whether there are any. */
    #prepare(renderer) {
        if (this.#stream === null) return false;
        if (this.#failure !== null) throw this.#failure;
        if (this.#textures !== null && this.#textures.renderer !== renderer) {
            throw new Error("a FanMesh belongs to the renderer that drew it first; load the asset once for each renderer");
        }
        if (renderer.isWebGLRenderer) return this.#prepareWebGl(renderer);
        if (renderer.isWebGPURenderer) return this.#prepareNodes(renderer);
        throw new Error("FanMesh draws with three's WebGLRenderer or WebGPURenderer; it was given another renderer");
    }

    #prepareWebGl(renderer) {
        if (renderer.getContext().isContextLost()) return false;
        if (this.#textures === null || this.#isLost) {
            this.#makeTextures(renderer);
            this.#isLost = false;
            if (this.#canvas === null) {
                this.#canvas = renderer.domElement;
                this.#canvas.addEventListener("webglcontextlost", this.#onLost);
            }
        }
        return true;
    }

    #prepareNodes(renderer) {
        if (this.#textures !== null) return true;
        if (!hasNodes() || !renderer.hasInitialized()) {
            this.#hide();
            return false;
        }
        this.#makeTextures(renderer);
        for (const material of this.#hidden) material.visible = true;
        this.#hidden.clear();
        for (const [material, defines] of this.#patched) nodes.addNodes(material, this.#uniforms, defines);
        return true;
    }

    /** Nothing is drawn before the nodes are there. */
    #hide() {
        for (const material of this.#patched.keys()) {
            if (material.visible) this.#hidden.add(material);
            material.visible = false;
        }
    }

    /** Those of a lost context are gone. */
    #makeTextures(renderer) {
        try {
            this.#textures = new FanTextures(renderer, this.#asset, this.#options.compressed);
        } catch (error) {
            // Pages that go on draw the rest of the scene.
            this.visible = false;
            this.#failure = error;
            throw error;
        }
        setTextures(this.#uniforms, this.#asset.channels, this.#textures);
        this.#stream.begin(this.#textures.atlas, this.#options);
    }

    onBeforeRender(renderer) {
        this.#prepare(renderer);
    }

    onBeforeShadow(renderer) {
        this.#prepare(renderer);
    }

    /** How far streaming is. */
    get progress() {
        return this.#stream?.progress ?? { share: 0, isSettled: true, uploadedBytes: 0, damaged: 0 };
    }

    /** Why the first part that cannot be read cannot be; null where all can. */
    get damage() {
        return this.#stream?.damage ?? null;
    }

    /** Asks once more for what could not be read. */
    retry() {
        this.#stream?.retry();
    }

    /** Whether texels lie compressed in graphics memory; null before the first frame. */
    get isCompressed() {
        return this.#textures?.isCompressed ?? null;
    }

    clone() {
        throw new Error("a FanMesh cannot be cloned; for another copy of it, make a Mesh of its geometry and material, or load the asset again");
    }

    /** Ends streaming and its worker, and frees memory and graphics memory. Materials given to `patch` stay the page's. */
    dispose() {
        if (this.#stream === null) return;
        this.removeFromParent();
        this.#stream.close();
        this.#stream = null;
        this.#asset = null;
        this.#textures?.dispose();
        this.#textures = null;
        this.#canvas?.removeEventListener("webglcontextlost", this.#onLost);
        this.geometry.dispose();
        this.#patched.clear();
        for (const material of this.#own) material.dispose();
    }
}

function geometryOf({ vertices, bounds: { min, max, centre, radius } }) {
    const geometry = new BufferGeometry();
    geometry.setIndex(new BufferAttribute(vertices.indices, 1));
    geometry.setAttribute("position", new BufferAttribute(vertices.positions, 3));
    geometry.setAttribute("normal", new BufferAttribute(vertices.normals, 3, true));
    geometry.setAttribute("fanUv01", new BufferAttribute(vertices.uv01, 4));
    geometry.setAttribute("fanUv2", new BufferAttribute(vertices.uv2, 2));
    geometry.setAttribute("fanGroups", new BufferAttribute(vertices.groups, 3));
    geometry.setAttribute("fanCorner", new BufferAttribute(vertices.corners, 4, true));
    geometry.boundingBox = new Box3(new Vector3(...min), new Vector3(...max));
    geometry.boundingSphere = new Sphere(new Vector3(...centre), radius);
    return geometry;
}
