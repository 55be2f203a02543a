# cmake --install BUILD --component portable --prefix DIR makes a folder whose programs run wherever it is copied to.
# DIR/bin has the executables ubs and ubs-lab, the device tests and tools/gpu_check.sh. DIR/lib has the libraries that
# they need, except libc, the C++ runtime and drivers, which the target machine must have. DIR/source has the sources
# that the device tests read. The libraries are found through RPATH $ORIGIN/../lib, because RUNPATH would not apply to
# libraries that these libraries load.
set(portable ubs ubs-lab)
if(UBS_TESTS)
  list(APPEND portable test_stages test_pipeline test_packed test_metrics test_variants test_work test_approximations
       test_reduce)
endif()
foreach(target IN LISTS portable)
  # Use the same RPATH in the build folder. If installation changes an RPATH, CMake pads it with ":". The
  # loader would then search for libraries in the working directory, which may contain untrusted files.
  set_target_properties(${target} PROPERTIES INSTALL_RPATH "$ORIGIN/../lib" INSTALL_RPATH_USE_LINK_PATH ON
                                             BUILD_WITH_INSTALL_RPATH ON)
  target_link_options(${target} PRIVATE LINKER:--disable-new-dtags)
endforeach()
install(TARGETS ${portable} RUNTIME_DEPENDENCY_SET ubs_libraries RUNTIME DESTINATION bin COMPONENT portable
        EXCLUDE_FROM_ALL)
if(UBS_OPENCV)
  set_target_properties(ubs_opencv_parts PROPERTIES INSTALL_RPATH "$ORIGIN")
  target_link_options(ubs_opencv_parts PRIVATE LINKER:--disable-new-dtags)
  install(TARGETS ubs_opencv_parts RUNTIME_DEPENDENCY_SET ubs_libraries LIBRARY DESTINATION lib COMPONENT portable
          EXCLUDE_FROM_ALL)
endif()
install(RUNTIME_DEPENDENCY_SET ubs_libraries
        PRE_EXCLUDE_REGEXES "^lib(c|m|dl|rt|pthread|stdc\\+\\+|gcc_s|cuda|nvidia-.*)\\.so.*" "^ld-linux.*"
        LIBRARY DESTINATION lib COMPONENT portable EXCLUDE_FROM_ALL)
install(PROGRAMS tools/gpu_check.sh DESTINATION bin COMPONENT portable EXCLUDE_FROM_ALL)
# Files that device tests read or copy (tests/support/source_folder.hpp).
install(DIRECTORY kernels DESTINATION source COMPONENT portable EXCLUDE_FROM_ALL)
install(DIRECTORY tests/support DESTINATION source/tests COMPONENT portable EXCLUDE_FROM_ALL
        FILES_MATCHING PATTERN "*.cl" PATTERN "*.h")
install(FILES host/opencl/projection.cpp DESTINATION source/host/opencl COMPONENT portable EXCLUDE_FROM_ALL)
