// The list of valve sessions: filters, sorting, pages by cursor.
import { allCauses, get, save } from "./api.js";
import { address, el, field, options } from "./dom.js";
import { follow } from "./events.js";
import { causeCell, isFinal, spoken, time, verdictMark } from "./format.js";
import { table } from "./table.js";

const FILTERS = ["serial", "lot", "valve_type", "stand", "verdict", "cause", "since", "until"];
const VERDICTS = [["", "any"], ["Good", "Good"], ["Malfunctioned", "Malfunctioned"], ["Severe", "Severe"]];

function filterForm(chosen, causes) {
  const inputs = {
    serial: el("input", { value: chosen.serial ?? "", spellcheck: "false" }),
    lot: el("input", { value: chosen.lot ?? "", spellcheck: "false" }),
    valve_type: el("input", { value: chosen.valve_type ?? "", spellcheck: "false" }),
    stand: el("input", { value: chosen.stand ?? "", spellcheck: "false" }),
    verdict: options(el("select"), VERDICTS, chosen.verdict),
    cause: options(el("select"), [["", "any"], ...causes.map((c) => [c.cause, spoken(c.cause)])], chosen.cause),
    since: el("input", { type: "date", value: chosen.since ?? "" }),
    until: el("input", { type: "date", value: chosen.until ?? "" }),
  };
  const submit = (event) => {
    event.preventDefault();
    location.hash = address("valves", null, Object.fromEntries(FILTERS.map((name) => [name, inputs[name].value.trim()])));
  };
  const labels = { valve_type: "Valve type", since: "Received from", until: "Received before" };
  return el("form", { class: "filters", onsubmit: submit },
    FILTERS.map((name) => field(labels[name] ?? spoken(name), inputs[name])),
    el("div", { class: "buttons" }, el("button", { type: "submit" }, "Filter"),
      FILTERS.some((name) => chosen[name]) ? el("a", { href: "#/valves" }, "Clear") : null));
}

export const sessionColumns = [
  { title: "Received", value: (row) => row.received_at, show: (row) => time(row.received_at) },
  { title: "Serial", value: (row) => row.serial, show: (row) => el("a", { href: address("valve", row.id) }, row.serial ?? "without serial") },
  { title: "Lot", value: (row) => row.lot, show: (row) => (row.lot ? el("a", { href: address("lot", row.lot) }, row.lot) : "–"), minor: true },
  { title: "Type", value: (row) => row.valve_type, minor: true },
  { title: "Stand", value: (row) => row.stand, minor: true },
  { title: "Recordings", value: (row) => row.recordings, number: true, minor: true },
  { title: "Verdict", value: (row) => (isFinal(row.state) ? row.verdict ?? row.state : row.state), show: verdictCell },
  { title: "What is wrong", value: causeCell, words: true },
];

function verdictCell(row) {
  if (row.state === "done") return verdictMark(row.verdict);
  // Of a valve "rejected" would be a verdict; it is the files that were refused.
  return el("span", { class: `state ${row.state}`, title: row.error?.detail }, row.state === "rejected" ? "files refused" : row.state);
}

export async function showList({ parameters, signal }) {
  const chosen = Object.fromEntries(parameters);
  const query = new URLSearchParams({ limit: "50" });
  for (const name of FILTERS) {
    if (!chosen[name]) continue;
    const day = name === "since" || name === "until";
    query.set(name, day ? new Date(`${chosen[name]}T00:00`).toISOString() : chosen[name]);
  }
  if (chosen.cursor) query.set("cursor", chosen.cursor);
  const [page, causes] = await Promise.all([get(`/v1/submissions?${query}`, signal), allCauses()]);
  const filtered = FILTERS.some((name) => chosen[name]);
  const empty = filtered ? "No valve fits these filters."
    : el("span", {}, "No valve has been tested yet. ", el("a", { href: "#/upload" }, "Upload its recordings"), " to begin.");
  const next = { ...chosen, cursor: page.next };
  const rows = (items) => table(sessionColumns, items, { caption: "Test sessions, newest first", empty,
    sort: new URLSearchParams(location.hash.split("?")[1]).get("sort") ?? "", keep: true });
  const list = el("div", {}, rows(page.items));

  /// While a session of this page has not ended, its row follows it. Rows that came since are left to the next visit, so
  /// that nothing moves under the reader's hand.
  async function followRows() {
    let items = page.items;
    const leave = new AbortController();
    signal.addEventListener("abort", () => leave.abort(signal.reason));
    await follow(async (changed) => {
      const open = items.filter((row) => !isFinal(row.state) && (!changed || changed.has(row.job_id)));
      const now = new Map(await Promise.all(open.map(async (row) => [row.id, await get(`/v1/submissions/${row.id}`, signal)])));
      if (now.size > 0) {
        items = items.map((row) => (now.has(row.id) ? { ...now.get(row.id), recordings: row.recordings } : row));
        list.replaceChildren(rows(items));
      }
      if (items.every((row) => isFinal(row.state))) leave.abort(new DOMException("ended", "AbortError"));
    }, leave.signal);
  }

  const node = el("div", {},
    el("h1", {}, "Valves"),
    filterForm(chosen, causes),
    list,
    el("p", { class: "pager" },
      page.items.length ? el("button", { type: "button", class: "link", onclick: () => save("valves.csv", `/v1/submissions?${query}&format=csv`) }, "these as CSV") : null,
      chosen.cursor ? el("a", { href: address("valves", null, { ...chosen, cursor: null }) }, "First page") : null,
      page.next ? el("a", { href: address("valves", null, next) }, "Next page") : null));
  return { node, title: "Valves", shown: () => page.items.some((row) => !isFinal(row.state)) && followRows().catch(() => {}) };
}
