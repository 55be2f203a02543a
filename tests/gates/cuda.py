# SPDX-License-Identifier: Apache-2.0
"""Instructions of the visit loops, and accesses to global memory, of the CUDA kernels for sm_90."""

import gate
import sass

SOURCES = {"raster_kernels": ["raster_forward", "raster_backward", "measure_weights", "sum_slots"],
           "map_kernels": ["project_forward", "project_backward"]}


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
                    if kernel:
                        table.add(kernel, {**resources[mangled], **sass.counts(code)}, n)
    gate.finish([table])


main()
