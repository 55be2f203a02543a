#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares training from wide images with training from pinhole images of the same directions.

wide_lens.py UBS MODEL FOLDER renders MODEL from poses around the origin: panoramas, fisheye images of 200 degrees with
a mask, and the pinhole images of the six faces of a cube, all with about the same resolution. It trains with each set
and three seeds, measures all models with pinhole images of other poses, and compares MODEL with the wide images in
their own lens. The data sets and runs are written to FOLDER. docs/results/2026-11-28-wide-lens.md has the figures.
"""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

PANORAMA, FISHEYE, FACE = (512, 256), (256, 256), (163, 163)  # width and height [px]
FACE_FOCAL = PANORAMA[0] / (2 * math.pi)  # the resolution of the panorama at its centre [px per radian]
FISHEYE_FOCAL = FISHEYE[0] / math.radians(200)
LIMIT = math.radians(99)  # directions farther from the axis are masked in fisheye images
# Rotations from the camera of the wide image to that of a face.
FACES = {
    "front": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "right": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "back": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "left": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "up": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "down": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
}
PINHOLE = f"PINHOLE {FACE[0]} {FACE[1]} {FACE_FOCAL} {FACE_FOCAL} {FACE[0] / 2} {FACE[1] / 2}"


def run(ubs, *arguments):
    done = subprocess.run([ubs, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{arguments}: {done.stderr}")
    return done.stdout


def quaternion(rotation):
    """Returns the quaternion w, x, y, z of a rotation matrix (the method of Bar-Itzhack)."""
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]  # reads the lower triangle
    return w, x, y, z


def poses(count, phase):
    """Yields names, positions around the origin, and rotations that look at a point above the origin."""
    for i in range(count):
        angle = 2 * math.pi * (i + phase) / count
        radius, height = 1.6 + 1.2 * ((0.37 * i + phase) % 1), 0.5 + (0.61 * i + phase) % 1
        centre = np.array([radius * math.cos(angle), radius * math.sin(angle), height])
        forward = np.array([0, 0, 0.3]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        yield f"im{i:03d}", centre, np.stack([right, np.cross(forward, right), forward])


def face_views(views, faces):
    return [(f"{name}_{face}", centre, np.array(FACES[face]) @ r) for name, centre, r in views for face in faces]


def face_mask(face):
    """Returns the mask of the pixels of a face that show directions within LIMIT of the axis of the wide image."""
    y, x = np.mgrid[0 : FACE[1], 0 : FACE[0]]
    ray = np.stack([(x + 0.5 - FACE[0] / 2) / FACE_FOCAL, (y + 0.5 - FACE[1] / 2) / FACE_FOCAL, np.ones(x.shape)], -1)
    return np.arccos((ray @ np.array(FACES[face]))[..., 2] / np.linalg.norm(ray, axis=-1)) <= LIMIT


def fisheye_mask():
    y, x = np.mgrid[0 : FISHEYE[1], 0 : FISHEYE[0]]
    return np.hypot(x + 0.5 - FISHEYE[0] / 2, y + 0.5 - FISHEYE[1] / 2) <= LIMIT * FISHEYE_FOCAL


def write_set(folder, camera, size, views, masks=None):
    """Writes a COLMAP text model with black images. If `masks` is given, also writes the masks that it returns for the
    names of the views."""
    for part in ("images", "sparse/0"):
        (folder / part).mkdir(parents=True)
    lines = []
    for number, (name, centre, rotation) in enumerate(views, 1):
        numbers = " ".join(f"{v:.17g}" for v in [*quaternion(rotation), *(-rotation @ centre)])
        lines.append(f"{number} {numbers} 1 {name}.png\n\n")
        Image.new("RGB", size).save(folder / "images" / f"{name}.png")
        if masks:
            (folder / "masks").mkdir(exist_ok=True)
            Image.fromarray(255 * masks(name).astype(np.uint8)).save(folder / "masks" / f"{name}.png")
    (folder / "sparse/0/cameras.txt").write_text(f"1 {camera}\n")
    (folder / "sparse/0/images.txt").write_text("".join(lines))
    (folder / "sparse/0/points3D.txt").write_text("# none\n")


def render_set(ubs, model, folder, cameras, *lens):
    """Replaces the images of a set by renders from the pinhole cameras of another set with the same names."""
    out = folder / "rendered"
    views = ("--split", "train", "--test-every", 0)
    run(ubs, "render", model, cameras, *views, "--background", "0,0,0", "--out", out, *lens)
    for file in out.glob("*.png"):
        shutil.move(file, folder / "images" / file.name)


def evaluate(ubs, model, folder, *more):
    return json.loads(
        run(ubs, "eval", model, folder, "--split", "train", "--test-every", 0, "--fps-views", 0, "--json", *more)
    )


def main(ubs, model, root):
    root = Path(root)
    train, test = list(poses(30, 0)), list(poses(6, 0.41))
    within = [face for face in FACES if face_mask(face).any()]
    for name, views in (("pinhole", train), ("test", test)):
        write_set(root / name, PINHOLE, FACE, face_views(views, FACES))
        render_set(ubs, model, root / name, root / name)
        masked = root / f"{name}-masked"
        write_set(masked, PINHOLE, FACE, face_views(views, within), lambda view: face_mask(view.split("_")[1]))
        for file in (masked / "images").iterdir():
            shutil.copy(root / name / "images" / file.name, file)
    write_set(root / "poses", "PINHOLE 64 64 32 32 32 32", (64, 64), train)
    size = "{}x{}".format
    panorama = "EQUIRECTANGULAR {0} {1} {0} {1}".format(*PANORAMA)
    write_set(root / "panorama", panorama, PANORAMA, train)
    render_set(ubs, model, root / "panorama", root / "poses", "--lens", "equirectangular", "--size", size(*PANORAMA))
    fisheye = f"SIMPLE_FISHEYE {FISHEYE[0]} {FISHEYE[1]} {FISHEYE_FOCAL} {FISHEYE[0] / 2} {FISHEYE[1] / 2}"
    write_set(root / "fisheye", fisheye, FISHEYE, train, lambda view: fisheye_mask())
    render_set(ubs, model, root / "fisheye", root / "poses", "--lens", "fisheye:200", "--size", size(*FISHEYE))
    for name in ("panorama", "fisheye"):
        found = evaluate(ubs, model, root / name, "--background", "0,0,0")
        of_views = np.mean([view["psnr_joint"] for view in found["views"]])
        whole = found["mean"]["psnr_joint"]
        print(f"{name}: mean PSNR {whole:.2f} dB of wide images, {of_views:.2f} dB of their views", flush=True)
    for name in ("panorama", "pinhole", "fisheye", "pinhole-masked"):
        judge = "test" if name in ("panorama", "pinhole") else "test-masked"
        values = []
        for seed in range(3):
            out = root / f"run-{name}-{seed}"
            options = ("--test-every 0 --schedule published --iterations 1500 --cap-max 12000 --dim 6 "
                       "--set opacity_reg=0 --quiet")
            run(ubs, "train", root / name, "--out", out, "--seed", seed, *options.split())
            values.append(evaluate(ubs, out, root / judge)["mean"]["psnr_joint"])
        print(f"{name}: {', '.join(f'{v:.2f}' for v in values)} dB, mean {np.mean(values):.2f} dB", flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
