// The field's confusion table: what was named beside what teardown found.
import { get } from "./api.js";
import { address, el, section } from "./dom.js";
import { conclusionWords, counted, foundWords, isCause, spoken } from "./format.js";

const namedName = (name) => (name === "not_analysed" ? "Not analysed" : isCause(name) ? spoken(name) : conclusionWords(name));

function cellOf(cell, right) {
  if (!cell) return el("td", { class: "number" }, "");
  const more = cell.valves - cell.serials.length;
  return el("td", { class: `number${right ? " right" : ""}` }, el("details", {}, el("summary", {}, String(cell.valves), right ? el("span", { class: "unseen" }, " right") : null),
    el("ul", { class: "plain" }, cell.serials.map((serial) => el("li", {}, el("a", { href: address("serial", serial) }, serial)))), more > 0 ? `and ${more} more` : null));
}

/// Rows: what was named; columns: what was found; the same order in both, so that the right ones lie on the diagonal.
export function confusionTable(items) {
  const count = (key, name) => items.filter((item) => item[key] === name).reduce((sum, item) => sum + item.valves, 0);
  const names = (key) => [...new Set(items.map((item) => item[key]))];
  const order = (a, b) => isCause(b) - isCause(a) || count("found", b) + count("named", b) - count("found", a) - count("named", a) || a.localeCompare(b);
  const [rows, columns] = [names("named").sort(order), names("found").sort(order)];
  const at = (named, found) => items.find((item) => item.named === named && item.found === found);
  const isRight = (named, found) => named === found;
  return el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Confusion table" }, el("table", { class: "confusion" },
    el("caption", {}, "Valves: named (rows) and found in teardown (columns)"),
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Named"), columns.map((found) => el("th", { scope: "col", class: "number" }, foundWords(found))),
      el("th", { scope: "col", class: "number" }, "All"))),
    el("tbody", {}, rows.map((named) => el("tr", {}, el("th", { scope: "row" }, namedName(named)),
      columns.map((found) => cellOf(at(named, found), isRight(named, found))), el("td", { class: "number" }, String(count("named", named))))))));
}

export async function showTeardown({ signal }) {
  const { findings, valves, named, named_right: right, items } = await get("/v1/confusion", signal);
  const node = el("div", {}, el("h1", {}, "Teardown"),
    items.length === 0
      ? el("p", { class: "empty" }, "Nobody has entered yet what teardown found. It is entered on the page of a valve, under Teardown: ", el("a", { href: "#/valves" }, "choose one"), ".")
      : [el("p", {}, `${counted(findings, "finding")} in ${counted(valves, "valve")}. `, named ? `Of ${counted(named, "valve")} with a settled cause, teardown found that cause in ${right} (${Math.round(100 * right / named)} %).` : "None of them has a settled cause."),
        section("Named and found", confusionTable(items))]);
  return { node, title: "Teardown" };
}
