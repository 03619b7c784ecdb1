// The page in a real browser: node --test test.mjs, with CHROMIUM, FUSELINE (the command) and SHOTS (a folder).

import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import puppeteer from "puppeteer-core";
import { axis, time } from "./format.js";

const { CHROMIUM, FUSELINE, SHOTS, CORPUS } = process.env;
const MESSAGES = 100_000;
const folder = mkdtempSync(join(tmpdir(), "report-"));
let browser;

before(async () => {
  mkdirSync(SHOTS, { recursive: true });
  browser = await puppeteer.launch({ executablePath: CHROMIUM, pipe: true, args: ["--no-sandbox", "--disable-gpu"] });
});
after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true });
});

/** Makes a page of traces; answers its file. */
function report(name, ...traces) {
  const file = join(folder, `${name}.html`);
  const { status, stderr } = spawnSync(FUSELINE, ["report", ...traces, "--force", "-o", file], { encoding: "utf8" });
  assert.ok([0, 1, 3].includes(status), stderr);
  return file;
}

/** Opens it; whatever it asks for but itself, and whatever goes wrong in it, fails the test. */
async function open(t, file, { hash = "", scheme = "light", width = 1180, height = 1500 } = {}) {
  const page = await browser.newPage();
  // On a busy host a page may take half a minute.
  page.setDefaultTimeout(180_000);
  const wrong = [];
  page.on("pageerror", (error) => wrong.push(error.stack ?? error.message));
  page.on("console", (message) => wrong.push(message.text()));
  page.on("request", (request) => /^(file|data):/.test(request.url()) || wrong.push(request.url()));
  await page.emulateMediaFeatures([
    { name: "prefers-color-scheme", value: scheme },
    { name: "prefers-reduced-motion", value: "reduce" },
  ]);
  const phone = width < 600;
  await page.setViewport({ width, height, isMobile: phone, hasTouch: phone, deviceScaleFactor: phone ? 2 : 1 });
  await page.goto(`file://${file}${hash}`);
  await settle(page);
  t.after(async () => {
    await page.close();
    assert.deepEqual(wrong, []);
  });
  return page;
}

/** Waits until what was done is seen and told. */
const settle = (page) => page.evaluate(() => new Promise((done) => setTimeout(() => requestAnimationFrame(done), 250)));
const text = (page, selector) => page.$eval(selector, (element) => element.innerText.trim());
const hidden = (page, selector) => page.$eval(selector, (element) => element.hidden);
const shot = (page, name) => page.screenshot({ path: join(SHOTS, `${name}.png`), fullPage: true });
async function press(page, ...keys) {
  for (const key of keys) await page.keyboard.press(key);
  await settle(page);
}

/** How many pixels have this colour, given as #rrggbb, of a plot's canvas or of its part up to a distance from the left. */
const pixels = (page, colour, plot = "#timeline", to = Infinity) =>
  page.$eval(`${plot} canvas`, (canvas, name, to) => {
    const colour = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const rgb = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    const { data } = copy.getImageData(0, 0, Math.min(canvas.width, to * devicePixelRatio), canvas.height);
    let n = 0;
    for (let i = 0; i < data.length; i += 4) if (rgb.every((part, at) => data[i + at] === part)) n++;
    return n;
  }, colour, to);

/** A short run's trace, with what the command notes in it. */
function run(name, ...options) {
  const file = join(folder, `${name}.jsonl`);
  execFileSync(FUSELINE, ["run", "--for", "2s", "--trace", file, ...options], { stdio: "ignore" });
  return file;
}

test("a run's policies, configuration and caveats are told, light, dark and on a phone", async (t) => {
  const file = report("run", run("policies"));
  for (const [name, options] of [["run-light", {}], ["run-dark", { scheme: "dark" }], ["run-phone", { width: 390, height: 844 }]]) {
    const page = await open(t, file, options);
    assert.equal(await page.title(), "detector · policies.jsonl – Fuseline report");
    assert.equal(await text(page, "h1"), "detector · policies.jsonl");
    const rows = await page.$$eval("#scores tbody tr", (all) => all.map((row) => row.cells[0].textContent));
    assert.deepEqual(rows, ["fusion", "constant 500 ms", "local only", "cloud only: west", "cloud only: east", "first response wins", "progressive"]);
    assert.match(await text(page, "#caveats"), /AP is COCO's box AP/);
    assert.match(await page.$eval("#configuration", (list) => list.textContent), /Longest deadline500 ms/);
    assert.equal(await hidden(page, "#compared"), true);
    assert.match(await text(page, "#sources thead"), /Deadlines/);
    const named = /deadlines?((?: [\d.]+\sm?s,?)+)/.exec(await text(page, "#legend"))[1].split(",").map(parseFloat);
    assert.deepEqual(named, [...named].sort((a, b) => a - b));
    await shot(page, name);
  }
});

test("two runs stand side by side", async (t) => {
  const file = report("pair", run("first"), run("second", "--deadline", "300ms", "--policy", "constant"));
  for (const [name, options] of [["pair-light", {}], ["pair-dark", { scheme: "dark" }], ["pair-phone", { width: 390, height: 844 }]]) {
    const page = await open(t, file, options);
    assert.equal(await page.title(), "2 traces – Fuseline report");
    const cells = await page.$$eval("#comparison tbody tr", (all) => all.map((row) => [...row.cells].map((cell) => cell.innerText)));
    const row = (name) => cells.find(([one]) => one === name)?.slice(1);
    assert.deepEqual(row("Longest deadline"), ["500 ms", "300 ms"]);
    assert.deepEqual(row("Messages"), ["20", "20"]);
    assert.equal(row("Fusion: mean AP").length, 2);
    assert.equal(row("By local").length, 2);
    // Each row's name has room.
    const cut = await page.$$eval("#comparison tbody th", (all) => all.filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.innerText));
    assert.deepEqual(cut, []);
    await shot(page, name);
  }
});

test("a part of a trace keeps the file's lines", async (t) => {
  const file = join(folder, "part.html");
  const trace = run("part");
  spawnSync(FUSELINE, ["report", trace, "--timestamps", "7..7", "--force", "-o", file]);
  const page = await open(t, file, { hash: "#t=7" });
  const line = readFileSync(trace, "utf8").split("\n").findIndex((one) => /"ev":"open",.*"t":7[,}]/.test(one)) + 1;
  assert.ok(line > 7);
  assert.equal(await page.$eval("#events .line", (one) => one.textContent), `line ${line}`);
});

/** What the command told the page. */
const toldOf = (file) => JSON.parse(/id="data">(.*?)<\/script>/s.exec(readFileSync(file, "utf8"))[1]);
const parse = (shown) => Number(shown.replaceAll(",", ""));

const bad = () => report("bad", join(CORPUS, "bad/f3-first-response-wins.jsonl"));

/** A camera's run; both clouds lose their networks by turns. */
const runs = new Map();
function camera(messages = MESSAGES) {
  if (runs.has(messages)) return runs.get(messages);
  let seed = 1;
  const random = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
  const events = [];
  for (let t = 0; t < messages; t++) {
    const at = t * 100_000;
    events.push([at, `"ev":"open","at":${at},"t":${t}`]);
    for (const p of [1, 2]) {
      events.push([at, `"ev":"offer","at":${at},"t":${t},"p":${p},"deadline":500000,"backlog":${Math.floor(random() * 33)}`]);
      const lost = Math.floor(t / 2500) % 4 >= 4 - p;
      const answered = at + Math.floor((80 + 200 * random() ** 2) * (lost ? 5 : 1) * 1000);
      events.push([answered, `"ev":"${random() < 0.01 ? "fail" : "result"}","at":${answered},"t":${t},"p":${p}`]);
    }
    const local = at + 300_000 + Math.floor(random() * 20_000);
    events.push([local, `"ev":"${random() < 0.01 ? "fail" : "result"}","at":${local},"t":${t},"p":0`]);
  }
  events.sort(([a], [b]) => a - b);
  const header = '{"fuseline":1,"operator":"camera","window":64,"clouds":[{"p":1,"name":"west","limit":31},{"p":2,"name":"east","limit":31}]}';
  const inputs = `${header}\n${events.map(([, event]) => `{${event}}\n`).join("")}`;
  const trace = join(folder, "camera.jsonl");
  writeFileSync(trace, execFileSync(FUSELINE, ["replay"], { input: inputs, maxBuffer: 1 << 30 }));
  runs.set(messages, report(`camera-${messages}`, trace));
  return runs.get(messages);
}

test("the summary counts what came out of the run", async (t) => {
  const page = await open(t, camera());
  const figures = Object.fromEntries(
    await page.$$eval("#figures div", (all) => all.map((one) => [one.children[0].innerText, one.children[1].innerText])),
  );
  const number = (name) => Number(figures[name].replaceAll(",", ""));
  assert.equal(number("Messages"), MESSAGES);
  assert.ok(number("Missed") > 0);
  assert.equal(number("Forwarded") + number("Missed"), MESSAGES);
  const { columns, traces: [{ account }] } = toldOf(camera());
  assert.equal(number("Messages"), account.messages);
  const rows = await page.$$eval("#sources tbody tr", (all) =>
    all.map((row) => Object.fromEntries([...row.querySelectorAll("[data-of]")].map((cell) => [cell.dataset.of, cell.innerText]))));
  assert.equal(rows.length, 3);
  for (const [at, row] of rows.entries()) {
    for (const [n, [word]] of columns.entries()) assert.equal(parse(row[word] ?? "0"), account.rows[at].counts[n], word);
    const { requests, refused, ...fates } = Object.fromEntries(Object.entries(row).map(([word, shown]) => [word, parse(shown)]));
    assert.equal(Object.values(fates).reduce((sum, n) => sum + n), requests);
    if (at > 0) assert.ok(refused > 0);
  }
  assert.equal(rows.reduce((sum, row) => sum + parse(row.forwarded), 0), number("Forwarded"));
  // A chip counts what the table counts.
  const chips = Object.fromEntries(await page.$$eval("#filters button", (all) => all.map((one) => [one.dataset.label, one.querySelector("span").innerText])));
  assert.equal(chips["forwarded east"], rows[2].forwarded);
  assert.equal(chips["late west"], rows[1].late);
  assert.equal(chips["failed local"], rows[0].failed);
  assert.match(await text(page, "#verdict"), /^✓ conforms$/);
  for (const source of [0, 1, 2]) assert.ok((await pixels(page, `--source-${source}`)) > 500, `source ${source}`);
  assert.ok((await pixels(page, "--bad")) > 10);
  await shot(page, "whole-run");
});

test("the deadline is a line in both plots, and no point is where the labels are", async (t) => {
  const page = await open(t, camera());
  for (const plot of ["#timeline", "#spread"]) assert.ok((await pixels(page, "--ink", plot)) > 100, plot);
  for (const source of [0, 1, 2]) assert.equal(await pixels(page, `--source-${source}`, "#timeline", 55), 0);
  assert.match(await text(page, "#legend"), /deadline 500\sµs/);
});

test("a duration has the unit that its rounded number wants", () => {
  for (const [ns, shown] of [[999, "999 ns"], [1000, "1 µs"], [999_499, "999 µs"], [999_500, "1 ms"], [999_999, "1 ms"],
    [1e6, "1 ms"], [999_949_999, "1 s"], [12_340_000, "12.3 ms"], [0, "0"]]) {
    assert.equal(time(ns).replace("\u00a0", " "), shown, String(ns));
  }
  assert.deepEqual(axis([0, 500_000, 1e6, 1.5e6], 500_000), ["0 ms", "0.5 ms", "1 ms", "1.5 ms"]);
  assert.deepEqual(axis([0, 200_000, 400_000], 200_000), ["0 µs", "200 µs", "400 µs"]);
});

test("all violations are marked and counted, though the page has details of the first", async (t) => {
  const lines = ['{"fuseline":1,"window":9,"clouds":[]}'];
  for (let n = 0; n < 250; n++) lines.push(`{"ev":"open","at":${n},"t":${n}}`, `{"ev":"miss","at":${n},"t":${n}}`);
  const trace = join(folder, "many.jsonl");
  writeFileSync(trace, `${lines.join("\n")}\n`);
  const page = await open(t, report("many", trace));
  const whole = /(\d+) violations/.exec(await text(page, "#verdict"))[1];
  assert.ok(Number(whole) > 100, whole);
  const chips = await page.$$eval("#filters .bad", (all) => all.filter((one) => one.dataset.label.startsWith("violation")).map((one) => one.querySelector("span").innerText));
  assert.equal(chips.reduce((sum, shown) => sum + parse(shown), 0), Number(whole));
  // The last one too: the timeline has marks to its end.
  const reach = await page.$eval("#timeline canvas", (canvas) => {
    const bad = getComputedStyle(document.documentElement).getPropertyValue("--bad").trim();
    const rgb = [1, 3, 5].map((at) => parseInt(bad.slice(at, at + 2), 16));
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    // The marks stand on the upper rim, above all that is drawn of misses.
    const { data } = copy.getImageData(0, 0, canvas.width, 3 * devicePixelRatio);
    let right = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (rgb.every((part, at) => data[i + at] === part)) right = Math.max(right, (i / 4) % canvas.width);
    }
    return right / canvas.width;
  });
  assert.ok(reach > 0.95, `marks reach to ${reach}`);
});

test("a violation is found and told with its rule", async (t) => {
  const page = await open(t, bad());
  assert.equal(await text(page, "#verdict"), "✕ does not conform: 1 violation");
  await press(page, "/");
  await page.keyboard.type("violation");
  await settle(page);
  assert.equal(await text(page, "#hits"), "1 timestamp found");
  await press(page, "Enter");
  assert.equal(await text(page, "#hits"), "1 of 1");
  assert.equal(await text(page, "#story-title"), "Timestamp 1");
  const breach = await text(page, "#breaches");
  assert.match(breach, /Breaks F3 at line 8/);
  assert.match(breach, /A result is dropped for the first of unknown, superseded, unsolicited, duplicate and late that holds/);
  assert.match(breach, /\{"ev":"hold","at":5,"t":1,"p":0\}/);
  assert.match(await text(page, "#events .broken"), /Forwarded: local breaks F3/);
  assert.ok((await pixels(page, "--bad")) > 50);
  await shot(page, "violation");
});

test("timestamps are found by number and by reason", async (t) => {
  const page = await open(t, camera());
  const find = async (query) => {
    await page.$eval("#query", (input) => (input.value = ""));
    await page.type("#query", query);
    await settle(page);
    return text(page, "#hits");
  };
  assert.equal(await find("4711"), "1 timestamp found");
  await press(page, "Enter");
  assert.equal(await text(page, "#story-title"), "Timestamp 4711");
  assert.match(await text(page, "#events"), /Message/);
  assert.match(await text(page, "#events"), /Forwarded|Missed/);
  assert.equal(await find(String(MESSAGES)), "nothing found");
  assert.match(await find("dropped superseded"), /^[\d,]+ timestamps found$/);
  await press(page, "Enter");
  assert.match(await text(page, "#events .drop"), /Dropped: superseded – that message is over/);
  const before = await text(page, "#story-title");
  await press(page, "Enter");
  assert.notEqual(await text(page, "#story-title"), before);
  assert.match(await text(page, "#hits"), /^2 of /);
  assert.match(await find("missed"), /found$/);
  await press(page, "Enter");
  assert.match(await text(page, "#ending"), /^Missed/);
  await shot(page, "missed");
});

test("everything goes by the keyboard", async (t) => {
  const page = await open(t, camera());
  await page.focus("#timeline");
  const ring = await page.$eval("#timeline", (element) => getComputedStyle(element).outlineStyle);
  assert.equal(ring, "solid");
  const whole = await text(page, "#view");
  await press(page, ...Array(12).fill("+"));
  const near = await text(page, "#view");
  assert.notEqual(near, whole);
  await press(page, "ArrowRight");
  assert.notEqual(await text(page, "#view"), near);
  await press(page, "ArrowLeft");
  assert.equal(await text(page, "#view"), near);
  await press(page, "Enter");
  assert.equal(await hidden(page, "#story"), false);
  const first = await text(page, "#story-title");
  await press(page, "j");
  assert.notEqual(await text(page, "#story-title"), first);
  await press(page, "k");
  assert.equal(await text(page, "#story-title"), first);
  await press(page, "Escape");
  assert.equal(await hidden(page, "#story"), true);
  assert.equal(await text(page, "#view"), near);
  await press(page, "Escape");
  assert.equal(await text(page, "#view"), whole);
  await press(page, "/");
  assert.equal(await page.evaluate(() => document.activeElement.id), "query");
});

test("a click goes to a timestamp, and the address names it", async (t) => {
  const page = await open(t, camera());
  await page.focus("#timeline");
  await press(page, ...Array(22).fill("+"));
  const { x, y } = await page.$eval("#timeline .u-over", (over) => over.getBoundingClientRect().toJSON());
  for (let i = 0; i < 20 && (await hidden(page, "#story")); i++) await page.mouse.click(x + 30 + 45 * i, y + 40);
  await settle(page);
  const title = await text(page, "#story-title");
  assert.equal(await page.evaluate(() => location.hash), `#t=${title.replace("Timestamp ", "")}`);
  await shot(page, "near");
});

test("wheel and drag move the timeline, the strip too", async (t) => {
  const page = await open(t, camera());
  const { x, y } = await page.$eval("#timeline .u-over", (over) => over.getBoundingClientRect().toJSON());
  const views = [await text(page, "#view")];
  const differs = async (what) => {
    await settle(page);
    const view = await text(page, "#view");
    assert.notEqual(view, views.at(-1), what);
    views.push(view);
  };
  await page.mouse.move(x + 400, y + 100);
  for (let i = 0; i < 8; i++) await page.mouse.wheel({ deltaY: -80 });
  await differs("wheel");
  await page.mouse.down();
  await page.mouse.move(x + 300, y + 100, { steps: 5 });
  await page.mouse.up();
  await differs("drag");
  assert.equal(await hidden(page, "#story"), true);
  const strip = await page.$eval("#overview", (canvas) => canvas.getBoundingClientRect().toJSON());
  await page.mouse.click(strip.x + strip.width * 0.9, strip.y + 10);
  await differs("strip");
  await page.click("#whole");
  await settle(page);
  assert.equal(await text(page, "#view"), views[0]);
});

test("names are texts", async (t) => {
  const name = "</script><img src=x onerror=alert(1)><b>";
  const trace = join(folder, "hostile.jsonl");
  writeFileSync(trace, `${JSON.stringify({ fuseline: 1, operator: name, window: 1, clouds: [{ p: 1, name, limit: 1 }] })}\n`
    + '{"ev":"open","at":0,"t":18446744073709551615}\n{"ev":"tick","at":9}\n');
  const page = await open(t, report("hostile", trace), { hash: "#t=18446744073709551615" });
  assert.match(await text(page, "h1"), /^<\/script><img src=x onerror=alert\(1\)><b> · /);
  assert.equal(await page.$$eval("img, h1 *, #sources .label *", (all) => all.length), 0);
  assert.equal(await text(page, "#story-title"), "Timestamp 18446744073709551615");
});

test("several traces stand side by side", async (t) => {
  const file = report("both", join(CORPUS, "f3-forwarded-at-once.jsonl"), join(CORPUS, "bad/f3-first-response-wins.jsonl"));
  const page = await open(t, file);
  await shot(page, "several");
  assert.match(await text(page, "#verdict"), /conforms$/);
  const rows = await page.$$eval("#traces tbody tr", (all) => all.map((row) => [...row.cells].map((cell) => cell.innerText)));
  assert.deepEqual(rows.map((row) => row.slice(1, 4)), [["✓ conforms", "–", "1"], ["✕ 1", "F3, line 8", "1"]]);
  await page.click("#traces tbody tr:nth-child(2) button");
  await settle(page);
  assert.equal(await page.evaluate(() => location.hash), "#trace=1");
  assert.match(await text(page, "#verdict"), /does not conform/);
  assert.match(await text(page, "#violations"), /F3 timestamp 1, line 8/);
});

test("every trace of the corpus can be shown, and each of its timestamps", async (t) => {
  const traces = [CORPUS, join(CORPUS, "bad")].flatMap((place) => readdirSync(place).filter((name) => name.endsWith(".jsonl")).map((name) => join(place, name)));
  const page = await open(t, report("corpus", ...traces));
  const told = await page.evaluate(async () => {
    const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
    const told = [];
    for (const row of document.getElementById("traces").tBodies[0].rows) {
      const choice = row.querySelector("button");
      choice.click();
      press("Escape");
      for (let i = 0, title; i < 40; i++) {
        press(i === 0 ? "Home" : "j");
        await new Promise(requestAnimationFrame);
        if (i > 1 && title === document.getElementById("story-title").textContent) break;
        title = document.getElementById("story-title").textContent;
      }
      const [verdict, violations] = ["verdict", "violations"].map((id) => document.getElementById(id));
      told.push([choice.title, verdict.textContent, violations.children.length]);
    }
    return told;
  });
  assert.equal(told.length, traces.length);
  for (const [name, verdict, violations] of told) {
    const bad = name.includes("/bad/");
    assert.equal(verdict.startsWith("✕"), bad, name);
    assert.equal(violations > 0, bad, name);
  }
});

for (const scheme of ["light", "dark"]) {
  test(`it can be read in the ${scheme}, on a phone too`, async (t) => {
    const page = await open(t, bad(), { scheme, width: 390, height: 840, hash: "#t=1" });
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
    const ratios = await page.evaluate(() => {
      const style = getComputedStyle(document.documentElement);
      const light = (name) => {
        const colour = style.getPropertyValue(`--${name}`).trim();
        const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255)
          .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
      };
      return ["ink", "soft", "bad", "good", "accent"].flatMap((ink) => ["panel", "ground"].map((on) =>
        [`${ink} on ${on}`, Math.max(light(ink), light(on)) / Math.min(light(ink), light(on))]));
    });
    for (const [pair, ratio] of ratios) assert.ok(ratio >= 4.5, `${pair}: ${ratio}`);
    await shot(page, `phone-${scheme}`);
    const run = await open(t, camera(), { scheme, width: 390, height: 840 });
    assert.ok(await run.$eval("#sources", (table) => table.scrollWidth > table.parentElement.clientWidth));
    await shot(run, `phone-run-${scheme}`);
  });
}

test("what 100,000 timestamps take is told", async (t) => {
  const begin = performance.now();
  const page = await open(t, camera(), { scheme: "dark" });
  console.log(`opened in ${Math.round(performance.now() - begin)} ms`);
  await page.focus("#timeline");
  for (const [where, keys] of [["whole run", ["+", "-"]], ["a half", ["+", "ArrowLeft", "ArrowRight", "-"]]]) {
    const frames = await page.evaluate(async (keys) => {
      const times = [];
      let last = performance.now();
      for (let i = 0; i < 60; i++) {
        document.activeElement.dispatchEvent(new KeyboardEvent("keydown", { key: keys[i % keys.length], bubbles: true }));
        await new Promise(requestAnimationFrame);
        times.push(performance.now() - last);
        last = performance.now();
      }
      return times.sort((a, b) => a - b);
    }, keys);
    console.log(`${where}: a frame in ${frames[30].toFixed(1)} ms at the median, ${frames[59].toFixed(1)} ms at worst`);
  }
  await shot(page, "dark");
});

test("a trace too long for a page is judged whole and shown from its beginning", async (t) => {
  const file = camera(150_000);
  const { traces: [{ account, capped, ev, lines }] } = toldOf(file);
  assert.equal(ev.length, 1_250_000);
  assert.ok(account.messages < 150_000 && capped.events === lines - 1);
  for (const [name, options] of [["long-light", {}], ["long-dark", { scheme: "dark" }], ["long-phone", { width: 390, height: 844 }]]) {
    const page = await open(t, file, options);
    const note = await text(page, "#capped");
    assert.match(note, /^The page ends at line 1,250,001: it shows the first 1,250,000 of [\d,]+ events\. /);
    const chips = Object.fromEntries(await page.$$eval("#filters button", (all) => all.map((one) => [one.dataset.label, one.querySelector("span").innerText])));
    assert.equal(parse(chips.missed), account.missed);
    for (const source of [0, 1, 2]) assert.ok((await pixels(page, `--source-${source}`)) > 300, `source ${source}`);
    await shot(page, name);
  }
});

test("words of one instant stand apart", async (t) => {
  const request = `{"ev":"offer","at":0,"t":1,"p":1,"deadline":200000000,"backlog":0}
{"ev":"request","at":0,"t":1,"p":1,"due":200000000}
`;
  const trace = (clouds) => {
    const file = join(folder, `instant-${clouds}.jsonl`);
    writeFileSync(file, `{"fuseline":1,"operator":"tracker","window":4,"clouds":[${clouds ? '{"p":1,"name":"west","limit":4}' : ""}]}
{"ev":"open","at":0,"t":1,"deadline":200000000}
${clouds ? request : ""}{"ev":"tick","at":200000000}
{"ev":"timer","at":200000000,"t":1,"p":0}
${clouds ? '{"ev":"timer","at":200000000,"t":1,"p":1}\n' : ""}{"ev":"miss","at":200000000,"t":1}
`);
    return file;
  };
  for (const [name, width, clouds] of [["instant-local", 1180, 0], ["instant", 1180, 1], ["instant-phone", 390, 1]]) {
    const page = await open(t, report("instant", trace(clouds)), { width, hash: "#t=1" });
    const words = await page.evaluate(async () => {
      const words = [];
      const draw = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...more) {
        const { e, f, a } = this.getTransform();
        const { width } = this.measureText(text);
        if (this.textAlign === "left") words.push([text, e + a * x, e + a * (x + width), f + a * (y - 9), f + a * y]);
        draw.call(this, text, x, y, ...more);
      };
      document.dispatchEvent(new KeyboardEvent("keydown", { key: "-" }));
      await new Promise((done) => setTimeout(done, 400));
      return words;
    });
    const said = [...new Map(words.map((word) => [String(word), word])).values()];
    assert.ok(["due", "timer"].every((text) => said.filter((word) => word[0] === text).length > clouds), JSON.stringify(said));
    const over = (a, b) => a !== b && a[1] < b[2] && b[1] < a[2] && a[3] < b[4] && b[3] < a[4];
    const clash = said.flatMap((a) => said.filter((b) => over(a, b)).map((b) => `${a[0]} on ${b[0]}`));
    assert.deepEqual(clash, []);
    await shot(page, name);
  }
});

test("a timestamp's story says what its message comes from and how old its output is", async (t) => {
  const trace = join(folder, "lineage.jsonl");
  writeFileSync(trace, `{"fuseline":1,"operator":"tracker","window":4,"clouds":[]}
{"ev":"open","at":5000000,"t":7,"within":90000000,"age":30000000,"origin":"camera/front","seq":41}
{"ev":"result","at":25000000,"t":7,"p":0}
{"ev":"emit","at":25000000,"t":7,"p":0}
{"ev":"open","at":30000000,"t":8}
{"ev":"result","at":31000000,"t":8,"p":0}
{"ev":"emit","at":31000000,"t":8,"p":0}
`);
  const file = report("lineage", trace);
  assert.deepEqual(toldOf(file).traces[0].lineages, [{ t: 0, age: 30000000, origin: "camera/front", seq: 41 }]);
  const page = await open(t, file, { hash: "#t=7" });
  const ending = await text(page, "#ending");
  assert.match(ending, /The message comes from camera\/front 41; it was 30.ms old as it was opened and 50.ms as its output was sent\.$/);
});

test("a timestamp's story follows its frame through the traces of all operators", async (t) => {
  const [detector, tracker] = ["detector", "tracker"].map((name) => join(folder, `${name}.jsonl`));
  writeFileSync(detector, `{"fuseline":1,"operator":"detector","window":4,"clouds":[{"p":1,"name":"west","limit":4}]}
{"ev":"open","at":1000000,"t":4,"deadline":200000000,"within":500000000,"age":1000000,"origin":"camera","seq":41}
{"ev":"offer","at":1000000,"t":4,"p":1,"deadline":150000000,"backlog":0}
{"ev":"request","at":1000000,"t":4,"p":1,"due":151000000}
{"ev":"open","at":90000000,"t":5,"age":0,"origin":"camera","seq":42}
{"ev":"result","at":91000000,"t":5,"p":0}
{"ev":"emit","at":91000000,"t":5,"p":0}
{"ev":"tick","at":151000000}
{"ev":"timer","at":151000000,"t":4,"p":1}
{"ev":"tick","at":201000000}
{"ev":"timer","at":201000000,"t":4,"p":0}
{"ev":"miss","at":201000000,"t":4}
`);
  writeFileSync(tracker, `{"fuseline":1,"operator":"tracker","window":4,"clouds":[]}
{"ev":"open","at":7000000000,"t":0,"age":205000000,"origin":"camera","seq":41}
{"ev":"result","at":7020000000,"t":0,"p":0}
{"ev":"emit","at":7020000000,"t":0,"p":0}
`);
  const page = await open(t, report("frame", tracker, detector), { hash: "#t=0" });
  assert.match(await text(page, "#frame-title"), /^camera 41 /);
  assert.match(await text(page, "#frame-most"), /225.ms old .* most went to: detector, 200.ms or 88\.9 %\.$/);
  const rows = await page.$$eval("#stages tbody tr", (rows) => rows.map((row) => [...row.cells].map((cell) => cell.innerText.trim().replaceAll("\u00a0", " "))));
  assert.deepEqual(rows, [
    ["detector", "", "1 ms", "201 ms", "missed", "local late, west late"],
    ["tracker", "", "205 ms", "225 ms", "local", "local forwarded"],
  ]);
  await shot(page, "frame");
  await page.click("#stages tbody tr button");
  await settle(page);
  assert.match(await text(page, "#ending"), /^Missed 200.ms after its message/);
  await press(page, "j");
  assert.equal(await hidden(page, "#frame"), true);
});

test("a dead sensor is named, and a frame's life reaches control, whose ticks use its plan again", async (t) => {
  const [detector, control] = ["cameras", "control"].map((name) => join(folder, `${name}.jsonl`));
  const operator = (name) => `{"fuseline":1,"operator":"${name}","window":4,"clouds":[]}\n`;
  const message = (t, at, age, seq, missing) => `{"ev":"open","at":${at},"t":${t},"age":${age},"origin":"left-camera","seq":${seq}${missing}}
{"ev":"result","at":${at + 1e6},"t":${t},"p":0}
{"ev":"emit","at":${at + 1e6},"t":${t},"p":0}\n`;
  const dead = ',"missing":["right","place"]';
  writeFileSync(detector, operator("detection") + message(0, 0, 0, 7, "") + message(1, 1e8, 2e7, 8, dead));
  writeFileSync(control, operator("control") + message(0, 0, 3e7, 7, "") + message(1, 5e7, 4e7, 8, dead) + message(2, 1e8, 9e7, 8, dead));
  const file = report("control", detector, control);
  assert.deepEqual(toldOf(file).traces[0].lineages[1].missing, ["right", "place"]);
  const page = await open(t, file, { hash: "#t=1" });
  assert.match(await text(page, "#ending"), /\. Nothing came from right and place\.$/);
  assert.match(await text(page, "#filters"), /without right 1/);
  assert.equal(await text(page, "#frame-title"), "left-camera 8 through 2 operators");
  const rows = await page.$$eval("#stages tbody tr", (rows) => rows.map((row) => [row.cells[0], row.cells[4]].map((cell) => cell.innerText.trim())));
  assert.deepEqual(rows, [["detection", "local, without right place"], ["control", "local, and 1 more of this frame, without right place"]]);
  await page.type("#query", "without place");
  assert.equal(await text(page, "#hits"), "1 timestamp found");
  await shot(page, "control");
});
