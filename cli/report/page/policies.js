// Shows what the command knows of a run beside its trace: policies over the same messages, configuration, caveats.

import { by, el } from "./dom.js";

/** Shows it, if the trace's run is known. */
export function showPolicies({ run }) {
  by("policies").hidden = !run;
  if (!run) return;
  const { policies: { columns, rows }, configuration, caveats } = run;
  by("scores").replaceChildren(
    el("thead", {}, el("tr", {}, ...columns.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...rows.map(([name, ...cells]) => el("tr", {}, el("th", { scope: "row" }, name), ...cells.map((cell) => el("td", {}, cell))))));
  by("caveats").replaceChildren(...caveats.map((one) => el("li", {}, one)));
  by("configuration").replaceChildren(...configuration.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
}
