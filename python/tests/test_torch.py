# SPDX-License-Identifier: Apache-2.0
"""Tests gradients that are computed through PyTorch, and the example torch_fit.py. Most of these tests compare with the
gradients of the library, because other tests compare the library with float64."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="SKIPPED: PyTorch is not installed")

import ubs  # noqa: E402
import ubs.torch  # noqa: E402
from ubs import _abi  # noqa: E402
from ubs._drawing import Drawing  # noqa: E402


@pytest.fixture(scope="module")
def data(folder: Path) -> ubs.Dataset:
    return ubs.Dataset.open(folder)


def test_gradients_are_those_of_the_library(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats = ubs.torch.Splats(model)
    cameras = [view.camera for view in data.test]
    weights = [torch.randn(40, 40, 3), torch.randn(40, 40)]
    rgb, alpha = splats(cameras[0])
    assert np.array_equal(rgb.detach().numpy(), model.render(cameras[0]))
    other, _ = splats(cameras[1])  # another image is rendered before the gradient of the first one is computed
    ((rgb * weights[0]).sum() + (alpha * weights[1]).sum()).backward()
    expected = ubs.vjp(model, cameras[0], weights[0].numpy(), weights[1].numpy())
    for name, parameter in splats.named_parameters():
        assert parameter.grad is not None
        assert np.array_equal(parameter.grad.numpy(), expected[name])
    other.sum().backward()
    for loss in (torch.sum, lambda rgb: (rgb**2).sum()):
        with pytest.raises(ubs.UsageError, match="no second-order gradients"):
            torch.autograd.grad(loss(splats(cameras[0])[0]), splats.xyz, create_graph=True)
    for name, values in splats.model().parameters.items():
        assert np.array_equal(values, model.parameters[name])


@pytest.mark.parametrize("shared", [True, False])
def test_a_gradient_does_not_render_the_image_again(
    data: ubs.Dataset, monkeypatch: pytest.MonkeyPatch, shared: bool
) -> None:
    splats = ubs.torch.Splats(ubs.train(data, iterations=30, init_points=300, dim=6))
    if not shared:  # as with OpenCL on GPUs, values are copied through host memory
        splats._drawing.place = None
    cameras = [view.camera for view in data.test]
    weights = torch.randn(40, 40, 3), torch.randn(40, 40)
    calls: list[str] = []
    original = _abi.call
    monkeypatch.setattr(_abi, "call", lambda name, *arguments: (calls.append(name), original(name, *arguments))[1])

    def rendered() -> int:
        number = calls.count("renderer_draw")
        calls.clear()
        return number

    def gradient(image: Any, alpha: Any = None) -> Any:
        loss = (image * weights[0]).sum() + (0 if alpha is None else (alpha * weights[1]).sum())
        return torch.autograd.grad(loss, list(splats.parameters()), retain_graph=True)

    first, first_alpha = splats(cameras[0])
    alone = gradient(first)
    assert rendered() == 1
    both = gradient(first, first_alpha)
    assert rendered() == 0
    again = gradient(first)  # after a gradient of alpha, the image must be rendered again
    assert rendered() == 1
    second, _ = splats(cameras[1])
    after = gradient(first)  # the device holds the second image, so the first one must be rendered again
    other = gradient(second)
    assert rendered() == 3
    with torch.no_grad():
        splats(cameras[0])
        splats.xyz += 0.01
    assert rendered() == 1
    moved = gradient(splats(cameras[0])[0])
    assert rendered() == 1
    for same in (again, after):
        assert all(torch.equal(a, b) for a, b in zip(alone, same))
    for changed in (both, other, moved):
        assert not all(torch.equal(a, b) for a, b in zip(alone, changed))


def test_the_drawing_of_jax_renders_once_for_a_gradient(data: ubs.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests the class Drawing, which ubs.jax uses: a gradient only renders the image again if the image that the device
    holds cannot be used."""
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    drawing = Drawing(model, None, False)
    cameras = [view.camera for view in data.test]
    arrays = [values.copy() for values in model.parameters.values()]
    random = np.random.default_rng(1)
    v = [random.normal(size=size).astype(np.float32) for size in ((40, 40, 3), (40, 40))]
    calls: list[str] = []
    original = _abi.call
    monkeypatch.setattr(_abi, "call", lambda name, *arguments: (calls.append(name), original(name, *arguments))[1])

    def gradient(camera: ubs.Camera, arrays: list[Any], expected: int) -> dict[str, Any]:
        calls.clear()
        found = drawing.differentiate(camera, arrays, v)
        assert calls.count("renderer_draw") == expected
        return found

    def same(a: dict[str, Any], b: dict[str, Any]) -> bool:
        return all(np.array_equal(a[name], b[name]) for name in a)

    drawing.draw(cameras[0], arrays, True)
    first = gradient(cameras[0], [values.copy() for values in arrays], 0)  # JAX passes other arrays with equal values
    assert same(first, ubs.vjp(model, cameras[0], *v))
    assert same(gradient(cameras[0], arrays, 1), first)  # after a gradient of alpha, the image must be rendered again
    drawing.draw(cameras[0], arrays)
    assert same(gradient(cameras[0], arrays, 1), first)  # the call of draw() did not announce a gradient
    drawing.draw(cameras[0], arrays, True)
    assert not same(gradient(cameras[1], arrays, 1), first)
    drawing.draw(cameras[0], arrays, True)
    moved = [arrays[0] + np.float32(0.01), *arrays[1:]]
    assert not same(gradient(cameras[0], moved, 1), first)
    drawing.draw(cameras[0], moved, True)
    drawing.put(arrays)
    assert same(gradient(cameras[0], arrays, 1), first)  # put() has replaced the values after the image was rendered


def test_threads_get_their_own_pictures_and_gradients(data: ubs.Dataset) -> None:
    """Tests that four threads that use one Splats object get the same images and gradients as a single thread."""
    splats = ubs.torch.Splats(ubs.train(data, iterations=30, init_points=300, dim=6))
    cameras = [view.camera for view in data.test]

    def gradient(k: int) -> tuple[torch.Tensor, torch.Tensor]:
        rgb = splats(cameras[k])[0]
        return rgb.detach(), torch.autograd.grad(rgb.sum(), splats.xyz)[0]

    expected = [gradient(k) for k in range(2)]
    assert not torch.equal(expected[0][0], expected[1][0])
    wrong: list[int] = []

    def work(k: int) -> None:
        for _ in range(100):
            if not all(torch.equal(a, b) for a, b in zip(gradient(k), expected[k])):
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k % 2,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_parameters_of_one_splat_are_not_spread_over_all(data: ubs.Dataset) -> None:
    """Tests that a parameter with the values of a single splat is rejected, and not used for all splats."""
    camera = data.test[0].camera
    for name in ("opacity", "xyz"):
        splats = ubs.torch.Splats(ubs.train(data, iterations=1, init_points=50, dim=6))
        splats._parameters[name] = torch.nn.Parameter(getattr(splats, name).data[:1].clone())
        with pytest.raises(ubs.UsageError, match=r"has (1|50) splats, but xyz has (1|50)$"):
            splats(camera)


def test_splats_come_and_go(data: ubs.Dataset) -> None:
    """Tests Splats objects whose number of splats changes between two images."""
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats, camera = ubs.torch.Splats(model), data.test[0].camera
    weights = torch.randn(40, 40, 3)
    for count in (100, 300, 1, 1000, 250):
        chosen = np.arange(count) % len(model)
        expected = model.like(count)
        for name, values in model.parameters.items():
            expected.parameters[name] = values[chosen]
            setattr(splats, name, torch.nn.Parameter(torch.from_numpy(values[chosen].copy())))
        rgb, _ = splats(camera)
        assert np.array_equal(rgb.detach().numpy(), expected.render(camera))
        splats(data.test[1].camera)
        (rgb * weights).sum().backward()
        gradient = ubs.vjp(expected, camera, weights.numpy())
        for name, parameter in splats.named_parameters():
            assert np.array_equal(parameter.grad, gradient[name])
        assert len(splats.model()) == count
        rendered = ubs.torch.render(dict(splats.named_parameters()), camera)[0]
        assert torch.equal(rendered, rgb)
    for name, parameter in list(splats.named_parameters()):
        setattr(splats, name, torch.nn.Parameter(parameter.detach()[:0].clone()))
    rgb, alpha = splats(camera)
    (rgb.sum() + alpha.sum()).backward()
    assert not rgb.any() and not alpha.any() and splats.xyz.grad.shape == (0, 3)


def test_parameters_that_are_not_finite_are_refused(data: ubs.Dataset) -> None:
    splats = ubs.torch.Splats(ubs.Model.empty(6, 5))
    with torch.no_grad():
        splats.mean[3, 1] = torch.nan
    with pytest.raises(ubs.NumericalError, match="not finite: mean|the parameter mean of splat 3"):
        splats(data.test[0].camera)


def test_splats_can_be_copied_and_saved(data: ubs.Dataset, tmp_path: Path) -> None:
    splats = ubs.torch.Splats(ubs.train(data, iterations=5, init_points=200, dim=6), depth=True, background=(0, 1, 0))
    camera = data.test[0].camera
    expected = splats(camera)
    torch.save(splats, tmp_path / "splats.pt")
    for again in (copy.deepcopy(splats), torch.load(tmp_path / "splats.pt")):
        assert all(torch.equal(a, b) for a, b in zip(again(camera), expected))
        with torch.no_grad():
            again.rgb += 1
        assert not torch.equal(again(camera)[0], expected[0])
    assert all(torch.equal(a, b) for a, b in zip(splats(camera), expected))
    fresh = ubs.torch.Splats(ubs.Model.empty(6, len(splats.xyz)), depth=True, background=(0, 1, 0))
    fresh.load_state_dict(splats.state_dict())
    assert all(torch.equal(a, b) for a, b in zip(fresh(camera), expected))


def test_parameters_of_another_number_of_splats_can_be_loaded(data: ubs.Dataset) -> None:
    """Tests checkpoints that were written after density control."""
    splats = ubs.torch.Splats(ubs.train(data, iterations=5, init_points=200, dim=6))
    splats.rgb.requires_grad_(False)
    expected = splats(data.test[0].camera)
    whole = torch.nn.ModuleDict({"scene": splats}).state_dict()
    for count in (3, 500):
        fresh = ubs.torch.Splats(ubs.Model.empty(6, count))
        fresh.rgb.requires_grad_(False)
        torch.nn.ModuleDict({"scene": fresh}).load_state_dict(whole)
        assert all(torch.equal(a, b) for a, b in zip(fresh(data.test[0].camera), expected))
        assert fresh.xyz.requires_grad and not fresh.rgb.requires_grad and len(fresh.model()) == len(splats.model())
    wrong = splats.state_dict()
    wrong["xyz"] = wrong["xyz"][1:]
    for state in (wrong, {**splats.state_dict(), "opacity": torch.zeros(len(splats.xyz), 2)}):
        with pytest.raises(RuntimeError, match="size mismatch"):
            ubs.torch.Splats(ubs.Model.empty(6, 4)).load_state_dict(state)
    with pytest.raises(RuntimeError, match="Missing key"):
        ubs.torch.Splats(ubs.Model.empty(6, 4)).load_state_dict({"xyz": splats.xyz})


def test_functions_of_raw_parameters(data: ubs.Dataset) -> None:
    camera = data.test[0].camera
    forms: list[dict[str, object]] = [
        {"dim": 6, "background": (0.2, 0.7, 0.4)}, {"dim": 3, "kernel": "gaussian", "colour": "sh3"},
        {"dim": 7, "conditioning": "direct", "query_grad": False},
    ]
    for form in forms:
        dim, settings = int(str(form["dim"])), {k: v for k, v in form.items() if k not in ("dim", "query_grad")}
        model = ubs.Model.initial(data, dim=dim, init_points=200, **settings)
        model.parameters["opacity"] = np.full_like(model.parameters["opacity"], 2)
        tensors = {name: torch.from_numpy(values.copy()).requires_grad_() for name, values in model.parameters.items()}
        pictures = ubs.torch.render(tensors, camera, depth=True, **form)  # type: ignore[arg-type]
        drawn = {k: v for k, v in settings.items() if k == "background"}
        chosen = {"query_grad": False} if "query_grad" in form else {}
        renderer = ubs.Renderer(model, depth=True, gradients=True, **drawn, **chosen)
        image = renderer.render(camera)
        for mine, other in zip(pictures, (image.rgb, image.alpha, image.depth)):
            assert np.array_equal(mine.detach(), other)
        sum(picture.sum() for picture in pictures).backward()
        ones = np.ones((40, 40), np.float32)
        expected = renderer.vjp(camera, np.ones((40, 40, 3)), ones, ones)[0]
        for name, tensor in tensors.items():
            assert np.array_equal(tensor.grad, expected[name])
        none = {name: tensor.detach()[:0].requires_grad_() for name, tensor in tensors.items()}
        empty = ubs.torch.render(none, camera, depth=True, **form)  # type: ignore[arg-type]
        assert torch.equal(empty[0], torch.tensor(settings.get("background", (0.0, 0, 0))).expand(40, 40, 3))
        assert not empty[1].any() and not empty[2].any() and len(empty) == 3
        sum(picture.sum() for picture in empty).backward()
        assert none["xyz"].grad is not None and none["xyz"].grad.shape == (0, 3)
    white = ubs.torch.render({name: tensor.detach()[:0] for name, tensor in tensors.items()}, camera, dim=7,
                             conditioning="direct", background="white")  # a background may also be a string
    assert torch.equal(white[0], torch.ones(40, 40, 3)) and not white[1].any()
    with pytest.raises(ubs.UsageError, match="this variant has xyz, rgb"):
        ubs.torch.render({"xyz": tensors["xyz"]}, camera, dim=3)
    with pytest.raises(ubs.UsageError, match="iterations has no effect"):
        ubs.torch.render(tensors, camera, dim=7, iterations=3)
    with pytest.raises(ubs.UsageError, match="float32"):
        ubs.torch.render({name: tensor.double() for name, tensor in tensors.items()}, camera, dim=7, conditioning="direct")


def test_poses_may_be_larger_matrices_and_not_quite_rotations(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats, camera = ubs.torch.Splats(model), data.test[0].camera
    weights = torch.randn(40, 40, 3)
    four = torch.eye(4, dtype=torch.float64)
    four[:3] = torch.from_numpy(camera.world_to_camera)
    k = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], requires_grad=True)
    pose = four.clone().requires_grad_()
    (splats(camera, pose=pose, intrinsics=k)[0] * weights).sum().backward()
    three, flat = four[:3].clone().requires_grad_(), torch.tensor([camera.fx, camera.fy, camera.cx, camera.cy], requires_grad=True)
    (splats(camera, pose=three, intrinsics=flat)[0] * weights).sum().backward()
    assert torch.equal(pose.grad[:3], three.grad) and not pose.grad[3].any() and three.grad.abs().max() > 0
    fx, fy, cx, cy = flat.grad
    assert torch.equal(k.grad, torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 0]]))
    for shape in ((3, 3), (4, 3)):
        with pytest.raises(ubs.UsageError, match=r"pose has the shape .*, not \(3, 4\) or \(4, 4\)"):
            splats(camera, pose=torch.zeros(shape))
    with pytest.raises(ubs.UsageError, match="intrinsics has the shape"):
        splats(camera, intrinsics=torch.zeros(3))
    with pytest.raises(ubs.UsageError, match="skew"):
        splats(camera, intrinsics=torch.tensor([[40.0, 5, 20], [0, 40, 20], [0, 0, 1]]))
    # If the matrix of a pose is not quite a rotation, ubs renders with the nearest rotation, and the gradient must take
    # this into account. Each entry of the gradient is compared with a finite difference in float64.
    crooked = four[:3] + 0.02 * torch.randn(3, 4, dtype=torch.float64)
    pose = crooked.clone().requires_grad_()
    splats(camera, pose=pose)[0].sum().backward()
    from ubs._drawing import polar

    def nearest(matrix: np.ndarray) -> np.ndarray:
        u, _, vt = np.linalg.svd(matrix)
        return u @ vt

    stretch, rotation = polar(crooked.numpy()[:, :3])
    assert np.allclose(stretch @ rotation, crooked[:, :3]) and np.allclose(rotation, nearest(crooked[:, :3].numpy()))
    renderer = ubs.Renderer(model, gradients=True)
    seen = replace(camera, world_to_camera=np.c_[rotation, crooked[:, 3]])
    assert np.array_equal(splats(camera, pose=crooked)[0].detach(), renderer.render(seen).rgb)
    renderer.vjp(seen, np.ones((40, 40, 3)))
    whole = renderer.camera_gradient().world_to_camera
    step = 1e-6
    for i, j in np.ndindex(3, 3):
        change = np.zeros((3, 3))
        change[i, j] = step
        ends = [nearest(crooked[:, :3].numpy() + sign * change) for sign in (1, -1)]
        slope = (whole[:, :3] * (ends[0] - ends[1])).sum() / (2 * step)
        assert float(pose.grad[i, j]) == pytest.approx(slope, rel=1e-5, abs=1e-5 * np.abs(whole).max())
    assert np.allclose(pose.grad[:, 3], whole[:, 3])
    with pytest.raises(ubs.DataError, match="rotation"):
        splats(camera, pose=1.5 * crooked)


def test_gradients_of_depth_and_camera_are_those_of_the_library(data: ubs.Dataset) -> None:
    model = ubs.train(data, iterations=30, init_points=300, dim=6)
    splats = ubs.torch.Splats(model, depth=True)
    camera = data.test[0].camera
    pose = torch.tensor(camera.world_to_camera, requires_grad=True)
    intrinsics = torch.tensor([camera.fx, camera.fy, camera.cx, camera.cy], requires_grad=True)
    v = [torch.randn(40, 40, 3), torch.randn(40, 40), torch.randn(40, 40)]
    pictures = splats(camera, pose=pose, intrinsics=intrinsics, time=torch.tensor(0.0, requires_grad=True))
    sum((picture * weight).sum() for picture, weight in zip(pictures, v)).backward()
    renderer = ubs.Renderer(model, depth=True, gradients=True)
    assert np.array_equal(pictures[2].detach().numpy(), renderer.render(camera).depth)
    expected = renderer.vjp(camera, *(weight.numpy() for weight in v))[0]
    for name, parameter in splats.named_parameters():
        assert parameter.grad is not None and np.abs(expected[name]).max() > 0
        assert np.array_equal(parameter.grad.numpy(), expected[name])
    of_camera = renderer.camera_gradient()
    assert pose.grad is not None and intrinsics.grad is not None
    assert np.array_equal(pose.grad.numpy(), of_camera.world_to_camera)
    assert np.allclose(intrinsics.grad.numpy(), of_camera.intrinsics, rtol=1e-6)


# Bounds of the relative error (2-norm) of the gradient of each parameter array and of the intrinsics. The keys are N
# and the colour model. Each bound is twice the largest error observed on PoCL, which always occurs in the gradient of
# the intrinsics if the loss depends on alpha only. The gradients include the path through the view direction.
BOUNDS = {(3, "rgb"): 1.3e-4, (3, "sh3"): 1.3e-4, (6, "rgb"): 2.6e-4, (7, "rgb"): 7.8e-4}


@pytest.mark.parametrize("dim, colour", BOUNDS)
def test_gradients_agree_with_float64(dim: int, colour: str) -> None:
    command = [os.environ["UBS_FLOAT64_GRADIENT"], str(dim), colour]
    scene = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    model = ubs.Model.empty(dim, scene["splats"], background=scene["background"], colour=colour)
    widths = {name: values.shape[1] for name, values in model.parameters.items()}

    def split(values: list[float]) -> dict[str, np.ndarray]:
        rows = np.split(np.reshape(values, (-1, len(model))), np.cumsum(list(widths.values()))[:-1])
        return {name: part.T for name, part in zip(widths, rows)}

    for name, values in split(scene["values"]).items():
        model.parameters[name][...] = values
    pose = torch.tensor(np.c_[np.reshape(scene["rotation"], (3, 3)), scene["translation"]], requires_grad=True)
    k = torch.tensor(scene["intrinsics"], dtype=torch.float64, requires_grad=True)
    camera = ubs.Camera.from_matrix(pose.detach(), k.detach(), *scene["size"], scene["time"])
    splats = ubs.torch.Splats(model, depth=True)
    weights = [torch.tensor(scene[name]) for name in ("rgb", "alpha", "depth")]
    for number, chosen in (("colours", [0]), ("alpha", [1]), ("depth", [2]), ("all", [0, 1, 2])):
        splats.zero_grad(set_to_none=True)
        k.grad = None
        pictures = splats(camera, pose=pose, intrinsics=k)
        sum((pictures[i].reshape(-1) * weights[i]).sum() for i in chosen).backward()
        found = {name: parameter.grad.numpy() for name, parameter in splats.named_parameters()}
        expected = scene["gradients"][number]
        pairs = {name: (found[name], values) for name, values in split(expected["parameters"]).items()}
        pairs["intrinsics"] = (k.grad.numpy(), expected["camera"][6:10])
        for name, (mine, truth) in pairs.items():
            if np.linalg.norm(truth) < 1e-9:
                assert np.abs(mine).max() < 1e-6
                continue
            error = np.linalg.norm(mine - truth) / np.linalg.norm(truth)
            print(f"N = {dim} {colour}  {number:8} {name:11} {error:.1e}")
            assert error <= BOUNDS[dim, colour]
    published = ubs.Renderer(model, gradients=True, query_grad=False).vjp(camera, scene_array(scene, "rgb"))[0]
    whole = ubs.vjp(model, camera, scene_array(scene, "rgb"))
    missing = np.linalg.norm(published["xyz"] - whole["xyz"]) / np.linalg.norm(whole["xyz"])
    assert (missing == 0) == ((dim, colour) == (3, "rgb")) and missing < 0.5


def scene_array(scene: dict[str, Any], name: str) -> np.ndarray:
    return np.reshape(np.array(scene[name], np.float32), (scene["size"][1], scene["size"][0], 3))


def test_tensors_stay_in_device_memory(data: ubs.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    model = ubs.train(data, iterations=5, init_points=200, dim=6)
    splats = ubs.torch.Splats(model, depth=True)
    if splats._drawing.place is None:
        with pytest.raises(ubs.UsageError, match="does not provide addresses"):
            splats._drawing.renderer.array("parameters")
        pytest.skip("SKIPPED: the device does not provide addresses of its memory")
    array = splats._drawing.renderer.array("parameters")
    seen = torch.from_dlpack(array)
    assert seen.data_ptr() == array.address and tuple(seen.shape) == array.shape
    assert np.array_equal(seen[:3].T.numpy(), model.parameters["xyz"])
    from ubs import _dlpack

    before = len(_dlpack._handed_out)
    unused = array.__dlpack__()
    assert len(_dlpack._handed_out) == before + 1
    del unused, seen
    assert len(_dlpack._handed_out) == before - 1

    def copied(*_: object) -> None:
        raise AssertionError("values were copied through host memory")

    monkeypatch.setattr(ubs.torch, "_array", copied)
    camera = data.test[0].camera
    rgb, alpha, _ = splats(camera)
    expected = ubs.Renderer(model).render(camera)
    assert np.array_equal(rgb.detach(), expected.rgb) and np.array_equal(alpha.detach(), expected.alpha)
    weights = torch.randn(rgb.shape)
    (rgb * weights).sum().backward()
    gradient = ubs.vjp(model, camera, weights.numpy())
    for name, parameter in splats.named_parameters():
        assert np.array_equal(parameter.grad, gradient[name]) and np.abs(gradient[name]).max() > 0
    with torch.no_grad():
        splats.rgb += 0.5
    changed = ubs.Model.empty(6, len(model))
    for name, parameter in splats.named_parameters():
        changed.parameters[name][:] = parameter.detach().numpy()
    for used in ((1, 1, 0), (0, 0, 1), (1, 1, 1)):
        pictures = splats(camera)
        assert np.array_equal(pictures[0].detach(), changed.render(camera))
        splats.zero_grad()
        sum(picture.sum() for picture, part in zip(pictures, used) if part).backward()
        given = [np.ones(picture.shape) if part else None for picture, part in zip(pictures, used)]
        gradient = ubs.vjp(changed, camera, **dict(zip(("v_rgb", "v_alpha", "v_depth"), given)))
        for name, parameter in splats.named_parameters():
            assert np.array_equal(parameter.grad, gradient[name])
            assert np.abs(gradient[name]).max() > 0 or (name, used[0]) == ("rgb", 0)


def test_images_may_be_changed_in_place(data: ubs.Dataset) -> None:
    splats = ubs.torch.Splats(ubs.train(data, iterations=5, init_points=200, dim=6))
    flat = ubs.torch.rasterize(torch.rand(3, 2).requires_grad_(), torch.eye(2).expand(3, 2, 2), torch.ones(3),
                               torch.rand(3, 1), torch.rand(3), width=4, height=4)
    for image in (*splats(data.test[0].camera), *flat):
        expected = image.detach().clamp(0.1, 0.2)
        assert torch.equal(image.clamp_(0.1, 0.2), expected)


def test_arguments_of_other_types_are_refused(data: ubs.Dataset) -> None:
    splats, array = ubs.torch.Splats(ubs.Model.empty(6, 5)), np.zeros((3, 2), np.float32)
    with pytest.raises(ubs.UsageError, match="pose must be a torch.Tensor, not ndarray"):
        splats(data.test[0].camera, pose=np.eye(4))
    with pytest.raises(ubs.UsageError, match="a ubs.Camera, not View: pass its camera"):
        splats(data.test[0])
    with pytest.raises(ubs.UsageError, match=r"means2d must be a float32 tensor \(n, 2\), not ndarray"):
        ubs.torch.rasterize(array, array, array, array, array, width=4, height=4)


def test_a_pose_is_found_again(data: ubs.Dataset) -> None:
    """Tests that Adam can recover a camera pose that was rotated and moved by a small amount."""
    model = ubs.train(data, iterations=500, init_points=1000, cap_max=1000, init_extent=1.3, dim=3)
    camera = data.train[0].camera
    truth = torch.from_numpy(model.render(camera))
    splats = ubs.torch.Splats(model).requires_grad_(False)
    start = torch.from_numpy(camera.world_to_camera)
    moved = torch.tensor([0.01, -0.015, 0.02, 0.01, 0.02, -0.02], dtype=torch.float64, requires_grad=True)
    adam = torch.optim.Adam([moved], lr=5e-3)
    rates = torch.optim.lr_scheduler.ExponentialLR(adam, 0.97)
    errors = []
    for _ in range(150):
        zero = torch.zeros((), dtype=torch.float64)
        x, y, z = moved[:3]
        turn = torch.matrix_exp(torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3))
        pose = turn @ start + torch.nn.functional.pad(moved[3:, None], (3, 0))
        error = ((splats(camera, pose=pose)[0] - truth) ** 2).sum()
        errors.append(float(error))
        adam.zero_grad()
        error.backward()
        adam.step()
        rates.step()
    assert errors[-1] < 1e-2 * errors[0]


def test_the_example_learns(data: ubs.Dataset) -> None:
    sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
    import torch_fit

    splats, losses = torch_fit.fit(data, 60)
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])
    assert torch_fit.psnr(splats, data.test) > 10


def test_memory_of_the_device_is_given_back(data: ubs.Dataset) -> None:
    """Tests that an array of a renderer is freed when its last tensor is deleted, or if no tensor was made of it."""
    from ubs import _dlpack

    renderer = ubs.Renderer(ubs.Model.empty(3, 5))
    renderer.draw(data.test[0].camera)
    try:
        array = renderer.array("rgb")
    except ubs.UsageError:
        pytest.skip("SKIPPED: the device does not provide addresses of its memory")
    before = len(_dlpack._handed_out)
    tensor = torch.from_dlpack(array)
    part = tensor[1:]
    del tensor
    assert len(_dlpack._handed_out) == before + 1
    del part
    assert len(_dlpack._handed_out) == before
    capsule = array.__dlpack__()
    assert len(_dlpack._handed_out) == before + 1
    del capsule
    assert len(_dlpack._handed_out) == before
