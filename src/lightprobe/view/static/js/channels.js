// One channel of a material instead of its light, as three.js computes it: textures and normal map included.

const AS_SHOWN = (value) => `sRGBTransferEOTF(vec4(${value}, 1.0)).rgb`; // undone when the picture is encoded
const CHANNELS = {
  base: "diffuseColor.rgb",
  roughness: AS_SHOWN("vec3(roughnessFactor)"),
  metallic: AS_SHOWN("vec3(metalnessFactor)"),
  normal: AS_SHOWN("0.5 + 0.5 * lightprobeUp(inverseTransformDirection(normal, viewMatrix))"),
};
const UP = "vec3 lightprobeUp(vec3 n) { return vec3(n.x, -n.z, n.y); }\n"; // three.js' y-up to the files' z-up

/** Return a material that shows a channel of another. */
export function channelMaterial(material, channel) {
  const shown = material.clone();
  shown.toneMapped = false;
  shown.onBeforeCompile = (shader) => {
    const end = "#include <opaque_fragment>";
    shader.fragmentShader = shader.fragmentShader
      .replace("void main()", `${UP}void main()`)
      .replace(end, `outgoingLight = ${CHANNELS[channel]};\n${end}`);
  };
  shown.customProgramCacheKey = () => channel;
  return shown;
}
