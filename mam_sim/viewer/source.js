// The page that `mam-sim view --html` writes: one object, a slider for every joint, no network.
// scripts/build_viewer.sh bundles this file with three.js into viewer.js.
import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
const asset = JSON.parse(document.getElementById("asset").textContent);
const view = document.getElementById("view");
const values = new Map(asset.joints.map((joint) => [joint.name, 0]));

// Without a graphics card the processor draws every pixel: fewer and plainer ones while the view moves.
function drawnByProcessor() {
  const probe = document.createElement("canvas").getContext("webgl2");
  const info = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? probe.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
const slow = drawnByProcessor();
const renderer = new THREE.WebGLRenderer({ antialias: !slow });
renderer.shadowMap.enabled = true;
renderer.shadowMap.autoUpdate = false; // only what moves changes the shadows, not the view
renderer.toneMapping = THREE.NeutralToneMapping;
view.appendChild(renderer.domElement);

const scene = new THREE.Scene();
scene.background = new THREE.Color(0xf4f5f7);
if (slow) {
  scene.add(new THREE.HemisphereLight(0xffffff, 0x9a958f, 1.9));
} else {
  const rooms = new THREE.PMREMGenerator(renderer);
  scene.environment = rooms.fromScene(new RoomEnvironment(), 0.04, 0.1, 100, { size: 64 }).texture;
  scene.environmentIntensity = 0.7;
}
const camera = new THREE.PerspectiveCamera(32, 1, 0.001, 1000);
const controls = new OrbitControls(camera, renderer.domElement);
let held = false; // by the pointer
controls.addEventListener("change", draw);
controls.addEventListener("start", () => (held = true));
controls.addEventListener("end", () => {
  held = false;
  draw();
});

const links = asset.links.map(() => {
  const group = new THREE.Group();
  group.matrixAutoUpdate = false;
  scene.add(group);
  return group;
});

function motion(joint, value) {
  if (joint.type === "fixed") return new THREE.Matrix4();
  const axis = new THREE.Vector3(...joint.axis);
  if (joint.type === "prismatic") {
    return new THREE.Matrix4().makeTranslation(axis.multiplyScalar(value));
  }
  const origin = new THREE.Vector3(...joint.origin);
  return new THREE.Matrix4()
    .makeTranslation(origin)
    .multiply(new THREE.Matrix4().makeRotationAxis(axis, value))
    .multiply(new THREE.Matrix4().makeTranslation(origin.negate()));
}

function pose() {
  for (const joint of asset.joints) {
    // parents come first
    links[joint.child].matrix.multiplyMatrices(
      links[joint.parent].matrix,
      motion(joint, values.get(joint.name)),
    );
  }
  renderer.shadowMap.needsUpdate = true;
  draw();
}

let waiting = false;
let resting;
function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    render(0.5e6, 1);
    clearTimeout(resting);
    if (slow && !held) resting = setTimeout(() => render(4e6, 2), 400);
  });
}

// Draw with about so many pixels, where they are to be spared.
function render(pixels, most) {
  const spared = Math.min(most, Math.sqrt(pixels / (view.clientWidth * view.clientHeight)));
  const ratio = slow ? spared : Math.min(window.devicePixelRatio, 2);
  if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
  renderer.render(scene, camera);
}

function plain(color, map = null) {
  const look = { color, map, side: THREE.DoubleSide };
  return slow
    ? new THREE.MeshLambertMaterial(look)
    : new THREE.MeshStandardMaterial({ ...look, roughness: 0.8 });
}

function fit() {
  const { clientWidth: width, clientHeight: height } = view;
  renderer.setSize(width, height);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  draw();
}

function place() {
  const [low, high] = asset.bounds.map((corner) => new THREE.Vector3(...corner));
  const middle = low.clone().add(high).multiplyScalar(0.5);
  const size = high.clone().sub(low).length();
  const away = (1.15 * size) / (2 * Math.tan((camera.fov * Math.PI) / 360)) + 0.4 * size;
  const narrow = Math.max(1, 0.9 / (view.clientWidth / view.clientHeight));
  camera.position.set(-0.78, -0.54, 0.36).normalize().multiplyScalar(away * narrow).add(middle);
  camera.near = size / 500;
  camera.far = size * 60;
  controls.target.copy(middle);

  const light = new THREE.DirectionalLight(0xffffff, 1.6);
  light.position.set(-1.1, -0.6, 1.5).multiplyScalar(size).add(middle);
  light.target.position.copy(middle);
  light.castShadow = true;
  light.shadow.mapSize.set(2048, 2048);
  light.shadow.normalBias = size / 500;
  light.shadow.bias = -0.001; // without it rings of shadow lie on a surface that faces the light
  const reach = 1.4 * size;
  Object.assign(light.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach });
  Object.assign(light.shadow.camera, { near: 0.01 * size, far: 6 * size });
  scene.add(light, light.target);

  const floor = new THREE.Mesh(
    new THREE.CircleGeometry(6 * size, 64),
    new THREE.ShadowMaterial({ opacity: 0.18 }),
  );
  floor.position.set(middle.x, middle.y, low.z - size / 2000);
  floor.receiveShadow = true;
  scene.add(floor);
  controls.update();
}

function slider(text, low, high, unit, digits, moved) {
  const row = document.createElement("div");
  const head = document.createElement("span");
  const name = document.createElement("b");
  const shown = document.createElement("output");
  const input = document.createElement("input");
  name.textContent = text;
  Object.assign(input, { type: "range", min: low, max: high, step: "any", value: 0 });
  input.setAttribute("aria-label", text);
  const tell = () => (shown.textContent = `${Number(input.value).toFixed(digits)} ${unit}`);
  input.addEventListener("input", () => {
    tell();
    moved(Number(input.value));
  });
  tell();
  head.append(name, shown);
  row.append(head, input);
  document.getElementById("joints").append(row);
  return (value) => {
    input.value = value;
    tell();
  };
}

function panel() {
  document.getElementById("name").textContent = asset.name;
  const moving = asset.joints.filter((joint) => joint.type !== "fixed");
  const rows = moving.map((joint) => {
    const factor = joint.type === "prismatic" ? 100 : 180 / Math.PI;
    const unit = joint.type === "prismatic" ? "cm" : "°";
    const digits = joint.type === "prismatic" ? 1 : 0;
    const set = slider(joint.part, joint.lower * factor, joint.upper * factor, unit, digits, (v) => {
      values.set(joint.name, v / factor);
      pose();
    });
    return { joint, set: (value) => set(value * factor) };
  });
  if (rows.length < 2) return;
  slider("everything", 0, 100, "%", 0, (share) => {
    for (const { joint, set } of rows) {
      const value = joint.closed + ((joint.open - joint.closed) * share) / 100;
      values.set(joint.name, value);
      set(value);
    }
    pose();
  });
}

// The same surface without reflections.
function lighten(mesh) {
  const was = mesh.material;
  mesh.material = plain(was.color, was.map);
  for (const key of ["vertexColors", "transparent", "opacity", "alphaTest", "side"]) {
    mesh.material[key] = was[key];
  }
}

function colours() {
  const row = document.createElement("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  row.append(box, "parts in colours");
  row.className = "choice";
  document.getElementById("joints").append(row);
  const own = links.map((_, k) =>
    plain(k ? new THREE.Color().setHSL((0.08 + 0.618 * k) % 1, 0.6, 0.55) : 0xc9ccd1),
  );
  box.addEventListener("change", () => {
    links.forEach((link, k) =>
      link.traverse((child) => {
        if (!child.isMesh) return;
        child.userData.own ??= child.material;
        child.material = box.checked ? own[k] : child.userData.own;
      }),
    );
    draw();
  });
}

const bytes = Uint8Array.from(atob(asset.glb), (c) => c.charCodeAt(0));
new GLTFLoader().parse(bytes.buffer, "", (made) => {
  for (const node of [...made.scene.children]) {
    const index = asset.links.indexOf(node.userData.name ?? node.name);
    links[Math.max(index, 0)].add(node);
    node.traverse((child) => {
      child.castShadow = child.receiveShadow = Boolean(child.isMesh);
      if (slow && child.isMesh) lighten(child);
    });
  }
  panel();
  colours();
  fit();
  place();
  pose();
  document.body.dataset.ready = "yes";
});
window.addEventListener("resize", fit);
