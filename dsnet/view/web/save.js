// What is seen, saved: a picture, or a video of one pass of the motion. Labels, legend and notice are drawn into both.
import { play, seek } from "./clock.js";
import { $, make, say } from "./dom.js";
import { COLOURS } from "./stage.js";
import { state } from "./state.js";

const KIND = "video/webm", BITS_A_SECOND = 12e6;
export const canClip = Boolean(window.MediaRecorder?.isTypeSupported(KIND) && HTMLCanvasElement.prototype.captureStream);
const drawing = () => new Promise(requestAnimationFrame); // resolves after the bodies are drawn
let isRecording = false;

// A canvas, and a function that draws onto it what is seen now.
function copier() {
  const { width, height, clientWidth } = $("view"), canvas = make("canvas", { width, height }), flat = canvas.getContext("2d");
  flat.scale(width / clientWidth, width / clientWidth);
  return [canvas, () => {
    flat.drawImage($("view"), 0, 0, clientWidth, (clientWidth * height) / width);
    if (!$("legend").hidden) drawScale(flat);
    for (const element of $("stage").querySelectorAll(".tag, #legend span, #about, #notice")) if (element.offsetParent) drawText(flat, element);
    drawLines(flat);
  }];
}

function placeOf(element) {
  const { left, top, width, height } = element.getBoundingClientRect(), stage = $("stage").getBoundingClientRect();
  return [left - stage.left, top - stage.top, width, height];
}

function drawText(flat, element) {
  const [left, top, width, height] = placeOf(element), style = getComputedStyle(element), padding = parseFloat(style.paddingLeft);
  flat.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
  flat.fillStyle = style.backgroundColor;
  flat.beginPath();
  flat.roundRect(left, top, width, height, parseFloat(style.borderRadius) || 0);
  flat.fill();
  const lines = [""];
  for (const word of element.textContent.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (flat.measureText(longer).width > width - 2 * padding + 1) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  Object.assign(flat, { fillStyle: style.color, textBaseline: "middle" });
  lines.filter(Boolean).forEach((line, i, { length }) => flat.fillText(line, left + padding, top + ((i + 0.5) * height) / length, width - 2 * padding + 1));
}

function drawScale(flat) {
  const [left, top, width, height] = placeOf($("scale")), ramp = flat.createLinearGradient(left, 0, left + width, 0);
  COLOURS.forEach((colour, i) => ramp.addColorStop(i / (COLOURS.length - 1), `rgb(${colour})`));
  flat.fillStyle = ramp;
  flat.fillRect(left, top, width, height);
}

// Between views, and at a wipe.
function drawLines(flat) {
  const [, , width, height] = placeOf($("stage")), views = +$("tags").style.getPropertyValue("--views");
  flat.fillStyle = getComputedStyle($("now")).backgroundColor;
  if (!$("bar").hidden) flat.fillRect(state.wipeAt * width - 1, 0, 2, height);
  flat.fillStyle = getComputedStyle($("timeline")).borderTopColor;
  for (let i = 1; i < views; i++) flat.fillRect((i * width) / views - 0.5, 0, 1, height);
}

function download(blob, ending) {
  const href = URL.createObjectURL(blob), name = state.motion.name.replace(/\.\w+$/, "").replace(/[^\p{L}\p{N}-]+/gu, "_");
  make("a", { href, download: `${name}.${ending}` }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000);
}

export function savePicture() {
  const [canvas, copy] = copier();
  copy();
  canvas.toBlob((blob) => (blob ? download(blob, "png") : say("this browser cannot save so large a picture")));
}

// One pass of the motion, or of its loop, at the present speed. Called again, or by a pause, it ends before.
export async function saveClip() {
  if (isRecording || !canClip) { isRecording = false; return; }
  const [canvas, copy] = copier(), { motion } = state, parts = [];
  const recorder = new MediaRecorder(canvas.captureStream(60), { mimeType: KIND, videoBitsPerSecond: BITS_A_SECOND });
  recorder.ondataavailable = ({ data }) => parts.push(data);
  recorder.onstop = () => download(new Blob(parts, { type: KIND }), "webm");
  isRecording = true;
  $("clip").textContent = "Stop";
  seek(0);
  do { await drawing(); await drawing(); } while (isRecording && !state.frames.get(0));
  copy();
  recorder.start();
  play(true);
  for (let last = 0; isRecording && state.playing && state.motion === motion && state.time >= last && motion.count > 1;) {
    last = state.time;
    copy();
    await drawing();
  }
  recorder.stop();
  isRecording = false;
  $("clip").textContent = "Video";
}
