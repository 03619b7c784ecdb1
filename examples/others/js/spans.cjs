// A hedged gRPC client as OpenTelemetry sees it: node spans.cjs hedging FOLDER SCENARIO. Of the operator there is nothing but
// spans: those of gRPC's instrumentation, and one each of the decision and of local.
const { registerInstrumentations } = require('@opentelemetry/instrumentation');
const { GrpcInstrumentation } = require('@opentelemetry/instrumentation-grpc');
const { JsonTraceSerializer } = require('@opentelemetry/otlp-transformer');
const { InMemorySpanExporter, SimpleSpanProcessor } = require('@opentelemetry/sdk-trace-base');
const { NodeTracerProvider } = require('@opentelemetry/sdk-trace-node');
const { trace } = require('@opentelemetry/api');
const { spawn } = require('node:child_process');
const fs = require('node:fs');
const path = require('node:path');

const memory = new InMemorySpanExporter();
new NodeTracerProvider({ spanProcessors: [new SimpleSpanProcessor(memory)] }).register();
registerInstrumentations({ instrumentations: [new GrpcInstrumentation()] });
const grpc = require('@grpc/grpc-js'); // after the instrumentation
const loader = require('@grpc/proto-loader');

const [folder, text] = process.argv.slice(3);
const { delays, kill_at, period = 60, deadline = 100 } = JSON.parse(text);
const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const beside = (name) => path.join(__dirname, name);
const tracer = trace.getTracer('robot');
const server = spawn('node', [beside('server.mjs'), folder, text], { stdio: ['ignore', 'pipe', 'inherit'] });

server.stdout.once('data', async (port) => {
  const { infer } = grpc.loadPackageDefinition(loader.loadSync(beside('infer.proto'), { longs: Number }));
  const hedgingPolicy = { maxAttempts: 2, hedgingDelay: '0.04s', nonFatalStatusCodes: ['UNAVAILABLE'] };
  const model = new infer.Model(`127.0.0.1:${parseInt(port)}`, grpc.credentials.createInsecure(), {
    'grpc.service_config': JSON.stringify({ methodConfig: [{ name: [{}], hedgingPolicy }] }),
  });
  const call = (t) =>
    new Promise((resolve, reject) => {
      const done = (error, reply) => (error ? reject(error) : resolve(reply));
      model.Infer({ t }, new grpc.Metadata(), { deadline: Date.now() + deadline }, done);
    });
  for (let t = -1; t > -20; t--) await call(t).catch(() => 0); // warm up
  memory.reset();
  const start = performance.now();
  const message = async (_, t) => {
    await sleep(start + period * t - performance.now());
    if (t === kill_at) server.kill('SIGKILL');
    await tracer.startActiveSpan('decide', { attributes: { 'frame.id': t } }, async (span) => {
      const local = tracer.startActiveSpan('local.policy', async (own) => {
        await sleep(4);
        own.end();
      });
      await call(t).catch(() => local);
      span.end();
    });
  };
  await Promise.all(delays.map(message));
  await sleep(200);
  const spans = JsonTraceSerializer.serializeRequest(memory.getFinishedSpans());
  fs.writeFileSync(path.join(folder, 'spans.json'), Buffer.from(spans));
  server.kill('SIGKILL');
  process.exit(0);
});
