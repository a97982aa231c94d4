// The page "Training": how far it is, how well it goes, and the object as it forms.

import { getJson, ServerLost } from "./api.js";
import { drawChart } from "./charts.js";
import { $, duration, el, say } from "./dom.js";
import { CheckpointPreview } from "./preview.js";
import { on, state } from "./state.js";

const EVERY = 2000; // milliseconds
const NAMES = { decompose: "Phase I: object and lights", distill: "Phase II: the predictor" };
const parts = {};
let watched = null; // {run, records, next}
let timer = 0;

export async function show(changed = false) {
  if (!parts.loss) build();
  if (changed || !watched || watched.run !== state.run) {
    watched = { run: state.run, records: [], next: 0 };
    parts.preview.clear();
  }
  hide();
  await ask();
}

export function hide() {
  clearTimeout(timer);
  timer = 0;
}

on("run", () => (watched = null));

function build() {
  for (const name of ["head", "numbers", "bars", "scores", "log"]) parts[name] = el("div");
  parts.loss = el("canvas", { className: "chart", role: "img", "aria-label": "Loss by step" });
  parts.quality = el("canvas", { className: "chart", role: "img", "aria-label": "Quality on held-out photos by step" });
  parts.log.className = "log";
  parts.held = el("div", {}, el("h3", { textContent: "Held-out photos, PSNR in dB" }), parts.quality);
  parts.preview = new CheckpointPreview();
  $("page-training").append(
    parts.head, parts.numbers, parts.bars,
    el("div", { className: "watch" },
      el("div", {}, el("h3", { textContent: "Loss" }), parts.loss, parts.held, parts.scores),
      el("div", {}, el("h3", { textContent: "The newest checkpoint" }), parts.preview.element, el("h3", { textContent: "Log" }), parts.log)),
  );
  new ResizeObserver(() => watched?.state && draw()).observe(parts.loss);
}

async function ask() {
  const mine = watched;
  try {
    const training = (after) => getJson(`/api/runs/${mine.run}/training?after=${after}`);
    let answer = await training(mine.next);
    if (mine.state && mine.state.begun !== answer.begun) answer = await training(0); // started over meanwhile
    if (mine !== watched) return;
    if (answer.from === 0) mine.records = [];
    mine.records.push(...answer.records);
    [mine.next, mine.state] = [answer.next, answer];
    draw();
    parts.preview.update(mine.run, answer);
  } catch (error) {
    if (!(error instanceof ServerLost)) say(error.message, { key: "training" });
  }
  if (mine === watched && !$("page-training").hidden) timer = setTimeout(document.hidden ? later : ask, EVERY);
}

function later() {
  timer = setTimeout(document.hidden ? later : ask, EVERY);
}

function draw() {
  const now = watched.state;
  const finished = now.phases.every((phase) => phase.finished);
  const words = finished ? "Finished" : now.running ? "In training" : now.records.length || watched.records.length ? "Not in training now" : "Not begun";
  parts.head.replaceChildren(el("h2", { textContent: `${state.session.runs[watched.run].name}: ${words}` }));
  const loss = [...watched.records].reverse().find((record) => record.loss !== undefined);
  const score = [...watched.records].reverse().find((record) => record.held_out !== undefined);
  parts.numbers.replaceChildren(el("dl", { className: "numbers" },
    number("Time left in this phase", now.running ? duration(now.seconds_left) : "–"),
    number("Loss", loss ? loss.loss.toPrecision(3) : "–"),
    number("Held-out photos", score ? `${Math.max(score.held_out, score.held_out_before).toFixed(2)} dB` : finished ? "–" : "after the second pass"),
    number("Trained for", duration(now.phases.reduce((sum, phase) => sum + (phase.seconds ?? 0), 0)))));
  parts.bars.replaceChildren(el("div", { className: "stages" }, ...now.phases.flatMap(bar)));
  drawChart(parts.loss, ["decompose", "distill"].map(series).filter((one) => one.points.length), { log: watched.records.every((record) => record.loss === undefined || record.loss > 0) });
  const scores = watched.records.filter((record) => record.held_out !== undefined);
  parts.held.hidden = scores.length === 0;
  drawChart(parts.quality, scores.length ? [{ name: "held out", points: [[0, scores[0].held_out_before], ...scores.map((record) => [record.step, record.held_out])].slice(scores[0].step ? 0 : 1) }] : []);
  parts.scores.replaceChildren(...now.verdicts.map(quiet), ...evaluation(now.evaluation));
  parts.log.textContent = now.log.join("\n");
}

function series(phase) {
  return { name: phase === "decompose" ? "Phase I" : "Phase II", points: watched.records.filter((record) => record.phase === phase && record.loss !== undefined).map((record) => [record.step, record.loss]) };
}

const quiet = (textContent) => el("p", { className: "quiet", textContent });

const number = (term, value) => el("div", {}, el("dt", { textContent: term }), el("dd", { textContent: value }));

function bar({ name, steps, step, finished }) {
  const words = finished ? "done" : steps ? `${step} of ${steps}` : "not begun";
  return [el("span", { textContent: NAMES[name] }), el("progress", { max: Math.max(steps, 1), value: finished ? Math.max(steps, 1) : step, "aria-label": NAMES[name] }), el("span", { textContent: words })];
}

function evaluation(scores) {
  const known = [["psnr_masked", "the object's PSNR"], ["psnr_unseen", "on pixels not fitted"], ["psnr", "of whole photos"]].filter(([key]) => typeof scores[key] === "number");
  return known.length ? [quiet(`Evaluated: ${known.map(([key, word]) => `${word} ${scores[key].toFixed(2)} dB`).join(", ")}.`)] : [];
}
