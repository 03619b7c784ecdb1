// The page: its traces, what is found and chosen in them, and the keys.

import "uplot/dist/uPlot.min.css";
import "./style.css";
import { showComparison } from "./compare.js";
import { after, decode } from "./data.js";
import { by, el } from "./dom.js";
import { filters, search } from "./find.js";
import { axis, count, counted, time } from "./format.js";
import { showFrame } from "./frame.js";
import { overview } from "./overview.js";
import { showPolicies } from "./policies.js";
import { redrawSpread, resizeSpread, showSpread } from "./spread.js";
import { breach, showStory } from "./story.js";
import { showCap, showLegend, showSummary, titleOf, violationsOf } from "./summary.js";
import { timeline } from "./timeline.js";
import { markTrace, showTraces } from "./traces.js";

const PAN = 0.2;

const { traces: stored, ...words } = JSON.parse(by("data").textContent);
by("data").remove();

let number = -1;
let trace;
let lines;
let strip;
let all = [];
let found = { hits: [], at: -1 };
let selected = -1;
/** The view to go back to from a timestamp. */
let before;
let saying = 0;

function show(which) {
  lines?.destroy();
  strip?.destroy();
  number = which;
  // One trace is decoded at a time.
  trace = decode(stored[which], words);
  markTrace(which);
  by("name").textContent = titleOf(trace);
  by("name").title = trace.file;
  document.title = `${stored.length > 1 ? counted(stored.length, "trace") : titleOf(trace)} – Fuseline report`;
  showSummary(trace);
  showCap(trace);
  showPolicies(trace);
  showLegend(trace);
  showSpread(trace);
  selected = -1;
  before = undefined;
  lines = timeline(trace, { choose: visit, seen });
  strip = overview(trace, { go: (view) => lines.put(view), view: () => lines.view() });
  strip.paint();
  all = filters(trace);
  by("queries").replaceChildren(...all.map(({ label }) => el("option", { value: label })));
  by("filters").replaceChildren(...all.filter(({ quiet }) => !quiet).map(chip));
  by("story").hidden = true;
  showViolations();
  look("");
  seen(lines.view());
}

function chip({ group, label, title, count: whole, hits }) {
  const act = () => {
    const again = by("query").value === label;
    by("query").value = again ? "" : label;
    look(by("query").value);
  };
  const apart = whole === hits.length ? "" : `${count(whole)} at ${counted(hits.length, "timestamp")}`;
  return el("button", { type: "button", class: group < 2 ? "bad" : "", title: [title, apart].filter(Boolean).join("; ") || false, "aria-pressed": "false", "data-label": label, onclick: act },
    label, " ", el("span", {}, count(whole)));
}

function showViolations() {
  by("all").hidden = trace.violations.length === 0;
  const { violations, detailed } = trace;
  const whole = violationsOf(trace);
  const marked = trace.capped ? "; the timeline marks those that it shows" : ", all of which the timeline marks";
  by("all-title").textContent = whole > detailed ? `Violations: the first ${count(detailed)} of ${count(whole)}${marked}` : `Violations: ${count(whole)}`;
  by("cause").textContent = trace.cause ? `Likely: ${trace.cause}` : "";
  by("violations").replaceChildren(...violations.slice(0, detailed).map((violation) => {
    const { t: k, rule, line, sentence, found, expected } = violation;
    if (k === null) return el("li", {}, breach(violation));
    const about = el("button", { type: "button", title: sentence, onclick: () => visit(k) },
      el("strong", {}, `${rule} `), `timestamp ${trace.timestamps[k]}, line ${count(line)} `,
      el("span", { class: "why found" }, `found ${found}`), el("span", { class: "why found" }, `expected ${expected}`));
    return el("li", {}, about);
  }));
}

/** Tells which part is seen, and draws it in the strip. */
function seen(view) {
  strip?.draw();
  clearTimeout(saying);
  saying = setTimeout(() => {
    const some = after(trace, view.to) - after(trace, view.from);
    const span = view.to - view.from;
    const part = span >= trace.duration ? `${time(0)} to ${time(trace.duration)}`
      : `${time(span)} from ${from(view.from, span)} on`;
    by("view").textContent = `${part}, ${counted(some, "timestamp")} of ${count(trace.order.length)}`;
  }, 150);
}

/** An instant, as exactly as a view of this span needs. */
function from(instant, span) {
  const step = 10 ** Math.max(0, Math.floor(Math.log10(span / 50)));
  return axis([Math.max(0, Math.round(instant / step) * step)], step)[0];
}

/** Looks for what was typed; goes nowhere yet. */
function look(query) {
  found = { hits: search(trace, all, query), at: -1 };
  for (const button of by("filters").children) button.setAttribute("aria-pressed", String(button.dataset.label === query.trim()));
  lines.mark({ hits: new Set(found.hits), selected });
  say(query);
}

function say(query) {
  const { hits, at } = found;
  by("hits").textContent = !query.trim() ? "" : hits.length === 0 ? "nothing found"
    : at < 0 ? `${counted(hits.length, "timestamp")} found` : `${count(at + 1)} of ${count(hits.length)}`;
}

/** Goes to the next timestamp found, or to the one before. */
function step(way) {
  const { hits } = found;
  if (hits.length === 0) return;
  found.at = found.at < 0 && way < 0 ? hits.length - 1 : (found.at + way + hits.length) % hits.length;
  say(by("query").value);
  visit(hits[found.at]);
}

function visit(k) {
  before ??= lines.view();
  selected = k;
  lines.mark({ selected });
  lines.visit(k);
  showStory(trace, k);
  showFrame(trace.lineages.get(k), stored, words, go);
  remember();
}

/** Goes to a timestamp of any trace. */
function go(which, k) {
  if (which !== number) show(which);
  visit(k);
}

/** Goes to the timestamp that begins next, or before. */
function neighbour(way) {
  const middle = (lines.view().from + lines.view().to) / 2;
  const at = selected >= 0 ? trace.rank[selected] + way : after(trace, middle);
  if (at >= 0 && at < trace.order.length) visit(trace.order[at]);
}

/** From a timestamp to where one was, from there to the whole run. */
function back() {
  if (selected < 0) return lines.whole();
  selected = -1;
  by("story").hidden = true;
  lines.mark({ selected });
  lines.go(before);
  before = undefined;
  remember();
}

/** The address names the timestamp, to be kept or passed on. */
function remember() {
  const parts = [number > 0 && `trace=${number}`, selected >= 0 && `t=${trace.timestamps[selected]}`].filter(Boolean);
  try {
    history.replaceState(null, "", `#${parts.join("&")}`);
  } catch {
    // A page that is shown within another may have no address.
  }
}

const KEYS = {
  ArrowLeft: () => lines.pan(-PAN), ArrowRight: () => lines.pan(PAN),
  ArrowUp: () => lines.closer(), ArrowDown: () => lines.farther(),
  "+": () => lines.closer(), "=": () => lines.closer(), "-": () => lines.farther(), 0: () => lines.whole(),
  Home: () => lines.put(end(-1)), End: () => lines.put(end(1)),
  j: () => neighbour(1), k: () => neighbour(-1), n: () => step(1), N: () => step(-1),
  "/": () => by("query").select(), Escape: back,
};
/** These scroll the page unless the timeline has the focus. */
const SCROLLS = new Set(["ArrowUp", "ArrowDown", "Home", "End"]);

/** The view as long as this one at either end of the run. */
function end(way) {
  const { from, to } = lines.view();
  const at = way < 0 ? -trace.duration : 2 * trace.duration;
  return { from: at, to: at + (to - from) };
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const inside = event.target instanceof Element ? event.target : document.body;
  if (inside.matches("input")) {
    if (event.key === "Escape") by("timeline").focus();
    return;
  }
  if (inside.closest("#timeline") && event.key === "Enter") {
    event.preventDefault();
    return found.hits.length > 0 ? step(event.shiftKey ? -1 : 1) : neighbour(1);
  }
  if (SCROLLS.has(event.key) && !inside.closest("#timeline")) return;
  if (event.key.startsWith("Arrow") && inside.closest(".scroll")) return;
  const act = KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});

by("find").addEventListener("submit", (event) => {
  event.preventDefault();
  step(1);
});
by("query").addEventListener("input", () => look(by("query").value));
by("query").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && event.shiftKey) {
    event.preventDefault();
    step(-1);
  }
});
const acts = { left: () => lines.pan(-PAN), right: () => lines.pan(PAN), closer: () => lines.closer(), farther: () => lines.farther(),
  whole: () => lines.whole(), previous: () => neighbour(-1), next: () => neighbour(1), close: back };
for (const [id, act] of Object.entries(acts)) by(id).addEventListener("click", act);

showComparison(stored);
showTraces(stored, (which) => {
  show(which);
  remember();
});

const address = new URLSearchParams(location.hash.slice(1));
const wanted = Number(address.get("trace") ?? 0);
show(stored[wanted] ? wanted : 0);
if (address.has("q")) {
  by("query").value = address.get("q");
  look(by("query").value);
}
const [named] = address.has("t") ? search(trace, all, address.get("t")) : [];
if (named !== undefined) visit(named);

new ResizeObserver(() => {
  lines.resize();
  strip.paint();
  resizeSpread();
}).observe(by("timeline"));
for (const query of ["(prefers-color-scheme: dark)", "(prefers-contrast: more)"]) {
  matchMedia(query).addEventListener("change", () => {
    lines.redraw();
    strip.paint();
    redrawSpread();
  });
}
