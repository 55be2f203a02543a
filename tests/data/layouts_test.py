#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes an analytic scene in the forms of photogrammetry programs, and tests that ubs reads them.

layouts_test.py --test build/tests/test_data

The scene is the inside of a sphere, whose colour is a smooth function of the position. Its images are computed with the
lens formulas in the documents of the programs, which are written here independently of ubs. The test compares each
pixel of each view that ubs makes with the colour at the point where the ray of this pixel hits the sphere. So it finds
wrong poses, axes, pixel centres, intrinsics and lens coefficients. Only Python's standard library is needed.
"""
import argparse
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import zlib

W, H = 80, 60
RADIUS = 4.0  # of the sphere, whose centre is the origin


def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def apply(a, v):
    return [sum(a[i][k] * v[k] for k in range(3)) for i in range(3)]


def transposed(a):
    return [[a[j][i] for j in range(3)] for i in range(3)]


def about(axis, degrees):
    """Rotation about the axis with this index."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    m = [[float(r == k) for k in range(3)] for r in range(3)]
    m[i][i], m[i][j], m[j][i], m[j][j] = c, -s, s, c
    return m


# Each camera has a position and the angles heading, pitch and roll of RealityCapture. If all angles are 0, the camera
# looks down (-z) and the top of its image is in the direction +y. The rotation is camera-to-world, y up, z backward.
CAMERAS = []
for index, (place, angles) in enumerate([((1.0, 0.5, 0.3), (20, 70, 5)), ((-0.8, 0.9, -0.2), (140, 95, -12)),
                                         ((0.2, -1.1, 0.6), (-75, 40, 30)), ((0.1, 0.2, -0.9), (260, 120, 3))]):
    heading, pitch, roll = angles
    CAMERAS.append({"name": f"im{index}", "position": list(place), "angles": angles,
                    "gl": mul(mul(about(2, -heading), about(0, pitch)), about(1, roll))})
FLIP = [[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]]
for camera in CAMERAS:
    camera["cv"] = mul(camera["gl"], FLIP)  # camera-to-world, y down, z forward


def colour(p):
    """Colour of a point of the sphere; tests/data/layouts_test.cpp has the same function."""
    x, y, z = (v / RADIUS for v in p)
    return [0.5 + 0.4 * math.sin(5 * x + 1), 0.5 + 0.4 * math.sin(6 * y + 2 * x), 0.5 + 0.4 * math.cos(5 * z - y)]


def png(path, rows):
    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    raw = b"".join(b"\0" + bytes(row) for row in rows)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", W, H, 8, 2, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


def invert(distort, target):
    """Returns the position that `distort` maps to `target`, by Newton's method with numeric derivatives."""
    x = y = 0.0
    for _ in range(20):
        u, v = distort(x, y)
        e = 1e-6
        ux, vx = distort(x + e, y)
        uy, vy = distort(x, y + e)
        a, b, c, d = (ux - u) / e, (uy - u) / e, (vx - v) / e, (vy - v) / e
        det = a * d - b * c
        x, y = x - (d * (u - target[0]) - b * (v - target[1])) / det, y - (a * (v - target[1]) - c * (u - target[0])) / det
    return x, y


def images(folder, distort, names, fisheye=False):
    """Writes the images. `distort` maps the position (X/Z, Y/Z), or for a fisheye the position whose distance from the
    centre is the angle, to pixels, with (0.5, 0.5) at the centre of the first pixel."""
    for camera, name in zip(CAMERAS, names):
        rows = []
        for row in range(H):
            pixels = []
            for column in range(W):
                x, y = invert(distort, (column + 0.5, row + 0.5))
                z = 1.0
                if fisheye:
                    angle = math.hypot(x, y)
                    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
                    x, y, z = s * x, s * y, math.cos(angle)
                d = apply(camera["cv"], [x, y, z])
                p = camera["position"]
                a, b, c = sum(v * v for v in d), sum(u * v for u, v in zip(d, p)), sum(v * v for v in p) - RADIUS**2
                t = (-b + math.sqrt(b * b - a * c)) / a
                pixels += [round(255 * v) for v in colour([u + t * v for u, v in zip(p, d)])]
            rows.append(pixels)
        png(os.path.join(folder, name), rows)


def write(path, text):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def numbers(values):
    return " ".join(f"{v:.15g}" for v in values)


# ---- Metashape: manual, appendix "Camera models" ----

def metashape(folder, fisheye):
    k1, k2, k3, k4, p1, p2 = (-0.08, 0.03, -0.01, 0.004, 0.003, -0.002) if not fisheye else \
        (0.03, -0.02, 0.004, -0.001, 0.002, -0.003)
    f, cx, cy, b1, b2 = (70.0, 1.7, -2.3, 1.2, 0.9) if not fisheye else (52.0, 1.7, -2.3, 1.2, 0.0)

    def distort(x, y):
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        u = x * radial + (p1 * (r2 + 2 * x * x) + 2 * p2 * x * y)
        v = y * radial + (p2 * (r2 + 2 * y * y) + 2 * p1 * x * y)
        return W * 0.5 + cx + u * f + u * b1 + v * b2, H * 0.5 + cy + v * f

    images(f"{folder}/images", distort, [c["name"] + ".png" for c in CAMERAS], fisheye)
    # World = scale R x + t; the cameras are in the coordinates of the chunk.
    turn, shift, scale = mul(about(0, 25), about(2, -40)), [3.0, -2.0, 1.5], 2.5
    back = transposed(turn)
    text = ""
    for index, c in enumerate(CAMERAS):
        rotation = mul(back, c["cv"])
        position = [v / scale for v in apply(back, [u - s for u, s in zip(c["position"], shift)])]
        rows = [v for r in range(3) for v in rotation[r] + [position[r]]] + [0, 0, 0, 1]
        label = c["name"] + (".png" if index == 1 else "")
        text += f'<camera id="{index}" sensor_id="3" component_id="0" label="{label}" enabled="true">' \
                f"<transform>{numbers(rows)}</transform></camera>\n"
    text += '<camera id="8" sensor_id="3" label="disabled" enabled="false"><transform>' + numbers([0] * 16) + \
            '</transform></camera><camera id="9" sensor_id="3" label="unaligned"/>\n'
    motion = f"<transform><rotation>{numbers(sum(turn, []))}</rotation><translation>{numbers(shift)}</translation>" \
             f"<scale>{scale}</scale></transform>"
    if fisheye:  # older versions have one transform for the chunk
        place, components = motion, ""
    else:
        place, components = "", f'<components><component id="0">{motion}</component></components>'
    kind = "equidistant_fisheye" if fisheye else "frame"
    write(f"{folder}/cameras.xml", f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="4">
<sensor id="3" label="camera" type="{kind}"><resolution width="{W}" height="{H}"/>
<calibration type="{kind}" class="initial"><f>40</f></calibration>
<calibration type="{kind}" class="adjusted"><resolution width="{W}" height="{H}"/><f>{f}</f><cx>{cx}</cx><cy>{cy}</cy>
<b1>{b1}</b1><b2>{b2}</b2><k1>{k1}</k1><k2>{k2}</k2><k3>{k3}</k3><k4>{k4}</k4><p1>{p1}</p1><p2>{p2}</p2></calibration>
</sensor></sensors>{components}<cameras>{text}</cameras>{place}</chunk></document>
""")


# ---- RealityCapture: support article "RealityCapture XMP Camera Math"; the tangential terms as in Camorph and
# AliceVision, which exchange t1 and t2 for OpenCV's formula ----

def realitycapture(folder, xmp):
    f35, px, py = 32.0, 0.02, -0.015
    k, t = (-0.07, 0.02, -0.006, 0.002), (0.002, -0.003)
    size = max(W, H)

    def distort(x, y):
        r2 = x * x + y * y
        radial = 1 + sum(value * r2**(i + 1) for i, value in enumerate(k))
        u = x * radial + t[0] * (r2 + 2 * x * x) + 2 * t[1] * x * y
        v = y * radial + t[1] * (r2 + 2 * y * y) + 2 * t[0] * x * y
        return W / 2 + (u * f35 / 36 + px) * size, H / 2 + (v * f35 / 36 + py) * size

    images(f"{folder}/images", distort, [c["name"] + ".png" for c in CAMERAS])
    if not xmp:
        text = "\ufeff#cameras 4\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n"
        for c in CAMERAS:
            values = [*c["position"], *c["angles"], f35, px, py, *k, *t]
            text += c["name"] + ".png," + ",".join(f"{v:.10g}" for v in values) + "\r\n"
        return write(f"{folder}/cameras.csv", text)
    for c in CAMERAS:
        write(f"{folder}/images/{c['name']}.xmp", f"""<x:xmpmeta xmlns:x="adobe:ns:meta/">
 <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description xcr:Version="3"
  xcr:PosePrior="initial" xcr:Coordinates="absolute" xcr:DistortionModel="brown4t2" xcr:FocalLength35mm="{f35}"
  xcr:Skew="0" xcr:AspectRatio="1" xcr:PrincipalPointU="{px}" xcr:PrincipalPointV="{py}"
  xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
  <xcr:Rotation>{numbers(sum(transposed(c["cv"]), []))}</xcr:Rotation>
  <xcr:Position>{numbers(c["position"])}</xcr:Position>
  <xcr:DistortionCoeficients>{numbers([*k, *t])}</xcr:DistortionCoeficients>
 </rdf:Description></rdf:RDF></x:xmpmeta>
""")


# ---- OpenSfM: documentation, "Geometric models" and "Dataset structure" ----

def rotation_vector(m):
    angle = math.acos(max(-1.0, min(1.0, (m[0][0] + m[1][1] + m[2][2] - 1) / 2)))
    s = angle / (2 * math.sin(angle))
    return [s * (m[2][1] - m[1][2]), s * (m[0][2] - m[2][0]), s * (m[1][0] - m[0][1])]


def opensfm(folder, kind):
    size = max(W, H)
    f, fy, c = 0.9, 0.92, (0.02, -0.03)
    if kind == "perspective":
        lens = {"focal": f, "k1": -0.06, "k2": 0.02}
        fy, c = f, (0.0, 0.0)
    elif kind == "brown":
        lens = {"focal_x": f, "focal_y": fy, "c_x": c[0], "c_y": c[1], "k1": -0.06, "k2": 0.02, "k3": -0.004,
                "p1": 0.002, "p2": -0.003}
    else:
        f = fy = 0.7
        c = (0.0, 0.0)
        lens = {"focal": f, "k1": 0.03, "k2": -0.01}

    def distort(x, y):
        r2 = x * x + y * y
        radial = 1 + lens["k1"] * r2 + lens["k2"] * r2**2 + lens.get("k3", 0) * r2**3
        p1, p2 = lens.get("p1", 0), lens.get("p2", 0)
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return W / 2 + size * (f * u + c[0]), H / 2 + size * (fy * v + c[1])

    images(f"{folder}/images", distort, [camera["name"] + ".png" for camera in CAMERAS], kind == "fisheye")
    shots = {}
    for camera in CAMERAS:
        r = transposed(camera["cv"])
        shots[camera["name"] + ".png"] = {"rotation": rotation_vector(r), "camera": "v2 cam",
                                          "translation": [-v for v in apply(r, camera["position"])]}
    part = {"cameras": {"v2 cam": {"projection_type": kind, "width": W, "height": H, **lens}}, "shots": shots,
            "points": {"7": {"color": [10.0, 20.0, 30.0], "coordinates": [1.0, 2.0, 3.0]}}}
    empty = {"cameras": {}, "shots": {}, "points": {}}
    name = "opensfm/reconstruction.json" if kind == "brown" else "reconstruction.json"  # ODM, OpenSfM
    write(f"{folder}/{name}", json.dumps([empty, part]))


# ---- Bundler: user's manual, "Output format" ----

def bundler(folder):
    f, k1, k2 = 75.0, -0.05, 0.02

    def distort(x, y):
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2
        return W / 2 + f * radial * x, H / 2 + f * radial * y

    images(f"{folder}/images", distort, [c["name"] + ".png" for c in CAMERAS])
    text = f"# Bundle file v0.3\n{len(CAMERAS) + 1} 1\n" + "0 0 0\n" * 5
    for c in CAMERAS:
        r = transposed(c["gl"])  # world-to-camera, y up, z backward
        text += f"{f} {k1} {k2}\n" + "".join(numbers(row) + "\n" for row in r)
        text += numbers([-v for v in apply(r, c["position"])]) + "\n"
    write(f"{folder}/bundle/bundle.out", text + "1 2 3\n10 20 30\n1 0 5 1.5 2.5\n")
    write(f"{folder}/list.txt", "".join(f"images/{n}.png 0 75.0\n" for n in ["lost"] + [c["name"] for c in CAMERAS]))


# ---- Phones: poses as ARKit has them ----

def pinhole(fx, fy, cx, cy):
    return lambda x, y: (cx + fx * x, cy + fy * y)


def polycam(folder):
    lens = (70.0, 71.0, 41.5, 28.5)
    images(f"{folder}/keyframes/corrected_images", pinhole(*lens), [f"00{i}.png" for i in range(len(CAMERAS))])
    for i, c in enumerate(CAMERAS):
        values = {f"t_{r}{k}": (c["gl"][r] + [c["position"][r]])[k] for r in range(3) for k in range(4)}
        values.update(zip(("fx", "fy", "cx", "cy"), lens), width=W, height=H, blur_score=100)
        write(f"{folder}/keyframes/corrected_cameras/00{i}.json", json.dumps(values))
    write(f"{folder}/keyframes/cameras/000.json", json.dumps({"t_00": 1}))  # of the recording; not used


def quaternion(m):
    """Returns x y z w."""
    w = math.sqrt(max(0.0, 1 + m[0][0] + m[1][1] + m[2][2])) / 2
    if w < 0.1:
        x = math.sqrt(max(0.0, 1 + m[0][0] - m[1][1] - m[2][2])) / 2
        if x > 0.1:
            return [x, (m[0][1] + m[1][0]) / (4 * x), (m[0][2] + m[2][0]) / (4 * x), (m[2][1] - m[1][2]) / (4 * x)]
    return [(m[2][1] - m[1][2]) / (4 * w), (m[0][2] - m[2][0]) / (4 * w), (m[1][0] - m[0][1]) / (4 * w), w]


def record3d(folder):
    lens = (70.0, 71.0, 41.5, 28.5)
    images(f"{folder}/rgbd", pinhole(*lens), [f"{i}.png" for i in range(len(CAMERAS))])
    fx, fy, cx, cy = lens
    write(f"{folder}/metadata", json.dumps({"w": W, "h": H, "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1], "fps": 60,
                                            "poses": [quaternion(c["gl"]) + c["position"] for c in CAMERAS]}))


def nerfcapture(folder):
    lens = (70.0, 71.0, 41.5, 28.5)
    images(f"{folder}/images", pinhole(*lens), [f"{i}.png" for i in range(len(CAMERAS))])
    frames = []
    for i, c in enumerate(CAMERAS):
        matrix = [c["gl"][r] + [c["position"][r]] for r in range(3)] + [[0, 0, 0, 1]]
        frames.append({"file_path": f"images/{i}", "transform_matrix": matrix, "fl_x": lens[0], "fl_y": lens[1],
                       "cx": lens[2], "cy": lens[3], "w": W, "h": H, "timestamp": 0.1 * i})
    write(f"{folder}/transforms.json", json.dumps({"camera_model": "OPENCV", "frames": frames}))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--test", required=True, help="the executable test_data")
    parser.add_argument("--out", help="write the data here, and keep them")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        out = options.out or temporary
        metashape(f"{out}/metashape-frame", False)
        metashape(f"{out}/metashape-fisheye", True)
        realitycapture(f"{out}/realitycapture-csv", False)
        realitycapture(f"{out}/realitycapture-xmp", True)
        for kind in ("perspective", "brown", "fisheye"):
            opensfm(f"{out}/opensfm-{kind}", kind)
        bundler(f"{out}/bundler")
        polycam(f"{out}/polycam")
        record3d(f"{out}/record3d")
        nerfcapture(f"{out}/nerfstudio-nerfcapture")
        environment = dict(os.environ, UBS_LAYOUTS=out)
        return subprocess.run([options.test, "[.layouts]"], env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
