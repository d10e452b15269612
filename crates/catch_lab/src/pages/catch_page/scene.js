"use strict";
// The throw in three dimensions. Matrices are 4×4, column by column; poses are (x, y, z, qx, qy, qz, qw).
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);

function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  return Float32Array.from(new Uint16Array(bytes.buffer), (integer) => packed.offset + packed.scale * integer);
}
const motion = {};
for (const [name, packed] of Object.entries(data.motion)) motion[name] = packed === null ? new Float32Array(0) : packed.data === undefined ? packed : unpack(packed);

// A row of a motion's table at a time, between its two neighbours.
function rowAt(name, time) {
  const columns = data.motion[name].columns, table = motion[name], rows = table.length / columns;
  const at = Math.min(Math.max(time / motion.step_s, 0), rows - 1), i = Math.min(Math.floor(at), Math.max(rows - 2, 0));
  return Array.from({ length: columns }, (_, c) => {
    const a = table[i * columns + c], b = table[Math.min(i + 1, rows - 1) * columns + c];
    return a + (b - a) * (at - i);
  });
}
// The last entry of a list that is not later than a time.
function latest(times, time) {
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] <= time + 1e-9) low = middle + 1; else high = middle; }
  return low - 1;
}

// ---- Algebra.
function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++)
    out[c * 4 + r] = a[r] * b[c * 4] + a[4 + r] * b[c * 4 + 1] + a[8 + r] * b[c * 4 + 2] + a[12 + r] * b[c * 4 + 3];
  return out;
}
function poseMatrix([px, py, pz, x, y, z, w]) {
  const n = 2 / (x * x + y * y + z * z + w * w);
  return new Float32Array([
    1 - n * (y * y + z * z), n * (x * y + z * w), n * (x * z - y * w), 0,
    n * (x * y - z * w), 1 - n * (x * x + z * z), n * (y * z + x * w), 0,
    n * (x * z + y * w), n * (y * z - x * w), 1 - n * (x * x + y * y), 0, px, py, pz, 1]);
}
const shift = (x, y, z) => poseMatrix([x, y, z, 0, 0, 0, 1]);
const turn = (axis, angle) => poseMatrix([0, 0, 0, ...axis.map((a) => a * Math.sin(angle / 2)), Math.cos(angle / 2)]);
const moved = (m, [x, y, z]) => [0, 1, 2].map((r) => m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r]);
const minus = (a, b) => a.map((value, i) => value - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const length = Math.hypot(...a) || 1; return a.map((value) => value / length); };

// ---- WebGL.
const canvas = $("view");
const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, stencil: true });
if (!gl) { $("failure").hidden = false; $("failure").textContent = "This browser offers no WebGL 2, so there are only the plots."; }

const SURFACE = [`#version 300 es
  uniform mat4 view, model; in vec3 position, normal; out vec3 n, p;
  void main() { vec4 w = model * vec4(position, 1.0); p = w.xyz; n = mat3(model) * normal; gl_Position = view * w; }`, `#version 300 es
  precision highp float; uniform vec4 colour; uniform vec3 eye, sun; uniform float lit; in vec3 n, p; out vec4 o;
  void main() {
    if (lit == 0.0) { o = colour; return; }
    vec3 N = normalize(n), E = normalize(eye - p); float day = max(dot(N, sun), 0.0);
    float shine = pow(max(dot(N, normalize(sun + E)), 0.0), 42.0), rim = pow(1.0 - max(dot(N, E), 0.0), 3.0);
    o = vec4(colour.rgb * (0.58 + 0.13 * N.z + 0.36 * day) + 0.14 * shine + 0.07 * rim, colour.a); }`];
const FLOOR = [`#version 300 es
  uniform mat4 view; in vec2 position; out vec2 p; void main() { p = position * 9.0; gl_Position = view * vec4(p, 0.0, 1.0); }`, `#version 300 es
  precision highp float; uniform vec3 sky, ground, grid; in vec2 p; out vec4 o;
  float lines(float size) { vec2 g = abs(fract(p / size - 0.5) - 0.5) / fwidth(p / size); return 1.0 - min(min(g.x, g.y) / 1.2, 1.0); }
  void main() {
    float fade = 1.0 - smoothstep(1.5, 6.5, length(p));
    vec3 c = mix(ground, grid, max(lines(1.0) * 0.9, lines(0.25) * 0.35)); o = vec4(mix(sky, c, fade), 1.0); }`];
// Lines are as wide as they should be on every screen: each piece is a rectangle.
const LINE = [`#version 300 es
  precision highp float; uniform mat4 view, model; uniform vec2 size; uniform float wide, nearer; in vec2 corner; in vec3 a, b; out float across;
  void main() { across = corner.y * (wide + 1.5) * 0.5;
    vec4 A = view * model * vec4(a, 1.0), B = view * model * vec4(b, 1.0);
    vec2 d = (B.xy / B.w - A.xy / A.w) * size; d = length(d) > 0.0 ? normalize(d) : vec2(1.0, 0.0);
    vec4 C = mix(A, B, corner.x); C.xy += vec2(-d.y, d.x) * corner.y * (wide + 1.5) / size * C.w;
    C.z -= nearer * C.w; gl_Position = C; }`, `#version 300 es
  precision highp float; uniform vec4 colour; uniform float wide; in float across; out vec4 o;
  void main() { o = vec4(colour.rgb, colour.a * clamp(wide * 0.5 + 0.5 - abs(across), 0.0, 1.0)); }`];
const POINT = [`#version 300 es
  uniform mat4 view; uniform float wide; in vec3 a; void main() { gl_Position = view * vec4(a, 1.0); gl_Position.z -= 0.0006 * gl_Position.w; gl_PointSize = clamp(wide * 3.0 / gl_Position.w, 1.2, 2.0 * wide); }`, `#version 300 es
  precision highp float; uniform vec4 colour; out vec4 o;
  void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; o = colour; }`];

function program([vertex, fragment]) {
  const it = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(it, shader);
  }
  gl.linkProgram(it);
  if (!gl.getProgramParameter(it, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(it));
  const u = {};
  for (let i = gl.getProgramParameter(it, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) {
    const { name } = gl.getActiveUniform(it, i); u[name] = gl.getUniformLocation(it, name);
  }
  return { it, u, attribute: (name) => gl.getAttribLocation(it, name) };
}
function buffer(values, kind = gl.ARRAY_BUFFER) {
  const it = gl.createBuffer();
  gl.bindBuffer(kind, it); gl.bufferData(kind, values, gl.STATIC_DRAW);
  return it;
}
function attribute(location, size, stride, offset, divisor = 0) {
  gl.enableVertexAttribArray(location); gl.vertexAttribPointer(location, size, gl.FLOAT, false, stride, offset);
  gl.vertexAttribDivisor(location, divisor);
}

// A surface's corners with normals that are smooth across faces that meet at less than 40°, and its triangles.
function shaded(surface) {
  const p = unpack(surface.positions), t = unpack(surface.triangles), around = new Map(), normals = [];
  const corner = (k) => [p[t[k] * 3], p[t[k] * 3 + 1], p[t[k] * 3 + 2]];
  for (let f = 0; f < t.length / 3; f++) {
    const a = corner(f * 3);
    normals.push(cross(minus(corner(f * 3 + 1), a), minus(corner(f * 3 + 2), a)));
    for (let k = f * 3; k < f * 3 + 3; k++) { if (!around.has(t[k])) around.set(t[k], []); around.get(t[k]).push(f); }
  }
  // Corners of the same point with nearly the same normal are one.
  const units = normals.map(unit), values = [], known = new Map(), triangles = new Uint32Array(t.length);
  for (let k = 0; k < t.length; k++) {
    const own = units[Math.floor(k / 3)], sum = [0, 0, 0];
    for (const f of around.get(t[k])) if (dot(units[f], own) > 0.77) for (let i = 0; i < 3; i++) sum[i] += normals[f][i];
    const n = unit(sum), key = `${t[k]} ${Math.round(n[0] * 20)} ${Math.round(n[1] * 20)} ${Math.round(n[2] * 20)}`;
    if (!known.has(key)) { known.set(key, values.length / 6); values.push(...corner(k), ...n); }
    triangles[k] = known.get(key);
  }
  return { values: new Float32Array(values), triangles };
}

// The true path needs fewer pieces than the motion has samples.
const PATH_STRIDE = 6;
const scene = gl && (() => {
  const programs = { surface: program(SURFACE), floor: program(FLOOR), line: program(LINE), point: program(POINT) };
  const array = (setUp) => { const it = gl.createVertexArray(); gl.bindVertexArray(it); setUp(); gl.bindVertexArray(null); return it; };
  const surfaces = data.surfaces.map((surface) => {
    const { values, triangles } = shaded(surface);
    return { ...surface, count: triangles.length, vao: array(() => {
      buffer(values); buffer(triangles, gl.ELEMENT_ARRAY_BUFFER);
      attribute(programs.surface.attribute("position"), 3, 24, 0); attribute(programs.surface.attribute("normal"), 3, 24, 12);
    }) };
  });
  const floor = array(() => { buffer(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1])); attribute(programs.floor.attribute("position"), 2, 0, 0); });
  const corners = buffer(new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]));
  // A polyline shares its points between pieces; loose pieces have two each.
  const lines = (values, loose) => ({ buffer: buffer(Float32Array.from(values)), stride: loose ? 24 : 12, vao: array(() => {
    gl.bindBuffer(gl.ARRAY_BUFFER, corners); attribute(programs.line.attribute("corner"), 2, 0, 0);
  }) });
  const { palm_y_m: palm, finger_tip_y_m: tip, finger_thickness_m: thick } = data.robot;
  const half = data.plans.length ? data.plans[0].width_m / 2 + thick / 2 : 0.04;
  const fork = [[-half, tip, 0], [-half, palm, 0], [-half, palm, 0], [half, palm, 0], [half, palm, 0], [half, tip, 0], [0, palm, 0], [0, palm - 0.04, 0]];
  const cameras = data.cameras.flatMap(({ pose, half: [x, y] }) => {
    const m = poseMatrix(pose), d = 0.35, apex = moved(m, [0, 0, 0]);
    const rim = [[-x, -y], [x, -y], [x, y], [-x, y]].map(([u, v]) => moved(m, [u * d, v * d, d]));
    return rim.flatMap((corner, i) => [...apex, ...corner, ...corner, ...rim[(i + 1) % 4]]);
  });
  const points = unpack(data.points.p_W), path = motion.p_WO.filter((_, i) => Math.floor(i / 3) % PATH_STRIDE === 0);
  return { programs, surfaces, floor, lines: {
    truth: lines(path), predicted: lines(unpack(data.predictions.p_WO)), fork: lines(fork.flat(), true), cameras: lines(cameras, true),
  }, cameraPieces: cameras.length / 6, points: array(() => { buffer(points); attribute(programs.point.attribute("a"), 3, 12, 0); }) };
})();

// ---- The arm at a time.
function frames(time) {
  const q = rowAt("q", time), links = [poseMatrix(data.robot.base)];
  data.robot.joints.forEach((joint, i) => links.push(multiply(multiply(links[i], poseMatrix(joint.parent)), turn(joint.axis, q[i]))));
  const hand = multiply(links[links.length - 1], poseMatrix(data.robot.gripper));
  const object = data.motion.p_WO && poseMatrix([...rowAt("p_WO", time), ...rowAt("R_WO", time)]);
  return { links, hand, object, width: rowAt("width_m", time)[0] };
}
function placesOf(surface, { links, hand, object, width }) {
  if (surface.of === "link") return [links[surface.link]];
  if (surface.of === "housing") return [hand];
  if (surface.of === "object") return [object];
  const x = (width + data.robot.finger_thickness_m) / 2;
  return [-x, x].map((side) => multiply(hand, shift(side, data.robot.finger_centre_y_m, 0)));
}

// ---- The camera that looks at it all.
const camera = { azimuth: 0, elevation: 0.3, distance: 3, target: [0, 0, 0.5], chosen: false };
// Beside the flight and a little behind the arm, as near as shows all of both.
function resetCamera() {
  // Without a true path the one that was predicted last.
  const predicted = unpack(data.predictions.p_WO).slice(-3 * data.predictions.points), truth = motion.p_WO;
  const end = Math.round(data.flight_end_s / motion.step_s) * 3, path = truth.length ? truth.slice(0, end + 3) : predicted, points = [];
  for (let i = 0; i + 2 < path.length; i += 30) points.push([...path.slice(i, i + 3)]);
  const base = data.robot.base, [first, last] = points.length ? [points[0], points[points.length - 1]] : [base, base];
  for (const side of [-0.25, 0.25]) points.push([base[0] + side, base[1] + side, base[2]], [base[0] + side, base[1] - side, base[2]]);
  for (const { links, hand } of [0, data.flight_end_s].map(frames)) for (const m of [...links, hand]) points.push(moved(m, [0, 0, 0]));
  camera.azimuth = Math.atan2(first[1] - last[1], first[0] - last[0]) + 2.0; camera.elevation = 0.24; camera.distance = 4; camera.chosen = false;
  camera.target = [0, 1, 2].map((i) => points.reduce((sum, p) => sum + p[i], 0) / points.length);
  for (let round = 0; round < 12; round++) {
    const view = viewMatrix(), seen = points.map(([x, y, z]) => {
      const [u, v, w] = [0, 1, 3].map((r) => view[r] * x + view[4 + r] * y + view[8 + r] * z + view[12 + r]);
      return [u / Math.max(w, 0.2), v / Math.max(w, 0.2)];
    });
    const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((i) => pick(...seen.map((p) => p[i]))));
    pan(-(low[0] + high[0]) / 4 * canvas.clientWidth, (low[1] + high[1]) / 4 * canvas.clientHeight);
    camera.distance = Math.min(Math.max(camera.distance * Math.max((high[0] - low[0]) / 1.7, (high[1] - low[1]) / 1.45), 1), 18);
  }
}
// Moves the camera sideways by so many pixels.
function pan(dx, dy) {
  const step = camera.distance * 0.75 / Math.max(canvas.clientHeight, 1), [s, c] = [Math.sin(camera.azimuth), Math.cos(camera.azimuth)], e = Math.sin(camera.elevation);
  camera.target = camera.target.map((value, i) => value + step * (dx * [s, -c, 0][i] + dy * [-e * c, -e * s, Math.cos(camera.elevation)][i]));
}
function eyeOf({ azimuth, elevation, distance, target }) {
  return [target[0] + distance * Math.cos(elevation) * Math.cos(azimuth), target[1] + distance * Math.cos(elevation) * Math.sin(azimuth), target[2] + distance * Math.sin(elevation)];
}
function viewMatrix() {
  const eye = eyeOf(camera), back = unit(minus(eye, camera.target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  const look = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
  const f = 1 / Math.tan(0.36), near = 0.05, far = 40;
  return multiply([f * canvas.clientHeight / Math.max(canvas.clientWidth, 1), 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0], look);
}

// ---- Drawing.
const layers = { truth: true, predicted: true, plan: true, points: true, grasps: false, cameras: false };
// Pixels drawn per pixel shown, in each direction.
let sharpness = 1;
const rgb = (name) => {
  const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
};
function draw(time, sharp = sharpness) {
  if (!gl) return;
  const scale = Math.min((devicePixelRatio || 1) * sharp, 3);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(Math.round(size * scale), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const view = viewMatrix(), now = frames(time), dark = document.documentElement.dataset.theme === "dark";
  const sky = rgb("--sky"), { programs: { surface, floor, line, point } } = scene, still = shift(0, 0, 0);
  gl.viewport(0, 0, width, height); gl.clearColor(...sky, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);

  gl.useProgram(floor.it); gl.uniformMatrix4fv(floor.u.view, false, view);
  gl.uniform3fv(floor.u.sky, sky); gl.uniform3fv(floor.u.ground, rgb("--floor")); gl.uniform3fv(floor.u.grid, rgb("--grid"));
  gl.depthMask(false); gl.bindVertexArray(scene.floor); gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);

  const sun = unit([0.35, -0.35, 0.87]);
  gl.useProgram(surface.it); gl.uniformMatrix4fv(surface.u.view, false, view);
  gl.uniform3fv(surface.u.eye, eyeOf(camera)); gl.uniform3fv(surface.u.sun, sun);
  const paint = (it, place, colour, lit) => {
    gl.uniformMatrix4fv(surface.u.model, false, place); gl.uniform4fv(surface.u.colour, colour); gl.uniform1f(surface.u.lit, lit);
    gl.bindVertexArray(it.vao); gl.drawElements(gl.TRIANGLES, it.count, gl.UNSIGNED_INT, 0);
  };
  // Shadows: everything flattened onto the floor along the light, each pixel darkened once.
  const flat = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, -sun[0] / sun[2], -sun[1] / sun[2], 0, 0, 0, 0, 0.001, 1]);
  gl.enable(gl.CULL_FACE); gl.enable(gl.BLEND); gl.enable(gl.STENCIL_TEST); gl.disable(gl.DEPTH_TEST);
  gl.stencilFunc(gl.EQUAL, 0, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
  for (const it of scene.surfaces) for (const place of placesOf(it, now)) paint(it, multiply(flat, place), [0, 0, 0, dark ? 0.34 : 0.13], 0);
  gl.disable(gl.STENCIL_TEST); gl.disable(gl.BLEND); gl.enable(gl.DEPTH_TEST); gl.depthMask(true);

  const colours = { link: dark ? [0.80, 0.82, 0.85, 1] : [0.93, 0.93, 0.92, 1], housing: [0.27, 0.30, 0.34, 1], finger: [0.36, 0.39, 0.43, 1], object: [0.98, 0.71, 0.10, 1] };
  for (const it of scene.surfaces) for (const place of placesOf(it, now)) paint(it, place, colours[it.of], 1);

  gl.disable(gl.CULL_FACE); gl.enable(gl.BLEND);
  const stroke = (it, first, pieces, place, colour, wide) => {
    if (pieces <= 0) return;
    gl.useProgram(line.it); gl.bindVertexArray(it.vao); gl.bindBuffer(gl.ARRAY_BUFFER, it.buffer);
    attribute(line.attribute("a"), 3, it.stride, first * 12, 1); attribute(line.attribute("b"), 3, it.stride, first * 12 + 12, 1);
    gl.uniformMatrix4fv(line.u.view, false, view); gl.uniformMatrix4fv(line.u.model, false, place);
    gl.uniform2f(line.u.size, width, height); gl.uniform1f(line.u.wide, wide * scale); gl.uniform1f(line.u.nearer, wide * 0.0002); gl.uniform4fv(line.u.colour, colour);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, pieces);
  };
  const { truth, predicted, fork, cameras } = scene.lines, blue = rgb("--blue"), accent = rgb("--accent"), K = data.predictions.points;
  if (layers.predicted) {
    const last = latest(data.predictions.time_s, time);
    // The older ones thinned out: many draw no clearer picture.
    for (let i = (last + 4) % 4; i <= last; i += 4) stroke(predicted, i * K, K - 1, still, [...blue, i === last ? 1 : 0.14], i === last ? 2.4 : 1.2);
  }
  if (layers.truth) {
    const piece = motion.step_s * PATH_STRIDE, last = Math.ceil(motion.p_WO.length / 3 / PATH_STRIDE) - 1;
    const at = Math.min(Math.round(time / piece), last), end = Math.min(Math.ceil(data.flight_end_s / piece), last);
    stroke(truth, at, end - at, still, [...accent, 0.3], 1.6); stroke(truth, 0, at, still, [...accent, 1], 2.6);
  }
  if (layers.cameras) stroke(cameras, 0, scene.cameraPieces, still, [...rgb("--j5"), 0.8], 1.3);
  if (layers.grasps) {
    const known = data.candidates[latest(data.candidates.map((it) => it.time_s), time)];
    for (const hand of known ? known.hands : []) stroke(fork, 0, 4, poseMatrix(hand), [...rgb("--j2"), 0.75], 1.6);
  }
  if (layers.points) {
    const i = latest(data.points.time_s, time);
    if (i >= 0) {
      gl.useProgram(point.it); gl.bindVertexArray(scene.points); gl.uniformMatrix4fv(point.u.view, false, view);
      gl.uniform1f(point.u.wide, 2 * scale); gl.uniform4fv(point.u.colour, [...rgb("--j6"), 0.9]);
      gl.drawArrays(gl.POINTS, data.points.first[i], data.points.first[i + 1] - data.points.first[i]);
    }
  }
  // Where the hand is meant to be at the catch, until it is there.
  const plan = data.plans[latest(data.plans.map((it) => it.time_s), time)];
  if (layers.plan && plan && time < plan.catch_s) {
    gl.useProgram(surface.it); gl.depthMask(false);
    const meant = { ...now, hand: poseMatrix(plan.hand), width: plan.width_m };
    for (const it of scene.surfaces) if (it.of === "housing" || it.of === "finger")
      for (const place of placesOf(it, meant)) paint(it, place, [...blue, 0.34], 1);
    gl.depthMask(true);
  }
  gl.disable(gl.BLEND);
}
