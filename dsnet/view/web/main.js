// The page: time, display and controls. The model runs in a worker.
import { GENDERS, readAmass } from "./amass.js";
import { Body, bytesOf, numbersOf } from "./body.js";
import { Curves, inkOf } from "./curves.js";
import { COLOURS, Stage } from "./stage.js";

const $ = (id) => document.getElementById(id);
const make = (tag, more) => Object.assign(document.createElement(tag), more);
const AHEAD = 6; // frames requested before they are shown; more if drawing is slow
const SCALES_MM = [1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200];
const say = (text) => { $("says").textContent = text; };

// An asset is in the page or on its server, gzipped or not.
async function asset(name) {
  const embedded = $(`asset:${name}`);
  const bytes = embedded ? bytesOf(embedded.textContent) : await fetched(name);
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes.buffer;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

async function fetched(name) {
  const response = await fetch(`assets/${name}`).catch(() => null);
  if (!response?.ok) throw new Error("the server does not answer: start `dsnet view` again");
  if (response.headers.get("content-type") === "application/json") throw new Error((await response.json()).failed);
  return new Uint8Array(await response.arrayBuffer());
}

async function json(name) {
  const value = JSON.parse(new TextDecoder().decode(await asset(name)));
  if (value.failed) throw new Error(value.failed);
  return value;
}

// A function that sends jobs to the worker; results come in the order of jobs.
function startWorker() {
  const worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }))), waiting = [];
  worker.onmessage = ({ data }) => {
    if (data.failed) say(data.failed);
    (data.job === "survey" ? surveyed : waiting.shift())(data);
  };
  worker.onerror = (event) => say(`the model cannot run here: ${event.message}`);
  return (job, more, transferred = []) => {
    worker.postMessage({ job, ...more }, transferred);
    return new Promise((resolve) => waiting.push(resolve));
  };
}

let scene, body, stage, work, curves, partWeights, shapes = {};
let motion, dropped, betas, gains, request = 0; // the present motion, and the one of a dropped file
let epoch = 0, rows = [], full = {}, low = 0; // results of the survey of the whole motion
let frames = new Map(), time = 0, before = 0, playing = true, drawn = "", plotted = "", wipeAt = 0.5, root = [0, 0, 0];

const allNames = () => Object.keys(scene.labels);
const hasOriginalShape = () => betas.every((beta, i) => Math.abs(beta - motion.betas[i]) < 1e-6);
// Whether a body can be shown now: tracks are of the recorded motion and shape alone.
const canShow = (name) => motion.tracks.includes(name) ? scene.baked || hasOriginalShape() : !scene.baked && ["smpl", scene.graph.predictor].includes(name);
const shownNames = () => allNames().filter((name) => $(`show-${name}`).checked && canShow(name));

async function main() {
  scene = await json("scene");
  const parts = scene.baked ? [] : Promise.all([asset("model"), asset("runtime")]);
  body = new Body(scene);
  try { stage = new Stage($("view"), body); } catch { throw new Error("this browser draws no WebGL: switch on its hardware acceleration, or take another one"); }
  if (typeof WebAssembly !== "object") throw new Error("this browser runs no WebAssembly, which the model needs");
  partWeights = numbersOf(scene.part_weights, Float32Array);
  work = startWorker();
  curves = new Curves($("plot"), allNames());
  controls();
  const [model, wasm] = await parts;
  work("open", { scene, model, wasm }, model ? [model, wasm] : []);
  work("gains", { gains });
  stage.warm(); // while the model opens
  await choose(0);
  if (!scene.baked) json("shapes").then((value) => { shapes = value; if (motion) showShapes(); }, (error) => say(error.message));
  requestAnimationFrame(turn);
}

// Motions: those of the scene, and that of a dropped file.

async function choose(number, looped = $("loop").checked && !scene.baked) {
  const thisRequest = ++request, isDropped = number === scene.motions.length, missing = [], tracks = {};
  try {
    let why = looped && isDropped ? "a loop is closed by Python" : "", next = isDropped && dropped;
    if (looped && !isDropped) next = await json(`loop${number}`).catch((error) => { why = error.message; });
    next ||= await json(`motion${number}`);
    for (const name of isDropped || next.first ? [] : scene.motions[number].tracks)
      if (scene.baked || $(`show-${name}`).checked) {
        $("who").textContent = `computing ${scene.labels[name]} …`;
        await asset(`track${number}_${name}`).then((bytes) => { tracks[name] = bytes; }, (error) => missing.push(error.message));
      }
    if (thisRequest !== request) return;
    if (missing.length && scene.baked) throw new Error(missing[0]);
    $("looped").textContent = why && "cannot be closed here";
    perform({ ...next, number, tracks: Object.keys(tracks) }, tracks, why);
    say(missing.join(" "));
  } catch (error) { say(error.message); }
  $("who").textContent = `${scene.owner} · ${motion?.count ?? 0} frames, ${motion?.fps ?? 60} fps`;
}

function perform({ theta, ...next }, tracks, why) {
  const isOther = motion?.number !== next.number;
  if (isOther || hasOriginalShape()) betas = [...next.betas];
  motion = next;
  time = isOther ? 0 : Math.min(time, motion.count - 1);
  $("motion").value = motion.number;
  forget();
  work("perform", { motion, theta, tracks, betas, epoch }, Object.values(tracks));
  $("odd").textContent = [why, ...motion.says].filter(Boolean).join("; ");
  showShapes();
}

function forget() {
  epoch++;
  frames = new Map();
  rows = [];
  full = {};
  drawn = plotted = "";
}

function person(next) { // another shape, in the present frame
  betas = next;
  forget();
  work("person", { betas, epoch });
  showShapes();
}

async function openFile(file) {
  try {
    if (scene.baked) throw new Error("this page holds no model, only what was baked into it: dsnet view --motion FILE");
    const read = readAmass(new Uint8Array(await file.arrayBuffer()), scene.most_frames);
    const isOther = read.gender !== scene.gender && [read.gender, scene.gender].every((one) => GENDERS.includes(one));
    if ((!read.embedded || isOther) && read.betas.some((beta) => beta !== 0)) {
      const origin = read.embedded ? `a ${read.gender} body's, the body is ${scene.gender}` : "another body model's";
      read.betas = read.betas.map(() => 0);
      read.says.push(`Its betas are ${origin}: the mean shape is taken. By its markers: dsnet view --motion FILE.`);
    }
    dropped = { ...read, name: file.name };
    $("motion").options[scene.motions.length]?.remove();
    $("motion").add(new Option(`${file.name} (yours)`, scene.motions.length));
    motion = null;
    await choose(scene.motions.length);
  } catch (error) { say(`${file.name}: ${error.message}`); }
}

// Frames: requested ahead, shown when they have arrived, and interpolated between.

function ask(index) {
  const requested = frames;
  frames.set(index, null);
  work("frame", { index, epoch }).then(({ parts, exact }) => {
    if (requested !== frames) return;
    if (parts) frames.set(index, { ...parts, exact });
    else frames.delete(index); // it failed, and is requested again
  });
}

function surveyed(result) {
  if (result.epoch !== epoch) return;
  rows.push(...result.rows);
  ({ full, low } = result);
  plotted = "";
  for (const [index, frame] of frames) if (frame?.exact === false && (result.done || index < rows.length)) { frames.delete(index); drawn = ""; }
}

const mixed = {};
function between({ exact, ...from }, to, fraction) {
  if (fraction === 0 || !to) return from;
  return Object.fromEntries(Object.entries(from).map(([name, values]) => {
    const out = (mixed[name] ??= new Float32Array(values.length));
    for (let i = 0; i < out.length; i++) out[i] = values[i] + fraction * (to[name][i] - values[i]);
    return [name, out];
  }));
}

function play(on) {
  playing = on;
  $("play").textContent = on ? "Pause" : "Play";
}

function seek(frame) {
  time = Math.min(Math.max(frame, 0), motion.count - 1);
  play(false);
}

function turn(now) {
  requestAnimationFrame(turn);
  const passed = before && now - before;
  before = now;
  if (!motion) return;
  const { count, fps, first: loops } = motion, last = count - 1, round = loops ? count : last; // from a loop's last frame on to its first
  let next = time + (playing ? Math.min(passed, 100) * 0.001 * fps * +$("speed").value : 0);
  if (next > round) next = round ? next % round : 0;
  const one = Math.min(Math.floor(next), last), then = loops ? (one + 1) % count : Math.min(one + 1, last);
  const ahead = AHEAD + 2 * Math.ceil(Math.max(0, next - time));
  for (let index = one; index <= one + ahead; index++) {
    const at = loops ? index % count : Math.min(index, last);
    if (!frames.has(at)) ask(at);
  }
  for (const index of frames.keys()) if ((index - one + count) % count > Math.max(4 * AHEAD, ahead)) frames.delete(index);
  const a = frames.get(one), b = frames.get(then);
  if (a && (b || next === one)) show(a, b, next, next - one); // otherwise the shown frame stays, and time waits
}

function show(a, b, next, fraction) {
  time = next;
  const names = shownNames(), layout = $("layout").value, hasTruth = canShow("truth");
  const colouring = $("colouring").value === "apart" && !hasTruth ? "none" : $("colouring").value;
  const key = [epoch, time, names, colouring].join();
  if (key !== drawn) {
    drawn = key;
    const { rest, bones, root: position, ...offsets } = between(a, b, fraction);
    const truth = colouring === "apart" && !names.includes("truth") ? ["truth"] : [];
    for (const name of [...names, ...truth]) stage.pose(name, { rest, bones }, offsets[name], name === "truth" ? null : gains);
    root = position;
  }
  const scaleMm = SCALES_MM.find((mm) => mm >= 1000 * (full[colouring] ?? 0.02)) ?? 200;
  stage.colour(names, colouring, scaleMm / 1000);
  const stays = $("stay").checked ? root : [0, 0, 0];
  stage.draw(layout, wipeAt, names, [stays[0], $("floor").checked ? low : 0, stays[2]]);
  tags(layout, names);
  $("legend").hidden = colouring === "none";
  $("most").textContent = `${scaleMm} mm and more`;
  $("what").textContent = colouring === "apart" ? "distance to the truth" : "size of the offset";
  plot(names, names.includes("truth") ? "apart" : "size");
  document.body.dataset.ready ??= String(performance.now());
}

// Around the bodies.

function tags(layout, names) {
  $("bar").hidden = layout !== "wipe" || names.length < 2;
  $("bar").style.left = `${100 * wipeAt}%`;
  const { clientWidth: wide, clientHeight: high } = $("view");
  for (const name of allNames()) {
    const tag = $(`tag-${name}`), i = names.indexOf(name);
    tag.hidden = i < 0 || (layout === "wipe" && i > 1);
    if (tag.hidden) continue;
    tag.style.maxWidth = layout === "side" ? `${wide / names.length - 4}px` : "";
    const half = tag.offsetWidth / 2;
    let [x, y] = stage.above(name, root);
    if (layout === "wipe") [x, y] = [wipeAt * wide + (i ? half + 26 : -half - 26), 0.8 * high + 12];
    if (layout === "overlay") y = Math.max(y, 4 + 26 * names.length) - 26 * (names.length - 1 - i);
    tag.style.transform = `translate(${Math.min(Math.max(x - half, 4), wide - 2 * half - 4)}px, ${Math.min(Math.max(y - 24, 6), high - 60)}px)`;
  }
}

function plot(names, kind) {
  const { count, fps } = motion, key = [kind, names].join();
  $("now").style.left = `${(100 * time) / Math.max(1, count - 1)}%`;
  $("clock").textContent = `${(time / fps).toFixed(2)} / ${((count - 1) / fps).toFixed(2)} s`;
  if (plotted === key) return;
  plotted = key;
  const most = curves.draw(rows, count, kind, names.filter((name) => name !== (kind === "apart" ? "truth" : "smpl")));
  $("highest").textContent = (1000 * most).toFixed(most < 0.01 ? 1 : 0);
  $("measure").textContent = kind === "apart" ? "mean distance to the truth, mm" : "mean offset, mm";
  $("end").textContent = `${((count - 1) / fps).toFixed(1)} s`;
}

// Controls.

// A slider shows the value that was set, even between its steps, until it is moved.
const showValue = ({ id, nextElementSibling }, value) => { nextElementSibling.textContent = value.toFixed(id === "speed" ? 1 : 2); };

function slider(parent, id, text, range, value, moved) {
  const row = make("label"), input = make("input", { id, type: "range", ...range });
  row.append(text, input, make("output"));
  $(parent).append(row);
  bindSlider(input, value, moved);
}

function bindSlider(input, value, moved) {
  input.value = value;
  input.oninput = () => { showValue(input, +input.value); moved(+input.value); };
  showValue(input, value);
}

function dynamics() {
  const parts = scene.start.parts.map((part) => scene.start.gain * part);
  gains = new Float32Array(body.count);
  parts.forEach((gain, p) => { for (let v = 0; v < body.count; v++) gains[v] += gain * partWeights[p * body.count + v]; });
  drawn = "";
}

let timer = 0;
function gained() {
  dynamics();
  clearTimeout(timer); // curves follow when the slider rests
  timer = setTimeout(() => { forget(); work("gains", { gains, epoch }); }, 250);
}

function showShapes() {
  betas.slice(0, 10).forEach((beta, i) => { $(`beta${i}`).value = beta; showValue($(`beta${i}`), beta); });
  const options = { "who moved": motion.betas, ...shapes }, near = (a, b) => a.every((x, i) => Math.abs(x - b[i]) < 1e-4);
  const now = Object.keys(options).find((name) => near(options[name], betas)) ?? "as set";
  $("person").replaceChildren(...[...new Set([...Object.keys(options), now])].map((name) => new Option(name)));
  $("person").value = now;
  $("person").onchange = () => { if (options[$("person").value]) person([...options[$("person").value]]); };
}

const NOTICES = { synthetic: "Synthetic: body and flesh are simulated, not measured.", "synthetic flesh": "Synthetic flesh: simulated, not measured." };

function controls() {
  const { start, baked } = scene, names = allNames();
  $("scale").style.background = `linear-gradient(to top, ${COLOURS.map((c) => `rgb(${c})`)})`;
  $("notice").textContent = [NOTICES[scene.origin], baked].filter(Boolean).join(" ");
  scene.motions.forEach(({ name }, i) => $("motion").add(new Option(name, i)));
  const hasTruth = scene.motions.some(({ tracks }) => tracks.includes("truth"));
  for (const name of names) {
    const row = make("label", { className: "check", hidden: name === "truth" && !hasTruth }), key = make("i", { className: "key" });
    const box = make("input", { id: `show-${name}`, type: "checkbox", checked: ["smpl", "truth", names[1]].includes(name) });
    key.style.background = inkOf(name, names);
    row.append(box, key, scene.labels[name]);
    $("shown").append(row);
    box.onchange = () => { if (box.checked && !canShow(name)) choose(motion.number); };
    $("tags").append(make("span", { id: `tag-${name}`, className: "tag", hidden: true, textContent: scene.labels[name] }));
  }
  if (!hasTruth) $("colouring").options[2].remove();
  start.parts.forEach((gain, i) => slider("parts", `part${i}`, scene.parts[i].replace("_", " "), { min: 0, max: Math.max(5, gain), step: 0.05 }, gain,
                                          (value) => { start.parts[i] = value; gained(); }));
  for (let i = 0; i < 10; i++)
    slider("betas", `beta${i}`, `β${i + 1}`, { min: -5, max: 5, step: 0.01 }, 0, (value) => person(betas.with(i, value)));
  $("gain").max = Math.max(5, start.gain);
  bindSlider($("gain"), start.gain, (value) => { start.gain = value; gained(); });
  bindSlider($("speed"), 1, () => {});
  dynamics();
  $("loop").checked = start.loop;
  for (const id of ["shape", "own", "loops"]) $(id).hidden = Boolean(baked);
  $("motion").onchange = () => choose(+$("motion").value);
  $("loop").onchange = () => choose(motion.number);
  $("play").onclick = () => play(!playing);
  const moves = { ArrowLeft: -1, ArrowRight: 1, Home: -Infinity, End: Infinity };
  $("curves").onkeydown = ({ key }) => { if (moves[key]) seek(Math.round(time) + moves[key]); };
  document.onkeydown = (event) => { if (event.key === " " && event.target.tagName !== "BUTTON") { event.preventDefault(); play(!playing); } };
  dragged($("curves"), ({ clientX }) => { const { left, width } = $("curves").getBoundingClientRect(); seek(((clientX - left) / width) * (motion.count - 1)); });
  dragged($("bar"), ({ clientX }) => { wipeAt = Math.min(Math.max(clientX / $("view").clientWidth, 0), 1); });
  document.ondragover = (event) => event.preventDefault();
  document.ondrop = (event) => { event.preventDefault(); if (event.dataTransfer.files[0]) openFile(event.dataTransfer.files[0]); };
  $("file").onchange = () => { if ($("file").files[0]) openFile($("file").files[0]); };
}

function dragged(what, moved) {
  what.onpointerdown = (event) => { what.setPointerCapture(event.pointerId); moved(event); };
  what.onpointermove = (event) => { if (event.buttons) moved(event); };
}

// For tests and measurements.
window.page = {
  seek, readAmass, person, play,
  get time() { return time; }, get frames() { return frames; }, get motion() { return motion; }, get stage() { return stage; }, get curves() { return rows; },
};

main().catch((error) => { say(error.message); });
