// The page "Photo": a photo in, the light around the object and all that follows from it out.

import { follow, taskFile, sendJson, upload } from "./api.js";
import { guarded } from "./app.js";
import { $, el, say } from "./dom.js";
import { placing } from "./placing.js";
import { lightMap, sidePictures, verdict, wiped } from "./results.js";
import { aboutRun, on, predictions, refreshTasks, state } from "./state.js";

let ready = false;
let loaded = null; // the run that the server was told to load
let current = null; // the task that is shown

export async function show(changed = false) {
  if (!ready) {
    ready = true;
    listen();
    on("tasks", listRecent);
  }
  if (changed) clear();
  const run = state.run;
  const about = await aboutRun(run, true);
  if (run !== state.run) return; // another one was chosen meanwhile
  $("drop").hidden = !about.object;
  $("result").querySelector(".no-object")?.remove();
  if (!about.object) {
    $("result").replaceChildren(el("p", { className: "no-object", textContent: "This run has no object yet: light can be read off photos when its training is done." }));
  }
  await refreshTasks();
  if (about.object && loaded !== state.run) {
    loaded = state.run;
    await sendJson("POST", `/api/runs/${state.run}/load`);
  }
}

function clear() {
  current = null;
  $("result").replaceChildren();
}

function listen() {
  for (const input of [$("photo-file"), $("photo-camera")]) {
    const take = () => {
      const [file] = input.files;
      input.value = "";
      if (file) guarded(() => predict(file));
    };
    input.addEventListener("change", take);
    take(); // what was chosen while this page was loading
  }
  const page = $("page-photo");
  page.addEventListener("dragover", (event) => {
    event.preventDefault();
    $("drop").classList.add("over");
  });
  page.addEventListener("dragleave", () => $("drop").classList.remove("over"));
  page.addEventListener("drop", (event) => {
    event.preventDefault();
    $("drop").classList.remove("over");
    const [file] = event.dataTransfer.files;
    if (file) guarded(() => predict(file));
  });
  document.addEventListener("paste", (event) => {
    const file = [...(event.clipboardData?.files ?? [])].find((one) => one.type.startsWith("image/"));
    if (file && !page.hidden) guarded(() => predict(file));
  });
}

async function predict(file) {
  const bar = el("progress", { "aria-label": "Upload", max: 1, value: 0 });
  const words = el("p", { textContent: `Sending ${file.name}…` });
  $("result").replaceChildren(words, bar);
  const run = state.run;
  let task;
  try {
    task = await upload(`/api/runs/${run}/predictions`, file, state.session.limits.photo, (share) => (bar.value = share));
  } catch (error) {
    if (run === state.run) clear();
    throw error;
  }
  if (run === state.run) await watch(task, words, bar);
}

async function watch(task, words, bar) {
  current = task.id;
  bar.removeAttribute("value");
  const stop = el("button", { type: "button", textContent: "Stop", onclick: () => guarded(() => sendJson("POST", `/api/tasks/${task.id}/stop`)) });
  $("result").append(stop);
  try {
    task = await follow(task, (now) => {
      words.textContent = now.state === "waiting" ? "Waiting for its turn…" : `${now.title}: ${now.stage || "starting"}…`;
    });
  } catch (error) {
    if (current === task.id) $("result").replaceChildren(el("p", { className: "verdict failed", textContent: error.message, role: "alert" }));
    return;
  }
  await refreshTasks();
  if (current === task.id) showResult(task);
}

function listRecent() {
  const items = predictions().map((task) => {
    const button = el("button", { type: "button", title: task.title, onclick: () => showResult(task) }, el("img", { src: taskFile(task, "photo.jpg"), alt: task.title }));
    if (task.id === current) button.setAttribute("aria-current", "true");
    return el("li", {}, button);
  });
  $("recent").replaceChildren(...items);
}

function showResult(task) {
  current = task.id;
  listRecent();
  const picture = wiped(task);
  const under = el("button", {
    type: "button",
    textContent: "See the object under this light",
    onclick: async () => {
      (await import("./object.js")).chooseLight(`task:${task.id}`);
      location.hash = "object";
    },
  });
  $("result").replaceChildren(
    verdict(task),
    el("div", { className: "pictures" }, el("div", {}, picture.element, picture.controls, placing(task)), el("div", { className: "side" }, lightMap(task), sidePictures(task), under, files(task))),
  );
}

function files(task) {
  const links = task.result.files.map(({ name, title }) => el("li", {}, el("a", { href: taskFile(task, name, true), download: name, textContent: name }), ` – ${title}`));
  return el("details", { open: true }, el("summary", { textContent: "Files" }), el("ul", { className: "files" }, ...links));
}

window.addEventListener("unhandledrejection", (event) => {
  event.preventDefault();
  say(event.reason?.message ?? "Something went wrong; load the page again.");
});
