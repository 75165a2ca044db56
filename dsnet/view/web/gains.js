// Gains of the dynamics: of the whole body, and of its parts.
import { $ } from "./dom.js";
import { work } from "./model.js";
import { forget } from "./motions.js";
import { bindSlider, slider } from "./sliders.js";
import { state } from "./state.js";

const MOST = 3; // more adds little, as flesh strains no further; an option may still ask for more
let timer = 0;

export function gainControls() {
  const { start, parts } = state.scene;
  start.parts.forEach((gain, i) => slider("parts", `part${i}`, parts[i].replace("_", " "), { min: 0, max: Math.max(MOST, gain), step: 0.05 }, gain,
                                          (value) => { start.parts[i] = value; gained(); }));
  $("gain").max = Math.max(MOST, start.gain);
  bindSlider($("gain"), start.gain, (value) => { start.gain = value; gained(); });
  spread();
}

function spread() {
  const { start } = state.scene;
  Object.assign(state, { gains: Float64Array.from(start.parts, (part) => start.gain * part), drawn: "" });
}

function gained() {
  spread();
  clearTimeout(timer); // curves follow when the slider rests
  timer = setTimeout(() => { forget(); work("gains", { gains: state.gains, epoch: state.epoch }); }, 250);
}
