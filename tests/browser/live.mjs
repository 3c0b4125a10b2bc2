// Watches flights as a person would: node live.mjs ADDRESS GERONO FOLDER PICTURES [laboratory]
//
// The server follows one flight after the other. The flights are made here, so that what is seen can be compared with what is
// done: one in real time; and with `laboratory` another with cameras and a radio link.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { join } from "node:path";
import { start } from "./browser.mjs";
import { checkDoor, compare, receive } from "./topics.mjs";

const [address, gerono, scenarios, folder, pictures, withLaboratory] = process.argv.slice(2);

const DESKTOP = { width: 1280, height: 800 };
const PHONE = { width: 360, height: 740, isMobile: true, hasTouch: true, deviceScaleFactor: 2 };

/** Longest wait for anything, ms. */
const PATIENCE = 60_000;

/** Drawings whose delay is measured. */
const MEASURED = 150;

let browser;
try {
  browser = await start();
} catch (error) {
  console.log(`\nSKIPPED: no Chromium starts here: ${error.message}\n`);
  process.exit(process.env.BROWSER_REQUIRED ? 1 : 0);
}

const processes = [];
/** A command beside this program; ends with it. What becomes of it is seen; what it says is kept for a failure. */
function begin(...args) {
  const child = spawn(gerono, args, { stdio: ["ignore", "ignore", "pipe"] });
  child.said = "";
  child.stderr.on("data", (piece) => { child.said += piece; });
  child.ended = new Promise((done) => child.on("exit", done));
  processes.push(child);
  return child;
}

/** `gerono view` beside the one that this program was started for, and its address. */
async function serve(...args) {
  const child = spawn(gerono, ["view", "--port", "0", ...args], { stdio: ["ignore", "pipe", "inherit"] });
  child.ended = new Promise((done) => child.on("exit", done));
  processes.push(child);
  for await (const piece of child.stdout) {
    const [, url] = /(http:\S+)/.exec(piece.toString()) ?? [];
    if (url !== undefined) return { child, url };
  }
  throw new Error(`no address of gerono view ${args.join(" ")}`);
}

const page = await browser.newPage();
page.setDefaultTimeout(PATIENCE);
/** Where something may be asked for. */
const known = [address];
const troubles = [];
page.on("console", (message) => {
  if (["error", "warn"].includes(message.type())) troubles.push(`console: ${message.text()}`);
});
page.on("pageerror", (error) => troubles.push(`error: ${error.message}`));
page.on("request", (request) => {
  if (!known.some((url) => [url, `${url}live`].includes(request.url())) && !request.url().startsWith("data:")) troubles.push(`request: ${request.url()}`);
});

let checks = 0;
async function check(what, property) {
  await property();
  checks += 1;
  console.log(`ok   ${what}`);
}

const picture = (name) => page.screenshot({ path: join(pictures, `${name}.png`) });
const text = (id) => page.$eval(`#${id}`, (node) => node.textContent);
const settled = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
/** The time that the first panels show; panels that nobody sees are not drawn. */
const scales = () => page.evaluate(() => plots.slice(0, 2).map(({ plot: { scales: { x } } }) => [x.min, x.max]));
const services = () => page.$$eval("#services tbody tr", (rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
const darken = (value) => page.emulateMediaFeatures([{ name: "prefers-color-scheme", value }]);
const awaitPhase = (phase) => page.waitForFunction((wanted) => byId("phase").textContent === wanted, {}, phase);
/** The flight's time on the page goes on to this, s. */
const awaitTime = (time) => page.waitForFunction((wanted) => (moments.at(-1)?.t ?? 0) >= wanted, {}, time);

/** How long after a moment of the flight it was drawn, ms: the median, and 95 %. */
async function delays() {
  const found = await page.evaluate((count) => new Promise((done) => {
    const late = [];
    let last = null;
    const look = () => {
      if (drawn.wall !== null && drawn.wall !== last) {
        last = drawn.wall;
        late.push(drawn.at - drawn.wall);
      }
      if (late.length < count) requestAnimationFrame(look); else done(late);
    };
    look();
  }), MEASURED);
  found.sort((left, right) => left - right);
  return [found[Math.floor(found.length / 2)], found[Math.floor(found.length * 0.95)]];
}

async function nothingSticksOut() {
  const [content, window] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
  assert.ok(content <= window, `${content} of ${window} pixels`);
}

/** The process of a service, as the run tells. */
async function processOf(name) {
  const news = await fetch(`${address}live`);
  let seen = "";
  for await (const piece of news.body.pipeThrough(new TextDecoderStream())) {
    seen += piece;
    const status = /^event: status\ndata: (.*)\n\n/m.exec(seen);
    if (status !== null) return JSON.parse(status[1]).snapshot.services.find((service) => service.name === name).pid;
  }
  throw new Error("the run told nothing");
}

async function watchAFlight() {
  const flight = begin("run", join(scenarios, "takeoff_and_land.toml"), "--host", "realtime", "--quiet", "--out", join(folder, "flight"),
    "--set", "flight.arm_at=1.0", "--set", "duration=200.0", "--set", "flight.land_at=190.0");
  await check("a flight that begins is shown", async () => {
    await page.waitForFunction(() => byId("contact").textContent === "live" && moments.length > 5);
    assert.match(await text("title"), /^Take-off/);
    const rows = await services();
    assert.deepEqual(rows.map(([name]) => name), ["plant", "estimator", "path_generator", "controller", "rc_output"]);
  });
  await check("the phase and what the motors may do are told in large letters", async () => {
    await awaitPhase("take-off");
    assert.equal(await text("armed"), "armed");
    await picture("1-take-off");
    await awaitPhase("fly");
    const size = await page.$eval("#phase", (node) => parseFloat(getComputedStyle(node).fontSize));
    assert.ok(size >= 24, `${size} pixels`);
  });
  await check("the commands that stop it name the run, and the envelope's box is drawn", async () => {
    assert.match(await text("commands"), /gerono kill --run \d+-0.*Land and end the flight: gerono stop --run \d+-0/);
    assert.equal(await text("warnings"), "");
    assert.ok(await page.evaluate(() => !byId("fence").hidden && orbit.bounds[0][1] === flight.envelope_box.max[0]));
  });
  await check("every number is known, and services step", async () => {
    await page.waitForFunction(() => [...document.querySelectorAll("#numbers dd")].every((cell) => !cell.textContent.startsWith("–")));
    for (const [name, rate] of await services()) assert.ok(Number(rate) > 10, `${name}: ${rate} Hz`);
  });
  await check("the panels grow with the flight, and then its end moves on", async () => {
    await page.$eval("#over-time", (section) => section.scrollIntoView());
    await page.waitForFunction(() => plots[0].plot.scales.x.max > 4);
    for (const [from] of await scales()) assert.equal(from, 0);
    await awaitTime(12);
    await page.keyboard.press("1");
    await page.waitForFunction(() => plots[0].plot.scales.x.min > 1);
    for (const [from, to] of await scales()) assert.ok(Math.abs(to - from - 10) < 0.01, `${from} to ${to}`);
    await page.keyboard.press("2");
    await page.waitForFunction(() => plots[0].plot.scales.x.min === 0);
    assert.ok((await page.$$("#panels .panel")).length >= 8);
    await picture("3-panels");
    await page.evaluate(() => scrollTo(0, 0));
  });
  await awaitTime(pictured ? 24 : 13);
  await picture("2-flight");
  await check("the space bar pauses the page, keys and slider then move the moment, and the flight goes on", async () => {
    await page.keyboard.press("Space");
    const [paused, kept] = await page.evaluate(() => [now(), moments.length]);
    for (let times = 0; times < 4; times++) await page.keyboard.press(",");
    const earlier = await page.evaluate(() => now());
    assert.ok(earlier < paused - 1, `${earlier} after ${paused}`);
    await page.$eval("#moment", (slider) => {
      slider.valueAsNumber = 8;
      slider.dispatchEvent(new Event("input"));
    });
    await page.waitForFunction((count) => moments.length > count + 20, {}, kept);
    await settled();
    assert.match(await text("clock"), /^8\.0 s of/);
    await picture("4-paused");
    await page.keyboard.press("Space");
    await page.waitForFunction((then) => now() > then, {}, paused);
  });
  await check("the 3D view turns with the keys", async () => {
    await page.focus("#orbit");
    const turned = () => page.evaluate(() => orbit.azimuth);
    const before = await turned();
    await page.keyboard.press("ArrowRight");
    assert.notEqual(await turned(), before);
    await page.keyboard.press("Home");
    await page.evaluate(() => document.activeElement.blur());
  });
  await check("a service that dies is told, and its restart counted", async () => {
    await darken("dark");
    process.kill(await processOf("estimator"), "SIGKILL");
    await page.waitForFunction(() => [...document.querySelectorAll("#services tbody tr")].some((row) => row.cells[0].textContent === "estimator" && row.cells[5].textContent === "1"));
    await page.waitForFunction(() => byId("marks").textContent.includes("estimator"));
    await settled();
    await picture("5-restart-in-the-dark");
    await darken("light");
  });
  await check("a moment of the flight is drawn soon", async () => {
    const [half, most] = await delays();
    console.log(`     from a sample to its drawing: ${half.toFixed(0)} ms (median), ${most.toFixed(0)} ms (95 %)`);
    assert.ok(half < 500, `${half} ms`);
  });
  await check("all topics are for programs that speak the Foxglove protocol, and not for pages of the internet", () => checkDoor(address));
  const received = await receive(address);
  await check("on a phone nothing sticks out, also not the restarts of a service", async () => {
    await page.setViewport(PHONE);
    await settled();
    await nothingSticksOut();
    const right = await page.$$eval("#services tbody tr", (rows) => Math.max(...rows.map((row) => row.lastElementChild.getBoundingClientRect().right)));
    assert.ok(right <= PHONE.width, `${right} pixels`);
    await picture("6-phone");
    await page.setViewport(DESKTOP);
  });
  await check("the end of a flight is told", async () => {
    flight.kill("SIGINT");
    await page.waitForFunction(() => byId("contact").textContent === "ended");
    assert.match(await text("banners"), /has ended; waiting for the next flight/);
    await flight.ended;
  });
  await check("what the published client of that protocol has received is what the log has", async () => {
    const { topics, samples } = compare(received, join(folder, "flight", "run.mcap"));
    console.log(`     ${samples} samples of ${topics} topics`);
    assert.ok(topics >= 8 && samples > 100);
  });
}

async function watchAFlightThatIsKilled() {
  const flight = begin("run", join(scenarios, "takeoff_and_land.toml"), "--host", "realtime", "--quiet", "--out", join(folder, "killed"),
    "--set", "flight.arm_at=190.0", "--set", "duration=200.0", "--set", "flight.land_at=195.0", "--set", "vehicle.initial.roll_pitch_yaw=[0.8, 0.0, 0.0]");
  await check("why a vehicle will not arm is told in red", async () => {
    await page.waitForFunction(() => byId("warnings").textContent.startsWith("Will not arm: the vehicle is tilted by"));
    assert.doesNotMatch(await text("commands"), /gerono arm/);
  });
  await check("a wrong response is told, as text", async () => {
    const [told, elements] = await page.evaluate(() => {
      drawWarnings({ killed: false, killed_by: null, response: "<b>roll</b> answers with the wrong sign", refusal_to_arm: null });
      return [byId("warnings").textContent, document.querySelectorAll("#warnings b").length];
    });
    assert.deepEqual([told, elements], ["WRONG: <b>roll</b> answers with the wrong sign.", 0]);
  });
  await check("a kill is told on the first screen, wide and narrow, in the light and in the dark", async () => {
    assert.equal(await begin("kill").ended, 0);
    await page.waitForFunction(() => byId("warnings").textContent.startsWith("KILLED: the operator killed"));
    assert.equal(await text("armed"), "killed");
    for (const [width, height] of [[1400, 900], [390, 844]]) {
      for (const mode of ["light", "dark"]) {
        await page.setViewport({ width, height });
        await darken(mode);
        await settled();
        await nothingSticksOut();
        const bottom = await page.$eval("#warnings", (node) => node.getBoundingClientRect().bottom);
        assert.ok(bottom < height / 2, `${bottom} of ${height} pixels`);
        // The manual shows the last of them.
        await picture(pictured ? "10-killed" : `10-killed-${width}-${mode}`);
      }
    }
    await darken("light");
    await page.setViewport(DESKTOP);
  });
  flight.kill("SIGINT");
  await flight.ended;
}

async function watchFromElsewhere() {
  const { child, url } = await serve("--follow", "--bind", "127.0.0.2");
  const { origin } = new URL(url);
  known.push(url, `${origin}/`);
  const flight = begin("run", join(scenarios, "fig1.toml"), "--quiet", "--out", join(folder, "fig1"), "--set", "duration=2000.0");
  await check("with the token a flight in simulated time is shown, and without it nothing", async () => {
    assert.equal((await fetch(`${origin}/`)).status, 401);
    await page.goto(url, { waitUntil: "load" });
    assert.equal(page.url(), `${origin}/`);
    await page.waitForFunction(() => moments.length > 5 && /times real time/.test(byId("speed").textContent));
    // The cookie is enough from now on.
    await page.reload({ waitUntil: "load" });
    await page.waitForFunction(() => moments.length > 5);
    assert.equal(await page.evaluate(() => document.cookie), "");
    await settled();
    await picture("8-simulated");
  });
  flight.kill("SIGINT");
  child.kill("SIGINT");
  await Promise.all([flight.ended, child.ended]);
}

async function lookAtAFinishedFlight() {
  const { child, url } = await serve(join(folder, "flight"));
  known.push(url);
  await check("a finished flight has a slider of time that moves the vehicle", async () => {
    await page.goto(url, { waitUntil: "load" });
    const seen = () => page.$eval("#orbit", (canvas) => canvas.toDataURL());
    const slide = async (share) => {
      await page.$eval("#moment", (slider, part) => {
        slider.valueAsNumber = Number(slider.min) + part * (slider.max - slider.min);
        slider.dispatchEvent(new Event("input"));
      }, share);
      await settled();
      return seen();
    };
    assert.notEqual(await slide(0.2), await slide(0.6));
    await picture("9-finished");
  });
  child.kill("SIGINT");
  await child.ended;
}

async function watchALaboratory() {
  const scenario = join(scenarios, "laboratory_simulated.toml");
  const device = join(folder, "radio");
  const settings = ["--set", `rc_output.transmitter.device="${device}"`];
  begin("world", scenario, "--out", join(folder, "world"), ...settings);
  while (!existsSync(device)) await new Promise((done) => { setTimeout(done, 100); });
  const flight = begin("run", scenario, "--host", "realtime", "--quiet", "--out", join(folder, "laboratory"), ...settings);
  await check("cameras and radio link of a laboratory are shown", async () => {
    await page.waitForFunction(() => /cameras: .* accepted/.test(byId("laboratory").textContent) && moments.length > 5);
    assert.match(await text("laboratory"), /radio link: \d+ sent/);
    assert.match(await text("banners"), /where the estimator believes it to be/);
    // Not before the rate of frames is known.
    const until = Date.now() + PATIENCE;
    for (let arm = begin("arm"); (await arm.ended) !== 0; arm = begin("arm")) {
      assert.ok(Date.now() < until, `it is not armed: ${arm.said}`);
    }
    await awaitPhase("fly");
    await settled();
    await picture("7-laboratory");
  });
  flight.kill("SIGINT");
  await flight.ended;
}

const pictured = withLaboratory === "laboratory";
try {
  await page.setViewport(DESKTOP);
  await page.goto(address, { waitUntil: "load" });
  await watchAFlight();
  await watchAFlightThatIsKilled();
  if (pictured) await watchALaboratory();
  await watchFromElsewhere();
  await lookAtAFinishedFlight();
  await check("nothing went wrong and nothing was asked of another server", async () => assert.deepEqual(troubles, []));
  console.log(`${checks} checks of the live page, ${await browser.version()}; pictures in ${pictures}`);
} catch (error) {
  console.log(`FAILED: ${error.message}`);
  for (const trouble of troubles) console.log(`  ${trouble}`);
  await picture("failed").catch(() => {});
  process.exitCode = 1;
} finally {
  await browser.close();
  for (const child of processes) child.kill("SIGINT");
  await Promise.all(processes.map((child) => child.ended));
}
