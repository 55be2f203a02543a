# Defines what `cmake --install BUILD --prefix DIR [--component NAME]` installs and what the package of `cpack
# -G DEB` contains.
# Components:
#   library      libubs.so.1, the OpenCV module, the bill of materials, and documents such as the licence
#   development  headers, libubs.a, the packages for find_package(ubs) and pkg-config
#   tools        the executables ubs and ubs-lab, and their manual pages
#   portable     see Portable.cmake; only installed if it is named
#   python       see python/CMakeLists.txt; only installed if it is named
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# The static library contains all archives of ubs in one file. The other libraries that it needs are listed in
# the packages for find_package and pkg-config. A build with CUDA does not make the static library, because every
# program that uses the library would have to link device code. A build with UBS_BUNDLE does not make it either.
set(static_parts ubs_capi ubs_model ubs_run ubs_check ubs_devices ubs_dataset ubs_formats ubs_train ubs_settings ubs_core)
if(UBS_OPENCL)
  list(APPEND static_parts ubs_opencl)
endif()
set(UBS_STATIC_LIBRARIES stdc++ m pthread dl fmt yaml-cpp pugixml z zstd)
if(UBS_OPENCL)
  list(APPEND UBS_STATIC_LIBRARIES OpenCL clblast)
endif()
if(UBS_OPENCV)
  list(APPEND UBS_STATIC_LIBRARIES opencv_core opencv_imgproc opencv_features2d opencv_calib3d
       turbojpeg png16 tiff OpenEXR Iex IlmThread Imath)
endif()
set(UBS_HAS_STATIC OFF)
if(NOT UBS_WITH_CUDA AND NOT UBS_BUNDLE)
  set(UBS_HAS_STATIC ON)
  set(static_library ${PROJECT_BINARY_DIR}/libubs.a)
  set(script "create ${static_library}\n")
  set(static_files)
  foreach(part IN LISTS static_parts)
    string(APPEND script "addlib $<TARGET_FILE:${part}>\n")
    list(APPEND static_files $<TARGET_FILE:${part}>)
  endforeach()
  file(GENERATE OUTPUT ${PROJECT_BINARY_DIR}/libubs.mri CONTENT "${script}save\nend\n")
  add_custom_command(OUTPUT ${static_library}
                     COMMAND ${CMAKE_AR} -M < ${PROJECT_BINARY_DIR}/libubs.mri
                     DEPENDS ${static_parts} ${PROJECT_BINARY_DIR}/libubs.mri VERBATIM)
  add_custom_target(ubs_static ALL DEPENDS ${static_library})
  install(FILES ${static_library} DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
endif()

install(TARGETS ubs_shared EXPORT ubs-targets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library NAMELINK_COMPONENT development)
if(UBS_OPENCV)
  install(TARGETS ubs_opencv_parts LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library)
endif()
install(EXPORT ubs-targets NAMESPACE ubs:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ubs COMPONENT development)
install(DIRECTORY include/ubs DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)
install(TARGETS ubs ubs-lab RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools)
include(Sbom)
install(FILES ${UBS_SBOM} DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT library)
# Manual pages are made from the help texts if help2man is installed.
find_program(HELP2MAN help2man)
if(HELP2MAN AND NOT CMAKE_CROSSCOMPILING)
  set(manual ${PROJECT_BINARY_DIR}/manual)
  add_custom_command(OUTPUT ${manual}/man1/ubs.1
                     COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:ubs> "-DTITLE=Universal Beta Splatting"
                             -DHELP2MAN=${HELP2MAN} -DFOLDER=${manual}/man1 -P ${PROJECT_SOURCE_DIR}/cmake/manual.cmake
                     COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:ubs-lab> "-DTITLE=measurements of Universal Beta Splatting"
                             -DHELP2MAN=${HELP2MAN} -DFOLDER=${manual}/man1 -P ${PROJECT_SOURCE_DIR}/cmake/manual.cmake
                     DEPENDS ubs ubs-lab cmake/manual.cmake VERBATIM)
  add_custom_target(ubs_manual ALL DEPENDS ${manual}/man1/ubs.1)
  install(DIRECTORY ${manual}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR} COMPONENT tools)
endif()
install(FILES LICENSE CHANGELOG.md CITATION.cff DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT library)

configure_package_config_file(cmake/ubs-config.cmake.in ${PROJECT_BINARY_DIR}/ubs-config.cmake
                              INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ubs
                              PATH_VARS CMAKE_INSTALL_LIBDIR CMAKE_INSTALL_INCLUDEDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/ubs-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/ubs-config.cmake ${PROJECT_BINARY_DIR}/ubs-config-version.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/ubs COMPONENT development)
list(TRANSFORM UBS_STATIC_LIBRARIES PREPEND -l OUTPUT_VARIABLE private)
list(JOIN private " " UBS_PRIVATE_LIBRARIES)
file(RELATIVE_PATH UBS_PC_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(cmake/ubs.pc.in ubs.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/ubs.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "The ubs project")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Universal Beta Splatting on OpenCL and CUDA")
set(CPACK_COMPONENTS_ALL library development tools)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS pocl-opencl-icd)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libubs${soversion})
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libubs-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libubs${soversion} (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME ubs)
if(UBS_OPENCV)  # the library package contains the OpenCV module
  set(CPACK_DEBIAN_TOOLS_PACKAGE_DEPENDS "libubs${soversion} (= ${PROJECT_VERSION})")
endif()
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION graphics)
include(CPack)
