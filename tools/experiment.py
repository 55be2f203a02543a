#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the runs of an experiment with `ubs train` and compares the results with published ones (docs/experiments.md).

An experiment (data_specs/experiments/*.yaml) has rows, which are settings with a name, and scenes of data sets
(data_specs/sets/*.yaml). A run is the training of a scene with the settings of a row. This program finds the data of
all runs, lets `ubs` check their settings, starts `ubs train` and `ubs eval` for one run after another, and writes the
tables after each run. experiment_files.py reads files, and experiment_tables.py makes the tables.

The files of a run are in OUT/runs/ROW.SET.SCENE. Before the training, this program writes job.json there, which states
the settings and data of the run. At the end of the training, `ubs` writes metrics.json and renames checkpoint.ubs.

Requires the executable `ubs` and PyYAML (Debian: python3-yaml). Exit codes are those of `ubs` (README.md).
"""
import argparse
import datetime
import json
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys

from experiment_files import (
    DATA, INTERNAL, INTERRUPTED, USAGE, UTF8, Failure, find_data, load_experiment, load_results, need, read_json, write)
from experiment_tables import Run, make_tables

# Settings that change what a run stores or prints, but neither its model nor its measurements.
WITHOUT_EFFECT = {"image_cache_mb", "cache_folder", "eval_every", "save_renders", "log_every", "checkpoint_every",
                  "allow_outside"}


def check(code, output, log):
    """If `ubs` failed, raises a Failure with its error message or, if it printed none, with its exit code or signal."""
    if code != 0:
        how = f"ended by signal {-code}" if code < 0 else f"exit code {code}"
        messages = re.findall("^ubs: error: (.*)$", output, re.MULTILINE)
        raise Failure(max(code, INTERNAL), messages[-1] if messages else f"{how}; see {log}")


def ask(ubs, *arguments):
    """Returns the JSON object that a command of `ubs` prints."""
    command = [ubs, *map(str, arguments), "--json"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False, **UTF8)
        check(done.returncode, done.stderr, f"{ubs} {arguments[0]}")
        return json.loads(done.stdout)
    except (OSError, ValueError) as error:
        raise Failure(USAGE, f"{ubs}: cannot be used as ubs ({error}): pass --ubs PATH") from error


def call(log, *command):
    """Runs a command with its output in the file `log`. The command runs in another session, so it does not get Ctrl-C.
    It gets SIGTERM instead, and `ubs train` then saves its state. After SIGINT, a run with a time budget would first
    complete its schedule."""
    command = [str(word) for word in command]
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


def make_plan(spec, options):
    """Returns the runs that the options select, in the order of the file: rows, then data sets, then scenes."""
    runs = [Run(row, data, scene) for row in spec["rows"] for data in spec["sets"] for scene in data["scenes"]]
    for option, given, names in (("--rows", options.rows, lambda run: {run.row["name"]}),
                                 ("--scenes", options.scenes, lambda run: {run.scene, run.place}),
                                 ("--task", options.task, lambda run: {run.id})):
        known = set().union(*map(names, runs))
        for name in given:
            need(name in known, option, f"unknown name '{name}'; there are: {', '.join(sorted(known))}", USAGE)
        runs = [run for run in runs if not given or names(run) & set(given)]
    for run in runs:
        run.folder = options.out / "runs" / run.id.replace("/", ".")
        run.data = find_data(run, spec, options.root)
        if not run.data:
            run.state = "no data"
            run.reason = f"there is neither {options.root / run.place} nor a folder of its other names"
        choose_settings(run, spec, options)
        if run.data:
            load_results(run)
    return runs


def choose_settings(run, spec, options):
    """Collects the settings of a run and lets `ubs` check them."""
    settings, scaled = {}, {}
    for part in (run.data_set, run.about, spec, run.data_set["entry"], run.row):  # later ones take precedence
        settings |= part.get("settings", {})
    try:
        published = ask(options.ubs, "train", "--print-settings", *set_options(settings))
    except Failure as error:
        raise Failure(DATA, f"{options.spec}: {run.id}: settings: {str(error).removeprefix('--set: ')}") from error
    if (k := options.scale_down) > 1:  # keeps the number of splats per pixel
        factors = {"downscale": k, "iterations": 1 / k, "cap_max": 1 / k**2, "init_points": 1 / k**2}
        scaled = {key: max(1, round(published[key] * factor)) for key, factor in factors.items()
                  if published[key] != "auto"}
    given = [*set_options(settings | scaled), *(f"--set={setting}" for setting in options.set)]
    used = ask(options.ubs, "train", "--print-settings", *given)
    budget = int(run.row.get("budget", 0))  # in seconds; 0: none
    # With a budget, `ubs` chooses the settings that are not passed. Otherwise all settings are passed.
    run.arguments = ["--budget", f"{budget}s", *given] if budget else set_options(used)
    run.settings = {key: value for key, value in used.items() if key not in WITHOUT_EFFECT}
    run.changes = [f"{key} {published[key]} -> {value}" for key, value in run.settings.items()
                   if value != published[key]]
    run.identity = {"data": os.path.realpath(run.data or ""), "budget": budget, "settings": run.settings}


def train(run, options):
    """Trains a run, or continues its interrupted training."""
    job, checkpoint = run.folder / "job.json", run.folder / "checkpoint.ubs"
    same = read_json(job).get("identity") == run.identity
    if same and checkpoint.exists():
        arguments = ["--resume", run.folder]
    else:
        arguments = ["--out", run.folder, "--overwrite", *run.arguments]
        run.folder.mkdir(parents=True, exist_ok=True)
        for file in (checkpoint, run.folder / "metrics.json", run.folder / "eval.json"):
            file.unlink(missing_ok=True)
        commit = pathlib.Path(os.path.realpath(options.ubs) + ".commit")
        record = {"identity": run.identity, "commit": commit.read_text().strip() if commit.exists() else "unknown",
                  "command": shlex.join(sys.orig_argv), "begun": datetime.datetime.now().isoformat()}
        write(job, json.dumps(record, indent=2))
    try:
        call(run.folder / "train.log", options.ubs, "train", "--data", run.data, *arguments)
    except Failure as error:
        if error.code == USAGE and not same:  # it did not start: another run may be writing to the folder
            job.unlink()
        raise
    load_results(run)
    need(run.state == "done", run.folder / "metrics.json", "the training did not reach its last iteration")


def measure(run, options):
    """Measures what training does not measure: the width of the images, FPS, and LPIPS if there are weights."""
    weights, width = options.lpips_weights, run.about.get("width", run.data_set.get("width"))
    lpips = ["--lpips", "vgg", "--lpips-range", "unit", "--lpips-weights", weights] if weights else []
    try:
        if width:
            found = ask(options.ubs, "info", run.data, "--spec", run.folder / "config.yaml")
            used = found["splits"]["train"]["sizes"][0][0]
            if abs(used / int(width) - 1) > 0.05:  # published widths are approximate
                run.changes.append(f"images {used} px wide (published: about {width})")
        if "psnr" in run.ours and ("fps" not in run.ours or (lpips and "lpips" not in run.ours)):
            call(run.folder / "measure.log", options.ubs, "eval", "--model", run.folder, "--data", run.data,
                 "--out", run.folder / "eval.json", "--overwrite", *lpips)
            load_results(run)
    except (Failure, OSError) as error:
        run.reason = f"FPS, LPIPS or the image size not measured: {error}"


def dry_run(runs, options):
    """Prints the runs and the hours that `ubs plan` expects of each."""
    total = 0
    for run in runs:
        print(f"{run.id}: ", end="", flush=True)
        if run.state == "not run":
            seconds = run.identity["budget"] or ask(options.ubs, "plan", "--data", run.data, *run.arguments)["seconds"]
            total += seconds
            print(f"{seconds / 3600:.3f} h, {run.data}")
        else:
            print(f"{run.state}: {run.reason}")
    print(f"\nestimated total: {total / 3600:.3f} hours, without loading and evaluation")


def execute(spec, runs, options):
    """Trains and measures unfinished runs, and writes the tables after each run. Returns the exit code of the first
    failed run."""
    options.out.mkdir(parents=True, exist_ok=True)
    need(options.resume or options.task or not any(options.out.iterdir()), options.out,
         "is not empty: continue with --resume, or choose another --out", USAGE)
    code, tables = 0, {}
    for number, run in enumerate(runs, 1):
        name = f"[{number}/{len(runs)}] {run.id}"
        try:
            if run.state == "not run":
                print(f"{name}: training on {run.data}, log {run.folder / 'train.log'}", file=sys.stderr)
                train(run, options)
            if run.state == "done":
                measure(run, options)
        except (Failure, OSError) as error:
            run.state, run.reason = "failed", str(error)
            code = code or getattr(error, "code", DATA)
        except KeyboardInterrupt:
            run.state, run.reason = "interrupted", f"its results so far are in {run.folder}"
            load_results(run)  # after the last iteration, a signal has no effect
            raise
        finally:
            psnr = f", PSNR {run.ours['psnr']:.2f} dB" if "psnr" in run.ours else ""
            print(f"{name}: {run.state}{psnr}{', ' if run.reason else ''}{run.reason}", file=sys.stderr)
            tables = make_tables(spec, runs)
            if not options.task:
                for file, text in tables.items():
                    write(options.out / file, text)
    print(tables["table.md"], end="")
    return code


def parse(arguments):
    """Returns the options of the command."""
    built = pathlib.Path(__file__).resolve().parent.parent / "build" / "ubs"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    add = parser.add_argument
    add("spec", type=pathlib.Path, help="file of the experiment, such as data_specs/experiments/main_table.yaml")
    add("--root", metavar="DIR", type=pathlib.Path, required=True, help="folder that contains the data sets")
    add("--out", metavar="DIR", type=pathlib.Path, help="output: table.md, table.csv, table.json, runs/ [out/NAME]")
    add("--ubs", metavar="PATH", default=str(built) if built.exists() else "ubs",
        help="executable [build/ubs of this source tree, or in PATH]")
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
        return execute(spec, runs, options)
    return 0


def main():
    """Executes the command, prints its errors in one line, and returns its exit code."""
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
