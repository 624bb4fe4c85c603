// Tables whose columns sort.
import { el, keepInAddress } from "./dom.js";
import { counted } from "./format.js";

function compare(a, b) {
  if (a === b) return 0;
  if (a === null || a === undefined) return 1;
  if (b === null || b === undefined) return -1;
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true });
}

const classOf = (column) => ["number", "words", "minor"].filter((kind) => column[kind]).join(" ") || null;

const FIRST_ROWS = 200; // of a long table, drawn at once; sorting is over all of them
const MORE_ROWS = 1000;

/// columns  {title, unit, value(row), show(row), number, words, minor}: `value` sorts, `show` (else the value) is shown;
///          a minor one is left out where the window is narrow
/// options  caption; empty: what stands there without rows; sort: "title" or "-title"; keep: the sort order stands in the
///          address; detail(row): class of the row
export function table(columns, rows, { caption, empty = "Nothing here.", sort = "", keep = false, detail = () => null } = {}) {
  if (rows.length === 0) return el("p", { class: "empty" }, empty);
  const body = el("tbody");
  const heads = columns.map((column) => headOf(column));
  const head = el("thead", {}, el("tr", {}, heads));
  let order = sort;
  let most = FIRST_ROWS;
  const rest = el("p", { class: "pager", hidden: rows.length <= FIRST_ROWS });

  function headOf(column) {
    const button = el("button", { type: "button", onclick: () => sortBy(order === column.title ? `-${column.title}` : column.title) },
      column.title, column.unit ? el("span", { class: "unit" }, ` ${column.unit}`) : null);
    return el("th", { scope: "col", class: classOf(column) }, button);
  }

  function fill() {
    const down = order.startsWith("-");
    const column = columns.find((c) => c.title === order.replace(/^-/, ""));
    const shown = column ? [...rows].sort((a, b) => {
      const [x, y] = [column.value(a), column.value(b)];
      const missing = [x, y].some((v) => v === null || v === undefined);
      return down && !missing ? compare(y, x) : compare(x, y);
    }) : rows;
    columns.forEach((c, i) => {
      if (c === column) heads[i].setAttribute("aria-sort", down ? "descending" : "ascending");
      else heads[i].removeAttribute("aria-sort");
    });
    body.replaceChildren(...shown.slice(0, most).map((row) => el("tr", { class: detail(row) },
      columns.map((c) => el("td", { class: classOf(c) }, c.show ? c.show(row) : c.value(row) ?? "–")))));
  }

  function showRest() {
    const left = rows.length - most;
    rest.hidden = left <= 0;
    rest.replaceChildren(el("span", { role: "status" }, `${Math.min(most, rows.length)} of ${counted(rows.length, "row")}`),
      el("button", { type: "button", onclick: () => {
        most += MORE_ROWS;
        fill();
        showRest();
      } }, `Show ${Math.min(left, MORE_ROWS)} more`));
  }

  function sortBy(title) {
    order = title;
    if (keep) keepInAddress({ sort: title });
    fill();
  }

  fill();
  showRest();
  return el("div", {}, el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    el("table", {}, el("caption", {}, caption), head, body)), rest);
}
