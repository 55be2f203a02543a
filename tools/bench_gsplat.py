#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how fast gsplat (from PyPI, with CUDA) or ubs.gsplat (on any device) renders a 3DGS file from the training
cameras of a NeRF Synthetic folder. Compare the results with those of `ubs-lab bench --model` for the same model, data
and device.

  ubs convert RUN model.ply --to 3dgs
  bench_gsplat.py model.ply LEGO --size 400
  bench_gsplat.py model.ply LEGO --size 400 --package ubs.gsplat --tensors cpu

Prints milliseconds per view, for the forward pass alone and for both passes. With tensors on the CPU, this is the
median of single views. With tensors on a GPU, it is the mean of many views without waiting between them, followed by
the median of single views, which is measured with CUDA events. For ubs.gsplat, it also prints how much of this time is
spent in the library, which waits for the device; the rest is work of PyTorch. Needs the Python packages torch and
numpy, and the package that is measured.
"""
import argparse
import importlib
import json
import math
import pathlib
import time

import numpy as np
import torch

# The arguments of rasterization() for each mode. With sh_degree None, the colours of the Gaussians are random.
MODES = {
    "plain": {}, "absgrad": {"absgrad": True}, "sparse_grad": {"sparse_grad": True}, "rgb": {"sh_degree": None},
    "antialiased": {"rasterize_mode": "antialiased"}, "depth": {"render_mode": "RGB+ED"}, "background": {},
    "8 channels": {"sh_degree": None}, "absgrad, depth": {"absgrad": True, "render_mode": "RGB+ED"},
}
CHANNELS = {"depth": 4, "8 channels": 8, "absgrad, depth": 4}  # in other modes, images have three channels
# Number of timed views with tensors on a GPU. With tensors on the CPU, an eighth of them is timed. The cameras are used
# in turn.
VIEWS = 400


def read_splats(path):
    """Returns {property: values} of a binary PLY file whose first element has only float properties."""
    with open(path, "rb") as file:
        names, count = [], 0
        while (line := file.readline().split()) != [b"end_header"]:
            if line[:2] == [b"element", b"vertex"]:
                count = int(line[2])
            elif line and line[0] == b"property":
                names.append(line[2].decode())
        values = np.frombuffer(file.read(4 * len(names) * count), "<f4").reshape(count, len(names))
    return {name: values[:, i] for i, name in enumerate(names)}


def cameras(folder, size, where):
    """Returns world-to-camera matrices (OpenCV axes) of the training views, and their intrinsics [px]."""
    data = json.loads((pathlib.Path(folder) / "transforms_train.json").read_text())
    focal = 0.5 * size / math.tan(0.5 * data["camera_angle_x"])
    intrinsics = torch.tensor([[[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]]], device=where)
    views = []
    for frame in data["frames"]:
        to_world = np.array(frame["transform_matrix"])
        to_world[:3, 1:3] *= -1  # from OpenGL axes
        views.append(torch.tensor(np.linalg.inv(to_world), device=where, dtype=torch.float32)[None])
    return views, intrinsics


def card_ms(draw):
    """Returns a string with the mean time of views that the GPU renders without a pause, and the median time of single
    views."""
    for _ in range(20):
        draw()
    torch.cuda.synchronize()
    start = time.perf_counter()
    for _ in range(VIEWS):
        draw()
    torch.cuda.synchronize()
    mean = (time.perf_counter() - start) / VIEWS * 1e3
    times = []
    for _ in range(VIEWS):
        begin, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
        begin.record()
        draw()
        end.record()
        end.synchronize()
        times.append(begin.elapsed_time(end))
    return f"{mean:.3f} ms (single views {np.median(times):.3f})"


def host_ms(draw):
    """Returns a string with the median time of single views."""
    times = []
    for k in range(5 + VIEWS // 8):
        start = time.perf_counter()
        draw()
        if k >= 5:
            times.append((time.perf_counter() - start) * 1e3)
    return f"{np.median(times):.2f} ms"


def library_ms(call):
    """Returns a string with the median time per call that is spent in the library of ubs, which waits for the device,
    and the median of the ratios of the whole time to this time."""
    from ubs import _abi
    original, times, ratios = _abi.call, [], []

    def timed(*arguments):
        start = time.perf_counter()
        original(*arguments)
        times[-1] += (time.perf_counter() - start) * 1e3

    _abi.call = timed
    for _ in range(VIEWS // 8):
        times.append(0)
        start = time.perf_counter()
        call()
        ratios.append((time.perf_counter() - start) * 1e3 / times[-1])
    _abi.call = original
    return f"{np.median(times):.2f} ms (ratio {np.median(ratios):.2f})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", help="3DGS file with harmonics of degree 3 (.ply)")
    parser.add_argument("data", help="NeRF Synthetic folder")
    parser.add_argument("--size", type=int, default=800, help="width and height of the images [px]")
    parser.add_argument("--package", choices=("gsplat", "ubs.gsplat"), default="gsplat")
    parser.add_argument("--tensors", choices=("cuda", "cpu"), default="cuda", help="device of PyTorch's tensors")
    parser.add_argument("--mode", choices=MODES, default="plain",
                        help="what is rendered, and which gradients are computed")
    args = parser.parse_args()
    rasterization = importlib.import_module(args.package).rasterization
    measured = card_ms if args.tensors == "cuda" else host_ms

    splats = read_splats(args.model)
    columns = lambda *names: torch.tensor(np.stack([splats[n] for n in names], -1), device=args.tensors)
    rest = columns(*[f"f_rest_{i}" for i in range(45)]).reshape(-1, 3, 15).transpose(1, 2)
    parameters = [
        columns("x", "y", "z"),
        columns("rot_0", "rot_1", "rot_2", "rot_3"),
        torch.exp(columns("scale_0", "scale_1", "scale_2")),
        torch.sigmoid(columns("opacity")[:, 0]),
        torch.cat([columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None], rest], 1).contiguous(),
    ]
    how, channels = {"sh_degree": 3, **MODES[args.mode]}, CHANNELS.get(args.mode, 3)
    if how["sh_degree"] is None:
        parameters[4] = torch.rand(len(parameters[0]), channels, device=args.tensors)
    if args.mode == "background":
        how["backgrounds"] = torch.rand(1, 3, device=args.tensors)
    for parameter in parameters:
        parameter.requires_grad_(True)
    views, intrinsics = cameras(args.data, args.size, args.tensors)
    v_image = torch.rand(1, args.size, args.size, channels, device=args.tensors)

    for packed in (True,) if args.mode == "sparse_grad" else (False, True):
        drawn = 0

        def draw():
            nonlocal drawn
            drawn += 1
            return rasterization(*parameters, views[drawn % len(views)], intrinsics, args.size, args.size,
                                 packed=packed, **how)[0]

        def forward():
            with torch.no_grad():
                draw()

        def both():
            for parameter in parameters:
                parameter.grad = None
            draw().backward(v_image)

        print(f"{args.package}, {len(splats['x'])} splats, {args.size}x{args.size}, packed={packed}: "
              f"forward {measured(forward)}, forward and backward {measured(both)}"
              + (f", of which the library {library_ms(both)}" if args.package == "ubs.gsplat" else ""))


if __name__ == "__main__":
    main()
