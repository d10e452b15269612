// An arm with the shapes of its links and the capsules around them; one slider for each joint.
const q = [...data.ready_rad], layers = { mesh: true, capsule: true };
let waiting = false;
const scene = gl && (() => {
  const programs = { surface: program(SURFACE), floor: program(FLOOR) };
  const array = (setUp) => { const it = gl.createVertexArray(); gl.bindVertexArray(it); setUp(); gl.bindVertexArray(null); return it; };
  const surfaces = data.surfaces.map((surface) => {
    const { values, triangles } = shaded(surface);
    return { ...surface, count: triangles.length, vao: array(() => {
      buffer(values); buffer(triangles, gl.ELEMENT_ARRAY_BUFFER);
      attribute(programs.surface.attribute("position"), 3, 24, 0); attribute(programs.surface.attribute("normal"), 3, 24, 12);
    }) };
  });
  const floor = array(() => { buffer(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1])); attribute(programs.floor.attribute("position"), 2, 0, 0); });
  return { programs, surfaces, floor };
})();

function links() {
  const poses = [poseMatrix(data.base)];
  data.joints.forEach((joint, i) => poses.push(multiply(multiply(poses[i], poseMatrix(joint.parent)), turn(joint.axis, q[i]))));
  return [...poses, multiply(poses[poses.length - 1], poseMatrix(data.gripper))];
}
function resetCamera() {
  const points = links().map((pose) => moved(pose, [0, 0, 0]));
  const [low, high] = [Math.min, Math.max].map((pick) => [0, 1, 2].map((i) => pick(...points.map((p) => p[i]))));
  camera.target = low.map((value, i) => (value + high[i]) / 2);
  camera.azimuth = 0.9; camera.elevation = 0.3; camera.distance = 1.2 + 1.6 * Math.hypot(...minus(high, low)); camera.chosen = false;
}
function draw() {
  if (!gl) return;
  const scale = Math.min(Math.max(devicePixelRatio || 1, 2), 3);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(Math.round(size * scale), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const view = viewMatrix(), poses = links(), sky = rgb("--sky"), { programs: { surface, floor } } = scene;
  gl.viewport(0, 0, width, height); gl.clearColor(...sky, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.useProgram(floor.it); gl.uniformMatrix4fv(floor.u.view, false, view);
  gl.uniform3fv(floor.u.sky, sky); gl.uniform3fv(floor.u.ground, rgb("--floor")); gl.uniform3fv(floor.u.grid, rgb("--grid"));
  gl.depthMask(false); gl.bindVertexArray(scene.floor); gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4); gl.depthMask(true);
  gl.useProgram(surface.it); gl.uniformMatrix4fv(surface.u.view, false, view);
  gl.uniform3fv(surface.u.eye, eyeOf(camera)); gl.uniform3fv(surface.u.sun, unit([0.35, -0.35, 0.87])); gl.uniform1f(surface.u.lit, 1);
  const paint = (kind, colour) => {
    for (const it of scene.surfaces) if (it.of === kind && layers[kind]) {
      gl.uniformMatrix4fv(surface.u.model, false, poses[it.link]); gl.uniform4fv(surface.u.colour, colour);
      gl.bindVertexArray(it.vao); gl.drawElements(gl.TRIANGLES, it.count, gl.UNSIGNED_INT, 0);
    }
  };
  paint("mesh", [0.86, 0.87, 0.88, 1]);
  // What is seen through is drawn last, its nearer side only.
  gl.enable(gl.BLEND); gl.enable(gl.CULL_FACE); gl.depthMask(false);
  paint("capsule", [...rgb("--blue"), layers.mesh ? 0.3 : 0.85]);
  gl.depthMask(true); gl.disable(gl.CULL_FACE); gl.disable(gl.BLEND);
}
function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; draw(); document.body.dataset.firstPictureMs ||= Math.round(performance.now()); });
}
function setTheme(name) { document.documentElement.dataset.theme = name; refresh(); }

$("outcome").textContent = data.coverage;
$("outcome").classList.add(data.is_covered ? "good" : "bad");
for (const [name, label, colour] of [["mesh", "shapes", "--faint"], ["capsule", "capsules", "--blue"]]) {
  const button = document.createElement("button");
  button.id = `layer-${name}`; button.textContent = label; button.ariaPressed = true; button.style.setProperty("--mark", `var(${colour})`);
  button.onclick = () => { layers[name] = !layers[name]; button.ariaPressed = layers[name]; refresh(); };
  $("layers").append(button);
}
data.joints.forEach((joint, i) => {
  const [label, slider, value] = ["label", "input", "output"].map((kind) => document.createElement(kind));
  Object.assign(slider, { type: "range", min: joint.lower, max: joint.upper, step: 0.001, value: q[i], ariaLabel: joint.name });
  const say = () => { value.textContent = `${q[i].toFixed(2)} rad`; };
  slider.oninput = () => { q[i] = Number(slider.value); say(); refresh(); };
  label.className = "joint"; label.append(joint.name, slider, value); $("plots").append(label); say();
});
addEventListener("keydown", (event) => { if (event.key.toLowerCase() === "r") { resetCamera(); refresh(); } });
addEventListener("resize", () => { if (!camera.chosen) resetCamera(); refresh(); });
$("theme").onclick = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
const wanted = new URLSearchParams(location.hash.slice(1));
resetCamera();
setTheme(wanted.get("theme") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
