// SPDX-License-Identifier: Apache-2.0
// The page of a live training or model: the camera is here, pictures come from the server, one at a time.
// They have as many pixels as come a few times a second while something moves, and within seconds at rest.
'use strict';

const MOVING_SECONDS = 0.25, REST_SECONDS = 5, REST_MS = 400, REFRESH_MS = 1000, MAX_PIXELS = 1 << 21;

const duration = (s) => s < 60 ? `${s.toFixed(0)} s` :
    s < 3600                   ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` :
                                 `${Math.floor(s / 3600)} h ${Math.floor(s % 3600 / 60)} min`;

class Live {
  constructor(root, options) {
    Object.assign(this, {root, options, asked: 0, shown: 0, frames: 0, pixelSeconds: 0, changed: 0, at: 0});
    this.find = (selector) => root.querySelector(selector);
    this.canvas = this.find('canvas');
    this.camera = new ViewCamera(options.scene, options.cameras[0]);
    const cameras = this.find('select');
    cameras.append(...options.cameras.map((c) => new Option(c.name)));
    cameras.onchange = () => this.jump(cameras.selectedIndex);
    const time = this.find('input[type=range]');
    time.parentNode.hidden = !options.timed;
    if (!options.training) this.find('svg').remove();  // curves
    this.find('details').open = innerWidth > 700;
    time.value = this.camera.time;
    time.oninput = () => {
      this.camera.time = Number(time.value);
      this.change();
    };
    const camera = this.camera, way = 0.05;
    new Controls(this.canvas, camera, () => this.change(), {
      w: () => camera.fly(0, 0, way),
      s: () => camera.fly(0, 0, -way),
      a: () => camera.fly(-way, 0, 0),
      d: () => camera.fly(way, 0, 0),
      q: () => camera.fly(0, way, 0),
      e: () => camera.fly(0, -way, 0),
      home: () => this.jump(this.at),
      p: () => this.save(),
    });
    new ResizeObserver(() => this.change()).observe(this.canvas);
    this.connect();
    this.watch();
  }

  say(text) {
    const message = this.find('.message');
    message.textContent = text;
    message.hidden = !text;
  }

  // ---- Pictures ----
  connect() {
    const socket = new WebSocket(`${location.origin.replace('http', 'ws')}/live${location.search}`);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.change();
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = (event) => {
      this.closed = true;
      this.say(event.code === 1001 ? 'It has ended; this is the last picture.' :
                                     `The connection is lost. ${event.reason}`);
    };
  }

  change() {
    this.changed = performance.now();
    this.dirty = true;
    this.ask();
  }

  size() {
    const box = this.canvas.getBoundingClientRect(), dots = Math.min(devicePixelRatio || 1, 2);
    const full = Math.max(1, dots * dots * box.width * box.height);  // 1: hidden, or no room just now
    const moving = performance.now() - this.changed < REST_MS && this.frames > 0;
    const pixels = Math.min(MAX_PIXELS, full, (moving ? MOVING_SECONDS : REST_SECONDS) / this.pixelSeconds);
    const scale = dots * Math.max(Math.sqrt(pixels / full), 48 / Math.max(48, box.width * dots));
    this.small = moving && pixels < full;
    return [Math.max(16, Math.floor(box.width * scale)), Math.max(16, Math.floor(box.height * scale))];
  }

  ask() {
    // A newer camera takes the place of one at rest, which may take long.
    if ((this.waiting && this.small) || this.socket.readyState !== WebSocket.OPEN) return;
    clearTimeout(this.later);
    this.dirty = false;
    this.waiting = true;
    const [width, height] = this.size(), {rotation, centre, query, ...lens} = this.camera.on(width, height);
    const translation = [0, 3, 6].map((r) => -dot(rotation.slice(r, r + 3), centre));
    const [time, ...extra] = query;
    const camera = {...lens, rotation, translation, time, extra};
    this.socket.send(JSON.stringify({id: ++this.asked, camera}));
  }

  // u32 bytes of the header, the header (JSON), the picture.
  async take(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    this.say(header.error || '');
    if (!header.error) {
      const picture = await createImageBitmap(new Blob([new Uint8Array(data, 4 + length)]));
      const box = this.canvas.getBoundingClientRect(), dots = Math.min(devicePixelRatio || 1, 2);
      this.canvas.width = Math.max(picture.width, Math.round(box.width * dots));
      this.canvas.height = Math.max(picture.height, Math.round(box.height * dots));
      this.canvas.getContext('2d').drawImage(picture, 0, 0, this.canvas.width, this.canvas.height);
      this.find('.stage').classList.add('drawn');
      this.pixelSeconds = header.wait / (picture.width * picture.height);
      this.iteration = header.iteration;
      ++this.frames;
    }
    this.shown = header.id;
    this.waiting = header.id !== this.asked;
    if (this.waiting) return;
    if (this.dirty) return this.ask();
    // A small picture becomes a whole one at rest; one of a training becomes old.
    if (this.small)
      this.later = setTimeout(() => this.ask(), REST_MS);
    else if (this.options.training)
      this.later = setTimeout(() => this.ask(), REFRESH_MS);
  }

  save() {
    const link = document.createElement('a');
    Object.assign(link, {href: this.canvas.toDataURL(), download: `${document.title}.png`});
    link.click();
  }

  jump(index) {
    this.at = index;
    this.camera.set(this.options.cameras[index]);
    this.find('input[type=range]').value = this.camera.time;
    this.change();
  }

  // ---- Figures ----
  async watch() {
    try {
      const answer = await fetch(`state${location.search}`);
      if (answer.ok) this.show(await answer.json());
    } catch {  // between two answers the run may end
    }
    if (!this.closed) setTimeout(() => this.watch(), 1000);
  }

  show(state) {
    this.state = state;
    const memory = `${state.splats} splats, ${(state.memory / 1e6).toFixed(0)} MB on the device`;
    if (!this.options.training) {
      this.find('.facts').textContent = memory;
      return;
    }
    const last = (points) => points[points.length - 1]?.[1];
    const loss = last(state.loss), test = last(state.test);
    this.find('.facts').textContent =
        `iteration ${state.iteration} of ${state.iterations}, ${duration(state.seconds)}, ` +
        `${duration(state.left)} left; ${memory}` + (loss === undefined ? '' : `; loss ${loss.toFixed(4)}`) +
        (test === undefined ? '' : `; test ${test.toFixed(2)} dB`);
    this.draw('.loss', state.loss.map(([i, v]) => [i, Math.log(Math.max(v, 1e-9))]), state.iterations);
    this.draw('.test', state.test, state.iterations);
  }

  // A curve over all iterations, from its least to its greatest value.
  draw(selector, points, iterations) {
    const values = points.map((p) => p[1]), low = Math.min(...values), span = Math.max(...values) - low || 1;
    const place = ([i, v]) =>
        `${(300 * i / iterations).toFixed(1)},${(62 - 60 * (v - low) / span).toFixed(1)}`;
    this.find(selector).setAttribute('points', points.map(place).join(' '));
  }
}

const root = document.getElementById('ubs-viewer');
root.live = new Live(root, JSON.parse(document.getElementById('ubs-options').textContent));
