// All traces of the page, a row each.

import { by, el, swatch } from "./dom.js";
import { count, quantile, share } from "./format.js";
import { colourOf, verdictOf, violationsOf } from "./summary.js";

/** Of a longer path the end is shown. */
const LONG = 36;

/** Shows the rows; `choose` takes the number of a trace. */
export function showTraces(traces, choose) {
  by("several").hidden = traces.length < 2;
  const bad = traces.filter((trace) => violationsOf(trace)).length;
  const unsure = traces.filter((trace) => !trace.conforms).length - bad;
  const found = [bad && `${count(bad)} ${bad === 1 ? "does" : "do"} not conform`, unsure && `${count(unsure)} in doubt`].filter(Boolean);
  by("several-title").textContent = `${count(traces.length)} traces: ${found.join(", ") || "all conform"}`;
  const folder = common(traces.map(({ file }) => file));
  const head = ["Trace", "Verdict", "Worst violation", "Messages", "Served by", "p50", "p90", "p99"];
  by("traces").replaceChildren(
    el("thead", {}, el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...traces.map((trace, number) => row(trace, folder, () => choose(number)))),
  );
}

/** Marks the one that is shown below. */
export function markTrace(number) {
  for (const [at, one] of [...by("traces").tBodies[0].rows].entries()) {
    one.classList.toggle("shown", at === number);
    one.querySelector("button").setAttribute("aria-pressed", String(at === number));
  }
}

function row(trace, folder, act) {
  const { file, operator, conforms, doubts, account: { messages, response } } = trace;
  const path = file.slice(folder);
  const name = path.length > LONG ? `…${path.slice(1 - LONG)}` : path;
  const button = el("button", { type: "button", title: `${file}: ${verdictOf(trace)}`, onclick: act }, operator ? `${operator} · ${name}` : name);
  const unsure = doubts.map(({ kind }) => kind).join(", ");
  const verdict = violationsOf(trace) ? `✕ ${count(violationsOf(trace))}` : conforms ? "✓ conforms" : `? ${unsure}`;
  const breach = worst(trace.violations);
  return el("tr", {},
    el("th", { scope: "row" }, button),
    el("td", { class: colourOf(trace) }, verdict),
    el("td", { title: breach?.sentence }, breach ? `${breach.rule}, line ${count(breach.line)}` : "–"),
    el("td", {}, count(messages)),
    el("td", {}, ...served(trace)),
    ...response.map((ns) => el("td", {}, quantile(ns))));
}

/** Returns the length of the folders that all paths begin with. */
function common([first, ...others]) {
  let at = first.lastIndexOf("/") + 1;
  while (at > 0 && !others.every((other) => other.startsWith(first.slice(0, at)))) at = first.lastIndexOf("/", at - 2) + 1;
  return at;
}

/** The one that is latest, if lateness is stated; else the first, from which others may follow. */
function worst(violations) {
  return violations.reduce((worst, one) => (worst && (one.late ?? 0) <= (worst.late ?? 0) ? worst : one), undefined);
}

/** Shows whose results went out: a bar of their shares, and the shares in words. */
function served({ sources, account: { messages, missed, rows } }) {
  if (messages === 0) return ["–"];
  const parts = rows.map(({ place, counts: [, forwarded] }) => ({
    name: sources[place].name ?? (sources[place].p === 0 ? "local" : `cloud ${sources[place].p}`), part: forwarded, of: swatch(place).style.getPropertyValue("--of"),
  }));
  parts.push({ name: "missed", part: missed, of: "var(--bad)" });
  const shown = parts.filter(({ part }) => part > 0);
  const bar = el("span", { class: "track", "aria-hidden": "true" }, ...shown.map(({ part, of }) => {
    const piece = el("span", { class: "share" });
    piece.style.width = `${(100 * part) / messages}%`;
    piece.style.background = of;
    return piece;
  }));
  const words = shown.sort((a, b) => b.part - a.part).map(({ name, part }) => `${name} ${share(part, messages)}`).join(", ");
  return [bar, el("span", { class: "why" }, words || "none")];
}
