// An engine in a worker. It says first that it is there.

import { Engine } from "./engine.js";

/** So an answer is there by the next frame. */
const SLICE_MILLISECONDS = 10;

const engine = new Engine((answer, buffers) => self.postMessage(answer, buffers), SLICE_MILLISECONDS);
self.onmessage = ({ data }) => engine.receive(data);
self.postMessage({ type: "ready" });
