// Motion files that Python reads: any that `dsnet predict` reads, and by which options.
import { $, say } from "./dom.js";
import { changes, choose } from "./motions.js";
import { ask, showScene, shownScene } from "./server.js";
import { state } from "./state.js";

const LARGEST_MB = 128;
const fields = () => [...document.querySelectorAll("[data-reading]")];

export function readingControls() {
  for (const field of fields()) field.onchange = () => readAgain();
  changes.addEventListener("motion", showReading);
}

export async function sendFile(file) {
  if (file.size > LARGEST_MB << 20) throw new Error(`${file.size >> 20} MB; expected at most ${LARGEST_MB} MB. Pass it by dsnet view --motion FILE.`);
  $("who").textContent = `reading ${file.name} …`;
  await show(await ask(`files/${encodeURIComponent(file.name)}`, file));
}

async function readAgain() {
  const reading = Object.fromEntries(fields().map(({ dataset, value }) => [dataset.reading, value.trim()]));
  try { await show(await ask("read", { scene: shownScene, number: state.motion.number, reading })); } catch (error) {
    say(error.message);
    showReading();
  }
}

async function show({ scene, number, entry }) {
  if (scene !== shownScene) { showScene(scene, number); return; }
  const { motions } = state.scene;
  if (number === motions.length) $("motion").add(new Option(entry.name, number));
  motions[number] = entry;
  await choose(number);
}

function showReading() {
  const { reading } = state.scene.motions[state.motion.number];
  $("reading").hidden = !reading;
  for (const field of fields()) field.value = reading?.[field.dataset.reading] ?? "";
}
