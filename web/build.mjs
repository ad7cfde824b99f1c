// Bundles the page's script and style into the Python package: node build.mjs [--check]
// With --check nothing is written; it fails where the committed bundle is not a fresh build.
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const assets = join(here, "..", "src", "deltac", "report", "page", "assets");
const bundled = ["three", "uplot"];

const result = await build({
  entryPoints: { "page": join(here, "src", "main.ts") },
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  outdir: assets,
  absWorkingDir: here,
  write: false,
});

const files = new Map(result.outputFiles.map((file) => [file.path, file.text]));
// A script ends where "</script" stands in it, whatever that is part of.
for (const [path, text] of files) files.set(path, text.replaceAll("</script", "<\\/script"));
files.set(join(assets, "page.html"), readFileSync(join(here, "src", "page.html"), "utf8"));
files.set(join(assets, "LICENSES.txt"), licences());

function licences() {
  const parts = ["The pages that deltac writes contain these libraries.\n"];
  for (const name of bundled) {
    const folder = join(here, "node_modules", name);
    const { version, license, homepage } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
    const text = readFileSync(join(folder, "LICENSE"), "utf8").trim();
    parts.push(`${"-".repeat(72)}\n${name} ${version} (${license}) ${homepage ?? ""}\n\n${text}\n`);
  }
  return parts.join("\n");
}

const stale = [];
for (const [path, text] of files) {
  let old = "";
  try {
    old = readFileSync(path, "utf8");
  } catch {}
  if (old === text) continue;
  if (process.argv.includes("--check")) stale.push(path);
  else writeFileSync(path, text);
}
for (const [path, text] of files) console.log(`${(text.length / 1024).toFixed(0).padStart(6)} KiB  ${path.slice(here.length - 3)}`);
if (stale.length) {
  console.error(`not a fresh build: ${stale.join(", ")}; run: npm run build`);
  process.exit(1);
}
