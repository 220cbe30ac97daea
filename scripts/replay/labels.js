// Names of bodies over the image; where they would overlap, the nearer one is shown.

import { Vector3 } from "three";

const FONT = "500 12px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
const HEIGHT = 18;
const point = new Vector3();

export class Labels {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.widths = new Map();
  }

  resize(width, height) {
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    this.width = width;
    this.height = height;
    this.context.scale(ratio, ratio);
  }

  draw(bodies, camera, { ground, ink }) {
    const { context } = this;
    context.clearRect(0, 0, this.width, this.height);
    if (!bodies.length) return;
    context.font = FONT;
    context.textBaseline = "middle";
    const candidates = [];
    for (const body of bodies) {
      point.setFromMatrixPosition(body.matrixWorld).project(camera);
      if (Math.abs(point.x) > 1 || Math.abs(point.y) > 1 || Math.abs(point.z) > 1) continue;
      const x = ((point.x + 1) / 2) * this.width;
      const y = ((1 - point.y) / 2) * this.height;
      candidates.push({ name: body.name, x, y, depth: point.z });
    }
    candidates.sort((a, b) => a.depth - b.depth);
    const taken = [];
    for (const each of candidates) {
      const width = this.measure(each.name) + 12;
      const box = { left: each.x - width / 2, top: each.y - HEIGHT / 2 - 14, right: each.x + width / 2, bottom: each.y + HEIGHT / 2 - 14 };
      if (taken.some((other) => box.left < other.right && box.right > other.left && box.top < other.bottom && box.bottom > other.top)) continue;
      taken.push(box);
      context.globalAlpha = 0.88;
      context.fillStyle = ground;
      context.beginPath();
      context.roundRect(box.left, box.top, width, HEIGHT, 4);
      context.fill();
      context.globalAlpha = 1;
      context.fillStyle = ink;
      context.fillText(each.name, box.left + 6, box.top + HEIGHT / 2 + 0.5);
      context.beginPath();
      context.arc(each.x, each.y, 2, 0, 7);
      context.fill();
    }
  }

  measure(name) {
    if (!this.widths.has(name)) this.widths.set(name, this.context.measureText(name).width);
    return this.widths.get(name);
  }
}
