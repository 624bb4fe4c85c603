// Upload: files or folders are dropped, grouped into valves, sent a few at a time, and their analyses followed.
import { Problem, authorization, get, post } from "./api.js";
import { address, append, el, field, options } from "./dom.js";
import { follow } from "./events.js";
import { labelsOf } from "./file_labels.js";
import { bytes, counted, isFinal, verdictMark } from "./format.js";
import { problemText } from "./valve_view.js";

const AT_A_TIME = 3;
const ROWS_AT_ONCE = 40; // listed between two frames
const FILE = /\.(csv|txt|json|mat)(\.gz|\.zst)?$/i;
const MAY_BE_REPEATED = ["failed", "poisoned", "cancelled"];
const LABELS = ["serial", "lot", "valve_type", "stand"];
const CONDITIONS = [["", "as the file says"], ["returned", "returned"], ["new", "new"], ["prototype", "prototype"], ["unknown", "unknown"]];

/// Files of dropped items, folders walked through: [{file, folder}].
async function droppedFiles(items) {
  const found = [];
  const walk = async (entry, folder) => {
    if (entry.isFile) {
      found.push({ file: await new Promise((resolve, reject) => entry.file(resolve, reject)), folder });
      return;
    }
    const reader = entry.createReader();
    for (;;) {
      const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
      if (some.length === 0) return;
      for (const child of some) await walk(child, `${folder}/${entry.name}`);
    }
  };
  for (const entry of [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean)) await walk(entry, "");
  return found;
}

/// Files that belong together: of one folder, else of one lot and serial, else each alone. `unread`: what a file of the
/// group says of itself is not known here.
async function grouped(found) {
  const groups = new Map();
  for (const { file, folder } of found) {
    const read = await labelsOf(file);
    const labels = read ?? {};
    const key = folder || (labels.serial ? `${labels.lot ?? ""}\n${labels.serial}` : `${groups.size} ${file.name}`);
    const group = groups.get(key) ?? groups.set(key, { files: [], labels: {}, folder, unread: false }).get(key);
    group.files.push(file);
    group.labels = { ...labels, ...group.labels };
    if (read === null) group.unread = true;
  }
  return [...groups.values()];
}

/// Sends one group; `onSent` hears the share that is sent. Resolves with the submission.
function send(group, labels, onSent, signal) {
  const form = new FormData();
  for (const file of group.files) form.append("file", file, file.name);
  const query = new URLSearchParams(Object.entries(labels).filter(([, value]) => value));
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `/v1/submissions${query.size ? `?${query}` : ""}`);
    for (const [name, value] of Object.entries(authorization())) request.setRequestHeader(name, value);
    request.setRequestHeader("Idempotency-Key", group.key);
    request.upload.addEventListener("progress", (event) => event.lengthComputable && onSent(event.loaded / event.total));
    request.addEventListener("error", () => reject(new Error("The server cannot be reached. Nothing is lost: try again.")));
    request.addEventListener("load", () => {
      let answer = {};
      try {
        answer = JSON.parse(request.responseText);
      } catch {
        // No document: the status has to do.
      }
      if (request.status < 300) resolve(answer);
      else reject(new Problem(answer, request.status));
    });
    signal.addEventListener("abort", () => request.abort());
    request.send(form);
  });
}

const UNREAD = "waits; the server reads what this file says of itself as it comes in";

/// The row of one valve: its labels, what becomes of it, and a button to try again.
function groupRow(group, defaults) {
  const inputs = Object.fromEntries(LABELS.map((name) => [name, el("input", { value: group.labels[name] ?? "", placeholder: defaults[name].value || (group.unread ? "in the file?" : "–"),
    "aria-label": `${name} of ${group.files[0].name}`, spellcheck: "false" })]));
  const bar = el("progress", { max: "1", value: "0", "aria-label": `progress of ${group.files[0].name}` });
  const status = el("span", {}, group.unread ? UNREAD : "waits");
  const retry = el("button", { type: "button", hidden: true }, "Try again");
  const size = group.files.reduce((sum, file) => sum + file.size, 0);
  const files = group.files.length === 1 ? group.files[0].name : `${group.folder.replace(/^\//, "") || "together"}: ${group.files.length} files`;
  const cell = (attributes, ...content) => el("td", { role: "cell", ...attributes }, ...content);
  const row = el("tr", { role: "row" }, cell({ title: group.files.map((file) => file.name).join("\n") }, files), cell({ class: "number" }, bytes(size)),
    LABELS.map((name) => cell({}, inputs[name])), cell({}, bar, " ", status, " ", retry));
  const say = (...text) => append(status, (status.replaceChildren(), text));
  return {
    row, retry,
    /// Only what the files do not say themselves, or what was changed by hand.
    labels: () => Object.fromEntries(LABELS.map((name) => {
      const typed = inputs[name].value.trim();
      return [name, group.labels[name] ? (typed !== group.labels[name] ? typed : "") : typed || defaults[name].value.trim()];
    })),
    /// What is sent cannot be changed any more; what was refused can.
    fixed: (fixed) => Object.values(inputs).forEach((input) => {
      input.readOnly = fixed;
    }),
    /// What the server read in files that the browser does not open.
    fill: (submission) => group.unread && LABELS.forEach((name) => {
      inputs[name].value = submission[name] ?? "";
      inputs[name].placeholder = "–";
    }),
    progress: (share) => {
      bar.hidden = false;
      bar.value = share;
    },
    say,
    end: (...text) => {
      bar.hidden = true;
      say(...text);
    },
  };
}

function mistake(error) {
  return el("span", { class: "mistake" }, problemText(error.document?.detail ? error.document : null) || error.message);
}

/// Follows the jobs of many submissions by one long poll.
class Jobs {
  #rows = new Map();
  #signal;
  #running = false;

  constructor(signal) {
    this.#signal = signal;
  }

  /// Resolves with the submission when its job has ended.
  ended(submission, row) {
    return new Promise((resolve, reject) => {
      this.#rows.set(submission.job_id, { submission, row, resolve, reject });
      if (this.#running) this.#look(submission.job_id).catch(() => {}); // the follower asks again
      else this.#start();
    });
  }

  async #start() {
    this.#running = true;
    try {
      await follow((changed) => Promise.all([...this.#rows.keys()].filter((id) => !changed || changed.has(id)).map((id) => this.#look(id))), this.#signal);
    } catch (error) {
      for (const { reject } of this.#rows.values()) reject(error);
      this.#rows.clear();
    }
    this.#running = false;
  }

  async #look(id) {
    const { submission, row, resolve, reject } = this.#rows.get(id) ?? {};
    if (!row) return;
    try {
      const job = await get(`/v1/jobs/${id}`, this.#signal);
      row.progress(0.5 + 0.5 * job.progress);
      row.say(job.state === "running" ? `analysing${job.progress_note ? `: ${job.progress_note}` : ""}` : job.state);
      if (!isFinal(job.state)) return;
      const done = await get(`/v1/submissions/${submission.id}`, this.#signal);
      if (this.#rows.delete(id)) resolve(done);
    } catch (error) {
      if (!(error instanceof Problem) || error.status >= 500) throw error; // the follower asks again
      this.#rows.delete(id);
      reject(error);
    }
  }
}

function outcome(submission) {
  const link = el("a", { href: address("valve", submission.id) }, submission.serial ?? "open");
  if (submission.state === "done") return [verdictMark(submission.verdict), " ", link];
  const problems = [submission.error, ...submission.recordings.map((r) => r.error)].filter(Boolean);
  const said = [...new Set(problems.map(problemText))];
  return [el("strong", {}, submission.state), " ", said.map((text) => el("span", { class: "mistake" }, text, " ")), link];
}

export async function showUpload({ signal }) {
  const defaults = Object.fromEntries(LABELS.map((name) => [name, el("input", { spellcheck: "false", autocomplete: "off" })]));
  const condition = options(el("select"), CONDITIONS, "");
  const columns = el("input", { spellcheck: "false", autocomplete: "off", size: "44", placeholder: "time=t_s,input=coil_mA,output=outlet_bar" });
  const rate = el("input", { type: "number", min: "0", step: "any", placeholder: "as the times say" });
  // Rows are boxes of their own, so that what is out of sight is neither laid out nor drawn: hundreds change at a time. A
  // table that is shown so has to say by roles that it is one.
  const body = el("tbody", { role: "rowgroup" });
  const list = el("div", { class: "scroll", hidden: true, tabindex: "0", role: "region", "aria-label": "Valves to upload" },
    el("table", { class: "uploads", role: "table", "aria-label": "Valves to upload" },
      el("thead", { role: "rowgroup" }, el("tr", { role: "row" }, ["Files", "Size", "Serial", "Lot", "Valve type", "Stand", "State"]
        .map((title) => el("th", { role: "columnheader", class: title === "Size" ? "number" : null }, title)))), body));
  const start = el("button", { type: "button", class: "primary", hidden: true }, "Upload");
  const total = el("p", { role: "status" });
  const waiting = [];
  const jobs = new Jobs(signal);
  let ended = 0;
  let all = 0;
  let sending = 0;

  async function run(group, row) {
    row.retry.hidden = true;
    row.fixed(true);
    try {
      row.say("sending");
      const submission = group.failed ?? await send(group, { ...row.labels(), condition: condition.value, columns: columns.value.trim(), sample_rate_hz: rate.value }, (share) => row.progress(0.5 * share), signal);
      row.fill(submission);
      if (group.failed) submission.job_id = (await post(`/v1/submissions/${submission.id}/reanalyze`)).id;
      row.say("queued");
      jobs.ended(submission, row).then((done) => {
        row.fill(done);
        row.end(...outcome(done));
        // A fault that was not the file's: the server has the bytes, so that its analysis is started again.
        group.failed = MAY_BE_REPEATED.includes(done.state) ? done : null;
        row.retry.hidden = !group.failed;
      }, (error) => !signal.aborted && row.end(mistake(error)))
        .finally(() => showTotal(++ended));
    } catch (error) {
      if (signal.aborted) return;
      row.end(mistake(error));
      row.fixed(false);
      row.retry.hidden = false;
    }
  }

  function showTotal() {
    total.textContent = all ? `${ended} of ${counted(all, "valve")} ${all === 1 ? "has" : "have"} ended.` : "";
  }

  async function sendAll() {
    start.hidden = true;
    while (sending < AT_A_TIME && waiting.length > 0) {
      ++sending;
      const { group, row } = waiting.shift();
      run(group, row).finally(() => {
        --sending;
        sendAll();
      });
    }
  }

  async function add(found) {
    const fit = found.filter(({ file }) => FILE.test(file.name));
    const ignored = found.length - fit.length;
    let listed = 0;
    for (const group of await grouped(fit)) {
      if (++listed % ROWS_AT_ONCE === 0) await new Promise((next) => requestAnimationFrame(next));
      group.key = crypto.randomUUID();
      const row = groupRow(group, defaults);
      row.retry.addEventListener("click", () => {
        group.key = crypto.randomUUID();
        if (group.failed) showTotal(--ended);
        waiting.push({ group, row });
        sendAll();
      });
      body.append(row.row);
      waiting.push({ group, row });
      ++all;
    }
    list.hidden = body.rows.length === 0;
    start.hidden = waiting.length === 0;
    start.textContent = `Upload ${counted(waiting.length, "valve")}`;
    total.textContent = ignored ? `${ignored === 1 ? "1 file is no recording" : `${ignored} files are no recordings`} (CSV, JSON or MAT) and ${ignored === 1 ? "was" : "were"} left out.` : "";
  }

  start.addEventListener("click", sendAll);
  const chosen = (input) => add([...input.files].map((file) => ({ file, folder: file.webkitRelativePath.split("/").slice(0, -1).join("/") })));
  const files = el("input", { type: "file", multiple: true, id: "choose-files", onchange: (event) => chosen(event.target) });
  const folder = el("input", { type: "file", webkitdirectory: true, id: "choose-folder", onchange: (event) => chosen(event.target) });
  const zone = el("div", { class: "drop",
    ondragover: (event) => {
      event.preventDefault();
      zone.classList.add("over");
    },
    ondragleave: () => zone.classList.remove("over"),
    ondrop: async (event) => {
      event.preventDefault();
      zone.classList.remove("over");
      add(await droppedFiles(event.dataTransfer.items));
    } },
  el("p", { class: "big" }, "Drop recordings here"),
  el("p", {}, "Files of one folder are one valve's session; other files go together by the lot and serial they name. ",
    "CSV, JSON and MAT, also as .gz, are taken; what a .zst file says of itself the server reads as it comes in, so drop those of one valve as a folder."),
  el("div", { class: "filters" }, field("Choose files", files), field("Choose a folder", folder)));
  const node = el("div", {}, el("h1", {}, "Upload"), zone,
    el("fieldset", { class: "filters" }, el("legend", {}, "For files that do not say so themselves"),
      field("Default serial", defaults.serial), field("Default lot", defaults.lot), field("Default valve type", defaults.valve_type),
      field("Default stand", defaults.stand), field("Condition", condition)),
    el("details", {}, el("summary", {}, "Other columns than time_s, current_A and pressure_psi"),
      el("fieldset", { class: "filters" }, el("legend", {}, "What the columns are called, for all files"),
        field("Columns", columns), field("Sample rate in Hz, where no column is a time", rate)),
      el("p", { class: "small" }, "A unit that ends a name (_mA, _bar, _kPa, _ms) is converted. ",
        "Side channels that may matter are added as side=temperature_C,supply_psi.")),
    list, el("p", {}, start), total);
  return { node, title: "Upload" };
}
