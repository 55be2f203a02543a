# ubs_cuda_architectures(VERSION OUT): sets OUT to the architectures that a CUDA compiler of this version
# generates code for, if the user does not choose any. There is machine code for GPUs from Turing (sm_75) on, and
# PTX for one architecture. Drivers compile this PTX for all newer GPUs without machine code. From version 12.8 on,
# the PTX is for sm_100 and not for sm_120, because PTX only runs on the same or newer architectures, and PTX for
# sm_120 would not run on sm_110.
function(ubs_cuda_architectures version out)
  set(list 75-real 80-real 86-real 89-real)
  if(version VERSION_GREATER_EQUAL 12.8)
    list(APPEND list 90-real 100 120-real)
  else()
    list(APPEND list 90)
  endif()
  set(${out} ${list} PARENT_SCOPE)
endfunction()
