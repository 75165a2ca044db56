// Drawing by three.js: bodies side by side, overlaid or under a wipe, coloured by a number per vertex.
import {
  BufferAttribute, BufferGeometry, Color, DataTexture, DirectionalLight, DynamicDrawUsage, Fog,
  GridHelper, HemisphereLight, LinearFilter, Mesh, MeshStandardMaterial, PCFSoftShadowMap,
  PerspectiveCamera, PlaneGeometry, Scene, ShadowMaterial, SRGBColorSpace, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { distances } from "./body.js";

// Colours of the report, from 0 to the end of the scale.
export const COLOURS = [[252, 240, 178], [254, 196, 136], [253, 154, 106], [246, 110, 92], [224, 76, 103],
                        [188, 57, 120], [150, 44, 128], [114, 31, 129], [76, 17, 122], [37, 18, 85]];
const CLAY = [219, 196, 178];
const BACKGROUND = 0xf3f1ee;
const APART_M = 1.35;

// A texture of colours in a row, which is looked up by one number and interpolated.
const texture = (colours) => Object.assign(new DataTexture(new Uint8Array(colours.flatMap((colour) => [...colour, 255])), colours.length, 1), {
  colorSpace: SRGBColorSpace, magFilter: LinearFilter, minFilter: LinearFilter, needsUpdate: true });

export class Stage {
  constructor(canvas, body) {
    this.canvas = canvas;
    this.body = body;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setScissorTest(true);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFSoftShadowMap;
    this.scene = new Scene();
    this.scene.background = new Color(BACKGROUND);
    this.scene.fog = new Fog(BACKGROUND, 9, 22);
    this.camera = new PerspectiveCamera(28, 1, 0.1, 60);
    this.camera.position.set(0.5, 1.15, 5);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.set(0, 0.95, 0);
    this.controls.maxPolarAngle = 0.515 * Math.PI; // above the floor, also from afar
    this.controls.minDistance = 0.8;
    this.controls.maxDistance = 14;
    this.lights();
    this.clay = texture([CLAY]);
    this.palette = texture(COLOURS);
    this.palette.offset.x = 0.5 / COLOURS.length; // the middle of the first colour
    this.bodies = {};
  }

  lights() {
    const key = new DirectionalLight(0xfff4e8, 2.6), rim = new DirectionalLight(0xdfe8ff, 1.1);
    key.position.set(2.2, 4.2, 3.2);
    rim.position.set(-3, 2.5, -3.5);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    Object.assign(key.shadow.camera, { left: -4, right: 4, top: 3.5, bottom: -3.5, near: 0.5, far: 14 });
    Object.assign(key.shadow, { bias: -0.0004, normalBias: 0.012, radius: 4 });
    const ground = new Mesh(new PlaneGeometry(60, 60).rotateX(-Math.PI / 2), new ShadowMaterial({ opacity: 0.2 }));
    ground.receiveShadow = true;
    ground.position.y = -0.002; // below the soles
    this.grid = new GridHelper(40, 80, 0xd8d3cb, 0xe3dfd8);
    this.grid.position.y = -0.003;
    this.scene.add(new HemisphereLight(0xffffff, 0xb8aea2, 1.25), key, rim, ground, this.grid);
  }

  figure(name) {
    if (this.bodies[name]) return this.bodies[name];
    const { count, faces } = this.body, geometry = new BufferGeometry();
    geometry.setIndex((this.index ??= new BufferAttribute(faces, 1))); // one for all bodies
    for (const [attribute, width] of [["position", 3], ["normal", 3], ["uv", 1]]) // uv: metres, the place in a texture's row
      geometry.setAttribute(attribute, new BufferAttribute(new Float32Array(count * width), width).setUsage(DynamicDrawUsage));
    const mesh = new Mesh(geometry, new MeshStandardMaterial({ roughness: 0.62, metalness: 0, map: this.clay }));
    mesh.frustumCulled = false; // no bounding sphere to be kept up to date
    mesh.castShadow = mesh.receiveShadow = true;
    this.scene.add(mesh);
    return (this.bodies[name] = mesh);
  }

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
    position.needsUpdate = normal.needsUpdate = uv.needsUpdate = true;
  }

  // colouring: "none", "size" or "apart", the distance to the truth.
  colour(shown, colouring, fullM) {
    this.palette.repeat.x = (1 - 1 / COLOURS.length) / fullM;
    for (const name of shown) {
      const { material, geometry: { attributes: { position, uv } } } = this.figure(name);
      const coloured = colouring === "size" ? name !== "smpl" : colouring === "apart" && name !== "truth";
      material.map = coloured ? this.palette : this.clay;
      if (coloured && colouring === "apart") distances(position.array, this.bodies.truth.geometry.attributes.position.array, uv.array);
    }
  }

  // Move the camera so that all bodies are in view, also on an upright phone.
  fit(bodies) {
    const { clientWidth: width, clientHeight: height } = this.canvas, ratio = Math.min(devicePixelRatio, 2);
    const fitted = [bodies, width, height, ratio].join();
    if (this.fitted === fitted) return;
    this.fitted = fitted;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    const high = Math.tan((this.camera.fov * Math.PI) / 360), away = this.camera.position.clone().sub(this.controls.target);
    away.setLength(Math.max(1.24 / high, (0.5 * APART_M * (bodies - 1) + 0.85) / (high * this.camera.aspect)));
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
  }

  // layout: "side", "overlay" or "wipe"; at: position of the wipe, 0 to 1; root: position that stays in place.
  draw(layout, at, shown, root) {
    const side = layout === "side";
    this.fit(side ? shown.length : 1);
    this.grid.position.x = -root[0] % 0.5;
    this.grid.position.z = -root[2] % 0.5;
    shown.forEach((name, i) => {
      const { position, material } = this.figure(name), see = layout === "overlay" && i === 0 && shown.length > 1;
      position.set((side ? APART_M * (i - (shown.length - 1) / 2) : 0) - root[0], -root[1], -root[2]);
      if (material.transparent !== see) Object.assign(material, { transparent: see, opacity: see ? 0.4 : 1, depthWrite: !see, needsUpdate: true });
    });
    const { renderer, canvas: { clientWidth: width, clientHeight: height } } = this, [left, right] = shown;
    const halves = layout === "wipe" && right ? [[[left], 0, at], [[right], at, 1]] : [[shown, 0, 1]];
    for (const [names, from, to] of halves) {
      for (const name in this.bodies) this.bodies[name].visible = names.includes(name);
      renderer.setScissor(from * width, 0, (to - from) * width, height);
      renderer.render(this.scene, this.camera);
    }
  }

  // Position of the label above a body whose root is at `root`, pixels.
  above(name, root) {
    const { geometry, position } = this.bodies[name], { array } = geometry.attributes.position;
    let top = -Infinity;
    for (let i = 1; i < array.length; i += 3) top = Math.max(top, array[i]);
    const { x, y } = new Vector3(root[0], top + 0.06, root[2]).add(position).project(this.camera);
    return [(x * 0.5 + 0.5) * this.canvas.clientWidth, (0.5 - y * 0.5) * this.canvas.clientHeight];
  }
}
