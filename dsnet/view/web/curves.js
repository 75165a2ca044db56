// Curves over time: mean offsets, or mean distances to the truth.
const INKS = { smpl: "var(--ink-smpl)", truth: "var(--ink-truth)" }; // page.css
const MORE = [1, 2, 3, 4].map((i) => `var(--ink-${i})`);
const SVG = "http://www.w3.org/2000/svg";

export const inkOf = (name, names) => INKS[name] ?? MORE[names.filter((one) => !INKS[one]).indexOf(name) % MORE.length];

export class Curves {
  constructor(plot, names) {
    this.lines = new Map(names.map((name) => [name, plot.appendChild(document.createElementNS(SVG, "polyline"))]));
    for (const [name, line] of this.lines) line.style.stroke = inkOf(name, names);
  }

  // rows: of the surveyed frames; kind: "size" or "apart"; shown: names of curves. Gives the highest value, metres.
  draw(rows, count, kind, shown) {
    const curves = shown.map((name) => [name, rows.map((row) => row[name]?.[kind] ?? 0)]);
    const most = curves.flatMap(([, values]) => values).reduce((a, b) => Math.max(a, b), 1e-6);
    for (const line of this.lines.values()) line.setAttribute("points", "");
    for (const [name, values] of curves)
      this.lines.get(name).setAttribute("points", values.map((value, frame) => `${frame / Math.max(1, count - 1)},${1 - value / most}`).join(" "));
    return most;
  }
}
