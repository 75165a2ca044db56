// Runs the model in a worker, so that slow steps block neither drawing nor controls. Between jobs it
// goes through the whole motion once, for the curves and the scale of colours.
import { Body, distances } from "./body.js";
import { openGraph, Performer, Roll } from "./performer.js";

const TRUTH = "truth";
const MOST_SURVEYED = 7200;
const BINS = 800, BIN_M = 0.00025, KEPT = 0.998; // the quantile of vertices at which the scale of colours ends
let performer, roll, survey = null, body, epoch = 0, gains = null;

const jobs = {
  async open({ scene, model, wasm }) {
    body = new Body(scene);
    performer = new Performer(scene, model && (await openGraph(model, wasm)));
  },
  perform({ motion, theta, tracks, betas }) {
    performer.perform(motion, theta, tracks, betas);
    roll = new Roll(performer);
    survey = new Survey();
  },
  person({ betas }) {
    performer.person(betas);
    survey = new Survey();
  },
  gains(job) {
    gains = job.gains;
    if (performer?.motion) survey = new Survey();
  },
  async frame({ index, epoch: requested }) {
    if (requested !== epoch) return {};
    const parts = await roll.frame(performer.motion.first + index);
    return { parts, exact: roll.exact };
  },
};

class Survey {
  constructor() {
    Object.assign(this, { at: 0, roll: new Roll(performer), bins: {}, found: [], lows: [], epoch });
    this.roll.patient = true;
    this.count = Math.min(performer.motion.count, MOST_SURVEYED);
  }

  async step() {
    const { rest, bones, root, ...offsets } = await this.roll.frame(performer.motion.first + this.at);
    const names = ["smpl", ...Object.keys(offsets)], placed = {}, row = {};
    for (const name of names) {
      placed[name] = new Float32Array(3 * body.count);
      const sizes = new Float32Array(body.count);
      body.skin(rest, offsets[name], name === TRUTH ? null : gains, bones, placed[name], sizes);
      if (name === "smpl") this.lows.push(placed.smpl.reduce((low, y, i) => (i % 3 === 1 && y < low ? y : low), Infinity));
      else row[name] = { size: this.counted("size", sizes) };
    }
    if (placed[TRUTH])
      for (const name of names.filter((one) => one !== TRUTH)) {
        const apart = new Float32Array(body.count);
        distances(placed[name], placed[TRUTH], apart);
        (row[name] ??= {}).apart = this.counted("apart", apart);
      }
    this.found.push(row);
    this.at++;
    if (this.found.length < 30 && this.at < this.count) return;
    const low = this.lows.toSorted((a, b) => a - b)[Math.floor(0.01 * (this.lows.length - 1))]; // height of the floor
    self.postMessage({ job: "survey", epoch: this.epoch, rows: this.found, full: this.full(), low, done: this.at === this.count });
    this.found = [];
  }

  // The mean of some lengths, which are added to the histogram.
  counted(kind, metres) {
    const bins = (this.bins[kind] ??= new Float64Array(BINS));
    let sum = 0;
    for (const m of metres) { sum += m; bins[Math.min(BINS - 1, Math.floor(m / BIN_M))]++; }
    return sum / metres.length;
  }

  full() {
    return Object.fromEntries(Object.entries(this.bins).map(([kind, bins]) => {
      let left = bins.reduce((a, b) => a + b, 0) * (1 - KEPT), bin = BINS - 1;
      while (bin > 0 && (left -= bins[bin]) > 0) bin--;
      return [kind, (bin + 1) * BIN_M];
    }));
  }
}

// With one thread a step ends in microtasks alone, so messages would wait for the whole queue. So
// each job starts in a separate task.
const pause = new MessageChannel(), queue = [];
let busy = false;
const next = () => pause.port2.postMessage(0);

async function work() {
  const job = queue.shift();
  try {
    if (job) {
      const answer = (await jobs[job.job](job)) ?? {};
      self.postMessage({ job: job.job, ...answer }, Object.values(answer.parts ?? {}).map((array) => array.buffer));
    } else if (survey && survey.at < survey.count) await survey.step();
  } catch (error) {
    survey = null;
    self.postMessage({ job: job?.job ?? "survey", failed: String(error?.message ?? error) });
  }
  busy = queue.length > 0 || Boolean(survey && survey.at < survey.count);
  if (busy) next();
}

// onnxruntime's threads may run this same file, which must then do nothing.
if (!self.name.startsWith("em-pthread")) {
  pause.port1.onmessage = work;
  self.onmessage = ({ data }) => {
    epoch = Math.max(epoch, data.epoch ?? 0); // on arrival, so that frames of older shapes are not computed
    queue.push(data);
    if (!busy) { busy = true; next(); }
  };
}
