# SPDX-License-Identifier: Apache-2.0
"""Trains models."""

from __future__ import annotations

import ctypes
import importlib
import math
import os
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt

from . import _abi
from ._data import Dataset, c_pointer
from ._device import Device, DeviceLike, opened
from ._errors import UsageError
from ._model import Model
from ._settings import BOOLEANS, Settings, values_of


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


_meters: dict[tuple[Device, str, str], _abi.Handle] = {}
_meters_lock = threading.Lock()


def meter_for(
    device: Device, networks: Sequence[str], weights: os.PathLike[str] | str | None
) -> _abi.Handle:
    """Returns the object that measures these LPIPS networks on this device. Creates it on first use."""
    if isinstance(networks, str):
        raise UsageError(f"networks must be a list of names, such as [{networks!r}], not a text")
    chosen = os.environ.get("UBS_LPIPS_WEIGHTS", "") if weights is None else os.fspath(weights)
    key = (device, ",".join(networks), str(chosen))
    with _meters_lock:
        if key not in _meters:
            file = None if weights is None else _abi.path_bytes(weights)
            _meters[key] = _abi.Handle("meter", "meter_create", device, key[1].encode(), file)
        return _meters[key]


def metrics_of(found: _abi.Metrics) -> Metrics:
    more = {name: known(getattr(found, name)) for name in _abi.METRICS[3:]}
    return Metrics(found.psnr, found.psnr_joint, found.ssim, **more)


def _step(c: _abi.Step) -> Step:
    return Step(
        c.iteration, c.iterations, c.seconds, c.splats, known(c.loss), known(c.test_psnr), known(c.test_ssim)
    )


OnStep = Callable[[Step], Any]
_PART = 0.05  # time of the iterations that the library makes at once, if nothing else limits their number, in seconds


class Trainer(_abi.Handle):
    """A training that can be run in parts. `settings` are those of `ubs train`, by name. Settings that determine how
    data are read, such as background, must have the values that were passed to Dataset.open(). `spec` is a YAML file
    with settings, whose values are replaced by `settings`. `initial` is the initial model. If it is None, the initial
    model is created from the data. Without `iterations` or `budget`, the length is 16 000 iterations or 15 minutes, as
    described at train(). With a time limit, the constructor measures some steps to choose the number of iterations."""

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
        self._running = threading.RLock()  # held by run()
        self._runs = False
        super().__init__("trainer", "trainer_create", self._device, data, chosen, initial)

    def __repr__(self) -> str:
        status = self.status
        return f"<ubs.Trainer: iteration {status.iteration} of {status.iterations}, {status.splats} splats>"

    def run(self, steps: int = 0, on_step: OnStep | None = None) -> None:
        """Trains for `steps` iterations, or for all remaining iterations if `steps` is 0. Calls `on_step` after each
        iteration. `on_step` may use the trainer, but not call run(). If `on_step` returns False, training stops after
        this iteration. If it raises an exception, training also stops, and run() raises this exception. The same is
        true for exceptions of signal handlers, which Python calls in the main thread: for example, Ctrl-C stops
        training after the current iteration, and run() raises KeyboardInterrupt. In all these cases the trainer has the
        state of the last iteration, so it can be saved, and run() can continue."""
        steps = _abi.integer(steps, "steps")
        if steps < 0:
            raise UsageError(f"steps = {steps}: pass a number of iterations, or 0 for all remaining ones")
        with self._running:
            if self._runs:
                raise UsageError("on_step cannot call run() of the trainer that calls it")
            self._runs = True
            try:
                self._run(steps, on_step)
            finally:
                self._runs = False

    def _run(self, steps: int, on_step: OnStep | None, pause: float = 0.0) -> None:
        """Runs one iteration after the other, so that no Python code runs inside of the library. Without `on_step`, or
        if it need not be called more often than every `pause` seconds, the library makes as many iterations at once as
        take about this time, or _PART."""
        step = self.status
        last = step.iteration + steps if steps > 0 else None
        part, wanted = 1, _PART if on_step is None else pause
        # A time budget changes step.iterations during the run.
        while (left := (step.iterations if last is None else min(last, step.iterations)) - step.iteration) > 0:
            begin = time.perf_counter()
            _abi.call("trainer_run", self, min(part, left), _abi.StepFunction(0), None)
            took = time.perf_counter() - begin
            if on_step is None:
                time.sleep(1e-4)  # other threads that wait for the device go first
            step = self.status
            if on_step is not None:
                answer = on_step(step)
                if isinstance(answer, BOOLEANS) and not answer:
                    break
                step = self.status  # on_step may have restored another state
            if wanted > 0:
                part = max(1, min(2 * part, int(part * wanted / max(took, 1e-6))))

    @property
    def status(self) -> Step:
        """The current progress. Its loss and metrics are those that the last iteration reported."""
        step = _abi.Step()
        _abi.call("trainer_get_status", self, ctypes.byref(step))
        return _step(step)

    @property
    def settings(self) -> dict[str, str]:
        """The settings with the values that were chosen for automatic ones, as in the config.yaml of `ubs train`."""
        return values_of(_abi.Handle("settings", "trainer_get_settings", self))

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

    def evaluate(
        self, *, networks: Sequence[str] = (), weights: os.PathLike[str] | str | None = None
    ) -> Metrics:
        """Returns the mean metrics over the test views that have an image. `networks` and `weights` are those of
        ubs.metrics.measure(): LPIPS takes much longer than the other metrics."""
        return self._evaluated(networks, weights)[0]

    def evaluate_views(
        self, *, networks: Sequence[str] = (), weights: os.PathLike[str] | str | None = None
    ) -> dict[str, Metrics]:
        """Returns the metrics of each test view that has an image, by the name of the view. The arguments are those of
        evaluate()."""
        names = [view.name for view in self._data.test if view.has_image]
        return dict(zip(names, self._evaluated(networks, weights)[1]))

    def _evaluated(
        self, networks: Sequence[str], weights: os.PathLike[str] | str | None
    ) -> tuple[Metrics, list[Metrics]]:
        meter = meter_for(self._device, networks, weights) if networks else None
        count = sum(view.has_image for view in self._data.test)
        mean, views = _abi.Metrics(), (_abi.Metrics * count)(*(_abi.Metrics() for _ in range(count)))
        _abi.call("trainer_evaluate_views", self, meter, ctypes.byref(mean), count, views)
        return metrics_of(mean), [metrics_of(view) for view in views]

    def save(self, path: os.PathLike[str] | str) -> None:
        """Writes a checkpoint."""
        _abi.call("trainer_save", self, _abi.path_bytes(path))

    def restore(self, path: os.PathLike[str] | str) -> None:
        """Resumes from a checkpoint of the same data, settings and device. The result is bit-identical to that of an
        uninterrupted run."""
        _abi.call("trainer_restore", self, _abi.path_bytes(path))


class _Lines:
    """Reports the progress of a training in lines of text: at each tenth of the iterations, and at least every
    minute."""

    def __init__(self) -> None:
        self._tenths, self._time = 0, time.monotonic()
        self._print("preparing the training")

    def _print(self, text: str) -> None:
        print(f"ubs: {text}", file=sys.stderr, flush=True)

    def update(self, step: Step) -> None:
        tenths, now = 10 * step.iteration // max(step.iterations, 1), time.monotonic()
        if tenths > self._tenths or now > self._time + 60:
            self._tenths, self._time = tenths, now
            loss = "" if step.loss is None else f", loss {step.loss:.4f}"
            self._print(
                f"iteration {step.iteration} of {step.iterations}, {step.seconds:.1f} s, {step.splats} splats{loss}"
            )

    def close(self) -> None:
        pass


class _Bar:
    """Shows the progress of a training with a progress bar of tqdm."""

    def __init__(self, tqdm: Any) -> None:
        self._bar = tqdm(unit="step", desc="preparing")

    def update(self, step: Step) -> None:
        self._bar.total = step.iterations
        self._bar.set_description(None, refresh=False)
        if step.loss is not None:
            self._bar.set_postfix(loss=f"{step.loss:.4f}", splats=step.splats, refresh=False)
        self._bar.update(step.iteration - self._bar.n)

    def close(self) -> None:
        self._bar.close()


def _progress() -> _Bar | _Lines:
    """Returns a progress bar if tqdm is installed, and if there is a terminal or a notebook that can show it. Otherwise
    returns an object that prints lines, for logs."""
    if "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty()):
        try:
            return _Bar(importlib.import_module("tqdm.auto").tqdm)
        except ImportError:
            pass
    return _Lines()


def train(
    data: Dataset,
    *,
    device: DeviceLike = None,
    on_step: OnStep | None = None,
    initial: Model | None = None,
    spec: str | None = None,
    **settings: Any,
) -> Model:
    """Trains a model: ubs.train(data, iterations=7000, device="cpu"). The settings are those of `ubs train`, with the
    same defaults; ubs.settings() lists them. Use Trainer to run other code between iterations. As in the published
    method, gradients do not include the path through the view direction, unless query_grad is True.

    The length is a number of iterations, or a time: ubs.train(data, budget="2m"). Without either, training takes 16 000
    iterations or 15 minutes, whichever ends first. With schedule="published" it takes 30 000 iterations, with the
    published learning rates.

    Without `on_step`, reports the progress on stderr: with a progress bar of tqdm in terminals and notebooks, if tqdm
    is installed, and otherwise with lines of text.

    If an exception ends the training, for example KeyboardInterrupt after Ctrl-C, or an exception of `on_step`, it has
    the attribute `trainer`, unless the training was still being prepared. This is the Trainer: its `model` is the model
    so far, and its run() continues the training. In a notebook: sys.last_value.trainer.model.

    The number of splats grows until half of the training is done. It then reaches cap_max, which by default is 12 times
    the number of iterations, but at least 10 000 and at most 300 000: a training of 200 iterations ends with 10 000
    splats, and a training of 7000 iterations with 84 000. If there are more initial points, cap_max is their number, up
    to 40 times the number of iterations. refine="0:0:1" keeps the number of splats constant. With
    schedule="published", cap_max is 300 000, and the number grows by 2 % at each of 244 refinements."""
    progress = _progress() if on_step is None else None
    try:
        trainer = Trainer(data, device=device, initial=initial, spec=spec, **settings)
        try:
            if progress is None:
                trainer.run(on_step=on_step)
            else:
                trainer._run(0, progress.update, pause=_PART)
        except BaseException as error:
            error.trainer = trainer  # type: ignore[attr-defined]
            if hasattr(error, "add_note"):
                error.add_note("the model so far is in the attribute trainer.model of this exception")
            raise
    finally:
        if progress is not None:
            progress.close()
    return trainer.model
