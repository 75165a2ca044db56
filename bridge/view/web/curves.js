// Curves over time: mean offsets, or mean distances to the truth, and where time is.
export const INKS = { smpl: "#8a8178", truth: "#2f6f4f" };
const MORE = ["#963d7c", "#d0762a", "#2c6aa0", "#b8a02c"];

export const inkOf = (name, names) => INKS[name] ?? MORE[names.filter((one) => !INKS[one]).indexOf(name) % MORE.length];

export class Curves {
  constructor(canvas, seek) {
    Object.assign(this, { canvas, pen: canvas.getContext("2d"), rows: [] });
    const at = (event) => seek(Math.min(1, Math.max(0, (event.offsetX - 34) / (canvas.clientWidth - 40))));
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); at(event); };
    canvas.onpointermove = (event) => { if (event.buttons) at(event); };
  }

  // kind: "size" or "apart"; names with their labels, of whom there is something to draw.
  draw(count, time, kind, names, all, fps) {
    const { canvas, pen } = this, ratio = devicePixelRatio, { clientWidth: wide, clientHeight: high } = canvas;
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio))
      Object.assign(canvas, { width: Math.round(wide * ratio), height: Math.round(high * ratio) });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const left = 34, right = wide - 6, top = 16, bottom = high - 15, x = (frame) => left + ((right - left) * frame) / Math.max(1, count - 1);
    const most = Math.max(1e-6, ...this.rows.flatMap((row) => names.map((name) => row?.[name]?.[kind] ?? 0)));
    pen.font = "10px system-ui, sans-serif";
    pen.fillStyle = "#766e64";
    pen.textAlign = "left";
    pen.fillText(kind === "apart" ? "mean distance to the truth, mm" : "mean offset, mm", left, 9);
    pen.textAlign = "right";
    pen.fillText((1000 * most).toFixed(most < 0.01 ? 1 : 0), left - 5, top + 6);
    pen.fillText("0", left - 5, bottom);
    pen.fillText(`${((count - 1) / fps).toFixed(1)} s`, right, high - 3);
    pen.strokeStyle = "#e0dad1";
    pen.strokeRect(left, top, right - left, bottom - top);
    for (const name of names) {
      pen.beginPath();
      for (let frame = 0, down = false; frame < count; frame++) {
        const value = this.rows[frame]?.[name]?.[kind];
        if (value === undefined) { down = false; continue; }
        pen[down ? "lineTo" : "moveTo"](x(frame), bottom - ((bottom - top) * value) / most);
        down = true;
      }
      pen.strokeStyle = inkOf(name, all);
      pen.lineWidth = 1.6;
      pen.stroke();
    }
    pen.lineWidth = 1;
    pen.fillStyle = "#2a2622";
    pen.fillRect(x(time) - 0.75, top - 4, 1.5, bottom - top + 8);
  }
}
