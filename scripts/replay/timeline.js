// The bar under the image: a slider over time, with marks of events and assertions.

import { h } from "./dom.js";

export class Timeline {
  // `seek` gets the time that the user chooses; `grab` is called with whether the user holds the slider.
  constructor(player, marks, format, { seek, grab }) {
    this.player = player;
    this.format = format;
    this.seek = seek;
    this.grab = grab;
    this.thumb = h("div", { class: "thumb" });
    this.fill = h("div", { class: "fill" });
    marks = [...marks].sort((a, b) => (a.kind === "fail") - (b.kind === "fail")); // failures over all others
    const placed = marks.map((mark) => h("i", { class: `mark ${mark.kind}`, title: `${format(mark.time)} s  ${mark.text}` }));
    placed.forEach((element, i) => (element.style.left = `${100 * this.share(marks[i].time)}%`));
    this.track = h(
      "div",
      {
        class: "track",
        role: "slider",
        tabindex: "0",
        "aria-label": "Time in seconds",
        "aria-valuemin": player.start,
        "aria-valuemax": player.end,
      },
      h("div", { class: "rail" }, this.fill),
      ...placed,
      this.thumb,
    );
    this.cursors = [];
    this.listen(this.track);
  }

  share(time) {
    const { start, end } = this.player;
    return end > start ? (time - start) / (end - start) : 0;
  }

  // Puts the cursor over an element as wide as the slider, which then is one as well.
  attach(element) {
    const cursor = h("div", { class: "cursor" });
    element.append(cursor);
    this.cursors.push(cursor);
    this.listen(element);
  }

  listen(element) {
    const toTime = (event) => {
      const { left, width } = element.getBoundingClientRect();
      const share = Math.max(0, Math.min(1, (event.clientX - left) / width));
      this.seek(this.player.start + share * (this.player.end - this.player.start));
    };
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      element.setPointerCapture(event.pointerId);
      this.held = event.pointerId;
      this.grab(true);
      toTime(event);
    });
    element.addEventListener("pointermove", (event) => {
      if (this.held === event.pointerId) toTime(event);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, () => {
        if (this.held === undefined) return;
        this.held = undefined;
        this.grab(false);
      });
    }
  }

  show(time) {
    const left = `${100 * this.share(time)}%`;
    this.thumb.style.left = left;
    this.fill.style.width = left;
    for (const cursor of this.cursors) cursor.style.left = left;
    this.track.setAttribute("aria-valuenow", Number(time.toFixed(6)));
    this.track.setAttribute("aria-valuetext", `${this.format(time)} seconds`);
  }
}
