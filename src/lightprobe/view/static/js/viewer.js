// A scene with the object, seen from around it or by a photo's camera, drawn only when something has changed.

import * as THREE from "three";
import { OrbitControls } from "../vendor/three/controls/OrbitControls.js";
import { GLTFLoader } from "../vendor/three/loaders/GLTFLoader.js";
import { makeBalls } from "./balls.js";
import { channelMaterial } from "./channels.js";

const TONES = {
  srgb: THREE.LinearToneMapping, // exposure, then cut off at white
  neutral: THREE.NeutralToneMapping,
  agx: THREE.AgXToneMapping,
  aces: THREE.ACESFilmicToneMapping,
};
const KEY_TURN = Math.PI / 24;

export class Viewer {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "low-power" });
    this.renderer.toneMapping = TONES.srgb;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
    this.photoCamera = null;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    canvas.addEventListener("keydown", (event) => this.#key(event));
    this.object = null;
    this.balls = null;
    this.channel = "shaded";
    this.radius = 1;
    this.center = new THREE.Vector3();
  }

  /** Return the object in a GLB. */
  async read(url) {
    return (await new GLTFLoader().loadAsync(url)).scene;
  }

  /** Show no object. */
  clear() {
    this.#remove();
    this.draw();
  }

  #remove() {
    if (!this.object) return;
    this.scene.remove(this.object);
    this.object.traverse((part) => part.geometry?.dispose());
    this.object = null;
  }

  setObject(object, { keepView = false } = {}) {
    this.#remove();
    this.object = object;
    this.scene.add(object);
    const ball = new THREE.Box3().setFromObject(object).getBoundingSphere(new THREE.Sphere());
    this.center.copy(ball.center);
    this.radius = ball.radius || 1;
    this.showBalls(this.balls !== null);
    this.setChannel(this.channel);
    if (!keepView) this.freeView();
  }

  /** Look at the object from a little above. */
  freeView() {
    this.photoCamera = null;
    this.controls.enabled = true;
    this.controls.target.copy(this.center);
    const narrow = Math.min(this.camera.aspect, 1);
    const room = this.balls ? 1.3 : 0.92;
    const distance = (this.radius * room) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.camera.position.copy(this.center).add(new THREE.Vector3(0.45, 0.3, 0.84).multiplyScalar(distance));
    this.camera.near = this.radius * 0.02;
    this.camera.far = distance + this.radius * 20;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.showBalls(this.balls !== null);
    this.draw();
  }

  /** Look through a photo's camera: pose z-up with OpenGL's axes, intrinsics in pixels. */
  standAt({ camera_to_world: pose, fx, fy, cx, cy, width, height }) {
    const camera = new THREE.PerspectiveCamera();
    const [right, forth, up] = pose;
    camera.matrixAutoUpdate = false;
    camera.matrix.set(...right, ...up, ...forth.map((value) => -value), 0, 0, 0, 1);
    camera.matrix.decompose(camera.position, camera.quaternion, camera.scale);
    camera.updateMatrixWorld(true);
    const distance = camera.position.distanceTo(this.center);
    const near = Math.max(distance - 3 * this.radius, this.radius * 0.02);
    const far = distance + 20 * this.radius;
    const [left, top] = [-cx / fx, cy / fy].map((share) => share * near);
    const [last, bottom] = [(width - cx) / fx, (cy - height) / fy].map((share) => share * near);
    camera.projectionMatrix.makePerspective(left, last, top, bottom, near, far);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    this.photoCamera = camera;
    this.controls.enabled = false;
    this.showBalls(this.balls !== null);
    this.draw();
  }

  /** Fill width by height CSS pixels. */
  resize(width, height) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(Math.max(width, 1), Math.max(height, 1));
    this.camera.aspect = Math.max(width, 1) / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Light the scene by a map of half floats. */
  setLight({ data, height, scale }) {
    const texture = new THREE.DataTexture(data, 2 * height, height, THREE.RGBAFormat, THREE.HalfFloatType);
    texture.mapping = THREE.EquirectangularReflectionMapping;
    texture.magFilter = texture.minFilter = THREE.LinearFilter;
    texture.wrapS = THREE.RepeatWrapping;
    texture.needsUpdate = true;
    this.scene.environment?.dispose();
    this.scene.environment = texture;
    this.scene.environmentIntensity = this.scene.backgroundIntensity = scale;
    this.setBackground(this.background ?? "none");
  }

  setBackground(kind) {
    this.background = kind;
    this.scene.background = kind === "none" ? null : this.scene.environment;
    this.scene.backgroundBlurriness = kind === "blurred" ? 0.4 : 0;
    this.draw();
  }

  /** Turn the light about the vertical. */
  setTurn(degrees) {
    const turn = (degrees * Math.PI) / 180;
    this.scene.environmentRotation.y = this.scene.backgroundRotation.y = turn;
    this.draw();
  }

  setTone(tone, stops) {
    this.renderer.toneMapping = TONES[tone];
    this.renderer.toneMappingExposure = 2 ** stops;
    this.draw();
  }

  /** Show the lit object, or one channel of its material. */
  setChannel(channel) {
    this.channel = channel;
    this.object?.traverse((part) => {
      if (!part.isMesh) return;
      part.userData.lit ??= part.material;
      part.material = channel === "shaded" ? part.userData.lit : channelMaterial(part.userData.lit, channel);
    });
    this.draw();
  }

  showBalls(shown) {
    if (this.balls) this.scene.remove(this.balls);
    this.balls = shown ? makeBalls(this.radius, this.center, this.photoCamera ?? this.camera) : null;
    if (this.balls) this.scene.add(this.balls);
    this.draw();
  }

  draw() {
    if (this.waiting || this.lost) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.drawNow();
    });
  }

  drawNow() {
    this.renderer.render(this.scene, this.photoCamera ?? this.camera);
  }

  /** Return the picture as a PNG of width by height pixels. */
  async snapshot(width, height) {
    const size = this.renderer.getSize(new THREE.Vector2());
    const ratio = this.renderer.getPixelRatio();
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(width, height, false);
    this.drawNow();
    const blob = await new Promise((done) => this.canvas.toBlob(done, "image/png"));
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(size.x, size.y, false);
    this.drawNow();
    return blob;
  }

  #key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const zoom = { "+": 0.9, "=": 0.9, "-": 1 / 0.9 }[event.key];
    if ((!turns && !zoom) || this.photoCamera || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    const offset = this.camera.position.clone().sub(this.controls.target);
    const place = new THREE.Spherical().setFromVector3(offset);
    if (turns) {
      place.theta += turns[0] * KEY_TURN;
      place.phi = Math.min(Math.max(place.phi + turns[1] * KEY_TURN, 0.02), Math.PI - 0.02);
    }
    place.radius *= zoom ?? 1;
    this.camera.position.copy(this.controls.target).add(offset.setFromSpherical(place));
    this.controls.update();
  }
}
