# SPDX-License-Identifier: Apache-2.0
"""Trains models."""

from __future__ import annotations

import ctypes
import importlib
import math
import os
import signal
import sys
import threading
from dataclasses import dataclass
from typing import Any, Callable

import numpy as np
import numpy.typing as npt

from . import _abi
from ._data import Dataset, c_pointer
from ._device import DeviceLike, opened
from ._errors import UsageError
from ._model import Model
from ._settings import BOOLEANS, Settings


@dataclass(frozen=True)
class Step:
    """The progress of a training after an iteration: the number of finished iterations and of all iterations, the
    training time so far, and the number of splats. The loss and the metrics of the test views are None if they were not
    measured in this iteration."""

    iteration: int
    iterations: int
    seconds: float
    splats: int
    loss: float | None
    test_psnr: float | None
    test_ssim: float | None


@dataclass(frozen=True)
class Metrics:
    """Metrics of an image, or their means over several images (docs/metrics.md). Metrics that were not measured are
    None."""

    psnr: float
    psnr_joint: float
    ssim: float
    ssim_valid: float | None
    lpips_alex: float | None = None
    lpips_squeeze: float | None = None
    lpips_vgg: float | None = None
    lpips_alex_unit: float | None = None
    lpips_squeeze_unit: float | None = None
    lpips_vgg_unit: float | None = None


def known(value: float) -> float | None:
    return None if math.isnan(value) else value


def metrics_of(found: _abi.Metrics) -> Metrics:
    more = {name: known(getattr(found, name)) for name in _abi.METRICS[3:]}
    return Metrics(found.psnr, found.psnr_joint, found.ssim, **more)


def _step(c: _abi.Step) -> Step:
    return Step(
        c.iteration, c.iterations, c.seconds, c.splats, known(c.loss), known(c.test_psnr), known(c.test_ssim)
    )


class _Interrupt:
    """Records in `came` that Ctrl-C was pressed, instead of raising KeyboardInterrupt, because Python ignores
    exceptions that are raised in a callback from C. This is only done in the main thread, and only if the program has
    not installed another handler."""

    def __init__(self) -> None:
        self.came = False
        self._replaced = False

    def __enter__(self) -> _Interrupt:
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._note)
            self._replaced = True
        return self

    def _note(self, _number: int, _frame: Any) -> None:
        self.came = True

    def __exit__(self, *_: object) -> None:
        if self._replaced:
            signal.signal(signal.SIGINT, signal.default_int_handler)


OnStep = Callable[[Step], Any]


class Trainer(_abi.Handle):
    """A training that can be run in parts. `settings` are those of `ubs train`, by name. Settings that determine how
    data are read, such as background, must have the values that were passed to Dataset.open(). `spec` is a YAML file
    with settings, whose values are replaced by `settings`. `initial` is the initial model. If it is None, the initial
    model is created from the data."""

    def __init__(
        self,
        data: Dataset,
        *,
        device: DeviceLike = None,
        initial: Model | None = None,
        spec: str | None = None,
        **settings: Any,
    ) -> None:
        self._device = opened(device)
        chosen = Settings(settings, spec, use=_abi.USE_TRAINER)
        # Training reads images from files that may be deleted together with the data set, so keep the data set alive.
        self._data = data
        super().__init__("trainer", "trainer_create", self._device, data, chosen, initial)

    def __repr__(self) -> str:
        status = self.status
        return f"<ubs.Trainer: iteration {status.iteration} of {status.iterations}, {status.splats} splats>"

    def run(self, steps: int = 0, on_step: OnStep | None = None) -> None:
        """Trains for `steps` iterations, or for all remaining iterations if `steps` is 0. Calls `on_step` after each
        iteration. If `on_step` returns False, training stops after this iteration. If it raises an exception, training
        also stops, and run() raises this exception. Ctrl-C in the main thread stops training after the current
        iteration, and run() raises KeyboardInterrupt. In all these cases the trainer has the state of the last
        iteration, so it can be saved, and run() can continue."""
        if steps < 0:
            raise UsageError(f"steps = {steps}: pass a number of iterations, or 0 for all remaining ones")
        raised: list[BaseException] = []  # exceptions must not pass through C code

        with _Interrupt() as interrupt:

            def forward(_user: int, step: Any) -> int:
                try:
                    answer = None if on_step is None else on_step(_step(step.contents))
                    ended = isinstance(answer, BOOLEANS) and not answer
                    return 0 if ended or interrupt.came else 1
                except BaseException as error:
                    raised.append(error)
                    return 0

            try:
                _abi.call("trainer_run", self, steps, _abi.StepFunction(forward), None)
            finally:
                if raised:
                    raise raised[0]
        if interrupt.came:
            raise KeyboardInterrupt

    @property
    def status(self) -> Step:
        """The current progress. Its loss and metrics are None."""
        step = _abi.Step()
        _abi.call("trainer_get_status", self, ctypes.byref(step))
        return _step(step)

    @property
    def model(self) -> Model:
        """A copy of the current model."""
        return Model("trainer_get_model", self)

    def set_model(self, model: Model, source: npt.ArrayLike | None = None) -> None:
        """Replaces the splats during a training, for example to add or remove some between two calls of run(). The
        iteration, the cameras, the appearance and the background do not change. `model` must have the same dimension
        and variant. Its number of splats must not exceed cap_max, or the initial number if that is larger. `source`
        contains an integer for each splat of `model`: the index of the current splat whose optimiser state this splat
        continues with, or -1 for a new state. If `source` is None, all states are new."""
        taken = None
        if source is not None:
            taken = np.ascontiguousarray(source)
            if not np.issubdtype(taken.dtype, np.integer) or taken.shape != (len(model),):
                raise UsageError(f"source must be {len(model)} integers, not {taken.dtype} {taken.shape}")
            taken = taken.astype(np.int64)
        _abi.call("trainer_set_model", self, model, c_pointer(taken))

    def evaluate(self) -> Metrics:
        """Returns the mean metrics over the test views."""
        found = _abi.Metrics()
        _abi.call("trainer_evaluate", self, ctypes.byref(found))
        return metrics_of(found)

    def save(self, path: os.PathLike[str] | str) -> None:
        """Writes a checkpoint."""
        _abi.call("trainer_save", self, _abi.path_bytes(path))

    def restore(self, path: os.PathLike[str] | str) -> None:
        """Resumes from a checkpoint of the same data, settings and device. The result is bit-identical to that of an
        uninterrupted run."""
        _abi.call("trainer_restore", self, _abi.path_bytes(path))


def _progress() -> tuple[OnStep, Callable[[], None]] | None:
    """Returns two functions that update and close a progress bar of tqdm. Returns None if tqdm is not installed, or if
    stderr is not a terminal."""
    if not sys.stderr.isatty():
        return None
    try:
        bar = importlib.import_module("tqdm").tqdm(unit="step")
    except ImportError:
        return None

    def update(step: Step) -> None:
        bar.total = step.iterations
        if step.loss is not None:
            bar.set_postfix(loss=f"{step.loss:.4f}", splats=step.splats, refresh=False)
        bar.update(step.iteration - bar.n)

    return update, bar.close


def train(
    data: Dataset,
    *,
    device: DeviceLike = None,
    on_step: OnStep | None = None,
    initial: Model | None = None,
    spec: str | None = None,
    **settings: Any,
) -> Model:
    """Trains a model: ubs.train(data, dim=6, iterations=7000, device="cpu"). The settings are those of `ubs train`;
    ubs.settings() lists them. Use Trainer to run other code between iterations. As in the published method, gradients
    do not include the path through the view direction, unless query_grad is True.

    The schedule, which includes the growth of the number of splats, scales with the number of iterations. For example,
    a training of 200 iterations turns 500 initial splats into 12 000, and a training of 30 000 iterations turns them
    into 64 000. cap_max limits the number of splats, and refine="0:0:1" keeps it constant."""
    trainer = Trainer(data, device=device, initial=initial, spec=spec, **settings)
    progress = _progress() if on_step is None else None
    try:
        trainer.run(on_step=progress[0] if progress else on_step)
    finally:
        if progress:
            progress[1]()
    return trainer.model
