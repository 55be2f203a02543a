# cmake --install BUILD --component portable --prefix DIR: a folder that runs where it is copied to, with the
# executable, the device tests, tools/gpu_check.sh and the libraries they need beyond libc and the C++ runtime
# (DIR/bin, DIR/lib, found through RPATH $ORIGIN/../lib, which unlike RUNPATH also holds for what the libraries load).
# Drivers stay the target machine's own.
set(portable ubs ubs-lab)
if(UBS_TESTS)
  list(APPEND portable test_stages test_pipeline test_packed test_metrics test_variants test_work test_approximations
       test_reduce)
endif()
foreach(target IN LISTS portable)
  # The same one in the build folder: CMake pads one that installation changes with ":", and the loader then looks for
  # libraries in the working folder, which may be anybody's data.
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
