# The copies of raster_kernels.cu beside the plain one (cuda_backend/kernels.hpp), each an object library: names, and the
# switches that they stand for. Also for the host build of tests/cuda.
set(UBS_CUDA_RASTER_FORMS depth splats turns depth_turns splats_turns)
function(ubs_cuda_raster_form target form)
  target_compile_definitions(${target} PRIVATE UBS_RASTER_FORM=${form})
  foreach(switch depth=UBS_DEPTH splats=UBS_SPLAT_BACKWARD turns=UBS_TILE_TURNS)
    string(REPLACE "=" ";" switch ${switch})
    list(POP_FRONT switch word macro)
    if(form MATCHES ${word})
      target_compile_definitions(${target} PRIVATE ${macro}=1)
    endif()
  endforeach()
endfunction()
