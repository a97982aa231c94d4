// The page "Masks": photos of a scene, a mask to correct by clicks or by painting, a box to draw around the object.

import { follow, getJson, sendBytes, sendJson } from "./api.js";
import { guarded } from "./app.js";
import { $, el, fillSelect, say } from "./dom.js";
import { Easel } from "./easel.js";
import { choose } from "./results.js";
import { state } from "./state.js";

const page = {};
let scene = null; // {index, photos, ...}
let held = null; // {scene, photo}: what is on the easel, by their numbers
let working = false; // whether a correction is being taken up

export async function show() {
  if (!page.shots) build();
  if (!scene) await openScene(0);
}

function build() {
  page.scene = el("select", { "aria-label": "Scene", onchange: () => guarded(() => openScene(Number(page.scene.value))) });
  page.shots = el("ul", { className: "shots", "aria-label": "Photos" });
  page.notes = el("div");
  page.easel = new Easel();
  page.command = el("div", { "aria-live": "polite" });
  page.tools = el("div", { className: "tools" });
  $("page-masks").append(page.scene, page.notes, el("div", { className: "mask-page" }, page.shots, el("div", {}, page.tools, page.easel.element, page.command)));
  fillSelect(page.scene, state.session.scenes.map((one) => [String(one.index), one.name]));
  page.scene.hidden = state.session.scenes.length < 2;
}

const mayLeave = () => !page.easel.changed || window.confirm("The painted mask is not saved. Leave it?");

async function openScene(index) {
  const before = scene;
  const back = () => (page.scene.value = String(before?.index ?? index));
  if (!mayLeave()) {
    back();
    return;
  }
  let told;
  try {
    told = await getJson(`/api/scenes/${index}`);
  } catch (error) {
    back();
    throw error;
  }
  if (before !== scene || Number(page.scene.value) !== index) return; // another one was chosen meanwhile
  page.easel.clear();
  take(index, told);
  held = null;
  page.about = scene.prepared
    ? "Doubtful masks come first. Click on what is the object but left out, or on what is not but taken for it; all photos follow in seconds."
    : "This folder has no masks yet. Draw a box around the object in one photo, and prepare the scene with it.";
  buildTools();
  page.command.replaceChildren(...(scene.hint ? [el("p", { className: "quiet", textContent: `A box is kept: ${scene.hint}` })] : []));
  listShots();
  if (scene.order.length) await openPhoto(scene.order[0].number);
}

/** Take what the server tells of a scene. */
function take(index, told) {
  scene = { index, ...told, now: Date.now() };
  scene.order = scene.photos.map((photo, number) => ({ ...photo, number })).sort((a, b) => b.doubtful - a.doubtful || (a.stability ?? 2) - (b.stability ?? 2));
}

function listShots() {
  const warnings = scene.warnings.map((text) => el("p", { className: "verdict doubtful", textContent: text }));
  page.notes.replaceChildren(el("p", { textContent: page.about }), ...warnings);
  page.shots.replaceChildren(...scene.order.map((photo) => {
    const words = `${photo.name}${photo.doubtful ? ", doubtful" : ""}${photo.corrected ? ", corrected" : ""}`;
    const button = el("button", { type: "button", onclick: () => guarded(() => openPhoto(photo.number)) }, el("img", { src: `/api/scenes/${scene.index}/photos/${photo.number}/thumbnail?now=${scene.now}`, alt: "", loading: "lazy" }), words);
    if (photo.number === held?.photo) button.setAttribute("aria-current", "true");
    return el("li", {}, button);
  }));
}

async function openPhoto(number) {
  if (!mayLeave()) return;
  held = null;
  const at = `/api/scenes/${scene.index}/photos/${number}`;
  const opened = { scene: scene.index, photo: number };
  const isShown = await page.easel.open(`${at}/picture`, scene.prepared ? `${at}/mask?now=${Date.now()}` : null, scene.photos[number].name);
  if (!isShown) return;
  held = opened;
  listShots();
}

function buildTools() {
  const easel = page.easel;
  const corrections = [["other", "Click: not the object"], ["object", "Click: the object"], ["paint", "Paint: add"], ["erase", "Paint: take away"]];
  const modes = [...(scene.prepared ? corrections : []), ["box", "Box"]];
  easel.setMode(modes[0][0]);
  const button = (textContent, work, className = "") => el("button", { type: "button", textContent, className, onclick: () => guarded(work) });
  const size = el("input", { type: "range", min: 1, max: 100, value: easel.size, "aria-label": "Size of the brush" });
  size.addEventListener("input", () => (easel.size = Number(size.value)));
  easel.onClick = (at, object) => guarded(() => click(at, object));
  easel.onSize = (value) => (size.value = value);
  const edges = ["left", "top", "right", "bottom"].map((word, i) =>
    el("input", { type: "number", min: 0, max: 100, step: 0.5, "aria-label": `Box, ${word}, percent`, placeholder: word, onchange: (event) => easel.setEdge(i, Number(event.target.value) / 100) }));
  easel.onBox = (box) => edges.forEach((input, i) => (input.value = box ? (100 * box[i]).toFixed(1) : ""));
  page.tools.replaceChildren(
    choose("mask-mode", modes, (mode) => easel.setMode(mode)),
    ...(scene.prepared ? [el("label", { className: "row" }, "Brush", size), button("Undo", () => easel.undo()), button("Save the mask", saveMask, "primary"), button("Forget this photo's corrections", forget)] : []),
    ...edges, button("Keep the box", saveBox),
    el("p", { className: "quiet", textContent: "Keys on the picture: arrows move, Space clicks, paints or sets a corner, [ and ] change the brush, Ctrl+Z takes back." }),
  );
}

const photoOf = ({ scene, photo }) => `/api/scenes/${scene}/photos/${photo}`;

async function click(at, object) {
  if (page.easel.changed) {
    say("Save what is painted first, or take it back.", { key: "mask", info: true, seconds: 4 });
    return;
  }
  await takeUp(() => sendJson("POST", `${photoOf(held)}/clicks`, { at, object }));
}

async function forget() {
  if (!scene.photos[held?.photo]?.corrected) {
    say("Nothing was corrected in this photo.", { key: "mask", info: true, seconds: 4 });
    return;
  }
  await takeUp(() => sendJson("POST", `${photoOf(held)}/forget`));
}

async function saveMask() {
  if (!page.easel.changed) {
    say("Nothing has been painted yet.", { key: "mask", info: true, seconds: 4 });
    return;
  }
  await takeUp(async () => sendBytes("PUT", `${photoOf(held)}/mask`, await page.easel.mask()));
}

/** Have a correction taken up by all masks, and show them. `submit` returns the task. Nothing is drawn meanwhile. */
async function takeUp(submit) {
  if (!held) return;
  if (working) {
    say("The correction before is still being taken up; wait a moment.", { key: "mask", info: true, seconds: 4 });
    return;
  }
  const { scene: index } = held;
  const words = el("p", { className: "quiet", textContent: "…" });
  page.command.replaceChildren(words);
  working = page.easel.locked = true;
  try {
    const task = await submit();
    page.easel.changed = false; // it is in the scene now
    await follow(task, (now) => (words.textContent = now.state === "waiting" ? "Waiting for its turn…" : `${now.stage || "Beginning"}…`));
    words.textContent = "All masks have taken it up.";
  } catch (error) {
    words.textContent = "";
    throw error;
  } finally {
    working = page.easel.locked = false;
    if (scene.index === index) await refresh(index); // else another one was chosen meanwhile
  }
}

/** Show a scene's photos and masks as they are now. */
async function refresh(index) {
  const told = await getJson(`/api/scenes/${index}`);
  if (scene.index !== index) return;
  take(index, told);
  listShots();
  if (held && !page.easel.changed) await openPhoto(held.photo);
}

async function saveBox() {
  if (!page.easel.box) {
    say("Draw a box around the object first.", { key: "box", info: true, seconds: 4 });
    return;
  }
  const answer = await sendJson("PUT", `/api/scenes/${held.scene}/box`, { photo: held.photo, box: page.easel.box });
  next(scene.prepared ? "The box is kept in the scene. The same command as before takes it up, where PHOTOS is the folder or video it was made from:" : "This command prepares the scene with the box; SCENE is a new folder:", answer.command);
}

function next(words, command) {
  const copy = el("button", { type: "button", textContent: "Copy", onclick: () => navigator.clipboard?.writeText(command) });
  page.command.replaceChildren(el("p", { textContent: words }), el("div", { className: "command" }, el("code", { textContent: command }), copy));
}
