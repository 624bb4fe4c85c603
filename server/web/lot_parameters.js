// How large the named causes are over the valves of a lot: one chart for each parameter of a chosen cause.
import { get } from "./api.js";
import { distributionChart } from "./chart.js";
import { address, el, field, keepInAddress, options } from "./dom.js";
import { counted, quantity, scaled, spoken, withDeviation } from "./format.js";

/// The value below which `share` of the sorted values lie, between two of them by their distance.
export function quantile(sorted, share) {
  const at = share * (sorted.length - 1);
  const [below, above] = [sorted[Math.floor(at)], sorted[Math.ceil(at)]];
  return below + (at - Math.floor(at)) * (above - below);
}

/// "breakaway" of breakaway_A, "gain change" of gain_change, which has no unit.
function withoutUnit({ name, unit }) {
  const suffix = `_${unit.replace("/", "_per_")}`.toLowerCase();
  return (unit && name.toLowerCase().endsWith(suffix) ? name.slice(0, -suffix.length) : name).replaceAll("_", " ");
}

function parameterChart(cause, parameter) {
  const sorted = parameter.values.map((v) => v.value).sort((a, b) => a - b);
  const [factor, unit] = scaled(sorted[Math.floor(sorted.length / 2)], parameter.unit);
  const times = (value) => (typeof value === "number" ? value * factor : null);
  const { population_mean: mean, population_sd: sd } = parameter;
  const band = typeof mean === "number" && sd > 0 ? [times(mean - 2 * sd), times(mean + 2 * sd)] : null;
  const said = (share) => quantity(quantile(sorted, share), parameter.unit);
  const middle = sorted.length > 1 && sorted.length < 4 ? `from ${said(0)} to ${said(1)}` : sorted.length > 1 ? `median ${said(0.5)}, the middle half from ${said(0.25)} to ${said(0.75)}` : said(0.5);
  const values = parameter.values.map((v) => ({
    value: times(v.value), low: times(v.ci95[0]), high: times(v.ci95[1]), href: address("valve", v.submission_id),
    title: `${v.serial ?? "without serial"}: ${quantity(v.value, parameter.unit)}` }));
  return el("div", {},
    el("h3", {}, el("code", {}, parameter.name)),
    el("p", { class: "small" }, `${counted(sorted.length, "valve")}: ${middle}; lines are 95 % intervals`,
      band ? `, the band is good valves (${withDeviation(times(mean), times(2 * sd))}${unit ? ` ${unit}` : ""})` : null, "."),
    distributionChart({ values, band, label: `${parameter.name} of ${spoken(cause).toLowerCase()} over ${counted(sorted.length, "valve")}: ${middle}`,
      xTitle: `${withoutUnit(parameter)}${unit ? ` [${unit}]` : ""}` }));
}

/// Loads into its place after the view is shown; the chosen cause stands in the address.
export function parametersPart(path, parameters, signal) {
  const place = el("div", { class: "later" }, el("p", { class: "empty" }, "Reading the named causes …"));
  async function load() {
    const { items, named, read } = await get(`${path}/parameters`, signal);
    if (items.length === 0) {
      place.replaceChildren(el("p", { class: "empty" }, "No cause of this lot is settled, so there are no sizes to compare."));
      return;
    }
    const charts = el("div");
    const entryOf = (cause) => items.find((item) => item.cause === cause) ?? items[0];
    const show = (entry) => charts.replaceChildren(...entry.parameters.map((parameter) => parameterChart(entry.cause, parameter)),
      entry.parameters.length ? "" : el("p", { class: "empty" }, "This cause has no parameter."));
    const chosen = entryOf(parameters.get("cause"));
    const choice = options(el("select", { onchange: () => {
      keepInAddress({ cause: choice.value });
      show(entryOf(choice.value));
    } }), items.map((item) => [item.cause, `${spoken(item.cause)} (${item.valves})`]), chosen.cause);
    show(chosen);
    place.replaceChildren(el("div", { class: "filters" }, field("Cause", choice)), charts,
      read < named ? el("p", { class: "small" }, `Of the newest ${read} of ${named} valves with a settled cause.`) : "");
  }
  return { node: place, shown: () => load().catch((error) => {
    if (!signal.aborted) place.replaceChildren(el("p", { class: "mistake" }, error.message));
  }) };
}
