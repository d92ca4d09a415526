// node validate.mjs PACKAGES < ["file.glb", ...]: the Khronos validator's verdict on each file, as JSON
import { readFileSync } from "fs";
import { createRequire } from "module";

const validator = createRequire(process.argv[2] + "/")("gltf-validator");
const verdicts = [];
for (const path of JSON.parse(readFileSync(0, "utf8"))) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), { maxIssues: 50 });
  const { numErrors, numWarnings, messages } = report.issues;
  verdicts.push({ path, errors: numErrors, warnings: numWarnings, messages });
}
process.stdout.write(JSON.stringify(verdicts));
