// The shape of who performs: by name, or ten betas.
import { json } from "./assets.js";
import { $, say } from "./dom.js";
import { changes, person } from "./motions.js";
import { ask, isServed, shownScene } from "./server.js";
import { showValue, slider } from "./sliders.js";
import { state } from "./state.js";

let named = {};

export function shapeControls() {
  for (let i = 0; i < 10; i++)
    slider("betas", `beta${i}`, `β${i + 1}`, { min: -5, max: 5, step: 0.01 }, 0, (value) => person(state.betas.with(i, value)));
  changes.addEventListener("shape", showShape);
  $("words").parentElement.hidden = !isServed();
  $("words").onchange = () => ask("shape", { scene: shownScene, words: $("words").value }).then(
    ({ betas }) => person(betas), (error) => say(error.message));
}

export const loadShapes = () => json("shapes").then((value) => { named = value; if (state.motion) showShape(); }, (error) => say(error.message));

function showShape() {
  const { betas, motion } = state, options = { "shape of the motion's performer": motion.betas, ...named };
  betas.slice(0, 10).forEach((beta, i) => { $(`beta${i}`).value = beta; showValue($(`beta${i}`), beta); });
  const near = (a, b) => a.every((x, i) => Math.abs(x - b[i]) < 1e-4);
  const now = Object.keys(options).find((name) => near(options[name], betas)) ?? "as set";
  $("person").replaceChildren(...[...new Set([...Object.keys(options), now])].map((name) => new Option(name)));
  $("person").value = now;
  $("person").onchange = () => { if (options[$("person").value]) person([...options[$("person").value]]); };
}
