// Motions, those of the scene and that of a dropped file, and who performs them.
import { asset, json } from "./assets.js";
import { $, say } from "./dom.js";
import { work } from "./model.js";
import { hasOriginalShape, state } from "./state.js";

export const changes = new EventTarget(); // "motion": another one; "shape": another motion or other betas
let request = 0;

export async function choose(number, looped = $("loop").checked && !state.scene.baked) {
  const { scene } = state, thisRequest = ++request, isDropped = number === scene.motions.length, missing = [], tracks = {};
  try {
    let why = looped && isDropped ? "a loop is closed by Python" : "", next = isDropped && state.dropped;
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
  showOwner();
}

export function showOwner() {
  const { scene: { owner }, motion } = state;
  $("who").textContent = `${owner} · ${motion?.count ?? 0} frames, ${motion?.fps ?? 60} fps`;
}

function perform({ theta, ...motion }, tracks, why) {
  const isOther = state.motion?.number !== motion.number;
  if (isOther || hasOriginalShape()) state.betas = [...motion.betas];
  state.motion = motion;
  state.time = isOther ? 0 : Math.min(state.time, motion.count - 1);
  $("motion").value = motion.number;
  forget();
  work("perform", { motion, theta, tracks, betas: state.betas, epoch: state.epoch }, Object.values(tracks));
  $("odd").textContent = [why, ...motion.says].filter(Boolean).join("; ");
  for (const change of ["shape", "motion"]) changes.dispatchEvent(new Event(change));
}

// Drop all frames and curves.
export function forget() {
  state.epoch++;
  Object.assign(state, { frames: new Map(), rows: [], full: {}, drawn: "", plotted: "" });
}

// Another shape, in the present frame.
export function person(betas) {
  state.betas = betas;
  forget();
  work("person", { betas, epoch: state.epoch });
  changes.dispatchEvent(new Event("shape"));
}
