// SPDX-License-Identifier: Apache-2.0
// Style and script of the page of `ubs report`.
#include "host/report/report_sections.hpp"

namespace ubs {

// Colours of series: Okabe and Ito, distinct for colour-blind readers too; lightened where the page is dark.
std::string report_style() {
  return R"css(
:root { --page: #fbfbfa; --ink: #1d1f21; --soft: #6a6f75; --edge: #dcdedf; --panel: #ffffff; --mark: #fff1c9;
  --good: #17733c; --bad: #b3261e; --s0: #0072b2; --s1: #d55e00; --s2: #009e73; --s3: #b0538c; --s4: #b97f00;
  --s5: #2f8fc4; --s6: #5a5a5a; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --page: #16181a; --ink: #e4e6e8; --soft: #9aa0a6; --edge: #34383c;
  --panel: #1e2124; --mark: #4a3d12; --good: #6fcf8e; --bad: #f28b82; --s0: #56b4e9; --s1: #ff8b3d; --s2: #3fd0a4;
  --s3: #e39bc4; --s4: #ecb23e; --s5: #8fd0f5; --s6: #b4b4b4; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1280px; margin: 0 auto; padding: 0 20px 40px; }
header { padding-top: 26px; }
h1 { margin: 0 0 10px; font-size: 28px; line-height: 1.2; overflow-wrap: anywhere; }
h2 { margin: 44px 0 10px; font-size: 21px; border-bottom: 1px solid var(--edge); padding-bottom: 5px; }
h3 { margin: 24px 0 8px; font-size: 16px; overflow-wrap: anywhere; }
h4 { margin: 16px 0 6px; font-size: 14px; font-weight: 600; color: var(--soft); }
p { margin: 6px 0; }
.kicker, .note, .sources, footer, figcaption, .readout { color: var(--soft); font-size: 13px; }
.kicker { margin: 0; text-transform: uppercase; letter-spacing: .06em; }
.note { max-width: 80em; }
.sources { list-style: none; margin: 6px 0; padding: 0; }
.sources:empty { display: none; }
.remarks, .warn { background: var(--mark); border-radius: 6px; padding: 8px 12px; }
.remarks { padding-left: 28px; margin: 10px 0; }
nav { position: sticky; top: 0; z-index: 2; background: var(--page); padding: 8px 0; border-bottom: 1px solid var(--edge);
  display: flex; flex-wrap: wrap; gap: 4px 18px; }
nav a { color: var(--soft); text-decoration: none; font-size: 14px; }
nav a:hover { color: var(--ink); }
section { scroll-margin-top: 30px; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(125px, 1fr)); gap: 10px; margin: 12px 0 18px; }
.card { background: var(--panel); border: 1px solid var(--edge); border-radius: 8px; padding: 10px 12px; }
.card b { display: block; font-size: 19px; font-variant-numeric: tabular-nums; }
.card span { color: var(--soft); font-size: 12px; }
.scroll { overflow-x: auto; max-height: 620px; overflow-y: auto; margin: 8px 0; }
table { border-collapse: collapse; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 4px 14px 4px 0; border-bottom: 1px solid var(--edge); vertical-align: top; }
thead th { position: sticky; top: 0; background: var(--page); }
th { font-weight: 500; }
tbody th { color: var(--soft); white-space: nowrap; }
td { overflow-wrap: anywhere; min-width: 6em; }
.number { text-align: right; white-space: nowrap; }
tr.differ td, tr.differ th { background: var(--mark); }
.better { color: var(--good); } .worse { color: var(--bad); } .same { color: var(--soft); }
.better, .worse, .same { font-size: 12px; display: inline-block; min-width: 4.5em; text-align: right; }
.track { display: block; height: 4px; width: 150px; margin: 2px 0 2px auto; background: var(--edge); border-radius: 2px; }
.bar { display: block; height: 4px; border-radius: 2px; background: var(--tone); }
code { font: 12.5px ui-monospace, monospace; }
details { margin: 10px 0; } summary { cursor: pointer; font-weight: 600; }
.c0 { --tone: var(--s0); } .c1 { --tone: var(--s1); } .c2 { --tone: var(--s2); } .c3 { --tone: var(--s3); }
.c4 { --tone: var(--s4); } .c5 { --tone: var(--s5); } .c6 { --tone: var(--s6); }
.run { color: var(--tone); font-weight: 600; }
.run::before { content: ""; display: inline-block; width: .7em; height: .7em; border-radius: 50%; background: var(--tone);
  margin-right: .35em; }
.legend .run { margin-right: 14px; }
figure { margin: 0; min-width: 0; }
.charts { display: grid; gap: 14px; }
.charts.four { grid-template-columns: repeat(4, 1fr); } .charts.two { grid-template-columns: repeat(2, 1fr); }
.charts figure { background: var(--panel); border: 1px solid var(--edge); border-radius: 8px; padding: 6px 8px; }
.charts.two { max-width: 860px; }
@media (max-width: 1000px) { .charts.four { grid-template-columns: repeat(2, 1fr); } }
.chart { display: block; width: 100%; height: auto; }
.chart text { fill: var(--soft); font-size: 10.5px; } .chart .mid { text-anchor: middle; } .chart .end { text-anchor: end; }
.chart text.title { fill: var(--ink); font-size: 13px; font-weight: 600; }
.grid { stroke: var(--edge); stroke-width: .7; fill: none; } .frame { stroke: var(--soft); stroke-width: .7; fill: none; }
.line { fill: none; stroke: var(--tone); stroke-width: 1.6; stroke-linejoin: round; } .faint { stroke-width: .8; opacity: .35; }
.dot { fill: var(--tone); }
.zoom { display: grid; gap: 8px; }
.n1 { grid-template-columns: 1fr; } .n2 { grid-template-columns: repeat(2, 1fr); } .n3 { grid-template-columns: repeat(3, 1fr); }
.n4 { grid-template-columns: repeat(4, 1fr); } .n5 { grid-template-columns: repeat(5, 1fr); } .n6 { grid-template-columns: repeat(6, 1fr); }
.pane { position: relative; overflow: hidden; border-radius: 4px; cursor: crosshair; background: #000; touch-action: pan-y; }
.pane img { display: block; width: 100%; height: auto; transform-origin: 0 0; image-rendering: pixelated; user-select: none; }
.pane i { position: absolute; width: 13px; height: 13px; margin: -6.5px; pointer-events: none; border: 1.5px solid #fff;
  border-radius: 50%; mix-blend-mode: difference; display: none; }
.pane.at i { display: block; }
.facts { align-self: center; justify-self: center; }
.side { display: flex; flex-wrap: wrap; gap: 0 60px; align-items: flex-start; }
.blank { display: flex; align-items: center; justify-content: center; border: 1px dashed var(--edge); border-radius: 4px; min-height: 60px; }
.readout { margin: 2px 0 0; text-align: right; font-variant-numeric: tabular-nums; min-height: 1.4em; }
.strip { white-space: nowrap; margin-left: 14px; }
.strip img { width: 110px; height: 10px; margin: 0 7px; vertical-align: baseline; border-radius: 2px; }
footer { margin-top: 50px; border-top: 1px solid var(--edge); padding-top: 8px; }
@media print { nav { display: none; } .scroll { max-height: none; } }
)css";
}

// The panes of a set share one transformation. It is kept in fractions of the pane, which differ in size. The
// wheel scrolls the page until the mouse has been moved over a pane, so that scrolling past pictures does not
// zoom them.
std::string report_script() {
  return R"js(
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
)js";
}

}  // namespace ubs
