// What all valves of a lot share that no single one need show: their own fits against good valves.
import { get } from "./api.js";
import { el } from "./dom.js";
import { quantity, spoken } from "./format.js";
import { table } from "./table.js";

const chance = (p) => (p < 0.0001 ? "< 0.0001" : p.toPrecision(2));

export function shiftsShown({ scope, sentences, items }) {
  const columns = [
    { title: "Figure", value: (item) => spoken(item.words) },
    { title: "Good valves", value: (item) => item.good_mean, show: (item) => quantity(item.good_mean, item.unit), number: true },
    { title: "Lot", value: (item) => item.lot_mean, show: (item) => quantity(item.lot_mean, item.unit), number: true },
    { title: "Shift", value: (item) => item.shift, show: (item) => quantity(item.shift, item.unit), number: true },
    { title: "95 % from", value: (item) => item.ci95[0], show: (item) => quantity(item.ci95[0], item.unit), number: true },
    { title: "to", value: (item) => item.ci95[1], show: (item) => quantity(item.ci95[1], item.unit), number: true },
    { title: "p, paid", value: (item) => item.p_adjusted, show: (item) => chance(item.p_adjusted), number: true },
  ];
  return [
    ...sentences.map((sentence) => el("p", { class: "conclusion ambiguous" }, sentence)),
    el("p", { class: "small" }, scope),
    items.length ? el("details", {}, el("summary", {}, `All ${items.length} figures`),
      table(columns, items, { caption: "Means of the lot and of good valves; p is paid for the number of figures" })) : "",
  ];
}

/// Loads into its place after the view is shown.
export function shiftsPart(path, signal) {
  const place = el("div", { class: "later" }, el("p", { class: "empty" }, "Comparing the lot's fits with good valves …"));
  return { node: place, shown: () => get(`${path}/shifts`, signal).then((answer) => place.replaceChildren(...shiftsShown(answer))).catch((error) => {
    if (!signal.aborted) place.replaceChildren(el("p", { class: "mistake" }, error.message));
  }) };
}
