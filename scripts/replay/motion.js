// The pose of a scene at an instant, between frames as glTF interpolates: positions along lines, rotations along arcs.

import { Quaternion } from "three";

const SIZES = { translation: 3, rotation: 4, scale: 3 };
const a = new Quaternion();
const b = new Quaternion();

// Returns the index of the last of increasing times that is not after `time`, and the share of the way to the next one.
export function locate(times, time) {
  let low = 0;
  let high = times.length - 1;
  if (time <= times[0]) return [0, 0];
  if (time >= times[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return [low, (time - times[low]) / (times[high] - times[low])];
}

export class Motion {
  // `deform` maps nodes to functions that take the weights of targets in all rows, the row and the share.
  constructor(clip, deform) {
    this.clip = clip;
    this.deform = deform;
  }

  // Moves the nodes to their poses at a frame, or at a share of the way to the next one.
  apply(frame, share) {
    for (const channel of this.clip) {
      const between = channel.isStep ? 0 : share;
      const [row, part] = channel.frames ? locate(channel.frames, frame + between) : [frame, between];
      const within = channel.isStep ? 0 : part;
      if (channel.path === "weights") this.deform.get(channel.node)?.(channel.values, row, within);
      else move(channel, row, within);
    }
  }
}

function move({ node, path, values }, row, share) {
  const size = SIZES[path];
  const start = row * size;
  if (path === "rotation") {
    a.fromArray(values, start);
    if (share) a.slerp(b.fromArray(values, start + size), share);
    node.quaternion.copy(a);
    return;
  }
  const property = path === "scale" ? node.scale : node.position;
  property.fromArray(values, start);
  if (!share) return;
  property.x += (values[start + 3] - property.x) * share;
  property.y += (values[start + 4] - property.y) * share;
  property.z += (values[start + 5] - property.z) * share;
}
