// Asks the search of a built site what it finds, with the site's own worker: node search.js SITE QUERY...
// Prints JSON: for each query the places that it finds, the first one first.
const fs = require("fs"), path = require("path"), vm = require("vm");
const [site, ...queries] = process.argv.slice(2);
const folder = path.join(site, "assets/javascripts/workers");
const worker = fs.readdirSync(folder).find((name) => /^search\..*\.js$/.test(name));
const { config, docs } = JSON.parse(fs.readFileSync(path.join(site, "search/search_index.json"), "utf8"));
let hear, answered;
const context = vm.createContext({ console, importScripts: () => {} });
context.self = context;
context.addEventListener = (kind, listener) => { hear = listener; };
context.postMessage = (answer) => answered(answer);
vm.runInContext(fs.readFileSync(path.join(folder, worker), "utf8"), context);
const ask = (type, data) => new Promise((resolve) => { answered = resolve; hear({ data: { type, data } }); });
(async () => {
  await ask(0, { config, docs, options: { suggest: false } });
  const found = {};
  for (const query of queries) found[query] = (await ask(2, query)).data.items.map((items) => items[0].location);
  console.log(JSON.stringify(found));
})();
