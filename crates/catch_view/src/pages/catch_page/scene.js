// The throw in three dimensions: what is in it, and where it is at a time.
const motion = {};
for (const [name, packed] of Object.entries(data.motion)) motion[name] = packed === null ? new Float32Array(0) : packed.data === undefined ? packed : unpack(packed);
const predictedPaths = unpack(data.predictions.p_WO), halfAxes = unpack(data.predictions.half_axes_m);

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
const planTimes = data.plans.map((it) => it.time_s), planAt = (time) => data.plans[latest(planTimes, time)];

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
  if (surface.of === "object") return object ? [object] : [];
  if (surface.of === "obstacle") return [shift(0, 0, 0)];
  const x = (width + data.robot.finger_thickness_m) / 2;
  const right = multiply(hand, shift(x, data.robot.finger_centre_y_m, 0)), left = multiply(hand, shift(-x, data.robot.finger_centre_y_m, 0));
  return [multiply(left, turn([0, 1, 0], Math.PI)), right];
}
// Where the hand holds, in its frame: as it last planned, else between the fingers.
const holdAt = (time) => planAt(time)?.held || [0, (data.robot.finger_centre_y_m + data.robot.finger_tip_y_m) / 2, 0];

// The true path and the hand's need fewer pieces than the motion has samples.
const PATH_STRIDE = 6;
const handPath = [];
for (let i = 0; i * motion.step_s <= data.end_s; i += PATH_STRIDE) {
  const time = i * motion.step_s;
  handPath.push(...moved(frames(time).hand, holdAt(data.flight_end_s)));
}
const scene = gl && (() => {
  const programs = { surface: program(SURFACE), floor: program(FLOOR), line: program(LINE), point: program(POINT) };
  const array = (setUp) => { const it = gl.createVertexArray(); gl.bindVertexArray(it); setUp(); gl.bindVertexArray(null); return it; };
  const drawn = ({ values, triangles }) => ({ count: triangles.length, vao: array(() => {
    buffer(values); buffer(triangles, gl.ELEMENT_ARRAY_BUFFER);
    attribute(programs.surface.attribute("position"), 3, 24, 0); attribute(programs.surface.attribute("normal"), 3, 24, 12);
  }) });
  const surfaces = data.surfaces.map((surface) => {
    const it = shaded(surface), corners = [0, 1, 2].map((c) => it.values.filter((_, i) => i % 6 === c));
    const [low, high] = [Math.min, Math.max].map((pick) => corners.map((values) => values.reduce((a, b) => pick(a, b))));
    return { ...surface, low, high, ...drawn(it) };
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
  // What the arm may touch with: a half ball at each end of a segment.
  const capsules = data.robot.capsules.map(({ link, from, to, radius }) => {
    const way = minus(to, from), long = Math.hypot(...way), curve = (s) => [radius * Math.sin(Math.PI * s), (s < 0.5 ? 0 : long) - radius * Math.cos(Math.PI * s)];
    return { link, place: along(from, unit(long ? way : [0, 0, 1]), 1), it: drawn(revolved(13, 24, curve)) };
  });
  return { programs, surfaces, capsules, floor, ball: drawn(revolved(8, 24, (s) => [Math.sin(Math.PI * s), -Math.cos(Math.PI * s)])),
    cone: drawn(revolved(1, 20, (s) => [1 - s, s])), rod: drawn(revolved(1, 14, (s) => [1, s])), lines: {
      truth: lines(path), hand: lines(handPath), predicted: lines(predictedPaths), fork: lines(fork.flat(), true), cameras: lines(cameras, true),
      free: { ...lines([]), stride: 12 },
    }, cameraPieces: cameras.length / 6, points: array(() => { buffer(points); attribute(programs.point.attribute("a"), 3, 12, 0); }) };
})();

// A surface around z from the curve (radius, height) of s from 0 to 1.
function revolved(rows, columns, curve) {
  const values = [], triangles = [];
  for (let i = 0; i <= rows; i++) for (let j = 0; j < columns; j++) {
    const [r, z] = curve(i / rows), [r0, z0] = curve((i - 0.5) / rows), [r1, z1] = curve((i + 0.5) / rows), a = 2 * Math.PI * j / columns;
    values.push(r * Math.cos(a), r * Math.sin(a), z, (z1 - z0) * Math.cos(a), (z1 - z0) * Math.sin(a), r0 - r1);
    const [b, c] = [i * columns + j, i * columns + (j + 1) % columns];
    if (i < rows) triangles.push(b, c, c + columns, b, c + columns, b + columns);
  }
  return { values: new Float32Array(values), triangles: new Uint32Array(triangles) };
}

// ---- Cameras.
// The view of the ring around the throw that sees most of the catch, as near as shows arm and flight.
function resetCamera() {
  // Without a true path the one that was predicted last.
  const predicted = predictedPaths.slice(-3 * data.predictions.points), truth = motion.p_WO;
  const end = Math.round(data.flight_end_s / motion.step_s) * 3, path = truth.length ? truth.slice(0, end + 3) : predicted, points = [];
  for (let i = 0; i + 2 < path.length; i += 30) points.push([...path.slice(i, i + 3)]);
  const base = data.robot.base;
  for (const side of [-0.25, 0.25]) points.push([base[0] + side, base[1] + side, base[2]], [base[0] + side, base[1] - side, base[2]]);
  for (const { links, hand } of [0, data.flight_end_s].map(frames)) for (const m of [...links, hand]) points.push(moved(m, [0, 0, 0]));
  const { azimuth, elevation } = data.scene_view || { azimuth: 0.6, elevation: 0.3 };
  Object.assign(camera, { azimuth, elevation, distance: 4, chosen: false, follows: false });
  camera.target = [0, 1, 2].map((i) => points.reduce((sum, p) => sum + p[i], 0) / points.length);
  for (let round = 0; round < 12; round++) {
    const view = viewMatrix(), seen = points.map((p) => projected(view, p));
    const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((i) => pick(...seen.map((p) => p[i]))));
    pan(-(low[0] + high[0]) / 4 * canvas.clientWidth, (low[1] + high[1]) / 4 * canvas.clientHeight);
    camera.distance = Math.min(Math.max(camera.distance * Math.max((high[0] - low[0]) / 1.7, (high[1] - low[1]) / 1.45), 1), 18);
  }
}
// A camera that follows hand and object: the farther they are apart, the more it shows.
const CLOSE_UP_S = 0.15;
function closeUp(now, time) {
  const { azimuth, elevation, radius_m: radius } = data.close_up_view || { azimuth: 0.6, elevation: 0.3, radius_m: 0.15 };
  const hand = moved(now.hand, holdAt(time)), away = now.object ? minus(moved(now.object, [0, 0, 0]), hand) : [0, 0, 0];
  const gap = Math.min(Math.hypot(...away) / 2, 4 * radius), target = hand.map((value, i) => value + unit(away)[i] * gap);
  return { azimuth, elevation, target, distance: (radius + gap) / Math.tan(VIEW_RAD / 2) };
}
function follow(on = !camera.follows) {
  if (!on) resetCamera();
  else {
    const { azimuth, elevation, distance } = closeUp(frames(data.flight_end_s), data.flight_end_s);
    Object.assign(camera, { azimuth, elevation, distance: distance * 1.25, chosen: true, follows: true });
  }
  refresh();
}
