"use strict";

/* What the report's page and the live page share: colours, elements, numbers in words, axes. */

// A token in the address has done its work once the page is here: from then on it is in a cookie.
if (location.search.startsWith("?t=")) history.replaceState(null, "", location.pathname);

/** Told apart by eyes of all kinds (after Okabe and Ito), on white and on black, also from the bound and from faults. */
const COLORS = {
  light: ["#0072b2", "#009e73", "#cc79a7", "#6a51a3", "#56b4e9", "#8a6d00", "#333333"],
  dark: ["#56b4e9", "#2fc79a", "#e59ac4", "#b3a1f0", "#9ad0f5", "#d9c67a", "#dddddd"],
};
const DASHES = [[], [7, 4], [2, 3]];
const DASH_NAMES = ["solid", "dashed", "dotted"];

/** Least value that a logarithmic axis shows: it knows no zero. */
const FLOOR = 1e-5;

const PANEL_HEIGHT = 220;

const darkness = matchMedia("(prefers-color-scheme: dark)");
const byId = (id) => document.getElementById(id);
const isDark = () => darkness.matches && !document.documentElement.classList.contains("print");
const palette = () => (isDark() ? COLORS.dark : COLORS.light);
const colorOf = (index) => palette()[index % palette().length];
const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** An element with attributes and children. Text becomes text, whatever it holds. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== null) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function inDigits(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return Number(value.toPrecision(3)).toExponential();
  return String(Number(value.toPrecision(4)));
}

/** Powers of ten that are named on a logarithmic axis: more overlap where a flight has gone wrong. */
const MOST_POWERS = 8;

/** What a logarithmic axis names: powers of ten, every so manieth of many; where there is hardly one, 1, 2 and 5 of each. */
function namesOfLogarithmic(values) {
  const powers = values.filter(isPower).map((value) => Math.round(Math.log10(value)));
  if (powers.length < 2) {
    const isNamed = (value) => value !== null && isRound(value) && ["1", "2", "5"].includes(value.toExponential(0)[0]);
    return values.map((value) => (isNamed(value) ? inDigits(value) : ""));
  }
  const every = Math.ceil(powers.length / MOST_POWERS);
  return values.map((value) => (isPower(value) && Math.round(Math.log10(value)) % every === 0 ? inDigits(value) : ""));
}

const isRound = (value) => Math.abs(Number(value.toPrecision(1)) / value - 1) < 1e-9;
const isPower = (value) => Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-9;

function axes(panel) {
  const common = {
    stroke: () => variable("--faint"),
    grid: { stroke: () => variable("--grid"), width: 1 },
    ticks: { stroke: () => variable("--grid"), width: 1 },
    font: "11px system-ui, sans-serif",
  };
  return [
    { ...common, size: 30, values: (_, values) => values.map((value) => `${label(value)} s`), space: 70 },
    {
      ...common,
      size: 62,
      values: (_, values) => (panel.is_logarithmic ? namesOfLogarithmic(values) : values.map(inDigits)),
    },
  ];
}

/** The range upwards: all that is seen, the bound with it, and never so near that rounding fills the panel. */
function rangeUpwards(panel, bounds) {
  if (panel.is_logarithmic) {
    return (_, low, high) => uPlot.rangeLog(Math.min(low ?? 1, ...bounds) * 0.7, Math.max(high ?? 1, ...bounds) * 1.3, 10, false);
  }
  return (_, low, high) => {
    if (low === null || high === null || (low === 0 && high === 0)) return [-1, 1];
    const middle = (low + high) / 2;
    const half = Math.max((high - low) * 0.55, Math.abs(middle) * 1e-4, 1e-6);
    return [middle - half, middle + half];
  };
}

/** Lines at what has happened, and at the bounds. */
function drawMarks(plot, marks, bounds) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.lineWidth = devicePixelRatio;
  for (const mark of marks) {
    ctx.strokeStyle = variable(mark.kind === "fault" || mark.kind === "safety" ? "--fault" : "--mark");
    ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
    const x = plot.valToPos(mark.time, "x", true);
    stroke(ctx, [x, bbox.top], [x, bbox.top + bbox.height]);
  }
  drawBounds(plot, bounds);
  ctx.restore();
}

/** Lines at the theorem's bounds. */
function drawBounds(plot, bounds) {
  const { ctx, bbox } = plot;
  ctx.setLineDash([]);
  ctx.strokeStyle = variable("--bound");
  for (const bound of bounds) {
    const y = plot.valToPos(bound, "y", true);
    stroke(ctx, [bbox.left, y], [bbox.left + bbox.width, y]);
  }
}

/** Names the bounds; what lies behind a name shall not hide it, nor may one name lie on another. */
function nameBounds(plot, bounds) {
  const { ctx, bbox } = plot;
  const right = bbox.left + bbox.width - 6 * devicePixelRatio;
  ctx.save();
  ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  ctx.lineJoin = "round";
  ctx.lineWidth = 4 * devicePixelRatio;
  ctx.strokeStyle = variable("--card");
  ctx.fillStyle = variable("--bound");
  const apart = 13 * devicePixelRatio;
  let lowest = -Infinity;
  for (const bound of bounds) {
    const text = `theorem's bound ${inDigits(bound)} m`;
    const y = Math.max(plot.valToPos(bound, "y", true) - 5 * devicePixelRatio, lowest + apart);
    lowest = y;
    ctx.strokeText(text, right, y);
    ctx.fillText(text, right, y);
  }
  ctx.restore();
}

function stroke(ctx, from, to) {
  ctx.beginPath();
  ctx.moveTo(...from);
  ctx.lineTo(...to);
  ctx.stroke();
}

function tableOf(heads, rows) {
  const cells = (name, texts) => texts.map((text) => (text instanceof Node ? element(name, {}, text) : element(name, {}, String(text))));
  return element("div", { class: "scroll" }, element("table", {},
    element("thead", {}, element("tr", {}, ...cells("th", heads))),
    element("tbody", {}, ...rows.map((row) => element("tr", {}, ...cells("td", row))))));
}
