"use strict";
// Nothing, the image alone, the model alone, both: red, green, blue.
const COLOURS = [[16, 18, 24], [70, 120, 255], [255, 70, 60], [170, 170, 170]];

function draw(image) {
  const canvas = document.createElement("canvas");
  canvas.width = image.width;
  canvas.height = image.height;
  canvas.style.maxWidth = "100%";
  const bytes = Uint8Array.from(atob(image.runs.data), (letter) => letter.charCodeAt(0));
  const runs = new Uint16Array(bytes.buffer);
  const context = canvas.getContext("2d");
  const pixels = context.createImageData(image.width, image.height);
  let at = 0;
  for (let run = 0; run < runs.length; run += 2) {
    const colour = COLOURS[runs[run]];
    for (let count = 0; count < runs[run + 1]; count++) {
      pixels.data.set([...colour, 255], 4 * at++);
    }
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}

const cameras = JSON.parse(document.getElementById("data").textContent);
for (const camera of cameras) {
  const section = document.createElement("section");
  const heading = document.createElement("h2");
  heading.textContent = camera.summary;
  section.append(heading, ...camera.images.map(draw));
  document.getElementById("cameras").append(section);
}
