// What came of the run, in figures and by source.

import { MISSED, REFUSED, drop } from "./data.js";
import { by, el, swatch } from "./dom.js";
import { count, counted, share, time } from "./format.js";

/** The p-th part of sorted numbers, by the nearest rank. */
export const quantile = (sorted, p) => sorted[Math.max(0, Math.ceil(p * sorted.length) - 1)] ?? NaN;

export function summarise(trace) {
  const { outcome, response, sources, ev, p, a, t, length } = trace;
  const tally = sources.map((source) => ({
    source, outputs: 0, requests: 0, refused: 0, results: 0, late: 0, superseded: 0, dropped: 0, failed: 0, times: [],
  }));
  const ends = { forwarded: 0, missed: 0, open: 0, refused: 0 };
  for (let k = 0; k < outcome.length; k++) {
    if (outcome[k] >= 0) {
      ends.forwarded++;
      tally[outcome[k]].outputs++;
      if (!Number.isNaN(response[k])) tally[outcome[k]].times.push(response[k]);
    } else if (outcome[k] === MISSED) ends.missed++;
    else if (outcome[k] === REFUSED) ends.refused++;
    else ends.open++;
  }
  for (let i = 0; i < length; i++) {
    const of = tally[p[i]];
    if (!of) continue;
    const kind = ev[i];
    if (kind === "q") of.requests++;
    else if (kind === "n") of.refused++;
    else if (kind === "r") of.results++;
    else if (kind === "x") of.failed++;
    else if (kind === "d" && !(ev[i - 1] === "x" && p[i - 1] === p[i] && t[i - 1] === t[i])) {
      of.dropped++;
      if (drop(trace, i)[0] === "late") of.late++;
      if (drop(trace, i)[0] === "superseded") of.superseded++;
    }
  }
  for (const of of tally) of.times = Float64Array.from(of.times).sort();
  const all = new Float64Array(tally.reduce((sum, of) => sum + of.times.length, 0));
  let put = 0;
  for (const { times } of tally) {
    all.set(times, put);
    put += times.length;
  }
  return { tally, ends, all: all.sort() };
}

export function showSummary(trace, { tally, ends, all }) {
  const violations = trace.violations.length + trace.more;
  const verdict = by("verdict");
  verdict.className = `verdict ${trace.conforms ? "good" : "bad"}`;
  verdict.textContent = trace.conforms
    ? "✓ conforms"
    : violations ? `✕ does not conform: ${counted(violations, "violation")}` : "✕ does not conform: nothing to judge";
  const messages = ends.forwarded + ends.missed + ends.open;
  by("figures").replaceChildren(
    ...[
      ["Messages", count(messages), `${count(trace.judged)} judged`],
      ["Forwarded", count(ends.forwarded), share(ends.forwarded, messages)],
      ["Missed", count(ends.missed), share(ends.missed, messages), ends.missed > 0],
      ends.open > 0 && ["Left open", count(ends.open), "as the trace ends"],
      ends.refused > 0 && ["Not opened", count(ends.refused), "refused or never opened"],
      ["Response", time(quantile(all, 0.5)), `p90 ${time(quantile(all, 0.9))}, p99 ${time(quantile(all, 0.99))}`],
      ["Run", time(trace.duration), `${trace.commit}, window ${count(trace.window)}`],
      trace.observed && ["Observed", `± ${time(trace.observed[0])}`, `late by up to ${time(trace.observed[1])}`],
    ].filter(Boolean).map(([name, value, more, bad]) =>
      el("div", { class: bad ? "bad" : "" }, el("dt", {}, name), el("dd", {}, value), el("dd", { class: "more" }, more))),
  );
  const head = ["Source", "Forwarded", "Share", "p50", "p90", "p99", "Requests", "In time", "Late", "Superseded", "Failed", "Refused"];
  by("sources").replaceChildren(
    el("thead", {}, el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...[...tally].sort((a, b) => a.source.place - b.source.place).map((of) => line(of, messages))),
  );
}

function line(of, messages) {
  const { source } = of;
  const bar = el("span", { class: "share", "aria-hidden": "true" });
  bar.style.width = `${messages ? (100 * of.outputs) / messages : 0}%`;
  const local = source.place === 0;
  const cells = [
    ...[0.5, 0.9, 0.99].map((p) => time(quantile(of.times, p))),
    local ? "–" : count(of.requests), count(Math.max(0, of.results - of.dropped)),
    count(of.late), count(of.superseded), count(of.failed), local ? "–" : count(of.refused),
  ];
  const square = swatch(source.place);
  bar.style.background = square.style.getPropertyValue("--of");
  return el("tr", {},
    el("th", { scope: "row" }, square, `${source.p} `, el("span", { class: "label" }, source.label)),
    el("td", {}, count(of.outputs)),
    el("td", { class: "shares" }, el("span", { class: "track" }, bar), el("b", {}, share(of.outputs, messages))),
    ...cells.map((cell) => el("td", {}, cell)));
}

export function showLegend(trace, { tally, ends }) {
  const item = (square, text) => el("span", {}, square, text);
  const mark = (name) => el("span", { class: `mark ${name}`, "aria-hidden": "true" });
  by("legend").replaceChildren(
    ...tally.filter((of) => of.outputs > 0 || of.source.known).map(({ source }) => item(swatch(source.place), source.label)),
    ...(ends.missed ? [item(mark("missed"), "missed")] : []),
    ...(ends.open ? [item(mark("open"), "open")] : []),
    ...(trace.violations.length ? [item(mark("violation"), "violation")] : []),
    item(mark("hit"), "found"),
  );
}
