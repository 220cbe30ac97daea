// Ground that fades out around the motion, with lines where it has no texture.

import { Vector3 } from "three";

const uniforms = {
  fadeCenter: { value: new Vector3() },
  fadeRadius: { value: 1 },
  lineSpacing: { value: 1 },
};

// Sets the place around which ground is visible.
export function aimGround(center, radius) {
  uniforms.fadeCenter.value.copy(center);
  uniforms.fadeRadius.value = radius;
  uniforms.lineSpacing.value = 10 ** Math.floor(Math.log10(radius / 4));
}

// Returns a material for planes, from that of the model.
export function fadeGround(material) {
  const ground = material.clone();
  ground.transparent = true;
  ground.depthWrite = true;
  const hasLines = !material.map;
  ground.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nvarying vec3 groundPosition;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\ngroundPosition = (modelMatrix * vec4(transformed, 1.0)).xyz;");
    shader.fragmentShader = shader.fragmentShader
      .replace(
        "#include <common>",
        `#include <common>
        varying vec3 groundPosition;
        uniform vec3 fadeCenter;
        uniform float fadeRadius, lineSpacing;
        float groundLines(float spacing) {
          vec2 at = groundPosition.xz / spacing;
          vec2 width = fwidth(at) + 1e-4;
          vec2 lines = 1.0 - smoothstep(0.5 * width, 1.5 * width, abs(fract(at + 0.5) - 0.5));
          return max(lines.x, lines.y) * (1.0 - smoothstep(0.1, 0.5, max(width.x, width.y)));
        }`,
      )
      .replace(
        "#include <map_fragment>",
        `#include <map_fragment>
        ${hasLines ? "diffuseColor.rgb = mix(diffuseColor.rgb, vec3(dot(diffuseColor.rgb, vec3(0.33)) > 0.3 ? 0.0 : 1.0), 0.12 * groundLines(lineSpacing) + 0.1 * groundLines(10.0 * lineSpacing));" : ""}
        diffuseColor.a *= 1.0 - smoothstep(0.35, 1.0, distance(groundPosition, fadeCenter) / fadeRadius);`,
      );
  };
  ground.customProgramCacheKey = () => (hasLines ? "ground with lines" : "ground");
  return ground;
}
