// `node build.mjs` builds dist/ from src/; `--check` fails unless dist/ equals a build of src/; `--tests` bundles the tests
// of test/ into out/. The build is reproducible: equal sources give equal bytes.
import { readFile, readdir, writeFile, mkdir } from "node:fs/promises";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

/** Upper limit of the page's total size, gzip-compressed bytes. */
const MAX_SIZE = 200_000;
const common = { bundle: true, format: "esm", target: "es2022", charset: "utf8", logLevel: "warning" };

if (process.argv.includes("--tests")) {
  const tests = (await readdir("test")).filter((name) => name.endsWith(".test.ts"));
  await build({
    ...common,
    entryPoints: tests.map((name) => `test/${name}`),
    outdir: "out",
    platform: "node",
    loader: { ".css": "empty" },
  });
} else {
  const result = await build({
    ...common,
    entryPoints: { app: "src/main.ts" },
    outdir: "dist",
    minify: true,
    legalComments: "inline",
    write: false,
  });
  const files = new Map(result.outputFiles.map((f) => [f.path.split("/").at(-1), Buffer.from(f.contents)]));
  for (const name of ["index.html", "icon.svg"]) files.set(name, await readFile(`src/${name}`));
  const size = [...files.values()].reduce((sum, bytes) => sum + gzipSync(bytes).length, 0);
  console.log(`page: ${(size / 1000).toFixed(1)} kB compressed`);
  if (size > MAX_SIZE) fail(`the page exceeds ${MAX_SIZE / 1000} kB compressed`);
  if (process.argv.includes("--check")) {
    for (const [name, bytes] of files) {
      const committed = await readFile(`dist/${name}`).catch(() => Buffer.alloc(0));
      if (!committed.equals(bytes)) fail(`web/dist/${name} differs from a build of web/src: run \`make web\` and commit it`);
    }
  } else {
    await mkdir("dist", { recursive: true });
    for (const [name, bytes] of files) await writeFile(`dist/${name}`, bytes);
  }
}

function fail(message) {
  console.error(message);
  process.exit(1);
}
