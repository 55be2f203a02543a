# SPDX-License-Identifier: Apache-2.0
"""Tests falloffs that the user defines as expressions. The tests compare the values and derivatives of the expressions,
and the images that devices render with them, with values in float64."""

from __future__ import annotations

import copy
import pickle
from typing import Any, Callable

import numpy as np
import pytest

import ubs

# Expressions, and functions that compute log2 of the same falloff for a given beta in NumPy or PyTorch. ubs.Falloff
# multiplies an expression without beta by beta, so the functions do the same.
EXPRESSIONS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "log2_1m(r)": lambda r, beta, m: beta * m.log2(1 - r),
    "log2_1m(r * r)": lambda r, beta, m: beta * m.log2(1 - r * r),
    "-1.5 * r ** beta": lambda r, beta, m: -1.5 * r**beta,
    "-r if r < 0.3 else -0.3 - 2 * (r - 0.3)": lambda r, beta, m: beta * m.where(r < 0.3, -r, -0.3 - 2 * (r - 0.3)),
    "beta * log2(0.505 + 0.495 * cos(3.1416 * sqrt(r)))":
        lambda r, beta, m: beta * m.log2(0.505 + 0.495 * m.cos(3.1416 * m.sqrt(r))),
    "max(-3 * r, -1) - abs(r - 0.5)":
        lambda r, beta, m: beta * (m.where(-3 * r < -1, 0 * r - 1, -3 * r) - m.where(r < 0.5, 0.5 - r, r - 0.5)),
    "exp(-r) - 1.5 + exp2(r) / (2 + sin(r)) - log(1 + r)":
        lambda r, beta, m: beta * (m.exp(-r) - 1.5 + 2**r / (2 + m.sin(r)) - m.log(1 + r)),
}
R = np.array([1e-6, 0.03, 0.27, 0.61, 0.97])


@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.parametrize("beta", [0.4, 3.0])
def test_expressions_have_their_values_and_slopes(text: str, beta: float) -> None:
    log2, r_slope, beta_slope = ubs.Falloff(text).values(R, beta)
    truth, h = EXPRESSIONS[text], 1e-7
    np.testing.assert_allclose(log2, truth(R, beta, np), rtol=1e-12, atol=1e-12)
    step = 1e-5 * R
    np.testing.assert_allclose(
        r_slope, (truth(R + step, beta, np) - truth(R - step, beta, np)) / (2 * step), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(
        beta_slope, (truth(R, beta + h, np) - truth(R, beta - h, np)) / (2 * h), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    "text, message",
    [
        ("foo(r)", "'foo\\(r\\)' is not allowed"),
        ("__import__('os').system('true')", "is not allowed"),
        ("r; r", "invalid syntax"),
        ("", "invalid syntax"),
        ("r.real", "'r.real' is not allowed"),
        ("x * r", "'x' is not allowed"),
        ("True", "'True' is not allowed"),
        ("1e300 * r", "'1e\\+300' is not allowed"),
        ("r if r < 0.2 < 1 else 0", "is not allowed"),
        ("min(r)", "'min\\(r\\)' is not allowed"),
        ("+".join(["r"] * 2000), "it is (too long|nested too deeply)"),
        ("(" * 400 + "r" + ")" * 400, "too (many nested|deep)"),
        ("(1 - r) ** beta", "must not be above 0: pass the binary logarithm"),
        ("r", "log2 is 0.25 at r = 0.999999"),
    ],
)
def test_other_expressions_are_refused(text: str, message: str) -> None:
    with pytest.raises(ubs.UsageError, match=message):
        ubs.Falloff(text)


def test_values_that_are_not_finite_and_wrong_slopes_are_refused() -> None:
    with pytest.raises(ubs.NumericalError, match="log2 is not finite at r = 0.73"):
        ubs.Falloff("log2(0.7 - r)")
    with pytest.raises(ubs.NumericalError, match="the slope '-2 \\* r' is"):
        ubs.Falloff("log2_1m(r * r)", "-2 * r")
    for support in (0, -1, 101, float("nan")):
        with pytest.raises(ubs.UsageError, match="support"):
            ubs.Falloff("-r", support=support)
    ubs.Falloff("log2_1m(r * r)", "-2.8853900817779268 * r / (1 - r * r)")


def test_falloffs_can_be_compared_copied_and_pickled() -> None:
    one = ubs.Falloff("-r", support=4)
    assert one == copy.deepcopy(one) == pickle.loads(pickle.dumps(one)) != ubs.Falloff("-r")
    assert len({one, ubs.Falloff("- r", support=4)}) == 1
    assert repr(one) == "Falloff('-r', support=4.0)"


def flat_model(n: int = 40) -> ubs.Model:
    model, random = ubs.Model.empty(dim=6, splats=n), np.random.default_rng(1)
    for name, values in model.parameters.items():
        values[:] = random.normal(0, 0.4, values.shape)
    model.parameters["scale"][:, :3] -= 2
    return model


CAMERA = ubs.Camera.from_matrix(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3]]), (60, 60, 24, 20), 48, 40)


@pytest.mark.parametrize("raster", ["cpu", "gpu"])
def test_the_kernel_beta_as_an_expression_draws_the_same(raster: str) -> None:
    model, v_rgb = flat_model(), np.random.default_rng(2).normal(size=(40, 48, 3)).astype(np.float32)
    plain = ubs.Renderer(model, gradients=True, raster=raster)
    own = ubs.Renderer(model, gradients=True, raster=raster, falloff="log2_1m(r)")
    np.testing.assert_allclose(own.render(CAMERA).rgb, plain.render(CAMERA).rgb, atol=1e-6)
    expected, found = (renderer.vjp(CAMERA, v_rgb)[0] for renderer in (plain, own))
    for name, values in expected.items():
        assert np.linalg.norm(found[name] - values) <= 2e-5 * np.linalg.norm(values) + 1e-9, name


def test_a_falloff_needs_the_kernel_beta() -> None:
    with pytest.raises(ubs.UsageError, match="requires a kernel with beta"):
        ubs.Renderer(ubs.Model.empty(dim=3, splats=4, kernel="gaussian"), falloff="-r")
    with pytest.raises(ubs.UsageError, match="falloff has the type int"):
        ubs.Renderer(ubs.Model.empty(dim=3, splats=4), falloff=1)  # type: ignore[arg-type]


def test_a_device_that_differs_is_refused() -> None:
    falloff = ubs.Falloff("log2_1m(r * r * r)")
    falloff.code = falloff.code[0], falloff.code[1], "(V(1.01)*" + falloff.code[2] + ")"
    with pytest.raises(ubs.NumericalError, match="the gradient of beta on .* differs from float64 by 0.01"):
        ubs.Renderer(flat_model(), falloff=falloff)
    falloff.code = "ubs_log2_1m(r", *falloff.code[1:]
    with pytest.raises(ubs.BuildError):
        ubs.Renderer(flat_model(), falloff=falloff)


# A renderer compares the device with float64 when a falloff is used for the first time, and raises NumericalError if
# they differ. So this test only has to create renderers.
@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.parametrize("raster", ["cpu", "gpu"])
def test_devices_agree_with_float64(text: str, raster: str) -> None:
    for support in (1, 0.8):
        ubs.Renderer(flat_model(), gradients=True, raster=raster, falloff=ubs.Falloff(text, support=support))
    image = ubs.Renderer(flat_model(), raster=raster, falloff=text).render(CAMERA)
    assert 0 < image.alpha.max() < 1 and np.isfinite(image.rgb).all()
