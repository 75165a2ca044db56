// Controls of the motion, of time and of what is shown.
import { seek } from "./clock.js";
import { inkOf } from "./curves.js";
import { $, dragged, make } from "./dom.js";
import { choose } from "./motions.js";
import { isServed } from "./server.js";
import { bindSlider } from "./sliders.js";
import { COLOURS } from "./stage.js";
import { allNames, canShow, state } from "./state.js";

const DARK = "(prefers-color-scheme: dark)";
const NOTICES = { synthetic: "Synthetic: body and flesh are simulated, not measured.", "synthetic flesh": "Synthetic flesh: simulated, not measured." };

export function controls() {
  paint();
  matchMedia(DARK).addEventListener("change", paint);
  const { scene: { start, baked, origin, motions } } = state;
  $("notice").textContent = [NOTICES[origin], baked].filter(Boolean).join(" ");
  for (const id of ["shape", "loops"]) $(id).hidden = Boolean(baked);
  $("own").hidden = Boolean(baked) && !isServed();
  for (const other of document.querySelectorAll(isServed() ? ".disk" : ".served")) other.hidden = true;
  motions.forEach(({ name }, i) => $("motion").add(new Option(name, i)));
  $("motion").onchange = () => choose(+$("motion").value);
  $("loop").checked = start.loop;
  $("loop").onchange = () => choose(state.motion.number);
  shownControls(motions.some(({ tracks }) => tracks.includes("truth")));
  bindSlider($("speed"), 1, () => {});
  dragged($("curves"), ({ clientX }) => { const { left, width } = $("curves").getBoundingClientRect(); seek(((clientX - left) / width) * (state.motion.count - 1)); });
  dragged($("bar"), ({ clientX }) => { state.wipeAt = Math.min(Math.max(clientX / $("view").clientWidth, 0), 1); });
}

function shownControls(hasTruth) {
  const names = allNames(), { labels } = state.scene;
  $("scale").style.background = `linear-gradient(to right, ${COLOURS.map((c) => `rgb(${c})`)})`;
  for (const name of names) {
    const row = make("label", { className: "check", hidden: name === "truth" && !hasTruth }), key = make("i");
    const box = make("input", { id: `show-${name}`, type: "checkbox", checked: ["smpl", "truth", names[1]].includes(name) });
    key.style.background = inkOf(name, names);
    row.append(box, key, labels[name]);
    $("shown").append(row);
    box.onchange = () => { if (box.checked && !canShow(name)) choose(state.motion.number); };
    $("tags").append(make("span", { id: `tag-${name}`, className: "tag", hidden: true, textContent: labels[name] }));
  }
  if (!hasTruth) $("colouring").options[2].remove();
}

// The stage in the style's colours, light or dark.
function paint() {
  const style = getComputedStyle(document.documentElement);
  state.stage.paint(...["--stage", "--grid"].map((name) => style.getPropertyValue(name)));
}
