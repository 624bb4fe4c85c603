// Elements of the page. Every text goes in as a text node, so that nothing a file says about itself is ever read as HTML.

/// el("a", {href: "#/lots", class: "x", onclick: f}, "text", node, null, [more])
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  append(element, children);
  return element;
}

export function append(element, children) {
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return element;
}

/// The address of a view: address("valve", "sub_1", {recording: "rec_2"}) is "#/valve/sub_1?recording=rec_2".
export function address(view, argument = null, parameters = {}) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(parameters)) {
    if (value !== null && value !== undefined && value !== "") query.set(name, value);
  }
  const path = argument === null ? view : `${view}/${encodeURIComponent(argument)}`;
  return `#/${path}${query.size ? `?${query}` : ""}`;
}

/// Changes parameters of the present address without leaving the view or adding to the history.
export function keepInAddress(parameters) {
  const [path, query = ""] = location.hash.split("?");
  const all = new URLSearchParams(query);
  for (const [name, value] of Object.entries(parameters)) {
    if (value === null || value === "") all.delete(name);
    else all.set(name, value);
  }
  history.replaceState(null, "", `${path || "#/valves"}${all.size ? `?${all}` : ""}`);
}

export function section(title, ...children) {
  const id = `h-${title.toLowerCase().replaceAll(/[^a-z]+/g, "-")}`;
  return el("section", { "aria-labelledby": id }, el("h2", { id }, title), ...children);
}

/// A field with its label.
export function field(label, input) {
  input.id ||= `f-${label.toLowerCase().replaceAll(/[^a-z]+/g, "-")}`;
  return el("div", { class: "field" }, el("label", { for: input.id }, label), input);
}

export function options(select, values, chosen) {
  for (const [value, text] of values) select.append(el("option", { value, selected: value === chosen }, text));
  return select;
}
