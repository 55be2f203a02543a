# SPDX-License-Identifier: Apache-2.0
"""Tests that ubs and OpenUSD can read each other's USD files. Usage: usd_test.py UBS, where UBS is the path of ubs.

OpenUSD reads the files that `ubs convert` writes, and their values are compared with PLY files. ubs reads files that
OpenUSD wrote. The test needs numpy and OpenUSD 26.03 or later (pip install usd-core). Without them it exits with 77."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import numpy as np
    from pxr import Gf, Plug, Sdf, Usd, UsdGeom, UsdVol, Vt

    UsdVol.ParticleField3DGaussianSplat
except (ImportError, AttributeError):
    print("SKIPPED: needs numpy and OpenUSD 26.03 or later (pip install usd-core)")
    sys.exit(77)

from gaussian_maths import colour, covariances

UBS = sys.argv[1]
COUNT = 500
# The commands that ubs runs must use this Python.
os.environ["PATH"] = str(Path(sys.executable).parent) + os.pathsep + os.environ["PATH"]
TURN = np.diag([1.0, -1.0, -1.0])
SH = "radiance:sphericalHarmonicsCoefficients"


def ubs(*arguments):
    return subprocess.run([UBS, *map(str, arguments)], check=True, stdout=subprocess.PIPE, text=True).stdout


def columns(degree):
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{k}" for k in range(3 * ((degree + 1) ** 2 - 1))]
    return names + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def write_ply(path, table, degree, comments=()):
    head = ["ply", "format binary_little_endian 1.0", *(f"comment {c}" for c in comments)]
    head += [f"element vertex {len(table)}"]
    head += [f"property float {n}" for n in columns(degree)] + ["end_header"]
    Path(path).write_bytes(("\n".join(head) + "\n").encode() + table.astype("<f4").tobytes())


def read_ply(path):
    head, body = Path(path).read_bytes().split(b"end_header\n", 1)
    names = [line.split()[-1] for line in head.decode().split("\n") if line.startswith("property")]
    table = np.frombuffer(body, "<f4").reshape(-1, len(names))
    degree = int(round(np.sqrt(sum(n.startswith("f_") for n in names) / 3))) - 1
    comments = [line[8:] for line in head.decode().split("\n") if line.startswith("comment ")]
    return table[:, [names.index(n) for n in columns(degree)]], degree, comments


class Table:
    """Splits the table of a 3DGS PLY file into its parts."""

    def __init__(self, table, degree):
        self.places, self.coefficients = table[:, :3], (degree + 1) ** 2
        rest = table[:, 6 : 3 + 3 * self.coefficients].reshape(len(table), 3, -1).transpose(0, 2, 1)
        self.sh = np.concatenate([table[:, None, 3:6], rest], 1)
        self.logits, self.log_scales, self.wxyz = table[:, -8], table[:, -7:-4], table[:, -4:]


def random_table(rng, degree):
    table = np.concatenate(
        [
            rng.uniform(-3, 3, (COUNT, 3)),
            rng.uniform(-1, 1, (COUNT, 3 * (degree + 1) ** 2)),
            rng.uniform(-9, 9, (COUNT, 1)),
            rng.uniform(-9, 0, (COUNT, 3)),
            rng.normal(0, 1, (COUNT, 4)),
        ],
        1,
    ).astype("<f4")
    # Half of the positions are arbitrary finite numbers of float32, including denormals. After writing and reading
    # the text, they must have the same bits.
    bits = rng.integers(0, 2**32, (COUNT // 2, 3), dtype=np.uint64).astype(np.uint32).view(np.float32)
    table[: COUNT // 2, :3] = np.where(np.isfinite(bits), bits, 1)
    return table


def quaternions(values):
    return np.array([[q.GetReal(), *q.GetImaginary()] for q in values], np.float32)


def values_of(prim, time):
    """Returns the values of the splats at a time code, as read by OpenUSD."""
    get = lambda name: prim.GetAttribute(name).Get(time)
    rest = (np.array(get(name)) for name in ("scales", "opacities", SH))
    return np.array(get("positions")), quaternions(get("orientations")), *rest


def open_stage(path):
    """Opens a file, checks its attributes against the schema, and returns the stage and the prim."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetDefaultPrim()
    assert prim.IsA(UsdVol.ParticleField3DGaussianSplat) and prim.GetTypeName() == "ParticleField3DGaussianSplat"
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    definition = prim.GetPrimDefinition()
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if name.startswith("xformOp:"):
            continue
        schema = definition.GetAttributeDefinition(name)
        assert schema, f"{name} is not in the schema"
        assert schema.GetTypeName() == attribute.GetTypeName(), name
        assert schema.GetVariability() == attribute.GetVariability(), name
        allowed = schema.GetMetadata("allowedTokens")
        assert not allowed or attribute.Get() in allowed, name
    validate(stage)
    return stage, prim


def validate(stage):
    try:
        from pxr import UsdValidation
    except ImportError:
        print("OpenUSD's validators are not run, because this package does not contain them")
        return
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert len(validators) > 5
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not errors, [(e.GetName(), e.GetMessage()) for e in errors]


def check_splats(values, table):
    places, wxyz, scales, opacities, sh = values
    assert np.array_equal(places, (table.places * [1, -1, -1]).astype(np.float32))
    assert np.abs(np.linalg.norm(wxyz, axis=1) - 1).max() < 1e-6
    truth = TURN @ covariances(np.exp(table.log_scales.astype(float)), table.wxyz) @ TURN
    found = covariances(scales.astype(float), wxyz)
    size = np.abs(truth).max((1, 2))
    assert (np.abs(found - truth).max((1, 2)) / size).max() < 2e-6
    assert np.abs(opacities - 1 / (1 + np.exp(-table.logits.astype(float)))).max() < 2e-7
    sh = sh.reshape(len(places), -1, 3)
    assert sh.shape[1] == table.coefficients
    assert np.array_equal(np.abs(sh), np.abs(table.sh))
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(len(places), 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    assert np.abs(colour(sh, seen @ TURN) - colour(table.sh, seen)).max() < 1e-6


def check_back(path, table, degree, folder, offset=None):
    """Tests that ubs reads the values that the file was created from."""
    ubs("convert", path, folder / "back.ply", "--to", "3dgs", "--overwrite")
    back, found, comments = read_ply(folder / "back.ply")
    assert found == degree
    a, b = Table(back, degree), table
    assert np.array_equal(a.places, b.places) and np.array_equal(a.sh, b.sh)
    assert np.abs(a.log_scales - b.log_scales).max() < 2e-6
    opacity = lambda t: 1 / (1 + np.exp(-t.logits.astype(float)))
    assert np.abs(opacity(a) - opacity(b)).max() < 2e-7
    assert (offset is None) == (not any(c.startswith("ubs_offset") for c in comments))
    if offset is not None:
        assert [float(v) for c in comments if c.startswith("ubs_offset") for v in c.split()[1:]] == offset


def check_still(folder):
    rng = np.random.default_rng(5)
    for degree in (0, 1, 2, 3):
        rows = random_table(rng, degree)
        offset = [4321987.0625, -5500000.1, 12.25] if degree == 2 else None
        write_ply(folder / "a.ply", rows, degree, [f"ubs_offset {' '.join(map(repr, offset))}"] if offset else [])
        table = Table(rows, degree)
        seen = []
        for name in ("a.usda", "a.usdc", "a.usd"):
            ubs("convert", folder / "a.ply", folder / name, "--overwrite")
            start = (folder / name).read_bytes()[:8]
            assert start == (b"#usda 1." if name == "a.usda" else b"PXR-USDC"), start
            stage, prim = open_stage(folder / name)
            assert prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get() == degree
            values = values_of(prim, Usd.TimeCode.Default())
            check_splats(values, table)
            low, high = np.array(prim.GetAttribute("extent").Get())
            places, wxyz, scales = values[0].astype(float), values[1], values[2].astype(float)
            reach = 3 * np.sqrt(np.einsum("nkk->nk", covariances(scales, wxyz)))
            assert (low <= places - reach).all() and (high >= places + reach).all()
            world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
            expected = np.array(offset or [0, 0, 0]) @ TURN
            assert np.array_equal(np.array(world.ExtractTranslation()), expected), world
            seen.append(values)
            check_back(folder / name, table, degree, folder, offset)
        for values in seen[1:]:
            assert all(np.array_equal(a.view(np.uint32), b.view(np.uint32)) for a, b in zip(seen[0], values))
        # ubs must also read the text that OpenUSD writes.
        assert Sdf.Layer.FindOrOpen(str(folder / "a.usdc")).Export(str(folder / f"other{degree}.usda"))
        assert (folder / f"other{degree}.usda").read_bytes() != (folder / "a.usda").read_bytes()
        check_back(folder / f"other{degree}.usda", table, degree, folder, offset)


def check_foreign(folder):
    """Tests a stage as another program may write it: its values have half precision, its positions have time samples,
    its prim is below a translated prim, and its z axis points up."""
    stage = Usd.Stage.CreateNew(str(folder / "foreign.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.Xform.Define(stage, "/World").AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    splat = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/S")
    prim = splat.GetPrim()
    set_value = lambda name, value, *time: prim.GetAttribute(name).Set(value, *time)
    rng = np.random.default_rng(2)
    half = lambda *shape: rng.uniform(0.1, 1, shape).astype(np.float16)
    places = [half(7, 3), half(7, 3)]
    scales, opacities, sh = half(7, 3), half(7), half(28, 3)
    for code, p in zip((10.5, 20), places):
        set_value("positionsh", Vt.Vec3hArray.FromNumpy(p), code)
    set_value("scalesh", Vt.Vec3hArray.FromNumpy(scales))
    set_value("opacitiesh", Vt.HalfArray.FromNumpy(opacities))
    set_value("orientationsh", Vt.QuathArray([Gf.Quath(0.5, 0.5, -0.5, 0.5)] * 7))
    set_value("radiance:sphericalHarmonicsDegree", 1)
    set_value(SH + "h", Vt.Vec3hArray.FromNumpy(sh))
    stage.GetRootLayer().Save()
    assert stage.GetRootLayer().Export(str(folder / "foreign.usdc"))
    for name in ("foreign.usda", "foreign.usdc"):
        for time, p in zip(("0", "1"), places):
            said = ubs("convert", folder / name, folder / "f.ply", "--to", "3dgs", "--time", time, "--overwrite")
            assert "2 time samples, time codes 10.5 to 20" in said and "z axis points up" in said, said
            rows, degree, comments = read_ply(folder / "f.ply")
            found = Table(rows, degree)
            moved = (p.astype(float) + [1, 2, 3]).astype(np.float32)
            assert degree == 1 and np.array_equal(found.places, moved)
            assert np.array_equal(found.sh, sh.astype(np.float32).reshape(7, 4, 3))
            assert np.allclose(found.log_scales, np.log(scales.astype(float)), atol=1e-6)
            assert np.allclose(1 / (1 + np.exp(-found.logits)), opacities, atol=1e-6)
            assert (found.wxyz == [0.5, 0.5, -0.5, 0.5]).all()
            assert not any(c.startswith("ubs_offset") for c in comments), comments


def check_series(folder):
    """Tests that time samples are equal to the models that `--time` exports one by one."""
    ubs("synth", "orbit", "--out", folder / "data", "--size", 40, "--views", 8, "--test-views", 1)
    short = ["--iterations", 60, "--init-points", 600, "--quiet"]
    ubs("train", folder / "data", "--out", folder / "run", "--dim", 7, *short)
    count = 5
    for name in ("m.usda", "m.usdc"):
        ubs("convert", folder / "run", folder / name, "--series", count)
        stage, prim = open_stage(folder / name)
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (0, count - 1, 24)
        assert prim.GetAttribute("positions").GetTimeSamples() == list(range(count))
        moved = 0
        for moment in range(count):
            at_moment = ["--to", "3dgs", "--time", moment / (count - 1), "--overwrite"]
            ubs("convert", folder / "run", folder / "t.ply", *at_moment, "--distill", 0)
            rows, degree, _ = read_ply(folder / "t.ply")
            table = Table(rows, degree)
            places, wxyz, scales, opacities, sh = values_of(prim, moment)
            # The file also contains splats that are invisible at this time. The other splats have the same
            # order as in the PLY file.
            visible = opacities >= np.float32(1 / 255)
            assert visible.sum() == len(rows), (visible.sum(), len(rows))
            assert visible.sum() > 100
            every = (places, wxyz, scales, opacities, sh.reshape(len(places), -1, 3))
            check_splats([values[visible] for values in every], table)
            low, high = np.array(prim.GetAttribute("extent").Get(moment))
            assert (low < places).all() and (high > places).all()
            ubs("convert", folder / name, folder / "u.ply", *at_moment)
            back = Table(*read_ply(folder / "u.ply")[:2])
            assert np.array_equal(back.places, (places * [1, -1, -1]).astype(np.float32))
            if moment > 0:
                moved = max(moved, np.abs(places - values_of(prim, 0)[0]).max())
                # OpenUSD interpolates linearly between time samples. From one time sample to the next, an ellipsoid
                # must not rotate further than necessary.
                before, after = values_of(prim, moment - 1), values_of(prim, moment)
                half = values_of(prim, moment - 0.5)
                assert np.allclose(half[0], (before[0] + after[0]) / 2, atol=1e-6)
                dots = np.abs((before[1] * after[1]).sum(1))
                # `dots` contains the cosine of half the rotation angle of each ellipsoid. If both time samples name
                # the axes of the ellipsoid alike, half the angle is at most 45 degrees here.
                assert dots.min() > 0.7, dots.min()
        assert moved > 0.001, moved  # 0.0035 was observed, because the training is short
    said = ubs("convert", folder / "run", folder / "still.usda", "--time", 0.5, "--distill", 0)
    assert "store K of them with --series K" in said
    # Splats of different distilled time samples do not correspond, so OpenUSD must not interpolate.
    ubs("convert", folder / "run", folder / "d.usda", "--series", 2, "--distill", "0.001s", "--degree", 1)
    stage, prim = open_stage(folder / "d.usda")
    first, between, last = (np.array(prim.GetAttribute("positions").Get(t)) for t in (0, 0.5, 1))
    assert len(first) != len(last) and np.array_equal(first, between)
    assert len(prim.GetAttribute(SH).Get(1)) == 4 * len(last)


def main():
    print("OpenUSD", ".".join(map(str, Usd.GetVersion())))
    assert Plug.Registry().GetPluginWithName("usdVol")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        check_still(folder)
        check_foreign(folder)
        check_series(folder)
    print("passed")


main()
