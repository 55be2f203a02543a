# SPDX-License-Identifier: Apache-2.0
"""Makes the tables of tools/experiment.py: table.md, table.csv and table.json (docs/experiments.md)."""
import csv
import datetime
import io
import json
import shlex
import sys

MEAN, AVERAGE = "mean", "average"  # instead of a scene: our mean over the scenes, and the published average
# For each metric: its key in files, its heading, the number of decimals, whether it measures image quality, and its
# definition. Metrics of image quality get a column of differences. The other metrics are costs.
METRICS = {
    "psnr": ("PSNR [dB]", 2, True, "mean over the test views of the mean over the channels of 10 log10(1 / mse)"),
    "ssim": ("SSIM", 3, True, "zero-padded, 11 x 11 Gaussian of sigma 1.5, mean over the test views"),
    "lpips": ("LPIPS", 3, True, "VGG16, images fed in [0, 1] as the published code does; requires --lpips-weights"),
    "minutes": ("training [min]", 1, False, "wall time of training without loading and evaluation"),
    "fps": ("FPS", 1, False, "images per second of wall time, conditioning on the view included"),
    "splats": ("splats", 0, False, "at the end of training"),
    "mib": ("MiB", 1, False, "size of model.ply / 2^20"),
}


class Run:
    """A line of the tables: a row of the experiment for one scene, or for an average over scenes."""

    def __init__(self, row, data_set, scene, title=None):
        self.row, self.data_set, self.scene = row, data_set, scene
        self.about = data_set["scenes"].get(scene, {})  # what the file of the data set states about the scene
        self.title = title or self.about.get("title", scene)
        self.place = f"{data_set['name']}/{scene}"
        self.id = f"{row['name']}/{self.place}"
        self.method = row.get("label", row["name"])
        self.state, self.reason = "not run", ""  # later: done, no data, failed or interrupted
        self.ours, self.paper = {}, row["published"].get(self.place, {})  # measured and published values by metric
        self.data = self.folder = None  # paths; the data may be missing
        self.arguments = []  # for `ubs train`
        self.settings = {}  # those that have an effect on the result
        self.changes = []  # differences from the published settings
        self.identity = {}  # everything that determines the result on one device and build
        self.record = {}  # how the values were measured: job.json, and the build and the device of metrics.json

    def compared(self, key):
        """Returns the values of a metric and their difference; None where there is none."""
        ours, paper = self.ours.get(key), self.paper.get(key)
        return {"ours": ours, "published": paper, "difference": None if None in (ours, paper) else ours - paper}


def shown(lines):
    """Returns the metrics that occur in the lines."""
    return {key: metric for key, metric in METRICS.items() if any(key in line.ours | line.paper for line in lines)}


def make_tables(spec, runs):
    """Returns the contents of the files by their names. Lines are ordered by data set and row; averages follow the
    runs of a row."""
    lines = []
    for data in spec["sets"]:
        for row in spec["rows"]:
            own = [run for run in runs if run.data_set is data and run.row is row]
            lines += own + (averages(own) if own and len(data["scenes"]) > 1 else [])
    return {"table.md": markdown(spec, runs, lines), "table.csv": csv_text(lines), "table.json": json_text(spec, lines)}


def averages(runs):
    """Returns lines for the runs of a row: our means, and the average that was published. The means of a metric are
    over the runs that have both the measured and the published value, so that a missing scene does not shift the
    difference. If there is no published value, the mean is over all measured runs."""
    row, data = runs[0].row, runs[0].data_set
    done, count = sum(run.state == "done" for run in runs), len(data["scenes"])
    means = Run(row, data, MEAN, f"mean of {done} of {count}")
    printed = Run(row, data, AVERAGE, f"average as printed, {count} scenes")
    means.state = printed.state = "done"
    for key in METRICS:
        both = [run for run in runs if key in run.ours and key in run.paper]
        measured = both or [run for run in runs if key in run.ours]
        if measured:
            means.ours[key] = sum(run.ours[key] for run in measured) / len(measured)
        if both:
            means.paper[key] = sum(run.paper[key] for run in both) / len(both)
    return [means, printed] if printed.paper else [means]


def csv_text(lines):
    """Returns table.csv, which has a line for each metric of a run or an average."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["row", "dataset", "scene", "state", "metric", "ours", "published", "difference"])
    for line in lines:
        for key in shown([line]) or [""]:
            values = ["" if value is None else f"{value:.10g}" for value in line.compared(key).values()]
            table.writerow([line.row["name"], line.data_set["name"], line.scene, line.state, key, *values])
    return text.getvalue()


def json_text(spec, lines):
    """Returns table.json, which also states the settings of each run and how it was measured."""
    entries = [{"row": line.row["name"], "dataset": line.data_set["name"], "scene": line.scene, "title": line.title,
                "state": line.state, "reason": line.reason, "data": str(line.data or ""),
                "metrics": {key: line.compared(key) for key in shown([line])}, "not_as_published": line.changes,
                "settings": line.settings, "record": line.record} for line in lines]
    return json.dumps({"experiment": spec["name"], "date": datetime.datetime.now().isoformat(),
                       "command": shlex.join(sys.orig_argv), "published_source": spec["published"]["source"],
                       "lines": entries}, indent=2) + "\n"


def markdown(spec, runs, lines):
    """Returns table.md: a table for each data set, and the information that is needed to compare the values."""
    done, source = [run for run in runs if run.state == "done"], spec["published"]["source"]
    changes = markdown_list((run.id, ", ".join(run.changes)) for run in done)
    missing = markdown_list((run.id, f"{run.state}: {run.reason}") for run in runs if run.reason)
    origins = {"{device[name]} ({device[platform]}); ubs {version}, build {build}, commit {commit}".format(**run.record)
               for run in done}
    paragraphs = [
        f"# {spec.get('title', spec['name'])}", f"{datetime.date.today()}. Values after the last iteration.",
        source and f"Difference: ours minus paper. Published values: {source}", spec.get("notes"),
        changes and "**Not the published settings or image sizes**, so a difference to the paper is expected:", changes,
        source and not changes and "All runs have the published settings and image sizes."]
    for data in spec["sets"]:
        if own := [line for line in lines if line.data_set is data]:
            paragraphs += [f"## {data.get('title', data['name'])}", overview(own), set_table(own)]
    definitions = markdown_list((heading, definition) for heading, _, _, definition in shown(lines).values())
    paragraphs += [
        missing and "## Not in the table", missing, "## Metrics and settings", definitions,
        *(f"Measured with: {origin}" for origin in sorted(origins)), f"    {shlex.join(sys.orig_argv)}",
        "All settings of every run: `table.json`, and `config.yaml` in its folder."]
    return "\n\n".join(paragraph for paragraph in paragraphs if paragraph) + "\n"


def overview(lines):
    """Returns a table with a line for each scene and a column for each row of the experiment: PSNR and training time.
    Returns nothing if there is only one row, or if there are published values, which the other table compares."""
    methods = {line.row["name"]: line.method for line in lines}
    if len(methods) == 1 or any(line.paper for line in lines):
        return ""
    scenes = {line.scene: "mean" if line.scene == MEAN else line.title for line in lines}
    cells = {(line.scene, line.row["name"]): f"{line.ours['psnr']:.2f} dB, {60 * line.ours['minutes']:.0f} s"
             for line in lines if "psnr" in line.ours}
    return markdown_table([["scene", *methods.values()],
                           *([title, *(cells.get((scene, row), "–") for row in methods)]
                             for scene, title in scenes.items())])


def set_table(lines):
    """Returns the table of one data set, with a line for each run."""
    columns = [["method", *(line.method for line in lines)],
               ["scene", *(line.title if line.state == "done" else f"{line.title} ({line.state})" for line in lines)]]
    for key, (heading, decimals, is_quality, _) in shown(lines).items():
        parts = [(heading, "ours", "")]
        if any(key in line.paper for line in lines):
            parts += [("paper", "published", "")] + ([("difference", "difference", "+")] if is_quality else [])
        for title, part, sign in parts:
            values = [line.compared(key)[part] for line in lines]
            columns.append([title, *("–" if value is None else f"{value:{sign}.{decimals}f}" for value in values)])
    return markdown_table(list(zip(*columns)))


def markdown_table(rows):
    """Returns a table in Markdown. The first row is the heading."""
    return "\n".join("| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |"
                     for cells in (rows[0], ["---"] * len(rows[0]), *rows[1:]))


def markdown_list(pairs):
    """Returns a list in Markdown of texts, each preceded by all names to which it applies. Empty texts are omitted."""
    names = {}
    for name, text in pairs:
        names.setdefault(text, []).append(name)
    return "\n".join(f"- {', '.join(names[text])}: {text}" for text in names if text)
