// How long responses took: a histogram, one source's bars upon the other's.

import uPlot from "uplot";
import { by, colours } from "./dom.js";
import { axis, count, counted, time } from "./format.js";
import { quantile } from "./summary.js";

const BINS = 60;
const STEPS = [1, 2, 2.5, 5, 10];

let plot;

export function showSpread(trace, { tally, all }) {
  const host = by("spread");
  plot?.destroy();
  plot = undefined;
  host.replaceChildren();
  host.parentElement.hidden = all.length === 0;
  if (all.length === 0) return;
  // A long tail goes into the last bin, so that the rest can be seen.
  const longest = all[all.length - 1];
  const top = Math.max(Math.min(longest, 3 * quantile(all, 0.99)), 1);
  const bin = step(top / BINS);
  const bins = Math.floor(top / bin) + 1;
  const tail = longest >= bins * bin;
  const shown = tally.filter((of) => of.times.length > 0);
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
  const legend = (i) => (self, _, __, at) => count(at == null ? shown[i].times.length : counts[i][at]);
  plot = new uPlot({
    width: host.clientWidth, height: 200, padding: [8, 24, 0, 0],
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
      { stroke: () => colours().soft, grid: { stroke: () => colours().line, width: 1 }, ticks: { show: false }, font: "12px system-ui", size: 48,
        incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5, 1e6], values: (_, values) => values.map(count) },
    ],
  }, [centres, ...order.map((i) => stacked[i])], host);
  host.setAttribute("aria-label", `Histogram of ${counted(all.length, "response time")}: half within ${time(quantile(all, 0.5))}, `
    + `99 % within ${time(quantile(all, 0.99))}, the longest ${time(longest)}.`);
}

export const resizeSpread = () => plot?.setSize({ width: by("spread").clientWidth, height: 200 });
export const redrawSpread = () => plot?.redraw(false);

const range = (at, bin, bins, tail) =>
  tail && at === bins - 1 ? `${time(at * bin)} and more` : `${time(at * bin)} to ${time((at + 1) * bin)}`;

/** The least round number that is at least this. */
function step(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return STEPS.map((n) => n * power).find((n) => n >= least * 0.999) ?? 10 * power;
}
