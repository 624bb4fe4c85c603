// The gain as bars on one scale: error before and after, and what limits it.
import { el } from "./dom.js";
import { quantity } from "./format.js";

export function gainBars(gain, unit) {
  const bars = [["simulation", "simulated", gain.rmse_baseline], ["with the causes", "extended", gain.rmse_extended],
    ["best black box", "black-box", gain.rmse_black_box], ["noise alone", "floor", gain.noise_floor]]
    .filter(([, , value]) => typeof value === "number");
  const largest = Math.max(...bars.map(([, , value]) => value), 1e-12);
  return el("table", { class: "bars" }, el("caption", {}, `Error on data not fitted to: ${gain.heldout}`),
    el("tbody", {}, bars.map(([name, kind, value]) => barRow(name, kind, value / largest, quantity(value, unit)))));
}

/// A row of a bar table; share is of the full width.
export function barRow(name, kind, share, text) {
  const bar = el("span", { class: `bar ${kind}`, "aria-hidden": "true" });
  bar.style.width = `${Math.max(0, Math.min(100, 100 * share)).toFixed(2)}%`;
  return el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: "track" }, bar), el("td", { class: "number" }, text));
}
