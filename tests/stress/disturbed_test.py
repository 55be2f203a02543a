#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the device check and some tests of `ubs-lab stress` with inexact divisions. Run it as disturbed_test.py UBS
UBS-LAB, with the paths of the two executables.

OpenCL allows errors of about 3 ulp in divisions and roots. CPUs round both correctly, so ordinary tests on a CPU do not
show the results of a device with such errors. disturb() writes a copy of kernels/ in which every floating-point
quotient, root and reciprocal is changed by up to 3 ulp; a hash of the bits of the operands determines the change. If
`functions` is 1, it also changes the results of exp, log, sin and cos. With this copy, the device check and the stress
tests must pass, and the errors of four stages must be at least twice those with the original kernels.
`disturbed_test.py --write OUT [name=value ...]` only writes the copy to the folder OUT; names and values are parameters
of disturb().
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

KERNELS = pathlib.Path(__file__).resolve().parents[2] / 'kernels'
ROWS = 'needles*,query condition*,low betas*,four pixels on rims*,large image*,relocation*'
TOKEN = re.compile(r'//[^\n]*|/\*.*?\*/|\\\n|\s+|"(?:\\.|[^"\\])*"|\.?\d(?:[eEpP][+-]|[\w.])*|\w+|/=|->|.', re.S)
HEAD = re.compile(r'^[ \t]*#[ \t]*(?:define[ \t]+\w+(?:\([^)]*\))?|(?!define)(?:[^\n\\]|\\.)*)', re.M | re.S)
KEYWORDS = {'return', 'if', 'else', 'for', 'while', 'case', 'do'}
# Text that is appended to kernels/dialect/dialect.h. UBS_DIV chooses an implementation by the type of the quotient, so
# integer divisions are not changed.
PRELUDE = r'''
#if defined(UBS_OPENCL) && !defined(UBS_REAL_DOUBLE)
#define UBS_OVERLOAD static inline __attribute__((overloadable, always_inline))
#define UBS_MOVE(real_type, uint_type, as_bits, as_real_type)                                       \
  UBS_OVERLOAD real_type ubs_moved(real_type q, real_type a, real_type b) {                         \
    uint_type h = (as_bits(a) * 0x9e3779b1u ^ as_bits(b) * 0x85ebca77u) + %(seed)uu * 0x27d4eb2fu;  \
    h = (h ^ h >> 15) * 0x2c1b3c6du;                                                                \
    h = ((h ^ h >> 13) >> 16) * %(values)uu >> 16;                                                  \
    uint_type bits = as_bits(q), size = bits & 0x7fffffffu;                                         \
    real_type moved = as_real_type(bits + h * %(step)uu + (uint)(%(least)d));                       \
    return size > 0x800010u && size < 0x7f7ffff0u ? moved : q;  /* not denormals, not infinity */   \
  }                                                                                                 \
  UBS_OVERLOAD real_type ubs_quotient(real_type a, real_type b) { return ubs_moved(a / b, a, b); }
UBS_MOVE(float, uint, as_uint, as_float)
#if UBS_VW == 1
#define UBS_DIV(a, b) _Generic((a) / (b), float: ubs_quotient(a, b), default: (a) / (b))
#else
UBS_MOVE(vreal, vuint, UBS_FLOAT_BITS, UBS_PASTE(as_float, UBS_VW))
vuint __attribute__((overloadable)) ubs_quotient(vuint a, uint b);  // must exist to compile
#define UBS_DIV(a, b) \
  _Generic((a) / (b), float: ubs_quotient(a, b), vreal: ubs_quotient(a, b), default: (a) / (b))
#endif
#define UBS_MOVED(call, x) ubs_moved(call(x), x, x)
#else
#define UBS_MOVED(call, x) call(x)
#define UBS_DIV(a, b) ((a) / (b))
#endif
'''


def tokens(text):
    """Splits C code into tokens. A directive, or the head of a #define, is one token."""
    out, at = [], 0
    for m in HEAD.finditer(text):
        out += [*TOKEN.findall(text[at:m.start()]), m[0]]
        at = m.end()
    return out + TOKEN.findall(text[at:])


def is_operand(t):  # returns whether a token is part of a name, number, call, cast or group (no operator or keyword)
    return t not in KEYWORDS and (t[0].isalnum() or t[0] in '_.([' or t == '->')


def step(parts, i, by):  # returns the index of the next token in direction `by` that is no white space or comment
    i += by
    while 0 <= i < len(parts) and (parts[i][0].isspace() or parts[i][:2] in ('//', '/*', '\\\n')):
        i += by
    return i


def operands(parts, i, by):  # returns the index of the last of the adjacent operand tokens that begin at i
    while 0 <= (k := step(parts, i, by)) < len(parts) and is_operand(parts[k]):
        i = k
    return i


def left_of(parts, i):
    """Returns where the left operand of the `/` at i begins. Products and quotients are left-associative."""
    first = operands(parts, step(parts, i, -1), -1)
    while parts[i] != '/=':
        sign = step(parts, first, -1)
        before = step(parts, sign, -1)
        binary = before >= 0 and is_operand(parts[before])
        if sign < 0 or parts[sign] not in ('*%' if binary else '*-!~'):
            break
        first = operands(parts, before, -1) if binary else sign
    return first


def divided(parts):
    """Returns the tokens as text, with UBS_DIV instead of `/`."""
    out, i = [], 0
    while i < len(parts):  # replaces divisions within parentheses and brackets first
        k = i
        if parts[i] in '([':
            depth = 1
            while depth:
                depth += (parts[k := k + 1] in '([') - (parts[k] in ')]')
        out.append(parts[i] if k == i else parts[i] + divided(parts[i + 1:k]) + parts[k])
        i = k + 1
    while (i := next((k for k, t in enumerate(out) if t in ('/', '/=')), -1)) >= 0:
        last = step(out, i, 1)
        while out[last] in '-+!~*&':
            last = step(out, last, 1)
        first, last = left_of(out, i), operands(out, last, 1)
        left, right = (''.join(t).strip() for t in (out[first:i], out[i + 1:last + 1]))
        out[first:last + 1] = [(f'{left} = ' if out[i] == '/=' else '') + f'UBS_DIV({left}, {right})']
    return ''.join(out)


def disturb(out, seed=1, values=7, step=1, least=-3, functions=0):
    """Writes the changed kernels to `out`. Each result is changed by least + step * k ulp, where k is a number from 0
    to values - 1 that depends on the operands and on `seed`."""
    shutil.copytree(KERNELS, out)
    names = 'sqrt|native_recip' + ('|exp|log|log1p|expm1|sin|cos|native_exp2|native_log2' if functions else '')
    for path in [*out.rglob('*.h'), *out.rglob('*.cl')]:
        text = re.sub(rf'(?<![\w:])({names})\((?=[^()])', r'UBS_MOVED(\1, ', divided(tokens(path.read_text())))
        if path.name == 'dialect.h':
            text += PRELUDE % {'seed': seed, 'values': values, 'step': step, 'least': least}
        path.write_text(text)


def checked(ubs, **environment):
    """Returns the errors of the stages as fractions of their bounds."""
    text = subprocess.run([ubs, 'devices', '--check', '--dim', '6', '--device', 'opencl', '--json'],
                          stdout=subprocess.PIPE, env={**os.environ, **environment}).stdout
    stages = json.loads(text)['devices'][0]['forms'][0]['stages']
    return {s['stage']: s['error'] / (s['bound'] or 1e-30) for s in stages}


def main(ubs, lab):
    with tempfile.TemporaryDirectory() as folder:
        kernels = pathlib.Path(folder) / 'kernels'
        disturb(kernels, values=2, step=6)  # 3 ulp up or down
        plain, moved = checked(ubs), checked(ubs, UBS_KERNEL_DIR=str(kernels))
        print(*(f'{s}: {plain[s]:.3f} of the bound, disturbed {moved[s]:.3f}' for s in moved), sep='\n', flush=True)
        assert all(share <= 1 for share in moved.values()), 'an error of `ubs devices --check` exceeds its bound'
        undisturbed = [s for s in ('projection', 'loss', 'penalties', 'noise') if moved[s] < 2 * plain[s]]
        assert not undisturbed, f'the errors of these stages did not grow: {undisturbed}'
        rows = subprocess.run([lab, 'stress', ROWS], env={**os.environ, 'UBS_KERNEL_DIR': str(kernels)})
        assert rows.returncode == 0, 'a row of `ubs-lab stress` fails'


if sys.argv[1] == '--write':
    disturb(pathlib.Path(sys.argv[2]), **{n: int(v) for n, v in (a.split('=') for a in sys.argv[3:])})
else:
    main(*sys.argv[1:])
