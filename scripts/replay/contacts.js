// Contacts of a frame: a disc at each, and an arrow as long as its force.

import { ConeGeometry, CylinderGeometry, Group, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion, Vector3 } from "three";

const VALUES = 9; // of a contact: position [m], normal, force [N], each along x, y, z of the world
const UP = new Vector3(0, 1, 0);
const matrix = new Matrix4();
const place = new Vector3();
const along = new Vector3();
const scale = new Vector3();
const turn = new Quaternion();

export class Contacts {
  // `counts` holds the number of contacts of each frame, `values` all contacts one after another.
  constructor({ counts, values }, size) {
    this.size = size;
    this.values = values;
    this.starts = new Uint32Array(counts.length + 1);
    counts.forEach((count, i) => (this.starts[i + 1] = this.starts[i] + count));
    const most = counts.reduce((a, b) => Math.max(a, b), 0);
    this.material = new MeshBasicMaterial({ depthTest: false, transparent: true, toneMapped: false });
    this.arrowMaterial = this.material.clone();
    const instances = (geometry, material, order) => {
      const mesh = new InstancedMesh(geometry, material, Math.max(1, most));
      mesh.frustumCulled = false;
      mesh.renderOrder = order;
      return mesh;
    };
    this.discs = instances(new CylinderGeometry(1, 1, 1, 20), this.material, 4);
    this.shafts = instances(new CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0), this.arrowMaterial, 5);
    this.heads = instances(new ConeGeometry(1, 1, 16).translate(0, 0.5, 0), this.arrowMaterial, 5);
    this.arrows = new Group().add(this.shafts, this.heads);
    this.group = new Group().add(this.discs, this.arrows);
    this.strongest = this.usualForce();
    this.discs.visible = this.arrows.visible = false;
  }

  // Returns the force of the longest arrow [N]: impacts above the 98th percentile are no longer than it.
  usualForce() {
    const forces = [];
    for (let i = 0; i < this.values.length; i += VALUES) {
      const force = along.fromArray(this.values, i + 6).length();
      if (force > 0) forces.push(force);
    }
    const sorted = Float64Array.from(forces).sort();
    return sorted[Math.floor(0.98 * (sorted.length - 1))] || 0;
  }

  count(frame) {
    return this.starts[frame + 1] - this.starts[frame];
  }

  paint(discs, arrows) {
    this.material.color.set(discs);
    this.arrowMaterial.color.set(arrows);
  }

  show(frame) {
    const first = this.starts[frame];
    const count = this.count(frame);
    const width = 0.012 * this.size;
    for (let i = 0; i < count; i++) {
      const start = (first + i) * VALUES;
      place.fromArray(this.values, start);
      turn.setFromUnitVectors(UP, along.fromArray(this.values, start + 3).normalize());
      this.discs.setMatrixAt(i, matrix.compose(place, turn, scale.set(width, 0.25 * width, width)));
      const force = along.fromArray(this.values, start + 6).length();
      const length = this.strongest ? 0.45 * this.size * Math.min(1, force / this.strongest) : 0;
      const head = Math.min(0.4 * length, 3.2 * width);
      turn.setFromUnitVectors(UP, force ? along.divideScalar(force) : UP);
      this.shafts.setMatrixAt(i, matrix.compose(place, turn, scale.set(0.4 * width, length - head, 0.4 * width)));
      place.addScaledVector(along.copy(UP).applyQuaternion(turn), length - head);
      this.heads.setMatrixAt(i, matrix.compose(place, turn, scale.set(1.1 * width, head, 1.1 * width)));
    }
    for (const mesh of [this.discs, this.shafts, this.heads]) {
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
    }
  }
}
