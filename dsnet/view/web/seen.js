// What is seen: the bodies of one moment, their labels and legend, and the curves.
import { Curves } from "./curves.js";
import { $ } from "./dom.js";
import { between } from "./frames.js";
import { allNames, canShow, shownNames, state } from "./state.js";

const SCALES_MM = [1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200];
const LEGENDS = {
  size: ["size of the offset", "How far the flesh is from SMPL's skin. Not zero at rest: it is zero in the T-pose, and gravity has turned since."],
  apart: ["distance to the truth", "How far the skin is from where it should be."],
};
const placed = {};
let curves;

// Show the moment between two frames; passed: seconds since the last drawing.
export function show(a, b, fraction, passed) {
  const { stage } = state, names = shownNames(), layout = $("layout").value, hasTruth = canShow("truth");
  const colouring = $("colouring").value === "apart" && !hasTruth ? "none" : $("colouring").value;
  const key = [state.epoch, state.time, names, colouring].join();
  if (key !== state.drawn) {
    state.drawn = key;
    const { rest, bones, root, ...offsets } = between(a, b, fraction);
    const truth = colouring === "apart" && !names.includes("truth") ? ["truth"] : [];
    for (const name of [...names, ...truth]) stage.pose(name, { rest, bones }, offsets[name], name === "truth" ? null : state.gains);
    const [x, , z] = [6, 7, 8].map((row) => bones[(row * bones.length) / 12]); // of the root, where its axis z points
    Object.assign(state, { root, facing: Math.atan2(x, z) });
  }
  const scaleMm = SCALES_MM.find((mm) => mm >= 1000 * (state.full[colouring] ?? 0.02)) ?? 200;
  stage.colour(names, colouring, scaleMm / 1000);
  const stays = $("stay").checked ? state.root : [0, 0, 0];
  stage.draw(layout, state.wipeAt, names, [stays[0], $("floor").checked ? state.low : 0, stays[2]], passed);
  tags(layout, names);
  legend(colouring, scaleMm);
  plot(names, names.includes("truth") ? "apart" : "size");
  document.body.dataset.ready ??= String(performance.now());
}

// Whether this part of the page is to be written anew: writing each time would lay out the page each time.
function isNew(part, ...facts) {
  const key = facts.join(), was = placed[part];
  placed[part] = key;
  return key !== was;
}

function legend(colouring, scaleMm) {
  if (!isNew("legend", colouring, scaleMm)) return;
  const [what, about] = LEGENDS[colouring] ?? ["", ""];
  $("legend").hidden = !what;
  $("most").textContent = `${scaleMm} mm and more`;
  $("what").textContent = what;
  $("about").textContent = about;
}

// Labels: each in the middle of its view; one below the other if bodies overlie; on both sides of a wipe.
function tags(layout, names) {
  const { wipeAt } = state, { clientWidth: wide, clientHeight: high } = $("view"), views = layout === "side" ? Math.max(1, names.length) : 1;
  if (!isNew("tags", layout, names, wipeAt, wide, high)) return;
  $("bar").hidden = layout !== "wipe" || names.length < 2;
  $("bar").style.left = `${100 * wipeAt}%`;
  $("tags").style.setProperty("--views", views);
  for (const name of allNames()) {
    const tag = $(`tag-${name}`), i = names.indexOf(name), wipes = layout === "wipe" && names.length > 1;
    tag.hidden = i < 0 || (wipes && i > 1);
    if (tag.hidden) continue;
    tag.style.maxWidth = `${wide / views - 8}px`;
    const half = tag.offsetWidth / 2, row = layout === "overlay" ? i : 0;
    let x = ((layout === "side" ? i : 0) + 0.5) * (wide / views);
    if (wipes) x = wipeAt * wide + (i ? half + 10 : -half - 10);
    tag.style.transform = `translate(${Math.min(Math.max(x - half, 4), wide - 2 * half - 4)}px, ${10 + 27 * row}px)`;
  }
}

function plot(names, kind) {
  const { time, motion: { count, fps } } = state, key = [kind, names].join();
  $("now").style.left = `${(100 * time) / Math.max(1, count - 1)}%`;
  $("clock").textContent = `${(time / fps).toFixed(2)} / ${((count - 1) / fps).toFixed(2)} s`;
  if (state.plotted === key) return;
  state.plotted = key;
  curves ??= new Curves($("plot"), allNames());
  const most = curves.draw(state.rows, count, kind, names.filter((name) => name !== (kind === "apart" ? "truth" : "smpl")));
  $("highest").textContent = (1000 * most).toFixed(most < 0.01 ? 1 : 0);
  $("measure").textContent = kind === "apart" ? "mean distance to the truth, mm" : "mean offset, mm";
  $("end").textContent = `${((count - 1) / fps).toFixed(1)} s`;
}
