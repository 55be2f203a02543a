# SPDX-License-Identifier: Apache-2.0
"""What a call of model.render costs beyond the device's time for the same pictures, which `ubs eval` measures by the
device's own timers: python overhead.py MODEL DATA [REPEATS], with UBS_EXECUTABLE. By turns, because other work on the
machine changes both."""

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
    model.render(views[0].camera)
    rows = []
    for _ in range(int(arguments[2]) if len(arguments) > 2 else 5):
        medians = []
        for view in views:
            times = []
            for _ in range(5):
                begin = time.perf_counter()
                model.render(view.camera)
                times.append(1000 * (time.perf_counter() - begin))
            medians.append(statistics.median(times))
        rows.append((statistics.median(medians), device_ms(*arguments[:2])))
        print(f"model.render {rows[-1][0]:.3f} ms, device {rows[-1][1]:.3f} ms", flush=True)
    call, device = (statistics.median(column) for column in zip(*rows))
    camera = views[0].camera
    print(f"{camera.width} x {camera.height}, {len(model)} splats: {call:.3f} - {device:.3f} = {call - device:.3f} ms")


if __name__ == "__main__":
    main(sys.argv[1:])
