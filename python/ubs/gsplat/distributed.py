# SPDX-License-Identifier: Apache-2.0
"""The function that starts the trainers of gsplat. Here it always uses one process."""

from __future__ import annotations

import os
from typing import Any, Callable

from .._errors import UsageError
from .absent import refusing


def cli(fn: Callable[..., Any], args: Any, verbose: bool = False) -> bool:
    """Calls fn(0, 0, 1, args) in this process, and returns True. The first three arguments are the local rank, the
    world rank and the number of processes. Raises UsageError if mpirun or torchrun has started several processes.
    `verbose` has no effect."""
    for name in ("OMPI_COMM_WORLD_SIZE", "WORLD_SIZE"):
        if os.environ.get(name, "1") != "1":
            raise UsageError(
                f"{name}={os.environ[name]}, but ubs.gsplat runs in one process: start the script without mpirun and "
                "torchrun, or train on several machines with `ubs train`"
            )
    fn(0, 0, 1, args)
    return True


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
