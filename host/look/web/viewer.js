// SPDX-License-Identifier: Apache-2.0
// Viewer is one element with a canvas and its controls. The worker (worker.js) slices, projects and sorts the splats.
// This file contains the state, the scheduling of frames, and the input from mouse, touch and keys.
'use strict';

const CHANNELS = ['colour', 'alpha', 'depth'];
const FRAME_MS = 33;  // if frames take longer while something moves, the resolution is lowered

function element(name, attributes = {}, ...children) {
  const e = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on'))
      e.addEventListener(key.slice(2), value);
    else if (value === true)
      e.setAttribute(key, '');
    else if (value !== false && value !== undefined)
      e.setAttribute(key, value);
  }
  e.append(...children);
  return e;
}

class Viewer {
  constructor(root, options, workerText) {
    Object.assign(this, {
      root,
      options,
      channel: 0,
      ranges: {},
      speed: 1,
      playing: false,
      scale: 1,
      held: new Set(),
      frames: 0,
      waiting: [],
      size: null,
      automatic: true
    });
    this.canvas = element('canvas', {
      tabindex: 0,
      role: 'img',
      'aria-label': `${options.title}: interactive image`,
      'aria-describedby': 'ubs-keys'
    });
    this.message = element('p', {class: 'message', role: 'alert', hidden: true});
    this.stage = element('div', {class: 'stage'}, this.canvas, this.message);
    if (options.poster)
      this.stage.prepend(
          element('img', {class: 'poster', src: options.poster, alt: `${options.title}: still image`}));
    root.append(this.stage);
    this.ready = new Promise((resolve) => {
      this.opened = resolve;
    });
    this.complete = new Promise((resolve) => {  // resolves when all levels are loaded
      this.completed = resolve;
    });
    try {
      this.camera = new ViewCamera(options.scene, options.cameras[options.start]);
      this.picture = new Picture(this.canvas);
      const source = URL.createObjectURL(new Blob([workerText], {type: 'text/javascript'}));
      this.worker = new Worker(source);
      URL.revokeObjectURL(source);
    } catch (error) {
      this.fail(error.message);
      return;
    }
    this.worker.onmessage = (event) => this.hear(event.data);
    this.worker.onerror = (event) => this.fail(event.message || 'The worker does not start.');
    this.canvas.addEventListener('webglcontextlost', (e) => {
      e.preventDefault();
      this.fail('The graphics device was lost; load the page again.');
    });
    this.parts = 0;
    this.feed();
  }

  // Sends the worker the parts of the model that the page has loaded so far.
  feed() {
    const parts = document.getElementsByClassName('ubs-model');
    while (this.worker && this.parts < parts.length)
      this.worker.postMessage({kind: 'part', model: parts[this.parts++].textContent.trim()});
  }
  end() {
    this.feed();
    this.worker?.postMessage({kind: 'end'});
  }

  fail(text) {
    if (this.failed) return;  // the first message states the cause
    this.message.textContent = `The model cannot be shown: ${text}`;
    this.message.hidden = false;
    this.failed = text;
    this.opened();
    this.completed();
  }

  hear(data) {
    if (data.kind === 'error') return this.fail(data.text);
    if (data.kind === 'opened') {
      const first = !this.model;
      this.model = data;
      if (data.level === data.levels) this.completed();
      if (!first) return this.change();
      this.panel = new Panel(this);
      this.root.append(this.panel.element);
      this.listen();
      this.readLink();
      new ResizeObserver(() => this.change()).observe(this.stage);
      this.opened();
      return this.change();
    }
    this.busy = false;
    this.picture.resize(data.width, data.height);
    this.picture.take(data);
    this.spare = data.buffer;
    this.last = data;
    if (this.dirty) this.request();
    requestAnimationFrame(() => this.draw());
  }

  // Requests a new frame from the worker. It must be called after each change of the view.
  change() {
    markUnseen(this.stage, this.camera, this.options);
    this.dirty = true;
    if (!this.busy && this.model) this.request();
  }

  wantedSize() {
    if (this.size) return this.size;
    const s = this.scale * Math.min(devicePixelRatio || 1, 2), box = this.stage.getBoundingClientRect();
    return [Math.max(16, Math.round(box.width * s)), Math.max(16, Math.round(box.height * s))];
  }

  request() {
    const {near, far, eps2d, alphaMin} = this.options, [width, height] = this.wantedSize();
    this.dirty = false;
    this.busy = true;
    const camera = {...this.camera.on(width, height), near, far, eps2d, alphaMin};
    this.worker.postMessage(
        {kind: 'frame', id: ++this.frames, camera, buffer: this.spare}, this.spare ? [this.spare] : []);
    this.spare = null;
  }

  draw() {
    if (this.failed) return;
    const {background, alphaMin} = this.options;
    this.picture.draw(
        {channel: this.channel, background, alphaMin, kernel: this.model.switches.kernel});
    this.stage.classList.add('drawn');
    this.hold(performance.now());
    const done = this.waiting.filter((w) => w.id <= (this.last ? this.last.id : 0));
    this.waiting = this.waiting.filter((w) => !done.includes(w));
    for (const w of done) w.resolve();
    this.panel.show();
  }

  // Keeps the frame rate by changing the resolution: lowers it while consecutive frames are late, and
  // restores it when nothing moves.
  hold(now) {
    const passed = now - (this.before || 0);
    this.before = now;
    clearTimeout(this.still);
    if (passed > 400 || this.size) {
      this.pace = undefined;
    } else {
      this.pace = this.pace === undefined ? passed : 0.8 * this.pace + 0.2 * passed;
      const elsewhere = this.last.slice + this.last.sort > 0.7 * this.pace;  // fewer pixels would not help
      if (this.automatic && this.pace > FRAME_MS && !elsewhere)
        this.scale = Math.max(0.25, 0.93 * this.scale);
      if (this.automatic && this.pace < 0.6 * FRAME_MS) this.scale = Math.min(1, 1.03 * this.scale);
    }
    if (this.automatic && this.scale < 1)
      this.still = setTimeout(() => {
        const moving = this.scale;
        this.scale = 1;
        this.change();
        this.scale = moving;
      }, 300);
  }

  // ---- Animation ----
  tick(now) {
    const passed = Math.min(0.1, (now - (this.ticked || now)) / 1000);
    this.ticked = now;
    if (this.playing) {
      this.camera.time = (this.camera.time + passed * this.speed * 0.25) % 1;
      this.change();
    }
    const step = passed * (this.held.has('shift') ? 2 : 0.6), on = (key) => (this.held.has(key) ? step : 0);
    const move = [on('d') - on('a'), on('q') - on('e'), on('w') - on('s')];
    if (move.some((v) => v)) {
      this.camera.fly(...move);
      this.change();
    }
    this.ticking = this.playing || this.held.size > 0;
    if (this.ticking) requestAnimationFrame((t) => this.tick(t));
  }
  start() {
    if (this.ticking) return;
    this.ticking = true;
    this.ticked = undefined;
    requestAnimationFrame((t) => this.tick(t));
  }
  play(on) {
    this.playing = on;
    this.panel.show();
    this.start();
  }

  jump(index) {
    const n = this.options.cameras.length;
    this.at = (index + n) % n;
    const time = this.camera.time;
    this.camera.set(this.options.cameras[this.at]);
    if (this.playing) this.camera.time = time;
    this.panel.show();
    this.change();
  }
  choose(kind, range) {
    this.ranges[kind] = range;
    this.worker.postMessage({kind: 'choose', ranges: this.ranges});
    this.change();
  }
  setChannel(channel) {
    this.channel = channel;
    this.panel.show();
    if (this.last) requestAnimationFrame(() => this.draw());
  }

  // ---- Links and screenshots ----
  link() {
    const page = location.href.split('#')[0];
    return `${page}#view=${this.camera.text()}&channel=${CHANNELS[this.channel]}`;
  }
  readLink() {
    const words = new URLSearchParams(location.hash.slice(1)),
          channel = CHANNELS.indexOf(words.get('channel'));
    if (words.has('view') && !this.camera.read(words.get('view')))
      this.panel.say('The link does not contain a view.');
    if (channel >= 0) this.channel = channel;
  }
  async copyLink() {
    history.replaceState(null, '', this.link());
    const copied = await navigator.clipboard?.writeText(this.link()).then(() => true, () => false);
    this.panel.say(copied ? 'Link copied.' : 'The link is in the address bar.');
  }
  screenshot() {
    this.draw();  // draw and copy in the same task, because the canvas does not keep its content
    this.canvas.toBlob((blob) => {
      const url = URL.createObjectURL(blob),
            a = element('a', {href: url, download: `${this.options.title}.png`});
      a.click();
      setTimeout(() => URL.revokeObjectURL(url), 1000);
      this.panel.say('Image saved.');
    });
  }

  // ---- Mouse, touch, keys ----
  listen() {
    const c = this.canvas, hold = (key) => () => (this.held.add(key), this.start());
    const keys = {
      ' ': () => this.panel.timed && this.play(!this.playing),
      home: () => this.jump(this.options.start),
      '[': () => this.jump((this.at ?? this.options.start) - 1),
      ']': () => this.jump((this.at ?? this.options.start) + 1),
      c: () => this.setChannel((this.channel + 1) % 3),
    };
    for (const key of ['w', 'a', 's', 'd', 'q', 'e', 'shift']) keys[key] = hold(key);
    // If the page has other content, the wheel scrolls it until the canvas has been clicked.
    new Controls(c, this.camera, () => this.change(), keys, () => this.options.page || document.activeElement === c);
    c.addEventListener('keyup', (e) => this.held.delete(e.key.toLowerCase()));
    c.addEventListener('blur', () => this.held.clear());
    addEventListener('hashchange', () => {
      this.readLink();
      this.panel.show();
      this.change();
    });
  }

  // ---- For tests and scripts ----
  // Returns a promise that resolves when an image of the current state has been rendered.
  settled() {
    if (this.failed) return Promise.resolve();
    this.change();
    const id = this.frames + (this.busy && this.dirty ? 1 : 0);
    return new Promise((resolve) => this.waiting.push({id, resolve}));
  }
  pixels() {
    this.draw();
    return this.picture.pixels();
  }
}

function ubsViewers() {
  const options = JSON.parse(document.getElementById('ubs-options').textContent);
  const root = document.getElementById('ubs-viewer'), text = (id) => document.getElementById(id).textContent;
  root.viewer = new Viewer(root, options, text('ubs-worker'));
  addEventListener('DOMContentLoaded', () => root.viewer.end());
}
// The page calls this after each part of the model.
function ubsPart() { document.getElementById('ubs-viewer').viewer.feed(); }
ubsViewers();
