// Gains of the dynamics: of the whole body, and of its parts.
import { numbersOf } from "./body.js";
import { $ } from "./dom.js";
import { work } from "./model.js";
import { forget } from "./motions.js";
import { bindSlider, slider } from "./sliders.js";
import { state } from "./state.js";

const MOST = 3; // beyond it flesh is no flesh any more; an option may still ask for more
let partWeights, timer = 0;

export function gainControls() {
  const { start, parts, part_weights } = state.scene;
  partWeights = numbersOf(part_weights, Float32Array);
  start.parts.forEach((gain, i) => slider("parts", `part${i}`, parts[i].replace("_", " "), { min: 0, max: Math.max(MOST, gain), step: 0.05 }, gain,
                                          (value) => { start.parts[i] = value; gained(); }));
  $("gain").max = Math.max(MOST, start.gain);
  bindSlider($("gain"), start.gain, (value) => { start.gain = value; gained(); });
  spread();
}

// The gain of each vertex.
function spread() {
  const { body: { count }, scene: { start } } = state, gains = new Float32Array(count);
  start.parts.forEach((part, p) => { const gain = start.gain * part; for (let v = 0; v < count; v++) gains[v] += gain * partWeights[p * count + v]; });
  Object.assign(state, { gains, drawn: "" });
}

function gained() {
  spread();
  clearTimeout(timer); // curves follow when the slider rests
  timer = setTimeout(() => { forget(); work("gains", { gains: state.gains, epoch: state.epoch }); }, 250);
}
