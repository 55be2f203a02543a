# SPDX-License-Identifier: Apache-2.0
"""Tests the servers of `ubs train --serve` and `ubs view` with requests of viewers. Run it as serve_test.py UBS [NAME
...], with the path of the executable ubs and the names of tests (by default all of TESTS).

The client implements HTTP itself, so that it can also send invalid requests. `flood-full`, `flood-wide` and
`growth-long` are longer variants of `flood` and `growth`. tests/web/server_test.cpp tests the server alone."""

import contextlib
import csv
import fcntl
import hashlib
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import termios
import threading
import time
from pathlib import Path

import browser

UBS = sys.argv[1]
TRAINING = "--init-points 300 --cap-max 500 --save-renders 0".split()


# ---- Commands ----


def ubs(*arguments):
    done = subprocess.run([UBS, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, f"ubs {' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}"
    return done.stdout


def synthesise(folder):
    ubs("synth", "orbit", "--out", folder / "data", "--size", 64, "--views", 6, "--test-views", 2)


def train(folder, name, iterations, *more, log=50):
    where = ["train", folder / "data", "--out", folder / name]
    return [*where, *TRAINING, "--iterations", iterations, "--log-every", log, *more]


def losses(folder, name):
    """Returns the iteration, the loss and the number of splats in each complete row of the log of a run."""
    rows = list(csv.DictReader((folder / name / "log.csv").read_text().rpartition("\n")[0].splitlines()))
    return [(row["iteration"], row["loss"], row["splats"]) for row in rows]


def sha(folder, name):
    return hashlib.sha256((folder / name / "model.ply").read_bytes()).hexdigest()


class Served:
    """A command that serves its page on a free port and prints its address to stderr."""

    def __init__(self, folder, *arguments, desktop=None, terminal=None):
        self.errors = folder / "stderr.txt"
        port = "--port" if arguments[0] == "view" else "--serve"
        # Without a desktop, `ubs view` does not open a browser.
        environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.process = subprocess.Popen(
            [UBS, *map(str, arguments), port, "0"],
            stdout=subprocess.DEVNULL,
            stderr=self.errors.open("w"),
            env={**environment, **(desktop or {})},
            stdin=subprocess.DEVNULL if terminal is None else terminal,
            start_new_session=terminal is not None,
            preexec_fn=terminal and (lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0)),
        )
        found, deadline = None, time.time() + 600
        while not found:
            assert self.process.poll() is None and time.time() < deadline, self.errors.read_text()
            time.sleep(0.02)
            found = re.search(r"live at (http://([^/]*):(\d+)/(\S*))\n", self.errors.read_text())
        self.url, self.port, self.query = found[1], int(found[3]), found[4]
        self.get("/")  # waits until the server answers

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()

    def connect(self, timeout=600):
        return socket.create_connection(("127.0.0.1", self.port), timeout)

    def get(self, path, query=None, **headers):
        with self.connect() as link:
            send(link, path + (self.query if query is None else query), headers)
            return answer(link.makefile("rb"))

    # Requests an image and returns the connection, on which the server answers after it has rendered the image.
    def ask(self, camera, exact=False):
        link = self.connect()
        body = json.dumps({"camera": camera, "exact": exact}).encode()
        headers = {"Content-Type": "application/json", "Content-Length": len(body)}
        send(link, "/picture" + self.query, headers, "POST", body)
        return link

    def picture(self, camera, exact=False):
        with self.ask(camera, exact) as link:
            return answer(link.makefile("rb"))

    def state(self):
        status, _, body = self.get("/state")
        assert status == 200
        return json.loads(body)

    def page_options(self):
        page = self.get("/")[2].decode()
        return json.loads(re.search(r'id="ubs-options"[^>]*>(.*?)</script>', page)[1])

    def end(self, code, with_signal=None):
        if with_signal:
            self.process.send_signal(with_signal)
        ended = self.process.wait(600)
        assert ended == code, f"exit code {ended}: {self.errors.read_text()}"


# ---- HTTP ----


def send(link, path, headers=None, method="GET", body=b""):
    fields = {"Host": "localhost", **{k.replace("_", "-"): v for k, v in (headers or {}).items()}}
    lines = [f"{method} {path} HTTP/1.1", *(f"{k}: {v}" for k, v in fields.items()), "", ""]
    link.sendall("\r\n".join(lines).encode() + body)


def answer(file):
    status, headers = file.readline().split(), {}
    if not status:
        raise ConnectionError("the server closed the connection without an answer")
    for line in iter(file.readline, b"\r\n"):
        if not line:
            raise ConnectionError("the headers of the answer are truncated")
        name, _, value = line.decode().partition(":")
        headers[name.lower()] = value.strip()
    body = file.read()
    if len(body) != int(headers["content-length"]):
        raise ConnectionError("the body of the answer is truncated")
    return int(status[1]), headers, body


def lens(camera, **changes):
    keys = ("rotation", "translation", "fx", "fy", "cx", "cy", "width", "height", "time", "extra")
    return {**{k: camera[k] for k in keys}, **changes}


def rendered(folder, name, model):
    ubs("render", model, folder / "data", "--split", "train", "--views", 0, "--out", folder / name)
    return next((folder / name).glob("*.png")).read_bytes()


# ---- Tests ----


def pictures_to_the_end(served, camera):
    """Requests images during training until it ends. Returns a pair (iteration, PNG file) for each image."""
    seen = []
    while True:
        try:
            status, headers, data = served.picture(camera, exact=True)
        except ConnectionError:  # training has ended between two requests
            return seen
        if status != 200:
            assert status == 410 and b"ended" in data, (status, data)
            return seen
        assert data.startswith(b"\x89PNG") and headers["content-type"] == "image/png", headers
        seen.append((int(headers["ubs-iteration"]), data))
        if len(seen) == 3:
            state = served.state()
            assert 0 <= state["iteration"] <= 600 and state["iterations"] == 600
            assert state["splats"] >= 100 and state["memory"] > 1e5 and state["left"] >= 0


def training(folder):
    synthesise(folder)
    # With --unit 1, lengths are not scaled. Otherwise, they would be rounded when the model is written.
    exact = ("--unit", 1)
    ubs(*train(folder, "alone", 600, *exact))
    with Served(folder, *train(folder, "nobody", 600, *exact)) as served:
        served.end(0)
    with Served(folder, *train(folder, "visited", 600, *exact), "--serve-share", 50) as served:
        status, headers, page = served.get("/")
        assert status == 200 and b"ubs-viewer" in page and "no-store" in headers["cache-control"]
        seen = pictures_to_the_end(served, lens(served.page_options()["cameras"][0]))
        served.end(0)
    assert seen[0][0] < seen[-1][0] == 600, [i for i, _ in seen]
    assert seen[0][1] != seen[-1][1]
    # The last image is bit-identical to a render of the saved model.
    assert seen[-1][1] == rendered(folder, "pictures", folder / "visited")
    assert sha(folder, "alone") == sha(folder, "nobody") == sha(folder, "visited")
    with contextlib.suppress(ConnectionRefusedError):
        served.connect(1)
        raise AssertionError("the port is still open")
    return f"{len(seen)} images"


# If `ubs train --serve` runs in the foreground of a terminal, it continues to serve the page after the training, until
# the user presses Ctrl-C.
def terminal(folder):
    synthesise(folder)
    ours, theirs = os.openpty()
    with Served(folder, *train(folder, "run", 600), "--serve-share", 50, terminal=theirs) as served:
        camera = lens(served.page_options()["cameras"][0])
        until(lambda: served.state()["ended"])
        until(lambda: "final model until" in served.errors.read_text())
        assert (folder / "run" / "metrics.json").exists() and not (folder / "run" / "checkpoint.ubs").exists()
        for _ in range(3):
            status, headers, picture = served.picture(camera, exact=True)
            assert status == 200 and headers["ubs-iteration"] == "600", (status, headers)
        (folder / "last.png").write_bytes(picture)
        os.write(ours, b"\x03")
        served.end(0)
    os.close(ours)
    os.close(theirs)
    (folder / "saved.png").write_bytes(rendered(folder, "pictures", folder / "run"))
    mean = json.loads(ubs("metrics", folder / "saved.png", folder / "last.png", "--json"))["mean"]
    assert mean["ssim"] > 1 - 1e-5, mean


def unit(folder):
    """Tests that the cameras of the page are those of the data, although training uses another unit of length."""
    synthesise(folder)
    with Served(folder, *train(folder, "run", 600), "--serve-share", 50) as served:
        seen = pictures_to_the_end(served, lens(served.page_options()["cameras"][0]))
        served.end(0)
    (folder / "last.png").write_bytes(seen[-1][1])
    (folder / "saved.png").write_bytes(rendered(folder, "pictures", folder / "run"))
    mean = json.loads(ubs("metrics", folder / "saved.png", folder / "last.png", "--json"))["mean"]
    assert mean["ssim"] > 1 - 1e-5, mean
    return f"SSIM {mean['ssim']}"


def until(condition):
    end = time.time() + 600
    while not condition():
        assert time.time() < end
        time.sleep(0.05)


def figures(folder):
    synthesise(folder)
    with Served(folder, *train(folder, "run", 100000, log=1), "--eval-every", 200) as served:
        until(lambda: served.state()["test"])
        before = served.state()
        assert before["loss"][0][0] == 1 and before["test"][0][0] == 200 and before["test"][0][1] > 5
        assert served.page_options()["poster"].startswith("data:image/")
        until(lambda: served.state()["iteration"] > 600)  # more iterations than the curve of losses contains
        state = served.state()
        assert 200 <= len(state["loss"]) < 400 and state["loss"][0][0] == 1
        assert state["loss"][-1][0] > state["iteration"] - 100
        served.end(130, signal.SIGTERM)


# After SIGTERM, the model is saved and the program ends, even if viewers hold open connections or wait for images.
def interrupt(folder):
    synthesise(folder)
    with Served(folder, *train(folder, "run", 1000000), "--serve-share", 0.1) as served:
        camera = lens(served.page_options()["cameras"][0])
        until(lambda: served.picture(camera)[0] == 200)
        silent = [served.connect() for _ in range(20)]
        # After this expensive image, the share of the time is used up for minutes.
        until(lambda: served.picture(lens(camera, width=1024, height=2048), exact=True)[0] == 200)
        waiting = served.ask(camera)
        piping = served.connect()
        with contextlib.suppress(ConnectionError):
            for _ in range(1000):
                send(piping, "/state")
        served.process.send_signal(signal.SIGTERM)
        with contextlib.suppress(ConnectionError):
            status, _, body = answer(waiting.makefile("rb"))
            assert status == 410 and b"ended" in body, (status, body)
        served.end(130)
        for link in (*silent, waiting, piping):
            link.close()
    assert (folder / "run" / "model.ply").exists()


# Tests that invalid requests, and requests for images of very different sizes, do not affect later requests.
def visitors(folder):
    synthesise(folder)
    with Served(folder, *train(folder, "run", 1000000), "--serve-share", 50) as served:
        camera = lens(served.page_options()["cameras"][0])
        for size in ((65535, 31), (16384, 128), (1, 1), (16, 16), (512, 512), (1, 1), (2048, 1024), (64, 64)):
            status, _, data = served.picture(lens(camera, width=size[0], height=size[1]))
            assert status == (400 if size[0] > 16384 else 200), (size, status, data[:100])
        for wrong in (2**32 + 64, 64.5, True, 1e300, -64):
            assert served.picture(lens(camera, width=wrong))[0] == 400, wrong
        before = served.state()["iteration"]
        until(lambda: served.state()["iteration"] > before)
        served.end(130, signal.SIGTERM)
    assert (folder / "run" / "model.ply").exists()


def view(folder):
    synthesise(folder)
    ubs(*train(folder, "run", 200))
    truth = rendered(folder, "pictures", folder / "run")
    with Served(folder, "view", folder / "run", folder / "data") as served:
        options = served.page_options()
        camera = lens(options["cameras"][0])
        assert not options["training"] and served.state()["splats"] > 0
        assert options["poster"].startswith("data:image/")  # shown until the first frame
        assert served.picture(camera, exact=True)[2] == truth
        picture = served.picture(camera)[2]
        assert picture.startswith(b"\xff\xd8") and len(picture) < len(truth)
        # The image of a camera in the middle of the splats is rendered, or rejected because it takes too long. In both
        # cases, the next image is rendered.
        status, _, data = served.picture({**camera, "translation": [0, 0, 0], "fx": 1e4, "fy": 1e4})
        assert status == 200 or (status == 500 and data.startswith(b"the view is too expensive")), data
        assert served.picture(camera, exact=True)[2] == truth
        served.end(130, signal.SIGTERM)


# SIGTERM ends the program while an expensive image is rendered.
def heavy(folder):
    synthesise(folder)
    ubs(*train(folder, "run", 200))
    with Served(folder, "view", folder / "run", folder / "data") as served:
        camera = lens(served.page_options()["cameras"][0], width=1448, height=1448)
        waiting = [served.ask(camera, exact=True) for _ in range(4)]
        # The first answer is sent when the server begins to render the second image.
        ready, _, _ = select.select(waiting, [], [], 600)
        assert ready
        served.end(130, signal.SIGTERM)
        answered = 0
        for link in waiting:
            with contextlib.suppress(ConnectionError):
                answered += answer(link.makefile("rb"))[0] == 200
            link.close()
        assert answered < 3, "the server rendered images after the signal"


def desktop(folder):
    synthesise(folder)
    ubs(*train(folder, "run", 100))
    # A script replaces xdg-open. It writes its process ID and the address to a file, and keeps running, as some
    # browsers do.
    tools, opened, noted = folder / "tools", folder / "opened.txt", folder / "noted.txt"
    tools.mkdir()
    program = tools / "xdg-open"
    note = f"printf '%s %s' $$ \"$*\" >'{noted}' && mv '{noted}' '{opened}'"
    program.write_text(f"#!/bin/sh\n{note}\nexec sleep 600\n")
    program.chmod(0o755)
    path = {"PATH": f"{tools}:{os.environ['PATH']}"}
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        with Served(folder, "view", folder / "run", desktop={**path, name: ":97"}) as served:
            until(opened.exists)
            process, address = opened.read_text().split(" ", 1)
            assert address == served.url, (address, served.url)
            served.end(130, signal.SIGTERM)
            os.kill(int(process), signal.SIGKILL)  # the process still exists, because the browser stays open
        opened.unlink()
    # If there is no desktop or xdg-open fails, only the address is printed.
    with Served(folder, "view", folder / "run", desktop=path) as served:
        first_picture(served)
        served.end(130, signal.SIGTERM)
    assert not opened.exists()
    program.write_text(f"#!/bin/sh\n{note}\nexit 3\n")
    with Served(folder, "view", folder / "run", desktop={**path, "DISPLAY": ":97"}) as served:
        until(opened.exists)
        first_picture(served)
        served.end(130, signal.SIGTERM)


def first_picture(served):
    status, _, data = served.picture(lens(served.page_options()["cameras"][0]))
    assert status == 200 and data.startswith(b"\xff\xd8"), (status, data)


def limits(folder):
    synthesise(folder)
    ubs(*train(folder, "run", 100))
    with Served(folder, "view", folder / "run", "--host", "0.0.0.0") as served:
        token = served.query.removeprefix("?token=")
        assert re.fullmatch("[0-9a-f]{32}", token)
        wrong = token[:-1] + ("0" if token[-1] != "0" else "1")
        for path in ("/", "/state", "/picture"):
            for query in ("", "?token=", f"?token={wrong}", f"?token={token}0", f"?token={token[:-1]}"):
                assert served.get(path, query)[0] == 403, (path, query)
        assert served.get("/")[0] == served.get("/state", f"?x=1&token={token}")[0] == 200
        assert served.get("/", Host="another.name")[0] == 200  # any host name is allowed, because the token is required
        first_picture(served)
        served.query = ""
        assert served.picture({})[0] == 403
    with Served(folder, "view", folder / "run") as served:
        port = str(served.port)
        for host, status in {
            "localhost:" + port: 200,
            "127.0.0.1": 200,
            "[::1]:" + port: 200,
            "evil.example": 421,
            "localhost.evil.example:" + port: 421,
            "": 421,
        }.items():
            assert served.get("/state", Host=host)[0] == status, host
        assert served.get("/state", Origin="http://localhost")[0] == 200
        for origin in ("http://evil.example", "null", "http://localhost.evil.example"):
            assert served.get("/state", Origin=origin)[0] == 403, origin
        first_picture(served)
        done = subprocess.run(
            [UBS, "view", folder / "run", "--port", port], capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 2 and "in use" in done.stderr and done.stderr.count("\n") == 1, done.stderr
        done = subprocess.run(
            [UBS, "view", folder / "run", "--host", ""], capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 2 and "empty" in done.stderr and done.stderr.count("\n") == 1, done.stderr
        # No request of a viewer may write to the disk.
        assert sorted(p.name for p in folder.iterdir()) == ["data", "run", "stderr.txt"]


# During training, 50 viewers together send up to 1000 requests for the state per second, one client requests images,
# two clients do not read the answers, and one client sends invalid requests. The training must give the same losses as
# without viewers.
def flooded(folder, seconds, *options):
    synthesise(folder)
    counts, lock = {"asked": 0, "answered": 0, "pictures": 0}, threading.Lock()

    def count(**more):
        with lock:
            for key, value in more.items():
                counts[key] += value

    def asker(served, stop):
        start = time.time()
        for k in range(int(20 * seconds)):
            time.sleep(max(0, start + k / 20 - time.time()))
            if time.time() > start + seconds:  # the answers came late: the server accepts few connections per second
                break
            count(asked=1)
            with contextlib.suppress(ConnectionError):  # rejected while all connections are in use
                count(answered=int("iteration" in served.state()))

    def watcher(served, stop):
        while not stop.is_set():
            with contextlib.suppress(ConnectionError):
                status, _, data = served.picture(camera)
                count(pictures=int(status == 200 and len(data) > 100))

    def sleeper(served, stop):  # sends a request and never reads the answer
        link = served.ask(lens(camera, width=1024, height=1024), exact=True)
        stop.wait()
        link.close()

    def breaker(served, stop):
        while not stop.is_set():
            with contextlib.suppress(ConnectionError), served.connect() as link:
                link.sendall(os.urandom(200) + b"\r\n\r\n")
                link.recv(100)

    with Served(folder, *train(folder, "flooded", 1000000), *options) as served:
        camera = lens(served.page_options()["cameras"][0])
        stop, failures = threading.Event(), []

        def guarded(work):
            try:
                work(served, stop)
            except Exception as error:
                failures.append(f"{work.__name__}: {type(error).__name__}: {error}")

        begin = time.time()
        askers = [threading.Thread(target=guarded, args=[asker]) for _ in range(50)]
        others = [threading.Thread(target=guarded, args=[w]) for w in (watcher, sleeper, sleeper, breaker)]
        for thread in askers + others:
            thread.start()
        for thread in askers:
            thread.join()
        took = time.time() - begin
        until(lambda: len(losses(folder, "flooded")) > 10 and counts["pictures"] > 0)
        state = served.state()
        stop.set()
        for thread in others:
            thread.join()
        served.process.send_signal(signal.SIGTERM)
        served.end(130)
    assert not failures, failures
    assert counts["answered"] > 0, counts
    with Served(folder, *train(folder, "alone", 1000000)) as served:  # no viewer sends requests
        until(lambda: len(losses(folder, "alone")) > 10)
        served.process.send_signal(signal.SIGTERM)
        served.end(130)
    for one, other in zip(losses(folder, "alone"), losses(folder, "flooded")):
        assert one == other, (one, other)
    return (
        f"{counts['answered']} answers and {counts['pictures']} images in {took:.1f} s; images took "
        f"{100 * state['spent'] / state['seconds']:.1f} % of the time"
    )


def resources(process):
    """Returns the resident memory of a process without mapped files [bytes], and its numbers of open files and
    threads."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    number = lambda name: int(re.search(name + r":\s*(\d+)", status)[1])
    return 1024 * number("RssAnon"), len(os.listdir(f"/proc/{process.pid}/fd")), number("Threads")


def visit(served, camera, rounds):
    """Opens 10 connections in each round and sends different requests on them, one of them for a large image."""
    for _ in range(rounds):
        assert served.get("/")[0] == 200
        served.state()
        assert served.picture(lens(camera, width=256, height=256), exact=True)[0] == 200
        assert served.picture(camera)[0] == 200
        assert served.picture(lens(camera, width=True))[0] == 400
        assert served.get("/nothing")[0] == 404
        served.connect().close()
        served.ask(lens(camera, width=128, height=128)).close()  # does not wait for the answer
        for begin in (b"GET /state", os.urandom(200) + b"\r\n\r\n"):
            with contextlib.suppress(ConnectionError), served.connect() as link:
                link.sendall(begin)
                link.shutdown(socket.SHUT_WR)
                link.recv(100)


def grown(served, rounds):
    """Sends many requests. Checks that all their connections and threads have ended, and returns by how many bytes the
    memory of the process has grown."""
    camera = lens(served.page_options()["cameras"][0])
    visit(served, camera, max(10, rounds // 4))  # the first requests allocate memory that later ones use again

    def rested():  # sends a request, because the server closes old connections when a new one is opened
        served.get("/state")
        return resources(served.process)

    low = [min(numbers) for numbers in zip(*(rested() for _ in range(20)))]
    visit(served, camera, rounds)
    until(lambda: all(now <= least for now, least in zip(rested()[1:], low[1:])))
    return rested()[0] - low[0]


# Tests that the memory, the open files and the threads of a server do not grow with the number of requests.
def growth(folder, rounds):
    synthesise(folder)
    ubs(*train(folder, "run", 100))
    with Served(folder, "view", folder / "run", folder / "data") as served:
        viewed = grown(served, rounds)
        served.end(130, signal.SIGTERM)
    with Served(folder, *train(folder, "long", 1000000, log=1000), "--serve-share", 50) as served:
        trained = grown(served, rounds)
        served.end(130, signal.SIGTERM)
    # The observed growth is 0.04 MB with 400 requests and 0.20 MB with 4000 requests (Debian 12, two cores). A large
    # image has 0.2 MB of pixels.
    assert max(viewed, trained) < 0.4e6, (viewed, trained)
    return f"{10 * rounds} requests: {viewed / 1e6:.2f} MB with ubs view, {trained / 1e6:.2f} MB with ubs train"


def pages(folder):
    program = browser.find()
    if not program:
        return "SKIPPED: no Chromium (Debian's chromium-headless-shell or chromium); the page is not tested"
    synthesise(folder)
    page = browser.Browser(program)
    try:
        with Served(folder, *train(folder, "run", 1000000, "--dim", 6), "--serve-share", 50) as served:
            page.open(served.url, (400, 300))
            page.run("window.L = document.getElementById('ubs-viewer').live, 0")
            slider = "getComputedStyle(L.find('input[type=range]').parentNode).display"
            assert not page.run("L.options.timed") and page.run(slider) == "none", "a slider without effect is shown"
            look(page, "a drag", lambda: page.drag((200, 80), (280, 110)))
            look(page, "the wheel", lambda: page.mouse("mouseWheel", 200, 80, deltaX=0, deltaY=-240))
            look(page, "an arrow", lambda: (page.run("L.canvas.focus()"), page.key("ArrowLeft")))
            look(page, "another camera", lambda: page.run("L.jump(2)"))
            unseen = "L.find('.stage').classList.contains('unseen')"
            assert not page.run(unseen)
            page.run("L.camera.orbit(0, -3), L.camera.zoom(3), L.change()")
            assert page.run(unseen), "the page does not mark what no camera saw"
            page.run("L.jump(2)")
            assert not page.run(unseen)
            # Without visible size, as in a hidden frame, the page sends no requests.
            page.run("L.find('.stage').style.display = 'none', L.change()")
            wait(page, "L.asked === L.shown && !L.waiting && !L.dirty", "the page does not show the requested image")
            asked = page.run("L.asked")
            page.run("L.change()")
            assert page.run("L.asked") == asked
            page.run("L.find('.stage').style.display = '', L.change()")
            before = page.run("L.iteration")
            wait(page, f"L.iteration > {before}", "training does not continue")
            wait(page, "L.state && L.state.loss.length > 2", "the page receives no losses")
            assert "iteration" in page.run("document.querySelector('.facts').textContent")
            assert page.run("document.querySelector('.loss').getAttribute('points').split(' ').length") > 2
            served.process.send_signal(signal.SIGTERM)
            wait(page, "!document.querySelector('.message').hidden", "the page does not show the end")
            assert "ended" in page.run("document.querySelector('.message').textContent")
            page.run("document.querySelector('.panel').open = true")
            assert page.run("""(m => { const b = m.getBoundingClientRect();
                return document.elementFromPoint(b.left + 20, b.bottom - 5) === m; })(document.querySelector('.message'))""")
            served.end(130)
            assert_no_complaints(page)
        ubs(*train(folder, "finished", 200, "--dim", 7))
        with Served(folder, "view", folder / "finished") as served:
            page.open(served.url, (400, 300))
            page.run("window.L = document.getElementById('ubs-viewer').live, 0")
            look(page, "a drag", lambda: page.drag((200, 80), (280, 110)))
            slider = "Object.assign(L.find('input[type=range]'), {value: 0.9}).oninput()"
            assert page.run("getComputedStyle(L.find('input[type=range]').parentNode).display") != "none"
            look(page, "time", lambda: page.run(f"{slider}, 0"))
            assert page.run("L.find('svg') === null"), "the page of a finished model shows a loss curve"
            wait(page, "document.querySelector('.facts').textContent.includes('splats')", "the page shows no figures")
            page.run("HTMLAnchorElement.prototype.click = function() { L.saved = this.href; }, 0")
            page.run("L.canvas.focus()")
            page.key("p")
            assert page.run("L.saved.startsWith('data:image/png;') && L.saved.length > 1000")
            served.end(130, signal.SIGTERM)
            assert_no_complaints(page)
    finally:
        page.close()
    return "in Chromium"


# Checks that the console of the page contains no errors except those about the end of the server.
def assert_no_complaints(page):
    ends = ("ERR_CONNECTION", "ERR_EMPTY", "ERR_SOCKET", "410")
    complaints = [c for c in page.complaints if not any(end in c for end in ends)]
    assert complaints == [], complaints


def wait(page, condition, failure):
    deadline = time.time() + 600
    while not page.run(condition):
        assert time.time() < deadline, failure
        time.sleep(0.05)


# Checks that the action `act` changes the camera and the image. Moving the camera changes the whole image, while
# training changes it much less. `what` names the action in messages.
def look(page, what, act):
    rest = "L.frames > 0 && !L.waiting && !L.dirty && !L.small"
    grey = """(() => { const c = new OffscreenCanvas(40, 30).getContext('2d');
        c.drawImage(L.canvas, 0, 0, 40, 30);
        return Array.from(c.getImageData(0, 0, 40, 30).data); })()"""
    wait(page, rest, "the page shows no image")
    before, asked = page.run(grey), page.run("JSON.stringify(L.camera.on(100, 100))")
    assert max(before[i] for i in range(len(before)) if i % 4 < 3) > 30, "the image is black"
    act()
    wait(page, f"L.asked === L.shown && {rest}", f"{what}: the page does not show the new image")
    now = page.run(grey)
    assert page.run("JSON.stringify(L.camera.on(100, 100))") != asked
    assert sum(abs(a - b) for a, b in zip(before, now)) / len(now) > 0.5, f"{what} changes nothing"


TESTS = {
    "training": training,
    "terminal": terminal,
    "unit": unit,
    "figures": figures,
    "interrupt": interrupt,
    "visitors": visitors,
    "view": view,
    "heavy": heavy,
    "desktop": desktop,
    "limits": limits,
    "flood": lambda folder: flooded(folder, 2),
    "growth": lambda folder: growth(folder, 40),
    "pages": pages,
}
MEASURES = {
    "growth-long": lambda folder: growth(folder, 400),
    "flood-full": lambda folder: flooded(folder, 10),
    "flood-wide": lambda folder: flooded(folder, 10, "--serve-share", 50),
}


def main():
    failures = 0
    for name in sys.argv[2:] or TESTS:
        with tempfile.TemporaryDirectory() as folder:
            begin = time.time()
            try:
                said = {**TESTS, **MEASURES}[name](Path(folder)) or ""
                print(f"passed  {name} ({time.time() - begin:.1f} s) {said}", flush=True)
            except Exception as error:  # the following tests are still run
                failures += 1
                print(f"FAILED  {name}: {type(error).__name__}: {error}", flush=True)
    return 1 if failures else 0


sys.exit(main())
