# SPDX-License-Identifier: Apache-2.0
"""Measures the overhead of a call of model.render: its time minus the time that the device needs for the same images.
`ubs eval` measures the time of the device with the device's own timers. Usage: python overhead.py MODEL DATA [REPEATS].
The environment variable UBS_EXECUTABLE must contain the path of `ubs`.

The program measures three kinds of calls. The first kind renders into a new array, so its time includes the page faults
of this array. The second kind renders into an existing array. The third kind leaves the image in the memory of the
device. The kinds are measured in turn. The time of a view is the minimum of several measurements, because other work on
the machine can only increase the times. The program prints the median over up to 20 views. With a model of one splat,
almost all of the time is overhead."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable

import ubs


def device_ms(model: str, data: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "eval.json"
        command = [os.environ["UBS_EXECUTABLE"], "eval", "--model", model, "--data", data, "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        return 1000.0 / float(json.loads(out.read_text())["frames"]["fps_device"])


def least_ms(call: Callable[[], object]) -> float:
    least = float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        call()
        least = min(least, 1000 * (time.perf_counter() - begin))
    return least


def main(arguments: list[str]) -> None:
    model, views = ubs.Model.load(arguments[0]), ubs.Dataset.open(arguments[1]).test[:20]
    new, reused, left = ([float("inf")] * len(views) for _ in range(3))
    devices, faults = [], 0
    repeats = int(arguments[2]) if len(arguments) > 2 else 5
    for _ in range(repeats):
        for number, view in enumerate(views):
            out = model.render(view.camera)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            new[number] = min(new[number], least_ms(lambda: model.render(view.camera)))
            faults += resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
            left[number] = min(left[number], least_ms(lambda: model.render(view.camera, copy=False)))
            reused[number] = min(reused[number], least_ms(lambda: model.render(view.camera, out=out)))
        devices.append(device_ms(*arguments[:2]))
    camera, device = views[0].camera, min(devices)
    print(f"{camera.width} x {camera.height}, {len(model)} splats, device {device:.3f} ms; overhead of a call:")
    for name, calls in (("new array", new), ("out=", reused), ("copy=False", left)):
        call = statistics.median(calls)
        print(f"  {name}: {call:.3f} - {device:.3f} = {call - device:.3f} ms")
    print(f"  page faults per call: {faults / (5 * repeats * len(views)):.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
