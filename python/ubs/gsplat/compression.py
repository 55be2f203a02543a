# SPDX-License-Identifier: Apache-2.0
"""PngCompression can be imported, but is refused when it is created (absent.py)."""

from typing import Any

from .absent import refusing


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
