// A small picture of an environment map, drawn from its half floats.

const HALVES = new Float32Array(65536);
for (let bits = 0; bits < 65536; bits += 1) {
  const [exponent, share] = [(bits >> 10) & 31, bits & 1023];
  HALVES[bits] = exponent === 0 ? share * 2 ** -24 : (1 + share / 1024) * 2 ** (exponent - 15);
}

/** Draw a map so that its typical brightness is in the middle, turned about the vertical by degrees. */
export function drawMap(canvas, { data, height }, degrees = 0) {
  const width = 2 * height;
  const [columns, rows] = [canvas.width, canvas.height];
  const image = new ImageData(columns, rows);
  const factor = 0.5 / typical(data, width, height);
  const shift = Math.round((degrees / 360) * width);
  for (let y = 0; y < rows; y += 1) {
    const line = height - 1 - Math.min(Math.floor((y * height) / rows), height - 1);
    for (let x = 0; x < columns; x += 1) {
      const column = (((Math.floor((x * width) / columns) + shift) % width) + width) % width;
      const [from, to] = [4 * (line * width + column), 4 * (y * columns + x)];
      for (let c = 0; c < 3; c += 1) {
        const shown = 1 - Math.exp(-factor * HALVES[data[from + c]]);
        image.data[to + c] = 255 * (shown <= 0.0031308 ? 12.92 * shown : 1.055 * shown ** (1 / 2.4) - 0.055);
      }
      image.data[to + 3] = 255;
    }
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

function typical(data, width, height) {
  const step = Math.max(Math.floor((width * height) / 4096), 1);
  const values = [];
  for (let i = 0; i < width * height; i += step) values.push(HALVES[data[4 * i + 1]]);
  values.sort((a, b) => a - b);
  const most = 5 * values[values.length >> 1];
  return values.reduce((sum, value) => sum + Math.min(value, most), 0) / values.length || 1;
}
