// One frame's way through the operators whose traces are on the page, and where its time went.

import { decode, fate, MISSED, OPEN } from "./data.js";
import { by, el } from "./dom.js";
import { share, time } from "./format.js";

/**
 * Shows each operator's message of one origin; `own` is the lineage of the chosen message. `go` takes the number of a trace and
 * the place of its message.
 */
export function showFrame(own, traces, words, go) {
  const stages = own?.origin == null || own.seq == null ? [] : stagesOf(own, traces, words);
  by("frame").hidden = stages.length < 2;
  if (stages.length < 2) return;
  const age = Math.max(...stages.map(({ sent }) => sent));
  const [what, most] = spans(stages).reduce((most, span) => (span[1] > most[1] ? span : most));
  by("frame-title").textContent = `${own.origin} ${own.seq} through ${stages.length} operators`;
  by("frame-most").textContent = `It was ${time(age)} old at its last answer; most went to: ${what}, ${time(most)} or ${share(most, age)}.`;
  const head = ["Operator", "Since its capture", "Taken in", "Answered", "Answered by", "What became of all"];
  by("stages").replaceChildren(
    el("thead", {}, el("tr", {}, ...head.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...stages.map((stage) => row(stage, age, go))));
}

/** The messages of this origin in all traces, in the order in which they were taken in. */
function stagesOf({ origin, seq }, traces, words) {
  const isOfFrame = (one) => one.origin === origin && String(one.seq) === String(seq) && one.age != null;
  const stages = traces.flatMap((stored, number) => {
    const messages = (stored.lineages ?? []).filter(isOfFrame);
    if (messages.length === 0) return [];
    // Control has a message a tick of the same plan: the first one stands for all.
    const first = messages.reduce((first, one) => (Number(one.age) < Number(first.age) ? one : first));
    return [{ ...stage(decode(stored, words), number, first.t, Number(first.age)), missing: first.missing ?? [], more: messages.length - 1 }];
  });
  return stages.sort((a, b) => a.taken - b.taken || a.sent - b.sent);
}

function stage(trace, number, k, taken) {
  const { outcome, sources, columns, start, end, operator, file } = trace;
  const by = outcome[k] >= 0 ? sources[outcome[k]].label : outcome[k] === MISSED ? "missed" : outcome[k] === OPEN ? "open" : "refused";
  const fates = sources.map(({ label, place }) => [label, fate(trace, k, place)]).filter(([, column]) => column > 0);
  const became = fates.map(([label, column]) => `${label} ${columns[column][0]}`).join(", ");
  return { number, k, operator: operator ?? file, taken, sent: taken + end[k] - start[k], by, became };
}

/** Returns what its time went to, one after the other: in an operator, or before it. What several took at once is counted once. */
function spans(stages) {
  let done = 0;
  return stages.flatMap(({ operator, taken, sent }) => {
    const before = Math.max(0, taken - done);
    const inside = Math.max(0, sent - Math.max(taken, done));
    done = Math.max(done, sent);
    return [[`before ${operator}`, before], [operator, inside]];
  });
}

function row({ number, k, operator, taken, sent, by, became, missing, more }, age, go) {
  const notes = [more > 0 && `and ${more} more of this frame`, missing.length > 0 && `without ${missing.join(" ")}`].filter(Boolean);
  const bar = el("span", { class: "share" });
  bar.style.marginLeft = `${(100 * taken) / age}%`;
  bar.style.width = `${(100 * (sent - taken)) / age}%`;
  return el("tr", { class: by === "missed" ? "bad" : "" },
    el("th", { scope: "row" }, el("button", { type: "button", onclick: () => go(number, k) }, operator)),
    el("td", {}, el("span", { class: "track", "aria-hidden": "true" }, bar)),
    el("td", {}, time(taken)), el("td", {}, time(sent)), el("td", {}, [by, ...notes].join(", ")), el("td", {}, became || "–"));
}
