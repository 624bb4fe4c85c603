// One recording: output, residual and input over time on one axis, drawn by dygraphs from points the server has reduced
// to what the screen can show. Zooming draws at once from the points at hand and then asks for the visible range.
import { get } from "./api.js";
import { el, keepInAddress } from "./dom.js";
import { figure } from "./format.js";

// The legend is the page's own: the library's writes styles into the document, which the page's policy forbids.
Dygraph.PLUGINS = Dygraph.PLUGINS.filter((plugin) => plugin !== Dygraph.Plugins.Legend);

const CHARTS = [
  { title: "Output", height: "tall", series: [["measured", "measured"], ["simulated", "simulated"], ["extended", "extended simulation"]] },
  { title: "Residual", height: "", series: [["residual", "measured − simulated"], ["extended_residual", "measured − extended simulation"]] },
  { title: "Input", height: "low", series: [["input", "input"]] },
];
const POINTS = 1600;
const SETTLE_MS = 180;
const GAP = 8; // times the usual distance of two points: nothing was measured between

/// Joins series with times of their own: rows [time, value or null, ...]; NaN breaks a line, null does not.
function joined(series) {
  const rows = new Map();
  series.forEach(({ time_s: times, values }, k) => {
    const at = (time) => rows.get(time) ?? rows.set(time, [time, ...series.map(() => null)]).get(time);
    const usual = times.length > 1 ? (times[times.length - 1] - times[0]) / (times.length - 1) : 0;
    times.forEach((time, i) => {
      at(time)[k + 1] = values[i];
      if (i > 0 && time - times[i - 1] > GAP * usual) at((time + times[i - 1]) / 2)[k + 1] = NaN;
    });
  });
  return [...rows.values()].sort((a, b) => a[0] - b[0]);
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/// Draws into the page until the view is left. `recording` is a row of the service, `extended` whether there is an
/// extended simulation to show, `range` {from, to} in seconds or null for all.
export function recordingPlots(recording, { extended, range, signal }) {
  const status = el("p", { class: "status", role: "status" }, "Loading …");
  const places = CHARTS.map((chart) => ({
    ...chart,
    series: chart.series.filter(([what]) => extended || !what.startsWith("extended")),
    box: el("div", { class: `chart ${chart.height}` }),
    legend: el("p", { class: "legend" }),
  }));
  let graphs = [];
  let whole = null;
  let settle = 0;
  let syncing = false;

  async function load(from, to) {
    const base = recording.links.series;
    const wanted = places.flatMap((place) => place.series.map(([what]) => what));
    const query = from === null ? "" : `&from=${from}&to=${to}`;
    const answers = await Promise.all(wanted.map((what) => get(`${base}?what=${what}&points=${POINTS}${query}`, signal)));
    return new Map(wanted.map((what, i) => [what, answers[i]]));
  }

  const rowsOf = (place, loaded) => joined(place.series.map(([what]) => loaded.get(what)));

  function showLegend(place, unit, values = null) {
    place.legend.replaceChildren(el("span", { class: "chart-title" }, `${place.title}${unit ? ` [${unit}]` : ""}`),
      ...place.series.map(([what, title], i) => el("span", { class: `key ${what}` },
        `${title}${values ? ` ${figure(values[i], 4)}` : ""}`)));
  }

  function options(place, loaded) {
    const unit = loaded.get(place.series[0][0]).unit;
    showLegend(place, unit);
    return {
      labels: ["time", ...place.series.map(([what]) => what)],
      colors: place.series.map(([what]) => colour(what)),
      series: Object.fromEntries(place.series.map(([what], i) => [what, { strokeWidth: i === 0 ? 1.2 : 1.6,
        strokePattern: what.startsWith("extended") ? [7, 3] : null }])),
      connectSeparatedPoints: true,
      axisLineColor: colour("line"),
      gridLineColor: colour("grid"),
      axisLabelFontSize: 12,
      rightGap: 12,
      axes: { y: { axisLabelWidth: 56, pixelsPerLabel: 22 }, x: { drawAxis: true } },
      highlightCircleSize: 3,
      highlightCallback: (event, x, points) => {
        const values = place.series.map(([what]) => points.find((point) => point.name === what)?.yval ?? null);
        showLegend(place, unit, values);
        status.textContent = `at ${figure(x, 5)} s`;
      },
      unhighlightCallback: () => {
        showLegend(place, unit);
        status.textContent = "";
      },
      drawCallback: (graph, first) => {
        if (!first && !syncing) follow(graph.xAxisRange());
      },
    };
  }

  /// All charts show the range of one; after a moment its points are asked for.
  function follow(window) {
    syncing = true;
    for (const graph of graphs) graph.updateOptions({ dateWindow: window });
    syncing = false;
    clearTimeout(settle);
    settle = setTimeout(() => refine(window).catch(report), SETTLE_MS);
  }

  async function refine([from, to]) {
    const all = from <= whole[0] && to >= whole[1];
    keepInAddress({ from: all ? null : figure(from, 6), to: all ? null : figure(to, 6) });
    const margin = (to - from) / 2;
    const loaded = await load(...(all ? [null, null] : [from - margin, to + margin]));
    syncing = true;
    places.forEach((place, i) => graphs[i].updateOptions({ file: rowsOf(place, loaded) }));
    syncing = false;
  }

  function report(error) {
    if (!signal.aborted) status.textContent = error.message;
  }

  /// By buttons: dygraphs itself listens to the mouse alone.
  function move(shift, zoom) {
    if (!graphs.length) return;
    const [from, to] = graphs[0].xAxisRange();
    const half = ((to - from) / 2) * zoom;
    const middle = (from + to) / 2 + shift * (to - from);
    follow([Math.max(whole[0], middle - half), Math.min(whole[1], middle + half)]);
  }

  function draw(loaded) {
    const keep = graphs.length ? graphs[0].xAxisRange() : null;
    for (const graph of graphs) graph.destroy();
    graphs = places.map((place) => new Dygraph(place.box, rowsOf(place, loaded), options(place, loaded)));
    if (keep) follow(keep);
  }

  async function start() {
    const loaded = await load(null, null);
    const times = loaded.get("measured").time_s;
    whole = [times[0] ?? 0, times[times.length - 1] ?? 1];
    draw(loaded);
    status.textContent = "";
    if (range) follow([Math.max(whole[0], range.from), Math.min(whole[1], range.to)]);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw(loaded), { signal });
  }

  signal.addEventListener("abort", () => {
    clearTimeout(settle);
    for (const graph of graphs) graph.destroy();
  });
  const button = (text, label, action) => el("button", { type: "button", "aria-label": label, title: label, onclick: action }, text);
  const node = el("div", { class: "plots" },
    el("div", { class: "toolbar", role: "group", "aria-label": "Time axis" },
      button("◀", "earlier", () => move(-0.25, 1)), button("▶", "later", () => move(0.25, 1)),
      button("+", "zoom in", () => move(0, 0.5)), button("−", "zoom out", () => move(0, 2)),
      button("all", "whole recording", () => whole && follow(whole)),
      el("span", { class: "hint" }, "drag to zoom, shift-drag to pan, double-click for all"), status),
    places.map((place) => [place.legend,
      el("div", { role: "img", "aria-label": `${place.title} of ${recording.name} over time` }, place.box)]),
    el("p", { class: "axis-title" }, "time [s]"));
  return { node, shown: () => start().catch(report) };
}
