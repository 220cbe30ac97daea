// The replay: a scene, its player and what the user sees of both.

import { Vector3 } from "three";
import { Contacts } from "./contacts.js";
import { readData } from "./data.js";
import { h, icon, setIcon } from "./dom.js";
import { readGlb } from "./glb.js";
import { Labels } from "./labels.js";
import { locate } from "./motion.js";
import { Player, SPEEDS } from "./player.js";
import { Plots } from "./plots.js";
import { ReplayScene } from "./scene.js";
import { Stage } from "./stage.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";

const place = new Vector3();
const ELEVATION = 0.33; // of the first view [rad]
const AZIMUTH = 0.9;
const LAYERS = { contactpoint: "contacts", contactforce: "forces", labels: "labels" }; // their switches
const MARKS = { pass: "holds", fail: "fails" };
const DOUBLE_TAP = 350; // [ms]
const MANY = 6; // more cameras than that are a list
const NARROW = window.matchMedia("(max-width: 720px)");
const DARK = window.matchMedia("(prefers-color-scheme: dark)");
const KEYS = [
  ["Space", "Play or pause"],
  ["← →", "Step by one frame; with Shift by ten"],
  ["Home End", "First or last frame"],
  ["[ ]", "Slower or faster"],
  ["0", "Free view of what moves"],
  ["1 … 9", "Cameras of the model"],
  ["C", "Contacts"],
  ["F", "Contact forces"],
  ["G", "Collision geoms"],
  ["L", "Names of bodies"],
  ["T", "Light or dark"],
  ["P", "Show or hide the panel"],
  ["?", "This list"],
];
const GESTURES = [
  ["Drag", "Turn; with two fingers, Shift or the right button: move"],
  ["Wheel, pinch", "Zoom"],
  ["Tap", "Name of a body"],
  ["Double tap", "Follow a body"],
];

class Replay {
  constructor(glb, data, report) {
    this.data = data;
    this.report = report;
    this.digits = 3;
    this.format = (time) => time.toFixed(this.digits);
    this.shows = { contacts: false, forces: false, collisions: false, labels: false };
    this.scene = new ReplayScene(glb, data.times.length);
    this.player = new Player(data.times, () => this.refresh());
    this.buildPage();
    this.stage = new Stage(this.canvas);
    this.view = new View(this.canvas, 1);
    this.labels = new Labels(this.labelCanvas);
    this.space = this.scene.measure();
    this.view.size = this.space.size;
    // MuJoCo's camera looks along its azimuth, counted from x to y; here the image is seen from the azimuth, from x to −y.
    [this.azimuth, this.elevation] = data.direction ? [Math.PI - data.direction[0], -data.direction[1]] : [AZIMUTH, ELEVATION];
    this.stage.add(this.scene.root, this.space.size, this.azimuth);
    if (this.scene.isMetallic) this.stage.addReflections();
    if (data.contacts) {
      this.contacts = new Contacts(data.contacts, this.space.size);
      this.scene.world.add(this.contacts.group);
      if (this.contacts.strongest) this.forceNote.textContent = `max ${Number(this.contacts.strongest.toPrecision(2))} N`;
    }
    this.view.changed = () => this.refresh();
    this.view.manual = () => this.freeView();
    this.view.tapped = (event) => this.tap(event);
    this.pose();
    this.setTheme(DARK.matches);
    this.placeInset();
    this.resetView();
    this.listen();
    this.resize();
    for (const layer of data.layers) this.toggle(LAYERS[layer], true);
    this.readHash(true);
  }

  // --- the page

  buildPage() {
    const { data } = this;
    document.title = data.title;
    const button = (name, label, action, extra = {}) =>
      h("button", { type: "button", title: label, "aria-label": label, class: "icon", onclick: action, ...extra }, icon(name));
    this.themeButton = button("dark", "Light or dark (T)", () => this.setTheme(!this.isDark));
    this.panelButton = button("panel", "View and cameras (P)", () => this.showPanel(this.panel.hidden));
    const header = h(
      "header",
      {},
      h("div", { class: "title" }, h("h1", {}, data.title), data.subtitle ? h("p", {}, data.subtitle) : ""),
      h(
        "div",
        { class: "actions" },
        button("link", "Copy a link to this instant", () => this.copyLink()),
        this.themeButton,
        button("keys", "Keys and gestures (?)", () => this.help.showModal()),
        this.panelButton,
      ),
    );
    this.canvas = h("canvas", { class: "view", "aria-label": `${data.title}: 3D view` });
    this.labelCanvas = h("canvas", { class: "labels", "aria-hidden": "true" });
    this.toast = h("p", { class: "toast", role: "status", hidden: true });
    this.panel = this.buildPanel();
    this.area = h("main", {}, this.canvas, this.labelCanvas, this.panel, this.toast);
    this.help = this.buildHelp(button);
    document.body.append(header, this.area, this.buildDock(button), this.help);
    this.showPanel(!NARROW.matches);
  }

  buildPanel() {
    const { cameras, bodies } = this.scene;
    const sections = [];
    this.cameraChips = new Map();
    this.cameraSelect = h("select", { "aria-label": "Camera", onchange: () => this.chooseCamera(cameras[this.cameraSelect.value] ?? null) });
    this.cameraSelect.append(h("option", { value: "" }, "Free view"));
    cameras.forEach((node, i) => this.cameraSelect.append(h("option", { value: i }, node.name)));
    const chip = (node, text, key) => {
      const element = h("button", { type: "button", class: "chip", title: `Key ${key}`, onclick: () => this.chooseCamera(node) }, text);
      this.cameraChips.set(node, element);
      return element;
    };
    const chips = () => h("div", { class: "chips" }, chip(null, "Free view", 0), ...cameras.map((node, i) => chip(node, node.name, i + 1)));
    sections.push(section("Camera", cameras.length > MANY ? this.cameraSelect : chips()));

    this.followSelect = h("select", { "aria-label": "Follow", onchange: () => this.follow(this.followSelect.value) });
    this.followSelect.append(h("option", { value: "" }, "Nothing"));
    const moving = bodies.filter((body) => this.scene.moving.has(body));
    moving.forEach((body) => this.followSelect.append(h("option", { value: bodies.indexOf(body) }, body.name)));
    if (moving.length) sections.push(section("Follow", this.followSelect));

    this.switches = {};
    this.forceNote = h("small", {});
    const toggle = (name, text, key, note = "") => {
      const input = h("input", { type: "checkbox", onchange: () => this.toggle(name, input.checked) });
      this.switches[name] = input;
      return h("label", { class: "switch", title: `Key ${key}` }, input, h("span", {}, text), note);
    };
    const toggles = [];
    if (this.data.contacts) {
      this.contactNote = h("small", {});
      toggles.push(toggle("contacts", "Contacts", "C", this.contactNote));
      toggles.push(toggle("forces", "Contact forces", "F", this.forceNote));
    }
    if (this.scene.hasCollisions) toggles.push(toggle("collisions", "Collision geoms", "G"));
    toggles.push(toggle("labels", "Names of bodies", "L"));
    sections.push(section("Show", ...toggles));

    if (this.data.marks.length) {
      const marks = this.data.marks.map((mark) =>
        h(
          "button",
          { type: "button", class: `jump ${mark.kind}`, disabled: mark.time === null, onclick: () => this.jump(mark.time) },
          h("i", { class: `mark ${mark.kind}` }),
          h("span", {}, mark.text),
          h("small", {}, mark.time === null ? MARKS[mark.kind] : `${this.format(mark.time)} s`),
        ),
      );
      sections.push(section("Events and assertions", h("div", { class: "events" }, ...marks)));
    }
    if (this.data.facts.length) {
      const facts = this.data.facts.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]);
      sections.push(h("details", {}, h("summary", {}, "About this replay"), h("dl", {}, ...facts)));
    }
    return h("aside", { "aria-label": "View" }, ...sections);
  }

  buildDock(button) {
    const { data, player } = this;
    this.playButton = button("play", "Play or pause (Space)", () => player.play(!player.isPlaying), { class: "icon play" });
    this.loopButton = button("loop", "Repeat", () => this.setLoop(!player.isLooping), { class: "icon" });
    this.speedSelect = h("select", { "aria-label": "Speed", title: "Speed ([ and ])", onchange: () => this.setSpeed(Number(this.speedSelect.value)) });
    SPEEDS.forEach((speed) => this.speedSelect.append(h("option", { value: speed, selected: speed === 1 }, `${speed}×`)));
    this.clock = h("output", { "aria-hidden": "true" });
    this.timeline = new Timeline(player, data.marks.filter(({ time }) => time !== null), this.format, {
      seek: (time) => player.seek(time),
      grab: (isHeld) => this.hold(isHeld),
    });
    this.plots = new Plots(data.panels, data.curveTimes, player, data.colors);
    const rows = this.plots.panels.map(({ side, area }) => {
      this.timeline.attach(area);
      return h("div", { class: "row plot" }, side, area);
    });
    const controls = h(
      "div",
      { class: "controls" },
      button("back", "Back by one frame (←)", () => player.step(-1)),
      this.playButton,
      button("forward", "Forward by one frame (→)", () => player.step(1)),
      this.clock,
      h("span", { class: "spring" }),
      this.loopButton,
      this.speedSelect,
    );
    this.setLoop(true);
    return h("footer", { hidden: data.times.length === 1 && !rows.length }, h("div", { class: "plots" }, ...rows), h("div", { class: "row" }, controls, this.timeline.track));
  }

  buildHelp(button) {
    const list = (entries) => h("dl", {}, ...entries.flatMap(([keys, text]) => [h("dt", {}, keys), h("dd", {}, text)]));
    const close = button("close", "Close", () => this.help.close());
    return h("dialog", { "aria-label": "Keys and gestures" }, h("h2", {}, "Keys and gestures", close), list(KEYS), list(GESTURES));
  }

  // --- what the user does

  listen() {
    window.addEventListener("resize", () => this.resize());
    new ResizeObserver(() => this.resize()).observe(this.area);
    window.addEventListener("hashchange", () => this.readHash(false));
    window.addEventListener("keydown", (event) => this.key(event));
    DARK.addEventListener("change", () => this.setTheme(DARK.matches));
    this.canvas.addEventListener("webglcontextrestored", () => this.refresh());
    this.help.addEventListener("click", (event) => event.target === this.help && this.help.close());
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || this.help.open) return;
    const { player } = this;
    const isChoice = event.target.tagName === "SELECT";
    const jump = event.shiftKey ? 10 : 1;
    const actions = {
      " ": () => player.play(!player.isPlaying),
      ArrowLeft: () => player.step(-jump),
      ArrowRight: () => player.step(jump),
      Home: () => this.jump(player.start),
      End: () => this.jump(player.end),
      "[": () => this.changeSpeed(-1),
      "]": () => this.changeSpeed(1),
      0: () => this.resetView(),
      c: () => this.toggle("contacts"),
      f: () => this.toggle("forces"),
      g: () => this.toggle("collisions"),
      l: () => this.toggle("labels"),
      t: () => this.setTheme(!this.isDark),
      p: () => this.showPanel(this.panel.hidden),
      "?": () => this.help.showModal(),
    };
    this.scene.cameras.slice(0, 9).forEach((node, i) => (actions[i + 1] = () => this.chooseCamera(node)));
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const isTyped = isChoice || (event.key === " " && ["BUTTON", "INPUT", "SUMMARY"].includes(event.target.tagName));
    if (!action || isTyped) return;
    event.preventDefault();
    action();
  }

  hold(isHeld) {
    const { player } = this;
    if (isHeld) {
      this.wasPlaying = player.isPlaying;
      player.play(false);
    } else if (this.wasPlaying) player.play(true);
  }

  jump(time) {
    this.player.play(false);
    this.player.seek(time);
  }

  toggle(name, isShown = !this.shows[name]) {
    if (!this.switches[name]) return;
    this.shows[name] = this.switches[name].checked = isShown;
    if (this.contacts) {
      this.contacts.discs.visible = this.shows.contacts;
      this.contacts.arrows.visible = this.shows.forces;
    }
    if (name === "collisions") this.scene.showCollisions(isShown, this.style.collision);
    this.refresh();
  }

  setLoop(isLooping) {
    this.player.isLooping = isLooping;
    this.loopButton.setAttribute("aria-pressed", isLooping);
  }

  setSpeed(speed) {
    this.player.speed = speed;
    this.speedSelect.value = speed;
  }

  changeSpeed(by) {
    const index = SPEEDS.indexOf(this.player.speed) + by;
    if (!SPEEDS[index]) return;
    this.setSpeed(SPEEDS[index]);
    this.say(`${SPEEDS[index]}× speed`);
  }

  chooseCamera(node) {
    if (node === null) {
      if (this.view.model) this.freeView();
      else this.resetView();
      return;
    }
    this.view.choose(node);
    this.markCamera();
  }

  // Leaves the camera of the model where it is, to move from there.
  freeView() {
    if (!this.view.model) return;
    this.view.takeOver(this.view.followed ? this.view.followedPosition : this.space.locate(place));
    this.markCamera();
    this.refresh();
  }

  resetView() {
    this.view.model = null;
    this.selected = null;
    this.view.frame(this.space, this.azimuth, this.elevation);
    this.setFollowed(this.view.followed);
    this.markCamera();
    this.refresh();
  }

  markCamera() {
    const { model } = this.view;
    for (const [node, element] of this.cameraChips) element.setAttribute("aria-pressed", node === model);
    this.cameraSelect.value = model ? this.scene.cameras.indexOf(model) : "";
  }

  follow(value) {
    this.freeView();
    this.setFollowed(value === "" ? null : this.scene.bodies[value]);
    this.view.center();
    this.refresh();
  }

  setFollowed(body) {
    this.view.follow(body);
    this.followSelect.value = body ? this.scene.bodies.indexOf(body) : "";
  }

  // Names the body at a point; a second tap there follows it.
  tap(event) {
    const { x, y, time } = this.tapped ?? { x: Infinity, y: Infinity, time: -Infinity };
    this.tapped = { x: event.clientX, y: event.clientY, time: event.timeStamp };
    const isSecond = event.timeStamp - time < DOUBLE_TAP && Math.hypot(event.clientX - x, event.clientY - y) < 24;
    const body = this.hit(event)?.body ?? null;
    this.selected = isSecond ? null : body;
    if (isSecond && body && this.scene.moving.has(body)) {
      this.follow(this.scene.bodies.indexOf(body));
      this.say(`Following ${body.name}`);
    }
    this.refresh();
  }

  hit(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const x = ((event.clientX - left) / width) * 2 - 1;
    const y = 1 - ((event.clientY - top) / height) * 2;
    return this.scene.pick(x, y, this.view.camera);
  }

  async copyLink() {
    const hash = new URLSearchParams({ t: Number(this.player.time.toFixed(6)) });
    if (this.view.model) hash.set("camera", this.view.model.name);
    if (this.view.followed) hash.set("follow", this.view.followed.name);
    location.hash = hash;
    try {
      await navigator.clipboard.writeText(location.href);
      this.say("Link copied");
    } catch {
      this.say("The address now links to this instant");
    }
  }

  // Shows the instant in the address, #t=1.25&camera=side; plays from the start if it has none.
  readHash(isFirst) {
    const hash = new URLSearchParams(location.hash.slice(1));
    const named = (nodes, key) => nodes.find((node) => node.name === hash.get(key));
    const camera = named(this.scene.cameras, "camera");
    const body = named(this.scene.bodies, "follow");
    const time = parseFloat(hash.get("t"));
    if (Number.isFinite(time)) this.jump(time);
    else if (isFirst && !this.view.isCalm) this.player.play(true);
    if (isFirst && this.scene.shots.length) this.chooseCamera(this.scene.shots[0]);
    if (body) this.follow(this.scene.bodies.indexOf(body));
    if (camera) this.chooseCamera(camera);
  }

  say(text) {
    this.toast.textContent = text;
    this.toast.hidden = false;
    clearTimeout(this.silence);
    this.silence = setTimeout(() => (this.toast.hidden = true), 1800);
  }

  // --- what it shows

  showPanel(isShown) {
    this.panel.hidden = !isShown;
    this.panelButton.setAttribute("aria-pressed", isShown);
    if (!this.view) return;
    this.placeInset();
    this.refresh();
  }

  // Centers the free view in the part of the image that the panel leaves.
  placeInset() {
    this.view.inset = this.panel.hidden || NARROW.matches ? 0 : this.panel.offsetWidth + 12;
  }

  setTheme(isDark) {
    this.isDark = isDark;
    document.documentElement.dataset.theme = isDark ? "dark" : "light";
    setIcon(this.themeButton.firstChild, isDark ? "light" : "dark");
    const computed = getComputedStyle(document.documentElement);
    this.style = {};
    for (const name of ["ground", "raised", "ink", "grey", "line", "contact", "force", "collision"]) {
      this.style[name] = computed.getPropertyValue(`--${name}`).trim();
    }
    this.stage.setTheme(isDark);
    this.contacts?.paint(this.style.contact, this.style.force);
    this.scene.showCollisions(this.shows.collisions, this.style.collision);
    this.plots.draw(isDark, this.style);
    this.refresh();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.area;
    const ratio = window.devicePixelRatio;
    const dock = this.timeline.track.clientWidth;
    const size = `${width} ${height} ${ratio} ${dock}`;
    if (!width || !height || size === this.size) return;
    this.size = size;
    this.placeInset();
    this.stage.resize(width, height);
    this.labels.resize(width, height);
    this.plots.draw(this.isDark, this.style);
    this.draw(0);
  }

  // Draws a new image before the next repaint.
  refresh() {
    this.scheduled ??= requestAnimationFrame((now) => {
      this.scheduled = null;
      const seconds = this.last ? Math.min(0.1, (now - this.last) / 1000) : 0;
      this.draw(seconds);
      const isActive = this.player.isPlaying || this.isMoving;
      this.last = isActive ? now : null;
      if (isActive) this.refresh();
    });
  }

  draw(seconds) {
    const { player, view } = this;
    player.advance(seconds);
    if (this.posed !== player.time) this.pose();
    if (this.contacts && (this.shows.contacts || this.shows.forces)) this.contacts.show(player.frame);
    this.isMoving = view.update(seconds || 1 / 60);
    this.stage.aim(this.space.locate(place));
    this.stage.fadeGround(view.model ? place : view.now.target, Math.max(3 * this.space.reach, 3 * view.now.distance));
    this.stage.render(view.camera);
    this.drawLabels();
    this.showTime();
    document.documentElement.dataset.time = player.time;
  }

  pose() {
    this.posed = this.player.time;
    this.scene.pose(...locate(this.data.times, this.posed));
  }

  drawLabels() {
    const named = this.shows.labels ? this.scene.bodies : [];
    if (this.selected && !named.includes(this.selected)) named.unshift(this.selected);
    this.labels.draw(named, this.view.camera, this.style);
  }

  showTime() {
    const { player } = this;
    this.timeline.show(player.time);
    this.plots.show(player.time);
    const text = `${this.format(player.time)} s`;
    if (this.clock.textContent !== text) this.clock.textContent = text;
    const name = player.isPlaying ? "pause" : "play";
    if (this.playButton.firstChild.dataset.icon !== name) setIcon(this.playButton.firstChild, name);
    if (this.contacts) this.contactNote.textContent = this.contacts.count(player.frame) || "";
  }
}

function section(title, ...content) {
  return h("section", {}, h("h2", {}, title), ...content);
}

export async function start(scene, data, report) {
  try {
    new Replay(await readGlb(scene), readData(data), report);
    document.getElementById("status").hidden = true;
    document.documentElement.dataset.ready = "true";
  } catch (error) {
    report(error);
  }
}
