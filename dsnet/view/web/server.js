// The Python that serves this page; a page from a disk has none.
import { $ } from "./dom.js";

export const isServed = () => !$("asset:scene");

// Which scene is shown, and its first motion; another body is another scene of the same server.
const [shown = 0, first = 0] = location.hash.slice(1).split(".").filter(Boolean).map(Number);
export const firstMotion = first;
export const shownScene = shown;
export function showScene(scene, number) {
  location.hash = `${scene}.${number}`;
  location.reload();
}

// Bytes of an asset of the scene.
export async function fetched(name) {
  const response = await answer(`assets/${shown}/${name}`);
  if (response.headers.get("content-type") === "application/json") throw new Error((await response.json()).failed);
  return new Uint8Array(await response.arrayBuffer());
}

// A JSON answer; with a body, a file or what becomes JSON, it is posted.
export async function ask(path, body) {
  const text = body === undefined || body instanceof Blob ? body : JSON.stringify(body);
  const value = await (await answer(path, text === undefined ? {} : { method: "POST", body: text })).json();
  if (value?.failed && !("share" in value)) throw new Error(value.failed);
  return value;
}

async function answer(path, more) {
  const response = await fetch(path, more).catch(() => null);
  if (!response?.ok) throw new Error("the server does not answer: start `dsnet view` again");
  return response;
}
