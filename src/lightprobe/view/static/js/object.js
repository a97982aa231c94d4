// The page "Object": under any light, beside its photos, one channel of its material.

import { getLight, upload } from "./api.js";
import { guarded } from "./app.js";
import { $, fillSelect, say } from "./dom.js";
import { drawMap } from "./maps.js";
import { aboutRun, on, predictions, state } from "./state.js";
import { Viewer } from "./viewer.js";

const own = []; // lights that the person has opened: {id, name}
let viewer = null;
let shown = { run: null, light: null }; // another one for each run that is opened
let light = null;

export async function show() {
  if (!viewer) {
    viewer = new Viewer($("view"));
    listen();
    new ResizeObserver(layout).observe($("stage"));
    on("tasks", () => state.about.has(state.run) && listLights(state.about.get(state.run)));
  }
  if (shown.run === state.run) {
    layout();
    await useLight();
  } else await openRun();
}

/** Choose a prediction's light; the page is opened by the caller. */
export function chooseLight(value) {
  wanted = value;
}
let wanted = null;

async function openRun() {
  const [began, run] = [(shown = { run: null, light: null }), state.run];
  const isLate = () => began !== shown; // another run was chosen meanwhile
  viewer.clear();
  delete $("stage").dataset.run;
  $("stand").value = "";
  hideWipe(true);
  layout();
  note("Loading the object…");
  try {
    const about = await aboutRun(run, true);
    if (isLate()) return;
    listLights(about);
    listPhotos(about);
    if (!about.object) {
      note("This run has no object yet: the page Training shows it as it forms.");
      return;
    }
    const [object] = await Promise.all([viewer.read(`/api/runs/${run}/object.glb`), guarded(useLight)]);
    if (isLate()) return;
    viewer.setObject(object);
  } catch (error) {
    if (isLate()) return;
    note("The object could not be loaded; open this page again.");
    throw error;
  }
  shown.run = run;
  stand();
  note("");
  viewer.drawNow();
  performance.mark("interactive");
  $("stage").dataset.run = String(run); // what is on the stage now
}

function note(text) {
  $("stage-note").textContent = text;
  $("stage-note").hidden = text === "";
}

function listLights(about) {
  const trained = about.photos.flatMap((photo, i) => (photo.light ? [[`photo:${i}`, photo.name]] : []));
  const groups = [
    { label: "Predicted", options: predictions().map((task) => [`task:${task.id}`, task.title]) },
    { label: "Yours", options: own.map(({ id, name }) => [`own:${id}`, name]) },
    { label: "Training photos", options: trained },
  ];
  fillSelect($("light"), groups.filter((group) => group.options.length > 0));
  if (!$("light").value && trained.length) $("light").value = trained[0][0];
}

function listPhotos(about) {
  const groups = ["train", "test", "relight"].map((split) => ({
    label: `${split} photos`,
    options: about.photos.flatMap((photo, i) => (photo.split === split ? [[String(i), photo.name]] : [])),
  }));
  fillSelect($("stand"), [["", "free view"], ...groups.filter((group) => group.options.length > 0)]);
}

function lightPath(value) {
  const [kind, id] = value.split(":");
  return { photo: `/api/runs/${state.run}/photos/${id}/light`, task: `/api/tasks/${id}/light`, own: `/api/lights/${id}` }[kind];
}

async function useLight() {
  if (wanted && [...$("light").options].some((option) => option.value === wanted)) $("light").value = wanted;
  wanted = null;
  const value = $("light").value;
  if (!value || shown.light === value) return;
  const began = shown;
  const isLate = () => began !== shown || shown.light !== value; // another one was chosen meanwhile
  shown.light = value;
  let found;
  try {
    found = await getLight(lightPath(value));
  } catch (error) {
    if (isLate()) return;
    shown.light = null;
    throw error;
  }
  if (isLate()) return;
  light = found;
  viewer.setLight(light);
  drawMap($("light-map"), light, Number($("turn").value));
}

function listen() {
  $("light").addEventListener("change", () => guarded(useLight));
  $("light-file").addEventListener("change", () => guarded(openLight));
  $("turn").addEventListener("input", () => {
    const degrees = Number($("turn").value);
    $("turn-out").textContent = `${degrees}°`;
    viewer.setTurn(degrees);
    if (light) drawMap($("light-map"), light, degrees);
  });
  const tone = () => {
    const stops = Number($("exposure").value);
    $("exposure-out").textContent = `${stops.toFixed(1)} EV`;
    viewer.setTone($("tone").value, stops);
  };
  $("exposure").addEventListener("input", tone);
  $("tone").addEventListener("change", tone);
  $("background").addEventListener("change", () => viewer.setBackground($("background").value));
  $("balls").addEventListener("change", () => {
    viewer.showBalls($("balls").checked);
    if (!standing()) viewer.freeView(); // with room for them
  });
  $("channels").addEventListener("change", (event) => viewer.setChannel(event.target.value));
  $("stand").addEventListener("change", stand);
  $("wipe").addEventListener("input", wipe);
  $("snapshot").addEventListener("click", () => guarded(save));
  $("page-object").addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || $("stand").value === "") return;
    $("stand").value = "";
    stand();
  });
  dropLights();
}

async function openLight(file = $("light-file").files[0]) {
  if (!file) return;
  $("light-file").value = "";
  const given = await upload("/api/lights", file, state.session.limits.light);
  own.unshift(given);
  listLights(await aboutRun());
  wanted = `own:${given.id}`;
  await useLight();
  say(`${given.name} lights the object now.`, { key: "own-light", info: true, seconds: 4 });
}

function dropLights() {
  const page = $("page-object");
  page.addEventListener("dragover", (event) => event.preventDefault());
  page.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) guarded(() => openLight(file));
  });
}

function standing() {
  const value = $("stand").value;
  return value === "" ? null : state.about.get(state.run).photos[Number(value)];
}

function hideWipe(hidden) {
  for (const id of ["wipe", "wipe-photo", "wipe-line"]) $(id).hidden = hidden;
}

function stand() {
  if (!viewer.object) return;
  const photo = standing();
  hideWipe(!photo);
  layout();
  if (!photo) {
    viewer.freeView();
    return;
  }
  $("wipe-photo").alt = `The photo ${photo.name}`;
  $("wipe-photo").src = `/api/runs/${state.run}/photos/${$("stand").value}/picture`;
  if (photo.light) {
    wanted = `photo:${$("stand").value}`;
    guarded(useLight);
  }
  viewer.standAt(photo.camera);
  wipe();
}

/** Fit the canvas to the stage, or to a photo's shape within it. */
function layout() {
  const stage = $("stage").getBoundingClientRect();
  if (!viewer || stage.width === 0) return;
  const photo = standing();
  let [width, height] = [stage.width, stage.height];
  if (photo) {
    const scale = Math.min(width / photo.camera.width, height / photo.camera.height);
    [width, height] = [photo.camera.width * scale, photo.camera.height * scale];
  }
  const place = { left: `${(stage.width - width) / 2}px`, top: `${(stage.height - height) / 2}px`, width: `${width}px`, height: `${height}px` };
  Object.assign($("view").style, place);
  Object.assign($("wipe-photo").style, place);
  viewer.resize(width, height);
  wipe();
}

function wipe() {
  const [share, line, picture] = [Number($("wipe").value), $("wipe-line").style, $("wipe-photo").style];
  picture.clipPath = `inset(0 ${100 - share}% 0 0)`;
  line.left = `${parseFloat(picture.left) + (parseFloat(picture.width) * share) / 100}px`;
  [line.top, line.height] = [picture.top, picture.height];
}

async function save() {
  const photo = standing();
  const size = photo ? [photo.camera.width, photo.camera.height] : [viewer.canvas.width, viewer.canvas.height];
  const url = URL.createObjectURL(await viewer.snapshot(...size));
  const link = document.createElement("a");
  Object.assign(link, { href: url, download: `${state.session.runs[state.run].name}.png` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
