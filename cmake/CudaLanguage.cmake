# Finds a CUDA compiler as requested by UBS_CUDA (AUTO, ON, OFF) and sets UBS_WITH_CUDA. The architectures are
# CMAKE_CUDA_ARCHITECTURES or, if that is not set, the environment variable CUDAARCHS or, if that is not set
# either, those of ubs_cuda_architectures. With pip, they are those of the GPUs of this machine or, if it has none,
# only PTX of the oldest architecture, which the drivers of all GPUs compile at first use. This is faster to build.
# Measured sizes and times are in docs/cuda.md.
include(${CMAKE_CURRENT_LIST_DIR}/CudaArchitectures.cmake)
set(UBS_WITH_CUDA OFF)
if(UBS_CUDA STREQUAL "OFF")
  return()
endif()
include(CheckLanguage)
check_language(CUDA)
if(NOT CMAKE_CUDA_COMPILER)
  if(UBS_CUDA STREQUAL "ON")
    message(FATAL_ERROR "UBS_CUDA=ON, but no CUDA compiler was found: put nvcc on PATH or set CUDACXX")
  endif()
  message(STATUS "No CUDA compiler was found: the CUDA back end is not built")
  return()
endif()
set(chosen ${CMAKE_CUDA_ARCHITECTURES})
enable_language(CUDA)
find_package(CUDAToolkit 12 REQUIRED)
# enable_language writes its default to the cache. Remove it, or the next run of CMake would take it for a
# choice of the user.
if(NOT chosen)
  unset(CMAKE_CUDA_ARCHITECTURES CACHE)
  set(CMAKE_CUDA_ARCHITECTURES $ENV{CUDAARCHS})
  if(NOT CMAKE_CUDA_ARCHITECTURES AND SKBUILD)
    set(CMAKE_CUDA_ARCHITECTURES ${CMAKE_CUDA_ARCHITECTURES_NATIVE})
    if(NOT CMAKE_CUDA_ARCHITECTURES)
      set(CMAKE_CUDA_ARCHITECTURES 75-virtual)
    endif()
  endif()
  if(NOT CMAKE_CUDA_ARCHITECTURES)
    ubs_cuda_architectures(${CMAKE_CUDA_COMPILER_VERSION} CMAKE_CUDA_ARCHITECTURES)
  endif()
endif()
set(UBS_WITH_CUDA ON)
message(STATUS "CUDA back end for ${CMAKE_CUDA_ARCHITECTURES}")
