// A line chart on a canvas: values by step, on a linear or logarithmic axis.

const MARGIN = { left: 52, right: 12, top: 12, bottom: 24 };
const COLORS = ["#f0c36a", "#7fb2e5", "#8fd6a4"];

/** Draw series {name, points: [[x, y], ...]}; with `log` the vertical axis is logarithmic. */
export function drawChart(canvas, series, { log = false, unit = "" } = {}) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width) return;
  [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = "12px system-ui, sans-serif";
  const points = series.flatMap((one) => one.points).filter(([, y]) => Number.isFinite(y) && (!log || y > 0));
  pen.fillStyle = "#a3a3a3";
  if (points.length === 0) {
    pen.fillText("Nothing recorded yet.", 16, 28);
    return;
  }
  const at = (y) => (log ? Math.log10(y) : y);
  const range = (values) => [Math.min(...values), Math.max(...values)];
  const [x0, x1] = range([0, ...points.map(([x]) => x)]);
  let [y0, y1] = range(points.map(([, y]) => at(y)));
  if (y1 - y0 < 1e-6) [y0, y1] = [y0 - 0.5, y1 + 0.5];
  const px = (x) => MARGIN.left + ((x - x0) / Math.max(x1 - x0, 1)) * (width - MARGIN.left - MARGIN.right);
  const py = (y) => height - MARGIN.bottom - ((at(y) - y0) / (y1 - y0)) * (height - MARGIN.top - MARGIN.bottom);
  pen.strokeStyle = "#333";
  for (let i = 0; i <= 4; i += 1) {
    const value = y0 + ((y1 - y0) * i) / 4;
    const y = height - MARGIN.bottom - ((height - MARGIN.top - MARGIN.bottom) * i) / 4;
    pen.beginPath();
    pen.moveTo(MARGIN.left, y);
    pen.lineTo(width - MARGIN.right, y);
    pen.stroke();
    pen.fillText(`${(log ? 10 ** value : value).toPrecision(3)}${unit}`, 4, y + 4);
  }
  pen.textAlign = "right";
  pen.fillText(`step ${x1}`, width - MARGIN.right, height - 7);
  pen.textAlign = "left";
  series.forEach((one, i) => {
    pen.strokeStyle = pen.fillStyle = COLORS[i % COLORS.length];
    pen.lineWidth = 1.5;
    pen.beginPath();
    one.points.filter(([, y]) => !log || y > 0).forEach(([x, y], k) => (k ? pen.lineTo(px(x), py(y)) : pen.moveTo(px(x), py(y))));
    pen.stroke();
    if (one.points.length < 12) for (const [x, y] of one.points) pen.fillRect(px(x) - 3, py(y) - 3, 6, 6);
    pen.fillText(one.name, MARGIN.left + 8 + 110 * i, MARGIN.top + 10);
  });
}
