# SPDX-License-Identifier: Apache-2.0
"""The build backend of pyproject.toml. It calls scikit-build-core. In addition, it shows the progress of the
compilation on the terminal, because pip hides it."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import threading
from typing import Any, Iterator

from scikit_build_core import build as _backend
from scikit_build_core.build import *  # noqa: F403  the other hooks of PEP 517 and PEP 660


@contextlib.contextmanager
def _progress() -> Iterator[None]:
    """Forwards the standard output. If there is a terminal, also shows Ninja's progress there: for a line that starts
    with "[12/68]", it shows "ubs: step 12 of 68"."""
    try:
        terminal = open("/dev/tty", "w")
    except OSError:
        yield
        return
    sys.stdout.flush()
    output, (reading, writing) = os.dup(1), os.pipe()
    os.dup2(writing, 1)
    os.close(writing)

    def forward() -> None:
        with os.fdopen(reading, "rb") as lines, terminal:
            for line in lines:
                os.write(output, line)
                if done := re.match(rb"\[(\d+)/(\d+)\]", line):
                    terminal.write("\r\033[K  ubs: step {} of {}".format(*(int(n) for n in done.groups())))
                    terminal.flush()
            terminal.write("\r\033[K")

    thread = threading.Thread(target=forward)
    thread.start()
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(output, 1)  # closes the last descriptor that writes to the pipe, so the thread ends
        thread.join()
        os.close(output)


def build_wheel(*arguments: Any, **named: Any) -> str:
    with _progress():
        return _backend.build_wheel(*arguments, **named)


def build_editable(*arguments: Any, **named: Any) -> str:
    with _progress():
        return _backend.build_editable(*arguments, **named)
