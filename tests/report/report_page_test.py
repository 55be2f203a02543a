# SPDX-License-Identifier: Apache-2.0
"""Tests pages of `ubs report` in a real browser. Run it as report_page_test.py UBS, where UBS is the path of the
executable ubs.

Exits with 77 if Chromium is not installed. UBS_CHROMIUM selects another browser that is based on Chromium."""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "web"))
import browser

UBS = sys.argv[1]
HOSTILE = ("<img src=x onerror=alert(1)>&amp;\"'", "<b>\u2028<!--")
SECTIONS = "summary curves views decomposition times parameters measurements settings device".split()


def ubs(*arguments):
    subprocess.run([UBS, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def until(page, condition):
    deadline = time.time() + 300
    while not page.run(condition):
        assert time.time() < deadline, f"{condition} does not become true"
        time.sleep(0.05)


def opened(page, path, width):
    page.open(path, (width, 900))
    until(page, "[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    assert page.complaints == [], page.complaints
    assert page.run("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the window"
    # Every chart contains lines. Their colours are not shades of grey.
    drawn = """[...document.querySelectorAll('.plot canvas')].map((canvas) => {
        const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        let coloured = 0;
        for (let i = 0; i < data.length; i += 4)
          coloured += data[i + 3] > 100 && Math.abs(data[i] - data[i + 2]) > 60;
        return coloured;
      })"""
    until(page, f"{drawn}.every((coloured) => coloured > 20)")
    return page.run("[...document.querySelectorAll('section')].map((section) => section.id)")


def texts(page, selector):
    return page.run(f"[...document.querySelectorAll({json.dumps(selector)})].map((e) => e.textContent)")


def one_run(page, folder, run):
    ubs("report", run, "--views", 2, "--no-viewer", "--out", folder / "one.html")
    sections = opened(page, folder / "one.html", 1200)
    assert sections == SECTIONS, sections
    assert texts(page, "h1") == [HOSTILE[0]] and page.run("document.title") == HOSTILE[0]
    assert page.run("document.querySelector('[onerror]')") is None
    metrics = json.loads((run / "metrics.json").read_text())
    assert f"{metrics['test']['mean']['psnr']:.3f} dB" in texts(page, ".card b")
    assert len(texts(page, ".plot")) == 4 + page.run("JSON.parse(document.getElementById('ubs-record').textContent).histograms.length")
    assert page.run("document.images.length") == 2 * 5 + 3 * 4 + 6
    names = texts(page, "#measurements tbody th")
    assert metrics["test"]["views"][0]["name"] in names and "raster_backward" in names, names

    # Charts show values under the pointer, and a button changes the quantity on their x axis. Smooth scrolling is
    # disabled, because the position of the chart would change after the test has read it.
    page.run("document.documentElement.style.scrollBehavior = 'auto'")
    page.run("document.getElementById('curves').scrollIntoView()")
    chart = "Chart.getChart(document.querySelector('.plot canvas'))"
    deadline, moves = time.time() + 300, 0
    while not page.run(f"{chart}.tooltip.opacity > 0"):
        assert time.time() < deadline, "the chart shows no values under the pointer"
        x, y = page.run(f"(b => [b.left + b.width / 2, b.top + b.height / 2])({chart}.canvas.getBoundingClientRect())")
        page.mouse("mouseMoved", x + moves % 9, y)
        moves += 1
        time.sleep(0.1)
    assert page.run(f"{chart}.tooltip.title[0]").startswith("iteration "), page.run(f"{chart}.tooltip.title")
    page.run("document.querySelectorAll('.choice button')[1].click()")
    assert page.run(f"{chart}.options.scales.x.title.text") == "seconds of training"

    # Zooming into one image of a view enlarges all images of this view.
    page.run("document.querySelector('.pane').scrollIntoView({block: 'center'})")
    x, y = page.run("(b => [b.left + 20, b.top + 20])(document.querySelector('.pane').getBoundingClientRect())")
    time.sleep(0.2)  # waits until the page has scrolled
    page.mouse("mouseMoved", x, y)
    page.mouse("mouseMoved", x + 5, y + 5)
    page.mouse("mouseWheel", x + 5, y + 5, deltaX=0, deltaY=-400)
    until(page, "document.querySelector('.readout').textContent.endsWith('zoom 2.2')")
    transforms = page.run("[...document.querySelectorAll('.panes')[0].querySelectorAll('img')].map((i) => i.style.transform)")
    assert len(transforms) == 5 and len(set(transforms)) == 1 and "scale(2.2" in transforms[0], transforms

    assert len(page.call("Page.printToPDF")["data"]) > 20000
    assert page.complaints == [], page.complaints
    assert opened(page, folder / "one.html", 400) == SECTIONS


def two_runs(page, folder, run, other):
    ubs("report", run, other, "--views", 2, "--no-viewer", "--out", folder / "two.html")
    for width in (1200, 400):
        assert opened(page, folder / "two.html", width) == SECTIONS
    assert texts(page, "h1") == [" / ".join(HOSTILE)]
    assert page.run("document.querySelector('main b:not(.card b)')") is None
    assert texts(page, "#curves .legend .run") == list(HOSTILE)
    assert "dim" in texts(page, "#settings .differ th")
    assert "init_points" in texts(page, "#settings tr:not(.differ) th")
    assert len(texts(page, "#summary .better, #summary .worse")) >= 3
    assert len([text for text in texts(page, ".blank") if text == "ground truth as above"]) == 2


# The page shows the model of the first run, and states its name.
def with_model(page, folder, run, other):
    ubs("report", run, other, "--views", 1, "--out", folder / "model.html")
    assert opened(page, folder / "model.html", 1200) == ["viewer", *SECTIONS]
    assert texts(page, "nav a")[0] == "The model"
    note = texts(page, "#viewer .note")
    assert len(note) == 1 and note[0].startswith(f"This is the model of {HOSTILE[0]} in compressed form. PSNR"), note
    until(page, "document.querySelector('#viewer .stage.drawn canvas') !== null")


# The PSNR of a run with smaller images is different, but is marked neither better nor worse.
def two_sizes(page, folder, run, half):
    ubs("report", run, half, "--views", 1, "--no-viewer", "--out", folder / "sizes.html")
    opened(page, folder / "sizes.html", 1200)
    rows = page.run("""Object.fromEntries([...document.querySelectorAll('#summary tbody tr')].map((row) =>
        [row.children[0].textContent, [row.children[2].textContent, row.children[2].querySelector('span')?.className]]))""")
    psnr, seconds = rows["PSNR, mean over channels [dB]"], rows["training [s]"]
    assert psnr[0].endswith(" different image sizes") and psnr[1] == "same", psnr
    assert rows["SSIM"][0].endswith(" different image sizes"), rows["SSIM"]
    assert "different" not in seconds[0], seconds


# Replaces metrics.json by values of unexpected types, which another version of ubs might write, and removes the model.
def damaged(page, folder, run):
    metrics = {"test": {"mean": [], "views": [5, {"name": "a"}]}, "device": 3, "minutes": {"stages": {"a": "b"}},
               "data_report": {"notes": 1, "skipped": [2]}, "chosen": {}, "seconds": "__proto__", "constructor": {}}
    shutil.copytree(run, folder / "damaged")
    (folder / "damaged/metrics.json").write_text(json.dumps(metrics))
    (folder / "damaged/log.csv").write_text("iteration,loss\n5,0\n10,-1\n20,2\n30,1\n")
    (folder / "damaged/model.ply").unlink()
    ubs("report", folder / "damaged", "--no-viewer")
    sections = opened(page, folder / "damaged/report.html", 1200)
    assert sections == ["summary", "curves", "measurements", "settings", "device"], sections
    assert any("model.ply is missing" in text for text in texts(page, ".remarks li"))


def main():
    program = browser.find()
    if not program:
        print("SKIPPED: Chromium is not installed")
        return 77
    page = browser.Browser(program)
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            run, other = (folder / name for name in HOSTILE)
            ubs("synth", "orbit", "--size", 48, "--views", 8, "--test-views", 3, "--out", folder / "data")
            common = ["--init-points", 200, "--cap-max", 300, "--iterations", 60, "--eval-every", 20, "--quiet"]
            ubs("train", folder / "data", "--out", run, "--dim", 7, *common)
            ubs("train", folder / "data", "--out", other, "--dim", 4, *common)
            ubs("train", folder / "data", "--out", folder / "half", "--dim", 7, "--downscale", 2, *common)
            one_run(page, folder, run)
            two_sizes(page, folder, run, folder / "half")
            two_runs(page, folder, run, other)
            with_model(page, folder, run, other)
            damaged(page, folder, run)
    finally:
        page.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
