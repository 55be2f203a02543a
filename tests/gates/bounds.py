# SPDX-License-Identifier: Apache-2.0
"""Contains upper bounds for the figures of each kernel, by target. A bound is slightly larger than the value that was
observed on 2026-11-21 (docs/results) or on the date in a comment, so that other minor versions of a compiler also pass.
If a figure improves, lower its bound. Scratch, stack and spills without a bound must be 0. Do not add bounds for these
three figures of the rasterisers, which must always be 0.

    vgpr, registers          number of registers per work-item
    lds                      bytes of local memory per work-group
    scratch, stack, private  bytes of memory per work-item (on Xe: per thread)
    spill                    number of spilled registers on AMD; bytes of spilled registers on other targets
    instructions             number of instructions of the whole kernel
    visit                    number of instructions of the loop that blends splats at one pixel; some compilers unroll
                             it, so one pass may blend several splats
    narrow                   number of instructions that load or store one word of global memory or less"""

BOUNDS = {
    # clang 15.0.6, ROCm's device libraries 5.2.3
    "gfx1030": {
        # The observed number of registers is 126. It was 124 before the Newton step for 1/z was added (2026-11-28), and
        # 112 before the results of a splat became independent of its neighbours (2026-11-26). Registers are allocated
        # in blocks of eight, so the occupancy is the same for 121 to 128 registers.
        "project_forward": {"vgpr": 128, "narrow": 44},
        "project_backward": {"vgpr": 256, "narrow": 150},
        "raster_gpu_forward": {"vgpr": 96, "lds": 12288, "narrow": 14},
        "raster_gpu_backward": {"vgpr": 64, "lds": 28672, "narrow": 9},
        "sum_slots_scalar": {"vgpr": 16, "narrow": 8},
        "loss_window": {"vgpr": 80},
        "loss_gradient": {"vgpr": 56},
    },
    "gfx90a": {
        "project_forward": {"vgpr": 136, "narrow": 44},
        # Registers are spilled to accumulation registers, not to memory.
        "project_backward": {"vgpr": 320, "spill": 8, "narrow": 150},
        "raster_gpu_forward": {"vgpr": 112, "lds": 12288, "narrow": 14},
        "raster_gpu_backward": {"vgpr": 72, "lds": 28672, "narrow": 9},
        "sum_slots_scalar": {"vgpr": 18, "narrow": 8},
        "loss_window": {"vgpr": 80},
        "loss_gradient": {"vgpr": 64},
    },
    # clang 15.0.6, libclc 15.0.6, ptxas 13.0
    "opencl_sm_90": {
        "project_forward": {"registers": 168, "instructions": 6330, "narrow": 64},
        "project_backward": {"registers": 255, "instructions": 11000, "narrow": 165},
        # Since 2026-11-27, long lists are rendered in parts (kernels/gpu/list_parts.h). This needs an unrolled loop
        # with 64 loads of the transmittances in front of a part.
        "raster_gpu_forward": {"registers": 64, "instructions": 1600, "visit": 56, "narrow": 76},
        "raster_gpu_backward": {"registers": 48, "instructions": 820, "visit": 148, "narrow": 12},
        "sum_slots_scalar": {"registers": 36, "instructions": 370, "narrow": 34},
        "loss_window": {"registers": 52, "instructions": 1140},
        "loss_gradient": {"registers": 68, "instructions": 850},
        "measure_weights": {"registers": 36, "visit": 68},
    },
    # nvcc and ptxas 13.0
    "cuda_sm_90": {
        # One pass of the loop of raster_gpu_forward processes three splats.
        "raster_gpu_forward": {"registers": 60, "visit": 144, "narrow": 52},
        "raster_gpu_backward": {"registers": 48, "visit": 136, "narrow": 13},
        "measure_weights": {"registers": 36, "visit": 136, "narrow": 20},
        "sum_slots_scalar": {"registers": 36, "instructions": 420, "narrow": 34},
        # The values of the following kernels were observed on 2026-11-28.
        "loss_window": {"registers": 52, "instructions": 1340, "narrow": 20},
        "loss_window, masked": {"registers": 52, "instructions": 1440, "narrow": 28},
        "loss_gradient": {"registers": 44, "instructions": 690, "narrow": 48},
        "loss_gradient, masked": {"registers": 36, "instructions": 750, "narrow": 52},
        "loss_total": {"registers": 36, "instructions": 720, "narrow": 8},
        "loss_total, masked": {"registers": 36, "instructions": 720, "narrow": 8},
        "project_forward": {"registers": 128, "instructions": 4930, "narrow": 64},
        "project_backward": {"registers": 240, "instructions": 10080, "narrow": 200},
    },
    # ocloc 22.43 of intel-opencl-icd with its graphics compiler. project.cl is compiled with 256 registers per thread.
    "xe_dg2": {"project_backward": {"spill": 0}},
}
