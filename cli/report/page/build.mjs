// Builds dist/ (or the folder named) from main.js and style.css, with the licences of what is in it.
import { build } from "esbuild";
import { readFile, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));
const out = process.argv[2] ?? here("dist");
const { metafile } = await build({
  absWorkingDir: here("."),
  entryPoints: { report: "main.js" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  metafile: true,
});

const of = (path) => /^node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(path)?.[1];
const packages = [...new Set(Object.keys(metafile.inputs).map(of).filter(Boolean))].sort();
const texts = await Promise.all(
  packages.map(async (name) => {
    const { version } = JSON.parse(await readFile(here(`node_modules/${name}/package.json`), "utf8"));
    const licence = await readFile(here(`node_modules/${name}/LICENSE`), "utf8");
    return `This page contains ${name} ${version}:\n\n${licence.trim()}\n`;
  }),
);
await writeFile(`${out}/LICENSES.txt`, texts.join("\n"));
