// What the page holds now, and what follows from it. A comment names the module that changes it.
import { $ } from "./dom.js";

export const state = {
  scene: null, body: null, stage: null, // main.js, once
  motion: null, betas: null, // motions.js
  dropped: null, // dropped.js: the motion of a dropped file
  gains: null, // gains.js: one a part
  epoch: 0, frames: new Map(), // motions.js makes all frames anew; frames.js requests them
  rows: [], full: {}, low: 0, // frames.js: results of the survey of the whole motion
  time: 0, playing: true, // clock.js: time in frames
  drawn: "", plotted: "", // seen.js: of what the bodies and the curves are
  root: [0, 0, 0], facing: 0, // seen.js: where the root is, and where it looks, an angle about the vertical; 0 is +z
  wipeAt: 0.5, // controls.js
};

export const allNames = () => Object.keys(state.scene.labels);
export const hasOriginalShape = () => state.betas.every((beta, i) => Math.abs(beta - state.motion.betas[i]) < 1e-6);

// Whether a body can be shown now: tracks are of the recorded motion and shape alone.
export function canShow(name) {
  const { baked, graph } = state.scene;
  if (state.motion.tracks.includes(name)) return Boolean(baked) || hasOriginalShape();
  return !baked && ["smpl", graph.predictor].includes(name);
}

export const shownNames = () => allNames().filter((name) => $(`show-${name}`).checked && canShow(name));
