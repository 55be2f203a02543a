#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes copies of a data set whose camera poses are wrong, to measure how well training corrects them
(docs/results/2026-11-22-cameras.md), or which are in another unit of length (docs/results/2026-11-28-unit.md).

  perturb_cameras.py perturb DATA OUT [DEGREES SHARE]   write a copy of a Blender or COLMAP folder whose cameras are
                                                        rotated by DEGREES (default 0.5) and shifted by SHARE of the
                                                        scene's extent (default 0.01)
  perturb_cameras.py compare DATA OUT RUN               compare OUT and RUN/cameras with the correct cameras, which
                                                        are those of DATA: a data folder or a run
  perturb_cameras.py scale DATA OUT FACTOR              write a copy of a Blender, LLFF or COLMAP folder (with
                                                        binary files) in which all positions of cameras and points are
                                                        multiplied by FACTOR
"""
import json
import pathlib
import shutil
import struct
import sys

import numpy as np


def rotation_by(turn):
    angle = np.linalg.norm(turn)
    x, y, z = turn / max(angle, 1e-300)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def turn_of(r):
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    # For rotations of up to 4 degrees, this sine differs from the angle by less than 1e-4 rad.
    return axis


def quaternion_matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return rotation_by(2 * np.arctan2(np.linalg.norm([x, y, z]), w)
                       * np.array([x, y, z]) / max(np.linalg.norm([x, y, z]), 1e-300))


def matrix_quaternion(r):
    values, vectors = np.linalg.eigh(np.array([
        [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
        [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
        [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]]))
    x, y, z, w = vectors[:, np.argmax(values)]
    return np.array([w, x, y, z]) * (1 if w >= 0 else -1)


# Returns {file name: (world-to-camera rotation, centre, camera number)}.
def colmap_images(folder):
    found = {}
    if (folder / "images.txt").exists():
        lines = [line for line in (folder / "images.txt").read_text().splitlines() if not line.startswith("#")]
        for line in lines[::2]:
            _, qw, qx, qy, qz, tx, ty, tz, camera, name = line.split(maxsplit=9)
            r = quaternion_matrix(np.array([qw, qx, qy, qz], float))
            found[name] = (r, -r.T @ np.array([tx, ty, tz], float), int(camera))
        return found
    data, at = (folder / "images.bin").read_bytes(), 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        number = struct.unpack_from("<I7dI", data, at)
        end = data.index(b"\0", at + 64)
        r = quaternion_matrix(np.array(number[1:5]))
        found[data[at + 64:end].decode()] = (r, -r.T @ np.array(number[5:8]), number[8])
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
    return found


def poses_of(data):
    """Returns {name: (world-to-camera rotation, centre)}; names are SPLIT/VIEW, or VIEW if the data have no splits."""
    if (data / "sparse/0").exists():
        return {pathlib.Path(name).stem: pose[:2] for name, pose in colmap_images(data / "sparse/0").items()}
    found = {}
    for split in ("train", "test"):
        for frame in json.loads((data / f"transforms_{split}.json").read_text())["frames"]:
            m = np.array(frame["transform_matrix"])
            name = f"{split}/{pathlib.Path(frame['file_path']).stem}"
            found[name] = ((m[:3, :3] * [1, -1, -1]).T, m[:3, 3])
    return found


def perturbed(poses, degrees, share):
    random = np.random.default_rng(7)
    centres = np.array([centre for _, centre in poses.values()])
    extent = 1.1 * np.linalg.norm(centres - centres.mean(0), axis=1).max()
    unit = lambda: (v := random.normal(size=3)) / np.linalg.norm(v)
    return {name: (rotation_by(np.radians(degrees) * unit()) @ r, c + share * extent * unit())
            for name, (r, c) in poses.items()}


def perturb(data, out, degrees, share):
    poses = perturbed(poses_of(data), degrees, share)
    out.mkdir(parents=True)
    for entry in data.iterdir():
        if entry.is_dir() and entry.name != "sparse":
            shutil.copytree(entry, out / entry.name)
    if (data / "sparse/0").exists():
        sparse = out / "sparse/0"
        shutil.copytree(data / "sparse/0", sparse)
        images = colmap_images(sparse)
        text, binary = ["# perturbed"], struct.pack("<Q", len(images))
        for i, (name, (_, _, camera)) in enumerate(images.items()):
            r, centre = poses[pathlib.Path(name).stem]
            row = [i + 1, *matrix_quaternion(r), *(-r @ centre), camera]
            text += [" ".join(map(str, [*row, name])), ""]
            binary += struct.pack("<I7dI", *row) + name.encode() + b"\0" + struct.pack("<Q", 0)
        if (sparse / "images.txt").exists():
            (sparse / "images.txt").write_text("\n".join(text) + "\n")
        else:
            (sparse / "images.bin").write_bytes(binary)
        return
    for split in ("train", "test"):
        content = json.loads((data / f"transforms_{split}.json").read_text())
        for frame in content["frames"]:
            r, centre = poses[f"{split}/{pathlib.Path(frame['file_path']).stem}"]
            m = np.eye(4)
            m[:3, :3], m[:3, 3] = r.T * [1, -1, -1], centre
            frame["transform_matrix"] = m.tolist()
        (out / f"transforms_{split}.json").write_text(json.dumps(content))


def multiply(data, at, factor):
    """Multiplies the three doubles at this position of the data."""
    struct.pack_into("<3d", data, at, *(factor * value for value in struct.unpack_from("<3d", data, at)))


def scale(data, out, factor):
    model, frames = "sparse/0/images.bin", sorted(data.glob("transforms_*.json"))
    if not frames and not any((data / name).exists() for name in ("poses_bounds.npy", model)):
        sys.exit(f"{data}: no poses_bounds.npy, {model} or transforms_*.json: only these cameras can be scaled")
    shutil.copytree(data, out)
    if (out / "poses_bounds.npy").exists():  # 3 x 5 numbers whose fourth column is the position, and two depths
        rows = np.load(out / "poses_bounds.npy")
        rows[:, [3, 8, 13, 15, 16]] *= factor
        np.save(out / "poses_bounds.npy", rows)
    if (out / model).exists():
        file = out / model
        images, at = bytearray(file.read_bytes()), 8
        for _ in range(struct.unpack_from("<Q", images)[0]):
            multiply(images, at + 36, factor)
            end = images.index(b"\0", at + 64)
            at = end + 9 + 24 * struct.unpack_from("<Q", images, end + 1)[0]
        file.write_bytes(images)
        file = out / "sparse/0/points3D.bin"
        points, at = bytearray(file.read_bytes()), 8
        for _ in range(struct.unpack_from("<Q", points)[0]):
            multiply(points, at + 8, factor)
            at += 51 + 8 * struct.unpack_from("<Q", points, at + 43)[0]
        file.write_bytes(points)
    for file in (out / path.name for path in frames):
        content = json.loads(file.read_text())
        for frame in content["frames"]:
            for row in frame["transform_matrix"][:3]:
                row[3] *= factor
        file.write_text(json.dumps(content))


def error(poses, truth):
    """Returns the number of common views, and the root mean square errors of rotations [degrees] and of centres, after
    the best similarity transform."""
    names = sorted(set(poses) & set(truth))
    r, c = (np.array([poses[n][k] for n in names]) for k in (0, 1))
    rt, ct = (np.array([truth[n][k] for n in names]) for k in (0, 1))
    back = rotation_by(-np.mean([turn_of(a.T @ b) for a, b in zip(r, rt)], axis=0))
    away, away_t = (c - c.mean(0)) @ back.T, ct - ct.mean(0)
    scale = (away * away_t).sum() / (away * away).sum()
    turns = [turn_of(a @ back.T @ b.T) for a, b in zip(r, rt)]
    rms = lambda rows: np.sqrt((np.array(rows) ** 2).sum(1).mean())
    return len(names), np.degrees(rms(turns)), rms(scale * away - away_t)


def training_poses(run, names):
    """Returns the poses in RUN/cameras, with the names of `names`, which may include the split."""
    found = {}
    for name, pose in colmap_images(run / "cameras").items():
        key = name.removesuffix(".png")
        if key.startswith("train/"):
            found[key if key in names else key.split("/", 1)[1]] = pose[:2]
    return found


def compare(data, out, run):
    given = poses_of(out)
    truth = training_poses(data, given) if (data / "cameras").exists() else poses_of(data)
    refined = training_poses(run, given)
    given = {name: pose for name, pose in given.items() if name in refined}
    count, turn, centre = error(given, truth)
    print(f"{count} training cameras: before training, rotation error {turn:.4f} degrees, position error {centre:.5f}")
    _, turn2, centre2 = error(refined, truth)
    print(
        f"after refinement, rotation error {turn2:.4f} degrees ({turn2 / turn:.0%} of the error before), "
        f"position error {centre2:.5f} ({centre2 / centre:.0%})"
    )


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if len(arguments) in (3, 5) and arguments[0] == "perturb":
        perturb(*map(pathlib.Path, arguments[1:3]), *map(float, arguments[3:] or (0.5, 0.01)))
    elif len(arguments) == 4 and arguments[0] == "compare":
        compare(*map(pathlib.Path, arguments[1:]))
    elif len(arguments) == 4 and arguments[0] == "scale":
        scale(*map(pathlib.Path, arguments[1:3]), float(arguments[3]))
    else:
        sys.exit(__doc__)
