// A model over gRPC whose replies come as late as the scenario says: node server.mjs FOLDER SCENARIO. It prints its port.
import grpc from '@grpc/grpc-js';
import loader from '@grpc/proto-loader';
import fs from 'node:fs';
import { fileURLToPath } from 'node:url';

const [folder, text] = process.argv.slice(2);
const { delays } = JSON.parse(text);
const proto = fileURLToPath(new URL('infer.proto', import.meta.url));
const { infer } = grpc.loadPackageDefinition(loader.loadSync(proto, { longs: Number }));
const attempts = {};

const Infer = ({ request, cancelled }, done) => {
  const t = Number(request.t);
  const attempt = (attempts[t] = (attempts[t] ?? -1) + 1);
  const planned = [delays[t] ?? 1].flat();
  const delay = t < 0 ? 1 : delays[t] === null ? null : planned[Math.min(attempt, planned.length - 1)];
  if (delay === null) return;
  if (delay === 'fail') return done({ code: grpc.status.UNAVAILABLE, details: 'it fails' });
  setTimeout(() => {
    if (t >= 0 && !cancelled) {
      const line = `{"ev":"result","at":${process.hrtime.bigint()},"t":${t},"p":1,"of":${t}}\n`;
      fs.appendFileSync(`${folder}/server.facts`, line);
    }
    done(null, { t });
  }, delay);
};

const server = new grpc.Server();
server.addService(infer.Model.service, { Infer });
server.bindAsync('127.0.0.1:0', grpc.ServerCredentials.createInsecure(), (error, port) => {
  if (error) throw error;
  console.log(port);
});
