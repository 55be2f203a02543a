BOUNDS = {"gfx1030": {}, "gfx90a": {}, "opencl_sm_90": {}, "cuda_sm_90": {}, "xe_dg2": {}}
