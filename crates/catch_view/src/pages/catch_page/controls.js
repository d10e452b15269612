// Slider, keys, mouse and touch.
let now = 0, playing = false, whole = false, waiting = false, lastFrame = 0, pace = 16, still = 0, later = 0, told = -2, rest = 0;
const shownUntil = () => (whole ? data.end_s : Math.min(data.flight_end_s + 0.3, data.end_s)) || 1;

// Speed of the playback over that of the throw: by itself it slows down around the contact.
function speedAt(time) {
  const chosen = $("speed").value, away = Math.min(Math.max((Math.abs(time - data.flight_end_s) - 0.03) / 0.2, 0), 1);
  return chosen === "eased" ? 0.03 + 0.27 * away * away * (3 - 2 * away) : Number(chosen);
}
function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame((stamp) => {
    waiting = false;
    const since = Math.min(Math.max(stamp - lastFrame, 0), 100);
    lastFrame = stamp;
    if (playing) {
      now += since / 1000 * speedAt(now);
      // In the end it rests for a second, and begins anew.
      if (now >= shownUntil()) {
        now = shownUntil(); rest += since;
        if (rest > 1000) { now = 0; rest = 0; }
      }
      // A slow machine gets a coarser picture instead of a jerky one.
      pace += (since - pace) * 0.1;
      if (pace > 34 && sharpness > 0.65) { sharpness -= 0.1; pace = 16; }
    }
    show();
    if (playing) refresh();
    // What stands still is drawn once more, finer.
    clearTimeout(still);
    if (!playing) still = setTimeout(() => { draw(now, Math.max(2 / (devicePixelRatio || 1), 1)); writeAddress(); }, 300);
  });
}
// A throw beside another one tells its time, and follows the other's.
let shared = 0;
addEventListener("message", ({ source, data: told }) => {
  if (source !== parent || !Number.isFinite(told?.time_s)) return;
  setPlaying(false); seek(told.time_s); shared = now;
});
function show() {
  if (parent !== window && now !== shared) parent.postMessage({ time_s: shared = now }, "*");
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
  if (playing) { rest = 0; if (now >= shownUntil() - 1e-6) now = 0; lastFrame = performance.now(); refresh(); }
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
  const mark = document.createElement("li"), go = () => { setPlaying(false); seek(time); };
  mark.textContent = label; mark.title = `${time.toFixed(3)} s: ${detail}`; mark.role = "button"; mark.tabIndex = 0; mark.onclick = go;
  mark.onkeydown = (event) => { if (event.key === "Enter") go(); };
  $("events").append(mark);
}
const LAYERS = [["truth", "true path", "--accent"], ["predicted", "predictions", "--blue"], ["plan", "planned hand", "--blue"],
  ["motion", "velocity, spin", "--j2"], ["contact", "contacts, miss", "--bad"], ["points", "depth points", "--j6"],
  ["obstacles", "surroundings", "--faint"], ["capsules", "capsules", "--blue"], ["grasps", "grasp candidates", "--j2"], ["cameras", "cameras", "--j5"]]
  .filter(([name]) => (name !== "truth" && name !== "motion" || data.motion.p_WO) && (name !== "obstacles" || data.surfaces.some((it) => it.of === "obstacle")));
function toggle(name, on = !layers[name]) { layers[name] = on; $(`layer-${name}`).ariaPressed = on; refresh(); }
LAYERS.forEach(([name, label, colour], i) => {
  const button = document.createElement("button");
  button.id = `layer-${name}`; button.textContent = label; button.title = `key ${i + 1}`; button.ariaPressed = layers[name];
  button.style.setProperty("--mark", `var(${colour})`); button.onclick = () => toggle(name); $("layers").append(button);
});
// The way through a report, and what can be kept.
for (const [name, text, key] of [["report", "report", "B"], ["previous", "previous miss", "["], ["next", "next miss", "]"], ["caught", "caught neighbour", "V"], ["missed", "the miss", "V"]]) if (data.links?.[name]) {
  const link = document.createElement("a");
  link.href = data.links[name]; link.textContent = text; link.title = `key ${key}`; link.accessKey = key; $("nav").append(link);
}
const go = (...names) => { const to = names.map((name) => data.links?.[name]).find(Boolean); if (to) location.href = to; };
function keep(extension, url) {
  const link = document.createElement("a");
  link.href = url; link.download = `${$("title").textContent} ${now.toFixed(3)} s.${extension}`; link.click(); setTimeout(() => URL.revokeObjectURL(url), 1000);
}
const KEEP = {
  png: () => { draw(now, 2); canvas.toBlob((blob) => keep("png", URL.createObjectURL(blob))); },
  json: () => keep("json", URL.createObjectURL(new Blob([$("data").textContent], { type: "application/json" }))),
};
for (const kind of ["png", "json"]) $(`keep-${kind}`).onclick = KEEP[kind];
$("time").oninput = (event) => { setPlaying(false); seek(Number(event.target.value)); };
$("play").onclick = () => setPlaying(!playing);
$("help").onclick = () => toggleKeys();
$("inset").onclick = () => follow(true);
canvas.addEventListener("dblclick", () => follow());
$("range").onclick = () => setRange(!whole);
let theme = null;
$("theme").onclick = () => { theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark"; setTheme(theme); };

const KEYS = {
  " ": () => setPlaying(!playing), Home: () => seek(0), End: () => seek(shownUntil()), r: () => { resetCamera(); refresh(); }, c: () => follow(),
  "?": () => toggleKeys(), Escape: () => toggleKeys(false),
  ArrowLeft: (far) => seek(now - (far ? 0.1 : 0.01)), ArrowRight: (far) => seek(now + (far ? 0.1 : 0.01)),
  b: () => go("report"), "[": () => go("previous"), "]": () => go("next"), v: () => go("caught", "missed"), s: KEEP.png, j: KEEP.json,
  n: () => seekMark(1), p: () => seekMark(-1), z: () => setRange(!whole), "-": () => changeSpeed(-1), "+": () => changeSpeed(1),
};
// The next mark of the story, or the one before.
function seekMark(by) {
  const times = data.events.map((event) => event.time_s), wanted = by > 0 ? times.find((time) => time > now + 1e-3) : times.findLast((time) => time < now - 1e-3);
  setPlaying(false); seek(wanted ?? (by > 0 ? shownUntil() : 0));
}
function toggleKeys(on = $("keys").hidden) { $("keys").hidden = !on; $("help").ariaExpanded = on; }
function changeSpeed(by) { $("speed").selectedIndex = Math.min(Math.max($("speed").selectedIndex + by, 0), $("speed").length - 1); }
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  if (event.key === " " && event.target.tagName === "BUTTON") return;
  const layer = LAYERS[Number(event.key) - 1], action = layer ? () => toggle(layer[0]) : KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (action) { event.preventDefault(); action(event.shiftKey); }
});

addEventListener("resize", () => { if (!camera.chosen) resetCamera(); layout(); });

// The address holds what is shown: #t=0.4&camera=0.9,0.3,3,0,0,0.5&layers=truth,points&theme=dark, and `play`, `whole`, `follow`.
let address = "";
function readAddress() {
  if (location.hash.slice(1) === address && address) return;
  const wanted = new URLSearchParams(location.hash.slice(1)), numbers = (wanted.get("camera") || "").split(",").map(Number);
  if (wanted.has("layers")) for (const [name] of LAYERS) toggle(name, wanted.get("layers").split(",").includes(name));
  if (wanted.has("follow")) follow(true);
  if (numbers.length === 6 && numbers.every(Number.isFinite)) {
    const [azimuth, elevation, distance, ...target] = numbers;
    Object.assign(camera, { azimuth, elevation, distance, target, chosen: true });
  }
  theme = wanted.get("theme");
  setTheme(theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  setRange(wanted.has("whole") || data.shows_all);
  seek(Number(wanted.get("t")) || 0);
  // It plays on its own, but for those who asked for a time or for stillness.
  if (window.name !== "second") setPlaying(wanted.has("play") || !wanted.has("t") && !matchMedia("(prefers-reduced-motion: reduce)").matches);
}
function writeAddress() {
  const { azimuth, elevation, distance, target, chosen, follows } = camera, wanted = { t: now.toFixed(3) };
  if (chosen) wanted.camera = [azimuth, elevation, distance, ...target].map((value) => value.toFixed(3)).join(",");
  wanted.layers = LAYERS.map(([name]) => name).filter((name) => layers[name]).join(",");
  if (theme) wanted.theme = theme;
  const text = Object.entries(wanted).map(([name, value]) => `${name}=${value}`).join("&") + (whole ? "&whole" : "") + (follows ? "&follow" : "");
  if (text !== address && window === parent) history.replaceState(null, "", `#${address = text}`);
}
addEventListener("hashchange", readAddress);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => { if (!theme) setTheme(event.matches ? "dark" : "light"); });
resetCamera();
readAddress();
