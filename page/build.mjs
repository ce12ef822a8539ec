// Builds the page into the Python package: `npm run build`, or to another folder, `npm run build -- FOLDER`.
// The names of the files are fixed and nothing in them depends on the time or the machine, so that a build can
// be compared with the one that is committed.
import { copyFile, mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const target = path.resolve(process.argv[2] ?? path.join(here, "../app/page/static"));

await rm(target, { recursive: true, force: true });
await mkdir(target, { recursive: true });

const { metafile } = await build({
  absWorkingDir: here,
  // The editor is a file of its own, loaded by whoever starts a job.
  entryPoints: ["src/app.tsx", "src/editor.ts", "src/app.css"],
  outdir: target,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  charset: "utf8",
  external: ["./editor.js"],
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "none",
  metafile: true,
});
for (const name of ["index.html", "icon.svg"]) {
  await copyFile(path.join(here, "src", name), path.join(target, name));
}
await writeFile(path.join(target, "LICENSES.txt"), await licences(Object.keys(metafile.inputs)));

/** The licences of all packages of which anything is in the files. */
async function licences(inputs) {
  const packages = new Set();
  for (const input of inputs) {
    const found = /^node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(input);
    if (found) packages.add(found[1]);
  }
  const texts = [];
  for (const name of [...packages].sort()) {
    const folder = path.join(here, "node_modules", name);
    const { version, license } = JSON.parse(await readFile(path.join(folder, "package.json"), "utf8"));
    const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
    if (!file) throw new Error(`${name} comes without the text of its licence`);
    const text = (await readFile(path.join(folder, file), "utf8")).replaceAll("\r\n", "\n").trim();
    texts.push(`${name} ${version} (${license})\n\n${text}\n`);
  }
  return `Libraries in the files beside this one, and their licences.\n\n${texts.join(`\n${"-".repeat(72)}\n\n`)}`;
}
