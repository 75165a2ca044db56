// Assets: in the page or on its server, gzipped or not.
import { bytesOf } from "./body.js";
import { $ } from "./dom.js";
import { fetched } from "./server.js";

export async function asset(name) {
  const embedded = $(`asset:${name}`);
  const bytes = embedded ? bytesOf(embedded.textContent) : await fetched(name);
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes.buffer;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

export async function json(name) {
  const value = JSON.parse(new TextDecoder().decode(await asset(name)));
  if (value.failed) throw new Error(value.failed);
  return value;
}
