// SPDX-License-Identifier: Apache-2.0
// Script of the page of `ubs report`. The panes of a set share one transformation. It is kept in fractions of the
// pane, which differ in size. The wheel scrolls the page until the mouse has been moved over a pane, so that
// scrolling past pictures does not zoom them.
'use strict';
let armed = false;
addEventListener('scroll', () => { armed = false; }, { passive: true });
for (const set of document.querySelectorAll('.zoom')) {
  const panes = [...set.querySelectorAll('.pane')];
  const readout = set.nextElementSibling;
  let zoom = 1, left = 0, top = 0, drag = null;
  for (const pane of panes) pane.appendChild(document.createElement('i'));
  const clamp = (v) => Math.min(0, Math.max(1 - zoom, v));
  const place = (e, pane) => {
    const box = pane.getBoundingClientRect();
    return [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height];
  };
  const show = () => {
    left = clamp(left);
    top = clamp(top);
    for (const pane of panes)
      pane.firstElementChild.style.transform = `translate(${100 * left}%, ${100 * top}%) scale(${zoom})`;
  };
  const point = (x, y) => {
    for (const pane of panes) {
      pane.classList.add('at');
      pane.lastElementChild.style.left = `${100 * x}%`;
      pane.lastElementChild.style.top = `${100 * y}%`;
    }
    const image = panes[0].firstElementChild;
    const width = Number(set.dataset.width), height = width * image.naturalHeight / image.naturalWidth;
    const at = (v, size) => Math.max(0, Math.min(Math.ceil(size) - 1, Math.floor(v * size)));
    readout.textContent = `pixel ${at((x - left) / zoom, width)}, ${at((y - top) / zoom, height)}, zoom ${zoom.toFixed(1)}`;
  };
  for (const pane of panes) {
    pane.addEventListener('wheel', (e) => {
      const next = Math.min(64, Math.max(1, zoom * Math.exp(-e.deltaY * (e.deltaMode ? 0.06 : 0.002))));
      if (!armed || next === zoom) return;
      e.preventDefault();
      const [x, y] = place(e, pane);
      left = x - (x - left) / zoom * next;
      top = y - (y - top) / zoom * next;
      zoom = next;
      show();
      point(x, y);
    }, { passive: false });
    pane.addEventListener('pointerdown', (e) => {
      drag = place(e, pane);
      pane.setPointerCapture(e.pointerId);
      e.preventDefault();
    });
    pane.addEventListener('pointermove', (e) => {
      if (e.movementX || e.movementY) armed = true;
      const [x, y] = place(e, pane);
      if (drag) {
        left += x - drag[0];
        top += y - drag[1];
        drag = [x, y];
        show();
      }
      point(x, y);
    });
    for (const end of ['pointerup', 'pointercancel']) pane.addEventListener(end, () => { drag = null; });
    pane.addEventListener('dblclick', () => { zoom = 1; left = top = 0; show(); });
    pane.addEventListener('pointerleave', () => {
      for (const other of panes) other.classList.remove('at');
      readout.textContent = '\u00a0';
    });
  }
}
