export { FanLoader } from "./FanLoader.js";
export { FanMesh } from "./FanMesh.js";
