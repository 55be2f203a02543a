// SPDX-License-Identifier: Apache-2.0
// Panel contains the controls of the viewer, as ordinary labelled HTML elements.
'use strict';

const KEYS =
    'Drag: orbit. Shift or right drag: pan. Wheel, + and -: zoom. Arrows: orbit. W A S D Q E: fly. ' +
    'Space: play. [ and ]: previous and next camera. C: next channel. Home: initial camera.';
const BETAS = {
  spatial: 'Spatial beta',
  angular: 'Angular beta',
  temporal: 'Temporal beta'
};

class Panel {
  constructor(viewer) {
    this.viewer = viewer;
    const {options, model} = viewer;
    this.timed = model.dims.some((n) => n === 4 || n === 5 || n >= 7);
    const parts =
        [this.views(options), ...(this.timed ? [this.times()] : []), this.buttons(), ...this.more(model)];
    this.facts = element('p', {class: 'facts'});
    this.said = element('p', {class: 'said', role: 'status'});
    // In a page of its own, the open panel would cover a part of the image.
    const open = !options.embed && !options.page && innerWidth > 700;
    const body = element('details', {class: 'panel', open},
        element('summary', {}, 'Controls'), ...parts, element('p', {class: 'keys', id: 'ubs-keys'}, KEYS),
        this.facts, this.said);
    this.element = body;
  }

  labelled(text, input) { return element('label', {}, element('span', {}, text), input); }
  slider(text, attributes, change) {
    const input = element('input',
        {type: 'range', 'aria-label': text, ...attributes, oninput: () => change(Number(input.value))});
    return input;
  }

  views(options) {
    const {viewer} = this;
    this.channel = element('select', {onchange: () => viewer.setChannel(this.channel.selectedIndex)},
        ...CHANNELS.map((name) => element('option', {}, name)));
    this.cameras = element('select', {onchange: () => viewer.jump(this.cameras.selectedIndex)},
        ...options.cameras.map((camera) => element('option', {}, camera.name)));
    this.cameras.selectedIndex = options.start;
    this.scale = this.slider('Resolution', {min: 0.25, max: 1, step: 0.05, value: 1}, (v) => {
      viewer.automatic = this.automatic.checked = false;
      viewer.scale = v;
      viewer.change();
    });
    this.automatic = element('input', {
      type: 'checkbox',
      checked: true,
      onchange: () => {
        viewer.automatic = this.automatic.checked;
        viewer.scale = 1;
        viewer.change();
      }
    });
    return element('div', {class: 'row'}, this.labelled('Channel', this.channel),
        this.labelled('Camera', this.cameras), this.labelled('Resolution', this.scale),
        this.labelled('keep 30 frames per second', this.automatic));
  }

  times() {
    const {viewer} = this;
    this.time = this.slider('Time', {min: 0, max: 1, step: 0.001, value: viewer.camera.time}, (v) => {
      viewer.camera.time = v;
      viewer.change();
    });
    this.playing = element('button', {type: 'button', onclick: () => viewer.play(!viewer.playing)}, 'Play');
    this.speed = element('select', {
      onchange: () => {
        viewer.speed = Number(this.speed.value);
      }
    },
        ...[0.25, 0.5, 1, 2, 4].map((v) => element('option', {value: v, selected: v === 1}, `${v} x`)));
    return element('div', {class: 'row'}, this.labelled('Time', this.time), this.playing,
        this.labelled('Speed', this.speed));
  }

  // Returns the folded controls, which few users need. A model without betas does not have them.
  more(model) {
    if (model.betas.length === 0) return [];
    return [element('details', {class: 'more'}, element('summary', {}, 'More'), this.choices(model))];
  }

  choices(model) {
    const rows = model.betas.map((kind) => {
      const name = BETAS[kind], range = [0, 1];
      const ends =
          [0, 1].map((end) => this.slider(`${name}, ${end ? 'upper' : 'lower'} quantile`,
                         {min: 0, max: 1, step: 0.01, value: end, 'data-beta': `${kind}-${end}`}, (v) => {
                           range[end] = v;
                           if (range[0] > range[1]) {
                             range[1 - end] = v;
                             ends[1 - end].value = v;
                           }
                           this.viewer.choose(kind, range.slice());
                         }));
      return element('div', {class: 'row'}, element('span', {}, name), ...ends);
    });
    return element(
        'fieldset', {}, element('legend', {}, 'Splats shown, by quantiles of their betas'), ...rows);
  }

  buttons() {
    const {viewer} = this, button = (text, act) => element('button', {type: 'button', onclick: act}, text);
    return element('div', {class: 'row'}, button('Back', () => viewer.jump(viewer.options.start)),
        button('Copy link', () => viewer.copyLink()), button('Save image', () => viewer.screenshot()),
        button('Full screen',
            () => (
                document.fullscreenElement ? document.exitFullscreen() : viewer.root.requestFullscreen?.())));
  }

  say(text) { this.said.textContent = text; }

  show() {
    const {viewer} = this, {model, last} = viewer;
    this.channel.selectedIndex = viewer.channel;
    if (viewer.at !== undefined) this.cameras.selectedIndex = viewer.at;
    if (this.timed) {
      this.time.value = viewer.camera.time;
      this.playing.textContent = viewer.playing ? 'Pause' : 'Play';
    }
    if (viewer.automatic) this.scale.value = viewer.scale;
    if (!last) return;
    const quality = model.psnr === null ? 'exact' : `${model.psnr.toFixed(1)} dB`;
    const level = model.levels > 1 ? `Level ${model.level} of ${model.levels} (${quality}): ` : '';
    const rate = viewer.pace ? `, ${(1000 / viewer.pace).toFixed(0)} frames per second` : '';
    this.facts.textContent =
        `${level}${model.splats} splats of N = ${model.dims.join(', ')} in ${(model.bytes / 1e6).toFixed(2)} MB; ` +
        `${last.drawn} rendered at ${viewer.picture.width} x ${viewer.picture.height}${rate}`;
  }
}
