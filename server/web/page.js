// The page: the address after # says what is shown, so that every link can be sent.
import { showCompare } from "./compare_view.js";
import { el } from "./dom.js";
import { showList } from "./list_view.js";
import { showLot, showLots } from "./lot_view.js";
import { showTeardown } from "./teardown_view.js";
import { showUpload } from "./upload_view.js";
import { showSerial, showValve } from "./valve_view.js";

const VIEWS = { valves: showList, valve: showValve, serial: showSerial, lots: showLots, lot: showLot, compare: showCompare, teardown: showTeardown, upload: showUpload };

const byId = (id) => document.getElementById(id);
let leaving = new AbortController();

/// "#/valve/sub_1?from=2" is the view "valve" with the argument "sub_1" and the parameters {from: "2"}.
function readAddress() {
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  const [view, ...argument] = path.split("/");
  return { view: view || "valves", argument: decoded(argument.join("/")), parameters: new URLSearchParams(query) };
}

/// What somebody typed into the address may hold a "%" that means itself.
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

function showNavigation(view) {
  const part = { valve: "valves", serial: "valves", lot: "lots" }[view] ?? view;
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#/${part}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

async function show() {
  leaving.abort(new DOMException("left", "AbortError"));
  leaving = new AbortController();
  const { signal } = leaving;
  const { view, argument, parameters } = readAddress();
  byId("message").textContent = "";
  showNavigation(view);
  const viewOf = VIEWS[view];
  try {
    if (!viewOf) throw new Error("There is no such view.");
    document.body.setAttribute("aria-busy", "true");
    const content = await viewOf({ argument, parameters, signal, again: show });
    if (signal.aborted) return;
    byId("view").replaceChildren(content.node);
    document.title = `${content.title} – valvetriage`;
    content.shown?.();
  } catch (error) {
    if (signal.aborted) return;
    byId("message").textContent = error.message;
    byId("view").replaceChildren(el("p", {}, el("button", { type: "button", onclick: show }, "Try again"), " or go to ",
      el("a", { href: "#/valves" }, "all valves"), ", ", el("a", { href: "#/lots" }, "all lots"), "."));
  } finally {
    if (!signal.aborted) document.body.removeAttribute("aria-busy");
  }
}

byId("access").addEventListener("submit", (event) => {
  event.preventDefault();
  sessionStorage.setItem("token", byId("token").value);
  byId("token").value = "";
  byId("access").hidden = true;
  show();
});
byId("search").addEventListener("submit", (event) => {
  event.preventDefault();
  const serial = byId("search-serial").value.trim();
  if (serial) location.hash = `#/serial/${encodeURIComponent(serial)}`;
});
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  byId("view").focus();
});
addEventListener("hashchange", () => {
  scrollTo(0, 0);
  show();
});
show();
