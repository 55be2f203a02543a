# SPDX-License-Identifier: Apache-2.0
"""Writes Gaussians to the files of other programs."""

from __future__ import annotations

import math
import os
import tempfile
from pathlib import Path
from typing import Any, Optional

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from .._errors import UsageError
from .._model import Model
from .._raster import scale_inverse

Array = npt.NDArray[Any]
SH0 = 0.28209479177387814  # the spherical harmonic of degree 0, sqrt(1 / (4 pi))
NAMES = ("xyz", "sh0", "sh_rest", "opacity", "scale", "rotation")
WRITERS = {"ply": "3dgs", "splat": "splat"}  # formats, and their names in Model.save()
CHUNK = 256  # number of splats that share bounds in compressed PLY files


def export_splats(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    opacities: Tensor,
    sh0: Tensor,
    shN: Tensor,
    format: str = "ply",
    save_to: "Optional[str | os.PathLike[str]]" = None,
) -> bytes:
    """Returns a file with these Gaussians, and writes it to the path `save_to`, if there is one. The values are those
    of trainers: means (N, 3), logarithms of scales (N, 3), quats (N, 4), opacities (N,) before the sigmoid, and
    coefficients of spherical harmonics sh0 (N, 1, 3) and shN (N, K, 3), where K is 0, 3, 8 or 15. Gaussians that
    cannot be rendered are omitted: their values are not finite, or their quats have the length 0. "ply" and "splat"
    also omit scales above e^40 and coefficients above 1e6.

    The formats are "ply", which other programs for 3D Gaussian Splatting read; "splat", which stores sh0 but not shN;
    and "ply_compressed", the compressed PLY format of SuperSplat, which does not store Gaussians whose opacity is at
    most 1/255. Quaternions are divided by their lengths. "ply" limits opacities before the sigmoid to the range from
    -16 to 16, and logarithms of scales to at least -39. "ply_compressed" limits the latter to the range from -20 to
    20."""
    if shN.dim() != 3:
        raise UsageError(f"shN has the shape {tuple(shN.shape)}, not (N, K, 3)")
    count, higher = len(means), shN.shape[1]
    given = {"means": means, "scales": scales, "quats": quats, "opacities": opacities, "sh0": sh0, "shN": shN}
    for (name, tensor), shape in zip(given.items(), ((3,), (3,), (4,), (), (1, 3), (higher, 3))):
        if tuple(tensor.shape) != (count, *shape):
            raise UsageError(f"{name} has the shape {tuple(tensor.shape)}, not {(count, *shape)}")
    if higher not in (0, 3, 8, 15):
        raise UsageError(f"shN has {higher} coefficients for each channel: there must be 0, 3, 8 or 15")
    if format not in WRITERS and format != "ply_compressed":
        raise UsageError(f"format={format!r} is not supported: choose one of 'ply', 'splat', 'ply_compressed'")
    rest = shN.transpose(1, 2).reshape(count, 3 * higher)  # the coefficients of each channel are stored together
    columns = (means, sh0[:, 0], rest, opacities[:, None], scales, quats)
    table = torch.cat([column.detach().cpu().float() for column in columns], 1)
    table = table[torch.isfinite(table).all(1) & (table[:, -4:] != 0).any(1)]
    if len(table) == 0:
        raise UsageError("there are no Gaussians with finite values, so no file is written")
    parts = dict(zip(NAMES, table.split([3, 3, 3 * higher, 1, 3, 4], 1)))
    turns = parts["rotation"].double()  # multiplied by powers of 2, so that no length is too small or too large
    parts["rotation"] = torch.ldexp(turns, -torch.frexp(turns.abs().amax(1, keepdim=True))[1]).float()
    if format == "ply_compressed":
        file = _compressed({name: part.double().numpy() for name, part in parts.items()})
        if save_to is not None:
            Path(save_to).write_bytes(file)
        return file
    colour = f"sh{math.isqrt(higher)}"
    model = Model.empty(3, len(table), kernel="gaussian", rot_mode="quaternion", colour=colour)
    parts["scale"] = scale_inverse(parts["scale"].double().clamp(-80, 80).exp())  # avoids 0 and infinity
    for name, values in model.parameters.items():
        values[...] = parts[name]
    with tempfile.TemporaryDirectory(prefix="ubs-") as folder:
        path = Path(folder) / "splats" if save_to is None else Path(save_to)
        model.save(path, WRITERS[format])
        return path.read_bytes()


def _compressed(parts: dict[str, Array]) -> bytes:
    """Returns a compressed PLY file of SuperSplat. It stores positions, logarithms of scales and colours relative to
    their bounds in chunks of 256 splats. `parts` contains float64 arrays (N, ...) with the names NAMES."""
    opacity = 1 / (1 + np.exp(-parts["opacity"].clip(-100, 100)))
    parts = {name: values[opacity[:, 0] > 1 / 255] for name, values in parts.items()}
    opacity = opacity[opacity > 1 / 255, None]
    if len(opacity) == 0 or len(parts["xyz"]) == 0:
        raise UsageError("all Gaussians have opacities of at most 1/255, so no file is written")
    order = _along_curve(parts["xyz"])
    parts, opacity = {name: values[order] for name, values in parts.items()}, opacity[order]
    count = len(order)
    chunks, starts = np.arange(count) // CHUNK, np.arange(0, count, CHUNK)
    bounds, shares = [], []
    for values in (parts["xyz"], parts["scale"].clip(-20, 20), parts["sh0"] * SH0 + 0.5):
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        bounds += [low, high]
        shares.append((values - low[chunks]) / np.where(high > low, high - low, 1)[chunks])
    turns = parts["rotation"] / np.linalg.norm(parts["rotation"], axis=1, keepdims=True)
    largest = np.abs(turns).argmax(1)
    turns *= np.where(turns[np.arange(count), largest] < 0, -1, 1)[:, None]
    others = turns[np.arange(4) != largest[:, None]].reshape(count, 3) * math.sqrt(0.5) + 0.5
    words = np.stack([
        _packed(shares[0], (11, 10, 11)),
        _packed(np.hstack([largest[:, None] / 3, others]), (2, 10, 10, 10)),
        _packed(shares[1], (11, 10, 11)),
        _packed(np.hstack([shares[2], opacity]), (8, 8, 8, 8)),
    ], 1)
    harmonics = ((parts["sh_rest"] / 8 + 0.5) * 256).clip(0, 255).astype(np.uint8)
    header = ["ply", "format binary_little_endian 1.0", f"element chunk {len(starts)}"]
    for what, axes in (("", "xyz"), ("scale_", "xyz"), ("", "rgb")):
        header += [f"property float {end}_{what}{axis}" for end in ("min", "max") for axis in axes]
    header += [f"element vertex {count}"]
    header += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    header += [f"element sh {count}"]
    header += [f"property uchar f_rest_{k}" for k in range(harmonics.shape[1])]
    rows = (np.hstack(bounds).astype("<f4"), words.astype("<u4"), harmonics)
    return b"".join(["\n".join([*header, "end_header\n"]).encode(), *(block.tobytes() for block in rows)])


def _packed(shares: Array, widths: tuple[int, ...]) -> Array:
    """Returns integers (N,) that contain numbers from 0 to 1 (N, k). The first number is in the highest bits."""
    words = np.zeros(len(shares), np.int64)
    for k, bits in enumerate(widths):
        words = words << bits | np.floor(shares[:, k] * (2**bits - 1) + 0.5).astype(np.int64)
    return words


def _along_curve(points: Array) -> Array:
    """Returns the order of points (N, 3) along a Morton curve, so that neighbours in space are in the same chunk."""
    low, high = points.min(0, initial=np.inf), points.max(0, initial=-np.inf)
    cells = ((points - low) / np.where(high > low, high - low, 1) * 1023).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(9, -1, -1):
        for axis in (2, 1, 0):
            codes = codes << 1 | cells[:, axis] >> bit & 1
    return codes.argsort(kind="stable")
