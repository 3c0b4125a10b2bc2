// Uses a report as a person would, and checks what it shows: node check.mjs REPORT.html SCREENSHOTS

import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { basename, dirname, join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { start } from "./browser.mjs";

const [report, pictures] = process.argv.slice(2);
const address = pathToFileURL(resolve(report)).href;
const name = basename(dirname(resolve(report)));
mkdirSync(pictures, { recursive: true });

/** Longest time from the page's first line of code to the frame that shows it, ms. */
const LONGEST = 1000;

/** How often it may be tried: a machine that does something else meanwhile draws late. */
const TRIES = 5;

let browser;
try {
  browser = await start();
} catch (error) {
  console.log(`\nSKIPPED: no Chromium starts here: ${error.message}\n`);
  process.exit(process.env.BROWSER_REQUIRED ? 1 : 0);
}

const troubles = [];
const page = await browser.newPage();
page.on("console", (message) => {
  if (["error", "warn"].includes(message.type())) troubles.push(`console: ${message.text()}`);
});
page.on("pageerror", (error) => troubles.push(`error: ${error.message}`));
page.on("request", (request) => {
  if (request.url() !== address && !request.url().startsWith("data:")) troubles.push(`request: ${request.url()}`);
});

const checks = [];
async function check(what, property) {
  await property();
  checks.push(what);
  console.log(`ok   ${what}`);
}

const picture = (what, options = {}) => page.screenshot({ path: join(pictures, `${name}-${what}.png`), ...options });

/** How many colours are in a canvas: a blank one has one. */
const colorsOf = (selector) => page.$$eval(selector, (canvases) => canvases.map((canvas) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(data.buffer)).size;
}));
const scales = () => page.evaluate(() => plots.map(({ scales: { x } }) => [x.min, x.max]));
const settled = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
const pixelsOf = (selector) => page.$eval(selector, (canvas) => canvas.toDataURL());

/** Drags from one place in the first panel to another, both as shares of its width. */
async function dragInFirstPanel(from, to) {
  const over = await page.$("#panels .u-over");
  await over.scrollIntoView();
  const box = await over.boundingBox();
  const y = box.y + box.height / 2;
  await page.mouse.move(box.x + from * box.width, y);
  await page.mouse.down();
  await page.mouse.move(box.x + to * box.width, y, { steps: 5 });
  await page.mouse.up();
  await settled();
}

try {
  await page.goto(address, { waitUntil: "load" });
  await settled();

  await check("it is drawn within a second", async () => {
    const drawn = () => page.evaluate(() => performance.getEntriesByName("report-drawn")[0]?.duration ?? Infinity);
    let took = await drawn();
    for (let tries = 1; took >= LONGEST && tries < TRIES; tries++) {
      await page.reload({ waitUntil: "load" });
      await settled();
      took = await drawn();
    }
    console.log(`     drawn in ${took.toFixed(0)} ms, ${await page.$$eval("#panels .panel", (all) => all.length)} panels`);
    assert.ok(took < LONGEST, `it took ${took} ms`);
  });

  await check("every panel shows curves", async () => {
    const colors = await colorsOf("#panels canvas");
    assert.ok(colors.length >= 5, `${colors.length} panels`);
    assert.ok(colors.every((count) => count > 3), `colours in each panel: ${colors}`);
    assert.ok((await colorsOf("#orbit"))[0] > 3, "the 3D view is blank");
  });
  await picture("whole", { fullPage: true });

  const whole = await scales();
  await check("all panels show the same stretch of time, the whole flight", async () => {
    const end = await page.evaluate(() => end);
    for (const [from, to] of whole) assert.deepEqual([from, to], [0, end]);
  });

  await check("dragging over a stretch in one panel zooms all of them", async () => {
    await dragInFirstPanel(0.4, 0.6);
    const zoomed = await scales();
    const [from, to] = zoomed[0];
    const length = whole[0][1];
    assert.ok(Math.abs(from / length - 0.4) < 0.02 && Math.abs(to / length - 0.6) < 0.02, `${from} to ${to}`);
    for (const scale of zoomed) assert.deepEqual(scale, zoomed[0]);
    assert.equal(Number(await page.$eval("#from", (input) => input.value)), Number(from.toFixed(4)));
    await picture("zoomed");
  });

  await check("a pointer in one panel shows the moment in all, and the vehicle there", async () => {
    const before = await pixelsOf("#orbit");
    const box = await (await page.$("#panels .u-over")).boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 3);
    await settled();
    const times = await page.$$eval("#panels .u-legend tr:first-child .u-value", (cells) => cells.map((cell) => cell.textContent));
    assert.ok(times.every((time) => time === times[0] && time !== "–"), `${times}`);
    assert.notEqual(await pixelsOf("#orbit"), before);
  });

  await check("a double click shows the whole flight again", async () => {
    const box = await (await page.$("#panels .u-over")).boundingBox();
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2, { count: 2 });
    await settled();
    assert.deepEqual(await scales(), whole);
  });

  await check("the keyboard zooms, moves and resets", async () => {
    await page.focus("#panels .panel");
    await page.keyboard.press("+");
    await page.keyboard.press("ArrowRight");
    const moved = await scales();
    assert.ok(moved.every(([from, to]) => from === moved[0][0] && to - from < 0.6 * whole[0][1] && from > 0.3 * whole[0][1]), `${moved[0]}`);
    await page.keyboard.press("Home");
    assert.deepEqual(await scales(), whole);
  });

  await check("the 3D view turns with the mouse and comes back", async () => {
    const canvas = await page.$("#orbit");
    await canvas.scrollIntoView();
    const before = await pixelsOf("#orbit");
    const box = await canvas.boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 2 + 120, box.y + box.height / 2 + 40, { steps: 4 });
    await page.mouse.up();
    assert.notEqual(await pixelsOf("#orbit"), before);
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2, { count: 2 });
    assert.equal(await pixelsOf("#orbit"), before);
  });

  await check("a click on a flight's name hides it, another shows it", async () => {
    const chip = await page.$("#flights button");
    const before = await pixelsOf("#panels canvas");
    await chip.click();
    await settled();
    assert.notEqual(await pixelsOf("#panels canvas"), before);
    await chip.click();
    await settled();
    assert.equal(await pixelsOf("#panels canvas"), before);
  });

  await check("playing moves the vehicle on", async () => {
    await page.click("#play");
    await page.waitForFunction(() => moment > 0.2);
    await page.click("#play");
    assert.ok(await page.evaluate(() => player === null));
  });

  await check("in the dark it is dark", async () => {
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
    await settled();
    await picture("dark", { fullPage: true });
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
  });

  await check("on a narrow screen nothing sticks out", async () => {
    await page.setViewport({ width: 420, height: 900 });
    await settled();
    await picture("narrow", { fullPage: true });
    const [content, window] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    assert.ok(content <= window, `${content} of ${window} pixels`);
  });

  await check("nothing went wrong and nothing was asked of a network", async () => {
    assert.deepEqual(troubles, []);
  });
  console.log(`${checks.length} checks of ${report}, ${await browser.version()}; pictures in ${pictures}`);
} catch (error) {
  console.log(`FAILED: ${error.message}`);
  for (const trouble of troubles) console.log(`  ${trouble}`);
  process.exitCode = 1;
} finally {
  await browser.close();
}
