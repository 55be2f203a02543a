# Defines targets for the libraries in a folder created by tools/make_bundle.sh (UBS_BUNDLE). The targets have the
# names that find_package and pkg_check_modules would give them. This file is used on machines that only have a
# compiler, CMake and the CUDA toolkit. Some libraries are header-only; the others are linked statically.
foreach(part include/fmt/format.h include/CLI/CLI.hpp lib/libyaml-cpp.a lib/libz.a lib/libzstd.a)
  if(NOT EXISTS ${UBS_BUNDLE}/${part})
    message(FATAL_ERROR "UBS_BUNDLE: ${UBS_BUNDLE}/${part} is missing: create the folder with tools/make_bundle.sh")
  endif()
endforeach()
function(ubs_bundled name)  # name [archive]
  if(ARGN)
    add_library(${name} STATIC IMPORTED GLOBAL)
    set_target_properties(${name} PROPERTIES IMPORTED_LOCATION ${UBS_BUNDLE}/lib/${ARGV1})
  else()
    add_library(${name} INTERFACE IMPORTED GLOBAL)
  endif()
  target_include_directories(${name} SYSTEM INTERFACE ${UBS_BUNDLE}/include)
endfunction()
foreach(header_only fmt::fmt CLI11::CLI11 nlohmann_json::nlohmann_json nanoflann::nanoflann)
  ubs_bundled(${header_only})
endforeach()
target_compile_definitions(fmt::fmt INTERFACE FMT_HEADER_ONLY=1)
ubs_bundled(yaml-cpp libyaml-cpp.a)
ubs_bundled(ZLIB::ZLIB libz.a)
ubs_bundled(PkgConfig::zstd libzstd.a)
