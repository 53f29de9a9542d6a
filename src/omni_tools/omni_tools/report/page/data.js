// Recordings as columns of numbers over time, and functions that read them.

function decodeColumn(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

function readRuns(report) {
  return report.runs.map((run, number) => {
    const columns = {};
    for (const [name, texts] of Object.entries(run.columns)) columns[name] = texts.map(decodeColumn);
    const read = { ...run, number, columns, times: columns.time[0] };
    read.forces = run.forces && readForces(run.forces, read);
    read.series = {};
    for (const [name, { names, time, values }] of Object.entries(run.series)) {
      read.series[name] = { names, times: decodeColumn(time), values: values.map(decodeColumn) };
    }
    return read;
  });
}

// Forces of the wheels in the body frame, so that they rotate with the vehicle between samples.
function readForces(forces, run) {
  const times = decodeColumn(forces.time);
  const values = forces.values.map(decodeColumn);
  const wheels = run.wheels.map((_, wheel) => {
    const [inX, inY] = [values[2 * wheel], values[2 * wheel + 1]];
    const x = new Float32Array(times.length), y = new Float32Array(times.length);
    times.forEach((time, i) => {
      const { yaw } = poseAt(run, time);
      x[i] = Math.cos(yaw) * inX[i] + Math.sin(yaw) * inY[i];
      y[i] = Math.cos(yaw) * inY[i] - Math.sin(yaw) * inX[i];
    });
    return { x, y };
  });
  const largest = finiteRange(wheels.map(({ x, y }) => x.map((fx, i) => Math.hypot(fx, y[i]))));
  return { times, wheels, largest: largest ? largest[1] : 0 };
}

// Index of the last sample that is not later than a time; 0 before the first sample.
function indexAt(times, time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
}

function poseAt(run, time) {
  const i = indexAt(run.times, time);
  const next = Math.min(i + 1, run.times.length - 1);
  const span = run.times[next] - run.times[i];
  const share = span > 0 ? Math.min(Math.max((time - run.times[i]) / span, 0), 1) : 0;
  const between = ([column]) => column[i] + share * (column[next] - column[i]);
  return { x: between(run.columns.x), y: between(run.columns.y), yaw: between(run.columns.yaw) };
}

function speedAt(run, i) {
  return Math.hypot(run.columns.velocity[0][i], run.columns.velocity[1][i]);
}

// Share of the pressure at the brake of a wheel; 1 if there is no enable.
function brakeShare(run, wheel, i) {
  if (!(run.columns.pedal[0][i] > 0)) return 0;
  const share = run.columns.enable[wheel][i];
  return Number.isNaN(share) ? 1 : Math.min(Math.max(share, 0), 1);
}

// "on", "released" or "up" (the pedal is not pressed).
function brakeState(run, wheel, i) {
  if (!(run.columns.pedal[0][i] > 0)) return "up";
  return brakeShare(run, wheel, i) > 0 ? "on" : "released";
}

function assistState(run, i) {
  let name = "";
  for (const [from, state] of run.states) if (from <= i) name = state;
  return name;
}

// Smallest and largest finite number of several columns; null if no number is finite.
function finiteRange(columns) {
  let low = Infinity, high = -Infinity;
  for (const column of columns) {
    for (const value of column) {
      if (value < low && value > -Infinity) low = value;
      if (value > high && value < Infinity) high = value;
    }
  }
  return low <= high ? [low, high] : null;
}

function inDigits(value, digits) {
  if (!Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

// About `count` round numbers within a range.
function roundTicks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return { ticks: multiples(step, low, high), step, digits };
}

// The multiples of a step within a range; the count is bounded for any range.
function multiples(step, low, high) {
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: count > 0 ? Math.min(count, 200) : 0 }, (_, k) => (first + k) * step);
}

// Present colors of the style sheet, light or dark.
function readColors() {
  const style = getComputedStyle(document.documentElement);
  const color = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = ["paper", "ink", "quiet", "rule", "braking", "released", "chassis", "slippery", "speed"];
  const colors = Object.fromEntries(names.map((name) => [name, color(name)]));
  colors.series = [0, 1, 2, 3, 4, 5].map((number) => color(`series-${number}`));
  return colors;
}

// Canvas with the resolution of the screen and CSS pixels as units.
function prepareCanvas(canvas, height) {
  const ratio = window.devicePixelRatio || 1;
  if (height) canvas.style.height = `${height}px`;
  const box = canvas.getBoundingClientRect();
  const [width, tall] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== width || canvas.height !== tall) [canvas.width, canvas.height] = [width, tall];
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  return { pen, width: box.width, height: box.height };
}
