// Small charts of lots, drawn as SVG: one mark per valve, limits as lines, links to the valves.
import { counted, figure } from "./format.js";

const SVG = "http://www.w3.org/2000/svg";
const NARROW = matchMedia("(max-width: 40rem)"); // as in page.css
/// Units across a chart: in a narrow window as many as there are pixels, so that its words stay readable.
export const chartWidth = () => (NARROW.matches ? 420 : 1000);
const halfWidth = () => (NARROW.matches ? 420 : 620); // of charts that stand side by side
const MARGIN = { left: 64, right: 12, top: 12, bottom: 34 };
const MARKS_AT_MOST = 1500; // beyond that one line stands for the marks, and only those outside the limits stay

export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  for (const child of children.flat(Infinity)) if (child) element.append(child);
  return element;
}

/// Marks that open a view when they are clicked. A drawing is one thing to a screen reader and to the keyboard, so these are
/// no links: the tables of the same view hold those.
function opens(href, ...children) {
  const group = svg("g", { class: "opens" }, children);
  group.addEventListener("click", () => {
    location.hash = href;
  });
  return group;
}

/// Round numbers that cover [low, high], about `wanted` of them.
export function ticks(low, high, wanted = 5) {
  const span = high - low || 1;
  const power = 10 ** Math.floor(Math.log10(span / wanted));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => span / size <= wanted);
  const all = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * span; ++i) all.push(Number((i * step).toPrecision(12)));
  return all;
}

/// A frame with a y axis in `unit`; x runs over the valves in the order they were received.
function frame({ height, width = chartWidth(), low, high, label, yTitle, xTitle, whole = false }) {
  const bottom = height - MARGIN.bottom;
  const y = (value) => bottom - ((value - low) / (high - low || 1)) * (bottom - MARGIN.top);
  const node = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "lot-chart", role: "img", "aria-label": label });
  for (const tick of ticks(low, high).filter((value) => !whole || Number.isInteger(value))) {
    node.append(svg("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: y(tick), y2: y(tick) }),
      svg("text", { class: "tick", x: MARGIN.left - 8, y: y(tick) + 4, "text-anchor": "end" }, String(tick)));
  }
  node.append(svg("text", { class: "tick", transform: `translate(14 ${(MARGIN.top + bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, yTitle),
    svg("text", { class: "tick", x: (MARGIN.left + width) / 2, y: height - 6, "text-anchor": "middle" }, xTitle));
  return { node, y, bottom };
}

const across = (count) => (index) => MARGIN.left + ((index + 0.5) / Math.max(count, 1)) * (chartWidth() - MARGIN.left - MARGIN.right);

/// A circle, triangle or square: the verdict without its colour.
function mark(verdict, x, y, size) {
  const kind = `mark ${verdict?.toLowerCase() ?? "none"}`;
  if (verdict === "Malfunctioned") return svg("path", { class: kind, d: `M${x} ${y - size}L${x + size} ${y + size}H${x - size}Z` });
  if (verdict === "Severe") return svg("rect", { class: kind, x: x - size, y: y - size, width: 2 * size, height: 2 * size });
  return svg("circle", { class: kind, cx: x, cy: y, r: size });
}

/// points  {value, verdict, href, serial}; lines  {value, title, kind}; outside  indices of points
export function individualsChart({ points, lines, outside, height = 300, label, yTitle }) {
  const values = [...points.map((p) => p.value), ...lines.map((l) => l.value)];
  const high = Math.max(...values, 1e-9);
  const low = Math.min(0, ...values);
  const { node, y } = frame({ height, low, high: high + 0.05 * (high - low), label, yTitle, xTitle: "valves in the order received" });
  const x = across(points.length);
  for (const line of lines) {
    node.append(svg("line", { class: `limit ${line.kind}`, x1: MARGIN.left, x2: chartWidth() - MARGIN.right, y1: y(line.value), y2: y(line.value) }),
      svg("text", { class: "tick", x: chartWidth() - MARGIN.right, y: y(line.value) - 4, "text-anchor": "end" }, line.title));
  }
  node.append(svg("path", { class: "run", d: `M${points.map((p, i) => `${x(i).toFixed(1)} ${y(p.value).toFixed(1)}`).join("L")}` }));
  const marked = new Set(outside);
  const size = points.length > 200 ? 2.5 : 5;
  let drawn = 0;
  points.forEach((point, i) => {
    if (points.length > MARKS_AT_MOST && (!marked.has(i) || ++drawn > MARKS_AT_MOST)) return;
    const title = svg("title", {}, `${point.serial}: ${figure(point.value)}`);
    const ring = marked.has(i) ? svg("circle", { class: "ring", cx: x(i), cy: y(point.value), r: size + 5 }) : null;
    node.append(opens(point.href, ring, mark(point.verdict, x(i), y(point.value), size), title));
  });
  return node;
}

const PLAIN = { left: 64, right: 18, top: 8, bottom: 40 };

/// Values of one parameter over valves, in rising order from the bottom, each with its interval; the band is what good
/// valves show.
///
/// values  {value, low, high, href, title} with low and high null where not known; band  [low, high] or null
export function distributionChart({ values, band, label, xTitle }) {
  const sorted = [...values].sort((a, b) => a.value - b.value);
  const step = Math.max(2, Math.min(16, 360 / sorted.length));
  const height = Math.max(90, PLAIN.top + PLAIN.bottom + step * (sorted.length + 1));
  const all = sorted.flatMap((v) => [v.value, v.low, v.high]).concat(band ?? []).filter((v) => typeof v === "number");
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const room = 0.04 * (high - low || Math.abs(high) || 1);
  const x = (value) => PLAIN.left + ((value - low + room) / (high - low + 2 * room)) * (chartWidth() - PLAIN.left - PLAIN.right);
  const bottom = height - PLAIN.bottom;
  const node = svg("svg", { viewBox: `0 0 ${chartWidth()} ${height}`, class: "lot-chart", role: "img", "aria-label": label });
  if (band) node.append(svg("rect", { class: "band", x: x(band[0]), width: Math.max(1, x(band[1]) - x(band[0])), y: PLAIN.top, height: bottom - PLAIN.top }));
  for (const tick of ticks(low - room, high + room, NARROW.matches ? 4 : 8)) {
    node.append(svg("line", { class: "grid", x1: x(tick), x2: x(tick), y1: PLAIN.top, y2: bottom }),
      svg("text", { class: "tick", x: x(tick), y: bottom + 16, "text-anchor": "middle" }, String(tick)));
  }
  node.append(svg("text", { class: "tick", x: (PLAIN.left + chartWidth()) / 2, y: height - 6, "text-anchor": "middle" }, xTitle));
  sorted.forEach((value, i) => {
    const y = bottom - step * (i + 1);
    const whisker = typeof value.low === "number" && typeof value.high === "number"
      ? svg("line", { class: "whisker", x1: x(value.low), x2: x(value.high), y1: y, y2: y }) : null;
    node.append(opens(value.href, whisker,
      svg("circle", { class: "dot", cx: x(value.value), cy: y, r: Math.max(1.5, Math.min(4.5, step / 2.5)) }), svg("title", {}, value.title)));
  });
  return node;
}

/// Mean residual over time with its standard deviation, and what good valves leave; null breaks the lines.
export function residualChart({ time_s: times, mean, sd, good, label }) {
  const height = 190;
  const edges = mean.flatMap((value, i) => (value === null ? [] : [value - sd[i], value + sd[i]])).concat(good.filter((v) => v !== null), 0);
  const [low, high] = [Math.min(...edges), Math.max(...edges)];
  const { node, y, bottom } = frame({ height, width: halfWidth(), low, high, label, yTitle: "residual", xTitle: "time [s]" });
  const last = times[times.length - 1] + times[0];
  const x = (time) => MARGIN.left + (time / last) * (halfWidth() - MARGIN.left - MARGIN.right);
  for (const tick of ticks(0, last, 6)) node.append(svg("text", { class: "tick", x: x(tick), y: bottom + 14, "text-anchor": "middle" }, String(tick)));
  const at = (i, value) => `${x(times[i]).toFixed(1)} ${y(value).toFixed(1)}`;
  const line = (values) => values.map((value, i) => (value === null ? "" : `${i > 0 && values[i - 1] !== null ? "L" : "M"}${at(i, value)}`)).join("");
  const there = mean.map((value, i) => i).filter((i) => mean[i] !== null);
  if (there.length > 1) {
    const up = there.map((i) => at(i, mean[i] + sd[i]));
    const down = there.map((i) => at(i, mean[i] - sd[i])).reverse();
    node.append(svg("path", { class: "band", d: `M${[...up, ...down].join("L")}Z` }));
  }
  node.append(svg("line", { class: "limit centre", x1: MARGIN.left, x2: halfWidth() - MARGIN.right, y1: y(0), y2: y(0) }));
  if (good.length) node.append(svg("path", { class: "response good", d: line(good) }));
  node.append(svg("path", { class: "response", d: line(mean) }));
  return node;
}

const GROUPS_AT_MOST = 40;
const VERDICTS = ["Good", "Malfunctioned", "Severe", null];

/// Columns of the verdicts of consecutive valves, oldest first. hrefOf(group, verdict)  the view of a piece's valves
export function verdictColumns(valves, hrefOf, height = 200) {
  const size = Math.max(1, Math.ceil(valves.length / GROUPS_AT_MOST));
  const groups = [];
  for (let i = 0; i < valves.length; i += size) groups.push(valves.slice(i, i + size));
  const label = `Verdicts of ${counted(valves.length, "valve")} in the order received, ${size} a column`;
  const { node, y } = frame({ height, low: 0, high: size, whole: true, label, yTitle: "valves", xTitle: `valves in the order received${size > 1 ? `, ${size} a column` : ""}` });
  const x = across(groups.length);
  const width = Math.min(60, 0.8 * (x(1) - x(0)));
  groups.forEach((group, i) => {
    let below = 0;
    for (const verdict of VERDICTS) {
      const count = group.filter((valve) => (valve.verdict ?? null) === verdict).length;
      if (count === 0) continue;
      node.append(opens(hrefOf(group, verdict),
        svg("rect", { class: `mark ${verdict?.toLowerCase() ?? "none"}`, x: x(i) - width / 2, width, y: y(below + count), height: y(below) - y(below + count) }),
        svg("title", {}, `${count} ${verdict ?? "without verdict"}, from ${group[0].received_at}`)));
      // The sign of the verdict where there is room: a column is read without its colour as well.
      const [tall, sign] = [y(below) - y(below + count), Math.min(7, width / 3)];
      if (verdict && tall > 3 * sign) node.append(svg("g", { class: "sign" }, mark(verdict, x(i), (y(below) + y(below + count)) / 2, sign)));
      below += count;
    }
  });
  return node;
}
