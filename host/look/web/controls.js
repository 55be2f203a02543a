// SPDX-License-Identifier: Apache-2.0
// Controls moves a camera (camera.js) with mouse, touch and keys over a canvas.

class Controls {
  // `changed()` is called after every movement; `keys` maps keys to further actions; `wanted()` returns
  // whether the wheel should zoom the image instead of scrolling the page.
  constructor(canvas, camera, changed, keys, wanted = () => true) {
    Object.assign(this, {canvas, camera, changed, pointers: new Map()});
    const turn = 0.08;
    this.keys = {
      arrowleft: () => camera.orbit(turn, 0),
      arrowright: () => camera.orbit(-turn, 0),
      arrowup: () => camera.orbit(0, turn),
      arrowdown: () => camera.orbit(0, -turn),
      '+': () => camera.zoom(0.9),
      '=': () => camera.zoom(0.9),
      '-': () => camera.zoom(1.1),
      ...keys,
    };
    canvas.addEventListener('contextmenu', (e) => e.preventDefault());
    canvas.addEventListener('pointerdown', (e) => {
      this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
      canvas.setPointerCapture?.(e.pointerId);
      canvas.focus({preventScroll: true});
    });
    for (const end of ['pointerup', 'pointercancel'])
      canvas.addEventListener(end, (e) => this.pointers.delete(e.pointerId));
    canvas.addEventListener('pointermove', (e) => this.drag(e));
    canvas.addEventListener('wheel', (e) => {
      if (!wanted()) return;
      e.preventDefault();
      camera.zoom(Math.exp(e.deltaY * (e.deltaMode ? 0.03 : 0.001)));
      changed();
    }, {passive: false});
    canvas.addEventListener('keydown', (e) => this.key(e));
  }

  drag(e) {
    const from = this.pointers.get(e.pointerId);
    if (!from) return;
    const box = this.canvas.getBoundingClientRect(), to = [e.clientX, e.clientY], dx = to[0] - from[0],
          dy = to[1] - from[1];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== e.pointerId)[1];
      const apart = (p) => Math.max(8, Math.hypot(p[0] - other[0], p[1] - other[1]));
      this.camera.zoom(apart(from) / apart(to));
      this.camera.pan(dx / 2, dy / 2, box.width, box.height);
    } else if (e.shiftKey || e.buttons & 6) {
      this.camera.pan(dx, dy, box.width, box.height);
    } else {
      this.camera.orbit(5 * dx / box.width, 4 * dy / box.height);
    }
    this.pointers.set(e.pointerId, to);
    this.changed();
  }

  key(e) {
    if (e.ctrlKey || e.altKey || e.metaKey) return;
    const action = this.keys[e.key.toLowerCase()];
    if (!action) return;
    e.preventDefault();
    action();
    this.changed();
  }
}
