// What is seen: the bodies of one moment, their labels and legend, and the curves.
import { Curves } from "./curves.js";
import { $ } from "./dom.js";
import { between } from "./frames.js";
import { allNames, canShow, shownNames, state } from "./state.js";

const SCALES_MM = [1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200];
let curves;

// Show the moment between two frames.
export function show(a, b, fraction) {
  const { stage } = state, names = shownNames(), layout = $("layout").value, hasTruth = canShow("truth");
  const colouring = $("colouring").value === "apart" && !hasTruth ? "none" : $("colouring").value;
  const key = [state.epoch, state.time, names, colouring].join();
  if (key !== state.drawn) {
    state.drawn = key;
    const { rest, bones, root, ...offsets } = between(a, b, fraction);
    const truth = colouring === "apart" && !names.includes("truth") ? ["truth"] : [];
    for (const name of [...names, ...truth]) stage.pose(name, { rest, bones }, offsets[name], name === "truth" ? null : state.gains);
    state.root = root;
  }
  const scaleMm = SCALES_MM.find((mm) => mm >= 1000 * (state.full[colouring] ?? 0.02)) ?? 200;
  stage.colour(names, colouring, scaleMm / 1000);
  const stays = $("stay").checked ? state.root : [0, 0, 0];
  stage.draw(layout, state.wipeAt, names, [stays[0], $("floor").checked ? state.low : 0, stays[2]]);
  tags(layout, names);
  $("legend").hidden = colouring === "none";
  $("most").textContent = `${scaleMm} mm and more`;
  $("what").textContent = colouring === "apart" ? "distance to the truth" : "size of the offset";
  plot(names, names.includes("truth") ? "apart" : "size");
  document.body.dataset.ready ??= String(performance.now());
}

function tags(layout, names) {
  const { stage, wipeAt, root } = state;
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
