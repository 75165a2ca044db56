// Time: which frame is shown.
import { $ } from "./dom.js";
import { request } from "./frames.js";
import { show } from "./seen.js";
import { state } from "./state.js";

let before = 0;

export function play(on) {
  state.playing = on;
  $("play").textContent = on ? "Pause" : "Play";
}

export function seek(frame) {
  state.time = Math.min(Math.max(frame, 0), state.motion.count - 1);
  play(false);
}

export function turn(now) {
  requestAnimationFrame(turn);
  const passed = before && now - before;
  before = now;
  if (!state.motion) return;
  const { time, motion: { count, fps, first: loops } } = state, last = count - 1, round = loops ? count : last; // from a loop's last frame on to its first
  let next = time + (state.playing ? Math.min(passed, 100) * 0.001 * fps * +$("speed").value : 0);
  if (next > round) next = round ? next % round : 0;
  const one = Math.min(Math.floor(next), last), then = loops ? (one + 1) % count : Math.min(one + 1, last);
  request(one, next - time);
  const a = state.frames.get(one), b = state.frames.get(then);
  if (!a || (!b && next !== one)) return; // the shown frame stays, and time waits
  state.time = next;
  show(a, b, next - one, passed / 1000);
}
