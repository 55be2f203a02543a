# SPDX-License-Identifier: Apache-2.0
"""Compares two kinds of functions of ubs.torch with implementations in float64: those that render projected splats, and
those that compute the conditioning."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="SKIPPED: PyTorch is not installed")

import ubs  # noqa: E402
from ubs.gsplat import fully_fused_projection  # noqa: E402
from ubs.torch import condition, condition_direct, rasterize, render  # noqa: E402

from test_falloff import EXPRESSIONS  # noqa: E402

WIDTH, HEIGHT = 48, 40


def ellipses(n: int = 120, channels: int = 3, seed: int = 1) -> dict[str, Any]:
    random = torch.Generator().manual_seed(seed)

    def uniform(*shape: int, low: float = 0.0, high: float = 1.0) -> Any:
        return low + (high - low) * torch.rand(*shape, generator=random)

    angle, axes = uniform(n, high=math.pi), uniform(n, 2, low=1.5, high=8)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(n, 2, 2)
    return {
        "means2d": uniform(n, 2, low=-3) * torch.tensor([WIDTH, HEIGHT]),
        "covs2d": (turn * axes[:, None] ** 2) @ turn.mT,
        "depths": uniform(n, low=0.5, high=9),
        "colors": uniform(n, channels),
        "opacities": uniform(n, low=0.05),
        "betas": uniform(n, low=0.4, high=6),
        "background": uniform(channels),
    }


def dense(means2d: Any, covs2d: Any, depths: Any, colors: Any, opacities: Any, background: Any, betas: Any = None,
          log2: Any = None) -> Any:
    """Blends all splats in each pixel as docs/method.md describes in section 2.6. Computes in the type of the tensors,
    without tiles."""
    order = torch.argsort(depths)
    y, x = torch.meshgrid(torch.arange(HEIGHT) + 0.5, torch.arange(WIDTH) + 0.5, indexing="ij")
    d = torch.stack([x, y], -1).to(means2d)[None] - means2d[order, None, None]
    r = torch.einsum("nhwi,nij,nhwj->nhw", d, torch.linalg.inv(covs2d[order]), d)
    if log2 is not None:
        inside = r < 1
        falloff = torch.exp2(log2(torch.where(inside, r, 0.5), betas[order, None, None], torch))
        alpha = torch.where(inside, (opacities[order, None, None] * falloff).clamp_max(0.999), 0.0)
    elif betas is None:
        alpha = (opacities[order, None, None] * torch.exp(-r / 2)).clamp_max(0.99)
        alpha = torch.where(alpha >= 1 / 255, alpha, 0.0)
    else:
        inside = r < 1
        falloff = torch.where(inside, 1 - r, 1.0) ** betas[order, None, None]
        alpha = torch.where(inside, (opacities[order, None, None] * falloff).clamp_max(0.999), 0.0)
    left = torch.ones_like(alpha[0])
    open_ = torch.ones_like(left, dtype=torch.bool)
    image = torch.zeros(HEIGHT, WIDTH, colors.shape[1]).to(means2d)
    for a, colour in zip(alpha, colors[order]):
        open_ = open_ & (left * (1 - a) > 1e-4)
        weight = torch.where(open_, a * left, 0.0)
        image = image + weight[..., None] * colour
        left = torch.where(open_, left * (1 - a), left)
    return image + left[..., None] * background, 1 - left


def relative(mine: Any, truth: Any) -> float:
    return float((mine.double() - truth).norm() / truth.norm().clamp_min(1e-12))


def compared(given: dict[str, Any], mine: Any, truth: Any) -> dict[str, float]:
    """Runs `mine` in float32 and `truth` in float64. Returns the relative errors (2-norm) of the image, of alpha, and
    of the gradients of a loss that depends on both."""
    channels = given["colors"].shape[1]
    weights = torch.randn(HEIGHT, WIDTH, channels, generator=torch.Generator().manual_seed(2)), torch.rand(HEIGHT, WIDTH)
    results = []
    for dtype, function in ((torch.float32, mine), (torch.float64, truth)):
        tensors = {name: value.detach().to(dtype).clone() for name, value in given.items()}
        for name in set(tensors) - {"depths"}:
            tensors[name].requires_grad_()
        size: dict[str, int] = {"width": WIDTH, "height": HEIGHT} if function is mine else {}
        image, alpha = function(**tensors, **size)
        ((image * weights[0]).sum() + (alpha * weights[1]).sum()).backward()
        gradients = {name: tensor.grad for name, tensor in tensors.items() if name != "depths"}
        results.append({"image": image.detach(), "alpha": alpha.detach(), **gradients})
    return {name: relative(value, results[1][name]) for name, value in results[0].items()}


# Bounds of the relative errors of gradients. With Gaussians, the largest error observed on PoCL is 2.2e-7 for images
# and gradients. With Beta kernels, the largest error is 1.8e-5. It occurs in the gradient of means2d, because the slope
# is computed with max(1 - r, 1e-5) (docs/method.md, section 3.1).
BOUNDS = {"gaussian": 4.4e-7, "beta": 3.6e-5}


@pytest.mark.parametrize("kernel", ["gaussian", "beta"])
@pytest.mark.parametrize("channels", [1, 3, 5])
def test_ellipses_agree_with_float64(kernel: str, channels: int) -> None:
    given = ellipses(channels=channels)
    if kernel == "gaussian":
        del given["betas"]
    for name, error in compared(given, rasterize, dense).items():
        print(f"{kernel} {channels} {name:10} {error:.1e}")
        assert error < (4.4e-7 if name in ("image", "alpha") else BOUNDS[kernel])


# The largest errors observed on PoCL are 2.5e-7 for images and 2.0e-6 for gradients. The latter occurs in the gradient
# of means2d with the last expression.
@pytest.mark.parametrize("text", EXPRESSIONS)
def test_a_falloff_agrees_with_float64(text: str) -> None:
    mine, truth = partial(rasterize, falloff=text), partial(dense, log2=EXPRESSIONS[text])
    for name, error in compared(ellipses(), mine, truth).items():
        print(f"{text} {name:10} {error:.1e}")
        assert error < (5e-7 if name in ("image", "alpha") else 4e-6)


def test_a_falloff_without_betas_has_those_of_1() -> None:
    """Tests that a falloff gives the same image without betas as with betas of 1."""
    given = {**ellipses(), "betas": torch.ones(120)}
    image, _ = rasterize(**given, width=WIDTH, height=HEIGHT, falloff="log2_1m(r * r)")
    del given["betas"]
    assert torch.equal(image, rasterize(**given, width=WIDTH, height=HEIGHT, falloff="log2_1m(r * r)")[0])


def test_ellipses_may_be_any_number_and_hidden() -> None:
    """Tests different numbers of ellipses. Also tests that ellipses with negative depths are not rendered."""
    given = ellipses(n=50)
    for count in (50, 0, 3, 400, 10):
        some = {name: value if name == "background" else ellipses(n=max(count, 1))[name][:count] for name, value in given.items()}
        image, alpha = rasterize(**some, width=WIDTH, height=HEIGHT)
        assert image.shape == (HEIGHT, WIDTH, 3) and alpha.shape == (HEIGHT, WIDTH)
        assert count > 0 or torch.equal(image, given["background"].expand_as(image))
    hidden = {**given, "depths": torch.where(torch.arange(50) < 10, given["depths"], -given["depths"])}
    seen = {name: value if name == "background" else value[:10] for name, value in given.items()}
    pairs = zip(rasterize(**hidden, width=WIDTH, height=HEIGHT), rasterize(**seen, width=WIDTH, height=HEIGHT))
    assert all(torch.equal(a, b) for a, b in pairs)


def test_wrong_ellipses_are_refused() -> None:
    given = ellipses(n=5)
    size = {"width": WIDTH, "height": HEIGHT}
    for name, wrong, message in (
        ("means2d", torch.zeros(5, 3), r"means2d has the shape \(5, 3\)"),
        ("means2d", torch.zeros(5, 2).double(), "float32"),
        ("covs2d", torch.zeros(5, 2, 2), "positive definite"),
        ("covs2d", torch.eye(2), r"covs2d has the shape \(2, 2\), not \(5, 2, 2\)"),
        ("opacities", 2 * torch.ones(5), "between 0 and 1"),
        ("betas", torch.zeros(5), "betas must be positive"),
        ("colors", given["colors"] * math.nan, "colors has values that are not finite"),
        ("background", torch.zeros(4), "background has the shape"),
        ("depths", given["depths"].double(), "depths must be a tensor of torch.float32"),
    ):
        with pytest.raises(ubs.Error, match=message):
            rasterize(**{**given, name: wrong}, **size)
    for wrong_size in ({"width": 0, "height": 3}, {"width": 3.0, "height": 3}):
        with pytest.raises(ubs.UsageError, match="width must be an integer of at least 1, not [03]"):
            rasterize(**given, **wrong_size)  # type: ignore[arg-type]
    numpy_size: Any = {name: np.int64(value) for name, value in size.items()}
    assert torch.equal(rasterize(**given, **numpy_size)[0], rasterize(**given, **size)[0])


def joint(dim: int, n: int = 40) -> tuple[Any, ...]:
    random = torch.Generator().manual_seed(dim)
    factor = torch.randn(n, dim, dim, generator=random, dtype=torch.float64).tril() + 1.5 * torch.eye(dim)
    means = torch.randn(n, dim, generator=random, dtype=torch.float64)
    betas = 4 * torch.exp(torch.randn(n, dim - 3, generator=random, dtype=torch.float64) - 0.5)
    return means, factor, betas, torch.randn(n, dim - 3, generator=random, dtype=torch.float64)


def by_inverse(means: Any, factor: Any, betas: Any, query: Any, weights: Any, whiten: bool) -> tuple[Any, Any, Any]:
    """Computes the conditioning of docs/method.md, sections 2.3 and 2.4, with the inverse of Sigma_q."""
    sigma = factor @ factor.mT
    across, own = sigma[:, :3, 3:], sigma[:, 3:, 3:]
    x = (query - means[:, 3:])[..., None]
    gain = across @ own.inverse() * weights[:, None]
    covariance = sigma[:, :3, :3] - gain @ across.mT
    lower = torch.linalg.cholesky(own)
    if whiten:
        z = across @ lower.inverse().mT
        covariance = sigma[:, :3, :3] - z * weights[:, None] @ z.mT
    covariance = covariance.triu() + covariance.triu(1).mT
    y = (lower.inverse() @ x)[..., 0]
    change = ((1 - torch.tanh(y * y)).clamp_min(2.0**-23) ** betas).prod(-1)
    return means[:, :3] + (gain @ x)[..., 0], covariance, change


@pytest.mark.parametrize("dim", [4, 6, 7, 9])
@pytest.mark.parametrize("mode", ["upper", "whiten"])
def test_conditioning_agrees_with_the_formulas(dim: int, mode: str) -> None:
    given = joint(dim)
    results = []
    for mine in (True, False):
        tensors = [tensor.clone().requires_grad_() for tensor in given]
        weights = (tensors[2] / 4).clamp_max(1)
        if mine:
            found = condition(*tensors, cov_mode=mode)  # type: ignore[arg-type]
        else:
            found = by_inverse(*tensors, weights, mode == "whiten")
        sum((value * torch.linspace(-1, 2, value.numel()).reshape(value.shape)).sum() for value in found).backward()
        results.append([*(value.detach() for value in found), *(tensor.grad for tensor in tensors)])
    for a, b in zip(*results):
        assert torch.allclose(a, b, rtol=1e-9, atol=1e-9 * float(b.abs().max()))
    plain = condition(given[0], given[1], None, given[3])  # the conditional distribution of a Gaussian
    expected = by_inverse(*given, torch.ones_like(given[2]), False)
    assert torch.allclose(plain[0], expected[0]) and torch.allclose(plain[1], expected[1]) and (plain[2] == 1).all()
    one = condition(*given[:3], given[3][0])
    each = condition(*given[:3], given[3][:1].expand_as(given[3]))
    assert all(torch.equal(a, b) for a, b in zip(one, each))
    # Far from the mean, the published code limits 1 - tanh to 2^-23.
    upright = torch.eye(dim, dtype=torch.float64).expand_as(given[1])
    far = condition(given[0], upright, 0.01 * torch.ones_like(given[2]), given[3] + 1e3)[2]
    assert torch.allclose(far, torch.full_like(far, 2.0 ** (-23 * 0.01 * (dim - 3))))


def test_autocast_does_not_change_conditioning() -> None:
    given = [tensor.float() for tensor in joint(6)]
    theta, scales = torch.randn(40, 3, 3), torch.rand(40, 3)
    results = []
    for enabled in (False, True):
        means, factor, betas, query = (tensor.clone().requires_grad_() for tensor in given)
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=enabled):
            found = [*condition(means, factor, betas, query)]
            found += condition(means, factor, betas, query, cov_mode="whiten")
            found += condition_direct(means, factor[:, 3:, 3:], theta, scales, betas, query)
        sum((value**2).sum() for value in found).backward()
        results.append([*found, means.grad, factor.grad, betas.grad, query.grad])
    assert all(a.dtype == torch.float32 and torch.equal(a, b) for a, b in zip(*results))


def test_wrong_arguments_of_conditioning_are_refused() -> None:
    means, factor, betas, query = joint(6)
    for wrong in ((means[:, :2], factor, betas, query), (means, factor[:, 1:], betas, query),
                  (means, factor, betas[:, 1:], query), (means, factor, betas, query[:, 1:]),
                  (means, factor.float(), betas, query), (means, factor * math.inf, betas, query)):
        with pytest.raises(ubs.Error, match="shape|tensor of|finite"):
            condition(*wrong)
    with pytest.raises(ubs.UsageError, match="cov_mode"):
        condition(means, factor, betas, query, cov_mode="lower")
    with pytest.raises(ubs.UsageError, match="theta"):
        condition_direct(means, factor[:, 3:, 3:], torch.zeros(1), means[:, :3], betas, query)


def raw_parameters(data: ubs.Dataset, dim: int, conditioning: str) -> dict[str, Any]:
    # There are no refinements, because these would create pairs of splats at the same depth.
    settings = {"iterations": 60, "init_points": 400, "init_extent": 1.3, "refine": "0:0:1"}
    model = ubs.train(data, dim=dim, conditioning=conditioning, **settings)
    return {name: torch.from_numpy(values.copy()).requires_grad_() for name, values in model.parameters.items()}


def by_functions(raw: dict[str, Any], camera: ubs.Camera, dim: int, direct: bool) -> Any:
    """Implements the method in PyTorch with condition() and rasterize(), starting from raw parameters."""
    pose = torch.from_numpy(camera.world_to_camera).float()
    away = raw["xyz"] - (-pose[:, :3].T @ pose[:, 3])
    query = torch.nn.functional.normalize(away, dim=-1)
    if dim == 7:
        query = torch.cat([query, torch.full_like(query[:, :1], camera.time)], -1)
    n, scale, betas = len(query), torch.nn.functional.softplus(raw["scale"]), 4 * raw["beta"].exp()
    rows = torch.zeros(n, dim, dim)
    i, j = torch.tril_indices(dim, dim, -1)
    rows[:, i, j] = raw["l_triangle"]
    a, b, c = raw["l_triangle"][:, :3].T
    zero, one = torch.zeros_like(a), torch.ones_like(a)
    spatial = torch.stack([one, a, b, -a, one, c, -b, -c, one], -1).reshape(n, 3, 3) * scale[:, None, :3]
    own = rows[:, 3:, 3:] + torch.diag_embed(scale[:, 3:])
    means = torch.cat([raw["xyz"], raw["mean"]], -1)
    if direct:
        covariances = spatial @ spatial.mT
        positions, change = condition_direct(
            means, own, rows[:, 3:, :3].mT, scale[:, :3], betas[:, 1:], query
        )
    else:
        factor = torch.cat([torch.cat([spatial, torch.zeros(n, 3, dim - 3)], -1), torch.cat([rows[:, 3:, :3], own], -1)], 1)
        positions, covariances, change = condition(means, factor, betas[:, 1:], query)
    viewmat = torch.eye(4)
    viewmat[:3] = pose
    k = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=torch.float32)
    triangle = covariances[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]
    radii, means2d, depths, conics, _ = fully_fused_projection(
        positions, triangle, None, None, viewmat[None], k[None], camera.width, camera.height
    )
    seen = (radii > 0).all(-1)[0]
    xx, xy, yy = conics[0, seen].unbind(-1)
    covs2d = torch.stack([yy, -xy, -xy, xx], -1).reshape(-1, 2, 2) / (xx * yy - xy * xy)[:, None, None]
    opacities = torch.sigmoid(raw["opacity"][:, 0]) * change
    return rasterize(
        means2d[0, seen], covs2d, depths[0, seen], raw["rgb"][seen], opacities[seen], betas[seen, 0],
        width=camera.width, height=camera.height,
    )


# The largest errors observed on PoCL are 9.3e-7 for images and 2.6e-6 for gradients. The latter occurs in the gradient
# of xyz with N = 7.
@pytest.mark.parametrize("dim, conditioning", [(6, "covariance"), (7, "covariance"), (6, "direct"), (7, "direct")])
def test_the_functions_together_are_the_method(folder: Path, dim: int, conditioning: str) -> None:
    """Compares by_functions() with ubs.torch.render(), which implements the whole method."""
    data = ubs.Dataset.open(folder)
    camera = data.test[0].camera.at(0.4)
    raw = raw_parameters(data, dim, conditioning)
    weights = torch.randn(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(4))
    results = []
    for draw in (
        lambda: by_functions(raw, camera, dim, conditioning == "direct")[0],
        lambda: render(raw, camera, dim=dim, conditioning=conditioning)[0],
    ):
        for tensor in raw.values():
            tensor.grad = None
        image = draw()
        (image * weights).sum().backward()
        results.append((image.detach(), {name: tensor.grad.clone() for name, tensor in raw.items()}))
    (image, gradients), (expected, truth) = results
    assert np.abs(expected).max() > 0.1
    print(f"N = {dim} {conditioning} image {relative(image, expected.double()):.1e}")
    for name, gradient in gradients.items():
        print(f"  {name:10} {relative(gradient, truth[name].double()):.1e}")
        assert relative(gradient, truth[name].double()) < 5.2e-6
    assert relative(image, expected.double()) < 1.8e-6
