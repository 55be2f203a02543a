#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the runs of an experiment with `ubs train` and compares the results with published ones (docs/experiments.md).

An experiment (data_specs/experiments/*.yaml) has rows, which are settings with a name, and scenes of data sets
(data_specs/sets/*.yaml). A run is the training of a scene with the settings of a row. This program reads the files,
finds the data, lets `ubs` check the settings, starts `ubs train` and `ubs eval` for one run after another, and writes
the tables after each run.

The files of a run are in OUT/runs/ROW.SET.SCENE. Before the training, this program writes job.json there, which states
the settings and data of the run. At the end of the training, `ubs` writes metrics.json and renames checkpoint.ubs.

Requires the executable `ubs` and PyYAML (Debian: python3-yaml). Exit codes are those of `ubs` (README.md).
"""
import argparse
import csv
import datetime
import io
import json
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys

import yaml

INTERNAL, USAGE, DATA, INTERRUPTED = 1, 2, 3, 130  # exit codes
UTF8 = {"encoding": "utf-8", "errors": "surrogateescape"}  # paths may have any bytes
AVERAGE = "average"  # is used instead of the name of a scene for published averages
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
# Settings that change what a run stores or prints, but neither its model nor its measurements.
WITHOUT_EFFECT = {"image_cache_mb", "cache_folder", "eval_every", "save_renders", "log_every", "checkpoint_every",
                  "allow_outside"}


class Failure(Exception):
    """An error for the user, with the exit code that `ubs` uses for errors of this kind."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


def need(condition, where, message, code=DATA):
    """Raises an error about a file, a folder or an option if the condition is not met."""
    if not condition:
        raise Failure(code, f"{where}: {message}")


def read_json(path):
    """Returns the content of a file, or nothing if it is missing or damaged."""
    try:
        return json.loads(path.read_text(**UTF8))
    except (OSError, ValueError):
        return {}


def write(path, text):
    """Replaces a file. If this fails, the file has the old content."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, **UTF8)
    temporary.replace(path)


def check(code, output, log):
    """If `ubs` failed, raises a Failure with its error message or, if it printed none, with its exit code or signal."""
    if code != 0:
        how = f"ended by signal {-code}" if code < 0 else f"exit code {code}"
        messages = re.findall("^ubs: error: (.*)$", output, re.MULTILINE)
        raise Failure(max(code, INTERNAL), messages[-1] if messages else f"{how}; see {log}")


def ask(ubs, *arguments):
    """Returns the JSON object that a command of `ubs` prints."""
    command = [ubs, *arguments, "--json"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False, **UTF8)
        check(done.returncode, done.stderr, f"{ubs} {arguments[0]}")
        return json.loads(done.stdout)
    except (OSError, ValueError) as error:
        raise Failure(USAGE, f"{ubs}: cannot be used as ubs ({error}): pass --ubs PATH") from error


def call(command, log):
    """Runs a command with its output in the file `log`. The command runs in another session, so it does not get Ctrl-C.
    It gets SIGTERM instead, and `ubs train` then saves its state. After SIGINT, a run with a time budget would first
    complete its schedule."""
    command = list(map(str, command))
    with open(log, "w", **UTF8) as file:
        print("$", shlex.join(command), file=file, flush=True)
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True)
        try:
            code = process.wait()
        except KeyboardInterrupt:
            process.terminate()
            process.wait()
            raise
    if code == INTERRUPTED:  # only `ubs` got the signal
        raise KeyboardInterrupt
    check(code, log.read_text(**UTF8), log)


def set_options(settings):
    """Returns the options of `ubs` for these settings."""
    def text(value):
        if isinstance(value, list):
            return ",".join(map(text, value))
        return value if isinstance(value, str) else json.dumps(value)

    return [f"--set={key}={text(value)}" for key, value in settings.items()]


# Files of experiments and data sets. There are four kinds of schemas. A text is a pattern that a value must match. [A]
# is a list of items that match the schema A. A mapping maps patterns of keys to schemas, with "!" after required keys.
# ANY allows all values; it is used for settings, which `ubs` checks.

ANY = object()
TEXT = r"[^\0\ud800-\udfff]+"
NAME, WIDTH, SECONDS = "[A-Za-z0-9_-]{1,64}", "[1-9][0-9]{0,4}", "[1-9][0-9]{0,5}"  # names are names of folders, too
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
             f"{value!r} is not allowed: expected {'text' if schema is TEXT else schema}")
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
    """Returns an experiment with its data sets in "sets", and published values of rows by "set/scene" and metric."""
    spec = {"published": {"source": "", "columns": []}, **read_yaml(path, EXPERIMENT)}
    spec["sets"], columns, places = [], spec["published"]["columns"], set()
    for entry in spec["data"]:
        data = read_yaml(path.parent / entry["set"], DATA_SET)
        need(data["scenes"], path.parent / entry["set"], "the data set has no scenes")
        for scene in entry.get("scenes", []):
            need(scene in data["scenes"], path, f"data set '{data['name']}' has no scene '{scene}'")
        chosen = {scene: data["scenes"][scene] for scene in entry.get("scenes", data["scenes"])}
        spec["sets"].append({**data, "scenes": chosen, "entry": entry})
        places |= {f"{data['name']}/{scene}" for scene in [*chosen, AVERAGE]}
    for what, names in (("data sets", [data["name"] for data in spec["sets"]]), ("columns", columns),
                        ("rows", [row["name"] for row in spec["rows"]])):
        need(len(set(names)) == len(names), path, f"two {what} have the same name: {', '.join(names)}")
    for row in spec["rows"]:
        published = {}
        for data, scenes in row.get("published", {}).items():
            for scene, values in scenes.items():
                place, where = f"{data}/{scene}", f"{path}: row '{row['name']}': published: {data}: {scene}"
                need(place in places, where, "is not a scene of this experiment")
                need(len(values) == len(columns), where, f"needs {len(columns)} values, one per column (or null)")
                published[place] = {key: float(value) for key, value in zip(columns, values) if value != "null"}
        row["published"] = published
    return spec


class Run:
    """A line of the tables: a row of the experiment for one scene, or for an average over scenes."""

    def __init__(self, row, data_set, scene, title=None):
        self.row, self.set, self.scene = row, data_set, scene
        self.about = data_set["scenes"].get(scene, {})
        self.title = title or self.about.get("title", scene)
        self.place = f"{data_set['name']}/{scene}"
        self.id = f"{row['name']}/{self.place}"
        self.folder = self.data = None  # their paths; the data may be missing
        self.budget = int(row.get("budget", 0))  # in seconds; 0: none
        self.settings = {}  # those that have an effect on the result
        self.changes = []  # differences from the published settings
        self.identity = {}  # everything that determines the result on one device and build
        self.arguments = []  # for `ubs train`
        self.state, self.reason, self.code = "not run", "", 0  # later: done, no data, failed or interrupted
        self.values, self.paper = {}, row["published"].get(self.place, {})  # measured and published values by metric
        self.record = {}  # job.json, and the build and the device of metrics.json

    def end(self, state, reason="", code=0):
        """Sets the state, the reason for it, and the exit code of a failed run."""
        self.state, self.reason, self.code = state, reason, code

    def compared(self, key):
        """Returns the values of a metric and their difference; None where there is none."""
        ours, paper = self.values.get(key), self.paper.get(key)
        return {"ours": ours, "published": paper, "difference": None if None in (ours, paper) else ours - paper}


def find_data(run, root, unique):
    """Returns the data of a run: ROOT/SET/SCENE or, if the scene name is unique among the data sets, ROOT/SCENE. The
    data set and the scene may also have one of the names in `folders`. Each may be a packed file. Returns None if
    nothing is found."""
    scenes = [run.scene, *run.about.get("folders", [])]
    places = [root / folder / scene for folder in [run.set["name"], *run.set.get("folders", [])] for scene in scenes]
    places += [root / scene for scene in scenes] if unique else []
    files = [file for place in places for file in (place, pathlib.Path(f"{place}.ubsd"))]
    return next((file for file in files if file.exists()), None)


def make_plan(spec, options):
    """Returns the runs that the options select, in the order of the file: rows, then data sets, then scenes."""
    runs = [Run(row, data, scene) for row in spec["rows"] for data in spec["sets"] for scene in data["scenes"]]
    scenes = [scene for data in spec["sets"] for scene in data["scenes"]]
    for option, given, names in (("--rows", options.rows, lambda run: {run.row["name"]}),
                                 ("--scenes", options.scenes, lambda run: {run.scene, run.place}),
                                 ("--task", options.task, lambda run: {run.id})):
        known = set().union(*map(names, runs))
        for name in given:
            need(name in known, option, f"unknown name '{name}'; there are: {', '.join(sorted(known))}", USAGE)
        runs = [run for run in runs if not given or names(run) & set(given)]
    for run in runs:
        run.folder = options.out / "runs" / run.id.replace("/", ".")
        run.data = find_data(run, options.root, unique=scenes.count(run.scene) == 1)
        plan_settings(run, spec, options)
        if run.data:
            load(run)
        else:
            run.end("no data", f"there is neither {options.root / run.place} nor a folder of its other names")
    return runs


def plan_settings(run, spec, options):
    """Collects the settings of a run and lets `ubs` check them."""
    settings, further = {}, {}
    for part in (run.set, run.about, spec, run.set["entry"], run.row):  # later ones take precedence
        settings |= part.get("settings", {})
    try:
        published = ask(options.ubs, "train", "--print-settings", *set_options(settings))
    except Failure as error:
        raise Failure(DATA, f"{options.spec}: {run.id}: settings: {str(error).removeprefix('--set: ')}") from error
    if (k := options.scale_down) > 1:  # keeps the number of splats per pixel
        factors = {"downscale": k, "iterations": 1 / k, "cap_max": 1 / k**2, "init_points": 1 / k**2}
        further = {key: max(1, round(published[key] * factor)) for key, factor in factors.items()
                   if published[key] != "auto"}
    run.arguments = [*set_options(settings), *set_options(further), *(f"--set={setting}" for setting in options.set)]
    used = ask(options.ubs, "train", "--print-settings", *run.arguments)
    # With a budget, `ubs` chooses the settings that are not passed. Otherwise all settings are passed.
    run.arguments = ["--budget", f"{run.budget}s", *run.arguments] if run.budget else set_options(used)
    run.settings = {key: value for key, value in used.items() if key not in WITHOUT_EFFECT}
    run.changes = [f"{key} {published[key]} -> {value}" for key, value in run.settings.items()
                   if value != published[key]]
    run.identity = {"data": os.path.realpath(run.data or ""), "budget": run.budget, "settings": run.settings}


def load(run):
    """Reuses the results of a finished training run with the same settings and data."""
    metrics, evaluation, job = (read_json(run.folder / name) for name in ("metrics.json", "eval.json", "job.json"))
    if (job.get("identity") != run.identity or (run.folder / "checkpoint.ubs").exists()
            or metrics.get("interrupted", True) or metrics.get("ended_early")):
        return
    test, model = (metrics["test"] or {}).get("mean", {}), run.folder / "model.ply"
    values = {"psnr": test.get("psnr"), "ssim": test.get("ssim"),
              "lpips": evaluation.get("mean", {}).get("lpips_vgg_unit"),
              "minutes": metrics["seconds"] / 60, "fps": evaluation.get("frames", {}).get("fps_wall"),
              "splats": metrics["splats"], "mib": model.stat().st_size / 2**20 if model.exists() else None}
    run.values = {key: float(value) for key, value in values.items() if value is not None}
    run.record = job | {key: metrics.get(key) for key in ("version", "build", "device", "data_report")}
    run.end("done", "" if "psnr" in run.values else "the data have no test views with images: not measured")


def train(run, options):
    """Trains a run, or continues its interrupted training."""
    folder, job, checkpoint = run.folder, run.folder / "job.json", run.folder / "checkpoint.ubs"
    same = read_json(job).get("identity") == run.identity
    if same and checkpoint.exists():
        arguments = ["--resume", folder]
    else:
        arguments = ["--out", folder, "--overwrite", *run.arguments]
        folder.mkdir(parents=True, exist_ok=True)
        for file in (job, checkpoint, folder / "metrics.json", folder / "eval.json"):
            file.unlink(missing_ok=True)
        commit = pathlib.Path(os.path.realpath(options.ubs) + ".commit")
        record = {"identity": run.identity, "commit": commit.read_text().strip() if commit.exists() else "unknown",
                  "command": shlex.join(sys.orig_argv), "begun": datetime.datetime.now().isoformat()}
        write(job, json.dumps(record, indent=2))
    try:
        call([options.ubs, "train", "--data", run.data, *arguments], folder / "train.log")
    except Failure as error:
        if error.code == USAGE and not same:  # it did not start: another run may be writing to the folder
            job.unlink()
        raise
    load(run)
    need(run.state == "done", f"{folder}/metrics.json", "the training did not reach its last iteration")


def measure(run, options):
    """Measures what training does not measure: the width of the images, FPS, and LPIPS if there are weights."""
    folder, weights, width = run.folder, options.lpips_weights, run.about.get("width", run.set.get("width"))
    lpips = ["--lpips", "vgg", "--lpips-range", "unit", "--lpips-weights", weights] if weights else []
    try:
        if width:
            found = ask(options.ubs, "info", str(run.data), "--spec", str(folder / "config.yaml"))
            used = found["splits"]["train"]["sizes"][0][0]
            if abs(used / int(width) - 1) > 0.05:  # published widths are approximate
                run.changes.append(f"images {used} px wide (published: about {width})")
        if "psnr" in run.values and ("fps" not in run.values or (lpips and "lpips" not in run.values)):
            call([options.ubs, "eval", "--model", folder, "--data", run.data, "--out", folder / "eval.json",
                  "--overwrite", *lpips], folder / "measure.log")
            load(run)
    except (Failure, OSError) as error:
        run.reason = f"FPS, LPIPS or the image size not measured: {error}"


def averages(runs):
    """Returns two lines of tables: the means over runs of a row, and the average that was published. The means of a
    metric are over the runs that have both the measured and the published value, so that a missing scene does not
    shift the difference. If there is no published value, the mean is over all measured runs."""
    row, data = runs[0].row, runs[0].set
    means = Run(row, data, "mean", f"mean of {sum(run.state == 'done' for run in runs)} of {len(data['scenes'])}")
    printed = Run(row, data, AVERAGE, f"average as printed, {len(data['scenes'])} scenes")
    for key in METRICS:
        both = [run for run in runs if key in run.values and key in run.paper]
        measured = both or [run for run in runs if key in run.values]
        if measured:
            means.values[key] = sum(run.values[key] for run in measured) / len(measured)
        if both:
            means.paper[key] = sum(run.paper[key] for run in both) / len(both)
    lines = [means, printed] if printed.paper else [means]
    for line in lines:
        line.end("done")
    return lines


def shown(lines):
    """Returns the metrics that occur in the lines."""
    return {key: metric for key, metric in METRICS.items() if any(key in run.values | run.paper for run in lines)}


def write_tables(spec, runs, options):
    """Writes table.md, table.csv and table.json, and returns the text of table.md. With --task, writes no files. Lines
    are ordered by data set and row; averages follow the runs of a row."""
    lines = []
    for data in spec["sets"]:
        for row in spec["rows"]:
            own = [run for run in runs if run.set is data and run.row is row]
            lines += own + (averages(own) if own and len(data["scenes"]) > 1 else [])
    text = markdown(spec, runs, lines)
    if options.task:
        return text
    csv_text = io.StringIO()
    table = csv.writer(csv_text, lineterminator="\n")
    table.writerow(["row", "dataset", "scene", "state", "metric", "ours", "published", "difference"])
    for run in lines:
        for key in shown([run]) or [""]:
            values = ["" if value is None else f"{value:.10g}" for value in run.compared(key).values()]
            table.writerow([run.row["name"], run.set["name"], run.scene, run.state, key, *values])
    entries = [{"row": run.row["name"], "dataset": run.set["name"], "scene": run.scene, "title": run.title,
                "state": run.state, "reason": run.reason, "data": str(run.data or ""),
                "metrics": {key: run.compared(key) for key in shown([run])}, "not_as_published": run.changes,
                "settings": run.settings, "record": run.record} for run in lines]
    record = {"experiment": spec["name"], "date": datetime.datetime.now().isoformat(),
              "command": shlex.join(sys.orig_argv), "published_source": spec["published"]["source"], "lines": entries}
    write(options.out / "table.md", text)
    write(options.out / "table.csv", csv_text.getvalue())
    write(options.out / "table.json", json.dumps(record, indent=2) + "\n")
    return text


def grouped(pairs):
    """Returns a list in Markdown of texts, each preceded by all names to which it applies."""
    names = {}
    for name, text in pairs:
        names.setdefault(text, []).append(name)
    return "\n".join(f"- {', '.join(names[text])}: {text}" for text in names if text)


def markdown_table(rows):
    """Returns a table in Markdown. The first row is the heading."""
    return "\n".join("| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |"
                     for cells in (rows[0], ["---"] * len(rows[0]), *rows[1:]))


def overview(lines):
    """Returns a table with a line for each scene and a column for each row: the PSNR, and the training time. If there
    is only one row, returns nothing."""
    cells = {}
    for run in lines:
        if run.scene != AVERAGE:
            ours = run.values
            cells.setdefault("mean" if run.scene == "mean" else run.title, {})[run.row.get("label", run.row["name"])] = (
                f"{ours['psnr']:.2f} dB, {60 * ours['minutes']:.0f} s" if "psnr" in ours else "–")
    methods = list(dict.fromkeys(method for by_method in cells.values() for method in by_method))
    rows = [[scene, *(by_method.get(method, "–") for method in methods)] for scene, by_method in cells.items()]
    return markdown_table([["scene", *methods], *rows]) if len(methods) > 1 else ""


def set_table(lines):
    """Returns the table of one data set in Markdown, with a line for each run."""
    columns, table = [], []  # a column: heading, key of the metric, which of the compared values, format
    for key, (heading, decimals, quality, _) in shown(lines).items():
        published = any(key in run.paper for run in lines)
        columns.append((heading, key, "ours", f".{decimals}f"))
        columns += [("paper", key, "published", f".{decimals}f")] if published else []
        columns += [("difference", key, "difference", f"+.{decimals}f")] if published and quality else []
    for run in lines:
        values = [(run.compared(key)[which], form) for _, key, which, form in columns]
        table.append([run.row.get("label", run.row["name"]),
                      run.title if run.state == "done" else f"{run.title} ({run.state})",
                      *("–" if value is None else format(value, form) for value, form in values)])
    return markdown_table([["method", "scene", *(heading for heading, *_ in columns)], *table])


def markdown(spec, runs, lines):
    """Returns the tables of all data sets in Markdown, and the information that is needed to compare the values."""
    done, source = [run for run in runs if run.state == "done"], spec["published"]["source"]
    changes = grouped((run.id, ", ".join(run.changes)) for run in done)
    missing = grouped((run.id, f"{run.state}: {run.reason}") for run in runs if run.reason)
    origins = {"{device[name]} ({device[platform]}); ubs {version}, build {build}, commit {commit}".format(**run.record)
               for run in done}
    paragraphs = [
        f"# {spec.get('title', spec['name'])}", f"{datetime.date.today()}. Values after the last iteration.",
        source and f"Difference: ours minus paper. Published values: {source}", spec.get("notes"),
        changes and "**Not the published settings or image sizes**, so a difference to the paper is expected:", changes,
        source and not changes and "All runs have the published settings and image sizes."]
    for data in spec["sets"]:
        if own := [run for run in lines if run.set is data]:
            compared = any(run.paper for run in own)
            paragraphs += [f"## {data.get('title', data['name'])}", not compared and overview(own), set_table(own)]
    paragraphs += [
        missing and "## Not in the table", missing,
        "## Metrics and settings", grouped((heading, text) for heading, _, _, text in shown(lines).values()),
        *(f"Measured with: {origin}" for origin in sorted(origins)), f"    {shlex.join(sys.orig_argv)}",
        "All settings of every run: `table.json`, and `config.yaml` in its folder."]
    return "\n\n".join(paragraph for paragraph in paragraphs if paragraph) + "\n"


def dry_run(runs, options):
    """Prints the runs and the hours that `ubs plan` expects of each."""
    total = 0
    for run in runs:
        print(f"{run.id}: ", end="", flush=True)
        if run.state == "not run":
            seconds = run.budget or ask(options.ubs, "plan", "--data", str(run.data), *run.arguments)["seconds"]
            total += seconds
            print(f"{seconds / 3600:.3f} h, {run.data}")
        else:
            print(f"{run.state}: {run.reason}")
    print(f"\nestimated total: {total / 3600:.3f} hours, without loading and evaluation")


def execute(spec, runs, options):
    """Trains and measures unfinished runs, and writes the tables after each run. Returns the exit code of the first
    failed run."""
    for number, run in enumerate(runs, 1):
        name = f"[{number}/{len(runs)}] {run.id}"
        try:
            if run.state == "not run":
                print(f"{name}: training on {run.data}, log {run.folder / 'train.log'}", file=sys.stderr)
                train(run, options)
            if run.state == "done":
                measure(run, options)
        except (Failure, OSError) as error:
            run.end("failed", str(error), getattr(error, "code", DATA))
        except KeyboardInterrupt:
            run.end("interrupted", f"its results so far are in {run.folder}")
            load(run)  # after the last iteration, a signal has no effect
            raise
        finally:
            psnr = f", PSNR {run.values['psnr']:.2f} dB" if "psnr" in run.values else ""
            print(f"{name}: {run.state}{psnr}{', ' if run.reason else ''}{run.reason}", file=sys.stderr)
            text = write_tables(spec, runs, options)
    print(text, end="")
    return next((run.code for run in runs if run.state == "failed"), 0)


def command(options):
    """Does what the options ask for and returns the exit code."""
    for path in (options.root, options.lpips_weights):
        need(not path or os.path.exists(path), path, "no such file or folder")
    ask(options.ubs, "train", "--print-settings")  # fails if this is not the executable
    spec = load_experiment(options.spec)
    options.out = options.out or pathlib.Path("out") / spec["name"]
    runs = make_plan(spec, options)
    need(any(run.data for run in runs), options.root,
         f"no data of any of the {len(runs)} runs; {runs[0].id}: {runs[0].reason}")
    if options.dry_run:
        dry_run(runs, options)
    elif options.emit_tasks:
        words = [word for word in sys.orig_argv if word != "--emit-tasks"]
        for run in runs:
            if run.state == "not run":
                print(json.dumps({"id": run.id, "command": shlex.join([*words, "--task", run.id])}))
    else:
        options.out.mkdir(parents=True, exist_ok=True)
        need(options.resume or options.task or not any(options.out.iterdir()), options.out,
             "is not empty: continue with --resume, or choose another --out", USAGE)
        return execute(spec, runs, options)
    return 0


def parse(arguments):
    built = pathlib.Path(__file__).resolve().parent.parent / "build" / "ubs"
    ubs = str(built) if built.exists() else "ubs"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    add = parser.add_argument
    add("spec", type=pathlib.Path, help="file of the experiment, such as data_specs/experiments/main_table.yaml")
    add("--root", metavar="DIR", type=pathlib.Path, required=True, help="folder that contains the data sets")
    add("--out", metavar="DIR", type=pathlib.Path, help="output: table.md, table.csv, table.json, runs/ [out/NAME]")
    add("--ubs", metavar="PATH", default=ubs, help="executable [build/ubs of this source tree, or in PATH]")
    names = {"metavar": "A,B", "type": lambda text: text.split(","), "default": [], "action": "extend"}
    add("--scenes", **names, help="only run these scenes, such as lego or dnerf/lego")
    add("--rows", **names, help="only run these rows (methods)")
    add("--scale-down", metavar="K", type=int, nargs="?", const=4, default=1,
        help="run a smaller version: divide the width of the images and the iterations by K, and the number of splats "
        "by K^2; K = 4 if it is omitted")
    add("--set", metavar="KEY=VALUE", default=[], action="append",
        help="a setting of all runs, such as iterations=2000 (repeatable)")
    add("--lpips-weights", metavar="FILE|DIR", type=pathlib.Path, default=os.environ.get("UBS_LPIPS_WEIGHTS"),
        help="weights of VGG16 for the column LPIPS: FILE, or DIR/lpips_vgg.safetensors [UBS_LPIPS_WEIGHTS]")
    add("--device", help="device, as for `ubs train` [UBS_DEVICE]")
    add = parser.add_mutually_exclusive_group().add_argument
    add("--resume", action="store_true", help="keep finished runs with these settings, continue the interrupted one")
    add("--dry-run", action="store_true", help="only print the runs and the hours that `ubs plan` expects of each")
    add("--emit-tasks", action="store_true", help="train nothing, but print the command of each run that is not "
        "finished, for job arrays (one JSON object per line)")
    add("--task", metavar="ID", default=[], action="append",
        help="only execute this run of --emit-tasks, as with --resume; write no tables")
    options = parser.parse_args(arguments)
    if options.scale_down < 1:
        parser.error("--scale-down must be at least 1")
    if options.device:
        os.environ["UBS_DEVICE"] = options.device
    return options


def main():
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(**UTF8)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        return command(parse(sys.argv[1:]))
    except KeyboardInterrupt:
        code, message = INTERRUPTED, "interrupted: continue with the same command and --resume"
    except Failure as error:
        code, message = error.code, f"error: {error}"
    except OSError as error:
        code, message = DATA, f"error: {error.filename}: {error.strerror}" if error.filename else f"error: {error}"
    print("experiment.py:", " ".join(message.split()), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
