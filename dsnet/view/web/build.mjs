// `npm ci && npm run build` writes bundle/page.html and bundle/runtime.wasm.gz, always the same bytes.
import { build } from "esbuild";
import fs from "node:fs";
import path from "node:path";
import { gunzipSync, gzipSync } from "node:zlib";

const here = import.meta.dirname, out = path.resolve(process.argv[2] ?? path.join(here, "../bundle"));
const read = (...parts) => fs.readFileSync(path.join(here, ...parts), "utf8");
// A page on a disk can start only classic workers from blobs, which have no import.meta.
const options = { bundle: true, minify: true, write: false, target: "es2022", absWorkingDir: here, legalComments: "none" };
const bundled = async (entry, more) => (await build({ ...options, ...more, entryPoints: [entry] })).outputFiles[0].text;
const [main, worker] = await Promise.all([
  bundled("main.js", { format: "esm" }),
  bundled("worker.js", { format: "iife", define: { "import.meta.url": "self.location.href" } }),
]);
const licences = ["three", "fflate"].map((name) => `${name}\n\n${read("node_modules", name, "LICENSE")}`);
licences.push(`onnxruntime-web\n\n${read("onnxruntime.LICENSE")}`);

const inline = (text) => text.replaceAll("</script", "<\\/script"); // which would end the script
const parts = { STYLE: read("page.css"), LICENCES: licences.join("\n\n").replaceAll("<", "&lt;"), WORKER: inline(worker), MAIN: inline(main) };
const page = read("page.html").replace(/@(STYLE|LICENCES|WORKER|MAIN)@/g, (_, name) => parts[name]);
fs.mkdirSync(out, { recursive: true });
fs.writeFileSync(path.join(out, "page.html"), page);
// Releases of Node compress differently: keep the file if its content is the same.
const packed = path.join(out, "runtime.wasm.gz"), wasm = fs.readFileSync(path.join(here, "node_modules/onnxruntime-web/dist/ort-wasm-simd-threaded.wasm"));
if (!fs.existsSync(packed) || !gunzipSync(fs.readFileSync(packed)).equals(wasm)) fs.writeFileSync(packed, gzipSync(wasm, { level: 9 }));
