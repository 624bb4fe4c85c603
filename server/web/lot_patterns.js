// Unexplained valves of a lot that leave the same residual: the groups, their members and their mean residual.
import { get } from "./api.js";
import { residualChart } from "./chart.js";
import { address, el } from "./dom.js";
import { counted, figure } from "./format.js";

const link = (valve) => el("a", { href: address("valve", valve.submission_id) }, valve.serial ?? "without serial");

function sharedStand(members) {
  const stands = new Set(members.map((member) => member.stand));
  return stands.size === 1 && !stands.has(null) ? ` All were tested on ${[...stands][0]}.` : "";
}

export function patternGroup(group, number) {
  const { members, residuals } = group;
  return el("article", { class: "cause" },
    el("h3", {}, `Pattern ${number}: ${members.length} valves`),
    el("p", {}, members.map((member, i) => [i ? ", " : "", link(member), ` (${figure(member.typicality, 2)})`]), `.${sharedStand(members)}`),
    el("div", { class: "columns" }, residuals.map((residual) => el("figure", {},
      el("figcaption", { class: "small" }, residual.test),
      residualChart({ ...residual, label: `Mean residual of ${members.length} valves, ${residual.test}` })))));
}

function shown(answer) {
  const { groups, alone, compared, unexplained, good_valves: good } = answer;
  if (unexplained === 0) return [el("p", { class: "empty" }, "No valve of this lot is unexplained.")];
  if (unexplained === 1) return [el("p", {}, "One valve is unexplained: ", link(alone[0]), ". A pattern needs two.")];
  const scope = `${compared < unexplained ? `The newest ${compared} of ${unexplained}` : unexplained} unexplained valves were compared`;
  const beyond = good ? `, beyond what ${counted(good, "valve")} ${good === 1 ? "leaves" : "leave"} in which nothing is wrong` : "";
  return [
    el("p", { class: "small" }, `${scope}${beyond}. In brackets: how typical the valve is of its group. Lines: mean residual; tinted: one standard deviation of the members`,
      good ? "; dashed: the good valves." : "."),
    groups.length ? groups.map((group, i) => patternGroup(group, i + 1)) : el("p", {}, "No two of them leave the same residual over time."),
    alone.length ? el("p", {}, groups.length ? "Like no other: " : "They are: ", alone.map((valve, i) => [i ? ", " : "", link(valve)]), ".") : null,
  ].flat().filter(Boolean);
}

/// Loads into its place after the view is shown.
export function patternsPart(path, signal) {
  const place = el("div", { class: "later" }, el("p", { class: "empty" }, "Comparing the residuals of unexplained valves …"));
  return { node: place, shown: () => get(`${path}/patterns`, signal).then((answer) => place.replaceChildren(...shown(answer))).catch((error) => {
    if (!signal.aborted) place.replaceChildren(el("p", { class: "mistake" }, error.message));
  }) };
}
