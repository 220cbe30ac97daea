// Reads the GLB that mjrun writes: its nodes, geometries, materials, cameras and animation.

import {
  BufferAttribute,
  BufferGeometry,
  ClampToEdgeWrapping,
  Color,
  DoubleSide,
  FrontSide,
  Matrix4,
  MeshStandardMaterial,
  MirroredRepeatWrapping,
  Object3D,
  RepeatWrapping,
  SRGBColorSpace,
  Texture,
} from "three";

const ARRAYS = {
  5120: Int8Array,
  5121: Uint8Array,
  5122: Int16Array,
  5123: Uint16Array,
  5125: Uint32Array,
  5126: Float32Array,
};
const SIZES = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 };
const ATTRIBUTES = {
  POSITION: "position",
  NORMAL: "normal",
  TEXCOORD_0: "uv",
  COLOR_0: "color",
  JOINTS_0: "skinIndex",
  WEIGHTS_0: "skinWeight",
};
const LINES = 1;
const WRAPPINGS = { 10497: RepeatWrapping, 33071: ClampToEdgeWrapping, 33648: MirroredRepeatWrapping };
const JSON_CHUNK = 0x4e4f534a;

// Returns {nodes, roots, primitives, clip}; nodes are Object3D with their glTF description as `source`.
export async function readGlb(buffer) {
  const { gltf, binary } = chunks(buffer);
  const textures = await Promise.all((gltf.textures || []).map((texture) => readTexture(gltf, binary, texture)));
  const materials = (gltf.materials || []).map((material) => readMaterial(material, textures));
  const plain = readMaterial({}, []);
  const geometries = new Map();
  const meshes = (gltf.meshes || []).map((mesh) =>
    mesh.primitives.map((primitive) => ({
      geometry: once(geometries, `${primitive.indices} ${JSON.stringify(primitive.attributes)}`, () =>
        readGeometry(gltf, binary, primitive),
      ),
      targets: (primitive.targets || []).map((target) => readTarget(gltf, binary, target)),
      material: primitive.material === undefined ? plain : materials[primitive.material],
      isLines: primitive.mode === LINES,
    })),
  );
  const nodes = (gltf.nodes || []).map((source) => readNode(gltf, source, meshes));
  gltf.nodes.forEach((source, i) => (source.children || []).forEach((child) => nodes[i].add(nodes[child])));
  gltf.nodes.forEach((source, i) => {
    if (source.skin !== undefined) nodes[i].skin = readSkin(gltf, binary, gltf.skins[source.skin], nodes);
  });
  const scene = gltf.scenes[gltf.scene || 0];
  return { nodes, roots: scene.nodes.map((i) => nodes[i]), clip: readClip(gltf, binary, nodes) };
}

function chunks(buffer) {
  const view = new DataView(buffer);
  const length = view.getUint32(12, true);
  if (view.getUint32(16, true) !== JSON_CHUNK) throw new Error("the scene is not a GLB");
  const gltf = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  return { gltf, binary: { buffer, start: 28 + length } };
}

// Returns a typed array over the numbers of an accessor, without a copy unless they are interleaved.
function readArray(gltf, binary, index) {
  const accessor = gltf.accessors[index];
  const Type = ARRAYS[accessor.componentType];
  const size = SIZES[accessor.type];
  if (accessor.bufferView === undefined) return new Type(accessor.count * size);
  const view = gltf.bufferViews[accessor.bufferView];
  const start = binary.start + (view.byteOffset || 0) + (accessor.byteOffset || 0);
  const stride = view.byteStride / Type.BYTES_PER_ELEMENT;
  if (!view.byteStride || stride === size) return new Type(binary.buffer, start, accessor.count * size);
  const spread = new Type(binary.buffer, start, (accessor.count - 1) * stride + size);
  const packed = new Type(accessor.count * size);
  for (let i = 0; i < accessor.count; i++) packed.set(spread.subarray(i * stride, i * stride + size), i * size);
  return packed;
}

function once(values, key, make) {
  if (!values.has(key)) values.set(key, make());
  return values.get(key);
}

function readAttribute(gltf, binary, index) {
  const accessor = gltf.accessors[index];
  return new BufferAttribute(readArray(gltf, binary, index), SIZES[accessor.type], accessor.normalized === true);
}

function readGeometry(gltf, binary, primitive) {
  const geometry = new BufferGeometry();
  for (const [name, index] of Object.entries(primitive.attributes)) {
    if (ATTRIBUTES[name]) geometry.setAttribute(ATTRIBUTES[name], readAttribute(gltf, binary, index));
  }
  if (primitive.indices !== undefined) geometry.setIndex(readAttribute(gltf, binary, primitive.indices));
  if (!geometry.attributes.normal && primitive.mode !== LINES) geometry.computeVertexNormals();
  geometry.computeBoundingSphere();
  return geometry;
}

// Returns the nodes that move the vertices of a skin, and the matrices from the mesh to each.
function readSkin(gltf, binary, skin, nodes) {
  const matrices = readArray(gltf, binary, skin.inverseBindMatrices);
  return {
    joints: skin.joints.map((i) => nodes[i]),
    inverses: skin.joints.map((_, i) => new Matrix4().fromArray(matrices, 16 * i)),
  };
}

function readTarget(gltf, binary, target) {
  const array = (name) => (target[name] === undefined ? null : readArray(gltf, binary, target[name]));
  return { position: array("POSITION"), normal: array("NORMAL") };
}

async function readTexture(gltf, binary, texture) {
  const image = gltf.images[texture.source];
  const view = gltf.bufferViews[image.bufferView];
  const bytes = new Uint8Array(binary.buffer, binary.start + (view.byteOffset || 0), view.byteLength);
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const result = new Texture(await createImageBitmap(new Blob([bytes], { type: image.mimeType }), options));
  const sampler = (gltf.samplers || [])[texture.sampler] || {};
  result.wrapS = WRAPPINGS[sampler.wrapS] || RepeatWrapping;
  result.wrapT = WRAPPINGS[sampler.wrapT] || RepeatWrapping;
  result.flipY = false;
  result.needsUpdate = true;
  return result;
}

function readMaterial(source, textures) {
  const pbr = source.pbrMetallicRoughness || {};
  const [r, g, b, a] = pbr.baseColorFactor || [1, 1, 1, 1];
  const material = new MeshStandardMaterial({
    name: source.name || "",
    color: new Color(r, g, b),
    opacity: a,
    metalness: pbr.metallicFactor ?? 1,
    roughness: pbr.roughnessFactor ?? 1,
    emissive: new Color(...(source.emissiveFactor || [0, 0, 0])),
    emissiveIntensity: source.extensions?.KHR_materials_emissive_strength?.emissiveStrength ?? 1,
    side: source.doubleSided ? DoubleSide : FrontSide,
    transparent: source.alphaMode === "BLEND",
    depthWrite: source.alphaMode !== "BLEND",
    alphaTest: source.alphaMode === "MASK" ? (source.alphaCutoff ?? 0.5) : 0,
  });
  material.map = readMap(pbr.baseColorTexture, textures, true);
  material.emissiveMap = readMap(source.emissiveTexture, textures, true);
  material.normalMap = readMap(source.normalTexture, textures, false);
  material.metalnessMap = material.roughnessMap = readMap(pbr.metallicRoughnessTexture, textures, false);
  material.aoMap = readMap(source.occlusionTexture, textures, false);
  return material;
}

// Returns the texture that a material refers to, repeated as KHR_texture_transform requires, or null.
function readMap(reference, textures, isColor) {
  if (!reference) return null;
  const transform = reference.extensions?.KHR_texture_transform;
  const texture = textures[reference.index].clone();
  if (isColor) texture.colorSpace = SRGBColorSpace;
  if (transform) {
    texture.repeat.set(...(transform.scale || [1, 1]));
    texture.offset.set(...(transform.offset || [0, 0]));
    texture.rotation = transform.rotation || 0;
  }
  return texture;
}

function readNode(gltf, source, meshes) {
  const node = new Object3D();
  node.name = source.name || "";
  if (source.matrix) {
    node.matrix.fromArray(source.matrix);
    node.matrix.decompose(node.position, node.quaternion, node.scale);
  } else {
    if (source.translation) node.position.fromArray(source.translation);
    if (source.rotation) node.quaternion.fromArray(source.rotation);
    if (source.scale) node.scale.fromArray(source.scale);
  }
  node.userData = source.extras || {};
  node.lens = source.camera === undefined ? null : gltf.cameras[source.camera];
  node.primitives = source.mesh === undefined ? [] : meshes[source.mesh];
  return node;
}

// Returns the channels of the first animation: the property of a node, and its values at all frames or at `frames`.
function readClip(gltf, binary, nodes) {
  const animation = (gltf.animations || [])[0];
  if (!animation) return [];
  return animation.channels.map(({ sampler, target }) => {
    const { output, interpolation, extras } = animation.samplers[sampler];
    return {
      node: nodes[target.node],
      path: target.path,
      values: readArray(gltf, binary, output),
      frames: extras?.frames,
      isStep: interpolation === "STEP",
    };
  });
}
