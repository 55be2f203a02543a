// SPDX-License-Identifier: Apache-2.0
// Picture renders the image of the viewer. It draws the records from the worker, farthest first, into a
// floating-point framebuffer. Then it draws the selected channel of this framebuffer onto the canvas.
'use strict';

const SPLAT_VERTEX = `#version 300 es
layout(location = 0) in vec4 a0;
layout(location = 1) in vec4 a1;
layout(location = 2) in vec4 a2;
uniform vec2 size;
flat out vec4 shape;    // mean, L00, L01
flat out vec4 look;     // L11, opacity, beta, reach
flat out vec3 colour;
uniform bool depth;
void main() {
  shape = a0;
  look = vec4(a1.xyz, a2.w);
  colour = depth ? vec3(a1.w) : a2.rgb;
  // In the coordinates of the ellipse, draw the square around the circle with r = reach. The square has a margin,
  // because its corners are rounded to fractions of a pixel.
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec2 p = corner * (sqrt(a2.w) + 0.2 * vec2(a0.z + abs(a0.w), a1.x));
  float dy = p.y / a1.x;
  vec2 at = a0.xy + vec2((p.x - a0.w * dy) / a0.z, dy);
  gl_Position = vec4(2.0 * at.x / size.x - 1.0, 1.0 - 2.0 * at.y / size.y, 0.0, 1.0);
}`;

// The spatial kernels of worker.js, as GLSL expressions of r and beta, with the largest alpha and the smallest alpha that
// contributes.
const FALLOFFS = {
  beta: {falloff: 'pow(1.0 - r, beta)', most: '0.999', least: '0.0'},
  gaussian: {falloff: 'exp(-0.5 * r)', most: '0.99', least: '1.0 / 255.0'}
};
const FALLOFF_CASES = Object.values(FALLOFFS).map(({falloff, most, least}, number) => `
  if (kernel == ${number}) {
    alpha = min(${most}, opacity * ${falloff});
    if (alpha < ${least}) discard;
  }`).join('');

const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
flat in vec4 shape;
flat in vec4 look;
flat in vec3 colour;
uniform vec2 size;
uniform int kernel;  // index in FALLOFFS
uniform float alphaMin;
out vec4 result;
void main() {
  vec2 d = shape.xy - vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
  vec2 p = vec2(shape.z * d.x + shape.w * d.y, look.x * d.y);
  float r = dot(p, p), opacity = look.y, beta = look.z, alpha = 0.0;
  if (r >= look.w) discard;
${FALLOFF_CASES}
  if (alphaMin > 0.0 && alpha <= alphaMin) discard;
  result = vec4(colour * alpha, alpha);
}`;

const SHOW_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

const SHOW_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D sums;
uniform vec3 background;
uniform int channel;
uniform vec2 range;
out vec4 result;
void main() {
  vec4 s = texelFetch(sums, ivec2(gl_FragCoord.xy), 0);
  vec3 shown = s.rgb + (1.0 - s.a) * background;
  if (channel == 1) shown = vec3(s.a);
  if (channel == 2) {
    float near = 1.0 - clamp((s.r / max(s.a, 1e-10) - range.x) / max(range.y - range.x, 1e-6), 0.0, 1.0);
    vec3 warm = mix(vec3(0.85, 0.35, 0.25), vec3(1.0, 0.95, 0.7), near);
    shown = s.a > 1e-3 ? mix(vec3(0.08, 0.05, 0.25), warm, near) : vec3(0);
  }
  result = vec4(shown, 1.0);
}`;

class Picture {
  constructor(canvas) {
    const gl = canvas.getContext(
        'webgl2', {alpha: false, antialias: false, depth: false, powerPreference: 'high-performance'});
    if (!gl) throw new Error('This browser has no WebGL 2.');
    this.gl = gl;
    this.canvas = canvas;
    // Use 32-bit floats if the device can blend them, and 16-bit floats otherwise. Splats are blended back to front,
    // because this is more accurate than front to back with 16-bit floats.
    const floats = gl.getExtension('EXT_color_buffer_float');
    this.format = floats && gl.getExtension('EXT_float_blend') ? gl.RGBA32F : gl.RGBA16F;
    if (!floats && !gl.getExtension('EXT_color_buffer_half_float'))
      throw new Error('This device cannot render to floating-point framebuffers.');
    this.splats = this.program(SPLAT_VERTEX, SPLAT_FRAGMENT, ['size', 'depth', 'kernel', 'alphaMin']);
    this.show = this.program(SHOW_VERTEX, SHOW_FRAGMENT, ['sums', 'background', 'channel', 'range']);
    this.buffer = gl.createBuffer();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    for (let k = 0; k < 3; ++k) {
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 4, gl.FLOAT, false, 48, 16 * k);
      gl.vertexAttribDivisor(k, 1);
    }
    this.empty = gl.createVertexArray();
    this.target = gl.createFramebuffer();
    this.texture = null;
    this.drawn = this.room = 0;
  }

  program(vertex, fragment, uniforms) {
    const {gl} = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new Error(`A shader does not compile: ${gl.getProgramInfoLog(program)}`);
    return {
      program,
      at: Object.fromEntries(uniforms.map((name) => [name, gl.getUniformLocation(program, name)]))
    };
  }

  resize(width, height) {
    const {gl} = this;
    if (this.texture && this.width === width && this.height === height) return;
    Object.assign(this, {width, height});
    this.canvas.width = width;
    this.canvas.height = height;
    if (this.texture) gl.deleteTexture(this.texture);
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
  }

  // Uploads the records of a frame from the worker. They are kept until the next frame.
  take(frame) {
    const {gl} = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    const bytes = 48 * frame.drawn;
    if (bytes > this.room) {
      this.room = Math.ceil(1.5 * bytes);
      gl.bufferData(gl.ARRAY_BUFFER, this.room, gl.STREAM_DRAW);
    }
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, new Float32Array(frame.buffer, 0, 12 * frame.drawn));
    this.drawn = frame.drawn;
    this.range = [frame.nearest, frame.farthest];
  }

  // Draws the frame. `channel` is 0 for colour, 1 for alpha and 2 for depth.
  draw({channel, background, kernel, alphaMin}) {
    const {gl} = this;
    gl.viewport(0, 0, this.width, this.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.splats.program);
    gl.uniform2f(this.splats.at.size, this.width, this.height);
    gl.uniform1i(this.splats.at.depth, channel === 2);
    gl.uniform1i(this.splats.at.kernel, Object.keys(FALLOFFS).indexOf(kernel));
    gl.uniform1f(this.splats.at.alphaMin, alphaMin);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
    gl.disable(gl.BLEND);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(this.show.program);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.uniform1i(this.show.at.sums, 0);
    gl.uniform3fv(this.show.at.background, background);
    gl.uniform1i(this.show.at.channel, channel);
    gl.uniform2fv(this.show.at.range, this.range || [0, 1]);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Returns the RGBA values of the canvas, starting with the top row. It must be called directly after draw().
  pixels() {
    const {gl, width, height} = this, flipped = new Uint8Array(4 * width * height),
                      out = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, flipped);
    for (let y = 0; y < height; ++y)
      out.set(flipped.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    return out;
  }
}
