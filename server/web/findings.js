// What teardown found in a valve: the list, and the form to enter more.
import { allCauses, get, post } from "./api.js";
import { el, field, options } from "./dom.js";
import { foundWords, time } from "./format.js";
import { table } from "./table.js";

const columns = [
  { title: "When", value: (row) => row.when, show: (row) => time(row.when) },
  { title: "Found", value: (row) => foundWords(row.cause) },
  { title: "By", value: (row) => row.who },
  { title: "Note", value: (row) => row.note },
];

/// List and form of one serial number.
export async function findingsPart(serial, signal) {
  const causes = await allCauses();
  const valve = await get(`/v1/valves/${encodeURIComponent(serial)}`, signal);
  const list = el("div");
  const showList = (findings) => list.replaceChildren(
    table(columns, findings, { caption: "Teardown findings", empty: "Nobody has entered what teardown found in this valve." }));
  showList(valve.findings);

  const cause = options(el("select", { required: true }),
    [["", "choose"], ...["none", ...causes.map((c) => c.cause), "other"].map((name) => [name, foundWords(name)])]);
  const who = el("input", { required: true, maxlength: "200", autocomplete: "name" });
  const note = el("textarea", { maxlength: "5000", rows: "2" });
  const status = el("p", { role: "status" });
  const submit = async (event) => {
    event.preventDefault();
    try {
      await post(`/v1/valves/${encodeURIComponent(serial)}/findings`, { cause: cause.value, who: who.value, note: note.value });
      showList((await get(`/v1/valves/${encodeURIComponent(serial)}`, signal)).findings);
      event.target.reset();
      status.textContent = "Stored.";
    } catch (error) {
      status.textContent = error.message;
    }
  };
  const form = el("form", { class: "finding", onsubmit: submit },
    field("Teardown found", cause), field("Found by", who), field("Note", note),
    el("div", { class: "buttons" }, el("button", { type: "submit" }, "Store finding")), status);
  return { valve, node: el("div", {}, list, form) };
}
