# SPDX-License-Identifier: Apache-2.0
"""Implements the command `ubs` that pip installs. It runs the executable that the package contains."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def main() -> None:
    program = Path(__file__).parent / "bin" / "ubs"
    if not program.exists():
        sys.exit("ubs: error: this package was built without the executable: build it with OpenCV, see docs/python.md")
    os.execv(program, ["ubs", *sys.argv[1:]])
