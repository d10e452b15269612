// What explains a catch or a miss: arrows of motion, the uncertainty of the prediction, contacts, the distance at the catch.
let labelled = [];
function clearLabels() { $("labels").replaceChildren(); labelled = []; }
// Text beside a point of a view, below what stands there already; none beside a close-up that has the same.
function label({ view, quiet, box: [left, top, width, height] }, point, text, colour) {
  const [u, v, w] = projected(view, point), x = left + (u + 1) / 2 * width;
  if (quiet || w < 0 || Math.abs(u) > 0.95 || Math.abs(v) > 0.95) return;
  let y = top + (1 - v) / 2 * height;
  for (const [a, b, long] of labelled.toSorted((p, q) => p[1] - q[1])) if (Math.abs(b - y) < 19 && x < a + long && a < x + text.length * 7 + 14) y = b + 19;
  labelled.push([x, y, text.length * 7 + 14]);
  const it = document.createElement("span");
  it.textContent = text; it.style.setProperty("--mark", `var(${colour})`); it.style.left = `${x}px`; it.style.top = `${y}px`;
  $("labels").append(it);
}
// A frame whose z axis goes along a vector: unit x and y scaled by `across`.
function along(from, [x, y, z], across) {
  const w = unit([x, y, z]), u = unit(cross(Math.abs(w[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], w)), v = cross(w, u);
  return new Float32Array([...u.map((it) => it * across), 0, ...v.map((it) => it * across), 0, x, y, z, 0, ...from, 1]);
}
function arrow(it, from, vector, colour, radius) {
  const length = Math.hypot(...vector), head = Math.min(radius * 6, length), way = unit(vector), tip = way.map((value) => value * head);
  paint(scene.rod, along(from, way.map((value) => value * (length - head)), radius), colour, 0);
  paint(scene.cone, along(from.map((value, i) => value + way[i] * (length - head)), tip, radius * 2.6), colour, 0);
}
function polyline(it, points, colour, wide) {
  gl.bindBuffer(gl.ARRAY_BUFFER, scene.lines.free.buffer); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points.flat()), gl.DYNAMIC_DRAW);
  stroke(it, scene.lines.free, [0, points.length - 1], STILL, colour, wide); useSurface(it);
}
function useSurface({ view }) { gl.useProgram(scene.programs.surface.it); gl.uniformMatrix4fv(scene.programs.surface.u.view, false, view); }

// Velocity and angular velocity of the object, by differences.
function velocities(time) {
  const h = Math.max(2 * motion.step_s, 0.004), [before, after] = [Math.max(time - h, 0), Math.min(time + h, data.end_s)], span = after - before || 1;
  const v = minus(rowAt("p_WO", after), rowAt("p_WO", before)).map((value) => value / span);
  const [a, b] = [rowAt("R_WO", before), rowAt("R_WO", after)], sign = a.reduce((sum, value, i) => sum + value * b[i], 0) < 0 ? -1 : 1;
  // The vector part of b·a⁻¹ is half the rotation vector.
  const [p, q] = [a.slice(0, 3), b.slice(0, 3)], turned = cross(p, q).map((value, i) => sign * (a[3] * q[i] - b[3] * p[i] + value));
  return { v, w: turned.map((value) => 2 * value / span) };
}
function drawMotion(it, now, time) {
  const centre = moved(now.object, [0, 0, 0]), { v, w } = velocities(time), [speed, spin] = [Math.hypot(...v), Math.hypot(...w)];
  const size = it.near ? 0.0022 : 0.006, radius = Math.max(...objectSize) / 2 * 1.25;
  if (speed > 0.3) {
    const end = centre.map((value, i) => value + v[i] * (it.near ? 0.012 : 0.05));
    arrow(it, centre, minus(end, centre), [...rgb("--j2"), 1], size);
    label(it, end, `${speed.toFixed(1)} m/s`, "--j2");
  }
  if (spin < 2) return;
  // An arc about the axis, as long as the turn within 30 ms.
  const frame = along(centre, unit(w), 1), angle = Math.min(spin * 0.03, 5), arc = [];
  for (let k = 0; k <= 24; k++) arc.push(moved(frame, [radius * Math.cos(angle * k / 24), radius * Math.sin(angle * k / 24), 0]));
  const violet = [...rgb("--j3"), 1], end = arc[24], back = minus(end, arc[22]);
  polyline(it, arc, violet, 2.4);
  paint(scene.cone, along(end, unit(back).map((value) => value * size * 5), size * 2.4), violet, 0);
  label(it, arc[12], `${spin.toFixed(0)} rad/s`, "--j3");
}
const objectSize = (() => {
  const parts = (scene ? scene.surfaces : []).filter((it) => it.of === "object");
  return parts.length ? [0, 1, 2].map((i) => Math.max(...parts.map(({ high }) => high[i])) - Math.min(...parts.map(({ low }) => low[i]))) : [0.06, 0.06, 0.06];
})();

// The ellipsoid of three standard deviations around the predicted place of the catch.
function drawUncertainty(it, time) {
  const i = latest(data.predictions.time_s, time), K = data.predictions.points;
  if (i < 0 || time > data.flight_end_s) return;
  const axes = [0, 3, 6].map((at) => [...halfAxes.slice(i * 9 + at, i * 9 + at + 3)]), centre = [...predictedPaths.slice((i + 1) * K * 3 - 3, (i + 1) * K * 3)];
  const largest = Math.max(...axes.map((axis) => Math.hypot(...axis)));
  gl.disable(gl.DEPTH_TEST); gl.enable(gl.CULL_FACE);
  paint(scene.ball, new Float32Array([...axes[0], 0, ...axes[1], 0, ...axes[2], 0, ...centre, 1]), [...rgb("--blue"), 0.35]);
  gl.disable(gl.CULL_FACE); gl.enable(gl.DEPTH_TEST);
  label(it, centre, `3σ ±${millimetres(largest * 1e3)}`, "--blue");
}
const millimetres = (mm) => `${mm < 9.95 ? mm.toFixed(1) : mm.toFixed(0)} mm`;

// From where the hand holds to the object's centre, around the catch.
function drawDistance(it, now, time) {
  const lead = time - data.flight_end_s;
  if (lead < -0.04 || lead > 0.25) return;
  // In the end the distance at the catch stays, where it was.
  const fixed = lead > 0 ? frames(data.flight_end_s) : now, hand = moved(fixed.hand, holdAt(data.flight_end_s)), object = moved(fixed.object, [0, 0, 0]);
  const red = [...rgb("--bad"), 1], mm = Math.hypot(...minus(object, hand)) * 1e3;
  gl.disable(gl.DEPTH_TEST);
  polyline(it, [hand, object], red, 2.6);
  for (const end of [hand, object]) paint(scene.ball, ballAt(end, it.near ? 0.0022 : 0.006), red, 0);
  gl.enable(gl.DEPTH_TEST);
  label(it, hand.map((value, i) => (value + object[i]) / 2), lead < 0 ? millimetres(mm) : `off by ${millimetres(mm)}`, "--bad");
}
const ballAt = ([x, y, z], r) => new Float32Array([r, 0, 0, 0, 0, r, 0, 0, 0, 0, r, 0, x, y, z, 1]);

// Where fingers and palm were touched until now, the last one with its impulse.
function drawContacts(it, now, time) {
  const until = latest(data.contacts.map((contact) => contact.time_s), time);
  gl.disable(gl.DEPTH_TEST);
  for (let i = Math.max(until - 5, 0); i <= until; i++) {
    const { time_s: since, part, p_G: p, impulse_ns: impulse } = data.contacts[i], place = moved(now.hand, p), age = time - since;
    paint(scene.ball, ballAt(place, (it.near ? 0.004 : 0.008) * (age < 0.02 ? 1.5 : 1)), [...rgb("--j6"), 1], 0);
    if (i === until && age < 0.06) label(it, place, `${part} ${(impulse * 1e3).toFixed(0)} mN·s`, "--j6");
  }
  gl.enable(gl.DEPTH_TEST);
}
function drawWhy(it, now, time) {
  useSurface(it);
  if (layers.motion && now.object) drawMotion(it, now, time);
  if (layers.contact && now.object) { drawDistance(it, now, time); drawContacts(it, now, time); }
  if (layers.predicted) drawUncertainty(it, time);
  // Where the hand is meant to be at the catch, until it is there.
  const plan = planAt(time);
  if (!layers.plan || !plan || time >= plan.catch_s || it.near) return;
  gl.depthMask(false);
  const meant = { ...now, hand: poseMatrix(plan.hand), width: plan.width_m };
  for (const surface of scene.surfaces) if (surface.of === "housing" || surface.of === "finger")
    for (const place of placesOf(surface, meant)) paint(surface, place, [...rgb("--blue"), 0.3]);
  gl.depthMask(true);
}
