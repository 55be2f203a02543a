# SPDX-License-Identifier: Apache-2.0
"""Checks the registers, the stack and the instructions of the OpenCL kernels on NVIDIA GPUs. The kernels are compiled
by clang for nvptx with libclc, and then by ptxas.

The OpenCL compiler in NVIDIA's driver is a different one, so these results only show approximately which resources the
sources require. libclc has no functions such as native_log2() for these GPUs. This script defines them with the
instructions that NVIDIA documents for them."""

import gate
import sass

NATIVE = {"native_log2": "lg2.approx.f32", "native_exp2": "ex2.approx.ftz.f32", "native_recip": "rcp.approx.ftz.f32"}


def write_natives(path):
    with open(path, "w") as file:
        for name, instruction in NATIVE.items():
            file.write(f'static inline float ptx_{name}(float x) {{ float y; __asm("{instruction} %0, %1;" : "=f"(y) : "f"(x)); '
                       f"return y; }}\n#define {name} ptx_{name}\n")


def main():
    args = gate.arguments(__doc__)
    clang = gate.find(args.tools, ["clang-15", "clang"])
    library = next((f for f in [args.tools / "root/usr/lib/clc/nvptx64--nvidiacl.bc",
                                gate.pathlib.Path("/usr/lib/clc/nvptx64--nvidiacl.bc")] if f.exists()), None)
    if not clang:
        gate.skip("clang", "install clang-15")
    if not library:
        gate.skip("libclc for nvptx64--nvidiacl", "install libclc-15, or run tools/setup.sh gates")
    ptxas = gate.find(args.tools, ["ptxas"], ["/usr/local/cuda/bin"])
    if not ptxas:
        gate.skip("ptxas", "install the CUDA toolkit or nvidia-cuda-nvcc of PyPI, or run tools/setup.sh gates")
    nvdisasm = sass.disassembler(args.tools)
    table = gate.Table("opencl_sm_90")
    with gate.scratch_folder() as scratch:
        natives = f"{scratch}/natives.h"
        write_natives(natives)
        for program in gate.programs(args.programs):
            for n in gate.dims(program):
                text, binary = f"{scratch}/{program.name}.ptx", f"{scratch}/{program.name}.cubin"
                gate.run([clang, "-x", "cl", "-target", "nvptx64--nvidiacl", "-O3", "-Xclang", "-target-cpu", "-Xclang",
                          "sm_86", "-Xclang", "-target-feature", "-Xclang", "+ptx75", "-Xclang",
                          "-finclude-default-header", "-Xclang", "-mlink-builtin-bitcode", "-Xclang", library,
                          "-include", natives,
                          *program.options_with(UBS_SUBGROUPS=2, UBS_N=n), "-S", program.path, "-o", text])
                resources = sass.resources(gate.run([ptxas, "-arch=sm_90", "-v", text, "-o", binary]))
                codes = sass.functions(gate.run([nvdisasm, "-c", binary]))
                for kernel in program.kernels:
                    table.add(kernel, {**resources[kernel], **sass.counts(codes[kernel])}, n)
    gate.finish([table])


main()
