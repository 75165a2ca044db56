// A motion file dropped onto the page: AMASS .npz, read and resampled as Python reads it
// (bridge/motion/readers/amass.py), within the same bounds.
import { unzipSync } from "fflate";
import { inverse, median, middle, quaternion, sorted, times } from "./linear.js";
import { refuse } from "./refused.js";
import { MOST_FRAMES, sampled } from "./resampling.js";

export const GENDERS = ["female", "male", "neutral"];
const KIND = "surface_model_type"; // the body model, if the file states it
const LENGTH = "mocap_time_length", RATES = ["mocap_framerate", "mocap_frame_rate", "fps", "framerate", "frame_rate", "frameRate"];
const KEYS = ["poses", "trans", "betas", "gender", "source", "body_model", KIND, LENGTH, ...RATES];
const WIDTHS = [72, 156, 165], JOINTS = 22;
const MOST_BYTES = { poses: MOST_FRAMES * 165 * 8, trans: MOST_FRAMES * 24, betas: MOST_FRAMES * 128 };
const ASLANT = 0.5; // largest y relative to z of a trunk along z
// The root rotates about the root joint J, and so does the rotation to y up: R J - J.
const BY_JOINT = { y: [[0, 0, 0], [0, 0, 0], [0, 0, 0]], z: [[0, 0, 0], [0, -1, 1], [0, -1, -1]] };
const TYPES = { f4: Float32Array, f8: Float64Array, i1: Int8Array, u1: Uint8Array, i2: Int16Array, u2: Uint16Array,
                i4: Int32Array, u4: Uint32Array, i8: BigInt64Array, u8: BigUint64Array };

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
  if (bytes[0] !== 0x50 || bytes[1] !== 0x4b) refuse("this is no .npz or .bvh; other formats need Python: dsnet view --motion FILE");
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
  const text = (name) => { const value = array(name); return String(value?.text ?? value?.data[0] ?? "").trim(); };
  const isSmplx = (text(KIND).toLowerCase() || (width === 165 && "smplx")) === "smplx";
  const gender = text("gender").toLowerCase().replace(/^b'|'$/g, ""), embedded = text("source").startsWith("synthetic") || text("body_model").startsWith("embedded:");
  const shape = [...Array(10)].map((_, i) => sorted(betaRows, (row) => betas.data[row * betaCount + i])), range = Math.max(...shape.map((all) => all.at(-1) - all[0]));
  const duration = frames / rate, statedDuration = Number(text(LENGTH) || NaN), says = [];
  if (up === "y") says.push("It is taken as y up, for its bodies stand so.");
  if (range > 0.05) says.push(`It changes its shape by up to ${range.toPrecision(2)} betas: the median is taken.`);
  if (Math.abs(duration - statedDuration) > 0.05 * statedDuration + 1 / rate) says.push(`It says that it lasts ${statedDuration} s, but ${frames} frames at ${rate} a second last ${+duration.toPrecision(4)}.`);
  return { ...sampled({ poses: poses.data, trans: trans.data, frames, width, rate, up }, mostFrames), by_joint: BY_JOINT[up], unplaced: true, betas: shape.map(middle),
           gender: GENDERS.find((one, i) => [one, one[0], `${2 - i}`].includes(gender)) ?? "unknown", embedded, space: embedded ? "" : isSmplx ? "SMPL-X's" : "SMPL's",
           says };
}

// The axis along which trunks are upright. Python also finds it for bodies that lie or bend, by their legs.
function vertical(poses, frames, width) {
  const roots = Array.from({ length: frames }, (_, i) => quaternion(poses.subarray(i * width, i * width + 3)));
  const trunks = roots.map((q) => times(times(q, [0, 1, 0, 0]), inverse(q)));
  const [y, z] = [1, 2].map((axis) => median(frames, (i) => trunks[i][axis]));
  if (z > 0 && Math.abs(y) <= ASLANT * z) return "z";
  if (y > 0.7 && Math.abs(z) < 0.3) return "y"; // as Python does for sitting bodies
  return refuse("its bodies stand along neither y nor z; Python tells which is up: dsnet view --motion FILE");
}
