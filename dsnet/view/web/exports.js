// What is shown, exported by Python as `dsnet export` does it, into the browser's downloads.
import { $, make, say } from "./dom.js";
import { changes } from "./motions.js";
import { ask, shownScene } from "./server.js";
import { hasOriginalShape, shownNames, state } from "./state.js";

const ASKED_EVERY_MS = 400;
const pause = () => new Promise((resolve) => setTimeout(resolve, ASKED_EVERY_MS));

export async function exportControls() {
  $("export").onclick = () => exported().catch((error) => say(error.message)).finally(() => running(false));
  $("cancel").onclick = () => ask("cancel", {});
  changes.addEventListener("motion", () => { $("exports").hidden = !state.scene.motions[state.motion.number].reading; });
  for (const { name, title, missing } of await ask("formats"))
    $("format").add(new Option(missing ? `${title} (needs dsnet-skin[${missing}])` : title, name, name === "glb", name === "glb"));
}

// The page's knobs as controls of the command; an empty word is the default.
function controlsOfPage() {
  const { scene: { start, parts, motions }, motion, betas } = state, stands = $("floor").checked && !motions[motion.number].reading.floor;
  return {
    gain: start.gain,
    part_gain: start.parts.map((gain, i) => `${parts[i]}=${gain}`).filter((_, i) => start.parts[i] !== 1),
    betas: hasOriginalShape() ? "" : betas.join(","),
    loop: Boolean(motion.first),
    ...(stands ? { floor: "shift" } : {}),
  };
}

function running(on) {
  for (const id of ["cancel", "share"]) $(id).hidden = !on;
  $("export").disabled = on;
}

async function exported() {
  const predictors = shownNames().filter((name) => !["smpl", "truth"].includes(name));
  const asked = { scene: shownScene, number: state.motion.number, to: $("format").value, predictors, shown: controlsOfPage() };
  const { command } = await ask("export", asked);
  $("command").textContent = command;
  running(true);
  say("");
  for (;;) {
    const job = await ask("export/state");
    if (!job) return; // cancelled
    if (job.failed) throw new Error(job.failed);
    if (job.file) break;
    if (job.share) $("share").value = job.share; else $("share").removeAttribute("value");
    await pause();
  }
  make("a", { href: "export/file", download: "" }).click();
}
