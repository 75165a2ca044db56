// One body in one motion: the graph rolled along it, and tracks of what was computed elsewhere.
import * as ort from "onnxruntime-web/wasm";

const EVERY = 30; // frames between remembered states, 66 kB each, in a motion of usual length
const MOST_STATES = 400;
const FAR = 45; // frames that may be rolled before something is shown
const PREROLL = 30; // by then tissue has forgotten most of how it began; the survey brings the rest
const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];

// Numbers (T, 3, V) in whole steps, stored as differences in time behind the size of a step.
class Track {
  constructor(buffer, vertices) {
    this.step = new Float32Array(buffer, 0, 1)[0];
    this.size = 3 * vertices;
    this.steps = new Int16Array(buffer, 4);
    this.frames = this.steps.length / this.size;
    for (let i = this.size; i < this.steps.length; i++) this.steps[i] += this.steps[i - this.size];
  }

  at(frame) {
    const from = Math.min(frame, this.frames - 1) * this.size, found = new Float32Array(this.size);
    for (let i = 0; i < this.size; i++) found[i] = this.step * this.steps[from + i];
    return found;
  }
}

export class Performer {
  static async open(scene, model, wasmBinary) {
    const made = new Performer();
    made.scene = scene;
    if (!model) return made; // all of it is tracks
    ort.env.wasm.numThreads = 1;
    ort.env.logLevel = "error";
    ort.env.wasm.wasmBinary = wasmBinary;
    const session = (made.session = await ort.InferenceSession.create(model, { executionProviders: ["wasm"], logSeverityLevel: 3, graphOptimizationLevel: "disabled" }));
    const { state, latency } = scene.graph, size = (shape) => shape.reduce((a, b) => a * b, 1);
    made.latency = latency;
    made.moves = state.moves && [state.moves[0], state.moves[0] + size(state.moves[1])];
    made.stateSize = Math.max(...Object.values(state).map(([at, shape]) => at + size(shape)));
    made.names = [session.inputNames, session.outputNames];
    return made;
  }

  perform(motion, tracks, betas) {
    this.motion = motion;
    this.tracks = Object.fromEntries(Object.entries(tracks).map(([name, bytes]) => [name, new Track(bytes, this.scene.vertices)]));
    this.every = Math.max(EVERY, Math.ceil(motion.frames / MOST_STATES));
    this.person(betas);
  }

  // Another shape: all that was known of the last one is forgotten.
  person(betas) {
    this.betas = Float32Array.from(betas);
    this.states = new Map();
    this.shift = rootShift(this.motion, betas, this.scene);
  }

  // theta of a frame: the root begins at the origin of its piece, where float32 is finest.
  theta(frame, origin) {
    const { theta } = this.motion, found = Float32Array.from(theta.subarray(frame * 69, frame * 69 + 69));
    for (let k = 0; k < 3; k++) found[66 + k] = theta[frame * 69 + 66 + k] - theta[origin * 69 + 66 + k];
    return found;
  }

  place(frame) {
    return [0, 1, 2].map((k) => this.motion.theta[frame * 69 + 66 + k] + this.shift[k]);
  }

  // What is shown at a frame: rest (3, V), bones (12, N), and offsets (3, V) by predictor.
  assembled(frame, live) {
    const { first, back } = this.motion, offsets = {};
    for (const name in this.tracks) offsets[name] = this.tracks[name].at(frame - first);
    if (live) {
      const { rest, bones } = live;
      if (back) returned(bones, back);
      return { rest, bones, offsets: { ...offsets, [this.scene.graph.predictor]: live.offsets } };
    }
    const { smpl, ...others } = offsets;
    return { rest: smpl, bones: Float32Array.from([...IDENTITY, ...this.place(frame)]), offsets: others };
  }
}

// The graph at one place of a motion; several of them share what is remembered.
export class Roll {
  constructor(performer) { Object.assign(this, { performer, fed: 0, piece: -1, exact: true }); }

  async frame(index) {
    const { performer } = this;
    if (!performer.session) return performer.assembled(index, null);
    const { starts, frames } = performer.motion;
    const piece = starts.findLastIndex((start) => start <= index);
    const [start, end] = [starts[piece], starts[piece + 1] ?? frames], last = index + performer.latency;
    this.begin(piece, start, end, last, index);
    let found;
    while (this.fed <= last) found = await this.feed(this.fed, start, end);
    const { rest, offsets, bones } = found, place = performer.place(start), bonesThere = bones.length / 12;
    for (let k = 0; k < 3; k++) for (let j = 0; j < bonesThere; j++) bones[(9 + k) * bonesThere + j] += place[k];
    return performer.assembled(index, { rest, offsets, bones });
  }

  // Goes on where it is, or from what is remembered, or from the piece's beginning, or, where all of
  // that is far, from rest a second before.
  begin(piece, start, end, last, index) {
    const { performer } = this, known = [...performer.states.keys()].filter((at) => at > start && at <= Math.min(last, end - 1));
    const from = Math.max(start, ...known);
    const here = this.piece === piece && this.betas === performer.betas && this.fed <= last;
    const far = this.patient ? Infinity : FAR;
    if (here && (this.exact || from <= this.began) && last - this.fed <= far && this.fed >= from - performer.every) return;
    Object.assign(this, { piece, betas: performer.betas, fed: from, exact: true, state: performer.states.get(from) ?? this.rest() });
    if (last - from <= far) return;
    this.began = this.fed = index - PREROLL;
    Object.assign(this, { exact: false, state: this.rest() });
  }

  rest() { return new Float32Array(this.performer.stateSize); }

  async feed(frame, start, end) {
    const { performer } = this, { states, every, moves, session, stateSize } = performer;
    if (this.exact && frame % every === 0 && frame < end && frame > start) states.set(frame, this.state);
    let state = this.state;
    if (frame >= end && moves) { // a piece ends by standing still, as in Python
      state = state.slice();
      state.fill(0, ...moves);
    }
    const began = performance.now(), tensor = (values) => new ort.Tensor("float32", values, [1, values.length]);
    const given = { theta: performer.theta(Math.min(frame, end - 1), start), betas: this.betas, state };
    const out = await session.run(Object.fromEntries(Object.entries(given).map(([name, values]) => [name, tensor(values)])));
    this.ms = performance.now() - began;
    this.state = out.next_state.data;
    this.fed = frame + 1;
    return { rest: out.rest.data, offsets: out.offsets.data, bones: out.bones.data };
  }
}

// By what the root's place of another shape differs: in a file the root turns about the root joint,
// so turning the world upright adds R J - J, and J goes with the shape.
function rootShift(motion, betas, scene) {
  if (!motion.of_file || scene.baked) return [0, 0, 0];
  const by = (shape) => {
    const [, y, z] = scene.root_joint.map((c, axis) => scene.root_joint_shapes[axis].reduce((sum, s, i) => sum + s * (shape[i] ?? 0), c));
    return [0, z - y, -y - z];
  };
  if (!motion.unplaced) return by(betas).map((c, k) => c - by(motion.betas)[k]);
  const [x, y, z] = motion.embedded ? [0, 0, 0] : motion.pelvis.map((c, axis) => c - scene.root_joint[axis]);
  return by(betas).map((c, k) => c + [x, z, -y][k]);
}

// Bones of a later round of a loop, brought back to the first.
function returned(bones, back) {
  const count = bones.length / 12;
  for (let j = 0; j < count; j++)
    for (let column = 0; column < 4; column++) {
      const at = [0, 1, 2].map((r) => (3 * column + r) * count + j), old = at.map((i) => bones[i]);
      for (let r = 0; r < 3; r++)
        bones[at[r]] = back[3 * r] * old[0] + back[3 * r + 1] * old[1] + back[3 * r + 2] * old[2] + (column === 3 ? back[9 + r] : 0);
    }
}
