# SPDX-License-Identifier: Apache-2.0
"""Defines functions that parse the output of ptxas and nvdisasm, the assembler and the disassembler of the CUDA
toolkit."""

import re

import gate

INSTRUCTION = re.compile(r"^\s+/\*[0-9a-f]{4,}\*/\s+(.*?)\s*;")
LABEL = re.compile(r"^(\.L_x?_?\d+):")


def disassembler(tools):
    found = gate.find(tools, ["nvdisasm"], ["/usr/local/cuda/bin"])
    if not found:
        gate.skip("nvdisasm", "install nvidia-cuda-nvdisasm of PyPI, or run tools/setup.sh gates")
    return found


def resources(log):
    """Returns {kernel: {registers, stack, spill}} from the output of `ptxas -v`."""
    found, name = {}, None
    for line in log.splitlines():
        if match := re.search(r"Compiling entry function '(\w+)'", line):
            name = match[1]
            found[name] = {}
        elif re.search(r"Function properties for (\w+)", line):
            other = re.search(r"Function properties for (\w+)", line)[1]
            name = other if other in found else None
        if name is None:
            continue
        if (match := re.search(r"(\d+) bytes stack frame, (\d+) bytes spill stores", line)) and "stack" not in found[name]:
            found[name].update(stack=int(match[1]), spill=int(match[2]))
        if match := re.search(r"Used (\d+) registers", line):
            found[name]["registers"] = int(match[1])
    return found


def functions(text):
    """Returns {function: lines} from the output of `nvdisasm -c`."""
    found, lines = {}, None
    for line in text.splitlines():
        if match := re.match(r"^\.text\.(\w+):", line):
            lines = found.setdefault(match[1], [])
        elif line.startswith("\t.section"):
            lines = None
        elif lines is not None:
            lines.append(line)
    return found


def loops(lines):
    """Returns all instructions, and for each loop the indices of its first and its last instruction. The last
    instruction of a loop is a branch back to the first one."""
    code, labels, found = [], {}, []
    for line in lines:
        if match := LABEL.match(line):
            labels[match[1]] = len(code)
        elif match := INSTRUCTION.match(line):
            target = re.search(r"\bBRA\b.*`\((\.L\w+)\)", match[1])
            # The branch to itself at the end of a function is not a loop.
            if target and target[1] in labels and labels[target[1]] < len(code):
                found.append((labels[target[1]], len(code)))
            code.append(match[1])
    return code, found


def counts(lines):
    """Returns the number of instructions, and the numbers of narrow and wide accesses to global memory. If a kernel
    blends splats, also returns the length of its longest visit loop. A visit loop is a loop that contains an
    exponential, but no other loop with an exponential."""
    code, all_loops = loops(lines)
    reach = [match[0] for i in code if (match := re.search(r"\b(?:LDG|STG|LD|ST)\.E[.\w]*", i))]
    wide = sum(bool(re.search(r"\.(64|128)$|\.(64|128)\.", i)) for i in reach)
    figures = {"instructions": len(code), "narrow": len(reach) - wide, "wide": wide}
    visits = [(a, b) for a, b in all_loops if any("MUFU.EX2" in i for i in code[a:b + 1])]
    inner = [(a, b) for a, b in visits if not any((c, d) != (a, b) and a <= c and d <= b for c, d in visits)]
    if inner:
        figures["visit"] = max(b - a + 1 for a, b in inner)
    return figures


def arithmetic_of(code, end, register, begin):
    """Returns the sorted opcodes of those additions, multiplications and special functions between `begin` and `end` on
    which the value of `register` at `end` depends."""
    wanted, opcodes = {register}, []
    for line in reversed(code[begin:end]):
        words = re.match(r"(@!?U?P\d+ )?\s*([A-Z][\w.]*)\s+(.*)", line)
        operands = [match[0] for match in re.finditer(r"\bR\d+\b|\b[U]?PT\b|\bP\d\b|[^,]+", words[3])] if words else []
        registers = re.findall(r"\bR\d+\b", words[3]) if words else []
        if not registers or not operands or operands[0].strip() not in wanted:
            continue
        if not words[1]:  # an instruction with a predicate may leave the earlier value in the register
            wanted.discard(registers[0])
        wanted.update(registers[1:])
        opcode = words[2].split(".")[0] if not words[2].startswith("MUFU") else words[2]
        if opcode in ("FADD", "FMUL", "FFMA") or opcode.startswith("MUFU"):
            opcodes.append(opcode)
    return tuple(sorted(opcodes))


def transmittances(lines):
    """Returns a set with the results of arithmetic_of() for the transmittances after a splat, in all loops of a kernel.
    A transmittance is recognised by its comparison with 1e-4."""
    code, all_loops = loops(lines)
    found = set()
    for at, line in enumerate(code):
        match = re.search(r"FSETP\.GT\S* P\d, PT, (R\d+), 9\.99999974\d*e-05", line)
        around = [(a, b) for a, b in all_loops if a <= at <= b]
        if match and around:
            found.add(arithmetic_of(code, at, match[1], max(around)[0]))
    return found
