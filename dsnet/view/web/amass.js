// A motion file dropped onto the page: AMASS .npz, read and resampled as Python reads it
// (bridge/motion/readers/amass.py, resampling.py, cuts.py), within the same bounds.
import { unzipSync } from "fflate";

export const GENDERS = ["female", "male", "neutral"];
const KIND = "surface_model_type"; // the body model, if the file states it
const LENGTH = "mocap_time_length", RATES = ["mocap_framerate", "mocap_frame_rate", "fps", "framerate", "frame_rate", "frameRate"];
const KEYS = ["poses", "trans", "betas", "gender", "source", "body_model", KIND, LENGTH, ...RATES];
const WIDTHS = [72, 156, 165], JOINTS = 22, FPS = 60, MOST_FRAMES = 108000;
const MOST_BYTES = { poses: MOST_FRAMES * 165 * 8, trans: MOST_FRAMES * 24, betas: MOST_FRAMES * 128 };
const CUT_M = 0.5, CUT_RAD = (150 / 180) * Math.PI, MOST_TURN_RAD_S = (3500 / 180) * Math.PI, MOST_ARM_TURN_RAD_S = (8000 / 180) * Math.PI, UPRIGHT = [-Math.SQRT1_2, 0, 0, Math.SQRT1_2];
const ASLANT = 0.5; // largest y relative to z of a trunk along z
// The root rotates about the root joint J, and so does the rotation to y up: R J - J.
const BY_JOINT = { y: [[0, 0, 0], [0, 0, 0], [0, 0, 0]], z: [[0, 0, 0], [0, -1, 1], [0, -1, -1]] };
const TYPES = { f4: Float32Array, f8: Float64Array, i1: Int8Array, u1: Uint8Array, i2: Int16Array, u2: Uint16Array,
                i4: Int32Array, u4: Uint32Array, i8: BigInt64Array, u8: BigUint64Array };

function refuse(flaw) { throw new Error(flaw); }

function readNpy(bytes, name) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 12 || view.getUint32(0) !== 0x934e554d) refuse(`'${name}' is no array`);
  const start = bytes[6] === 1 ? 10 : 12, size = bytes[6] === 1 ? view.getUint16(8, true) : view.getUint32(8, true);
  const header = new TextDecoder("latin1").decode(bytes.subarray(start, start + size));
  const [, descr] = /'descr':\s*'([^']+)'/.exec(header) ?? refuse(`'${name}' is no array of numbers`);
  if (/'fortran_order':\s*True/.test(header)) refuse(`'${name}' is in Fortran's order: Python reads it`);
  const [, sizes] = /'shape':\s*\(([\d,\s]*)\)/.exec(header) ?? refuse(`'${name}' has no shape`);
  const shape = sizes.split(",").filter((s) => s.trim()).map(Number), count = shape.reduce((a, b) => a * b, 1);
  const [order, kind, width] = [descr[0], descr[1], Number(descr.slice(2))], body = bytes.slice(start + size);
  if (kind === "U" || kind === "S") {
    const text = kind === "S" ? [...body] : [...new Uint32Array(body.buffer, 0, Math.floor(body.length / 4))];
    return { shape, text: String.fromCodePoint(...text.slice(0, 64).filter((c) => c > 0 && c < 0x110000)) };
  }
  const Type = TYPES[kind + width];
  if (!Type || order === ">") refuse(`'${name}' are not all finite numbers (${descr})`); // objects are pickles
  if (count * width !== body.length) refuse(`'${name}' is cut off`);
  return { shape, data: Float64Array.from(new Type(body.buffer), Number) };
}

export function readAmass(bytes, mostFrames = MOST_FRAMES) {
  if (bytes[0] !== 0x50 || bytes[1] !== 0x4b) refuse("this is no .npz; BVH and other formats need Python: dsnet view --motion FILE");
  let files;
  try {
    files = unzipSync(bytes, { filter: ({ name, originalSize }) => {
      const key = name.replace(/\.npy$/, "");
      if (key === "Rh") refuse("its bodies turn about the origin by 'Rh', as EasyMocap's: write them as 'poses' and 'trans' of SMPL");
      if (KEYS.includes(key) && originalSize > (MOST_BYTES[key] ?? 4096) + 256) refuse(`'${key}' is larger than any motion's`);
      return KEYS.includes(key);
    } });
  } catch (error) { refuse(error.code === undefined ? error.message : `the file is damaged (${error.message})`); }
  const array = (name) => files[`${name}.npy`] && readNpy(files[`${name}.npy`], name);
  const numbers = (name, most) => {
    const read = array(name);
    if (!read?.data) refuse(`no numbers '${name}': this is no AMASS motion`);
    if (most) for (const x of read.data) if (!(Math.abs(x) <= most)) refuse(`'${name}' hold ${x}: no person's`);
    return read;
  };
  const poses = numbers("poses"), trans = numbers("trans", 1000), betas = numbers("betas", 100);
  const [frames, width] = poses.shape, [betaCount, betaRows = 1] = betas.shape.filter((size) => size !== 1).reverse();
  const stated = RATES.filter((name) => files[`${name}.npy`]), [rate, ...more] = (stated.length ? stated : RATES).map((name) => numbers(name, 1e4).data[0]);
  if (poses.shape.length !== 2 || !WIDTHS.includes(width) || !frames) refuse(`'poses' have shape ${poses.shape}; expected (frames, ${WIDTHS.join(" or ")})`);
  if (trans.shape[0] !== frames || trans.shape[1] !== 3) refuse(`'trans' have shape ${trans.shape} beside ${frames} frames of poses`);
  if (!(rate >= 1)) refuse(`its frame rate is ${rate}`);
  for (const other of more)
    if (!(Math.abs(other / rate - 1) < 0.01)) refuse(`it says two frame rates, ${rate} and ${other}: dsnet view --motion FILE --motion-fps RATE`);
  if (!(betaCount >= 10 && betaRows) || betaRows * betaCount !== betas.data.length) refuse(`'betas' have shape ${betas.shape}; expected 10 or more`);
  for (let i = 0; i < poses.data.length; i++) // hands are ignored, whatever their numbers
    if (i % width < 3 * JOINTS && !(Math.abs(poses.data[i]) <= 100)) refuse(`'poses' hold ${poses.data[i]}: radians are expected`);
  const up = vertical(poses.data, frames, width), high = median(frames, (i) => trans.data[3 * i + (up === "y" ? 1 : 2)]);
  if (Math.abs(high) > 50) refuse(`'trans' are ${high.toPrecision(3)} m high over half of the time: metres are expected`);
  const count = Math.floor(((frames - 1) / rate) * FPS + 1e-3) + 1;
  if (count > Math.min(MOST_FRAMES, mostFrames)) refuse(`a motion of ${count} frames; a page shows ${mostFrames}: cut it into several files`);
  const repeat = repeated(poses.data, trans.data, frames, width, rate);
  if (repeat) refuse(`its frame ${repeat} repeats the one before while the body moves; Python interpolates it: dsnet view --motion FILE`);
  const theta = atSixty(poses.data, trans.data, frames, width, rate, count, up);
  const text = (name) => { const value = array(name); return String(value?.text ?? value?.data[0] ?? "").trim(); };
  const isSmplx = (text(KIND).toLowerCase() || (width === 165 && "smplx")) === "smplx";
  const gender = text("gender").toLowerCase().replace(/^b'|'$/g, ""), embedded = text("source").startsWith("synthetic") || text("body_model").startsWith("embedded:");
  const shape = [...Array(10)].map((_, i) => sorted(betaRows, (row) => betas.data[row * betaCount + i])), range = Math.max(...shape.map((all) => all.at(-1) - all[0]));
  const duration = frames / rate, statedDuration = Number(text(LENGTH) || NaN), says = [];
  if (up === "y") says.push("It is taken as y up, for its bodies stand so.");
  if (range > 0.05) says.push(`It changes its shape by up to ${range.toPrecision(2)} betas: the median is taken.`);
  if (Math.abs(duration - statedDuration) > 0.05 * statedDuration + 1 / rate) says.push(`It says that it lasts ${statedDuration} s, but ${frames} frames at ${rate} a second last ${+duration.toPrecision(4)}.`);
  return { theta, frames: count, first: 0, count, starts: [0], by_joint: BY_JOINT[up], unplaced: true, betas: shape.map(middle), fps: FPS,
           gender: GENDERS.find((one, i) => [one, one[0], `${2 - i}`].includes(gender)) ?? "unknown", embedded, space: embedded ? "" : isSmplx ? "SMPL-X's" : "SMPL's",
           says };
}

const sorted = (count, value) => Float64Array.from({ length: count }, (_, i) => value(i)).sort(); // as numbers
const middle = (all) => (all[(all.length - 1) >> 1] + all[all.length >> 1]) / 2;
const median = (count, value) => middle(sorted(count, value));

// The axis along which trunks are upright. Python also finds it for bodies that lie or bend, by their legs.
function vertical(poses, frames, width) {
  const roots = Array.from({ length: frames }, (_, i) => quaternion(poses.subarray(i * width, i * width + 3)));
  const trunks = roots.map((q) => times(times(q, [0, 1, 0, 0]), inverse(q)));
  const [y, z] = [1, 2].map((axis) => median(frames, (i) => trunks[i][axis]));
  if (z > 0 && Math.abs(y) <= ASLANT * z) return "z";
  if (y > 0.7 && Math.abs(z) < 0.3) return "y"; // as Python does for sitting bodies
  return refuse("its bodies stand along neither y nor z; Python tells which is up: dsnet view --motion FILE");
}

const quaternion = (v) => {
  const angle = Math.hypot(v[0], v[1], v[2]), s = angle > 1e-12 ? Math.sin(angle / 2) / angle : 0.5;
  return [v[0] * s, v[1] * s, v[2] * s, Math.cos(angle / 2)];
};
const rotvec = ([x, y, z, w]) => {
  if (w < 0) [x, y, z, w] = [-x, -y, -z, -w];
  const s = Math.hypot(x, y, z), k = s > 1e-12 ? (2 * Math.atan2(s, w)) / s : 2;
  return [x * k, y * k, z * k];
};
const times = ([a, b, c, d], [e, f, g, h]) =>
  [d * e + a * h + b * g - c * f, d * f - a * g + b * h + c * e, d * g + a * f - b * e + c * h, d * h - a * e - b * f - c * g];
const inverse = ([x, y, z, w]) => [-x, -y, -z, w];

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

// Between frames: Slerp joint by joint and translation linearly; of slower files than 60 fps cubic splines of quaternions and
// translation, as corners would hit the tissue. y up, axis-angles continuous in time.
function atSixty(poses, trans, frames, width, rate, count, up) {
  const theta = new Float64Array(count * 69), quats = [...Array(JOINTS)].map(() => [...Array(4)].map(() => new Float64Array(frames)));
  const moved = [0, 1, 2].map((k) => Float64Array.from({ length: frames }, (_, row) => trans[3 * row + k]));
  const turned = (row, j) => quats[j].map((part) => part[row]);
  for (let row = 0; row < frames; row++) {
    const far = row ? Math.hypot(...moved.map((part) => part[row] - part[row - 1])) : 0;
    for (let j = 0; j < JOINTS; j++) {
      let q = quaternion(poses.subarray(row * width + 3 * j, row * width + 3 * j + 3));
      if (row && turned(row - 1, j).reduce((sum, x, i) => sum + x * q[i], 0) < 0) q = q.map((x) => -x);
      q.forEach((x, i) => (quats[j][i][row] = x));
      const turn = row ? Math.hypot(...rotvec(times(inverse(turned(row - 1, j)), q))) : 0;
      if (far >= CUT_M || turn >= CUT_RAD || turn * rate > (j < 12 ? MOST_TURN_RAD_S : MOST_ARM_TURN_RAD_S))
        refuse(`the motion jumps at its frame ${row}; Python divides or mends it there: dsnet view --motion FILE`);
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
