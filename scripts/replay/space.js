// The space in which things move, and where a camera sees it whole.

import { Sphere, Vector3 } from "three";

const SHARE = 0.98; // of the spheres is seen: single bodies may fly away
const TRAVELS = 2; // a group that needs this many times its own size is followed
const back = new Vector3();
const right = new Vector3();
const up = new Vector3();

export class Space {
  // `instants` holds spheres around moving geoms at some frames, and the origin of the body `carrier`, which may be null;
  // `resting` holds spheres around all others.
  constructor(instants, resting, carrier) {
    const all = instants.flatMap(({ spheres }) => spheres);
    const around = instants.flatMap(({ origin, spheres }) =>
      spheres.map(({ center, radius }) => new Sphere(center.clone().sub(origin), radius)),
    );
    const sizes = instants.map(({ spheres }) => extent(spheres));
    this.size = Math.max(...sizes) || 1;
    this.isTravelling = carrier !== null && extent(all) > TRAVELS * this.size;
    this.carrier = carrier;
    this.reach = extent(all) || 1;
    this.center = new Vector3(...bounds(all).map(([low, high]) => (low + high) / 2));
    const isAmong = ({ center, radius }) => radius < this.reach && center.distanceTo(this.center) < this.reach;
    this.spheres = this.isTravelling ? around : [...all, ...resting.filter(isAmong).flatMap((each) => instants.map(() => each))];
  }

  // Writes the place around which things move now.
  locate(vector) {
    return this.isTravelling ? vector.setFromMatrixPosition(this.carrier.matrixWorld) : vector.copy(this.center);
  }

  // Returns the target and the distance from which a camera sees the space; the target is relative to a followed carrier.
  fit(azimuth, elevation, field, aspect) {
    direction(back, azimuth, elevation);
    right.set(0, 1, 0).cross(back).normalize();
    up.copy(back).cross(right);
    const target = new Vector3();
    for (const axis of [right, up, back]) {
      const lows = this.spheres.map(({ center, radius }) => center.dot(axis) - radius);
      const highs = this.spheres.map(({ center, radius }) => center.dot(axis) + radius);
      target.addScaledVector(axis, (quantile(lows, 1 - SHARE) + quantile(highs, SHARE)) / 2);
    }
    const half = Math.tan(field / 2);
    const distances = this.spheres.map(({ center, radius }) => {
      const seen = center.clone().sub(target);
      const side = (Math.abs(seen.dot(right)) + radius) / (half * aspect);
      const height = (Math.abs(seen.dot(up)) + radius) / half;
      return seen.dot(back) + Math.max(side, height);
    });
    return { target, distance: quantile(distances, SHARE) || 3 * this.size };
  }
}

// Writes the direction from the target to the camera.
export function direction(vector, azimuth, elevation) {
  const flat = Math.cos(elevation);
  return vector.set(flat * Math.cos(azimuth), Math.sin(elevation), flat * Math.sin(azimuth));
}

// Returns half the diagonal of a box around spheres.
function extent(spheres) {
  return Math.hypot(...bounds(spheres).map(([low, high]) => (high - low) / 2));
}

// Returns the lower and upper bound of spheres along x, y and z.
function bounds(spheres) {
  return ["x", "y", "z"].map((axis) => [
    quantile(spheres.map(({ center, radius }) => center[axis] - radius), 1 - SHARE),
    quantile(spheres.map(({ center, radius }) => center[axis] + radius), SHARE),
  ]);
}

// Returns the nearest of the values that is at least as far out as a share of them.
function quantile(values, share) {
  if (!values.length) return 0;
  const sorted = Float64Array.from(values).sort();
  const place = share * (sorted.length - 1);
  return sorted[share > 0.5 ? Math.ceil(place) : Math.floor(place)];
}
