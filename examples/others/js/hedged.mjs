// grpc-js with a hedging policy and a deadline, local's result as the fallback: node hedged.mjs hedging FOLDER SCENARIO
import grpc from '@grpc/grpc-js';
import loader from '@grpc/proto-loader';
import { beside, drive, record, scenario, serve, sleep } from './facts.mjs';

const server = await serve('node', beside('server.mjs'));
const { infer } = grpc.loadPackageDefinition(loader.loadSync(beside('infer.proto'), { longs: Number }));
const hedgingPolicy = { maxAttempts: 2, hedgingDelay: '0.04s', nonFatalStatusCodes: ['UNAVAILABLE'] };
const model = new infer.Model(`127.0.0.1:${server.port}`, grpc.credentials.createInsecure(), {
  'grpc.service_config': JSON.stringify({ methodConfig: [{ name: [{}], hedgingPolicy }] }),
});

const call = (t, options) =>
  new Promise((resolve, reject) => {
    model.Infer({ t }, new grpc.Metadata(), options, (error, reply) => {
      if (!error) return resolve(reply);
      const isOurs = [grpc.status.DEADLINE_EXCEEDED, grpc.status.CANCELLED].includes(error.code);
      if (t >= 0 && !isOurs) record('fail', t, { p: 1 });
      reject(error);
    });
  });

await new Promise((resolve) => model.waitForReady(Date.now() + 3000, resolve));
for (let t = -1; t > -20; t--) await call(t, {}); // warm up
await drive(server, async (t) => {
  record('request', t, { p: 1, deadline: scenario.deadline * 1e6 });
  const local = sleep(4).then(() => record('result', t, { p: 0 }));
  const done = await call(t, { deadline: Date.now() + scenario.deadline }).then(
    (reply) => ({ p: 1, of: reply.t }),
    () => local.then(() => ({ p: 0 })),
  );
  record('emit', t, done);
});
