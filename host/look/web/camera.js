// SPDX-License-Identifier: Apache-2.0
// ViewCamera is the viewer's camera: its position, its orientation (rows right, down, forward in the world),
// the distance of its target in front of it, and its lens. The axes are those of docs/data.md: x right, y
// down, z forward.
'use strict';

const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((v) => v / (Math.hypot(...a) || 1));

// Returns v rotated about a unit axis.
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle), along = dot(axis, v) * (1 - c), side = cross(axis, v);
  return v.map((x, i) => c * x + s * side[i] + along * axis[i]);
}

class ViewCamera {
  // `scene` has the members centre, up and distance. `camera` has the members centre, rotation (9 numbers), fx, fy,
  // cx, cy, width, height, time and extra.
  constructor(scene, camera) {
    this.scene = scene;
    this.set(camera);
  }

  set(camera) {
    this.centre = camera.centre.slice();
    this.axes = [0, 3, 6].map((r) => camera.rotation.slice(r, r + 3));
    this.lens = {
      fx: camera.fx,
      fy: camera.fy,
      cx: camera.cx,
      cy: camera.cy,
      width: camera.width,
      height: camera.height
    };
    this.time = camera.time;
    this.extra = camera.extra || this.extra || [];
    const ahead = dot(add(this.scene.centre, this.centre, -1), this.axes[2]);
    this.distance = ahead > 0.05 * this.scene.distance ? ahead : this.scene.distance;
  }

  get target() { return add(this.centre, this.axes[2], this.distance); }

  // Returns the camera for a canvas of this size. The canvas shows at least the complete image of the lens.
  on(width, height) {
    const l = this.lens, s = Math.min(width / l.width, height / l.height);
    return {
      rotation: this.axes.flat(),
      centre: this.centre,
      fx: s * l.fx,
      fy: s * l.fy,
      width,
      height,
      cx: width / 2 + s * (l.cx - l.width / 2),
      cy: height / 2 + s * (l.cy - l.height / 2),
      query: [this.time, ...this.extra]
    };
  }

  turnAxes(axis, angle) { this.axes = this.axes.map((a) => unit(turned(a, axis, angle))); }

  // Orbits the target: `across` radians about the scene's up axis and `upwards` about the camera's right
  // axis, but not past the poles.
  orbit(across, upwards) {
    const target = this.target, up = unit(this.scene.up);
    this.turnAxes(up, -across);
    const elevation = Math.asin(Math.max(-1, Math.min(1, -dot(this.axes[2], up))));
    const wanted = Math.max(-1.55, Math.min(1.55, elevation + upwards));
    this.turnAxes(this.axes[0], elevation - wanted);
    this.centre = add(target, this.axes[2], -this.distance);
  }

  // Pans by (dx, dy) pixels of a canvas of this size. Points at the depth of the target follow the pointer.
  pan(dx, dy, width, height) {
    const {fx, fy} = this.on(width, height);
    this.centre =
        add(add(this.centre, this.axes[0], -dx * this.distance / fx), this.axes[1], -dy * this.distance / fy);
  }

  zoom(factor) {
    const target = this.target;
    this.distance = Math.max(1e-3 * this.scene.distance, this.distance * factor);
    this.centre = add(target, this.axes[2], -this.distance);
  }

  // Moves the camera together with its target, in units of the target's distance.
  fly(right, down, forward) {
    [right, down, forward].forEach((v, k) => {
      this.centre = add(this.centre, this.axes[k], v * this.distance);
    });
  }

  // Returns whether one of `cameras` saw this view. A camera saw it if three conditions hold. The target is in the
  // image of the camera. The directions from which the camera and this view look at the target differ by at most 60
  // degrees. The distance of this view from the target is at most twice that of the camera.
  isSeenBy(cameras) {
    return cameras.some((c) => {
      const way = add(this.target, c.centre, -1), far = Math.hypot(...way);
      const [x, y, depth] = [0, 3, 6].map((r) => dot(way, c.rotation.slice(r, r + 3)));
      const column = c.fx * x / depth + c.cx, row = c.fy * y / depth + c.cy;
      return depth > 0 && column >= 0 && column <= c.width && row >= 0 && row <= c.height &&
          dot(way, this.axes[2]) >= 0.5 * far && this.distance <= 2 * far;
    });
  }

  // Returns the camera as a string for links.
  text() {
    const numbers =
        [...this.centre, ...this.axes.flat(), this.distance, this.lens.fx / this.lens.width, this.time];
    return numbers.map((v) => Number(v.toPrecision(6))).join(',');
  }

  // Sets the camera from a string that text() returned. Returns false for other strings.
  read(text) {
    const v = text.split(',').map(Number);
    if (v.length !== 15 || !v.every(Number.isFinite) || !(v[12] > 0 && v[13] > 0)) return false;
    const axes = [3, 6, 9].map((r) => v.slice(r, r + 3));
    if (!axes.every((a) => Math.abs(dot(a, a) - 1) < 1e-3)) return false;
    const zoom = v[13] * this.lens.width / this.lens.fx;
    Object.assign(this, {centre: v.slice(0, 3), axes, distance: v[12], time: v[14]});
    this.lens.fx *= zoom;
    this.lens.fy *= zoom;
    return true;
  }
}

// Marks the stage while the camera shows a view that no camera of the capture saw. The style sheet then shows a
// message and a border.
function markUnseen(stage, camera, {captured, cameras}) {
  stage.classList.toggle('unseen', captured && !camera.isSeenBy(cameras));
}
