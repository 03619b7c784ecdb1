// Draws a histogram of response times, one source's bars upon the other's.

import uPlot from "uplot";
import { by, colours } from "./dom.js";
import { axis, count, counted as plural, time } from "./format.js";

const BINS = 60;
const HEIGHT = 220;
const STEPS = [1, 2, 2.5, 5, 10];

let plot;

export function showSpread(trace) {
  const { tally, all } = times(trace);
  const host = by("spread");
  plot?.destroy();
  plot = undefined;
  host.replaceChildren();
  host.parentElement.hidden = all.total === 0;
  if (all.total === 0) return;
  // A long tail goes into the last bin, so that the rest can be seen.
  const longest = all.times[all.times.length - 1];
  const top = Math.max(Math.min(longest, 3 * part(all, 0.99)), 1, ...trace.deadlines);
  const bin = step(top / BINS);
  const bins = Math.floor(top / bin) + 1;
  const tail = longest >= bins * bin;
  const shown = tally.filter((of) => of.total > 0);
  const counts = shown.map(({ times }) => {
    const bars = new Float64Array(bins);
    for (const response of times) bars[Math.min(bins - 1, Math.max(0, Math.floor(response / bin)))]++;
    return bars;
  });
  // Stacked: each series is drawn from 0 over those before it, the whole first.
  const stacked = counts.map((_, i) => counts.slice(0, i + 1).reduce((sum, bars) => sum.map((n, j) => n + bars[j]), new Float64Array(bins)));
  const centres = Float64Array.from({ length: bins }, (_, i) => (i + 0.5) * bin);
  const order = shown.map((_, i) => i).reverse();
  const tint = (place) => () => colours().source(place);
  const legend = (i) => (self, _, __, at) => count(at == null ? shown[i].total : counts[i][at]);
  plot = new uPlot({
    width: host.clientWidth, height: HEIGHT, padding: [20, 24, 0, 0],
    scales: { x: { time: false, range: [0, bins * bin] }, y: { range: (_, __, max) => [0, Math.max(1, max * 1.08)] } },
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    legend: { live: true },
    series: [
      { label: "Within", value: (_, __, ___, at) => (at == null ? "all" : range(at, bin, bins, tail)) },
      ...order.map((i) => ({
        label: shown[i].source.label, fill: tint(shown[i].source.place), width: 0, points: { show: false },
        paths: uPlot.paths.bars({ size: [0.9, Infinity] }), value: legend(i),
      })),
    ],
    axes: [
      { stroke: () => colours().soft, grid: { show: false }, ticks: { stroke: () => colours().line, size: 4 }, font: "12px system-ui", size: 32,
        values: (_, values) => axis(values, values[1] - values[0] || 1) },
      { stroke: () => colours().soft, grid: { stroke: () => colours().line, width: 1 }, ticks: { show: false }, font: "12px system-ui", size: 64,
        incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5, 1e6], values: (_, values) => values.map(count) },
    ],
    hooks: { draw: [(self) => drawDeadlines(self, trace.deadlines)] },
  }, [centres, ...order.map((i) => stacked[i])], host);
  host.setAttribute("aria-label", `Histogram of ${plural(all.total, "response time")}: half within ${time(part(all, 0.5))}, `
    + `99 % within ${time(part(all, 0.99))}, the longest ${time(longest)}.`);
}

export const resizeSpread = () => plot?.setSize({ width: by("spread").clientWidth, height: HEIGHT });
export const redrawSpread = () => plot?.redraw(false);

/** The p-th part of sorted times, by the nearest rank. */
const part = ({ times, total }, p) => times[Math.max(1, Math.ceil(p * total)) - 1] ?? NaN;

/** The response times that each source's results had, and all, sorted. */
function times({ sources, outcome, response }) {
  const tally = sources.map((source) => ({ source, times: [] }));
  for (let k = 0; k < outcome.length; k++) if (outcome[k] >= 0 && !Number.isNaN(response[k])) tally[outcome[k]].times.push(response[k]);
  const all = Float64Array.from(tally.flatMap(({ times }) => times)).sort();
  return { tally: tally.map((of) => ({ ...of, total: of.times.length })), all: { times: all, total: all.length } };
}

/** A line for each deadline, named above the plot. */
function drawDeadlines(self, deadlines) {
  const { ctx, bbox: { left, top, width, height } } = self;
  const tint = colours();
  const ratio = uPlot.pxRatio;
  ctx.save();
  ctx.font = `${11 * ratio}px system-ui`;
  ctx.textBaseline = "alphabetic";
  ctx.lineWidth = 1.5 * ratio;
  ctx.strokeStyle = tint.ink;
  ctx.fillStyle = tint.ink;
  ctx.setLineDash([5 * ratio, 4 * ratio]);
  const inside = (x) => x >= left && x <= left + width;
  const lines = [...deadlines].sort((a, b) => a - b).map((deadline) => ({ deadline, x: Math.round(self.valToPos(deadline, "x", true)) + 0.5 }));
  for (const { x } of lines.filter(({ x }) => inside(x))) {
    ctx.beginPath();
    ctx.moveTo(x, top - 3 * ratio);
    ctx.lineTo(x, top + height);
    ctx.stroke();
  }
  ctx.textAlign = "left";
  for (const { text, at } of labels(ctx, lines.filter(({ x }) => inside(x)), left, width, 8 * ratio)) ctx.fillText(text, at, top - 8 * ratio);
  ctx.restore();
}

/** A label for each line, in its middle as far as the plot allows; lines whose labels would meet have one together. */
function labels(ctx, lines, left, width, gap) {
  const put = (group) => {
    const text = `${group.length > 1 ? "deadlines" : "deadline"} ${group.map(({ deadline }) => time(deadline)).join(", ")}`;
    const size = ctx.measureText(text).width;
    const middle = (group[0].x + group.at(-1).x) / 2;
    return { group, text, size, at: Math.max(left, Math.min(middle - size / 2, left + width - size)) };
  };
  const all = [];
  for (const line of lines) {
    let next = put([line]);
    while (all.length > 0 && all.at(-1).at + all.at(-1).size + gap > next.at) next = put([...all.pop().group, ...next.group]);
    all.push(next);
  }
  return all;
}

const range = (at, bin, bins, tail) =>
  tail && at === bins - 1 ? `${time(at * bin)} and more` : `${time(at * bin)} to ${time((at + 1) * bin)}`;

/** The least round number that is at least this. */
function step(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return STEPS.map((n) => n * power).find((n) => n >= least * 0.999) ?? 10 * power;
}
