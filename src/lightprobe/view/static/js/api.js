// What is asked of the server. A refusal is an Error whose message is the server's sentence.

const OWN = { "X-Lightprobe": "1" };
const LOST = "The server does not answer. Start `lightprobe view` again; this page goes on when it is back.";

export class Refusal extends Error {}
export class ServerLost extends Error {
  constructor() {
    super(LOST);
  }
}

async function refusalOf(response) {
  try {
    return new Refusal((await response.json()).sentence ?? `The server answered ${response.status}.`);
  } catch {
    return new Refusal(`The server answered ${response.status}.`);
  }
}

async function request(path, options = {}) {
  let response;
  try {
    response = await fetch(path, { ...options, headers: { ...OWN, ...options.headers } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ServerLost();
  }
  if (!response.ok) throw await refusalOf(response);
  return response;
}

export const getJson = async (path, options) => (await request(path, options)).json();

export async function sendJson(method, path, value) {
  const headers = { "Content-Type": "application/json" };
  return (await request(path, { method, headers, body: value === undefined ? undefined : JSON.stringify(value) })).json();
}

export const sendBytes = async (method, path, body) => (await request(path, { method, body })).json();

export const getBytes = async (path) => (await request(path)).arrayBuffer();

/** Return an environment map: half floats R, G, B, 1 from the bottom row up, its height, and their scale. */
export async function getLight(path) {
  const response = await request(path);
  const [height, scale] = ["x-height", "x-scale"].map((name) => Number(response.headers.get(name)));
  return { data: new Uint16Array(await response.arrayBuffer()), height, scale };
}

/** Send a file, refused here if it is larger than `limit` bytes; `onShare` hears how much of it has gone. */
export function upload(path, file, limit, onShare = () => {}) {
  if (limit && file.size > limit) {
    return Promise.reject(
      new Refusal(`${file.name} is too large: at most ${Math.floor(limit / 2 ** 20)} MB are taken; choose a smaller file.`),
    );
  }
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    request.setRequestHeader("X-Lightprobe", "1");
    request.setRequestHeader("X-File-Name", encodeURIComponent(file.name));
    request.upload.addEventListener("progress", (event) => onShare(event.loaded / Math.max(event.total, 1)));
    request.addEventListener("error", () => reject(new ServerLost()));
    request.addEventListener("load", () => {
      let answer = {};
      try {
        answer = JSON.parse(request.responseText);
      } catch {
        /* not ours: said below */
      }
      if (request.status < 300) resolve(answer);
      else reject(new Refusal(answer.sentence ?? `The server answered ${request.status}.`));
    });
    request.send(file);
  });
}

/** Follow a task to its end, telling `onTask` of each state; returns it, or throws its sentence.
 *
 * The task goes on without this page: one that cannot be asked after now is asked after again. */
export async function follow(task, onTask = () => {}) {
  while (task.state === "waiting" || task.state === "running") {
    onTask(task);
    await new Promise((done) => setTimeout(done, 250));
    try {
      task = await getJson(`/api/tasks/${task.id}`);
    } catch (error) {
      if (!(error instanceof ServerLost)) throw error;
    }
  }
  onTask(task);
  if (task.state === "failed") throw new Refusal(task.sentence);
  return task;
}

export const taskFile = (task, name, save = false) => `/api/tasks/${task.id}/files/${name}${save ? "?save=true" : ""}`;
