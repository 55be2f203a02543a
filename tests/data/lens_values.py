#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Creates tables of camera models with pycolmap. They contain rays and the pixels to which COLMAP projects them.

lens_values.py --points 15 --out tests/data/lens_values.txt    the table that tests/data/lens_test.cpp reads
lens_values.py --points 1000 --test build/tests/test_data      compares ubs with pycolmap at 1000 points of each model

If pycolmap is not installed, prints a message and exits with 77 (skipped). All 18 models need pycolmap 4.1 or newer.
"""
import argparse
import os
import subprocess
import sys
import tempfile

# Each row contains the name of a model, the largest angle between a ray and the optical axis in degrees, and the
# parameters. Below these angles, each polynomial is invertible.
LENSES = [
    ("SIMPLE_PINHOLE", 60, [210, 161, 118]),
    ("PINHOLE", 60, [210, 205, 161, 118]),
    ("SIMPLE_RADIAL", 45, [210, 161, 118, 0.08]),
    ("SIMPLE_RADIAL", 35, [210, 161, 118, -0.3]),
    ("RADIAL", 45, [210, 161, 118, -0.1, 0.02]),
    ("OPENCV", 40, [210, 205, 161, 118, -0.15, 0.03, 0.001, -0.002]),
    ("OPENCV_FISHEYE", 85, [210, 205, 161, 118, 0.02, -0.01, 0.003, -0.001]),
    ("OPENCV_FISHEYE", 85, [210, 205, 161, 118, -0.05, 0.01, 0, 0]),
    ("FULL_OPENCV", 40, [210, 205, 161, 118, -0.15, 0.03, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001]),
    ("FOV", 80, [210, 205, 161, 118, 0.7]),
    ("FOV", 80, [210, 205, 161, 118, 1.2]),
    ("SIMPLE_RADIAL_FISHEYE", 85, [210, 161, 118, 0.02]),
    ("RADIAL_FISHEYE", 85, [210, 161, 118, 0.02, -0.01]),
    ("THIN_PRISM_FISHEYE", 80, [210, 205, 161, 118, 0.02, -0.01, 0.001, -0.001, 0.002, 0.001, 0.003, -0.002]),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 80,
     [210, 205, 161, 118, 0.02, -0.01, 0.002, 0.001, 0.0005, -0.0002, 0.001, -0.001, 0.002, 0.001, -0.001, 0.0005]),
    ("SIMPLE_DIVISION", 120, [210, 161, 118, -0.2]),
    ("SIMPLE_DIVISION", 45, [210, 161, 118, 0.1]),
    ("DIVISION", 120, [210, 205, 161, 118, -0.2]),
    ("SIMPLE_FISHEYE", 88, [210, 161, 118]),
    ("FISHEYE", 88, [210, 205, 161, 118]),
    ("EUCM", 88, [210, 205, 161, 118, 0.6, 1.1]),
    ("EUCM", 80, [210, 205, 161, 118, 0.3, 0.8]),
    ("EQUIRECTANGULAR", 180, [320, 240]),
]


def write_table(pycolmap, numpy, points, out):
    out.write("# SPDX-License-Identifier: Apache-2.0\n")
    out.write(f"# Projections by pycolmap {pycolmap.__version__}, made by lens_values.py --points {points}.\n")
    out.write("# lens NAME WIDTH HEIGHT PARAMETERS..., then its lines: ray X Y Z COLUMN ROW\n")
    random = numpy.random.default_rng(54)
    known = pycolmap.CameraModelId.__members__
    missing = sorted({name for name, _, _ in LENSES if name not in known})
    if missing:
        print(f"pycolmap {pycolmap.__version__} does not have {', '.join(missing)}: these are not compared")
    for name, degrees, parameters in LENSES:
        if name in missing:
            continue
        camera = pycolmap.Camera(model=name, width=320, height=240, params=parameters)
        out.write(f"lens {name} 320 240 {' '.join(map(repr, parameters))}\n")
        cosine = random.uniform(numpy.cos(numpy.radians(degrees)), 1, points)
        turn = random.uniform(0, 2 * numpy.pi, points)
        sine = numpy.sqrt(1 - cosine**2)
        length = random.uniform(0.2, 5, points)
        rays = (numpy.stack([sine * numpy.cos(turn), sine * numpy.sin(turn), cosine]) * length).T
        rays[0] = [0, 0, 1]  # the centre, where formulas divide by the radius
        pixels = numpy.asarray(camera.img_from_cam(rays)).reshape(-1, 2)
        for ray, pixel in zip(rays, pixels):
            if not numpy.isfinite(pixel).all():
                sys.exit(f"{name}: pycolmap does not project {ray}")
            out.write(f"ray {' '.join(repr(float(v)) for v in (*ray, *pixel))}\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1000, help="number of points of each model [1000]")
    parser.add_argument("--out", help="file that the table is written to")
    parser.add_argument("--test", help="path of the program test_data, which is compared with a new table")
    options = parser.parse_args()
    try:
        import numpy
        import pycolmap
    except ImportError as error:
        print(f"skipped: {error} (pip install pycolmap); tests/data/lens_values.txt contains values of pycolmap")
        return 77
    if options.out:
        with open(options.out, "w", encoding="ascii") as out:
            write_table(pycolmap, numpy, options.points, out)
    if options.test:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "values.txt")
            with open(path, "w", encoding="ascii") as out:
                write_table(pycolmap, numpy, options.points, out)
            environment = dict(os.environ, UBS_LENS_VALUES=path)
            test = [options.test, "lens: every camera model agrees with pycolmap", "-s"]
            result = subprocess.run(test, env=environment, stdout=subprocess.PIPE, text=True, check=False)
            print(result.stdout if result.returncode else f"{options.points} points of each model agree")
            print("\n".join(line for line in result.stdout.splitlines() if "worst of" in line))
            return result.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
