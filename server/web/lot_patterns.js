// Unexplained valves of a lot that leave the same residual: the groups, their members and their mean residual.
import { get } from "./api.js";
import { residualChart } from "./chart.js";
import { address, el } from "./dom.js";
import { counted, figure } from "./format.js";

const NAMED = 60; // links of a group that stand there at once

/// The valves as links, the rest of a long list folded.
function links(valves, show) {
  const list = (some) => some.map((valve, i) => [i ? ", " : "", show(valve)]);
  if (valves.length <= NAMED) return el("p", {}, list(valves), ".");
  const rest = el("details", {}, el("summary", {}, `and ${valves.length - NAMED} more`));
  rest.addEventListener("toggle", () => rest.childElementCount > 1 || rest.append(el("p", {}, list(valves.slice(NAMED)), ".")));
  return el("div", {}, el("p", {}, list(valves.slice(0, NAMED))), rest);
}

const link = (valve) => el("a", { href: address("valve", valve.submission_id) }, valve.serial ?? "without serial");

function sharedStand(members) {
  const stands = new Set(members.map((member) => member.stand));
  return stands.size === 1 && !stands.has(null) ? `All were tested on ${[...stands][0]}.` : "";
}

export function patternGroup(group, number) {
  const { members, residuals } = group;
  return el("article", { class: "cause" },
    el("h3", {}, `Pattern ${number}: ${members.length} valves`),
    links(members, (member) => [link(member), ` (${figure(member.typicality, 2)})`]),
    sharedStand(members) ? el("p", {}, sharedStand(members)) : null,
    el("div", { class: "columns" }, residuals.map((residual) => el("figure", {},
      el("figcaption", { class: "small" }, residual.test),
      residualChart({ ...residual, label: `Mean residual of ${members.length} valves, ${residual.test}` })))));
}

const DRAWN = 20; // patterns with their curves; the smaller ones are listed

function smallerGroups(groups) {
  return el("details", {}, el("summary", {}, `${counted(groups.length, "smaller pattern")}`),
    groups.map((group, i) => [el("h3", {}, `Pattern ${DRAWN + i + 1}: ${group.members.length} valves`), links(group.members, link)]));
}

function shown(answer) {
  const { groups, alone, compared, unexplained, good_valves: good } = answer;
  if (unexplained === 0) return [el("p", { class: "empty" }, "No valve of this lot is unexplained.")];
  if (unexplained === 1) return [el("p", {}, "One valve is unexplained: ", link(alone[0]), ". A pattern needs two.")];
  const scope = `${compared < unexplained ? `${compared} of ${unexplained}` : unexplained} unexplained valves were compared`;
  const beyond = good ? `, beyond what ${counted(good, "valve")} ${good === 1 ? "leaves" : "leave"} in which nothing is wrong` : "";
  return [
    el("p", { class: "small" }, `${scope}${beyond}. In brackets: how typical the valve is of its group. Lines: mean residual; tinted: one standard deviation of the members`,
      good ? "; dashed: the good valves." : "."),
    groups.length ? groups.slice(0, DRAWN).map((group, i) => patternGroup(group, i + 1)) : el("p", {}, "No two of them leave the same residual over time."),
    groups.length > DRAWN ? smallerGroups(groups.slice(DRAWN)) : null,
    alone.length ? [el("p", {}, groups.length ? "Like no other:" : "They are:"), links(alone, link)] : null,
  ].flat().filter(Boolean);
}

/// Loads into its place after the view is shown.
export function patternsPart(path, signal) {
  const place = el("div", { class: "later" }, el("p", { class: "empty" }, "Comparing the residuals of unexplained valves …"));
  return { node: place, shown: () => get(`${path}/patterns`, signal).then((answer) => place.replaceChildren(...shown(answer))).catch((error) => {
    if (!signal.aborted) place.replaceChildren(el("p", { class: "mistake" }, error.message));
  }) };
}
