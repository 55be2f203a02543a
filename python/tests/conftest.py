# SPDX-License-Identifier: Apache-2.0
"""Fixtures with a small data set, which `ubs` creates. UBS_EXECUTABLE and UBS_LAB_EXECUTABLE are the paths of `ubs` and
`ubs-lab`."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

# Other tests compare devices with float64. Constants that were tuned on this machine must not be used.
os.environ.setdefault("UBS_CHECK", "off")
os.environ["UBS_TUNING"] = "off"


def run_ubs(*arguments: object, program: str = "UBS_EXECUTABLE") -> None:
    subprocess.run([os.environ[program], *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "data"
    run_ubs("synth", "glossy", "--size", 40, "--views", 8, "--test-views", 2, "--supersampling", 1, "--out", path)
    return path
