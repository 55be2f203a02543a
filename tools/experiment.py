#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the runs of an experiment with `ubs train` and compares the results with published ones (docs/experiments.md).

An experiment (data_specs/experiments/*.yaml) has rows, which are settings with a name, and scenes of data sets
(data_specs/sets/*.yaml). A run is a row on a scene. This program reads the files, finds the data, lets `ubs` check the
settings, starts `ubs train` and `ubs eval` for one run after another, and writes the tables after each.

The files of a run are in OUT/runs/ROW.SET.SCENE. Before the training, this program writes job.json there, which states
the settings and data of the run. At the end of the training, `ubs` writes metrics.json and removes checkpoint.ubs.

Requires the executable `ubs` and PyYAML (Debian: python3-yaml). Exit codes are those of `ubs` (README.md).
"""
import argparse
import csv
import datetime
import functools
import io
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import sys

import yaml

INTERNAL, USAGE, DATA, INTERRUPTED = 1, 2, 3, 130  # exit codes
UTF8 = {"encoding": "utf-8", "errors": "surrogateescape"}  # paths may have any bytes
AVERAGE = "average"  # replaces the name of a scene
# For each metric: its key in files, its heading, its exact definition, the number of decimals, and whether it measures
# image quality. Metrics of image quality get a column of differences. The other metrics are costs.
METRICS = {
    "psnr": ("PSNR [dB]", "mean over the test views of the mean over the three channels of 10 log10(1 / mse), as the "
             "published code computes it", 2, True),
    "ssim": ("SSIM", "zero-padded, 11 x 11 Gaussian of sigma 1.5, mean over the test views", 3, True),
    "lpips": ("LPIPS", "VGG16, images fed in [0, 1] as the published code does (lpips_vgg_unit)", 3, True),
    "minutes": ("training [min]", "wall time of training without loading and evaluation", 1, False),
    "fps": ("FPS", "images per second of wall time, conditioning on the view included", 1, False),
    "splats": ("splats", "at the end of training", 0, False),
    "mib": ("MiB", "size of model.ply / 2^20", 1, False),
}
# Settings that change what a run stores or prints, but neither its model nor its measurements.
WITHOUT_EFFECT = {"image_cache_mb", "cache_folder", "eval_every", "save_renders", "log_every", "checkpoint_every",
                  "allow_outside"}


class Failure(Exception):
    """An error for the user, with a message and the exit code that `ubs` uses for errors of this kind."""


def need(condition, where, message):
    """An error in a file, with its position."""
    if not condition:
        raise Failure(DATA, f"{where}: {message}")


def read_json(path):
    """Returns the content of a file, or nothing if it is missing or damaged."""
    try:
        found = json.loads(path.read_text(**UTF8))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def write(path, text):
    """Replaces a file. If this fails, the file has the old content."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, **UTF8)
    temporary.replace(path)


def json_text(value):
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


# The executable


def why(code, output, log):
    """Returns the reason why `ubs` failed: its error message, or otherwise how it ended."""
    if errors := re.findall("^ubs: error: (.*)$", output, re.MULTILINE):
        return errors[-1]
    return (f"ended by signal {-code}" if code < 0 else f"exit code {code}") + f"; see {log}"


@functools.cache
def ask(ubs, *arguments):
    """Returns the output of the executable."""
    try:
        done = subprocess.run([ubs, *arguments], stdin=subprocess.DEVNULL, capture_output=True, check=False, **UTF8)
    except (OSError, ValueError) as error:
        raise Failure(USAGE, f"{ubs}: cannot be started ({error}): pass --ubs PATH") from error
    if done.returncode != 0:
        raise Failure(max(done.returncode, INTERNAL), why(done.returncode, done.stderr, f"{ubs} {arguments[0]}"))
    return done.stdout


def setting_text(value):
    if isinstance(value, list):
        return ",".join(map(setting_text, value))
    return value if isinstance(value, str) else json.dumps(value).removesuffix(".0")


def set_options(settings):
    return [f"--set={key}={setting_text(value)}" for key, value in settings.items()]


def all_settings(ubs, given):
    """Returns all settings of a training to which these are passed."""
    return json.loads(ask(ubs, "train", "--print-settings", "--json", *set_options(given)))


def image_width(ubs, data, settings):
    """Returns the width of the first image, if there is one. The settings for reading data are those of `ubs info`."""
    reading = set(re.findall("^  --([a-z-]+)", ask(ubs, "info", "--help-all"), re.MULTILINE))
    options = set_options({key: value for key, value in settings.items() if key.replace("_", "-") in reading})
    splits = json.loads(ask(ubs, "info", str(data), "--json", *options))["splits"].values()
    return next((split["sizes"][0][0] for split in splits if split["sizes"]), 0)


def version_of(ubs):
    found = re.match(r"ubs (\S+) \(build (\S+)\)", ask(ubs, "--version"))
    if not found:
        raise Failure(USAGE, f"{ubs}: is not the executable ubs: pass --ubs PATH")
    file = pathlib.Path(os.path.realpath(ubs) + ".commit")
    return {"version": found[1], "build": found[2],
            "commit": file.read_text().strip() if file.exists() else "unknown"}


class Child:
    """The running training or measurement. Signals are passed on to it, and a training then saves its state."""

    process, stopped = None, False

    def stop(self, *_):
        self.stopped = True
        if self.process:
            # After SIGINT, a run with a time budget would first complete its schedule.
            self.process.send_signal(signal.SIGTERM)

    def run(self, command, log):
        """Runs a command with its output in `log`; returns the exit code and the output. The command runs in a separate
        session, so Ctrl-C only reaches it through `stop`."""
        command = list(map(str, command))
        with open(log, "w", **UTF8) as file:
            print("$", shlex.join(command), file=file, flush=True)
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file,
                                            start_new_session=True)
        if self.stopped:  # a signal arrived before the process started
            self.stop()
        code, self.process = self.process.wait(), None
        return code, log.read_text(**UTF8)


child = Child()


# Files of experiments and data sets. There are four kinds of schemas. A text is a pattern that a value must match. [A]
# is a list of items that match the schema A. A mapping maps patterns of keys to schemas, with "!" after required keys.
# ANY allows all values; it is used for settings, which `ubs` checks.

ANY = object()
TEXT = r"[^\0\ud800-\udfff]+"
NAME, WIDTH = "[A-Za-z0-9_-]{1,64}", "[1-9][0-9]{0,4}"  # names are used as names of folders
SECONDS = "[1-9][0-9]{0,5}"
NUMBER = r"null|[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,2})?"
SCENE = {"title": TEXT, "folders": [TEXT], "width": WIDTH, "settings": {TEXT: ANY}}
DATA_SET = {"name!": NAME, **SCENE, "dataset!": {TEXT: TEXT}, "scenes!": {NAME: SCENE}}
EXPERIMENT = {"name!": NAME, "title": TEXT, "notes": TEXT, "settings": {TEXT: ANY},
              "published": {"source!": TEXT, "columns!": ["|".join(METRICS)]},
              "data!": [{"set!": TEXT, "scenes": [NAME], "settings": {TEXT: ANY}}],
              "rows!": [{"name!": NAME, "label": TEXT, "settings": {TEXT: ANY}, "budget": SECONDS,
                         "published": {NAME: {NAME: [NUMBER]}}}]}


class Loader(yaml.BaseLoader):
    """Reads every value as the text in the file. Rejects keys that appear twice; PyYAML would use the last of them."""

    def construct_mapping(self, node, deep=False):
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            raise yaml.MarkedYAMLError(problem="a key appears twice in the mapping", problem_mark=node.start_mark)
        return mapping


def checked(value, schema, where):
    """Returns the value if it matches the schema. An empty value is an empty mapping."""
    if schema is ANY:
        return value
    if isinstance(schema, str):
        need(isinstance(value, str) and re.fullmatch(schema, value), where,
             f"{value!r} is not allowed: expected {'a text' if schema is TEXT else schema}")
        return value
    if isinstance(schema, list):
        need(value and isinstance(value, list), where, "must be a list with at least one entry")
        return [checked(item, schema[0], f"{where}[{i}]") for i, item in enumerate(value)]
    need(not value or isinstance(value, dict), where, "must be a mapping of keys to values")
    keys, found = [key.removesuffix("!") for key in schema], {}
    for key, item in (value or {}).items():
        part = next((part for pattern, part in zip(keys, schema.values()) if re.fullmatch(pattern, key)), None)
        need(part, where, f"unknown key {key!r}: expected {', '.join(keys)}")
        found[key] = checked(item, part, f"{where}: {key}")
    for key in schema:
        need(key[-1] != "!" or key[:-1] in found, where, f"the key '{key[:-1]}' is missing")
    return found


def read_yaml(path, schema):
    try:
        with open(path, encoding="utf-8") as file:
            return checked(yaml.load(file, Loader), schema, path)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise Failure(DATA, f"{path}: malformed YAML: {error}") from error


def load_experiment(path):
    """Returns an experiment with its data sets by name in "sets", and published values of rows by "set/scene" and
    metric."""
    spec = {"published": {"source": "", "columns": []}, "sets": {}, **read_yaml(path, EXPERIMENT)}
    for i, entry in enumerate(spec["data"]):
        data, where = read_yaml(path.parent / entry["set"], DATA_SET), f"{path}: data[{i}]"
        need(data["name"] not in spec["sets"], where, f"data set '{data['name']}' appears twice")
        need(data["scenes"], where, f"data set '{data['name']}' has no scenes")
        chosen = entry.get("scenes", data["scenes"])
        for scene in chosen:
            need(scene in data["scenes"], where, f"data set '{data['name']}' has no scene '{scene}'")
        data["scenes"] = {scene: about for scene, about in data["scenes"].items() if scene in chosen}
        spec["sets"][data["name"]] = data | {"entry": entry}
    names, columns = [row["name"] for row in spec["rows"]], spec["published"]["columns"]
    need(len(set(columns)) == len(columns), f"{path}: published: columns", "a column appears twice")
    for i, row in enumerate(spec["rows"]):
        need(names.count(row["name"]) == 1, f"{path}: rows[{i}]", f"there are two rows '{row['name']}'")
        published, row["published"] = row.get("published", {}), {}
        for data, scene, values in [(data, *item) for data, scenes in published.items() for item in scenes.items()]:
            where = f"{path}: rows[{i}]: published: {data}: {scene}"
            need(data in spec["sets"] and scene in [AVERAGE, *spec["sets"][data]["scenes"]], where,
                 "is not a scene of this experiment")
            need(len(values) == len(columns), where, "needs a value, or null, for each of the columns of 'published' "
                 f"({', '.join(columns) or 'which is missing'})")
            row["published"][f"{data}/{scene}"] = {key: float(value) for key, value in sorted(zip(columns, values))
                                                   if value != "null"}
    return spec


# From an experiment to a list of runs


class Run:
    """A row of the experiment for one scene. In tables, the mean over the scenes of a row is also a run, with the scene
    AVERAGE."""

    def __init__(self, row, data_set, scene):
        self.row, self.set, self.scene = row, data_set, scene
        self.about = data_set["scenes"].get(scene, {})
        self.place = f"{data_set['name']}/{scene}"
        self.id = f"{row['name']}/{self.place}"
        self.data = self.folder = None  # their paths; the data may be missing
        self.published, self.settings = {}, {}  # settings as published, and of this run
        self.budget = int(row.get("budget", 0))  # in seconds; 0: none
        self.arguments = []  # for `ubs train`
        self.published_width = int(self.about.get("width", data_set.get("width", 0)))
        self.width = 0  # width of the images that are used
        self.identity = {}  # everything that determines the result on one device and build
        self.end("not run")  # later: done, no data, failed or interrupted
        self.values, self.paper = {}, row["published"].get(self.place, {})  # measured and published values by metric
        self.lacks = {}  # by metric, the reason why a finished run has no value
        self.record = {}  # job.json, and the build and the device of metrics.json

    def end(self, state, reason="", code=0):
        """Sets the state, the reason for it, and the exit code of a failed run."""
        self.state, self.reason, self.code = state, reason, code

    def changes(self):
        """Returns the differences from the published settings."""
        found = [f"{key} {setting_text(self.published[key])} -> {setting_text(value)}"
                 for key, value in deciding(self.settings).items() if value != self.published[key]]
        if self.width and self.published_width not in (0, self.width):
            found.insert(0, f"images {self.width} px wide (published: about {self.published_width})")
        return found

    def compared(self, key):
        """Returns the measured value, the published value, and the difference; None where there is none."""
        ours, paper = self.values.get(key), self.paper.get(key)
        return ours, paper, None if ours is None or paper is None else ours - paper


def deciding(settings):
    return {key: value for key, value in settings.items() if key not in WITHOUT_EFFECT}


def find_data(run, root, unique):
    """Returns ROOT/SET/SCENE, or ROOT/SCENE if the scene name is unique among the sets. Each may be a packed file."""
    scenes = [run.scene, *run.about.get("folders", [])]
    places = [root / folder / scene for folder in [run.set["name"], *run.set.get("folders", [])] for scene in scenes]
    places += [root / scene for scene in scenes] if unique else []
    files = [file for place in places for file in (place, pathlib.Path(f"{place}.ubsd"))]
    return next((file for file in files if file.exists()), None)


def scaled_down(ubs, run, k):
    """Returns settings for images / K, iterations / K and splats / K^2. The number of splats per pixel does not change.
    Images that are already smaller than published are reduced by less, and never enlarged."""
    def rounded(number):
        return max(1, int(number + 0.5))

    published = run.published
    scaled = {"cap_max": rounded(published["cap_max"] / k**2), "iterations": rounded(published["iterations"] / k)}
    if published["init_points"] != "auto":
        scaled["init_points"] = rounded(published["init_points"] / k**2)
    if run.data:
        full = image_width(ubs, run.data, {**published, "downscale": 1}) if run.published_width else 0
        factor = full / run.published_width if full else published["downscale"]
        scaled["downscale"] = min(rounded(factor * k), 64)
    return scaled


def make_plan(spec, options):
    """Returns the runs that the options select, in the order of the file: rows, then data sets, then scenes."""
    scenes = [scene for found in spec["sets"].values() for scene in found["scenes"]]
    runs = [Run(row, data, scene) for row in spec["rows"] for data in spec["sets"].values() for scene in data["scenes"]]
    for option, given, known in (("--rows", options.rows, [row["name"] for row in spec["rows"]]),
                                 ("--scenes", options.scenes, [*scenes, *(run.place for run in runs)])):
        if unknown := [name for name in given if name not in known]:
            raise Failure(USAGE, f"{option}: unknown name '{unknown[0]}'; there are: {', '.join(dict.fromkeys(known))}")
    if not options.root.is_dir():
        raise Failure(DATA, f"{options.root}: no such folder: pass the folder of the data sets as --root")
    runs = [run for run in runs if (not options.rows or run.row["name"] in options.rows)
            and (not options.scenes or run.scene in options.scenes or run.place in options.scenes)]
    for run in runs:
        plan_run(run, spec, options, unique=scenes.count(run.scene) == 1)
    return runs


def plan_run(run, spec, options, unique):
    """Finds the data of a run and completes its settings."""
    if run.budget and options.scale_down > 1:
        raise Failure(USAGE, f"--scale-down: row '{run.row['name']}' has a budget, for which ubs chooses iterations "
                      "and splats: choose others with --rows")
    run.folder, run.data = options.out / "runs" / run.id.replace("/", "."), find_data(run, options.root, unique)
    given = {}
    for part in (run.set, run.about, spec, run.set["entry"], run.row):  # later ones take precedence
        given |= part.get("settings", {})
    try:
        run.published = all_settings(options.ubs, given)
        scaled = scaled_down(options.ubs, run, options.scale_down) if options.scale_down > 1 else {}
        chosen = {**given, **scaled, **dict(options.set)}
        run.settings = all_settings(options.ubs, chosen)
        run.arguments = set_options(run.settings)
        if run.budget:  # ubs chooses the settings that are not passed
            run.arguments = ["--budget", f"{run.budget}s", *set_options(chosen)]
        run.width = image_width(options.ubs, run.data, run.settings) if run.data else 0
    except Failure as error:
        code, message = error.args
        if message.startswith("--set: "):  # an invalid key or value in --set or in a file
            raise error if run.published else Failure(DATA, f"{options.spec}: {run.id}: settings: {message[7:]}")
        run.end("failed", message, code)  # incompatible settings, or unusable data
    if not run.data:
        run.end("no data", f"there is neither {options.root / run.place} nor a folder of its other names")
    run.identity = {"data": os.path.realpath(run.data or ""), "arguments": options.train_argument,
                    "settings": deciding(run.settings), **({"budget": run.budget} if run.budget else {})}


# Running


def load(run):
    """Reuses the results of a finished training with the same settings, data and arguments."""
    metrics, evaluation, record = (read_json(run.folder / name) for name in ("metrics.json", "eval.json", "job.json"))
    last, test, model = metrics.get("iterations"), metrics.get("test") or {}, run.folder / "model.ply"
    if (record.get("identity") != run.identity or (run.folder / "checkpoint.ubs").exists()
            or metrics.get("interrupted", True) or metrics.get("ended_early")
            or last != metrics["settings"]["iterations"]
            or test.get("iteration", last) != last):  # measured before the last iteration
        return
    mean = {"lpips_vgg_unit": evaluation.get("mean", {}).get("lpips_vgg_unit"), **test.get("mean", {})}
    values = {"psnr": mean.get("psnr"), "psnr_joint": mean.get("psnr_joint"), "ssim": mean.get("ssim"),
              "lpips": mean["lpips_vgg_unit"], "fps": evaluation.get("frames", {}).get("fps_wall"),
              "minutes": metrics["seconds"] / 60, "splats": metrics["splats"], "iterations": last,
              "peak_device_mib": metrics["peak_device_bytes"] / 2**20 if "peak_device_bytes" in metrics else None,
              "mib": model.stat().st_size / 2**20 if model.exists() else None}
    run.values = {key: float(value) for key, value in sorted(values.items()) if value is not None}
    run.record = record | {key: metrics[key] for key in ("version", "build", "device", "data_report") if key in metrics}
    run.end("done", "" if "psnr" in run.values else "the data have no test views with images: not measured")


def train(run, options):
    folder, job, checkpoint = run.folder, run.folder / "job.json", run.folder / "checkpoint.ubs"
    record, log = read_json(job), folder / "train.log"
    same = record.get("identity") == run.identity
    if options.resume and same and checkpoint.exists():
        arguments = ["--resume", folder]
    else:
        arguments = ["--out", folder, "--overwrite", *run.arguments]
        folder.mkdir(parents=True, exist_ok=True)
        for file in (job, checkpoint, folder / "metrics.json", folder / "eval.json"):
            file.unlink(missing_ok=True)
        record = {"identity": run.identity, "commit": options.version["commit"], "command": shlex.join(sys.orig_argv),
                  "host": os.uname().nodename, "begun": datetime.datetime.now().isoformat()}
        write(job, json_text(record))
    code, output = child.run([options.ubs, "train", "--data", run.data, *arguments, *options.on_device,
                              *options.train_argument], log)
    interrupted = code == INTERRUPTED or (code < 0 and child.stopped)
    if interrupted and (checkpoint.exists() or not (folder / "metrics.json").exists()):
        run.end("interrupted", f"its results so far are in {folder}")
    elif code == 0 or interrupted:  # after the last step, a signal has no effect
        run.end("failed", f"{folder}/metrics.json: the training did not reach its last iteration", DATA)
        load(run)
    else:
        run.end("failed", why(code, output, log), max(code, INTERNAL))
        if code == USAGE and not same:  # it did not start: another training may be writing to the folder
            job.unlink()


def measure(run, options):
    """Measures with `ubs eval` what training does not measure. If this fails, the values are missing."""
    asked, reason = {"fps": options.fps_views, "lpips": options.lpips_weights}, ""
    missing = [key for key in asked if key not in run.values and "psnr" in run.values]  # no PSNR: no test images
    if any(asked[key] for key in missing):
        folder, log = run.folder, run.folder / "measure.log"
        lpips = ["--lpips", "vgg", "--lpips-range", "unit", "--lpips-weights", asked["lpips"]] if asked["lpips"] else []
        code, output = child.run([options.ubs, "eval", "--model", folder / "model.ply", "--data", run.data, "--out",
                                  folder / "eval.json", "--spec", folder / "config.yaml", "--overwrite", "--fps-views",
                                  asked["fps"], *lpips, *options.on_device], log)
        reason = why(code, output, log)
        load(run)
    run.lacks = {key: reason if asked[key] else "not asked for (--fps-views, --lpips-weights)" for key in missing
                 if key not in run.values}


# Tables


def mean(runs):
    """Computes both means of a metric over the runs that have both values, so that a missing scene does not shift the
    difference. If there is no published value, computes the measured mean over all measured runs."""
    found = Run(runs[0].row, runs[0].set, AVERAGE)
    found.end("done")
    found.paper, found.present = {}, sum(run.state == "done" for run in runs)
    for key in METRICS:
        both = [run for run in runs if key in run.values and key in run.paper]
        measured = both or [run for run in runs if key in run.values]
        if measured:
            found.values[key] = sum(run.values[key] for run in measured) / len(measured)
        if both:
            found.paper[key] = sum(run.paper[key] for run in both) / len(both)
    return found


def shown(lines):
    """Returns the metrics that occur in the lines."""
    return {key: metric for key, metric in METRICS.items() if any(key in run.values | run.paper for run in lines)}


def table_texts(spec, runs, options):
    """Returns table.md, table.csv and table.json. Their lines are ordered by data set and row, and the mean of a row
    follows its runs."""
    occasion = {"date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"), **options.version,
                "command": shlex.join(sys.orig_argv), "scale_down": options.scale_down}
    lines = []
    for data in spec["sets"].values():
        for row in spec["rows"]:
            own = [run for run in runs if run.set is data and run.row is row]
            lines += own + ([mean(own)] if own and len(data["scenes"]) > 1 else [])
    return markdown(spec, runs, lines, occasion), csv_table(lines), json_table(spec, runs, lines, occasion)


def csv_table(lines):
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["row", "dataset", "scene", "state", "metric", "ours", "published", "difference"])
    for run in lines:
        for key in sorted(shown([run])) or [""]:
            values = ["" if value is None else f"{value:.10g}" for value in run.compared(key)]
            table.writerow([run.row["name"], run.set["name"], run.scene, run.state, key, *values])
    return text.getvalue()


def json_table(spec, runs, lines, occasion):
    means = [run for run in lines if run.scene == AVERAGE]
    return json_text({
        "experiment": spec["name"], **occasion, "published_source": spec["published"]["source"],
        "metrics": {key: definition for key, (_, definition, _, _) in METRICS.items()},
        "runs": [{"id": run.id, "state": run.state, "reason": run.reason, "lacks": run.lacks,
                  "data": str(run.data or ""), "image_width": run.width or None, "ours": run.values,
                  "published": run.paper, "not_as_published": run.changes(), "settings": run.settings,
                  "record": run.record or None} for run in runs],
        "means": [{"row": run.row["name"], "dataset": run.set["name"], "scenes_present": run.present,
                   "scenes_planned": len(run.set["scenes"]),
                   "metrics": {key: dict(zip(("ours", "published", "difference"), run.compared(key)))
                               for key in sorted(run.values)}} for run in means],
        "published_averages": {f"{run.row['name']}/{run.set['name']}": run.row["published"][run.place]
                               for run in means if run.place in run.row["published"]}})


def table_row(cells):
    return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |\n"


def items(texts):
    return "".join("- " + text.replace("\n", " ") + "\n" for text in texts)


def grouped(pairs):
    """Returns texts, each preceded by the names of all runs to which it applies."""
    names = {}
    for name, text in pairs:
        names.setdefault(text, []).append(name)
    return [f"{', '.join(names[text])}: {text}" for text in sorted(names) if text]


def scene_table(lines):
    """Returns a table with a line for each scene and a column for each row: the PSNR, and the training time."""
    def cell(run):
        found = run.values
        return f"{found['psnr']:.2f} dB, {60 * found['minutes']:.0f} s" if "psnr" in found else "–"

    scenes = {}
    for run in lines:
        title = "mean" if run.scene == AVERAGE else run.about.get("title", run.scene)
        scenes.setdefault(title, []).append(run)
    methods = dict.fromkeys(run.row.get("label", run.row["name"]) for run in lines)
    if len(methods) == 1:
        return ""
    text = table_row(["scene", *methods]) + "|---" * (1 + len(methods)) + "|\n"
    return text + "".join(table_row([scene, *map(cell, runs)]) for scene, runs in scenes.items()) + "\n"


def set_table(data, lines):
    """Returns the table of one data set in Markdown."""
    def cell(value, decimals, sign=""):
        return "–" if value is None else f"{value:{sign}.{decimals}f}"

    columns, scenes, titled = shown(lines), len(data["scenes"]), []
    compared = any(run.paper for run in lines)
    widths = {key: 1 if not compared else 3 if quality else 2 for key, (_, _, _, quality) in columns.items()}
    for run in lines:
        if run.scene != AVERAGE:
            state = "" if run.state == "done" else f" ({run.state})"
            titled.append((run.about.get("title", run.scene) + state, run))
        else:
            titled.append((f"mean of {run.present} of {scenes}", run))
            if run.place in run.row["published"]:
                titled.append((f"average as printed, {scenes} scenes", Run(run.row, data, AVERAGE)))
    head = ["method", "scene"]
    for key, (heading, _, _, _) in columns.items():
        head += [heading, "paper", "difference"][:widths[key]]
    text = f"\n## {data.get('title', data['name'])}\n\n"
    text += "" if compared else scene_table(lines)
    text += f"{table_row(head)}{'|---' * len(head)}|\n"
    for title, run in titled:
        cells = [run.row.get("label", run.row["name"]), title]
        for key, (_, _, decimals, _) in columns.items():
            ours, paper, difference = run.compared(key)
            found = [cell(ours, decimals), cell(paper, decimals), cell(difference, decimals, "+")]
            cells += found[:widths[key]]
        text += table_row(cells)
    return text


def markdown(spec, runs, lines, occasion):
    done = [run for run in runs if run.state == "done"]
    scale, source = occasion["scale_down"], spec["published"]["source"]
    text = f"# {spec.get('title', spec['name'])}\n\n{occasion['date'][:10]}"
    text += f", scaled down by {scale}" if scale > 1 else ""
    text += ". Values of the model after the last iteration.\n"
    text += f"Difference: ours minus paper. Published values: {source}\n" if source else ""
    text += f"\n{spec['notes']}\n" if "notes" in spec else ""
    changes = grouped((run.id, ", ".join(run.changes())) for run in done)
    if changes:
        text += ("\n**Not the published settings or image sizes**, so a difference to the paper is expected:\n\n"
                 + items(changes))
    elif source:
        text += "\nAll runs have the published settings and image sizes.\n"
    for data in spec["sets"].values():
        if own := [run for run in lines if run.set is data]:
            text += set_table(data, own)
    missing = grouped((run.id, run.reason if run.state == "done" else f"{run.state}: {run.reason}") for run in runs)
    for key, (heading, *_) in shown(lines).items():
        missing += grouped((run.id, f"{heading} not measured: {run.lacks[key]}") for run in done if key in run.lacks)
    text += f"\n## Not in the table\n\n{items(missing)}" if missing else ""
    text += "\n## Metrics and settings\n\n"
    text += items(f"{heading}: {definition}" for heading, definition, _, _ in shown(lines).values())
    origins = {"{device[name]} ({device[platform]}); ubs {version}, build {build}, commit {commit}".format(**run.record)
               for run in done}
    text += f"\nMeasured with:\n\n{items(sorted(origins))}" if origins else ""
    return text + (f"\n    {occasion['command']}\n\nAll settings of every run: `table.json`, and `config.yaml` in its "
                   "folder.\n")


# The command


def dry_run(runs, options):
    """Prints the runs and the hours that `ubs plan` expects of each."""
    total = 0
    for run in runs:
        text = f"{run.state}: {run.reason}"
        if run.state == "not run":
            try:
                plan = {"seconds": run.budget} if run.budget else json.loads(
                    ask(options.ubs, "plan", "--data", str(run.data), "--json", *options.on_device, *run.arguments))
                hours = plan["seconds"] / 3600
                total += hours
                length = f"budget {run.budget} s" if run.budget else f"{run.settings['iterations']} iterations"
                text = f"{hours:.3f} h, {run.data}, {run.width} px wide, {length}"
            except Failure as error:
                text = f"time unknown: {error.args[1]}"
        print(f"{run.id}: {text}", flush=True)
    print(f"\nestimated total: {total:.3f} hours, without loading and evaluation")
    return 0


def emit_tasks(runs):
    """Prints a command for each run that is not finished."""
    words = [word for word in sys.orig_argv if word != "--emit-tasks"]
    for run in [run for run in runs if run.state == "not run"]:
        load(run)
        if run.state != "done":
            print(json.dumps({"id": run.id, "command": shlex.join([*words, "--task", run.id])}))
    return 0


def execute(spec, runs, options):
    """Trains and measures unfinished runs, and writes the tables after each run; with --task only prints them."""
    tables = [options.out / f"table.{suffix}" for suffix in ("md", "csv", "json")]
    results = tables + [run.folder / name for run in runs for name in ("job.json", "checkpoint.ubs", "model.ply")]
    found = [file for file in results if file.exists()]
    if found and not options.overwrite and not options.resume:
        raise Failure(USAGE, f"{found[0]} exists: continue with --resume, replace results with --overwrite, or choose "
                      "another --out")
    if options.lpips_weights and not os.path.exists(options.lpips_weights):
        raise Failure(DATA, f"{options.lpips_weights}: no such file (--lpips-weights or UBS_LPIPS_WEIGHTS)")
    options.out.mkdir(parents=True, exist_ok=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, child.stop)
    for run in runs:
        if options.resume and run.state == "not run":
            load(run)
    for number, run in enumerate(runs, 1):
        if child.stopped or any(run.state == "interrupted" for run in runs):
            break
        try:
            if run.state == "not run":
                print(f"[{number}/{len(runs)}] {run.id}: training on {run.data}, log {run.folder / 'train.log'}",
                      file=sys.stderr)
                train(run, options)
            if run.state == "done":
                measure(run, options)
        except OSError as error:
            run.end("failed", str(error), DATA)
        values = [f"{heading} {run.values[key]:.4g}" for key, (heading, *_) in METRICS.items() if key in run.values]
        print(f"[{number}/{len(runs)}] {run.id}: {', '.join(filter(None, [run.state, run.reason, *values]))}",
              file=sys.stderr)
        texts = table_texts(spec, runs, options)
        for path, text in zip(tables, [] if options.task else texts):
            write(path, text)
    print(texts[0], end="")
    if child.stopped or any(run.state in ("interrupted", "not run") for run in runs):
        print("experiment.py: interrupted: continue with the same command and --resume", file=sys.stderr)
        return INTERRUPTED
    return next((run.code for run in runs if run.state == "failed"), 0)


def command(options):
    spec, options.version = load_experiment(options.spec), version_of(options.ubs)
    options.out = options.out or pathlib.Path("out") / spec["name"]
    runs = make_plan(spec, options)
    if options.dry_run:
        return dry_run(runs, options)
    if options.task:
        runs = [run for run in runs if run.id == options.task]
        if not runs:
            raise Failure(USAGE, f"--task {options.task}: there is no such run; use --emit-tasks again")
    if not any(run.data for run in runs):
        raise Failure(DATA, f"{options.root}: no data of any of the {len(runs)} runs; {runs[0].id}: {runs[0].reason}")
    return emit_tasks(runs) if options.emit_tasks else execute(spec, runs, options)


def key_value(text):
    key, value = text.split("=", 1)
    return key, value


def parse(arguments):
    built = pathlib.Path(__file__).resolve().parent.parent / "build" / "ubs"
    ubs = str(built) if built.exists() else shutil.which("ubs") or str(built)
    parser = argparse.ArgumentParser(description="Trains the runs of an experiment and compares the results with "
                                     "published ones.", epilog="See docs/experiments.md for details.",
                                     allow_abbrev=False)
    add = parser.add_argument
    add("spec", type=pathlib.Path, help="experiment, such as data_specs/experiments/main_table.yaml")
    add("--root", metavar="DIR", type=pathlib.Path, required=True, help="folder that contains the data sets")
    add("--out", metavar="DIR", type=pathlib.Path, help="output: table.md, table.csv, table.json, runs/ [out/NAME]")
    add("--ubs", metavar="PATH", default=ubs, help="executable [build/ubs of this source tree, or in PATH]")
    names = {"metavar": "A,B", "type": lambda text: text.split(","), "default": [], "action": "extend"}
    add("--scenes", **names, help="only these scenes: lego, or dnerf/lego")
    add("--rows", **names, help="only these rows (methods)")
    add("--scale-down", metavar="K", type=int, nargs="?", const=4, default=1,
        help="small version: images / K, splats / K^2, iterations / K; K = 4 if none is given")
    add("--set", metavar="KEY=VALUE", type=key_value, default=[], action="append",
        help="a setting of all runs, such as iterations=2000 (repeatable)")
    add("--train-argument", metavar="ARG", default=[], action="append",
        help="passed to `ubs train` of every run, as --train-argument=--quiet (repeatable)")
    add("--lpips-weights", metavar="FILE|DIR", default=os.environ.get("UBS_LPIPS_WEIGHTS"),
        help="weights of VGG16 for the column LPIPS: FILE, or DIR/lpips_vgg.safetensors [UBS_LPIPS_WEIGHTS]")
    add("--fps-views", metavar="N", type=int, default=20, help="test views rendered for the column FPS, 0: none [20]")
    add("--device", metavar="DEVICE", help="as for `ubs train`")
    add = parser.add_mutually_exclusive_group().add_argument
    add("--resume", action="store_true", help="keep finished runs with these settings, continue the interrupted one")
    add("--overwrite", action="store_true", help="replace results of earlier runs")
    add("--dry-run", action="store_true", help="only print the runs and the hours that `ubs plan` expects of each")
    add("--emit-tasks", action="store_true", help="only print a JSON line with a command for each run that is not "
        "finished, for job arrays")
    add("--task", metavar="ID", help="only execute this run of --emit-tasks, as with --resume; write no tables")
    options = parser.parse_args(arguments)
    if not 1 <= options.scale_down <= 64 or options.fps_views < 0:
        parser.error("--scale-down must be from 1 to 64, and --fps-views must not be negative")
    options.resume = options.resume or bool(options.task)
    options.on_device = ["--device", options.device] if options.device else []
    return options


def main():
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(**UTF8)
    try:
        return command(parse(sys.argv[1:]))
    except Failure as error:
        code, message = error.args
    except OSError as error:
        code, message = DATA, f"{error.filename}: {error.strerror}" if error.filename else str(error)
    except KeyboardInterrupt:
        return INTERRUPTED
    print("experiment.py: error:", " ".join(message.split()), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
