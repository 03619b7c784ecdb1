// Libraries of timeouts and fallbacks, local's result as the fallback: node fallbacks.mjs LIBRARY FOLDER SCENARIO
import net from 'node:net';
import { TimeoutStrategy, fallback, handleAll, timeout, wrap } from 'cockatiel';
import CircuitBreaker from 'opossum';
import { beside, drive, mode, record, scenario, serve, sleep } from './facts.mjs';

const server = await serve('python3', beside('../python/server.py'), 'lines');

const call = (t, signal) =>
  new Promise((resolve, reject) => {
    const socket = net.connect(server.port, '127.0.0.1', () => socket.write(`${t} 0\n`));
    const failed = (error) => {
      if (!signal?.aborted) record('fail', t, { p: 1, try: 0 });
      reject(error ?? new Error('closed'));
    };
    socket.once('data', (line) => {
      socket.removeAllListeners().destroy();
      resolve({ p: 1, of: parseInt(line) });
    });
    socket.once('error', failed).once('end', failed);
    signal?.addEventListener('abort', () => socket.destroy());
  });

const D = scenario.deadline;
const cockatiel = (strategy) => (t, local) =>
  wrap(fallback(handleAll, () => local), timeout(D, strategy)).execute(({ signal }) =>
    call(t, strategy === TimeoutStrategy.Aggressive ? signal : undefined),
  );
const breaker = new CircuitBreaker((t) => call(t), { timeout: D, volumeThreshold: 1000 });
breaker.fallback((t, local) => local);
const library = {
  'cockatiel-aggressive': cockatiel(TimeoutStrategy.Aggressive),
  'cockatiel-cooperative': cockatiel(TimeoutStrategy.Cooperative),
  opossum: (t, local) => breaker.fire(t, local),
}[mode];

await drive(server, async (t) => {
  record('request', t, { p: 1, deadline: D * 1e6, try: 0 });
  const local = sleep(4).then(() => {
    record('result', t, { p: 0 });
    return { p: 0 };
  });
  record('emit', t, await library(t, local));
});
