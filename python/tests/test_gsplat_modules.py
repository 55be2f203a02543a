# SPDX-License-Identifier: Apache-2.0
"""Tests the modules of ubs.gsplat other than the rasteriser and the strategies: optimizers, exporter, utils,
cuda._wrapper, cuda._torch_impl, distributed and compression. The formulas are evaluated in float64."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="SKIPPED: PyTorch is not installed")

import ubs  # noqa: E402
from ubs.gsplat import SelectiveAdam, export_splats, fully_fused_projection, spherical_harmonics  # noqa: E402
from ubs.gsplat.cuda._torch_impl import _eval_sh_bases_fast  # noqa: E402
from ubs.gsplat.cuda._wrapper import proj, quat_scale_to_covar_preci, world_to_cam  # noqa: E402
from ubs.gsplat.distributed import cli  # noqa: E402
from ubs.gsplat.utils import (  # noqa: E402
    depth_to_normal,
    depth_to_points,
    get_projection_matrix,
    inverse_log_transform,
    log_transform,
    normalized_quat_to_rotmat,
    save_ply,
)

from test_gsplat import HEIGHT, WIDTH, ellipse, norm_error, pixel_of, rotations, scene  # noqa: E402

UPPER = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]


def spread(rotation: Any, scales: Any) -> Any:
    """Returns covariance matrices (n, 3, 3)."""
    return rotation @ torch.diag_embed(scales**2) @ rotation.transpose(-1, -2)


# ---- cuda._wrapper ----


@pytest.mark.parametrize("triu", [False, True])
def test_covariances_and_precisions(triu: bool) -> None:
    """Compares matrices and gradients with float64. The largest errors on a CPU are 2.2e-7 and 3.6e-7."""
    s = scene(splats=50, batch=(2,))
    quats, scales = s["quats"].requires_grad_(), s["scales"].requires_grad_()
    exact = [tensor.detach().double().requires_grad_() for tensor in (quats, scales)]
    rotation = rotations(exact[0].reshape(-1, 4)).reshape(2, 50, 3, 3)
    expected = spread(rotation, exact[1]), spread(rotation, 1 / exact[1])
    found = quat_scale_to_covar_preci(quats, scales, triu=triu)
    for mine, other in zip(found, expected):
        wanted = other[(..., *UPPER)] if triu else other
        assert mine is not None and mine.shape == wanted.shape
        assert norm_error(mine.detach(), wanted.detach()) < 4e-7
        weights = torch.randn(mine.shape, generator=torch.Generator().manual_seed(4))
        gradients = torch.autograd.grad((mine * weights).sum(), (quats, scales))
        for gradient, value in zip(gradients, torch.autograd.grad((wanted * weights).sum(), exact, retain_graph=True)):
            assert norm_error(gradient, value) < 7e-7
    assert quat_scale_to_covar_preci(quats, scales, compute_preci=False)[1] is None
    assert quat_scale_to_covar_preci(quats, scales, compute_covar=False)[0] is None
    with pytest.raises(ubs.UsageError, match="scales has the shape"):
        quat_scale_to_covar_preci(quats, scales[:, 1:])


@pytest.mark.parametrize("model", ["pinhole", "ortho", "fisheye"])
def test_projection_in_steps(model: str) -> None:
    """Compares world_to_cam() and proj(), and their gradients, with float64, and with fully_fused_projection(). The
    largest errors on a CPU are 1.5e-7 for values, 5.4e-7 for gradients and 3e-7 for conics."""
    s = scene(splats=60, batch=(2,))
    covars = quat_scale_to_covar_preci(s["quats"], s["scales"])[0]
    assert covars is not None
    given = [s["means"], covars, s["viewmats"], s["Ks"]]
    means, covars, viewmats, ks = (tensor.clone().requires_grad_() for tensor in given)
    points, turned = world_to_cam(means, covars, viewmats)
    means2d, covars2d = proj(points, turned, ks, WIDTH, HEIGHT, camera_model=model)
    exact = [tensor.double().requires_grad_() for tensor in given]
    wanted: dict[str, list[Any]] = {"points": [], "turned": [], "means2d": [], "covars2d": []}
    for b in range(2):
        for c in range(2):
            view, k = exact[2][b, c], exact[3][b, c]
            p = exact[0][b] @ view[:3, :3].T + view[:3, 3]
            wide = view[:3, :3] @ exact[1][b] @ view[:3, :3].T
            for name, value in zip(wanted, (p, wide, pixel_of(model, p, k), ellipse(model, p, wide, k))):
                wanted[name].append(value)
    loss, exact_loss = 0, 0
    for mine, (name, values) in zip((points, turned, means2d, covars2d), wanted.items()):
        other = torch.stack(values).reshape(mine.shape)
        assert norm_error(mine.detach(), other.detach()) < 3e-7, name
        weights = torch.randn(mine.shape, generator=torch.Generator().manual_seed(5))
        weights = weights + weights.transpose(-1, -2) if name == "covars2d" else weights
        loss, exact_loss = loss + (mine * weights).sum(), exact_loss + (other * weights).sum()
    gradients = torch.autograd.grad(loss, (means, covars, viewmats, ks))
    for gradient, value in zip(gradients, torch.autograd.grad(exact_loss, exact)):
        assert norm_error(gradient, value) < 1e-6
    radii, fused2d, depths, conics, _ = fully_fused_projection(
        means, covars, None, None, viewmats, ks, WIDTH, HEIGHT, camera_model=model
    )
    seen = (radii > 0).all(-1)
    assert int(seen.sum()) > 80
    assert torch.allclose(fused2d[seen], means2d[seen], rtol=1e-5, atol=1e-5)
    assert torch.allclose(depths, points[..., 2], rtol=1e-6, atol=1e-6)
    inverse = torch.linalg.inv(covars2d.double() + 0.3 * torch.eye(2))[..., [0, 0, 1], [0, 1, 1]]
    assert norm_error(conics[seen].detach(), inverse[seen].detach()) < 6e-7


def test_bases_of_harmonics() -> None:
    dirs = torch.nn.functional.normalize(torch.randn(4, 5, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    for degree in range(5):
        count = (degree + 1) ** 2
        found = _eval_sh_bases_fast(count, dirs)
        one = torch.eye(count)[:, None, None, :, None].expand(count, 4, 5, count, 1)
        for k in range(count):
            assert torch.allclose(found[..., k], spherical_harmonics(degree, dirs, one[k])[..., 0], atol=1e-6)
    with pytest.raises(ubs.UsageError, match="basis_dim=8"):
        _eval_sh_bases_fast(8, dirs)


# ---- optimizers ----


def test_selective_adam_changes_visible_rows() -> None:
    g = torch.Generator().manual_seed(2)
    first, second = (torch.nn.Parameter(torch.randn(20, *shape, generator=g)) for shape in ((3,), ()))
    groups = [{"params": [first], "lr": 0.1, "name": "a"}, {"params": [second], "lr": 0.2}]
    optimizer = SelectiveAdam(groups, eps=1e-3, betas=(0.8, 0.95))
    exact = [tuple(t.double() for t in (p.detach(), 0 * p.detach(), 0 * p.detach())) for p in (first, second)]
    for step in range(4):
        visible = torch.rand(20, generator=g) < 0.5
        before = first.detach().clone()
        for i, (p, lr) in enumerate(((first, 0.1), (second, 0.2))):
            p.grad = torch.randn(p.shape, generator=g)
            value, m, v = exact[i]
            rows = visible.reshape(-1, *[1] * (p.dim() - 1))
            m_new, v_new = 0.8 * m + 0.2 * p.grad, 0.95 * v + 0.05 * p.grad**2
            moved = value - lr * m_new / (v_new.sqrt() + 1e-3)
            exact[i] = tuple(torch.where(rows, new, old) for new, old in ((moved, value), (m_new, m), (v_new, v)))
        optimizer.step(visible.float() if step == 2 else visible)
        assert torch.equal(first[~visible], before[~visible]) and not torch.equal(first, before)
    for p, (value, m, v) in zip((first, second), exact):
        state = optimizer.state[p]
        assert float(state["step"]) == 0
        for mine, other in ((p, value), (state["exp_avg"], m), (state["exp_avg_sq"], v)):
            assert norm_error(mine.detach(), other) < 1.1e-7  # at most 5.6e-8 on a CPU
    first.grad = None
    optimizer.step(torch.ones(20, dtype=torch.bool))  # a parameter without a gradient is not changed
    with pytest.raises(ubs.UsageError, match="visibility has 19 values, but a parameter has 20 rows"):
        optimizer.step(torch.ones(19, dtype=torch.bool))
    with pytest.raises(ubs.UsageError, match="2 parameters"):
        SelectiveAdam([first, second], eps=1e-8, betas=(0.9, 0.999)).step(torch.ones(20, dtype=torch.bool))


def test_selective_adam_refuses_sparse_gradients() -> None:
    p = torch.nn.Parameter(torch.zeros(3, 2))
    optimizer = SelectiveAdam([p], eps=1e-8, betas=(0.9, 0.999))
    p.grad = torch.sparse_coo_tensor([[0]], [[1.0, 1.0]], (3, 2))
    with pytest.raises(ubs.UsageError, match="sparse gradients"):
        optimizer.step(torch.ones(3, dtype=torch.bool))


# ---- exporter ----


def gaussians(count: int = 600, higher: int = 8) -> dict[str, Any]:
    g = torch.Generator().manual_seed(count)
    return {
        "means": torch.randn(count, 3, generator=g),
        "scales": torch.randn(count, 3, generator=g) - 3,
        "quats": torch.randn(count, 4, generator=g).requires_grad_(),
        "opacities": torch.randn(count, generator=g),
        "sh0": torch.randn(count, 1, 3, generator=g).requires_grad_(),
        "shN": 0.3 * torch.randn(count, higher, 3, generator=g),
    }


def close(found: Any, expected: Any, most: float) -> None:
    expected = np.asarray(expected)
    assert np.shape(found) == expected.shape
    assert float(np.abs(np.asarray(found, np.float64) - expected).max()) <= most


@pytest.mark.parametrize("higher", [0, 3, 8, 15])
def test_ply_has_the_layout_of_3dgs(higher: int, tmp_path: Path) -> None:
    s = gaussians(higher=higher)
    file = export_splats(**s, format="ply", save_to=str(tmp_path / "model.ply"))
    assert (tmp_path / "model.ply").read_bytes() == file == export_splats(**s)
    s = {name: value.detach() for name, value in s.items()}
    header, rows = file.split(b"end_header\n", 1)
    lines = header.decode().splitlines()
    names = [line.split()[-1] for line in lines if line.startswith("property float ")]
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 600"]
    wanted = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(3 * higher)), "opacity"]
    wanted += [f"scale_{k}" for k in range(3)] + [f"rot_{k}" for k in range(4)]
    assert [name for name in names if name not in ("nx", "ny", "nz")] == wanted
    table = np.frombuffer(rows, "<f4").reshape(600, len(names))
    column = {name: table[:, k] for k, name in enumerate(names)}
    for k in range(3):
        assert np.array_equal(column["xyz"[k]], s["means"][:, k])
        assert np.array_equal(column[f"f_dc_{k}"], s["sh0"][:, 0, k])
        for n in range(higher):  # the coefficients of red come first
            assert np.array_equal(column[f"f_rest_{k * higher + n}"], s["shN"][:, n, k])
        close(column[f"scale_{k}"], s["scales"][:, k], 6e-8)  # at most 3e-8
    assert np.array_equal(column["opacity"], s["opacities"])
    turns = s["quats"] / s["quats"].norm(dim=-1, keepdim=True)
    close(np.stack([column[f"rot_{k}"] for k in range(4)], 1), turns, 6e-8)  # 0, but other CPUs may round differently
    model = ubs.Model.load(tmp_path / "model.ply")
    assert np.array_equal(model.parameters["xyz"], s["means"])
    assert np.array_equal(model.parameters["sh0"], s["sh0"][:, 0])


def test_splat_files_contain_the_gaussians(tmp_path: Path) -> None:
    s = gaussians()
    assert len(export_splats(**s, format="splat", save_to=tmp_path / "model.splat")) == 600 * 32
    s = {name: value.detach() for name, value in s.items()}
    found = ubs.Model.load(tmp_path / "model.splat").parameters
    close(found["xyz"], s["means"], 0)
    close(1 / (1 + np.exp(-found["opacity"][:, 0])), torch.sigmoid(s["opacities"]), 0.51 / 255)
    close((found["sh0"] * 0.28209479 + 0.5) * 255, (s["sh0"][:, 0] * 0.28209479 + 0.5).clamp(0, 1) * 255, 0.51)
    close(np.log(np.log1p(np.exp(found["scale"]))), s["scales"], 9e-7)  # at most 4.8e-7


@pytest.mark.parametrize("higher", [0, 15])
def test_compressed_ply_contains_the_gaussians(higher: int, tmp_path: Path) -> None:
    """Tests that `ubs` reads the same Gaussians, within the resolution of the format. Gaussians that are nearly
    transparent are omitted, and the order is another one."""
    s = gaussians(higher=higher)
    with torch.no_grad():
        s["opacities"][:10] = -9
        s["means"][:, 0] = torch.arange(600.0)  # identifies the Gaussian
        s["means"][:, 2] = 1.0  # bounds without extent
    file = export_splats(**s, format="ply_compressed", save_to=tmp_path / "model.ply")
    assert (tmp_path / "model.ply").read_bytes() == file
    assert b"element chunk 3\n" in file and b"element vertex 590\n" in file
    found = ubs.Model.load(tmp_path / "model.ply").parameters
    ids = found["xyz"][:, 0].round().astype(int)
    assert sorted(ids) == list(range(10, 600))
    assert list(ids) != sorted(ids)
    s = {name: value.detach()[ids] for name, value in s.items()}
    close(found["xyz"], s["means"], 0.15)  # in steps of at most 1/2047 of the extent along x
    close(found["xyz"][:, 1:], s["means"][:, 1:], 8 / 1023 / 2)
    close(np.log(np.log1p(np.exp(found["scale"]))), s["scales"], 8 / 1023 / 2)
    close(1 / (1 + np.exp(-found["opacity"][:, 0])), torch.sigmoid(s["opacities"]), 0.51 / 255)
    close(found["sh0"], s["sh0"][:, 0], 8 / 255 / 2)
    turns = s["quats"] / s["quats"].norm(dim=-1, keepdim=True)
    read = found["rotation"] / np.linalg.norm(found["rotation"], axis=1, keepdims=True)
    close(np.abs((read * turns.numpy()).sum(1)), np.ones(590), 2e-6)
    if higher:
        close(found["sh_rest"], s["shN"].transpose(1, 2).reshape(590, -1), 8 / 256 / 2 + 1e-6)


def test_values_that_cannot_be_exported(tmp_path: Path) -> None:
    s = {name: value.detach() for name, value in gaussians(count=5, higher=3).items()}
    for row, name in enumerate(("means", "shN", "opacities", "quats")):
        s[name][row] = [math.nan, math.inf, -math.inf, 0][row]
    for kind in ("ply", "splat", "ply_compressed"):
        export_splats(**s, format=kind, save_to=tmp_path / "model.splat")
        one = export_splats(**{name: value[4:] for name, value in s.items()}, format=kind)
        assert (tmp_path / "model.splat").read_bytes() == one
        with pytest.raises(ubs.UsageError, match="no Gaussians"):
            export_splats(**{name: value[:4] for name, value in s.items()}, format=kind)
    for changed, word in (
        ({"shN": torch.zeros(5, 4, 3)}, "0, 3, 8 or 15"), ({"format": "obj"}, "format='obj'"),
        ({"opacities": torch.zeros(5, 1)}, "opacities has the shape"),
        ({"shN": torch.zeros(5, 9)}, "shN has the shape"),
    ):
        with pytest.raises(ubs.UsageError, match=word):
            export_splats(**{**s, **changed})


def test_extreme_values_are_limited(tmp_path: Path) -> None:
    s = gaussians(count=4, higher=0)
    s["opacities"] = torch.tensor([1000.0, -1000, 5, 3])
    s["scales"] = torch.tensor([-800.0, 15, -30, 800])[:, None].repeat(1, 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rows = export_splats(**s).split(b"end_header\n")[1]
        packed = export_splats(**s, format="ply_compressed", save_to=tmp_path / "model.ply")
    table = np.frombuffer(rows, "<f4").reshape(3, 17)
    close(table[:, 9], [16, -16, 5], 0)
    close(table[:, 10], [-39, 15, -30], 2e-6)  # 0, but other CPUs may round differently
    assert b"element vertex 3\n" in packed
    found = ubs.Model.load(tmp_path / "model.ply").parameters
    assert sorted(np.log(found["scale"][found["scale"] > 0]).round(3)) == [20, 20, 20]


def test_all_lengths_of_quats_are_exported() -> None:
    g = torch.Generator().manual_seed(5)
    quats = torch.randn(4, 4, generator=g)
    sizes = torch.tensor([[1.0], [1e-30], [1e37], [1e-12]])
    given = (torch.randn(4, 3, generator=g), torch.full((4, 3), -3.0))
    rest = (torch.full((4,), 1.0), torch.zeros(4, 1, 3), torch.zeros(4, 0, 3))
    for kind in ("ply", "splat", "ply_compressed"):
        plain = export_splats(*given, quats, *rest, format=kind)
        assert len(export_splats(*given, quats * sizes, *rest, format=kind)) == len(plain)
    with pytest.raises(ubs.UsageError, match="at most 1/255"):
        export_splats(*given, quats, torch.full((4,), -9.0), *rest[1:], format="ply_compressed")


def test_save_ply(tmp_path: Path) -> None:
    s = gaussians()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_ply(torch.nn.ParameterDict({k: torch.nn.Parameter(v) for k, v in s.items()}), str(tmp_path / "a.ply"))
    assert (tmp_path / "a.ply").read_bytes() == export_splats(**s)
    colors = torch.rand(600, 3, generator=torch.Generator().manual_seed(0))
    save_ply(s, str(tmp_path / "b.ply"), colors)
    model = ubs.Model.load(tmp_path / "b.ply")
    assert "sh_rest" not in model.parameters
    close(model.parameters["sh0"] * math.sqrt(1 / (4 * math.pi)) + 0.5, colors, 1.2e-7)  # at most 6e-8


# ---- utils ----


def test_rotation_matrices_and_logarithms() -> None:
    quats = torch.nn.functional.normalize(torch.randn(3, 7, 4, generator=torch.Generator().manual_seed(0)), dim=-1)
    found = normalized_quat_to_rotmat(quats)
    assert found.shape == (3, 7, 3, 3)
    assert norm_error(found.reshape(-1, 3, 3), rotations(quats.double().reshape(-1, 4))) < 2.3e-7  # 1.2e-7 on a CPU
    x = torch.tensor([-100.0, -1, -1e-6, 0, 1e-6, 0.5, 1e4])
    wanted = torch.tensor([math.copysign(math.log1p(abs(v)), v) for v in x.double().tolist()])
    assert torch.allclose(log_transform(x), wanted, rtol=2e-7, atol=0)
    assert torch.allclose(inverse_log_transform(log_transform(x)), x, rtol=2e-6, atol=0)


def test_points_and_normals_of_depths() -> None:
    """Projects the points again, and compares the normals with those of a plane."""
    s = scene(splats=1, batch=(3,))
    viewmats, ks = s["viewmats"].double(), s["Ks"].double()
    poses, depths = torch.linalg.inv(viewmats), 2 + torch.rand(3, 2, HEIGHT, WIDTH, 1).double()
    ys, xs = torch.meshgrid(torch.arange(HEIGHT) + 0.5, torch.arange(WIDTH) + 0.5, indexing="ij")
    for z_depth in (True, False):
        points = depth_to_points(depths, poses, ks, z_depth=z_depth)
        assert points.shape == (3, 2, HEIGHT, WIDTH, 3)
        seen = torch.einsum("bcij,bchwj->bchwi", viewmats[..., :3, :3], points) + viewmats[..., None, None, :3, 3]
        far = seen[..., 2:] if z_depth else seen.norm(dim=-1, keepdim=True)
        assert torch.allclose(far, depths)
        pixels = torch.einsum("bcij,bchwj->bchwi", ks, seen / seen[..., 2:])
        assert torch.allclose(pixels[..., 0], xs.double().expand(3, 2, -1, -1))
        assert torch.allclose(pixels[..., 1], ys.double().expand(3, 2, -1, -1))
    # The plane n . x = 3 in the coordinate system of a camera that looks along z. n points away from the camera.
    n = torch.nn.functional.normalize(torch.tensor([0.2, -0.3, 1.0]).double(), dim=0)
    rays = depth_to_points(torch.ones(HEIGHT, WIDTH, 1).double(), torch.eye(4).double(), ks[0, 0])
    plane = (3 / (rays @ n))[..., None]
    normals = depth_to_normal(plane, poses[0, 1], ks[0, 0])
    inner = normals[1:-1, 1:-1]
    assert torch.allclose(inner, -(poses[0, 1, :3, :3] @ n).expand_as(inner))
    assert float(normals.abs().sum()) == pytest.approx(float(inner.abs().sum()))
    with pytest.raises(ubs.UsageError, match="camtoworlds and Ks"):
        depth_to_points(depths, poses[0], ks)


@pytest.mark.parametrize("size", [(1, 4), (4, 1), (2, 2), (3, 2)])
def test_normals_of_small_images_are_0(size: tuple[int, int]) -> None:
    normals = depth_to_normal(torch.ones(*size, 1), torch.eye(4), torch.eye(3))
    assert normals.shape == (*size, 3) and not bool(normals.any())


def test_projection_matrix() -> None:
    matrix = get_projection_matrix(0.5, 20.0, 1.2, 0.8).double()
    for depth, wanted in ((0.5, 0.0), (20.0, 1.0)):
        corner = torch.tensor([depth * math.tan(0.6), -depth * math.tan(0.4), depth, 1.0]).double()
        x, y, z, w = (matrix @ corner).tolist()
        assert (x / w, y / w, z / w, w) == pytest.approx((1, -1, wanted, depth), abs=2e-7)


# ---- distributed, compression ----


def test_cli_runs_in_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    names = "OMPI_COMM_WORLD_SIZE", "WORLD_SIZE"
    for name in names:
        monkeypatch.delenv(name, raising=False)
    assert cli(lambda *arguments: calls.append(arguments), {"steps": 3}, verbose=True) is True
    monkeypatch.setenv("WORLD_SIZE", "1")
    cli(lambda local_rank, world_rank, world_size, args: calls.append(world_size), None)
    assert calls == [(0, 0, 1, {"steps": 3}), 1]
    for name in names:
        monkeypatch.setenv(name, "4")
        with pytest.raises(ubs.UsageError, match=f"{name}=4, but ubs.gsplat runs in one process"):
            cli(lambda *arguments: calls.append(arguments), None)
        monkeypatch.delenv(name)
    assert len(calls) == 2


def test_compression_is_imported_and_refused() -> None:
    from ubs.gsplat.compression import PngCompression
    from ubs.gsplat.cuda._wrapper import rasterize_to_pixels
    from ubs.gsplat.distributed import all_gather_int32

    for call in (PngCompression, rasterize_to_pixels, all_gather_int32):
        with pytest.raises(ubs.UsageError, match=f"^{call.__name__} does not exist in ubs.gsplat: "):
            call()


def test_functions_that_pytorch_computes_have_float64(recwarn: pytest.WarningsRecorder) -> None:
    """Tests that torch.autograd.gradcheck, which needs float64, accepts these functions and their gradients."""
    torch.manual_seed(1)
    double = {"dtype": torch.float64}
    check = torch.autograd.gradcheck
    quats, scales = torch.randn(3, 4, **double).requires_grad_(), (0.5 + torch.rand(3, 3, **double)).requires_grad_()
    assert check(lambda q, s: quat_scale_to_covar_preci(q, s), (quats, scales))
    means = (torch.randn(3, 3, **double) + torch.tensor([0, 0, 5.0])).requires_grad_()
    viewmats, ks = torch.eye(4, **double)[None], torch.tensor([[[20.0, 0, 8], [0, 21, 6], [0, 0, 1]]], **double)
    covars = quat_scale_to_covar_preci(quats, scales)[0].detach().requires_grad_()
    turned = viewmats.clone().requires_grad_()
    assert check(world_to_cam, (means, covars, turned))
    assert check(lambda m, c: proj(m[None], c[None], ks, 16, 12), (means, covars))
    assert check(
        lambda m, q, s, v: fully_fused_projection(m, None, q, s, v, ks, 16, 12)[1:4], (means, quats, scales, turned)
    )
    coeffs = torch.randn(3, 25, 2, **double).requires_grad_()
    assert check(lambda d, c: spherical_harmonics(4, d, c), (means, coeffs))
    depths = (1 + torch.rand(4, 5, 1, **double)).requires_grad_()
    assert check(lambda d: ubs.gsplat.utils.depth_to_normal(d, torch.eye(4, **double), ks[0]), (depths,))
    opacities = (0.1 + 0.8 * torch.rand(3, **double)).requires_grad_()
    binoms, ratios = torch.zeros(5, 5), torch.tensor([1, 2, 5])
    assert check(lambda o, s: ubs.gsplat.relocation.compute_relocation(o, s, ratios, binoms), (opacities, scales))
    for call in (
        lambda: spherical_harmonics(0, means, coeffs.float()),
        lambda: quat_scale_to_covar_preci(quats, scales.float()),
        lambda: world_to_cam(means, covars, viewmats.float()),
        lambda: proj(means[None], covars[None], ks.float(), 16, 12),
    ):
        with pytest.raises(ubs.UsageError, match="has the type torch.float32, but other tensors are torch.float64"):
            call()
    with pytest.raises(ubs.UsageError, match="torch.float16, but must be torch.float32 or torch.float64"):
        spherical_harmonics(0, means.half(), coeffs)


def test_harmonics_of_all_cameras() -> None:
    """Tests coefficients (N, K, D) with directions (C, N, 3), as in gsplat 1.6."""
    torch.manual_seed(2)
    dirs, coeffs = torch.randn(2, 5, 3), torch.randn(5, 4, 3, requires_grad=True)
    found = spherical_harmonics(1, dirs, coeffs)
    assert torch.equal(found, spherical_harmonics(1, dirs, coeffs.expand(2, 5, 4, 3)))
    found.sum().backward()
    assert coeffs.grad is not None and coeffs.grad.shape == coeffs.shape and float(coeffs.grad.abs().max()) > 0
    with pytest.raises(ubs.UsageError, match="coeffs has the shape"):
        spherical_harmonics(1, dirs, coeffs[:4])


def test_rasterization_has_the_arguments_of_gsplat_1_6() -> None:
    """Tests that their default values are accepted, and that others are refused."""
    turn, size = torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.1)
    splats = (torch.zeros(1, 3), turn, size, torch.ones(1), torch.ones(1, 3))
    view = (torch.eye(4)[None] + torch.tensor([[0.0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [0, 0, 0, 0]]),
            torch.tensor([[[8.0, 0, 4], [0, 8, 4], [0, 0, 1]]]), 8, 8)
    default = {"tile_size": None, "return_normals": False, "global_z_order": True, "rays": None, "lidar_coeffs": None,
               "external_distortion_coeffs": None, "ut_params": None, "renderer_config": None}
    image = ubs.gsplat.rasterization(*splats, *view, **default)[0]
    assert torch.equal(image, ubs.gsplat.rasterization(*splats, *view)[0]) and float(image.max()) > 0.1
    for name, other in (("return_normals", True), ("global_z_order", False), ("rays", torch.zeros(1)),
                        ("ut_params", 3), ("renderer_config", 3)):
        with pytest.raises(ubs.UsageError, match=f"{name}.* is not supported"):
            ubs.gsplat.rasterization(*splats, *view, **{**default, name: other})
