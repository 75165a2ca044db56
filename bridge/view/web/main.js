// The page: what is shown, when, and what the knobs say. The model runs in a worker.
import { readAmass } from "./amass.js";
import { Body, bytesOf, numbersOf } from "./body.js";
import { Curves, inkOf } from "./curves.js";
import { COLOURS, Stage } from "./stage.js";

const $ = (id) => document.getElementById(id);
const AHEAD = 6; // frames asked for before they are shown; more where drawing is slow
const LABELS = { smpl: "SMPL alone", truth: "truth" };
const SCALES_MM = [1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200];
const say = (text) => { $("says").textContent = text; };

// An asset lies in the page, or on its server; packed or not.
async function asset(name) {
  const embedded = $(`asset:${name}`);
  const bytes = embedded ? bytesOf(embedded.textContent) : await fetched(name);
  if (embedded) embedded.textContent = ""; // text of several MB
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes.buffer;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

async function fetched(name) {
  const answer = await fetch(`assets/${name}`).catch(() => null);
  if (!answer?.ok) throw new Error("the server does not answer: start `dsnet view` again");
  if (answer.headers.get("content-type") === "application/json") throw new Error((await answer.json()).failed);
  return new Uint8Array(await answer.arrayBuffer());
}

async function json(name) {
  const found = JSON.parse(new TextDecoder().decode(await asset(name)));
  if (found.failed) throw new Error(found.failed);
  return found;
}

const kept = new Map(); // what was fetched, by name
const once = (name, how) => kept.get(name) ?? kept.set(name, how(name).catch((error) => { kept.delete(name); throw error; })).get(name);

class Worked {
  constructor() {
    this.waiting = new Map();
    const address = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
    this.worker = new Worker(address);
    this.worker.onmessage = ({ data }) => {
      if (data.failed) say(data.failed);
      if (data.job === "survey") return surveyed(data);
      this.waiting.get(data.ticket)?.(data);
      this.waiting.delete(data.ticket);
    };
    this.worker.onerror = (event) => say(`the model cannot run here: ${event.message}`);
  }

  call(job, more = {}, transferred = []) {
    const ticket = (this.last = (this.last ?? 0) + 1);
    this.worker.postMessage({ job, ticket, ...more }, transferred);
    return new Promise((resolve) => this.waiting.set(ticket, resolve));
  }
}

let scene, body, stage, worked, curves, motion, betas, shapes = {}, gains = null, partWeights;
let epoch = 0, frames = new Map(), pending = new Set(), time = 0, playing = true, before = 0, drawn = "", low = 0;
let full = {}, wanted = 0, own = null;
const stats = { step: [], draw: [], skin: [], between: [], stalls: 0 }; // milliseconds
const keep = (list, ms) => { list.push(ms); if (list.length > 600) list.shift(); };

const everybody = () => ["smpl", ...scene.predictors.map(({ name }) => name), "truth"];
const labelOf = (name) => LABELS[name] ?? scene.predictors.find((one) => one.name === name).label;
// Who can be seen now: tracks are of one motion as it was recorded, of one shape.
const isThere = (name) => motion.tracks[name] ? scene.baked || isOwn() : !scene.baked && ["smpl", scene.graph.predictor].includes(name);
const isOwn = () => betas.every((beta, i) => Math.abs(beta - motion.betas[i]) < 1e-6);
const shownNames = () => everybody().filter((name) => $(`show-${name}`).checked && isThere(name));

async function main() {
  const opened = [json("scene"), asset("runtime")];
  scene = await opened[0];
  body = new Body(scene);
  try { stage = new Stage($("view"), body); } catch { throw new Error("this browser draws no WebGL: switch on its hardware acceleration, or take another one"); }
  if (typeof WebAssembly !== "object") throw new Error("this browser runs no WebAssembly, which the model needs");
  partWeights = numbersOf(scene.part_weights, Float32Array);
  worked = new Worked();
  const [model, wasm] = scene.baked ? [null, null] : await Promise.all([asset("model"), opened[1]]);
  curves = new Curves($("curves"), (share) => seek(share * (motion.count - 1)));
  controls();
  stats.fetched = performance.now();
  const ready = worked.call("open", { scene, model: model && new Uint8Array(model), wasm }, model ? [model, wasm] : []);
  stage.warm(); // while the model opens
  await choose(0);
  if (!scene.baked) once("shapes", json).then((found) => { shapes = found; people(); }).catch((error) => say(error.message));
  await ready;
  stats.opened = performance.now();
  requestAnimationFrame(turn);
}

// Motions: those of the scene, and what was dropped.

async function choose(number, looped = $("loop").checked) {
  const mine = ++wanted;
  try {
    let next, failed = "";
    if (own && number === scene.motions.length) next = own;
    else if (looped && !scene.baked) next = await once(`loop${number}`, json).then(ready, (error) => { failed = error.message; });
    $("looped").textContent = failed || (looped && next === own) ? "cannot be closed here" : "";
    $("looped").title = failed || (looped ? "a loop is closed by Python" : "");
    next ??= ready(await once(`motion${number}`, json));
    const tracks = {}, missing = [];
    if (next !== own && !next.back)
      for (const name of scene.motions[number].tracks)
        if (scene.baked || $(`show-${name}`).checked) {
          if (!kept.has(`track${number}_${name}`)) $("who").textContent = `computing ${labelOf(name)} …`;
          await once(`track${number}_${name}`, asset).then((found) => { tracks[name] = found; }, (error) => missing.push(error.message));
        }
    if (mine !== wanted) return;
    if (missing.length && scene.baked) throw new Error(missing[0]);
    await perform({ ...next, tracks, number }, looped && Boolean(failed));
    say(missing.join(" "));
  } catch (error) { say(error.message); }
  headline();
}

function ready(given) {
  const theta = given.theta instanceof Float64Array ? given.theta : numbersOf(given.theta, Float64Array);
  return { ...given, theta, frames: theta.length / 69, tracks: {} };
}

async function perform(next, goesOn) {
  const same = motion && motion.number === next.number;
  const shape = same && betas && !isOwn() ? betas : next.betas;
  motion = next;
  betas = [...shape];
  if (!same) time = 0;
  time = Math.min(time, motion.count - 1);
  $("motion").value = motion.number;
  forget();
  const { tracks, ...rest } = motion;
  await worked.call("perform", { motion: rest, tracks, betas, epoch });
  $("odd").textContent = [goesOn ? $("looped").title : "", ...motion.says, ...otherGender()].filter(Boolean).join("; ");
  sliders();
  people();
}

const otherGender = () => (["female", "male"].includes(motion.gender) && motion.gender !== scene.gender ? [`The file's betas are a ${motion.gender}'s, the body is ${scene.gender}.`] : []);

function forget() {
  epoch++;
  frames = new Map();
  pending = new Set();
  curves.rows = [];
  full = {};
  drawn = "";
}

function person(next) { // another shape, from where she is
  betas = next;
  forget();
  worked.call("person", { betas, epoch });
}

async function take(file) {
  try {
    if (scene.baked) throw new Error("this page holds no model, only what was baked into it: dsnet view --motion FILE");
    const read = readAmass(new Uint8Array(await file.arrayBuffer()), scene.most_frames);
    if (!read.embedded && read.betas.some((beta) => beta !== 0)) {
      read.betas = read.betas.map(() => 0);
      read.says.push("Its betas are another body model's: the mean shape is taken. By its markers: dsnet view --motion FILE.");
    }
    own = ready({ ...read, name: file.name });
    $("motion").options[scene.motions.length]?.remove();
    $("motion").add(new Option(`${file.name} (yours)`, scene.motions.length));
    motion = null;
    await choose(scene.motions.length);
  } catch (error) { say(`${file.name}: ${error.message}`); }
}

// Frames: asked for ahead, shown when they are there; in between, mixed.

function ask(index) {
  const mine = epoch;
  pending.add(index);
  worked.call("frame", { index, epoch }).then((found) => {
    if (mine !== epoch) return;
    pending.delete(index);
    if (found.index === undefined) return;
    if (found.ms) keep(stats.step, found.ms);
    frames.set(index, found);
  });
}

function surveyed({ epoch: theirs, from, rows, full: scale, low: height, done }) {
  if (theirs !== epoch) return;
  rows.forEach((row, i) => { curves.rows[from + i] = row; });
  full = scale;
  low = height;
  for (const [index, frame] of frames) if (!frame.exact && (done || index < from)) { frames.delete(index); drawn = ""; }
}

const mixed = new Map();
function mix(key, a, b, share) {
  const out = mixed.get(key) ?? mixed.set(key, new Float32Array(a.length)).get(key);
  for (let i = 0; i < out.length; i++) out[i] = a[i] + share * (b[i] - a[i]);
  return out;
}

function between(a, b, share) {
  if (share === 0 || !b) return a;
  const offsets = Object.fromEntries(Object.keys(a.offsets).map((name) => [name, mix(name, a.offsets[name], b.offsets[name], share)]));
  return { rest: mix("rest ", a.rest, b.rest, share), bones: mix("bones ", a.bones, b.bones, share), offsets };
}

function seek(frame) {
  time = frame;
  playing = false;
  $("play").textContent = "Play";
}

function turn(now) {
  requestAnimationFrame(turn);
  if (!motion) return;
  const passed = before ? now - before : 0, last = motion.count - 1;
  before = now;
  if (passed) keep(stats.between, passed);
  let next = time + (playing ? Math.min(passed, 100) * 0.001 * motion.fps * +$("speed").value : 0);
  const round = motion.back ? motion.count : last; // from a loop's last frame on to its first
  if (next > round) next = round ? next % round : 0;
  const one = Math.min(Math.floor(next), last), then = one < last ? one + 1 : motion.back ? 0 : last;
  const ahead = AHEAD + 2 * Math.ceil(Math.max(0, next - time));
  for (let index = one; index <= one + ahead; index++) {
    const at = motion.back ? index % motion.count : index;
    if (at <= last && !frames.has(at) && !pending.has(at)) ask(at);
  }
  for (const index of frames.keys()) if ((index - one + motion.count) % motion.count > 4 * AHEAD && index !== one) frames.delete(index);
  const a = frames.get(one), b = frames.get(then);
  if (!a || (!b && next > one)) stats.stalls++; // what is shown stays, and time waits
  else show(a, b, next, one);
  const names = shownNames(), kind = names.includes("truth") && motion.tracks.truth ? "apart" : "size";
  const drawnNames = names.filter((name) => (kind === "apart" ? name !== "truth" : name !== "smpl"));
  curves.draw(motion.count, time, kind, drawnNames, everybody(), motion.fps);
  $("clock").textContent = `${(time / motion.fps).toFixed(2)} / ${(last / motion.fps).toFixed(2)} s`;
}

function show(a, b, next, one) {
  time = next;
  const names = shownNames(), layout = $("layout").value, colouring = $("colouring").value;
  const key = [epoch, time, names, layout, colouring, $("gain").value, drawn && gains].join();
  const began = performance.now();
  if (key !== drawn) {
    drawn = key;
    const frame = between(a, b, time - one), truth = colouring === "apart" && !names.includes("truth") && frame.offsets.truth ? ["truth"] : [];
    for (const name of [...names, ...truth]) {
      stage.pose(name, frame, frame.offsets[name], name === "truth" ? null : gains);
    }
    root = $("stay").checked ? rootOf(time) : [0, 0, 0];
    keep(stats.skin, performance.now() - began);
  }
  const scaleMm = SCALES_MM.find((mm) => mm >= 1000 * (full[colouring] ?? 0.02)) ?? 200;
  stage.colour(names, colouring === "apart" && !motion.tracks.truth ? "none" : colouring, scaleMm / 1000);
  const drawing = performance.now();
  stage.draw(layout, wipeAt, names, [root[0], $("floor").checked ? low : 0, root[2]]);
  keep(stats.draw, performance.now() - drawing);
  tags(layout, names);
  legend(colouring, scaleMm);
  if (!document.body.dataset.ready) document.body.dataset.ready = String(performance.now());
}

let wipeAt = 0.5, root = [0, 0, 0];
function rootOf(at) { // horizontally, where the motion has her
  const one = Math.floor(at), two = Math.min(one + 1, motion.count - 1), share = at - one, rounds = motion.back && motion.first;
  const place = (frame) => [0, 1, 2].map((k) => motion.theta[(frame + (rounds ? 0 : motion.first)) * 69 + 66 + k]);
  const [from, to] = [place(one), place(two)];
  return from.map((c, k) => c + share * (to[k] - c));
}

// Around the bodies.

function tags(layout, names) {
  $("bar").hidden = layout !== "wipe" || names.length < 2;
  $("bar").style.left = `${100 * wipeAt}%`;
  for (const name of everybody()) {
    const tag = $(`tag-${name}`), i = names.indexOf(name);
    tag.hidden = i < 0 || (layout === "wipe" && i > 1);
    if (tag.hidden) continue;
    let [x, y] = stage.above(name);
    const { clientWidth: wide, clientHeight: high } = $("view"), half = tag.offsetWidth / 2;
    if (layout === "wipe") [x, y] = [wipeAt * wide + (i ? half + 26 : -half - 26), 0.8 * high + 12];
    if (layout === "overlay") y -= 26 * (names.length - 1 - i);
    tag.style.transform = `translate(${Math.min(Math.max(x - half, 4), wide - 2 * half - 4)}px, ${Math.min(Math.max(y - 24, 6), high - 60)}px)`;
  }
}

function legend(colouring, scaleMm) {
  const apart = colouring === "apart";
  $("legend").hidden = colouring === "none" || (apart && !motion.tracks.truth);
  $("most").textContent = `${scaleMm} mm and more`;
  $("what").textContent = apart ? "distance to the truth" : "size of the offset";
}

function headline() {
  $("who").textContent = `${scene.owner} · ${motion?.count ?? 0} frames, ${motion?.fps ?? 60} fps`;
}

// Knobs.

function slider(parent, id, text, range, value, moved) {
  const row = document.createElement("label");
  row.append(text, Object.assign(document.createElement("input"), { id, type: "range", ...range, value }), document.createElement("output"));
  parent.append(row);
  $(id).oninput = () => { told(id); moved(+$(id).value); };
  told(id);
}
const told = (id) => { $(id).nextElementSibling.textContent = (+$(id).value).toFixed(id === "speed" ? 1 : 2); };

let later = 0;
function dynamics() {
  const gain = +$("gain").value, parts = scene.parts.map((_, i) => +$(`part${i}`).value);
  gains = new Float32Array(body.count);
  parts.forEach((part, p) => { for (let v = 0; v < body.count; v++) gains[v] += gain * part * partWeights[p * body.count + v]; });
  drawn = "";
  clearTimeout(later); // curves follow when the hand rests
  later = setTimeout(() => { curves.rows = []; full = {}; worked.call("gains", { gains }); }, 250);
}

function sliders() {
  for (let i = 0; i < 10; i++) { $(`beta${i}`).value = betas[i]; told(`beta${i}`); }
}

function people() {
  const options = { "who moved": motion.betas, ...shapes }, near = (a, b) => a.every((x, i) => Math.abs(x - b[i]) < 1e-4);
  const now = isOwn() ? "who moved" : Object.keys(options).find((name) => near(options[name], betas)) ?? "as set";
  $("person").replaceChildren(...[...Object.keys(options), ...(now === "as set" ? [now] : [])].map((name) => new Option(name)));
  $("person").value = now;
  $("person").onchange = () => { if (options[$("person").value]) { person([...options[$("person").value]]); sliders(); } };
}

function controls() {
  const { start } = scene, range = { min: 0, max: 5, step: 0.05 };
  $("scale").style.background = `linear-gradient(to top, ${COLOURS.map((c) => `rgb(${c})`)})`;
  $("notice").textContent = [scene.origin === "synthetic" ? "Synthetic: body and flesh are simulated, not measured." : "", scene.baked].filter(Boolean).join(" ");
  scene.motions.forEach(({ name }, i) => $("motion").add(new Option(name, i)));
  const known = scene.motions.some(({ tracks }) => tracks.includes("truth"));
  const [best] = scene.predictors;
  for (const name of everybody()) {
    const row = Object.assign(document.createElement("label"), { className: "check", hidden: name === "truth" && !known });
    const box = Object.assign(document.createElement("input"), { id: `show-${name}`, type: "checkbox", checked: ["smpl", "truth", best.name].includes(name) });
    const key = Object.assign(document.createElement("i"), { className: "key" });
    key.style.background = inkOf(name, everybody());
    const text = document.createElement("span");
    text.append(key, ` ${labelOf(name)}`);
    row.append(box, text);
    $("shown").append(row);
    box.onchange = () => { if (box.checked && !isThere(name)) choose(motion.number); };
    $("tags").append(Object.assign(document.createElement("span"), { id: `tag-${name}`, className: "tag", hidden: true, textContent: labelOf(name) }));
  }
  if (!known) $("colouring").options[2].remove();
  scene.parts.forEach((part, i) => slider($("parts"), `part${i}`, part.replace("_", " "), range, start.parts[i], dynamics));
  for (let i = 0; i < 10; i++)
    slider($("betas"), `beta${i}`, `β${i + 1}`, { min: -5, max: 5, step: 0.01 }, 0, (value) => {
      person(betas.map((beta, k) => (k === i ? value : beta)));
      people();
    });
  $("gain").max = Math.max(5, start.gain);
  $("gain").value = start.gain;
  $("loop").checked = start.loop;
  for (const [id, moved] of [["gain", dynamics], ["speed", () => {}]]) { told(id); $(id).oninput = () => { told(id); moved(); }; }
  dynamics();
  $("shape").hidden = $("own").hidden = Boolean(scene.baked);
  $("motion").onchange = () => choose(+$("motion").value);
  $("loop").onchange = () => choose(motion.number);
  $("loop").parentElement.hidden = Boolean(scene.baked);
  $("floor").onchange = $("stay").onchange = $("layout").onchange = $("colouring").onchange = () => { drawn = ""; };
  const play = ($("play").onclick = () => { playing = !playing; $("play").textContent = playing ? "Pause" : "Play"; });
  const moves = { ArrowLeft: -1, ArrowRight: 1, Home: -1e9, End: 1e9 };
  $("curves").onkeydown = ({ key }) => { if (moves[key]) seek(Math.min(Math.max(Math.round(time) + moves[key], 0), motion.count - 1)); };
  document.onkeydown = (event) => { if (event.key === " " && event.target.tagName !== "BUTTON") { event.preventDefault(); play(); } };
  $("bar").onpointerdown = (event) => {
    $("bar").setPointerCapture(event.pointerId);
    $("bar").onpointermove = ({ clientX }) => { wipeAt = Math.min(Math.max(clientX / $("view").clientWidth, 0), 1); };
  };
  $("bar").onpointerup = () => { $("bar").onpointermove = null; };
  document.ondragover = (event) => event.preventDefault();
  document.ondrop = (event) => { event.preventDefault(); if (event.dataTransfer.files[0]) take(event.dataTransfer.files[0]); };
  $("file").onchange = () => { if ($("file").files[0]) take($("file").files[0]); };
}

// For tests and measurements.
window.page = {
  stats, seek, readAmass, person: (shape) => { person(shape); sliders(); people(); },
  play: (on) => { if (on !== playing) $("play").onclick(); },
  get time() { return time; }, get frames() { return frames; }, get motion() { return motion; }, get stage() { return stage; },
  get full() { return full; }, get curves() { return curves.rows; }, get epoch() { return epoch; }, get low() { return low; },
};

main().catch((error) => { say(error.message); });
