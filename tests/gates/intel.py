# SPDX-License-Identifier: Apache-2.0
"""Checks the spills of the OpenCL kernels on Intel GPUs of the type Xe (DG2, sold as Arc), and prints the private
memory and the vector width of each kernel. The kernels are compiled by ocloc of intel-opencl-icd."""

import os
import re

import gate


def kernels_of(binary):
    """Returns {kernel: figures} from the YAML text in the section .ze_info of a binary."""
    text = binary[binary.rindex(b"\nkernels:"):].decode(errors="replace")
    found = {}
    for part in re.split(r"^  - name:\s+", text.split("\nkernels_misc_info")[0], flags=re.M)[1:]:
        name = part.split()[0]
        if name.startswith("Intel_Symbol_Table"):
            continue
        figures = {"simd": int(re.search(r"simd_size:\s+(\d+)", part)[1])}
        for what, usage in (("spill", "spill_fill_space"), ("private", "private_space")):
            sizes = re.findall(rf"usage:\s+{usage}\s+size:\s+(\d+)", part)
            figures[what] = sum(map(int, sizes))
        found[name] = figures
    return found


def main():
    args = gate.arguments(__doc__)
    ocloc = gate.find(args.tools, ["ocloc"])
    if not ocloc:
        gate.skip("ocloc", "install intel-opencl-icd, or run tools/setup.sh gates to unpack it in the build folder")
    libraries = args.tools / "root/usr/lib/x86_64-linux-gnu"
    environment = {**os.environ, "LD_LIBRARY_PATH": f"{libraries}:{os.environ.get('LD_LIBRARY_PATH', '')}"}
    table = gate.Table("xe_dg2")
    with gate.scratch_folder() as scratch:
        for program in gate.programs(args.programs):
            for n in gate.dims(program):
                options = program.options_with(UBS_SUBGROUPS=1, UBS_N=n)
                if "project_backward" in program.kernels:  # host/opencl/projection.cpp also uses this option
                    options = [*options, "-cl-intel-256-GRF-per-thread"]
                if "-DUBS_SUBGROUPS=1" in options:
                    options = [o for o in options if not o.startswith("-cl-std")] + ["-cl-std=CL3.0"]
                gate.run([ocloc, "compile", "-file", program.path, "-device", "dg2", "-options", " ".join(options),
                          "-internal_options", "-cl-intel-allow-zebin -ze-opt-enable-zebin", "-out_dir", scratch,
                          "-output", program.name, "-output_no_suffix"], env=environment)
                for kernel, figures in kernels_of(open(f"{scratch}/{program.name}", "rb").read()).items():
                    if kernel in program.kernels:
                        table.add(kernel, figures, n)
    gate.finish([table])


main()
