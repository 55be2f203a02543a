# SPDX-License-Identifier: Apache-2.0
"""Checks the registers, spills, instructions and accesses to global memory of the CUDA kernels for sm_90. Also checks
that the forward and the backward rasteriser compute the transmittance with the same arithmetic on every
architecture."""

from collections import Counter

import gate
import sass

SOURCES = {"raster_kernels": ["raster_gpu_forward", "raster_gpu_backward", "measure_weights", "sum_slots_scalar"],
           "loss_kernels": ["loss_window", "loss_gradient", "loss_total"],
           "map_kernels": ["project_forward", "project_backward"]}


ARCHITECTURES = [75, 80, 86, 90, 120]


def unlike_transmittances(nvcc, nvdisasm, scratch):
    """Returns the architectures on which the forward and the backward rasteriser do not compute the transmittance after
    a splat with the same instructions. On such an architecture, the gradient would not be that of the rendered
    image."""
    root, bad = gate.KERNELS.parent, []
    for architecture in ARCHITECTURES:
        binary = f"{scratch}/raster.cubin"
        gate.run([nvcc, "-cubin", "-std=c++17", f"-I{root}", f"-arch=sm_{architecture}",
                  f"{root}/cuda_backend/raster_kernels.cu", "-o", binary])
        functions = sass.functions(gate.run([nvdisasm, "-c", binary]))
        found = {kernel: set().union(*(sass.transmittances(code) for name, code in functions.items() if kernel in name))
                 for kernel in ("raster_gpu_forward", "raster_gpu_backward")}
        # The loop of the forward kernel blends several splats one after the other. The longest entry is that of the
        # transmittance after the last of these splats, which contains the arithmetic of all of them.
        forward, backward = max(found["raster_gpu_forward"], key=len), min(found["raster_gpu_backward"], key=len)
        splats = forward.count("MUFU.EX2")
        counts = ", ".join(f"{n} {opcode}" for opcode, n in Counter(forward).items())
        print(f"sm_{architecture}: the forward rasteriser computes the transmittance of {splats} splats with {counts}")
        # If the compiler contracts operations in only one kernel, FFMA replaces FMUL and FADD there. FADD is not
        # compared, because for a loop that the compiler has rotated, the analysis also counts an FADD of the previous
        # splat.
        unlike = [name for name in {*forward, *backward} - {"FADD"} if forward.count(name) != splats * backward.count(name)]
        if len(found["raster_gpu_backward"]) != 1 or unlike:
            print(f"FAILED: sm_{architecture}: for one splat, the backward rasteriser uses other instructions: "
                  f"{sorted(found['raster_gpu_backward'])}")
            bad.append(architecture)
    return bad


def main():
    args = gate.arguments(__doc__)
    nvcc = gate.find(args.tools, ["nvcc"], ["/usr/local/cuda/bin"])
    if not nvcc:
        gate.skip("nvcc", "install the CUDA toolkit (12 or later)")
    nvdisasm = sass.disassembler(args.tools)
    table = gate.Table("cuda_sm_90")
    root = gate.KERNELS.parent
    with gate.scratch_folder() as scratch:
        for source, kernels in SOURCES.items():
            for n in ([3, 6, 7] if gate.ALL else [6]) if source == "map_kernels" else [None]:
                binary = f"{scratch}/{source}.cubin"
                log = gate.run([nvcc, "-cubin", "-std=c++17", f"-I{root}", "-arch=sm_90", "-Xptxas", "-v",
                                *([f"-DUBS_N={n}"] if n else []), f"{root}/cuda_backend/{source}.cu", "-o", binary])
                resources = sass.resources(log)
                for mangled, code in sass.functions(gate.run([nvdisasm, "-c", binary])).items():
                    kernel = next((k for k in sorted(kernels, key=len, reverse=True) if f"{len(k)}{k}" in mangled), None)
                    if kernel:  # the loss kernels with a mask are in the namespace `masked`
                        kernel += ", masked" if "6masked" in mangled else ""
                        table.add(kernel, {**resources[mangled], **sass.counts(code)}, n)
        unlike = unlike_transmittances(nvcc, nvdisasm, scratch)
    if unlike:
        table.bad.append("the forward and the backward rasteriser compute the transmittance differently on the "
                         f"architectures {unlike}")
    gate.finish([table])


main()
