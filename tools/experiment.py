#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the runs of an experiment with `ubs train` and compares the results with published ones (docs/experiments.md).

An experiment (data_specs/experiments/*.yaml) consists of rows, which are settings with a name, and of scenes of data
sets (data_specs/sets/*.yaml). Each run is a process of its own: one that crashes or runs out of memory ends alone.
Requires the executable `ubs` and PyYAML (Debian: python3-yaml). Exit codes are those of `ubs` (README.md).
"""
import argparse
import ctypes
import datetime
import difflib
import fcntl
import hashlib
import json
import math
import os
import pathlib
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field

import yaml

INTERNAL, USAGE, DATA, INTERRUPTED = 1, 2, 3, 130  # exit codes
AVERAGE = "average"  # is written instead of the name of a scene
# By the key in files: heading, what exactly we measure, decimals, and whether it is a quality of images, which gets a
# column of differences; the others are costs.
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
# Settings that change what a run keeps or shows, but neither its model nor its measurements.
WITHOUT_EFFECT = {"image_cache_mb", "cache_folder", "eval_every", "save_renders", "log_every", "checkpoint_every",
                  "allow_outside"}
# Settings that decide how large the images are.
READING = ("layout", "images", "downscale", "test_every", "frames", "cache_folder", "allow_outside")


class Failure(Exception):
    """An error for the user, with the exit code that `ubs` has for errors of its kind."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


def remark(text):
    print(text, file=sys.stderr, flush=True)


def write(path, text):
    """Replaces a file atomically: after a crash, or on a full disk, it has the old or the new content."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with open(temporary, "w", encoding="utf-8", errors="surrogateescape") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def read_json(path):
    try:
        return json.loads(path.read_text(encoding="utf-8", errors="surrogateescape"))
    except ValueError as error:
        raise Failure(DATA, f"{path}: not JSON: {error}")


def to_json(value):
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def hash_of(value):
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]


def utc_date():
    return datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def is_inside(path, folder):
    path, folder = os.path.realpath(path), os.path.realpath(folder)
    return os.path.commonpath([path, folder]) == folder


def lock(folder):
    """Opens the file that locks the folder, the one of `ubs train`. The lock ends when all processes have closed it."""
    folder.mkdir(parents=True, exist_ok=True)
    file = open(folder / ".ubs-lock", "a")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise Failure(USAGE, f"{folder}: another process is writing there: wait for it, or choose another --out")
    except OSError:  # a file system without locks
        pass
    return file


# Processes of ubs


class Interrupt:
    """Notes a request to end, and passes every request on to the running child, which then saves its state."""

    requested = False
    child = None

    def install(self):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # which nohup ignores
                signal.signal(number, self.handle)

    def handle(self, *_):
        self.requested = True
        if self.child:
            self.child.send_signal(signal.SIGINT)


interrupt = Interrupt()


def start(command, **options):
    """Starts a child in a session of its own, so that Ctrl-C reaches it through this process alone. The system ends it
    with SIGTERM when this process is killed."""
    parent, library = os.getpid(), ctypes.CDLL(None)

    def prepare():
        library.prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os._exit(127)

    try:
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=prepare,
                                 **options)
    except OSError as error:
        raise Failure(USAGE, f"{command[0]}: cannot be started ({error.strerror}): pass --ubs PATH")
    interrupt.child = child
    if interrupt.requested:  # before the line above
        child.send_signal(signal.SIGINT)
    return child


def reason_of(code, output, more=""):
    """Why a process ended: its error message, or the signal or exit code and `more`."""
    if code < 0:
        return f"ended by signal {-code} ({signal.strsignal(-code)}){more}"
    errors = re.findall("^ubs: error: (.*)$", output, re.MULTILINE)
    return f"{errors[-1]} (exit code {code})" if errors else f"exit code {code}{more}"


class Ubs:
    """The executable."""

    def __init__(self, path):
        self.path, self.answers = path, {}
        found = re.match(r"ubs (\S+) \(build (\S+)\)", self.run("--version")[1])
        if not found:
            raise Failure(USAGE, f"{path}: is not an executable of ubs: pass --ubs PATH")
        commit = pathlib.Path(os.path.realpath(path) + ".commit")
        self.version, self.build = found.groups()
        self.commit = commit.read_text().strip() if commit.exists() else "unknown"

    def run(self, *arguments):
        child = start([self.path, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
                      errors="surrogateescape")
        output, errors = child.communicate()
        interrupt.child = None
        return child.returncode, output, errors

    def answer(self, *arguments):
        """The JSON that a command prints. The same question is asked once."""
        if arguments not in self.answers:
            self.answers[arguments] = self.run(*arguments)
        code, output, errors = self.answers[arguments]
        if code != 0:
            raise Failure(abs(code), reason_of(code, errors).removesuffix(f" (exit code {code})"))
        return json.loads(output)

    def settings(self, texts):
        """All settings of a training that sets these. Raises Failure if a value or combination is not allowed."""
        return self.answer("train", "--print-settings", "--json", *[f"--set={key}={t}" for key, t in texts.items()])

    def wrong_value(self, texts):
        """What is wrong with a single key or value, apart from combinations of them; empty if nothing."""
        try:
            self.settings(texts)
        except Failure as error:
            if str(error).startswith("--set: "):
                return str(error).removeprefix("--set: ")
        return ""

    def check(self, texts):
        """Raises Failure with the place of a wrong setting of a file."""
        for key in texts if self.wrong_value(texts) else ():
            if problem := self.wrong_value({key: texts[key]}):
                raise Failure(DATA, f"{key.place}: {problem}")

    def image_width(self, data, settings):
        options = [f"--set={key}={setting_text(settings[key])}" for key in READING]
        for split in self.answer("info", str(data), "--json", *options)["splits"].values():
            if split["sizes"]:
                return split["sizes"][0][0]
        raise Failure(DATA, f"{data}: has no views")


def setting_text(value):
    if isinstance(value, list):
        return ",".join(map(setting_text, value))
    return value if isinstance(value, str) else json.dumps(value).removesuffix(".0")


def settings_file(settings):
    return "".join(f"{key}: {json.dumps(value)}\n" for key, value in settings.items())


# Files of experiments and data sets


class Text(str):
    """A key or value of a YAML file, as it is written there, with its place: file:line:column."""

    place = ""


# What a text must match, and how a message says so.
ANY = ("(?s:.+)", "must not be empty")
NAME = ("[A-Za-z0-9_-]{1,64}", "must be of letters, digits, _ and - (it names folders)")
WIDTH = ("[1-9][0-9]{0,4}", "is not allowed: expected a width in pixels")
COLUMN = ("|".join(METRICS), f"must be one of {', '.join(METRICS)}")
NUMBER = (r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,2})?", "must be a number or null")
SETTING = ("(?s:.*)", "")
SETTINGS = {ANY: SETTING}
DATA_SET = {"name!": NAME, "title": ANY, "folders": [ANY], "width": WIDTH, "settings": SETTINGS,
            "dataset!": {"source!": ANY, "licence!": ANY, "layout!": ANY, "split!": ANY, "resolution!": ANY,
                         "background!": ANY, "notes": ANY},
            "scenes!": {NAME: {"title": ANY, "folders": [ANY], "width": WIDTH, "settings": SETTINGS}}}
EXPERIMENT = {"name!": NAME, "title": ANY, "notes": ANY, "settings": SETTINGS,
              "published": {"source!": ANY, "columns!": [COLUMN]},
              "data!": [{"set!": ANY, "scenes": [ANY], "settings": SETTINGS}],
              "rows!": [{"name!": NAME, "label": ANY, "settings": SETTINGS, "published": {ANY: {ANY: [NUMBER]}}}]}


def read_yaml(path, schema):
    """Reads a file strictly; every error names the place. A schema is a mapping of keys to schemas, with "!" after
    required keys, or of a pattern that all keys match; or a list of one schema; or a pattern."""
    def fail(mark, message):
        raise Failure(DATA, f"{path}:{mark.line + 1}:{mark.column + 1}: {message}" if mark else f"{path}: {message}")

    def text(node, pattern, what):
        if not isinstance(node, yaml.ScalarNode):
            fail(node.start_mark, f"{what} must be plain text")
        if not re.fullmatch(pattern[0], node.value) or re.search("[\0\ud800-\udfff]", node.value):
            fail(node.start_mark, f"{what} '{node.value}' {pattern[1] or 'is not text'}")
        found = Text(node.value)
        found.place = f"{path}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"
        return found

    def mapping(node, schema, what):
        if not isinstance(node, yaml.MappingNode):
            fail(node.start_mark, f"{what} must be a mapping of keys to values")
        found, pattern = {}, next((key for key in schema if isinstance(key, tuple)), ANY)
        known = [key.removesuffix("!") for key in schema if isinstance(key, str)]
        for key_node, value in node.value:
            key = text(key_node, pattern, "the name")
            part = schema.get(key) or schema.get(key + "!") or schema.get(pattern)
            if key in found:
                fail(key_node.start_mark, f"key '{key}' appears twice")
            if part is None:
                near = difflib.get_close_matches(key, known, 1)
                fail(key_node.start_mark, f"unknown key '{key}' in {what}; "
                     + (f"did you mean '{near[0]}'?" if near else f"there are: {', '.join(known)}"))
            found[key] = convert(value, part, key)
        for key in schema:
            if key[-1] == "!" and key[:-1] not in found:
                fail(node.start_mark, f"{what} needs the key '{key[:-1]}'")
        return found

    def convert(node, schema, what):
        null = node.tag == "tag:yaml.org,2002:null"
        if isinstance(schema, dict):
            optional = not any(key[-1] == "!" for key in schema)
            return {} if null and optional else mapping(node, schema, what)
        if isinstance(schema, list):
            if not isinstance(node, yaml.SequenceNode) or not node.value:
                fail(node.start_mark, f"{what} must be a list with at least one entry")
            return [convert(item, schema[0], f"an entry of {what}") for item in node.value]
        if schema is SETTING and isinstance(node, yaml.SequenceNode):
            return ",".join(text(item, SETTING, what) for item in node.value)
        if null and schema is not NUMBER:
            fail(node.start_mark, f"{what} must not be empty")
        return None if null else text(node, schema, what)

    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
        if root is None:
            fail(None, "the file is empty")
        return mapping(root, schema, "the file")
    except OSError as error:
        raise Failure(DATA, f"{path}: {(error.strerror or str(error)).lower()}")
    except yaml.YAMLError as error:
        fail(getattr(error, "problem_mark", None), f"malformed YAML: {getattr(error, 'problem', None) or error}")
    except (UnicodeDecodeError, RecursionError) as error:
        fail(None, f"malformed YAML: {error}")


def load_set(path, ubs):
    found = {"folders": [], "width": None, "settings": {}, **read_yaml(path, DATA_SET)}
    found.setdefault("title", found["name"])
    found["folders"] = list(dict.fromkeys([found["name"], *found["folders"]]))
    ubs.check(found["settings"])
    for key, scene in found["scenes"].items():
        scene = found["scenes"][key] = {"title": key, "folders": [], "width": found["width"], "settings": {}, **scene}
        scene["folders"] = list(dict.fromkeys([key, *scene["folders"]]))
        ubs.check(scene["settings"])
    if not found["scenes"]:
        raise Failure(DATA, f"{path}: there are no scenes")
    return found


def load_experiment(path, ubs):
    """An experiment, with its data sets by name in "sets" and published values of rows by "set/scene" and metric."""
    def fail(key, message):
        raise Failure(DATA, f"{key.place}: {message}")

    spec = {"settings": {}, "notes": "", "published": {"source": "", "columns": []}, "sets": {},
            **read_yaml(path, EXPERIMENT)}
    spec.setdefault("title", spec["name"])
    ubs.check(spec["settings"])
    for entry in spec["data"]:
        found = load_set(path.parent / entry["set"], ubs)
        if found["name"] in spec["sets"]:
            fail(entry["set"], f"there are two entries for data set '{found['name']}'")
        for key in (wanted := entry.get("scenes", list(found["scenes"]))):
            if key not in found["scenes"]:
                fail(key, f"data set '{found['name']}' has no scene '{key}'")
        found["scenes"] = {key: scene for key, scene in found["scenes"].items() if key in wanted}
        found["settings_here"] = entry.get("settings", {})
        ubs.check(found["settings_here"])
        spec["sets"][found["name"]] = found
    columns = spec["published"]["columns"]
    if len(set(columns)) < len(columns):
        fail(columns[0], f"a column appears twice: {', '.join(columns)}")
    for row in spec["rows"]:
        row.setdefault("label", row["name"])
        ubs.check(row.setdefault("settings", {}))
        if [other["name"] for other in spec["rows"]].count(row["name"]) > 1:
            fail(row["name"], f"there are two rows '{row['name']}'")
        by_set, row["published"] = row.get("published", {}), {}
        for data, scene, values in [(data, *item) for data, scenes in by_set.items() for item in scenes.items()]:
            if data not in spec["sets"]:
                fail(data, f"'{data}' is no data set of this experiment")
            if scene != AVERAGE and scene not in spec["sets"][data]["scenes"]:
                fail(scene, f"'{scene}' is no scene of '{data}' in this experiment")
            if len(values) != len(columns):
                fail(scene, f"'{scene}' needs one value, or null, for each of the columns of 'published' "
                     f"({', '.join(columns) or 'which is missing'})")
            row["published"][f"{data}/{scene}"] = {key: float(value) for key, value in sorted(zip(columns, values))
                                                   if value is not None}
    return spec


# From an experiment to a list of runs


@dataclass
class Job:
    row: dict
    set: dict
    scene: str
    data: pathlib.Path | None = None  # None: not found
    looked_for: str = ""
    problem: str = ""  # why it cannot run: settings that do not fit, unusable data
    code: int = 0  # the exit code of that
    width: int | None = None  # of the images as they are used
    published: dict = field(default_factory=dict)  # settings
    settings: dict = field(default_factory=dict)

    @property
    def place(self):
        return f"{self.set['name']}/{self.scene}"

    @property
    def id(self):
        return f"{self.row['name']}/{self.place}"

    @property
    def published_width(self):
        text = self.set["scenes"][self.scene]["width"]
        return text and int(text)

    @property
    def runnable(self):
        return self.data is not None and not self.problem

    def deciding(self):
        return {key: value for key, value in self.settings.items() if key not in WITHOUT_EFFECT}

    def changes(self):
        """Settings that are not the published ones."""
        return [f"{key} {setting_text(self.published[key])} -> {setting_text(value)}"
                for key, value in self.deciding().items() if value != self.published[key]]


def resolve_scene(scene, option, known):
    """"set/scene" for what the user wrote, which may be the name of the scene alone if only one data set has it."""
    found = [place for place in known if scene in (place, place.split("/")[1])]
    if len(found) > 1:
        raise Failure(USAGE, f"{option}: scene '{scene}' is in several data sets: write one of {', '.join(found)}")
    if not found:
        raise Failure(USAGE, f"{option}: the experiment has no scene '{scene}'; there are: {', '.join(known)}")
    return found[0]


def find_data(job, root, unique, given):
    """ROOT/SET/SCENE, then ROOT/SCENE if the name is unique; or a packed file of that name with the suffix .ubsd."""
    sets, scenes = job.set["folders"], job.set["scenes"][job.scene]["folders"]
    places = [root / folder / scene for folder in sets for scene in scenes]
    places += [root / scene for scene in scenes] if unique else []
    places = [place for path in places for place in (path, pathlib.Path(f"{path}.ubsd"))]
    job.looked_for = f"{root}/{'[' if unique else ''}{'|'.join(sets)}/{']' if unique else ''}{'|'.join(scenes)}"
    if given:
        places, job.looked_for = [root / given], str(root / given)
    job.data = next((place for place in places if place.exists()), None)


def scaled_down(job, k, ubs):
    """Images / K, iterations / K, and splats / K^2, so that the splats per pixel stay. Images that are smaller than
    published already are reduced by less, and never enlarged."""
    def divided(key, divisor):
        return max(1, math.floor(job.published[key] / divisor + 0.5))

    scaled = {"cap_max": divided("cap_max", k * k), "iterations": divided("iterations", k)}
    if job.published["init_points"] != "auto":
        scaled["init_points"] = divided("init_points", k * k)
    if job.data:
        factor = job.published["downscale"] * k
        if job.published_width:
            full = ubs.image_width(job.data, {**job.published, "downscale": 1})
            factor = math.floor(full * k / job.published_width + 0.5)
        scaled["downscale"] = min(max(factor, 1), 64)
    return scaled


def prepare(job, spec, options, named, ubs):
    """Fills in the settings and the image width of a job, or why it cannot run."""
    texts = {**job.set["settings"], **job.set["scenes"][job.scene]["settings"], **spec["settings"],
             **job.set["settings_here"], **job.row["settings"]}
    try:
        job.published = ubs.settings(texts)
        scaled = scaled_down(job, options.scale_down, ubs) if options.scale_down > 1 else {}
        job.settings = ubs.settings({**texts, **scaled, **options.set})
        if job.data and not named and not job.settings["allow_outside"] and not is_inside(job.data, options.root):
            raise Failure(DATA, f"{job.data}: is {os.path.realpath(job.data)}, outside of the data folder "
                          f"{options.root}; --set allow_outside=true reads it all the same")
        job.width = ubs.image_width(job.data, job.settings) if job.data else None
    except Failure as error:
        job.problem, job.code = str(error), error.code


def make_plan(spec, options, ubs):
    """In the order of the file: rows, then data sets, then scenes."""
    names = [row["name"] for row in spec["rows"]]
    for row in options.rows or ():
        if row not in names:
            raise Failure(USAGE, f"--rows: the experiment has no row '{row}'; there are: {', '.join(names)}")
    if not options.root.is_dir():
        raise Failure(DATA, f"{options.root}: no such folder; --root names the one that holds the data sets")
    if problem := ubs.wrong_value(options.set):
        raise Failure(USAGE, f"--set: {problem}")
    known = [f"{data}/{scene}" for data, found in spec["sets"].items() for scene in found["scenes"]]
    wanted = [resolve_scene(scene, "--scenes", known) for scene in options.scenes or known]
    folders = {resolve_scene(scene, "--scene-folder", known): path for scene, path in options.scene_folder.items()}
    jobs = [Job(row, data, scene) for row in spec["rows"] if not options.rows or row["name"] in options.rows
            for data in spec["sets"].values() for scene in data["scenes"]]
    jobs = [job for job in jobs if job.place in wanted]
    for job in jobs:
        unique = sum(place.endswith("/" + job.scene) for place in known) == 1
        find_data(job, options.root, unique, folders.get(job.place))
        prepare(job, spec, options, job.place in folders, ubs)
    return jobs


# Running


@dataclass
class Result:
    state: str = "not run"  # or done, no data, failed, interrupted
    reason: str = ""  # of states other than done, or what a measurement lacks
    values: dict = field(default_factory=dict)  # by metric
    record: dict = field(default_factory=dict)  # job.json
    lacks: dict = field(default_factory=dict)  # by metric: why a finished run was not measured for it
    code: int = 0  # of a failed run

    def text(self):
        if self.state != "done":
            return f"{self.state}: {self.reason}"
        return ", ".join(f"{heading} {self.values[key]:.{decimals}f}" for key, (heading, _, decimals, _)
                         in METRICS.items() if key in self.values)


def read_metrics(folder):
    """The measurements of a finished run. Raises Failure if it did not finish, or was measured before its end."""
    path = folder / "metrics.json"
    files = {"metrics": read_json(path)}
    files["eval"] = read_json(folder / "eval.json") if (folder / "eval.json").exists() else {}

    def at(*keys):
        found = files
        for key in keys:
            found = found.get(key) if isinstance(found, dict) else None
        return float(found) if isinstance(found, (int, float)) and math.isfinite(found) else None

    last, tested = at("metrics", "iterations"), at("metrics", "test", "iteration")
    if last is None or last != at("metrics", "settings", "iterations") or files["metrics"].get("interrupted", True):
        raise Failure(DATA, f"{path}: the run was interrupted, or did not reach its last iteration")
    if files["metrics"].get("test") and tested != last:
        raise Failure(DATA, f"{path}: the measurement is not that of the last iteration")
    model = folder / "model.ply"
    values = {key: at("metrics", "test", "mean", key) for key in ("psnr", "psnr_joint", "ssim")}
    lpips, peak = at("metrics", "test", "mean", "lpips_vgg_unit"), at("metrics", "peak_device_bytes")
    values |= {"lpips": at("eval", "mean", "lpips_vgg_unit") if lpips is None else lpips,
               "fps": at("eval", "frames", "fps_wall"), "minutes": (at("metrics", "seconds") or 0) / 60,
               "splats": at("metrics", "splats"), "iterations": last,
               "peak_device_mib": None if peak is None else peak / 2**20,
               "mib": model.stat().st_size / 2**20 if model.exists() else None}
    return dict(sorted((key, value) for key, value in values.items() if value is not None))


class Runner:
    """Runs the jobs one after another. The results of a job are in a folder of OUT/runs. job.json is written when all
    of them are there, and removed before any of them is replaced: a folder that has it is complete."""

    def __init__(self, options, jobs, out, ubs):
        self.options, self.jobs, self.out, self.ubs = options, jobs, out, ubs
        self.weights, self.why_no_lpips = None, ""
        self.locks = []  # which children hold too
        self.resume = options.resume or options.emit_tasks or bool(options.task)
        self.device = ["--device", options.device] if options.device else []

    def folder(self, job):
        return self.out / "runs" / job.id.replace("/", ".")

    def identity(self, job):
        """What decides the result, on one device and build."""
        return {"data": os.path.realpath(job.data), "arguments": self.options.train_argument,
                "settings": job.deciding()}

    def key(self, job):
        """As far as it can be known without reading images, and on a machine without the device."""
        device = self.options.device or os.environ.get("UBS_DEVICE", "")
        return hash_of({"identity": self.identity(job), "build": self.ubs.build, "device": device})

    def known_before(self, job):
        """The result of a job that cannot run, or of its complete earlier run; and why that one must be repeated."""
        folder = self.folder(job)
        if job.data is None:
            return Result("no data", f"looked for {job.looked_for}"), ""
        if job.problem:
            return Result("failed", job.problem, code=job.code), ""
        if not self.resume or not (folder / "job.yaml").exists():
            return Result(), ""
        if not (folder / "job.json").exists():
            return Result(), "; an earlier run did not end"
        try:
            result = Result("done", "", read_metrics(folder), read_json(folder / "job.json"))
        except Failure as error:
            return Result(), f"; {error}"
        if result.record.get("identity") != self.identity(job):
            return Result(), "; settings or data changed"
        if (self.options.task or self.options.emit_tasks) and result.record.get("key") != self.key(job):
            return Result(), "; another build or device"
        return result, ""

    def run_logged(self, arguments, log):
        """Runs ubs with its output in `log`; returns the exit code and the output."""
        command = [self.ubs.path, *arguments]
        write(log, f"$ {shlex.join(command)}\n")
        with open(log, "a") as file:
            child = start(command, pass_fds=[lock.fileno() for lock in self.locks], stdout=file, stderr=file)
        code = child.wait()
        interrupt.child = None
        return code, log.read_text(errors="replace")

    def train(self, job, resume):
        folder, identity, begun = self.folder(job), self.identity(job), utc_date()
        lock(folder).close()  # its training may still run although the driver that started it was killed
        settings = f"# run {hash_of(identity)}\n{settings_file(job.settings)}"
        spec, log = folder / "job.yaml", folder / "train.log"
        goes_on = resume and (folder / "checkpoint.ubs").exists() and spec.exists() and spec.read_text() == settings
        if goes_on:
            arguments = ["--resume", str(folder)]
        else:
            for file in ("job.json", "eval.json", "measure.log"):
                (folder / file).unlink(missing_ok=True)
            write(spec, settings)
            arguments = ["--out", str(folder), "--spec", str(spec), "--overwrite"]
        arguments = ["train", "--data", str(job.data), *arguments, *self.device, *self.options.train_argument]
        code, output = self.run_logged(arguments, log)
        if code == INTERRUPTED or interrupt.requested and -code in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            # A request after the last step leaves a complete run.
            if not (folder / "metrics.json").exists() or (folder / "checkpoint.ubs").exists():
                return Result("interrupted", f"what it had is in {folder}")
        elif code != 0:
            reason = reason_of(code, output, f"; see {log}")
            # A damaged checkpoint, or one of another version, device or data, cannot be continued. After other errors,
            # such as a full disk, it can.
            if goes_on and ("/checkpoint.ubs: " in reason or "the run was started" in reason):
                return self.train(job, False)
            return Result("failed", reason, code=code if code > 0 else INTERNAL)
        result, metrics = Result("done", "", read_metrics(folder)), read_json(folder / "metrics.json")
        if "psnr" not in result.values:
            result.reason = "the data have no test views with images: not measured"
        result.record = {"hash": hash_of(identity), "identity": identity}
        result.record |= {key: metrics[key] for key in ("version", "build", "device", "data_report") if key in metrics}
        result.record |= {"commit": self.ubs.commit, "command": shlex.join(sys.orig_argv), "host": socket.gethostname(),
                          "begun": begun, "ended": utc_date(), "key": self.key(job)}
        write(folder / "job.json", to_json(result.record))
        return result

    def evaluate(self, job, folder, lpips):
        """Measures the frame rate, and LPIPS if wanted, with `ubs eval`; returns why that failed."""
        log = folder / "measure.log"
        arguments = ["eval", "--model", str(folder / "model.ply"), "--data", str(job.data), "--out",
                     str(folder / "eval.json"), "--spec", str(folder / "config.yaml"), "--fps-views",
                     str(self.options.fps_views), "--overwrite", *self.device]
        if lpips:
            arguments += ["--lpips", "vgg", "--lpips-range", "unit", "--lpips-weights", str(self.weights)]
        code, output = self.run_logged(arguments, log)
        if code != 0 and interrupt.requested:
            return "interrupted; --resume measures it"
        return reason_of(code, output, f"; see {log}") if code != 0 else ""

    def measure(self, job, result):
        """Adds what training does not measure. If that fails, the run stays without it."""
        if "psnr" not in result.values:  # no test images
            return
        folder, why = self.folder(job), {"fps": "not asked for (--fps-views 0)", "lpips": self.why_no_lpips}
        wanted = [key for key, asked in (("fps", self.options.fps_views), ("lpips", self.weights))
                  if asked and key not in result.values]
        if wanted:
            why |= dict.fromkeys(wanted, self.evaluate(job, folder, "lpips" in wanted))
            if len(wanted) == 2 and why["fps"] and not interrupt.requested:  # images or a device too small for LPIPS
                why["fps"] = self.evaluate(job, folder, False)
            result.values = read_metrics(folder)
        result.lacks = {key: reason for key, reason in why.items() if key not in result.values}

    def run(self, on_progress):
        """The results of the jobs, in their order. A run that fails is a result like others."""
        def say(job, text):
            if not self.options.quiet:
                remark(f"[{self.jobs.index(job) + 1}/{len(self.jobs)}] {job.id}: {text}")

        before = [self.known_before(job) for job in self.jobs]
        results = [result for result, _ in before]
        for job, result in zip(self.jobs, results):
            if result.state != "not run":
                say(job, ("kept: " if result.state == "done" else "") + result.text())
        for i, (job, (result, why_not)) in enumerate(zip(self.jobs, before)):
            kept, known = result.state == "done", len(result.values)
            if interrupt.requested or result.state not in ("done", "not run"):
                continue
            try:
                if not kept:
                    say(job, f"training on {job.data}, log {self.folder(job) / 'train.log'}" + why_not)
                    results[i] = result = self.train(job, self.resume)
                if result.state == "done":
                    self.measure(job, result)
            except (Failure, OSError) as error:
                results[i] = result = Result("failed", str(error), code=getattr(error, "code", DATA))
            if not kept or len(result.values) > known:
                say(job, result.text())
            on_progress(results)
            if result.state == "interrupted":
                break
        return results


# Tables. A cell is our value and the published one; either may be None.


@dataclass
class Line:
    row: dict
    set: dict
    scene: str
    title: str
    state: str
    cells: dict  # by metric
    lacks: dict = field(default_factory=dict)
    present: int = 0  # of means: the number of scenes that were measured


def difference(cell):
    return None if None in cell else cell[0] - cell[1]


def mean_line(lines):
    """Both values of a cell are means over the same scenes, those with both values, so that a missing scene does not
    shift the difference; without any published value the mean is over all measured scenes."""
    cells = {}
    for key in METRICS:
        measured = [line.cells[key] for line in lines if line.cells.get(key, (None,))[0] is not None]
        both = [cell for cell in measured if cell[1] is not None]
        if both:
            cells[key] = tuple(sum(values) / len(both) for values in zip(*both))
        elif measured:
            cells[key] = sum(ours for ours, _ in measured) / len(measured), None
    present = sum(line.state == "done" for line in lines)
    return Line(lines[0].row, lines[0].set, AVERAGE, "mean", "done", cells, present=present)


def compare(spec, jobs, results):
    """Lines by data set, then row, then scene; after the scenes of a row their mean."""
    found = []
    for data in spec["sets"].values():
        for row in spec["rows"]:
            lines = []
            for job, result in zip(jobs, results):
                if job.set is data and job.row is row:
                    published = row["published"].get(job.place, {})
                    cells = {key: (result.values.get(key), published.get(key)) for key in METRICS
                             if key in result.values or key in published}
                    title = data["scenes"][job.scene]["title"]
                    lines.append(Line(row, data, job.scene, title, result.state, cells, result.lacks))
            found += lines
            if lines and len(data["scenes"]) > 1:
                found.append(mean_line(lines))
    return found


def table_cell(text):
    return text.replace("|", "/").replace("\n", " ")


def table_line(label, title, cells, columns):
    def shown(value, decimals, sign=""):
        return "–" if value is None else f"{value:{sign}.{decimals}f}"

    words = [table_cell(label), table_cell(title)]
    for key, (_, _, decimals, quality) in columns.items():
        cell = cells.get(key, (None, None))
        words += [shown(value, decimals) for value in cell]
        words += [shown(difference(cell), decimals, "+")] if quality else []
    return f"| {' | '.join(words)} |\n"


def set_table(data, lines):
    """The table of one data set, followed by what its finished runs lack."""
    columns = {key: metric for key, metric in METRICS.items() if any(key in line.cells for line in lines)}
    heads = ["method", "scene"]
    for heading, _, _, quality in columns.values():
        heads += [heading, "paper", "difference"] if quality else [heading, "paper"]
    text = f"\n## {table_cell(data['title'])}\n\n| {' | '.join(heads)} |\n{'|---' * len(heads)}|\n"
    for line in lines:
        mean, label = line.scene == AVERAGE, line.row["label"]
        title = f"mean of {line.present} of {len(data['scenes'])}" if mean else line.title
        text += table_line(label, title + (f" ({line.state})" if line.state != "done" else ""), line.cells, columns)
        printed = line.row["published"].get(f"{data['name']}/{AVERAGE}") if mean else None
        if printed:
            text += table_line(label, f"average as printed, {len(data['scenes'])} scenes",
                               {key: (None, value) for key, value in printed.items()}, columns)
    gaps = ""
    for key, (heading, *_) in columns.items():
        for reason in sorted({line.lacks[key] for line in lines if key in line.lacks}):
            runs = [f"{line.row['name']}/{line.scene}" for line in lines if line.lacks.get(key) == reason]
            gaps += f"- {heading} not measured of {', '.join(runs)}: {table_cell(reason)}\n"
    return text + (f"\n{gaps}" if gaps else "")


def differences(jobs, results):
    """The runs that are in the table, grouped by what is not as published."""
    groups = {}
    for job, result in zip(jobs, results):
        changes = job.changes() if result.state == "done" else []
        if result.state == "done" and None not in (job.width, job.published_width) and job.width != job.published_width:
            changes.insert(0, f"images {job.width} px wide (published: about {job.published_width})")
        if changes:
            groups.setdefault(", ".join(changes), []).append(job.id)
    if not groups:
        return "\nAll runs have the published settings and image sizes.\n"
    return ("\n**Not the published settings or image sizes**, so a difference to the paper is expected:\n\n"
            + "".join(f"- {', '.join(ids)}: {table_cell(change)}\n" for change, ids in sorted(groups.items())))


def markdown(spec, jobs, results, lines, occasion):
    scale, source = occasion["scale_down"], spec["published"]["source"]
    text = f"# {spec['title']}\n\n{occasion['date'][:10]}" + (f", scaled down by {scale}" if scale > 1 else "")
    text += ". Values of the model after the last iteration. Difference: ours minus paper.\n"
    text += f"Published values: {source}\n" if source else ""
    text += f"\n{spec['notes']}\n" if spec["notes"] else ""
    text += differences(jobs, results)
    for data in spec["sets"].values():
        if own := [line for line in lines if line.set is data]:
            text += set_table(data, own)
    missing = "".join(f"- {job.id}: {result.state}" + (f": {table_cell(result.reason)}" if result.reason else "") + "\n"
                      for job, result in zip(jobs, results) if result.state != "done" or result.reason)
    text += f"\n## Not in the table\n\n{missing}" if missing else ""
    text += "\n## Metrics and settings\n\n"
    text += "".join(f"- {heading}: {definition}\n" for key, (heading, definition, _, _) in METRICS.items()
                    if any(key in line.cells for line in lines))
    origins = set()
    for record in (result.record for result in results if result.state == "done"):
        device = record.get("device", {})
        origins.add(f"- {device.get('name', 'unknown device')} ({device.get('platform', '?')}); ubs "
                    f"{record.get('version', '?')}, build {record.get('build', '?')}, "
                    f"commit {record.get('commit', 'unknown')}\n")
    text += f"\nMeasured with:\n\n{''.join(sorted(origins))}" if origins else ""
    return text + (f"\n    {occasion['command']}\n\nAll settings of every run: `table.json`, and `config.yaml` in its "
                   "folder.\n")


def csv(lines):
    """One line per value; means have the scene "average". Names are words without commas and quotes."""
    text = "row,dataset,scene,state,metric,ours,published,difference\n"
    for line in lines:
        head = f"{line.row['name']},{line.set['name']},{line.scene},{line.state}"
        for key, cell in sorted(line.cells.items()):
            values = ["" if value is None else f"{value:.10g}" for value in (*cell, difference(cell))]
            text += f"{head},{key},{','.join(values)}\n"
        text += "" if line.cells else f"{head},,,,\n"
    return text


def table_json(spec, jobs, results, lines, occasion):
    runs = [{"id": job.id, "state": result.state, "reason": result.reason, "lacks": result.lacks,
             "data": str(job.data or ""), "image_width": job.width, "ours": result.values,
             "published": job.row["published"].get(job.place, {}), "not_as_published": job.changes(),
             "settings": job.settings, "record": result.record or None} for job, result in zip(jobs, results)]
    means = [{"row": line.row["name"], "dataset": line.set["name"], "scenes_present": line.present,
              "scenes_planned": len(line.set["scenes"]),
              "metrics": {key: {"ours": cell[0], "published": cell[1], "difference": difference(cell)}
                          for key, cell in sorted(line.cells.items())}} for line in lines if line.scene == AVERAGE]
    averages = {f"{line.row['name']}/{line.set['name']}": line.row["published"][f"{line.set['name']}/{AVERAGE}"]
                for line in lines if f"{line.set['name']}/{AVERAGE}" in line.row["published"]}
    return {"experiment": spec["name"], **occasion, "published_source": spec["published"]["source"],
            "metrics": {key: definition for key, (_, definition, _, _) in METRICS.items()}, "runs": runs,
            "means": means, "published_averages": averages}


# The command


def plan_of(job, device, ubs):
    """What `ubs plan` prints for a job, and why it failed."""
    with tempfile.TemporaryDirectory() as folder:
        spec = pathlib.Path(folder) / "job.yaml"
        spec.write_text(settings_file(job.settings))
        code, output, errors = ubs.run("plan", "--data", str(job.data), "--spec", str(spec), "--json", *device)
    last = (errors.split("\n") or [""])[-2:][0]
    return (json.loads(output), "") if code == 0 else (None, reason_of(code, errors, f" after '{last}'"))


def dry_run(options, spec, runner):
    """Prints the runs and the hours that `ubs plan` expects. Runs of the same settings, data set and image size share
    an estimate."""
    plans, entries = {}, []
    for job in runner.jobs:
        if interrupt.requested:
            return INTERRUPTED
        plan, problem = None, job.problem and f"cannot run: {job.problem}"
        if job.data is None:
            problem = f"no data (looked for {job.looked_for})"
        if job.runnable:
            key = json.dumps([job.set["name"], job.width, job.deciding()])
            if key not in plans:
                plans[key] = plan_of(job, runner.device, runner.ubs)
            plan, problem = plans[key]
        hours = plan["seconds"] / 3600 if plan else None
        text = f"time unknown: {problem}" if job.runnable else problem
        if plan:
            s, (first, last) = job.settings, (plan["start"], plan["end"])
            text = (f"{job.data}, {job.width} px wide, N = {s['dim']}, up to {s['cap_max']} splats, {s['iterations']} "
                    f"iterations of {s['batch']} views, {hours:.3f} h ({first['step_ms']:.2f} ms at {first['splats']} "
                    f"splats, {last['step_ms']:.2f} ms at {last['splats']} splats)")
        if not options.json:
            print(f"{job.id}: {text}", flush=True)
        entries.append({"id": job.id, "data": str(job.data or ""), "runnable": job.runnable, "reason": problem,
                        "not_as_published": job.changes(), "start": plan and plan["start"], "end": plan and plan["end"],
                        "hours": hours})
    unknown = sum(entry["runnable"] and entry["hours"] is None for entry in entries)
    if options.json:
        print(to_json({"experiment": spec["name"], "runs": entries}), end="")
    else:
        print(f"\n{sum(entry['runnable'] for entry in entries)} of {len(entries)} runs have data; "
              f"{sum(entry['hours'] or 0 for entry in entries):.3f} hours"
              + (f" and {unknown} runs of unknown length" if unknown else "")
              + " as planned, without loading and evaluation")
    return INTERRUPTED if interrupt.requested else 0


def find_weights(options):
    """The weights of LPIPS, or None and why not. Those that the user names must be there."""
    named = options.lpips_weights or os.environ.get("UBS_LPIPS_WEIGHTS", "")
    path = pathlib.Path(named).absolute()
    file = path / "lpips_vgg.safetensors" if path.is_dir() else path
    if not named:
        return None, "no weights of VGG16 (--lpips-weights or UBS_LPIPS_WEIGHTS)"
    if options.lpips_weights and not file.is_file():
        raise Failure(DATA, f"{file}: no such file")
    return (path, "") if file.is_file() else (None, f"{file}: no such file")


def check_output(options, runner):
    """Nothing of earlier runs is replaced unless the user says so."""
    for job in runner.jobs:
        if job.data and is_inside(runner.out, job.data):
            raise Failure(USAGE, f"{runner.out}: is inside of the data folder {job.data}: choose another --out")
    files = [runner.out / f"table.{suffix}" for suffix in ("md", "csv", "json")]
    files += [runner.folder(job) / file for job in runner.jobs for file in ("job.json", "checkpoint.ubs", "model.ply")]
    found = next((file for file in files if file.exists()), None)
    if found and not options.overwrite and not runner.resume:
        raise Failure(USAGE, f"{found} exists: go on with --resume, replace results with --overwrite, or choose "
                      "another --out")


def execute(options, spec, runner):
    check_output(options, runner)
    runner.weights, runner.why_no_lpips = find_weights(options)
    if not options.task:  # tasks lock the folders of their runs alone
        runner.locks.append(lock(runner.out))

    def save(results):
        ubs, lines = runner.ubs, compare(spec, runner.jobs, results)
        occasion = {"date": utc_date(), "version": ubs.version, "build": ubs.build, "commit": ubs.commit,
                    "command": shlex.join(sys.orig_argv), "scale_down": options.scale_down}
        texts = {"md": markdown(spec, runner.jobs, results, lines, occasion), "csv": csv(lines),
                 "json": to_json(table_json(spec, runner.jobs, results, lines, occasion))}
        for suffix, text in texts.items():
            if not options.task:
                write(runner.out / f"table.{suffix}", text)
        return texts

    results = runner.run(save)
    print(save(results)["json" if options.json else "md"], end="")
    failed = [result for result in results if result.state == "failed"]
    if interrupt.requested or any(result.state in ("interrupted", "not run") for result in results):
        remark("ubs: warning: interrupted; go on with the same command and --resume")
        return INTERRUPTED
    if failed:
        remark(f"ubs: warning: {len(failed)} runs failed, see the table")
    return failed[0].code if failed else 0


def emit_tasks(runner):
    """Prints a JSON line for each run that is not finished: this command with --task instead of --emit-tasks."""
    command = shlex.join(word for word in sys.orig_argv if word != "--emit-tasks")
    runnable = [job for job in runner.jobs if job.runnable]
    left = [job for job in runnable if runner.known_before(job)[0].state != "done"]
    for job in left:
        key = runner.key(job)
        print(json.dumps({"key": key, "id": job.id, "command": f"{command} --task {key}"}))
    if len(left) < len(runnable):
        remark(f"{len(runnable) - len(left)} runs are finished already")
    return 0


def run(options):
    ubs = Ubs(options.ubs)
    spec = load_experiment(options.spec, ubs)
    runner = Runner(options, make_plan(spec, options, ubs), options.out or pathlib.Path("out") / spec["name"], ubs)
    if interrupt.requested:
        return INTERRUPTED
    if options.dry_run:
        return dry_run(options, spec, runner)
    if not any(job.data for job in runner.jobs):
        raise Failure(DATA, f"{options.root}: no data of any of the {len(runner.jobs)} runs; the first was looked for "
                      f"in {runner.jobs[0].looked_for}; see --scene-folder")
    if options.emit_tasks:
        return emit_tasks(runner)
    if options.task:
        runner.jobs = [job for job in runner.jobs if job.runnable and runner.key(job) == options.task]
        if not runner.jobs:
            raise Failure(USAGE, f"--task {options.task}: no run has this key here: other settings, data, build or "
                          "device; use --emit-tasks again")
    return execute(options, spec, runner)


class Parser(argparse.ArgumentParser):
    def error(self, message):
        raise Failure(USAGE, f"{message} (see --help)")


def pair(text):
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form KEY=VALUE")
    return key, value


def integer(low, high):
    def checked(text):
        if not re.fullmatch("[0-9]{1,9}", text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"'{text}' is not an integer {low} to {high}")
        return int(text)
    return checked


def default_ubs():
    built = pathlib.Path(__file__).resolve().parent.parent / "build" / "ubs"
    return str(built) if built.exists() else shutil.which("ubs") or str(built)


def parse(arguments):
    parser = Parser(description="Trains the runs of an experiment and compares the results with published ones "
                    "(docs/experiments.md).", allow_abbrev=False)
    add = parser.add_argument
    add("spec", type=pathlib.Path, help="experiment, such as data_specs/experiments/main_table.yaml")
    add("--root", type=pathlib.Path, required=True, metavar="DIR", help="folder that holds the data sets")
    add("--out", type=pathlib.Path, metavar="DIR", help="output folder: table.md, .csv, .json, runs/ [out/NAME]")
    add("--ubs", metavar="PATH", default=default_ubs(), help="executable [build/ubs of this source tree, or in PATH]")
    add("--scenes", type=lambda text: text.split(","), action="extend", metavar="A,B,...",
        help="only these scenes: lego, or dnerf/lego")
    add("--rows", type=lambda text: text.split(","), action="extend", metavar="A,B,...",
        help="only these rows (methods)")
    add("--scene-folder", type=pair, action="append", default=[], metavar="SCENE=FOLDER",
        help="where a scene is, relative to --root (repeatable)")
    add("--scale-down", type=integer(1, 64), nargs="?", const=4, default=1, metavar="K",
        help="small version: images / K, splats / K^2, iterations / K; K = 4 if none is given")
    add("--set", type=pair, action="append", default=[], metavar="KEY=VALUE",
        help="a setting of all runs, such as iterations=2000 (repeatable)")
    add("--train-argument", action="append", default=[], metavar="ARG",
        help="passed to `ubs train` of every run, as --train-argument=--quiet (repeatable)")
    add("--lpips-weights", metavar="FILE|DIR", help="weights of VGG16 for the column LPIPS: a safetensors file, or a "
        "folder with lpips_vgg.safetensors [UBS_LPIPS_WEIGHTS]")
    add("--fps-views", type=integer(0, 10**6), default=20, metavar="N",
        help="test views rendered for the column FPS, 0: none [20]")
    add("--device", metavar="DEVICE", help="as for `ubs train`")
    add("--quiet", action="store_true", help="no progress")
    add("--json", action="store_true", help="print table.json (with --dry-run the plan) instead of text")
    add("--resume", action="store_true", help="keep complete runs of the same settings, continue the interrupted one")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--dry-run", action="store_true", help="only print the runs and the hours that `ubs plan` "
                      "expects of each, without --train-argument")
    mode.add_argument("--emit-tasks", action="store_true", help="only print a JSON line with a command for each run "
                      "that is not finished, for job arrays")
    mode.add_argument("--task", metavar="KEY", help="of these commands: the run of this key, and no tables")
    mode.add_argument("--overwrite", action="store_true", help="replace results of earlier runs")
    options = parser.parse_args(arguments)
    if options.resume and options.overwrite:
        parser.error("argument --resume: not allowed with argument --overwrite")
    options.set, options.scene_folder = dict(options.set), dict(options.scene_folder)
    return options


def main():
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(encoding="utf-8", errors="surrogateescape")
    interrupt.install()
    try:
        code = run(parse(sys.argv[1:]))
        sys.stdout.flush()
        return code
    except Failure as error:
        code, message = error.code, str(error)
    except OSError as error:
        code, message = DATA, str(error)
    remark("experiment.py: error: " + " ".join(message.split()))
    return INTERRUPTED if interrupt.requested else code


if __name__ == "__main__":
    sys.exit(main())
