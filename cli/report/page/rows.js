// The timeline from near: a block for each timestamp, a lane in it for each source.

import { MISSED, after } from "./data.js";

const GAP = 5;
/** A lane as high as this has room for words; the events below the timeline say them anyway. */
const ROOMY = 48;

/** The blocks that can be seen, each with its place; undefined if they are too many to be told apart. */
export function layout(trace, view, width, height, selected) {
  const { order, start, end, row, sources } = trace;
  const lanes = sources.filter(({ known }) => known).length;
  const x = width / (view.to - view.from);
  const story = selected >= 0 && (end[selected] - start[selected]) * x > width * 0.2;
  if (story) return [{ k: selected, top: 18, height: Math.min(height - 22, sources.length * 76), story }];
  const most = Math.max(4, Math.floor(width / 22));
  const ks = [];
  for (let n = after(trace, view.from - trace.span); n < order.length && start[order[n]] < view.to; n++) {
    if (end[order[n]] >= view.from) ks.push(order[n]);
    if (ks.length > most) return undefined;
  }
  const used = [...new Set(ks.map((k) => row[k]))].sort((a, b) => a - b);
  const each = Math.min(84, (height - 18) / used.length);
  if (ks.length === 0 || each < lanes * 4 + GAP + 3) return undefined;
  return ks.map((k) => ({ k, top: 18 + used.indexOf(row[k]) * each, height: each - GAP, story: false }));
}

export function drawRows(ctx, trace, view, width, blocks, marked, colours) {
  const x = (at) => (at - view.from) * (width / (view.to - view.from));
  for (const block of blocks) drawBlock(ctx, trace, block, x, width, marked, colours);
}

function drawBlock(ctx, trace, { k, top, height, story }, x, width, { selected, hits }, colours) {
  const { start, end, broken, timestamps, outcome } = trace;
  const left = Math.max(-4, x(start[k]));
  const right = Math.min(width + 4, Math.max(x(end[k]), x(start[k]) + 3));
  ctx.globalAlpha = 1;
  ctx.fillStyle = colours.ground;
  ctx.strokeStyle = broken[k] ? colours.bad : k === selected || hits.has(k) ? colours.accent : colours.line;
  ctx.lineWidth = broken[k] || k === selected || hits.has(k) ? 2 : 1;
  ctx.beginPath();
  ctx.roundRect(left, top, right - left, height, 4);
  ctx.fill();
  ctx.stroke();
  const roomy = height > 34 && !story;
  const head = roomy ? 13 : 0;
  if (roomy && right - left > 34) {
    ctx.fillStyle = outcome[k] === MISSED || broken[k] ? colours.bad : colours.soft;
    ctx.font = "11px system-ui";
    ctx.textBaseline = "alphabetic";
    ctx.fillText(`${timestamps[k]}${broken[k] ? " ✕" : outcome[k] === MISSED ? " missed" : ""}`, Math.max(2, left + 5), top + 12, right - Math.max(2, left + 5));
  }
  const lanes = lanesOf(trace, k);
  const shown = trace.sources.filter(({ known, place }) => known || (story && lanes.has(place)));
  const each = (height - head) / shown.length;
  if (story && outcome[k] === MISSED) drawMiss(ctx, x(end[k]), top, height, width, colours);
  // The best source stands on top.
  [...shown].reverse().forEach(({ place, label }, n) => {
    const middle = top + head + (n + (story ? 0.58 : 0.5)) * each;
    const lane = lanes.get(place);
    if (story) {
      ctx.fillStyle = colours.ink;
      ctx.font = "600 12px system-ui";
      ctx.textBaseline = "alphabetic";
      ctx.fillText(label, 6, top + n * each + 15, width - 12);
    }
    if (lane) drawLane(ctx, lane, { x, middle, each, end: end[k], width, story, colour: colours.source(place) }, colours);
  });
}

/** Where a message was missed, through all lanes: its name stands above what they say of that instant. */
function drawMiss(ctx, at, top, height, width, colours) {
  ctx.fillStyle = colours.bad;
  ctx.globalAlpha = 0.5;
  ctx.fillRect(at - 1, top + 18, 2, height - 18);
  ctx.globalAlpha = 1;
  note(ctx, "✕ missed", at, top + 13, width, colours.bad, colours.ground);
}

/** Returns what happened to each source's result for one timestamp. */
function lanesOf(trace, k) {
  const { ev, at, p, a, first, events, start, refusals, drops } = trace;
  const lanes = new Map();
  const of = (place) => {
    if (!lanes.has(place)) lanes.set(place, { from: NaN, due: NaN, stop: NaN, held: NaN, marks: [] });
    return lanes.get(place);
  };
  of(0).from = start[k];
  for (let n = first[k]; n < first[k + 1]; n++) {
    const i = events[n];
    const put = (shape, text, strong = false) => of(p[i]).marks.push({ at: at[i], shape, text, strong });
    const stop = () => {
      if (Number.isNaN(of(p[i]).stop)) of(p[i]).stop = at[i];
    };
    switch (ev[i]) {
      case "o": if (a[i] >= 0 && at[i] === start[k]) of(0).due = at[i] + a[i]; break;
      case "q": Object.assign(of(p[i]), { from: at[i], due: at[i] + a[i] }); put("ring", "request"); break;
      case "r": stop(); put("tick", "result"); break;
      case "x": stop(); put("cross", "failed", true); break;
      case "h": of(p[i]).held = at[i]; put("none", "held"); break;
      case "t": stop(); put("timer", "timer"); break;
      case "c": stop(); put("ring", "cancelled"); break;
      case "e": put("disc", "forwarded", true); break;
      case "d": put("cross", drops[a[i]].word); break;
      case "n": if (p[i] >= 0) put("cross", `refused: ${refusals[a[i]].word}`); break;
      default:
    }
  }
  return lanes;
}

function drawLane(ctx, lane, { x, middle, each, end, width, story, colour }, colours) {
  const thick = story ? 5 : Math.max(1.5, Math.min(4, each * 0.3));
  const stop = Number.isNaN(lane.stop) ? end : lane.stop;
  const line = (from, to, size, alpha, dash = []) => {
    if (!(to > from)) return;
    ctx.globalAlpha = alpha;
    ctx.strokeStyle = colour;
    ctx.lineWidth = size;
    ctx.setLineDash(dash);
    ctx.beginPath();
    ctx.moveTo(Math.max(-9, x(from)), middle);
    ctx.lineTo(Math.min(width + 9, x(to)), middle);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  };
  line(lane.from, story ? stop : Math.min(stop, end), thick, 1);
  line(lane.held, end, thick * 2, 0.35);
  const last = Math.max(...lane.marks.map((mark) => mark.at));
  if (story) line(stop, last, 1.5, 0.6, [2, 4]);
  if (story && lane.due <= 2 ** 60) {
    ctx.strokeStyle = colours.soft;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(x(lane.due), middle - 12);
    ctx.lineTo(x(lane.due), middle + 12);
    ctx.stroke();
    if (each >= ROOMY) note(ctx, "due", x(lane.due), middle - 15, width, colours.soft, colours.ground);
  }
  const size = story ? 5.5 : Math.max(1.5, Math.min(4, each * 0.3));
  const notes = new Map();
  for (const { at, shape, text, strong } of lane.marks) {
    if (!story && at > end) continue;
    const tint = shape === "cross" ? (strong ? colours.bad : colours.warn) : colour;
    if (shape !== "none") mark(ctx, x(at), middle, shape === "disc" ? size * 1.25 : size, shape, tint, colours.ground);
    notes.set(at, [...(notes.get(at) ?? []), text]);
  }
  if (story && each >= ROOMY) spread([...notes], x, (texts, at, step) => note(ctx, texts.join(", "), at, middle + 22 + step * 13, width, colours.ink, colours.ground), ctx);
}

/** Notes one below the other where they would run into each other. */
function spread(notes, x, put, ctx) {
  ctx.font = "12px system-ui";
  const until = [-Infinity, -Infinity];
  for (const [at, texts] of notes.sort(([a], [b]) => a - b)) {
    const half = ctx.measureText(texts.join(", ")).width / 2 + 4;
    const step = x(at) - half > until[0] ? 0 : 1;
    until[step] = x(at) + half;
    put(texts, x(at), step);
  }
}

/** A text about a place, kept within the box. */
function note(ctx, text, at, y, width, colour, ground) {
  if (at < -40 || at > width + 40) return;
  ctx.font = "12px system-ui";
  ctx.textBaseline = "alphabetic";
  ctx.fillStyle = colour;
  const size = ctx.measureText(text).width;
  const left = Math.max(2, Math.min(width - size - 2, at - size / 2));
  // Lines that cross it stay behind.
  ctx.strokeStyle = ground;
  ctx.lineWidth = 3;
  ctx.strokeText(text, left, y);
  ctx.fillText(text, left, y);
}

function mark(ctx, x, y, size, shape, colour, ground) {
  ctx.strokeStyle = colour;
  ctx.fillStyle = colour;
  ctx.lineWidth = Math.max(1.5, size / 3);
  ctx.beginPath();
  if (shape === "disc") {
    ctx.arc(x, y, size, 0, 2 * Math.PI);
    ctx.fill();
  } else if (shape === "ring") {
    ctx.arc(x, y, size * 0.8, 0, 2 * Math.PI);
    ctx.fillStyle = ground;
    ctx.fill();
    ctx.stroke();
  } else if (shape === "cross") {
    ctx.moveTo(x - size, y - size);
    ctx.lineTo(x + size, y + size);
    ctx.moveTo(x + size, y - size);
    ctx.lineTo(x - size, y + size);
    ctx.stroke();
  } else if (shape === "timer") {
    ctx.moveTo(x - size, y - size);
    ctx.lineTo(x + size, y - size);
    ctx.lineTo(x - size, y + size);
    ctx.lineTo(x + size, y + size);
    ctx.closePath();
    ctx.fill();
  } else {
    ctx.rect(x - size / 3, y - size * 1.3, (2 * size) / 3, size * 2.6);
    ctx.fill();
  }
}
