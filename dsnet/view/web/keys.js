// Keys, and the buttons that do the same: one list, which is also the help.
import { play, seek } from "./clock.js";
import { $, make } from "./dom.js";
import { canClip, saveClip, savePicture } from "./save.js";
import { state } from "./state.js";

const step = (frames) => seek(Math.round(state.time) + frames);
const look = (angle) => state.stage.look(state.facing + angle);

// By `KeyboardEvent.key`: what a person reads on the key, what it does, and how.
const KEYS = new Map([
  [" ", ["Space", "play or pause", () => play(!state.playing)]],
  ["ArrowLeft", ["←", "a frame back", () => step(-1)]],
  ["ArrowRight", ["→", "a frame on", () => step(1)]],
  ["Home", ["Home", "to the first frame", () => step(-Infinity)]],
  ["End", ["End", "to the last frame", () => step(Infinity)]],
  ["1", ["1", "from the front", () => look(0)]],
  ["2", ["2", "from the side", () => look(Math.PI / 2)]],
  ["3", ["3", "from the back", () => look(Math.PI)]],
  ["r", ["R", "reset the camera", () => state.stage.reset()]],
  ["t", ["T", "turntable: turn slowly around the bodies", turntable]],
  ["f", ["F", "full screen", fullScreen]],
  ["l", ["L", "loop", () => { if (!$("loops").hidden) $("loop").click(); }]],
  ["c", ["C", "next colours", nextColours]],
  ["s", ["S", "save a picture", savePicture]],
  ["v", ["V", "save a video of one pass", saveClip]],
  ["?", ["?", "this list", () => $("keys").togglePopover()]],
]);

export function keyControls() {
  for (const [key, [cap, does]] of KEYS) {
    if (isMissing(key)) continue;
    const row = $("keys").appendChild(make("div"));
    row.append(make("kbd", { textContent: cap }), does);
  }
  for (const button of document.querySelectorAll("[data-key]")) {
    const { key } = button.dataset, [cap, does] = KEYS.get(key);
    button.title = `${does} (${cap})`;
    button.hidden = isMissing(key);
    button.onclick = () => act(key);
    button.onpointerdown = (event) => event.preventDefault(); // it takes no focus, so that space still plays
  }
  document.addEventListener("keydown", (event) => {
    const key = event.key.length > 1 ? event.key : event.key.toLowerCase();
    if (!KEYS.has(key) || event.ctrlKey || event.altKey || event.metaKey || isOfElement(event.target, key)) return;
    event.preventDefault();
    if (!event.repeat || key.startsWith("Arrow")) act(key);
  });
}

function act(key) {
  if (state.motion) KEYS.get(key)[2]();
  $("turntable").ariaPressed = state.stage.turns;
}

const isMissing = (key) => (key === "f" && !document.fullscreenEnabled) || (key === "v" && !canClip) || (key === "l" && $("loops").hidden);

// Whether an element does something of its own by this key.
function isOfElement(target, key) {
  if (target.matches("input[type=range]")) return /^(Arrow|Home|End)/.test(key);
  if (target.matches("input[type=checkbox], button, summary")) return key === " ";
  return target.matches("input, select, textarea");
}

function turntable() { state.stage.turns = !state.stage.turns; }

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.querySelector("main").requestFullscreen();
}

function nextColours() {
  const { options, selectedIndex } = $("colouring");
  $("colouring").selectedIndex = (selectedIndex + 1) % options.length;
}
