// Loads a GLB with Babylon.js and prints what its loader makes of EXT_lights_image_based, as JSON: node babylon_light.mjs FILE
// Without a GPU: where the loader hands faces and harmonics over to one, they are kept.
import { readFileSync } from "node:fs";
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { SceneLoader } from "@babylonjs/core/Loading/sceneLoader.js";
import { InternalTexture } from "@babylonjs/core/Materials/Textures/internalTexture.js";
import { RawCubeTexture } from "@babylonjs/core/Materials/Textures/rawCubeTexture.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/2.0/index.js";

const engine = new NullEngine();
const kept = {};
engine.createRawCubeTexture = () => new InternalTexture(engine, 0, true);
RawCubeTexture.prototype.updateRGBDAsync = async (levels, polynomial) => void Object.assign(kept, { levels, polynomial });

const scene = new Scene(engine);
const data = `data:model/gltf-binary;base64,${readFileSync(process.argv[2]).toString("base64")}`;
await SceneLoader.AppendAsync("", data, scene, undefined, ".glb");
const texture = scene.environmentTexture;
const harmonics = kept.polynomial.preScaledHarmonics;
const names = ["l00", "l1_1", "l10", "l11", "l2_2", "l2_1", "l20", "l21", "l22"];
const answer = {
  levels: kept.levels.map((faces) => faces.map((png) => Buffer.from(png).toString("base64"))),
  intensity: texture.level,
  turn: [...texture.getReflectionTextureMatrix().m],
  world: [...scene.meshes[0].computeWorldMatrix(true).m],
  opposite_z: scene.useRightHandedSystem ? !texture.invertZ : texture.invertZ, // as its materials decide
  harmonics: names.map((name) => harmonics[name].asArray()),
  meshes: scene.meshes.length,
};
process.stdout.write(JSON.stringify(answer), () => process.exit(0));
