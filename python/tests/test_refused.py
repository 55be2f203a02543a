# SPDX-License-Identifier: Apache-2.0
"""Tests that the package rejects arguments that would silently give wrong results, and tests its messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ubs

SETTINGS = {"iterations": 60, "init_points": 300, "cap_max": 400, "dim": 6}


@pytest.fixture(scope="module")
def data(folder: Path) -> ubs.Dataset:
    return ubs.Dataset.open(folder)


@pytest.fixture(scope="module")
def model(data: ubs.Dataset) -> ubs.Model:
    return ubs.train(data, **SETTINGS)



def test_images_of_0_to_255_as_floats_are_refused(data: ubs.Dataset, model: ubs.Model) -> None:
    view = data.test[0]
    wide = view.image.astype(np.float32)  # earlier versions clamped it to white
    good = wide / 255
    for call in (
        lambda: ubs.metrics.psnr(np.full((8, 8, 3), 40.0), np.full((8, 8, 3), 200.0)),
        lambda: ubs.metrics.psnr(view.image, wide),
        lambda: ubs.metrics.ssim(good, -wide),
        lambda: ubs.loss(model, view.camera, wide),
        lambda: ubs.Dataset.from_arrays([wide], [view.camera.world_to_camera], (40, 40, 20, 20)),
    ):
        with pytest.raises(ubs.UsageError, match="pass uint8, or floating point from 0 to 1"):
            call()
    # Values outside 0 to 1, which occur in rendered images, are clamped.
    assert ubs.metrics.psnr(good * 1.5 - 0.2, good * 1.5 - 0.2) == np.inf
    assert set(dir(ubs.metrics)) >= {"psnr"} and ubs.metrics.__all__ == ["lpips", "measure", "psnr", "ssim"]


def test_images_of_other_integers_are_refused(data: ubs.Dataset, model: ubs.Model) -> None:
    view = data.test[0]
    wide = view.image.astype(np.int64)  # values from 0 to 255; as values from 0 to 1, most would be clamped to 1
    for call in (lambda: ubs.metrics.psnr(wide, wide // 2), lambda: ubs.loss(model, view.camera, wide)):
        with pytest.raises(ubs.UsageError, match="int64: pass uint8"):
            call()


def test_what_c_would_read_otherwise_is_refused(data: ubs.Dataset, model: ubs.Model, tmp_path: Path) -> None:
    """Tests that arguments are rejected if C would interpret them differently from Python: a negative number of steps,
    and a path that contains a NUL character."""
    trainer = ubs.Trainer(data, **SETTINGS)
    with pytest.raises(ubs.UsageError, match="steps = -1"):
        trainer.run(-1)
    assert trainer.status.iteration == 0
    with pytest.raises(ubs.UsageError, match="NUL"):
        model.save(f"{tmp_path}/a\0b.ply")
    assert not list(tmp_path.iterdir())


def test_what_would_have_no_effect_is_refused(data: ubs.Dataset, model: ubs.Model, folder: Path) -> None:
    """Tests that functions reject settings that have no effect on them."""
    for call, what in (
        (lambda: ubs.Renderer(model, iterations=5), "iterations has no effect on a renderer"),
        (lambda: ubs.Renderer(model, kernel="gaussian"), "kernel has no effect on a renderer: a renderer uses"),
        (lambda: ubs.Renderer(model, dim=3), "dim has no effect on a renderer"),
        (lambda: ubs.Renderer(model, downscale=2), "downscale has no effect on a renderer"),
        (lambda: ubs.Model.empty(6, 5, lr_xyz=0.1), "lr_xyz has no effect on a new model"),
        (lambda: ubs.Dataset.open(folder, iterations=5), "iterations has no effect on data"),
        (lambda: ubs.Dataset.open(folder, dim=5), "dim has no effect on data"),
        (lambda: ubs.train(data, save_renders=3), "save_renders has no effect on a trainer"),
        (lambda: ubs.Model.initial(data, checkpoint_every=3), "checkpoint_every has no effect on a trainer"),
    ):
        with pytest.raises(ubs.UsageError, match=what):
            call()
    camera = data.test[0].camera
    white = ubs.Renderer(model, background=(1, 1, 1), eps2d=0.5, raster="cpu", math="exact", query_grad=False)
    assert white.render(camera).rgb.mean() > model.render(camera).mean()
    ubs.Dataset.open(folder, background=(1, 1, 1), downscale=2, image_cache_mb=9)
    ubs.Model.empty(6, 5, kernel="gaussian", colour="sh2", conditioning="direct", near_plane=0.1)


def test_cameras_that_ubs_does_not_have_are_refused(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that matrices with a skew or a wrong last row, and times outside of 0 to 1, are rejected."""
    camera = data.test[0].camera
    k = np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]])
    four = np.vstack([camera.world_to_camera, (0, 0, 0, 1)])
    assert ubs.Camera.from_matrix(four, k, 40, 40) == ubs.Camera.from_matrix(four[:3], (40, 40, 20, 20), 40, 40)
    for row, column, value, what in ((0, 1, 3, "skew 3"), (1, 0, 3, "skew 3"), (2, 2, 2, "last row"), (2, 0, 1, "last")):
        wrong = k.copy()
        wrong[row, column] = value
        for make in (
            lambda: ubs.Camera.from_matrix(four, wrong, 40, 40),
            lambda: ubs.Dataset.from_arrays([np.zeros((40, 40, 3))], four[None], wrong),
        ):
            with pytest.raises(ubs.UsageError, match=what):
                make()
    four[3, 3] = 2
    with pytest.raises(ubs.UsageError, match="last row"):
        model.render(ubs.Camera.from_matrix(four, k, 40, 40))
    made = ubs.Dataset()
    for time in (-0.1, 1.5):
        with pytest.raises(ubs.UsageError, match="time = .* is outside of 0 to 1"):
            made.add_view("train", camera.at(time))
    with pytest.raises(ubs.UsageError, match="outside of 0 to 1"):
        ubs.Dataset.from_arrays(np.zeros((3, 4, 4, 3)), [four[:3]] * 3, (4, 4, 2, 2), times=np.linspace(0, 2, 3))


def test_test_views_are_chosen_by_index_or_boolean(data: ubs.Dataset) -> None:
    images, poses = np.zeros((4, 8, 8, 3)), [np.eye(4)[:3]] * 4
    for test in (np.array([False, False, True, True]), [False, False, True, True], [2, 3], np.array([3, 2])):
        made = ubs.Dataset.from_arrays(images, poses, (8, 8, 4, 4), test=test)
        assert [view.name for view in made.test] == ["2", "3"] and len(made.train) == 2
    with pytest.raises(ubs.UsageError, match="3 booleans, but there are 4 views"):
        ubs.Dataset.from_arrays(images, poses, (8, 8, 4, 4), test=[True, False, True])


def test_parameters_that_are_not_finite_are_refused(data: ubs.Dataset) -> None:
    camera, model = data.test[0].camera, ubs.Model.empty(6, 5)
    renderer = ubs.Renderer(model)
    model.parameters["scale"][2, 1] = np.inf
    for call in (lambda: model.render(camera), lambda: renderer.update(model), lambda: ubs.Renderer(model)):
        with pytest.raises(ubs.NumericalError, match="the parameter scale of splat 2 with N = 6 is inf"):
            call()


def test_messages_speak_of_arguments(
    data: ubs.Dataset, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tests that messages name Python arguments, and not options of the command line such as --device."""
    monkeypatch.delenv("UBS_LPIPS_WEIGHTS", raising=False)
    with pytest.raises(ubs.DeviceError) as error:
        ubs.train(data, device="H100")
    assert "device 'H100' matches no device" in str(error.value) and "--" not in str(error.value)
    with pytest.raises(ubs.UsageError) as error:
        ubs.metrics.lpips(data.test[0].image, data.test[0].image)
    assert "weights" in str(error.value) and "--" not in str(error.value)
    renderer, camera = ubs.Renderer(ubs.Model.empty(6, 5), gradients=True), data.test[0].camera
    image = np.zeros((40, 40, 3))
    more = image, image, np.zeros((5, 3))
    for part, call in (
        ("more must contain three arrays", lambda: renderer.vjp(camera, image, more=more[:2])),
        ("more requires absgrad=True, and no v_depth", lambda: renderer.vjp(camera, image, more=more)),
        ("there is no image to differentiate", lambda: renderer.vjp(None, image)),
        ("call vjp() or loss() first", renderer.camera_gradient),
        ("needs the size of the view", lambda: renderer.array("v_alpha")),
        ("created without depth=True", lambda: renderer.array("v_depth", size=(40, 40))),
        ("created without depth=True", lambda: renderer.vjp(camera, v_depth=image[..., 0])),
        ("absgrad=True requires gradients=True", lambda: ubs.Renderer(ubs.Model.empty(6, 5), absgrad=True)),
        ("v_rgb contains values that are not finite", lambda: renderer.vjp(camera, image + np.nan)),
        ("a ubs.Camera, not View: pass its camera", lambda: renderer.render(data.test[0])),
        ("`extra` of the camera has 0 values", lambda: ubs.Model.empty(8, 5).render(camera)),
        ("unknown key 'foo'", lambda: ubs.train(data, foo=1)),
    ):
        with pytest.raises(ubs.UsageError) as error:
            call()
        assert part in str(error.value) and "UBS_" not in str(error.value) and "ubs_" not in str(error.value)
    caplog.set_level("INFO", "ubs")
    ubs.Trainer(data, **{**SETTINGS, "dim": 4})
    ubs.Trainer(data, dim="auto", iterations=5)
    assert "use dim 3 for a static scene" in caplog.text and "--" not in caplog.text


def test_files_of_unknown_formats_are_not_written(model: ubs.Model, tmp_path: Path) -> None:
    for name in ("model.xyz", "model", "model.ply.bak"):
        with pytest.raises(ubs.UsageError, match="no format has the extension"):
            model.save(tmp_path / name)
    assert not list(tmp_path.iterdir())
    model.save(tmp_path / "model.xyz", format="ubs")
    assert len(ubs.Model.load(tmp_path / "model.xyz")) == len(model)


def test_absurd_pictures_are_refused_before_memory_is_taken(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that impossible image sizes raise an error that names the size, and not an error of a failed
    allocation."""
    camera, renderer = data.test[0].camera, ubs.Renderer(model)
    for side in (100_000, 2_000_000_000, 2**32 + 48, 48 - 2**32):  # ctypes would convert the last two to 48
        absurd = replace(camera, width=side, height=side)
        for draw in (model.render, renderer.render, renderer.draw):
            with pytest.raises(ubs.Error, match=f"the image size {side}x{side} is not possible"):
                draw(absurd)


def test_integers_that_c_would_wrap_are_refused(model: ubs.Model) -> None:
    for splats in (2**64 + 5, -1, 2**64):
        with pytest.raises(ubs.UsageError, match="is not an integer from 0"):
            ubs.Model.empty(3, splats)
    assert len(ubs.Model.empty(3, np.int64(5))) == 5
    renderer = ubs.Renderer(model, gradients=True)
    with pytest.raises(ubs.UsageError, match="2\\^31"):
        renderer.array("v_rgb", size=(2**64 + 40, 40))
    with pytest.raises(ubs.UsageError, match="is not an integer from 0"):
        renderer.array("parameters", 2**32)
    for call in (lambda: ubs.Model.empty(3, 5.0), lambda: renderer.array("parameters", np.float64(0))):  # type: ignore
        with pytest.raises(ubs.UsageError, match="must be an integer, not [50].0"):
            call()


def test_pictures_have_whole_pixels(data: ubs.Dataset, model: ubs.Model) -> None:
    """Tests that the width of an image must be an integer, which may have a type of NumPy."""
    camera = data.test[0].camera
    for width in (48.5, 48.0, float("nan")):  # ctypes would truncate the first one
        with pytest.raises(ubs.UsageError, match="width must be an integer"):
            model.render(replace(camera, width=width))  # type: ignore[arg-type]
    whole = replace(camera, width=np.int32(camera.width))
    assert np.array_equal(model.render(whole), model.render(camera))
