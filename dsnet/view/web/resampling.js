// A motion at 60 frames a second, y up, as bridge/motion/resampling.py makes it. What Python divides or mends is refused.
import { inverse, quaternion, rotvec, times } from "./linear.js";
import { BY_PYTHON, refuse } from "./refused.js";

export const MOST_FRAMES = 108000;
const JOINTS = 22, FPS = 60;
const CUT_M = 0.5, CUT_RAD = (150 / 180) * Math.PI, MOST_TURN_RAD_S = (3500 / 180) * Math.PI, MOST_ARM_TURN_RAD_S = (8000 / 180) * Math.PI, MOST_ROOT_M_S2 = 20 * 9.81, LEAST_ROOT_M = 0.03, UPRIGHT = [-Math.SQRT1_2, 0, 0, Math.SQRT1_2];

// poses (frames, width) and trans (frames, 3) of a file at its rate.
export function sampled({ poses, trans, frames, width, rate, up }, mostFrames = MOST_FRAMES) {
  const count = Math.floor(((frames - 1) / rate) * FPS + 1e-3) + 1;
  if (count > Math.min(MOST_FRAMES, mostFrames)) refuse(`a motion of ${count} frames; a page shows ${mostFrames}: cut it into several files`);
  const repeat = repeated(poses, trans, frames, width, rate);
  if (repeat) refuse(`its frame ${repeat} repeats the one before while the body moves; Python interpolates it: ${BY_PYTHON}`);
  return { theta: atSixty(poses, trans, frames, width, rate, count, up), frames: count, first: 0, count, starts: [0], fps: FPS };
}

// The first frame that repeats the one before, for at most a quarter of a second, while the body moves as fast just before
// and after (repeated_frames of bridge.motion.cuts); 0 if there is none.
function repeated(poses, trans, frames, width, rate) {
  const square = (values, many, each, i) => { let sum = 0; for (let k = 0; k < many; k++) sum += (values[i + each + k] - values[i + k]) ** 2; return sum; };
  const speed = Float64Array.from({ length: frames - 1 }, (_, i) =>
    rate * Math.sqrt((square(poses, 3 * JOINTS, width, i * width) + square(trans, 3, 3, 3 * i)) / 69));
  for (let i = 0, last = Infinity; i < frames - 1; i++) {
    if (speed[i] <= 1e-6) continue;
    const still = i - last - 1, slowest = Math.min(speed[last] - 0.7 * (speed[last - 1] ?? 0), speed[i] - 0.7 * (speed[i + 1] ?? 0));
    if (still > 0 && still <= 0.25 * rate && Math.min(speed[last], speed[i]) >= 0.02 && slowest >= 0) return last + 2;
    last = i;
  }
  return 0;
}

// The first frame in which the root has left faster than anybody can, and is back within some frames (find_spikes of
// bridge.motion.repairs); 0 if there is none.
function leap(moved, frames, rate) {
  const apart = (of) => Math.hypot(...moved.map(of)), bent = [];
  for (let row = 1; row < frames - 1; row++) if (apart((at) => at[row + 1] - 2 * at[row] + at[row - 1]) * rate ** 2 > MOST_ROOT_M_S2) bent.push(row);
  return bent.find((first) => bent.some((end) => {
    if (end <= first || end > first + Math.max(4, Math.round(0.1 * rate))) return false;
    const away = (row) => apart((at) => at[row] - at[first - 1] - (row - first + 1) * (at[first - 1] - at[Math.max(first - 2, 0)]));
    const most = Math.max(...Array.from({ length: end - first }, (_, i) => away(first + i)));
    return most >= LEAST_ROOT_M && away(end) <= 0.5 * most;
  })) ?? 0;
}

// Between frames: Slerp joint by joint and translation linearly; of slower files than 60 fps cubic splines of quaternions and
// translation, as corners would hit the tissue. y up, axis-angles continuous in time.
function atSixty(poses, trans, frames, width, rate, count, up) {
  const theta = new Float64Array(count * 69), quats = [...Array(JOINTS)].map(() => [...Array(4)].map(() => new Float64Array(frames)));
  const moved = [0, 1, 2].map((k) => Float64Array.from({ length: frames }, (_, row) => trans[3 * row + k]));
  const turned = (row, j) => quats[j].map((part) => part[row]);
  const leapt = leap(moved, frames, rate);
  if (leapt) refuse(`its root leaps at its frame ${leapt}; Python mends it there: ${BY_PYTHON}`);
  for (let row = 0; row < frames; row++) {
    const far = row ? Math.hypot(...moved.map((part) => part[row] - part[row - 1])) : 0;
    for (let j = 0; j < JOINTS; j++) {
      let q = quaternion(poses.subarray(row * width + 3 * j, row * width + 3 * j + 3));
      if (row && turned(row - 1, j).reduce((sum, x, i) => sum + x * q[i], 0) < 0) q = q.map((x) => -x);
      q.forEach((x, i) => (quats[j][i][row] = x));
      const turn = row ? Math.hypot(...rotvec(times(inverse(turned(row - 1, j)), q))) : 0;
      if (far >= CUT_M || turn >= CUT_RAD || turn * rate > (j < 12 ? MOST_TURN_RAD_S : MOST_ARM_TURN_RAD_S))
        refuse(`the motion jumps at its frame ${row}; Python divides or mends it there: ${BY_PYTHON}`);
    }
  }
  const curved = rate < FPS - 1e-3 && frames >= 4, bend = (parts) => parts.map((part) => [part, slopes(part)]);
  const turns = curved && quats.map(bend), path = curved && bend(moved);
  for (let f = 0; f < count; f++) {
    const at = Math.min((f / FPS) * rate, frames - 1), one = Math.floor(at), two = Math.min(one + 1, frames - 1), fraction = at - one;
    for (let j = 0; j < JOINTS; j++) {
      let q = curved ? turns[j].map((part) => onSpline(part, one, two, fraction)) : turned(one, j);
      if (!curved && fraction > 0) q = times(q, quaternion(rotvec(times(inverse(q), turned(two, j))).map((x) => x * fraction)));
      if (j === 0 && up === "z") q = times(UPRIGHT, q);
      const v = rotvec(q), angle = Math.hypot(...v);
      if (f && angle > 1e-9) {
        const before = theta.subarray((f - 1) * 69 + 3 * j, (f - 1) * 69 + 3 * j + 3), axis = v.map((x) => x / angle);
        const turns = Math.round((axis[0] * before[0] + axis[1] * before[1] + axis[2] * before[2] - angle) / (2 * Math.PI));
        for (let k = 0; k < 3; k++) v[k] += 2 * Math.PI * turns * axis[k];
      }
      theta.set(v, f * 69 + 3 * j);
    }
    const [x, y, z] = curved ? path.map((part) => onSpline(part, one, two, fraction)) : moved.map((part) => part[one] * (1 - fraction) + part[two] * fraction);
    theta.set(up === "z" ? [x, z, -y] : [x, y, z], f * 69 + 66);
    if (f && Math.hypot(...[66, 67, 68].map((k) => theta[f * 69 + k] - theta[f * 69 - 69 + k])) >= CUT_M) refuse(`its root goes faster than anybody; Python divides it there: ${BY_PYTHON}`);
  }
  return theta;
}

// Slopes, per frame, of the cubic spline through values, with "not-a-knot" ends.
function slopes(y) {
  const n = y.length, right = new Float64Array(n), upper = new Float64Array(n);
  const rise = (i) => y[i + 1] - y[i], end = (near, next) => (5 * near + next) / 2;
  upper[0] = 2;
  right[0] = end(rise(0), rise(1));
  for (let i = 1; i < n - 1; i++) {
    const pivot = 4 - upper[i - 1];
    upper[i] = 1 / pivot;
    right[i] = (3 * (rise(i) + rise(i - 1)) - right[i - 1]) / pivot;
  }
  right[n - 1] = (end(rise(n - 2), rise(n - 3)) - 2 * right[n - 2]) / (1 - 2 * upper[n - 2]);
  for (let i = n - 2; i >= 0; i--) right[i] -= upper[i] * right[i + 1];
  return right;
}

function onSpline([y, slope], one, two, t) {
  const rise = y[two] - y[one], a = slope[one], b = slope[two];
  return y[one] + t * (a + t * (3 * rise - 2 * a - b + t * (a + b - 2 * rise)));
}
