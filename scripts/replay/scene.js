// The scene of a replay: bodies that move, their geoms drawn in batches, and collision geoms over them.

import {
  BufferAttribute,
  Group,
  InstancedMesh,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  Raycaster,
  Skeleton,
  SkinnedMesh,
  Vector2,
  Vector3,
} from "three";
import { fadeGround } from "./ground.js";
import { Motion } from "./motion.js";
import { Space } from "./space.js";

const SIGNS = ["site", "tendon", "joint", "actuator", "contact", "decoration"]; // kinds of nodes
const INSTANTS = 48; // at which the space of the motion is measured
const SPHERES = 12000; // for which it is, in total

export class ReplayScene {
  // `frames` is the number of frames of the clip.
  constructor({ nodes, roots, clip }, frames) {
    this.root = new Group();
    this.root.add(...roots);
    this.world = roots[0];
    this.nodes = nodes;
    this.frames = frames;
    this.bodies = nodes.filter((node) => node.userData.kind === "body");
    this.shots = nodes.filter((node) => node.lens && node.userData.kind === "shot");
    this.cameras = [...this.shots, ...nodes.filter((node) => node.lens && node.userData.kind !== "shot")];
    this.batches = [];
    this.collisions = null;
    const deform = new Map();
    this.build(deform);
    this.motion = new Motion(clip, deform);
    this.moving = new Set(clip.map((channel) => channel.node));
    for (const node of nodes) node.matrixAutoUpdate = this.moving.has(node);
    for (const node of nodes) node.updateMatrix();
  }

  // Puts geoms of the same mesh and material into one batch; transparent, deformed and ground geoms are drawn singly.
  build(deform) {
    const groups = new Map();
    for (const node of this.nodes) {
      if (isHidden(node)) continue;
      for (const primitive of node.primitives) {
        if (isPlane(node)) this.addGround(node, primitive);
        else if (primitive.isLines) this.addLines(node, primitive);
        else if (node.skin) this.addSkinned(node, primitive);
        else if (primitive.targets.length) deform.set(node, this.addDeformed(node, primitive));
        else if (primitive.material.transparent) this.addSingle(node, primitive.geometry, primitive.material);
        else if (groups.has(primitive)) groups.get(primitive).push(node);
        else groups.set(primitive, [node]);
      }
    }
    for (const [{ geometry, material }, nodes] of groups) this.batches.push(batch(geometry, material, nodes));
    for (const { mesh } of this.batches) {
      mesh.castShadow = mesh.receiveShadow = true;
      this.root.add(mesh);
    }
  }

  addSingle(node, geometry, material) {
    const mesh = new Mesh(geometry, material);
    mesh.castShadow = !material.transparent || material.opacity > 0.4;
    mesh.receiveShadow = true;
    node.add(mesh);
    return mesh;
  }

  addGround(node, { geometry, material }) {
    const mesh = this.addSingle(node, geometry, fadeGround(material));
    mesh.castShadow = false;
    mesh.renderOrder = -1;
    mesh.isGround = true;
    this.ground = mesh;
  }

  addLines(node, { geometry, material }) {
    const lines = new LineSegments(geometry, new LineBasicMaterial({ color: material.color }));
    lines.raycast = () => {}; // which finds lines at a distance of a metre
    node.add(lines);
  }

  addSkinned(node, { geometry, material }) {
    const mesh = new SkinnedMesh(geometry, material);
    mesh.bind(new Skeleton(node.skin.joints, node.skin.inverses), new Matrix4());
    mesh.frustumCulled = false;
    mesh.castShadow = mesh.receiveShadow = true;
    node.add(mesh);
    node.measured = () => {
      mesh.skeleton.update();
      mesh.computeBoundingSphere();
      return mesh.boundingSphere;
    };
  }

  // Returns the function that moves the vertices of a mesh: at most two targets differ from 0 between two frames.
  addDeformed(node, { geometry, material, targets }) {
    const own = geometry.clone();
    const base = { position: geometry.attributes.position.array, normal: geometry.attributes.normal.array };
    const position = new BufferAttribute(base.position.slice(), 3);
    const normal = new BufferAttribute(base.normal.slice(), 3);
    own.setAttribute("position", position);
    own.setAttribute("normal", normal);
    const mesh = this.addSingle(node, own, material);
    mesh.frustumCulled = false;
    const count = targets.length;
    node.measured = () => {
      own.computeBoundingSphere();
      return own.boundingSphere;
    };
    return (values, index, share) => {
      position.array.set(base.position);
      normal.array.set(base.normal);
      let hasNormals = true;
      for (let i = 0; i < count; i++) {
        const first = values[index * count + i];
        const weight = share ? first + share * (values[(index + 1) * count + i] - first) : first;
        if (!weight) continue;
        addScaled(position.array, targets[i].position, weight);
        if (targets[i].normal) addScaled(normal.array, targets[i].normal, weight);
        else hasNormals = false;
      }
      position.needsUpdate = normal.needsUpdate = true;
      if (!hasNormals) own.computeVertexNormals();
    };
  }

  // Moves everything to its pose at a frame, or at a share of the way to the next one.
  pose(frame, share) {
    this.motion.apply(frame, share);
    this.root.updateMatrixWorld();
    for (const each of this.batches) place(each);
    if (this.collisions?.visible) this.collisions.batches.forEach(place);
  }

  get isMetallic() {
    return this.nodes.some((node) => node.primitives.some(({ material }) => material.metalness > 0));
  }

  get hasCollisions() {
    return this.nodes.some(isCollision);
  }

  showCollisions(shown, color) {
    if (shown && !this.collisions) this.collisions = this.buildCollisions();
    if (!this.collisions) return;
    this.collisions.visible = shown;
    if (!shown) return;
    this.collisions.materials.forEach((material) => material.color.set(color));
    this.root.updateMatrixWorld();
    this.collisions.batches.forEach(place);
  }

  buildCollisions() {
    const fill = new MeshBasicMaterial({ transparent: true, opacity: 0.16, depthWrite: false, polygonOffset: true, polygonOffsetFactor: -1 });
    const wires = new MeshBasicMaterial({ transparent: true, opacity: 0.5, wireframe: true, depthWrite: false });
    const groups = new Map();
    for (const node of this.nodes) {
      if (!isCollision(node)) continue;
      for (const { geometry } of node.primitives) {
        if (groups.has(geometry)) groups.get(geometry).push(node);
        else groups.set(geometry, [node]);
      }
    }
    const group = new Group();
    group.materials = [fill, wires];
    group.batches = [];
    for (const [geometry, nodes] of groups) {
      for (const material of group.materials) {
        const each = batch(geometry, material, nodes);
        each.mesh.renderOrder = 2;
        group.batches.push(each);
        group.add(each.mesh);
      }
    }
    this.root.add(group);
    return group;
  }

  // Returns the body of a node.
  bodyOf(node) {
    for (let each = node; each; each = each.parent) if (each.userData.kind === "body") return each;
    return null;
  }

  // Returns the body below a point of the image, in normalized device coordinates; null if there is none, or if an opaque
  // geom of the world hides it.
  pick(x, y, camera) {
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2(x, y), camera);
    for (const each of this.batches) each.mesh.computeBoundingSphere();
    const targets = this.root.children.filter((child) => child !== this.collisions);
    for (const hit of caster.intersectObjects(targets)) {
      const each = this.batches.find(({ mesh }) => mesh === hit.object);
      const node = each ? each.nodes[hit.instanceId] : hit.object.parent;
      const body = this.bodyOf(node);
      if (body) return { body, point: hit.point };
      if (node.userData.kind === "geom" && !hit.object.material.transparent) return null;
    }
    return null;
  }

  // Measures the space in which things move, as spheres around geoms at some frames, and of what rests among them.
  measure() {
    const moves = (node) => node && (this.moving.has(node) || moves(node.parent) || node.skin?.joints.some(moves));
    const drawn = this.nodes.filter((node) => node.primitives.length && isPart(node) && !isHidden(node) && !isPlane(node));
    const moving = drawn.filter(moves);
    const subjects = moving.length ? moving : drawn;
    const carrier = this.mainBody();
    const most = Math.max(2, Math.min(INSTANTS, SPHERES / (subjects.length || 1)));
    const step = Math.max(1, Math.floor(this.frames / most));
    const instants = [];
    for (let frame = 0; frame < this.frames; frame += step) {
      this.motion.apply(frame, 0);
      this.root.updateMatrixWorld();
      const origin = carrier ? new Vector3().setFromMatrixPosition(carrier.matrixWorld) : new Vector3();
      instants.push({ origin, spheres: spheresOf(subjects) });
    }
    return new Space(instants, spheresOf(drawn.filter((node) => !subjects.includes(node))), carrier);
  }

  // Returns the moving body that carries at least half of all that move: what a camera follows; null if there is none.
  mainBody() {
    const byName = new Map(this.bodies.map((body) => [body.name, body]));
    const carried = new Map();
    let count = 0;
    for (const body of this.bodies) {
      let root = null;
      for (let each = body; each; each = byName.get(each.userData.parent)) if (this.moving.has(each)) root = each;
      if (!root) continue;
      count++;
      carried.set(root, (carried.get(root) || 0) + 1);
    }
    return [...carried.keys()].find((root) => 2 * carried.get(root) >= count) ?? null;
  }
}

function spheresOf(nodes) {
  return nodes.flatMap((node) => {
    const spheres = node.measured ? [node.measured()] : node.primitives.map(({ geometry }) => geometry.boundingSphere);
    return spheres.map((sphere) => sphere.clone().applyMatrix4(node.matrixWorld));
  });
}

// Whether a node is a part of the model, not a sign for a contact or a force.
function isPart(node) {
  return !SIGNS.includes(node.userData.kind);
}

function isPlane(node) {
  return node.userData.type === "plane";
}

function isHidden(node) {
  return node.userData.visible === false;
}

function isCollision(node) {
  return ["collision", "both"].includes(node.userData.layer) && !isPlane(node);
}

function batch(geometry, material, nodes) {
  const mesh = new InstancedMesh(geometry, material, nodes.length);
  mesh.frustumCulled = false;
  return { mesh, nodes };
}

function place({ mesh, nodes }) {
  const { array } = mesh.instanceMatrix;
  for (let i = 0; i < nodes.length; i++) nodes[i].matrixWorld.toArray(array, i * 16);
  mesh.instanceMatrix.needsUpdate = true;
}

function addScaled(array, other, factor) {
  for (let i = 0; i < array.length; i++) array[i] += factor * other[i];
}
