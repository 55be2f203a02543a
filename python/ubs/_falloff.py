# SPDX-License-Identifier: Apache-2.0
"""Defines Falloff, which describes the falloff of splats by an expression. This module converts the expression to C for
the kernels, computes its derivatives, evaluates it in float64, and compares the results of a device with these
values."""

from __future__ import annotations

import ast
import math
from typing import Any, Callable, NamedTuple

import numpy as np

from . import _abi
from ._data import Camera, FloatArray
from ._errors import NumericalError, UsageError

# A node of an expression: an operation and its operands, such as ("*", ("number", 2.0), ("r",)). The operations are
# "number", "r", "beta", "+", "-", "*" and "/" of two nodes, the names in FUNCTIONS, and "less". The value of
# ("less", a, b, x, y) is x where a < b, and y elsewhere.
Node = tuple[Any, ...]
LOG2E = 1 / math.log(2)
# The maximum length of an expression in C. Expressions are passed in options of the compiler, and drivers limit the
# length of options.
MOST_CHARACTERS = 4000
# The kernels evaluate an expression for r up to END times the support, and its derivative with respect to r for r up to
# RIM times the support (own_inside() in kernels/math/falloff.h).
END, RIM = 1 - 1e-6, 1 - 1e-5
ALPHA_MAX = 0.999  # UBS_ALPHA_MAX of kernels/limits.h
# The largest allowed absolute error of alpha, and the largest allowed relative error of gradients. The largest errors
# observed in the tests are 2.5e-6 for alpha and 1.5e-5 for gradients.
MOST_ERROR = 1e-4, 1e-3
MOST_LOG2 = 1e-5  # the largest allowed value of log2, which includes rounding errors


def _number(value: float) -> Node:
    return ("number", float(value))


def _add(a: Node, b: Node) -> Node:
    if a == _number(0):
        return b
    return a if b == _number(0) else ("+", a, b)


def _subtract(a: Node, b: Node) -> Node:
    if b == _number(0):
        return a
    return _multiply(_number(-1), b) if a == _number(0) else ("-", a, b)


def _multiply(a: Node, b: Node) -> Node:
    if a[0] == b[0] == "number":
        return _number(a[1] * b[1])
    if _number(0) in (a, b):
        return _number(0)
    if a == _number(1):
        return b
    return a if b == _number(1) else ("*", a, b)


def _divide(a: Node, b: Node) -> Node:
    return a if a == _number(0) or b == _number(1) else ("/", a, b)


class _Function(NamedTuple):
    code: str  # the call of the function in the language of kernels/, with {} in place of the operand
    value: Callable[[Any], Any]  # computes the function with NumPy
    slope: Callable[[Node], Node]  # returns the derivative as a node


FUNCTIONS = {
    "exp": _Function(f"ubs_exp2(V({LOG2E!r})*{{}})", np.exp, lambda x: ("exp", x)),
    "exp2": _Function("ubs_exp2({})", np.exp2, lambda x: _multiply(_number(1 / LOG2E), ("exp2", x))),
    "log": _Function("ubs_log({})", np.log, lambda x: _divide(_number(1), x)),
    "log2": _Function(f"(ubs_log({{}})*V({LOG2E!r}))", np.log2, lambda x: _divide(_number(LOG2E), x)),
    "log2_1m": _Function("ubs_log2_1m({})", lambda x: np.log1p(-x) * LOG2E,
                         lambda x: _divide(_number(-LOG2E), _subtract(_number(1), x))),
    "sqrt": _Function("ubs_sqrt({})", np.sqrt, lambda x: _divide(_number(0.5), ("sqrt", x))),
    "sin": _Function("ubs_sin({})", np.sin, lambda x: ("cos", x)),
    "cos": _Function("ubs_cos({})", np.cos, lambda x: _multiply(_number(-1), ("sin", x))),
}


def _power(base: Node, exponent: Node) -> Node:
    if exponent[0] == "number" and exponent[1] in (1, 2, 3, 4):
        product = base
        for _ in range(int(exponent[1]) - 1):
            product = _multiply(product, base)
        return product
    return ("exp2", _multiply(exponent, ("log2", base)))


def _node(tree: ast.AST) -> Node:
    """Converts a Python expression to a node. Raises ValueError with the part that is not allowed."""
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float) and abs(tree.value) < 3e38:
        return _number(tree.value)
    if isinstance(tree, ast.Name) and tree.id in ("r", "beta"):
        return (tree.id,)
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, (ast.USub, ast.UAdd)):
        return _multiply(_number(-1 if isinstance(tree.op, ast.USub) else 1), _node(tree.operand))
    if isinstance(tree, ast.BinOp):
        makers: dict[type, Callable[[Node, Node], Node]] = {
            ast.Add: _add, ast.Sub: _subtract, ast.Mult: _multiply, ast.Div: _divide, ast.Pow: _power,
        }
        if type(tree.op) in makers:
            return makers[type(tree.op)](_node(tree.left), _node(tree.right))
    if isinstance(tree, ast.IfExp) and isinstance(tree.test, ast.Compare) and len(tree.test.ops) == 1:
        a, b = _node(tree.test.left), _node(tree.test.comparators[0])
        x, y = _node(tree.body), _node(tree.orelse)
        if isinstance(tree.test.ops[0], ast.Lt):
            return ("less", a, b, x, y)
        if isinstance(tree.test.ops[0], ast.Gt):
            return ("less", b, a, x, y)
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) and not tree.keywords:
        given = [_node(argument) for argument in tree.args]
        name = tree.func.id
        if name in FUNCTIONS and len(given) == 1:
            return (name, given[0])
        if name == "abs" and len(given) == 1:
            return ("less", given[0], _number(0), _multiply(_number(-1), given[0]), given[0])
        if name in ("min", "max") and len(given) == 2:
            a, b = given if name == "min" else given[::-1]
            return ("less", a, b, *given)
    raise ValueError(ast.unparse(tree) if isinstance(tree, ast.expr) else type(tree).__name__)


def _parsed(text: str) -> Node:
    try:
        node = _node(ast.parse(text.strip(), mode="eval").body)
        if len(_code(node)) <= MOST_CHARACTERS:
            return node
        wrong = "it is too long"
    except SyntaxError as error:
        wrong = f"{error.msg} at character {error.offset}"
    except (ValueError, RecursionError, MemoryError) as error:
        wrong = f"'{error}' is not allowed" if isinstance(error, ValueError) else "it is nested too deeply"
    raise UsageError(
        f"falloff '{text[:200]}': {wrong}. An expression may contain r, beta, numbers, + - * / **, x if a < b else y, "
        f"abs, min, max, {', '.join(FUNCTIONS)}"
    )


def _code(node: Node) -> str:
    """Returns the expression as C code. The code has no blanks, because it is passed to a compiler in an option."""
    name, *operands = node
    if name == "number":
        return f"V({node[1]!r})" if node[1] >= 0 else f"(-V({-node[1]!r}))"
    texts = [_code(operand) for operand in operands]
    if name in FUNCTIONS:
        return FUNCTIONS[name].code.format(*texts)
    if name == "less":
        return "({}<{}?{}:{})".format(*texts)
    return f"({texts[0]}{name}{texts[1]})" if texts else str(name)


def _value(node: Node, r: FloatArray | float, beta: FloatArray | float) -> Any:
    name, *operands = node
    if name in ("r", "beta"):
        return r if name == "r" else beta
    if name == "number":
        return node[1]
    values = [_value(operand, r, beta) for operand in operands]
    if name in FUNCTIONS:
        return FUNCTIONS[name].value(*values)
    if name == "less":
        return np.where(np.less(values[0], values[1]), values[2], values[3])
    a, b = values
    return a + b if name == "+" else a - b if name == "-" else a * b if name == "*" else np.divide(a, b)


def _derivative(node: Node, of: str) -> Node:
    """Returns the derivative with respect to `of`, which is r or beta."""
    name, *x = node
    if name in ("number", "r", "beta"):
        return _number(1 if name == of else 0)
    if name in FUNCTIONS:
        return _multiply(FUNCTIONS[name].slope(x[0]), _derivative(x[0], of))
    if name == "less":
        y = _derivative(x[2], of), _derivative(x[3], of)
        return y[0] if y[0] == y[1] else ("less", x[0], x[1], *y)
    a, b = _derivative(x[0], of), _derivative(x[1], of)
    if name in "+-":
        return _add(a, b) if name == "+" else _subtract(a, b)
    if name == "*":
        return _add(_multiply(a, x[1]), _multiply(x[0], b))
    return _subtract(_divide(a, x[1]), _divide(_multiply(x[0], b), _multiply(x[1], x[1])))


def _mentions(node: Node, name: str) -> bool:
    return node[0] == name or any(isinstance(part, tuple) and _mentions(part, name) for part in node[1:])


class Falloff:
    """Describes how the opacity of a splat decreases with the distance from its centre, instead of (1 - r)^beta.

    `log2` is an expression of r and beta. r = d^T cov^-1 d is the squared distance from the centre in units of the
    ellipse, and beta is the parameter of the splat. At a distance with the value r, the opacity of the splat is
    multiplied by 2^log2. An expression without beta is multiplied by beta, so "log2_1m(r * r)" gives (1 - r^2)^beta.
    log2_1m(x) is log2(1 - x), without the rounding error of 1 - x for small x. An expression may use numbers,
    + - * / **, `x if a < b else y`, exp, exp2, log, log2, log2_1m, sqrt, sin, cos, abs, min and max. The kernels
    compute with float32, and results below 2^-126 become 2^-126.

    `slope` is an expression for the derivative of `log2` with respect to r. If `slope` is None, the derivative is
    computed from `log2`. Splats end where r is equal to `support`, and log2 is evaluated only for smaller values of r.
    With a support of 1, the ellipse of a splat is its boundary. With a larger support, the splat extends beyond this
    ellipse, so the ellipse can be that of the standard deviations. For example, with a beta of 1,
    Falloff("-0.7213475 * r", support=11.0889) is a Gaussian that ends at 3.33 standard deviations.

    A wrong expression raises UsageError, and so does a value of log2 above 0, because the opacity of a splat would be
    larger than its parameter. The values and the slope are tested for several values of r between 0 and the
    support, and for several values of beta. NumericalError is raised if one of the values is not finite, or if the
    slope is not the derivative of the expression. When a falloff is used for the first time on a device, its kernels
    are compiled, and their results are compared with float64. If they differ too much, NumericalError is raised."""

    def __init__(self, log2: str, slope: str | None = None, *, support: float = 1.0) -> None:
        self.log2, self.slope, self.support = log2, slope, float(support)
        if not 0 < self.support <= 100:
            raise UsageError(f"support = {support}: choose a squared distance above 0 and at most 100")
        whole = _parsed(log2)
        r_slope = _derivative(whole, "r") if slope is None else _parsed(slope)
        with_beta = _mentions(whole, "beta")
        self._log2 = whole if with_beta else _multiply(("beta",), whole)
        self._r_slope = r_slope if with_beta else _multiply(("beta",), r_slope)
        self._beta_slope = _derivative(self._log2, "beta")
        self.code = tuple(_code(node) for node in (self._log2, self._r_slope, self._beta_slope))
        if max(map(len, self.code)) > MOST_CHARACTERS:
            raise UsageError(
                f"falloff '{log2[:200]}': its derivative is too long: simplify log2, or pass a shorter expression of "
                f"the derivative as slope"
            )
        self._check_values()

    def __repr__(self) -> str:
        slope = "" if self.slope is None else f", {self.slope!r}"
        return f"Falloff({self.log2!r}{slope}{'' if self.support == 1 else f', support={self.support}'})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Falloff) and (self.code, self.support) == (other.code, other.support)

    def __hash__(self) -> int:
        return hash((self.code, self.support))

    def __reduce__(self) -> Any:
        return _again, (self.log2, self.slope, self.support)

    def values(self, r: FloatArray, beta: FloatArray | float) -> tuple[Any, Any, Any]:
        """Returns log2 and its derivatives with respect to r and beta, in the type of the arguments."""
        with np.errstate(all="ignore"):
            log2, r_slope, beta_slope = (_value(node, r, beta) + 0 * r
                                         for node in (self._log2, self._r_slope, self._beta_slope))
        return log2, r_slope, beta_slope

    def _check_values(self) -> None:
        r = self.support * np.array([1e-12, 1e-6, 0.0137, 0.1193, 0.2718, 0.4142, 0.5772, 0.7321, 0.8854, 0.9871, RIM, END])
        for beta in (0.25, 1.0, 4.0):
            found = self.values(r, beta)
            for what, values in zip(("log2", "the slope", "the derivative with respect to beta"), found):
                if not np.isfinite(values).all():
                    at = r[~np.isfinite(values)][0]
                    raise NumericalError(f"falloff '{self.log2}': {what} is not finite at r = {at:.6g}, beta = {beta:g}")
            if found[0].max() > MOST_LOG2:
                k = int(np.argmax(found[0]))
                raise UsageError(
                    f"falloff '{self.log2}': log2 is {found[0][k]:.4g} at r = {r[k]:.6g} and beta = {beta:g}, but must "
                    f"not be above 0: pass the binary logarithm of the falloff, such as 'log2_1m(r)' for 1 - r"
                )
            if self.slope is not None:
                step = 1e-4 * np.minimum(r, self.support - r)
                about = (self.values(r + step, beta)[0] - self.values(r - step, beta)[0]) / (2 * step)
                off = np.abs(about - found[1]) > 1e-3 * np.abs(about) + 1e-6 * np.abs(found[0]).max() / self.support
                if off.any():
                    k = int(np.argmax(off))
                    raise NumericalError(
                        f"falloff '{self.log2}': the slope '{self.slope}' is {found[1][k]:.6g} at r = {r[k]:.6g} and "
                        f"beta = {beta:g}, but the slope of the expression is {about[k]:.6g}"
                    )

    def check(self, renderer_of: Callable[[Any], Any], model_of: Callable[[int], Any], name: str) -> None:
        """Renders splats that do not overlap, and compares their alpha and its gradients with float64. Raises
        NumericalError if they differ by more than MOST_ERROR. `renderer_of` creates a renderer for a model. `model_of`
        creates a model with the given number of splats, whose raw parameters are all 0. `name` is the name of the
        device."""
        columns, rows, cell, depth = 4, 3, 24, 96.0
        width, height, n = columns * cell, rows * cell, columns * rows
        k = np.arange(n)
        centre = np.stack([k % columns, k // columns], 1) * cell + 11.5 + np.stack([np.sin(k + 0.3), np.cos(k + 0.3)], 1)
        beta, opacity = np.array([0.7, 1.0, 2.0, 5.0])[k % 4], np.array([0.3, 0.7, 0.95])[k // 4]
        scale = np.stack([7 + 2 * np.cos(2.0 * k), 6 + np.sin(3.0 * k), 0 * k + 4e-3], 1) / math.sqrt(self.support)
        shear = 2 * np.sin(5.0 * k) / math.sqrt(self.support)
        model = model_of(n)
        raw = scale + np.log(-np.expm1(-scale))
        parameters = model.parameters
        parameters["xyz"][:] = np.column_stack([centre - [width / 2, height / 2], 0 * k + depth])
        parameters["opacity"][:, 0], parameters["beta"][:, 0] = np.log(opacity / (1 - opacity)), np.log(beta / 4)
        parameters["scale"][:], parameters["l_triangle"][:] = raw, np.column_stack([shear, 0 * k, 0 * k])
        camera = Camera.from_matrix(np.eye(4), (depth, depth, width / 2, height / 2), width, height)
        y, x = np.mgrid[:height, :width] + 0.5
        d = centre[:, None, None] - np.stack([x, y], -1)
        p = d[..., 0] / scale[:, 0, None, None]  # the Cholesky factor of cov is [[s0, 0], [shear, s1]]
        q = (d[..., 1] - shear[:, None, None] * p) / scale[:, 1, None, None]
        r = p * p + q * q
        inside = r < self.support
        clear = (np.abs(r - self.support) > 1e-4 * self.support).all(0)  # skips pixels near the end of the support
        weights = np.random.default_rng(1).random((height, width)) * clear
        renderer = renderer_of(model)
        drawn = renderer.render(camera).alpha
        found = renderer.vjp(camera, None, weights.astype(np.float32))[0]
        log2, r_slope, beta_slope = self.values(np.clip(r, 1e-12 * self.support, RIM * self.support), beta[:, None, None])
        falloff = np.where(inside, np.exp2(np.where(inside, log2, 0)), 0)
        alpha = np.minimum(opacity[:, None, None] * falloff, ALPHA_MAX)
        v_alpha = np.where(alpha < ALPHA_MAX, weights, 0)
        h = -2 / LOG2E * v_alpha * alpha * np.where(inside, r_slope, 0)

        def total(values: Any) -> Any:
            return values.sum((1, 2))

        v_q = total(h * q) / scale[:, 1]
        truth = {
            "opacity": total(v_alpha * falloff) * opacity * (1 - opacity),
            "beta": total(v_alpha * alpha * np.where(inside, beta_slope, 0)) * beta / LOG2E,
            "xyz": np.stack([-(total(h * p) - shear * v_q) / scale[:, 0], -v_q], 1),
            "scale": np.stack([(total(h * p * p) - shear * total(h * p * q) / scale[:, 1]) / scale[:, 0],
                               total(h * q * q) / scale[:, 1]], 1) * -np.expm1(-scale[:, :2]),
            "l_triangle": total(h * p * q) / scale[:, 1],
        }
        errors = {"alpha": (float((np.abs(drawn - alpha.sum(0)) * clear).max()), MOST_ERROR[0])}
        for name_of, expected in truth.items():
            mine = found[name_of][:, : expected.shape[1]] if expected.ndim == 2 else found[name_of][:, 0]
            error = float(np.linalg.norm(mine - expected) / max(float(np.linalg.norm(expected)), 1e-6))
            errors[f"the gradient of {name_of}"] = error, MOST_ERROR[1]
        for what, (error, most) in errors.items():
            if not error <= most:
                raise NumericalError(
                    f"falloff '{self.log2}': {what} on {name} differs from float64 by {error:.3g}, but at most "
                    f"{most:g} is allowed: rewrite the expression to avoid cancellation in float32"
                )

    def to_c(self) -> _abi.Falloff:
        log2, r_slope, beta_slope = (text.encode() for text in self.code)
        return _abi.Falloff(log2=log2, r_slope=r_slope, beta_slope=beta_slope, support=self.support)


def _again(log2: str, slope: str | None, support: float) -> Falloff:
    return Falloff(log2, slope, support=support)


def as_falloff(given: Falloff | str) -> Falloff:
    if isinstance(given, (Falloff, str)):
        return Falloff(given) if isinstance(given, str) else given
    raise UsageError(f"falloff has the type {type(given).__name__}: pass ubs.Falloff or a text")
