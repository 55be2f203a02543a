# SPDX-License-Identifier: Apache-2.0
"""Defines the functions that find tools, read programs, and compare figures with their bounds. All gates that run
offline compilers use them (tests/gates/README.md).

A gate prints a table. Its exit code is 0 if all figures are within their bounds, 1 if a figure exceeds its bound or a
command fails, and 77 (skipped) if a tool is missing. By default, a gate checks one program of each kind with N = 6.
With UBS_GATES=all, it checks every program with N = 3, 6, 7.
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from bounds import BOUNDS

SKIPPED = 77
ALL = os.environ.get("UBS_GATES") == "all"
KERNELS = pathlib.Path(__file__).resolve().parents[2] / "kernels"


def skip(what, how):
    print(f"SKIPPED: {what} is missing; {how}")
    sys.exit(SKIPPED)


def find(tools, names, folders=()):
    """Returns the path of the first of the programs `names` that is found in the folder `tools`, in `folders` or in
    PATH. Returns None if none of them is found."""
    for name in names:
        for folder in [tools / "venv" / "bin", tools / "root" / "usr" / "bin", *map(pathlib.Path, folders)]:
            if (folder / name).exists():
                return str(folder / name)
        for inside in sorted((tools / "venv").glob(f"lib/python*/site-packages/nvidia/*/bin/{name}")):
            return str(inside)
        if shutil.which(name):
            return shutil.which(name)
    return None


def run(command, **more):
    """Runs a command and returns its standard output and standard error. If the command fails, ends the gate."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)
    if done.returncode != 0:
        print(" ".join(map(str, command)))
        print(done.stdout)
        print(f"FAILED: the command above ended with exit code {done.returncode}")
        sys.exit(1)
    return done.stdout


class Program:
    def __init__(self, path):
        self.path, self.name = path, path.stem
        lines = path.with_suffix(".options").read_text().splitlines()
        self.options, self.kernels = lines[0].split(), lines[1:]
        self.kind = re.sub(r"_\d+$", "", self.name)

    def options_with(self, **values):
        """Returns the options of the program with other values of macros, such as UBS_N and UBS_SUBGROUPS. Ignores
        macros that the options do not define."""
        options = self.options
        for name, value in values.items():
            options = [f"-D{name}={value}" if o.startswith(f"-D{name}=") else o for o in options]
        return options


def programs(folder):
    """Returns the programs that gate_scene has written, which are those that the host passes to a driver. By default,
    returns only one program of each kind: the one with the most kernels."""
    found = [Program(path) for path in sorted(folder.glob("*.cl"))]
    if not found:
        print(f"FAILED: {folder} contains no programs: run gate_scene (test gate_programs) first")
        sys.exit(1)
    if ALL:
        return found
    best = {}
    for program in found:
        if program.kind not in best or len(program.kernels) > len(best[program.kind].kernels):
            best[program.kind] = program
    return list(best.values())


def dims(program):
    """Returns the values of UBS_N with which a program is compiled, or [None] if it does not use UBS_N."""
    has = any(o.startswith("-DUBS_N=") for o in program.options)
    return ([3, 6, 7] if ALL else [6]) if has else [None]


class Table:
    """Prints the figures of kernels with their bounds, and collects those that exceed their bounds. Spills, scratch
    memory and the stack must be 0 if they have no bound. This rule does not apply to kernels with N other than 6."""

    MUST_BE_ZERO = ("scratch", "stack", "spill")

    def __init__(self, target):
        self.target, self.bounds, self.seen, self.bad = target, BOUNDS[target], set(), []
        print(f"\n{target}: figures, with their upper bounds in brackets (tests/gates/bounds.py)")

    def add(self, kernel, figures, n=None):
        name = kernel if n in (None, 6) else f"{kernel}, N = {n}"
        bounds = self.bounds.get(name, {})
        self.seen.add(name)
        cells = []
        for what, value in figures.items():
            most = bounds.get(what, 0 if what in self.MUST_BE_ZERO and n in (None, 6) else None)
            cells.append(f"{what} {value}" + ("" if most is None else f" ({most})"))
            if most is not None and value > most:
                self.bad.append(f"{self.target}, {name}: {what} is {value}, but at most {most} is allowed")
        print(f"  {name:<28}" + ", ".join(cells))

    def verdict(self):
        """Returns whether all figures are within their bounds and no kernel with bounds is missing. Prints errors."""
        missing = [k for k in self.bounds if k not in self.seen and (ALL or ", N = " not in k)]
        self.bad += [f"{self.target}: bounds.py contains '{k}', but this kernel was not compiled" for k in missing]
        for line in self.bad:
            print("FAILED:", line)
        return not self.bad


def arguments(description):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--tools", type=pathlib.Path, required=True, help="folder of the tools (tools/setup.sh)")
    parser.add_argument("--programs", type=pathlib.Path, help="folder to which gate_scene writes the programs")
    return parser.parse_args()


def scratch_folder():
    return tempfile.TemporaryDirectory(prefix="ubs_gate_")


def finish(tables):
    good = [table.verdict() for table in tables]
    sys.exit(0 if all(good) else 1)
