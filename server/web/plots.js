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
const LISTED = 12; // places of quality items that are written out; all are drawn
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

const WORDS = { gap: "gap", outliers: "outlier left out", clipped: "clipped", stuck: "stuck", outside_reference: "outside the reference" };

/// Draws under the curves what stands at which time: a line where a segment begins, its name where there is room, a tinted
/// and hatched stretch where a quality item is.
function underlay(context, area, graph, marks, named) {
  const { x: left, y: top, w: width, h: height } = area;
  const place = (time) => Math.min(left + width, Math.max(left, graph.toDomXCoord(time)));
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.lineWidth = 1;
  for (const { from_s: from, to_s: to } of marks.quality) {
    const [a, b] = [place(from), place(to)];
    if (b <= left || a >= left + width) continue;
    const wide = Math.max(2, b - a);
    context.globalAlpha = 0.16;
    context.fillStyle = colour("malfunctioned");
    context.fillRect(a, top, wide, height);
    context.globalAlpha = 0.7;
    context.strokeStyle = colour("malfunctioned");
    context.beginPath();
    for (let y = top - wide; wide > 6 && y < top + height; y += 9) {
      context.moveTo(a, y + wide);
      context.lineTo(a + wide, y);
    }
    context.rect(a, top, wide, 3);
    context.stroke();
  }
  context.globalAlpha = 1;
  context.font = "12px system-ui, sans-serif";
  context.strokeStyle = colour("line");
  context.fillStyle = colour("soft");
  context.setLineDash([2, 3]);
  for (const { name, from_s: from, to_s: to } of marks.segments) {
    const [a, b] = [place(from), place(to)];
    if (b <= a) continue;
    if (a > left) {
      context.beginPath();
      context.moveTo(Math.round(a) + 0.5, top);
      context.lineTo(Math.round(a) + 0.5, top + height);
      context.stroke();
    }
    if (named && context.measureText(name).width + 8 < b - a) context.fillText(name, a + 4, top + 12);
  }
  context.restore();
}

/// The same marks as a list that can be read and whose places can be gone to.
function markList(marks, show) {
  const go = (mark, text) => el("button", { type: "button", class: "link", onclick: () => show(mark) }, text);
  const span = ({ from_s: from, to_s: to }) => `${Number(from.toPrecision(6))} to ${Number(to.toPrecision(6))} s`;
  return [
    marks.quality.length ? el("p", { class: "marks" }, el("strong", {}, "Marked in the plots: "),
      marks.quality.slice(0, LISTED).map((mark) => [go(mark, `${WORDS[mark.code]}, ${span(mark)}`), " "]),
      marks.quality.length > LISTED ? `and ${marks.quality.length - LISTED} more` : null) : null,
    el("details", {}, el("summary", {}, "What the input does"), el("ol", {}, marks.segments.slice(0, LISTED * 5).map((mark) =>
      el("li", {}, go(mark, `${mark.kind === mark.name ? mark.name : `${mark.kind} ${mark.name}`}, ${span(mark)}`))))),
  ];
}

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
  let marks = { segments: [], quality: [] };
  const listed = el("div");

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
      underlayCallback: (context, area, graph) => underlay(context, area, graph, marks, place.title === "Output"),
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

  /// Shows a mark with half its length, at least a moment, on both sides.
  function goTo({ from_s: from, to_s: to }) {
    const around = Math.max((to - from) / 2, (whole[1] - whole[0]) / 200);
    follow([Math.max(whole[0], from - around), Math.min(whole[1], to + around)]);
  }

  function draw(loaded) {
    const keep = graphs.length ? graphs[0].xAxisRange() : null;
    for (const graph of graphs) graph.destroy();
    graphs = places.map((place) => new Dygraph(place.box, rowsOf(place, loaded), options(place, loaded)));
    if (keep) follow(keep);
  }

  async function start() {
    const [loaded, found] = await Promise.all([load(null, null), get(recording.links.marks, signal)]);
    marks = found;
    const times = loaded.get("measured").time_s;
    whole = [times[0] ?? 0, times[times.length - 1] ?? 1];
    draw(loaded);
    listed.replaceChildren(...markList(marks, goTo).filter(Boolean));
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
    el("p", { class: "axis-title" }, "time [s]"), listed);
  return { node, shown: () => start().catch(report) };
}
