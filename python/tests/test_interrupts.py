# SPDX-License-Identifier: Apache-2.0
"""Tests what happens when a program is interrupted while the library works: exceptions of signal handlers, Ctrl-C, and
the end of the interpreter. Also tests that several threads may use the package for the first time."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Callable, Iterator

import pytest

import ubs
from ubs import _abi

SETTINGS: dict[str, Any] = {"iterations": 60, "init_points": 300, "cap_max": 400, "dim": 6, "log_every": 5}
LONG: dict[str, Any] = {**SETTINGS, "schedule": "published", "iterations": 100_000}


@pytest.fixture(scope="module")
def data(folder: Path) -> ubs.Dataset:
    return ubs.Dataset.open(folder)


class Timeout(Exception):
    pass


@pytest.fixture
def alarm() -> Iterator[None]:
    """Makes SIGALRM raise Timeout, as programs do that limit the time of a function."""

    def handler(*_: Any) -> None:
        raise Timeout

    before = signal.signal(signal.SIGALRM, handler)
    yield
    signal.signal(signal.SIGALRM, before)


def send_when(number: int, ready: Callable[[], bool]) -> threading.Thread:
    """Sends a signal to this process as soon as `ready` returns True."""

    def wait() -> None:
        while not ready():
            pass
        os.kill(os.getpid(), number)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("on_step", [None, lambda step: None])
def test_exceptions_of_signal_handlers_end_a_training(
    data: ubs.Dataset, alarm: None, on_step: Callable[[ubs.Step], Any] | None
) -> None:
    trainer = ubs.Trainer(data, **LONG)
    sender = send_when(signal.SIGALRM, lambda: trainer.status.iteration > 3)
    with pytest.raises(Timeout):
        trainer.run(on_step=on_step)
    sender.join()
    reached = trainer.status.iteration
    assert 3 < reached < 100_000
    trainer.run(2)  # the state is whole
    assert trainer.status.iteration == reached + 2


def test_ctrl_c_ends_a_training_in_asyncio(data: ubs.Dataset) -> None:
    """In Python 3.11 and later, the first Ctrl-C asks the task to end, and the second one raises KeyboardInterrupt."""
    trainer = ubs.Trainer(data, **LONG)
    ended = threading.Event()
    tasks: list[Any] = []

    def send() -> None:
        while trainer.status.iteration <= 3:
            pass
        os.kill(os.getpid(), signal.SIGINT)
        # If the second signal came before the handler of the first one has run, there would be only one call of it.
        while not ended.is_set() and not tasks[0].cancelling():
            pass
        if not ended.is_set():
            os.kill(os.getpid(), signal.SIGINT)

    async def main() -> None:
        tasks.append(asyncio.current_task())
        try:
            trainer.run()
        finally:
            ended.set()

    sender = threading.Thread(target=send)
    sender.start()
    with pytest.raises(KeyboardInterrupt):
        asyncio.run(main())
    sender.join()
    assert 3 < trainer.status.iteration < 100_000


def test_ctrl_c_ends_a_synthesis(tmp_path: Path) -> None:
    """The scene is so large that its images would take minutes."""
    sender = send_when(signal.SIGINT, lambda: (tmp_path / "scene" / "train").exists())
    with pytest.raises(KeyboardInterrupt):
        ubs.synth("glossy", size=1000, views=50, supersampling=5, out=tmp_path / "scene")
    sender.join()
    wait_for_calls()
    assert not (tmp_path / "scene" / "transforms_train.json").exists()


def wait_for_calls() -> None:
    """Waits until the calls have ended that continue in other threads after an interruption."""
    with _abi._idle:
        _abi._idle.wait_for(lambda: _abi._calls == 0)


@pytest.mark.parametrize("name", ["trainer_create", "data_open", "device_open"])
def test_ctrl_c_is_served_while_the_library_works(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Replaces a function of the library by one that ends only after Ctrl-C has been served. Earlier versions would
    wait for it forever."""
    data = ubs.Dataset.open(folder)
    ubs.devices()
    began, served = threading.Event(), threading.Event()
    original = _abi._functions[name]

    def slow(*arguments: Any) -> int:
        began.set()
        served.wait()
        return int(original(*arguments))

    monkeypatch.setitem(_abi._functions, name, slow)
    monkeypatch.setattr(_abi, "_PATIENCE", 0.01)
    sender = send_when(signal.SIGINT, began.is_set)
    calls: dict[str, Callable[[], Any]] = {
        "trainer_create": lambda: ubs.Trainer(data, **SETTINGS),
        "data_open": lambda: ubs.Dataset.open(folder),
        "device_open": lambda: ubs.Device(),
    }
    with pytest.raises(KeyboardInterrupt):
        calls[name]()
    sender.join()
    served.set()
    wait_for_calls()  # the call ends, and its result is freed


def test_calls_that_create_objects_can_be_stopped(folder: Path) -> None:
    """Tests that the library ends such a call when it is asked to stop."""
    stop = _abi.c_int32(1)
    _abi._library.ubs_set_stop_flag(_abi.ctypes.byref(stop))
    try:
        with pytest.raises(ubs.Error, match="stopped by the caller"):
            _abi._call_now("data_open", (os.fsencode(folder), None, _abi.c_void_p()))
    finally:
        _abi._library.ubs_set_stop_flag(None)
    assert len(ubs.Dataset.open(folder)) == 10


def test_the_trainer_can_be_used_in_on_step(data: ubs.Dataset, tmp_path: Path) -> None:
    trainer, found = ubs.Trainer(data, **SETTINGS), []

    def on_step(step: ubs.Step) -> bool:
        found.append((step, trainer.status, trainer.evaluate()))
        trainer.save(tmp_path / "checkpoint.ubs")
        trainer.set_model(trainer.model)
        with pytest.raises(ubs.UsageError, match="on_step cannot call run()"):
            trainer.run(1)
        return step.iteration < 5

    trainer.run(on_step=on_step)
    step, status, metrics = found[4]
    assert len(found) == 5 and step == status and step.loss is not None and metrics.psnr > 0
    trainer.restore(tmp_path / "checkpoint.ubs")
    assert trainer.status.iteration == 5


def test_an_exception_in_train_keeps_the_model(data: ubs.Dataset) -> None:
    with pytest.raises(ZeroDivisionError) as error:
        ubs.train(data, **SETTINGS, on_step=lambda step: 1 // (59 - step.iteration))
    trainer = error.value.trainer  # type: ignore[attr-defined]
    assert trainer.status.iteration == 59 and len(trainer.model) > 0
    trainer.run()
    expected = ubs.train(data, **SETTINGS).parameters["xyz"]
    assert (trainer.model.parameters["xyz"] == expected).all()


def test_ctrl_c_in_train_keeps_the_model(data: ubs.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    began = threading.Event()
    original = ubs._training._Lines.update
    monkeypatch.setattr(ubs._training._Lines, "update", lambda *a: (original(*a), began.set()))
    sender = send_when(signal.SIGINT, began.is_set)
    with pytest.raises(KeyboardInterrupt) as error:
        ubs.train(data, **LONG)
    sender.join()
    trainer = error.value.trainer  # type: ignore[attr-defined]
    assert 0 < trainer.status.iteration < 100_000 and len(trainer.model) > 0


def test_progress_is_printed_in_logs(
    data: ubs.Dataset, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = ubs.train(data, **SETTINGS)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "ubs: preparing the training"
    assert re.fullmatch(rf"ubs: iteration 60 of 60, .* s, {len(model)} splats, loss 0\.\d+", lines[-1])
    ubs.train(data, **SETTINGS, on_step=lambda step: None)
    assert capsys.readouterr().err == ""


def test_progress_is_a_bar_in_terminals_and_notebooks(
    data: ubs.Dataset, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Uses a module in the place of tqdm, which need not be installed."""

    class Bar:
        def __init__(self, **options: Any) -> None:
            self.n, self.total, self.closed, self.options = 0, None, False, options
            bars.append(self)

        def update(self, steps: int) -> None:
            self.n += steps

        def set_description(self, *_: Any, **__: Any) -> None:
            pass

        set_postfix = set_description

        def close(self) -> None:
            self.closed = True

    bars: list[Bar] = []
    module = type(sys)("tqdm.auto")
    module.tqdm = Bar  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "tqdm.auto", module)
    monkeypatch.setitem(sys.modules, "tqdm", type(sys)("tqdm"))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    ubs.train(data, **SETTINGS)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    monkeypatch.setitem(sys.modules, "ipykernel", type(sys)("ipykernel"))
    ubs.train(data, **SETTINGS)
    assert [(bar.n, bar.total, bar.closed) for bar in bars] == [(60, 60, True)] * 2
    assert capsys.readouterr().err == ""


def run_python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    text = f"import os, signal, threading, ubs\ndata = ubs.Dataset.open({str(folder)!r})\n"
    text += f"settings = {LONG!r}\n" + code
    return subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)


@pytest.mark.parametrize("with_on_step", [False, True])
def test_a_program_may_end_while_a_thread_trains(folder: Path, with_on_step: bool) -> None:
    argument = "lambda step: began.set()" if with_on_step else "None"
    run = run_python(
        f"""
began = threading.Event()
trainer = ubs.Trainer(data, **settings)
threading.Thread(target=lambda: trainer.run(on_step={argument}), daemon=True).start()
if {with_on_step}:
    began.wait()
else:
    while trainer.status.iteration == 0: pass
""", folder)
    assert (run.returncode, run.stderr) == (0, "")


def test_a_program_may_end_while_threads_render(folder: Path) -> None:
    run = run_python(
        """
model, camera = ubs.Model.initial(data, dim=6), data.test[0].camera
began = [threading.Event() for _ in range(3)]
def render(event):
    while True:
        model.copy().render(camera)
        event.set()
for event in began:
    threading.Thread(target=render, args=(event,), daemon=True).start()
for event in began:
    event.wait()
""", folder)
    assert (run.returncode, run.stderr) == (0, "")


def test_ctrl_c_ends_a_program_with_the_usual_status(folder: Path) -> None:
    run = run_python(
        """
trainer = ubs.Trainer(data, **settings)
def send():
    while trainer.status.iteration == 0: pass
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=send).start()
trainer.run()
""", folder)
    assert run.returncode == -signal.SIGINT and run.stderr.endswith("KeyboardInterrupt\n")


def test_objects_may_render_while_the_interpreter_ends(folder: Path) -> None:
    run = run_python(
        """
class Last:
    def __init__(self): self.model, self.camera = ubs.Model.initial(data, dim=6), data.test[0].camera
    def __del__(self): os.write(1, str(self.model.render(self.camera).shape).encode())
last = Last()
last.model.render(last.camera)
last.cycle = last
""", folder)
    assert (run.returncode, run.stdout, run.stderr) == (0, "(40, 40, 3)", "")


def test_threads_get_one_device_for_one_request() -> None:
    """Tests that what is created at the first use is created once if several threads use it first at the same time: the
    device of a request, the renderer of a model, the object that compares images, and the renderer of functions."""
    run = subprocess.run([sys.executable, "-c", """
import collections, threading
import numpy as np
import ubs
from ubs import _abi
try:
    import torch, ubs.torch
except ImportError:
    torch = None
meeting = threading.Barrier(6)
calls = collections.Counter()
def count(name):
    original = _abi._functions[name]
    def counted(*arguments):
        calls[name] += 1
        return original(*arguments)
    _abi._functions[name] = counted
for name in ("device_open", "meter_create", "renderer_create_falloff"):
    count(name)
model, image = ubs.Model.empty(3, 5), np.zeros((16, 16, 3))
camera = ubs.Camera.from_matrix(np.eye(4), (16, 16, 8, 8), 16, 16)
found = []
def work():
    meeting.wait()
    renderer = model.renderer()
    found.append((renderer.device, renderer))
    meeting.wait()
    assert ubs.metrics.psnr(image, image) == np.inf
    meeting.wait()
    if torch:
        ubs.torch.render({k: torch.from_numpy(v.copy()) for k, v in model.parameters.items()}, camera, dim=3)
threads = [threading.Thread(target=work) for _ in range(6)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert len(set(found)) == 1 and len(found) == 6
expected = {"device_open": 1, "meter_create": 1, "renderer_create_falloff": 1 if torch is None else 3}
# ubs.torch creates a renderer for one splat, and another one for the five splats
assert calls == expected, calls
"""], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
