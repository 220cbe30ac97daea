// Curves over the time line, with their values at its cursor.

import { locate } from "./motion.js";
import { h } from "./dom.js";

const HEIGHT = 92;
const PAD = 8;
const LETTER = 11; // height of the letters of labels

export class Plots {
  // `times` are those of the values; the axis spans the times of the player.
  constructor(panels, times, player, colors) {
    this.times = times;
    this.player = player;
    this.colors = colors;
    this.panels = panels.map((panel) => this.build(panel));
  }

  build(panel) {
    const curves = panel.curves.map((curve, index) => {
      const value = h("span", { class: "value" });
      const name = h("span", { class: "name", title: curve.name }, curve.name);
      const swatch = h("i", {});
      return { ...curve, value, swatch, index, item: h("li", {}, swatch, name, value) };
    });
    const canvas = h("canvas", { "aria-hidden": "true" });
    const legend = h("ul", { class: "legend" }, ...curves.map(({ item }) => item));
    const title = h("h3", {}, panel.title, panel.unit ? h("span", {}, ` ${panel.unit}`) : "");
    return { ...panel, curves, canvas, side: h("div", { class: "plot-side" }, title, legend), area: h("div", { class: "plot-area" }, canvas), range: extent(curves) };
  }

  // Draws all curves for a theme.
  draw(isDark, style) {
    const colors = this.colors[isDark ? "dark" : "light"];
    for (const panel of this.panels) {
      const ratio = window.devicePixelRatio || 1;
      const width = panel.area.clientWidth;
      if (!width) continue;
      panel.canvas.width = width * ratio;
      panel.canvas.height = HEIGHT * ratio;
      const context = panel.canvas.getContext("2d");
      context.scale(ratio, ratio);
      this.drawPanel(context, panel, width, colors, style);
    }
  }

  drawPanel(context, panel, width, colors, style) {
    const { low, high, ticks } = panel.range;
    const toY = (value) => HEIGHT - PAD - ((value - low) / (high - low)) * (HEIGHT - 2 * PAD);
    context.font = `${LETTER}px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif`;
    context.lineWidth = 1;
    for (const tick of ticks) {
      const y = Math.round(toY(tick)) + 0.5;
      context.strokeStyle = style.line;
      context.beginPath();
      context.moveTo(0, y);
      context.lineTo(width, y);
      context.stroke();
    }
    context.lineWidth = 1.6;
    context.lineJoin = "round";
    const { start, end } = this.player;
    const span = end - start || 1;
    for (const { values, index, swatch } of panel.curves) {
      context.strokeStyle = swatch.style.background = colors[index % colors.length];
      context.setLineDash(index >= colors.length ? [5, 3] : []);
      context.beginPath();
      let isOpen = false;
      for (let i = 0; i < values.length; i++) {
        const isNumber = Number.isFinite(values[i]);
        const x = ((this.times[i] - start) / span) * width;
        if (isNumber && isOpen) context.lineTo(x, toY(values[i]));
        else if (isNumber) context.moveTo(x, toY(values[i]));
        isOpen = isNumber;
      }
      context.stroke();
    }
    context.setLineDash([]);
    context.textBaseline = "top";
    let below = Infinity; // top of the label below
    for (const tick of ticks) {
      const text = tickText(tick);
      const top = toY(tick) + (toY(tick) > LETTER + 3 ? -LETTER - 1 : 2);
      if (top + LETTER > below) continue;
      below = top;
      context.lineWidth = 3;
      context.strokeStyle = style.raised;
      context.strokeText(text, 1, top);
      context.fillStyle = style.grey;
      context.fillText(text, 1, top);
    }
  }

  // Shows the values at a time [s].
  show(time) {
    const [index, share] = locate(this.times, time);
    for (const panel of this.panels) {
      for (const { values, value } of panel.curves) {
        const first = values[index];
        const now = share ? first + share * (values[index + 1] - first) : first;
        value.textContent = Number.isFinite(now) ? number(now, panel.range) : "–";
      }
    }
  }
}

function extent(curves) {
  let low = Infinity;
  let high = -Infinity;
  for (const { values } of curves) {
    for (const value of values) {
      if (!Number.isFinite(value)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) [low, high] = [0, 1];
  if (high - low <= 1e-9 * Math.max(Math.abs(low), Math.abs(high))) {
    const margin = Math.abs(high) * 0.1 || 1;
    [low, high] = [low - margin, high + margin];
  }
  const step = niceStep((high - low) / 2); // at least two ticks, at most six
  const ticks = [];
  for (let tick = Math.ceil(low / step - 1e-9); tick * step <= high + 1e-9 * step; tick++) ticks.push(tick * step);
  return { low, high, ticks };
}

function niceStep(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return ([5, 2].find((step) => step * power <= most) ?? 1) * power;
}

function tickText(value) {
  return String(Number(value.toPrecision(6))).replaceAll("-", "−");
}

// Formats a value; rounding errors beside the range of a panel are 0.
function number(value, { low, high }) {
  const size = Math.abs(value) < 1e-9 * (high - low) ? 0 : Math.abs(value);
  const sign = value < 0 && size ? "−" : "";
  if (size && (size >= 1e5 || size < 1e-3)) return sign + size.toExponential(2).replace("-", "−");
  return sign + size.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}
