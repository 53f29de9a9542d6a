// Drives the vehicle: tells the driver's node pedal and stick 20 times a second and draws what it
// answers. Whatever keeps this page from speaking (closed, hidden, halted) brakes the vehicle.
"use strict";

const HEARTBEAT = 50; // [ms]
const TRAIL = 4000; // points
const METRES_ACROSS = 14; // of the shorter side of the view
const $ = (id) => document.getElementById(id);

const held = new Set(); // keys and buttons that are down
let socket = null;
let vehicle = null;
let state = null;
let trail = [];
let stopped = ""; // why this page no longer drives

// ---------------------------------------------------------------- what the person asks for

const KEYS = {
  KeyW: "forward", ArrowUp: "forward", KeyS: "back", ArrowDown: "back",
  KeyA: "left", ArrowLeft: "left", KeyD: "right", ArrowRight: "right",
  KeyQ: "turn-left", KeyE: "turn-right", Space: "brake",
};

function gamepad() {
  const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected && one.mapping === "standard");
  if (!pad) return { pedal: 0, stick: [0, 0, 0] };
  const axis = (index) => (Math.abs(pad.axes[index]) > 0.12 ? -pad.axes[index] : 0);
  return { pedal: pad.buttons[7].value, stick: [axis(1), axis(0), axis(2)] };
}

function demand() {
  const pair = (one, other) => held.has(one) - held.has(other);
  const pad = gamepad();
  const limit = $("limit").value / 100;
  const keys = [pair("forward", "back"), pair("left", "right"), pair("turn-left", "turn-right")];
  const pedal = document.hidden || held.has("brake") ? 1 : pad.pedal;
  return { pedal, stick: keys.map((key, axis) => limit * (key || pad.stick[axis])) };
}

function send(more = {}) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ ...demand(), ...more }));
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const inControl = event.target instanceof HTMLInputElement;
  if (event.code === "KeyB" && !event.repeat && !$("assist").disabled) $("assist").click();
  if (!(event.code in KEYS) || (inControl && event.target.type === "range" && event.code.startsWith("Arrow"))) return;
  event.preventDefault(); // neither scroll nor press what has the focus
  held.add(KEYS[event.code]);
  send();
});
addEventListener("keyup", (event) => {
  if (!(event.code in KEYS)) return;
  event.preventDefault();
  held.delete(KEYS[event.code]);
  send();
});
const letGo = () => { held.clear(); send(); };
addEventListener("blur", letGo);
document.addEventListener("visibilitychange", letGo);
$("brake").addEventListener("pointerdown", (event) => {
  $("brake").setPointerCapture(event.pointerId);
  held.add("brake");
  send();
});
for (const name of ["pointerup", "pointercancel"]) {
  $("brake").addEventListener(name, () => { held.delete("brake"); send(); });
}
$("assist").addEventListener("change", () => send({ assist: $("assist").checked }));
$("limit").addEventListener("input", () => { $("limit-value").textContent = `${$("limit").value} %`; });

// ---------------------------------------------------------------- the connection

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onopen = () => { $("assist").disabled = false; };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.vehicle) {
      vehicle = message.vehicle;
      tabulate();
    } else take(message);
  };
  socket.onclose = (event) => {
    $("assist").disabled = true;
    if (event.code === 4001) stopped = "another page has taken over";
    if (!stopped) setTimeout(connect, 1000);
  };
}

function take(message) {
  state = message;
  if (!state.pose) return;
  const last = trail.at(-1);
  const [x, y] = state.pose;
  if (!last || Math.hypot(x - last.x, y - last.y) > 0.05) {
    trail.push({ x, y, braked: state.pedal > 0 });
    if (trail.length > TRAIL) trail = trail.slice(TRAIL / 4);
  }
}

// ---------------------------------------------------------------- numbers

function tabulate() {
  $("wheels").replaceChildren(...vehicle.wheels.map((wheel) => {
    const row = document.createElement("tr");
    for (const text of [wheel.name, "–", "–"]) row.insertCell().textContent = text;
    return row;
  }));
}

// A wheel rolls, its brake acts, or the assistant holds its brake back.
function brakeState(index) {
  if (!(state.pedal > 0)) return "rolling";
  return (state.enable?.[index] ?? 1) > 0 ? "braking" : "released";
}
const WORDS = { rolling: "○ off", braking: "● acts", released: "◌ held back" };

function write() {
  $("notice").textContent = stopped || (socket?.readyState !== WebSocket.OPEN ? "not connected: the vehicle brakes"
    : document.hidden ? "hidden: the vehicle brakes" : !state?.pose ? "waiting for the vehicle …" : "");
  $("brake").classList.toggle("down", held.has("brake"));
  if (!state?.pose || !vehicle) return;
  const [vx, vy, yawRate] = state.twist;
  $("speed").textContent = Math.hypot(vx, vy).toFixed(2);
  $("yaw").textContent = String(Math.round(yawRate * 180 / Math.PI) || 0);
  $("time").textContent = state.time.toFixed(1);
  $("source").textContent = { page: "this page", cmd_vel: "cmd_vel", nobody: "nobody: full braking" }[state.source] ?? "–";
  $("pedal").style.width = `${100 * (state.pedal ?? 0)}%`;
  $("assist").checked = state.assist;
  $("assist-state").textContent = `${(state.assist_state ?? "").replaceAll("_", " ")}: ${state.assist_reason ?? ""}`;
  vehicle.wheels.forEach((_, index) => {
    const cells = $("wheels").rows[index].cells;
    cells[1].textContent = WORDS[brakeState(index)];
    const error = state.error?.[index] ?? 0;
    cells[2].textContent = `${error < 0 ? "−" : "+"}${Math.abs(error).toFixed(3)}`;
  });
}

// ---------------------------------------------------------------- top view

function draw() {
  const canvas = $("scene"), style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`);
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  const scale = Math.min(width, height) / METRES_ACROSS;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  if (!state?.pose || !vehicle) return;
  const [x, y, yaw] = state.pose;
  // World frame: x to the right, y up, the vehicle in the middle.
  pen.translate(width / 2, height / 2);
  pen.scale(scale, -scale);
  pen.lineWidth = 1 / scale;
  pen.strokeStyle = colour("line");
  const reachX = width / 2 / scale + 1, reachY = height / 2 / scale + 1;
  pen.beginPath();
  for (let gx = Math.ceil(x - reachX); gx < x + reachX; gx += 1) { pen.moveTo(gx - x, -reachY); pen.lineTo(gx - x, reachY); }
  for (let gy = Math.ceil(y - reachY); gy < y + reachY; gy += 1) { pen.moveTo(-reachX, gy - y); pen.lineTo(reachX, gy - y); }
  pen.stroke();
  pen.lineWidth = 0.05;
  for (let i = 1; i < trail.length; i += 1) {
    const from = trail[i - 1], to = trail[i];
    pen.strokeStyle = colour(to.braked ? "braking" : "rolling");
    pen.beginPath();
    pen.moveTo(from.x - x, from.y - y);
    pen.lineTo(to.x - x, to.y - y);
    pen.stroke();
  }
  pen.rotate(yaw);
  pen.fillStyle = colour("body");
  pen.fillRect(-vehicle.length / 2, -vehicle.width / 2, vehicle.length, vehicle.width);
  pen.fillStyle = colour("ink"); // which way is forward
  pen.beginPath();
  pen.moveTo(vehicle.length / 2 - 0.1, 0);
  pen.lineTo(vehicle.length / 2 - 0.3, 0.12);
  pen.lineTo(vehicle.length / 2 - 0.3, -0.12);
  pen.fill();
  vehicle.wheels.forEach((wheel, index) => drawWheel(pen, colour, wheel, brakeState(index)));
  const [vx, vy] = state.twist;
  pen.strokeStyle = colour("arrow");
  pen.lineWidth = 0.06;
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.lineTo(0.5 * vx, 0.5 * vy); // half a second ahead
  pen.stroke();
}

function drawWheel(pen, colour, wheel, condition) {
  const length = 2 * wheel.radius, width = 0.6 * wheel.radius;
  pen.save();
  pen.translate(wheel.x, wheel.y);
  pen.rotate(wheel.heading);
  pen.fillStyle = pen.strokeStyle = colour(condition);
  pen.lineWidth = 0.04;
  // Filled where the brake acts, so that it does not take a colour to tell.
  if (condition === "released") pen.setLineDash([0.06, 0.05]);
  if (condition === "braking") pen.fillRect(-length / 2, -width / 2, length, width);
  pen.strokeRect(-length / 2, -width / 2, length, width);
  pen.setLineDash([]);
  pen.strokeStyle = colour("ink");
  pen.lineWidth = 0.02;
  pen.rotate(wheel.roller);
  pen.beginPath();
  pen.moveTo(-width / 2, 0);
  pen.lineTo(width / 2, 0);
  pen.stroke();
  pen.restore();
}

function show() {
  write();
  draw();
  requestAnimationFrame(show);
}

connect();
setInterval(() => send(), HEARTBEAT);
show();
