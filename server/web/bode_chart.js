// Gain with its 95 % band, and phase, over frequency; both axes of the gain in decades.
import { chartWidth, svg, ticks } from "./chart.js";

const LEFT = 64;
const RIGHT = 12;
const PANEL = { height: 220, top: 12, bottom: 34 };

/// Powers of ten, with 2 and 5 between where there are few of them.
export function decades(low, high) {
  const all = [];
  const factors = high / low < 300 ? [1, 2, 5] : [1];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); ++power) {
    for (const factor of factors) {
      const value = Number((factor * 10 ** power).toPrecision(2));
      if (value >= low * 0.999 && value <= high * 1.001) all.push(value);
    }
  }
  return all;
}

function panel({ offset, marks, y, yTitle, xMarks, x, xTitle }) {
  const bottom = offset + PANEL.height - PANEL.bottom;
  return [
    marks.map((mark) => [svg("line", { class: "grid", x1: LEFT, x2: chartWidth() - RIGHT, y1: y(mark), y2: y(mark) }),
      svg("text", { class: "tick", x: LEFT - 8, y: y(mark) + 4, "text-anchor": "end" }, String(mark))]),
    xMarks.map((mark) => [svg("line", { class: "grid", x1: x(mark), x2: x(mark), y1: offset + PANEL.top, y2: bottom }),
      svg("text", { class: "tick", x: x(mark), y: bottom + 17, "text-anchor": "middle" }, String(mark))]),
    svg("text", { class: "tick", transform: `translate(14 ${offset + PANEL.height / 2}) rotate(-90)`, "text-anchor": "middle" }, yTitle),
    xTitle ? svg("text", { class: "tick", x: (LEFT + chartWidth()) / 2, y: bottom + 32, "text-anchor": "middle" }, xTitle) : null,
  ];
}

const scale = (low, high, from, to) => (value) => from + ((value - low) / (high - low || 1)) * (to - from);

/// entry  one of the analysis's frequency_response; unit of the gain
export function bodeChart(entry, unit) {
  const points = entry.frequency_hz.map((frequency, i) => ({ frequency, gain: entry.gain[i], band: entry.band95[i], phase: entry.phase_deg[i] }))
    .filter((point) => point.frequency > 0 && point.gain > 0);
  if (points.length < 2) return null;
  const log = Math.log10;
  const frequencies = points.map((point) => point.frequency);
  const [first, last] = [Math.min(...frequencies), Math.max(...frequencies)];
  const along = scale(log(first), log(last), LEFT, chartWidth() - RIGHT);
  const x = (frequency) => along(log(frequency));
  const gains = points.flatMap((point) => [point.gain, point.band?.[1]]).filter((value) => value > 0);
  const smallest = Math.min(...points.map((point) => point.gain));
  const [low, high] = [Math.max(smallest / 3, Math.min(...gains)) / 1.1, Math.max(...gains) * 1.1];
  const up = scale(log(low), log(high), PANEL.height - PANEL.bottom, PANEL.top);
  const y = (gain) => up(log(Math.max(gain, low)));
  const phases = points.map((point) => point.phase).filter((value) => typeof value === "number");
  const second = PANEL.height + 4;
  const [lowest, highest] = [Math.min(...phases, -1), Math.max(...phases, 0)];
  const down = scale(lowest, highest, second + PANEL.height - PANEL.bottom, second + PANEL.top);
  const line = (list, of) => list.map((point) => `${x(point.frequency).toFixed(1)} ${of(point).toFixed(1)}`).join("L");
  const banded = points.filter((point) => typeof point.band?.[0] === "number");
  const node = svg("svg", { viewBox: `0 0 ${chartWidth()} ${second + PANEL.height + 4}`, class: "lot-chart", role: "img",
    "aria-label": `Bode plot: gain and phase from ${first.toPrecision(3)} to ${last.toPrecision(3)} Hz` });
  const xMarks = decades(first, last);
  node.append(
    ...panel({ offset: 0, marks: decades(low, high), y, yTitle: `gain${unit ? ` [${unit}]` : ""}`, xMarks, x }).flat(Infinity).filter(Boolean),
    ...panel({ offset: second, marks: ticks(lowest, highest), y: down, yTitle: "phase [°]", xMarks, x, xTitle: "frequency [Hz]" }).flat(Infinity).filter(Boolean));
  if (banded.length > 1) {
    node.append(svg("path", { class: "band", d: `M${line(banded, (p) => y(p.band[1]))}L${line([...banded].reverse(), (p) => y(p.band[0]))}Z` }));
  }
  node.append(svg("path", { class: "response", d: `M${line(points, (p) => y(p.gain))}` }),
    svg("path", { class: "response", d: `M${line(points.filter((p) => typeof p.phase === "number"), (p) => down(p.phase))}` }));
  return node;
}
