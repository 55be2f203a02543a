# SPDX-License-Identifier: Apache-2.0
"""Compares pages of `ubs web` in a real browser with the images of `ubs render`. Run it as web_test.py UBS [NAME ...],
with the path of the executable ubs and the names of tests.

Exits with 77 if Chromium or numpy is not installed. UBS_CHROMIUM selects another browser that is based on
Chromium. Without NAME, all tests are run except those of LONG, which are only run with UBS_TEST_ALL=1."""

import base64
import contextlib
import gzip
import http.server
import json
import math
import os
import re
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from pathlib import Path

import browser

try:
    import numpy as np
except ImportError:
    print("SKIPPED: the tests of pages need numpy")
    sys.exit(77)

UBS = sys.argv[1]
SIZE = (96, 72)
FOV = 50
COUNT = 700


# ---- Cameras, for the page and for `ubs render` ----


def look(position, target, up=(0, 0, 1)):
    forward = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def camera(position, target, when):
    focal = SIZE[0] / 2 / math.tan(math.radians(FOV) / 2)
    return {
        "centre": list(map(float, position)),
        "rotation": look(position, target).flatten().tolist(),
        "fx": focal,
        "fy": focal,
        "cx": SIZE[0] / 2,
        "cy": SIZE[1] / 2,
        "width": SIZE[0],
        "height": SIZE[1],
        "time": when,
    }


CAMERAS = [
    camera((3, 0.5, 1), (0, 0, 0), 0.4),
    camera((-1, -2.5, -0.5), (0, 0, 0), 0),
    camera((0, 2, 2), (0, 0, 0), 1),
    camera((0.1, 0.05, 0), (1, 0.3, 0.1), 0.6),  # inside the model
    camera((1.2, 0, 0.02), (-5, 0.1, 0), 0.2),  # close to the model
    camera((40, 10, 3), (0, 0, 0), 0.8),  # far away
]


# Returns the comments with the cameras in the header of the model file (docs/data.md).
def notes():
    c = CAMERAS[0]
    lines = [f"comment ubs_lens {c['width']} {c['height']} {c['fx']:.9g} {c['fy']:.9g}"]
    for c in CAMERAS:
        r = np.array(c["rotation"]).reshape(3, 3)
        values, vectors = np.linalg.eigh(  # the quaternion is the eigenvector of the largest eigenvalue
            np.array(
                [
                    [np.trace(r), r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
                    [0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
                    [0, 0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
                    [0, 0, 0, r[2, 2] - r[0, 0] - r[1, 1]],
                ]
            ),
            UPLO="U",
        )
        numbers = [*vectors[:, np.argmax(values)], *c["centre"], c["time"]]
        lines.append("comment ubs_camera " + " ".join(f"{v:.7g}" for v in numbers))
    return lines


# ---- Models: random splats whose image depends on every parameter ----


def rows(rng, n, dim, switches, size=1.0):
    c = dim - 3
    columns = [(name, rng.normal(0, 0.45, n)) for name in "xyz"]
    colour = switches.get("colour", "rgb")
    if colour == "rgb":
        columns += [(name, rng.uniform(0, 1, n)) for name in ("red", "green", "blue")]
    elif colour.startswith("sb"):
        lobes = int(colour[2])
        columns += [(f"f_dc_{k}", rng.normal(0, 1, n)) for k in range(3)]
        # Each lobe has three colours, two angles and a beta.
        columns += [
            (f"sb_params_{k}", rng.normal(0, 0.4 if k < 3 * lobes else 2 if k < 5 * lobes else 1, n))
            for k in range(6 * lobes)
        ]
    else:
        rest = 3 * (int(colour[2]) + 1) ** 2 - 3
        columns += [(f"f_dc_{k}", rng.normal(0, 1, n)) for k in range(3)]
        columns += [(f"f_rest_{k}", rng.normal(0, 0.3, n)) for k in range(rest)]
    columns.append(("opacity", rng.normal(0, 2, n)))
    if switches.get("kernel") != "gaussian":
        columns.append(("beta_0", rng.normal(-0.3, 0.7, n)))
    if not (switches.get("beta_cond") == "off" and switches.get("beta_opacity", "tanh") != "tanh"):
        learnt = switches.get("conditioning") == "direct" and switches.get("beta_opacity", "tanh") != "tanh"
        columns += [(f"lambda_{k + 1}" if learnt else f"beta_{k + 1}", rng.normal(-2, 1, n)) for k in range(c)]
    columns += [
        (f"mean_{k}", rng.uniform(-0.6, 0.6, n) if k < 3 <= c else rng.uniform(0, 1, n)) for k in range(c)
    ]
    columns += [(f"scale_{k}", np.log(np.expm1(size * rng.uniform(0.03, 0.2, n)))) for k in range(3)]
    if switches.get("conditioning") == "direct":
        packed = [(i, j) for i in range(c) for j in range(i + 1)]
        columns += [(f"precision_{k}", rng.normal(1 if i == j else 0, 0.4, n)) for k, (i, j) in enumerate(packed)]
        columns += [(f"l_triangle_{k}", rng.normal(0, 0.5, n)) for k in range(3)]
        columns += [(f"theta_{k}", rng.normal(0, 1, n)) for k in range(3 * c)]
        return [name for name, _ in columns], np.stack([v for _, v in columns], 1).astype("<f4")
    columns += [(f"scale_{k + 3}", rng.normal(0.5, 0.3, n)) for k in range(c)]
    if switches.get("rot_mode") == "quaternion":
        columns += [(f"rot_{k}", rng.normal(0, 1, n)) for k in range(4)]
    else:
        size = 0.03 if switches.get("cov_param") == "cholesky" else 0.5
        columns += [
            (f"l_triangle_{k}", rng.normal(0, size if k < 3 else 0.2, n)) for k in range(dim * (dim - 1) // 2)
        ]
    return [name for name, _ in columns], np.stack([v for _, v in columns], 1).astype("<f4")


def write_model(path, dims, seed=1, count=COUNT, size=1.0, **switches):
    rng = np.random.default_rng(seed)
    lines, blocks = ["ply", "format binary_little_endian 1.0"], []
    lines += [f"comment ubs {key} {value}" for key, value in switches.items()]
    if len(dims) > 1:
        lines.append("comment ubs groups " + ",".join(map(str, dims)))
    lines += ["comment ubs_drawn background=0.2,0.4,0.3", *notes()]
    for k, dim in enumerate(dims):
        names, values = rows(rng, count // len(dims), dim, switches, size)
        lines.append(f"element vertex{'' if k == 0 else f'_{dim}d'} {len(values)}")
        lines += [f"property float {name}" for name in names]
        blocks.append(values.tobytes())
    Path(path).write_bytes(("\n".join(lines) + "\nend_header\n").encode() + b"".join(blocks))


def keyframes(path):
    frames = []
    for c in CAMERAS:
        rotation, centre = np.array(c["rotation"]).reshape(3, 3), np.array(c["centre"])
        pose = np.concatenate([rotation, -(rotation @ centre)[:, None]], 1)
        frames.append({"world_to_camera": pose.tolist(), "fov": FOV, "time": c["time"]})
    Path(path).write_text(json.dumps({"closed": False, "keyframes": frames}))


# ---- Helpers ----


def ubs(*arguments, code=0):
    done = subprocess.run([UBS, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == code, f"ubs {' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}"
    return done.stdout


def rendered(folder, model, channel="rgb"):
    keyframes(folder / "keys.json")
    out = folder / f"pictures-{channel}"
    ubs(
        "render",
        model,
        "--path",
        folder / "keys.json",
        "--path-frames",
        len(CAMERAS),
        "--size",
        f"{SIZE[0]}x{SIZE[1]}",
        "--format",
        "npy",
        "--channels",
        channel,
        "--out",
        out,
        "--overwrite",
    )
    return [np.load(path) for path in sorted(out.glob("*.npy"))]


def psnr(a, b):
    return -10 * math.log10(max(1e-12, float(((np.clip(a, 0, 1) - np.clip(b, 0, 1)) ** 2).mean())))


def wait(page):
    page.run("window.V = document.getElementById('ubs-viewer').viewer, V.ready.then(() => 0)")
    assert page.run("V.failed") is None, page.run("V.failed")


def pixels(page):
    text = page.run(
        "(() => { let s = ''; for (const c of V.pixels()) s += String.fromCharCode(c); return btoa(s); })()"
    )
    flat = np.frombuffer(base64.b64decode(text), np.uint8)
    return flat.reshape(page.run("V.picture.height"), page.run("V.picture.width"), 4)[:, :, :3] / 255


def shown(page, shot, channel=0):
    page.run(
        f"V.size = [{shot['width']}, {shot['height']}], V.camera.set({json.dumps(shot)}), "
        f"V.setChannel({channel}), "
        "V.settled().then(() => 0)"
    )
    return pixels(page)


def settled(page):
    page.run("V.settled().then(() => 0)")
    return pixels(page)


def quiet(page):
    page.run("0")
    assert page.complaints == [], page.complaints


# ---- Tests ----


def compare(page, folder, least, dims, *options, **switches):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, dims, **switches)
    ubs("web", model, "--out", html, "--quiet", *options)
    truth = rendered(folder, model)
    page.open(html)
    wait(page)
    worst = 99.0
    for k, shot in enumerate(CAMERAS):
        picture = shown(page, shot)
        assert truth[k].std() > 0.01, "the image is empty"
        worst = min(worst, psnr(picture, truth[k]))
        assert worst >= least, f"camera {k}: {worst:.1f} dB"
    quiet(page)
    return f"worst {worst:.1f} dB"


# Tests a page without quantisation (--exact). The observed PSNR is at least 57 dB with Chromium 156 and SwiftShader.
# The remaining error is due to rounding to 8 bits.
def exact(dims, **switches):
    return lambda page, folder: compare(page, folder, 45, dims, "--exact", **switches)


def quantised(*dims):
    return lambda page, folder: compare(page, folder, 40, dims)


# Tests a model with learnt conditioning weights. They are stored in the rows of the query betas, but are not betas, so
# the page must not show sliders for betas.
def learnt(page, folder):
    form = {"conditioning": "direct", "kernel": "gaussian", "beta_opacity": "gaussian"}
    said = compare(page, folder, 45, (6,), "--exact", **form)
    assert page.run("V.model.betas") == [], page.run("V.model.betas")
    assert page.run("document.querySelector('.more')") is None, "the page shows sliders for betas that do not exist"
    return said


def channels(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (6,))
    ubs("web", model, "--out", html, "--exact", "--quiet")
    alpha = rendered(folder, model, "alpha")[0]
    depth = rendered(folder, model, "depth")[0]
    page.open(html)
    wait(page)
    picture = shown(page, CAMERAS[0], 1)
    assert psnr(picture, np.repeat(alpha[:, :, None], 3, 2)) >= 45
    # Depth is shown in colours that get brighter towards the camera.
    brightness = shown(page, CAMERAS[0], 2).sum(2)
    solid = alpha > 0.5
    assert np.corrcoef(brightness[solid], depth[solid])[0, 1] < -0.9
    quiet(page)


def poster(page, folder):
    ubs("synth", "orbit", "--out", folder / "data", "--size", 64, "--views", 4, "--test-views", 1)
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (7,))
    text = ubs(
        "web",
        model,
        folder / "data",
        "--out",
        html,
        "--poster",
        folder / "still.png",
        "--view",
        2,
        "--embed",
        "--quiet",
    )
    assert re.search(r"quality +PSNR 5\d\.\d\d dB against the original model \(mean of 4 cameras", text), text
    ubs(
        "render",
        model,
        folder / "data",
        "--split",
        "train",
        "--views",
        2,
        "--format",
        "npy",
        "--out",
        folder / "truth",
    )
    truth = np.load(next((folder / "truth").glob("*.npy")))
    assert (folder / "still.png").read_bytes()[:4] == b"\x89PNG"
    page.open(html)
    wait(page)
    page.run("V.size = [64, 64], V.settled().then(() => 0)")  # the initial camera of the page
    picture = pixels(page)
    assert psnr(picture, truth) >= 40
    still = page.run("""(async () => {
        const image = document.querySelector('.poster'), c = new OffscreenCanvas(64, 64).getContext('2d');
        await image.decode();
        c.drawImage(image, 0, 0);
        return Array.from(c.getImageData(0, 0, 64, 64).data); })()""")
    assert psnr(np.array(still).reshape(64, 64, 4)[:, :, :3] / 255, truth) >= 40
    assert page.run("document.querySelector('details').open") is False
    quiet(page)
    # Without --poster, the page also contains the still image, so it is not black before its first frame.
    for exact in ([], ["--exact"]):
        ubs("web", model, folder / "data", "--out", html, "--view", 2, "--quiet", "--overwrite", *exact)
        text = html.read_text()
        html.write_text(text.replace('class="ubs-model"', 'class="no-model"'))
        page.open(html)
        page.run("document.querySelector('.poster').decode().then(() => 0)")
        shot = page.call("Page.captureScreenshot", clip={"x": 0, "y": 0, "width": 400, "height": 400, "scale": 1})
        assert len(shot["data"]) > 10000, "the page is black before the first frame"


# Tests pages with several levels: the first level is shown before the rest of the page has arrived, and the last level
# is the whole model.
def levels(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (7, 3), count=16000, size=0.3)
    said = json.loads(ubs("web", model, "--out", html, "--levels", 3, "--json"))
    steps = said["levels"]
    assert len(steps) == 3 and steps[2]["splats"] == 16000 and steps[2]["psnr"] >= 50
    assert steps[0]["psnr"] < steps[1]["psnr"] < steps[2]["psnr"] and steps[0]["splats"] <= 1000
    text = html.read_bytes()
    first = text.index(b"ubsPart()</script>", text.index(b"octet-stream")) + 20
    assert first < 300000 < len(text), (first, len(text))
    go_on = threading.Event()

    class Slow(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(text[:first])
            self.wfile.flush()
            go_on.wait(60)
            self.wfile.write(text[first:])

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Slow)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        page.open(f"http://127.0.0.1:{server.server_port}/", whole=False)
        wait(page)
        coarse = shown(page, CAMERAS[0])
        assert page.run("document.readyState") == "loading"
        assert page.run("V.model.splats") == steps[0]["splats"]
        go_on.set()
        page.run("V.complete.then(() => 0)")
        assert page.run("V.model.splats") == 16000
        whole = settled(page)
    finally:
        go_on.set()
        server.shutdown()
    truth = rendered(folder, model)[0]
    assert psnr(whole, truth) > 40 and psnr(coarse, truth) > 12, (psnr(coarse, truth), psnr(whole, truth))
    assert psnr(coarse, truth) < psnr(whole, truth) - 3
    assert "Level 3 of 3" in page.run("V.panel.facts.textContent")
    quiet(page)
    (folder / "cut.html").write_bytes(text[:first] + b"</body></html>")
    page.open(folder / "cut.html")
    page.run("V = document.getElementById('ubs-viewer').viewer, V.complete.then(() => 0)")
    assert page.run("V.failed") == "the model is cut off", page.run("V.failed")
    # If the second level is damaged, the page reports this, continues to show the first level, and does not use the
    # third level instead.
    second = text.index(b">", text.index(b"octet-stream", first)) + 2000
    (folder / "bad.html").write_bytes(text[:second] + b"AAAA" * 8 + text[second + 32 :])
    page.open(folder / "bad.html")
    page.run("V = document.getElementById('ubs-viewer').viewer, V.complete.then(() => 0)")
    assert page.run("V.failed") == "the model is damaged", page.run("V.failed")
    assert page.run("V.model.level") == 1
    said = page.run("""new Promise((done) => {
        const said = [];
        V.worker.onmessage = (event) => {
            const text = event.data.text || '';
            said.push(text);
            if (text.startsWith('Cannot')) done(said);  // the answer to 'frame', which is sent without a camera
        };
        V.worker.postMessage({kind: 'end'});
        V.worker.postMessage({kind: 'frame'}); })""")
    assert "the model is cut off" in said, said
    ubs("web", model, "--out", folder / "m.ubsz", "--levels", 3, "--quiet")
    info = json.loads(ubs("info", folder / "m.ubsz", "--json"))
    assert info["splats"] == 16000
    rounded = rendered(folder, folder / "m.ubsz")[0]
    assert psnr(rounded, whole) > 50, psnr(rounded, whole)
    return f"{psnr(coarse, truth):.1f} dB, then {psnr(whole, truth):.1f} dB"


# Tests that a page of `ubs report` has a viewer of the model at the top, which --no-viewer removes.
def report(page, folder):
    data, run = folder / "data", folder / "run"
    ubs("synth", "orbit", "--out", data, "--size", 64, "--views", 12, "--test-views", 2)
    ubs("train", data, "--out", run, "--iterations", 60, "--init-points", 1500, "--quiet")
    ubs("report", run, "--out", folder / "with.html")
    ubs("report", run, "--out", folder / "without.html", "--no-viewer")
    ubs("web", run, "--out", folder / "model.html", "--quiet")
    assert "<title>run</title>" in (folder / "model.html").read_text()
    ubs("render", run, data, "--split", "train", "--views", 0, "--format", "npy", "--out", folder / "truth")
    truth = np.load(next((folder / "truth").glob("*.npy")))
    page.open(folder / "with.html", (900, 700))
    wait(page)
    page.run("V.automatic = false")
    box = page.run("(b => [b.width, b.height, b.top])(V.canvas.getBoundingClientRect())")
    assert box[0] >= 200 and box[1] >= 200 and box[2] < 700, box
    page.run("V.size = [64, 64], V.jump(0), V.settled().then(() => 0)")  # the first training camera
    picture = pixels(page)
    assert truth.std() > 0.01 and psnr(picture, truth) >= 40, psnr(picture, truth)
    middle = [box[0] / 2, box[2] + box[1] / 2]
    page.drag(middle, [middle[0] + 60, middle[1]])
    assert np.abs(settled(page) - picture).mean() > 1e-3, "dragging does not change the image"
    assert page.run("document.querySelectorAll('img').length") > 3
    quiet(page)
    page.open(folder / "without.html", (900, 700))
    assert page.run("document.getElementById('ubs-viewer')") is None
    quiet(page)
    return f"{psnr(picture, truth):.1f} dB"


def interaction(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (7, 3))
    ubs("web", model, "--out", html, "--title", "<b>a & b\x01", "--quiet")
    page.open(html, (500, 400))
    assert page.run("document.title") == "<b>a & b\\x01"
    wait(page)
    assert page.run("V.options.title") == "<b>a & b\\x01", page.run("V.options.title")
    page.run("V.automatic = false, V.scale = 1, document.querySelector('details').open = false")
    before = [settled(page)]
    # The sliders of betas are hidden until the user opens their section.
    page.run("document.querySelector('.panel').open = true")
    seen = "document.querySelector('[data-beta=spatial-1]').checkVisibility()"
    assert not page.run(seen)
    page.run("document.querySelector('.more').open = true")
    assert page.run(seen)
    page.run("document.querySelector('.panel').open = false")

    def changed(what):
        now = settled(page)
        assert np.abs(now - before[0]).mean() > 1e-3, f"{what} changes nothing"
        before[0] = now

    def same(what):
        assert np.abs(settled(page) - before[0]).max() < 0.02, f"{what}: the image is different"

    page.drag((250, 100), (320, 120))
    changed("a drag")
    distance = page.run("V.camera.distance")
    page.mouse("mouseWheel", 250, 100, deltaX=0, deltaY=-240)
    changed("the wheel")
    assert page.run("V.camera.distance") < distance
    target = page.run("V.camera.target")
    page.drag((250, 100), (300, 130), button="right")
    changed("panning")
    assert np.abs(np.subtract(target, page.run("V.camera.target"))).max() > 1e-3
    page.touch("touchStart", [(200, 100)])
    page.touch("touchMove", [(240, 130)])
    page.touch("touchEnd", [])
    changed("a finger")
    distance = page.run("V.camera.distance")
    page.touch("touchStart", [(200, 100), (300, 100)])
    page.touch("touchMove", [(150, 100), (350, 100)])
    page.touch("touchEnd", [])
    changed("two fingers")
    assert page.run("V.camera.distance") < 0.8 * distance
    page.run("V.canvas.focus()")
    page.key("ArrowLeft")
    changed("an arrow")
    page.key("w", hold=0.3)
    changed("flying")
    page.key("Home")
    changed("Home")
    page.key("]")
    changed("the next camera")
    page.key("c")
    changed("a channel")
    page.run("V.setChannel(0)")
    settled(page)
    before[0] = settled(page)
    slider = (
        "(q, v) => { const e = document.querySelector(q); e.value = v; e.dispatchEvent(new Event('input')); }"
    )
    page.run(f"({slider})('input[aria-label=Time]', {'0.9'})")
    assert abs(page.run("V.camera.time") - 0.9) < 1e-6
    changed("time")
    for kind in ("spatial", "angular", "temporal"):
        page.run(f"({slider})('[data-beta={kind}-1]', 0.5)")
        changed(f"the {kind} beta")
        page.run(f"({slider})('[data-beta={kind}-1]', 1)")
        changed(f"the {kind} beta back")
    page.run("V.camera.time = 0.1, V.play(true)")
    while page.run("V.camera.time") < 0.2:
        time.sleep(0.05)
    page.run("V.play(false)")
    changed("playing")
    page.run(
        "(v => { const e = document.querySelector('input[aria-label=Resolution]'); e.value = v; "
        "e.dispatchEvent(new Event('input')); })(0.5)"
    )
    page.run("V.settled().then(() => 0)")
    assert page.run("V.picture.width") == 250
    page.run("V.scale = 1")
    before[0] = settled(page)
    link = page.run("V.link()")
    page.drag((250, 100), (150, 120))
    changed("another drag")
    page.open(html, (500, 400), "#" + link.split("#")[1])
    wait(page)
    page.run("V.automatic = false, V.scale = 1, document.querySelector('details').open = false")
    now = settled(page)
    page.run("V.setChannel(0)")
    page.run("V.jump(0)")
    changed("leaving the link")
    page.run(f"location.hash = '', location.hash = '{link.split('#')[1]}'")
    time.sleep(0.2)
    assert np.abs(settled(page) - now).max() < 0.02, "the link shows a different image"
    saved = page.run("""new Promise((done) => {
        HTMLAnchorElement.prototype.click = function () { done(this.download + this.href.slice(0, 5)); };
        V.screenshot(); })""")
    assert saved == "<b>a & b\\x01.pngblob:", saved
    # Every control has an accessible name.
    assert page.run("""[...document.querySelectorAll('input, select, button')].filter((e) =>
        !(e.getAttribute('aria-label') || e.textContent.trim() || e.closest('label'))).length""") == 0
    for scheme in ("dark", "light"):
        page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        colour = page.run("getComputedStyle(document.querySelector('.panel')).backgroundColor")
        assert (int(colour.split("(")[1].split(",")[0]) < 128) == (scheme == "dark"), colour
    quiet(page)


# Tests that a page marks views that differ much from those of all cameras, but no views near one of the cameras.
def unseen(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (6,))
    ubs("web", model, "--out", html, "--exact", "--quiet")
    page.open(html)
    wait(page)
    assert page.run("V.panel.element.open") is False, "the panel covers a part of the image"
    around = [camera((3 * math.cos(a), 3 * math.sin(a), 0), (0, 0, 0), 0) for a in np.radians(range(0, 181, 30))]
    page.run(f"V.options.cameras = {json.dumps(around)}, V.options.scene.centre = [0, 0, 0], 0")

    def marked(act):
        return page.run(f"V.jump(3), {act}, V.change(), V.stage.classList.contains('unseen')")

    near = ["0", *(f"V.jump({k})" for k in range(7)), "V.camera.orbit(1, 0)", "V.camera.orbit(-2.5, 0)"]
    near += ["V.camera.orbit(0, 1)", "V.camera.zoom(0.2)", "V.camera.zoom(1.9)"]
    for act in near:
        assert not marked(act), act
    far = ["V.camera.orbit(3.1, 0)", "V.camera.orbit(0, 1.1)", "V.camera.orbit(0, -1.1)", "V.camera.zoom(2.1)"]
    far += ["V.camera.pan(500, 0, 100, 100)", "V.camera.turnAxes(V.camera.axes[1], 3)"]
    for act in far:
        assert marked(act), act
    assert "No camera saw" in page.run("getComputedStyle(V.stage, '::after').content")
    quiet(page)
    # If a model contains no cameras, ubs places some around the model, and no view is marked.
    lines = model.read_bytes().split(b"\n")
    model.write_bytes(b"\n".join(line for line in lines if not line.startswith(b"comment ubs_camera")))
    ubs("web", model, "--out", html, "--exact", "--quiet", "--overwrite")
    page.open(html)
    wait(page)
    assert not marked("V.camera.zoom(100)")
    quiet(page)


# Tests that the page reports damaged files: if a byte is changed, if the file is truncated, or if values in the header
# do not fit the data.
def damage(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (6,))
    ubs("web", model, "--out", html, "--quiet")
    text = html.read_text()
    begin = text.index('class="ubs-model"')
    begin = text.index(">", begin) + 1
    end = text.index("<", begin)
    good = base64.b64decode(text[begin:end])
    header = 16 + struct.unpack_from("<I", good, 8)[0]

    def altered(payload=good[header:], **changes):
        """Returns the file with other values in the header entry of its group of splats."""
        words = json.loads(good[16:header])
        words["groups"][0].update(changes)
        text = json.dumps(words).encode()
        return good[:8] + struct.pack("<II", len(text), zlib.crc32(text)) + text + payload

    classes = json.loads(good[16:header])["groups"][0]["classes"]
    bomb = gzip.compress(bytes(200_000_000), 1)
    page.open(html)
    before = resident(page)
    for name, bad in {
        # A reader that allocates memory for one of the next three files before it checks them needs up to several GB.
        "many": altered(splats=50_000_000, classes=[50_000_000, 0, 0, 0, 0, 0]),
        "bomb": altered(bomb),
        "wide": altered(dim=1_000_000),
        "negative": altered(splats=-1),
        "fraction": altered(splats=sum(classes) + 0.5),
        "classes": altered(classes=[classes[0] + 1, *classes[1:]]),
        "bytes": altered(rows=[{"bytes": 9, "centre": 0, "step": 1}] * 32),
        "rows": altered(rows=[]),
        "magic": b"X" + good[1:],
        "header": good[:40] + b"#" + good[41:],
        "cut": good[: len(good) // 2],
        "payload": good[: header + 300] + bytes([good[header + 300] ^ 64]) + good[header + 301 :],
        "empty": b"",
    }.items():
        broken = folder / f"{name}.html"
        broken.write_text(text[:begin] + base64.b64encode(bad).decode() + text[end:])
        page.open(broken)
        page.run("document.getElementById('ubs-viewer').viewer.ready.then(() => 0)")
        said = page.run(
            "document.querySelector('.message').hidden ? '' : document.querySelector('.message').textContent"
        )
        assert said.startswith("The model cannot be shown: "), f"{name}: {said!r}"
        assert page.run("document.querySelector('.message').getBoundingClientRect().top") == 0
        quiet(page)
        if name != "empty":
            (folder / "bad.ubsz").write_bytes(bad)
            ubs("info", folder / "bad.ubsz", code=3)
    assert resident(page) < before + 5e8


# Tests that the page and `ubs` reject headers with values that `ubs` never writes, although the checksum is correct.
def hostile(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (6,))
    ubs("web", model, "--out", html, "--quiet")
    ubs("web", model, "--out", folder / "model.ubsz", "--quiet")
    good = (folder / "model.ubsz").read_bytes()
    header = 16 + struct.unpack_from("<I", good, 8)[0]
    words, payload = json.loads(good[16:header]), good[header:]

    def file(text, version=1):
        text = text.encode()
        return struct.pack("<4sIII", b"UBSZ", version, len(text), zlib.crc32(text)) + text + payload

    def changed(path, value, version=1):
        """Returns the file in which one value of the header is replaced. `path` contains the keys that lead to it."""
        all_words = json.loads(json.dumps(words))
        if version == 2:
            all_words["levels"] = [{"bytes": len(payload), "psnr": 50, "groups": all_words.pop("groups")}]
        *parents, last = path
        place = all_words
        for key in parents:
            place = place[key]
        if last is not None:
            place[last] = value
        return file(json.dumps(all_words), version)

    def said(data):
        """Loads the file in the worker of the page. Returns the error message, or the number of splats."""
        return page.run(
            """new Promise((done) => {
            const text = document.getElementById('ubs-worker').textContent;
            const worker = new Worker(URL.createObjectURL(new Blob([text], {type: 'text/javascript'})));
            worker.onerror = (event) => done('uncaught: ' + event.message);
            worker.onmessage = (event) => {
                done(event.data.kind === 'error' ? event.data.text : event.data.splats);
                worker.terminate();
            };
            worker.postMessage({kind: 'part', model: '%s'});
            worker.postMessage({kind: 'end'}); })"""
            % base64.b64encode(data).decode()
        )

    page.open(html)
    assert said(changed([None], None)) == said(changed([None], None, 2)) == COUNT
    invalid, group, level = "the header of the model is not valid", ["groups", 0], ["levels", 0]
    tested = 0
    for path, values in (
        (["groups"], (None, 7, [None], ["group"])),
        ([*group, "dim"], (None, "6", 6.5, 2, 12, 2**32 + 6, True)),
        ([*group, "splats"], (None, "9", -1, 2**53, 1e300)),
        ([*group, "classes"], (None, {}, 7, [COUNT], [COUNT, 0, 0, 0, 0, None], [COUNT + 1, -1, 0, 0, 0, 0])),
        ([*group, "places"], (None, 7, {})),
        ([*group, "places", "bytes"], (0, 8, 1.5, 2**32 + 1, None)),
        ([*group, "places", "centre"], (None, [0, 0], [0, 0, "0"], [0, 0, None])),
        ([*group, "places", "step"], (None, "1")),
        ([*group, "rows"], (None, [], [None] * 29, {"length": 29})),
        ([*group, "rows", 0, "bytes"], (0, 5, 1.5, 2**32 + 1, "1")),
        ([*group, "rows", 0, "centre"], (None, "0")),
        ([*group, "rows", 0, "step"], (None, [1])),
        (["switches"], ({"colour": "sh4"}, {"colour": 3}, {"kernel": "box"}, {"__proto__": "on"}, {"size": "on"})),
    ):
        for value in values:
            data = changed(path, value)
            assert said(data) == invalid, (path, value, said(data))
            (folder / "bad.ubsz").write_bytes(data)
            ubs("info", folder / "bad.ubsz", code=3)
            tested += 1
    for path, values in (
        (["levels"], (None, [], {}, 7, [None])),
        ([*level, "bytes"], (None, -1, 0.5, 1e300, "9")),
        ([*level, "groups"], (None, 7)),
        ([*level, "groups", 0, "dim"], (12,)),
    ):
        for value in values:
            data = changed(path, value, 2)
            assert said(data) == invalid, (path, value, said(data))
            (folder / "bad.ubsz").write_bytes(data)
            ubs("info", folder / "bad.ubsz", code=3)
            tested += 1
    # The page rejects the next three files, but `ubs` does not: it does not need these values, and reads any number of
    # levels.
    assert said(changed(["switches"], None)) == invalid
    assert said(changed([*level, "psnr"], "50", 2)) == invalid
    empty = {"bytes": len(payload), "psnr": 50, "groups": []}
    assert said(changed(["levels"], [empty] * 9, 2)) == invalid
    assert said(changed([*level, "psnr"], None, 2)) == COUNT  # null means an infinite PSNR
    assert said(changed([*level, "bytes"], len(payload) + 1, 2)) == "the model is cut off"
    assert said(changed([*level, "bytes"], len(payload) // 2, 2)) in ("the model is cut off", "the model is damaged")
    for text in ("", "{", "[]", "null", "7", "[" * 100_000, '{"switches": {}, "groups": [{"dim": 1e999}]}'):
        assert said(file(text)) == invalid, text[:40]
        (folder / "bad.ubsz").write_bytes(file(text))
        ubs("info", folder / "bad.ubsz", code=3)
        tested += 1
    quiet(page)
    return f"{tested} headers"


# Returns the resident memory of all processes of the browser [bytes].
def resident(page):
    parents, sizes = {}, {}
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError, IndexError):
            number = int(entry.name)
            parents[number] = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            sizes[number] = int((entry / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    ours, grown = {page.process.pid}, True
    while grown:
        more = {n for n, parent in parents.items() if parent in ours} - ours
        ours, grown = ours | more, bool(more)
    return sum(sizes.get(n, 0) for n in ours)


def memory(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    write_model(model, (7,))
    ubs("web", model, "--out", html, "--exact", "--quiet")
    page.open(html, (160, 120))
    wait(page)
    held = []
    for _ in range(4):  # growth is measured after the second part, because memory is allocated in the first frames
        page.run(
            "(async () => { for (let i = 0; i < 80; ++i) { V.camera.orbit(0.02, 0); "
            "await V.settled(); } gc(); })()",
            timeout=300,
        )
        held.append((page.run("performance.memory.usedJSHeapSize"), resident(page)))
    growth = [held[-1][k] - held[1][k] for k in (0, 1)]
    # The observed growth is 20 kB of JavaScript objects. The memory of all processes varies by a few MB.
    assert growth[0] < 1.5e5, held
    assert growth[1] < 1.5e7, held
    quiet(page)
    return f"growth in 160 frames: {growth[0] / 1e3:.0f} kB of objects, {growth[1] / 1e6:.1f} MB in all processes"


def container(page, folder):
    del page
    model = folder / "model.ply"
    write_model(model, (7, 6, 3))
    ubs("web", model, "--out", folder / "m.ubsz", "--exact", "--quiet")
    ubs("convert", folder / "m.ubsz", folder / "back.ply", "--to", "ubs")
    assert (folder / "back.ply").read_bytes() == model.read_bytes()
    ubs("web", model, "--out", folder / "small.ubsz", "--quiet")
    size = (folder / "small.ubsz").stat().st_size
    assert size < 0.5 * (folder / "m.ubsz").stat().st_size
    assert ubs("info", folder / "small.ubsz", "--json").count('"splats"') > 0
    ubs("web", folder / "small.ubsz", "--out", folder / "again.html", "--exact", "--quiet")
    return f"{size / COUNT:.1f} bytes per splat"


TESTS = {
    "exact-3": exact((3,)),
    "exact-6": exact((6,)),
    "exact-7": exact((7,)),
    "exact-mixed": exact((7, 6, 3)),
    "quantised-3": quantised(3),
    "quantised-6": quantised(6),
    "quantised-7": quantised(7),
    "quantised-mixed": quantised(7, 6, 3),
    "gaussians": exact((3,), rot_mode="quaternion", kernel="gaussian", colour="sh3"),
    "lobes": exact((3,), rot_mode="quaternion", colour="sb2"),
    "lobes-6": exact((6,), colour="sb3"),
    "six-gaussians": exact(
        (6,), cov_param="cholesky", beta_cond="off", beta_opacity="gaussian", kernel="gaussian", colour="sh2"
    ),
    "whiten": exact((7,), cov_mode="whiten", rot_mode="exp", colour="sh1", antialias="on"),
    "skew": exact((6,), cov_param="skew_nd"),
    "direct": exact((7,), conditioning="direct"),
    "direct-learnt": learnt,
    "time-alone": exact((4,), rot_mode="cayley", beta_opacity="none"),
    "channels": channels,
    "poster": poster,
    "levels": levels,
    "unseen": unseen,
    "report": report,
    "interaction": interaction,
    "damage": damage,
    "hostile": hostile,
    "memory": memory,
    "container": container,
}


# This is not a test. It measures the frames per second of a page on this machine. The fastest frame is used, because
# other programs may slow down some frames.
def speed(page, folder):
    model, html = folder / "model.ply", folder / "model.html"
    for dim, count in ((6, 15000), (6, 100000), (7, 100000)):
        write_model(model, (dim,), count=count, size=0.25)
        ubs("web", model, "--out", html, "--exact", "--quiet")
        page.open(html, (400, 400))
        begin = time.time()
        wait(page)
        opened = time.time() - begin
        took = page.run(
            """(async () => {
            V.automatic = false;
            const times = [];
            for (let i = 0; i < 30; ++i) {
              const begin = performance.now();
              V.camera.orbit(0.05, 0);
              await V.settled();
              times.push([performance.now() - begin, V.last.slice, V.last.sort, V.last.drawn]);
            }
            return times.slice(5); })()""",
            timeout=300,
        )
        frame, slice_, sort, drawn = np.min(np.array(took), 0)
        print(
            f"N = {dim}, {count} splats, 400 x 400: {1000 / frame:.1f} frames per second, "
            f"conditioning and projection {slice_:.1f} ms, sort and copy {sort:.1f} ms, {drawn:.0f} drawn; opened in {opened:.1f} s",
            flush=True,
        )


MEASURES = {"speed": speed}
# These tests are only run with UBS_TEST_ALL=1, because quantised-mixed tests a model that contains splats of all these
# dimensions.
LONG = ("quantised-3", "quantised-6", "quantised-7")


def chosen():
    return [name for name in TESTS if name not in LONG or os.environ.get("UBS_TEST_ALL")]


def main():
    program = browser.find()
    if not program:
        print("SKIPPED: no Chromium (Debian's chromium-headless-shell or chromium); pages are not tested")
        return 77
    page, failures = browser.Browser(program), 0
    try:
        for name in sys.argv[2:] or chosen():
            with tempfile.TemporaryDirectory() as folder:
                begin = time.time()
                try:
                    said = {**TESTS, **MEASURES}[name](page, Path(folder)) or ""
                    print(f"passed  {name} ({time.time() - begin:.1f} s) {said}", flush=True)
                except Exception as error:  # the following tests are still run
                    failures += 1
                    print(f"FAILED  {name}: {type(error).__name__}: {error}", flush=True)
    finally:
        page.close()
    return 1 if failures else 0


sys.exit(main())
