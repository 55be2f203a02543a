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


def test_the_example_learns(data: ubs.Dataset) -> None:
    sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
    import torch_fit

    splats, losses = torch_fit.fit(data, 60)
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])
    assert torch_fit.psnr(splats, data.test) > 10
