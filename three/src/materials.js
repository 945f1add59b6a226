// Materials of three with the texture function in the place of their maps.

import {
    Color, DoubleSide, FrontSide, MeshBasicMaterial, MeshDepthMaterial, MeshDistanceMaterial, MeshPhysicalMaterial, MeshStandardMaterial,
} from "three";

import {
    FRAGMENT_CHUNKS, FRAGMENT_DECLARATIONS, FRAGMENT_STATEMENTS, VERTEX_DECLARATIONS, VERTEX_STATEMENTS,
} from "./shader.js";
import { BASE_COLOR, EMISSION, LIGHT, MATERIAL, NORMAL } from "./textures.js";

const DEFINES = [
    [BASE_COLOR, "FAN_BASE_COLOR"], [NORMAL, "FAN_NORMAL"], [MATERIAL, "FAN_MATERIAL"], [EMISSION, "FAN_EMISSION"], [LIGHT, "FAN_LIGHT"],
];

const CUT_OUT = 1, BLENDED = 2;

/** Uniforms of an asset, shared by all its materials. Textures are set when they are made. */
export function fanUniforms(delta, channels, anisotropy) {
    const channelOf = (kind) => Math.max(channels.findIndex((channel) => channel.kind === kind), 0);
    return {
        fanGroupTable: { value: null },
        fanPages: { value: null },
        fanMeans: { value: null },
        fanFrames: { value: null },
        fanAtlasScale: { value: [0, 0] },
        fanDelta: { value: delta },
        fanMaxAnisotropy: { value: anisotropy },
        fanChannels: { value: channels.length },
        fanMeanOf: { value: [BASE_COLOR, NORMAL, MATERIAL, EMISSION].map(channelOf) },
        fanMeanOfLight: { value: channelOf(LIGHT) },
        fanBaseColor: { value: null },
        fanNormalMap: { value: null },
        fanMaterial: { value: null },
        fanEmission: { value: null },
        fanLight: { value: null },
    };
}

/** Shows the textures to the shaders. */
export function setTextures(uniforms, channels, textures) {
    const atlasOf = (kind) => textures.atlases[channels.findIndex((channel) => channel.kind === kind)]?.external ?? null;
    uniforms.fanGroupTable.value = textures.groups.external;
    uniforms.fanPages.value = textures.pages.external;
    uniforms.fanMeans.value = textures.means.external;
    uniforms.fanFrames.value = textures.frames.external;
    uniforms.fanAtlasScale.value = [1 / textures.extent[0], 1 / textures.extent[1]];
    uniforms.fanBaseColor.value = atlasOf(BASE_COLOR);
    uniforms.fanNormalMap.value = atlasOf(NORMAL);
    uniforms.fanMaterial.value = atlasOf(MATERIAL);
    uniforms.fanEmission.value = atlasOf(EMISSION);
    uniforms.fanLight.value = atlasOf(LIGHT);
}

/** Defines of the shaders for an asset. */
export function fanDefines(channels, isPaged, anisotropy) {
    const defines = {};
    for (const [kind, name] of DEFINES) {
        if (channels.some((channel) => channel.kind === kind)) defines[name] = "";
    }
    if (isPaged) defines.FAN_PAGED = "";
    if (anisotropy > 1) defines.FAN_ANISOTROPIC = "";
    return defines;
}

/** Those for some of its triangles, without what they do not need. */
export function definesOf(defines, hasSeveralTiles, isPaged) {
    const { FAN_PAGED, ...rest } = defines;
    return { ...rest, ...(isPaged && { FAN_PAGED }), ...(!hasSeveralTiles && { FAN_SINGLE_TILE: "" }) };
}

/**
 * Has a material read the texture function: its colour, opacity, roughness, metalness and emission are multiplied by the channels,
 * its normals are replaced. Materials of three that are not lit, or are lit in another way, take what they know.
 */
export function patchMaterial(material, uniforms, defines) {
    const { onBeforeCompile } = material;
    const key = material.customProgramCacheKey();
    material.defines = { ...material.defines, ...defines };
    material.onBeforeCompile = (shader, renderer) => {
        onBeforeCompile.call(material, shader, renderer);
        Object.assign(shader.uniforms, uniforms);
        shader.uniforms.fanOcclusionIntensity = { get value() { return material.aoMapIntensity ?? 1; } };
        shader.vertexShader = shader.vertexShader
            .replace("void main() {", () => `${VERTEX_DECLARATIONS}\nvoid main() {\n${VERTEX_STATEMENTS}`);
        let fragment = shader.fragmentShader
            .replace("void main() {", () => `${FRAGMENT_DECLARATIONS}\nvoid main() {\n${FRAGMENT_STATEMENTS}`);
        for (const [chunk, replacement] of Object.entries(FRAGMENT_CHUNKS)) fragment = fragment.replace(chunk, () => replacement);
        shader.fragmentShader = fragment;
    };
    // Patched materials share their programs, and none with others.
    material.customProgramCacheKey = () => `fan ${key}`;
    return material;
}

/** The material of three for one of the asset's. Opposed triangles are seen from their front only. */
export function surfaceMaterial(own, isOpposed, channels, isPhysical) {
    const has = (kind) => channels.some((channel) => channel.kind === kind);
    const [red, green, blue, alpha] = has(BASE_COLOR) ? [1, 1, 1, 1] : own.baseColor;
    const parameters = {
        name: own.name,
        color: new Color(red, green, blue),
        opacity: own.alphaMode === BLENDED ? alpha : 1,
        transparent: own.alphaMode === BLENDED,
        depthWrite: own.alphaMode !== BLENDED,
        alphaTest: own.alphaMode === CUT_OUT ? own.alphaThreshold : 0,
        side: own.doubleSided && !isOpposed ? DoubleSide : FrontSide,
    };
    if (own.unlit) return new MeshBasicMaterial(parameters);
    const Lit = isPhysical ? MeshPhysicalMaterial : MeshStandardMaterial;
    return new Lit({
        ...parameters,
        roughness: has(MATERIAL) ? 1 : own.roughness,
        metalness: has(MATERIAL) ? 1 : own.metallic,
        emissive: has(EMISSION) ? new Color(1, 1, 1) : new Color(...own.emission),
    });
}

/** Materials with which an asset casts shadows: for lamps with one map, and for those that shine to all sides. */
export function shadowMaterials(uniforms, defines) {
    const { FAN_BASE_COLOR, FAN_PAGED } = defines;
    const needed = { ...(FAN_BASE_COLOR !== undefined && { FAN_BASE_COLOR }), ...(FAN_PAGED !== undefined && { FAN_PAGED }) };
    return [new MeshDepthMaterial(), new MeshDistanceMaterial()].map((material) => patchMaterial(material, uniforms, needed));
}
