"use strict";

/* A flight that goes on, from the news of `gerono view`. The page only reads: there is nothing that it could send. */

/** Times that the panels show, s. */
const WINDOWS = [[10, "10 s"], [60, "60 s"], [600, "10 min"], [Infinity, "whole flight"]];

/** Moments that are kept. When there are more, every second one of the older ones is forgotten. */
const MOST_MOMENTS = 6000;
const NEWEST_MOMENTS = 2400;

/** Places of the vehicle that the 3D view draws, and the time in which it shows them brightly, s. */
const MOST_PLACES = 900;
const BRIGHT = 6;
const LONGEST_GAP = 0.6;

/** Least time between two drawings of the panels, ms. */
const PANELS_PERIOD = 100;

/** Time after which a server that has refused is asked again, ms. */
const RETRY = 3000;

const NUMBERS = [
  ["distance from the path", "cm", (value) => 100 * value],
  ["speed", "m/s"],
  ["body rate", "rad/s"],
  ["thrust commanded", "N"],
  ["mass estimated", "g", (value) => 1000 * value],
  ["disturbance estimated", "m/s²"],
  ["to the envelope's box", "m"],
];

let flight = null;
let moments = [];
let marks = [];
let events = [];
let plots = [];
let shownWindow = 60;
/** The moment that is looked at while the page is paused, s. */
let pausedAt = null;
/** What is to be drawn. */
const due = { moment: false, panels: false };
let panelsDrawn = 0;
/** When the newest moment was and when it was drawn, ms since 1970: for measurements. */
const drawn = { wall: null, at: null };

const followed = { places: [], path: [], shown: true, color: colorOf(0) };
const orbit = new Orbit(byId("orbit"), [followed], () => ({
  grid: variable("--line"), faint: variable("--faint"), ink: variable("--ink"), bound: variable("--bound"), path: variable("--path"), fence: variable("--fault"),
}));

/* ---- News ---- */

function begin(news) {
  flight = news;
  moments = [];
  marks = [];
  events = [];
  pausedAt = null;
  followed.places = [];
  followed.path = flight.path;
  followed.envelope_box = flight.envelope_box;
  byId("fence").hidden = flight.envelope_box === null;
  cells.at(-1).value.parentElement.hidden = flight.envelope_box === null;
  orbit.measure();
  byId("panels").replaceChildren();
  plots = flight.panels.map(arrange).filter((panel) => panel.curves.length > 0);
  document.title = `${flight.description || flight.run} · gerono`;
  byId("title").textContent = flight.description || flight.run;
  const kind = flight.is_in_real_time ? "in real time" : "in simulated time";
  byId("description").textContent = `Run ${flight.run}, ${kind}, seed ${flight.seed}.`;
  byId("banners").replaceChildren(...(flight.is_estimated ? [element("p", { class: "banner" },
    "The vehicle is shown where the estimator believes it to be: in a laboratory nobody knows the truth.")] : []));
  byId("footer").textContent = `gerono ${flight.version}. Frames: {I}, z down; lengths in m, times in s, angles in rad.`;
  showPaused();
}

function keep(moment) {
  const last = moments.at(-1);
  if (last !== undefined && moment.t <= last.t) return;
  moments.push(moment);
  if (moments.length > MOST_MOMENTS) {
    const old = moments.slice(0, -NEWEST_MOMENTS).filter((_, place) => place % 2 === 0);
    moments = old.concat(moments.slice(-NEWEST_MOMENTS));
  }
  const place = placeIn(moment);
  if (moment.t - (last?.t ?? 0) > LONGEST_GAP) followed.places.push(breakAt(moment.t));
  followed.places.push(place);
  if (followed.places.length > MOST_PLACES) followed.places.splice(0, followed.places.length - MOST_PLACES);
  if (!orbit.holds(place.position) || !orbit.holds(place.desired)) orbit.measure();
}

function placeIn({ t, p }) {
  const known = p.map((value) => value ?? NaN);
  return { time: t, position: known.slice(0, 3), desired: known.slice(3, 6), attitude: known.slice(6, 9) };
}

/** Nobody knows the way between places that are far apart in time: none is drawn. */
const breakAt = (time) => ({ time, position: [NaN, NaN, NaN], desired: [NaN, NaN, NaN], attitude: [0, 0, 0] });

function take(moment) {
  keep(moment);
  redraw();
}

function takeStatus({ snapshot, speed }) {
  events = snapshot.events;
  byId("phase").textContent = snapshot.phase === null ? "in flight" : snapshot.landing && snapshot.phase === "fly" ? "fly, asked to land" : snapshot.phase;
  byId("armed").textContent = motors(snapshot);
  byId("armed").className = snapshot.killed ? "killed" : snapshot.armed ? "armed" : "";
  const isSimulated = flight !== null && !flight.is_in_real_time;
  byId("speed").textContent = isSimulated && speed !== null ? `${inDigits(Number(speed.toPrecision(2)))} times real time` : "";
  drawWarnings(snapshot);
  drawCommands(snapshot);
  drawServices(snapshot);
  drawLaboratory(snapshot);
  drawEvents();
}

/** What the motors may do; in the phase `disarmed` the phase says it. */
function motors({ phase, armed, killed }) {
  if (killed) return "killed";
  if (phase === null || phase === "disarmed") return "";
  return armed ? "armed" : "disarmed";
}

/** What keeps the vehicle from flying, or is wrong with its flight. */
function warnings({ g: givenUp } = {}, { killed, killed_by: by, response, refusal_to_arm: refusal }) {
  return [
    killed ? `KILLED${by === null ? "" : `: ${by}`}. The motors rest until the end of the run.` : null,
    response === null ? null : `WRONG: ${response}.`,
    givenUp === undefined ? null : `The take-off was given up: ${givenUp}`,
    refusal === null || killed ? null : `Will not arm: ${refusal}.`,
  ].filter((text) => text !== null);
}

function drawWarnings(snapshot) {
  const texts = warnings(moments.at(-1), snapshot);
  replaceIfChanged("warnings", texts.map((text) => element("p", { class: "banner alarm" }, text)));
}

/** Replaces the children of an element if they differ: screen readers announce a replaced text, and its selection is lost. */
function replaceIfChanged(id, children) {
  const shown = [...byId(id).children];
  const isShown = shown.length === children.length && children.every((child, at) => child.isEqualNode(shown[at]));
  if (!isShown) byId(id).replaceChildren(...children);
}

/** The commands for the terminal of who stands beside the vehicle; a flight in simulated time takes none. */
function drawCommands({ phase, killed, refusal_to_arm: refusal }) {
  if (flight === null) return;
  const command = (words, name) => element("span", {}, `${words}: `, element("code", {}, `gerono ${name} --run ${flight.run}`));
  const mayArm = phase === "disarmed" && refusal === null;
  const hasToLand = phase !== null && phase !== "disarmed";
  replaceIfChanged("commands", [
    ...(killed ? [] : [command("Stop the motors at once; in the air it falls", "kill")]),
    command(hasToLand ? "Land and end the flight" : "End the flight", "stop"),
    ...(mayArm ? [command("Ready to take off", "arm")] : []),
  ]);
  byId("commands").hidden = !flight.is_in_real_time;
}

function takeMarks(news) {
  marks = news;
  drawEvents();
}

/** Whether the run answers: live, silent or ended. */
function takeContact({ state, text }) {
  sayContact(state, text);
  redraw();
}

function sayContact(state, text) {
  const words = { live: "live", silent: "no answer", ended: "ended", waiting: "reconnecting" };
  byId("contact").className = state;
  if (state === "ended") byId("commands").hidden = true;
  byId("contact").textContent = words[state];
  const old = document.getElementById("contact-text");
  if (old !== null) old.remove();
  if (text !== "") byId("banners").append(element("p", { class: "banner", id: "contact-text", role: "alert" }, text));
}

function connect() {
  const source = new EventSource("live");
  const on = (name, handle) => source.addEventListener(name, (event) => handle(JSON.parse(event.data)));
  on("flight", begin);
  on("past", (news) => news.forEach(keep));
  on("frame", take);
  on("status", takeStatus);
  on("marks", takeMarks);
  on("contact", (news) => {
    takeContact(news);
    // Where other flights follow the server goes on.
    if (news.state === "ended" && !news.follows) source.close();
  });
  source.addEventListener("error", () => {
    if (byId("contact").className === "ended") return;
    // A server that is gone is asked again by the browser; one that has refused by this page.
    if (source.readyState !== EventSource.CLOSED) return sayContact("waiting", "");
    sayContact("waiting", "The server takes no more browsers: eight watch at once. This page tries again.");
    setTimeout(connect, RETRY);
  });
}

/* ---- Now ---- */

const cells = NUMBERS.map(([name, unit]) => {
  const value = element("dd", {}, "–");
  byId("numbers").append(element("div", {}, element("dt", {}, name), value));
  return { value, unit };
});

function drawNumbers(moment) {
  NUMBERS.forEach(([, unit, scaled = (value) => value], place) => {
    const value = [...moment.q, roomOf(moment)][place];
    const text = value === null ? "–" : String(Number(scaled(value).toPrecision(3)));
    cells[place].value.replaceChildren(text, element("small", {}, ` ${unit}`));
  });
}

/** Distance to the nearest face of the envelope's box, m; below 0 outside. */
function roomOf({ p }) {
  const box = flight.envelope_box;
  if (box === null || p[0] === null) return null;
  return Math.min(...[0, 1, 2].flatMap((axis) => [p[axis] - box.min[axis], box.max[axis] - p[axis]]));
}

const inUnits = (time) => (time === null || time === undefined ? "–" : time < 1e-3 ? `${inDigits(Number((time * 1e6).toPrecision(2)))} µs` : time < 1 ? `${inDigits(Number((time * 1e3).toPrecision(2)))} ms` : `${inDigits(Number(time.toPrecision(2)))} s`);

function drawServices({ services }) {
  const age = ({ inputs }) => {
    const ages = inputs.map((input) => input.age);
    return inputs.length === 0 ? "–" : ages.includes(null) ? "none" : inUnits(Math.max(...ages));
  };
  const rows = services.map((service) => [
    service.name,
    service.flies ? service.rate : element("span", { class: "down" }, "down"),
    age(service), inUnits(service.step?.p99), service.missed_steps, service.restarts,
  ]);
  byId("services").replaceChildren(tableOf(["service", "Hz", "age", "step p99", "missed", "restarts"], rows));
}

function drawLaboratory({ cameras, receivers, radio_link: link, battery, capture_to_frame: chain }) {
  const lines = [];
  if (chain !== null) lines.push(["", `capture to frame: p50 ${inUnits(chain.p50)}, p99 ${inUnits(chain.p99)}`]);
  if (cameras !== null) {
    lines.push(["", `cameras: ${cameras.rate.toFixed(1)} Hz, ${inUnits(cameras.latency)} old, ${cameras.believed} of ${cameras.frames} accepted`]);
    if (cameras.trouble !== null) lines.push(["trouble", cameras.trouble]);
    else if (cameras.refused !== null) lines.push(["", cameras.refused]);
  }
  // Runs of earlier versions send no receivers and no battery.
  if (receivers) {
    const sensors = ["inertial", "fixes", "altitudes", "fields"];
    lines.push(["", `receivers: ${sensors.map((sensor, place) => `${sensor} ${receivers.rates[place].toFixed(1)} Hz`).join(", ")}`]);
    if (receivers.trouble !== null) lines.push(["trouble", receivers.trouble]);
    else if (receivers.refused !== null) lines.push(["", receivers.refused]);
  }
  if (link !== null) {
    lines.push(["", `radio link: ${link.sent} sent, ${link.lost} lost`]);
    if (link.trouble !== null) lines.push(["trouble", link.trouble]);
  }
  if (battery) {
    const age = battery.age === null ? "modelled" : `${battery.age.toFixed(1)} s old`;
    const factor = battery.factor === null ? "" : `, thrust times ${battery.factor.toFixed(2)}`;
    lines.push([battery.trouble === null ? "" : "trouble", `battery: ${battery.voltage.toFixed(2)} V, ${age}${factor}`]);
    if (battery.trouble !== null) lines.push(["trouble", battery.trouble]);
  }
  byId("laboratory").replaceChildren(...lines.map(([name, text]) => element("p", { class: `hint ${name}` }, text)));
}

function drawEvents() {
  const all = [...marks, ...events].sort((left, right) => right.time - left.time);
  const items = all.map(({ time, text }) => element("li", {}, element("time", {}, `${time.toFixed(1)} s`), element("span", {}, text)));
  byId("marks").replaceChildren(...(items.length > 0 ? items : [element("li", {}, "nothing so far")]));
}

/* ---- Over time ---- */

/** A panel with the places of its curves among the values of a moment. A curve is drawn from its first value on. */
function arrange(panel) {
  const curves = panel.groups.flatMap((group, color) => group.curves.map((curve) => ({
    ...curve, color, place: flight.channels.findIndex(([topic, name]) => topic === curve.topic && name === curve.channel),
  }))).filter(({ place }) => place >= 0);
  return { panel, curves: curves.sort((left, right) => right.dash - left.dash), shown: [], plot: null, holder: null, isSeen: true };
}

/** Draws a panel with those of its curves that have had a value, in the place of an earlier one with fewer. */
function open(arranged, curves) {
  const { panel } = arranged;
  arranged.holder?.remove();
  arranged.plot?.destroy();
  arranged.shown = curves;
  const holder = element("div", { class: "panel", role: "group", "aria-label": `${panel.title} over time` },
    element("h3", {}, panel.title, element("span", {}, panel.unit)));
  // In the order of the panels, whichever has a value first.
  const later = plots.slice(plots.indexOf(arranged) + 1).find(({ plot }) => plot !== null);
  byId("panels").insertBefore(holder, later?.holder ?? null);
  arranged.holder = holder;
  const bounds = panel.has_bound && flight.bound !== null ? [flight.bound] : [];
  arranged.plot = new uPlot({
    width: holder.clientWidth - 18,
    height: PANEL_HEIGHT,
    scales: {
      x: { time: false, range: () => span() },
      y: { distr: panel.is_logarithmic ? 3 : 1, range: rangeUpwards(panel, bounds) },
    },
    axes: axes(panel),
    series: [
      { label: "time", value: (_, value) => (value === null || value === undefined ? "–" : `${value.toFixed(2)} s`) },
      ...curves.map((curve) => ({
        label: curve.label,
        stroke: () => `${colorOf(curve.color)}${curve.dash === 0 ? "" : "b8"}`,
        width: 1.4,
        dash: DASHES[curve.dash],
        points: { show: false },
        value: (_, value) => inDigits(value),
      })),
    ],
    cursor: { sync: { key: "live", setSeries: false }, drag: { x: false, y: false }, points: { size: 6 } },
    legend: { markers: { dash: (_, series) => DASH_NAMES[curves[series - 1]?.dash ?? 0] } },
    hooks: {
      drawAxes: [(plot) => drawMarks(plot, marks, bounds)],
      draw: [(plot) => nameBounds(plot, bounds)],
    },
  }, [[], ...curves.map(() => [])], holder);
  new IntersectionObserver(([entry]) => {
    arranged.isSeen = entry.isIntersecting;
    redraw();
  }).observe(holder);
}

/** The moment that is looked at: the newest, or where the page is paused. */
const now = () => pausedAt ?? moments.at(-1)?.t ?? 0;

/** The time that the panels show. */
function span() {
  const to = now();
  const from = shownWindow === Infinity ? Math.min(moments[0]?.t ?? 0, to) : Math.max(to - shownWindow, 0);
  return [from, Math.max(to, from + 1e-3)];
}

/** The first moment at or after a time. */
function placeOf(time) {
  let [low, high] = [0, moments.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (moments[middle].t < time) low = middle + 1; else high = middle;
  }
  return low;
}

function drawPanels() {
  const [from, to] = span();
  const seen = moments.slice(Math.max(placeOf(from) - 1, 0), placeOf(to) + 1);
  const times = seen.map(({ t }) => t);
  for (const arranged of plots) {
    const { panel } = arranged;
    const hasValue = ({ place }) => seen.some(({ v }) => v[place] !== null);
    const curves = arranged.curves.filter((curve) => arranged.shown.includes(curve) || hasValue(curve));
    if (curves.length === 0) continue;
    if (curves.length > arranged.shown.length) open(arranged, curves);
    if (!arranged.isSeen) continue;
    const least = panel.is_logarithmic ? FLOOR : -Infinity;
    const values = ({ place }) => seen.map(({ v }) => (v[place] === null ? null : Math.max(v[place], least)));
    arranged.plot.setData([times, ...curves.map(values)]);
  }
}

/* ---- Drawing ---- */

function drawMoment() {
  const time = now();
  const moment = moments[Math.min(Math.max(placeOf(time + 1e-9) - 1, 0), moments.length - 1)];
  byId("clock").textContent = `${time.toFixed(1)} s of ${inDigits(flight.duration)} s`;
  drawNumbers(moment);
  orbit.moment = time;
  orbit.view = [time - BRIGHT, time];
  orbit.draw();
}

function draw(at) {
  requestAnimationFrame(draw);
  if (flight === null || moments.length === 0 || document.hidden) return;
  if (due.moment) {
    due.moment = false;
    drawMoment();
    if (pausedAt === null) {
      drawn.wall = moments.at(-1).w ?? null;
      drawn.at = performance.timeOrigin + performance.now();
    }
  }
  if (due.panels && at - panelsDrawn >= PANELS_PERIOD) {
    due.panels = false;
    panelsDrawn = at;
    drawPanels();
  }
}

function redraw() {
  due.moment = true;
  due.panels = true;
}

/* ---- What the user asks for ---- */

function choose(length) {
  shownWindow = length;
  for (const button of byId("windows").children) button.setAttribute("aria-pressed", String(Number(button.value) === length));
  redraw();
}

function pause() {
  if (moments.length === 0) return;
  pausedAt = pausedAt === null ? now() : null;
  showPaused();
}

/** While it is paused the slider moves the moment; the 3D view then shows the places that are kept. */
function lookAt(time) {
  pausedAt = Math.min(Math.max(time, moments[0].t), moments.at(-1).t);
  byId("moment").value = pausedAt;
  redraw();
}

function showPaused() {
  const isPaused = pausedAt !== null;
  byId("pause").setAttribute("aria-pressed", String(isPaused));
  byId("pause").textContent = isPaused ? "▶ go on" : "❚❚ pause";
  const slider = byId("moment");
  slider.disabled = !isPaused;
  if (isPaused) {
    [slider.min, slider.max] = [moments[0].t, moments.at(-1).t];
    slider.value = pausedAt;
    followed.places = moments.flatMap((moment, index) => {
      const isFar = index > 0 && moment.t - moments[index - 1].t > LONGEST_GAP;
      return isFar ? [breakAt(moment.t), placeIn(moment)] : [placeIn(moment)];
    });
  } else {
    [slider.min, slider.max, slider.value] = [0, 1, 1];
    followed.places = followed.places.slice(-MOST_PLACES);
  }
  redraw();
}

function pressed(event) {
  const isElsewhere = event.ctrlKey || event.altKey || event.metaKey || event.target.matches("input, button");
  const step = Math.min(shownWindow, 60) / 50;
  const chosen = WINDOWS[Number(event.key) - 1];
  if (event.key === " " && !isElsewhere) pause();
  else if (chosen !== undefined && !isElsewhere) choose(chosen[0]);
  else if (event.key === "," && pausedAt !== null) lookAt(pausedAt - step);
  else if (event.key === "." && pausedAt !== null) lookAt(pausedAt + step);
  else return;
  event.preventDefault();
}

function fit() {
  for (const { plot } of plots) plot?.setSize({ width: plot.root.parentElement.clientWidth - 18, height: PANEL_HEIGHT });
  redraw();
}

for (const [length, name] of WINDOWS) {
  byId("windows").append(element("button", { type: "button", value: String(length), onclick: () => choose(length) }, name));
}
choose(shownWindow);
byId("pause").addEventListener("click", pause);
byId("moment").addEventListener("input", () => lookAt(byId("moment").valueAsNumber));
addEventListener("keydown", pressed);
addEventListener("resize", fit);
darkness.addEventListener("change", () => {
  followed.color = colorOf(0);
  for (const { plot } of plots) plot?.redraw(false);
  redraw();
});
requestAnimationFrame(draw);
connect();
