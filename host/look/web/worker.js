// SPDX-License-Identifier: Apache-2.0
// This is the worker (a background thread) of the viewer. It unpacks the model (docs/web.md) and precomputes
// the values of each splat that do not depend on the query. For each frame it slices, projects and sorts the
// splats. Section numbers and formulas are those of docs/method.md. Everything is computed in double
// precision, so the measures against rounding errors in kernels/math are not needed.
'use strict';

const CLASSES = 6, PLACE_BITS = 17;
const MAX_RATIO = 1032;  // gzip reduces the size of data by at most this factor
const MAX_LEVELS = 8;    // maximum of `ubs web`; the time for a level is proportional to the number of splats so far
// Number of floats of a visible splat: x, y, L00, L01 | L11, opacity, beta, depth | r, g, b, reach.
const RECORD = 12;

// ---- Container ----
function crc32(bytes) {
  const table = new Uint32Array(256);
  for (let i = 0; i < 256; ++i) {
    let c = i;
    for (let k = 0; k < 8; ++k) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
    table[i] = c;
  }
  let crc = 0xffffffff;
  for (const b of bytes) crc = table[(crc ^ b) & 255] ^ (crc >>> 8);
  return (crc ^ 0xffffffff) >>> 0;
}

// Unpacks `size` bytes. Throws an error as soon as the data contain more, so that a hostile file does not fill the
// memory.
async function inflate(bytes, size) {
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip')).getReader();
  const out = new Uint8Array(size);
  for (let at = 0;;) {
    const {done, value} = await reader.read().catch(() => {
      throw new Error('the model is damaged');
    });
    if (done && at < size) throw new Error('the model is cut off');
    if (done) return out;
    if (at + value.length > size) {
      reader.cancel();
      throw new Error('the model contains more data than its header says');
    }
    out.set(value, at);
    at += value.length;
  }
}

// Returns one coordinate of a position, which consists of every third of the 51 bits of the position. `low` contains
// the bits 0 to 23, and `high` the others.
function gather(low, high, axis) {
  let v = 0;
  for (let b = 0; b < PLACE_BITS; ++b) {
    const at = 3 * b + axis;
    v |= ((at < 24 ? low >>> at : high >>> (at - 24)) & 1) << b;
  }
  return v;
}

// Decodes a coordinate to a number of steps from the centre. Far from the centre, the step doubles with each
// doubling of the distance.
function farSteps(code) {
  const beyond = Math.abs(code) - 8192;
  if (beyond < 0) return code;
  return Math.sign(code) * (4096 + beyond % 4096 + 0.5) * 2 ** (Math.floor(beyond / 4096) + 1);
}

// Returns the rows of parameters of one group, in the order of kernels/layout.h.
function readGroup(group, names, take) {
  const n = group.splats, rows = [];
  for (let r = 0; r < names; ++r) rows.push(new Float32Array(n));
  const code = (planes, i) => {
    let v = 0;
    for (let b = planes.length - 1; b >= 0; --b) v = v * 256 + planes[b][i];
    return v;
  };
  const planes = (count, bytes) => Array.from({length: bytes}, () => take(count));
  const bits = new Uint32Array(1), float = new Float32Array(bits.buffer);
  if (!group.rows) {
    for (const row of rows) {
      const four = planes(n, 4);
      for (let i = 0; i < n; ++i) {
        bits[0] = code(four, i);
        row[i] = float[0];
      }
    }
    return rows;
  }
  for (let k = 0, first = 0; k < CLASSES; first += group.classes[k++]) {
    const count = group.classes[k], times = 2 ** k;
    const placePlanes = planes(count, group.places.bytes);
    let place = 0;
    for (let i = 0; i < count; ++i) {
      place += code(placePlanes, i);
      const high = Math.floor(place / 2 ** 24), low = place - high * 2 ** 24;
      for (let axis = 0; axis < 3; ++axis)
        rows[axis][first + i] = group.places.centre[axis] +
            group.places.step * times * farSteps(gather(low, high, axis) - 2 ** (PLACE_BITS - 1));
    }
    group.rows.forEach((row, r) => {
      const to = rows[r + 3], step = row.step * times, from = planes(count, row.bytes);
      for (let i = 0; i < count; ++i) {
        const v = code(from, i);
        if (row.bytes === 4) {
          bits[0] = v;
          to[first + i] = float[0];
        } else {
          to[first + i] = row.centre + step * (v & 1 ? -(v >>> 1) - 1 : v >>> 1);
        }
      }
    });
  }
  return rows;
}

// The spatial kernels (kSpatialKernels in host/scene/spatial_kernel.hpp; picture.js has their formulas): whether the
// splats have a beta, the squared distance r at which the kernel ends (UBS_SUPPORT in kernels/variant.h), the smallest
// alpha that contributes, and r where alpha falls to `least` (kernels/math/falloff.h).
const KERNELS = {
  beta: {
    hasBeta: true,
    support: 1,
    leastAlpha: 0,
    reach: (opacity, least, beta) => 1 - Math.pow(least / opacity, 1 / beta)
  },
  gaussian: {
    hasBeta: false,
    support: 3.33 ** 2,
    leastAlpha: 1 / 255,
    reach: (opacity, least) => 2 * Math.log(opacity / least)
  }
};

// Returns the row numbers of the parameters (ParameterLayout in host/scene/splat_model.hpp).
function layoutOf(dim, s) {
  const degree = Number(s.colour[2]), lobes = s.colour.startsWith('sb') ? degree : 0;
  const harmonics = lobes ? 1 : s.colour === 'rgb' ? 0 : (degree + 1) ** 2, C = dim - 3;
  const l = {dim, C, harmonics, lobes, xyz: 0, rgb: 3, opacity: 3 + 3 * Math.max(harmonics, 1) + 6 * lobes};
  l.beta = l.opacity + 1;
  l.queryBeta = l.beta + (KERNELS[s.kernel].hasBeta ? 1 : 0);
  l.mean = l.queryBeta + (s.beta_cond === 'on' || s.beta_opacity === 'tanh' ? C : 0);
  l.scale = l.mean + C;
  l.rotation = l.scale + dim;
  l.count = l.rotation + (s.rot_mode === 'quaternion' ? 4 : dim * (dim - 1) / 2);
  return l;
}

// These are the switches of a variant with their values (kVariantSwitches in host/scene/model_variant.hpp). The first
// value of each is the default.
const SWITCHES = {
  rot_mode: 'taylor1|taylor2|cayley|exp|quaternion',
  cov_param: 'spatial_ortho|cholesky|skew_nd',
  beta_cond: 'on|off',
  beta_opacity: 'tanh|none|gaussian',
  cov_mode: 'upper|whiten',
  kernel: Object.keys(KERNELS).join('|'),
  colour: 'rgb|sh0|sh1|sh2|sh3|sb1|sb2|sb3',
  antialias: 'off|on',
  conditioning: 'covariance|direct'
};

const within = (value, low, high) => Number.isInteger(value) && value >= low && value <= high;

// Returns all switches of a model. `given` contains those that are not at their default. Returns undefined if
// one of them is unknown.
function readSwitches(given) {
  const switches =
      Object.fromEntries(Object.entries(SWITCHES).map(([key, words]) => [key, words.split('|')[0]]));
  for (const [key, value] of Object.entries(given)) {
    if (!Object.hasOwn(SWITCHES, key) || !SWITCHES[key].split('|').includes(value)) return undefined;
    switches[key] = value;
  }
  return switches;
}

function validGroup(group, switches) {
  if (!within(group.dim, 3, 11) || !within(group.splats, 0, 2 ** 32)) return false;
  if (!('rows' in group)) return true;
  const {classes, places, rows} = group;
  return classes.length === CLASSES && classes.every((count) => within(count, 0, group.splats)) &&
      classes.reduce((a, b) => a + b, 0) === group.splats && within(places.bytes, 1, 7) &&
      [0, 1, 2].every((axis) => Number.isFinite(places.centre[axis])) && Number.isFinite(places.step) &&
      rows.length + 3 === layoutOf(group.dim, switches).count &&
      rows.every(
          (row) => within(row.bytes, 1, 4) && Number.isFinite(row.centre) && Number.isFinite(row.step));
}

// The PSNR of a level is null if it is infinite or unknown.
function validLevel(level, switches) {
  return within(level.bytes, 0, Number.MAX_SAFE_INTEGER) &&
      (level.psnr === null || Number.isFinite(level.psnr)) &&
      level.groups.every((group) => validGroup(group, switches));
}

// Parses the header of a file that starts with these bytes. Returns the switches, the levels, and the offset of the
// first level in the file. Throws an error for headers that `ubs` does not write.
function readHeader(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 16 || view.getUint32(0) !== 0x5542535a) throw new Error('this is not a UBSZ file');
  const version = view.getUint32(4, true);
  if (version !== 1 && version !== 2) throw new Error(`UBSZ version ${version} is not known`);
  const size = view.getUint32(8, true);
  if (size > bytes.length - 16) throw new Error('the model is cut off');
  const words = bytes.subarray(16, 16 + size);
  if (crc32(words) !== view.getUint32(12, true)) throw new Error('the header of the model is damaged');
  const begin = 16 + size;
  try {
    const header = JSON.parse(new TextDecoder().decode(words)), switches = readSwitches(header.switches);
    const levels =
        version === 2 ? header.levels : [{bytes: bytes.length - begin, psnr: null, groups: header.groups}];
    if (switches && within(levels.length, 1, MAX_LEVELS) &&
        levels.every((level) => validLevel(level, switches)))
      return {switches, levels, begin};
  } catch {  // the header is not JSON, or a member is missing or has the wrong type
  }
  throw new Error('the header of the model is not valid');
}

// Returns the number of bytes of a group before compression.
function groupBytes(group, switches) {
  const each = group.rows ? group.rows.reduce((sum, row) => sum + row.bytes, group.places.bytes) :
                            4 * layoutOf(group.dim, switches).count;
  return each * group.splats;
}

// Unpacks the groups of a level.
async function unpack(level, switches, bytes) {
  const size = level.groups.reduce((sum, group) => sum + groupBytes(group, switches), 0);
  if (size > MAX_RATIO * bytes.length) throw new Error('the model is cut off');
  const payload = await inflate(bytes, size);
  let at = 0;
  const take = (count) => {
    if (at + count > payload.length) throw new Error('the model is cut off');
    at += count;
    return payload.subarray(at - count, at);
  };
  const groups = level.groups.map((group) => {
    const layout = layoutOf(group.dim, switches);
    return {layout, count: group.splats, rows: readGroup(group, layout.count, take)};
  });
  return groups;
}

// ---- Values that do not depend on the query ----
const softplus = (x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
const sigmoid = (x) => 1 / (1 + Math.exp(-x));
const triangle = (i, j) => i * (i - 1) / 2 + j;

// Returns the rotation R of sections 2.1 and 8 in row-major order.
function rotationMatrix(mode, a) {
  if (mode === 'quaternion') {
    const length = Math.max(Math.hypot(a[0], a[1], a[2], a[3]), 1e-12);
    const [w, x, y, z] = a.map((v) => v / length);
    return [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
      1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
      1 - 2 * (x * x + y * y)
    ];
  }
  const A = [0, a[0], a[1], -a[0], 0, a[2], -a[1], -a[2], 0];
  const t = a[0] * a[0] + a[1] * a[1] + a[2] * a[2], angle = Math.sqrt(t);
  let f = 1, g = 0;
  if (mode === 'taylor2') g = 0.5;
  if (mode === 'cayley') f = g = 2 / (1 + t);
  if (mode === 'exp') {
    f = t < 1e-6 ? 1 - t / 6 : Math.sin(angle) / angle;
    g = t < 1e-6 ? 0.5 - t / 24 : 2 * Math.sin(angle / 2) ** 2 / t;
  }
  const R = [];
  for (let i = 0; i < 3; ++i)
    for (let j = 0; j < 3; ++j) {
      const square = A[3 * i] * A[j] + A[3 * i + 1] * A[3 + j] + A[3 * i + 2] * A[6 + j];
      R.push((i === j ? 1 : 0) + f * A[3 * i + j] + g * square);
    }
  return R;
}

// Returns the factor L of the covariance, with the lower limits of kernels/limits.h: its spatial rows M (3 x
// F) and its query rows B (C x N). With direct conditioning (section 9), a row of B is a row of Theta
// followed by a row of the factor of the precision.
function factorOf(e, l, s) {
  const N = l.dim, scale = [];
  for (let k = 0; k < N; ++k) scale.push(softplus(e[l.scale + k]));
  const skew = s.cov_param === 'skew_nd', cholesky = s.cov_param === 'cholesky', F = skew ? N : 3;
  const floor = (skew ? 1e-3 : cholesky ? 3e-4 : 1e-4) * Math.max(scale[0], scale[1], scale[2]);
  for (let k = 0; k < 3; ++k) scale[k] = Math.max(scale[k], floor);
  const queryLeast = s.cov_mode === 'whiten' ? 1.2e-2 : 6e-3;
  const low = (i, j) => e[l.rotation + triangle(i, j)];
  const M = [[], [], []], B = [];
  if (skew) {
    const entry = (i, j) => (i === j ? 1 : j > i ? low(j, i) : -low(i, j));
    const lifted = scale.map((v, i) => {
      let square = 0;
      for (let j = i < 3 ? 3 : 0; j < N; ++j)
        if (j !== i) square += (entry(i, j) * scale[j]) ** 2;
      return Math.max(v, (i < 3 ? 1.5e-2 : queryLeast) * Math.sqrt(square));
    });
    const R = rotationMatrix(s.rot_mode, [low(1, 0), low(2, 0), low(2, 1)]);
    for (let r = 0; r < 3; ++r)
      for (let c = 0; c < N; ++c) M[r].push((c < 3 ? R[3 * r + c] : low(c, r)) * lifted[c]);
    for (let i = 3; i < N; ++i) B.push(lifted.map((v, j) => entry(i, j) * v));
    return {M, B, F, scale: lifted};
  }
  if (cholesky) {
    for (let r = 0; r < 3; ++r)
      for (let c = 0; c < 3; ++c) M[r].push(r === c ? scale[c] : r > c ? low(r, c) : 0);
  } else {
    const raw = [0, 1, 2, 3].slice(0, s.rot_mode === 'quaternion' ? 4 : 3).map((k) => e[l.rotation + k]);
    const R = rotationMatrix(s.rot_mode, raw);
    for (let r = 0; r < 3; ++r)
      for (let c = 0; c < 3; ++c) M[r].push(R[3 * r + c] * scale[c]);
  }
  for (let i = 3; i < N; ++i) {
    const row = new Array(N).fill(0);
    let square = 0;
    for (let j = 0; j < i; ++j) {
      row[j] = low(i, j);
      square += row[j] * row[j];
    }
    row[i] = s.conditioning === 'direct' ? scale[i] : Math.max(scale[i], queryLeast * Math.sqrt(square));
    B.push(row);
  }
  return {M, B, F, scale};
}

// Factorises B = Lh Q, where the rows of Q are orthonormal, and inverts Lh. Lh and its inverse are lower triangular.
function factorise(B, N) {
  const C = B.length, lh = B.map(() => new Array(C).fill(0)), q = [];
  for (let i = 0; i < C; ++i) {
    const row = B[i].slice();
    for (let pass = 0; pass < 2; ++pass)
      for (let j = 0; j < i; ++j) {
        let dot = 0;
        for (let k = 0; k < N; ++k) dot += q[j][k] * row[k];
        lh[i][j] += dot;
        for (let k = 0; k < N; ++k) row[k] -= dot * q[j][k];
      }
    let square = 0;
    for (let k = 0; k < N; ++k) square += row[k] * row[k];
    lh[i][i] = Math.max(Math.sqrt(square), 1e-30);
    q.push(row.map((v) => v / lh[i][i]));
  }
  const inverse = B.map(() => new Array(C).fill(0));
  for (let c = 0; c < C; ++c)
    for (let i = c; i < C; ++i) {
      let v = i === c ? 1 : 0;
      for (let j = c; j < i; ++j) v -= lh[i][j] * inverse[j][c];
      inverse[i][c] = v / lh[i][i];
    }
  return {q, inverse};
}

// Returns column j of G with direct conditioning: s sum_i w_i (L L^T)_ij Theta_i, where s is the mean scale.
function directColumn(B, j, weight, scale) {
  const G = [0, 0, 0];
  B.forEach((row, i) => {
    let precision = 0;
    for (let k = 0; k <= Math.min(i, j); ++k) precision += row[3 + k] * B[j][3 + k];
    for (let r = 0; r < 3; ++r) G[r] += scale * weight[i] * precision * row[r];
  });
  return G;
}

// Prepares a group for slicing. `fixed` has `stride` floats per splat: position (3), opacity, beta, query mean (C),
// exponents (C), G (3C), inverse of Lh (C(C+1)/2; with direct conditioning, L by columns), colour and lobes.
// `covariance` is V (section 2.3), which is the same for every query.
function prepare(group, s) {
  const l = group.layout, C = l.C, N = l.dim, n = group.count, colours = 3 * Math.max(l.harmonics, 1);
  const at = {mean: 5};
  at.exponent = at.mean + C;
  at.G = at.exponent + C;
  at.inverse = at.G + 3 * C;
  at.colour = at.inverse + C * (C + 1) / 2;
  at.lobes = at.colour + colours;
  const stride = at.lobes + 7 * l.lobes;
  const fixed = new Float32Array(n * stride), covariance = new Float64Array(n * 6),
        e = new Float64Array(l.count);
  const direct = s.conditioning === 'direct', learnt = direct && s.beta_opacity !== 'tanh';
  const whiten = s.cov_mode === 'whiten' || s.beta_cond === 'off', weight = new Float64Array(8);
  const K = new Float64Array(N * N), column = new Float64Array(N);
  for (let i = 0; i < n; ++i) {
    let length = 0;
    for (let k = 0; k < l.count; ++k) {
      e[k] = group.rows[k][i];
      length += e[k] * e[k];
    }
    const to = i * stride;
    for (let k = 0; k < 3; ++k) fixed[to + k] = e[k];
    fixed[to + 3] = length <= 1e24 ? sigmoid(e[l.opacity]) : 0;
    fixed[to + 4] = KERNELS[s.kernel].hasBeta ? 4 * Math.exp(Math.min(e[l.beta], 7.5)) : 0;
    // The parameters have the constant harmonics of all channels first, then the others of each channel;
    // `fixed` has all harmonics of one channel after the other.
    for (let c = 0; c < 3 && l.harmonics; ++c)
      for (let k = 0; k < l.harmonics; ++k)
        fixed[to + at.colour + c * l.harmonics + k] = e[l.rgb + (k ? 3 + c * (l.harmonics - 1) + k - 1 : c)];
    if (!l.harmonics)
      for (let c = 0; c < 3; ++c) fixed[to + at.colour + c] = e[l.rgb + c];
    for (let k = 0; k < l.lobes; ++k) {  // a lobe has an axis, an exponent and a colour
      const [red, green, blue, theta, phi, beta] =
          [0, 1, 2, 3, 4, 5].map((f) => e[l.rgb + 3 + f * l.lobes + k]);
      const soft = (v) => softplus(10 * Math.LN2 * v) / (10 * Math.LN2), st = Math.sin(theta);
      fixed.set(
          [
            st * Math.cos(phi), st * Math.sin(phi), Math.cos(theta), 4 * Math.exp(Math.min(beta, 7.5)),
            soft(red), soft(green), soft(blue)
          ],
          to + at.lobes + 7 * k);
    }
    const {M, B, F, scale} = factorOf(e, l, s);
    K.fill(0);
    for (let r = 0; r < F; ++r) K[r * F + r] = 1;
    if (C > 0) {
      const {q, inverse} = direct ? {} : factorise(B, N);
      for (let j = 0; j < C; ++j) {
        const growth = l.mean > l.queryBeta ? Math.exp(e[l.queryBeta + j]) : 1;
        weight[j] = s.beta_cond !== 'on' ? 1 : learnt ? sigmoid(e[l.queryBeta + j]) : Math.min(growth, 1);
        fixed[to + at.mean + j] = e[l.mean + j];
        fixed[to + at.exponent + j] = s.beta_opacity === 'tanh' ? 4 * growth : 1;
      }
      let entry = to + at.inverse;
      for (let j = 0; j < C && direct; ++j) {
        fixed.set(directColumn(B, j, weight, (scale[0] + scale[1] + scale[2]) / 3), to + at.G + 3 * j);
        for (let i2 = j; i2 < C; ++i2) fixed[entry++] = B[i2][3 + j];
      }
      for (let j = 0; j < C && !direct; ++j) {
        // Compute column j of U^T Lh^-1 diag(w) or, if whitened, of U^T diag(w) Lh^-1, and its contribution to K.
        column.fill(0);
        for (let i2 = j; i2 < C; ++i2) {
          const times = inverse[i2][j] * weight[whiten ? i2 : j];
          for (let c = 0; c < F; ++c) column[c] += q[i2][c] * times;
        }
        for (let r = 0; r < F; ++r)
          for (let c = 0; c < F; ++c)
            K[r * F + c] -= whiten ? weight[j] * q[j][r] * q[j][c] : column[r] * B[j][c];
        for (let r = 0; r < 3; ++r) {
          let sum = 0;
          for (let c = 0; c < F; ++c) sum += M[r][c] * column[c];
          fixed[to + at.G + 3 * j + r] = sum;
        }
        for (let i2 = j; i2 < C; ++i2) fixed[to + at.inverse + i2 * (i2 + 1) / 2 + j] = inverse[i2][j];
      }
    }
    const V = (r, c) => {
      let sum = 0;
      for (let a = 0; a < F; ++a)
        for (let b = 0; b < F; ++b) sum += M[r][a] * K[a * F + b] * M[c][b];
      return sum;
    };
    let entry = 6 * i;
    for (let r = 0; r < 3; ++r)
      for (let c = r; c < 3; ++c)
        covariance[entry++] = V(r, c);
  }
  return {C, n, at, stride, fixed, covariance, harmonics: l.harmonics, lobes: l.lobes};
}

// ---- Selection by betas ----
// Returns for each splat the quantile of its beta, as in host/model/decompose.hpp. Returns null if the model has no
// such beta.
function quantiles(model, kind) {
  const {groups, switches: s} = model;
  const angular = (dim) => dim >= 6, temporal = (dim) => dim === 4 || dim === 5 || dim >= 7;
  // If `learnt` is true, the rows of query betas contain weights.
  const learnt = s.conditioning === 'direct' && s.beta_opacity !== 'tanh';
  const has = (l) =>
      (kind === 'spatial' ? KERNELS[s.kernel].hasBeta :
                            l.mean > l.queryBeta && !learnt &&
                                (kind === 'angular' ? angular(l.dim) : temporal(l.dim)));
  if (!groups.some((g) => has(g.layout))) return null;
  const values = [];
  for (const {layout: l, rows, count} of groups)
    for (let i = 0; i < count; ++i) {
      if (!has(l))
        values.push(-Infinity);
      else if (kind === 'spatial')
        values.push(rows[l.beta][i]);
      else if (kind === 'temporal')
        values.push(rows[l.queryBeta + (l.C >= 3 ? 3 : 0)][i]);
      else
        values.push((rows[l.queryBeta][i] + rows[l.queryBeta + 1][i] + rows[l.queryBeta + 2][i]) / 3);
    }
  const order = values.map((_, i) => i)
                    .sort((a, b) => (values[a] < values[b] ? -1 :
                                  values[a] > values[b]    ? 1 :
                                                             a - b));
  const out = new Float32Array(values.length);
  order.forEach((splat, rank) => {
    out[splat] = (rank + 0.5) / values.length;
  });
  return out;
}

// ---- A frame ----
// A table of ln(1 - tanh u) for linear interpolation, whose error is at most 1.3e-7.
const LN_STEP = 1 / 1024, LN_END = 8.4;
const LN = Float64Array.from({length: LN_END / LN_STEP + 2},
    (_, i) => Math.LN2 - 2 * i * LN_STEP - Math.log1p(Math.exp(-2 * i * LN_STEP)));
function lnOneMinusTanh(u) {
  if (u >= LN_END) return -15.942385152878742;
  const place = u / LN_STEP, i = Math.floor(place), v = LN[i] + (LN[i + 1] - LN[i]) * (place - i);
  return v < -15.942385152878742 ? -15.942385152878742 : v;
}

function harmonic(f, at, count, x, y, z) {
  let v = 0.5 + 0.28209479177387814 * f[at];
  if (count > 1) v += 0.4886025119029199 * (-y * f[at + 1] + z * f[at + 2] - x * f[at + 3]);
  const xx = x * x, yy = y * y, zz = z * z;
  if (count > 4)
    v += 1.0925484305920792 * (x * y * f[at + 4] - y * z * f[at + 5] - x * z * f[at + 7]) +
        0.31539156525252005 * (2 * zz - xx - yy) * f[at + 6] + 0.5462742152960396 * (xx - yy) * f[at + 8];
  if (count > 9)
    v += -0.5900435899266435 * (y * (3 * xx - yy) * f[at + 9] + x * (xx - 3 * yy) * f[at + 15]) +
        2.890611442640554 * x * y * z * f[at + 10] + 1.445305721320277 * z * (xx - yy) * f[at + 14] -
        0.4570457994644658 * (4 * zz - xx - yy) * (y * f[at + 11] + x * f[at + 13]) +
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy) * f[at + 12];
  return Math.max(0, v);
}

const LEAST_OPACITY = 1e-5;  // a hundred splats with this opacity change a pixel by a quarter of 1/255

// Computes the records of the visible splats, in the order of the model, and their depths. Returns their
// number.
function project(model, camera, chosen, records, depths) {
  const {switches: s, prepared} = model;
  const [r00, r01, r02, r10, r11, r12, r20, r21, r22] = camera.rotation, [ox, oy, oz] = camera.centre;
  const {fx, fy, cx, cy, width, height, near, far, eps2d, alphaMin} = camera;
  const marginX = 0.15 * width / fx, marginY = 0.15 * height / fy;
  const right = (width - cx) / fx + marginX, left = -cx / fx - marginX;
  const bottom = (height - cy) / fy + marginY, top = -cy / fy - marginY;
  const kernel = KERNELS[s.kernel], support = kernel.support;
  const leastAlpha = Math.max(kernel.leastAlpha, alphaMin);
  const direct = s.conditioning === 'direct', tanh = s.beta_opacity === 'tanh', antialias = s.antialias === 'on';
  const x = new Float64Array(8);
  let drawn = 0, splat = 0;
  for (const g of prepared) {
    const {C, at, stride, fixed: f, covariance: V, harmonics, lobes} = g, directed = C >= 3;
    for (let i = 0; i < g.n; ++i, ++splat) {
      if (chosen && !chosen[splat]) continue;
      const p = i * stride;
      let wx = f[p] - ox, wy = f[p + 1] - oy, wz = f[p + 2] - oz, dx = 0, dy = 0, dz = 0;
      if (directed || harmonics > 1 || lobes) {
        const rho = Math.max(Math.sqrt(wx * wx + wy * wy + wz * wz), 1e-12);
        dx = wx / rho;
        dy = wy / rho;
        dz = wz / rho;
      }
      if (C > 0) {
        const m = p + at.mean, first = directed ? 3 : 0;
        if (directed) {
          x[0] = dx - f[m];
          x[1] = dy - f[m + 1];
          x[2] = dz - f[m + 2];
        }
        for (let j = first; j < C; ++j) x[j] = camera.query[j - first] - f[m + j];
        for (let j = 0, G = p + at.G; j < C; ++j, G += 3) {
          wx += f[G] * x[j];
          wy += f[G + 1] * x[j];
          wz += f[G + 2] * x[j];
        }
      }
      const z = r20 * wx + r21 * wy + r22 * wz;
      if (!(z >= near && z <= far)) continue;
      let sx = (r00 * wx + r01 * wy + r02 * wz) / z, sy = (r10 * wx + r11 * wy + r12 * wz) / z;
      const u = fx * sx + cx, v = fy * sy + cy;
      sx = sx < left ? left : sx > right ? right : sx;
      sy = sy < top ? top : sy > bottom ? bottom : sy;
      const kx = fx / z, ky = fy / z;
      const a0 = kx * (r00 - sx * r20), a1 = kx * (r01 - sx * r21), a2 = kx * (r02 - sx * r22);
      const b0 = ky * (r10 - sy * r20), b1 = ky * (r11 - sy * r21), b2 = ky * (r12 - sy * r22);
      const c = 6 * i, v00 = V[c], v01 = V[c + 1], v02 = V[c + 2], v11 = V[c + 3], v12 = V[c + 4],
            v22 = V[c + 5];
      const h0 = v00 * a0 + v01 * a1 + v02 * a2, h1 = v01 * a0 + v11 * a1 + v12 * a2,
            h2 = v02 * a0 + v12 * a1 + v22 * a2;
      const sharpA = a0 * h0 + a1 * h1 + a2 * h2, sharpB = b0 * h0 + b1 * h1 + b2 * h2;
      const sharpC = b0 * (v00 * b0 + v01 * b1 + v02 * b2) + b1 * (v01 * b0 + v11 * b1 + v12 * b2) +
          b2 * (v02 * b0 + v12 * b1 + v22 * b2);
      const A = sharpA + eps2d, CC = sharpC + eps2d, sharp = sharpA * sharpC - sharpB * sharpB;
      const det = sharp + eps2d * (sharpA + sharpC + eps2d);
      if (!(det > 0.1 * eps2d * (A + sharpC) && det > 0 && A > 0 && CC > 0)) continue;
      const hx = Math.sqrt(support * A), hy = Math.sqrt(support * CC);
      if (!(u + hx > 0 && u - hx < width && v + hy > 0 && v - hy < height)) continue;

      let ln = 0;
      if (C > 0 && s.beta_opacity !== 'none') {
        let t = p + at.inverse;
        for (let j = 0; j < C && ln > -12; ++j) {
          let y = 0;
          for (let k = direct ? j : 0, end = direct ? C : j + 1; k < end; ++k) y += f[t++] * x[k];
          ln += tanh ? f[p + at.exponent + j] * lnOneMinusTanh(y * y) : -0.35 * Math.min(y * y, 1e4);
        }
      }
      let opacity = f[p + 3] * Math.exp(ln);
      if (antialias) opacity *= Math.sqrt(Math.max(0, sharp / det));
      if (!(opacity > Math.max(LEAST_OPACITY, leastAlpha))) continue;
      const beta = f[p + 4];
      const reach = leastAlpha > 0 ? Math.min(support, kernel.reach(opacity, leastAlpha, beta)) : support;
      const o = drawn * RECORD, l00 = Math.sqrt(CC / det);
      records[o] = u;
      records[o + 1] = v;
      records[o + 2] = l00;
      records[o + 3] = -sharpB / (det * l00);
      records[o + 4] = 1 / Math.sqrt(CC);
      records[o + 5] = opacity;
      records[o + 6] = beta;
      records[o + 7] = z;
      const k = p + at.colour;
      if (harmonics) {
        for (let channel = 0; channel < 3; ++channel)
          records[o + 8 + channel] = harmonic(f, k + channel * harmonics, harmonics, dx, dy, dz);
      } else {
        records[o + 8] = f[k];
        records[o + 9] = f[k + 1];
        records[o + 10] = f[k + 2];
      }
      for (let b = p + at.lobes; b < p + at.lobes + 7 * lobes; b += 7) {
        const r = 0.5 * ((dx - f[b]) ** 2 + (dy - f[b + 1]) ** 2 + (dz - f[b + 2]) ** 2);
        const value = r < 1 ? Math.pow(1 - r, f[b + 3]) : 0;
        for (let channel = 0; channel < 3; ++channel) records[o + 8 + channel] += f[b + 4 + channel] * value;
      }
      records[o + 11] = reach;
      depths[drawn++] = z;
    }
  }
  return drawn;
}

// Sorts indices by increasing depth; equal depths keep the order of the model. The bits of positive floats
// have the same order as their values.
class Sorter {
  constructor(n) {
    this.from = new Uint32Array(n);
    this.to = new Uint32Array(n);
    this.sums = new Uint32Array(65536);
  }
  sort(bits, n) {
    for (let i = 0; i < n; ++i) this.from[i] = i;
    for (const shift of [0, 16]) {
      const {from, to, sums} = this;
      sums.fill(0);
      for (let i = 0; i < n; ++i) ++sums[bits[i] >>> shift & 65535];
      for (let k = 0, sum = 0; k < 65536; ++k) {
        const count = sums[k];
        sums[k] = sum;
        sum += count;
      }
      for (let i = 0; i < n; ++i) to[sums[bits[from[i]] >>> shift & 65535]++] = from[i];
      [this.from, this.to] = [to, from];
    }
    return this.from;
  }
}

// ---- Messages ----
const state = {bytes: new Uint8Array(0), ranges: {}};

// Adds a further part of the file. Each level that is now complete is shown together with the levels before
// it.
async function open(data) {
  const text = atob(data.model), before = state.bytes;
  state.bytes = new Uint8Array(before.length + text.length);
  state.bytes.set(before);
  for (let i = 0; i < text.length; ++i) state.bytes[before.length + i] = text.charCodeAt(i);
  if (!state.header) {
    const header = readHeader(state.bytes);
    Object.assign(state, {header, at: header.begin, next: 0});
    state.model = {switches: header.switches, groups: [], prepared: []};
  }
  const {header, model} = state;
  while (state.next < header.levels.length &&
      state.at + header.levels[state.next].bytes <= state.bytes.length) {
    const level = header.levels[state.next], end = state.at + level.bytes;
    const groups = await unpack(level, model.switches, state.bytes.subarray(state.at, end));
    state.at = end;
    ++state.next;
    model.groups.push(...groups);
    model.prepared.push(...groups.map((g) => prepare(g, model.switches)));
    show(level);
  }
  if (state.next === header.levels.length) {
    state.surplus = state.bytes.length > state.at;
    state.bytes = new Uint8Array(0);
  }
}

function show(level) {
  const {header, model} = state, last = state.next === header.levels.length;
  const n = model.groups.reduce((sum, g) => sum + g.count, 0);
  state.quantiles = {};
  for (const kind of ['spatial', 'angular', 'temporal']) state.quantiles[kind] = quantiles(model, kind);
  if (last)
    for (const g of model.groups) g.rows = null;
  Object.assign(state, {
    n,
    records: new Float32Array(n * RECORD),
    depths: new Float32Array(n),
    sorter: new Sorter(n)
  });
  state.bits = new Uint32Array(state.depths.buffer);
  choose(state.ranges);
  postMessage({
    kind: 'opened',
    splats: n,
    bytes: state.at,
    level: state.next,
    levels: header.levels.length,
    psnr: level.psnr,
    switches: model.switches,
    dims: [...new Set(model.groups.map((g) => g.layout.dim))],
    betas: Object.keys(state.quantiles).filter((k) => state.quantiles[k])
  });
}

// This function is called when no further parts will arrive.
function end() {
  if (!state.header || state.next < state.header.levels.length) throw new Error('the model is cut off');
  if (state.surplus) throw new Error('the model contains more data than its header says');
}

function choose(ranges) {
  state.ranges = ranges;
  state.chosen = null;
  for (const [kind, [low, high]] of Object.entries(ranges)) {
    const q = state.quantiles[kind];
    if (!q || (low <= 0 && high >= 1)) continue;
    state.chosen = state.chosen || new Uint8Array(state.n).fill(1);
    for (let i = 0; i < state.n; ++i)
      if (!(q[i] >= low && q[i] < high)) state.chosen[i] = 0;
  }
}

function frame(data) {
  const begin = performance.now();
  const {model, records, depths, sorter} = state;
  const drawn = project(model, data.camera, state.chosen, records, depths);
  const between = performance.now();
  const order = sorter.sort(state.bits, drawn);
  const out = data.buffer && data.buffer.byteLength >= 4 * drawn * RECORD ?
      new Float32Array(data.buffer) :
      new Float32Array(Math.max(1, Math.min(state.n, Math.ceil(1.3 * drawn))) * RECORD);
  for (let i = 0, o = 0; i < drawn; ++i) {  // write the farthest splat first
    const from = order[drawn - 1 - i] * RECORD;
    for (let k = 0; k < RECORD; ++k) out[o++] = records[from + k];
  }
  const end = performance.now(),
        depth = (q) => (drawn ? depths[order[Math.min(drawn - 1, Math.floor(q * drawn))]] : 0);
  postMessage({
    kind: 'frame',
    id: data.id,
    width: data.camera.width,
    height: data.camera.height,
    drawn,
    buffer: out.buffer,
    nearest: depth(0.02),
    farthest: depth(0.98),
    slice: between - begin,
    sort: end - between
  },
      [out.buffer]);
}

// Messages are handled one after the other, so that no frame is rendered while a level is half loaded.
const answers = {
  part: open,
  end,
  choose: (data) => choose(data.ranges),
  frame
};
let done = Promise.resolve();
onmessage = (event) => {
  done = done.then(() => answers[event.data.kind](event.data))
             .catch((error) => postMessage({kind: 'error', text: error.message}));
};
