// What can be found: timestamps by number, by reason, by violation, by outcome.

import { MISSED, OPEN, drop, find, refusal } from "./data.js";

/** All that a trace can be searched for, each with the timestamps that have it, by their beginning. */
export function filters(trace) {
  const { ev, p, a, t, outcome, order, rank, sources, violations, length } = trace;
  const found = new Map();
  const put = (group, label, k, title = "") => {
    const entry = found.get(label) ?? { group, label, title, hits: new Set() };
    entry.hits.add(k);
    found.set(label, entry);
  };
  for (const { t: k, rule, sentence } of violations) if (k !== null) put(0, `violation ${rule}`, k, sentence);
  for (const k of order) {
    if (outcome[k] >= 0) put(2, `forwarded ${sources[outcome[k]].label}`, k);
    else if (outcome[k] === MISSED) put(1, "missed", k);
    else if (outcome[k] === OPEN) put(3, "left open", k);
  }
  for (let i = 0; i < length; i++) {
    if (ev[i] === "d") put(4, `dropped ${drop(trace, i)[0]}`, t[i]);
    else if (ev[i] === "n") put(5, `refused ${refusal(trace, i)[0]}`, t[i]);
    else if (ev[i] === "x" && p[i] >= 0) put(6, `failed ${sources[p[i]].label}`, t[i]);
  }
  const sorted = [...found.values()].sort((x, y) => x.group - y.group || y.hits.size - x.hits.size);
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
