// three.js: bodies side by side, overlaid or under a wipe, in the colours of a number per vertex.
import {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DynamicDrawUsage, Fog, GridHelper,
  HemisphereLight, Mesh, MeshStandardMaterial, PCFSoftShadowMap, PerspectiveCamera, PlaneGeometry,
  Scene, ShadowMaterial, SRGBColorSpace, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { distances } from "./body.js";

// The report's colours of sizes, from none to the scale's end.
export const COLOURS = [[252, 240, 178], [254, 196, 136], [253, 154, 106], [246, 110, 92], [224, 76, 103],
                        [188, 57, 120], [150, 44, 128], [114, 31, 129], [76, 17, 122], [37, 18, 85]];
const srgb = ([r, g, b]) => new Color().setRGB(r / 255, g / 255, b / 255, SRGBColorSpace);
const CLAY = srgb([219, 196, 178]);
const BACKGROUND = 0xf3f1ee;
const APART_M = 1.35;

function surface(own) {
  const made = new MeshStandardMaterial({ roughness: 0.62, metalness: 0, transparent: false });
  made.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, own);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute float size;\nvarying float vSize;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvSize = size;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>
        varying float vSize; uniform float fullM; uniform float coloured; uniform vec3 palette[10]; uniform vec3 clay;`)
      .replace("#include <color_fragment>", `#include <color_fragment>
        float at = clamp(vSize / fullM, 0.0, 0.9999) * 9.0;
        int low = int(at);
        diffuseColor.rgb = mix(clay, mix(palette[low], palette[min(low + 1, 9)], fract(at)), coloured);`);
  };
  return made;
}

export class Stage {
  constructor(canvas, body) {
    this.canvas = canvas;
    this.body = body;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFSoftShadowMap;
    this.scene = new Scene();
    this.scene.background = new Color(BACKGROUND);
    this.scene.fog = new Fog(BACKGROUND, 9, 22);
    this.camera = new PerspectiveCamera(28, 1, 0.1, 60);
    this.camera.position.set(0.5, 0.35, 5);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.set(0, 0.95, 0);
    this.controls.maxPolarAngle = 0.53 * Math.PI;
    this.controls.minDistance = 0.8;
    this.controls.maxDistance = 14;
    this.lights();
    this.shared = { fullM: { value: 0.02 }, clay: { value: CLAY }, palette: { value: COLOURS.map(srgb) } };
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
    ground.position.y = -0.002; // soles are not cut by it
    this.grid = new GridHelper(40, 80, 0xd8d3cb, 0xe3dfd8);
    this.grid.position.y = -0.003;
    this.scene.add(new HemisphereLight(0xffffff, 0xb8aea2, 1.25), key, rim, ground, this.grid);
  }

  figure(name) {
    if (this.bodies[name]) return this.bodies[name];
    const { count, faces } = this.body, geometry = new BufferGeometry();
    geometry.setIndex((this.index ??= new BufferAttribute(faces, 1))); // one for all bodies
    for (const [attribute, width] of [["position", 3], ["normal", 3], ["size", 1]])
      geometry.setAttribute(attribute, new BufferAttribute(new Float32Array(count * width), width).setUsage(DynamicDrawUsage));
    const own = { ...this.shared, coloured: { value: 0 } };
    const mesh = new Mesh(geometry, surface(own));
    mesh.frustumCulled = false; // no bounding sphere to be kept up to date
    mesh.castShadow = mesh.receiveShadow = true;
    mesh.userData = own;
    this.scene.add(mesh);
    return (this.bodies[name] = mesh);
  }

  // The first drawing makes the programs, which is most of its time.
  warm() {
    this.figure("smpl");
    this.draw("side", 0, ["smpl"], [0, 0, 0]);
  }

  // Pose one body: what is drawn next is this frame's in all of its numbers, so that nothing tears.
  pose(name, frame, offsets, gains) {
    const { position, normal, size } = this.figure(name).geometry.attributes;
    this.body.skin(frame.rest, offsets, gains, frame.bones, position.array, size.array);
    this.body.normals(position.array, normal.array);
    position.needsUpdate = normal.needsUpdate = size.needsUpdate = true;
  }

  // colouring: "none", "size" or "apart", the distance to the truth.
  colour(shown, colouring, fullM) {
    this.shared.fullM.value = fullM;
    const truth = this.bodies.truth?.geometry.attributes.position.array;
    for (const name of shown) {
      const { geometry, userData } = this.figure(name);
      const coloured = colouring === "size" ? name !== "smpl" : colouring === "apart" && name !== "truth";
      userData.coloured.value = coloured ? 1 : 0;
      if (coloured && colouring === "apart") distances(geometry.attributes.position.array, truth, geometry.attributes.size.array);
    }
  }

  // Room for all bodies, also on a phone held upright.
  fit(bodies) {
    const { clientWidth: width, clientHeight: height } = this.canvas, ratio = Math.min(devicePixelRatio, 2);
    const size = `${width} ${height} ${ratio}`;
    if (this.sized !== size) {
      this.sized = size;
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
    }
    const fitted = `${bodies} ${this.camera.aspect}`;
    if (this.fitted === fitted) return;
    this.fitted = fitted;
    const high = Math.tan((this.camera.fov * Math.PI) / 360), away = this.camera.position.clone().sub(this.controls.target);
    away.setLength(Math.max(1.24 / high, (0.5 * APART_M * (bodies - 1) + 0.85) / (high * this.camera.aspect)));
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
  }

  // layout: "side", "overlay" or "wipe"; at: where the wipe is, 0 to 1; root: what stays in place.
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
    const only = (names) => { for (const name in this.bodies) this.bodies[name].visible = names.includes(name); };
    const { renderer, scene, camera, canvas } = this, { clientWidth: width, clientHeight: height } = canvas;
    renderer.setScissorTest(false);
    if (layout !== "wipe" || shown.length < 2) {
      only(shown);
      renderer.render(scene, camera);
      return;
    }
    renderer.setScissorTest(true);
    [[0, at], [at, 1]].forEach(([from, to], i) => {
      only([shown[i]]);
      renderer.setScissor(from * width, 0, (to - from) * width, height);
      renderer.render(scene, camera);
    });
  }

  // Where a label belongs above a body, pixels.
  above(name) {
    const { array } = this.bodies[name].geometry.attributes.position, place = this.bodies[name].position;
    let top = -Infinity, at = 0, left = Infinity, right = -Infinity;
    for (let i = 0; i < array.length; i += 3) {
      if (array[i + 1] > top) { top = array[i + 1]; at = array[i + 2]; }
      left = Math.min(left, array[i]); right = Math.max(right, array[i]);
    }
    const p = new Vector3((left + right) / 2, top + 0.06, at).add(place).project(this.camera);
    return [(p.x * 0.5 + 0.5) * this.canvas.clientWidth, (0.5 - p.y * 0.5) * this.canvas.clientHeight];
  }
}
