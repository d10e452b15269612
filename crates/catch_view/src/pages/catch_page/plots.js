// The plots beside the scene. Each is drawn once; the slider only moves a line across them.
const plots = [];
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const evenly = (count) => Float32Array.from({ length: count }, (_, i) => i * motion.step_s);
const column = (table, columns, c) => table.filter((_, i) => i % columns === c);
const percent = (ratio) => `${Math.round(ratio * 100)} %`.replace("-", "−");

function legend(entries) {
  const it = document.createElement("div");
  it.className = "legend";
  for (const [label, colour] of entries) {
    const span = document.createElement("span");
    span.textContent = label; span.style.setProperty("--mark", `var(${colour})`); it.append(span);
  }
  return it;
}
// A plot of series {time, values, colour, dots?, dashed?} with lines across it at `marks`; `read` says what stands under the slider.
function plot({ title, unit, low, high, log, marks = [], ticks, series, read, labels, hover }) {
  const box = document.createElement("div"), head = document.createElement("header"), name = document.createElement("h2");
  const about = document.createElement("span"), value = document.createElement("span"), surface = document.createElement("canvas"), cursor = document.createElement("div");
  box.className = "plot"; about.className = "faint"; cursor.className = "cursor";
  name.textContent = title; about.textContent = unit; head.append(name, about, value); box.append(head);
  if (labels) box.append(legend(labels));
  box.append(surface, cursor); $("plots").append(box);
  const it = { surface, cursor, value, read, series, low, high, log, marks, ticks, left: 52, right: 4 };
  const seekTo = (event) => {
    const width = surface.clientWidth - it.left - it.right, part = (event.clientX - surface.getBoundingClientRect().left - it.left) / width;
    seek(Math.min(Math.max(part, 0), 1) * shownUntil());
  };
  surface.addEventListener("pointerdown", (event) => { surface.setPointerCapture(event.pointerId); seekTo(event); });
  surface.addEventListener("pointermove", (event) => { if (event.buttons) seekTo(event); else hover?.(event, it); });
  if (hover) surface.addEventListener("pointerleave", () => tint(-1));
  plots.push(it);
}
function drawPlot({ surface, series, low, high, log, marks, ticks, left, right }) {
  const scale = Math.min(devicePixelRatio || 1, 3), width = surface.clientWidth, height = surface.clientHeight, c = surface.getContext("2d");
  surface.width = width * scale; surface.height = height * scale; c.scale(scale, scale);
  const top = 5, bottom = 14, until = shownUntil(), warp = log ? Math.log10 : (v) => v, [a, b] = [warp(low), warp(high)];
  const x = (t) => left + t / until * (width - left - right);
  const y = (v) => top + (1 - (warp(Math.min(Math.max(v, low), high)) - a) / (b - a)) * (height - top - bottom);
  c.font = "10px system-ui, sans-serif"; c.lineWidth = 1; c.fillStyle = style("--faint"); c.textBaseline = "middle"; c.textAlign = "right";
  for (const [v, label] of ticks) {
    c.strokeStyle = style("--rule"); c.beginPath(); c.moveTo(left, y(v)); c.lineTo(width - right, y(v)); c.stroke(); c.fillText(label, left - 5, y(v));
  }
  c.strokeStyle = style("--bad"); c.setLineDash([4, 3]);
  for (const v of marks) { c.beginPath(); c.moveTo(left, y(v)); c.lineTo(width - right, y(v)); c.stroke(); }
  c.setLineDash([]); c.textBaseline = "alphabetic"; c.textAlign = "center";
  const step = [0.1, 0.2, 0.5, 1].find((s) => until / s <= 6) || 2;
  for (let t = 0; t <= until - step * 0.3; t += step) c.fillText(t ? t.toFixed(1) : "0 s", x(t), height - 1);
  c.save(); c.beginPath(); c.rect(left, 0, width - left - right, height - bottom + 2); c.clip();
  for (const { time, values, colour, dots, dashed } of series) {
    c.strokeStyle = c.fillStyle = style(colour); c.lineWidth = 1.4; c.setLineDash(dashed ? [3, 3] : []); c.beginPath();
    for (let i = 0; i < time.length; i++) {
      if (dots) { if (values[i] >= 0) c.fillRect(x(time[i]) - 1.2, y(values[i]) - 1.2, 2.4, 2.4); } else c.lineTo(x(time[i]), y(values[i]));
    }
    c.stroke();
  }
  c.restore();
}

// ---- What is plotted.
const joints = data.robot.joints.length, jointColour = (j) => `--j${j % 8}`;
function jointPlot(title, name, unit) {
  const table = motion[name], time = evenly(table.length / joints);
  const series = Array.from({ length: joints }, (_, j) => ({ time, values: column(table, joints, j), colour: jointColour(j) }));
  // The curve under the pointer tints the link that it is of.
  const hover = (event, { surface, left, right }) => {
    const box = surface.getBoundingClientRect(), row = rowAt(name, (event.clientX - box.left - left) / (box.width - left - right) * shownUntil());
    const value = 1.1 - (event.clientY - box.top - 5) / (box.height - 19) * 2.2;
    tint([...row.keys()].reduce((best, j) => (Math.abs(row[j] - value) < Math.abs(row[best] - value) ? j : best), 0));
  };
  plot({ title, unit, low: -1.1, high: 1.1, marks: [-1, 1], ticks: [[-1, "−100"], [0, "0"], [1, "100 %"]], series, hover, read: (t) => {
    const row = rowAt(name, t), j = row.reduce((best, v, i) => (Math.abs(v) > Math.abs(row[best]) ? i : best), 0);
    return `J${j + 1} ${percent(row[j])}`;
  } });
}
const stretch = (values, least) => Math.max(least, ...values);
$("plots").append(legend(data.robot.joints.map((_, j) => [`J${j + 1}`, jointColour(j)])));
[...$("plots").lastChild.children].forEach((it, j) => { it.tabIndex = 0; it.onpointerenter = it.onfocus = () => tint(j); it.onpointerleave = it.onblur = () => tint(-1); });
jointPlot("Position", "position_ratio", "of the joint's range");
jointPlot("Velocity", "velocity_ratio", "of its limit");
jointPlot("Acceleration", "acceleration_ratio", "commanded, of its limit");
if (motion.torque_ratio.length) jointPlot("Torque", "torque_ratio", "of its limit");

const { time_s: errorTime, error_mm: error, claimed_mm: claimed } = data.errors;
const decades = (from, to, unit) => {
  const list = [];
  for (let e = Math.round(Math.log10(from)); e <= Math.round(Math.log10(to)); e++) list.push([10 ** e, `${e < 0 ? (10 ** e).toFixed(-e) : 10 ** e}${e === Math.round(Math.log10(to)) ? ` ${unit}` : ""}`]);
  return list;
};
const around = (values) => {
  const some = values.filter((v) => v > 0);
  const low = 10 ** Math.floor(Math.log10(Math.min(...some, 1))), high = 10 ** Math.ceil(Math.log10(Math.max(...some, 1)));
  return [Math.max(low, high / 1e5), high > low ? high : low * 10];
};
if (error.length) {
  const [low, high] = around([...error, ...claimed]);
  plot({ title: "Prediction", unit: "of the place of the catch", low, high, log: true, ticks: decades(low, high, "mm"),
    labels: [["off by", "--j0"], ["claimed: 1 σ, worst direction", "--j1"]],
    series: [{ time: errorTime, values: error, colour: "--j0" }, { time: errorTime, values: claimed, colour: "--j1", dashed: true }],
    read: (t) => { const i = latest(errorTime, t); return i < 0 ? "" : `${error[i].toPrecision(2)} mm`; } });
}
const widths = motion.width_m.map((v) => v * 1e3), widest = Math.ceil(stretch(widths, 10) / 20) * 20, every = evenly(widths.length);
plot({ title: "Gripper", unit: "opening", low: 0, high: widest, ticks: [[0, "0"], [widest / 2, widest / 2], [widest, `${widest} mm`]],
  series: [{ time: every, values: widths, colour: "--j0" }], read: (t) => `${(rowAt("width_m", t)[0] * 1e3).toFixed(1)} mm` });
const force = motion.finger_force_n, strongest = Math.ceil(stretch(force, 20) / 20) * 20;
plot({ title: "Force", unit: "on the object", low: 0, high: strongest, ticks: [[0, "0"], [strongest / 2, strongest / 2], [strongest, `${strongest} N`]],
  labels: [["left finger", "--j0"], ["right finger", "--j1"]],
  series: [0, 1].map((c) => ({ time: every, values: column(force, 2, c), colour: `--j${c}` })),
  read: (t) => rowAt("finger_force_n", t).map((v) => v.toFixed(0)).join(" | ") + " N" });
if (data.stages) {
  const { names, time_s: time } = data.stages, ms = unpack(data.stages.ms), [low, high] = around([...ms].filter((v) => v > 0.001));
  plot({ title: "Computing", unit: "wall time per tick", low, high, log: true, ticks: decades(low, high, "ms"),
    labels: names.map((name, i) => [name.replaceAll("_", " "), jointColour(i)]),
    series: names.map((_, i) => ({ time, values: column(ms, names.length, i), colour: jointColour(i), dots: true })),
    read: (t) => {
      const i = latest(time, t), ran = i < 0 ? [] : [...ms.slice(i * names.length, (i + 1) * names.length)].filter((v) => v > 0);
      return ran.length ? `${ran.reduce((a, v) => a + v, 0).toFixed(2)} ms` : "";
    } });
}
