# SPDX-License-Identifier: Apache-2.0
# Installs the library of the build folder BUILD into a folder in WORK. Then builds and runs the project in
# tests/library/external with CMake, using the shared library and, if STATIC is set, the static library. Finally, builds
# and runs its C program with pkg-config.
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE text ERROR_VARIABLE text)
  message("${text}")
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "this command ended with an error (${code}): ${ARGN}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
foreach(component library development)
  run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/ubs --component ${component})
endforeach()
run(${CMAKE_COMMAND} -G Ninja -S ${SOURCE} -B ${WORK}/build -DCMAKE_PREFIX_PATH=${WORK}/ubs -DCMAKE_BUILD_TYPE=Release
    -DCMAKE_C_COMPILER=${C_COMPILER} -DCMAKE_CXX_COMPILER=${CXX_COMPILER} -DCMAKE_EXE_LINKER_FLAGS=${LINKER_FLAGS})
run(${CMAKE_COMMAND} --build ${WORK}/build)
set(programs with_c with_cpp)
if(STATIC)
  list(APPEND programs with_archive)
endif()
foreach(program IN LISTS programs)
  run(${WORK}/build/${program})
endforeach()

find_program(pkg_config pkg-config)
if(NOT pkg_config)
  message("SKIPPED: pkg-config is missing, so ubs.pc is not tested")
  return()
endif()
file(GLOB_RECURSE pc ${WORK}/ubs/*/ubs.pc)
cmake_path(GET pc PARENT_PATH folder)
set(ENV{PKG_CONFIG_PATH} ${folder})
execute_process(COMMAND ${pkg_config} --cflags --libs ubs OUTPUT_VARIABLE flags
                OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(flags)
run(${C_COMPILER} ${SOURCE}/main.c -o ${WORK}/with_pkg_config ${flags} -Wl,-rpath,${folder}/..)
run(${WORK}/with_pkg_config)
