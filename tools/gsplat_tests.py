#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs gsplat's own tests of its classic 3DGS rasteriser, lists of tiles and strategies against ubs.gsplat.

    GSPLAT_SOURCE=/path/to/gsplat tools/gsplat_tests.py [options of pytest]

GSPLAT_SOURCE is a checkout of gsplat 1.6 (https://github.com/nerfstudio-project/gsplat); it is not modified. The
tests run in a copy in which the device is the CPU and which has 400 Gaussians instead of 10 000. The tests compare with
gsplat's _rasterization(), which needs CUDA. This script replaces it by a reference that uses gsplat's projection,
covariances and spherical harmonics in float64, and blends all Gaussians at all pixels. Tests of CUDA operators, 3DGUT,
lidar and distribution are skipped. Needs PyTorch and pytest, and the package ubs (an installed one, or PYTHONPATH and
UBS_LIBRARY).

    GSPLAT_SOURCE=/path/to/gsplat tools/gsplat_tests.py --picture MODEL.ply DATA [VIEW ...]

The second command renders test views of a 3DGS file (all, or those with these numbers) with ubs and with that
reference. It prints the PSNR between the two images. 20 000 Gaussians at 200x200 take 76 s per view on one core."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import tempfile

TESTS = {
    "test_basic.py": "test_rasterization_cpp_classic or test_isect[",
    "test_rasterization.py": "test_rasterization and False-False-pinhole and not True-3-400",
    "test_strategy.py": "test_strategy",
}
CONFTEST = r'''
import importlib.machinery, importlib.util, sys, types, typing
from unittest.mock import MagicMock
import pytest, torch, typing_extensions
import ubs.gsplat, ubs.gsplat.strategy

SOURCE = %r
typing_extensions.Tuple = typing.Tuple  # for Python and typing_extensions older than those of gsplat


class StandIn(types.ModuleType):
    """A module in which only the names that the selected tests use are implemented."""
    __path__ = []
    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        value = MagicMock()
        setattr(self, name, value)
        return value


class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] != "gsplat":
            return None
        if name in ("gsplat._helper", "gsplat.cuda._constants", "gsplat.cuda._math", "gsplat.cuda._torch_impl"):
            return importlib.util.spec_from_file_location(name, SOURCE + "/" + name.replace(".", "/") + ".py")
        return importlib.machinery.ModuleSpec(name, self, is_package=True)
    def create_module(self, spec):
        return StandIn(spec.name)
    def exec_module(self, module):
        pass


sys.meta_path.insert(0, Finder())
import gsplat, gsplat.rendering, gsplat.cuda._wrapper  # noqa: E402
from gsplat.cuda._constants import ALPHA_THRESHOLD, MAX_ALPHA, TRANSMITTANCE_THRESHOLD  # noqa: E402
from gsplat.cuda._math import _quat_scale_to_covar_preci  # noqa: E402
from gsplat.cuda._torch_impl import _fully_fused_projection, _spherical_harmonics  # noqa: E402


def rasterization(*args, lidar_coeffs=None, renderer_config=None, **kwargs):
    assert lidar_coeffs is None
    return ubs.gsplat.rasterization(*args, **kwargs)


def composite(means2d, conics, opacities, colors, depths, radii, width, height):
    """Blends all Gaussians at all pixels, in chunks of pixels. Returns an image (H W, D) and its alpha (H W)."""
    seen = (radii > 0).all(-1)
    order = torch.argsort(depths[seen], stable=True)
    means2d, conics, opacities, colors = (t[seen][order] for t in (means2d, conics, opacities, colors))
    ys, xs = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    images, alphas = [], []
    for pixels in torch.stack([xs, ys], -1).double().reshape(-1, 2).split(2**21 // max(len(order), 1) + 1):
        d = pixels[None] - means2d[:, None]
        sigma = (conics[:, 0:1] * d[..., 0] ** 2 + conics[:, 2:3] * d[..., 1] ** 2) / 2
        sigma = sigma + conics[:, 1:2] * d[..., 0] * d[..., 1]
        alpha = (opacities[:, None] * torch.exp(-sigma)).clamp_max(MAX_ALPHA)
        alpha = torch.where((sigma >= 0) & (alpha >= ALPHA_THRESHOLD), alpha, torch.zeros_like(alpha))
        behind = torch.cumprod(1 - alpha, 0)
        before = torch.cat([torch.ones_like(behind[:1]), behind[:-1]])
        weight = torch.where(behind > TRANSMITTANCE_THRESHOLD, before * alpha, torch.zeros_like(alpha))
        images.append(weight.T @ colors)
        alphas.append(weight.sum(0))
    return torch.cat(images), torch.cat(alphas)


def reference(
    means, quats, scales, opacities, colors, viewmats, Ks, width, height, sh_degree=None, backgrounds=None,
    render_mode="RGB", rasterize_mode="classic", extra_signals=None, extra_signals_sh_degree=None, **ignored
):
    batch, n, cameras = means.shape[:-2], means.shape[-2], viewmats.shape[-3]
    means, quats, scales, opacities, viewmats, Ks = (t.double() for t in (means, quats, scales, opacities, viewmats, Ks))
    covars, _ = _quat_scale_to_covar_preci(quats, scales, compute_preci=False)
    aa = rasterize_mode == "antialiased"
    radii, means2d, depths, conics, compensations = _fully_fused_projection(
        means, covars, viewmats, Ks, width, height, calc_compensations=aa
    )
    strength = opacities[..., None, :].expand(depths.shape)
    strength = strength * compensations if aa else strength

    def shaded(values, degree, clamp):
        values = values.double()
        if degree is None:
            return values if values.dim() == means.dim() + 1 else values[..., None, :, :].expand(*depths.shape, -1)
        centres = torch.inverse(viewmats)[..., :3, 3]
        found = _spherical_harmonics(degree, means[..., None, :, :] - centres[..., None, :], values) + 0.5
        return found.clamp_min(0) if clamp else found

    bands, widths = [], [0, 0]
    if "RGB" in render_mode:
        bands.append(shaded(colors, sh_degree, True))
        widths[0] = bands[-1].shape[-1]
    if extra_signals is not None:
        bands.append(shaded(extra_signals, extra_signals_sh_degree, False))
        widths[1] = bands[-1].shape[-1]
    if "D" in render_mode:
        bands.append(depths[..., None])
    values = torch.cat(bands, -1)
    flat = [t.reshape(-1, *t.shape[len(batch) + 1:]) for t in (means2d, conics, strength, values, depths, radii)]
    images, alphas = zip(*(composite(*(t[k] for t in flat), width, height) for k in range(len(flat[0]))))
    shape = (*batch, cameras, height, width)
    image, alpha = torch.stack(images).reshape(*shape, -1), torch.stack(alphas).reshape(*shape, 1)
    if backgrounds is not None and "RGB" in render_mode:
        grounds = torch.nn.functional.pad(backgrounds.double(), (0, image.shape[-1] - backgrounds.shape[-1]))
        image = image + (1 - alpha) * grounds[..., None, None, :]
    if "ED" in render_mode:
        image = torch.cat([image[..., :-1], image[..., -1:] / alpha.clamp_min(1e-10)], -1)
    own, extra = widths
    rest = torch.cat([image[..., :own], image[..., own + extra:]], -1)
    return rest.float(), alpha.float(), {"render_extra_signals": image[..., own:own + extra].float()}


gsplat.rasterization = gsplat.rendering.rasterization = rasterization
gsplat.rendering._rasterization = reference
gsplat.rendering.RenderMode = str
for name, test in (
    ("color", lambda mode: "RGB" in mode), ("depth_channel", lambda mode: mode != "RGB"),
    ("hit_distance", lambda mode: "d" in mode),
):
    setattr(gsplat.rendering, "render_mode_has_" + name, test)
for name in ("RendererConfig_MixedBatch", "RendererConfig_ParallelBatch"):
    setattr(gsplat.rendering, name, type(name, (), {}))
gsplat.strategy = sys.modules["gsplat.strategy"] = ubs.gsplat.strategy
gsplat.has_3dgs, gsplat.has_3dgut, gsplat.has_2dgs = lambda: True, lambda: False, lambda: False
gsplat.cuda._wrapper.quat_scale_to_covar_preci = _quat_scale_to_covar_preci
gsplat.cuda._wrapper.isect_tiles = ubs.gsplat.isect_tiles
gsplat.cuda._wrapper.isect_offset_encode = ubs.gsplat.isect_offset_encode


@pytest.fixture
def dist_init():
    pass
'''
PICTURE = r'''
import pathlib, sys
import numpy as np
import torch, ubs
from conftest import reference

file, folder, *views = sys.argv[1:]
header, rows = pathlib.Path(file).read_bytes().split(b"end_header\n", 1)
names = [line.split()[-1].decode() for line in header.splitlines() if line.startswith(b"property float ")]
table = torch.tensor(np.frombuffer(rows, "<f4").reshape(-1, len(names)).astype(np.float64))


def columns(begin):
    return table[:, [k for k, name in enumerate(names) if name.startswith(begin)]]


sh = torch.cat([columns("f_dc_")[..., None], columns("f_rest_").reshape(len(table), 3, -1)], -1).mT
degree = int(sh.shape[1] ** 0.5) - 1
means = torch.stack([table[:, names.index(axis)] for axis in "xyz"], -1)
splats = (means, columns("rot_"), columns("scale_").exp(), columns("opacity").sigmoid()[:, 0], sh)
data = ubs.Dataset.open(folder)
renderer = ubs.Renderer(ubs.Model.load(file), background=(0, 0, 0))
for number in map(int, views) if views else range(len(data.test)):
    camera = data.test[number].camera
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3] = torch.tensor(camera.world_to_camera)
    k = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=torch.float64)
    size = (camera.width, camera.height)
    exact = reference(*splats, pose[None], k[None], *size, sh_degree=degree)[0][0].double().numpy()
    difference = np.abs(renderer.render(camera).rgb - exact)
    psnr = -10 * np.log10((difference**2).mean())
    print(f"view {number}: PSNR {psnr:.2f} dB, largest difference {difference.max():.2e}", flush=True)
'''


def main(source: str, options: list[str]) -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "tests").mkdir()
        (folder / "conftest.py").write_text(CONFTEST % source)
        (folder / "tests" / "__init__.py").touch()
        (folder / "assets").symlink_to(pathlib.Path(source) / "assets")
        (folder / "tests" / "test_cameras.py").write_text("parse_lidar_camera = None\n")
        if options[:1] == ["--picture"]:
            model, *rest = options[1:]
            (folder / "picture.py").write_text(PICTURE)
            files = [str(pathlib.Path(name).resolve()) for name in (model, *rest[:1])]
            return subprocess.run([sys.executable, "picture.py", *files, *rest[1:]], cwd=folder).returncode
        worst = 0
        for test, chosen in TESTS.items():
            text = (pathlib.Path(source) / "tests" / test).read_text()
            for old, new in (
                ('"cuda:0"', '"cpu"'), ("torch.cuda.is_available()", "True"), ("10_000", "400"),
                ("not gsplat.has_3dgut()", "False"),  # otherwise, the test of lists of tiles would be skipped
            ):
                text = text.replace(old, new)
            (folder / "tests" / test).write_text(text)
            command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"tests/{test}", "-k", chosen]
            worst = max(worst, subprocess.run(command + options, cwd=folder).returncode)
        return worst


if __name__ == "__main__":
    source = os.environ.get("GSPLAT_SOURCE", "")
    if not (pathlib.Path(source) / "tests" / "test_basic.py").is_file():
        sys.exit("gsplat_tests.py: set GSPLAT_SOURCE to a checkout of https://github.com/nerfstudio-project/gsplat")
    sys.exit(main(str(pathlib.Path(source).resolve()), sys.argv[1:]))
