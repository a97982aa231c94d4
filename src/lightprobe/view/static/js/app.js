// The frame of the page: which run, which page, and whether the server is there.

import { getJson, ServerLost } from "./api.js";
import { $, el, fillSelect, say, unsay } from "./dom.js";
import { refreshTasks, state, tell } from "./state.js";

const PAGES = { object: "./object.js", photo: "./photo.js", training: "./training.js", masks: "./masks.js" };
const HEARTBEAT = 3000; // milliseconds
const opened = new Map();
let current = null;

/** Run something and say what goes wrong. */
export async function guarded(work) {
  try {
    return await work();
  } catch (error) {
    say(error.message, { key: error instanceof ServerLost ? "lost" : error.message });
    return undefined;
  }
}

async function open(name) {
  const page = name in PAGES ? name : firstPage();
  for (const section of document.querySelectorAll(".page")) section.hidden = section.id !== `page-${page}`;
  for (const link of document.querySelectorAll("[data-page]")) {
    if (link.dataset.page === page) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${page[0].toUpperCase()}${page.slice(1)} · lightprobe`;
  if (current && current !== page) opened.get(current)?.hide?.();
  current = page;
  await guarded(async () => {
    if (!opened.has(page)) opened.set(page, await import(PAGES[page]));
    if (current === page) await opened.get(page).show();
  });
}

function firstPage() {
  if (state.session.runs.length === 0) return "masks";
  return "object";
}

async function choose(index) {
  state.run = index;
  tell("run", index);
  if (current) await guarded(() => opened.get(current)?.show?.(true));
}

function listRuns() {
  const { runs, scenes } = state.session;
  fillSelect($("run"), runs.map((run) => [String(run.index), run.name]));
  document.querySelector(".run-choice").hidden = runs.length === 0;
  for (const page of ["object", "photo", "training"]) document.querySelector(`[data-page=${page}]`).hidden = runs.length === 0;
  document.querySelector("[data-page=masks]").hidden = scenes.length === 0;
}

async function heartbeat() {
  let lost = false;
  for (;;) {
    await new Promise((done) => setTimeout(done, HEARTBEAT));
    if (document.hidden) continue;
    try {
      await getJson("/api/session");
      unsay("lost");
      if (lost) {
        lost = false;
        say("The server is back.", { key: "back", info: true, seconds: 4 });
      }
    } catch (error) {
      if (!lost) say(error.message, { key: "lost" });
      lost = true;
    }
  }
}

async function start() {
  state.session = await guarded(() => getJson("/api/session"));
  if (!state.session) {
    $("main").append(el("p", { className: "page", textContent: "Nothing to show yet; load the page again." }));
    return;
  }
  listRuns();
  $("run").addEventListener("change", () => choose(Number($("run").value)));
  window.addEventListener("hashchange", () => open(location.hash.slice(1)));
  guarded(refreshTasks);
  await open(location.hash.slice(1) || firstPage());
  heartbeat();
}

start();
