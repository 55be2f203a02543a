# SPDX-License-Identifier: Apache-2.0
"""Writes and tests the declarations in ubs/_abi.py, which are generated from include/ubs/ubs.h. With the environment
variable UBS_WRITE_LISTS=1, the test writes the declarations; otherwise it compares them."""

from __future__ import annotations

import os
import re
from pathlib import Path

MODULE = Path(__file__).parents[1] / "ubs/_abi.py"
BEGIN = "# The declarations of the header, written by python/tests/test_abi.py\n"
END = "# The end of the declarations\n"
HEADER = re.sub(r"/\*.*?\*/", "", (Path(__file__).parents[2] / "include/ubs/ubs.h").read_text(), flags=re.DOTALL)
HANDLES = re.findall(r"typedef struct ubs_(\w+) ubs_\1;", HEADER)
STRUCTS = re.findall(r"typedef struct ubs_(\w+) {(.*?)}", HEADER, re.DOTALL)
CALLBACKS = re.findall(r"typedef (\w+) \(\*ubs_(\w+)\)\((.*?)\);", HEADER)
FUNCTIONS = re.findall(r"UBS_API ubs_status ubs_(\w+)\((.*?)\);", HEADER, re.DOTALL)
SCALARS = {"size_t": "c_size_t", "char": "c_char", "float": "c_float", "double": "c_double", "int": "c_int",
           "unsigned": "c_uint", **{f"{kind}_t": f"c_{kind}" for kind in ("int32", "uint32", "int64", "uint64")},
           **{enumeration: "c_int" for enumeration in re.findall(r"typedef enum (\w+) {", HEADER)}}


def class_name(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def type_of(kind: str, pointers: int) -> str:
    """Returns the type of ctypes for a type of C. Handles have the name of their kind, which _abi.py replaces by a
    type. Pointers to numbers are arrays, which are passed as addresses, except those to size_t, which are results."""
    name = kind.removeprefix("ubs_")
    if name in HANDLES:
        return f'"{name}"' if pointers == 1 else "POINTER(c_void_p)"
    if name in [struct for struct, _ in STRUCTS] + [callback for _, callback, _ in CALLBACKS]:
        return f"POINTER({class_name(name)})" if pointers else class_name(name)
    if kind == "char" and pointers:
        return "c_char_p" if pointers == 1 else "POINTER(c_char_p)"
    if pointers and kind != "size_t":
        return "c_void_p"
    return f"POINTER({SCALARS[kind]})" if pointers else SCALARS[kind]


def types_of(arguments: str) -> list[str]:
    pattern = r"^\s*(?:const )?(\w+)(?: const)?\s*(\**)"
    found = [re.findall(pattern, text)[0] for text in arguments.split(",")]
    return [type_of(kind, len(pointers)) for kind, pointers in found]


def fields_of(body: str) -> list[tuple[str, str]]:
    """Returns the names and types of the members of a struct."""
    fields = []
    for declaration in body.split(";")[:-1]:
        kind, members = re.findall(r"^\s*(?:const )?(\w+)(.*)", declaration, re.DOTALL)[0]
        for member in members.split(","):
            pointers, name, count = re.findall(r"^\s*(\**)\s*(\w+)(?:\[(\w+)\])?", member)[0]
            fields.append((name, type_of(kind, len(pointers)) + (f" * {count}" if count else "")))
    return fields


def declarations() -> str:
    lines = []
    for struct, body in STRUCTS:
        lines += ["", "", f"class {class_name(struct)}(Struct):", "    _fields_ = ["]
        lines += [f'        ("{name}", {kind}),' for name, kind in fields_of(body)] + ["    ]"]
    lines += ["", ""]
    for result, callback, arguments in CALLBACKS:
        types = [SCALARS.get(result, "None"), *types_of(arguments)]
        lines.append(f"{class_name(callback)} = CFUNCTYPE({', '.join(types)})")
    numbers = re.findall(r"UBS_((?:USE|RENDER)_\w+) = (\d+)", HEADER)
    lines += [f"{name} = {value}" for name, value in numbers]
    lines += ["# The names of a renderer's arrays, in the order of their numbers", "ARRAYS = ("]
    arrays = re.findall(r"UBS_ARRAY_(\w+) = (\d+)", HEADER)
    assert [int(number) for _, number in arrays] == list(range(len(arrays)))
    lines += [f'    "{name.lower()}",' for name, _ in arrays] + [")"]
    lines += ["# The kinds of handles, and the argument types of the functions, which return a status"]
    lines += ["HANDLES = (" + ", ".join(f'"{handle}"' for handle in HANDLES) + ")"]
    lines += ["FUNCTIONS: dict[str, list[Any]] = {"]
    lines += [f'    "{name}": [{", ".join(types_of(arguments))}],' for name, arguments in FUNCTIONS] + ["}"]
    return "\n".join(lines) + "\n"


def test_declarations_are_those_of_the_header() -> None:
    assert len(STRUCTS) > 10 and len(FUNCTIONS) > 40
    before, _, rest = MODULE.read_text().partition(BEGIN)
    declared, _, after = rest.partition(END)
    assert rest and after
    if os.environ.get("UBS_WRITE_LISTS"):
        MODULE.write_text(before + BEGIN + declarations() + END + after)
    else:
        assert declared == declarations(), "repeat this test with UBS_WRITE_LISTS=1 to write the declarations"
