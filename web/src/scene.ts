// The mechanism, moving: three.js, poses as the page has them, one instant shared with the plots.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Clock } from "./clock";
import type { Arrow, Body, Form, Moving, Scene as Data, Tie, Vec } from "./data";
import { colour } from "./dom";

const Z = new THREE.Vector3(0, 0, 1);
const KINDS = { contact: "good", constraint: "doubt", applied: "bad" } as const;

interface Run { data: Moving; root: THREE.Group; bodies: THREE.Group[]; offset: THREE.Vector3; ties: THREE.Object3D[][] }

export class Stage {
  private readonly renderer: THREE.WebGLRenderer;
  private readonly scene = new THREE.Scene();
  private readonly camera: THREE.PerspectiveCamera;
  private readonly controls: OrbitControls;
  private readonly runs: Run[] = [];
  private readonly arrows: { data: Arrow; object: THREE.Group }[] = [];
  private readonly trails: THREE.Line[] = [];
  private readonly joints: THREE.Object3D[] = [];
  private readonly up: THREE.Vector3;
  private readonly front: THREE.Vector3;
  private readonly flat: boolean;
  private readonly sun = new THREE.DirectionalLight(0xffffff, 2.2);
  private readonly ground = new THREE.Group();
  private readonly lit: { material: THREE.MeshStandardMaterial; dark: string; light: string }[] = [];
  private strongest = 0;
  private cell = 1;
  private waiting = false;
  private last = new THREE.Vector3();
  private touched = false;
  follow: boolean;

  constructor(private readonly data: Data, private readonly clock: Clock, readonly canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.up = new THREE.Vector3(...data.up);
    this.front = new THREE.Vector3(...data.view);
    this.flat = Math.abs(this.front.dot(this.up)) < 1e-6;
    this.follow = data.follow;
    const size = data.size;
    this.camera = new THREE.PerspectiveCamera(this.flat ? 24 : 34, 1, size * 1e-3, Math.max(size, data.radius) * 400);
    this.camera.up.copy(this.up);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.ask());
    this.controls.addEventListener("start", () => { this.touched = true; });
    this.controls.enableDamping = false;
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb7c0cc, 1.6), this.sun, this.sun.target, this.ground);
    this.lights();
    const right = new THREE.Vector3().crossVectors(this.up, this.front).normalize();
    data.runs.forEach((run, k) => this.add(run, k, right));
    for (const force of data.runs[0]?.forces ?? []) this.arrows.push({ data: force, object: this.arrow(force) });
    this.strongest = strongest(data.runs[0]?.forces ?? []);
    for (const [body, point] of data.trails) this.trail(body, point);
    this.theme();
    this.home();
    clock.onMove(() => this.place());
    this.place();
  }

  get counts(): { forces: number; trails: number; joints: number; runs: number } {
    return { forces: this.arrows.length, trails: this.trails.length, joints: this.joints.length, runs: this.runs.length };
  }

  // --- what is there ---

  private lights(): void {
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.radius = 5;
    this.sun.shadow.bias = -0.0008;
    const r = this.data.follow ? 2.2 * this.data.size : Math.max(this.data.radius, this.data.size) * 1.3;
    Object.assign(this.sun.shadow.camera, { left: -r, right: r, top: r, bottom: -r, near: 0.01 * r, far: 12 * r });
    this.sun.shadow.camera.updateProjectionMatrix();
  }

  private aim(at: THREE.Vector3): void {
    const r = Math.max(this.data.radius, this.data.size);
    const right = new THREE.Vector3().crossVectors(this.up, this.front).normalize();
    this.sun.target.position.copy(at);
    const [above, before, left] = this.flat ? [1.6, 4.6, 0.9] : [4, 2.5, 1.5];
    this.sun.position.copy(at).addScaledVector(this.up, above * r).addScaledVector(this.front, before * r).addScaledVector(right, -left * r);
  }

  private material(light: string, dark: string, ghost: boolean): THREE.MeshStandardMaterial {
    const material = new THREE.MeshStandardMaterial({ roughness: 0.55, metalness: 0.05 });
    if (ghost) Object.assign(material, { transparent: true, opacity: 0.3, depthWrite: false });
    this.lit.push({ material, light, dark });
    return material;
  }

  private add(data: Moving, k: number, right: THREE.Vector3): void {
    const beside = this.data.side_by_side;
    const ghost = k > 0 && !beside;
    const root = new THREE.Group();
    const offset = new THREE.Vector3();
    if (beside) offset.copy(right).multiplyScalar(2.25 * this.data.radius * (k - (this.data.runs.length - 1) / 2));
    root.position.copy(offset);
    const bodies = this.data.bodies.map((body, i) => this.body(body, i, ghost));
    root.add(...bodies);
    const ties = ghost ? [] : this.data.ties.map((tie) => this.tie(tie, root, bodies));
    this.scene.add(root);
    this.runs.push({ data, root, bodies, offset, ties });
  }

  private body(body: Body, i: number, ghost: boolean): THREE.Group {
    const group = new THREE.Group();
    group.name = body.name;
    const own = ghost ? this.material("#8a8f98", "#9aa3b0", true) : this.material(`var:b${(i - 1 + 8) % 8}`, `var:b${(i - 1 + 8) % 8}`, false);
    for (const form of body.forms) {
      if (form.kind === "plane") continue; // the grid stands for it
      let material = own;
      if (form.colour && !ghost) {
        const c = `#${new THREE.Color().setRGB(form.colour[0], form.colour[1], form.colour[2], THREE.SRGBColorSpace).getHexString()}`;
        material = this.material(c, c, false);
        if (form.colour[3] < 1) Object.assign(material, { transparent: true, opacity: form.colour[3] });
      }
      const mesh = new THREE.Mesh(geometry(form), material);
      mesh.position.set(...form.position);
      mesh.quaternion.set(...form.rotation);
      if (form.kind === "capsule" || form.kind === "cylinder") mesh.quaternion.multiply(new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(1, 0, 0), Math.PI / 2));
      mesh.castShadow = !ghost;
      mesh.receiveShadow = !ghost;
      group.add(mesh);
    }
    const joint = body.carried;
    if (joint && !ghost && joint.kind !== "free" && joint.kind !== "fixed") {
      const r = 0.02 * this.data.size;
      const marker = new THREE.Mesh(
        joint.axis && joint.kind !== "prismatic" ? new THREE.CylinderGeometry(r, r, 2.4 * r, 24) : joint.kind === "prismatic" ? new THREE.BoxGeometry(1.7 * r, 3 * r, 1.7 * r) : new THREE.SphereGeometry(1.1 * r, 20, 14),
        this.material("#3a4048", "#d7dde6", false));
      marker.position.set(...joint.position);
      if (joint.axis) marker.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...joint.axis).normalize());
      marker.visible = body.inferred || !body.forms.some((f) => f.colour);
      marker.name = joint.name;
      group.add(marker);
      this.joints.push(marker);
    }
    return group;
  }

  private tie(tie: Tie, root: THREE.Group, bodies: THREE.Group[]): THREE.Object3D[] {
    const thin = 0.009 * this.data.size;
    if (tie.kind === "loop") {
      const [body, point] = tie.points[0]!;
      const ring = new THREE.Mesh(new THREE.TorusGeometry(2.6 * thin, 0.8 * thin, 12, 28), this.material("#c2410c", "#ff9d5c", false));
      ring.position.set(...point);
      ring.quaternion.setFromUnitVectors(Z, this.flat ? this.front : this.up);
      ring.name = tie.name;
      bodies[body]!.add(ring);
      return [];
    }
    const made = tie.points.slice(1).map(() => {
      const shape = tie.kind === "spring" ? coil(1.6 * thin, 0.45 * thin) : new THREE.CylinderGeometry(thin, thin, 1, 12).rotateX(Math.PI / 2).translate(0, 0, 0.5);
      const mesh = new THREE.Mesh(shape, tie.kind === "rod" ? this.material("#57606b", "#b9c2cf", false) : this.material("#0f766e", "#4fd1c0", false));
      mesh.name = tie.name;
      mesh.castShadow = true;
      root.add(mesh);
      return mesh;
    });
    return made;
  }

  private arrow(force: Arrow): THREE.Group {
    const group = new THREE.Group();
    const s = 0.013 * this.data.size;
    const material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.85 }); // seen through bodies
    this.lit.push({ material: material as unknown as THREE.MeshStandardMaterial, light: `var:${KINDS[force.kind]}`, dark: `var:${KINDS[force.kind]}` });
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.55 * s, 0.55 * s, 1, 10).translate(0, 0.5, 0).rotateX(Math.PI / 2), material);
    const head = new THREE.Mesh(new THREE.ConeGeometry(1.6 * s, 4 * s, 16).translate(0, 2 * s, 0).rotateX(Math.PI / 2), material);
    shaft.renderOrder = head.renderOrder = 5;
    group.add(shaft, head);
    group.name = force.name;
    this.runs[0]!.root.add(group);
    return group;
  }

  private trail(body: number, point: Vec): void {
    const { poses, t } = this.data.runs[0]!;
    const places = new Float32Array(3 * t.length);
    const p = new THREE.Vector3(), q = new THREE.Quaternion(), v = new THREE.Vector3();
    for (let f = 0; f < t.length; f++) {
      pose(poses, this.data.bodies.length, f, body, p, q);
      v.set(...point).applyQuaternion(q).add(p).toArray(places, 3 * f);
    }
    const line = new THREE.Line(new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(places, 3)), new THREE.LineBasicMaterial({ transparent: true, opacity: 0.75 }));
    line.frustumCulled = false;
    this.lit.push({ material: line.material as unknown as THREE.MeshStandardMaterial, light: `var:b${(body - 1) % 8}`, dark: `var:b${(body - 1) % 8}` });
    this.runs[0]!.root.add(line);
    this.trails.push(line);
  }

  private grid(): void {
    this.ground.clear();
    const reach = this.data.follow ? 8 * this.data.size : 2.4 * Math.max(this.data.radius, this.data.size) * (this.data.side_by_side ? 2 : 1);
    this.cell = 10 ** Math.floor(Math.log10(Math.max(this.data.size, 0.2 * this.data.radius) / 2.5));
    for (const m of [5, 2]) if (reach / (this.cell * m) > 9) { this.cell *= m; break; }
    const n = 2 * Math.ceil(reach / this.cell);
    const grid = new THREE.GridHelper(n * this.cell, n, colour("gridline"), colour("gridline"));
    (grid.material as THREE.Material).transparent = true;
    (grid.material as THREE.Material).opacity = 0.75;
    const normal = this.flat ? this.front : this.up;
    grid.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), normal);
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(n * this.cell, n * this.cell), new THREE.ShadowMaterial({ opacity: 0.16 }));
    shade.quaternion.setFromUnitVectors(Z, normal);
    shade.receiveShadow = true;
    this.ground.add(grid, shade);
  }

  private putGround(at: THREE.Vector3): void {
    const normal = this.flat ? this.front : this.up;
    const c = at.clone();
    const height = this.flat ? c.dot(normal) - 0.25 * this.data.size : (this.data.floor ?? c.dot(normal) - this.data.radius);
    c.addScaledVector(normal, height - c.dot(normal));
    const q = this.ground.children[0]!.quaternion;
    const local = c.clone().applyQuaternion(q.clone().invert());
    local.x = Math.round(local.x / this.cell) * this.cell;
    local.z = Math.round(local.z / this.cell) * this.cell;
    this.ground.position.copy(local.applyQuaternion(q));
  }

  // --- what is seen ---

  theme(): void {
    const dark = document.documentElement.dataset.theme === "dark";
    for (const { material, light, dark: night } of this.lit) {
      const wanted = dark ? night : light;
      material.color.set(wanted.startsWith("var:") ? colour(wanted.slice(4)) : wanted);
    }
    this.grid();
    this.place();
  }

  home(): void {
    this.touched = false;
    const aspect = this.camera.aspect || 1;
    const slope = Math.tan((this.camera.fov * Math.PI) / 360);
    const [w, h, d] = this.follow ? [0.7 * this.data.size, 0.7 * this.data.size, 0] : this.data.half;
    const beside = this.data.side_by_side ? 1.125 * this.data.radius * (this.data.runs.length - 1) : 0;
    const distance = 1.12 * Math.max((w + beside) / (slope * aspect), h / slope) + d;
    const target = this.follow ? this.middle() : new THREE.Vector3(...this.data.centre);
    this.controls.target.copy(target);
    this.last.copy(target);
    this.camera.position.copy(target).addScaledVector(this.front, distance);
    this.controls.update();
    this.place();
  }

  resize(): void {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (!w || !h) return;
    this.renderer.setSize(w, h, false);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    if (!this.touched) this.home();
    this.ask();
  }

  show(what: "forces" | "trails" | "joints" | "runs", on: boolean): void {
    if (what === "forces") for (const { object } of this.arrows) object.userData.off = !on;
    if (what === "trails") for (const line of this.trails) line.visible = on;
    if (what === "joints") for (const marker of this.joints) marker.visible = on;
    if (what === "runs") this.runs.slice(1).forEach((run) => { run.root.visible = on; });
    this.place();
  }

  get jointsShown(): boolean {
    return this.joints.some((j) => j.visible);
  }

  /** Where a body of a run is at the page's instant, as it is drawn. */
  pose(run: number, body: number): number[] {
    const group = this.runs[run]!.bodies[body]!;
    return [...group.position.toArray(), ...(group.quaternion.toArray() as number[])];
  }

  point(element: string): boolean {
    let found = false;
    this.scene.traverse((object) => {
      if (object.name === element && !found) {
        found = true;
        const was: [THREE.Object3D, number][] = [];
        object.traverse((part) => {
          const material = (part as THREE.Mesh).material as THREE.MeshStandardMaterial | undefined;
          if (material?.emissive) { was.push([part, material.emissive.getHex()]); material.emissive.set(colour("bad")); }
        });
        this.ask();
        setTimeout(() => {
          for (const [part, hex] of was) ((part as THREE.Mesh).material as THREE.MeshStandardMaterial).emissive.setHex(hex);
          this.ask();
        }, 1600);
      }
    });
    return found;
  }

  /** Names of what is under a point of the canvas. */
  under(x: number, y: number): string {
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2((x / this.canvas.clientWidth) * 2 - 1, 1 - (y / this.canvas.clientHeight) * 2), this.camera);
    for (const hit of ray.intersectObjects([...this.runs.map((r) => r.root)], true)) {
      if ((hit.object as THREE.Mesh).isMesh) {
        for (let o: THREE.Object3D | null = hit.object; o; o = o.parent) if (o.name) return o.name;
      }
    }
    return "";
  }

  private middle(): THREE.Vector3 {
    const sum = new THREE.Vector3();
    const bodies = this.runs[0]!.bodies.slice(1);
    for (const body of bodies) sum.add(body.position);
    return sum.divideScalar(bodies.length || 1);
  }

  private place(): void {
    const p = new THREE.Vector3(), q = new THREE.Quaternion(), p2 = new THREE.Vector3(), q2 = new THREE.Quaternion();
    const n = this.data.bodies.length;
    for (const run of this.runs) {
      const [frame, part] = at(run.data.t, this.clock.t);
      run.bodies.forEach((group, i) => {
        pose(run.data.poses, n, frame, i, p, q);
        if (part > 0) {
          pose(run.data.poses, n, frame + 1, i, p2, q2);
          p.lerp(p2, part);
          q.slerp(q2, part);
        }
        group.position.copy(p);
        group.quaternion.copy(q);
        group.updateMatrix();
      });
      this.data.ties.forEach((tie, k) => run.ties[k]?.forEach((object, j) => {
        const a = this.spot(run, tie.points[j]!), b = this.spot(run, tie.points[j + 1]!);
        stretch(object, a, b);
      }));
    }
    const first = this.runs[0];
    if (first) {
      const [frame, part] = at(first.data.t, this.clock.t);
      for (const { data, object } of this.arrows) this.force(data, object, frame, part);
      const from = at(first.data.t, this.clock.t - Math.max(0.12 * (this.clock.end - this.clock.start), 0))[0];
      for (const line of this.trails) line.geometry.setDrawRange(from, frame - from + 1);
      const middle = this.middle();
      if (this.follow) {
        const shift = middle.clone().sub(this.last);
        this.camera.position.add(shift);
        this.controls.target.add(shift);
        this.controls.update();
      }
      this.last.copy(middle);
      const around = this.data.follow ? middle : new THREE.Vector3(...this.data.centre);
      this.aim(around);
      if (this.ground.children.length) this.putGround(around);
    }
    this.ask();
  }

  private spot(run: Run, [body, point]: [number, Vec]): THREE.Vector3 {
    const group = run.bodies[body]!;
    return new THREE.Vector3(...point).applyQuaternion(group.quaternion).add(group.position);
  }

  private force(data: Arrow, object: THREE.Group, frame: number, part: number): void {
    const vector = (values: Float32Array) => {
      const v = new THREE.Vector3().fromArray(values, 3 * frame);
      if (part > 0) v.lerp(new THREE.Vector3().fromArray(values, 3 * frame + 3), part);
      return v;
    };
    const f = vector(data.force);
    const size = f.length() / (this.strongest || 1);
    object.visible = !object.userData.off && size > 0.01;
    if (!object.visible) return;
    const length = Math.min(size, 1.5) * 0.55 * this.data.size;
    const [shaft, head] = object.children as [THREE.Mesh, THREE.Mesh];
    shaft.scale.set(1, 1, length);
    head.position.set(0, 0, length);
    head.scale.setScalar(Math.min(1, 0.35 + 2 * size));
    object.position.copy(vector(data.at));
    object.quaternion.setFromUnitVectors(Z, f.normalize());
  }

  private ask(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.renderer.render(this.scene, this.camera);
    });
  }
}

function pose(poses: Float32Array, bodies: number, frame: number, body: number, p: THREE.Vector3, q: THREE.Quaternion): void {
  const k = 7 * (frame * bodies + body);
  p.fromArray(poses, k);
  q.fromArray(poses, k + 3);
}

/** The frame at or before an instant, and how far on the way to the next. */
function at(t: Float64Array, now: number): [number, number] {
  let a = 0, b = t.length - 1;
  if (now >= t[b]!) return [b, 0];
  while (b - a > 1) {
    const k = (a + b) >> 1;
    if (t[k]! <= now) a = k;
    else b = k;
  }
  return [a, Math.max(0, (now - t[a]!) / (t[b]! - t[a]!))];
}

/** The size that nearly all forces stay below: one blow shall not make all others invisible. */
function strongest(forces: Arrow[]): number {
  const sizes: number[] = [];
  for (const { force } of forces) for (let k = 0; k < force.length; k += 3) {
    const size = Math.hypot(force[k]!, force[k + 1]!, force[k + 2]!);
    if (size > 0 && Number.isFinite(size)) sizes.push(size);
  }
  sizes.sort((a, b) => a - b);
  return sizes[Math.floor(0.97 * (sizes.length - 1))] ?? 0;
}

function geometry(form: Form): THREE.BufferGeometry {
  const [a = 0, b = 0, c = 0] = form.size;
  switch (form.kind) {
    case "sphere": return new THREE.SphereGeometry(a, 32, 20);
    case "box": return new THREE.BoxGeometry(a, b, c);
    case "capsule": return new THREE.CapsuleGeometry(a, b, 8, 20);
    case "cylinder": return new THREE.CylinderGeometry(a, a, b, 40);
    case "ellipsoid": return new THREE.SphereGeometry(1, 32, 20).scale(a, b, c);
    case "mesh": {
      const plain = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(form.vertices!, 3)).setIndex(form.faces!);
      const made = plain.toNonIndexed();
      made.computeVertexNormals();
      return made;
    }
    default: return new THREE.BufferGeometry();
  }
}

/** A spring of length 1 along z. */
function coil(radius: number, wire: number): THREE.BufferGeometry {
  const points: THREE.Vector3[] = [];
  const turns = 9, n = 160;
  for (let k = 0; k <= n; k++) {
    const s = k / n;
    const r = radius * Math.min(1, 12 * s, 12 * (1 - s));
    points.push(new THREE.Vector3(r * Math.cos(2 * Math.PI * turns * s), r * Math.sin(2 * Math.PI * turns * s), s));
  }
  return new THREE.TubeGeometry(new THREE.CatmullRomCurve3(points), 260, wire, 6);
}

function stretch(object: THREE.Object3D, a: THREE.Vector3, b: THREE.Vector3): void {
  const along = b.clone().sub(a);
  const length = along.length();
  object.visible = length > 0;
  if (!length) return;
  object.position.copy(a);
  object.quaternion.setFromUnitVectors(Z, along.divideScalar(length));
  object.scale.set(1, 1, length);
}
