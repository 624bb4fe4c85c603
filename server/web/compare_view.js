// Two lots, two stands, or one lot on two stands beside each other; and the stands with their alarms.
import { get } from "./api.js";
import { address, el, field, section } from "./dom.js";
import { conclusionWords, counted, figure, isCause, spoken, time } from "./format.js";
import { table } from "./table.js";

const SIDES = ["lot", "stand", "with_lot", "with_stand"];
const LABELS = { lot: "Lot", stand: "Stand", with_lot: "With lot", with_stand: "With stand" };
const VERDICTS = ["Good", "Malfunctioned", "Severe"];
const CLEAR = 0.01; // chance below which a difference is pointed out

const sideName = ({ lot, stand }) => [lot ? `lot ${lot}` : null, stand ? `${lot ? "on " : ""}${stand}` : null].filter(Boolean).join(" ");

function chance(p) {
  if (p === null) return "too few";
  return p < 0.001 ? "< 0.001" : p.toFixed(3);
}

/// A word beside the number: a difference is not told by a colour alone.
const differs = (p) => (p !== null && p < CLEAR ? el("strong", {}, `${chance(p)} differ`) : chance(p));

/// Causes before what is no cause, the most frequent first.
const byFrequency = (a, b) => isCause(b.name) - isCause(a.name) || b.a + b.b - a.a - a.b;

/// The valves of a lot stand in it; those of a stand over all lots in the list, which knows no conclusions.
function verdictView(name, { lot, stand }) {
  if (lot) return address("lot", lot, { stand, verdict: VERDICTS.includes(name) ? name : "none" });
  return VERDICTS.includes(name) ? address("valves", null, { stand, verdict: name }) : null;
}

function causeView(name, { lot, stand }) {
  if (lot) return address("lot", lot, isCause(name) ? { stand, named: name } : { stand, conclusion: name, named: "none" });
  return isCause(name) ? address("valves", null, { stand, cause: name }) : null;
}

const outcomeName = (name) => (isCause(name) ? spoken(name) : conclusionWords(name));

/// viewOf(name, side)  the address that shows a share's valves; null where there is none
function shareTable(shares, sides, caption, nameOf, found, viewOf) {
  const cell = (share, count, total, side) => {
    if (!total) return "–";
    const text = `${count} (${Math.round(100 * count / total)} %)`;
    const href = count ? viewOf(share.name, side) : null;
    return href ? el("a", { href }, text) : text;
  };
  return table([
    { title: caption, value: (share) => nameOf(share.name) },
    { title: sides[0], value: (share) => share.a / (share.of_a || 1), show: (share) => cell(share, share.a, share.of_a, found.a), number: true },
    { title: sides[1], value: (share) => share.b / (share.of_b || 1), show: (share) => cell(share, share.b, share.of_b, found.b), number: true },
    { title: "Chance if equal", value: (share) => share.p_value, show: (share) => differs(share.p_value), number: true },
  ], shares, { caption: `${caption}: valves and shares, with Fisher's exact test`, empty: "Nothing to compare yet." });
}

function levelTable(levels, sides) {
  const shown = (side) => (level) => `${figure(level[side].median)} (${level[side].valves})`;
  return table([
    { title: "Level", unit: "A", value: (level) => level.level_A, show: (level) => level.level_A.toFixed(2), number: true },
    { title: sides[0], value: (level) => level.a.median, show: shown("a"), number: true },
    { title: sides[1], value: (level) => level.b.median, show: shown("b"), number: true },
    { title: "Chance if equal", value: (level) => level.p_value, show: (level) => differs(level.p_value), number: true },
  ], levels, { caption: "Median error (Eq 20) in psi/s and valves by level, with the rank sum test", empty: "The two have no level in common." });
}

function form(parameters, lots, stands) {
  const list = (id, names) => el("datalist", { id }, names.map((name) => el("option", { value: name })));
  const inputs = Object.fromEntries(SIDES.map((name) => [name, el("input", { value: parameters.get(name) ?? "", spellcheck: "false",
    list: name.endsWith("lot") ? "known-lots" : "known-stands" })]));
  const submit = (event) => {
    event.preventDefault();
    location.hash = address("compare", null, Object.fromEntries(SIDES.map((name) => [name, inputs[name].value.trim()])));
  };
  return el("form", { class: "filters", onsubmit: submit }, list("known-lots", lots), list("known-stands", stands),
    SIDES.map((name) => field(LABELS[name], inputs[name])), el("div", { class: "buttons" }, el("button", { type: "submit" }, "Compare")));
}

/// What an alarm says, with the valves to look at.
export function alarmText(alarm) {
  const link = (valve) => el("a", { href: address("valve", valve.submission_id) }, valve.serial ?? "without serial");
  const valves = alarm.valves;
  return [el("strong", {}, alarm.current ? "Look at " : "Was wrong: ", el("bdi", {}, alarm.stand), "."), ` ${valves.length} valves in a row show ${spoken(alarm.cause).toLowerCase()}, which is the stand's: `,
    valves.slice(0, 10).map((valve, i) => [i ? ", " : "", link(valve)]), valves.length > 10 ? `, and ${valves.length - 10} more` : "", "."];
}

/// Of stands as the service lists them.
export const currentAlarms = (stands) => stands.flatMap((stand) => stand.alarms).filter((alarm) => alarm.current);

export function alarmList(alarms) {
  if (alarms.length === 0) return null;
  return el("ul", { class: "alarms" }, alarms.map((alarm) => el("li", { class: alarm.current ? "current" : null }, alarmText(alarm))));
}

function standTable(stands) {
  const count = (stand, verdict) => stand.verdicts[verdict] ?? 0;
  const top = (stand) => Object.entries(stand.causes).sort((a, b) => b[1] - a[1])[0];
  return table([
    { title: "Stand", value: (stand) => stand.stand, show: (stand) => el("a", { href: address("valves", null, { stand: stand.stand }) }, stand.stand) },
    { title: "Valves", value: (stand) => stand.valves, number: true },
    ...["Good", "Malfunctioned", "Severe"].map((verdict) => ({ title: verdict, value: (stand) => count(stand, verdict), number: true })),
    { title: "Most frequent cause", value: (stand) => (top(stand) ? `${spoken(top(stand)[0])} (${top(stand)[1]})` : "–") },
    { title: "Last received", value: (stand) => stand.last_received_at, show: (stand) => time(stand.last_received_at) },
  ], stands, { caption: "Stands of the newest sessions", empty: "No recording names a stand yet: a line \"# stand: NAME\" in the file does." });
}

export async function showCompare({ parameters, signal }) {
  const asked = (side) => parameters.get(side) || parameters.get(side.replace("lot", "stand"));
  const query = new URLSearchParams(SIDES.filter((name) => parameters.get(name)).map((name) => [name, parameters.get(name)]));
  const complete = asked("lot") && asked("with_lot");
  const [lots, stands, found] = await Promise.all([get("/v1/lots?limit=200", signal), get("/v1/stands", signal),
    complete ? get(`/v1/comparison?${query}`, signal) : null]);
  const alarms = currentAlarms(stands.items);
  const sides = found ? [sideName(found.a), sideName(found.b)] : [];
  // Heads of columns say what differs: of one lot on two stands the stand alone.
  const heads = found && found.a.lot === found.b.lot && found.a.stand && found.b.stand ? [found.a.stand, found.b.stand] : sides;
  const node = el("div", {}, el("h1", {}, "Compare"), alarmList(alarms),
    form(parameters, lots.items.map((lot) => lot.lot), stands.items.map((stand) => stand.stand)),
    found ? [
      el("p", {}, el("bdi", {}, sides[0]), `: ${counted(found.a.valves, "valve")}; `, el("bdi", {}, sides[1]), `: ${counted(found.b.valves, "valve")}. `,
        "The chance is that of so large a difference between two halves of one population."),
      section("Verdicts", shareTable(found.verdicts, heads, "Verdict", (name) => name, found, verdictView)),
      section("Causes", shareTable([...found.causes].sort(byFrequency), heads, "Cause", outcomeName, found, causeView)),
      section("Error by level", levelTable(found.levels, heads)),
    ] : el("p", { class: "empty" }, "Choose two lots, two stands, or one lot on two stands."),
    section("Stands", standTable(stands.items)));
  return { node, title: "Compare" };
}
