# SPDX-License-Identifier: Apache-2.0
"""Tests GLB and SOG files that `ubs convert` writes. This program reads them with its own code, which follows only the
published layouts. It also writes SOG files, and tests that ubs reads them. Usage: interchange_test.py UBS, where UBS is
the path of the executable. Exits with 77 if numpy, or Pillow with support for WebP, is not installed."""

import json
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
from io import BytesIO
from pathlib import Path

try:
    import numpy as np
    from PIL import Image, features

    assert features.check("webp")
except (ImportError, AssertionError):
    print("SKIPPED: needs numpy and Pillow with WebP")
    sys.exit(77)

from gaussian_maths import colour, covariances

UBS = sys.argv[1]
COUNT, DEGREE = 500, 3


def ubs(*arguments):
    subprocess.run([UBS, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def columns():
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{k}" for k in range(3 * ((DEGREE + 1) ** 2 - 1))]
    return names + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def write_ply(path, table):
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property float {n}" for n in columns()] + ["end_header"]
    Path(path).write_bytes(("\n".join(head) + "\n").encode() + table.astype("<f4").tobytes())


def read_ply(path):
    data = Path(path).read_bytes()
    head, body = data.split(b"end_header\n", 1)
    names = [line.split()[-1] for line in head.decode().split("\n") if line.startswith("property")]
    table = np.frombuffer(body, "<f4").reshape(-1, len(names))
    return table[:, [names.index(n) for n in columns()]]


def sh_of(table):
    dc, rest = table[:, 3:6], table[:, 6:51].reshape(len(table), 3, 15)
    return np.concatenate([dc[:, None, :], rest.transpose(0, 2, 1)], 1)


def check_glb(path, table):
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON") and size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    bin_size, bin_kind = struct.unpack_from("<I4s", data, 20 + size)
    assert bin_kind == b"BIN\0" and bin_size == document["buffers"][0]["byteLength"]
    numbers = data[28 + size :]
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert extension["kernel"] == "ellipse" and extension["colorSpace"] == "srgb_rec709_display"

    def get(name, width):
        accessor = document["accessors"][primitive["attributes"][name]]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["type"] == {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[width], name
        assert accessor["componentType"] == 5126 and view["byteOffset"] % 4 == 0
        values = np.frombuffer(numbers, "<f4", accessor["count"] * width, view["byteOffset"])
        values = values.reshape(-1, width).astype(float)
        if "min" in accessor:
            assert np.allclose(accessor["min"], values.min(0)) and np.allclose(accessor["max"], values.max(0))
        return values

    assert "min" in document["accessors"][primitive["attributes"]["POSITION"]]
    turn = np.diag([1.0, -1, -1])
    place, turned = get("POSITION", 3), table[:, :3] @ turn
    assert np.array_equal(place, turned)
    quaternion, scale = get("KHR_gaussian_splatting:ROTATION", 4), get("KHR_gaussian_splatting:SCALE", 3)
    assert np.abs(np.linalg.norm(quaternion, axis=1) - 1).max() < 1e-6 and scale.min() > 0
    truth = turn @ covariances(np.exp(table[:, 52:55]), table[:, 55:59]) @ turn
    assert np.abs(covariances(scale, quaternion[:, [3, 0, 1, 2]]) - truth).max() < 1e-6 * truth.max()
    opacity = get("KHR_gaussian_splatting:OPACITY", 1)[:, 0]
    assert np.abs(opacity - 1 / (1 + np.exp(-table[:, 51]))).max() < 1e-6
    names = [f"KHR_gaussian_splatting:SH_DEGREE_{d}_COEF_{k}" for d in range(4) for k in range(2 * d + 1)]
    sh = np.stack([get(n, 3) for n in names], 1)
    # The axes of the two files differ. Seen from the same position in the scene, the colours must be the same.
    seen = table[:, :3] - [1, 2, 3]
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    assert np.abs(colour(sh, seen @ turn) - colour(sh_of(table), seen)).max() < 1e-5
    if shutil.which("assimp"):  # readers that do not support splats must find the same number of points
        said = subprocess.run(["assimp", "info", str(path)], capture_output=True, text=True).stdout
        assert f"Vertices:           {COUNT}" in said, said


def pixels(archive, name):
    image = Image.open(BytesIO(archive.read(name)))
    assert image.format == "WEBP" and b"VP8L" in archive.read(name)[:40]
    return np.asarray(image.convert("RGBA")).reshape(-1, 4).astype(int)


def sog_table(path):
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        meta = json.loads(archive.read("meta.json"))
        assert meta["version"] == 2
        n = meta["count"]
        low, high = (pixels(archive, f)[:n, :3] for f in meta["means"]["files"])
        mins, maxs = np.array(meta["means"]["mins"]), np.array(meta["means"]["maxs"])
        logs = mins + (maxs - mins) * (low + 256 * high) / 65535
        place = np.sign(logs) * (np.exp(np.abs(logs)) - 1)
        scale = np.array(meta["scales"]["codebook"])[pixels(archive, meta["scales"]["files"][0])[:n, :3]]
        quats = pixels(archive, meta["quats"]["files"][0])[:n]
        kept, mode = (quats[:, :3] / 255 - 0.5) * np.sqrt(2), quats[:, 3] - 252
        assert mode.min() >= 0
        largest = np.sqrt(np.maximum(0, 1 - (kept**2).sum(1)))
        wxyz = np.array([np.insert(k, m, d) for k, m, d in zip(kept, mode, largest)])
        sh0 = pixels(archive, meta["sh0"]["files"][0])[:n]
        dc, alpha = np.array(meta["sh0"]["codebook"])[sh0[:, :3]], sh0[:, 3] / 255
        centroids, labels = meta["shN"]["files"]
        assert Image.open(BytesIO(archive.read(centroids))).width == 64 * 15
        label = pixels(archive, labels)[:n]
        label = label[:, 0] + 256 * label[:, 1]
        assert label.max() < meta["shN"]["count"]
        palette = pixels(archive, centroids)[:, :3].reshape(-1, 15, 3)
        rest = np.array(meta["shN"]["codebook"])[palette[label]]
    logit = np.log(np.clip(alpha, 1e-6, 1 - 1e-6) / (1 - np.clip(alpha, 1e-6, 1 - 1e-6)))
    flat = rest.transpose(0, 2, 1).reshape(n, 45)
    return np.concatenate([place, dc, flat, logit[:, None], scale, wxyz], 1)


def check_sog(path, table):
    found = sog_table(path)
    nearest = np.array([np.argmin(((found[:, :3] - p) ** 2).sum(1)) for p in table[:, :3]])
    assert len(set(nearest)) == len(table)
    found = found[nearest]
    worst = np.abs(found - table).max(0)
    assert worst[:3].max() < 2e-4, worst[:3]
    assert worst[3:51].max() < 0.03, worst[3:51]
    alphas = [1 / (1 + np.exp(-t[:, 51])) for t in (found, table)]
    assert np.abs(alphas[0] - alphas[1]).max() < 0.002
    assert worst[52:55].max() < 0.05, worst[52:55]
    a, b = (t[:, 55:59] / np.linalg.norm(t[:, 55:59], axis=1, keepdims=True) for t in (found, table))
    assert (1 - np.abs((a * b).sum(1))).max() < 1e-4


# Writes a SOG file with Pillow and zipfile. It is compressed with deflate, and has other image sizes and file names
# than the files that ubs writes.
def write_sog(path, table):
    n, width = len(table), 64
    height = (n + width - 1) // width + 1
    logs = np.sign(table[:, :3]) * np.log1p(np.abs(table[:, :3]))
    mins, maxs = logs.min(0), logs.max(0)
    bits = np.round(65535 * (logs - mins) / (maxs - mins)).astype(int)

    def image(values):
        out = np.full((height * width, 4), 255, np.uint8)
        out[:n, : values.shape[1]] = values
        stream = BytesIO()
        Image.fromarray(out.reshape(height, width, 4)).save(stream, "WEBP", lossless=True, exact=True)
        return stream.getvalue()

    def book(values):
        low, high = values.min(), values.max()
        return np.round(255 * (values - low) / (high - low)).astype(int), np.linspace(low, high, 256).tolist()

    scale, scale_book = book(table[:, 52:55])
    dc, dc_book = book(table[:, 3:6])
    q = table[:, 55:59] / np.linalg.norm(table[:, 55:59], axis=1, keepdims=True)
    mode = np.argmax(np.abs(q), 1)
    kept = np.array([np.delete(v, m) * np.sign(v[m]) for v, m in zip(q, mode)])
    quats = np.concatenate([np.round(255 * (kept / np.sqrt(2) + 0.5)), mode[:, None] + 252], 1)
    alpha = np.round(255 / (1 + np.exp(-table[:, 51:52])))
    meta = {
        "version": 2,
        "count": n,
        "antialias": True,
        "means": {"mins": mins.tolist(), "maxs": maxs.tolist(), "files": ["l.webp", "u.webp"]},
        "scales": {"codebook": scale_book, "files": ["s.webp"]},
        "quats": {"files": ["q.webp"]},
        "sh0": {"codebook": dc_book, "files": ["c.webp"]},
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in {
            "l.webp": bits & 255,
            "u.webp": bits >> 8,
            "s.webp": scale,
            "q.webp": quats,
            "c.webp": np.concatenate([dc, alpha], 1),
        }.items():
            archive.writestr(name, image(values))
        archive.writestr("meta.json", json.dumps(meta))


def main():
    rng = np.random.default_rng(5)
    table = np.concatenate(
        [
            rng.uniform(-3, 3, (COUNT, 3)),
            rng.uniform(-1, 1, (COUNT, 48)),
            rng.uniform(-3, 3, (COUNT, 1)),
            rng.uniform(-5, -1, (COUNT, 3)),
            rng.normal(0, 1, (COUNT, 4)),
        ],
        1,
    ).astype("<f4")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_ply(folder / "a.ply", table)
        table = table.astype(float)
        ubs("convert", folder / "a.ply", folder / "a.glb", "--to", "glb")
        check_glb(folder / "a.glb", table)
        ubs("convert", folder / "a.ply", folder / "a.sog", "--to", "sog")
        check_sog(folder / "a.sog", table)
        write_sog(folder / "b.sog", table)
        ubs("convert", folder / "b.sog", folder / "b.glb")
        table[:, 6:51] = 0
        globals()["DEGREE"] = 0
        ubs("convert", folder / "b.sog", folder / "b.ply", "--to", "3dgs")
        back = read_ply(folder / "b.ply")
        error = np.abs(back[:, :6] - table[:, :6]).max(0)
        assert error[:3].max() < 2e-4 and error[3:].max() < 0.005, error
        assert np.abs(back[:, 7:10] - table[:, 52:55]).max() < 0.01
    print("passed")


main()
