// Drives the vehicle: sends pedal and stick to the driver node 20 times a second and draws the
// state that the node returns. If the page sends nothing (closed, hidden, halted), the vehicle brakes.
"use strict";

const HEARTBEAT = 50; // [ms]
const TRAIL = 4000; // maximum number of points
const METERS_ACROSS = 14; // length of the shorter side of the view [m]
const $ = (id) => document.getElementById(id);

const held = new Set(); // keys and buttons that are down
let socket = null;
let vehicle = null;
let state = null;
let trail = [];
let stopped = ""; // reason why this page no longer sends demands
let choosing = ""; // name of the vehicle, ground or law that is being loaded
// Requests are sent with each demand until the received state confirms them, also after a reconnection.
let assist = null; // confirmed position of the assistant's switch; null until the first state is received
let wanted = null; // requested position of the switch; null without a request
let early = false; // whether the switch was pressed before its position was known
let resetting = null; // identifier of the requested reset; null without a request

// ---------------------------------------------------------------- inputs of the person

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

// A touch that begins on the left half of the top view moves the vehicle; one on the right half turns it.
const fingers = new Map(); // first and present position of each finger [px]
const FULL = 70; // distance that gives full deflection of the stick [px]

function touched() {
  const stick = [0, 0, 0];
  const share = (pixels) => Math.max(-1, Math.min(1, -pixels / FULL));
  for (const { x, y, dx, dy } of fingers.values()) {
    if (x < $("scene").clientWidth / 2) [stick[0], stick[1]] = [share(dy), share(dx)];
    else stick[2] = share(dx);
  }
  return stick;
}

function demand() {
  const pair = (one, other) => held.has(one) - held.has(other);
  const pad = gamepad();
  const limit = $("limit").value / 100;
  const keys = [pair("forward", "back"), pair("left", "right"), pair("turn-left", "turn-right")];
  const pedal = document.hidden || held.has("brake") ? 1 : pad.pedal;
  const drawn = touched();
  return { pedal, stick: keys.map((key, axis) => limit * (key || drawn[axis] || pad.stick[axis])) };
}

function send(more = {}) {
  if (socket?.readyState !== WebSocket.OPEN) return;
  const requests = { ...(wanted !== null && { assist: wanted }), ...(resetting !== null && { reset: resetting }) };
  socket.send(JSON.stringify({ ...demand(), ...requests, ...more }));
}

function toggle() {
  if (assist === null) early = !early;
  else wanted = !(wanted ?? assist);
  send();
}

function reset() {
  resetting = Date.now();
  send();
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.target instanceof HTMLSelectElement) return; // letters and arrows choose an entry of the list
  const inControl = event.target instanceof HTMLInputElement;
  if (event.code === "KeyB" && !event.repeat) toggle();
  if (event.code === "KeyR" && !event.repeat) reset();
  if (!(event.code in KEYS) || (inControl && event.target.type === "range" && event.code.startsWith("Arrow"))) return;
  event.preventDefault(); // the key must neither scroll nor press the focused element
  held.add(KEYS[event.code]);
  send();
});
addEventListener("keyup", (event) => {
  if (!(event.code in KEYS)) return;
  event.preventDefault();
  held.delete(KEYS[event.code]);
  send();
});
$("scene").addEventListener("pointerdown", (event) => {
  $("scene").setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, dx: 0, dy: 0 });
});
$("scene").addEventListener("pointermove", (event) => {
  const finger = fingers.get(event.pointerId);
  if (!finger) return;
  [finger.dx, finger.dy] = [event.offsetX - finger.x, event.offsetY - finger.y];
  send();
});
for (const name of ["pointerup", "pointercancel"]) {
  $("scene").addEventListener(name, (event) => { fingers.delete(event.pointerId); send(); });
}
const letGo = () => { held.clear(); fingers.clear(); send(); };
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
$("assist").addEventListener("change", toggle);
$("reset").addEventListener("click", reset);
$("limit").addEventListener("input", () => { $("limit-value").textContent = `${$("limit").value} %`; });

// ---------------------------------------------------------------- the connection

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.vehicle) {
      vehicle = message.vehicle;
      choosing = "";
      state = stop = null;
      trail = [];
      wanted ??= assist; // nodes that were restarted begin with the switch of the experiment
      tabulate();
      offer(message.choices, message.remark);
    } else take(message);
  };
  socket.onclose = (event) => {
    if (event.code === 4001) stopped = "another page has taken over";
    if (!stopped) setTimeout(connect, 1000);
  };
}

// If another vehicle, ground or law is chosen, the command restarts the nodes, and this page reconnects.
function offer(choices, remark) {
  const kinds = Object.entries(choices);
  $("choices").hidden = !kinds.length;
  $("remark").textContent = remark;
  $("choices").replaceChildren(...kinds.flatMap(([kind, { chosen, names }]) => {
    const label = document.createElement("label"), list = document.createElement("select");
    label.textContent = kind[0].toUpperCase() + kind.slice(1);
    label.htmlFor = list.id = `choose-${kind}`;
    for (const name of names) list.add(new Option(spaced(name), name, false, name === chosen));
    list.disabled = names.length < 2;
    list.addEventListener("change", () => {
      send({ choose: [kind, list.value] });
      choosing = `${kind}: ${spaced(list.value)} …`;
      list.blur(); // the keys control the vehicle again
    });
    return [label, list];
  }));
  const named = (kind) => spaced(choices[kind]?.chosen ?? "");
  law = named("law");
  setup = kinds.length ? `${named("vehicle")} on ${named("ground")}, brakes: ${named("brakes")}` : "";
}

const spaced = (name) => name.replaceAll("_", " ");

function take(message) {
  const placed = state && message.placed !== state.placed; // elsewhere, for example at the start
  state = message;
  assist = state.assist;
  if (early) [wanted, early] = [!assist, false];
  if (wanted === assist && !state.switching) wanted = null;
  if (resetting === state.reset) resetting = null;
  if (!state.pose) return;
  if (placed) stop = { done: true };
  const last = trail.at(-1);
  const [x, y] = state.pose;
  if (!last || Math.hypot(x - last.x, y - last.y) > 0.05) {
    trail.push({ x, y, braked: state.pedal > 0, placed });
    if (trail.length > TRAIL) trail = trail.slice(TRAIL / 4);
  }
  if (state.twist) follow();
}

// ---------------------------------------------------------------- stops

const LATEST = 0.5; // limit on the time since the pedal was pressed [s]
const MOVING = 0.3; // minimum initial speed of a counted stop [m/s]
// As in a recording: at rest below SLOW [m/s, rad/s] until ROCKING is exceeded; a stop ends SETTLE [s] later.
const SLOW = 0.1, ROCKING = 0.4, SETTLE = 0.5;
const HELPS = ["assisting", "dead_reckoning", "no_release"];
let stop = null, stops = 0, law = "", setup = "";

// A stop begins when the pedal is pressed in motion and ends at rest with the pedal still pressed.
// A stopped vehicle rocks on its tires by some centimeters, so the distance is measured after that.
function follow() {
  const [vx, vy, rate] = state.twist, motion = Math.max(Math.hypot(vx, vy), Math.abs(rate));
  if (!(state.pedal > 0)) { stop = null; return; }
  if (!stop) {
    if (!state.start || state.start.time < state.time - LATEST) return; // the start is that of an earlier stop
    stop = { ...state.start, turned: 0, yaw: state.start.pose[2], done: state.start.speed < MOVING, helped: 0, states: 0 };
  }
  if (stop.done) return;
  const change = state.pose[2] - stop.yaw;
  stop.turned += Math.atan2(Math.sin(change), Math.cos(change));
  stop.yaw = state.pose[2];
  if (motion > ROCKING) stop.rest = undefined;
  else if (motion <= SLOW) stop.rest ??= state.time;
  if (stop.rest === undefined) {
    stop.states += 1;
    stop.helped += HELPS.includes(state.assist_state);
  }
  if (!(state.time - stop.rest >= SETTLE)) return;
  stop.done = true;
  card(Math.hypot(state.pose[0] - stop.pose[0], state.pose[1] - stop.pose[1]));
}

function card(distance) {
  const helped = stop.helped / stop.states;
  const row = document.createElement("li");
  row.className = helped > 0.2 ? "helps" : "";
  const how = helped > 0.2 ? `assisted ${law && `by ${law}`}` : "unassisted";
  const [x, y] = stop.pose.map((value) => (Math.round(10 * value) / 10 + 0).toFixed(1)); // -0 + 0 is 0
  const words = [`Stop ${stops += 1}: ${how}`,
    `from ${stop.speed.toFixed(1)}\u00a0m/s in ${(stop.rest - stop.time).toFixed(1)}\u00a0s at (${x},\u00a0${y})\u00a0m`];
  const numbers = document.createElement("b");
  numbers.textContent = `${length(distance)}, ${Math.abs(stop.turned * 180 / Math.PI).toFixed(1)}°`;
  row.append(words[0], numbers, words[1]);
  group().prepend(row);
}

// Stops can be compared only if vehicle, ground and brakes are equal, so each change of them begins a list.
function group() {
  if ($("stops").firstElementChild?.textContent !== setup) {
    const heading = document.createElement("h2");
    heading.textContent = setup;
    $("stops").prepend(heading, document.createElement("ol"));
  }
  return $("stops").querySelector("ol");
}

const radians = (degrees) => degrees * Math.PI / 180;

const length = (meters) => (meters < 1 ? `${Math.round(100 * meters)} cm` : `${meters.toFixed(2)} m`);

// ---------------------------------------------------------------- numbers

function tabulate() {
  $("ice-legend").hidden = !vehicle.patches.length;
  $("wheels").replaceChildren(...vehicle.wheels.map((wheel) => {
    const row = document.createElement("tr");
    for (const text of [wheel.name, "–", "–"]) row.insertCell().textContent = text;
    return row;
  }));
}

// State of the assistant as a banner, with the reason of a fault.
const BANNERS = {
  assisting: "ASSISTING", dead_reckoning: "DEAD RECKONING", no_release: "ASSISTING: all brakes on",
  below_speed_threshold: "AT REST: all brakes on", disabled: "ASSISTANT OFF", inactive: "READY",
};

function announce() {
  const name = state.assist_state ?? "", banner = $("banner");
  const words = BANNERS[name] ?? `${spaced(name).toUpperCase()}: all brakes on`;
  const className = HELPS.includes(name) ? "helps" : name in BANNERS ? "" : "fault";
  if (banner.hidden === !name && banner.dataset.words === words + state.assist_reason) return;
  banner.hidden = !name;
  banner.dataset.words = words + state.assist_reason;
  banner.className = className;
  banner.textContent = words;
  if (className === "fault") {
    const reason = document.createElement("small");
    reason.textContent = state.assist_reason ?? "";
    banner.append(reason);
  }
}

// State of a wheel: no braking, the brake acts, or the assistant releases the brake.
function brakeState(index) {
  if (!(state.pedal > 0)) return "rolling";
  return (state.enable?.[index] ?? 1) > 0 ? "braking" : "released";
}
const WORDS = { rolling: "○ off", braking: "● acts", released: "◌ released" };

function write() {
  $("notice").textContent = stopped || choosing || (socket?.readyState !== WebSocket.OPEN ? "not connected: the vehicle brakes"
    : document.hidden ? "hidden: the vehicle brakes" : !state?.pose ? "waiting for the vehicle …"
    : resetting !== null ? "back to the start …" : "");
  $("assist").checked = assist;
  $("assist").indeterminate = assist === null;
  $("pending").textContent = early ? "pending" : wanted !== null ? `${wanted ? "on" : "off"}: pending` : "";
  $("banner").style.visibility = $("notice").textContent ? "hidden" : ""; // the banner shows an old state
  $("brake").classList.toggle("down", held.has("brake"));
  if (!state?.pose || !vehicle) return;
  const [vx, vy, yawRate] = state.twist;
  $("speed").textContent = Math.hypot(vx, vy).toFixed(2);
  $("yaw").textContent = String(Math.round(yawRate * 180 / Math.PI) || 0);
  $("time").textContent = state.time.toFixed(1);
  $("source").textContent = { page: "this page", cmd_vel: "cmd_vel", none: "none: full braking" }[state.source] ?? "–";
  $("pedal").style.width = `${100 * (state.pedal ?? 0)}%`;
  announce();
  $("assist-state").textContent = `${spaced(state.assist_state ?? "")}: ${state.assist_reason ?? ""}`;
  vehicle.wheels.forEach((_, index) => {
    const cells = $("wheels").rows[index].cells;
    const share = state.enable?.[index] ?? 1, condition = brakeState(index);
    const partly = condition === "braking" && share < 1;
    cells[1].textContent = partly ? `● ${Math.round(100 * share)} %` : WORDS[condition];
    const error = state.error?.[index] ?? 0;
    cells[2].textContent = `${error < 0 ? "−" : "+"}${Math.abs(error).toFixed(3)}`;
  });
}

// ---------------------------------------------------------------- top view

function draw() {
  const canvas = $("scene"), style = getComputedStyle(document.documentElement);
  const color = (name) => style.getPropertyValue(`--${name}`);
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  const scale = Math.min(width, height) / METERS_ACROSS;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  if (!state?.pose || !vehicle) return;
  const [x, y, yaw] = state.pose;
  // World frame: x to the right, y up, the vehicle in the middle.
  pen.translate(width / 2, height / 2);
  pen.scale(scale, -scale);
  for (const patch of vehicle.patches) drawPatch(pen, color, patch, x, y, scale);
  pen.lineWidth = 1 / scale;
  pen.strokeStyle = color("line");
  const reachX = width / 2 / scale + 1, reachY = height / 2 / scale + 1;
  pen.beginPath();
  for (let gx = Math.ceil(x - reachX); gx < x + reachX; gx += 1) { pen.moveTo(gx - x, -reachY); pen.lineTo(gx - x, reachY); }
  for (let gy = Math.ceil(y - reachY); gy < y + reachY; gy += 1) { pen.moveTo(-reachX, gy - y); pen.lineTo(reachX, gy - y); }
  pen.stroke();
  pen.lineWidth = 0.05;
  for (let i = 1; i < trail.length; i += 1) {
    if (trail[i].placed) continue;
    const from = trail[i - 1], to = trail[i];
    pen.strokeStyle = color(to.braked ? "braking" : "rolling");
    pen.beginPath();
    pen.moveTo(from.x - x, from.y - y);
    pen.lineTo(to.x - x, to.y - y);
    pen.stroke();
  }
  pen.rotate(yaw);
  pen.fillStyle = color("body");
  const nose = vehicle.x + vehicle.length / 2;
  pen.fillRect(nose - vehicle.length, vehicle.y - vehicle.width / 2, vehicle.length, vehicle.width);
  pen.fillStyle = color("ink"); // marks the front of the vehicle
  pen.beginPath();
  pen.moveTo(nose - 0.1, vehicle.y);
  pen.lineTo(nose - 0.3, vehicle.y + 0.12);
  pen.lineTo(nose - 0.3, vehicle.y - 0.12);
  pen.fill();
  vehicle.wheels.forEach((wheel, index) => drawWheel(pen, color, wheel, brakeState(index)));
  const [vx, vy] = state.twist;
  pen.strokeStyle = color("arrow");
  pen.lineWidth = 0.06;
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.lineTo(0.5 * vx, 0.5 * vy); // distance traveled in half a second
  pen.stroke();
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.strokeStyle = color("arrow");
  pen.lineWidth = 3;
  for (const { x, y, dx, dy } of fingers.values()) {
    pen.beginPath();
    pen.arc(x, y, FULL, 0, 2 * Math.PI);
    pen.moveTo(x, y);
    pen.lineTo(x + dx, y + dy);
    pen.stroke();
  }
  drawScale(pen, color, ratio, width, height, scale);
}

function drawPatch(pen, color, patch, x, y, scale) {
  pen.save();
  pen.translate(patch.x - x, patch.y - y);
  pen.rotate(radians(patch.heading_deg));
  pen.fillStyle = color("ice");
  pen.beginPath();
  if (patch.shape === "ellipse") pen.ellipse(0, 0, patch.length / 2, patch.width / 2, 0, 0, 2 * Math.PI);
  else pen.rect(-patch.length / 2, -patch.width / 2, patch.length, patch.width);
  pen.fill();
  pen.scale(1 / scale, -1 / scale);
  pen.fillStyle = color("ink");
  pen.font = "14px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillText(`${patch.name}, friction ${patch.friction}`, 0, 5);
  pen.restore();
}

// Scale bar of one meter, or of a round number of meters that gives a readable length.
function drawScale(pen, color, ratio, width, height, scale) {
  const meters = [1, 2, 5, 10].find((one) => one * scale > 50) ?? 10;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  const right = width - 16, base = height - 14, left = right - meters * scale;
  pen.strokeStyle = pen.fillStyle = color("ink");
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(left, base - 6); pen.lineTo(left, base); pen.lineTo(right, base); pen.lineTo(right, base - 6);
  pen.stroke();
  pen.font = "14px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillText(`${meters} m`, (left + right) / 2, base - 8);
}

function drawWheel(pen, color, wheel, condition) {
  const length = 2 * wheel.radius, width = 0.6 * wheel.radius;
  pen.save();
  pen.translate(wheel.x, wheel.y);
  pen.rotate(radians(wheel.heading_deg));
  pen.fillStyle = pen.strokeStyle = color(condition);
  pen.lineWidth = 0.04;
  // A wheel is filled if its brake acts, so that the state is visible without color.
  if (condition === "released") pen.setLineDash([0.06, 0.05]);
  if (condition === "braking") pen.fillRect(-length / 2, -width / 2, length, width);
  pen.strokeRect(-length / 2, -width / 2, length, width);
  pen.setLineDash([]);
  pen.strokeStyle = color("ink");
  pen.lineWidth = 0.02;
  pen.rotate(radians(wheel.roller_angle_deg));
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
