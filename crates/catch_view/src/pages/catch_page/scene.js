// The throw in three dimensions.
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
  if (surface.of === "obstacle") return [shift(0, 0, 0)];
  const x = (width + data.robot.finger_thickness_m) / 2;
  const right = multiply(hand, shift(x, data.robot.finger_centre_y_m, 0)), left = multiply(hand, shift(-x, data.robot.finger_centre_y_m, 0));
  return [multiply(left, turn([0, 1, 0], Math.PI)), right];
}

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
// ---- Drawing.
const layers = { truth: true, predicted: true, plan: true, points: true, grasps: false, cameras: false };
// Pixels drawn per pixel shown, in each direction.
let sharpness = 1;
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

  const colours = { link: dark ? [0.80, 0.82, 0.85, 1] : [0.93, 0.93, 0.92, 1], housing: [0.27, 0.30, 0.34, 1], finger: [0.36, 0.39, 0.43, 1], object: [0.98, 0.71, 0.10, 1], obstacle: dark ? [0.42, 0.47, 0.54, 1] : [0.72, 0.76, 0.81, 1] };
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
