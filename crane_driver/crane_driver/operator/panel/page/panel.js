// The page of `ros2 run crane_driver panel`: shows what the panel tells, and asks for what buttons say.
"use strict";

const SILENCE = 1000; // ms without a picture, after which the line is lost; ten come a second
const RETRY = 1000; // ms
const PATIENCE = 1000; // ms for an answer
const NO_LINE_TO_SPARE = 1013; // why a line is closed at once: too many pages are live
// The number of DriverState.msg: what a colour says of the word beside it.
const TONES = { 3: "calm", 4: "live", 5: "alarm", 6: "alarm" };
const BUTTONS = ["enable", "disable", "reset"]; // all need the token; stop does not

const $ = (id) => document.getElementById(id);
let socket = null;
let live = false; // pictures come through it
let heard = 0; // when the last picture came, or the line was begun
let last = ""; // the time that it showed
let why = ""; // the panel gave for closing the line; kept while tries to connect fail
let built = ""; // for which joints and cylinders the rows were made
let armed = false;
let waiting = {}; // timers of requests that were not answered yet

function connect() {
  const line = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket = line;
  heard = performance.now();
  line.onmessage = (event) => {
    if (line !== socket) return;
    const told = JSON.parse(event.data);
    if ("armed" in told) arm(told.armed, told.refusal);
    if ("answer" in told) answered(told);
    if ("picture" in told) {
      heard = performance.now();
      live = true;
      document.body.classList.remove("lost");
      why = "";
      show(told.picture);
      say({ seen: told.picture.time });
      usable(true);
    }
  };
  line.onclose = (event) => {
    if (line === socket) lose(event.reason, event.code === NO_LINE_TO_SPARE);
    // given up for its silence before this page, held up, reads why: the next try that fails says it
    else if (!live) why = event.reason || why;
  };
}

// Where it was refused a live line, the panel is there and Stop works without one.
function lose(reason, refused) {
  socket = null;
  document.body.classList.add("lost");
  const since = last ? ` Values shown are from ${last}.` : "";
  why = refused ? "" : reason || why;
  $("loss").textContent = refused
    ? `This page is not live: ${reason}.${since} Stop works from here, too.`
    : `The connection to the panel is lost${why && `: ${why}`}.${since} Stop does not work from here: use the machine’s emergency stop.`;
  document.title = refused ? "NOT LIVE" : "LOST";
  if (live) {
    Object.values(waiting).forEach(clearTimeout);
    waiting = {};
    answer("", false);
  }
  live = false;
  arm(false, "");
  usable(false);
  $("stop").disabled = !refused;
  setTimeout(connect, RETRY);
}

setInterval(() => {
  if (socket && performance.now() - heard > SILENCE) {
    const old = socket;
    lose("", false);
    old.close();
  }
}, 200);

function say(message) {
  const heeded = live && socket.readyState === WebSocket.OPEN;
  if (heeded) socket.send(JSON.stringify(message));
  return heeded;
}

function usable(connected) {
  $("stop").disabled = !connected;
  for (const id of BUTTONS) $(id).disabled = !(connected && armed);
  $("token").disabled = $("arm").disabled = !connected;
}

// buttons

function ask(name) {
  if (!say({ request: name }) && name === "stop") stopWithoutLine();
  answer(`${name}: requested …`, false);
  clearTimeout(waiting[name]);
  waiting[name] = setTimeout(() => {
    answer(`${name}: no answer yet. Use the machine’s emergency stop if the crane must stop.`, true);
  }, PATIENCE);
}

async function stopWithoutLine() {
  try {
    answered(await (await fetch("stop", { method: "POST" })).json());
  } catch {
    answered({ answer: "stop", success: false, message: "the panel does not answer. Use the machine’s emergency stop." });
  }
}

function answered(told) {
  clearTimeout(waiting[told.answer]);
  const message = told.message.startsWith(told.answer) ? told.message : `${told.answer}: ${told.message}`;
  answer(message, !told.success);
}

function answer(text, failed) {
  $("answer").textContent = text;
  $("answer").dataset.failed = failed;
}

function arm(now, refusal) {
  if (armed !== now) answer("", false);
  armed = now;
  $("arming").hidden = armed;
  $("armed").hidden = !armed;
  if (armed) $("token").value = "";
  if (refusal) answer(refusal, true);
}

for (const id of BUTTONS) $(id).addEventListener("click", () => ask(id));
$("stop").addEventListener("pointerdown", () => { if (!$("stop").disabled) ask("stop"); }); // not when it is let go
$("stop").addEventListener("click", (event) => { if (event.detail === 0) ask("stop"); }); // by keyboard
$("disarm").addEventListener("click", () => say({ disarm: true }));
$("arming").addEventListener("submit", (event) => {
  event.preventDefault();
  say({ token: $("token").value });
});

// what is shown

function text(id, content) {
  if ($(id).textContent !== content) $(id).textContent = content; // else it would be read out again
}

function show(picture) {
  const { state, experiment } = picture;
  last = picture.time;
  text("machine", picture.machine + (picture.namespace === "/" ? "" : ` in ${picture.namespace}`));
  text("clock", picture.time);
  text("word", state.word);
  text("cause", state.cause + (state.further_faults ? ` (and ${state.further_faults} more)` : ""));
  text("remedy", state.remedy);
  $("state").dataset.tone = TONES[state.number] || "idle";
  document.title = `${state.word} – ${picture.machine}`;
  $("unknown_joints").hidden = picture.unknown_joints.length === 0;
  text("unknown_joints", `Readings arrive for ${picture.unknown_joints.join(", ")}, which this machine does not have: give the panel the driver’s machine.`);
  build(picture);
  picture.joints.forEach(showJoint);
  if (picture.pressures) showPressures(picture.pressures);
  showExperiment(experiment);
  showFaults(picture.faults);
  $("lost-page").hidden = !picture.lost_page;
  text("lost-page", picture.lost_page);
}

function build(picture) {
  const oil = picture.pressures;
  const key = JSON.stringify([picture.joints.map((one) => one.name), oil && oil.cylinders.map((one) => one.name)]);
  if (key === built) return;
  built = key;
  $("joints").replaceChildren(...picture.joints.map((one) => {
    const row = reading(`joint-${one.name}`, one.name.replaceAll("_", " "), ["position", "speed"]);
    row.querySelector(".speed").before(
      element("span", "ends", element("span", "", shown(one.lowest, 2)), element("span", "", shown(one.highest, 2))),
      element("span", "speed-name", "speed"), element("span", "speed-value"),
    );
    return row;
  }));
  $("oil").hidden = !oil;
  if (!oil) return;
  $("pressures").replaceChildren(
    reading("oil-supply", "supply", ["a"]),
    reading("oil-tank", "tank", ["a"]),
    ...oil.cylinders.map((one) => reading(`oil-${one.name}`, `${one.name.replaceAll("_", " ")}, A and B`, ["a", "b"])),
  );
}

function reading(id, name, scales) {
  const row = element("div", "reading", element("span", "name", name), element("span", "value", "–"));
  row.id = id;
  for (const kind of scales) {
    const scale = element("span", `scale ${kind}`, document.createElement("i"));
    scale.setAttribute("role", "meter");
    scale.setAttribute("aria-label", `${name}, ${kind}`);
    row.append(scale);
  }
  return row;
}

function element(tag, kind, ...content) {
  const made = document.createElement(tag);
  made.className = kind;
  made.append(...content);
  return made;
}

function showJoint(joint) {
  const row = $(`joint-${joint.name}`);
  const [position, speed] = row.querySelectorAll(".scale");
  const known = joint.position !== null;
  const beyond = known && ((joint.lowest !== null && joint.position < joint.lowest) || (joint.highest !== null && joint.position > joint.highest));
  row.classList.toggle("beyond", beyond);
  value(row, known ? `${shown(joint.position, 3)} ${joint.unit}${beyond ? ", beyond its limit" : ""}` : null);
  row.querySelector(".speed-value").textContent = joint.velocity === null ? "not known" : `${shown(joint.velocity, 3)} ${joint.unit}/s`;
  meter(position, joint.position, joint.lowest, joint.highest);
  fill(position, share(joint.position, joint.lowest, joint.highest), null);
  meter(speed, joint.velocity, joint.slowest, joint.fastest);
  const zero = share(0, joint.slowest, joint.fastest);
  const at = share(joint.velocity, joint.slowest, joint.fastest);
  if (zero !== null) speed.style.setProperty("--zero", percent(zero));
  const measured = at !== null && zero !== null;
  fill(speed, measured ? Math.min(zero, at) : null, measured ? Math.abs(at - zero) : null);
}

function showPressures(oil) {
  const alive = [oil.supply, oil.tank, ...oil.cylinders.flatMap((one) => [one.a, one.b])].some((one) => one !== null);
  showPressure("oil-supply", [oil.supply], oil.highest, alive);
  showPressure("oil-tank", [oil.tank], oil.highest, alive);
  for (const one of oil.cylinders) showPressure(`oil-${one.name}`, [one.a, one.b], oil.highest, alive);
}

function showPressure(id, values, highest, alive) {
  const row = $(id);
  const known = values.some((one) => one !== null);
  value(row, known ? values.map((one) => (one === null ? "not measured" : shown(one / 1e6, 2))).join("\u2003") : alive ? "not measured" : null);
  row.querySelectorAll(".scale").forEach((scale, i) => {
    meter(scale, values[i], 0, highest);
    fill(scale, values[i] === null ? null : 0, share(values[i], 0, highest));
  });
}

function showExperiment(experiment) {
  $("progress").hidden = !experiment.running;
  if (!experiment.running) {
    text("phase", experiment.last ? `none runs; the last one: ${experiment.last}` : "none runs");
    $("errors").replaceChildren();
    return;
  }
  text("phase", `${experiment.phase}, ${shown(experiment.elapsed, 0)} of ${shown(experiment.duration, 0)} s`);
  $("progress").max = experiment.duration || 1;
  $("progress").value = experiment.elapsed || 0;
  $("errors").replaceChildren(...experiment.errors.map((one) => element("li", "",
    element("span", "", `tracking error, ${one.name.replaceAll("_", " ")}`),
    element("span", "", `${shown(one.error === null ? null : one.error * 1e3, 1)} m${one.unit}`))));
}

function showFaults(faults) {
  const key = faults.map((one) => one.time + one.cause).join();
  $("no-faults").hidden = faults.length > 0;
  if ($("faults").dataset.key === key) return;
  $("faults").dataset.key = key;
  $("faults").replaceChildren(...faults.map((one) => element("li", "",
    element("time", "soft", one.time), element("b", "", one.word),
    element("span", "", one.cause), element("span", "soft", one.remedy))));
}

function value(row, content) {
  const place = row.querySelector(".value");
  place.classList.toggle("unknown", content === null);
  place.textContent = content === null ? "no reading" : content;
}

function meter(scale, now, lowest, highest) {
  scale.setAttribute("aria-valuemin", lowest);
  scale.setAttribute("aria-valuemax", highest);
  if (now === null) scale.removeAttribute("aria-valuenow");
  else scale.setAttribute("aria-valuenow", now);
}

function fill(scale, from, size) {
  scale.firstChild.hidden = from === null;
  if (from === null) return;
  scale.style.setProperty("--from", percent(from));
  if (size !== null) scale.style.setProperty("--size", percent(size));
}

const share = (now, lowest, highest) =>
  [now, lowest, highest].includes(null) ? null : Math.min(Math.max((now - lowest) / (highest - lowest), 0), 1);
const percent = (part) => `${(100 * part).toFixed(2)}%`;
const shown = (number, digits) => (number === null ? "–" : number.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "−"));

connect();
