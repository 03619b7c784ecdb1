// The timeline from afar: one bucket for each pixel, so that a frame costs what the screen holds.

import { MISSED, UNOPENED, after } from "./data.js";
import { axis, time } from "./format.js";

const CELL = 2;
const DOT = 1.6;
/** The greatest width of a bucket of shares. */
const WIDEST = 24;
/** The distance between labels. */
const LABEL = 12;

/**
 * Draws response times and whose results were forwarded, into a box of the width and height given. Answers the labels
 * of its lines, which stand beside the box, where no point is.
 */
export function drawBuckets(ctx, trace, view, width, height, colours) {
  const chart = { top: 16, height: Math.round(height * 0.62) - 16 };
  const band = { top: Math.round(height * 0.62) + 22, height: height - Math.round(height * 0.62) - 24 };
  const labels = drawResponses(ctx, trace, view, width, chart, colours);
  ctx.fillStyle = colours.soft;
  ctx.font = "11px system-ui";
  ctx.textBaseline = "alphabetic";
  ctx.fillText("whose result was forwarded", 2, band.top - 5);
  drawShares(ctx, trace, view, width, band, colours);
  return labels;
}

/** Draws the sources' shares of the results that went out, stacked in each bucket. */
export function drawShares(ctx, trace, view, width, box, colours) {
  const { order, start, outcome, sources } = trace;
  const low = after(trace, view.from);
  const high = after(trace, view.to);
  if (high === low) return;
  // Wide enough for about two timestamps, and fixed in time so that nothing flickers while panned.
  const wide = Math.min(WIDEST, Math.max(1, Math.round((2 * width) / (high - low))));
  const bucket = (wide * (view.to - view.from)) / width;
  const base = Math.floor(view.from / bucket);
  const number = Math.ceil(view.to / bucket) - base + 1;
  const kinds = sources.length + 2;
  const counts = new Uint32Array(number * kinds);
  const totals = new Uint32Array(number);
  // From the bucket's beginning, also where that is out of sight.
  for (let n = after(trace, base * bucket); n < high; n++) {
    const k = order[n];
    const at = Math.floor(start[k] / bucket) - base;
    if (outcome[k] === UNOPENED || at < 0 || at >= number) continue;
    counts[at * kinds + (outcome[k] >= 0 ? outcome[k] : outcome[k] === MISSED ? kinds - 2 : kinds - 1)]++;
    totals[at]++;
  }
  const below = new Float64Array(number);
  for (let kind = 0; kind < kinds; kind++) {
    ctx.fillStyle = kind < sources.length ? colours.source(kind) : kind === kinds - 2 ? colours.bad : colours.open;
    for (let at = 0; at < number; at++) {
      const n = counts[at * kinds + kind];
      if (n === 0) continue;
      const size = (n / totals[at]) * box.height;
      const x = ((at + base) * bucket - view.from) * (width / (view.to - view.from));
      // On whole pixels, lest the ground shine through.
      const left = Math.round(x);
      ctx.fillRect(left, box.top + box.height - below[at] - size, Math.round(x + wide) - left - (wide > 3 ? 1 : 0), size);
      below[at] += size;
    }
  }
}

function drawResponses(ctx, trace, view, width, box, colours) {
  const { order, start, outcome, response, sources } = trace;
  const low = after(trace, view.from);
  const high = after(trace, view.to);
  let most = Math.max(0, ...trace.deadlines);
  for (let n = low; n < high; n++) if (response[order[n]] > most) most = response[order[n]];
  const top = (most || trace.longest || 1) * 1.05;
  const labels = grid(ctx, width, box, top, trace.deadlines, colours);
  const y = box.height / top;
  const x = width / (view.to - view.from);
  const dots = high - low < width;
  const cells = dots ? undefined : density(width, box.height, sources.map(({ place }) => colours.source(place)));
  const paths = sources.map(() => new Path2D());
  const missed = [];
  for (let n = low; n < high; n++) {
    const k = order[n];
    const px = (start[k] - view.from) * x;
    if (outcome[k] === MISSED && !(px - missed.at(-1) < 1)) missed.push(px);
    if (outcome[k] < 0 || Number.isNaN(response[k])) continue;
    const py = box.height - response[k] * y;
    if (cells) {
      cells.put(px, py, outcome[k]);
      continue;
    }
    paths[outcome[k]].moveTo(px + DOT, box.top + py);
    paths[outcome[k]].arc(px, box.top + py, DOT, 0, 2 * Math.PI);
  }
  cells?.draw(ctx, box.top);
  paths.forEach((path, place) => {
    ctx.fillStyle = colours.source(place);
    ctx.fill(path);
  });
  ctx.fillStyle = colours.bad;
  for (const px of missed) ctx.fillRect(px - 1, box.top, 2, 10);
  return labels;
}

/** Points by the cell: a picture as large as the screen's part, however many they are. */
function density(width, height, tints) {
  const [columns, lines] = [Math.ceil(width / CELL), Math.ceil(height / CELL)];
  const picture = new OffscreenCanvas(columns, lines);
  const pen = picture.getContext("2d");
  const image = pen.createImageData(columns, lines);
  const colour = tints.map((tint) => [1, 3, 5].map((at) => parseInt(tint.slice(at, at + 2), 16)));
  return {
    put(x, y, place) {
      const [column, line] = [Math.floor(x / CELL), Math.floor(y / CELL)];
      if (column < 0 || column >= columns || line < 0 || line >= lines) return;
      const at = 4 * (line * columns + column);
      const { data } = image;
      // A cell has the colour of its points on average, and is the denser the more there are.
      const part = data[at + 3] === 0 ? 1 : 0.3;
      for (let i = 0; i < 3; i++) data[at + i] += (colour[place][i] - data[at + i]) * part;
      data[at + 3] = data[at + 3] === 0 ? 170 : Math.min(255, data[at + 3] + 30);
    },
    draw(ctx, top) {
      pen.putImageData(image, 0, 0);
      ctx.imageSmoothingEnabled = false;
      ctx.drawImage(picture, 0, top, columns * CELL, lines * CELL);
    },
  };
}

/** Labels of deadlines, from the longest; lines that are too near for two of them have one. */
function merged(deadlines, y) {
  const groups = [];
  for (const at of deadlines) {
    const last = groups.at(-1);
    if (last && y(at) - y(last[0]) < LABEL) last.push(at);
    else groups.push([at]);
  }
  return groups.map((all) => ({ y: y(all[0]), text: all.length > 1 ? `${time(all.at(-1))} …` : time(all[0]), strong: true }));
}

/** Lines for the response times and the deadlines; answers their labels. */
function grid(ctx, width, box, top, deadlines, colours) {
  const power = 10 ** Math.floor(Math.log10(top / 3));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => top / n <= 4.5) ?? 10 * power;
  const y = (at) => Math.round(box.top + box.height - (at / top) * box.height) + 0.5;
  const line = (at, width) => {
    ctx.beginPath();
    ctx.moveTo(0, y(at));
    ctx.lineTo(width, y(at));
    ctx.stroke();
  };
  const steps = Array.from({ length: Math.floor(top / step) + 1 }, (_, n) => n * step);
  ctx.lineWidth = 1;
  ctx.strokeStyle = colours.line;
  for (const at of steps) line(at, width);
  ctx.lineWidth = 1.5;
  ctx.strokeStyle = colours.ink;
  ctx.setLineDash([5, 4]);
  for (const at of deadlines) line(at, width);
  ctx.setLineDash([]);
  const strong = merged([...deadlines].sort((a, b) => b - a), y);
  const named = axis(steps, step).map((text, n) => ({ y: y(steps[n]), text, strong: false }));
  return [...strong, ...named.filter((one) => strong.every((other) => Math.abs(one.y - other.y) > LABEL))];
}
