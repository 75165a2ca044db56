// One body in one motion: the graph run along it, and tracks that were computed by Python.
import * as ort from "onnxruntime-web/wasm";
import { numbersOf } from "./body.js";

const EVERY = 30; // frames between kept states, of 66 kB each, in a motion of usual length
const MOST_STATES = 400;
const FAR = 45; // most frames that are run before a frame is shown
const PREROLL = 30; // frames after which the initial state hardly matters; the survey later gives the exact frames
const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];

// A function that gives a frame of a track: the size of a step, then (T, 3, V) whole steps as differences in time.
function track(buffer, size) {
  const [step] = new Float32Array(buffer, 0, 1), steps = new Int16Array(buffer, 4);
  for (let i = size; i < steps.length; i++) steps[i] += steps[i - size];
  return (frame) => {
    const from = Math.min(frame * size, steps.length - size), out = new Float32Array(size);
    for (let i = 0; i < size; i++) out[i] = step * steps[from + i];
    return out;
  };
}

export function openGraph(model, wasmBinary) {
  Object.assign(ort.env.wasm, { numThreads: 1, wasmBinary });
  ort.env.logLevel = "error";
  return ort.InferenceSession.create(new Uint8Array(model), { executionProviders: ["wasm"], logSeverityLevel: 3, graphOptimizationLevel: "disabled" });
}

export class Performer {
  // Without a session everything is a track.
  constructor(scene, session) { Object.assign(this, { scene, session, ...scene.graph }); }

  perform(motion, theta, tracks, betas) {
    this.motion = motion;
    this.poses = typeof theta === "string" ? numbersOf(theta, Float64Array) : theta; // (T, 69)
    this.tracks = Object.fromEntries(Object.entries(tracks).map(([name, bytes]) => [name, track(bytes, 3 * this.scene.vertices)]));
    this.frames = this.poses.length / 69;
    this.every = Math.max(EVERY, Math.ceil(this.frames / MOST_STATES));
    this.person(betas);
  }

  // Another shape: kept states are dropped.
  person(betas) {
    this.betas = Float32Array.from(betas);
    this.states = new Map();
    this.shift = rootShift(this.motion, betas, this.scene);
  }

  // theta of a frame, with the translation relative to the first frame of its piece, where float32 is more precise.
  theta(frame, origin) {
    const { poses } = this, theta = Float32Array.from(poses.subarray(frame * 69, frame * 69 + 69));
    for (let k = 66; k < 69; k++) theta[k] = poses[frame * 69 + k] - poses[origin * 69 + k];
    return theta;
  }

  place(frame) {
    return this.shift.map((shift, k) => this.poses[frame * 69 + 66 + k] + shift);
  }

  // Arrays of a frame: rest (3, V), bones (12, N), the root's position, and offsets (3, V) by predictor.
  assembled(frame, live) {
    const root = Float32Array.from(this.place(frame)), entries = Object.entries(this.tracks);
    const tracks = Object.fromEntries(entries.map(([name, at]) => [name, at(frame - this.motion.first)]));
    if (live) return { rest: live.rest, bones: live.bones, root, [this.predictor]: live.offsets, ...tracks };
    const { smpl, ...others } = tracks;
    return { rest: smpl, bones: Float32Array.from([...IDENTITY, ...root]), root, ...others };
  }
}

// The graph at one frame of a motion; instances share the kept states.
export class Roll {
  constructor(performer) { Object.assign(this, { performer, fed: 0, piece: -1, exact: true }); }

  async frame(index) {
    const { performer } = this;
    if (!performer.session) return performer.assembled(index, null);
    const { starts } = performer.motion, piece = starts.findLastIndex((start) => start <= index);
    const [start, end] = [starts[piece], starts[piece + 1] ?? performer.frames], last = index + performer.latency;
    this.begin(piece, start, end, last, index);
    let outputs;
    while (this.fed <= last) outputs = await this.feed(this.fed, start, end);
    const { rest, offsets, bones } = outputs, place = performer.place(start), boneCount = bones.length / 12;
    for (let k = 0; k < 3; k++) for (let j = 0; j < boneCount; j++) bones[(9 + k) * boneCount + j] += place[k];
    return performer.assembled(index, { rest, offsets, bones });
  }

  // Continue from the present frame, a kept state or the start of the piece; if all of these are
  // far, start at rest half a second before.
  begin(piece, start, end, last, index) {
    const { performer } = this, kept = [...performer.states.keys()].filter((at) => at > start && at <= Math.min(last, end - 1));
    const from = Math.max(start, ...kept);
    const continues = this.piece === piece && this.betas === performer.betas && this.fed <= last;
    const far = this.patient ? Infinity : FAR;
    if (continues && (this.exact || from <= this.began) && last - this.fed <= far && this.fed >= from - performer.every) return;
    Object.assign(this, { piece, betas: performer.betas, fed: from, exact: true, state: performer.states.get(from) ?? this.rest() });
    if (last - from <= far) return;
    this.began = this.fed = index - PREROLL;
    Object.assign(this, { exact: false, state: this.rest() });
  }

  rest() { return new Float32Array(this.performer.state_size); }

  async feed(frame, start, end) {
    const { performer } = this, { states, every, moves, session } = performer;
    if (this.exact && frame % every === 0 && frame < end && frame > start) states.set(frame, this.state);
    let state = this.state;
    if (frame >= end && moves) { // after the end of a piece the body stands still, as in Python
      state = state.slice();
      state.fill(0, ...moves);
    }
    const tensor = (values) => new ort.Tensor("float32", values, [1, values.length]);
    const inputs = { theta: performer.theta(Math.min(frame, end - 1), start), betas: this.betas, state };
    const out = await session.run(Object.fromEntries(Object.entries(inputs).map(([name, values]) => [name, tensor(values)])));
    this.state = out.next_state.data;
    this.fed = frame + 1;
    return { rest: out.rest.data, offsets: out.offsets.data, bones: out.bones.data };
  }
}

// Change of the root's translation by another shape: the motion gives its derivative by the root
// joint, and dropped files are relative to the pelvis of their kind of body.
function rootShift({ by_joint, unplaced, space, betas: original }, betas, { root_joint, root_joint_shapes, pelvis_m }) {
  if (!root_joint) return [0, 0, 0];
  const joint = (shape) => root_joint.map((c, axis) => root_joint_shapes[axis].reduce((sum, s, i) => sum + s * (shape[i] ?? 0), c));
  const from = unplaced ? [0, 0, 0] : joint(original), to = joint(betas), apart = root_joint.map((c, axis) => (pelvis_m[space]?.[axis] ?? c) - c);
  return by_joint.map((row, axis) => row.reduce((sum, part, k) => sum + part * (to[k] - from[k] + apart[k]), apart[axis]));
}
