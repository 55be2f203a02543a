# SPDX-License-Identifier: Apache-2.0
"""Compares the structs, functions and constants in ubs/_abi.py with those of include/ubs/ubs.h."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Any

from ubs import _abi

HEADER = re.sub(r"/\*.*?\*/", "", (Path(__file__).parents[2] / "include/ubs/ubs.h").read_text(), flags=re.DOTALL)
SCALARS: dict[str, Any] = {
    "size_t": ctypes.c_size_t, "char": ctypes.c_char, "float": ctypes.c_float, "double": ctypes.c_double,
    "int": ctypes.c_int, "int32_t": ctypes.c_int32, "uint32_t": ctypes.c_uint32, "unsigned": ctypes.c_uint,
    "int64_t": ctypes.c_int64, "uint64_t": ctypes.c_uint64, "ubs_camera": _abi.Camera,
    **{enumeration: ctypes.c_int for enumeration in re.findall(r"typedef enum (\w+) {", HEADER)},
}


def fields_of(struct: str) -> list[tuple[str, Any]]:
    """Returns the names and types of the members of a struct of the header."""
    body = re.search(rf"typedef struct {struct} {{(.*?)}} {struct};", HEADER, re.DOTALL)
    assert body, struct
    fields = []
    for declaration in body[1].split(";")[:-1]:
        kind, members = re.fullmatch(r"\s*(?:const )?(\w+)(.*)", declaration, re.DOTALL).groups()
        for member in members.split(","):
            pointer, name, count = re.fullmatch(r"\s*(\**)\s*(\w+)(?:\[(\d+)\])?", member).groups()
            scalar = ctypes.c_void_p if pointer else SCALARS[kind]
            fields.append((name, scalar * int(count) if count else scalar))
    return fields


def test_structs_have_the_members_of_the_header() -> None:
    structs = [found for found in vars(_abi).values() if isinstance(found, type) and issubclass(found, _abi.Struct)]
    structs.remove(_abi.Struct)
    names = {re.sub("(?<!^)([A-Z])", r"_\1", struct.__name__).lower(): struct for struct in structs}
    assert {f"ubs_{name}" for name in names} == set(re.findall(r"typedef struct (\w+) {", HEADER))
    for name, struct in names.items():
        expected = fields_of(f"ubs_{name}")
        assert [field for field, _ in struct._fields_] == [field for field, _ in expected], name
        for (field, has), (_, wanted) in zip(struct._fields_, expected):
            text = wanted is ctypes.c_void_p and (has is ctypes.c_char_p or hasattr(has, "contents"))
            assert has is wanted or text, f"{name}.{field}: {has} instead of {wanted}"


def test_functions_have_the_arguments_of_the_header() -> None:
    declared = {name: arguments.split(",") for name, arguments in
                re.findall(r"UBS_API ubs_status ubs_(\w+)\((.*?)\);", HEADER, re.DOTALL)}
    assert len(declared) > 40
    for name, arguments in _abi._FUNCTIONS.items():
        expected = declared[name]
        assert len(arguments) == len(expected), name
        for has, text in zip(arguments, expected):
            kind, pointers = re.fullmatch(r"\s*(?:const )?(\w+)(?: const)?\s*(\**).*", text, re.DOTALL).groups()
            if not pointers and kind in SCALARS:
                assert has is SCALARS[kind], f"{name}: {text}"
            else:
                assert has not in SCALARS.values(), f"{name}: {text}"


def test_numbers_are_those_of_the_header() -> None:
    numbers = {name: int(value) for name, value in re.findall(r"UBS_(\w+) = (\d+)", HEADER)}
    for prefix in ("USE_", "RENDER_"):
        own = {name: value for name, value in vars(_abi).items() if name.startswith(prefix)}
        assert own == {name: value for name, value in numbers.items() if name.startswith(prefix)}
    arrays = {f"ARRAY_{name.upper()}": number for number, name in enumerate(_abi.ARRAYS)}
    assert arrays == {name: value for name, value in numbers.items() if name.startswith("ARRAY_")}
