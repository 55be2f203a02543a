# SPDX-License-Identifier: Apache-2.0
"""Runs the examples of docs/python.md, docs/gsplat.md and docs/library.md as they are printed."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


def examples(document: str, language: str) -> list[str]:
    text = (ROOT / "docs" / document).read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


@pytest.fixture
def place(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scene").symlink_to(folder)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("package", ["torch", "jax"])
def test_examples_of_python(place: Path, package: str) -> None:
    """Runs the examples that need only NumPy, and then those of the package, which use their variables."""
    pytest.importorskip(package, reason=f"SKIPPED: {package} is not installed")
    names: dict[str, Any] = {}
    ran = []
    for text in examples("python.md", "python"):
        wants = [other for other in ("torch", "jax") if f"ubs.{other}" in text] or ["numpy"]
        if not {*wants} <= {"numpy", package}:
            continue
        exec(compile(text, "docs/python.md", "exec"), names)
        ran += wants
    assert ran == ["numpy", "numpy"] + (["torch"] * 3 if package == "torch" else ["jax"])
    assert (place / "model.ply").stat().st_size > 10000


def test_example_of_gsplat(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="SKIPPED: PyTorch is not installed")
    (text,) = examples("gsplat.md", "python")
    names: dict[str, Any] = {}
    exec(compile(text, "docs/gsplat.md", "exec"), names)
    assert "step 0: loss" in capsys.readouterr().out
    assert len(names["params"]["means"]) != names["count"] and float(names["loss"].detach()) < 0.1


def test_examples_of_c(place: Path) -> None:
    library = Path(os.environ["UBS_LIBRARY"])
    include, statements = examples("library.md", "cpp")[0].split("\n", 1)
    Path("main.cpp").write_text(f"{include}\nint main() {{\n{statements}return picture.rgb.empty();\n}}\n")
    options = [f"-I{ROOT / 'include'}", "-Wall", "-Werror"]
    linked = [str(library), f"-Wl,-rpath,{library.parent}", "-o", "main"]
    subprocess.run(["c++", "-std=c++20", *options, "main.cpp", *linked], check=True)
    subprocess.run(["./main"], check=True)
    assert (place / "model.ply").stat().st_size > 10000
    function = "void f(ubs_device* device, ubs_model* model)"
    Path("main.c").write_text(
        f"#include <stdio.h>\n#include <ubs/ubs.h>\n{function};\n{function} {{\n{examples('library.md', 'c')[0]}}}\n"
    )
    subprocess.run(["cc", "-std=c99", *options, "-fsyntax-only", "main.c"], check=True)


def test_tests_of_statements_exist() -> None:
    """Tests that the functions exist that docs/python.md names as tests of its statements."""
    table = (ROOT / "docs" / "python.md").read_text().partition("## Tests")[2]
    named = re.findall(r"`(test_\w+)`", table)
    sources = "".join(path.read_text() for path in (ROOT / "python" / "tests").glob("test_*.py"))
    assert len(named) > 50 and not [name for name in named if f"def {name}(" not in sources]
