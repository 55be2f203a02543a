# ubs_cuda_architectures(VERSION OUT): sets OUT to the architectures that a CUDA compiler of this version
# generates code for, if the user does not choose any. These are machine code from Turing on, and PTX for one
# architecture, which drivers compile for cards between these (sm_110) and for later ones. PTX is not made for
# the newest architecture, because it only runs on the same or newer architectures.
function(ubs_cuda_architectures version out)
  set(list 75-real 80-real 86-real 89-real)
  if(version VERSION_GREATER_EQUAL 12.8)
    list(APPEND list 90-real 100 120-real)
  else()
    list(APPEND list 90)
  endif()
  set(${out} ${list} PARENT_SCOPE)
endfunction()
