// Drawing by three.js: bodies in views side by side, overlaid or under a wipe, coloured by a number per vertex.
import {
  BufferAttribute, BufferGeometry, Color, DataTexture, DirectionalLight, DynamicDrawUsage, Fog,
  GridHelper, HemisphereLight, LinearFilter, Mesh, MeshStandardMaterial, PCFShadowMap,
  PerspectiveCamera, PlaneGeometry, Scene, ShadowMaterial, SRGBColorSpace, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { distances } from "./body.js";
import { Skin, pictureOf } from "./skin.js";

// Colours of the report, from 0 to the end of the scale.
export const COLOURS = [[252, 240, 178], [254, 196, 136], [253, 154, 106], [246, 110, 92], [224, 76, 103],
                        [188, 57, 120], [150, 44, 128], [114, 31, 129], [76, 17, 122], [37, 18, 85]];
const CLAY = [219, 196, 178];
const HEIGHT_M = 2.56, WIDTH_M = 1.7; // of what is in view at first, about TARGET
const TARGET = [0, 0.9, 0], ANGLE = 0.1, RISE = 0.04; // where the camera looks at first, from which angle and slope
const TURN_S = 20; // one turn of the turntable

// A texture of colours in a row, which is looked up by one number and interpolated.
const texture = (colours) => Object.assign(new DataTexture(new Uint8Array(colours.flatMap((colour) => [...colour, 255])), colours.length, 1), {
  colorSpace: SRGBColorSpace, magFilter: LinearFilter, minFilter: LinearFilter, needsUpdate: true });

export class Stage {
  constructor(canvas, body, skinFacts) {
    this.canvas = canvas;
    this.body = body;
    this.skin = skinFacts && new Skin(skinFacts, body.count);
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setScissorTest(true);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene = new Scene();
    this.scene.background = new Color();
    this.scene.fog = new Fog(0, 9, 22);
    this.camera = new PerspectiveCamera(28, 1, 0.1, 60);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.515 * Math.PI; // above the floor, also from afar
    this.controls.minDistance = 0.8;
    this.controls.maxDistance = 14;
    this.controls.autoRotateSpeed = 60 / TURN_S;
    this.lights();
    this.grid.material.vertexColors = false;
    this.plain = texture([CLAY]); // where no colours are shown
    this.palette = texture(COLOURS);
    this.palette.offset.x = 0.5 / COLOURS.length; // the middle of the first colour
    this.bodies = {};
  }

  lights() {
    const key = new DirectionalLight(0xfff4e8, 2.2), rim = new DirectionalLight(0xdfe8ff, 1.1);
    key.position.set(2.2, 4.2, 3.2);
    rim.position.set(-3, 2.5, -3.5);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    Object.assign(key.shadow.camera, { left: -4, right: 4, top: 3.5, bottom: -3.5, near: 0.5, far: 14 });
    Object.assign(key.shadow, { bias: -0.0006, normalBias: 0.03, radius: 8, intensity: 0.75 });
    const ground = new Mesh(new PlaneGeometry(60, 60).rotateX(-Math.PI / 2), new ShadowMaterial({ opacity: 0.2 }));
    ground.receiveShadow = true;
    ground.position.y = -0.002; // below the soles
    this.grid = new GridHelper(40, 80, 0xd8d3cb, 0xe3dfd8);
    this.grid.position.y = -0.003;
    this.scene.add(new HemisphereLight(0xffffff, 0xb8aea2, 1.5), key, rim, ground, this.grid);
  }

  figure(name) {
    if (this.bodies[name]) return this.bodies[name];
    const { body: { count, faces }, skin } = this, geometry = new BufferGeometry(), drawn = skin?.drawn ?? count;
    geometry.setIndex((this.index ??= skin?.index ?? new BufferAttribute(faces, 1))); // one for all bodies
    if (skin) geometry.setAttribute("uv1", skin.places);
    for (const [attribute, width] of [["position", 3], ["normal", 3], ["uv", 1]]) // uv: metres, the place in a texture's row
      geometry.setAttribute(attribute, new BufferAttribute(new Float32Array(drawn * width), width).setUsage(DynamicDrawUsage));
    const mesh = new Mesh(geometry, new MeshStandardMaterial({ roughness: 0.62, metalness: 0, map: this.plain }));
    mesh.frustumCulled = false; // no bounding sphere to be kept up to date
    mesh.castShadow = mesh.receiveShadow = true;
    this.scene.add(mesh);
    return (this.bodies[name] = mesh);
  }

  // Show the picture of skin (a PNG file) where no colours are shown.
  async wear(png) { this.plain = await pictureOf(png, Math.min(8, this.renderer.capabilities.getMaxAnisotropy())); }

  // Draw once, as the first drawing compiles the shaders, which takes most of its time.
  warm() {
    this.figure("smpl");
    this.draw("side", 0, ["smpl"], [0, 0, 0]);
  }

  // Pose one body. All of its attributes are of the same frame, so that it does not tear.
  pose(name, frame, offsets, gains) {
    const { position, normal, uv } = this.figure(name).geometry.attributes;
    this.body.skin(frame.rest, offsets, gains, frame.bones, position.array, uv.array);
    this.body.normals(position.array, normal.array);
    for (const { array, itemSize } of [position, normal, uv]) this.skin?.copy(array, itemSize);
    position.needsUpdate = normal.needsUpdate = uv.needsUpdate = true;
  }

  // colouring: "none", "size" or "apart", the distance to the truth.
  colour(shown, colouring, fullM) {
    this.palette.repeat.x = (1 - 1 / COLOURS.length) / fullM;
    for (const name of shown) {
      const { material, geometry: { attributes: { position, uv } } } = this.figure(name);
      const coloured = colouring === "size" ? name !== "smpl" : colouring === "apart" && name !== "truth";
      const map = coloured ? this.palette : this.plain;
      if (material.map !== map) Object.assign(material, { map, needsUpdate: material.map.channel !== map.channel });
      if (coloured && colouring === "apart") distances(position.array, this.bodies.truth.geometry.attributes.position.array, uv.array);
    }
  }

  // Colours around the bodies, as CSS writes them.
  paint(background, grid) {
    this.scene.background.set(background);
    this.scene.fog.color.set(background);
    this.grid.material.color.set(grid);
  }

  // Fit the camera to the size of a view; if that or the number of views is new, also its distance.
  fit(views) {
    const { canvas: { clientWidth: width, clientHeight: height }, camera, controls: { target } } = this, ratio = Math.min(devicePixelRatio, 2);
    const fitted = [views, width, height, ratio].join(), isFirst = !this.fitted;
    if (this.fitted === fitted) return;
    this.fitted = fitted;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    camera.aspect = width / views / height;
    camera.updateProjectionMatrix();
    if (isFirst) this.reset();
    camera.position.sub(target).setLength(this.distance()).add(target);
    this.controls.update();
  }

  // From where a whole body is in view, also on an upright phone.
  distance() {
    return Math.max(HEIGHT_M, WIDTH_M / this.camera.aspect) / 2 / Math.tan((this.camera.fov * Math.PI) / 360);
  }

  // The camera as it was at first.
  reset() {
    this.turns = false;
    this.controls.target.set(...TARGET);
    this.look(ANGLE, this.distance());
  }

  // From an angle about the vertical, where 0 is from +z, and level; by default from as far as now.
  look(angle, distance = this.camera.position.distanceTo(this.controls.target)) {
    this.camera.position.set(Math.sin(angle), RISE, Math.cos(angle)).setLength(distance).add(this.controls.target);
    this.controls.update();
  }

  get turns() { return this.controls.autoRotate; }
  set turns(on) { this.controls.autoRotate = on; }

  // What is drawn where: in each view these bodies, by the one camera; of it what lies between `from` and `to`.
  // All are shares of the canvas's width.
  views(layout, at, shown) {
    const [left, right] = shown, whole = { x: 0, width: 1 };
    if (layout === "wipe" && right) return [{ names: [left], ...whole, from: 0, to: at }, { names: [right], ...whole, from: at, to: 1 }];
    if (layout !== "side" || !right) return [{ names: shown, ...whole, from: 0, to: 1 }];
    return shown.map((name, i) => ({ names: [name], x: i / shown.length, width: 1 / shown.length, from: i / shown.length, to: (i + 1) / shown.length }));
  }

  // layout: "side", "overlay" or "wipe"; at: position of the wipe, 0 to 1; root: position that stays in place; passed: seconds since the last drawing.
  draw(layout, at, shown, root, passed = 0) {
    this.fit(layout === "side" ? Math.max(1, shown.length) : 1);
    if (this.turns) this.controls.update(passed);
    this.grid.position.x = -root[0] % 0.5;
    this.grid.position.z = -root[2] % 0.5;
    shown.forEach((name, i) => {
      const { position, material } = this.figure(name), see = layout === "overlay" && i === 0 && shown.length > 1;
      position.set(-root[0], -root[1], -root[2]);
      if (material.transparent !== see) Object.assign(material, { transparent: see, opacity: see ? 0.4 : 1, depthWrite: !see, needsUpdate: true });
    });
    const { renderer, canvas: { clientWidth: wide, clientHeight: high } } = this;
    for (const { names, x, width, from, to } of this.views(layout, at, shown)) {
      for (const name in this.bodies) this.bodies[name].visible = names.includes(name);
      renderer.setViewport(x * wide, 0, width * wide, high);
      renderer.setScissor(from * wide, 0, (to - from) * wide, high);
      renderer.render(this.scene, this.camera);
    }
  }
}
