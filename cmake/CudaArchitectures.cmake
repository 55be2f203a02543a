# ubs_cuda_architectures(VERSION OUT): what a compiler of that version makes code for where nobody chooses: machine code
# from Turing on, and PTX of one, which drivers compile for cards between those (sm_110) and for later ones. That is not
# the newest: PTX runs on what is newer than itself only.
function(ubs_cuda_architectures version out)
  set(list 75-real 80-real 86-real 89-real)
  if(version VERSION_GREATER_EQUAL 12.8)
    list(APPEND list 90-real 100 120-real)
  else()
    list(APPEND list 90)
  endif()
  set(${out} ${list} PARENT_SCOPE)
endfunction()
