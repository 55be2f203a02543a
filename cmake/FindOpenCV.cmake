# Finds OpenCV by its own CMake configuration. If this configuration is missing, finds the headers and the
# libraries of the requested modules instead. In Debian, the configuration is in libopencv-dev, which installs
# every module, so it is missing if only the packages of single modules are installed.
find_package(OpenCV QUIET CONFIG COMPONENTS ${OpenCV_FIND_COMPONENTS})
if(OpenCV_FOUND)
  return()
endif()
find_path(OpenCV_INCLUDE_DIRS opencv2/core.hpp PATH_SUFFIXES opencv4)
set(OpenCV_LIBS)
set(required OpenCV_INCLUDE_DIRS)
foreach(component IN LISTS OpenCV_FIND_COMPONENTS)
  find_library(OpenCV_${component}_LIBRARY opencv_${component})
  list(APPEND OpenCV_LIBS ${OpenCV_${component}_LIBRARY})
  list(APPEND required OpenCV_${component}_LIBRARY)
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCV REQUIRED_VARS ${required})
