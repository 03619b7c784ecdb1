// Shows the results of the run, in figures and by source, as the command counted them.

import { by, el, swatch } from "./dom.js";
import { count, counted, quantile, share, time } from "./format.js";

const SUMMED = 1;
const OPEN = 6;

/** Returns the name of a trace: its operator and its file, without the folders. */
export function titleOf({ operator, file }) {
  const name = file.slice(file.lastIndexOf("/") + 1);
  return operator ? `${operator} · ${name}` : name;
}

export const violationsOf = ({ violations, places, capped }) => capped?.violations ?? violations.length + (places?.line.length ?? 0);

/** Returns the colour of a verdict: green only without doubt. */
export const colourOf = (trace) => violationsOf(trace) ? "bad" : trace.doubts.length ? "doubt" : "good";

/** A verdict in words. */
export function verdictOf(trace) {
  if (violationsOf(trace)) return `✕ does not conform: ${counted(violationsOf(trace), "violation")}`;
  if (trace.conforms) return trace.doubts.length ? `✓ conforms, accepting ${trace.doubts.map(({ kind }) => kind).join(", ")}` : "✓ conforms";
  return `? no violation found; in doubt: ${trace.doubts.filter(({ accepted }) => !accepted).map(inShort).join(", ")}`;
}

const inShort = ({ kind, count: number }) => `${count(number)} ${kind}`;

export function showSummary(trace) {
  const { account } = trace;
  const { messages, forwarded, missed, refused, open, response } = account;
  const verdict = by("verdict");
  verdict.className = `verdict ${colourOf(trace)}`;
  verdict.textContent = verdictOf(trace);
  by("doubted").hidden = trace.doubts.length === 0;
  by("doubts").replaceChildren(...trace.doubts.map(({ kind, found, accepted }) =>
    el("li", {}, el("strong", {}, `${kind} `), found, accepted ? el("span", { class: "why" }, " (accepted)") : "")));
  const [half, most, nearly] = response.map(quantile);
  by("figures").replaceChildren(
    ...[
      ["Messages", count(messages), `${count(trace.judged)} judged`],
      ["Forwarded", count(forwarded), share(forwarded, messages)],
      ["Missed", count(missed), share(missed, messages), missed > 0],
      refused > 0 && ["Refused", count(refused), share(refused, messages), true],
      open > 0 && ["Open", count(open), waiting(trace) ? "some without an answer" : "as the trace ends", waiting(trace)],
      ["Response", half, `p90 ${most}, p99 ${nearly}`],
      ["Run", time(trace.duration), `${trace.commit}, window ${count(trace.window)}`],
      trace.observed && ["Observed", `± ${time(trace.observed[0])}`, `late by up to ${time(trace.observed[1])}`],
    ].filter(Boolean).map(([name, value, more, bad]) =>
      el("div", { class: bad ? "bad" : "" }, el("dt", {}, name), el("dd", {}, value), el("dd", { class: "more" }, more))),
  );
  const columns = trace.columns.map(([word, meaning], at) => ({ word, meaning, at }))
    .filter(({ at }) => at !== OPEN || account.rows.some(({ counts }) => counts[at] > 0));
  const head = [["Source"], ["Share"], ...columns.map(({ word, meaning }) => [capital(word), meaning]), ["p50"], ["p90"], ["p99"],
    ["Deadlines", "The least and the greatest that its requests had."]];
  by("sources").replaceChildren(
    el("thead", {}, el("tr", {}, ...head.map(([name, title]) => el("th", { scope: "col", title }, name)))),
    el("tbody", {}, ...account.rows.map((row) => line(trace, row, columns))),
  );
  const summed = columns.slice(SUMMED, -1).map(({ word }) => word).join(" + ");
  by("meanings").replaceChildren(
    el("p", {}, `A row adds up: requests = ${summed}.`),
    el("dl", {}, ...columns.flatMap(({ word, meaning }) => [el("dt", {}, word), el("dd", {}, meaning)])));
}

/** Returns whether messages are open that a later one overtook, or that the run's end left. */
const waiting = ({ doubts }) => doubts.some(({ kind }) => kind === "unanswered" || kind === "unfinished");

const capital = (word) => word[0].toUpperCase() + word.slice(1);

function line({ sources, account: { messages } }, { place, counts, response, deadlines }, columns) {
  const source = sources[place];
  const bar = el("span", { class: "share", "aria-hidden": "true" });
  bar.style.width = `${messages ? (100 * counts[SUMMED]) / messages : 0}%`;
  const square = swatch(place);
  bar.style.background = square.style.getPropertyValue("--of");
  return el("tr", {},
    el("th", { scope: "row" }, square, `${source.p} `, el("span", { class: "label" }, source.label)),
    el("td", { class: "shares" }, el("span", { class: "track" }, bar), el("b", {}, share(counts[SUMMED], messages))),
    ...columns.map(({ at, word }) => el("td", { "data-of": word }, count(counts[at]))),
    ...response.map((ns) => el("td", {}, quantile(ns))),
    el("td", { title: (deadlines ?? false) && `median ${time(Number(deadlines[1]))}` }, deadlines ? span(deadlines.map(Number)) : "–"));
}

/** The least and the greatest; one if they are the same. */
const span = ([least, , greatest]) => (least === greatest ? time(least) : `${time(least)} – ${time(greatest)}`);

/** Returns in words the deadlines that are drawn as lines, from the shortest. */
const deadlinesOf = ({ deadlines }) =>
  `${deadlines.length > 1 ? "deadlines" : "deadline"} ${[...deadlines].sort((a, b) => a - b).map(time).join(", ")}`;

export function showLegend(trace) {
  const { account, sources } = trace;
  const item = (square, text) => el("span", {}, square, text);
  const mark = (name) => el("span", { class: `mark ${name}`, "aria-hidden": "true" });
  by("legend").replaceChildren(
    ...account.rows.map(({ place }) => item(swatch(place), sources[place].label)),
    ...(trace.deadlines.length ? [item(mark("deadline"), deadlinesOf(trace))] : []),
    ...(account.missed ? [item(mark("missed"), "missed")] : []),
    ...(account.open ? [item(mark("open"), "open")] : []),
    ...(trace.violations.length ? [item(mark("violation"), "violation")] : []),
    item(mark("hit"), "found"),
  );
}

/** Tells what the page does not show of a trace that is too long for it, and how to see that. */
export function showCap({ capped, length, lineOf }) {
  by("capped").hidden = !capped;
  if (!capped) return;
  by("capped").textContent = `The page ends at line ${count(lineOf(length - 1))}: it shows the first ${count(length)} of ${counted(capped.events, "event")}. `
    + "The verdict and the violations are about the whole trace, and all other figures about what is shown. "
    + "fuseline report --from 10m --to 12m shows two other minutes, --timestamps 1000..2000 these timestamps.";
}
