// The document's elements.
export const $ = (id) => document.getElementById(id);
export const make = (tag, more) => Object.assign(document.createElement(tag), more);
export const say = (text) => { $("says").textContent = text; };

export function dragged(what, moved) {
  what.onpointerdown = (event) => { what.setPointerCapture(event.pointerId); moved(event); };
  what.onpointermove = (event) => { if (event.buttons) moved(event); };
}
