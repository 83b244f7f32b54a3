// Open a GLB with three.js in a headless browser and photograph it:
// `node look.js MODEL.glb VIEW.json PICTURE.png`. VIEW.json says from where, in the model's axes:
// {"position": [x, y, z], "target": [x, y, z], "vertical_fov_deg": d, "width": w, "height": h, "lit": true}.
// Prints what the page said on its console, and its errors, as a list in JSON.
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import chromium from "@sparticuz/chromium";
import puppeteer from "puppeteer-core";

const [model, viewFile, picture] = process.argv.slice(2);
const here = dirname(fileURLToPath(import.meta.url));
const site = "http://unshade.test/"; // nothing leaves the browser: all requests are answered below
const types = { html: "text/html", js: "text/javascript", glb: "model/gltf-binary" };

function answer(request) {
  const path = normalize(new URL(request.url()).pathname).slice(1);
  if (path === "favicon.ico") return request.respond({ status: 204 });
  const file = path === "model.glb" ? model : join(here, path);
  try {
    const contentType = types[file.split(".").pop()] ?? "application/octet-stream";
    return request.respond({ status: 200, contentType, body: readFileSync(file) });
  } catch {
    return request.respond({ status: 404, body: "" });
  }
}

const view = JSON.parse(readFileSync(viewFile, "utf-8"));
const browser = await puppeteer.launch({
  args: chromium.args,
  executablePath: process.env.UNSHADE_BROWSER || (await chromium.executablePath()),
  headless: "shell",
});
const said = [];
try {
  const page = await browser.newPage();
  await page.setViewport({ width: view.width, height: view.height });
  page.on("console", (message) => said.push(`${message.type()}: ${message.text()}`));
  page.on("pageerror", (error) => said.push(`error: ${error.message}`));
  page.on("requestfailed", (request) => said.push(`error: ${request.url()} failed`));
  await page.setRequestInterception(true);
  page.on("request", (request) => (request.url().startsWith(site) ? answer(request) : request.continue()));
  await page.goto(site + "viewer.html");
  await page.waitForFunction("window.show !== undefined");
  const url = await page.evaluate((asked) => window.show(asked), view);
  writeFileSync(picture, Buffer.from(url.split(",")[1], "base64"));
} finally {
  await browser.close();
}
console.log(JSON.stringify(said));
