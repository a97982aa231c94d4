// The object of a training's newest checkpoint, in a small view of its own.

import { follow, getBytes, taskFile, sendJson } from "./api.js";
import { el } from "./dom.js";

export class CheckpointPreview {
  constructor() {
    this.canvas = el("canvas", { tabIndex: 0, "aria-label": "The newest checkpoint. Drag or use the arrow keys to turn it." });
    this.note = el("p", { className: "stage-note", textContent: "It appears with the first checkpoint." });
    this.element = el("div", { className: "preview" }, this.canvas, this.note);
    this.shown = this.asked = null;
  }

  clear() {
    this.shown = this.asked = null;
    this.note.textContent = "It appears with the first checkpoint.";
    this.viewer?.clear();
  }

  /** Show the newest checkpoint's object, or the finished one, unless it is shown already. */
  async update(run, { begun, checkpoint, object }) {
    const newest = object ? `${run}:${begun}:object` : checkpoint === null ? null : `${run}:${begun}:${checkpoint}`;
    if (this.asked !== null || newest === null || newest === this.shown) return;
    const asked = (this.asked = { run }); // another one, or none, once something else is to be shown
    const isLate = () => asked !== this.asked;
    try {
      await this.#open();
      if (object) await this.#finished(run, isLate);
      else await this.#checkpoint(run, isLate);
    } catch (error) {
      if (!isLate()) this.note.textContent = error.message; // and it is not tried again
    }
    if (isLate()) return;
    [this.shown, this.asked] = [newest, null];
  }

  async #open() {
    if (this.viewer) return;
    const [{ Viewer }, THREE] = await Promise.all([import("./viewer.js"), import("three")]);
    this.three = THREE;
    this.viewer = new Viewer(this.canvas);
    const fit = () => this.viewer.resize(this.element.clientWidth, this.element.clientHeight);
    fit();
    new ResizeObserver(fit).observe(this.element);
    const sky = new THREE.HemisphereLight(0xffffff, 0x555555, 2.2);
    const lamp = new THREE.DirectionalLight(0xffffff, 1.6);
    lamp.position.set(1, 2, 1.5);
    this.viewer.scene.add(sky, lamp);
  }

  async #finished(run, isLate) {
    const object = await this.viewer.read(`/api/runs/${run}/object.glb`);
    if (isLate()) return;
    this.viewer.setObject(object);
    this.note.textContent = "The finished object.";
  }

  async #checkpoint(run, isLate) {
    const task = await follow(await sendJson("POST", `/api/runs/${run}/preview`), (now) => {
      if (!isLate() && !this.viewer.object) this.note.textContent = now.state === "waiting" ? "Waiting for its turn…" : `${now.stage || "Starting"}…`;
    });
    const mesh = this.#mesh(await getBytes(taskFile(task, "preview.bin")));
    if (isLate()) return;
    this.viewer.setObject(mesh, { keepView: Boolean(this.viewer.object) });
    this.note.textContent = `Step ${task.result.step} (${task.result.stage}), ${task.result.faces} triangles.`;
  }

  #mesh(buffer) {
    const THREE = this.three;
    const [vertices, faces] = new Uint32Array(buffer, 0, 2);
    const [colors, corners] = [32 + 12 * vertices, 32 + 24 * vertices];
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(buffer, 32, 3 * vertices), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(buffer, colors, 3 * vertices), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(buffer, corners, 3 * faces), 1));
    geometry.computeVertexNormals();
    const mesh = new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.8, side: THREE.DoubleSide }));
    mesh.position.fromArray(new Float64Array(buffer, 8, 3));
    return mesh;
  }
}
