// Runs of a scenario, drawn side by side from where things were and from what left the operators.
"use strict";
(() => {
  const RATE = 20;
  const ROLES = { ego: "--ego", other: "--other", person: "--person" };
  const animations = JSON.parse(document.getElementById("animations").textContent);

  const element = (name, parent, properties = {}) => {
    const made = Object.assign(document.createElement(name), properties);
    parent.append(made);
    return made;
  };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // The place between two recorded ones.
  const pose = (poses, now) => {
    const at = Math.min(now * RATE, poses.length - 1);
    const [from, part] = [Math.floor(at), at % 1];
    const [one, next] = [poses[from], poses[Math.min(from + 1, poses.length - 1)]];
    return one.map((figure, index) => figure + (next[index] - figure) * part);
  };

  class View {
    constructor(animation, run, parent, end) {
      Object.assign(this, { animation, run, end });
      const panel = element("section", parent);
      const head = element("h3", panel, { textContent: run.name + ": " });
      element("span", head, { textContent: run.outcome, className: run.collides ? "bad" : "good" });
      this.clock = element("small", head);
      const [[left, right], [low, high]] = animation.shown;
      this.scene = element("canvas", panel, { className: "scene" });
      this.scene.setAttribute("role", "img");
      this.scene.setAttribute("aria-label", `${run.name}: ${run.outcome}`);
      this.scene.style.aspectRatio = `${right - left} / ${high - low}`;
      this.time = element("canvas", panel, { className: "outputs", ariaHidden: "true" });
    }

    // A canvas with the size that it is shown in, whatever a pixel is.
    pen(canvas) {
      const { width, height } = canvas.getBoundingClientRect();
      const scale = window.devicePixelRatio || 1;
      canvas.width = Math.max(1, Math.round(width * scale));
      canvas.height = Math.max(1, Math.round(height * scale));
      const pen = canvas.getContext("2d");
      pen.scale(scale, scale);
      return { pen, width, height };
    }

    draw(now) {
      this.drawScene(now);
      this.drawOutputs(now);
    }

    drawScene(now) {
      const { pen, width } = this.pen(this.scene);
      const [[left, right], [, high]] = this.animation.shown;
      const metre = width / (right - left);
      const x = (at) => (at - left) * metre;
      const y = (at) => (high - at) * metre;
      for (const [kind, corners] of this.animation.still) {
        pen.fillStyle = colour(kind === "wall" ? "--wall" : "--road");
        pen.beginPath();
        corners.forEach(([cx, cy]) => pen.lineTo(x(cx), y(cy)));
        pen.fill();
      }
      for (const { role, size, poses } of this.run.bodies) {
        const [fx, fy, heading] = pose(poses, now);
        const isHit = this.run.collides && role === "ego" && now >= this.end - 1 / RATE;
        pen.fillStyle = colour(isHit ? "--bad" : ROLES[role]);
        pen.save();
        pen.translate(x(fx), y(fy));
        pen.rotate(-heading);
        pen.beginPath();
        if (role === "person") {
          pen.arc(0, 0, Math.max(3, (size[0] / 2) * metre), 0, 2 * Math.PI);
        } else {
          pen.roundRect(-size[0] * metre, (-size[1] / 2) * metre, size[0] * metre, size[1] * metre, 2);
        }
        pen.fill();
        pen.restore();
      }
      const isDecided = this.run.decided !== null && now >= this.run.decided;
      const decided = isDecided ? `, decided at ${this.run.decided.toFixed(2)} s` : "";
      this.clock.textContent = ` ${now.toFixed(2)} s${decided}`;
    }

    // A row for each source, a mark for each output.
    drawOutputs(now) {
      const { pen, width } = this.pen(this.time);
      const names = { 0: "local", 1: "cloud" };
      const x = (at) => 44 + (at / this.end) * (width - 52);
      pen.font = "11px Inter, system-ui, sans-serif";
      for (const source of [1, 0]) {
        const y = source === 1 ? 9 : 25;
        pen.fillStyle = colour("--soft");
        pen.fillText(names[source], 4, y + 4);
        pen.fillStyle = colour(source === 1 ? "--other" : "--ego");
        for (const [at, by] of this.run.outputs) {
          if (Math.min(by, 1) === source && at <= now) pen.fillRect(x(at) - 1, y - 5, 2, 10);
        }
      }
      pen.fillStyle = colour("--ink");
      pen.fillRect(x(now), 0, 1, 34);
    }
  }

  const show = (animation, figure) => {
    const poses = animation.runs.flatMap((run) => run.bodies.map((body) => body.poses.length));
    const end = (Math.max(...poses) - 1) / RATE;
    const views = element("div", figure, { className: "views" });
    const shown = animation.runs.map((run) => new View(animation, run, views, end));
    const controls = element("div", figure, { className: "controls" });
    const play = element("button", controls, { type: "button", textContent: "Play" });
    const slider = element("input", controls, {
      type: "range", min: 0, max: end, step: 1 / RATE, value: end, ariaLabel: "time in seconds",
    });
    element("figcaption", figure, { textContent: animation.caption });
    let [now, last, playing] = [end, null, false];
    const draw = () => shown.forEach((view) => view.draw(now));
    const set = (isPlaying) => {
      playing = isPlaying;
      play.textContent = isPlaying ? "Pause" : "Play";
      last = null;
    };
    const step = (at) => {
      if (!playing) return;
      now = Math.min(end, now + (last === null ? 0 : (at - last) / 1000));
      last = at;
      slider.value = now;
      draw();
      if (now >= end) set(false);
      else requestAnimationFrame(step);
    };
    play.addEventListener("click", () => {
      if (now >= end) now = 0;
      set(!playing);
      requestAnimationFrame(step);
    });
    slider.addEventListener("input", () => {
      set(false);
      now = Number(slider.value);
      draw();
    });
    new ResizeObserver(draw).observe(views);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    draw();
  };

  document.querySelectorAll("figure.animation").forEach((figure, index) => show(animations[index], figure));
})();
