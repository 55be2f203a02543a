# SPDX-License-Identifier: Apache-2.0
"""Controls a headless Chromium through the DevTools protocol over pipes. Only uses the standard library of Python."""

import json
import os
import select
import shutil
import subprocess
import tempfile
import time

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")


def find():
    return os.environ.get("UBS_CHROMIUM") or next((p for p in map(shutil.which, NAMES) if p), None)


class Browser:
    def __init__(self, program):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_read, to_write = os.pipe()
        from_read, from_write = os.pipe()

        def give():  # the browser reads requests from file descriptor 3 and writes answers to 4
            a, b = os.dup(to_read), os.dup(from_write)
            os.dup2(a, 3)
            os.dup2(b, 4)

        # Uses SwiftShader, which renders WebGL in software and is available on every machine.
        self.process = subprocess.Popen(
            [
                program,
                "--headless",
                "--no-sandbox",
                "--disable-gpu-sandbox",
                "--use-gl=angle",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--disable-dev-shm-usage",
                "--no-first-run",
                "--disable-extensions",
                "--js-flags=--expose-gc",
                "--enable-precise-memory-info",
                "--touch-events=enabled",
                f"--user-data-dir={self.profile.name}",
                "--remote-debugging-pipe",
                "about:blank",
            ],
            preexec_fn=give,
            pass_fds=(3, 4),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)
        self.out, self.into, self.buffer, self.number = from_read, to_write, b"", 0
        self.session, self.complaints = None, []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def close(self):
        try:
            self.session = None
            self.call("Browser.close")
            self.process.wait(10)
        except Exception:
            self.process.kill()
            self.process.wait()
        self.profile.cleanup()

    def message(self, deadline):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.out], [], [], max(0, deadline - time.time()))
            if not ready:
                raise TimeoutError("the browser does not answer")
            data = os.read(self.out, 1 << 20)
            if not data:
                raise RuntimeError("the browser has ended")
            self.buffer += data
        text, _, self.buffer = self.buffer.partition(b"\0")
        return json.loads(text)

    def call(self, method, timeout=600, **params):
        self.number += 1
        request = {"id": self.number, "method": method, "params": params}
        if self.session:
            request["sessionId"] = self.session
        os.write(self.into, json.dumps(request).encode() + b"\0")
        deadline = time.time() + timeout
        while True:
            answer = self.message(deadline)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.note(answer)

    # Adds the problems of a page to self.complaints: errors and warnings on its console, exceptions, and blocked loads.
    def note(self, event):
        params = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description", details["text"]))
        if event.get("method") == "Runtime.consoleAPICalled" and params["type"] in (
            "error",
            "warning",
            "assert",
        ):
            self.complaints.append(" ".join(str(a.get("value", "")) for a in params["args"]))
        if event.get("method") == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            # Ignores a warning of SwiftShader that reading pixels is slow.
            if "GPU stall due to ReadPixels" not in params["entry"]["text"]:
                self.complaints.append(params["entry"]["text"])

    # Opens a page and waits until it is loaded completely or, if `whole` is False, until it defines window.ubsPart.
    def open(self, path, size=(400, 400), fragment="", whole=True):
        self.complaints = []
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call("Page.navigate", url="about:blank")
        url = path if "://" in str(path) else f"file://{path}"
        self.call("Page.navigate", url=f"{url}{fragment}")
        deadline = time.time() + 600
        ready = "document.readyState === 'complete'" if whole else "window.ubsPart !== undefined"
        while not self.run(ready):
            if time.time() > deadline:
                raise TimeoutError(f"{path} does not load")
            time.sleep(0.05)

    # Evaluates a JavaScript expression in the page and returns its value. If the value is a promise, waits for its
    # result.
    def run(self, expression, timeout=600):
        answer = self.call(
            "Runtime.evaluate", timeout=timeout, expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, from_, to, button="left", modifiers=0):
        buttons = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mousePressed", *from_, button=button, buttons=buttons, clickCount=1, modifiers=modifiers)
        for k in range(1, 6):
            at = [a + (b - a) * k / 5 for a, b in zip(from_, to)]
            self.mouse("mouseMoved", *at, button=button, buttons=buttons, modifiers=modifiers)
        self.mouse("mouseReleased", *to, button=button, buttons=0, clickCount=1, modifiers=modifiers)

    def key(self, key, code=None, hold=0.0):
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=code or key, **text)
        time.sleep(hold)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=code or key)

    def touch(self, kind, points):
        self.call(
            "Input.dispatchTouchEvent",
            type=kind,
            touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)],
        )
