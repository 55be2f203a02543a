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


def small_model(data: ubs.Dataset) -> ubs.Model:
    return ubs.train(data, iterations=30, init_points=300, cap_max=400, dim=7, on_step=lambda step: None)


@pytest.mark.parametrize("compiled", [False, True])
def test_gradients_of_cameras_are_those_of_the_library(folder: Path, compiled: bool) -> None:
    data = ubs.Dataset.open(folder)
    model, camera = small_model(data), data.test[0].camera
    weights = np.random.default_rng(2).normal(size=(40, 40, 3)).astype(np.float32)
    view = ubs.jax.Splats(model).view(camera)
    parameters = ubs.jax.Splats(model).parameters()
    pose = np.vstack([data.test[1].camera.world_to_camera, (0, 0, 0, 1)]).astype(np.float32)
    given = pose, np.array([[41, 0, 20], [0, 40, 19], [0, 0, 1]], np.float32), np.float32(0.4)

    def number(p: ubs.jax.Parameters, *arrays: jax.Array) -> jax.Array:
        return (view(p, *arrays)[0] * weights).sum()

    gradient = jax.grad(number, (0, 1, 2, 3))
    found = (jax.jit(gradient) if compiled else gradient)(parameters, *given)
    other = ubs.Camera.from_matrix(pose, given[1], 40, 40, float(given[2]))
    renderer = ubs.Renderer(model, gradients=True)
    expected = renderer.vjp(other, weights)[0]
    assert np.array_equal(view(parameters, *given)[0], renderer.render(other).rgb)
    renderer.vjp(other, weights)
    cameras = renderer.camera_gradient()
    fx, fy, cx, cy = cameras.intrinsics
    assert all(np.array_equal(found[0][name], expected[name]) for name in expected)
    for mine, wanted in zip(found[1:], (np.vstack([cameras.world_to_camera, np.zeros(4)]),
                                        [[fx, 0, cx], [0, fy, cy], [0, 0, 0]], cameras.time)):
        # The gradients are rounded to float32. The largest error observed is 3.8e-8 (PoCL).
        error = np.abs(np.asarray(mine) - np.asarray(wanted)).max()
        assert error <= 7e-8 * np.abs(wanted).max() > 0
    for name, wrong in (("pose", np.eye(3)), ("intrinsics", np.ones(3)), ("time", np.ones(2))):
        with pytest.raises(ubs.UsageError, match=f"{name} has the shape"):
            view(parameters, **{name: wrong})


def test_vmap_renders_one_view_after_the_other(folder: Path) -> None:
    data = ubs.Dataset.open(folder)
    model = small_model(data)
    splats = ubs.jax.Splats(model)
    view, parameters = splats.view(data.test[0].camera), splats.parameters()
    poses = np.stack([data.train[k].camera.world_to_camera for k in range(3)]).astype(np.float32)
    single = [view(parameters, pose)[0] for pose in poses]
    assert np.array_equal(jax.vmap(lambda pose: view(parameters, pose)[0])(poses), single)
    assert not np.array_equal(single[0], single[1])

    def loss(p: ubs.jax.Parameters, pose: jax.Array) -> jax.Array:
        return (view(p, pose)[0] ** 2).sum()

    gradients = jax.jit(jax.vmap(jax.grad(loss, (0, 1)), (None, 0)))(parameters, poses)
    total = jax.grad(lambda p: jax.vmap(lambda pose: loss(p, pose))(poses).sum())(parameters)
    for k, pose in enumerate(poses):
        expected = jax.grad(loss, (0, 1))(parameters, pose)
        assert np.allclose(gradients[1][k], expected[1], rtol=1e-5) and np.abs(expected[1]).max() > 0
        assert np.allclose(gradients[0]["xyz"][k], expected[0]["xyz"], rtol=1e-5)
    assert np.allclose(total["xyz"], gradients[0]["xyz"].sum(0), rtol=1e-4, atol=1e-4)
    with pytest.raises(TypeError, match="jvp"):
        jax.jvp(lambda p: view(p)[0], (parameters,), (parameters,))
