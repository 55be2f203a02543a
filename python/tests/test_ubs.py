# SPDX-License-Identifier: Apache-2.0
"""Compares the package with the executable: the same settings must give bit-identical results. Also tests the
guarantees that only the package makes, for example about copies, threads and exceptions."""

from __future__ import annotations

import base64
import copy
import ctypes
import gc
import io
import json
import multiprocessing
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ubs
from conftest import run_ubs
from ubs._settings import as_text

SETTINGS = {"schedule": "published", "iterations": 60, "init_points": 300, "cap_max": 400, "dim": 6, "log_every": 5}


@pytest.fixture(scope="module")
def data(folder: Path) -> ubs.Dataset:
    return ubs.Dataset.open(folder)


@pytest.fixture(scope="module")
def model(data: ubs.Dataset) -> ubs.Model:
    return ubs.train(data, **SETTINGS)


def test_training_gives_the_bits_of_the_executable(folder: Path, model: ubs.Model, tmp_path: Path) -> None:
    options = [part for key, value in SETTINGS.items() for part in ("--set", f"{key}={value}")]
    run_ubs("train", "--quiet", "--data", folder, "--out", tmp_path / "run", *options)
    model.save(tmp_path / "model.ply")
    expected = (tmp_path / "run" / "model.ply").read_bytes()
    assert len(expected) > 10000
    assert (tmp_path / "model.ply").read_bytes() == expected
    loaded = ubs.Model.load(tmp_path / "run")
    for name, values in model.parameters.items():
        assert np.array_equal(loaded.parameters[name], values)
        assert values.dtype == np.float32 and len(values) == len(model)


def test_extension_chooses_the_format_in_capitals_too(model: ubs.Model, tmp_path: Path) -> None:
    """Tests that an extension in capital letters also selects the format of a file."""
    model.save(tmp_path / "MODEL.SPZ")
    assert (tmp_path / "MODEL.SPZ").read_bytes()[:2] == b"\x1f\x8b"


def test_pictures_and_gradients_are_those_of_the_executable(
    folder: Path, data: ubs.Dataset, model: ubs.Model, tmp_path: Path
) -> None:
    model.save(tmp_path / "model.ply")
    common = ["--model", tmp_path / "model.ply", "--data", folder]
    run_ubs("render", "--format", "npy", "--channels", "rgb,alpha,depth", "--out", tmp_path / "views", *common)
    renderer = ubs.Renderer(model, depth=True)
    for view in data.test:
        image = renderer.render(view.camera)
        stem = tmp_path / "views" / view.name
        assert f"{len(model)} splats on <ubs.Device" in repr(renderer)
        assert np.array_equal(np.load(f"{stem}.npy"), image.rgb)
        assert np.array_equal(np.load(f"{stem}_alpha.npy").reshape(image.alpha.shape), image.alpha)
        assert image.depth is not None
        assert np.array_equal(np.load(f"{stem}_depth.npy").reshape(image.depth.shape), image.depth)
        assert np.array_equal(model.render(view.camera), image.rgb)
        room = np.full_like(image.rgb, 9)
        assert model.render(view.camera, out=room) is room and np.array_equal(room, image.rgb)
        assert image.rgb.std() > 0.01
    options = ["--view", 1, "--set", "query_grad=true", "--out", tmp_path / "gradient.ply"]
    run_ubs("gradients", *options, *common, program="UBS_LAB_EXECUTABLE")
    expected = ubs.Model.load(tmp_path / "gradient.ply").parameters
    found, gradient = ubs.loss(model, data.test[1].camera, data.test[1].image)
    assert found.loss == pytest.approx(0.8 * found.l1 + 0.2 * (1 - found.ssim), rel=1e-6)
    assert set(gradient) == set(expected)
    for name, values in gradient.items():
        assert np.array_equal(values, expected[name])
        assert np.abs(values).max() > 0


def test_a_picture_can_be_seen_where_it_was_drawn(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that arrays of a renderer can be read and written in the memory of the device, without a copy."""
    renderer, camera = ubs.Renderer(model), data.test[0].camera
    renderer.draw(camera)
    try:
        seen = np.asarray(renderer.array("rgb"))
    except ubs.UsageError:
        pytest.skip("SKIPPED: the device does not provide addresses of its memory")
    assert seen.__array_interface__["data"][0] == renderer.array("rgb").address
    picture = renderer.render(camera).rgb
    assert np.array_equal(seen, picture)
    assert np.array_equal(model.render(camera, copy=False), picture)
    assert np.array_equal(model.render(camera, time=0.5, copy=False), model.render(camera, time=0.5))
    with pytest.raises(ubs.UsageError, match=re.escape('not the last array("v_rgb") of this renderer')):
        ubs.Renderer(model, gradients=True).vjp(camera, renderer.array("rgb"))
    with pytest.raises(ubs.UsageError, match=re.escape('not the last array("v_alpha") of this renderer')):
        ubs.Renderer(model, gradients=True).vjp(camera, None, renderer.array("transmittance"))
    np.asarray(renderer.array("parameters"))[:3] += 1  # in place
    assert not np.array_equal(renderer.render(camera).rgb, picture)


def test_vjp_of_colours_and_alpha_is_linear(data: ubs.Dataset, model: ubs.Model) -> None:
    camera = data.test[0].camera
    random = np.random.default_rng(1)
    v_rgb = random.normal(size=(camera.height, camera.width, 3)).astype(np.float32)
    v_alpha = random.normal(size=(camera.height, camera.width)).astype(np.float32)
    both, rgb, alpha = (
        ubs.vjp(model, camera, a, b) for a, b in ((v_rgb, v_alpha), (v_rgb, None), (None, v_alpha))
    )
    for name in both:
        error = np.linalg.norm(both[name] - rgb[name] - alpha[name])
        assert error <= 1e-4 * np.linalg.norm(both[name])
    assert np.abs(alpha["opacity"]).max() > 0
    assert np.abs(alpha["rgb"]).max() < 1e-6
    # A fraction of the gradient of alpha becomes the gradient of a colour, and a later step divides by it, so it must not
    # underflow.
    tiny = ubs.vjp(model, camera, None, v_alpha * np.float32(1e-33))
    for name in ("opacity", "xyz"):
        error = np.linalg.norm(tiny[name] * np.float64(1e33) - alpha[name]) / np.linalg.norm(alpha[name])
        assert error <= 1e-3
    for values in ubs.vjp(model, camera, None, np.full_like(v_alpha, 1e-36)).values():
        assert np.isfinite(values).all()


def test_data_from_arrays(data: ubs.Dataset, model: ubs.Model) -> None:
    views = [*data.train, *data.test]
    first = views[0].camera
    made = ubs.Dataset.from_arrays(
        [view.image for view in views],
        np.stack([view.camera.world_to_camera for view in views]),
        (first.fx, first.fy, first.cx, first.cy),
        test=[8, 9],
    )
    assert [len(made.train), len(made.test)] == [8, 2]
    assert np.array_equal(made.test[1].image, data.test[1].image)
    # Images that are given as arrays are opaque, but the images of `data` have transparent pixels. Both settings are
    # given explicitly, because their automatic values depend on this.
    trained = ubs.train(made, **SETTINGS, background=(0, 0, 0), random_background="off")
    for name, values in trained.parameters.items():
        assert np.array_equal(values, model.parameters[name])
    floating = ubs.Dataset.from_arrays(
        [view.image / 255 for view in views],
        np.stack([view.camera.world_to_camera for view in views]),
        [[first.fx, 0, first.cx], [0, first.fy, first.cy], [0, 0, 1]],
        times=np.linspace(0, 1, 10),
        masks=[np.ones((40, 40)) for _ in views],
        points=[[0, 0, 0], [1, 0, 0]],
    )
    assert np.array_equal(floating.train[3].image, data.train[3].image)
    assert floating.train[1].has_mask and floating.train[1].mask.min() == 255
    assert floating.train[9].camera.time == 1
    assert len(ubs.Model.initial(floating, dim=7)) == 2


def test_written_parameters_are_drawn(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that a render uses the new values after parameters of a model were changed."""
    camera = data.test[0].camera
    other = model.copy()
    before = other.render(camera)
    values = other.parameters
    values["rgb"][:] += 0.3
    after = other.render(camera)
    assert not np.array_equal(before, after)
    values["rgb"][:] -= 0.3
    values["xyz"][:] = model.parameters["xyz"]
    assert not np.array_equal(other.render(camera), after)
    assert np.array_equal(model.render(camera), before)
    other.parameters["rgb"] = np.zeros_like(values["rgb"])  # earlier versions ignored such an assignment
    assert not other.parameters["rgb"].any() and not values["rgb"].any()
    assert np.array_equal(other.render(camera), other.copy().render(camera))
    for name, wrong in (("rgb", np.zeros((1, 3))), ("colour", np.zeros(3))):
        with pytest.raises(ubs.UsageError, match=name):
            other.parameters[name] = wrong
    assert "xyz" in repr(values) and len(values) == len(list(values))
    kept = model.copy().parameters["xyz"]
    gc.collect()
    assert np.array_equal(kept, model.parameters["xyz"])


def test_training_in_parts(data: ubs.Dataset, model: ubs.Model, tmp_path: Path) -> None:
    steps: list[ubs.Step] = []
    trainer = ubs.Trainer(data, **SETTINGS)
    trainer.run(on_step=lambda step: (steps.append(step), step.iteration < 7)[1])
    assert repr(trainer).startswith("<ubs.Trainer: iteration 7 of 60, ")
    assert trainer.status.iteration == len(steps) == 7
    assert steps[0].loss is None and steps[4].loss is not None
    with pytest.raises(ZeroDivisionError):
        trainer.run(on_step=lambda step: 1 // 0)
    trainer.run(np.int64(5), lambda step: np.bool_(step.iteration < 10))
    assert trainer.status.iteration == 10
    trainer.run(np.int64(2), lambda step: None)
    trainer.run(1, lambda step: np.bool_(True))
    trainer.save(tmp_path / "checkpoint.ubs")
    again = ubs.Trainer(data, **SETTINGS)
    again.restore(tmp_path / "checkpoint.ubs")
    assert again.status.iteration == 13
    again.run()
    for name, values in again.model.parameters.items():
        assert np.array_equal(values, model.parameters[name])
    assert again.evaluate().psnr > 5
    with pytest.raises(ubs.UsageError, match="lambda_dssim"):
        ubs.Trainer(data, **SETTINGS, lambda_dssim=0.5).restore(tmp_path / "checkpoint.ubs")


def test_splats_can_be_replaced_in_training(data: ubs.Dataset, tmp_path: Path) -> None:
    settings = {**SETTINGS, "refine": "0:0:1", "unit": 1, "noise_lr": 0}
    whole, parts = ubs.Trainer(data, **settings), ubs.Trainer(data, **settings)
    whole.run()
    parts.run(30)
    model = parts.model
    order = np.random.default_rng(3).permutation(len(model))
    shuffled = model.like(len(model))
    for name, values in model.parameters.items():
        shuffled.parameters[name] = values[order]
    parts.set_model(shuffled, source=order)
    back = np.argsort(order)
    parts.set_model(model, source=back)
    parts.run()
    # The results are only equal if set_model() has reordered parameters and optimiser states in the same way.
    for name, values in whole.model.parameters.items():
        assert np.array_equal(parts.model.parameters[name], values)
    forgot = ubs.Trainer(data, **settings)
    forgot.run(30)
    forgot.set_model(forgot.model)
    forgot.run()
    assert not np.array_equal(forgot.model.parameters["xyz"], whole.model.parameters["xyz"])
    more = model.like(len(model) + 7)
    for name, values in model.parameters.items():
        more.parameters[name] = np.concatenate([values, values[:7]])
    source = np.concatenate([np.arange(len(model)), np.full(7, -1)])
    parts.set_model(more, source)
    assert len(parts.model) == len(model) + 7
    trainer = ubs.Trainer(data, **settings)
    for wrong, number in (([0, 1], "integers"), (np.full(len(more), len(model) + 9), "is neither -1 nor one of"),
                          (np.full(len(more), -2), "is neither -1"), (source / 2, "integers")):
        with pytest.raises(ubs.UsageError, match=number):
            trainer.set_model(more, wrong)
    with pytest.raises(ubs.UsageError, match="memory for 400"):
        trainer.set_model(model.like(401))
    with pytest.raises(ubs.UsageError, match="dimension|form"):
        trainer.set_model(ubs.Model.empty(3, 5))
    assert trainer.status.iteration == 0


def test_ctrl_c_ends_training_with_its_state(data: ubs.Dataset) -> None:
    trainer = ubs.Trainer(data, **{**SETTINGS, "iterations": 100000})
    timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        trainer.run()
    assert 0 < trainer.status.iteration < 100000
    assert len(trainer.model) > 0


def test_metrics(data: ubs.Dataset) -> None:
    truth = data.test[0].image
    noise = np.random.default_rng(2).normal(scale=0.05, size=truth.shape)
    image = np.clip(truth / 255 + noise, 0, 1).astype(np.float32)
    squared = ((image - truth / 255) ** 2).mean(axis=(0, 1))
    assert ubs.metrics.psnr(truth, image) == pytest.approx(np.mean(-10 * np.log10(squared)), abs=1e-3)
    assert ubs.metrics.psnr(truth, truth) == np.inf
    assert ubs.metrics.ssim(truth, truth) == pytest.approx(1, abs=1e-6)
    assert 0 < ubs.metrics.ssim(truth, image) < 1
    with pytest.raises(ubs.UsageError, match="weights"):
        ubs.metrics.lpips(truth, image)


def test_each_test_view_is_measured(data: ubs.Dataset) -> None:
    trainer = ubs.Trainer(data, **SETTINGS)
    trainer.run(20)
    views, mean = trainer.evaluate_views(), trainer.evaluate()
    assert list(views) == [view.name for view in data.test]
    assert np.mean([found.psnr for found in views.values()]) == pytest.approx(mean.psnr)
    renderer = ubs.Renderer(trainer.model)
    for view in data.test:
        expected = ubs.metrics.measure(view.image, renderer.render(view.camera).rgb)
        # The trainer scales lengths. The largest errors observed on a CPU are 3.6e-7 dB and 0.
        assert views[view.name].psnr == pytest.approx(expected.psnr, rel=0, abs=7e-7)
        assert views[view.name].ssim == pytest.approx(expected.ssim, rel=0, abs=1e-7)
        assert views[view.name].lpips_alex is None
    with pytest.raises(ubs.UsageError, match="weights"):
        trainer.evaluate(networks=["alex"], weights="")
    with pytest.raises(ubs.UsageError, match="must be a list of names"):
        trainer.evaluate_views(networks="alex")
    weights = Path(os.environ.get("UBS_TEST_DATA") or Path(__file__).parents[3] / "shared" / "data") / "lpips_weights"
    if not weights.exists():
        return
    large = ubs.synth("glossy", size=64, views=2, test_views=2, supersampling=1)  # LPIPS needs 31 pixels or more
    trainer = ubs.Trainer(large, **SETTINGS)
    found = trainer.evaluate_views(networks=["alex"], weights=weights)
    renderer = ubs.Renderer(trainer.model)
    for view in large.test:
        expected = ubs.metrics.measure(
            view.image, renderer.render(view.camera).rgb, networks=["alex"], weights=weights
        )
        # The largest errors observed on a CPU are 1.1e-7 and 5.5e-8.
        assert found[view.name].lpips_alex == pytest.approx(expected.lpips_alex, rel=0, abs=2.2e-7)
        assert found[view.name].ssim_valid == pytest.approx(expected.ssim_valid, rel=0, abs=1.1e-7)
    assert trainer.evaluate(networks=["alex"], weights=weights).lpips_alex > 0.01


def test_a_kept_image_is_differentiated(
    data: ubs.Dataset, model: ubs.Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tests that vjp(None, ...) differentiates the image of draw() or render() without rendering it again."""
    camera, v_rgb = data.test[0].camera, np.random.default_rng(4).normal(size=(40, 40, 3))
    expected = ubs.vjp(model, camera, v_rgb)
    renderer = ubs.Renderer(model, gradients=True)
    for draw in (renderer.draw, renderer.render):
        draw(camera, for_gradient=True)
        with monkeypatch.context() as patch:
            patch.delitem(ubs._abi._functions, "renderer_draw")
            found = renderer.vjp(None, v_rgb)[0]
        assert all(np.array_equal(found[name], expected[name]) for name in expected)


def test_lpips_has_the_values_of_the_published_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    shared = Path(__file__).parents[3] / "shared" / "data"
    folder = Path(os.environ.get("UBS_TEST_DATA") or shared) / "lpips_weights"
    if not folder.exists():
        pytest.skip(f"SKIPPED: no test data {folder}: set UBS_TEST_DATA to the folder that holds it")
    read = pytest.importorskip("matplotlib.image", reason="SKIPPED: matplotlib is not installed").imread
    truth, *images = (read(folder / "test_images" / f"ex_{name}.png")[..., :3] for name in ("ref", "p0", "p1"))
    # The expected values were computed with torch 1.13 on a CPU, and are listed in the README of the data. The largest
    # error observed is 2.1e-7, which is also the error of the executable.
    for network, *expected in (("alex", 0.7218806, 0.1375656), ("squeeze", 0.7110476, 0.1479016)):
        found = [ubs.metrics.lpips(truth, image, network, weights=folder) for image in images]
        assert found == pytest.approx(expected, rel=0, abs=4e-7)
    monkeypatch.setenv("UBS_LPIPS_WEIGHTS", str(folder))
    both = ubs.metrics.measure(truth, images[0], networks=["alex", "squeeze"])
    assert both.lpips_alex == pytest.approx(0.7218806, abs=4e-7) and both.lpips_vgg is None
    assert ubs.metrics.lpips(truth, images[0], unit=True) == both.lpips_alex_unit != both.lpips_alex
    with pytest.raises(ubs.Error, match="vgg"):
        ubs.metrics.lpips(truth, images[0], "vgg")


def test_errors_have_kinds(data: ubs.Dataset, model: ubs.Model, tmp_path: Path) -> None:
    with pytest.raises(ubs.UsageError, match="did you mean"):
        ubs.train(data, iteration=5)
    with pytest.raises(ubs.DataError, match="nowhere"):
        ubs.Dataset.open(tmp_path / "nowhere")
    with pytest.raises(ubs.DeviceError, match="quantum"):
        model.render(data.test[0].camera, device="quantum")
    camera = data.test[0].camera
    wrong = np.empty((3, camera.height, camera.width), np.float32).transpose(1, 2, 0)
    for out in (wrong, np.empty((camera.height, camera.width, 3))):
        with pytest.raises(ubs.UsageError, match="out must be"):
            model.render(camera, out=out)
    with pytest.raises(ubs.UsageError, match="shape"):
        ubs.vjp(model, data.test[0].camera, np.zeros((3, 3, 3)))
    with pytest.raises(ubs.UsageError, match="shape"):
        ubs.Dataset.from_arrays([np.zeros((4, 4, 3))], np.zeros((2, 3, 4)), (1, 1, 1, 1))
    with pytest.raises(ubs.UsageError, match="colours require points"):  # otherwise they would be ignored
        ubs.Dataset.from_arrays([np.zeros((4, 4, 3))], [np.eye(4)[:3]], (4, 4, 2, 2), colours=[[1, 2, 3]])
    for size in ((4,), (4, 4), ()):
        with pytest.raises(ubs.UsageError, match=re.escape(f"image 0 has the shape {size}, not (H, W, 3)")):
            ubs.Dataset.from_arrays([np.zeros(size)], [np.eye(4)[:3]], (4, 4, 2, 2))
    for number in (-1, 1):  # otherwise all views would be used for training
        with pytest.raises(ubs.UsageError, match=f"view {number} does not exist"):
            ubs.Dataset.from_arrays([np.zeros((4, 4, 3))], [np.eye(4)[:3]], (4, 4, 2, 2), test=[number])
    with pytest.raises(ubs.DataError, match="rotation"):
        ubs.Dataset.from_arrays([np.zeros((4, 4, 3))], np.zeros((1, 3, 4)), (1, 1, 1, 1))
    broken = model.copy()
    broken.parameters["xyz"][0, 0] = np.nan
    with pytest.raises(ubs.NumericalError):
        broken.save(tmp_path / "broken.ply")
    assert issubclass(ubs.UsageError, ValueError) and issubclass(ubs.OutOfMemoryError, MemoryError)


def test_handles_of_the_wrong_kind_are_refused(data: ubs.Dataset, model: ubs.Model) -> None:
    anything: Any = model
    with pytest.raises(ctypes.ArgumentError, match="expected a handle of kind 'data', not Model"):
        ubs.train(anything)
    anything = data
    with pytest.raises(ctypes.ArgumentError, match="expected a handle of kind 'model', not Dataset"):
        ubs.Renderer(model).update(anything)
    anything = None
    with pytest.raises(ubs.UsageError, match="data is NULL"):
        ubs.train(anything)


def test_copies_own_their_handles(data: ubs.Dataset, model: ubs.Model) -> None:
    for made in (copy.copy(model), copy.deepcopy(model)):
        made.parameters["xyz"][:] += 1
        assert not np.array_equal(made.parameters["xyz"], model.parameters["xyz"])
        assert np.array_equal(made.parameters["rgb"], model.parameters["rgb"])
    for owner in (ubs.Renderer(model), ubs.Trainer(data, **SETTINGS)):
        for copied in (copy.copy, pickle.dumps):
            with pytest.raises(TypeError, match="cannot be pickled or copied"):
                copied(owner)


def test_models_can_be_pickled(data: ubs.Dataset, model: ubs.Model) -> None:
    again = pickle.loads(pickle.dumps(model))
    camera = data.test[0].camera
    assert repr(again) == repr(model) and str(len(model)) in repr(model) and "N = 6" in repr(model)
    assert again.parameters.keys() == model.parameters.keys()
    for name, values in model.parameters.items():
        assert np.array_equal(again.parameters[name], values)
    assert np.array_equal(again.render(camera), model.render(camera))
    white = ubs.Model.empty(6, 3, background=(1, 1, 1))
    assert np.array_equal(pickle.loads(pickle.dumps(white)).render(camera), white.render(camera))


def test_data_can_be_pickled_and_iterated(folder: Path, data: ubs.Dataset) -> None:
    opened = ubs.Dataset.open(folder, background=(0, 1, 0))
    camera = opened.train[0].camera
    opened.add_view("train", camera, np.full((40, 40, 3), 7, np.uint8), mask=np.eye(40), name="added")
    made = ubs.Dataset()
    made.add_view("test", camera, name="no image")
    made.set_points([[0, 0, 1], [1, 2, 3]], np.array([[1, 2, 3], [4, 5, 6]], np.uint8))
    assert repr(opened) == f"<ubs.Dataset of {str(folder)!r}: 9 train, 2 test views>"
    assert repr(made) == "<ubs.Dataset: 1 test views>" and repr(ubs.Dataset()) == "<ubs.Dataset: no views>"
    for original in (opened, made):
        for again in (pickle.loads(pickle.dumps(original)), copy.deepcopy(original)):
            assert len(again) == len(original) == len(list(original))
            for mine, other in zip(again, original):
                assert (mine.name, mine.camera) == (other.name, other.camera)
                assert (mine.has_image, mine.has_mask) == (other.has_image, other.has_mask)
                if other.has_image:
                    assert np.array_equal(mine.image, other.image) and np.array_equal(mine.mask, other.mask)
    view = pickle.loads(pickle.dumps(data.test[1]))
    assert view.name == data.test[1].name and np.array_equal(view.image, data.test[1].image)
    made.add_view("train", camera, np.zeros((40, 40, 3), np.uint8))
    start = [ubs.Model.initial(d, dim=3).parameters for d in (made, pickle.loads(pickle.dumps(made)))]
    assert np.array_equal(start[0]["xyz"], [[0, 0, 1], [1, 2, 3]])
    assert all(np.array_equal(start[0][name], start[1][name]) for name in start[0])


def test_a_pickled_view_needs_no_data(data: ubs.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests that a view is pickled with its own pixels, and that reading them opens no data set."""
    made = ubs.Dataset()
    camera = data.train[0].camera
    for k in range(20):
        made.add_view("train", camera, np.full((40, 40, 3), k, np.uint8), mask=np.eye(40) if k == 3 else None)
    made.add_view("test", camera, name="no image")
    views = [*made, data.test[0]]
    texts = [pickle.dumps(view) for view in views]
    assert max(map(len, texts)) < 40 * 40 * 5
    for name in ("data_open", "data_create", "data_get_image"):
        monkeypatch.delitem(ubs._abi._functions, name)
    again = [pickle.loads(text) for text in texts]
    assert [(view.name, view.camera) for view in again] == [(view.name, view.camera) for view in views]
    assert [view.image.max() for view in again[:20]] == list(range(20))
    assert again[3].has_mask and again[3].mask.sum() == 40 * 255
    assert not again[2].has_mask and again[2].mask.min() == 255
    again[3].image[:] = 9  # each access returns an array of its own
    assert again[3].image.max() == 3
    with pytest.raises(ubs.DataError, match="no image"):
        again[20].image
    assert copy.deepcopy(views[0]) is copy.copy(views[0]) is views[0]
    monkeypatch.undo()
    assert np.array_equal(again[21].image, data.test[0].image)


def test_notebooks_show_pictures(data: ubs.Dataset, model: ubs.Model) -> None:
    read = pytest.importorskip("matplotlib.image", reason="SKIPPED: matplotlib is not installed").imread

    def shown(file: bytes) -> Any:
        return np.rint(255 * read(io.BytesIO(file))).astype(np.uint8)

    view = data.test[0]
    assert np.array_equal(shown(view._repr_png_()), view.image)
    image = model.renderer().render(view.camera)
    assert np.array_equal(shown(image._repr_png_()), np.rint(255 * np.clip(image.rgb, 0, 1)).astype(np.uint8))
    more = ubs.Model.empty(8, 50)  # has a further query value
    more.parameters["xyz"] = np.random.default_rng(1).normal(size=(50, 3))
    for other in (model, ubs.Model.initial(data, dim=3), more):
        text = other._repr_html_()
        source = re.fullmatch(r'<img src="data:image/png;base64,(.*)"><br>&lt;ubs.Model: .*', text)
        picture = shown(base64.b64decode(source[1]))
        assert picture.shape == (256, 256, 3)
        assert other is more or picture[64:192, 64:192].std() > 1  # the opacities of `more` are nearly 0
    made = ubs.Dataset()
    made.add_view("test", view.camera)
    assert made.test[0]._repr_png_() is None
    broken = model.copy()
    broken.parameters["xyz"][0, 0] = np.nan
    assert broken._repr_html_() is None  # the notebook then shows repr()


def test_other_processes_get_models_and_views(data: ubs.Dataset, model: ubs.Model) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        image, rendered = pool.apply(_image_and_rendering, (data.test[0], model))
    assert np.array_equal(image, data.test[0].image)
    assert np.array_equal(rendered, model.render(data.test[0].camera))


def _image_and_rendering(view: ubs.View, model: ubs.Model) -> tuple[Any, Any]:
    return view.image, model.render(view.camera)


def test_synthetic_scenes(folder: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {"size": 40, "views": 8, "test_views": 2, "supersampling": 1}
    data = ubs.synth("glossy", **options)
    for mine, other in zip(data, ubs.Dataset.open(folder)):  # created by the executable
        assert mine.camera == other.camera and np.array_equal(mine.image, other.image)
    again = pickle.loads(pickle.dumps(data))
    assert len(again) == 10 and np.array_equal(again.test[1].image, data.test[1].image)
    files = Path(data._temporary.name)
    assert files.exists()
    del data, mine
    gc.collect()
    assert not files.exists()
    wide = ubs.synth("orbit", **{**options, "size": (30, 20), "test_views": 0}, out=tmp_path / "orbit")
    assert (tmp_path / "orbit" / "transforms_train.json").exists()
    assert len(wide) == 8 and wide.train[0].image.shape == (20, 30, 3) and wide.train[7].camera.time == 1
    with pytest.raises(ubs.UsageError, match="already exists: choose another folder, or pass overwrite"):
        ubs.synth("orbit", **options, out=tmp_path / "orbit")
    assert len(ubs.synth("glossy", **options, out=tmp_path / "orbit", overwrite=True)) == 10
    for wrong in ({"scene": "mirror"}, {"size": 0}, {"size": (0, 9)}, {"size": 9000}, {"views": 0}, {"seed": -1},
                  {"test_views": 2.5}, {"supersampling": 0}, {"size": 40.0}, {"size": (1, 2, 3)}, {"views": 2**31}):
        with pytest.raises(ubs.UsageError, match="synth"):
            ubs.synth(**{**options, **wrong})
    of_numpy = {name: np.int64(value) for name, value in options.items()}
    for size in (np.int32(30), np.array([30, 30]), [30, np.int64(30)]):
        same = ubs.synth("glossy", **{**of_numpy, "size": size}, out=tmp_path / "orbit", overwrite=np.bool_(True))
        assert len(same) == 10 and same.test[0].image.shape == (30, 30, 3)


def test_settings_take_numbers_of_numpy(folder: Path) -> None:
    given = {"lr_scale": np.float64(0.01), "query_grad": np.bool_(True), "background": np.array([1, 0.5, 0])}
    plain = {"lr_scale": 0.01, "query_grad": True, "background": (1, 0.5, 0)}
    assert {key: as_text(value) for key, value in given.items()} == {
        "lr_scale": "0.01", "query_grad": "true", "background": "1.0,0.5,0.0"
    }
    a, b = (
        ubs.train(ubs.Dataset.open(folder, background=some["background"]), **{**SETTINGS, "iterations": 3, **some})
        for some in (given, plain)
    )
    assert np.array_equal(a.parameters["scale"], b.parameters["scale"])


def test_data_are_read_with_the_settings_of_their_opening(
    folder: Path, data: ubs.Dataset, tmp_path: Path
) -> None:
    for key, value, opened in (("background", (1, 1, 1), "0,0,0"), ("downscale", 2, "1"), ("test_every", 4, "auto")):
        message = f"{key} = {as_text(value)} has no effect here, because the data .* with {opened}"
        with pytest.raises(ubs.UsageError, match=message):
            ubs.Trainer(data, **{**SETTINGS, key: value})
    # If a trainer gets no value of such a setting, it uses the value with which the data were opened.
    trained = ubs.train(ubs.Dataset.open(folder, background=(1, 1, 1)), **{**SETTINGS, "iterations": 1})
    trained.save(tmp_path / "white.ply")
    assert b"background=1,1,1 " in (tmp_path / "white.ply").read_bytes()


def test_arrays_are_opaque_and_join_far_data(folder: Path, data: ubs.Dataset, tmp_path: Path) -> None:
    """Tests that images that are added as arrays count as opaque. Also tests that a view can be added to data whose
    cameras are far from the origin."""
    made = ubs.Dataset()
    for view in data.train[:2]:
        made.add_view("train", view.camera, view.image)
    assert len(ubs.Model.initial(made, init_points=9, background="learn")) > 0
    shutil.copytree(folder, tmp_path / "far")
    for path in (tmp_path / "far").glob("transforms_*.json"):
        scene = json.loads(path.read_text())
        for frame in scene["frames"]:
            frame["transform_matrix"][0][3] += 1e6
        path.write_text(json.dumps(scene))
    far = ubs.Dataset.open(tmp_path / "far")
    far.add_view("train", far.train[0].camera)
    first, *_, added = (view.camera.world_to_camera for view in far.train)
    assert np.allclose(first, added)


def test_a_process_forked_from_one_with_a_device_says_so(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that functions that need a device raise DeviceError in a forked process. Functions that only use the host
    must work in this process."""
    camera = data.test[0].camera
    expected = model.render(camera)
    for case in (
        lambda: model.render(camera),
        lambda: model.copy().render(camera),
        lambda: ubs.devices(),
        lambda: ubs.metrics.psnr(expected, expected),
        lambda: ubs.Trainer(data, **SETTINGS),
    ):
        child = os.fork()
        if child == 0:
            signal.alarm(60)  # a signal ends the test if it hangs
            try:
                case()
                os._exit(1)
            except ubs.DeviceError as error:
                os._exit(0 if "spawn" in str(error) else 2)
            except BaseException:
                os._exit(3)
        assert os.waitpid(child, 0)[1] == 0
    child = os.fork()
    if child == 0:  # functions on the host work, and handles of the parent can be freed
        signal.alarm(60)
        same = np.array_equal(model.copy().parameters["xyz"], model.parameters["xyz"])
        model._renderers.clear()
        gc.collect()
        os._exit(0 if same else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert np.array_equal(model.render(camera), expected)


def test_gradients_of_threads_do_not_mix(data: ubs.Dataset, model: ubs.Model) -> None:
    cameras = [view.camera for view in data.test]
    weights = np.ones((40, 40, 3), np.float32)
    expected = [ubs.vjp(model, camera, weights)["xyz"] for camera in cameras]
    target = np.zeros((40, 40, 3), np.float32)
    losses = [ubs.loss(model, camera, target) for camera in cameras]
    wrong: list[int] = []

    def work(k: int) -> None:
        for _ in range(60):
            found, gradient = ubs.loss(model, cameras[k], target)
            if found != losses[k][0] or not np.array_equal(gradient["xyz"], losses[k][1]["xyz"]):
                wrong.append(k)
            if not np.array_equal(ubs.vjp(model, cameras[k], weights)["xyz"], expected[k]):
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k % 2,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_picture_that_was_not_copied_keeps_its_memory(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that the memory of a render that was not copied is not reused while an array refers to it."""
    camera = data.test[0].camera
    other = replace(camera, width=640, height=480, cx=320, cy=240)
    expected = model.render(camera)
    try:
        seen = model.render(camera, copy=False)
    except ubs.UsageError:
        pytest.skip("SKIPPED: the device does not provide addresses of its memory")
    large = model.render(other)  # must use another renderer, because `seen` uses memory of the first one
    assert np.array_equal(seen, expected)
    assert np.array_equal(model.render(other), large)
    renderer = ubs.Renderer(model, gradients=True)
    renderer.draw(camera)
    held = np.asarray(renderer.array("rgb"))[1:]  # a part of the array also keeps it alive
    for draw in (renderer.render, renderer.draw, lambda c: renderer.vjp(c, np.zeros((480, 640, 3)))):
        with pytest.raises(ubs.UsageError, match="in use"):
            draw(other)
    assert np.array_equal(held, expected[1:])
    renderer.draw(camera)
    del held
    assert np.array_equal(renderer.render(other).rgb, large)


def test_devices_and_settings() -> None:
    assert len(ubs.devices()) >= 1
    assert ubs.devices()[0].memory_bytes > 0
    assert "optimiser steps" in ubs.settings()["iterations"]
    device = ubs.Device()
    assert device.allocated_bytes == 0


def test_cameras_views_and_pictures_can_be_compared(data: ubs.Dataset, model: ubs.Model) -> None:
    a, b = data.test
    again = data.test[0]
    assert again.camera == a.camera != b.camera and again == a != b
    assert len({a.camera, again.camera, b.camera}) == len({a, again, b}) == 2
    assert a.camera != a.camera.at(0.5) and a.camera != None  # noqa: E711
    renderer = model.renderer(gradients=True)
    image = renderer.render(a.camera)
    renderer.loss(a.camera, a.image)
    for value in (image, renderer.camera_gradient()):
        assert value == value != copy.copy(value) and len({value, value}) == 1


def test_a_device_is_named_by_its_index(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that an integer selects a device by its index, and that other types are rejected."""
    camera = data.test[0].camera
    for index in (0, np.int64(0)):
        assert model.renderer(index).device is model.renderer("0").device is not model.renderer().device
    assert ubs.Device(0).allocated_bytes == 0
    for index in (len(ubs.devices()), -1):
        with pytest.raises(ubs.DeviceError, match=str(index)):
            model.render(camera, device=index)
    wrong: Any
    for wrong in (False, True, 0.0, b"cpu", []):
        with pytest.raises(TypeError, match=f"not {type(wrong).__name__}"):
            model.render(camera, device=wrong)


def test_a_trainer_returns_the_settings_that_were_decided(data: ubs.Dataset) -> None:
    decided = ubs.Trainer(data, iterations=2000, growth=1.3).settings
    assert decided.keys() == ubs.settings().keys()
    assert (decided["iterations"], decided["growth"], decided["budget"]) == ("2000", "1.3", "none")
    assert (decided["cap_max"], decided["lr_rgb"], decided["schedule"]) == ("24000", "0.005", "fast")
    published = ubs.Trainer(data, schedule="published").settings
    assert (published["iterations"], published["cap_max"], published["lr_rgb"]) == ("30000", "300000", "0.001")


def test_a_training_with_a_time_budget_ends(data: ubs.Dataset) -> None:
    steps: list[ubs.Step] = []
    model = ubs.train(data, dim=6, init_points=300, budget="10s", on_step=steps.append)
    assert 100 <= steps[-1].iteration == steps[-1].iterations
    assert len(model) == steps[-1].splats


def test_growth_is_that_of_the_documentation(data: ubs.Dataset) -> None:
    """Tests the number of splats after a training with growth, with a lower cap_max, and without refinements."""
    few = {"dim": 3, "iterations": 200, "init_points": 500, "init_extent": 1.3}
    assert len(ubs.train(data, **few)) == 10_000
    assert len(ubs.train(data, **few, cap_max=700)) == 700
    assert len(ubs.train(data, **few, refine="0:0:1")) == 500


def test_the_command_without_an_executable_says_so() -> None:
    code = "from ubs._command import main; main()"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 1 and "built without the executable" in run.stderr


def test_importing_needs_numpy_alone() -> None:
    """Tests that importing ubs does not import torch or tqdm."""
    code = "import sys, ubs; assert 'torch' not in sys.modules and 'tqdm' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
