// One valve: its verdict, what the simulation gets wrong, its recordings, what teardown found, its history.
import { get, post, save } from "./api.js";
import { bodeChart } from "./bode_chart.js";
import { alarmList, currentAlarms } from "./compare_view.js";
import { address, el, keepInAddress, section } from "./dom.js";
import { reportLink } from "./report_link.js";
import { follow } from "./events.js";
import { findingsPart } from "./findings.js";
import { asTold, bytes, conclusionBeside, counted, featureWords, figure, isFinal, percent, quantity, scaled, spoken, time, unbroken, verdictMark, withDeviation } from "./format.js";
import { barRow, gainBars } from "./gain_bar.js";
import { sessionColumns } from "./list_view.js";
import { recordingPlots } from "./plots.js";
import { table } from "./table.js";

const LIMITS = { good: "good", malfunctioned: "malfunctioned", severe: "severe" };

function facts(pairs) {
  return el("dl", { class: "facts" }, pairs.filter(([, value]) => value).map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
}

function membershipBars(memberships, caption) {
  return el("table", { class: "bars" }, el("caption", {}, caption), el("tbody", {},
    Object.keys(LIMITS).filter((name) => name in memberships)
      .map((name) => barRow(spoken(name), name, memberships[name] ?? 0, figure(memberships[name], 2)))));
}

function levelTable(analysis) {
  const unit = analysis.baseline.model.output_unit ?? "";
  const levels = analysis.simulation.by_level;
  const has_bandwidth = levels.some((l) => typeof l.bandwidth_hz === "number");
  return table([
    { title: "Level", unit: "A", value: (l) => l.level_A, show: (l) => l.level_A.toFixed(2), number: true },
    { title: "Error (Eq 20)", unit: unit ? `${unit}/s` : "", value: (l) => l.error_eq20, show: (l) => figure(l.error_eq20), number: true },
    { title: "Settling error", unit, value: (l) => l.settling_error, show: (l) => figure(l.settling_error), number: true },
    { title: "Rise time", unit: "s", value: (l) => l.rise_time_s, show: (l) => figure(l.rise_time_s), number: true },
    ...(has_bandwidth ? [{ title: "Bandwidth", unit: "Hz", value: (l) => l.bandwidth_hz, show: (l) => figure(l.bandwidth_hz), number: true }] : []),
  ], levels, { caption: "Step response by current level, against the mean good valve", empty: "No recording steps to a known level." });
}

const PAPER_LEVELS = { low: 1.4, high: 1.6 }; // rule_base.schema.json
const levelCurrent = (name) => PAPER_LEVELS[name] ?? Number(name);

function ruleLists(classification) {
  const levels = Object.entries(classification.per_level ?? {}).sort(([a], [b]) => levelCurrent(a) - levelCurrent(b));
  if (levels.length === 0) return null;
  const base = classification.rule_base;
  return el("details", {}, el("summary", {}, "Rules that fired"),
    levels.map(([name, level]) => [
      el("h3", {}, `${levelCurrent(name).toFixed(1)} A${name in PAPER_LEVELS ? ` (${name})` : ""}: `, verdictMark(level.verdict)),
      el("ul", {}, level.rules.filter((rule) => rule.strength > 0)
        .map((rule) => el("li", {}, `${rule.rule} – strength ${figure(rule.strength, 2)}`)))]),
    base ? el("p", { class: "small" }, `Rule base ${base.name}, version ${base.version}, sha256 `, el("code", {}, base.sha256.slice(0, 12))) : null);
}

/// The verdict stands before the sentence as a mark already.
function withoutFirstWord(sentence, verdict) {
  const rest = sentence.slice((verdict ?? "No verdict").length).replace(/^[:.]\s*/, "");
  return rest ? rest[0].toUpperCase() + rest.slice(1) : "";
}

function verdictPart(analysis, summary) {
  const { classification } = analysis;
  const shown = Object.values(classification.memberships ?? {}).some((value) => value > 0);
  return section("Verdict",
    el("p", {}, el("span", { class: "big" }, verdictMark(classification.verdict)), " ", withoutFirstWord(summary.verdict, classification.verdict)),
    el("div", { class: shown ? "columns judged" : "columns" },
      shown ? membershipBars(classification.memberships, "Membership, worst level") : null,
      levelTable(analysis)),
    ruleLists(classification));
}

/// What good valves show of it: nothing at all where none of them has it.
function goodValves({ mean, sd }) {
  if (typeof mean !== "number") return "–";
  return mean === 0 && !(sd > 0) ? "none" : withDeviation(mean, sd);
}

function parameterTable(cause, recordings) {
  const rows = Object.entries(cause.parameters).map(([name, p]) => {
    if (name === "recording") return { name, value: recordings[Math.round(p.value)]?.name ?? "–" }; // its index is nobody's name
    if (name === "ahead_of_map") return { name, value: p.value ? "yes: coil or spool" : "no: pressure or gauge" };
    if (name === "spool_stops") return { name, value: p.value ? "yes: the spool" : "no: a relief, or the reading is clipped" };
    const [factor, unit] = typeof p.value === "string" ? [1, p.unit] : scaled(p.value, p.unit);
    const times = (value) => (typeof value === "number" ? value * factor : value);
    return { name, unit, value: times(p.value), se: times(p.std_error), low: times(p.ci95?.[0]), high: times(p.ci95?.[1]),
      mean: times(p.population_mean), sd: times(p.population_sd) };
  });
  if (rows.length === 0) return null;
  return table([
    { title: "Parameter", value: (r) => r.name, show: (r) => el("code", {}, r.name) },
    { title: "Value", value: (r) => r.value, show: (r) => (typeof r.value === "string" ? r.value : asTold(r.value, r.se)), number: true },
    { title: "±", value: (r) => r.se, show: (r) => asTold(r.se, r.se), number: true },
    { title: "95 % from", value: (r) => r.low, show: (r) => asTold(r.low, r.se), number: true },
    { title: "to", value: (r) => r.high, show: (r) => asTold(r.high, r.se), number: true },
    { title: "Unit", value: (r) => r.unit, show: (r) => r.unit || "–" },
    { title: "Good valves", value: (r) => r.mean, show: (r) => (goodValves(r)), number: true },
  ], rows, { caption: `Parameters of ${spoken(cause.cause).toLowerCase()}` });
}

function causePart(cause, sentence, recordings) {
  return el("article", { class: "cause" },
    el("h3", {}, spoken(cause.cause), el("span", { class: "chip" }, percent(cause.probability)),
      el("span", { class: "chip" }, { valve: "valve", stand: "stand", either: "valve or stand" }[cause.origin])),
    el("p", {}, sentence),
    cause.alternatives.length ? el("p", {}, "Rivals: ", cause.alternatives.map((a) => el("span", { class: "chip" }, spoken(a)))) : null,
    parameterTable(cause, recordings),
    cause.evidence.length ? el("details", {}, el("summary", {}, "Evidence"), el("ul", {}, cause.evidence.map((line) => el("li", {}, line)))) : null);
}

function candidateTable(candidates) {
  const words = { tested: "tested", not_excited: "not excited", not_identifiable: "cannot be told here" };
  return el("details", {}, el("summary", {}, `All ${candidates.length} explanations that were considered`), table([
    { title: "Explanation", value: (c) => spoken(c.cause) },
    { title: "Probability", value: (c) => c.probability, show: (c) => (c.status === "tested" ? percent(c.probability) : "–"), number: true },
    { title: "Status", value: (c) => words[c.status] },
    { title: "Why", value: (c) => c.reason },
  ], candidates, { caption: "Candidates, each as the whole explanation: a cause's own probability adds up all it stands in" }));
}

function findingTable(findings) {
  if (findings.length === 0) return null;
  return el("details", {}, el("summary", {}, "What the residual depends on"), table([
    { title: "On", value: (f) => f.what },
    { title: "Where", value: (f) => f.where },
    { title: "Share", value: (f) => f.share_of_structured_residual, show: (f) => percent(f.share_of_structured_residual), number: true },
    { title: "p", value: (f) => f.p_value, show: (f) => figure(f.p_value, 2), number: true },
  ], findings, { caption: "Structure in the residual" }));
}

/// The gain on a kind of test that the causes were not fitted to.
function transferTable(transfer, unit) {
  if (!transfer?.length) return null;
  return el("details", {}, el("summary", {}, "What carries over to tests it was not fitted to"), table([
    { title: "Fitted on", value: (t) => t.from },
    { title: "Run on", value: (t) => t.to },
    { title: "Simulation", unit, value: (t) => t.rmse_baseline, show: (t) => figure(t.rmse_baseline), number: true },
    { title: "With the causes", unit, value: (t) => t.rmse_extended, show: (t) => figure(t.rmse_extended), number: true },
  ], transfer, { caption: "Error (rms) of the free run" }));
}

function nextTestPart(test, sentence, name) {
  if (!sentence) return null;
  const file = `${name}-next-test.csv`;
  return el("p", { class: "next" }, sentence, " ",
    test?.input_csv ? el("button", { type: "button", onclick: () => save(file, new Blob([test.input_csv], { type: "text/csv" })) }, "Download its current") : null);
}

function discrepancyPart(analysis, summary, name) {
  const found = analysis.discrepancy;
  const title = "What the simulation gets wrong";
  if (!found) return section(title, el("p", {}, summary.discrepancy));
  const unit = analysis.baseline.model.output_unit ?? "";
  return section(title,
    el("p", { class: `conclusion ${found.conclusion}` }, el("strong", {}, conclusionBeside(found.conclusion, analysis.classification.verdict)), " ", summary.discrepancy, " ", summary.fault),
    el("div", { class: "columns uneven" },
      el("div", {}, found.causes.map((cause, i) => causePart(cause, summary.causes[i] ?? "", analysis.recordings))),
      found.causes.length ? gainBars(found.gain, unit) : null),
    summary.gain ? el("p", {}, summary.gain) : null,
    nextTestPart(found.next_test, summary.next_test, name),
    transferTable(found.gain.transfer, unit),
    findingTable(found.findings),
    summary.upper_limits.length ? el("details", {}, el("summary", {}, "What these recordings exclude"), el("ul", {}, summary.upper_limits.map((line) => el("li", {}, line)))) : null,
    candidateTable(found.candidates));
}

function qualityList(summary) {
  if (summary.quality.length === 0) return el("p", { class: "small" }, "Nothing odd about this recording.");
  return el("ul", { class: "quality" }, summary.quality.map((item) => el("li", {}, el("strong", {}, spoken(item.code)), `, ${counted(item.count, "sample")}: ${item.detail}`)));
}

const CSV_POINTS = 20000; // the service gives no more at a time

/// samples  of the recording where they are known; simulations  what there is: none, or simulated, or extended as well
function downloadLinks(recording, samples, { simulated, extended }) {
  const csv = (what) => el("button", { type: "button", class: "link", onclick: () => save(`${recording.name}-${what}.csv`, `${recording.links.series}?what=${what}&points=${CSV_POINTS}&format=csv`) }, `${what.replace("_", " ")} (CSV)`);
  return el("p", { class: "downloads" },
    el("button", { type: "button", class: "link", onclick: () => save(recording.name, recording.links.raw) }, `raw file (${bytes(recording.size_bytes)})`),
    ["measured", ...(simulated ? ["simulated", "residual"] : []), ...(extended ? ["extended", "extended_residual"] : [])].map(csv),
    samples > CSV_POINTS ? el("span", { class: "small" }, `CSV of ${CSV_POINTS} points that keep every extreme; all ${samples} samples are in the raw file.`) : null);
}

/// Gain and phase where the recording is a sweep, with the figures read off them.
function responsePart(analysis, recording) {
  const entry = analysis?.frequency_response.find((response) => response.recordings?.includes(recording.sha256));
  if (!entry) return null;
  const { input_unit: input, output_unit: output } = analysis.baseline.model;
  const chart = bodeChart(entry, output && input ? `${output}/${input}` : "");
  const features = Object.entries(entry.features ?? {}).filter(([, f]) => typeof f.value === "number");
  return el("div", {}, el("h3", {}, "Frequency response"), chart ?? el("p", { class: "empty" }, entry.refused || "No frequency response could be measured."),
    features.length ? facts(features.map(([name, f]) => {
      const [words, unit] = featureWords(name);
      return [words, `${quantity(f.value, unit)}${f.std_error ? ` ± ${quantity(f.std_error, unit)}` : ""}`];
    })) : null);
}

const WORST_FIT = -1e6; // stands for minus infinity: of an output that does not change there is no fit
const CLEARLY_MISSED = 1.5; // times the noise: more than good valves differ by

/// The recordings, one of them drawn; the choice and the visible range stand in the address.
function recordingsPart(submission, analysis, parameters, signal) {
  const summaries = new Map((analysis?.recordings ?? []).map((r) => [r.sha256, r]));
  const figures = new Map((analysis?.simulation.per_recording ?? []).map((r) => [r.name, r]));
  const unit = analysis?.baseline.model.output_unit ?? "";
  const holder = el("div", { class: "drawn" });
  let drawing = new AbortController();
  signal.addEventListener("abort", () => drawing.abort());

  function draw(recording, range) {
    drawing.abort();
    drawing = new AbortController();
    for (const radio of choices) radio.checked = radio.value === recording.id;
    const summary = summaries.get(recording.sha256);
    const numbers = figures.get(recording.name);
    const model = (document) => JSON.stringify(document ?? null);
    const extended = Boolean(analysis) && model(analysis.extended_model) !== model(analysis.baseline.model);
    const plots = analysis ? recordingPlots(recording, { extended, range, signal: drawing.signal }) : null;
    holder.replaceChildren(
      facts([["Test", summary?.test ?? recording.test], ["Samples", summary ? `${summary.samples} at ${figure(summary.sample_rate_hz, 4)} Hz` : null],
        ["Error of the simulation", numbers ? `${quantity(numbers.rmse, unit)} rms` : null],
        ["Noise alone", numbers ? `${quantity(numbers.noise_floor, unit)} rms` : null], ["Fit", numbers && numbers.fit_percent > WORST_FIT ? `${figure(numbers.fit_percent, 4)} %` : null]]),
      plots?.node ?? "", responsePart(analysis, recording) ?? "", summary ? qualityList(summary) : "", downloadLinks(recording, summary?.samples ?? 0, { simulated: Boolean(analysis), extended }));
    plots?.shown();
  }

  const choices = submission.recordings.map((recording) => el("input", { type: "radio", name: "recording", value: recording.id,
    onchange: () => {
      keepInAddress({ recording: recording.id, from: null, to: null });
      draw(recording, null);
    } }));
  // Without a choice the recording that the simulation misses most, where there is anything to see; else a step.
  const missed = (recording) => {
    const numbers = figures.get(recording.name);
    return numbers && numbers.noise_floor > 0 ? numbers.rmse / numbers.noise_floor : 0;
  };
  const most = submission.recordings.reduce((worst, recording) => (missed(recording) > missed(worst) ? recording : worst), submission.recordings[0]);
  const something = most && missed(most) > CLEARLY_MISSED;
  const chosen = submission.recordings.find((r) => r.id === parameters.get("recording")) ?? (something ? most : null)
    ?? submission.recordings.find((r) => summaries.get(r.sha256)?.test === "step") ?? submission.recordings[0];
  const range = parameters.has("from") ? { from: Number(parameters.get("from")), to: Number(parameters.get("to")) } : null;
  return {
    node: section("Recordings",
      el("fieldset", { class: "choices" }, el("legend", {}, "Recording"),
        submission.recordings.map((recording, i) => el("label", {}, choices[i], " ", recording.name))),
      analysis?.baseline.kind === "reference"
        ? el("p", { class: "small" }, "Simulated is a good valve with the parameters of this one, as far as good valves differ. The errors of the steps above are against the mean good valve instead.")
        : null,
      holder),
    shown: () => chosen && draw(chosen, range),
  };
}

/// The state of a session without a result: progress, or what was wrong with its files.
function waitingPart(submission, job, again, signal) {
  const bar = el("progress", { max: "1", "aria-label": "Progress of the analysis" });
  const note = el("span", { role: "status" });
  const showJob = (row) => {
    bar.value = row.progress;
    note.textContent = ` ${row.state}${row.progress_note ? `: ${row.progress_note}` : ""}`;
  };
  showJob(job);
  const look = async (changed) => {
    if (changed && !changed.has(job.id)) return;
    const row = await get(`/v1/jobs/${job.id}`, signal);
    showJob(row);
    if (isFinal(row.state)) again();
  };
  return { node: section("Analysis", el("p", {}, bar, note)), shown: () => follow(look, signal).catch((error) => {
    if (!signal.aborted) note.textContent = error.message;
  }) };
}

/// What was wrong and in which file: "steps.csv: line 51, column 3 (pressure_psi): 'n/a' is not a number".
export function problemText(problem) {
  if (!problem) return "";
  const at = [problem.line ? `line ${problem.line}` : null, problem.column ? `column ${problem.column}` : null].filter(Boolean);
  const file = problem.file && !problem.detail?.includes(problem.file) ? `${problem.file}: ` : "";
  return `${file}${problem.detail}${at.length && !problem.detail?.includes("line") ? ` (${at.join(", ")})` : ""}`;
}

/// One file's mistake ends the whole session, and every recording carries it: it is said once, with the file's name.
function failedPart(submission) {
  const said = [...new Set([submission.error, ...submission.recordings.map((r) => r.error)].filter(Boolean).map(problemText))];
  return section("No result", el("p", { class: "conclusion unexplained" }, el("strong", {}, spoken(submission.state)), " ", said.join("; "),
    submission.state === "rejected" && submission.error?.file && submission.recordings.length > 1 ? el("span", { class: "small" }, " Mend that file and send the session again.") : null));
}

/// A later analysis that gave nothing: what is shown is the one before.
function oldResultPart(job) {
  return el("p", { class: "conclusion unexplained" }, el("strong", {}, `The newest analysis: ${job.state}.`), " ", problemText(job.error), " Shown is the result before it.");
}

function head(submission, analysis, sessions, again, status) {
  const name = submission.serial ?? "Valve without serial";
  const base = submission.links.self;
  const reanalyze = async () => {
    try {
      await post(`${base}/reanalyze`);
      again();
    } catch (error) {
      status.textContent = error.message;
    }
  };
  return el("div", {},
    el("h1", {}, name),
    facts([["Same serial", submission.serial ? el("a", { href: address("serial", submission.serial) }, counted(sessions, "session")) : null],
      ["Lot", submission.lot ? el("a", { href: address("lot", submission.lot) }, submission.lot) : null], ["Type", submission.valve_type],
      ["Stand", submission.stand], ["Condition", submission.condition], ["Received", time(submission.received_at)],
      ["Baseline", analysis?.baseline.reason]]),
    el("p", { class: "downloads" },
      analysis ? reportLink(name, `${base}/report`) : null,
      analysis ? el("button", { type: "button", class: "link", onclick: () => save(`${name}.json`, `${base}/analysis`) }, "analysis (JSON)") : null,
      isFinal(submission.state) ? el("button", { type: "button", class: "link", onclick: reanalyze }, "analyse again") : null, status));
}

async function result(submission, signal) {
  if (submission.state !== "done") return null;
  const [analysis, summary] = await Promise.all([get(`${submission.links.self}/analysis`, signal), get(`${submission.links.self}/summary`, signal)]);
  const whole = (said) => (Array.isArray(said) ? said.map(unbroken) : unbroken(said));
  return { analysis, summary: Object.fromEntries(Object.entries(summary).map(([name, said]) => [name, whole(said)])) };
}

function makingPart(analysis, analyses) {
  const columns = [
    { title: "Made", value: (a) => a.created_at, show: (a) => time(a.created_at) },
    { title: "Verdict", value: (a) => a.verdict, show: (a) => verdictMark(a.verdict) },
    { title: "Engine", value: (a) => a.engine_version },
    { title: "Settings", value: (a) => a.settings_sha256, show: (a) => el("code", { title: a.settings_sha256 }, a.settings_sha256.slice(0, 12)) },
    { title: "Result", value: (a) => a.result_sha256, show: (a) => el("code", { title: a.result_sha256 }, a.result_sha256.slice(0, 12)) },
  ];
  return section("How it was made",
    table(columns, analyses, { caption: "All analyses of this session; nothing is overwritten" }),
    el("details", {}, el("summary", {}, "Input files"), el("ul", {}, analysis.recordings.map((r) => el("li", {}, `${r.name} `, el("code", {}, r.sha256))))));
}

export async function showValve({ argument, parameters, signal, again }) {
  const submission = await get(`/v1/submissions/${encodeURIComponent(argument)}`, signal);
  const [found, job, analyses, findings, stands] = await Promise.all([
    result(submission, signal), get(`/v1/jobs/${submission.job_id}`, signal),
    submission.state === "done" ? get(`${submission.links.self}/analyses`, signal) : { items: [] },
    submission.serial ? findingsPart(submission.serial, signal) : null,
    submission.stand ? get("/v1/stands", signal) : { items: [] }]);
  const alarms = currentAlarms(stands.items.filter((stand) => stand.stand === submission.stand));
  const name = submission.serial ?? submission.id;
  const parts = [head(submission, found?.analysis, findings?.valve.submissions.length ?? 1, again, el("span", { role: "status" })),
    alarmList(alarms)];
  const later = [];
  const add = (part) => {
    parts.push(part.node);
    later.push(part.shown);
  };
  if (!isFinal(job.state)) add(waitingPart(submission, job, again, signal));
  if (found && isFinal(job.state) && job.state !== "done") parts.push(oldResultPart(job));
  if (isFinal(submission.state) && !found) parts.push(failedPart(submission));
  if (found) parts.push(verdictPart(found.analysis, found.summary), discrepancyPart(found.analysis, found.summary, name));
  add(recordingsPart(submission, found?.analysis, parameters, signal));
  if (findings) parts.push(section("Teardown", findings.node));
  if (found) parts.push(makingPart(found.analysis, analyses.items));
  return { node: el("div", {}, parts), title: name, shown: () => later.forEach((start) => start()) };
}

/// Every session of one serial number, and what teardown found.
export async function showSerial({ argument, signal }) {
  const { valve, node } = await findingsPart(argument, signal);
  return {
    node: el("div", {}, el("h1", {}, `History of ${argument}`),
      section("Sessions", table(sessionColumns, valve.submissions, { caption: "Sessions of this serial, newest first", empty: "This serial has no recordings." })),
      section("Teardown", node)),
    title: argument,
  };
}
