// The facts that a harness records, on CLOCK_MONOTONIC, and the server that it calls.
import { spawn } from 'node:child_process';
import fs from 'node:fs';
import { fileURLToPath } from 'node:url';

export const [mode, folder, text] = process.argv.slice(2);
export const scenario = { period: 60, deadline: 100, ...JSON.parse(text) };

export const record = (ev, t, keys = {}) => {
  const at = process.hrtime.bigint();
  const rest = JSON.stringify({ ev, ...(t === undefined ? {} : { t }), ...keys }).slice(1);
  fs.appendFileSync(`${folder}/robot-${process.pid}.facts`, `{"at":${at},${rest}\n`);
};

// Starts a server that prints its port.
export const serve = async (command, ...args) => {
  const process = spawn(command, [...args, folder, text], { stdio: ['ignore', 'pipe', 'inherit'] });
  const port = await new Promise((resolve) => process.stdout.once('data', (line) => resolve(+line)));
  return { port, kill: () => process.kill('SIGKILL') };
};

export const beside = (name) => fileURLToPath(new URL(name, import.meta.url));

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// Opens each message at its time; `block_at` has the loop blocked while its call is under way.
export const drive = async (server, message) => {
  const start = performance.now();
  const all = scenario.delays.map(async (_, t) => {
    await sleep(start + scenario.period * t - performance.now());
    if (t === scenario.kill_at) server.kill();
    record('open', t);
    if (t === scenario.block_at) {
      setTimeout(() => {
        for (const end = performance.now() + scenario.block; performance.now() < end; );
      }, 30);
    }
    await message(t);
  });
  await Promise.race([Promise.all(all), sleep(scenario.period * all.length + 1000)]);
  record('tick');
  // The server may have yet to record the last reply.
  await sleep(200);
  server.kill();
  process.exit(0);
};
