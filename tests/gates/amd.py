# SPDX-License-Identifier: Apache-2.0
"""Checks how many registers and how much scratch memory the OpenCL kernels need on AMD GPUs. The kernels are compiled
by clang for amdgcn with the device libraries of ROCm."""

import re

import gate

FIGURES = {"vgpr": "vgpr_count", "scratch": "private_segment_fixed_size", "spill": "vgpr_spill_count",
           "lds": "group_segment_fixed_size"}
WIDE = re.compile(r"^\s+(?:global|flat|buffer)_(?:load|store)_dwordx[24]\b", re.M)
NARROW = re.compile(r"^\s+(?:global|flat|buffer)_(?:load|store)_(?:dword|[us]?byte|[us]?short)\b", re.M)


def kernels_of(assembly):
    """Returns {kernel: figures}. The figures are those of the metadata, and the numbers of accesses to global memory in
    the code."""
    found = {}
    for part in assembly.split("\n  - .")[1:]:  # an entry of amdhsa.kernels
        name = re.search(r"^\s+\.name:\s+(\w+)$", part, re.M)
        if name and ".vgpr_count" in part:
            found[name[1]] = {k: int(re.search(rf"\.{v}:\s+(\d+)", part)[1]) for k, v in FIGURES.items()}
    for name, figures in found.items():
        code = assembly[assembly.index(f"\n{name}:"):]
        code = code[:code.index("s_endpgm\n.Lfunc_end") if "s_endpgm\n.Lfunc_end" in code else code.index(".Lfunc_end")]
        figures["narrow"], figures["wide"] = len(NARROW.findall(code)), len(WIDE.findall(code))
    return found


def main():
    args = gate.arguments(__doc__)
    clang = gate.find(args.tools, ["clang-15", "clang"])
    libraries = next((f for f in [args.tools / "root/usr/lib/x86_64-linux-gnu/amdgcn/bitcode",
                                  gate.pathlib.Path("/usr/lib/x86_64-linux-gnu/amdgcn/bitcode")]
                      if (f / "ocml.bc").exists()), None)
    if not clang:
        gate.skip("clang", "install clang-15")
    if not libraries:
        gate.skip("ocml.bc of ROCm's device libraries", "install rocm-device-libs, or run tools/setup.sh gates")
    tables = []
    with gate.scratch_folder() as scratch:
        for card in ("gfx1030", "gfx90a"):
            table = gate.Table(card)
            for program in gate.programs(args.programs):
                for n in gate.dims(program):
                    out = f"{scratch}/{program.name}.s"
                    gate.run([clang, "-x", "cl", "-target", "amdgcn-amd-amdhsa", f"-mcpu={card}", "-O3",
                              f"--rocm-device-lib-path={libraries}", "-Xclang", "-finclude-default-header",
                              *program.options_with(UBS_SUBGROUPS=3, UBS_N=n), "-S", program.path, "-o", out])
                    for kernel, figures in kernels_of(open(out).read()).items():
                        if kernel in program.kernels:
                            table.add(kernel, figures, n)
            tables.append(table)
    gate.finish(tables)


main()
