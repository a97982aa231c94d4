// The pictures of a prediction: the photo beside what is known of it, the map with its lamps, the balls.

import { taskFile } from "./api.js";
import { el } from "./dom.js";

/** Return the photo under an upper picture that a slider wipes in: the object's outline, or its render. */
export function wiped(task) {
  const lower = el("img", { src: taskFile(task, "photo.jpg"), alt: `The photo ${task.title}` });
  const upper = el("img", { className: "upper", src: taskFile(task, "overlay.png"), alt: "The object's outline in the photo" });
  const slider = el("input", { type: "range", min: 0, max: 100, value: 100, "aria-label": "Wipe between photo and picture" });
  const wipe = () => (upper.style.clipPath = `inset(0 ${100 - slider.value}% 0 0)`);
  slider.addEventListener("input", wipe);
  wipe();
  const choices = choose(`upper-${task.id}`, [["overlay.png", "Outline"], ["render.png", "Render"], ["mask.png", "Mask"]], (name) => {
    upper.src = taskFile(task, name);
    upper.alt = { "overlay.png": "The object's outline", "render.png": "The object under this light", "mask.png": "The object's mask" }[name];
  });
  return { element: el("div", { className: "pair" }, lower, upper), controls: el("div", { className: "under" }, choices, slider) };
}

/** Return radio buttons that look like one switch. */
export function choose(name, options, onChoice) {
  const labels = options.map(([value, label], i) =>
    el("label", {}, el("input", { type: "radio", name, value, checked: i === 0, onchange: () => onChoice(value) }), el("span", { textContent: label })),
  );
  return el("div", { className: "choices" }, ...labels);
}

/** Return the environment map, its confidence, and marks where the sun and lamps are. */
export function lightMap(task) {
  const image = el("img", { className: "map", src: taskFile(task, "light.png"), alt: "The environment map in all directions" });
  const sources = task.result.sources ?? [];
  const marks = sources.map((source, i) => mark(source, i));
  const words = sources.length ? `${sources.length === 1 ? "One lamp or sun is" : `${sources.length} lamps or suns are`} marked.` : "No lamp stands out.";
  const legend = el("figcaption", { textContent: `The light from all directions; z is up. ${words}` });
  const choices = choose(`map-${task.id}`, [["light.png", "Light"], ["confidence.png", "Confidence"]], (name) => {
    image.src = taskFile(task, name);
    const light = name === "light.png";
    image.alt = light ? "The environment map in all directions" : "How far each direction can be trusted";
    legend.textContent = light ? `The light from all directions; z is up. ${words}` : `Yellow can be trusted, violet cannot; mean ${task.result.confidence.toFixed(2)}.`;
  });
  const turned = el("div", { className: "pair" }, image, ...marks);
  turned.style.width = "100%";
  return el("figure", {}, turned, el("div", { className: "under" }, choices), legend);
}

function mark({ direction: [x, y, z], irradiance_rgb: rgb }, index) {
  const place = { left: `${100 * (0.5 - Math.atan2(y, x) / (2 * Math.PI))}%`, top: `${(100 * Math.acos(Math.max(-1, Math.min(1, z)))) / Math.PI}%` };
  const title = `Lamp ${index + 1}: irradiance ${rgb.map((value) => value.toPrecision(2)).join(", ")}`;
  const spot = el("span", { className: "mark", title, role: "img", "aria-label": title });
  Object.assign(spot.style, place);
  return spot;
}

/** Return the balls under the light. */
export const sidePictures = (task) =>
  el("figure", {}, el("img", { className: "balls", src: taskFile(task, "balls.png"), alt: "A diffuse, a matte and a mirror ball under the light" }), el("figcaption", { textContent: "Diffuse, matte and mirror ball in the object's place." }));

/** Return what is thought of the photo, and what it took. */
export function verdict(task) {
  const { verdict: status, pose, sentences, warnings = [], seconds } = task.result;
  const doubts = [...sentences, ...warnings];
  const where = pose ? `Pose ${pose}, photo ${status}` : `A photo of the run's own scene, photo ${status}`;
  const words = `${where}; ${seconds.all.toFixed(1)} s.`;
  const doubtful = doubts.length > 0 || status !== "good";
  return el("div", { className: doubtful ? "verdict doubtful" : "verdict" }, el("p", { textContent: words }), ...doubts.map((text) => el("p", { textContent: text })));
}
