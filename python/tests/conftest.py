# SPDX-License-Identifier: Apache-2.0
"""Fixtures with a small data set, which `ubs` creates. UBS_EXECUTABLE and UBS_LAB_EXECUTABLE are the paths of `ubs` and
`ubs-lab`."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

# These tests do not repeat the comparison of the device with float64, which other tests make. They also ignore
# constants that were tuned for this machine, so that their results do not depend on it.
os.environ.setdefault("UBS_CHECK", "off")
os.environ["UBS_TUNING"] = "off"


def run_ubs(*arguments: object, program: str = "UBS_EXECUTABLE") -> None:
    subprocess.run([os.environ[program], *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "data"
    run_ubs("synth", "glossy", "--size", 40, "--views", 8, "--test-views", 2, "--supersampling", 1, "--out", path)
    return path
