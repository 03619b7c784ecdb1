// Finds timestamps by number, by reason, by violation, by outcome.

import { MISSED, OPEN, fate, find } from "./data.js";

/** Fates that are no trouble: found when asked for, without a chip. */
const QUIET = new Set(["forwarded", "discarded", "superseded", "open"]);

/**
 * All that a trace can be searched for, each with the timestamps that have it, by their beginning, and with how often
 * there is one in all.
 */
export function filters(trace) {
  const { ev, p, a, t, outcome, order, rank, sources, columns, refusals, drops, violations, lineages } = trace;
  const found = new Map();
  const put = (group, label, k, title = "", quiet = false) => {
    const entry = found.get(label) ?? { group, label, title, quiet, count: 0, hits: new Set() };
    entry.count++;
    if (k !== null) entry.hits.add(k);
    found.set(label, entry);
  };
  for (const { t: k, rule, sentence } of violations) put(0, `violation ${rule}`, k, sentence);
  for (const k of order) {
    if (outcome[k] >= 0) put(2, `forwarded ${sources[outcome[k]].label}`, k);
    else if (outcome[k] === MISSED) put(1, "missed", k);
    else if (outcome[k] === OPEN) put(3, "open", k);
    for (const { place, label } of sources) {
      const [word, meaning] = columns[fate(trace, k, place)];
      if (word !== "requests" && word !== "forwarded") put(4, `${word} ${label}`, k, meaning, QUIET.has(word));
    }
  }
  for (const [k, { missing = [] }] of lineages) for (const input of missing) put(1, `without ${input}`, k, `Nothing came from ${input}, an input of a join on its way.`);
  for (let i = 0; i < ev.length; i++) {
    if (ev[i] === "d") put(5, `dropped ${drops[a[i]].word}`, t[i], drops[a[i]].sentence);
    else if (ev[i] === "n") put(6, `refused ${refusals[a[i]].word}`, t[i], refusals[a[i]].sentence);
  }
  const sorted = [...found.values()].sort((x, y) => x.group - y.group || y.count - x.count);
  return sorted.map((filter) => ({ ...filter, hits: ordered(filter.hits, rank) }));
}

/** The timestamps that a query means, by their beginning. */
export function search(trace, all, query) {
  const words = query.trim().toLowerCase().split(/\s+/).filter(Boolean);
  if (words.length === 0) return [];
  if (words.length === 1 && /^\d{1,20}$/.test(words[0])) {
    const k = BigInt(words[0]) < 2n ** 64n ? find(trace, BigInt(words[0])) : -1;
    return k < 0 ? [] : [k];
  }
  const hits = new Set();
  const exact = all.filter(({ label }) => label.toLowerCase() === words.join(" "));
  const meant = exact.length > 0 ? exact : all.filter(({ label }) => words.every((word) => label.toLowerCase().includes(stem(word))));
  for (const filter of meant) for (const k of filter.hits) hits.add(k);
  return ordered(hits, trace.rank);
}

/** A plural finds what its singular does. */
const stem = (word) => (word === "violations" ? "violation" : word);

const ordered = (hits, rank) => [...hits].sort((i, j) => rank[i] - rank[j]);
