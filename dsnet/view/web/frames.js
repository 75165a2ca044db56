// Frames of the present motion: requested before they are shown, and interpolated between.
import { work } from "./model.js";
import { state } from "./state.js";

const AHEAD = 6; // frames requested before they are shown; more if drawing is slow

// Request the frames that come after frame `one`, `passed` frames of time after the shown ones; drop those that are far.
export function request(one, passed) {
  const { motion: { count, first: loops }, frames } = state, ahead = AHEAD + 2 * Math.ceil(Math.max(0, passed));
  for (let index = one; index <= one + ahead; index++) {
    const at = loops ? index % count : Math.min(index, count - 1);
    if (!frames.has(at)) ask(at);
  }
  for (const index of frames.keys()) if ((index - one + count) % count > Math.max(4 * AHEAD, ahead)) frames.delete(index);
}

function ask(index) {
  const { frames, epoch } = state;
  frames.set(index, null);
  work("frame", { index, epoch }).then(({ parts, exact }) => {
    if (frames !== state.frames) return;
    if (parts) frames.set(index, { ...parts, exact });
    else frames.delete(index); // it failed, and is requested again
  });
}

export function surveyed({ epoch, rows, full, low, done }) {
  if (epoch !== state.epoch) return;
  state.rows.push(...rows);
  Object.assign(state, { full, low, plotted: "" });
  for (const [index, frame] of state.frames)
    if (frame?.exact === false && (done || index < state.rows.length)) { state.frames.delete(index); state.drawn = ""; }
}

const mixed = {};
export function between({ exact, ...from }, to, fraction) {
  if (fraction === 0 || !to) return from;
  return Object.fromEntries(Object.entries(from).map(([name, values]) => {
    const out = (mixed[name] ??= new Float32Array(values.length));
    for (let i = 0; i < out.length; i++) out[i] = values[i] + fraction * (to[name][i] - values[i]);
    return [name, out];
  }));
}
