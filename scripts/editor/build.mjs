// Bundle codemirror.js and what it imports into one file of the Python package, with the licenses of all of it.
//
// The file begins with a digest of the sources here and one of the code, so that a test sees when they part.

import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const SOURCES = ["build.mjs", "codemirror.js", "package-lock.json", "package.json"];
const OUT = "../../mpvi_bt/apps/watch/page/codemirror.js";

const digest = (...parts) => parts.reduce((hash, part) => hash.update(part), createHash("sha256")).digest("hex");

const made = await build({
  entryPoints: ["codemirror.js"],
  bundle: true,
  format: "iife",
  globalName: "CodeMirror",
  minify: true,
  target: "es2022",
  charset: "ascii",
  legalComments: "none", // they follow below, in full
  metafile: true,
  write: false,
});

const code = made.outputFiles[0].text;
const names = Object.keys(made.metafile.inputs).map((path) => /^node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1]);
const packages = new Map(); // text of a license -> packages under it
for (const name of [...new Set(names.filter(Boolean))].sort()) {
  const { version, license } = JSON.parse(readFileSync(`node_modules/${name}/package.json`, "utf-8"));
  if (license !== "MIT") throw new Error(`${name} is under ${license}, not MIT: see whether it may ship, then say so here`);
  const text = readFileSync(`node_modules/${name}/LICENSE`, "utf-8").trim();
  packages.set(text, [...(packages.get(text) ?? []), `${name} ${version}`]);
}
const licenses = [...packages].map(([text, those]) => `${those.join(", ")}:\n\n${text}`).join("\n\n");
const head = [
  "/* Made by `make editor` of scripts/editor/; do not edit.",
  `sources: ${digest(...SOURCES.map((name) => readFileSync(name)))}`,
  `code: ${digest(code)}`,
  "",
  licenses,
  "*/",
].join("\n");
writeFileSync(OUT, `${head}\n${code}`);
