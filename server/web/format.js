// Numbers with units, times, and the few words for states and verdicts.
import { el } from "./dom.js";

export function figure(value, digits = 3) {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replace("e+", "e");
  const text = value.toPrecision(digits);
  return text.includes("e") ? String(Math.round(value)) : text;
}

/// With as many decimals as two digits of an uncertainty above 0 have.
function toTwoDigitsOf(uncertainty, value) {
  return value.toFixed(Math.max(0, 1 - Math.floor(Math.log10(uncertainty)))).replace(/^-(0(\.0*)?)$/, "$1");
}

/// A mean with its standard deviation, as far as the deviation's two digits tell: "0.00 ± 0.16".
export function withDeviation(mean, deviation) {
  if (!(deviation > 0) || deviation >= 100 || deviation < 1e-4) return `${figure(mean)} ± ${figure(deviation, 2)}`;
  return `${toTwoDigitsOf(deviation, mean)} ± ${toTwoDigitsOf(deviation, deviation)}`;
}

/// A number as far as two digits of its uncertainty tell; three digits where it has none: 1.63471 of ± 0.00053.
export function asTold(value, uncertainty) {
  if (typeof value !== "number" || !(uncertainty >= 1e-5) || uncertainty >= 1e6 || Math.abs(value) >= 1e6) return figure(value);
  return toTwoDigitsOf(uncertainty, value);
}

/// The number and unit a person would write: 0.0183 A is 18.3 mA.
export function scaled(value, unit) {
  const small = typeof value === "number" && value !== 0 && Math.abs(value) < 0.1;
  return small && ["A", "s", "A/s"].includes(unit) ? [1000, `m${unit}`] : [1, unit];
}

export function quantity(value, unit) {
  if (typeof value === "string") return value;
  const [factor, shown] = scaled(value, unit);
  return `${figure(typeof value === "number" ? value * factor : value)}${shown ? ` ${shown}` : ""}`;
}

export function percent(probability) {
  if (typeof probability !== "number") return "–";
  if (probability > 0.99) return ">\u00a099\u00a0%";
  if (probability < 0.01) return "<\u00a01\u00a0%";
  return `${Math.round(100 * probability)}\u00a0%`; // sign and number stay on one line
}

const local = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

/// Local time; UTC on hover.
export function time(text) {
  if (!text) return "–";
  return el("time", { datetime: text, title: `${text.replace("T", " ").replace("Z", "")} UTC` }, local.format(new Date(text)));
}

export function spoken(name) {
  if (!name) return "";
  const text = name.replaceAll("_", " ").replaceAll("+", " + ");
  return text[0].toUpperCase() + text.slice(1);
}

const FEATURE_UNITS = { hz: "Hz", db: "dB", db_per_decade: "dB/decade", deg: "°", s: "s" };

/// A feature of a frequency response in words, and its unit: its name ends in it.
export function featureWords(name) {
  const [, stem, unit] = /^(.*?)_(hz|db_per_decade|db|deg|s)$/.exec(name) ?? [null, name, ""];
  return [spoken(stem), FEATURE_UNITS[unit] ?? ""];
}

/// A sentence in which no line ends between a number and its unit.
export const unbroken = (text) => text.replaceAll(/(\d) (?=%|[mk]?A\b|m?s\b|psi\b|Hz\b)/g, "$1\u00a0");

/// "1 valve", "2 valves".
export const counted = (count, singular, plural = `${singular}s`) => `${count} ${count === 1 ? singular : plural}`;

export function bytes(count) {
  if (count < 1e3) return `${count} B`;
  return count < 1e6 ? `${figure(count / 1e3)} kB` : `${figure(count / 1e6)} MB`;
}

// A sign beside every colour: the page is read in grey and by colour-blind eyes as well.
const SIGNS = { Good: "●", Malfunctioned: "▲", Severe: "■" };

export function verdictMark(verdict) {
  if (!verdict) return el("span", { class: "verdict none" }, "no verdict");
  return el("span", { class: `verdict ${verdict.toLowerCase()}` }, el("span", { "aria-hidden": "true" }, SIGNS[verdict] ?? "◆"), ` ${verdict}`);
}

const CONCLUSIONS = { none: "Nothing wrong", named: "Named", ambiguous: "Not settled", unexplained: "Unexplained" };
/// Whether a name is a cause, or one of the words that stand where no cause is settled.
export const isCause = (name) => !Object.hasOwn(CONCLUSIONS, name) && !["other", "not_analysed"].includes(name);
export const conclusionWords = (conclusion) => CONCLUSIONS[conclusion] ?? "–";
const isJudgedBad = (verdict) => Boolean(verdict) && verdict !== "Good";
/// The same beside a verdict: of a valve that is not good, "nothing wrong" would contradict it.
export const conclusionBeside = (conclusion, verdict) => (conclusion === "none" && isJudgedBad(verdict) ? "No cause found" : conclusionWords(conclusion));

const FOUND = { none: "Nothing wrong", other: "Something else" };
/// What teardown found, in words.
export const foundWords = (name) => FOUND[name] ?? spoken(name);

/// q-value of a name: below 0.001 more digits mean nothing.
export const qValue = (q) => (q < 0.001 ? "q\u00a0<\u00a00.001" : `q\u00a0${figure(q, 2)}`);

/// Every settled cause of a lot's valve with its probability and q-value; without any as in a list.
export function causesCell(valve) {
  if (valve.causes.length === 0) return causeCell(valve);
  return valve.causes.map((c) => `${spoken(c.cause)}, ${percent(c.probability)} (${qValue(c.q_value)})`).join("; ");
}

/// Cause of a row in a list: named plainly only where it is settled.
export function causeCell(row) {
  if (!row.conclusion) return "–";
  if (row.conclusion === "none") return isJudgedBad(row.verdict) ? "no cause found" : "none";
  if (row.conclusion === "unexplained") return "unexplained";
  if (!row.top_cause) return conclusionWords(row.conclusion);
  const likely = `${spoken(row.top_cause)}, ${percent(row.top_cause_probability)}`;
  return row.conclusion === "ambiguous" ? `not settled: ${likely}` : likely;
}

export const isFinal = (state) => !["queued", "running"].includes(state);
