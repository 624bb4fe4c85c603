// A report opens in a window of its own; where a token is needed, which a link does not carry, it is saved as a file.
import { authorization, save } from "./api.js";
import { el } from "./dom.js";

export function reportLink(name, path) {
  const link = el("a", { href: path, target: "_blank", rel: "noopener", class: "report" }, "report to print");
  link.addEventListener("click", (event) => {
    if (!authorization().Authorization) return;
    event.preventDefault();
    save(`${name}.html`, path);
  });
  return link;
}
