// Prints the errors and warnings of glTF files as JSON, by file: node validate.js FOLDER_OF_NODE_MODULES FILE…
const { readFileSync } = require("node:fs");
const [folder, ...files] = process.argv.slice(2);
const { validateBytes } = require(`${folder}/gltf-validator`);
const WARNING = 1;

async function main() {
  const issues = {};
  for (const file of files) {
    const report = await validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 20 });
    const serious = report.issues.messages.filter(({ severity }) => severity <= WARNING);
    issues[file] = serious.map(({ code, message, pointer }) => `${code} ${pointer}: ${message}`);
  }
  console.log(JSON.stringify(issues));
}

main();
