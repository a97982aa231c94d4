// A virtual object of the person's own beside the known object: a GLB, a place in the photo, a size and a turn.

import { follow, taskFile, sendJson, upload } from "./api.js";
import { guarded } from "./app.js";
import { el } from "./dom.js";
import { refreshTasks, state } from "./state.js";

let own = null; // the last GLB: {id, name}

/** Return the controls, and below them what comes of them. */
export function placing(photo) {
  const place = { at: null, scale: null, turn: 0 };
  const picture = el("div", { className: "pair placing" });
  const photoImage = el("img", { src: taskFile(photo, "photo.jpg"), alt: "The photo: click where it is to stand" });
  const cross = el("span", { className: "mark", hidden: true });
  picture.append(photoImage, cross);
  const where = el("p", { className: "quiet", textContent: "It stands beside the known object; click into the photo for another place." });
  picture.addEventListener("click", (event) => {
    const box = photoImage.getBoundingClientRect();
    moveTo((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
  });
  const numbers = ["across", "down"].map((word, axis) =>
    el("input", { type: "number", min: 0, max: 100, step: 1, "aria-label": `Place, percent ${word}`, placeholder: word, onchange: () => typed(axis) }),
  );
  function typed() {
    if (numbers.every((input) => input.value !== "")) moveTo(...numbers.map((input) => Number(input.value) / 100));
  }
  function moveTo(x, y) {
    place.at = [x, y].map((share) => Math.min(Math.max(share, 0), 1));
    numbers.forEach((input, axis) => (input.value = Math.round(100 * place.at[axis])));
    cross.hidden = false;
    Object.assign(cross.style, { left: `${100 * place.at[0]}%`, top: `${100 * place.at[1]}%` });
  }
  const out = el("div", { "aria-live": "polite" });
  const name = el("span", { className: "quiet", textContent: own ? own.name : "no file yet" });
  const go = el("button", { type: "button", className: "primary", textContent: "Put it in", disabled: !own, onclick: () => guarded(() => insert(photo, place, out, go)) });
  const file = el("input", { type: "file", accept: ".glb,model/gltf-binary", className: "file", "aria-label": "Choose a GLB file" });
  file.addEventListener("change", () => guarded(() => take(file, name, go)));
  const tools = el("div", { className: "under" }, el("label", { className: "button" }, file, "Choose a GLB…"), name);
  return el("details", {}, el("summary", { textContent: "Put your own object beside it" }), tools, picture, where,
    el("div", { className: "under" }, el("span", { className: "quiet", textContent: "Place %" }), ...numbers),
    slider("Height", 0, 3, 0.05, 0, (value) => (place.scale = value || null), (value) => (value ? `${value.toFixed(2)} × the object` : "as in its file")),
    slider("Turn", -180, 180, 5, 0, (value) => (place.turn = value), (value) => `${value}°`), go, out);
}

function slider(label, min, max, step, value, hear, words) {
  const output = el("output", { textContent: words(value) });
  const input = el("input", { type: "range", min, max, step, value });
  input.addEventListener("input", () => {
    hear(Number(input.value));
    output.textContent = words(Number(input.value));
  });
  return el("label", { className: "row" }, label, input, output);
}

async function take(file, name, go) {
  const [given] = file.files;
  file.value = "";
  if (!given) return;
  go.disabled = true;
  name.textContent = `Sending ${given.name}…`;
  try {
    own = await upload("/api/objects", given, state.session.limits.object, (share) => (name.textContent = `Sending ${given.name}: ${Math.round(100 * share)} %`));
  } finally {
    name.textContent = own ? own.name : "no file yet";
    go.disabled = !own;
  }
}

async function insert(photo, place, out, go) {
  go.disabled = true;
  const words = el("p", { textContent: "Starting…" });
  out.replaceChildren(words, el("progress", { "aria-label": "Insertion" }));
  try {
    const task = await follow(await sendJson("POST", `/api/tasks/${photo.id}/insertions`, { object: own.id, ...place }), (now) => {
      words.textContent = now.state === "waiting" ? "Waiting for its turn…" : `${now.stage || "Starting"}…`;
    });
    out.replaceChildren(inserted(task));
    await refreshTasks();
  } catch (error) {
    out.replaceChildren(el("p", { className: "verdict failed", textContent: error.message, role: "alert" }));
  } finally {
    go.disabled = false;
  }
}

function inserted(task) {
  const image = el("img", { src: taskFile(task, task.result.picture), alt: `${task.title} in the photo` });
  const links = task.result.files.map(({ name, title }) => el("li", {}, el("a", { href: taskFile(task, name, true), download: name, textContent: name }), ` – ${title}`));
  const doubts = [...task.result.sentences, ...(task.result.warnings ?? [])].map((text) => el("p", { className: "verdict doubtful", textContent: text }));
  return el("div", {}, el("div", { className: "pair" }, image), ...doubts, el("ul", { className: "files" }, ...links));
}

