// Tells what happened to one timestamp, event by event, and what breaks a rule.

import { MISSED, OPEN } from "./data.js";
import { by, el, swatch } from "./dom.js";
import { count, time } from "./format.js";

export function showStory(trace, k) {
  const { first, events, start, violations, timestamps } = trace;
  by("story").hidden = false;
  by("story-title").textContent = `Timestamp ${timestamps[k]}`;
  by("ending").textContent = [ending(trace, k), lineage(trace, k)].filter(Boolean).join(" ");
  const own = violations.filter((violation) => violation.t === k);
  by("breaches").replaceChildren(...own.map(breach));
  const broken = new Map(own.map(({ line, rule }) => [line, rule]));
  by("events").replaceChildren(
    ...Array.from(events.subarray(first[k], first[k + 1]), (i) => {
      const { kind, what, why, place } = describe(trace, i);
      const rule = broken.get(trace.lineOf(i));
      return el("li", { class: `${kind}${rule ? " broken" : ""}` },
        el("span", { class: "at" }, `+${time(trace.at[i] - start[k])}`.replace("+-", "−")),
        place >= 0 ? swatch(place) : el("span", { class: "swatch none" }),
        el("span", { class: "what" }, what, why ? el("span", { class: "why" }, ` – ${why}`) : "", rule ? el("strong", {}, ` breaks ${rule}`) : ""),
        el("span", { class: "line" }, `line ${count(trace.lineOf(i))}`));
    }),
  );
}

/** A violation with the rule's sentence. */
export function breach({ line, rule, sentence, found, expected, late }) {
  return el("div", { class: "breach" },
    el("p", {}, el("strong", {}, `Breaks ${rule}`), ` at line ${count(line)}`),
    el("p", { class: "sentence" }, sentence),
    // Only the first ones have their details here.
    found === undefined ? el("p", {}, "The page has the details of the first 100 violations; fuseline check of a part of the trace shows these.") : el("dl", {},
      el("dt", {}, "found"), el("dd", {}, el("code", {}, found)),
      el("dt", {}, "expected"), el("dd", {}, el("code", {}, expected)),
      ...(late == null ? [] : [el("dt", {}, "late by"), el("dd", {}, time(late))])));
}

function ending({ outcome, response, start, end, sources, observed }, k) {
  const came = `${time(start[k])} into the run`;
  if (outcome[k] >= 0) {
    const after = Number.isNaN(response[k]) ? "" : `, ${time(response[k])} after its message`;
    return `The result of ${sources[outcome[k]].label} was forwarded${after}; it came ${came}.`;
  }
  if (outcome[k] === MISSED) return `Missed ${time(end[k] - start[k])} after its message, which came ${came}: nothing was available, and nothing would come.`;
  if (outcome[k] === OPEN) return `Still open as the trace ends; its message came ${came}.`;
  return observed ? "It was not opened." : `Never opened; first heard of ${came}.`;
}

/** Tells where the message comes from, and how old it was on its way. */
function lineage({ lineages, outcome, response }, k) {
  const own = lineages.get(k);
  if (!own) return "";
  const from = own.origin == null ? "The message" : `The message comes from ${own.origin}${own.seq == null ? "" : ` ${own.seq}`}`;
  const lacks = own.missing ? ` Nothing came from ${own.missing.join(" and ")}.` : "";
  if (own.age == null) return own.origin == null ? lacks.trim() : `${from}.${lacks}`;
  const age = Number(own.age);
  const out = outcome[k] >= 0 && !Number.isNaN(response[k]) ? ` and ${time(age + response[k])} as its output was sent` : "";
  return `${from}${own.origin == null ? "" : "; it"} was ${time(age)} old as it was opened${out}.${lacks}`;
}

function describe({ ev, p, a, b, sources, refusals, drops }, i) {
  const place = p[i];
  const name = sources[place]?.label;
  const of = (kind, what, why) => ({ kind, what, why, place });
  switch (ev[i]) {
    case "o": return of("input", "Message", a[i] < 0 ? "" : `local has ${time(a[i])}`);
    case "f": return of("input", `Offer to ${name}`, `${time(a[i])} to answer, ${count(b[i])} queued`);
    case "r": return of("input", `Result of ${name}`);
    case "x": return of("input", `Failure of ${name}`);
    case "t": return of("timer", `Timer of ${name} fired`, place === 0 ? "local's deadline" : "its deadline ended");
    case "q": return of("request", `Requested of ${name}`, a[i] < 2 ** 63 ? `due ${time(a[i])} from here` : "due at the end of time");
    case "h": return of("hold", "Held", "something better is pending");
    case "e": return of("emit", `Forwarded: ${name}`);
    case "z": return of("emit", "Final", `nothing better than ${name} will come`);
    case "m": return of("miss", "Missed", "nothing available, nothing pending");
    case "c": return of("cancel", `Call of ${name} cancelled`, "no longer wanted");
    case "n": {
      const { word, sentence } = refusals[a[i]];
      return of("drop", place < 0 ? `Refused: ${word}` : `Offer to ${name} refused: ${word}`, sentence);
    }
    default: return of("drop", `Dropped: ${drops[a[i]].word}`, drops[a[i]].sentence);
  }
}
