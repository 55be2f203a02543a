# SPDX-License-Identifier: Apache-2.0
"""Reads the files of tools/experiment.py: YAML files of experiments and data sets (data_specs/README.md), which this
module checks, and the results of runs. Also finds data sets, and defines the errors of the program."""
import json
import re

import yaml

from experiment_tables import AVERAGE, METRICS

UTF8 = {"encoding": "utf-8", "errors": "surrogateescape"}  # paths may have any bytes
INTERNAL, USAGE, DATA, INTERRUPTED = 1, 2, 3, 130  # exit codes, which are those of `ubs` (README.md)


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
    """Returns the object in a file, or an empty one if the file is missing or damaged."""
    try:
        value = json.loads(path.read_text(**UTF8))
    except (OSError, ValueError):
        value = None
    return value if isinstance(value, dict) else {}


def write(path, text):
    """Replaces a file. If this fails, the file has the old content."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, **UTF8)
    temporary.replace(path)


# There are four kinds of schemas. A text is a pattern that a value must match. [A] is a list of items that match the
# schema A. A mapping maps patterns of keys to schemas, with "!" after required keys. ANY allows all values; it is used
# for settings, which `ubs` checks.
ANY = object()
TEXT = r"[^\0\ud800-\udfff]+"
NAME = "[A-Za-z0-9_-]{1,64}"  # names are also names of folders
WIDTH, SECONDS = "[1-9][0-9]{0,4}", "[1-9][0-9]{0,5}"
NUMBER = r"null|[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,2})?"
SCENE = {"title": TEXT, "folders": [TEXT], "width": WIDTH, "settings": {TEXT: ANY}}
DATA_SET = {"name!": NAME, **SCENE, "dataset!": {TEXT: TEXT}, "scenes!": {NAME: SCENE}}
ROW = {"name!": NAME, "label": TEXT, "settings": {TEXT: ANY}, "budget": SECONDS, "published": {NAME: {NAME: [NUMBER]}}}
EXPERIMENT = {"name!": NAME, "title": TEXT, "notes": TEXT, "settings": {TEXT: ANY},
              "published": {"source!": TEXT, "columns!": ["|".join(METRICS)]},
              "data!": [{"set!": TEXT, "scenes": [NAME], "settings": {TEXT: ANY}}], "rows!": [ROW]}


class Loader(yaml.BaseLoader):
    """Reads every value as the text in the file. Rejects keys that appear twice; PyYAML would use the last of them."""

    def construct_mapping(self, node, deep=False):
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            raise yaml.MarkedYAMLError(problem="a key appears twice in the mapping", problem_mark=node.start_mark)
        return mapping


def checked(value, schema, where):
    """Returns the value if it matches the schema, and raises an error with its position `where` otherwise. An empty
    value is an empty mapping."""
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
    parts = {key.removesuffix("!"): part for key, part in schema.items()}
    found = {}
    for key, item in (value or {}).items():
        pattern = next((pattern for pattern in parts if re.fullmatch(pattern, key)), None)
        need(pattern, where, f"unknown key {key!r}: expected {', '.join(parts)}")
        found[key] = checked(item, parts[pattern], f"{where}: {key}")
    for key in parts:
        need(found.get(key) or f"{key}!" not in schema, where, f"the key '{key}' is missing or empty")
    return found


def read_yaml(path, schema):
    """Returns the content of a YAML file that must match the schema."""
    try:
        with open(path, encoding="utf-8") as file:
            return checked(yaml.load(file, Loader), schema, path)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise Failure(DATA, f"{path}: malformed YAML: {error}") from error


def load_data_set(path, entry):
    """Returns the data set of an entry of the experiment in the file `path`, with the scenes that the entry selects."""
    data = read_yaml(path.parent / entry["set"], DATA_SET)
    names = entry.get("scenes", data["scenes"])
    for name in names:
        need(name in data["scenes"], path, f"data set '{data['name']}' has no scene '{name}'")
    return {**data, "scenes": {name: data["scenes"][name] for name in names}, "entry": entry}


def load_experiment(path):
    """Returns the experiment in a file, and its data sets in the additional key "sets". The key "published" of a row
    maps "SET/SCENE" (or "SET/average") to the published values by metric."""
    spec = {"published": {"source": "", "columns": []}, **read_yaml(path, EXPERIMENT)}
    spec["sets"] = [load_data_set(path, entry) for entry in spec["data"]]
    columns = spec["published"]["columns"]
    for what, names in (("data sets", [data["name"] for data in spec["sets"]]), ("columns", columns),
                        ("rows", [row["name"] for row in spec["rows"]])):
        need(len(set(names)) == len(names), path, f"two {what} have the same name: {', '.join(names)}")
    places = {f"{data['name']}/{scene}" for data in spec["sets"] for scene in [*data["scenes"], AVERAGE]}
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


def find_data(run, spec, root):
    """Returns the data of a run: ROOT/SET/SCENE or, if the scene name is unique among the data sets, ROOT/SCENE. The
    data set and the scene may also have one of the names in `folders`. Each may be a packed file. Returns None if
    nothing is found."""
    scenes = [run.scene, *run.about.get("folders", [])]
    folders = [root / name for name in [run.data_set["name"], *run.data_set.get("folders", [])]]
    if sum(run.scene in data["scenes"] for data in spec["sets"]) == 1:
        folders.append(root)
    places = [folder / f"{scene}{ending}" for folder in folders for scene in scenes for ending in ("", ".ubsd")]
    return next((place for place in places if place.exists()), None)


def load_results(run):
    """Reads the results of a run if its training has finished with the same settings and data."""
    job, metrics, evaluation = (read_json(run.folder / name) for name in ("job.json", "metrics.json", "eval.json"))
    if (job.get("identity") != run.identity or (run.folder / "checkpoint.ubs").exists()
            or metrics.get("interrupted", True) or metrics.get("ended_early")):
        return
    test, model = (metrics["test"] or {}).get("mean", {}), run.folder / "model.ply"
    values = {"psnr": test.get("psnr"), "ssim": test.get("ssim"),
              "lpips": evaluation.get("mean", {}).get("lpips_vgg_unit"),
              "minutes": metrics["seconds"] / 60, "fps": evaluation.get("frames", {}).get("fps_wall"),
              "splats": metrics["splats"], "mib": model.stat().st_size / 2**20 if model.exists() else None}
    run.ours = {key: float(value) for key, value in values.items() if value is not None}
    run.record = job | {key: metrics.get(key) for key in ("version", "build", "device", "data_report")}
    run.state = "done"
    run.reason = "" if "psnr" in run.ours else "the data have no test views with images: not measured"
