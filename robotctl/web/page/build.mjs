// Builds the page into a folder, `../static` unless another is named: the same bytes from the same source.
import { build } from "esbuild";
import { cpSync, mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const page = dirname(fileURLToPath(import.meta.url));
const out = resolve(process.argv[2] ?? join(page, "..", "static"));

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });

await build({
  absWorkingDir: page,
  entryPoints: { page: "src/main.tsx" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  charset: "utf8",
  legalComments: "none", // the licences of all packages stand in licences.txt
  logLevel: "warning",
});

cpSync(join(page, "src", "index.html"), join(out, "index.html"));
cpSync(join(page, "src", "icon.svg"), join(out, "icon.svg"));

const lock = JSON.parse(readFileSync(join(page, "package-lock.json"), "utf8"));
const shipped = Object.entries(lock.packages)
  .filter(([path, entry]) => path !== "" && !entry.dev)
  .map(([path, entry]) => {
    const licence = readFileSync(join(page, path, "LICENSE"), "utf8").trim();
    return `${path.replace(/^.*node_modules\//, "")} ${entry.version}\n\n${licence}\n`;
  });
writeFileSync(join(out, "licences.txt"), shipped.join(`\n${"-".repeat(80)}\n\n`));
