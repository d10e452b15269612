// Slider, keys, mouse and touch.
let now = 0, playing = false, whole = false, waiting = false, lastFrame = 0, pace = 16, still = 0, later = 0, told = -2;
const shownUntil = () => (whole ? data.end_s : Math.min(data.flight_end_s + 0.3, data.end_s)) || 1;

function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame((stamp) => {
    waiting = false;
    const since = Math.min(Math.max(stamp - lastFrame, 0), 100);
    lastFrame = stamp;
    if (playing) {
      now += since / 1000 * Number($("speed").value);
      if (now >= shownUntil()) { now = shownUntil(); setPlaying(false); }
      // A slow machine gets a coarser picture instead of a jerky one.
      pace += (since - pace) * 0.1;
      if (pace > 34 && sharpness > 0.65) { sharpness -= 0.1; pace = 16; }
    }
    show();
    if (playing) refresh();
    // What stands still is drawn once more, finer.
    clearTimeout(still);
    if (!playing) still = setTimeout(() => draw(now, Math.max(2 / (devicePixelRatio || 1), 1)), 300);
  });
}
function show() {
  $("time").value = now; $("clock").textContent = `${now.toFixed(3)} s`;
  draw(now);
  for (const { surface, cursor, value, read, left, right } of plots) {
    cursor.style.left = `${left + now / shownUntil() * (surface.clientWidth - left - right)}px`; value.textContent = read(now);
  }
  const current = latest(data.events.map((event) => event.time_s), now);
  if (current !== told) {
    [...$("events").children].forEach((mark, i) => mark.classList.toggle("now", i === current));
    const { label, detail } = data.events[current] || { label: "", detail: "" };
    [$("story").firstChild.textContent, $("story").lastChild.textContent] = [label, detail]; told = current;
  }
  if (!document.body.dataset.firstPictureMs) document.body.dataset.firstPictureMs = Math.round(performance.now());
}
function seek(time) { now = Math.min(Math.max(time, 0), shownUntil()); refresh(); }
function setPlaying(wanted) {
  playing = wanted; $("play").textContent = playing ? "❚❚" : "▶"; $("play").ariaLabel = playing ? "Pause" : "Play";
  if (playing) { if (now >= shownUntil() - 1e-6) now = 0; lastFrame = performance.now(); refresh(); }
}
function setRange(all) {
  whole = all; $("range").textContent = whole ? "show: all" : "show: flight"; $("time").max = shownUntil();
  now = Math.min(now, shownUntil()); layout();
}
function placeEvents() {
  const width = $("events").clientWidth;
  let free = -1;
  // What would cover its neighbour's words is shown as a mark only.
  [...$("events").children].forEach((mark, i) => {
    const { time_s: time, label } = data.events[i], at = time / shownUntil() * width;
    mark.hidden = time > shownUntil() + 1e-6; mark.style.left = `${at}px`;
    mark.classList.toggle("bare", at < free || at + label.length * 6 > width + 30);
    if (!mark.hidden && !mark.classList.contains("bare")) free = at + label.length * 6 + 12;
  });
}
// The scene first: it is what one waits for.
function layout() { placeEvents(); refresh(); clearTimeout(later); later = setTimeout(() => plots.forEach(drawPlot), 20); }
function setTheme(name) { document.documentElement.dataset.theme = name; layout(); }

$("outcome").textContent = { true: "caught", false: "not caught", null: "outcome unknown" }[data.caught];
if (data.caught !== null) $("outcome").classList.add(data.caught ? "good" : "bad");
if (data.scene) {
  const { scenario, seed, index } = data.scene;
  $("scene").textContent = `${data.reason ? `${data.reason} · ` : ""}scenario ${scenario}, seed ${seed}, throw ${index}`;
}
for (const [label, value] of data.facts) {
  const [term, detail] = [document.createElement("dt"), document.createElement("dd")];
  term.textContent = label; detail.textContent = value; $("facts").append(term, detail);
}
for (const { time_s: time, label, detail } of data.events) {
  const mark = document.createElement("li");
  mark.textContent = label; mark.title = `${time.toFixed(3)} s: ${detail}`; mark.onclick = () => seek(time); $("events").append(mark);
}
const LAYERS = [["truth", "true path", "--accent"], ["predicted", "predictions", "--blue"], ["plan", "planned hand", "--blue"],
  ["points", "depth points", "--j6"], ["grasps", "grasp candidates", "--j2"], ["cameras", "cameras", "--j5"]].filter(([name]) => name !== "truth" || data.motion.p_WO);
function toggle(name, on = !layers[name]) { layers[name] = on; $(`layer-${name}`).ariaPressed = on; refresh(); }
LAYERS.forEach(([name, label, colour], i) => {
  const button = document.createElement("button");
  button.id = `layer-${name}`; button.textContent = label; button.title = `key ${i + 1}`; button.ariaPressed = layers[name];
  button.style.setProperty("--mark", `var(${colour})`); button.onclick = () => toggle(name); $("layers").append(button);
});
$("time").oninput = (event) => { setPlaying(false); seek(Number(event.target.value)); };
$("play").onclick = () => setPlaying(!playing);
$("range").onclick = () => setRange(!whole);
$("theme").onclick = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");

const KEYS = {
  " ": () => setPlaying(!playing), Home: () => seek(0), End: () => seek(shownUntil()), r: () => { resetCamera(); refresh(); },
  ArrowLeft: (far) => seek(now - (far ? 0.1 : 0.01)), ArrowRight: (far) => seek(now + (far ? 0.1 : 0.01)),
  z: () => setRange(!whole), "-": () => changeSpeed(-1), "+": () => changeSpeed(1),
};
function changeSpeed(by) { $("speed").selectedIndex = Math.min(Math.max($("speed").selectedIndex + by, 0), $("speed").length - 1); }
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  if (event.key === " " && event.target.tagName === "BUTTON") return;
  const layer = LAYERS[Number(event.key) - 1], action = layer ? () => toggle(layer[0]) : KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (action) { event.preventDefault(); action(event.shiftKey); }
});

addEventListener("resize", () => { if (!camera.chosen) resetCamera(); layout(); });

// The address may say what to show first: #t=0.4&theme=dark&layers=truth,points&play
function readAddress() {
  const wanted = new URLSearchParams(location.hash.slice(1));
  if (wanted.has("layers")) for (const [name] of LAYERS) toggle(name, wanted.get("layers").split(",").includes(name));
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  setTheme(wanted.get("theme") || (dark ? "dark" : "light"));
  setRange(wanted.has("whole"));
  seek(Number(wanted.get("t")) || 0);
  if (wanted.has("play")) setPlaying(true);
}
addEventListener("hashchange", readAddress);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => setTheme(event.matches ? "dark" : "light"));
resetCamera();
readAddress();
