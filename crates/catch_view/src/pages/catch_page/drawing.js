// Drawing of the scene and of the close-up in its corner.
const layers = { truth: true, predicted: true, plan: true, points: true, motion: true, contact: true, obstacles: true, capsules: false, grasps: false, cameras: false };
// The joint whose link is tinted.
let tinted = -1;
function tint(joint) { if (joint !== tinted) { tinted = joint; refresh(); } }
// Pixels drawn per pixel shown, in each direction.
let sharpness = 1;
const SUN = unit([0.35, -0.35, 0.87]), STILL = shift(0, 0, 0), OPAQUE_HAND = ["housing", "finger", "object"];
// Opacity of links before hand or object, and of surroundings before the throw.
const VEIL = 0.2, FADED = 0.14;

function draw(time, sharp = sharpness) {
  if (!gl) return;
  const scale = Math.min((devicePixelRatio || 1) * sharp, 3);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(Math.round(size * scale), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const now = frames(time), near = closeUp(now, time);
  if (camera.follows) camera.target = near.target;
  const inset = $("inset"), shows = time >= data.flight_end_s - CLOSE_UP_S && !camera.follows;
  inset.hidden = !shows;
  const views = [{ from: camera, box: [0, 0, canvas.clientWidth, canvas.clientHeight], near: camera.follows, quiet: shows }];
  if (shows) {
    // In the corner that is farther from the hand.
    const [x] = projected(viewMatrix(), moved(frames(data.flight_end_s).hand, [0, 0, 0]));
    $("stage").classList.toggle("swapped", x < 0);
    $("lead").textContent = `${(time - data.flight_end_s) * 1e3 < 0 ? "−" : "+"}${Math.abs((time - data.flight_end_s) * 1e3).toFixed(0)} ms`;
    views.push({ from: near, box: [inset.offsetLeft + 1, inset.offsetTop + 1, inset.clientWidth, inset.clientHeight], near: true });
  }
  clearLabels();
  casters = { object: ballOf("object", now), hand: ballOf("housing", now) };
  gl.enable(gl.SCISSOR_TEST);
  for (const view of views) drawView(view, now, time, scale);
  gl.disable(gl.SCISSOR_TEST);
}

// One view into a box of the canvas: left, top, width and height.
function drawView({ from, box, near, quiet }, now, time, scale) {
  const [left, top, width, height] = box.map((value) => Math.round(value * scale)), bottom = canvas.height - top - height;
  gl.viewport(left, bottom, width, height); gl.scissor(left, bottom, width, height);
  const it = { near, quiet, box, scale, size: [width, height], view: viewMatrix(from, box[2] / Math.max(box[3], 1)), eye: eyeOf(from) };
  const dark = document.documentElement.dataset.theme === "dark", sky = rgb("--sky"), { surface, floor } = scene.programs;
  gl.clearColor(...sky, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.useProgram(floor.it); gl.uniformMatrix4fv(floor.u.view, false, it.view);
  gl.uniform3fv(floor.u.sky, sky); gl.uniform3fv(floor.u.ground, rgb("--floor")); gl.uniform3fv(floor.u.grid, rgb("--grid"));
  gl.depthMask(false); gl.bindVertexArray(scene.floor); gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  gl.useProgram(surface.it); gl.uniformMatrix4fv(surface.u.view, false, it.view);
  gl.uniform3fv(surface.u.eye, it.eye); gl.uniform3fv(surface.u.sun, SUN);
  drawBodies(it, now, time, dark);
  gl.enable(gl.BLEND);
  drawPaths(it, time);
  drawWhy(it, now, time);
  gl.disable(gl.BLEND);
}
// What shades others as a ball around the origin: the matrix that makes it one, and where the sun is then. The object shades the hand,
// and the hand shades all else.
function ballOf(of, now) {
  const parts = scene.surfaces.filter((it) => it.of === of), place = parts.length && placesOf(parts[0], now)[0];
  if (!place) return { matrix: STILL, beam: [0, 0, 0] };
  const [low, high] = ["low", "high"].map((name) => [0, 1, 2].map((c) => Math[name === "low" ? "min" : "max"](...parts.map((it) => it[name][c]))));
  const centre = moved(place, low.map((value, c) => (value + high[c]) / 2)), half = low.map((value, c) => (high[c] - value) / 2);
  const rows = half.map((value, r) => [place[r * 4], place[r * 4 + 1], place[r * 4 + 2]].map((x) => x / value));
  return { matrix: new Float32Array([...[0, 1, 2].flatMap((c) => [rows[0][c], rows[1][c], rows[2][c], 0]), ...rows.map((row) => -dot(row, centre)), 1]), beam: unit(rows.map((row) => dot(row, SUN))) };
}
let casters = {};
function paint(it, place, colour, lit = it.of ? 2 : 1) {
  const { u } = scene.programs.surface;
  gl.uniformMatrix4fv(u.model, false, place); gl.uniform4fv(u.colour, colour); gl.uniform1f(u.lit, lit);
  if (lit > 1) { const by = ["housing", "finger"].includes(it.of) ? casters.object : casters.hand; gl.uniformMatrix4fv(u.caster, false, by.matrix); gl.uniform3fv(u.beam, by.beam); }
  gl.bindVertexArray(it.vao); gl.drawElements(gl.TRIANGLES, it.count, gl.UNSIGNED_INT, 0);
}
// Corners of the boxes around a body, in the world.
function cornersOf(it, now) {
  const { low, high } = it, corner = (k) => low.map((value, c) => (k >> c & 1 ? high[c] : value));
  return placesOf(it, now).flatMap((place) => [0, 1, 2, 3, 4, 5, 6, 7].map((k) => moved(place, corner(k))));
}
const boxOf = (points) => [Math.min, Math.max].map((pick) => [0, 1, 2].map((c) => pick(...points.map((p) => p[c]))));
// Whether a box of a view may cover something of another one; one that is too near may.
function meets([[left, bottom, front], [right, top]], [low, high]) {
  return front < 0.2 || left < high[0] && right > low[0] && bottom < high[1] && top > low[1] && front < high[2];
}
// Arm, hand, object and surroundings. Nothing opaque stands before hand and object: where they are drawn, links before them are a
// veil, and surroundings before the throw are one as a whole. In the close-up all surroundings are.
function drawBodies({ eye, near, view }, now, time, dark) {
  const shown = scene.surfaces.filter((it) => it.of !== "obstacle" || layers.obstacles);
  const points = sightPoints(now, time), faded = shown.filter((it) => it.of === "obstacle" && (near || points.some((p) => crosses(it, eye, p))));
  const solid = shown.filter((it) => !faded.includes(it)), boxes = new Map(solid.map((it) => [it, boxOf(cornersOf(it, now).map((p) => projected(view, p)))]));
  const seen = solid.filter((it) => meets(boxes.get(it), [[-1, -1], [1, 1, Infinity]])), catching = seen.filter((it) => OPAQUE_HAND.includes(it.of)), others = seen.filter((it) => !OPAQUE_HAND.includes(it.of));
  const all = (list, alpha) => { for (const it of list) for (const place of placesOf(it, now)) paint(it, place, [...(tinted >= 0 && it.of === "link" && it.link === tinted + 1 ? rgb(jointColour(tinted)) : it.colour).map((c) => c * (dark && c > 0.6 && it.of !== "object" ? 0.82 : 1)), alpha]); };
  // Shadows: everything flattened onto the floor along the light, each pixel darkened once.
  const flat = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, -SUN[0] / SUN[2], -SUN[1] / SUN[2], 0, 0, 0, 0, 0.001, 1]);
  gl.enable(gl.CULL_FACE); gl.enable(gl.BLEND); gl.enable(gl.STENCIL_TEST); gl.disable(gl.DEPTH_TEST);
  gl.stencilFunc(gl.EQUAL, 0, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
  if (eye[2] > 0) for (const it of solid) for (const place of placesOf(it, now)) paint(it, multiply(flat, place), [0, 0, 0, dark ? 0.34 : 0.13], 0);
  gl.disable(gl.BLEND); gl.enable(gl.DEPTH_TEST); gl.depthMask(true); gl.clear(gl.STENCIL_BUFFER_BIT);

  gl.stencilFunc(gl.ALWAYS, 1, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE); all(catching, 1);
  gl.stencilFunc(gl.NOTEQUAL, 1, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP); all(others, 1);
  gl.stencilFunc(gl.EQUAL, 1, 255); gl.enable(gl.BLEND); gl.depthMask(false);
  const caught = boxOf(catching.flatMap((it) => boxes.get(it)));
  all(others.filter((it) => meets(boxes.get(it), caught)), VEIL);
  gl.disable(gl.STENCIL_TEST); all(faded, FADED);
  if (layers.capsules) for (const { link, it, place } of scene.capsules) paint(it, multiply(now.links[link], place), [...rgb("--blue"), 0.3]);
  gl.depthMask(true); gl.disable(gl.BLEND); gl.disable(gl.CULL_FACE);
}
// What must be seen: hand, object, and the way of the throw.
function sightPoints(now, time) {
  const points = [moved(now.hand, [0, 0, 0]), moved(now.hand, holdAt(time))], path = motion.p_WO;
  if (now.object) points.push(moved(now.object, [0, 0, 0]));
  for (let i = 0; i + 2 < path.length && i / 3 * motion.step_s < data.flight_end_s; i += 90) points.push([...path.slice(i, i + 3)]);
  return points;
}
// Whether the box around a surface is between two points.
function crosses({ low, high }, from, to) {
  let [enter, leave] = [0, 1];
  for (let i = 0; i < 3; i++) {
    const step = to[i] - from[i] || 1e-9, [a, b] = [(low[i] - from[i]) / step, (high[i] - from[i]) / step];
    enter = Math.max(enter, Math.min(a, b)); leave = Math.min(leave, Math.max(a, b));
  }
  return enter < leave && enter < 0.999;
}

function stroke({ view, size: [width, height], scale }, line, [first, pieces], place, colour, wide) {
  if (pieces <= 0) return;
  const { line: { it, u, attribute: at } } = scene.programs;
  gl.useProgram(it); gl.bindVertexArray(line.vao); gl.bindBuffer(gl.ARRAY_BUFFER, line.buffer);
  attribute(at("a"), 3, line.stride, first * 12, 1); attribute(at("b"), 3, line.stride, first * 12 + 12, 1);
  gl.uniformMatrix4fv(u.view, false, view); gl.uniformMatrix4fv(u.model, false, place);
  gl.uniform2f(u.size, width, height); gl.uniform1f(u.wide, wide * scale); gl.uniform1f(u.nearer, wide * 0.0002); gl.uniform4fv(u.colour, colour);
  gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, pieces);
}
// Paths, grasps, cameras and the points of their images.
function drawPaths(it, time) {
  const { truth, predicted, fork, cameras, hand } = scene.lines, blue = rgb("--blue"), accent = rgb("--accent"), K = data.predictions.points;
  const piece = motion.step_s * PATH_STRIDE;
  if (layers.predicted) {
    const last = latest(data.predictions.time_s, Math.min(time, data.flight_end_s));
    // The older ones thinned out: many draw no clearer picture.
    for (let i = it.near ? last : (last + 4) % 4; i <= last; i += 4) if (i >= 0) stroke(it, predicted, [i * K, K - 1], STILL, [...blue, i === last ? 1 : 0.14], i === last ? 2.4 : 1.2);
  }
  if (layers.truth) {
    const last = Math.ceil(motion.p_WO.length / 3 / PATH_STRIDE) - 1;
    const at = Math.min(Math.round(time / piece), last), end = Math.min(Math.ceil(data.flight_end_s / piece), last);
    stroke(it, truth, [at, end - at], STILL, [...accent, 0.3], 1.6); stroke(it, truth, [0, at], STILL, [...accent, 1], 2.6);
  }
  if (layers.contact) stroke(it, hand, [0, Math.min(Math.round(time / piece), handPath.length / 3 - 1)], STILL, [...rgb("--j7"), 0.8], 1.6);
  if (layers.cameras && !it.near) stroke(it, cameras, [0, scene.cameraPieces], STILL, [...rgb("--j5"), 0.8], 1.3);
  if (layers.grasps) {
    const known = data.candidates[latest(data.candidates.map((candidate) => candidate.time_s), time)];
    for (const pose of known ? known.hands : []) stroke(it, fork, [0, 4], poseMatrix(pose), [...rgb("--j2"), 0.75], 1.6);
  }
  const i = latest(data.points.time_s, time), { point } = scene.programs;
  if (layers.points && i >= 0 && !it.near) {
    gl.useProgram(point.it); gl.bindVertexArray(scene.points); gl.uniformMatrix4fv(point.u.view, false, it.view);
    gl.uniform1f(point.u.wide, 1.1 * it.scale); gl.uniform4fv(point.u.colour, [...rgb("--j6"), 0.55]);
    gl.drawArrays(gl.POINTS, data.points.first[i], data.points.first[i + 1] - data.points.first[i]);
  }
}
