// What a page writes, as the compiler of TypeScript sees it.

import { FanLoader, type FanMesh } from "@fantex/three";
import { MeshLambertMaterial, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { WebGPURenderer } from "three/webgpu";

export async function show(scene: Scene, camera: PerspectiveCamera, renderer: WebGLRenderer): Promise<FanMesh> {
    const loader = new FanLoader({ cacheBytes: 2 ** 28, concurrency: 6, errorTarget: 1, worker: true, wasmUrl: undefined });
    const fan = await loader.loadAsync("bottle.fan", (event) => console.log(event.loaded));
    scene.add(fan);
    fan.update(camera, renderer);
    fan.update(camera, new WebGPURenderer());
    const lambert: MeshLambertMaterial = fan.patch(new MeshLambertMaterial());
    fan.material = lambert;
    const { share, isSettled } = fan.progress;
    console.log(share.toFixed(2), isSettled, fan.usesWorker, fan.damage?.length ?? 0);
    loader.abort().load("bottle.fan", (other: FanMesh) => other.dispose());
    // @ts-expect-error: there is no such option.
    new FanLoader({ cacheByte: 1 });
    fan.dispose();
    return fan;
}
