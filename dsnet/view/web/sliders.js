// Sliders, which show the value that was set, even between their steps, until they are moved.
import { $, make } from "./dom.js";

export const showValue = ({ id, nextElementSibling }, value) => { nextElementSibling.textContent = value.toFixed(id === "speed" ? 1 : 2); };

export function slider(parent, id, text, range, value, moved) {
  const row = make("label"), input = make("input", { id, type: "range", ...range });
  row.append(text, input, make("output"));
  $(parent).append(row);
  bindSlider(input, value, moved);
}

export function bindSlider(input, value, moved) {
  input.value = value;
  input.oninput = () => { showValue(input, +input.value); moved(+input.value); };
  showValue(input, value);
}
