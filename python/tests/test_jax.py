# SPDX-License-Identifier: Apache-2.0
"""Tests that gradients computed through JAX equal those of the library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="SKIPPED: JAX is not installed")

import ubs  # noqa: E402
import ubs.jax  # noqa: E402
from ubs import _abi  # noqa: E402


@pytest.mark.parametrize("compiled", [False, True])
def test_gradients_are_those_of_the_library(
    folder: Path, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = ubs.Dataset.open(folder)
    model = ubs.train(data, iterations=30, init_points=300, cap_max=400, dim=6)
    camera = data.test[0].camera
    random = np.random.default_rng(1)
    v = [random.normal(size=size).astype(np.float32) for size in ((40, 40, 3), (40, 40), (40, 40))]
    splats = ubs.jax.Splats(model, depth=True)
    view, parameters = splats.view(camera), splats.parameters()

    def number(p: ubs.jax.Parameters) -> jax.Array:
        return sum((picture * weight).sum() for picture, weight in zip(view(p), v))

    gradient = jax.grad(number)
    calls: list[str] = []
    original = _abi.call
    monkeypatch.setattr(_abi, "call", lambda name, *arguments: (calls.append(name), original(name, *arguments))[1])
    found = jax.block_until_ready((jax.jit(gradient) if compiled else gradient)(parameters))
    assert calls.count("renderer_vjp") == 1 and calls.count("renderer_draw") == 1  # the image is not rendered again
    renderer = ubs.Renderer(model, depth=True, gradients=True)
    pictures = renderer.render(camera)
    for mine, expected in zip(view(parameters), (pictures.rgb, pictures.alpha, pictures.depth)):
        assert np.array_equal(mine, expected)
    expected = renderer.vjp(camera, *v)[0]
    for name in parameters:
        assert np.array_equal(found[name], expected[name]) and np.abs(expected[name]).max() > 0
    changed = {**parameters, "rgb": parameters["rgb"] + 1}
    assert not np.array_equal(view(changed)[0], pictures.rgb)
    assert np.array_equal(splats.model(changed).parameters["rgb"], changed["rgb"])
