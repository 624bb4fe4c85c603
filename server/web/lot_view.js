// Lots: the list with counts, and one lot with its verdicts, errors and causes.
import { get } from "./api.js";
import { individualsChart, verdictColumns } from "./chart.js";
import { alarmList, currentAlarms } from "./compare_view.js";
import { address, el, field, keepInAddress, options, section } from "./dom.js";
import { follow } from "./events.js";
import { causesCell, conclusionWords, counted, featureWords, figure, qValue, spoken, time, verdictMark } from "./format.js";
import { barRow } from "./gain_bar.js";
import { parametersPart } from "./lot_parameters.js";
import { patternsPart } from "./lot_patterns.js";
import { shiftsPart } from "./lot_shifts.js";
import { reportLink } from "./report_link.js";
import { table } from "./table.js";

const count = (lot, verdict) => lot.verdicts[verdict] ?? 0;

function lotColumns() {
  const verdicts = ["Good", "Malfunctioned", "Severe"].map((verdict) => ({ title: verdict, value: (lot) => count(lot, verdict), number: true }));
  return [
    { title: "Lot", value: (lot) => lot.lot, show: (lot) => el("a", { href: address("lot", lot.lot) }, lot.lot) },
    { title: "Valves", value: (lot) => lot.valves, number: true },
    { title: "Analysed", value: (lot) => lot.analysed_valves, number: true },
    ...verdicts,
    { title: "No verdict", value: (lot) => count(lot, "null"), number: true },
    { title: "Most frequent cause", value: (lot) => topCause(lot) },
    { title: "Last received", value: (lot) => lot.last_received_at, show: (lot) => time(lot.last_received_at) },
  ];
}

function topCause(lot) {
  const [cause, valves] = Object.entries(lot.causes).sort((a, b) => b[1] - a[1])[0] ?? [];
  return cause ? `${spoken(cause)} (${valves})` : "–";
}

export async function showLots({ parameters, signal }) {
  const query = new URLSearchParams({ limit: "100" });
  if (parameters.has("cursor")) query.set("cursor", parameters.get("cursor"));
  const [page, stands] = await Promise.all([get(`/v1/lots?${query}`, signal), get("/v1/stands", signal)]);
  const alarms = currentAlarms(stands.items);
  const empty = el("span", {}, "There is no lot yet. Recordings that name a lot make one: ", el("a", { href: "#/upload" }, "upload some"), ".");
  const node = el("div", {}, el("h1", {}, "Lots"), alarmList(alarms),
    table(lotColumns(), page.items, { caption: "Lots, newest first, counted by valve", empty, sort: parameters.get("sort") ?? "", keep: true }),
    el("p", { class: "pager" }, parameters.has("cursor") ? el("a", { href: "#/lots" }, "First page") : null,
      page.next ? el("a", { href: address("lots", null, { cursor: page.next }) }, "Next page") : null));
  return { node, title: "Lots" };
}

/// How many of the named causes are expected to be another one: the sum of what is missing to certainty.
export function expectedFalse(names) {
  return names.reduce((sum, name) => sum + 1 - name.probability, 0);
}

const few = (expected) => (expected < 0.1 ? "fewer than 0.1" : figure(expected, 2));

function falseNames(names) {
  if (names.length === 0) return null;
  const expected = expectedFalse(names);
  const worst = Math.max(...names.map((name) => name.q_value));
  return el("p", { class: "small" }, `Of ${counted(names.length, "name")}, ${few(expected)} ${expected < 0.1 || expected > 1 ? "are" : "is"} expected to be false, by the probabilities they were given: ${qValue(worst)} for all of them together. `,
    "The q-value beside a name is the share of false ones expected among the names at least as sure as it.");
}

/// Bars of the settled causes, most frequent first, with the share that all down to here make together; a valve counts
/// with each of its causes. What is not settled or not explained stands apart, for it is no cause.
function pareto(lot, valves) {
  const tally = new Map();
  const names = valves.flatMap((valve) => valve.causes);
  for (const { cause } of names) tally.set(cause, (tally.get(cause) ?? 0) + 1);
  const sorted = [...tally].sort((a, b) => b[1] - a[1]);
  const ofCause = (cause) => few(expectedFalse(names.filter((name) => name.cause === cause)));
  const apart = [["ambiguous", "Not settled"], ["unexplained", "Unexplained"]]
    .map(([conclusion, title]) => [el("a", { href: address("lot", lot, { conclusion }) }, title), valves.filter((v) => v.conclusion === conclusion).length]).filter(([, count]) => count > 0);
  if (sorted.length + apart.length === 0) return el("p", { class: "empty" }, "No valve of this lot has a cause.");
  const all = sorted.reduce((sum, [, count]) => sum + count, 0);
  const largest = Math.max(...sorted.map(([, count]) => count), ...apart.map(([, count]) => count));
  let sum = 0;
  const bars = el("table", { class: "bars" }, el("caption", {}, "Valves by settled cause, the cumulated share, and how many of the names are expected to be false"), el("tbody", {},
    sorted.map(([cause, count]) => {
      sum += count;
      return barRow(el("a", { href: address("lot", lot, { named: cause }) }, spoken(cause)), "tally", count / largest, `${count} (${Math.round(100 * sum / all)} %), false: ${ofCause(cause)}`);
    }),
    apart.map(([title, count]) => barRow(title, "floor", count / largest, String(count)))));
  return el("div", {}, bars, falseNames(names));
}

const FIRED = 20; // times that a rule fired which are listed; the chart rings all
const RUN = 8; // consecutive values on one side of the centre: Western Electric's fourth rule
const RANGE_LIMIT = 3.267; // D4 of a moving range of two

/// First and last index of every run of at least RUN values on one side of the centre.
export function runs(values, centre) {
  const found = [];
  const side = (i) => Math.sign(values[i] - centre);
  let start = 0;
  for (let i = 1; i <= values.length; ++i) {
    if (i < values.length && side(i) === side(start)) continue;
    if (i - start >= RUN && side(start) !== 0) found.push([start, i - 1]);
    start = i;
  }
  return found;
}

/// What a control chart can show of a lot: the error at a level, or a feature of the frequency response.
export function figuresOf(history) {
  const errors = history.levels.map((level) => ({
    ...level, key: String(level.level_A), title: `Error (Eq 20) at ${level.level_A.toFixed(1)} A [psi/s]`, short: `${level.level_A.toFixed(1)} A`, unit: "psi/s",
    value: (valve) => valve.errors.find((error) => error.level_A === level.level_A)?.error_eq20,
  }));
  const features = history.features.map((feature) => {
    const [words, unit] = featureWords(feature.name);
    return { ...feature, key: feature.name, title: `${words} [${unit}]`, short: `${words} ${unit}`, unit, value: (valve) => valve.features[feature.name] };
  });
  return [...errors, ...features];
}

const rule = (name) => [el("strong", {}, name), ": "];

/// Individuals and moving range of one figure, with the rules that fired.
export function controlCharts(level, valves) {
  const points = valves.map((valve) => ({
    value: level.value(valve), verdict: valve.verdict,
    id: valve.submission_id, href: address("valve", valve.submission_id), serial: valve.serial ?? "without serial",
  })).filter((point) => typeof point.value === "number");
  if (level.centre === null) return el("p", { class: "empty" }, "Control limits need at least two valves.");
  const beyond = new Set(level.outside);
  const outside = points.map((point, i) => (beyond.has(point.id) ? i : -1)).filter((i) => i >= 0);
  const lines = [{ value: level.centre, title: `mean ${figure(level.centre)}`, kind: "centre" }, { value: level.upper_limit, title: `upper limit ${figure(level.upper_limit)}`, kind: "" }];
  if (level.lower_limit !== 0) lines.push({ value: level.lower_limit, title: `lower limit ${figure(level.lower_limit)}`, kind: "" });
  const ranges = points.slice(1).map((point, i) => ({ ...point, value: Math.abs(point.value - points[i].value) }));
  const mean = ranges.reduce((sum, point) => sum + point.value, 0) / ranges.length;
  const wide = ranges.map((point, i) => (point.value > RANGE_LIMIT * mean ? i : -1)).filter((i) => i >= 0);
  const first = (all, line) => [...all.slice(0, FIRED).map((entry) => el("li", {}, line(entry))),
    all.length > FIRED ? el("li", {}, `and ${all.length - FIRED} more like this`) : null].filter(Boolean);
  const fired = [
    ...first(outside, (i) => [rule("Outside the limits"), el("a", { href: points[i].href }, points[i].serial), `: ${figure(points[i].value)}`]),
    ...first(runs(points.map((p) => p.value), level.centre), ([from, to]) => [rule(`Run of ${RUN} or more`), `${to - from + 1} valves in a row on one side of the mean, from `, el("a", { href: points[from].href }, points[from].serial), " to ", el("a", { href: points[to].href }, points[to].serial)]),
    ...first(wide, (i) => [rule("Moving range"), "the step to ", el("a", { href: ranges[i].href }, ranges[i].serial), ` is larger than the moving range allows: ${figure(ranges[i].value)}`]),
  ];
  return el("div", {},
    individualsChart({ points, lines, outside, label: `${level.title} of each valve with control limits`, yTitle: level.title }),
    individualsChart({ points: ranges, outside: wide, height: 190, label: `Moving range of ${level.title}`, yTitle: `moving range${level.unit ? ` [${level.unit}]` : ""}`,
      lines: [{ value: mean, title: `mean ${figure(mean)}`, kind: "centre" }, { value: RANGE_LIMIT * mean, title: `limit ${figure(RANGE_LIMIT * mean)}`, kind: "" }] }),
    fired.length ? el("ul", {}, fired) : el("p", {}, "No rule fired: the lot varies no more than from valve to valve."));
}

/// The charts of one figure, chosen by the reader; the choice stands in the address.
function controlPart(history, parameters) {
  const figures = figuresOf(history);
  if (figures.length === 0) return el("p", { class: "empty" }, "No valve of this lot was tested at a known level.");
  const middle = figures[Math.floor(history.levels.length / 2)];
  const figureOf = (text) => figures.find((candidate) => candidate.key === text) ?? middle;
  const place = el("div");
  const show = (level) => place.replaceChildren(controlCharts(level, history.valves));
  const choice = options(el("select", { onchange: () => {
    keepInAddress({ level: choice.value });
    show(figureOf(choice.value));
  } }), figures.map((candidate) => [candidate.key, candidate.title]), figureOf(parameters.get("level")).key);
  show(figureOf(parameters.get("level")));
  return el("div", {}, el("div", { class: "filters" }, field("Figure", choice)), place);
}

function verdictBars(lot, verdicts) {
  const names = ["Good", "Malfunctioned", "Severe"];
  const all = Object.values(verdicts).reduce((sum, valves) => sum + valves, 0);
  if (all === 0) return el("p", { class: "empty" }, "No valve of this lot has been analysed yet.");
  const row = (name, title, valves, kind) => barRow(el("a", { href: address("lot", lot, { verdict: name }) }, title), kind, valves / all, String(valves));
  return el("table", { class: "bars" }, el("caption", {}, "Valves by verdict"), el("tbody", {},
    names.map((name) => row(name, name, verdicts[name] ?? 0, name.toLowerCase())),
    verdicts.null ? row("none", "No verdict", verdicts.null, "floor") : null));
}

/// The stands the lot was tested on, each to be laid beside another.
function standPart(lot, valves) {
  const stands = new Map();
  for (const valve of valves) {
    const name = valve.stand ?? null;
    if (!stands.has(name)) stands.set(name, []);
    stands.get(name).push(valve);
  }
  const rows = [...stands].map(([stand, of]) => ({ stand, of }));
  const share = (row, test) => row.of.filter(test).length;
  const part = (row, test, filter) => (row.stand && share(row, test) ? el("a", { href: address("lot", lot, { stand: row.stand, ...filter }) }, String(share(row, test))) : String(share(row, test)));
  const isUnexplained = (v) => v.conclusion === "unexplained";
  const other = (row) => rows.find((r) => r.stand && r !== row);
  return table([
    { title: "Stand", value: (row) => row.stand, show: (row) => (row.stand ? el("a", { href: address("lot", lot, { stand: row.stand }) }, row.stand) : "not named") },
    { title: "Valves", value: (row) => row.of.length, number: true },
    ...["Good", "Malfunctioned", "Severe"].map((verdict) => ({ title: verdict, value: (row) => share(row, (v) => v.verdict === verdict),
      show: (row) => part(row, (v) => v.verdict === verdict, { verdict }), number: true })),
    { title: "Named", value: (row) => share(row, NAMES.any.fits), show: (row) => part(row, NAMES.any.fits, { named: "any" }), number: true },
    { title: "Unexplained", value: (row) => share(row, isUnexplained), show: (row) => part(row, isUnexplained, { conclusion: "unexplained" }), number: true },
    { title: "Beside", value: () => null, show: (row) => (row.stand && other(row)
      ? el("a", { href: address("compare", null, { lot, stand: row.stand, with_lot: lot, with_stand: other(row).stand }) }, `compare with ${other(row).stand}`) : "–") },
  ], rows, { caption: "Valves of the lot by stand", empty: "No result yet." });
}

const NAMES = {
  any: { words: "with a settled cause", fits: (valve) => valve.causes.length > 0 },
  none: { words: "without a settled cause", fits: (valve) => valve.causes.length === 0 },
};

/// Filters of a lot's valves as they stand in the address: the words for one, and whether a valve fits it.
const FILTERS = {
  verdict: { words: (name) => (name === "none" ? "no verdict" : name), fits: (valve, name) => (valve.verdict ?? "none") === name },
  conclusion: { words: (name) => conclusionWords(name).toLowerCase(), fits: (valve, name) => valve.conclusion === name },
  named: { words: (cause) => NAMES[cause]?.words ?? spoken(cause).toLowerCase(), fits: (valve, cause) => NAMES[cause]?.fits(valve) ?? valve.causes.some((c) => c.cause === cause) },
  stand: { words: (name) => ["on ", el("bdi", {}, name)], fits: (valve, name) => valve.stand === name },
  first: { words: (at) => ["received from ", time(at)], fits: (valve, at) => valve.received_at >= at },
  last: { words: (at) => ["to ", time(at)], fits: (valve, at) => valve.received_at <= at },
};

/// The valves of a lot behind one bar, column or number: what it counted, no more and no less.
function filteredLot(lot, history, filters) {
  const valves = history.valves.filter((valve) => filters.every(([name, value]) => FILTERS[name].fits(valve, value)));
  const words = filters.flatMap(([name, value], i) => [i ? ", " : "", FILTERS[name].words(value)]);
  return el("div", {}, el("h1", {}, "Lot ", lot),
    el("p", {}, `${valves.length} of ${counted(history.valves.length, "analysed valve")}: `, el("strong", {}, words), ". ", el("a", { href: address("lot", lot) }, "The whole lot")),
    section("Valves", valveTable({ ...history, valves }, "No valve of this lot fits.")));
}

function valveTable(history, empty = "No result yet.") {
  const figures = figuresOf(history).map(({ short, value }) => ({ title: short, number: true, value, show: (valve) => figure(value(valve)) }));
  return table([
    { title: "Received", value: (valve) => valve.received_at, show: (valve) => time(valve.received_at) },
    { title: "Serial", value: (valve) => valve.serial, show: (valve) => el("a", { href: address("valve", valve.submission_id) }, valve.serial ?? "without serial") },
    { title: "Verdict", value: (valve) => valve.verdict, show: (valve) => verdictMark(valve.verdict) },
    { title: "What is wrong", value: causesCell, words: true },
    ...figures,
  ], history.valves, { caption: "Valves, each by its newest result; the error (Eq 20) in psi/s by level, then figures of the frequency response", empty,
    sort: new URLSearchParams(location.hash.split("?")[1]).get("sort") ?? "", keep: true });
}

/// Says when more of the lot has been analysed than is shown. What is shown stays: nothing moves under the reader's eyes.
function laterResults(lot, path, again, signal) {
  if (lot.analysed_valves === lot.valves) return null;
  const said = el("p", { role: "status", class: "since" });
  const look = async () => {
    const now = await get(path, signal);
    const more = now.analysed_valves - lot.analysed_valves;
    if (more > 0) said.replaceChildren(`${counted(more, "more valve")} ${more === 1 ? "has" : "have"} been analysed since. `, el("button", { type: "button", onclick: again }, "Show"));
  };
  return { node: said, shown: () => follow(look, signal).catch(() => {}) };
}

export async function showLot({ argument, parameters, signal, again }) {
  const path = `/v1/lots/${encodeURIComponent(argument)}`;
  const filters = Object.keys(FILTERS).filter((name) => parameters.get(name)).map((name) => [name, parameters.get(name)]);
  if (filters.length > 0) return { node: filteredLot(argument, await get(`${path}/history`, signal), filters), title: `Lot ${argument}` };
  const [lot, history] = await Promise.all([get(path, signal), get(`${path}/history`, signal)]);
  const sizes = parametersPart(path, parameters, signal);
  const shifts = shiftsPart(path, signal);
  const patterns = patternsPart(path, signal);
  const later = laterResults(lot, path, again, signal);
  const node = el("div", {},
    el("h1", {}, "Lot ", argument),
    el("p", {}, `${counted(lot.valves, "valve")} in ${counted(lot.submissions, "session")}, ${lot.analysed_valves} analysed; received `, time(lot.first_received_at), " to ", time(lot.last_received_at), ". ",
      el("a", { href: address("valves", null, { lot: argument }) }, "All sessions"), " ",
      el("a", { href: address("compare", null, { lot: argument }) }, "compare"), " ", reportLink(`Lot ${argument}`, `${path}/report`)),
    later?.node,
    alarmList(history.alarms),
    el("div", { class: "columns" }, section("Verdicts", verdictBars(argument, history.verdicts)), section("Causes", pareto(argument, history.valves))),
    history.valves.length ? section("Verdicts over time", verdictColumns(history.valves, (group, verdict) =>
      address("lot", argument, { verdict: verdict ?? "none", first: group[0].received_at, last: group[group.length - 1].received_at }))) : null,
    section("Stands", standPart(argument, history.valves)),
    section("Figures over time", controlPart(history, parameters)),
    section("Sizes of the causes", sizes.node),
    section("What all valves share", shifts.node),
    section("Patterns that no cause explains", patterns.node),
    section("Valves", valveTable(history)));
  return { node, title: `Lot ${argument}`,
    // What has to be read from many analyses waits until the rest is drawn.
    shown: () => requestAnimationFrame(() => setTimeout(() => !signal.aborted && [sizes, shifts, patterns, later].filter(Boolean).forEach((part) => part.shown()))) };
}
