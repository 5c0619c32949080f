// SPDX-License-Identifier: Apache-2.0
// Builds the page of `oddsmap view` into the Python package, where it is kept under version control:
// whoever installs or tests oddsmap needs no Node.

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { build, defineConfig, type Plugin } from "vite";

const page = "../src/oddsmap/viewer/page";
const outDir = process.env.ODDSMAP_PAGE ?? page;

/** Everything that decides what is built, by path. `tests/viewer/test_page.py` has the same list. */
function sources(): string[] {
  const own = readdirSync("src", { recursive: true, withFileTypes: true })
    .filter((entry) => entry.isFile())
    .map((entry) => join(entry.parentPath, entry.name).replaceAll("\\", "/"));
  return [...own, "package.json", "package-lock.json", "tsconfig.json", "vite.config.ts"].sort();
}

/** The same modules as notebooks load them, in one file with its style. */
async function buildWidget(): Promise<void> {
  const entry = { entry: "src/widget.ts", formats: ["es" as const], fileName: () => "widget.js" };
  await build({
    configFile: false,
    logLevel: "warn",
    build: {
      outDir, emptyOutDir: false, target: "es2022", lib: entry, rolldownOptions: { output: { minify: true } },
    },
  });
}

/** Builds the widget, ends each file with a line feed, and notes what it was built from. */
function record(): Plugin {
  return {
    name: "record",
    async closeBundle() {
      await buildWidget();
      const digest = createHash("sha256");
      for (const path of sources()) digest.update(`${path}\0`).update(readFileSync(path)).update("\0");
      const built: Record<string, string> = { sources: digest.digest("hex") };
      for (const name of ["viewer.css", "viewer.js", "widget.js"]) {
        const text = `${readFileSync(join(outDir, name), "utf8").trimEnd()}\n`;
        writeFileSync(join(outDir, name), text);
        built[name] = createHash("sha256").update(text).digest("hex");
      }
      writeFileSync(join(outDir, "build.json"), `${JSON.stringify(built, null, 1)}\n`);
    },
  };
}

export default defineConfig({
  build: {
    outDir,
    emptyOutDir: true,
    target: "es2022",
    // One classic script: a module does not load from a file on the disk.
    lib: {
      entry: "src/main.ts",
      formats: ["iife"],
      name: "oddsmapViewer",
      fileName: () => "viewer.js",
      cssFileName: "viewer",
    },
  },
  plugins: [record()],
});
