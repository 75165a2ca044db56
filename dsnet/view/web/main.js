// The page: its model, its stage and its controls.
import { asset, json } from "./assets.js";
import { Body } from "./body.js";
import { play, seek, turn } from "./clock.js";
import { controls } from "./controls.js";
import { $, say } from "./dom.js";
import { dropControls, readBytes } from "./dropped.js";
import { exportControls } from "./exports.js";
import { surveyed } from "./frames.js";
import { gainControls } from "./gains.js";
import { keyControls } from "./keys.js";
import { startModel, work } from "./model.js";
import { choose, person } from "./motions.js";
import { readingControls } from "./reading.js";
import { firstMotion, isServed } from "./server.js";
import { loadShapes, shapeControls } from "./shapes.js";
import { Stage } from "./stage.js";
import { state } from "./state.js";

async function main() {
  const scene = (state.scene = await json("scene"));
  const parts = scene.baked ? [] : Promise.all([asset("model"), asset("runtime")]);
  state.body = new Body(scene);
  try { state.stage = new Stage($("view"), state.body, scene.skin); } catch { throw new Error("this browser draws no WebGL: switch on its hardware acceleration, or take another one"); }
  if (typeof WebAssembly !== "object") throw new Error("this browser runs no WebAssembly, which the model needs");
  startModel(surveyed);
  for (const start of [controls, gainControls, shapeControls, dropControls, keyControls]) start();
  if (isServed()) for (const start of [readingControls, exportControls]) start();
  const [model, wasm] = await parts;
  work("open", { scene, model, wasm }, model ? [model, wasm] : []);
  work("gains", { gains: state.gains });
  if (scene.skin) await state.stage.wear(await asset("skin"));
  state.stage.warm(); // while the model opens
  await choose(firstMotion);
  if (!scene.baked) loadShapes();
  requestAnimationFrame(turn);
}

// For tests and measurements.
window.page = {
  seek, readBytes, person, play,
  get time() { return state.time; }, get betas() { return state.betas; }, get frames() { return state.frames; }, get motion() { return state.motion; }, get stage() { return state.stage; }, get curves() { return state.rows; },
};

main().catch((error) => { say(error.message); });
