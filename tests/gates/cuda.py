# SPDX-License-Identifier: Apache-2.0
"""Checks the number of instructions of the visit loops, and accesses to global memory, of the CUDA kernels for sm_90.
Also checks that both rasterisers compute the transmittance with the same arithmetic on every architecture."""

from collections import Counter

import gate
import sass

SOURCES = {"raster_kernels": ["raster_gpu_forward", "raster_gpu_backward", "measure_weights", "sum_slots_scalar"],
           "loss_kernels": ["loss_window", "loss_gradient", "loss_total"],
           "map_kernels": ["project_forward", "project_backward"]}


ARCHITECTURES = [75, 80, 86, 90, 120]


def unlike_transmittances(nvcc, nvdisasm, scratch):
    """Returns the architectures on which the two rasterisers do not compute the transmittance behind a splat with the
    same instructions. There, the gradient would be that of another image."""
    root, bad = gate.KERNELS.parent, []
    for architecture in ARCHITECTURES:
        binary = f"{scratch}/raster.cubin"
        gate.run([nvcc, "-cubin", "-std=c++17", f"-I{root}", f"-arch=sm_{architecture}",
                  f"{root}/cuda_backend/raster_kernels.cu", "-o", binary])
        functions = sass.functions(gate.run([nvdisasm, "-c", binary]))
        found = {kernel: set().union(*(sass.transmittances(code) for name, code in functions.items() if kernel in name))
                 for kernel in ("raster_gpu_forward", "raster_gpu_backward")}
        # The forward kernel blends several splats one after the other, so after the last one it has computed the
        # transmittance of all of them.
        forward, backward = max(found["raster_gpu_forward"], key=len), min(found["raster_gpu_backward"], key=len)
        splats = forward.count("MUFU.EX2")
        counts = ", ".join(f"{n} {opcode}" for opcode, n in Counter(forward).items())
        print(f"sm_{architecture}: transmittance in forward, of {splats} splats: {counts}")
        # Contraction replaces FMUL and FADD by FFMA. FADD is not compared, because for a loop that the compiler has
        # rotated, the analysis also counts an FADD of the previous splat.
        unlike = [name for name in {*forward, *backward} - {"FADD"} if forward.count(name) != splats * backward.count(name)]
        if len(found["raster_gpu_backward"]) != 1 or unlike:
            print(f"FAILED: sm_{architecture}: transmittance in backward {sorted(found['raster_gpu_backward'])}")
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
                    if kernel:  # the masked variant of the loss is in a namespace of that name
                        kernel += ", masked" if "6masked" in mangled else ""
                        table.add(kernel, {**resources[mangled], **sass.counts(code)}, n)
        unlike = unlike_transmittances(nvcc, nvdisasm, scratch)
    if unlike:
        table.bad.append(f"transmittance of forward and backward on sm_{unlike}")
    gate.finish([table])


main()
