# SPDX-License-Identifier: Apache-2.0
"""Tests DefaultStrategy and MCMCStrategy of ubs.gsplat: their effect on parameters and optimisers, and that training
works."""

from __future__ import annotations

import math
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="SKIPPED: PyTorch is not installed")

import ubs  # noqa: E402
from ubs.gsplat import DefaultStrategy, MCMCStrategy, quat_scale_to_covar_preci, rasterization  # noqa: E402
from ubs.gsplat.relocation import compute_relocation  # noqa: E402
from ubs.gsplat.strategy import ops  # noqa: E402
from ubs.gsplat.strategy.mcmc import BINOMS  # noqa: E402
from ubs.gsplat.strategy.ops import _rotated  # noqa: E402

Maker = tuple[Any, Any]


def learnt(count: int, dictionary: Any = dict) -> Maker:
    g = torch.Generator().manual_seed(count)
    values = {
        "means": torch.randn(count, 3, generator=g),
        "scales": torch.full((count, 3), math.log(0.005)),
        "quats": torch.randn(count, 4, generator=g),
        "opacities": torch.zeros(count),
        "colors": torch.arange(count * 3.0).reshape(count, 3),
    }
    params = dictionary({name: torch.nn.Parameter(value) for name, value in values.items()})
    optimizers = {name: torch.optim.Adam([params[name]], lr=0.0) for name in values}
    # The gradient of Gaussian i is i + 1, so that moments() can tell from its moments to which Gaussian they belong.
    for name in values:
        params[name].grad = torch.arange(1.0, count + 1).reshape(-1, *[1] * (params[name].dim() - 1)) + 0 * params[name]
        optimizers[name].step()
        optimizers[name].zero_grad(set_to_none=True)
    return params, optimizers


def moments(params: Any, optimizers: Any, name: str = "means") -> Any:
    """Returns for each Gaussian 1 + the index of the Gaussian to which its moments belong, or 0 if its moments are 0.
    Also checks that the optimisers contain these parameters."""
    for key, optimizer in optimizers.items():
        assert optimizer.param_groups[0]["params"][0] is params[key] and set(optimizer.state) == {params[key]}
        assert all(v.shape == params[key].shape for k, v in optimizer.state[params[key]].items() if k != "step")
        assert float(optimizer.state[params[key]]["step"]) == 1
    return (optimizers[name].state[params[name]]["exp_avg"] * 10).reshape(len(params[name]), -1)[:, 0].round()


def drawn(count: int, gradient: Any, radii: int = 4, packed: bool = False) -> dict[str, Any]:
    """Returns a dictionary like that of rasterization(), for two cameras in which everything is visible."""
    means2d = torch.zeros(2, count, 2, requires_grad=True)
    info = {"width": 20, "height": 10, "n_cameras": 2, "gaussian_ids": None}
    info["radii"] = torch.full((2, count, 2), radii, dtype=torch.int32)
    if packed:
        means2d = torch.zeros(2 * count, 2, requires_grad=True)
        info["gaussian_ids"] = torch.arange(count).repeat(2)
        info["radii"] = info["radii"].reshape(-1, 2)
    info["means2d"] = means2d + 0
    return info | {"v": gradient.repeat(2, 1) if packed else gradient.expand(2, count, 2)}


@pytest.mark.parametrize("times", [1, 2])
def test_autocast_does_not_move_gaussians(times: int) -> None:
    params, _ = learnt(50)
    vectors = torch.randn(50, 3)
    with torch.no_grad():
        params["scales"] += torch.randn(50, 3)
        found = _rotated(params, torch.arange(50), vectors, times)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert torch.equal(_rotated(params, torch.arange(50), vectors, times), found)
        q = params["quats"].double() / params["quats"].double().norm(dim=-1, keepdim=True)
        w, x, y, z = q.unbind(-1)
        turn = torch.stack([
            w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z,
        ], -1).reshape(-1, 3, 3)
        a = turn * params["scales"].double().exp()[:, None]
        matrix = a if times == 1 else a @ a.mT
        expected = (matrix @ vectors.double()[..., None])[..., 0]
        assert float((found - expected).norm() / expected.norm()) < 1e-6


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dictionary", [dict, torch.nn.ParameterDict])
def test_default_copies_splits_and_removes(dictionary: Any, packed: bool) -> None:
    strategy = DefaultStrategy(refine_start_iter=0, refine_every=10, reset_every=1000)
    params, optimizers = learnt(6, dictionary)
    with torch.no_grad():
        params["scales"][2:4] = math.log(0.5)  # large enough for a split
        params["opacities"][5] = -9
    strategy.check_sanity(params, optimizers)
    state = strategy.initialize_state(scene_scale=1.0)
    # The strategy multiplies gradients by half the image size and by the number of cameras. The resulting gradients of
    # Gaussians 1 and 2 are above the threshold, and the gradient of Gaussian 0 is just below the threshold.
    gradient = torch.tensor([[0.99e-5, 0], [0, 2.1e-5], [1.1e-5, 0], [0, 0], [0, 0], [0, 0]])
    before = {name: value.detach().clone() for name, value in params.items()}
    for step in (9, 10):
        info = drawn(6, gradient, packed=packed)
        strategy.step_pre_backward(params, optimizers, state, step, info)
        (info["means2d"] * info["v"]).sum().backward()
        strategy.step_post_backward(params, optimizers, state, step, info, packed=packed)
    # Gaussian 5 was removed, 2 was replaced by its two parts, and 1 was copied.
    ids = (params["colors"][:, 0] / 3).round().int().tolist()
    assert ids == [0, 1, 3, 4, 1, 2, 2]
    assert moments(params, optimizers).tolist() == [1, 2, 4, 5, 0, 0, 0]
    assert torch.equal(params["means"][[0, 1, 2, 3, 4]], before["means"][[0, 1, 3, 4, 1]])
    assert not torch.equal(params["means"][5], params["means"][6])
    assert torch.allclose(params["scales"][5:].exp(), torch.tensor(0.5 / 1.6))
    assert state["grad2d"].shape == (7,) and float(state["count"].abs().max()) == 0
    assert all(value.requires_grad and isinstance(value, torch.nn.Parameter) for value in params.values())


def test_default_resets_opacities_and_counts_radii() -> None:
    strategy = DefaultStrategy(
        refine_start_iter=0, refine_every=10, reset_every=20, refine_scale2d_stop_iter=100, revised_opacity=True
    )
    params, optimizers = learnt(3)
    state = strategy.initialize_state()
    for step in range(1, 21):
        info = drawn(len(params["means"]), torch.zeros(len(params["means"]), 2), radii=2 if step > 10 else step % 2)
        strategy.step_pre_backward(params, optimizers, state, step, info)
        (info["means2d"] * info["v"]).sum().backward()
        strategy.step_post_backward(params, optimizers, state, step, info)
        # In this image with a width of 20 pixels, a radius of 1 pixel is not above grow_scale2d, but 2 pixels are.
        if step == 9:
            assert torch.equal(state["radii"], torch.full((3,), 0.05)) and state["count"].tolist() == [10.0] * 3
        if step == 10:
            assert len(params["means"]) == 3
        if step == 19:
            assert torch.allclose(torch.sigmoid(params["opacities"]), torch.tensor(0.5))
    # Each Gaussian is split. Both parts get the opacity 1 - sqrt(1 - 0.5), which is then reset to 2 * prune_opa.
    assert len(params["means"]) == 6
    assert torch.allclose(torch.sigmoid(params["opacities"]), torch.tensor(0.01), rtol=1e-4)
    assert float(optimizers["opacities"].state[params["opacities"]]["exp_avg"].abs().max()) == 0
    info = drawn(6, torch.zeros(6, 2))
    # From refine_stop_iter on, the strategy does nothing and needs no gradient.
    strategy.step_post_backward(params, optimizers, state, strategy.refine_stop_iter, info)


def test_relocation_is_that_of_the_paper() -> None:
    """Compares compute_relocation() with the formulas of 3D Gaussian Splatting as Markov Chain Monte Carlo (Kheradmand
    et al. 2024)."""
    opacities, scales = torch.tensor([0.9, 0.3, 0.5, 0.99]), torch.ones(4, 3)
    copies = torch.tensor([2, 5, 1, 51])
    opacity, scale = compute_relocation(opacities, scales, copies, BINOMS)
    for i, n in enumerate(copies.tolist()):
        before = float(opacities[i])
        o = 1 - (1 - before) ** (1 / n)
        total = sum(
            math.comb(a - 1, k) * (-1) ** k / math.sqrt(k + 1) * o ** (k + 1) for a in range(1, n + 1) for k in range(a)
        )
        assert float(opacity[i]) == pytest.approx(o, rel=1e-6)
        assert float(scale[i, 0]) == pytest.approx(before / total, rel=1e-6)
    few = compute_relocation(opacities[:, None], scales, torch.tensor([0, 1, 7, 99]), BINOMS[:4, :4])
    clamped = compute_relocation(opacities, scales, torch.tensor([1, 1, 4, 4]), BINOMS)
    assert few[0].shape == (4, 1) and torch.equal(few[0][:, 0], clamped[0])
    assert torch.allclose(few[1], clamped[1], rtol=1e-6)
    with pytest.raises(ubs.UsageError, match="not \\(N,\\)"):
        compute_relocation(opacities[:3], scales, copies, BINOMS)


def test_operations_on_masks() -> None:
    """Tests duplicate(), remove(), split() and reset_opa()."""
    params, optimizers = learnt(6)
    state = {"rows": torch.arange(6.0), "scene_scale": 2.0}

    def ids() -> Any:
        return (params["colors"][:, 0] / 3).round().int().tolist()

    mask = torch.tensor([False, True, False, True, False, False])
    ops.duplicate(params, optimizers, state, mask)
    assert ids() == state["rows"].tolist() == [0, 1, 2, 3, 4, 5, 1, 3]
    assert moments(params, optimizers).tolist() == [1, 2, 3, 4, 5, 6, 0, 0]
    ops.remove(params, optimizers, state, torch.tensor([1, 0, 0, 0, 0, 0, 1, 0]) == 1)
    assert ids() == state["rows"].tolist() == [1, 2, 3, 4, 5, 3]
    assert moments(params, optimizers).tolist() == [2, 3, 4, 5, 6, 0] and state["scene_scale"] == 2.0
    means = params["means"].detach().clone()
    ops.split(params, optimizers, state, torch.tensor([1, 0, 0, 1, 0, 0]) == 1, revised_opacity=True)
    assert ids() == state["rows"].tolist() == [2, 3, 5, 3, 1, 4, 1, 4]
    assert moments(params, optimizers, "quats").tolist() == [3, 4, 6, 0, 0, 0, 0, 0]
    assert torch.equal(params["means"][:4], means[[1, 2, 4, 5]])
    assert not torch.isclose(params["means"][4:], means[[0, 3, 0, 3]]).any()
    assert torch.allclose(params["scales"][4:].exp(), torch.tensor(0.005 / 1.6))
    assert torch.allclose(1 - (1 - torch.sigmoid(params["opacities"][4:])) ** 2, torch.tensor(0.5))
    with torch.no_grad():
        params["opacities"][:3] = -3.0
    ops.reset_opa(params, optimizers, state, 0.25)
    assert torch.allclose(torch.sigmoid(params["opacities"]), torch.tensor([0.047426] * 3 + [0.25] * 5))
    assert float(moments(params, optimizers, "opacities").abs().max()) == 0
    assert moments(params, optimizers).tolist() == [3, 4, 6, 0, 0, 0, 0, 0]


def test_parts_and_noise_have_the_covariance_of_the_gaussian() -> None:
    """Tests the positions of 20 000 parts of equal Gaussians, and the noise of as many Gaussians."""
    torch.manual_seed(0)
    count = 10_000
    quat, scales, opacity = torch.tensor([0.9, 0.3, -0.4, 0.2]), torch.tensor([0.5, 2.0, 1.0]), 0.02
    values = {
        "means": torch.zeros(count, 3), "scales": scales.log().repeat(count, 1), "quats": quat.repeat(count, 1),
        "opacities": torch.logit(torch.full((count, 1), opacity)),
    }
    params = {name: torch.nn.Parameter(value) for name, value in values.items()}
    covar = quat_scale_to_covar_preci(quat[None], scales[None])[0][0]
    ops.split(params, {}, {}, torch.ones(count, dtype=torch.bool))
    found = params["means"].detach()
    # The standard error of a variance is sqrt(2 / 20 000) = 1 % of it. With 20 other seeds, the largest difference from
    # the covariance is 2.9 %, and 2.4 % for the noise.
    assert float((found.T @ found / (2 * count) - covar).abs().max() / covar.max()) < 0.045
    params = {name: torch.nn.Parameter(value) for name, value in values.items()}
    ops.inject_noise_to_position(params, {}, {}, 3.0)
    found = params["means"].detach() / (3.0 / (1 + math.exp(-100 * (1 - opacity - 0.995))))
    wanted = covar @ covar
    assert float((found.T @ found / count - wanted).abs().max() / wanted.max()) < 0.045


def test_relocated_and_added_gaussians() -> None:
    """Tests that all copies of a Gaussian together are as opaque as it was, and which states become 0."""
    torch.manual_seed(2)
    params, optimizers = learnt(8)
    with torch.no_grad():
        params["opacities"].copy_(torch.tensor([-9.0, 0.5, -9, 0.2, 0.4, -0.3, 0.1, -0.2]))
    before = torch.sigmoid(params["opacities"].detach())
    gone = before < 0.1
    state: dict[str, Any] = {"rows": torch.arange(1.0, 9.0)}
    ops.relocate(params, optimizers, state, gone, BINOMS)
    ids = (params["colors"][:, 0] / 3).round().long()
    chosen = ids[gone].unique()
    assert not bool(gone[ids].any()) and torch.equal(ids[~gone], torch.where(~gone)[0])
    for i in chosen.tolist():
        opacity, copies = torch.sigmoid(params["opacities"][ids == i]), int((ids == i).sum())
        assert copies > 1
        assert torch.allclose(1 - (1 - opacity) ** copies, before[i], rtol=1e-5)
        assert bool((params["scales"][ids == i] < math.log(0.005)).all())
    touched = torch.isin(ids, chosen)
    assert 4 <= int((~touched).sum()) <= 5
    assert moments(params, optimizers).tolist() == torch.where(touched, 0, ids + 1).tolist()
    assert [i for i, value in enumerate(state["rows"].tolist()) if value == 0] == chosen.tolist()
    opacities = params["opacities"].detach().clone()
    ops.sample_add(params, optimizers, state, 5, BINOMS)
    more = (params["colors"][8:, 0] / 3).round().long()
    assert len(params["means"]) == 13 and len(state["rows"]) == 13 and float(state["rows"][8:].abs().max()) == 0
    assert float(moments(params, optimizers)[8:].abs().max()) == 0
    assert bool((params["opacities"][8:] < opacities.max()).all()) and set(more.tolist()) <= set(ids.tolist())
    # Nothing can be moved to the position of others if there are no others.
    values = params["means"].detach().clone()
    ops.relocate(params, optimizers, state, torch.ones(13, dtype=torch.bool), BINOMS)
    ops.relocate(params, optimizers, state, torch.zeros(13, dtype=torch.bool), BINOMS)
    assert torch.equal(params["means"], values)


def test_gradients_of_changed_values_are_discarded() -> None:
    """An optimiser step after these functions would otherwise use gradients of the values before."""
    for change in (
        lambda p, o: ops.reset_opa(p, o, {}, 0.01),
        lambda p, o: ops.relocate(p, o, {}, torch.arange(6) < 2, BINOMS),
    ):
        params, optimizers = learnt(6)
        for value in params.values():
            value.grad = torch.ones_like(value)
        change(params, optimizers)
        assert params["opacities"].grad is None


def test_nothing_selected_changes_nothing() -> None:
    params, optimizers = learnt(6)
    before = dict(params)
    none = torch.zeros(6, dtype=torch.bool)
    for change in (ops.duplicate, ops.split, ops.remove):
        change(params, optimizers, {}, none)
    assert all(params[name] is value for name, value in before.items())


def test_states_of_mcmc_do_not_share_their_table() -> None:
    state = MCMCStrategy().initialize_state()
    state["binoms"].zero_()
    assert torch.equal(MCMCStrategy().initialize_state()["binoms"], BINOMS)


def test_relocation_of_transparent_gaussians() -> None:
    scales = torch.tensor([[1.0, 2.0, 3.0]])
    opacity, found = compute_relocation(torch.zeros(1), scales, torch.tensor([3]), BINOMS)
    assert float(opacity) == 0 and torch.equal(found, scales)


def test_mcmc_moves_adds_and_shakes() -> None:
    """Tests that MCMCStrategy relocates transparent Gaussians, adds new Gaussians, and adds noise to positions."""
    torch.manual_seed(1)
    strategy = MCMCStrategy(refine_start_iter=0, refine_every=10, cap_max=40, noise_lr=0.0)
    params, optimizers = learnt(40)
    with torch.no_grad():
        params["opacities"][:] = -9.0
        params["opacities"][[7, 8]] = 1.0
        params["opacities"][3] = math.log(0.0051 / 0.9949)  # just opaque enough to stay
    strategy.check_sanity(params, optimizers)
    state = strategy.initialize_state()
    means = params["means"].detach().clone()
    strategy.step_post_backward(params, optimizers, state, 9, {}, lr=1.0)
    assert torch.equal(params["means"], means)
    strategy.step_post_backward(params, optimizers, state, 10, {}, lr=1.0)
    assert len(params["means"]) == 40
    ids = (params["colors"][:, 0] / 3).round().int()
    assert set(ids.tolist()) <= {3, 7, 8} and {7, 8} <= set(ids.tolist())
    for i in (7, 8):  # all copies of a Gaussian have the same opacity and size
        mine = ids == i
        assert len(set(params["opacities"][mine].tolist())) == 1 and len(set(params["scales"][mine][:, 0].tolist())) == 1
        assert float(params["opacities"][mine][0]) < 1 and float(params["scales"][mine][0, 0]) < math.log(0.005)
    noted = moments(params, optimizers)
    assert float(noted[[i for i in range(40) if i != 3]].abs().max()) == 0
    strategy.cap_max = 41  # allows one more Gaussian, although a refinement could add up to 5 %
    strategy.step_post_backward(params, optimizers, state, 20, {}, lr=1.0)
    assert len(params["means"]) == 41 and moments(params, optimizers)[40] == 0
    together = (params["means"] == params["means"][40]).all(-1) & (params["opacities"] == params["opacities"][40])
    assert int(together.sum()) == 2  # the copy and its source
    strategy.noise_lr = 2.0
    with torch.no_grad():
        params["opacities"][:21] = -20
        params["opacities"][21:] = 5
        params["scales"][:] = math.log(2.0)
    means = params["means"].detach().clone()
    strategy.step_post_backward(params, optimizers, state, 11, {}, lr=0.5)
    moved = params["means"] - means
    assert float(moved[21:].abs().max()) < 1e-6
    with pytest.raises(ubs.UsageError, match="use the order of gsplat 1.6"):
        MCMCStrategy(1000, 5e5, 500, 25000, 100, 0.005, True)  # in the order of gsplat 1.5
    still = MCMCStrategy(noise_injection_stop_iter=11)
    means = params["means"].detach().clone()
    still.step_post_backward(params, optimizers, {}, 11, {}, lr=0.5)
    assert torch.equal(params["means"], means)
    still.step_post_backward(params, optimizers, {}, 10, {}, lr=0.5)
    assert not torch.equal(params["means"], means)
    # Because noise_lr * lr is 1, the standard deviation of the movement is the variance s^2 = 4 of the Gaussian, times
    # the factor 1 / (1 + exp(-0.5)) for an opacity near 0.
    assert 1.7 < float(moved[:21].std()) < 3.3


def test_mistakes_are_refused() -> None:
    """Tests that wrong parameters, optimisers and arguments raise errors that name them."""
    params, optimizers = learnt(3)
    with pytest.raises(ubs.UsageError, match="quats"):
        DefaultStrategy().check_sanity({k: v for k, v in params.items() if k != "quats"}, optimizers)
    with pytest.raises(ubs.UsageError, match="colors"):
        MCMCStrategy().check_sanity(params, {k: v for k, v in optimizers.items() if k != "colors"})
    with pytest.raises(ubs.UsageError, match="means"):
        MCMCStrategy().check_sanity(params, {**optimizers, "means": optimizers["scales"]})
    state = DefaultStrategy().initialize_state()
    info = drawn(3, torch.zeros(3, 2))
    with pytest.raises(ubs.UsageError, match="step_pre_backward"):
        info["means2d"].retain_grad()
        DefaultStrategy().step_post_backward(params, optimizers, state, 1, info)
    with pytest.raises(ubs.UsageError, match="absgrad=True"):
        DefaultStrategy(absgrad=True).step_post_backward(params, optimizers, state, 1, info)
    with pytest.raises(ubs.UsageError, match="packed"):
        DefaultStrategy().step_post_backward(params, optimizers, state, 1, info, packed=True)


@pytest.mark.parametrize("kind,packed", [("default", False), ("absgrad", True), ("mcmc", True)])
def test_they_learn(kind: str, packed: bool) -> None:
    """Trains with 3 views, starting from 40 Gaussians. The number of Gaussians must grow, and the error must fall below
    half of the initial error."""
    torch.manual_seed(0)
    viewmats, k = torch.eye(4).repeat(3, 1, 1), torch.tensor([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]).expand(3, 3, 3)
    for i in range(3):
        a = i * math.pi / 3
        viewmats[i, 0, 0], viewmats[i, 0, 2] = math.cos(a), math.sin(a)
        viewmats[i, 2, 0], viewmats[i, 2, 2] = -math.sin(a), math.cos(a)
    viewmats[:, 2, 3] = 5
    true = {"means": torch.randn(300, 3), "quats": torch.randn(300, 4), "scales": 0.05 + 0.15 * torch.rand(300, 3)}
    views = {"viewmats": viewmats, "Ks": k, "width": 40, "height": 40}
    target = rasterization(**true, opacities=torch.full((300,), 0.7), colors=torch.rand(300, 3), **views)[0]
    values = {
        "means": torch.randn(40, 3), "quats": torch.randn(40, 4), "scales": torch.full((40, 3), math.log(0.3)),
        "opacities": torch.zeros(40), "colors": torch.zeros(40, 3),
    }
    rates = {"means": 1e-2, "quats": 2e-2, "scales": 2e-2, "opacities": 5e-2, "colors": 5e-2}
    params = torch.nn.ParameterDict({name: torch.nn.Parameter(value) for name, value in values.items()})
    optimizers = {name: torch.optim.Adam([params[name]], lr=rate) for name, rate in rates.items()}
    strategy: Any = (
        DefaultStrategy(
            refine_start_iter=20, refine_every=20, refine_stop_iter=70, grow_scale3d=0.2,
            absgrad=kind == "absgrad", grow_grad2d=2e-3 if kind == "absgrad" else 1e-3,
        )
        if kind != "mcmc"
        else MCMCStrategy(refine_start_iter=10, refine_every=5, cap_max=120, noise_lr=1.0)
    )
    strategy.check_sanity(params, optimizers)
    state = strategy.initialize_state()
    errors = []
    for step in range(80):
        images, _, info = rasterization(
            params["means"], params["quats"], params["scales"].exp(), params["opacities"].sigmoid(),
            params["colors"].sigmoid(), **views, packed=packed, absgrad=kind == "absgrad",
        )
        loss = ((images - target) ** 2).mean()
        strategy.step_pre_backward(params, optimizers, state, step, info)
        loss.backward()
        errors.append(float(loss))
        extra = {"packed": packed} if kind != "mcmc" else {"lr": 1e-2}
        if kind != "mcmc":
            strategy.step_post_backward(params, optimizers, state, step, info, **extra)
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        if kind == "mcmc":
            strategy.step_post_backward(params, optimizers, state, step, info, **extra)
    print(kind, packed, len(params["means"]), errors[0], errors[-1])
    assert 50 <= len(params["means"]) < 2000
    assert errors[-1] < 0.5 * errors[0]


def test_arguments_of_gsplat_1_6(recwarn: pytest.WarningsRecorder) -> None:
    """Tests arguments that gsplat 1.6 has in addition."""
    scales, copies = torch.ones(2, 3), torch.tensor([5, 2])
    plain = compute_relocation(torch.tensor([0.01, 0.9]), scales, copies, BINOMS)
    found = compute_relocation(torch.tensor([0.01, 0.9]), scales, copies, BINOMS, min_opacity=0.005)
    total = sum(
        math.comb(a - 1, k) * (-1) ** k / math.sqrt(k + 1) * 0.005 ** (k + 1) for a in range(1, 6) for k in range(a)
    )
    assert float(plain[0][0]) < 0.0021 and found[0].tolist() == [pytest.approx(0.005), float(plain[0][1])]
    assert float(found[1][0, 0]) == pytest.approx(0.01 / total, rel=1e-5) and found[1][1, 0] == plain[1][1, 0]
    params, optimizers = learnt(8)
    mask = torch.arange(len(params["means"])) < 2
    for change in (
        lambda scene: ops.duplicate(params, optimizers, {}, mask, scene=scene),
        lambda scene: ops.split(params, optimizers, {}, torch.arange(len(params["means"])) < 2, scene=scene),
        lambda scene: ops.remove(params, optimizers, {}, torch.arange(len(params["means"])) < 2, scene=scene),
        lambda scene: ops.relocate(params, optimizers, {}, torch.arange(len(params["means"])) < 2, BINOMS, scene=scene),
        lambda scene: ops.sample_add(params, optimizers, {}, 2, BINOMS, scene=scene),
    ):
        change(None)
        with pytest.raises(ubs.UsageError, match="scene is not supported"):
            change(object())
    moved = []
    for name in ("noise_scale", "scaler"):
        params["means"].data.zero_()
        torch.manual_seed(3)
        ops.inject_noise_to_position(params, {}, {}, **{name: 3.0})
        moved.append(params["means"].detach().clone())
    assert torch.equal(*moved) and float(moved[0].abs().max()) > 0
    with pytest.raises(ubs.UsageError, match="noise_scale"):
        ops.inject_noise_to_position(params, {}, {})
    assert not recwarn.list


def test_largest_radii_are_kept_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    from ubs.gsplat.strategy.default import _maxima

    torch.manual_seed(1)
    ids, values = torch.randint(9, (200,)), torch.rand(200)
    found = dict(zip(*(tensor.tolist() for tensor in _maxima(ids, values))))
    assert found == {i: float(values[ids == i].max()) for i in range(9)}
    assert [len(tensor) for tensor in _maxima(ids[:0], values[:0])] == [0, 0]
    strategy = ubs.gsplat.DefaultStrategy(refine_scale2d_stop_iter=10)
    params, optimizers = learnt(4)
    state = strategy.initialize_state()
    centre = torch.zeros(2, 4, 2, requires_grad=True)
    (centre * 3).sum().backward()
    radii = torch.tensor([[1, 2, 3, 0], [4, 1, 1, 0]])[..., None].repeat(1, 1, 2)
    info = {"means2d": centre, "radii": radii, "width": 8, "height": 8, "n_cameras": 2, "gaussian_ids": None}
    strategy._update_state(params, state, info)
    assert state["radii"].tolist() == [0.5, 0.25, 0.375, 0] and state["count"].tolist() == [2, 2, 2, 0]
    assert not recwarn.list
