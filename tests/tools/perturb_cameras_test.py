#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests tools/perturb_cameras.py. Usage: perturb_cameras_test.py UBS, where UBS is the path of ubs. The script copies
data sets with changed cameras, and the tests read the copies with `ubs info`."""
import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

import numpy as np

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "tools" / "perturb_cameras.py"
UBS = sys.argv.pop(1)
CENTRES = ((1, 0, 0), (-1, 0, 0), (0, 2, 0))
# The extent is 1.1 times the largest distance of a camera from the mean position, which is (0, 2/3, 0). The third
# camera is the farthest.
EXTENT = 1.1 * 4 / 3


def info(folder):
    done = subprocess.run([UBS, "info", folder, "--test-every", "0", "--json"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def write_images(folder):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    folder.mkdir(exist_ok=True)
    for i in range(len(CENTRES)):  # grey, 8 x 8
        (folder / f"view{i}.png").write_bytes(
            b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", 8, 8, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(8 * (b"\0" + 8 * b"\x7f"))) + chunk(b"IEND", b""))


def blender(folder):
    write_images(folder)
    frames = [{"file_path": f"view{i}", "transform_matrix": [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]}
              for i, (x, y, z) in enumerate(CENTRES)]
    for split in ("train", "test"):
        (folder / f"transforms_{split}.json").write_text(
            json.dumps({"camera_angle_x": 0.7, "w": 8, "h": 8, "frames": frames}))


def llff(folder):
    write_images(folder / "images")
    poses = [np.column_stack([[0, -1, 0], [1, 0, 0], [0, 0, 1], centre, [8, 8, 9]]) for centre in CENTRES]
    np.save(folder / "poses_bounds.npy", [np.append(pose, [2.0, 5.0]) for pose in poses])


def colmap(folder):
    write_images(folder / "images")
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    (model / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 1, 8, 8, 9, 9, 4, 4))
    # Each image has two keypoints, and only the second one belongs to a point. The lists of observations of the two
    # points have different lengths (0 and 1), so that reading them requires the length.
    (model / "images.bin").write_bytes(struct.pack("<Q", 3) + b"".join(
        struct.pack("<I7dI", i, 1, 0, 0, 0, -x, -y, -z, 1) + f"view{i}.png\0".encode()
        + struct.pack("<QddqddQ", 2, 1, 1, -1, 2, 2, 1) for i, (x, y, z) in enumerate(CENTRES)))
    (model / "points3D.bin").write_bytes(struct.pack("<Q", 2) + b"".join(
        struct.pack("<Q3d3Bd", i, 1 + i, 2, 3, 9, 9, 9, 0.5) + struct.pack("<Q", i) + bytes(8 * i) for i in range(2)))


class Scale(unittest.TestCase):
    def test_positions_are_multiplied(self):
        for layout in (blender, llff, colmap):
            with self.subTest(layout.__name__), tempfile.TemporaryDirectory() as temporary:
                data, out = pathlib.Path(temporary, "data"), pathlib.Path(temporary, "out")
                data.mkdir()
                layout(data)
                subprocess.run([sys.executable, SCRIPT, "scale", data, out, "1e4"], check=True)
                self.assertAlmostEqual(info(data)["extent"], EXTENT)
                self.assertAlmostEqual(info(out)["extent"], 1e4 * EXTENT)
                self.assertEqual(info(out)["points"], info(data)["points"])
                if layout is llff:
                    self.assertEqual(np.load(out / "poses_bounds.npy")[0, 15:].tolist(), [2e4, 5e4])
                if layout is colmap:
                    points = (out / "sparse/0/points3D.bin").read_bytes()
                    self.assertEqual([struct.unpack_from("<3d", points, at) for at in (16, 67)],
                                     [(1e4, 2e4, 3e4), (2e4, 2e4, 3e4)])

    def test_a_folder_without_known_cameras_is_refused(self):
        with tempfile.TemporaryDirectory() as temporary:
            data, out = pathlib.Path(temporary, "data"), pathlib.Path(temporary, "out")
            data.mkdir()
            (data / "transforms.json").write_text("{}")
            done = subprocess.run([sys.executable, SCRIPT, "scale", data, out, "2"], stderr=subprocess.PIPE, text=True)
            self.assertEqual(done.returncode, 1)
            self.assertIn("no poses_bounds.npy", done.stderr)
            self.assertFalse(out.exists())


if __name__ == "__main__":
    unittest.main()
