// The camera: a free one that turns around a point, or one of the model; the mouse, touch and body that move it.

import { OrthographicCamera, PerspectiveCamera, Quaternion, Vector3 } from "three";
import { direction } from "./space.js";

const FIELD = (38 * Math.PI) / 180; // of the free camera, vertical [rad]
const MARGIN = 1.06;
const NARROWEST = 4 / 3; // narrower images of a camera of the model show the width of this one
const STEEPEST = 1.55; // elevation [rad]
const SETTLED = 1e-4;
const position = new Vector3();
const offset = new Vector3();
const right = new Vector3();
const up = new Vector3();
const turn = new Quaternion();

export class View {
  constructor(element, size) {
    this.element = element;
    this.size = size;
    this.perspective = new PerspectiveCamera();
    this.orthographic = new OrthographicCamera();
    this.camera = this.perspective;
    this.model = null;
    this.followed = null;
    this.followedPosition = new Vector3();
    this.goal = { azimuth: 0, elevation: 0, distance: 1, target: new Vector3() };
    this.now = { ...this.goal, target: new Vector3() };
    this.pointers = new Map();
    this.inset = 0; // pixels on the right that are covered
    this.changed = () => {};
    this.tapped = () => {};
    this.isCalm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.listen();
  }

  // Looks at a space from a direction; follows the body in it that travels, if any.
  frame(space, azimuth, elevation) {
    const clear = this.aspect * (1 - this.inset / this.element.clientWidth);
    const { target, distance } = space.fit(azimuth, elevation, FIELD, clear);
    this.follow(space.isTravelling ? space.carrier : null);
    Object.assign(this.goal, { azimuth, elevation, distance: MARGIN * distance });
    this.goal.target.copy(target);
    if (this.followed) this.goal.target.add(this.followedPosition);
    this.jump();
  }

  jump() {
    const { target, ...rest } = this.goal;
    Object.assign(this.now, rest);
    this.now.target.copy(target);
  }

  get aspect() {
    return (this.element.clientWidth || 1) / (this.element.clientHeight || 1);
  }

  // Looks through a camera of the model, or freely again if it is null.
  choose(node) {
    this.model = node;
    this.changed();
  }

  follow(body) {
    this.followed = body;
    if (!body) return;
    body.getWorldPosition(this.followedPosition);
    this.changed();
  }

  // Moves the target onto the followed body.
  center() {
    if (this.followed) this.goal.target.copy(this.followedPosition);
  }

  // Takes the free camera to where the camera of the model is, to turn around a point at the depth of `subject`, which
  // keeps its size in the image.
  takeOver(subject) {
    const { goal, model } = this;
    model.getWorldPosition(position);
    offset.set(0, 0, 1).applyQuaternion(model.getWorldQuaternion(turn));
    const depth = Math.max(position.clone().sub(subject).dot(offset), 0.05 * this.size);
    const { type, perspective, orthographic } = model.lens;
    const half = type === "orthographic" ? orthographic.ymag : depth * Math.tan(perspective.yfov / 2);
    goal.distance = (half * Math.max(1, NARROWEST / this.aspect)) / Math.tan(FIELD / 2);
    goal.target.copy(position).addScaledVector(offset, -depth);
    goal.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, Math.asin(offset.y)));
    goal.azimuth = Math.atan2(offset.z, offset.x);
    this.model = null;
    this.jump();
  }

  // Updates the camera for one image; returns whether it still moves.
  update(seconds) {
    if (this.followed) {
      this.followed.getWorldPosition(position);
      offset.copy(position).sub(this.followedPosition);
      this.goal.target.add(offset);
      this.now.target.add(offset);
      this.followedPosition.copy(position);
    }
    const moves = this.approach(this.isCalm ? 1 : 1 - Math.exp(-18 * seconds));
    if (this.model) this.updateModel();
    else this.updateFree();
    return moves && !this.model;
  }

  approach(share) {
    const { now, goal } = this;
    let rest = now.target.distanceTo(goal.target) / goal.distance;
    for (const key of ["azimuth", "elevation"]) {
      rest = Math.max(rest, Math.abs(goal[key] - now[key]));
      now[key] += share * (goal[key] - now[key]);
    }
    rest = Math.max(rest, Math.abs(Math.log(goal.distance / now.distance)));
    now.distance *= (goal.distance / now.distance) ** share;
    now.target.lerp(goal.target, share);
    if (rest < SETTLED) this.jump();
    return rest >= SETTLED;
  }

  updateFree() {
    const { azimuth, elevation, distance, target } = this.now;
    const camera = (this.camera = this.perspective);
    direction(offset, azimuth, elevation);
    camera.position.copy(target).addScaledVector(offset, distance);
    camera.up.set(0, 1, 0);
    camera.lookAt(target);
    const { clientWidth: width, clientHeight: height } = this.element;
    camera.setViewOffset(width, height, this.inset / 2, 0, width, height);
    this.project(Math.tan(FIELD / 2), Math.max(0.01 * distance, 1e-4 * this.size), 40 * (distance + this.size));
  }

  updateModel() {
    const lens = this.model.lens;
    const isFlat = lens.type === "orthographic";
    const camera = (this.camera = isFlat ? this.orthographic : this.perspective);
    this.model.matrixWorld.decompose(camera.position, camera.quaternion, offset);
    if (!isFlat) {
      camera.clearViewOffset();
      const half = Math.tan(lens.perspective.yfov / 2) * Math.max(1, NARROWEST / this.aspect);
      this.project(half, lens.perspective.znear, lens.perspective.zfar ?? 1000 * this.size);
      return;
    }
    const { ymag, znear, zfar } = lens.orthographic;
    const height = ymag * Math.max(1, NARROWEST / this.aspect);
    const width = height * this.aspect;
    Object.assign(camera, { left: -width, right: width, top: height, bottom: -height, near: znear, far: zfar });
    camera.updateProjectionMatrix();
  }

  // Sets the perspective; `half` is half the height of the image at distance 1.
  project(half, near, far) {
    Object.assign(this.camera, { fov: (360 / Math.PI) * Math.atan(half), aspect: this.aspect, near, far });
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  // --- mouse, touch and wheel

  listen() {
    const { element } = this;
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      this.pressed = { x: event.clientX, y: event.clientY, moved: this.pointers.size > 1 };
    });
    element.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, (event) => {
        this.pointers.delete(event.pointerId);
        if (name === "pointerup" && this.pressed && !this.pressed.moved && event.button === 0) this.tapped(event);
      });
    }
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const lines = event.deltaMode === 1 ? 16 : 1;
        this.zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0015)))));
      },
      { passive: false },
    );
  }

  drag(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const dx = event.clientX - last.x;
    const dy = event.clientY - last.y;
    if (Math.hypot(event.clientX - this.pressed.x, event.clientY - this.pressed.y) > 4) this.pressed.moved = true;
    if (!this.pressed.moved) return;
    const before = this.spread();
    Object.assign(last, { x: event.clientX, y: event.clientY });
    this.manual();
    if (this.pointers.size > 1) {
      this.zoom(before / this.spread());
      this.pan(dx / this.pointers.size, dy / this.pointers.size);
    } else if (event.shiftKey || event.buttons & 6) this.pan(dx, dy);
    else this.rotate(dx, dy);
  }

  spread() {
    if (this.pointers.size < 2) return 1;
    const [a, b] = this.pointers.values();
    return Math.max(10, Math.hypot(a.x - b.x, a.y - b.y));
  }

  rotate(dx, dy) {
    const { goal } = this;
    const rate = Math.PI / Math.max(240, this.element.clientHeight);
    goal.azimuth += dx * rate;
    goal.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, goal.elevation + dy * rate));
    this.changed();
  }

  pan(dx, dy) {
    const { goal } = this;
    const rate = (2 * goal.distance * Math.tan(FIELD / 2)) / this.element.clientHeight;
    direction(offset, goal.azimuth, goal.elevation);
    right.set(0, 1, 0).cross(offset).normalize();
    up.copy(offset).cross(right);
    goal.target.addScaledVector(right, -dx * rate).addScaledVector(up, dy * rate);
    this.changed();
  }

  zoom(factor) {
    this.manual();
    const distance = this.goal.distance * factor;
    this.goal.distance = Math.max(0.02 * this.size, Math.min(60 * this.size, distance));
    this.changed();
  }
}
