// The model, which runs in a worker.
import { $, say } from "./dom.js";

let worker;
const waiting = [];

// surveyed: takes what the worker tells of the whole motion, between jobs.
export function startModel(surveyed) {
  worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" })));
  worker.onmessage = ({ data }) => {
    if (data.failed) say(data.failed);
    (data.job === "survey" ? surveyed : waiting.shift())(data);
  };
  worker.onerror = (event) => say(`the model cannot run here: ${event.message}`);
}

// Give the worker a job; results come in the order of jobs.
export function work(job, more, transferred = []) {
  worker.postMessage({ job, ...more }, transferred);
  return new Promise((resolve) => waiting.push(resolve));
}
