"use strict";
// What three-dimensional pages share. Matrices are 4×4, column by column; poses are (x, y, z, qx, qy, qz, qw).
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);

function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  return Float32Array.from(new Uint16Array(bytes.buffer), (integer) => packed.offset + packed.scale * integer);
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
if (!gl) $("failure").hidden = false;
// Where one page after another is shown, what a graphics card holds must not wait for the collector.
if (parent !== window) addEventListener("pagehide", () => gl?.getExtension("WEBGL_lose_context")?.loseContext());

const SURFACE = [`#version 300 es
  uniform mat4 view, model; in vec3 position, normal; out vec3 n, p;
  void main() { vec4 w = model * vec4(position, 1.0); p = w.xyz; n = mat3(model) * normal; gl_Position = view * w; }`, `#version 300 es
  precision highp float; uniform vec4 colour; uniform vec3 eye, sun; uniform float lit; in vec3 n, p; out vec4 o;
  // What shades this body from the sun, as the ball that a matrix makes of it.
  uniform mat4 caster; uniform vec3 beam;
  void main() {
    if (lit == 0.0) { o = colour; return; }
    vec3 N = normalize(n), E = normalize(eye - p); float facing = max(dot(N, E), 0.0);
    float shine = pow(max(dot(N, normalize(sun + E)), 0.0), 60.0), floorward = mix(smoothstep(-0.02, 0.3, p.z), 1.0, 0.45 + 0.45 * max(N.z, 0.0));
    vec3 q = (caster * vec4(p, 1.0)).xyz; float along = min(dot(q, beam), 0.0), sunlit = lit > 1.0 ? smoothstep(0.5, 1.4, dot(q, q) - along * along + float(along == 0.0) * 9.0) : 1.0;
    // Light of sky and floor, of the sun, and a little from the camera; then a curve as of film.
    vec3 light = mix(vec3(0.30, 0.29, 0.28), vec3(0.62, 0.65, 0.70), 0.5 + 0.5 * N.z) * floorward + vec3(0.95, 0.90, 0.82) * max(dot(N, sun), 0.0) * sunlit + 0.16 * facing;
    vec3 c = colour.rgb * colour.rgb * light + 0.10 * shine * sunlit;
    float m = max(c.r, max(c.g, c.b)); o = vec4(sqrt(c * (2.2 * m + 0.1) / (m * (2.1 * m + 0.55) + 0.12)), colour.a); }`];
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

// ---- The camera that looks at it all.
const VIEW_RAD = 0.72;
const camera = { azimuth: 0, elevation: 0.3, distance: 3, target: [0, 0, 0.5], chosen: false };
// Moves the camera sideways by so many pixels.
function pan(dx, dy) {
  const step = camera.distance * 0.75 / Math.max(canvas.clientHeight, 1), [s, c] = [Math.sin(camera.azimuth), Math.cos(camera.azimuth)], e = Math.sin(camera.elevation);
  camera.target = camera.target.map((value, i) => value + step * (dx * [s, -c, 0][i] + dy * [-e * c, -e * s, Math.cos(camera.elevation)][i]));
}
function eyeOf({ azimuth, elevation, distance, target }) {
  return [target[0] + distance * Math.cos(elevation) * Math.cos(azimuth), target[1] + distance * Math.cos(elevation) * Math.sin(azimuth), target[2] + distance * Math.sin(elevation)];
}
function viewMatrix(from = camera, aspect = canvas.clientWidth / Math.max(canvas.clientHeight, 1)) {
  const eye = eyeOf(from), back = unit(minus(eye, from.target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  const look = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
  const f = 1 / Math.tan(VIEW_RAD / 2), near = 0.05, far = 40;
  return multiply([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0], look);
}
// Where a point is in a view, from −1 to 1 to the right and upward, and its depth.
function projected(view, [x, y, z]) {
  const [u, v, w] = [0, 1, 3].map((r) => view[r] * x + view[4 + r] * y + view[8 + r] * z + view[12 + r]);
  return [u / Math.max(w, 0.2), v / Math.max(w, 0.2), w];
}

// A colour of the page's style.
const rgb = (name) => {
  const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
};

// One pointer turns, two move and zoom, as does the right button and the wheel.
const pointers = new Map();
function zoom(factor) { camera.distance = Math.min(Math.max(camera.distance * factor, 0.25), 18); }
canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); pointers.set(event.pointerId, [event.clientX, event.clientY]); });
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const after = [event.clientX, event.clientY], [dx, dy] = minus(after, before), others = [...pointers].filter(([id]) => id !== event.pointerId);
  pointers.set(event.pointerId, after); camera.chosen = true;
  if (others.length) {
    const other = others[0][1];
    zoom(Math.hypot(...minus(before, other)) / Math.max(Math.hypot(...minus(after, other)), 1)); pan(dx / 2, dy / 2);
  } else if (event.buttons & 2 || event.shiftKey) pan(dx, dy);
  else { camera.azimuth -= dx * 0.006; camera.elevation = Math.min(Math.max(camera.elevation + dy * 0.006, -0.3), 1.55); }
  refresh();
});
canvas.addEventListener("wheel", (event) => { event.preventDefault(); camera.chosen = true; zoom(Math.exp(event.deltaY * 0.0012)); refresh(); }, { passive: false });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
