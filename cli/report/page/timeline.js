// The timeline: which part of the run is seen, and the hands on it.

import uPlot from "uplot";
import { drawBuckets } from "./buckets.js";
import { after } from "./data.js";
import { by, colours } from "./dom.js";
import { axis } from "./format.js";
import { drawRows, layout } from "./rows.js";

const CLOSER = 1 / 1.6;
const MOVE = 220; // ms
/** Steps of the axis: round numbers, from a minute on those of a clock. */
const STEPS = [
  ...Array.from({ length: 11 }, (_, power) => [1, 2, 5].map((n) => n * 10 ** power)).flat().filter((ns) => ns <= 2e10),
  ...[30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 43200, 86400, 864000, 8640000].map((s) => s * 1e9),
  ...Array.from({ length: 5 }, (_, power) => 1e17 * 10 ** power),
];

/** The room for the labels of the response times, beside the plot; the strip above leaves it too. */
const SIDE = 56;

/** The axis's labels, but those that the rim would cut. */
function labels(self, values) {
  const { width } = self.over.getBoundingClientRect();
  return axis(values, values[1] - values[0] || 1).map((label, i) => {
    const at = self.valToPos(values[i], "x");
    const half = label.length * 3.6;
    return at < half - SIDE || at > width - half ? "" : label;
  });
}

/** A timeline of a trace; it reports which timestamp was chosen, and each new view. */
export function timeline(trace, { choose, seen }) {
  const host = by("timeline");
  const least = Math.max(4, Math.min(1000, trace.duration / 1e5));
  const all = { from: -0.015 * trace.duration, to: 1.015 * trace.duration };
  const marked = { selected: -1, hits: new Set(), current: -1 };
  let view = { ...all };
  let blocks;
  let moving = 0;
  let tint = colours();
  const height = () => (window.innerWidth < 640 ? 300 : 340);

  const plot = new uPlot({
    width: host.clientWidth, height: height(), padding: [0, 0, 0, SIDE],
    scales: { x: { time: false, auto: false, min: view.from, max: view.to }, y: { auto: false, min: 0, max: 1 } },
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    legend: { show: false },
    series: [{}, { show: false }],
    axes: [
      { stroke: () => tint.soft, grid: { stroke: () => tint.line, width: 1 }, ticks: { stroke: () => tint.line, size: 4 }, font: "12px system-ui", size: 30, space: 76,
        incrs: STEPS, values: labels },
      { show: false },
    ],
    hooks: { draw: [draw] },
  }, [[0, trace.duration], [null, null]], host);

  function draw(self) {
    const { ctx } = self;
    const { left, top, width, height } = self.bbox;
    if (width < 1) return;
    const ratio = uPlot.pxRatio;
    const [wide, high] = [width / ratio, height / ratio];
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    ctx.translate(left, top);
    ctx.scale(ratio, ratio);
    ctx.textAlign = "left";
    blocks = layout(trace, view, wide, high, marked.selected);
    let names = [];
    if (blocks) drawRows(ctx, trace, view, wide, blocks, marked, tint);
    else names = drawBuckets(ctx, trace, view, wide, high, tint);
    flags(ctx, wide, high);
    ctx.restore();
    ctx.save();
    ctx.translate(left, top);
    ctx.scale(ratio, ratio);
    beside(ctx, names);
    ctx.restore();
  }

  function beside(ctx, names) {
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    for (const { text, y, strong } of names) {
      ctx.font = strong ? "600 11px system-ui" : "11px system-ui";
      ctx.fillStyle = strong ? tint.ink : tint.soft;
      ctx.fillText(text, -7, y, SIDE - 8);
    }
  }

  /** Marks on the upper rim: what was found, and what is broken. */
  function flags(ctx, wide, high) {
    const x = (k) => ((trace.start[k] - view.from) * wide) / (view.to - view.from);
    const sees = (px) => px >= -6 && px <= wide + 6;
    ctx.fillStyle = tint.accent;
    let before = -9;
    for (const k of marked.hits) {
      const px = x(k);
      if (!sees(px) || Math.abs(px - before) < 1) continue;
      ctx.fillRect(px - 1, 0, 2, 9);
      before = px;
    }
    if (marked.selected >= 0 && !blocks && sees(x(marked.selected))) ctx.fillRect(x(marked.selected) - 0.5, 0, 1, high);
    ctx.fillStyle = tint.bad;
    ctx.font = "600 12px system-ui";
    ctx.textBaseline = "alphabetic";
    const story = blocks?.[0].story;
    const drawn = new Set();
    for (const { t: k, instant, rule } of trace.violations) {
      const px = instant === undefined ? NaN : ((instant - view.from) * wide) / (view.to - view.from);
      if (!sees(px) || (story && k !== marked.selected)) continue;
      // Of many at one place, one is seen.
      if (!story && drawn.has(Math.round(px))) continue;
      drawn.add(Math.round(px));
      ctx.beginPath();
      ctx.moveTo(px - 5, 1);
      ctx.lineTo(px + 5, 1);
      ctx.lineTo(px, 11);
      ctx.fill();
      if (story) ctx.fillText(`breaks ${rule}`, px > wide - 80 ? px - 72 : px + 8, 11);
      ctx.globalAlpha = 0.35;
      if (!blocks || story) ctx.fillRect(px - 0.5, 11, 1, high);
      ctx.globalAlpha = 1;
    }
  }

  /** Shows a part of the run; a timestamp's, `free`, may reach beyond the run's ends. */
  function put(next, free = false) {
    const span = Math.max(next.to - next.from, least);
    const middle = (next.from + next.to) / 2;
    const most = all.to - all.from;
    if (!free && span >= most) view = { ...all };
    else {
      const rim = Math.max(0.015 * trace.duration, 0.15 * span * (1 - span / most));
      const from = free ? next.from : Math.max(-rim, Math.min(middle - span / 2, trace.duration + rim - span));
      view = { from, to: from + span };
    }
    plot.setScale("x", { min: view.from, max: view.to });
    seen(view);
  }

  /** Goes to a view, in steps unless less motion is wanted. */
  function go(next, free = false) {
    cancelAnimationFrame(moving);
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return put(next, free);
    const begin = performance.now();
    const old = view;
    const frame = (now) => {
      const part = Math.max(0, Math.min(1, (now - begin) / MOVE));
      const ease = 1 - (1 - part) ** 3;
      // The span shrinks by equal factors, the middle follows it.
      const span = (old.to - old.from) * ((next.to - next.from) / (old.to - old.from)) ** ease;
      const way = (old.to - old.from) - (next.to - next.from);
      const done = Math.abs(way) > 1e-9 * (old.to - old.from) ? ((old.to - old.from) - span) / way : ease;
      const from = old.from + (next.from - old.from) * done;
      put(part === 1 ? next : { from, to: from + span }, free || part < 1);
      if (part < 1) moving = requestAnimationFrame(frame);
    };
    moving = requestAnimationFrame(frame);
  }

  const zoom = (factor, at = 0.5) => {
    cancelAnimationFrame(moving);
    const span = Math.max((view.to - view.from) * factor, least);
    const fixed = view.from + at * (view.to - view.from);
    put({ from: fixed - at * span, to: fixed + (1 - at) * span });
  };
  const pan = (part) => {
    cancelAnimationFrame(moving);
    const way = part * (view.to - view.from);
    put({ from: view.from + way, to: view.to + way });
  };

  /** Returns the timestamp at a place of the plot; −1 if there are too many. */
  function pick(px, py) {
    const { width } = plot.over.getBoundingClientRect();
    const instant = (at) => view.from + (at / width) * (view.to - view.from);
    if (blocks) {
      const inside = blocks.find(({ k, top, height }) =>
        py >= top && py <= top + height && instant(px + 3) >= trace.start[k] && instant(px - 3) <= trace.end[k]);
      return inside?.k ?? -1;
    }
    const [low, high] = [after(trace, instant(px - 8)), after(trace, instant(px + 8))];
    if (high - low > 24) return -1;
    let best = -1;
    for (let n = low; n < high; n++) {
      const k = trace.order[n];
      if (best < 0 || Math.abs(trace.start[k] - instant(px)) < Math.abs(trace.start[best] - instant(px))) best = k;
    }
    return best;
  }

  const hands = new AbortController();
  const on = (name, act, options = {}) => plot.over.addEventListener(name, act, { signal: hands.signal, ...options });
  const fingers = new Map();
  let travelled = 0;
  on("wheel", (event) => {
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) return pan((event.deltaX || event.deltaY) / plot.over.clientWidth);
    const { left, width } = plot.over.getBoundingClientRect();
    zoom(Math.exp(Math.max(-80, Math.min(80, event.deltaY)) / 200), (event.clientX - left) / width);
  }, { passive: false });
  on("pointerdown", (event) => {
    fingers.set(event.pointerId, event.clientX);
    if (fingers.size === 1) travelled = 0;
    plot.over.setPointerCapture(event.pointerId);
  });
  on("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const { left, width } = plot.over.getBoundingClientRect();
    const before = [...fingers.values()];
    fingers.set(event.pointerId, event.clientX);
    const now = [...fingers.values()];
    if (now.length === 1) {
      travelled += Math.abs(now[0] - before[0]);
      if (travelled > 4) pan((before[0] - now[0]) / width);
      return;
    }
    travelled = Infinity;
    const apart = (xs) => Math.max(12, Math.abs(xs[0] - xs[1]));
    const middle = (xs) => (xs[0] + xs[1]) / 2;
    pan((middle(before) - middle(now)) / width);
    zoom(apart(before) / apart(now), (middle(now) - left) / width);
  });
  on("pointerup", (event) => {
    const alone = fingers.size === 1;
    fingers.delete(event.pointerId);
    if (!alone || travelled > 4) return;
    const { left, top, width } = plot.over.getBoundingClientRect();
    const k = pick(event.clientX - left, event.clientY - top);
    if (k >= 0) choose(k);
    else if (!blocks) zoom(1 / 8, (event.clientX - left) / width);
  });
  on("pointercancel", (event) => fingers.delete(event.pointerId));

  return {
    zoom, pan, go, put, closer: () => zoom(CLOSER), farther: () => zoom(1 / CLOSER), whole: () => go(all),
    view: () => view,
    /** Goes to all that happened to a timestamp, as far as that is not much longer than it was open. */
    visit(k) {
      const open = Math.max(trace.end[k] - trace.start[k], least);
      const until = Math.min(trace.last[k], trace.end[k] + 1.5 * open);
      const span = Math.max(until - trace.start[k], least);
      go({ from: trace.start[k] - 0.12 * span, to: trace.start[k] + 1.14 * span }, true);
    },
    mark(next) {
      Object.assign(marked, next);
      plot.redraw(false);
    },
    redraw() {
      tint = colours();
      plot.redraw(false, true);
    },
    resize: () => plot.setSize({ width: host.clientWidth, height: height() }),
    destroy() {
      cancelAnimationFrame(moving);
      hands.abort();
      plot.destroy();
    },
  };
}
