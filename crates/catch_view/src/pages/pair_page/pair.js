"use strict";
// Two throws beside each other: either's slider moves both.
const { page, surfaces, throws } = JSON.parse(document.getElementById("data").textContent);
const frames = [...document.querySelectorAll("iframe")];
frames.forEach((frame, i) => {
  frame.srcdoc = page.replaceAll(/\{\{(title|data)\}\}/g, (_, name) => throws[i][name]).replace("{{surfaces}}", () => surfaces);
});
addEventListener("message", (event) => {
  for (const frame of frames) if (frame.contentWindow !== event.source) frame.contentWindow.postMessage(event.data, "*");
});
