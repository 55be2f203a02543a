# SPDX-License-Identifier: Apache-2.0
"""What a call of model.render costs beyond the device's time for the same pictures, which `ubs eval` measures by the
device's own timers: python overhead.py MODEL DATA [REPEATS], with UBS_EXECUTABLE. By turns, and the least of several,
because other work on the machine adds to both."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import ubs


def device_ms(model: str, data: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "eval.json"
        command = [os.environ["UBS_EXECUTABLE"], "eval", "--model", model, "--data", data, "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        return 1000.0 / float(json.loads(out.read_text())["frames"]["fps_device"])


def main(arguments: list[str]) -> None:
    model, views = ubs.Model.load(arguments[0]), ubs.Dataset.open(arguments[1]).test[:20]
    least, devices = [float("inf")] * len(views), []
    for _ in range(int(arguments[2]) if len(arguments) > 2 else 5):
        for number, view in enumerate(views):
            for _ in range(5):
                begin = time.perf_counter()
                model.render(view.camera)
                least[number] = min(least[number], 1000 * (time.perf_counter() - begin))
        devices.append(device_ms(*arguments[:2]))
    call, device = statistics.median(least), min(devices)
    camera = views[0].camera
    print(f"{camera.width} x {camera.height}, {len(model)} splats: {call:.3f} - {device:.3f} = {call - device:.3f} ms")


if __name__ == "__main__":
    main(sys.argv[1:])
