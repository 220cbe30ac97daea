// The time of the replay: it runs while playing, at a speed, and stops or starts again at the end.

export const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8];
const SLACK = 1e-9; // relative to the time between two frames

export class Player {
  constructor(times, changed) {
    this.times = times;
    this.start = times[0];
    this.end = times[times.length - 1];
    this.time = this.start;
    this.speed = 1;
    this.isPlaying = false;
    this.isLooping = true;
    this.changed = changed;
  }

  // The last frame that is not after the time.
  get frame() {
    let low = 0;
    let high = this.times.length - 1;
    const limit = this.time + SLACK * (this.end - this.start);
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= limit) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  play(isPlaying) {
    if (isPlaying && this.time >= this.end) this.time = this.start;
    this.isPlaying = isPlaying && this.end > this.start;
    this.changed();
  }

  seek(time) {
    this.time = Math.max(this.start, Math.min(this.end, time));
    this.changed();
  }

  // Stops at a frame, counted from the shown one.
  step(frames) {
    this.isPlaying = false;
    const { frame } = this;
    const isBetween = this.time - this.times[frame] > SLACK * (this.end - this.start);
    const next = frame + frames + (frames < 0 && isBetween ? 1 : 0);
    this.seek(this.times[Math.max(0, Math.min(this.times.length - 1, next))]);
  }

  advance(seconds) {
    if (!this.isPlaying) return;
    this.time += seconds * this.speed;
    if (this.time < this.end) return;
    this.time = this.isLooping ? this.start : this.end;
    this.isPlaying = this.isLooping;
    if (!this.isPlaying) this.changed();
  }
}
