// A motion file of one's own: dropped onto the page, or chosen. Python reads it where it serves the
// page; a page from a disk reads AMASS's kind and BVH itself.
import { GENDERS, readAmass } from "./amass.js";
import { json } from "./assets.js";
import { readBvh } from "./bvh.js";
import { $, say } from "./dom.js";
import { choose, showOwner } from "./motions.js";
import { sendFile } from "./reading.js";
import { isServed } from "./server.js";
import { state } from "./state.js";

export function dropControls() {
  document.ondragover = (event) => event.preventDefault();
  document.ondrop = (event) => { event.preventDefault(); if (event.dataTransfer.files[0]) openFile(event.dataTransfer.files[0]); };
  $("file").onchange = () => { if ($("file").files[0]) openFile($("file").files[0]); };
}

async function openFile(file) {
  try { await (isServed() ? sendFile(file) : readFile(file)); } catch ({ message }) {
    say(message.startsWith(file.name) ? message : `${file.name}: ${message}`);
    showOwner();
  }
}

export async function readBytes(bytes, name, mostFrames) {
  return /\.bvh$/i.test(name) ? readBvh(bytes, await json("rules"), mostFrames) : readAmass(bytes, mostFrames);
}

async function readFile(file) {
  const { scene } = state;
  if (scene.baked) throw new Error("this page holds no model, only what was baked into it: dsnet view --motion FILE");
  const read = await readBytes(new Uint8Array(await file.arrayBuffer()), file.name, scene.most_frames);
  const isOther = read.gender !== scene.gender && [read.gender, scene.gender].every((one) => GENDERS.includes(one));
  if ((!read.embedded || isOther) && read.betas.some((beta) => beta !== 0)) {
    const origin = read.embedded ? `a ${read.gender} body's, the body is ${scene.gender}` : "another body model's";
    read.betas = read.betas.map(() => 0);
    read.says.push(`Its betas are ${origin}: the mean shape is taken. By its markers: dsnet view --motion FILE.`);
  }
  state.dropped = { ...read, name: file.name };
  $("motion").options[scene.motions.length]?.remove();
  $("motion").add(new Option(`${file.name} (yours)`, scene.motions.length));
  state.motion = null;
  await choose(scene.motions.length);
}
