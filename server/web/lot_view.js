// Lots: the list with counts, and one lot with its verdicts, errors and causes.
import { get } from "./api.js";
import { address, el, section } from "./dom.js";
import { figure, percent, spoken, time, verdictMark } from "./format.js";
import { barRow } from "./gain_bar.js";
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
  const page = await get(`/v1/lots?${query}`, signal);
  const empty = el("span", {}, "There is no lot yet. Recordings that name a lot make one: ", el("a", { href: "#/upload" }, "upload some"), ".");
  const node = el("div", {}, el("h1", {}, "Lots"),
    table(lotColumns(), page.items, { caption: "Lots, newest first, counted by valve", empty, sort: parameters.get("sort") ?? "", keep: true }),
    el("p", { class: "pager" }, parameters.has("cursor") ? el("a", { href: "#/lots" }, "First page") : null,
      page.next ? el("a", { href: address("lots", null, { cursor: page.next }) }, "Next page") : null));
  return { node, title: "Lots" };
}

/// Bars, most frequent first, with the share that all down to here make together.
function pareto(lot, causes) {
  const sorted = Object.entries(causes).sort((a, b) => b[1] - a[1]);
  if (sorted.length === 0) return el("p", { class: "empty" }, "No valve of this lot has a cause.");
  const all = sorted.reduce((sum, [, valves]) => sum + valves, 0);
  let sum = 0;
  return el("table", { class: "bars" }, el("caption", {}, "Strongest cause by valve, with the cumulated share"), el("tbody", {},
    sorted.map(([cause, valves]) => {
      sum += valves;
      return barRow(el("a", { href: address("valves", null, { lot, cause }) }, spoken(cause)), "cause", valves / sorted[0][1], `${valves} (${percent(sum / all)})`);
    })));
}

function verdictBars(lot, verdicts) {
  const names = ["Good", "Malfunctioned", "Severe"];
  const all = Object.values(verdicts).reduce((sum, valves) => sum + valves, 0);
  if (all === 0) return el("p", { class: "empty" }, "No valve of this lot has been analysed yet.");
  const row = (name, text, valves, kind) => barRow(text, kind, valves / all, String(valves));
  return el("table", { class: "bars" }, el("caption", {}, "Valves by verdict"), el("tbody", {},
    names.map((name) => row(name, el("a", { href: address("valves", null, { lot, verdict: name }) }, name), verdicts[name] ?? 0, name.toLowerCase())),
    verdicts.null ? row("null", "No verdict", verdicts.null, "floor") : null));
}

function valveTable(history) {
  const levels = history.levels.map((level) => ({
    title: `Error at ${level.level_A.toFixed(1)} A`, number: true,
    value: (valve) => valve.errors.find((error) => error.level_A === level.level_A)?.error_eq20,
    show: (valve) => figure(valve.errors.find((error) => error.level_A === level.level_A)?.error_eq20),
  }));
  return table([
    { title: "Received", value: (valve) => valve.received_at, show: (valve) => time(valve.received_at) },
    { title: "Serial", value: (valve) => valve.serial, show: (valve) => el("a", { href: address("valve", valve.submission_id) }, valve.serial ?? "without serial") },
    { title: "Verdict", value: (valve) => valve.verdict, show: (valve) => verdictMark(valve.verdict) },
    { title: "Strongest cause", value: (valve) => spoken(valve.top_cause) || "–" },
    ...levels,
  ], history.valves, { caption: "Valves, each by its newest result", empty: "No result yet." });
}

export async function showLot({ argument, signal }) {
  const path = `/v1/lots/${encodeURIComponent(argument)}`;
  const [lot, history] = await Promise.all([get(path, signal), get(`${path}/history`, signal)]);
  const node = el("div", {},
    el("h1", {}, "Lot ", argument),
    el("p", {}, `${lot.valves} valves in ${lot.submissions} sessions, ${lot.analysed_valves} analysed; received `, time(lot.first_received_at), " to ", time(lot.last_received_at), ". ",
      el("a", { href: address("valves", null, { lot: argument }) }, "All sessions")),
    el("div", { class: "columns" }, section("Verdicts", verdictBars(argument, history.verdicts)), section("Causes", pareto(argument, history.causes))),
    section("Valves", valveTable(history)));
  return { node, title: `Lot ${argument}` };
}
