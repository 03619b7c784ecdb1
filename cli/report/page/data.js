// The columns of one trace, decoded, and what follows from them for each timestamp.

/** A timestamp's outcome: the place of the source whose result was forwarded, or one of these. */
export const MISSED = -1;
export const OPEN = -2;
export const UNOPENED = -3;

const MORE = { o: 1, f: 2, q: 1, n: 1, d: 1 };

/**
 * Decodes a trace of the page; all instants count from its origin, in nanoseconds. `words` has the columns and the
 * reasons, each with its word and its meaning.
 */
export function decode(stored, words) {
  const length = stored.ev.length;
  const at = Float64Array.from(stored.at);
  const t = Int32Array.from(stored.t);
  const p = Int32Array.from(stored.p, (source) => source - 1);
  const a = new Float64Array(length);
  const b = new Float64Array(length);
  let x = 0;
  for (let i = 0; i < length; i++) {
    if (i > 0) {
      at[i] += at[i - 1];
      t[i] += t[i - 1];
    }
    const more = MORE[stored.ev[i]] ?? 0;
    if (more > 0) a[i] = Number(stored.x[x]);
    if (more > 1) b[i] = Number(stored.x[x + 1]);
    x += more;
  }
  const timestamps = BigUint64Array.from(stored.timestamps, BigInt);
  for (let i = 1; i < timestamps.length; i++) timestamps[i] += timestamps[i - 1];
  const trace = {
    ...stored, ...words, at, t, p, a, b, timestamps, length,
    outcome: Int32Array.from(stored.outcome),
    deadlines: stored.deadlines.map(Number),
    sources: stored.sources.map((source, place) => ({ ...source, place, label: label(source) })),
  };
  trace.lines = stored.line && Float64Array.from(stored.line, Number);
  for (let i = 1; i < trace.lines?.length; i++) trace.lines[i] += trace.lines[i - 1];
  /** The line of an event, and the instant of the event on a line. */
  trace.lineOf = (i) => trace.lines?.[i] ?? i + 2;
  const instantOn = (line) => {
    if (!trace.lines) return at[line - 2];
    const i = upTo(trace.lines, line);
    return trace.lines[i] === line ? at[i] : undefined;
  };
  trace.lineages = new Map((stored.lineages ?? []).map((one) => [one.t, one]));
  delete trace.x;
  delete trace.places;
  trace.violations = [...stored.violations, ...undetailed(stored.places)].map((violation) => ({ ...violation, instant: instantOn(violation.line) }));
  trace.detailed = stored.violations.length;
  group(trace);
  outcomes(trace);
  return trace;
}

/** The place of the last of ascending numbers that is at most this; −1 if none is. */
function upTo(numbers, most) {
  let [low, high] = [0, numbers.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= most) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** The violations of which the page knows the place and the rule alone. */
function undetailed({ rules, rule, line, t }) {
  let before = 0;
  return rule.map((which, n) => {
    before += line[n];
    const [id, sentence] = rules[which];
    return { line: before, t: t[n] ? t[n] - 1 : null, rule: id, sentence };
  });
}

function label({ p, name, known }) {
  if (name) return name;
  if (p === 0) return "local";
  return known ? `cloud ${p}` : `unknown ${p}`;
}

/** The events of each timestamp, in the order of the file; as observed, in that of their instants. */
function group(trace) {
  const { ev, at, t, timestamps, length } = trace;
  const first = new Uint32Array(timestamps.length + 1);
  for (let i = 0; i < length; i++) if (ev[i] !== ".") first[t[i] + 1]++;
  for (let k = 0; k < timestamps.length; k++) first[k + 1] += first[k];
  const events = new Uint32Array(first[timestamps.length]);
  const next = first.slice();
  for (let i = 0; i < length; i++) if (ev[i] !== ".") events[next[t[i]]++] = i;
  if (trace.observed) {
    for (let k = 0; k < timestamps.length; k++) {
      events.subarray(first[k], first[k + 1]).sort((i, j) => at[i] - at[j] || i - j);
    }
  }
  Object.assign(trace, { first, events });
}

/** When each timestamp began and ended; and the timestamps by their beginning. */
function outcomes(trace) {
  const { ev, at, p, first, events, timestamps, outcome } = trace;
  const size = timestamps.length;
  const start = new Float64Array(size);
  const end = new Float64Array(size);
  const last = new Float64Array(size);
  const response = new Float64Array(size).fill(NaN);
  let finish = 0;
  let longest = 0;
  for (let k = 0; k < size; k++) {
    let opened = NaN;
    let offered = NaN;
    let ended = NaN;
    for (let n = first[k]; n < first[k + 1]; n++) {
      const i = events[n];
      const kind = ev[i];
      if (kind === "o" && Number.isNaN(opened)) {
        opened = offered;
        offered = at[i];
      }
      else if (kind === "n" && p[i] < 0) offered = NaN;
      // A line that comes after an open says that it was not refused.
      else if (Number.isNaN(opened)) opened = offered;
      // Of several outputs, as under progressive, the last one counts.
      if (kind === "e" || (kind === "m" && Number.isNaN(ended))) ended = at[i];
      last[k] = Math.max(n > first[k] ? last[k] : -Infinity, at[i]);
    }
    if (Number.isNaN(opened)) opened = offered;
    start[k] = Number.isNaN(opened) ? at[events[first[k]]] : opened;
    end[k] = Number.isNaN(ended) ? last[k] : ended;
    if (outcome[k] >= 0) response[k] = ended - opened;
    if (response[k] > longest) longest = response[k];
    finish = Math.max(finish, last[k]);
  }
  const order = Uint32Array.from(start, (_, k) => k).sort((i, j) => start[i] - start[j] || i - j);
  const rank = new Uint32Array(size);
  order.forEach((k, place) => (rank[k] = place));
  let span = 0;
  for (let k = 0; k < size; k++) span = Math.max(span, end[k] - start[k]);
  const broken = new Uint8Array(size);
  for (const violation of trace.violations) if (violation.t !== null) broken[violation.t] = 1;
  const row = rows(order, start, end);
  Object.assign(trace, { start, end, last, response, order, rank, broken, row, span, longest });
  trace.duration = Math.max(finish, 1);
  // One that is far beyond all responses would press them into a line.
  trace.deadlines = trace.deadlines.filter((deadline) => deadline <= 4 * (longest || deadline));
}

/** The fate of a source's request for a timestamp, as its place among the columns; 0 without a request. */
export const fate = ({ fates, sources }, k, place) => fates.charCodeAt(k * sources.length + place) - 48;

/** A row for each timestamp, so that those open at once stand in different ones. */
function rows(order, start, end) {
  const row = new Uint32Array(order.length);
  const until = [];
  for (const k of order) {
    let r = until.findIndex((instant) => instant <= start[k]);
    if (r < 0) r = until.length;
    until[r] = end[k] > start[k] ? end[k] : start[k] + 1;
    row[k] = r;
  }
  return row;
}

/** The place in `order` of the first timestamp that begins at `instant` or later. */
export function after(trace, instant) {
  let [low, high] = [0, trace.order.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (trace.start[trace.order[middle]] < instant) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** The place of a timestamp, or −1. */
export function find(trace, timestamp) {
  let [low, high] = [0, trace.timestamps.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (trace.timestamps[middle] < timestamp) low = middle + 1;
    else high = middle;
  }
  return trace.timestamps[low] === timestamp ? low : -1;
}
