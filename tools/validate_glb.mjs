// Checks GLB files with Khronos' glTF validator: npm install gltf-validator; node tools/validate_glb.mjs FILE.glb ...
// Prints every message and exits with 1 when a file has an error or a warning.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const require = createRequire(pathToFileURL(process.cwd() + "/"));
const { validateBytes } = require("gltf-validator");
let failed = false;
for (const path of process.argv.slice(2)) {
  const { issues } = await validateBytes(new Uint8Array(readFileSync(path)), { maxIssues: 100 });
  console.log(`${path}: ${issues.numErrors} errors, ${issues.numWarnings} warnings, ${issues.numInfos} infos`);
  for (const issue of issues.messages) console.log(`  ${issue.code} ${issue.pointer}: ${issue.message}`);
  failed ||= issues.numErrors + issues.numWarnings > 0;
}
process.exit(failed ? 1 : 0);
