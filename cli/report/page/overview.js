// The whole run in a strip, with the part that the timeline shows.

import { drawShares } from "./buckets.js";
import { by, colours } from "./dom.js";

const HEIGHT = 34;

export function overview(trace, { go, view }) {
  const canvas = by("overview");
  const picture = document.createElement("canvas");
  const all = { from: -0.015 * trace.duration, to: 1.015 * trace.duration };
  const hands = new AbortController();
  let tint;
  let width;

  function paint() {
    tint = colours();
    width = canvas.clientWidth;
    for (const one of [canvas, picture]) {
      one.width = width * devicePixelRatio;
      one.height = HEIGHT * devicePixelRatio;
    }
    const ctx = picture.getContext("2d");
    ctx.scale(devicePixelRatio, devicePixelRatio);
    drawShares(ctx, trace, all, width, { top: 6, height: HEIGHT - 8 }, tint);
    ctx.fillStyle = tint.bad;
    const drawn = new Set();
    for (const { instant } of trace.violations) {
      const px = Math.round(((instant - all.from) / (all.to - all.from)) * width);
      if (instant === undefined || drawn.has(px)) continue;
      drawn.add(px);
      ctx.fillRect(px - 1, 0, 2, HEIGHT);
    }
    draw();
  }

  function draw() {
    const ctx = canvas.getContext("2d");
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.clearRect(0, 0, canvas.width, canvas.height);
    if (picture.width === 0) return;
    ctx.drawImage(picture, 0, 0);
    ctx.scale(devicePixelRatio, devicePixelRatio);
    const x = (at) => ((at - all.from) / (all.to - all.from)) * width;
    const left = Math.max(0, Math.min(x(view().from), width - 3));
    const right = Math.min(width, Math.max(x(view().to), left + 3));
    ctx.fillStyle = tint.panel;
    ctx.globalAlpha = 0.72;
    ctx.fillRect(0, 0, left, HEIGHT);
    ctx.fillRect(right, 0, width - right, HEIGHT);
    ctx.globalAlpha = 1;
    ctx.strokeStyle = tint.soft;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.roundRect(left + 0.75, 0.75, Math.max(1, right - left - 1.5), HEIGHT - 1.5, 4);
    ctx.stroke();
  }

  const move = (event) => {
    const { left } = canvas.getBoundingClientRect();
    const at = all.from + ((event.clientX - left) / width) * (all.to - all.from);
    const half = (view().to - view().from) / 2;
    go({ from: at - half, to: at + half });
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    move(event);
  }, { signal: hands.signal });
  canvas.addEventListener("pointermove", (event) => event.buttons && move(event), { signal: hands.signal });
  return { paint, draw, destroy: () => hands.abort() };
}
