// What the pages share: the session, the chosen run, and the predictions so far.

import { getJson } from "./api.js";

export const state = { session: null, run: 0, about: new Map(), tasks: [] };
const changes = new EventTarget();

export const on = (name, hear) => changes.addEventListener(name, (event) => hear(event.detail));
export const tell = (name, detail) => changes.dispatchEvent(new CustomEvent(name, { detail }));

/** Return what the server says of a run, asked for once unless `fresh`. */
export async function aboutRun(index = state.run, fresh = false) {
  if (fresh || !state.about.has(index)) state.about.set(index, await getJson(`/api/runs/${index}`));
  return state.about.get(index);
}

/** Ask for the predictions and insertions so far, and tell those who show them. */
export async function refreshTasks() {
  state.tasks = await getJson("/api/tasks");
  tell("tasks", state.tasks);
}

export const predictions = () =>
  state.tasks.filter((task) => task.kind === "predict" && task.state === "done" && task.about.run_index === state.run);
