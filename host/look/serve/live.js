// SPDX-License-Identifier: Apache-2.0
// This is the script of the page that shows live training or a model. The page controls the camera, and the server
// renders the images. The page requests one image at a time. When the image has arrived and another one is needed, the
// page requests it for the newest camera. While the camera moves, images have as many pixels as the server can render a
// few times per second. When it is at rest, images have as many pixels as the server can render within 5 seconds.
'use strict';

const MOVING_SECONDS = 0.25, REST_SECONDS = 5, REST_MS = 400, REFRESH_MS = 1000, MAX_PIXELS = 1 << 21;
// The fixed cost of an image, expressed as a number of pixels: the time for an image is proportional to this
// number plus the number of pixels of the image.
const FIXED_PIXELS = 1 << 15;

const duration = (s) => s < 60 ? `${s.toFixed(0)} s` :
    s < 3600 ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` :
               `${Math.floor(s / 3600)} h ${Math.floor(s % 3600 / 60)} min`;

class Live {
  constructor(root, options) {
    Object.assign(this, {root, options, asked: 0, shown: 0, frames: 0, pixelSeconds: 0, changed: 0});
    this.at = options.start;
    this.find = (selector) => root.querySelector(selector);
    this.canvas = this.find('canvas');
    if (options.poster) {
      const still = Object.assign(new Image(), {className: 'poster', src: options.poster, alt: 'Still image'});
      this.find('.stage').prepend(still);
    }
    this.camera = new ViewCamera(options.scene, options.cameras[this.at]);
    const cameras = this.find('select');
    cameras.append(...options.cameras.map((c) => new Option(c.name)));
    cameras.selectedIndex = this.at;
    cameras.onchange = () => this.jump(cameras.selectedIndex);
    const time = this.find('input[type=range]');
    time.parentNode.hidden = !options.timed;
    if (!options.training) this.find('svg').remove();  // removes the curves
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
    new ResizeObserver(() => this.change()).observe(this.canvas);  // the observer also calls change() once at the start
    this.watch();
  }

  say(text) {
    const message = this.find('.message');
    message.textContent = text;
    message.hidden = !text;
  }

  // ---- Images ----
  change() {
    this.changed = performance.now();
    markUnseen(this.find('.stage'), this.camera, this.options);
    this.dirty = true;
    // An image for a camera at rest may take a long time to render, so cancel its request: ask() sends a new one for
    // the new camera.
    if (this.waiting && this.resting) this.waiting.abort();
    this.ask();
  }

  // Returns width and height of the next image, or undefined if the canvas has no size, for example in a
  // hidden frame.
  size() {
    const box = this.canvas.getBoundingClientRect(), dots = Math.min(devicePixelRatio || 1, 2);
    const full = dots * dots * box.width * box.height;
    if (full < 1) return undefined;
    this.resting = performance.now() - this.changed >= REST_MS || this.frames === 0;
    const seconds = this.resting ? REST_SECONDS : MOVING_SECONDS;
    const pixels = Math.min(MAX_PIXELS, full, Math.max(0, seconds / this.pixelSeconds - FIXED_PIXELS));
    const scale = dots * Math.max(Math.sqrt(pixels / full), 48 / Math.max(48, box.width * dots));
    this.small = !this.resting && pixels < full;
    return [box.width, box.height].map((side) => Math.min(Math.max(16, Math.floor(side * scale)), 1 << 14));
  }

  async ask() {
    if (this.waiting || this.closed) return;
    clearTimeout(this.later);
    this.dirty = false;
    const size = this.size();
    if (!size) return;  // the ResizeObserver calls again when the canvas has a size
    this.waiting = new AbortController();
    ++this.asked;
    // During training, images become outdated, so they are requested again and again.
    let again = this.options.training && !this.ended;
    try {
      await this.draw(await this.request(...size));
    } catch (error) {
      again ||= error.again;
      if (error.name !== 'AbortError') this.say(error.message);
    }
    this.waiting = undefined;
    this.shown = this.asked;
    if (this.dirty) return this.ask();
    // After a small image, request a larger one when the camera is at rest.
    if (this.small || again) this.later = setTimeout(() => this.ask(), this.small ? REST_MS : REFRESH_MS);
  }

  async request(width, height) {
    const {rotation, centre, query, ...lens} = this.camera.on(width, height);
    const translation = [0, 3, 6].map((r) => -dot(rotation.slice(r, r + 3), centre));
    const [time, ...extra] = query;
    const camera = {...lens, rotation, translation, time, extra};
    const post = {
      method: 'POST',
      headers: {'Content-Type': 'application/json'},
      body: JSON.stringify({camera}),
      signal: this.waiting.signal,
    };
    const answer = await this.fetch('picture', post);
    if (answer.ok) return answer;
    this.closed = answer.status === 410;
    const why = this.closed ? this.farewell('has ended') : await answer.text();
    throw Object.assign(new Error(why), {again: answer.status === 503});
  }

  async draw(answer) {
    const seconds = Number(answer.headers.get('Ubs-Seconds')), blob = await answer.blob();
    const picture = await createImageBitmap(blob);
    const box = this.canvas.getBoundingClientRect(), dots = Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(picture.width, Math.round(box.width * dots));
    this.canvas.height = Math.max(picture.height, Math.round(box.height * dots));
    this.canvas.getContext('2d').drawImage(picture, 0, 0, this.canvas.width, this.canvas.height);
    this.find('.stage').classList.add('drawn');
    this.pixelSeconds = seconds / (picture.width * picture.height + FIXED_PIXELS);
    this.iteration = Number(answer.headers.get('Ubs-Iteration'));
    ++this.frames;
    this.say('');
  }

  async fetch(path, options) {
    try {
      const answer = await fetch(`${path}${location.search}`, options);
      if (this.lost) this.say('');
      this.lost = false;
      return answer;
    } catch (error) {
      if (error.name === 'AbortError') throw error;
      this.lost = true;
      const why = this.farewell('has ended or cannot be reached');
      throw Object.assign(new Error(why), {again: true});
    }
  }

  farewell(what) {
    return `The program ${what}; this is the last image.` +
        (this.options.training ? ' The command "ubs view" shows the saved model.' : '');
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

  // ---- Numbers and curves ----
  async watch() {
    try {
      const answer = await this.fetch('state');
      if (answer.ok) this.show(await answer.json());
    } catch (error) {
      if (!this.closed) this.say(error.message);
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
    if (state.ended && !this.ended) {
      this.ended = true;
      this.change();  // requests an image of the final model
    }
    const last = (points) => points[points.length - 1]?.[1];
    const loss = last(state.loss), test = last(state.test);
    this.find('.facts').textContent =
        (state.ended ? `finished: ${state.iteration} iterations in ${duration(state.seconds)}; ` :
                       `iteration ${state.iteration} of ${state.iterations}, ${duration(state.seconds)}, ` +
                     `${duration(state.left)} left; `) +
        memory + (loss === undefined ? '' : `; loss ${loss.toFixed(4)}`) +
        (test === undefined ? '' : `; ${state.sample_views || 'all'} test views ${test.toFixed(2)} dB`);
    this.curve('.loss', state.loss.map(([i, v]) => [i, Math.log(Math.max(v, 1e-9))]), state.iterations);
    this.curve('.test', state.test, state.iterations);
  }

  // Draws a curve over all iterations, scaled from its minimum to its maximum value.
  curve(selector, points, iterations) {
    const values = points.map((p) => p[1]), low = Math.min(...values), span = Math.max(...values) - low || 1;
    const place = ([i, v]) =>
        `${(300 * i / iterations).toFixed(1)},${(62 - 60 * (v - low) / span).toFixed(1)}`;
    this.find(selector).setAttribute('points', points.map(place).join(' '));
  }
}

const root = document.getElementById('ubs-viewer');
root.live = new Live(root, JSON.parse(document.getElementById('ubs-options').textContent));
