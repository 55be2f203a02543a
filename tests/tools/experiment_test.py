#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests tools/experiment.py and its modules. Usage: experiment_test.py UBS [NAME ...], where UBS is the path of ubs,
and NAMEs select tests. Most tests use a script in place of `ubs`. The last tests really train a small scene."""
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tools" / "experiment.py"
UBS = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else str(ROOT / "build" / "ubs")
sys.dont_write_bytecode = True
os.environ.pop("UBS_LPIPS_WEIGHTS", None)
sys.path.insert(0, str(SCRIPT.parent))
import experiment
import experiment_files

SET = """name: toys
dataset:
  source: nowhere
  licence: none
  layout: blender
  split: s
  resolution: r
  background: black
width: 80
settings: {cap_max: 1000, init_points: 800, iterations: 400, downscale: 2}
scenes:
  cube:
  sphere: {title: the sphere, folders: [ball, kugel], settings: {cap_max: 2000}}
"""
# This stand-in for `ubs` takes the settings from the real executable. "train --data D --out O ..." (or --resume O)
# records its start in a file, and then behaves as the file D/behaviour states. "eval --model M --data D --out E ..."
# also records its start, and fails if the file D/broken exists. Images are 80 pixels wide.
STAND_IN = """#!/bin/sh
here=$(dirname "$0")
if [ "$2" = --print-settings ]; then exec %s "$@"; fi
if [ "$1" = info ]; then echo '{"splits": {"train": {"sizes": [[80, 60]]}}}'; exit 0; fi
if [ "$1" = eval ]; then
  echo "$*" >> "$here/evals"
  if [ -e "$5/broken" ]; then echo "ubs: error: no device" >&2; exit 4; fi
  lpips=; case "$*" in *lpips*) lpips=', "lpips_vgg_unit": 0.125' ;; esac
  echo "{\\"frames\\": {\\"fps_wall\\": 250}, \\"mean\\": {\\"psnr\\": 1$lpips}}" > "$7"
  exit 0
fi
data=$3; out=$5
if [ "$1" = plan ]; then
  if [ $(cat "$data/behaviour") = fail ]; then echo "ubs: error: boom" >&2; exit 6; fi
  echo '{"seconds": 7200}'
  exit 0
fi
echo "$*" >> "$here/starts"
case $(cat "$data/behaviour") in
  busy) echo "ubs: error: $out: process 1 is writing to this folder" >&2; exit 2 ;;
  full) echo "ubs: error: log.csv: No space left on device; ubs train --resume $5" >&2; exit 3 ;;
  fail) echo "ubs: error: boom" >&2; exit 6 ;;
  crash) kill -SEGV $$ ;;
  wait)
    trap 'exit 130' TERM
    echo state > "$out/checkpoint.ubs"
    while [ -e "$out/checkpoint.ubs" ]; do sleep 0.05; done ;;
esac
seconds=120; case $data in *sphere) seconds=240 ;; esac
rm -f "$out/checkpoint.ubs"
echo splats > "$out/model.ply"
cat > "$out/metrics.json" <<END
{"version": "9", "build": "b", "interrupted": false, "ended_early": null, "seconds": $seconds, "splats": 900,
 "device": {"name": "paper", "platform": "desk"}, "test": {"mean": {"psnr": $(cat "$data/psnr"), "ssim": 0.5}}}
END
"""


def put(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def wait_for(condition, seconds=300):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition was not met in time"
        time.sleep(0.02)


class Case(unittest.TestCase):
    def setUp(self):
        self.maxDiff = None
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(os.path.realpath(temporary.name))
        self.ubs = UBS
        put(self.folder / "set.yaml", SET)
        put(self.folder / "e.yaml", "name: e\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n")

    def stand_in(self):
        put(self.folder / "ubs", STAND_IN % shlex.quote(UBS))
        (self.folder / "ubs").chmod(0o755)
        self.ubs = str(self.folder / "ubs")

    def command(self, *arguments):
        return [sys.executable, str(SCRIPT), "e.yaml", "--root", "root", "--ubs", self.ubs, *arguments]

    def run_script(self, *arguments, code=0):
        result = subprocess.run(self.command(*arguments), cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        return result

    def refused(self, code, *arguments):
        """Runs the script, which must fail with this exit code, and returns its error message, which is one line."""
        result = self.run_script(*arguments, code=code)
        found = re.fullmatch(r"(?:usage: (?:.*\n)+?)?(experiment\.py: error: .+\n)", result.stderr)
        self.assertTrue(found, result.stderr)
        return found[1]

    def lines(self, name):
        path = self.folder / name
        return path.read_text().splitlines() if path.exists() else []

    def plan(self, *arguments, spec="e.yaml"):
        """Returns a dictionary from the names of the runs to the runs."""
        options = experiment.parse([str(self.folder / spec), "--root", str(self.folder / "root"), "--ubs", self.ubs,
                                    "--out", "out", *arguments])
        return {run.id: run for run in experiment.make_plan(experiment_files.load_experiment(options.spec), options)}


class DataSpecs(Case):
    """Tests the files in data_specs."""

    def load(self, name):
        path = ROOT / "data_specs" / "experiments" / f"{name}.yaml"
        (self.folder / "root").mkdir(exist_ok=True)
        return experiment_files.load_experiment(path), self.plan(spec=path)

    def test_every_file_loads_and_plans(self):
        sets = sorted((ROOT / "data_specs" / "sets").glob("*.yaml"))
        for path in sets:
            self.assertEqual(experiment_files.read_yaml(path, experiment_files.DATA_SET)["name"], path.stem)
        page = (ROOT / "docs" / "experiments.md").read_text()
        published, of_paper, paths = 0, 0, sorted((ROOT / "data_specs" / "experiments").glob("*.yaml"))
        for path in paths:
            spec, runs = self.load(path.stem)
            self.assertEqual(spec["name"], path.stem)
            self.assertIn(f"`{path.name}` ({len(runs)})", page)
            self.assertEqual({run.state for run in runs.values()}, {"no data"})
            published += sum(len(row["published"]) for row in spec["rows"])
            if spec["published"]["source"]:
                of_paper += 1
                self.assertIn("ICLR 2026", spec["published"]["source"])
                self.assertEqual({run.settings["iterations"] for run in runs.values()}, {30000})
                self.assertTrue(all(run.paper for run in runs.values()))
        self.assertEqual((len(sets), len(paths), of_paper), (10, 9, 5))
        # The sum has one term for each experiment with published values. The first has values of 38 scenes and 5
        # averages. The other terms are 3 x (8 + 1), 6 x 4, 6 and 6 + 1.
        self.assertEqual(published, 43 + 27 + 24 + 6 + 7)

    def test_printed_averages_are_those_of_the_printed_scenes(self):
        # This detects typing errors in the averages and in the values of the scenes. The printed numbers have two or
        # three decimals, so a printed average may differ from the computed one by about one unit of the last decimal.
        # The largest difference is 0.0117 dB (7DGS-PBR). Printed times, FPS, counts and sizes are not compared, because
        # the paper does not average them consistently.
        averages = 0
        for name in ("main_table", "capacity", "n3v"):
            spec = experiment_files.load_experiment(ROOT / "data_specs" / "experiments" / f"{name}.yaml")
            for row in spec["rows"]:
                for found in spec["sets"]:
                    data = found["name"]
                    for metric, allowed in (("psnr", 0.02), ("ssim", 0.0011), ("lpips", 0.0011)):
                        if metric in row["published"][f"{data}/average"]:
                            values = [row["published"][f"{data}/{scene}"][metric] for scene in found["scenes"]]
                            mean = row["published"][f"{data}/average"][metric]
                            self.assertAlmostEqual(mean, sum(values) / len(values), delta=allowed)
                            averages += 1
        self.assertEqual(averages, 5 * 3 + 3 * 2 + 1)

    def test_settings_of_the_paper_arrive_in_the_runs(self):
        runs = {(name, key): run.settings for name in ("main_table", "ablations", "rotations", "capacity")
                for key, run in self.load(name)[1].items()}
        expected = {("main_table", "ubs/mip360/bicycle"):
                    {"cap_max": 6_000_000, "downscale": 4, "principal_point": "centre"},
                    ("main_table", "ubs/dnerf/mutant"): {"dim": 7, "cap_max": 300_000, "batch": 4},
                    ("ablations", "skew_nd/dnerf/lego"): {"batch": 1, "cov_param": "skew_nd"},
                    ("rotations", "quaternion/mip360/bicycle"): {"dim": 3},
                    ("capacity", "200k/nerf_synthetic/ship"): {"cap_max": 200_000}}
        for key, settings in expected.items():
            self.assertEqual({name: runs[key][name] for name in settings}, settings)


class BadFiles(Case):
    """Tests that errors in a file are reported with their position."""

    HEAD = "name: e\npublished: {source: s, columns: [psnr, ssim]}\ndata: [{set: set.yaml}]\n"

    def message(self, text):
        put(self.folder / "bad.yaml", text)
        (self.folder / "root").mkdir(exist_ok=True)
        try:
            self.plan(spec="bad.yaml")
            return ""
        except experiment_files.Failure as error:
            self.assertEqual(error.code, 3)
            return str(error)

    def test_experiments(self):
        def published(text):
            return self.message(f"{self.HEAD}rows:\n  - name: a\n    published: {{{text}}}\n")

        self.assertEqual(self.message(self.HEAD + "rows: [{name: a}]\n"), "")
        self.assertEqual(published("toys: {cube: [30, null], average: [30, 0.9]}"), "")
        for text, part in (
                (self.HEAD + "rows: [{name: a}]\nrow: 3\n", "bad.yaml: unknown key 'row': expected name, title"),
                (self.HEAD + "rows: [{name: a}, {name: b, lable: c}]\n", "bad.yaml: rows[1]: unknown key 'lable'"),
                (self.HEAD + "rows:\n  - name: a\n    settings: {cap_mux: 3}\n",
                 "bad.yaml: a/toys/cube: settings: unknown key 'cap_mux'; did you mean 'cap_max'?"),
                (self.HEAD + "rows:\n  - name: a\n    settings: {dim: 3, cap_max: many}\n",
                 "bad.yaml: a/toys/cube: settings: cap_max = 'many' is not allowed: expected "),
                (self.HEAD + "rows:\n  - name: a\n    settings: {dim: {a: 3}}\n", "settings: dim = "),
                (self.HEAD + "rows: [{name: a}, {name: a}]\n", "bad.yaml: two rows have the same name: a, a"),
                (self.HEAD + "rows: [{name: ../a}]\n", "bad.yaml: rows[0]: name: '../a' is not allowed: expected [A-Z"),
                (self.HEAD + "rows: []\n", "bad.yaml: rows: must be a list with at least one entry"),
                (self.HEAD + "rows: [{name: a, name: b}]\n", 'a key appears twice in the mapping in "'),
                (self.HEAD + "rows: [{name: a}]\nnotes: [a, b]\n", "notes: ['a', 'b'] is not allowed: expected text"),
                (self.HEAD + "rows: [{name: a}]\ntitle:\n", "title: '' is not allowed: expected text"),
                (self.HEAD + "rows: [{name: a, settings: 3}]\n", "rows[0]: settings: must be a mapping"),
                ("name: e\npublished: {source: s, columns: [speed]}\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n",
                 "bad.yaml: published: columns[0]: 'speed' is not allowed: expected psnr|ssim"),
                ("name: e\npublished: {source: s, columns: [psnr, psnr]}\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n",
                 "bad.yaml: two columns have the same name: psnr, psnr"),
                ("name: e\ndata: [{set: set.yaml, scenes: [cone]}]\nrows: [{name: a}]\n",
                 "bad.yaml: data set 'toys' has no scene 'cone'"),
                ("name: e\ndata: [{set: set.yaml}, {set: set.yaml}]\nrows: [{name: a}]\n",
                 "bad.yaml: two data sets have the same name: toys, toys"),
                ("name: e\nrows: [{name: a}]\n", "bad.yaml: the key 'data' is missing or empty"),
                ("name: e\ndata: [{set: set.yaml}]\nrows: [{name: a, published: {toys: {cube: [1]}}}]\n",
                 "bad.yaml: row 'a': published: toys: cube: needs 0 values"),
                ("", "bad.yaml: the key 'name' is missing"), ("- a\n", "bad.yaml: must be a mapping"),
                ("a: {\n", 'bad.yaml", line 2, column 1'), ("[" * 5000, "malformed YAML"),
                ("a: \x01\n", "malformed YAML"), ("? [a]\n: b\n", "malformed YAML"),
                (self.HEAD + 'rows: [{name: a}]\ntitle: "\\ud800"\n', "title: '\\ud800' is not allowed")):
            with self.subTest(part):
                self.assertIn(part, " ".join(self.message(text).split()))
        where = "bad.yaml: row 'a': published: "
        self.assertIn(where + "toys: cube: needs 2 values", published("toys: {cube: [30]}"))
        self.assertIn("rows[0]: published: toys: cube[1]: 'nan' is not allowed", published("toys: {cube: [30, nan]}"))
        self.assertIn(where + "toys: cone: is not a scene", published("toys: {cone: [30, 1]}"))
        self.assertIn(where + "tools: average: is not a scene", published("tools: {average: [30, 1]}"))

    def test_data_sets(self):
        def message(old, new):
            put(self.folder / "set.yaml", SET.replace(old, new))
            return self.message(self.HEAD + "rows: [{name: a}]\n")

        self.assertEqual(message("nowhere", "somewhere"), "")
        self.assertIn("set.yaml: unknown key 'folder'", message("width: 80", "folder: x"))
        about = SET[SET.index("dataset"):SET.index("width")]
        self.assertIn("set.yaml: the key 'dataset' is missing", message(about, ""))
        self.assertIn("set.yaml: width: 'wide' is not allowed", message("width: 80", "width: wide"))
        self.assertIn("set.yaml: scenes: sphere: folders: must be a list", message("[ball, kugel]", "ball"))
        self.assertIn("settings: unknown key 'cap_mux'; did you mean", message("{cap_max: 2000}", "{cap_mux: 2000}"))
        self.assertIn("the key 'scenes' is missing or empty", message(SET[SET.index("scenes:"):], "scenes:\n"))

    def test_nothing_in_a_file_leads_out_of_the_output_folder(self):
        spec = "name: e\ndata: [{set: set.yaml}]\nrows: [{name: r}]\n"
        for name in ("../x", "/x", "..", "'a\\b'", '"a\\tb"', "a/../../b", "a" * 300, "''", '"a\\0"', '"\\ud800"'):
            for key in ("name: e", "name: r"):
                self.assertIn("expected [A-Za-z0-9_-]", self.message(spec.replace(key, f"name: {name}")))
            for key, new in (("name: toys", f"name: {name}"), ("cube:", f"? {name}\n  :")):
                put(self.folder / "set.yaml", SET.replace(key, new))
                self.assertIn("expected [A-Za-z0-9_-]", self.message(spec))
            put(self.folder / "set.yaml", SET)

    def test_a_bad_file_or_option_ends_the_command_with_one_line(self):
        (self.folder / "root").mkdir()
        put(self.folder / "e.yaml", "nmae: e\n")
        self.assertIn("e.yaml: unknown key 'nmae'", self.refused(3))
        put(self.folder / "e.yaml", "name: e\ndata: [{set: none.yaml}]\nrows: [{name: a}]\n")
        self.assertIn("none.yaml: No such file", self.refused(3))
        (self.folder / "e.yaml").unlink()
        self.assertIn("e.yaml: No such file", self.refused(3))
        put(self.folder / "e.yaml", "name: e\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n")
        self.assertIn("pass --ubs", self.refused(2, "--ubs", "/bin/true"))
        self.assertIn("pass --ubs", self.refused(2, "--ubs", "no/such/file"))
        self.assertIn("--fast", self.refused(2, "--fast"))
        self.assertIn("--scale-down", self.refused(2, "--scale-down", "0"))
        self.assertIn("none: no such file", self.refused(3, "--root", "none"))
        self.assertIn("no data of any of the 2 runs; a/toys/cube: there is neither root/toys/cube nor", self.refused(3))
        self.assertIn("w: no such file", self.refused(3, "--lpips-weights", "w"))
        self.assertIn("--set: unknown key 'bach'", self.refused(2, "--set", "bach=1"))
        self.assertIn("--set: 'seed' is not of the form key=value", self.refused(2, "--set", "seed"))
        self.assertIn("--rows: unknown name 'c'; there are: a", self.refused(2, "--rows", "c"))
        self.assertIn("--scenes: unknown name 'spere'; there are: cube, sphere, toys/cube, toys/sphere",
                      self.refused(2, "--scenes", "toys/cube,spere"))
        self.assertIn("--task: unknown name 'a/toys/cone'", self.refused(2, "--task", "a/toys/cone"))
        self.assertIn("not allowed with", self.refused(2, "--emit-tasks", "--dry-run"))


class Plan(Case):
    def test_folders_are_found_and_overrides_follow_their_order(self):
        put(self.folder / "other.yaml", SET.replace("toys", "cars"))
        put(self.folder / "e.yaml",
            "name: e\nsettings: {batch: 2, seed: 7}\ndata:\n  - {set: set.yaml, settings: {batch: 3}}\n"
            "  - {set: other.yaml, scenes: [cube]}\nrows:\n  - name: a\n  - {name: b, settings: {batch: 4, dim: 3}}\n")
        for folder in ("toys/cube", "kugel", "cube"):
            put(self.folder / "root" / folder / "x", "")
        runs = self.plan()
        self.assertEqual(list(runs), [f"{row}/{place}" for row in "ab" for place in
                                      ("toys/cube", "toys/sphere", "cars/cube")])
        self.assertEqual(runs["a/toys/cube"].data, self.folder / "root/toys/cube")
        # The name of this folder is in the list `folders` of the scene, and the folder is directly below the root.
        self.assertEqual(runs["a/toys/sphere"].data, self.folder / "root/kugel")
        self.assertIsNone(runs["a/cars/cube"].data)  # root/cube may belong to either data set
        self.assertIn("root/cars/cube", runs["a/cars/cube"].reason)
        self.assertEqual([run.settings["batch"] for run in runs.values()], [3, 3, 2, 4, 4, 4])
        self.assertEqual({run.settings["seed"] for run in runs.values()}, {7})
        self.assertEqual(runs["a/toys/cube"].settings["cap_max"], 1000)
        self.assertEqual(runs["a/toys/sphere"].settings["cap_max"], 2000)

        put(self.folder / "root/cars/x", "")
        (self.folder / "root/cars/cube").symlink_to("../kugel")
        runs = self.plan("--set", "batch=9", "--rows", "b")
        self.assertEqual(runs["b/cars/cube"].identity["data"], str(self.folder / "root/kugel"))
        self.assertEqual(runs["b/cars/cube"].changes, ["batch 4 -> 9"])
        self.assertEqual(len(runs), 3)
        self.assertEqual(len(self.plan("--scenes", "sphere")), 2)
        self.assertEqual(len(self.plan("--scenes", "sphere", "--scenes", "toys/cube", "--rows", "a,b")), 4)
        self.assertEqual(list(self.plan("--scenes", "cube", "--rows", "a")), ["a/toys/cube", "a/cars/cube"])
        (self.folder / "root/kugel").rename(self.folder / "root/ball.ubsd")
        self.assertEqual(self.plan()["a/toys/sphere"].data, self.folder / "root/ball.ubsd")

    def test_scaling_down_keeps_the_splats_per_pixel(self):
        put(self.folder / "root/toys/cube/x", "")
        run = self.plan("--scale-down", "--scenes", "cube", "--set", "batch=2")["a/toys/cube"]
        self.assertEqual([run.settings[key] for key in ("downscale", "cap_max", "init_points", "iterations", "batch")],
                         [8, 62, 50, 100, 2])
        self.assertIn("iterations 400 -> 100", run.changes)
        run = self.plan("--scale-down", "2", "--set", "downscale=1", "--scenes", "sphere")["a/toys/sphere"]
        self.assertEqual([run.settings[key] for key in ("downscale", "cap_max", "iterations")], [1, 500, 200])


class Run(Case):
    """Tests with a stand-in for training."""

    def setUp(self):
        super().setUp()
        self.stand_in()
        put(self.folder / "e.yaml",
            "name: e\ntitle: An experiment\npublished: {source: a book, columns: [psnr, minutes]}\n"
            "data: [{set: set.yaml}]\nrows:\n  - name: a\n    label: Method A\n    published:\n"
            "      toys: {cube: [30.5, 1], sphere: [20, null], average: [25.25, null]}\n")
        self.scene("cube", "train", 31)
        self.scene("sphere", "train", 20.25)

    def scene(self, name, behaviour, psnr=1):
        put(self.folder / "root/toys" / name / "behaviour", behaviour)
        put(self.folder / "root/toys" / name / "psnr", str(psnr))

    def results(self, name):
        return self.folder / "out/e/runs" / f"a.toys.{name}"

    def table(self, *arguments, code=0):
        """Runs the script and returns a dictionary from the names of the scenes to the lines of table.json."""
        self.run_script(*arguments, code=code)
        return {line["scene"]: line for line in json.loads((self.folder / "out/e/table.json").read_text())["lines"]}

    def starts(self):
        return len(self.lines("starts"))

    def test_finished_runs_of_the_same_settings_are_kept(self):
        cube = self.table()["cube"]
        self.assertEqual((cube["state"], cube["record"]["device"]["name"]), ("done", "paper"))
        self.assertEqual({key: cube["metrics"][key]["ours"] for key in ("psnr", "fps", "minutes", "splats")},
                         {"psnr": 31, "fps": 250, "minutes": 2, "splats": 900})
        self.assertEqual((self.starts(), len(self.lines("evals"))), (2, 2))
        self.assertIn("out/e: is not empty: continue with --resume", self.refused(2))
        self.assertEqual(self.table("--resume")["sphere"]["metrics"]["psnr"]["ours"], 20.25)
        self.assertEqual((self.starts(), len(self.lines("evals"))), (2, 2))
        again = self.table("--resume", "--set", "iterations=401")
        self.assertEqual(again["cube"]["record"]["identity"]["settings"]["iterations"], 401)
        self.assertEqual(self.starts(), 4)
        self.table("--resume", "--set", "iterations=401", "--set", "log_every=7")  # does not affect results
        self.assertEqual(self.starts(), 4)

    def test_what_a_killed_program_left_is_no_result(self):
        self.table()
        (self.results("sphere") / "job.json").unlink()
        self.assertEqual(self.table("--resume")["sphere"]["state"], "done")
        self.assertEqual(self.starts(), 3)
        metrics = self.results("cube") / "metrics.json"
        whole = metrics.read_text()
        for damaged in (whole[:50], "[]", whole.replace('"interrupted": false', '"interrupted": true'),
                        whole.replace('"ended_early": null', '"ended_early": {"iteration": 300}')):
            self.assertNotEqual(damaged, whole)
            metrics.write_text(damaged)
            before = self.starts()
            self.assertEqual(self.table("--resume")["cube"]["metrics"]["psnr"]["ours"], 31)
            self.assertEqual(self.starts(), before + 1)
        # If there are both a checkpoint and a complete metrics.json, `ubs train` was killed before it had written the
        # renders.
        put(self.results("cube") / "checkpoint.ubs", "state")
        self.table("--resume")
        self.assertIn("--resume ", self.lines("starts")[-1])
        # Files of a failed run with other settings are not used as results.
        self.scene("cube", "fail")
        self.table("--resume", "--set", "iterations=401", code=6)
        self.scene("cube", "train", 32)
        self.assertEqual(self.table("--resume", "--set", "iterations=401")["cube"]["metrics"]["psnr"]["ours"], 32)

    def test_results_of_a_training_that_another_program_started_are_not_taken_for_ours(self):
        self.scene("cube", "busy")
        self.assertIn("process 1 is writing to this folder", self.table(code=2)["cube"]["reason"])
        self.assertFalse((self.results("cube") / "job.json").exists())

    def test_a_file_is_replaced_as_a_whole_or_not_at_all(self):
        path = self.folder / "table.md"
        experiment_files.write(path, "old")
        with unittest.mock.patch("pathlib.Path.replace", side_effect=OSError("disk full")), self.assertRaises(OSError):
            experiment_files.write(path, "new")
        self.assertEqual(path.read_text(), "old")

    def test_lpips_is_also_measured_for_runs_that_finished_without_it(self):
        self.table()
        self.assertNotIn("lpips", self.lines("evals")[0])
        text = (self.folder / "out/e/table.md").read_text()
        self.assertNotIn("LPIPS", text)  # LPIPS is neither measured here nor among the published values
        put(self.folder / "w.safetensors", "")
        put(self.folder / "root/toys/sphere/broken", "")
        runs = self.table("--resume", "--lpips-weights", "w.safetensors")
        self.assertEqual((self.starts(), len(self.lines("evals"))), (2, 4))
        self.assertIn("--lpips vgg --lpips-range unit --lpips-weights w.safetensors", self.lines("evals")[2])
        self.assertEqual((runs["cube"]["metrics"]["lpips"]["ours"], runs["cube"]["reason"]), (0.125, ""))
        self.assertEqual((runs["sphere"]["state"], runs["sphere"]["metrics"]["fps"]["ours"]), ("done", 250))
        text = (self.folder / "out/e/table.md").read_text()
        self.assertIn("- a/toys/sphere: done: FPS, LPIPS or the image size not measured: no device\n", text)
        self.assertIn("| Method A | the sphere | 20.25 | 20.00 | +0.25 | 0.500 | – | 4.0 |", text)

    def test_failing_and_missing_runs_are_reported_and_the_others_go_on(self):
        self.scene("cube", "fail")
        runs = self.table(code=6)
        self.assertEqual((runs["cube"]["state"], runs["cube"]["reason"]), ("failed", "boom"))
        self.assertEqual((runs["sphere"]["state"], runs["sphere"]["reason"]), ("done", ""))
        self.scene("cube", "crash")
        self.assertIn("ended by signal 11; see out/e/runs/a.toys.cube/train.log",
                      self.table("--resume", code=1)["cube"]["reason"])
        shutil.rmtree(self.folder / "root/toys/cube")
        cube = self.table("--resume")["cube"]
        self.assertEqual(cube["state"], "no data")
        self.assertIn("root/toys/cube", cube["reason"])
        self.scene("cube", "train")
        shutil.rmtree(self.results("cube"))
        put(self.results("cube"), "a file where the folder of the run would be")
        runs = self.table("--resume", code=3)
        self.assertEqual((runs["cube"]["state"], runs["sphere"]["state"]), ("failed", "done"))
        self.assertIn("a.toys.cube", runs["cube"]["reason"])

    def test_an_interruption_stops_the_training_cleanly_and_it_can_be_resumed(self):
        # The next run resumes the training from its checkpoint. If the resumed training fails, as with the behaviour
        # `full`, the checkpoint remains.
        for number, following, code in ((signal.SIGINT, "train", 0), (signal.SIGTERM, "full", 3)):
            with self.subTest(following=following):
                shutil.rmtree(self.folder / "out", ignore_errors=True)
                (self.folder / "starts").unlink(missing_ok=True)
                self.scene("cube", "wait")
                checkpoint = self.results("cube") / "checkpoint.ubs"
                process = subprocess.Popen(self.command(), cwd=self.folder, stdout=subprocess.DEVNULL,
                                           stderr=subprocess.PIPE, text=True)
                wait_for(checkpoint.exists)
                process.send_signal(number)
                message = process.communicate(timeout=300)[1]
                self.assertIn("interrupted: continue with the same command and --resume", message)
                self.assertEqual(process.returncode, 130)
                table = json.loads((self.folder / "out/e/table.json").read_text())["lines"]
                self.assertEqual([line["state"] for line in table[:2]], ["interrupted", "not run"])
                self.scene("cube", following, 31)
                self.assertEqual(self.table("--resume", code=code)["cube"]["state"], "failed" if code else "done")
                self.assertIn("--resume ", (self.folder / "starts").read_text())
                self.assertEqual(self.starts(), 3)
                self.assertEqual(checkpoint.exists(), code != 0)
                if code:  # with other settings, the checkpoint is not used
                    self.scene("cube", "train", 31)
                    self.table("--resume", "--set", "iterations=401")
                    self.assertIn("--out ", self.lines("starts")[-2])

    def test_tables_show_differences_and_means_over_the_same_scenes_and_list_missing_results(self):
        table = self.table("--scale-down", "1")
        text, csv = [(self.folder / f"out/e/table.{suffix}").read_text() for suffix in ("md", "csv")]
        means = table["mean"]["metrics"]
        self.assertEqual(means["psnr"], {"ours": 25.625, "published": 25.25, "difference": 0.375})
        # Only the scene cube has both a measured and a published time, so the mean is that of cube.
        self.assertEqual(means["minutes"], {"ours": 2, "published": 1, "difference": 1})
        self.assertEqual(means["ssim"], {"ours": 0.5, "published": None, "difference": None})
        self.assertEqual(table["average"]["metrics"]["psnr"], {"ours": None, "published": 25.25, "difference": None})
        self.assertEqual(table["sphere"]["settings"]["cap_max"], 2000)
        for part in ("# An experiment\n", "Published values: a book\n",
                     "\n## toys\n\n| method | scene | PSNR [dB] | paper | difference | SSIM | training [min] | paper | "
                     "FPS | splats | MiB |\n| --- | --- |",
                     "| Method A | cube | 31.00 | 30.50 | +0.50 | 0.500 | 2.0 | 1.0 | 250.0 | 900 |",
                     "| Method A | mean of 2 of 2 | 25.62 | 25.25 | +0.38 |",
                     "| Method A | average as printed, 2 scenes | – | 25.25 | – |",
                     "\nMeasured with: paper (desk); ubs 9, build b, commit ",
                     "All runs have the published settings",
                     "- PSNR [dB]: mean over the test views"):
            self.assertIn(part, text)
        self.assertNotIn("Not in the table", text)
        self.assertEqual(csv.splitlines()[0], "row,dataset,scene,state,metric,ours,published,difference")
        self.assertIn("a,toys,cube,done,psnr,31,30.5,0.5\n", csv)
        self.assertIn("a,toys,mean,done,minutes,2,1,1\n", csv)
        self.assertIn("a,toys,average,done,psnr,,25.25,\n", csv)

        # If one scene fails, the mean of the other is not compared with the mean of the paper over both.
        self.scene("cube", "fail")
        means = self.table("--resume", "--set", "iterations=200", code=6)["mean"]
        self.assertEqual(means["metrics"]["psnr"], {"ours": 20.25, "published": 20, "difference": 0.25})
        self.assertEqual(means["title"], "mean of 1 of 2")
        text = (self.folder / "out/e/table.md").read_text()
        for part in ("mean of 1 of 2", "| Method A | cube (failed) | – | 30.50 |", "- a/toys/cube: failed: boom"):
            self.assertIn(part, text)

        self.scene("cube", "train", 31)
        text = self.run_script("--resume", "--set", "iterations=200").stdout
        self.assertIn("a difference to the paper is expected", text)
        self.assertIn("- a/toys/cube, a/toys/sphere: iterations 400 -> 200\n", text)
        self.assertEqual(text, (self.folder / "out/e/table.md").read_text())
        put(self.folder / "set.yaml", SET.replace("width: 80", "width: 400"))
        text = self.run_script("--resume").stdout
        self.assertIn("- a/toys/cube, a/toys/sphere: images 80 px wide (published: about 400)\n", text)

    def test_rows_with_a_budget_leave_the_settings_to_ubs(self):
        put(self.folder / "e.yaml", "name: e\ntitle: An experiment\ndata: [{set: set.yaml}]\nrows:\n"
            "  - {name: a, budget: 40}\n  - {name: b, label: Method B, budget: 40, settings: {dim: 3}}\n")
        put(self.folder / "set.yaml", re.sub("(?m)^(width|settings).*\n", "", SET))
        self.assertIn("a/toys/cube: 0.011 h, root/toys/cube\n", self.run_script("--dry-run").stdout)
        self.run_script()
        starts = self.lines("starts")
        self.assertEqual(starts[0].split(" --overwrite ")[1], "--budget 40s")
        self.assertEqual(starts[3].split(" --overwrite ")[1], "--budget 40s --set=cap_max=2000 --set=dim=3")
        text = (self.folder / "out/e/table.md").read_text()
        self.assertIn("\n| scene | a | Method B |\n| --- | --- | --- |\n| cube | 31.00 dB, 120 s | 31.00 dB, 120 s |\n"
                      "| the sphere | 20.25 dB, 240 s | 20.25 dB, 240 s |\n"
                      "| mean | 25.62 dB, 180 s | 25.62 dB, 180 s |\n", text)
        self.assertIn("\n| method | scene | PSNR [dB] | SSIM | training [min] | FPS | splats | MiB |\n", text)
        self.assertIn("| Method B | the sphere | 20.25 | 0.500 | 4.0 |", text)
        self.assertNotIn("paper", text.split("Measured with")[0])
        put(self.folder / "e.yaml", (self.folder / "e.yaml").read_text().replace("40", "50", 1))
        self.run_script("--resume")
        self.assertEqual([line.split()[7] for line in self.lines("starts")[4:]], ["50s", "50s"])

    def test_a_dry_run_prints_what_ubs_plan_expects(self):
        text = self.run_script("--dry-run").stdout
        self.assertIn("a/toys/cube: 2.000 h, root/toys/cube\n", text)
        self.assertIn("\nestimated total: 4.000 hours", text)
        self.scene("sphere", "fail")
        self.assertIn("boom", self.refused(6, "--dry-run"))
        self.assertFalse((self.folder / "out").exists())

    def test_tasks_of_a_job_array(self):
        def tasks(*arguments):
            return [json.loads(line) for line in self.run_script("--emit-tasks", *arguments).stdout.splitlines()]

        def run_task(task):
            result = subprocess.run(task["command"], shell=True, cwd=self.folder, capture_output=True, text=True)
            self.assertEqual(result.returncode, 0, result.stderr)

        before = tasks()
        self.assertEqual([task["id"] for task in before], ["a/toys/cube", "a/toys/sphere"])
        self.assertFalse((self.folder / "out").exists())
        run_task(before[1])
        self.assertTrue((self.results("sphere") / "job.json").exists())
        self.assertFalse((self.folder / "out/e/table.md").exists())
        self.assertEqual([task["id"] for task in tasks()], ["a/toys/cube"])
        self.assertEqual(len(tasks("--set", "iterations=401")), 2)
        run_task(before[1])
        self.assertEqual(self.starts(), 1)  # a finished run is not started again
        run_task(before[0])
        runs = self.table("--resume")
        self.assertEqual([runs["cube"]["state"], runs["sphere"]["state"]], ["done", "done"])
        self.assertEqual(self.starts(), 2)


class Real(Case):
    """Tests that really train."""

    def setUp(self):
        super().setUp()
        put(self.folder / "set.yaml",
            "name: toys\ndataset: {source: synth, licence: Apache-2.0, layout: blender, split: s, resolution: r, "
            "background: black}\nwidth: 64\nsettings: {dim: 3, init_points: 200, cap_max: 250, iterations: 60, "
            "save_renders: 0}\nscenes: {shiny: , dull: }\n")
        put(self.folder / "e.yaml",
            "name: e\npublished: {source: a book, columns: [psnr, lpips, fps]}\ndata: [{set: set.yaml}]\nrows:\n"
            "  - name: short\n    published: {toys: {shiny: [30, 0.1, 200], dull: [31, null, 300]}}\n")
        subprocess.run([UBS, "synth", "glossy", "--size", "32", "--views", "6", "--test-views", "2", "--supersampling",
                        "1", "--out", "root/shiny"], cwd=self.folder, check=True, stdout=subprocess.DEVNULL)

    def test_an_experiment_makes_its_table_and_keeps_what_is_done(self):
        text = self.run_script("--device", "cpu").stdout
        for part in ("- short/toys/dull: no data: there is", "mean of 1 of 2", " | – | 0.100 | – | ",
                     "- short/toys/shiny: images 32 px wide (published: about 64)\n"):
            self.assertIn(part, text)
        run = json.loads((self.folder / "out/e/table.json").read_text())["lines"][0]
        folder = self.folder / "out/e/runs/short.toys.shiny"
        metrics = json.loads((folder / "metrics.json").read_text())
        self.assertEqual(run["metrics"]["psnr"]["ours"], metrics["test"]["mean"]["psnr"])
        self.assertGreater(run["metrics"]["psnr"]["ours"], 10)
        self.assertGreater(run["metrics"]["fps"]["ours"], 1)
        chosen = {key: metrics["settings"][key] for key in metrics["chosen"]}  # these were "auto" in the plan
        unimportant = {key: metrics["settings"][key] for key in experiment.WITHOUT_EFFECT}
        self.assertEqual({**run["settings"], **chosen, **unimportant}, metrics["settings"])
        self.assertEqual(run["record"]["build"], metrics["build"])
        model = folder / "model.ply"
        written = model.stat().st_mtime_ns
        self.run_script("--device", "cpu", "--resume", "--rows", "short", "--scenes", "dull,shiny")
        self.assertEqual(model.stat().st_mtime_ns, written)

    def test_an_interrupted_experiment_goes_on(self):
        (self.folder / "root/dull").symlink_to("shiny")
        arguments = ("--device", "cpu", "--resume")
        folder = self.folder / "out/e/runs/short.toys.shiny"

        def rows():
            return len(self.lines("out/e/runs/short.toys.shiny/log.csv"))

        for number in (signal.SIGTERM, signal.SIGINT):  # the second training resumes the first one
            before = rows()
            process = subprocess.Popen(self.command(*arguments, "--set", "iterations=100000"), cwd=self.folder,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            wait_for(lambda: rows() > before + 3)
            process.send_signal(number)
            self.assertEqual(process.wait(300), 130)
            self.assertTrue((folder / "checkpoint.ubs").exists())
        self.assertIn(" --resume ", self.lines("out/e/runs/short.toys.shiny/train.log")[0])
        self.run_script(*arguments)
        shiny, dull, means = json.loads((self.folder / "out/e/table.json").read_text())["lines"]
        self.assertEqual((shiny["state"], shiny["settings"]["iterations"]), ("done", 60))
        self.assertEqual(dull["metrics"]["psnr"]["ours"], shiny["metrics"]["psnr"]["ours"])  # the same data
        self.assertEqual(means["title"], "mean of 2 of 2")

    def test_a_dry_run_plans_and_changes_nothing(self):
        text = self.run_script("--device", "cpu", "--dry-run", "--set", "iterations=30000").stdout
        self.assertRegex(text, r"short/toys/shiny: 0\.\d+ h, root/shiny\n")
        self.assertIn("short/toys/dull: no data", text)
        self.assertNotIn("\nestimated total: 0.000 hours", text)
        self.assertFalse((self.folder / "out").exists())


class Settings(Case):
    """Tests functions of `ubs` that the script requires."""

    def test_printed_settings_are_a_file_of_settings(self):
        def printed(*arguments):
            return subprocess.run([UBS, "train", "--print-settings", *arguments], cwd=self.folder, check=True,
                                  capture_output=True, text=True).stdout

        text = printed("--set", "cap_max=77", "--background", "1,0.5,0")
        self.assertRegex(text, re.compile("^cap_max: 77  # ", re.MULTILINE))
        put(self.folder / "settings.yaml", text)
        self.assertEqual(printed("--spec", "settings.yaml"), text)
        settings = json.loads(printed("--json", "--spec", "settings.yaml"))
        self.assertEqual((settings["cap_max"], settings["background"]), (77, [1, 0.5, 0]))
        self.assertEqual(printed(*experiment.set_options(settings)), text)


if __name__ == "__main__":
    unittest.main(verbosity=2)
