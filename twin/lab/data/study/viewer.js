'use strict';
// Draws a grasp: the hand's links by forward kinematics, the object, and where they touch. Orthographic, with a depth buffer.
const Viewer = (() => {
  const mul = (a, b) => {
    const m = new Array(9);
    for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++)
      m[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    return m;
  };
  const at = (m, x, y, z) => [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => { const n = Math.hypot(...a) || 1; return a.map(x => x / n); };
  const turn = (axis, angle) => {
    const [x, y, z] = axis, c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
    return [c + x * x * d, x * y * d - z * s, x * z * d + y * s, y * x * d + z * s, c + y * y * d, y * z * d - x * s,
      z * x * d - y * s, z * y * d + x * s, c + z * z * d];
  };
  const quaternion = (i, j, k, w) => [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w),
    2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), 2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)];

  // The same first view as the pictures of `hand check`: onto the palm, a little from the side, fingers up.
  const FIRST = (() => {
    const eye = unit([0.35, 0.15, -1]), right = unit(cross([0, 1, 0], eye));
    return [...right, ...cross(eye, right), ...eye];
  })();
  const COLORS = { hand: [226, 168, 178], palm: [206, 146, 158], object: [110, 150, 205], contact: [40, 170, 70] };

  return class {
    constructor(canvas, scene) {
      this.canvas = canvas; this.scene = scene; this.context = canvas.getContext('2d');
      this.image = this.context.createImageData(canvas.width, canvas.height);
      this.depth = new Float32Array(canvas.width * canvas.height);
      this.on = { hand: true, object: true, contacts: true };
      this.reset();
    }
    reset() { this.view = FIRST; this.zoom = 1; }
    // Makes the canvas turn under the mouse or finger, zoom under the wheel, and start over on a double click.
    interactive() {
      const canvas = this.canvas; let last = null;
      canvas.addEventListener('pointerdown', e => { last = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener('pointerup', () => { last = null; });
      canvas.addEventListener('pointermove', e => {
        if (!last) return;
        this.rotate((e.clientX - last[0]) / 120, (e.clientY - last[1]) / 120);
        last = [e.clientX, e.clientY];
      });
      canvas.addEventListener('wheel', e => {
        e.preventDefault(); this.zoom = Math.min(6, Math.max(0.4, this.zoom * Math.exp(-e.deltaY / 500))); this.draw();
      }, { passive: false });
      canvas.addEventListener('dblclick', () => { this.reset(); this.draw(); });
    }
    rotate(x, y) { this.view = mul(mul(turn([1, 0, 0], y), turn([0, 1, 0], x)), this.view); this.draw(); }
    show(grasp) { this.grasp = grasp; this.draw(); }

    links(q) {
      const poses = [{ r: [1, 0, 0, 0, 1, 0, 0, 0, 1], t: [0, 0, 0] }];
      this.scene.joints.forEach((joint, n) => {
        const parent = poses[joint.p + 1], t = at(parent.r, ...joint.t);
        poses.push({ r: mul(mul(parent.r, joint.r), turn([0, 0, 1], q[n])), t: t.map((x, k) => x + parent.t[k]) });
      });
      return poses;
    }

    draw() {
      const { width, height } = this.canvas, data = this.image.data, grasp = this.grasp;
      data.fill(250); for (let n = 3; n < data.length; n += 4) data[n] = 255;
      this.depth.fill(-1e9);
      if (grasp) {
        this.scale = this.zoom * width / 0.24;
        const place = grasp.p;
        if (this.on.hand) this.links(grasp.q).forEach((pose, n) => this.mesh(this.scene.links[n], pose, n ? COLORS.hand : COLORS.palm));
        if (this.on.object) {
          const pose = { r: quaternion(...place.slice(3)), t: place.slice(0, 3) };
          this.mesh(grasp.mesh || this.scene.objects[grasp.o].mesh, pose, COLORS.object);
        }
        if (this.on.contacts) for (const c of grasp.c) this.disc(c);
      }
      this.context.putImageData(this.image, 0, 0);
    }

    mesh(mesh, pose, color) {
      const { width, height } = this.canvas, r = mul(this.view, pose.r), t = at(this.view, ...pose.t), v = mesh.v, points = [];
      const middle = at(this.view, 0.01, -0.015, -0.015);
      for (let n = 0; n < v.length; n += 3) {
        const p = at(r, v[n] * 1e-4, v[n + 1] * 1e-4, v[n + 2] * 1e-4);
        points.push([width / 2 + this.scale * (p[0] + t[0] - middle[0]), height / 2 - this.scale * (p[1] + t[1] - middle[1]),
          this.scale * (p[2] + t[2] - middle[2])]);
      }
      for (let n = 0; n < mesh.f.length; n += 3) this.triangle(points[mesh.f[n]], points[mesh.f[n + 1]], points[mesh.f[n + 2]], color, 0);
    }

    // A contact: a disc of 5 mm radius that shows through 15 mm of what covers it.
    disc(c) {
      const { width, height } = this.canvas, middle = at(this.view, 0.01, -0.015, -0.015);
      const p = at(this.view, c[0], c[1], c[2]).map((x, k) => x - middle[k]), n = at(this.view, c[3], c[4], c[5]);
      const u = unit(cross(n, Math.abs(n[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0])), w = cross(n, u), rim = [];
      for (let k = 0; k <= 12; k++) {
        const a = k * Math.PI / 6, q = p.map((x, m) => x + 0.005 * (Math.cos(a) * u[m] + Math.sin(a) * w[m]));
        rim.push([width / 2 + this.scale * q[0], height / 2 - this.scale * q[1], this.scale * q[2]]);
      }
      const center = [width / 2 + this.scale * p[0], height / 2 - this.scale * p[1], this.scale * p[2]];
      for (let k = 0; k < 12; k++) this.triangle(center, rim[k], rim[k + 1], COLORS.contact, 0.015 * this.scale);
    }

    triangle(a, b, c, color, bias) {
      const { width, height } = this.canvas, data = this.image.data, depth = this.depth;
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      if (Math.abs(area) < 1e-6) return;
      const n = unit(cross([b[0] - a[0], a[1] - b[1], b[2] - a[2]], [c[0] - a[0], a[1] - c[1], c[2] - a[2]]));
      if (n[2] < 0) { n[0] = -n[0]; n[1] = -n[1]; n[2] = -n[2]; }
      const light = 0.42 + 0.38 * Math.max(0, -0.35 * n[0] + 0.55 * n[1] + 0.75 * n[2]) + 0.22 * n[2];
      const rgb = color.map(x => Math.min(255, x * light));
      const x0 = Math.max(0, Math.ceil(Math.min(a[0], b[0], c[0]))), x1 = Math.min(width - 1, Math.floor(Math.max(a[0], b[0], c[0])));
      const y0 = Math.max(0, Math.ceil(Math.min(a[1], b[1], c[1]))), y1 = Math.min(height - 1, Math.floor(Math.max(a[1], b[1], c[1])));
      for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) {
        const u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
        const v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area, w = 1 - u - v;
        if (u < -1e-9 || v < -1e-9 || w < -1e-9) continue;
        const z = w * a[2] + u * b[2] + v * c[2] + bias, at = y * width + x;
        if (z > depth[at]) {
          depth[at] = z;
          data[4 * at] = rgb[0]; data[4 * at + 1] = rgb[1]; data[4 * at + 2] = rgb[2];
        }
      }
    }
  };
})();
