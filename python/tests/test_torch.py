# SPDX-License-Identifier: Apache-2.0
"""Gradients through PyTorch, and the example. What the library's gradients are worth, other tests say (float64)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="SKIPPED: PyTorch is not there")

import ubs  # noqa: E402
import ubs.torch  # noqa: E402


@pytest.fixture(scope="module")
def data(folder: Path) -> ubs.Dataset:
    return ubs.Dataset.open(folder)


def test_gradients_are_those_of_the_library(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats = ubs.torch.Splats(model)
    cameras = [view.camera for view in data.test]
    weights = [torch.randn(40, 40, 3), torch.randn(40, 40)]
    rgb, alpha = splats(cameras[0])
    assert np.array_equal(rgb.detach().numpy(), model.render(cameras[0]))
    other, _ = splats(cameras[1])  # drawn in between
    ((rgb * weights[0]).sum() + (alpha * weights[1]).sum()).backward()
    expected = ubs.vjp(model, cameras[0], weights[0].numpy(), weights[1].numpy())
    for name, parameter in splats.named_parameters():
        assert parameter.grad is not None
        assert np.array_equal(parameter.grad.numpy(), expected[name])
    other.sum().backward()
    with pytest.raises(RuntimeError):  # no second order
        gradient = torch.autograd.grad(splats(cameras[0])[0].sum(), splats.xyz, create_graph=True)
        gradient[0].sum().backward()
    for name, values in splats.model().parameters.items():
        assert np.array_equal(values, model.parameters[name])


def test_gradients_of_depth_and_camera_are_those_of_the_library(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats = ubs.torch.Splats(model, depth=True)
    camera = data.test[0].camera
    pose = torch.tensor(camera.world_to_camera, requires_grad=True)
    intrinsics = torch.tensor([camera.fx, camera.fy, camera.cx, camera.cy], requires_grad=True)
    v = [torch.randn(40, 40, 3), torch.randn(40, 40), torch.randn(40, 40)]
    pictures = splats(camera, pose=pose, intrinsics=intrinsics, time=torch.tensor(0.0, requires_grad=True))
    sum((picture * weight).sum() for picture, weight in zip(pictures, v)).backward()
    renderer = ubs.Renderer(model, depth=True, gradients=True)
    assert np.array_equal(pictures[2].detach().numpy(), renderer.render(camera).depth)
    expected = renderer.vjp(camera, *(weight.numpy() for weight in v))[0]
    for name, parameter in splats.named_parameters():
        assert parameter.grad is not None and np.abs(expected[name]).max() > 0
        assert np.array_equal(parameter.grad.numpy(), expected[name])
    of_camera = renderer.camera_gradient()
    assert pose.grad is not None and intrinsics.grad is not None
    assert np.array_equal(pose.grad.numpy(), of_camera.world_to_camera)
    assert np.allclose(intrinsics.grad.numpy(), of_camera.intrinsics, rtol=1e-6)


def test_a_pose_is_found_again(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=500, init_points=1000, cap_max=1000, init_extent=1.3, dim=3)
    camera = data.train[0].camera
    truth = torch.from_numpy(model.render(camera))
    splats = ubs.torch.Splats(model).requires_grad_(False)
    start = torch.from_numpy(camera.world_to_camera)
    moved = torch.tensor([0.01, -0.015, 0.02, 0.01, 0.02, -0.02], dtype=torch.float64, requires_grad=True)
    adam = torch.optim.Adam([moved], lr=5e-3)
    rates = torch.optim.lr_scheduler.ExponentialLR(adam, 0.97)
    errors = []
    for _ in range(150):
        zero = torch.zeros((), dtype=torch.float64)
        x, y, z = moved[:3]
        turn = torch.matrix_exp(torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3))
        pose = turn @ start + torch.nn.functional.pad(moved[3:, None], (3, 0))
        error = ((splats(camera, pose=pose)[0] - truth) ** 2).sum()
        errors.append(float(error))
        adam.zero_grad()
        error.backward()
        adam.step()
        rates.step()
    assert errors[-1] < 1e-2 * errors[0]


def test_the_example_learns(data: ubs.Dataset) -> None:
    sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
    import torch_fit

    splats, losses = torch_fit.fit(data, 60)
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])
    assert torch_fit.psnr(splats, data.test) > 10
