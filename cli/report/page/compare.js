// Traces side by side, a column each.

import { by, el } from "./dom.js";
import { count, quantile, share } from "./format.js";
import { titleOf, verdictOf } from "./summary.js";

/** More columns than these are a table of their own. */
const MOST = 4;

/** Shows the table, if there are two traces or a few more. */
export function showComparison(traces) {
  const shows = traces.length > 1 && traces.length <= MOST;
  by("compared").hidden = !shows;
  if (!shows) return;
  const rows = [
    ["Verdict", verdictOf],
    ["Messages", ({ account }) => count(account.messages)],
    ["Forwarded", ({ account }) => share(account.forwarded, account.messages)],
    ["Missed", ({ account }) => share(account.missed, account.messages)],
    ["Response p50", ({ account }) => quantile(account.response[0])],
    ["Response p90", ({ account }) => quantile(account.response[1])],
    ["Response p99", ({ account }) => quantile(account.response[2])],
    ...served(traces), ...scores(traces), ...settings(traces),
  ];
  by("comparison").replaceChildren(
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, ""), ...traces.map((trace) => el("th", { scope: "col", title: trace.file }, titleOf(trace))))),
    el("tbody", {}, ...rows.map(([name, of]) => {
      const cells = traces.map(of);
      const same = cells.every((cell) => cell === cells[0]);
      return el("tr", { class: same ? "same" : "" }, el("th", { scope: "row" }, name), ...cells.map((cell) => el("td", {}, cell ?? "–")));
    })));
}

const unique = (all) => [...new Set(all)];
const nameOf = ({ p, name }) => name ?? (p === 0 ? "local" : `cloud ${p}`);

/** The share of each source, by its name. */
const served = (traces) => unique(traces.flatMap(({ sources }) => sources.map(nameOf))).map((name) => [`By ${name}`, ({ sources, account }) => {
  const rows = account.rows.filter(({ place }) => nameOf(sources[place]) === name);
  return rows.length === 0 ? undefined : share(rows.reduce((sum, { counts: [, forwarded] }) => sum + forwarded, 0), account.messages);
}]);

/** Returns fusion's figures: for each column of the table of policies, its name and how to find its value. */
function scores(traces) {
  const columns = unique(traces.flatMap(({ run }) => run?.policies.columns.slice(1) ?? []));
  return columns.map((column) => [`Fusion: ${column}`, ({ run }) => run?.policies.rows[0]?.[run.policies.columns.indexOf(column)]]);
}

const settings = (traces) => unique(traces.flatMap(({ run }) => run?.configuration.map(([name]) => name) ?? []))
  .map((name) => [name, ({ run }) => run?.configuration.find(([known]) => known === name)?.[1]]);
