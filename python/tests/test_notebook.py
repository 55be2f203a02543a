# SPDX-License-Identifier: Apache-2.0
"""Runs the cells of the notebook python/examples/first_scene.ipynb one after the other, like Jupyter."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

matplotlib = pytest.importorskip("matplotlib", reason="SKIPPED: matplotlib is not installed")


def test_the_notebook_runs() -> None:
    matplotlib.use("Agg")
    path = Path(__file__).parent.parent / "examples" / "first_scene.ipynb"
    names: dict[str, Any] = {"__name__": "notebook"}
    for number, cell in enumerate(json.loads(path.read_text())["cells"]):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{path.name}, cell {number}", "exec"), names)
    losses = [loss for _, loss in names["losses"]]
    assert len(losses) == 100
    assert losses[-1] < 0.2 * losses[0]  # on PoCL, the ratio of the losses is 0.093
    figures = [matplotlib.pyplot.figure(n) for n in matplotlib.pyplot.get_fignums()]
    assert sum(len(figure.axes) for figure in figures) >= 6
    assert abs(names["renderer"].camera_gradient().pose).max() > 0
