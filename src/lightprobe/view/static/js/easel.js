// A photo with a mask over it that is painted by pointer or keys, or with a box drawn on it.

import { el } from "./dom.js";

const TINT = [240, 195, 106];
const UNDO = 12; // steps that can be taken back
const DRAWN = 900; // pixels of the longer side of the canvas that is painted on, at least

export class Easel {
  constructor() {
    this.photo = el("img", { alt: "" });
    this.canvas = el("canvas", { tabIndex: 0, "aria-label": "Mask. Paint with the pointer, or with arrow keys and Space." });
    this.element = el("div", { className: "easel" }, this.photo, this.canvas);
    this.size = 18;
    this.mode = "paint";
    [this.layer, this.history, this.box] = [null, [], null];
    this.changed = this.locked = false; // locked: nothing is taken
    this.onSize = this.onBox = this.onClick = () => {};
    this.canvas.addEventListener("pointerdown", (event) => this.#down(event));
    this.canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => this.#up());
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    this.canvas.addEventListener("blur", () => this.#draw());
  }

  /** Show nothing that could be painted on or saved. */
  clear() {
    this.opening = null;
    [this.layer, this.pen, this.history, this.box, this.corner] = [null, null, [], null, null];
    this.changed = this.down = false;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.onBox(null);
  }

  /** Show a photo and its mask, none where `mask` is null. Returns whether it is shown: not if another was asked for. */
  async open(photo, mask, name) {
    this.clear();
    const opening = (this.opening = {});
    let given = null;
    try {
      this.photo.src = photo;
      this.photo.alt = `The photo ${name}`;
      await this.photo.decode();
      if (mask) given = await decoded(mask);
    } catch (error) {
      if (opening === this.opening) throw new Error(`The photo ${name} or its mask cannot be shown: ${error.message}`);
    }
    if (opening !== this.opening) return false;
    const [width, height] = given ? [given.width, given.height] : fitted(this.photo.naturalWidth, this.photo.naturalHeight);
    this.layer = new OffscreenCanvas(width, height); // white with the mask as its alpha
    this.pen = this.layer.getContext("2d", { willReadFrequently: true });
    if (given) {
      this.pen.drawImage(given, 0, 0);
      const data = this.pen.getImageData(0, 0, width, height);
      for (let i = 0; i < data.data.length; i += 4) {
        data.data[i + 3] = data.data[i];
        [data.data[i], data.data[i + 1], data.data[i + 2]] = TINT;
      }
      this.pen.putImageData(data, 0, 0);
    }
    [this.canvas.width, this.canvas.height] = [width, height];
    this.cursor = [width / 2, height / 2];
    this.#draw();
    return true;
  }

  setMode(mode) {
    this.mode = mode;
    this.#draw();
  }

  /** Set one edge of the box, in shares of the photo: left, top, right, bottom. */
  setEdge(index, share) {
    if (!this.layer) return;
    this.box ??= [0, 0, 1, 1];
    this.box[index] = Math.min(Math.max(share, 0), 1);
    this.onBox(this.box);
    this.#draw();
  }

  undo() {
    const before = this.history.pop();
    if (!before) return;
    this.pen.putImageData(before.pixels, 0, 0);
    this.changed = before.changed;
    this.#draw();
  }

  /** Return the mask as PNG, the object white. */
  async mask() {
    const { width, height } = this.layer;
    const flat = new OffscreenCanvas(width, height);
    const pen = flat.getContext("2d");
    const data = this.pen.getImageData(0, 0, width, height);
    for (let i = 0; i < data.data.length; i += 4) {
      data.data[i] = data.data[i + 1] = data.data[i + 2] = data.data[i + 3];
      data.data[i + 3] = 255;
    }
    pen.putImageData(data, 0, 0);
    return flat.convertToBlob({ type: "image/png" });
  }

  #place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * this.canvas.width, ((event.clientY - box.top) / box.height) * this.canvas.height];
  }

  #down(event) {
    if (!this.layer || this.locked || event.button > 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.cursor = this.#place(event);
    if (this.#clicks) this.#click();
    else if (this.mode === "box") this.corner = this.cursor;
    else {
      this.#remember();
      this.#stroke(this.cursor, this.cursor);
    }
    this.down = !this.#clicks;
  }

  #move(event) {
    if (!this.layer) return;
    const place = this.#place(event);
    if (this.down && this.mode === "box") this.#stretch(place);
    else if (this.down) this.#stroke(this.cursor, place);
    this.cursor = place;
    this.#draw();
  }

  #up() {
    this.down = false;
    this.corner = null;
  }

  #remember() {
    this.history.push({ pixels: this.pen.getImageData(0, 0, this.layer.width, this.layer.height), changed: this.changed });
    if (this.history.length > UNDO) this.history.shift();
  }

  #stretch([x, y]) {
    const [w, h] = [this.canvas.width, this.canvas.height];
    const share = (value) => Math.min(Math.max(value, 0), 1);
    const [ax, ay, bx, by] = [this.corner[0] / w, this.corner[1] / h, x / w, y / h].map(share);
    this.box = [Math.min(ax, bx), Math.min(ay, by), Math.max(ax, bx), Math.max(ay, by)];
    this.onBox(this.box);
  }

  get #clicks() {
    return this.mode === "object" || this.mode === "other";
  }

  /** Tell of a click: its place in shares of the photo, and whether the object is there. */
  #click() {
    const share = (value) => Math.min(Math.max(value, 0), 1);
    this.onClick([share(this.cursor[0] / this.canvas.width), share(this.cursor[1] / this.canvas.height)], this.mode === "object");
  }

  get #radius() {
    return (this.size / 400) * Math.max(this.canvas.width, this.canvas.height);
  }

  #stroke(from, to) {
    this.pen.globalCompositeOperation = this.mode === "erase" ? "destination-out" : "source-over";
    this.pen.strokeStyle = `rgb(${TINT.join(" ")})`;
    [this.pen.lineCap, this.pen.lineWidth] = ["round", 2 * this.#radius];
    this.pen.beginPath();
    this.pen.moveTo(...from);
    this.pen.lineTo(to[0] + 0.01, to[1]);
    this.pen.stroke();
    this.pen.globalCompositeOperation = "source-over";
    this.changed = true;
    this.#draw();
  }

  #key(event) {
    if (!this.layer || this.locked) return;
    const step = Math.max(this.#radius / 2, 2);
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (moves) this.#step(moves, step);
    else if (event.key === " ") this.#space();
    else if (event.key === "[" || event.key === "]") this.onSize((this.size = Math.min(Math.max(this.size + (event.key === "]" ? 4 : -4), 1), 100)));
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) this.undo();
    else return;
    event.preventDefault();
    this.#draw();
  }

  #step([dx, dy], step) {
    this.cursor = [Math.min(Math.max(this.cursor[0] + dx * step, 0), this.canvas.width), Math.min(Math.max(this.cursor[1] + dy * step, 0), this.canvas.height)];
    if (this.corner) this.#stretch(this.cursor);
  }

  #space() {
    if (this.#clicks) this.#click();
    else if (this.mode === "box") this.corner = this.corner ? null : this.cursor;
    else {
      this.#remember();
      this.#stroke(this.cursor, this.cursor);
    }
  }

  #draw() {
    if (!this.layer) return;
    const pen = this.canvas.getContext("2d");
    const [w, h] = [this.canvas.width, this.canvas.height];
    pen.clearRect(0, 0, w, h);
    pen.globalAlpha = 0.5;
    pen.drawImage(this.layer, 0, 0);
    pen.globalAlpha = 1;
    pen.lineWidth = Math.max(w / 400, 1.5);
    if (this.box) {
      pen.strokeStyle = "#7fb2e5";
      pen.strokeRect(this.box[0] * w, this.box[1] * h, (this.box[2] - this.box[0]) * w, (this.box[3] - this.box[1]) * h);
    }
    pen.strokeStyle = this.mode === "erase" || this.mode === "other" ? "#ff8d7a" : "#ffffff";
    pen.beginPath();
    if (this.mode === "box" || this.#clicks) {
      pen.moveTo(this.cursor[0], 0);
      pen.lineTo(this.cursor[0], h);
      pen.moveTo(0, this.cursor[1]);
      pen.lineTo(w, this.cursor[1]);
      pen.globalAlpha = 0.4;
    } else pen.arc(...this.cursor, this.#radius, 0, 2 * Math.PI);
    pen.stroke();
    pen.globalAlpha = 1;
  }
}

async function decoded(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return createImageBitmap(image);
}

function fitted(width, height) {
  const scale = Math.max(DRAWN / Math.max(width, height), 1);
  return [Math.round(width * scale), Math.round(height * scale)];
}
