// Nodes of materials that read the texture function, for `WebGPURenderer`. Loaded only by pages that draw with it.

import {
    Fn, clamp, context, faceDirection, materialAO, materialColor, materialEmissive, materialMetalness, materialReference,
    materialRoughness, max, transformNormalToView, vec4,
} from "three/tsl";
import { BackSide, DoubleSide } from "three";

import { Lookup } from "./shaderNodes.js";

/** Defines that count for the opacity of what is cut out. */
const FOR_SHADOWS = ["FAN_BASE_COLOR", "FAN_PAGED", "FAN_SINGLE_TILE"];

const isUnlit = (material) => material.isMeshBasicMaterial === true || material.isMeshBasicNodeMaterial === true;
const isStandard = (material) => material.isMeshStandardMaterial === true || material.isMeshStandardNodeMaterial === true;

/** Has a material's nodes read the texture function, as `patchMaterial` has its shaders of a `WebGLRenderer`. */
export function addNodes(material, uniforms, defines) {
    const lookup = new Lookup(uniforms, defines);
    const surface = Fn(() => lookup.surface())().toVar("fanSurface");
    const multiply = (name, own, node) => { material[name] = (material[name] ?? own).mul(node); };

    material.colorNode = colorNode(material, lookup, surface, uniforms, defines);
    if (lookup.has("normal")) {
        material.normalNode = Fn((_, builder) => facing(transformNormalToView(surface.get("normal")).normalize(), builder.material))();
    }
    if (lookup.has("material") && isStandard(material)) {
        const [occlusion, roughness, metalness] = ["x", "y", "z"].map((part) => clamp(surface.get("material")[part], 0, 1));
        multiply("roughnessNode", materialRoughness, roughness);
        multiply("metalnessNode", materialMetalness, metalness);
        const weakened = occlusion.sub(1).mul(materialReference("aoMapIntensity", "float")).add(1);
        material.aoNode = weakened.mul(material.aoNode ?? (material.aoMap ? materialAO : 1));
    }
    if (lookup.has("emission") && material.emissive) multiply("emissiveNode", materialEmissive, max(surface.get("emission"), 0));
    if (lookup.has("light") && !isUnlit(material)) {
        const irradiance = max(surface.get("light"), 0).mul(Math.PI);
        material.contextNode = context({ getGI: () => irradiance });
    }
    // Nodes are the material's own, so is its program. (Materials of nodes have such keys.)
    if (!material.isNodeMaterial) material.customProgramCacheKey = () => `fan ${material.uuid}`;
    material.needsUpdate = true;
}

/** Colour and opacity; in passes that draw shadows the opacity of what is cut out. */
function colorNode(material, lookup, surface, uniforms, defines) {
    const own = material.colorNode ?? materialColor;
    return Fn((_, builder) => {
        if (builder.material.isShadowPassMaterial) return shadowColor(material, uniforms, defines);
        let color = vec4(own);
        if (lookup.has("baseColor")) {
            const base = surface.get("baseColor");
            color = color.mul(vec4(max(base.rgb, 0), clamp(base.a, 0, 1)));
        }
        if (lookup.has("light") && isUnlit(material)) color = color.mul(vec4(max(surface.get("light"), 0), 1));
        return color;
    })();
}

function shadowColor(material, uniforms, defines) {
    if (!("FAN_BASE_COLOR" in defines) || !(material.alphaTest > 0)) return vec4(1);
    const needed = Object.fromEntries(Object.entries(defines).filter(([name]) => FOR_SHADOWS.includes(name)));
    return Fn(() => new Lookup(uniforms, needed).surface())().toVar("fanSurface").get("baseColor");
}

/** Turned where the material is seen from behind. */
function facing(normal, { side }) {
    if (side === BackSide) return normal.negate();
    return side === DoubleSide ? normal.mul(faceDirection) : normal;
}
