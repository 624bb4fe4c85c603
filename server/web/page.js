// The list page: lots and recordings of this server. Every text goes in through textContent, so that nothing a file says
// about itself is ever read as HTML.

const byId = (id) => document.getElementById(id);
let nextCursor = null;

async function fetchJson(path) {
  const token = sessionStorage.getItem("token");
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  const response = await fetch(path, { headers });
  const body = await response.json();
  if (response.ok) return body;
  if (response.status === 401) byId("access").hidden = false;
  throw new Error(body.detail);
}

function addRow(table, cells) {
  const row = table.insertRow();
  for (const cell of cells) {
    const place = row.insertCell();
    if (typeof cell === "number") place.className = "number";
    if (cell instanceof Node) place.append(cell);
    else place.textContent = cell ?? "";
  }
}

function link(text, href) {
  const anchor = document.createElement("a");
  anchor.href = href;
  anchor.textContent = text;
  return anchor;
}

const localTime = (text) => new Date(text).toLocaleString();

async function showLots() {
  const { items } = await fetchJson("/v1/lots?limit=200");
  byId("lots").replaceChildren();
  for (const lot of items) {
    addRow(byId("lots"), [lot.lot, lot.valves, lot.analysed_valves, lot.verdicts.Good ?? 0, lot.verdicts.Malfunctioned ?? 0,
      lot.verdicts.Severe ?? 0, localTime(lot.last_received_at)]);
  }
}

function dataLinks(recording) {
  const span = document.createElement("span");
  span.append(link("raw", recording.links.raw));
  if (recording.links.analysis) span.append(" ", link("analysis", recording.links.analysis));
  return span;
}

async function showRecordings() {
  const cursor = nextCursor ? `&cursor=${encodeURIComponent(nextCursor)}` : "";
  const { items, next } = await fetchJson(`/v1/recordings?limit=100${cursor}`);
  for (const r of items) {
    addRow(byId("recordings"), [localTime(r.received_at), r.name, r.lot, r.serial, r.error?.detail ?? r.state, r.verdict ?? r.reason,
      r.top_cause, dataLinks(r)]);
  }
  nextCursor = next;
  byId("more").hidden = !next;
}

async function show() {
  byId("message").textContent = "";
  byId("recordings").replaceChildren();
  nextCursor = null;
  try {
    await showLots();
    await showRecordings();
  } catch (error) {
    byId("message").textContent = error.message;
  }
}

byId("more").addEventListener("click", showRecordings);
byId("access").addEventListener("submit", (event) => {
  event.preventDefault();
  sessionStorage.setItem("token", byId("token").value);
  byId("token").value = "";
  byId("access").hidden = true;
  show();
});
show();
