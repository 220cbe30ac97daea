// The renderer with its light: a sky, a key light whose shadows follow the view, and a weaker light from behind.

import {
  BoxGeometry,
  Color,
  DirectionalLight,
  HemisphereLight,
  Mesh,
  MeshBasicMaterial,
  NeutralToneMapping,
  PCFShadowMap,
  PMREMGenerator,
  Scene,
  WebGLRenderer,
} from "three";
import { aimGround } from "./ground.js";

const SHADOW_PIXELS = 2048;
const MOST_PIXELS = 2; // per CSS pixel

export class Stage {
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.anisotropy = this.renderer.capabilities.getMaxAnisotropy();
    this.scene = new Scene();
    this.sky = new HemisphereLight(0xffffff, 0xb8b6b2, 1.5);
    this.key = new DirectionalLight(0xfff6ea, 2.1);
    this.key.castShadow = true;
    this.key.shadow.mapSize.set(SHADOW_PIXELS, SHADOW_PIXELS);
    this.key.shadow.radius = 3.5;
    this.rim = new DirectionalLight(0xe4eeff, 0.5);
    this.head = new DirectionalLight(0xffffff, 0.8);
    this.scene.add(this.head, this.head.target);
    this.scene.add(this.sky, this.key, this.key.target, this.rim, this.rim.target);
  }

  // Gives metals something to reflect: a grey room with a bright ceiling.
  addReflections() {
    const room = new Scene();
    room.background = new Color(0.42, 0.43, 0.45);
    const ceiling = new Mesh(new BoxGeometry(6, 0.1, 6), new MeshBasicMaterial({ color: new Color(4, 4, 4) }));
    ceiling.position.y = 4;
    room.add(ceiling);
    const generator = new PMREMGenerator(this.renderer);
    this.scene.environment = generator.fromScene(room, 0.03).texture;
    this.scene.environmentIntensity = 0.6;
    generator.dispose();
  }

  add(root, radius, azimuth) {
    this.scene.add(root);
    this.radius = radius;
    this.azimuth = azimuth;
    const reach = 1.6 * radius;
    const { camera } = this.key.shadow;
    Object.assign(camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1 * radius, far: 9 * radius });
    camera.updateProjectionMatrix();
    this.key.shadow.normalBias = 0.004 * radius;
    this.key.shadow.bias = -0.0004;
    root.traverse((node) => {
      if (node.material?.map) node.material.map.anisotropy = this.anisotropy;
    });
  }

  // Moves the light and the visible ground to what is in view.
  aim(target) {
    const place = (light, turn, height) => {
      const angle = this.azimuth + turn;
      light.target.position.copy(target);
      light.position.copy(target);
      light.position.x += 4 * this.radius * Math.cos(angle) * Math.cos(height);
      light.position.z += 4 * this.radius * Math.sin(angle) * Math.cos(height);
      light.position.y += 4 * this.radius * Math.sin(height);
    };
    place(this.key, 0.75, 1.0);
    place(this.rim, 3.6, 0.5);
  }

  fadeGround(center, radius) {
    aimGround(center, radius);
  }

  setTheme(isDark) {
    this.sky.intensity = isDark ? 1.15 : 1.4;
    this.key.intensity = isDark ? 1.9 : 2.0;
  }

  resize(width, height) {
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, MOST_PIXELS));
    this.renderer.setSize(width, height, false);
  }

  render(camera) {
    this.head.position.setFromMatrixPosition(camera.matrixWorld);
    this.head.target.position.copy(this.key.target.position);
    this.renderer.render(this.scene, camera);
  }
}
