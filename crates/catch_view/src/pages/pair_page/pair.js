"use strict";
// Two throws beside each other: either's slider moves both.
const { page, surfaces, throws } = JSON.parse(document.getElementById("data").textContent);
const frames = [...document.querySelectorAll("iframe")];
for (const it of throws) it.data = it.data.replace('"surfaces":{{surfaces}}', () => surfaces);
frames.forEach((frame, i) => {
  frame.srcdoc = page.replaceAll(/\{\{(title|data)\}\}/g, (_, name) => throws[i][name]);
});
addEventListener("message", (event) => {
  for (const frame of frames) if (frame.contentWindow !== event.source) frame.contentWindow.postMessage(event.data, "*");
});
